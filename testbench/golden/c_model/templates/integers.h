/* Numbers of the model: int64_t, with the shifts that C99 leaves open for negative numbers.

   A value outside its format may overflow, which is undefined: the model checks no input. */
#ifndef GYRO_INTEGERS_H
#define GYRO_INTEGERS_H

#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* x * 2^n, 0 <= n <= 62 */
inline int64_t gyro_shl(int64_t x, int64_t n) { return x * (INT64_C(1) << n); }

/* Largest integer not above x / 2^n, 0 <= n <= 62 */
inline int64_t gyro_shr(int64_t x, int64_t n) { return x < 0 ? ~(~x >> n) : x >> n; }

inline int64_t gyro_abs(int64_t x) { return x < 0 ? -x : x; }

#ifdef __cplusplus
}
#endif

#endif
