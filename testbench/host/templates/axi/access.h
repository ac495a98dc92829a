/* How this host reaches registers and samples: words over AXI4-Lite, in the order that keeps them together. */
#include <stdio.h>
#include <stdlib.h>

#include "gyro_loop.h"
#include "gyro_spi.h"

static inline void failed(const char *what, uint16_t address) {
    fprintf(stderr, "address %03X: %s\n", address, what);
    exit(1);
}

static inline void okay(int response, uint16_t address) {
    if (response != 0) failed("the response is not OKAY", address);
}

static inline void read_words(uint16_t address, int words, int step, uint32_t *word) {
    for (int k = 0; k < words; k += step) okay(gyro_loop_read((uint16_t)(address + 4 * k), &word[k]), address);
}

static inline int64_t read_register(gyro_register r) {
    uint32_t word[2];
    read_words(r.address, gyro_words(r), 1, word);
    return gyro_unpack(r, word);
}

static inline void write_register(gyro_register r, int64_t raw) {
    uint32_t word[2];
    int words = gyro_pack(r, raw, word);
    if (words == 0) failed("value beyond its register", r.address);
    for (int k = 0; k < words; k++) okay(gyro_loop_write((uint16_t)(r.address + 4 * k), word[k]), r.address);
}

/* Four registers of one word each; the read of SAMPLE_RATE holds the others */
static inline gyro_sample read_sample(void) {
    uint32_t word[GYRO_SPI_SAMPLE_WORDS] = {0};
    read_words(GYRO_SAMPLE_RATE_ADDRESS, GYRO_SPI_SAMPLE_WORDS, 2, word);
    return gyro_sample_of(word);
}
