// gyro_loop.h: the calls that do not depend on the port
#include "gyro_loop.h"
#include "loop.h"

static const double CLOCK_HZ = 26e6, RAD_PER_DEG = 3.14159265358979323846 / 180;

int gyro_loop_data_ready(void) { return loop().top.o_data_ready; }

void gyro_loop_wait(double time_s) {
    for (i64 end = loop().now + (i64)std::floor(time_s * CLOCK_HZ + 0.5); loop().now < end;) loop().clock();
}

void gyro_loop_turn(double rate_deg_per_s) { loop().board.rate = rate_deg_per_s * RAD_PER_DEG; }

double gyro_loop_time(void) { return (double)loop().now / CLOCK_HZ; }
