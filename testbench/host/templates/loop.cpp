// gyro_loop.h: frames of an SPI master whose clock is the gyroscope's, divided by six
#include "gyro_loop.h"
#include "loop.h"

static const double CLOCK_HZ = 26e6, RAD_PER_DEG = 3.14159265358979323846 / 180;
enum { HALF = 3, LEAD = 6, GAP = 6 };  // clocks: half a period of SCK, CS_N before it, and high between frames

static Loop &loop() {
    static Loop only("state.bin");
    return only;
}

static void clocks(int count, int cs_n, int sck, int sdi) {
    for (int k = 0; k < count; k++) loop().clock(cs_n, sck, sdi);
}

void gyro_loop_transfer(const uint8_t *sent, uint8_t *received, size_t count) {
    clocks(LEAD, 0, 0, sent[0] >> 7);
    for (size_t n = 0; n < 8 * count; n++) {
        int place = 7 - (int)(n % 8), bit = sent[n / 8] >> place & 1, got = loop().top.o_sdo;
        clocks(HALF, 0, 1, bit);
        clocks(HALF, 0, 0, n + 1 < 8 * count ? sent[(n + 1) / 8] >> (7 - (n + 1) % 8) & 1 : bit);
        received[n / 8] = (uint8_t)((received[n / 8] & ~(1 << place)) | got << place);
    }
    clocks(GAP, 1, 0, 0);
}

int gyro_loop_data_ready(void) { return loop().top.o_data_ready; }

void gyro_loop_wait(double time_s) {
    for (i64 end = loop().now + (i64)std::floor(time_s * CLOCK_HZ + 0.5); loop().now < end;) loop().clock(1, 0, 0);
}

void gyro_loop_turn(double rate_deg_per_s) { loop().board.rate = rate_deg_per_s * RAD_PER_DEG; }

double gyro_loop_time(void) { return (double)loop().now / CLOCK_HZ; }
