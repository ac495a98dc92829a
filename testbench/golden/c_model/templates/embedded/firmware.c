#include "firmware.h"

gyro_top_Params gyro_params;
gyro_top_State gyro_state[2];
gyro_top_Inputs gyro_inputs;
gyro_top_Pins gyro_pins;
int gyro_now;

void gyro_clock(void) {
    gyro_top_step(&gyro_params, &gyro_state[gyro_now], &gyro_inputs, &gyro_state[gyro_now ^ 1]);
    gyro_now ^= 1;
    gyro_top_pins(&gyro_params, &gyro_state[gyro_now], &gyro_pins);
}
