/* One call of the driver per line of standard input, its result per line of standard output. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "gyro_driver.h"

int main(void) {
    char call[16];
    while (scanf("%15s", call) == 1) {
        if (!strcmp(call, "crc")) {
            uint8_t bytes[64];
            size_t count, n;
            if (scanf("%zu", &count) != 1 || count > sizeof bytes) return 1;
            for (n = 0; n < count; n++)
                if (scanf("%" SCNu8, &bytes[n]) != 1) return 1;
            printf("%u\n", gyro_crc8(bytes, count));
        } else if (!strcmp(call, "pack") || !strcmp(call, "unpack")) {
            unsigned width, is_signed;
            uint32_t word[2] = {0xDEADBEEF, 0xDEADBEEF};
            int64_t raw;
            if (scanf("%u %u", &width, &is_signed) != 2) return 1;
            gyro_register r = {0, (uint8_t)width, (uint8_t)is_signed};
            if (!strcmp(call, "pack")) {
                if (scanf("%" SCNd64, &raw) != 1) return 1;
                int words = gyro_pack(r, raw, word);
                printf("%d %" PRIu32 " %" PRIu32 "\n", words, word[0], word[1]);
            } else {
                if (scanf("%" SCNu32 " %" SCNu32, &word[0], &word[1]) != 2) return 1;
                printf("%" PRId64 "\n", gyro_unpack(r, word));
            }
        } else if (!strcmp(call, "register")) {
            gyro_register r = GYRO_REGISTER(RATE_SCALE_T1), f = GYRO_REGISTER(FREQUENCY);
            printf("%u %u %u %d %u %u %u %d\n", r.address, r.width, r.is_signed, gyro_words(r), f.address, f.width,
                   f.is_signed, gyro_words(f));
        } else {
            int64_t raw;
            if (scanf("%" SCNd64, &raw) != 1) return 1;
            printf("%.17g\n", !strcmp(call, "rate") ? gyro_deg_per_s(raw) : gyro_degc(raw));
        }
    }
    return 0;
}
