/* One call of the driver per line of standard input, its result per line of standard output. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gyro_spi.h"

static int bytes(uint8_t *to, size_t count) {
    for (size_t n = 0; n < count; n++)
        if (scanf("%" SCNu8, &to[n]) != 1) return 0;
    return 1;
}

static void print(const uint8_t *from, size_t count) {
    printf("%zu", count);
    for (size_t n = 0; n < count; n++) printf(" %u", from[n]);
    printf("\n");
}

int main(void) {
    char call[16];
    while (scanf("%15s", call) == 1) {
        if (!strcmp(call, "crc")) {
            uint8_t data[64];
            size_t count;
            if (scanf("%zu", &count) != 1 || count > sizeof data || !bytes(data, count)) return 1;
            printf("%u\n", gyro_crc8(data, count));
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
        } else if (!strcmp(call, "spi_read") || !strcmp(call, "spi_write")) {
            /* on the heap, exactly as large as it must be: the sanitizer sees a byte too many */
            unsigned address;
            int words, read = call[4] == 'r';
            uint32_t word[2] = {0, 0};
            if (scanf("%u %d", &address, &words) != 2) return 1;
            if (!read && scanf("%" SCNu32 " %" SCNu32, &word[0], &word[1]) != 2) return 1;
            size_t size = words < 1 ? 3 : 3 + 4 * (size_t)words + (size_t)read;
            uint8_t *frame = malloc(size);
            if (!frame) return 1;
            print(frame, read ? gyro_spi_read((uint16_t)address, words, frame)
                              : gyro_spi_write((uint16_t)address, word, words, frame));
            free(frame);
        } else if (!strcmp(call, "spi_reply")) {
            size_t count;
            if (scanf("%zu", &count) != 1) return 1;
            uint8_t *sent = malloc(count), *received = malloc(count), status;
            uint32_t word[GYRO_SPI_MOST_READ] = {0};
            if (!sent || !received || !bytes(sent, count) || !bytes(received, count)) return 1;
            int result = gyro_spi_reply(sent, received, word, &status);
            printf("%d %u", result, status);
            for (int k = 0; k < GYRO_SPI_MOST_READ; k++) printf(" %" PRIu32, word[k]);
            printf("\n");
            free(sent);
            free(received);
        } else if (!strcmp(call, "samples")) {
            gyro_sample s[2];
            for (int n = 0; n < 2; n++) {
                uint32_t word[GYRO_SPI_SAMPLE_WORDS];
                for (int k = 0; k < GYRO_SPI_SAMPLE_WORDS; k++)
                    if (scanf("%" SCNu32, &word[k]) != 1) return 1;
                s[n] = gyro_sample_of(word);
            }
            printf("%" PRId64 " %" PRId64 " %" PRIu32 " %u %d\n", s[1].rate, s[1].temperature, s[1].status, s[1].number,
                   gyro_samples_lost(s[0], s[1]));
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
