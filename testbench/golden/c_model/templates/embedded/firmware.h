/* The firmware for a small processor: one call per edge of the 26 MHz clock, everything in static memory. */
#ifndef GYRO_FIRMWARE_H
#define GYRO_FIRMWARE_H

#include "top.h"

extern gyro_top_Params gyro_params;
extern gyro_top_State gyro_state[2]; /* before and behind an edge, in turn */
extern gyro_top_Inputs gyro_inputs;
extern gyro_top_Pins gyro_pins;
extern int gyro_now; /* which of the two states holds */

void gyro_clock(void);

#endif
