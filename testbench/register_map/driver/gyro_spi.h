/* Frames of the gyroscope's SPI port: mode 0, most significant bit first, CS low for a frame. C99, no allocation.
 *
 * uint8_t sent[GYRO_SPI_READ_BYTES(2)], received[sizeof sent];
 * size_t count = gyro_spi_read(r.address, gyro_words(r), sent);
 * exchange `count` bytes with CS low, then gyro_spi_reply(sent, received, word, &status)
 */
#ifndef GYRO_SPI_H
#define GYRO_SPI_H

#include "gyro_driver.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GYRO_SPI_READ_BYTES(words) (4 + 4 * (words))
#define GYRO_SPI_WRITE_BYTES(words) (3 + 4 * (words))
#define GYRO_SPI_MOST_READ 7
#define GYRO_SPI_MOST_WRITTEN 2

#define GYRO_SPI_SAMPLE_WORDS 7 /* from SAMPLE_RATE on: a whole sample */

/* Status byte: errors of earlier frames since they were cleared, and the bus when the frame began */
#define GYRO_SPI_CRC 0x01
#define GYRO_SPI_LENGTH 0x02
#define GYRO_SPI_COMMAND 0x04
#define GYRO_SPI_PENDING 0x08 /* a low word waits for its high word */
#define GYRO_SPI_LOCKED 0x10
#define GYRO_SPI_FAULT 0x20
#define GYRO_SPI_OVERRUN 0x40 /* a sample was lost */
#define GYRO_SPI_DATA_READY 0x80

enum gyro_spi_result {
    GYRO_SPI_OK,
    GYRO_SPI_NO_SLAVE, /* the second byte is not the complement of the status */
    GYRO_SPI_CORRUPT   /* CRC of a read, echo of a write */
};

/* Frame that reads 1 to 7 words from a byte address; returns its bytes, 0 if address or count cannot be. */
size_t gyro_spi_read(uint16_t address, int words, uint8_t *frame);

/* Frame that writes 1 or 2 words; returns its bytes, 0 if address or count cannot be. */
size_t gyro_spi_write(uint16_t address, const uint32_t *word, int words, uint8_t *frame);

/* Checks what came back during a frame that was made here; takes status, and the words of a read that is right. */
enum gyro_spi_result gyro_spi_reply(const uint8_t *sent, const uint8_t *received, uint32_t *word, uint8_t *status);

/* A sample of the rate: registers RATE and TEMPERATURE, SAMPLE_STATUS, and the number of its frame of 8 kHz. */
typedef struct {
    int64_t rate, temperature;
    uint32_t status;
    uint16_t number;
} gyro_sample;

/* The sample in the words of a read of GYRO_SPI_SAMPLE_WORDS from SAMPLE_RATE on. */
gyro_sample gyro_sample_of(const uint32_t word[GYRO_SPI_SAMPLE_WORDS]);

/* Samples lost between two that were read, at most 4096 frames of 8 kHz apart, with one DECIMATION. */
int gyro_samples_lost(gyro_sample before, gyro_sample after);

#ifdef __cplusplus
}
#endif

#endif /* GYRO_SPI_H */
