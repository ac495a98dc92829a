#include "sha256.h"

#include <string.h>

/* Fractions of the cube roots of the first 64 primes; of the square roots of the first eight */
static const uint32_t K[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2,
};
static const uint32_t FIRST[8] = {
    0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19,
};

static uint32_t turned(uint32_t x, int n) { return x >> n | x << (32 - n); }

static void whole(sha256 *s) {
    uint32_t w[64], v[8];
    for (int k = 0; k < 16; k++) {
        const unsigned char *b = s->block + 4 * k;
        w[k] = (uint32_t)b[0] << 24 | (uint32_t)b[1] << 16 | (uint32_t)b[2] << 8 | b[3];
    }
    for (int k = 16; k < 64; k++) {
        uint32_t x = w[k - 15], y = w[k - 2];
        w[k] = w[k - 16] + (turned(x, 7) ^ turned(x, 18) ^ x >> 3) + w[k - 7] + (turned(y, 17) ^ turned(y, 19) ^ y >> 10);
    }
    memcpy(v, s->h, sizeof v);
    for (int k = 0; k < 64; k++) {
        uint32_t a = v[0], e = v[4];
        uint32_t t = v[7] + (turned(e, 6) ^ turned(e, 11) ^ turned(e, 25)) + ((e & v[5]) ^ (~e & v[6])) + K[k] + w[k];
        uint32_t u = (turned(a, 2) ^ turned(a, 13) ^ turned(a, 22)) + ((a & v[1]) ^ (a & v[2]) ^ (v[1] & v[2]));
        memmove(v + 1, v, 7 * sizeof v[0]);
        v[4] += t;
        v[0] = t + u;
    }
    for (int k = 0; k < 8; k++) s->h[k] += v[k];
}

void sha256_begin(sha256 *s) {
    memcpy(s->h, FIRST, sizeof s->h);
    s->bytes = 0;
}

void sha256_add(sha256 *s, const void *data, size_t size) {
    for (const unsigned char *at = data; size--; at++) {
        s->block[s->bytes++ % 64] = *at;
        if (s->bytes % 64 == 0) whole(s);
    }
}

void sha256_end(sha256 *s, unsigned char digest[32]) {
    uint64_t bits = 8 * s->bytes;
    sha256_add(s, "\x80", 1);
    while (s->bytes % 64 != 56) sha256_add(s, "", 1);
    for (int k = 7; k >= 0; k--) sha256_add(s, &(unsigned char){(unsigned char)(bits >> 8 * k)}, 1);
    for (int k = 0; k < 32; k++) digest[k] = (unsigned char)(s->h[k / 4] >> (24 - 8 * (k % 4)));
}
