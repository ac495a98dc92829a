/* How this host reaches registers and samples: frames at the SPI port. */
#include <stdio.h>
#include <stdlib.h>

#include "gyro_loop.h"
#include "gyro_spi.h"

static inline void failed(const char *what, unsigned number) {
    fprintf(stderr, "%s %02X\n", what, number);
    exit(1);
}

static inline void transfer(const uint8_t *sent, uint8_t *received, size_t count, uint32_t *word) {
    uint8_t status;
    gyro_loop_transfer(sent, received, count);
    if (gyro_spi_reply(sent, received, word, &status) == GYRO_SPI_OK && !(status & 7)) return;
    failed("a frame was wrong: status", status);
}

static inline int64_t read_register(gyro_register r) {
    uint8_t sent[GYRO_SPI_READ_BYTES(2)], received[sizeof sent];
    uint32_t word[2];
    transfer(sent, received, gyro_spi_read(r.address, gyro_words(r), sent), word);
    return gyro_unpack(r, word);
}

static inline void write_register(gyro_register r, int64_t raw) {
    uint8_t sent[GYRO_SPI_WRITE_BYTES(2)], received[sizeof sent];
    uint32_t word[2];
    int words = gyro_pack(r, raw, word);
    if (words == 0) failed("value beyond its register", r.address);
    transfer(sent, received, gyro_spi_write(r.address, word, words, sent), word);
}

static inline gyro_sample read_sample(void) {
    uint8_t sent[GYRO_SPI_READ_BYTES(GYRO_SPI_SAMPLE_WORDS)], received[sizeof sent];
    uint32_t word[GYRO_SPI_SAMPLE_WORDS];
    transfer(sent, received, gyro_spi_read(GYRO_SAMPLE_RATE_ADDRESS, GYRO_SPI_SAMPLE_WORDS, sent), word);
    return gyro_sample_of(word);
}
