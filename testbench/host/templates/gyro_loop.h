/* A gyroscope at the pins of its port: the RTL in Verilator, chips and plant around it, locked at time 0.
 *
 * Simulated time passes in these calls alone. It begins with the files of the present folder.
 */
#ifndef GYRO_LOOP_H
#define GYRO_LOOP_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#include "gyro_bus.h" /* the calls of the port */

/* Pin DATA_READY: there is a sample that was not read. */
int gyro_loop_data_ready(void);

void gyro_loop_wait(double time_s);

/* Rate of rotation (deg/s), from the next frame of 8 kHz on. */
void gyro_loop_turn(double rate_deg_per_s);

/* Simulated time (s). */
double gyro_loop_time(void);

#ifdef __cplusplus
}
#endif

#endif
