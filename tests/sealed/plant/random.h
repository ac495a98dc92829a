/* Random numbers: xoshiro256++ (Blackman and Vigna, 2019), normal ones by the ziggurat (Marsaglia and Tsang, 2000).

   A stream is 32 bytes and belongs to one source of noise, so that no source moves another one.
   flicker  sum of first-order processes an octave apart; slow processes move once in 2^k conversions
*/
#ifndef SEALED_RANDOM_H
#define SEALED_RANDOM_H

#include <math.h>
#include <stdint.h>

typedef struct {
    uint64_t s[4];
} Stream;

static uint64_t splitmix(uint64_t *x) {
    uint64_t z = (*x += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static Stream stream(uint64_t seed, uint64_t source) {
    uint64_t x = seed * 0xd1342543de82ef95u + source * 0x2545f4914f6cdd1du + 1;
    Stream out;
    for (int k = 0; k < 4; k++) out.s[k] = splitmix(&x);
    return out;
}

static inline uint64_t turned(uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }

static inline uint64_t word(Stream *r) {
    uint64_t *s = r->s, out = turned(s[0] + s[3], 23) + s[0], t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = turned(s[3], 45);
    return out;
}

static inline double uniform(Stream *r) { return ((double)(word(r) >> 11) + 0.5) * 0x1p-53; }

enum { LAYERS = 256 };
static double layer_x[LAYERS + 1], layer_f[LAYERS + 1];

/* Edges of the layers of equal area under exp(-x^2/2). */
static void ziggurat_tables(void) {
    const double r = 3.6541528853610088, area = 0.00492867323399;
    double f = exp(-0.5 * r * r);
    layer_x[0] = area / f;
    layer_x[1] = r;
    for (int k = 2; k < LAYERS; k++) {
        layer_x[k] = sqrt(-2 * log(area / layer_x[k - 1] + f));
        f = exp(-0.5 * layer_x[k] * layer_x[k]);
    }
    layer_x[LAYERS] = 0;
    for (int k = 0; k <= LAYERS; k++) layer_f[k] = exp(-0.5 * layer_x[k] * layer_x[k]);
}

static double tail(Stream *r) {
    double x, y;
    do {
        x = -log(uniform(r)) / layer_x[1];
        y = -log(uniform(r));
    } while (y + y < x * x);
    return layer_x[1] + x;
}

/* A normal number of variance 1. */
static inline double normal(Stream *r) {
    for (;;) {
        uint64_t bits = word(r);
        int k = (int)(bits & (LAYERS - 1));
        double sign = bits & 256 ? -1.0 : 1.0, x = (double)(bits >> 11) * 0x1p-53 * layer_x[k];
        if (x < layer_x[k + 1]) return sign * x;
        if (k == 0) return sign * tail(r);
        if (layer_f[k] + uniform(r) * (layer_f[k + 1] - layer_f[k]) < exp(-0.5 * x * x)) return sign * x;
    }
}

enum { FAST = 2, OCTAVES = 24 };

typedef struct {
    double state[OCTAVES];
    uint64_t count;
} Flicker;

static void flicker_begin(Flicker *f, Stream *r) {
    f->count = 0;
    for (int k = 0; k < OCTAVES; k++) f->state[k] = normal(r);
}

/* The next sample at level 1, whose one-sided density is 1/f.

   Lorentzians an octave apart of variance v each have the density v / (f ln 2): v = ln 2. Those below a corner of an
   eighth of the rate decay by 0.45 in a step of their own, 2^k samples; two faster ones move with every sample. */
static double flicker_next(Flicker *f, Stream *r) {
    double sum = 0;
    for (int k = 0; k < OCTAVES; k++) {
        double decay = k == 0 ? 0.04100625 : k == 1 ? 0.2025 : 0.45;
        uint64_t stride = k < FAST ? 1 : (uint64_t)1 << (k - FAST);
        if (!(f->count & (stride - 1))) f->state[k] = decay * f->state[k] + sqrt(1 - decay * decay) * normal(r);
        sum += f->state[k];
    }
    f->count++;
    return sum * sqrt(log(2.0));
}

#endif
