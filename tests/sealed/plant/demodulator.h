/* Synchronous integral demodulator: three buffered RC stages, two groups of capacitors that take turns on one switch.

   A group that is connected follows w1' = (v - w1)/RC, w2' = (w1 - w2)/RC, w3' = (w2 - w3)/RC; the other one is held.
   A step (or the piece of one between two edges) takes the input at the two points of Gauss: error (w h)^4/4320.
   A switch that opens leaves a charge on each capacitor of its group.
*/
#ifndef SEALED_DEMODULATOR_H
#define SEALED_DEMODULATOR_H

#include <math.h>

#define GAUSS_LOW 0.21132486540518711775
#define GAUSS_HIGH 0.78867513459481288225

typedef struct {
    double e0, e1, e2;      /* decay of a group */
    double k[3][2];         /* weights of the input at both points */
} Weights;

static Weights weights(double r) {
    Weights w;
    w.e0 = exp(-r);
    w.e1 = w.e0 * r;
    w.e2 = w.e0 * r * r / 2;
    const double at[2] = {GAUSS_LOW, GAUSS_HIGH};
    for (int n = 0; n < 2; n++) {
        double left = r * (1 - at[n]), first = 0.5 * r * exp(-left);
        w.k[0][n] = first;
        w.k[1][n] = first * left;
        w.k[2][n] = first * left * left / 2;
    }
    return w;
}

static inline void charged(const Weights *w, double *v, double low, double high) {
    double a = v[0], b = v[1];
    v[2] = w->e0 * v[2] + w->e1 * b + w->e2 * a + w->k[2][0] * low + w->k[2][1] * high;
    v[1] = w->e0 * b + w->e1 * a + w->k[1][0] * low + w->k[1][1] * high;
    v[0] = w->e0 * a + w->k[0][0] * low + w->k[0][1] * high;
}

#endif
