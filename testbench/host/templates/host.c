/* Reads the gyroscope as its user does: samples at DATA_READY, a calibration at two rates, then a rate that it measures. */
#include <math.h>

#include "access.h"

enum { SETTLE = 100, BLOCKS = 10, OF_BLOCK = 25 };
static int lost;

static int64_t nearest(double value) { return (int64_t)floor(value + 0.5); }

static gyro_sample next_sample(void) {
    static gyro_sample before;
    static int begun;
    while (!gyro_loop_data_ready()) gyro_loop_wait(1e-6);
    gyro_sample s = read_sample();
    if (begun++) lost += gyro_samples_lost(before, s);
    return before = s;
}

/* Mean rate (deg/s) at a rate of rotation, with its standard error from the spread of blocks */
static double measured(double turn_deg_per_s, double *error) {
    double sum = 0, squares = 0;
    gyro_loop_turn(turn_deg_per_s);
    for (int n = 0; n < SETTLE; n++) next_sample();
    for (int b = 0; b < BLOCKS; b++) {
        double block = 0;
        for (int n = 0; n < OF_BLOCK; n++) block += gyro_deg_per_s(next_sample().rate) / OF_BLOCK;
        sum += block;
        squares += block * block;
    }
    double mean = sum / BLOCKS;
    *error = sqrt((squares / BLOCKS - mean * mean) / (BLOCKS - 1));
    printf("%6.1f deg/s: reads %9.4f +- %.4f deg/s\n", turn_deg_per_s, mean, *error);
    return mean;
}

int main(void) {
    const gyro_register scale = GYRO_REGISTER(RATE_SCALE), bias = GYRO_REGISTER(RATE_BIAS);
    double of_zero, of_hundred, of_rate;
    uint64_t identity = (uint64_t)read_register(GYRO_REGISTER(IDENTITY));
    printf("%c%c%c%c, map %d\n", (int)(identity >> 40 & 255), (int)(identity >> 32 & 255), (int)(identity >> 24 & 255),
           (int)(identity >> 16 & 255), (int)(identity & 0xFFFF));
    printf("%s, %.1f degC\n", read_register(GYRO_REGISTER(STATE)) == GYRO_STATE__LOCKED ? "locked" : "not locked",
           gyro_degc(read_register(GYRO_REGISTER(TEMPERATURE))));
    double zero = measured(0, &of_zero), hundred = measured(100, &of_hundred);
    double old = (double)read_register(scale) * GYRO_RATE_SCALE_LSB, gain = 100 / (hundred - zero);
    write_register(bias, nearest(zero / GYRO_RATE_LSB / old));
    write_register(scale, nearest(gain * old / GYRO_RATE_SCALE_LSB));
    double rate = measured(-50, &of_rate);
    /* -50 deg/s is extrapolated from the two: bias counts 1.5 times, scale -0.5 times */
    double error = sqrt(of_rate * of_rate + pow(1.5 * of_zero, 2) + pow(0.5 * of_hundred, 2));
    printf("calibrated: %.3f +- %.3f deg/s, lost samples: %d\n", rate, error, lost);
    return 0;
}
