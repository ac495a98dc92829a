/* Three real poles in a row, d1' = (u - d1)/t1, d2' = (d1 - d2)/t2, d3' = (d2 - d3)/t3, and what they do to a mode.

   The mode is z = x' - conj(l) x with z' = l z + F/m, l = -s + i w_d, exact in a rotating frame. A force k d3 adds
       k/m I3,   I_j = integral of exp(l (h - s)) d_j(s) ds over the step,
   and each pole's own balance gives it from the one before, without error:
       I_j (1 + l t_j) = I_(j-1) - t_j (d_j(h) - exp(l h) d_j(0)),   I_0 of a staircase in closed form.
*/
#ifndef SEALED_CHAIN_H
#define SEALED_CHAIN_H

#include <math.h>

typedef struct {
    double re, im;
} Complex;

static inline Complex mul(Complex a, Complex b) { return (Complex){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re}; }
static inline Complex add(Complex a, Complex b) { return (Complex){a.re + b.re, a.im + b.im}; }
static inline Complex sub(Complex a, Complex b) { return (Complex){a.re - b.re, a.im - b.im}; }
static inline Complex scaled(Complex a, double k) { return (Complex){a.re * k, a.im * k}; }
static Complex inverse(Complex a) { return scaled((Complex){a.re, -a.im}, 1 / (a.re * a.re + a.im * a.im)); }
static Complex rotated(Complex l, double t) {
    double size = exp(l.re * t);
    return (Complex){size * cos(l.im * t), size * sin(l.im * t)};
}

/* (exp(l t) - 1)/l, without the cancellation of small l t. */
static Complex grown(Complex l, double t) {
    Complex x = scaled(l, t), sum = {0, 0};
    for (int k = 18; k >= 1; k--) {
        sum = mul(scaled(x, 1.0 / (k + 1)), add((Complex){1, 0}, sum));
    }
    return scaled(add((Complex){1, 0}, sum), t);
}

typedef struct {
    double m[3][3]; /* lower triangle: how three poles decay over a time */
} Decay;

/* exp(A t) of three poles, gain g before the last: Taylor of a part of the time, squared again. */
static Decay decay(const double tau[3], double g, double t) {
    double a[3][3] = {{0}}, e[3][3], term[3][3], next[3][3];
    int halvings = 0;
    double least = fmin(tau[0], fmin(tau[1], tau[2])), part = t;
    while (part > 0.25 * least) {
        part /= 2;
        halvings++;
    }
    for (int k = 0; k < 3; k++) {
        a[k][k] = -part / tau[k];
        if (k) a[k][k - 1] = (k == 2 ? g : 1) * part / tau[k];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) e[i][j] = term[i][j] = i == j;
    for (int n = 1; n < 22; n++) {
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                next[i][j] = 0;
                for (int k = 0; k < 3; k++) next[i][j] += a[i][k] * term[k][j] / n;
            }
        memcpy(term, next, sizeof term);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) e[i][j] += term[i][j];
    }
    while (halvings--) {
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                next[i][j] = 0;
                for (int k = 0; k < 3; k++) next[i][j] += e[i][k] * e[k][j];
            }
        memcpy(e, next, sizeof e);
    }
    Decay out;
    memcpy(out.m, e, sizeof e);
    return out;
}

static inline void decayed(const Decay *d, double *v) {
    v[2] = d->m[2][0] * v[0] + d->m[2][1] * v[1] + d->m[2][2] * v[2];
    v[1] = d->m[1][0] * v[0] + d->m[1][1] * v[1];
    v[0] = d->m[0][0] * v[0];
}

/* A DAC's output chain over one step of the integration. */
typedef struct {
    double tau[3], h, at; /* `at`: where in the step the DAC steps, h: it does not */
    Decay whole, before, behind;
    Complex turn, i0, step, c0, c1, c2, c3; /* of the mode that it drives */
} Chain;

static void chain_step_at(Chain *c, Complex l, double at) {
    c->at = at;
    c->before = decay(c->tau, 1, at);
    c->behind = decay(c->tau, 1, c->h - at);
    c->step = grown(l, c->h - at);
}

static void chain_design(Chain *c, const double tau[3], Complex l, double h) {
    Complex f[3];
    c->h = h;
    for (int k = 0; k < 3; k++) {
        c->tau[k] = tau[k];
        f[k] = inverse((Complex){1 + l.re * tau[k], l.im * tau[k]});
    }
    c->whole = decay(tau, 1, h);
    c->turn = rotated(l, h);
    c->i0 = grown(l, h);
    c->c3 = scaled(f[2], tau[2]);
    c->c2 = scaled(mul(f[1], f[2]), tau[1]);
    c->c0 = mul(f[0], mul(f[1], f[2]));
    c->c1 = scaled(c->c0, tau[0]);
    chain_step_at(c, l, h);
}

/* One step: `d` moves on, from a held voltage `*u` to `next` where the DAC steps. Returns I3, and the mean of d3. */
static inline Complex chain_advance(const Chain *c, double *d, double *u, double next, int steps, double *mean) {
    double was[3] = {d[0], d[1], d[2]}, held = *u, area = held * c->h;
    Complex i0 = scaled(c->i0, held);
    double e[3] = {d[0] - held, d[1] - held, d[2] - held};
    if (steps) {
        double du = next - held;
        decayed(&c->before, e);
        e[0] -= du;
        e[1] -= du;
        e[2] -= du;
        decayed(&c->behind, e);
        i0 = add(i0, scaled(c->step, du));
        area += du * (c->h - c->at);
        *u = held = next;
    } else {
        decayed(&c->whole, e);
    }
    Complex out = mul(c->c0, i0);
    Complex weight[3] = {c->c1, c->c2, c->c3};
    for (int k = 0; k < 3; k++) {
        d[k] = e[k] + held;
        area -= c->tau[k] * (d[k] - was[k]);
        Complex w = {d[k] - c->turn.re * was[k], -c->turn.im * was[k]};
        out = sub(out, mul(weight[k], w));
    }
    *mean = area / c->h;
    return out;
}

#endif
