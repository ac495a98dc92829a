#include "gyro_driver.h"

static uint64_t mask(int width) { return (UINT64_C(1) << width) - 1; }

int gyro_words(gyro_register r) { return r.width > 32 ? 2 : 1; }

int gyro_pack(gyro_register r, int64_t raw, uint32_t word[2]) {
    int64_t top = (int64_t)mask(r.width - r.is_signed), bottom = r.is_signed ? -top - 1 : 0;
    uint64_t bits = (uint64_t)raw & mask(r.width);
    if (raw < bottom || raw > top) return 0;
    word[0] = (uint32_t)(bits & UINT32_MAX);
    if (gyro_words(r) == 2) word[1] = (uint32_t)(bits >> 32);
    return gyro_words(r);
}

int64_t gyro_unpack(gyro_register r, const uint32_t word[2]) {
    uint64_t bits = word[0] | (gyro_words(r) == 2 ? (uint64_t)word[1] << 32 : 0);
    return r.is_signed ? gyro_sign_extend(bits, r.width) : (int64_t)(bits & mask(r.width));
}

int64_t gyro_sign_extend(uint64_t bits, int width) {
    uint64_t sign = UINT64_C(1) << (width - 1);
    return (int64_t)((bits & mask(width)) ^ sign) - (int64_t)sign;
}

uint8_t gyro_crc8(const uint8_t *bytes, size_t count) {
    uint8_t crc = 0xFF;
    for (size_t n = 0; n < count; n++) {
        crc ^= bytes[n];
        for (int bit = 0; bit < 8; bit++) crc = (uint8_t)(crc << 1 ^ (crc & 0x80 ? 0x1D : 0));
    }
    return crc ^ 0xFF;
}

double gyro_deg_per_s(int64_t rate) { return (double)rate * GYRO_RATE_LSB; }

double gyro_degc(int64_t temperature) {
    return GYRO_DEGC_AT_T_0 + ((double)temperature + 0.5) * GYRO_DEGC_PER_T;
}
