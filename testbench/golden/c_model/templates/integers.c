#include "integers.h"

extern inline int64_t gyro_shl(int64_t x, int64_t n);
extern inline int64_t gyro_shr(int64_t x, int64_t n);
extern inline int64_t gyro_abs(int64_t x);
