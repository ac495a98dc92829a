#include "gyro_spi.h"

#include <string.h>

enum { READ = 0x80, HEAD = 2, REPLY = 3, ECHO = 5, LAST_ADDRESS = 0x7FC };

static int head(uint16_t address, int words, int most, uint8_t read, uint8_t *frame) {
    if (words < 1 || words > most || address > LAST_ADDRESS || address % 4) return 0;
    frame[0] = (uint8_t)(read | words << 4 | address >> 8);
    frame[1] = (uint8_t)(address & 0xFF);
    return 1;
}

size_t gyro_spi_read(uint16_t address, int words, uint8_t *frame) {
    if (!head(address, words, GYRO_SPI_MOST_READ, READ, frame)) return 0;
    size_t count = GYRO_SPI_READ_BYTES((size_t)words);
    frame[HEAD] = gyro_crc8(frame, HEAD);
    memset(frame + HEAD + 1, 0, count - HEAD - 1);
    return count;
}

size_t gyro_spi_write(uint16_t address, const uint32_t *word, int words, uint8_t *frame) {
    if (!head(address, words, GYRO_SPI_MOST_WRITTEN, 0, frame)) return 0;
    size_t count = GYRO_SPI_WRITE_BYTES((size_t)words), n = HEAD;
    for (int k = 0; k < words; k++)
        for (int shift = 24; shift >= 0; shift -= 8) frame[n++] = (uint8_t)(word[k] >> shift & 0xFF);
    frame[n] = gyro_crc8(frame, n);
    return count;
}

enum gyro_spi_result gyro_spi_reply(const uint8_t *sent, const uint8_t *received, uint32_t *word, uint8_t *status) {
    uint8_t covered[HEAD + 4 * GYRO_SPI_MOST_READ];
    size_t bytes = 4 * (size_t)(sent[0] >> 4 & 7); /* of the words in the frame */
    *status = received[0];
    if ((received[0] ^ received[1]) != 0xFF) return GYRO_SPI_NO_SLAVE;
    if (!(sent[0] & READ)) return memcmp(received + ECHO, sent, HEAD + bytes + 1 - ECHO) ? GYRO_SPI_CORRUPT : GYRO_SPI_OK;
    memcpy(covered, sent, HEAD);
    memcpy(covered + HEAD, received + REPLY, bytes);
    if (gyro_crc8(covered, HEAD + bytes) != received[REPLY + bytes]) return GYRO_SPI_CORRUPT;
    for (const uint8_t *byte = received + REPLY; bytes; bytes -= 4, byte += 4)
        *word++ = (uint32_t)byte[0] << 24 | (uint32_t)byte[1] << 16 | (uint32_t)byte[2] << 8 | byte[3];
    return GYRO_SPI_OK;
}

gyro_sample gyro_sample_of(const uint32_t word[GYRO_SPI_SAMPLE_WORDS]) {
    const uint32_t number[2] = {word[6], 0};
    gyro_sample s;
    s.rate = gyro_unpack(GYRO_REGISTER(SAMPLE_RATE), word);
    s.temperature = gyro_unpack(GYRO_REGISTER(SAMPLE_TEMPERATURE), word + 2);
    s.status = (uint32_t)gyro_unpack(GYRO_REGISTER(SAMPLE_STATUS), word + 4);
    s.number = (uint16_t)gyro_unpack(GYRO_REGISTER(SAMPLE_NUMBER), number);
    return s;
}

int gyro_samples_lost(gyro_sample before, gyro_sample after) {
    unsigned frames = (unsigned)(after.number - before.number) & 0xFFF;
    return (int)(frames >> (after.status >> 16 & 7)) - 1;
}
