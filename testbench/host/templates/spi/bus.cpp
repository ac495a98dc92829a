// Frames of an SPI master whose clock is the gyroscope's, divided by six
#include "gyro_loop.h"
#include "loop.h"

enum { HALF = 3, LEAD = 6, GAP = 6 };  // clocks: half a period of SCK, CS_N before it, and high between frames

static void pins(Vgyro_board &top, int cs_n, int sck, int sdi) {
    top.cs_n = cs_n;
    top.sck = sck;
    top.sdi = sdi;
}

Loop &loop() {
    struct Port : Loop {
        Port() : Loop("state.bin") { pins(top, 1, 0, 0); }
    };
    static Port only;
    return only;
}

static void clocks(int count, int cs_n, int sck, int sdi) {
    pins(loop().top, cs_n, sck, sdi);
    for (int k = 0; k < count; k++) loop().clock();
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
