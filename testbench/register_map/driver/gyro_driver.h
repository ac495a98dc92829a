/* Registers of the gyroscope: values to words of the bus and back, CRC of a frame, physical units. C99, no allocation.
 *
 * gyro_register r = GYRO_REGISTER(RATE);
 * uint32_t word[2];                  read the bus at r.address, and at r.address + 4 if gyro_words(r) is 2, in this order
 * double rate = gyro_deg_per_s(gyro_unpack(r, word));
 */
#ifndef GYRO_DRIVER_H
#define GYRO_DRIVER_H

#include <stddef.h>
#include <stdint.h>

#include "gyro_formats.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint16_t address; /* bytes */
    uint8_t width;    /* bits, 1 to 62 */
    uint8_t is_signed;
} gyro_register;

#define GYRO_REGISTER(name) ((gyro_register){GYRO_##name##_ADDRESS, GYRO_##name##_WIDTH, GYRO_##name##_SIGNED})

/* Words of 32 bits on the bus: 1 or 2. */
int gyro_words(gyro_register r);

/* Words of a value, the low one first; returns how many, or 0 (nothing written) if the register cannot hold it. */
int gyro_pack(gyro_register r, int64_t raw, uint32_t word[2]);

/* Value of a register's words; bits above its width are ignored, and so is word[1] of a register of one word. */
int64_t gyro_unpack(gyro_register r, const uint32_t word[2]);

/* Value of the low `width` bits, 1 to 62, as two's complement. */
int64_t gyro_sign_extend(uint64_t bits, int width);

/* CRC-8/SAE-J1850 of bytes in the order of the wire: x^8 + x^4 + x^3 + x^2 + 1 (0x1D), initial value and final XOR 0xFF. */
uint8_t gyro_crc8(const uint8_t *bytes, size_t count);

/* Rate of the register RATE (deg/s). */
double gyro_deg_per_s(int64_t rate);

/* Temperature of the register TEMPERATURE (degC): the middle of its step. */
double gyro_degc(int64_t temperature);

#ifdef __cplusplus
}
#endif

#endif /* GYRO_DRIVER_H */
