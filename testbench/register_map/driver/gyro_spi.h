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

/* Status byte: errors of earlier frames since they were cleared */
#define GYRO_SPI_CRC 0x01
#define GYRO_SPI_LENGTH 0x02
#define GYRO_SPI_COMMAND 0x04

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

#ifdef __cplusplus
}
#endif

#endif /* GYRO_SPI_H */
