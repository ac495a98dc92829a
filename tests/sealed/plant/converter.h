/* Delta-sigma converter: the sinc3 filter as three integrators and three combs in integers that wrap (Hogenauer, 1981).

   sample    every 125/64 ticks from `offset` ticks after power-on; 64 of them are a frame
   code      step round(v PGA 2^23 / (VREF step)), clamped to 24 bits; ties upwards
   noise     white, or of first order with coefficient `colour` from conversion to conversion and the same rms; 1/f
*/
#ifndef SEALED_CONVERTER_H
#define SEALED_CONVERTER_H

#include "random.h"

enum { CHANNELS = 5, TAPS = 64 };
#define SAMPLE_TICKS (125.0 / 64)
#define UNITS_PER_VOLT 0x1p40

typedef struct {
    uint64_t sum[CHANNELS][3], comb[CHANNELS][3];
    double next; /* ticks from the first instant of the tick to come */
    double coloured[CHANNELS];
    int64_t count, code[CHANNELS];
    Flicker flicker[CHANNELS];
    Stream white, slow;
} Converter;

typedef struct {
    double vref[CHANNELS], rms[CHANNELS], flicker[CHANNELS], colour, step;
} ConverterParams;

static void converter_begin(Converter *c, uint64_t seed, double offset) {
    memset(c, 0, sizeof *c);
    c->next = offset;
    c->white = stream(seed, 21);
    c->slow = stream(seed, 22);
    for (int k = 0; k < CHANNELS; k++) flicker_begin(&c->flicker[k], &c->slow);
}

static void convert(Converter *c, const ConverterParams *p) {
    const double gain = 1 / (UNITS_PER_VOLT * TAPS * TAPS * TAPS), kick = sqrt(1 - p->colour * p->colour);
    for (int k = 0; k < CHANNELS; k++) {
        uint64_t y = c->sum[k][2];
        for (int n = 0; n < 3; n++) {
            uint64_t was = c->comb[k][n];
            c->comb[k][n] = y;
            y -= was;
        }
        c->coloured[k] = p->colour * c->coloured[k] + kick * normal(&c->white);
        double v = (double)(int64_t)y * gain + p->rms[k] * c->coloured[k];
        v += p->flicker[k] * flicker_next(&c->flicker[k], &c->slow);
        double code = p->step * floor(v / p->vref[k] * 8388608 / p->step + 0.5);
        c->code[k] = code >= 8388607 ? 8388607 : code <= -8388608 ? -8388608 : (int64_t)code;
    }
}

/* Samples of a tick from volts at `steps` + 1 instants of it; converts at the last of a frame. */
static inline void converter_tick(Converter *c, const ConverterParams *p, double (*volts)[CHANNELS], int steps) {
    while (c->next < 1) {
        double place = c->next * steps;
        int at = (int)place;
        double part = place - at;
        for (int k = 0; k < CHANNELS; k++) {
            double v = volts[at][k] + part * (volts[at + 1][k] - volts[at][k]);
            if (!(fabs(v) < 64)) v = v < 0 ? -64 : 64;
            c->sum[k][0] += (uint64_t)llrint(v * UNITS_PER_VOLT);
            c->sum[k][1] += c->sum[k][0];
            c->sum[k][2] += c->sum[k][1];
        }
        c->next += SAMPLE_TICKS;
        if (++c->count % TAPS == 0) convert(c, p);
    }
    c->next -= 1;
}

#endif
