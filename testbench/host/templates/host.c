/* Reads the gyroscope as its user does: samples at DATA_READY, a calibration at two rates, then a rate that it measures. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "gyro_loop.h"
#include "gyro_spi.h"

enum { SETTLE = 100, BLOCKS = 10, OF_BLOCK = 25 };
static int lost;

static void transfer(const uint8_t *sent, uint8_t *received, size_t count, uint32_t *word) {
    uint8_t status;
    gyro_loop_transfer(sent, received, count);
    if (gyro_spi_reply(sent, received, word, &status) == GYRO_SPI_OK && !(status & 7)) return;
    fprintf(stderr, "a frame was wrong: status %02X\n", status);
    exit(1);
}

static int64_t read_register(gyro_register r) {
    uint8_t sent[GYRO_SPI_READ_BYTES(2)], received[sizeof sent];
    uint32_t word[2];
    transfer(sent, received, gyro_spi_read(r.address, gyro_words(r), sent), word);
    return gyro_unpack(r, word);
}

static void write_register(gyro_register r, double raw) {
    uint8_t sent[GYRO_SPI_WRITE_BYTES(2)], received[sizeof sent];
    uint32_t word[2];
    int words = gyro_pack(r, (int64_t)floor(raw + 0.5), word);
    transfer(sent, received, gyro_spi_write(r.address, word, words, sent), word);
}

static gyro_sample next_sample(void) {
    static gyro_sample before;
    static int begun;
    uint8_t sent[GYRO_SPI_READ_BYTES(GYRO_SPI_SAMPLE_WORDS)], received[sizeof sent];
    uint32_t word[GYRO_SPI_SAMPLE_WORDS];
    while (!gyro_loop_data_ready()) gyro_loop_wait(1e-6);
    transfer(sent, received, gyro_spi_read(GYRO_SAMPLE_RATE_ADDRESS, GYRO_SPI_SAMPLE_WORDS, sent), word);
    gyro_sample s = gyro_sample_of(word);
    if (begun++) lost += gyro_samples_lost(before, s);
    return before = s;
}

/* Mean rate (deg/s) at a rate of rotation, with its standard error from the spread of blocks */
static double measured(double turn_deg_per_s, double *error) {
    double sum = 0, squares = 0;
    gyro_loop_turn(turn_deg_per_s);
    for (int n = 0; n < SETTLE; n++) next_sample();
    for (int b = 0; b < BLOCKS; b++) {
        double block = 0;
        for (int n = 0; n < OF_BLOCK; n++) block += gyro_deg_per_s(next_sample().rate) / OF_BLOCK;
        sum += block;
        squares += block * block;
    }
    double mean = sum / BLOCKS;
    *error = sqrt((squares / BLOCKS - mean * mean) / (BLOCKS - 1));
    printf("%6.1f deg/s: reads %9.4f +- %.4f deg/s\n", turn_deg_per_s, mean, *error);
    return mean;
}

int main(void) {
    const gyro_register scale = GYRO_REGISTER(RATE_SCALE), bias = GYRO_REGISTER(RATE_BIAS);
    double of_zero, of_hundred, of_rate;
    uint64_t identity = (uint64_t)read_register(GYRO_REGISTER(IDENTITY));
    printf("%c%c%c%c, map %d\n", (int)(identity >> 40 & 255), (int)(identity >> 32 & 255), (int)(identity >> 24 & 255),
           (int)(identity >> 16 & 255), (int)(identity & 0xFFFF));
    printf("%s, %.1f degC\n", read_register(GYRO_REGISTER(STATE)) == GYRO_STATE__LOCKED ? "locked" : "not locked",
           gyro_degc(read_register(GYRO_REGISTER(TEMPERATURE))));
    double zero = measured(0, &of_zero), hundred = measured(100, &of_hundred);
    double old = (double)read_register(scale) * GYRO_RATE_SCALE_LSB, gain = 100 / (hundred - zero);
    write_register(bias, zero / GYRO_RATE_LSB / old);
    write_register(scale, gain * old / GYRO_RATE_SCALE_LSB);
    double rate = measured(-50, &of_rate);
    /* -50 deg/s is extrapolated from the two: bias counts 1.5 times, scale -0.5 times */
    double error = sqrt(of_rate * of_rate + pow(1.5 * of_zero, 2) + pow(0.5 * of_hundred, 2));
    printf("calibrated: %.3f +- %.3f deg/s, lost samples: %d\n", rate, error, lost);
    return 0;
}
