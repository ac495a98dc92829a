#include "plant.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const int64_t NOT_PENDING = -((int64_t)1 << 61);
enum { HOLD = 5, JITTERED = 5 };

/* ---- noise: a hash of source and number, no state but that of 1/f ---- */

static void words(int64_t key0, int64_t key1, int64_t counter, int64_t *x, int64_t *y) {
    const int64_t MASK = 0xFFFFFFFF, MULTIPLIER = 0x4F1BBCDD, WEYL = 0x9E3779B9;
    int64_t a = counter & MASK, b = (counter >> 32) ^ key1;
    for (int round = 0; round < 7; round++) {
        int64_t product = a * MULTIPLIER;
        a = ((product >> 31) ^ b ^ (key0 + round * WEYL)) & MASK;
        b = product & MASK;
    }
    *x = a;
    *y = b;
}

static double white(const plant_constants *p, const source *of, int64_t half, int64_t counter) {
    int64_t x, y, sum = -510;
    if (!of->on) return 0.0;
    words(of->key0, of->key1, counter, &x, &y);
    for (int64_t word = half ? y : x; word; word >>= 8) sum += word & 0xFF;
    return of->sigma * ((double)sum * p->ih4_scale);
}

static double held(const plant_constants *p, const source *of, int64_t tick) {
    return white(p, of, of->half, tick / HOLD);
}

static int64_t sum4(const source *of, int64_t counter) {
    int64_t x, y;
    words(of->key0, of->key1, counter, &x, &y);
    return (x & 0xFFFF) + (x >> 16) + (y & 0xFFFF) + (y >> 16) - 2 * 65535;
}

static double white_fine(const plant_constants *p, const source *of, int64_t counter) {
    int64_t first = 3 * counter, sum = sum4(of, first) + sum4(of, first + 1) + sum4(of, first + 2);
    return of->sigma * ((double)sum * p->ih12_scale);
}

static double flicker(const plant_constants *p, const source *of, double *state, int64_t counter) {
    double total = 0.0;
    for (int block = 0; block < POLES / 4; block++) {
        int64_t x, y;
        words(of->key0, of->key1, POLES / 4 * counter + block, &x, &y);
        int64_t part[4] = {x & 0xFFFF, x >> 16, y & 0xFFFF, y >> 16};
        double *s = state + 4 * block;
        for (int k = 0; k < 4; k++)
            s[k] = p->decay[4 * block + k] * s[k] + p->gain[4 * block + k] * ((double)part[k] - 32767.5);
        total = total + ((s[0] + s[1]) + (s[2] + s[3]));
    }
    return of->sigma * total;
}

/* ---- the matrix of a frame ---- */

static double between(double a, double b, double weight) { return a + weight * (b - a); }

/* Everything at a temperature and at the clocks of the DACs */
static void blend(const plant_constants *p, plant_state *s, const knot *a, const knot *b, double weight) {
    for (int j = 0; j < JETS; j++)
        for (int i = 0; i < ROWS; i++)
            for (int o = 0; o < ROWS; o++) s->jet[j][i][o] = between(a->jet[j][i][o], b->jet[j][i][o], weight);
    for (int k = 0; k < 4; k++) {
        int64_t clock = s->cycles[k & 1]; /* steps of drive and sense, then their jitter */
        for (int j = 0; j < JETS; j++)
            for (int o = 0; o < ROWS; o++)
                s->column[k][j][o] = between(a->column[k][j][clock][o], b->column[k][j][clock][o], weight);
    }
    for (int c = 0; c < 2; c++)
        for (int i = 0; i < 4; i++)
            for (int o = 0; o < 6; o++)
                s->pickoff[c][i][o] = between(a->pickoff[c][i][o], b->pickoff[c][i][o], weight);
    s->driver_s = between(a->driver_s, b->driver_s, weight);
    memcpy(s->made_cycles, s->cycles, sizeof s->cycles);
}

static void matrix(plant_state *s) {
    /* step and jitter of a DAC stand apart, for the clock at which it changes */
    static const int COLUMN[ROWS] = {[17] = 1, [19] = 2, [20] = 3, [21] = 4};
    double o = s->rate_rad_s, k = s->stiffness, oo = o * o, ok = o * k, kk = k * k;
    for (int i = 0; i < ROWS; i++)
        for (int c = 0; c < ROWS; c++) {
            double e[JETS];
            for (int n = 0; n < JETS; n++) e[n] = COLUMN[i] ? s->column[COLUMN[i] - 1][n][c] : s->jet[n][i][c];
            double small = (kk * e[5] + ok * e[4]) + oo * e[3];
            s->g[i][c] = e[0] + (o * e[1] + (k * e[2] + small));
        }
}

static const knot *located(const plant_constants *p, double temp_degc, const knot **next, double *weight) {
    if (p->knots == 1) {
        *weight = 0.0;
        return *next = p->at;
    }
    double position = (temp_degc - p->temp_lo_degc) / p->temp_step_k;
    int64_t index = (int64_t)position;
    if (index < 0) index = 0;
    if (index > p->knots - 2) index = p->knots - 2;
    *weight = position - (double)index;
    *next = p->at + index + 1;
    return p->at + index;
}

static int moved(const plant_state *s) {
    return s->made_cycles[0] != s->cycles[0] || s->made_cycles[1] != s->cycles[1];
}

void plant_retune(const plant_constants *p, plant_state *s, double rate_rad_s, double temp_degc) {
    const knot *b, *a;
    double weight, v = (double)s->quadrature_code * p->quad_lsb_v;
    a = located(p, temp_degc, &b, &weight);
    double kq = between(a->kq_n_per_m_per_v2, b->kq_n_per_m_per_v2, weight);
    double stiffness = between(a->kxy_n_per_m, b->kxy_n_per_m, weight) - kq * (v * v);
    int other = s->temp_degc != temp_degc || moved(s);
    if (!other && s->rate_rad_s == rate_rad_s && s->stiffness == stiffness) return;
    s->rate_rad_s = rate_rad_s;
    s->stiffness = stiffness;
    s->temp_degc = temp_degc;
    if (other) blend(p, s, a, b, weight);
    matrix(s);
}

void plant_accelerate(const plant_constants *p, plant_state *s, double acceleration_g) {
    double e = p->two_mismatch * acceleration_g * p->g_m_per_s2 / p->shift_scale;
    s->push_per_v = (e * p->k_vf_n_per_v) * p->push_scale;
    s->push_per_m = (-e * p->softening_n_per_m) * p->push_scale;
    s->cv_gain = e;
}

/* ---- output of a DAC: step (V) and impulse area (V s) that act in this tick ---- */

static void dac(const plant_constants *p, plant_state *s, int which, int64_t code, double jitter_s, double *step,
                double *area) {
    int64_t carry = p->dac_carry[which][s->cycles[which]];
    double told = p->offset_v[which] + p->lsb_v[which] * (double)code, next = carry ? s->coming_v[which] : told;
    *step = next - s->volts[which];
    if (carry) {
        *area = s->late_area[which];
        s->late_area[which] = (told - s->coming_v[which]) * jitter_s;
    } else {
        *area = *step * jitter_s + s->late_area[which];
        s->late_area[which] = 0.0;
    }
    s->volts[which] = next;
    s->coming_v[which] = told;
}

/* ---- demodulators ---- */

static void whole_tick(const plant_constants *p, double *w, double n, const double *q) {
    double w1 = w[0], w2 = w[1], w3 = w[2];
    w[0] = p->e1 * w1 + (q[0] + n * p->s1);
    w[1] = p->e1 * w2 + (p->e2 * w1 + (q[1] + n * p->s2));
    w[2] = p->e1 * w3 + (p->e2 * w2 + (p->e3 * w1 + (q[2] + n * p->s3)));
}

static void response(const plant_constants *p, double v0, double dv0, double v1, double dv1, double s, double *q) {
    double a = dv0 * p->h_s, b = dv1 * p->h_s, rise = v1 - v0;
    double c2 = 3.0 * rise - 2.0 * a - b, c3 = a + b - 2.0 * rise, power = s;
    for (int j = 0; j < 3; j++, power = power * s) {
        const double(*t)[4] = p->taylor[j];
        double total = 0.0;
        for (int i = 3; i >= 0; i--)
            total = total * s + (t[0][i] * v0 + s * (t[1][i] * a + s * (t[2][i] * c2 + s * (t[3][i] * c3))));
        q[j] = total * power;
    }
}

static void piece(double *w, double n, double u, const double *q, const double *f) {
    double sixth = 1.0 / 6, third = 1.0 / 3;
    double e = 1.0 - u * (1.0 - u * 0.5 * (1.0 - u * third * (1.0 - u * 0.25 * (1.0 - u * 0.2 * (1.0 - u * sixth)))));
    double e2 = e * u, e3 = e * u * u * 0.5;
    double s1 = e * u * (1.0 + u * 0.5 * (1.0 + u * third * (1.0 + u * 0.25 * (1.0 + u * 0.2 * (1.0 + u * sixth)))));
    double s2 = e * u * u * 0.5 * (1.0 + u * third * (1.0 + u * 0.25 * (1.0 + u * 0.2 * (1.0 + u * sixth))));
    double s3 = e * u * u * u * sixth * (1.0 + u * 0.25 * (1.0 + u * 0.2 * (1.0 + u * sixth * (1.0 + u * (1.0 / 7)))));
    double w1 = w[0] - f[0], w2 = w[1] - f[1], w3 = w[2] - f[2];
    w[0] = e * w1 + (q[0] + n * s1);
    w[1] = e * w2 + (e2 * w1 + (q[1] + n * s2));
    w[2] = e * w3 + (e2 * w2 + (e3 * w1 + (q[2] + n * s3)));
}

/* A tick in which the switches move at `taus` */
static int64_t pieces(const plant_constants *p, double *caps, int64_t ref, const double *taus, int count, double n,
                      const double *whole, const double *v) {
    double s = 0.0, q[3] = {0.0, 0.0, 0.0}, f[3];
    for (int i = 0; i < count; i++) {
        double t = taus[i] / p->h_s, *group = caps + (ref ? 0 : 3);
        memcpy(f, q, sizeof f);
        response(p, v[0], v[1], v[2], v[3], t, q);
        piece(group, n, p->r * (t - s), q, f);
        for (int k = 0; k < 3; k++) group[k] = group[k] + p->inject[(ref ? 0 : 3) + k];
        ref = !ref;
        s = t;
    }
    piece(caps + (ref ? 0 : 3), n, p->r * (1.0 - s), whole, q);
    return ref;
}

/* Instants in this tick at which the switches of demodulator d move; those of the next tick are kept */
static int acting(const plant_constants *p, plant_state *s, int64_t tick, int d, const plant_pins *pins, double *taus) {
    int count = (int)s->late_count[d], late = 0;
    int64_t ref = s->at_switch[d] ^ (count & 1);
    for (int k = 0; k < count; k++) taus[k] = s->late_tau_s[d][k];
    for (int64_t k = 0; k < pins->edge_count; k++) {
        if (pins->edge_pin[k] != d) continue;
        int64_t clock = pins->edge_clock[k];
        ref ^= 1;
        double tau = p->switch_tau_s[ref][clock] + white(p, &p->jitter, 0, JITTERED * tick + 1 + d);
        tau = tau < 0.0 ? 0.0 : tau;
        if (p->switch_carry[ref][clock]) s->late_tau_s[d][late++] = tau;
        else taus[count++] = tau > p->h_s ? p->h_s : tau;
    }
    s->late_count[d] = late;
    return count;
}

/* ---- the converter ---- */

static int64_t code(const plant_constants *p, int channel, double volts) {
    const int64_t lo = -((int64_t)1 << 23);
    double x = (volts + p->adc_offset_v[channel]) * p->steps_per_v[channel];
    if (x != x || x >= p->full_steps) return p->code_hi;
    if (x <= -p->full_steps) return lo;
    int64_t rounded = (int64_t)floor(x + 0.5) * p->step_code;
    return rounded > p->code_hi ? p->code_hi : rounded < lo ? lo : rounded;
}

static void conversion(const plant_constants *p, plant_state *s) {
    for (int c = 0; c < CHANNELS; c++) {
        double *sum = s->sums[c], v = sum[2] * p->normal;
        if (p->white[c].on) v = v + white_fine(p, &p->white[c], s->conversions);
        if (p->flicker[c].on) v = v + flicker(p, &p->flicker[c], sum + 3, s->conversions);
        s->codes[c] = code(p, c, v);
        sum[2] = sum[1];
        sum[1] = sum[0];
        sum[0] = 0.0;
    }
    s->conversions++;
}

static int64_t convert(const plant_constants *p, plant_state *s, const double *start, const double *stop) {
    const int64_t units = p->clocks << 32;
    if (s->due < units) {
        double frac = (double)s->due * (1.0 / (double)units);
        int64_t n = p->decimation, m = s->sample, rise = (m * (m - 1)) >> 1;
        double w[3] = {(double)rise, (double)((((n + m - 1) * (n + m)) >> 1) - 3 * rise),
                       (double)(((n - m) * (n - m + 1)) >> 1)};
        for (int c = 0; c < CHANNELS; c++) {
            double v = start[c] + frac * (stop[c] - start[c]);
            for (int k = 0; k < 3; k++) s->sums[c][k] = s->sums[c][k] + w[k] * v;
        }
        s->sample = m + 1;
        if (s->sample == n) {
            s->sample = 0;
            s->pending = s->due + p->delay;
            conversion(p, s);
        }
        s->due += p->period;
    }
    s->due -= units;
    if (s->pending == NOT_PENDING) return -1;
    int64_t left = s->pending - units, at = (left + ((int64_t)1 << 32) - 1) >> 32;
    s->pending = at < p->clocks ? NOT_PENDING : left;
    return at < p->clocks ? at : -1;
}

/* ---- a tick ---- */

int64_t plant_step(const plant_constants *p, plant_state *s, int64_t tick, const plant_pins *pins) {
    static const int FORCED[] = {1, 2, 3, 4, 5, 16, 17, 18, 19, 20, 21, 22, 23};
    const double(*g)[ROWS];
    double in[ROWS], out[STATES], b[4], path[6], start[CHANNELS], stop[CHANNELS], *z = s->z;
    for (int k = 0; k < 2; k++)
        if (pins->clock[k] >= 0) s->cycles[k] = pins->clock[k];
    if (moved(s)) {
        const knot *next, *at;
        double weight;
        at = located(p, s->temp_degc, &next, &weight);
        blend(p, s, at, next, weight);
        matrix(s);
    }
    g = (const double(*)[ROWS])s->g;
    memcpy(in, z, sizeof s->z);
    in[16] = s->volts[0] + held(p, &p->drive_dac, tick);
    in[18] = s->volts[1] + held(p, &p->sense_dac, tick);
    dac(p, s, 0, pins->code[0], white(p, &p->jitter, 0, JITTERED * tick), &in[17], &in[20]);
    dac(p, s, 1, pins->code[1], white(p, &p->jitter, 1, JITTERED * tick), &in[19], &in[21]);
    in[22] = held(p, &p->force_x, tick);
    in[23] = held(p, &p->force_y, tick);

    for (int c = 0; c < 2; c++) {
        int a = 3 * c, u = 16 + 2 * c, jitter = 20 + c;
        double f[3];
        for (int k = 0; k < 3; k++)
            f[k] = (g[u][a + k] * in[u] + g[u + 1][a + k] * in[u + 1]) + g[jitter][a + k] * in[jitter];
        out[a] = g[a][a] * z[a] + f[0];
        out[a + 1] = g[a + 1][a + 1] * z[a + 1] + (g[a][a + 1] * z[a] + f[1]);
        out[a + 2] = g[a + 2][a + 2] * z[a + 2] + ((g[a][a + 2] * z[a] + g[a + 1][a + 2] * z[a + 1]) + f[2]);
    }
    /* by the mean voltage about the tick's first instant */
    z[9] = z[9] + (s->push_per_v * (z[5] + p->lead * (out[5] - z[5])) + s->push_per_m * z[8]);
    for (int o = 0; o < 4; o++) b[o] = g[0][6 + o] * in[0];
    for (size_t k = 0; k < sizeof FORCED / sizeof FORCED[0]; k++)
        for (int o = 0; o < 4; o++) b[o] = b[o] + g[FORCED[k]][6 + o] * in[FORCED[k]];
    for (int o = 6; o < 10; o++)
        out[o] = ((g[6][o] * z[6] + g[7][o] * z[7]) + (g[8][o] * z[8] + g[9][o] * z[9])) + b[o - 6];
    for (int c = 0; c < 2; c++) {
        int a = 10 + 3 * c, x = 6 + 2 * c;
        const double(*q)[6] = (const double(*)[6])s->pickoff[c];
        double d[6], *e = d + 3;
        /* the cubic through both ends of the mode's tick, into the C/V states and the path */
        for (int o = 0; o < 6; o++)
            d[o] = ((q[0][o] * z[x] + q[1][o] * z[x + 1]) + q[2][o] * out[x]) + q[3][o] * out[x + 1];
        out[a] = g[a][a] * z[a] + d[0];
        out[a + 1] = g[a + 1][a + 1] * z[a + 1] + (g[a][a + 1] * z[a] + d[1]);
        out[a + 2] = g[a + 2][a + 2] * z[a + 2] + ((g[a][a + 2] * z[a] + g[a + 1][a + 2] * z[a + 1]) + d[2]);
        for (int k = 0; k < 3; k++) {
            int o = 16 + 3 * c + k;
            path[3 * c + k] = ((e[k] + g[a][o] * z[a]) + g[a + 1][o] * z[a + 1]) + g[a + 2][o] * z[a + 2];
        }
    }

    double noise[2] = {held(p, &p->cv_x, tick), held(p, &p->cv_y, tick)};
    noise[1] = noise[1] + (0.5 * (s->cv_gain * z[15]) + 0.5 * (s->cv_gain * out[15]));
    for (int d = 0; d < 4; d++) {
        double taus[2 * EDGES], *caps = s->caps[d];
        const double *q = path + (d < 2 ? 0 : 3);
        int cv = d < 2 ? 12 : 15, count = acting(p, s, tick, d, pins, taus);
        start[d] = caps[2] - caps[5];
        if (count == 0) whole_tick(p, caps + (s->at_switch[d] ? 0 : 3), noise[d / 2], q);
        else {
            double v[4] = {z[cv], (p->slope_gain * z[cv - 1] - z[cv]) / s->driver_s, out[cv],
                           (p->slope_gain * out[cv - 1] - out[cv]) / s->driver_s};
            s->at_switch[d] = pieces(p, caps, s->at_switch[d], taus, count, noise[d / 2], q, v);
        }
        stop[d] = caps[2] - caps[5];
    }
    memcpy(z, out, sizeof out);
    start[4] = stop[4] = p->sensor_v + p->sensor_v_per_k * (s->temp_degc - 25.0);
    return convert(p, s, start, stop);
}

void plant_reset(const plant_constants *p, plant_state *s) {
    memset(s, 0, sizeof *s);
    memcpy(s->z, p->z, sizeof s->z);
    memcpy(s->volts, p->volts, sizeof s->volts);
    memcpy(s->coming_v, p->volts, sizeof s->coming_v);
    memcpy(s->sums, p->sums, sizeof s->sums);
    s->quadrature_code = p->quadrature_code;
    s->pending = NOT_PENDING;
    s->rate_rad_s = s->temp_degc = s->stiffness = INFINITY;
    s->made_cycles[0] = s->made_cycles[1] = -1;
}

/* ---- the file: little-endian words of 64 bits ---- */

typedef struct {
    FILE *file;
    int64_t left; /* words; below 0: the file is too short */
} reader;

static int64_t word(reader *r) {
    unsigned char b[8];
    uint64_t value = 0;
    if (r->left <= 0 || fread(b, 1, sizeof b, r->file) != sizeof b) {
        r->left = -1;
        return 0;
    }
    r->left--;
    for (int k = 7; k >= 0; k--) value = value << 8 | b[k];
    return (int64_t)value;
}

static void integers(reader *r, int64_t *to, int64_t n) {
    for (int64_t k = 0; k < n; k++) to[k] = word(r);
}

static void doubles(reader *r, double *to, int64_t n) {
    for (int64_t k = 0; k < n; k++) {
        int64_t bits = word(r);
        memcpy(&to[k], &bits, sizeof bits);
    }
}

static void sources(reader *r, source *to, int64_t n) {
    for (int64_t k = 0; k < n; k++) {
        int64_t *whole[] = {&to[k].key0, &to[k].key1, &to[k].on, &to[k].half};
        for (int j = 0; j < 4; j++) integers(r, whole[j], 1);
        doubles(r, &to[k].sigma, 1);
    }
}

#define DOUBLES(x) doubles(r, (double *)&(x), (int64_t)(sizeof(x) / sizeof(double)))
#define INTEGERS(x) integers(r, (int64_t *)&(x), (int64_t)(sizeof(x) / sizeof(int64_t)))

static void read_knot(reader *r, knot *at, int64_t clocks) {
    DOUBLES(at->jet);
    for (int k = 0; k < 4; k++)
        for (int j = 0; j < JETS; j++)
            for (int64_t c = 0; c < clocks; c++) DOUBLES(at->column[k][j][c]);
    DOUBLES(at->pickoff);
    DOUBLES(at->driver_s);
    DOUBLES(at->kxy_n_per_m);
    DOUBLES(at->kq_n_per_m_per_v2);
}

static int read_all(reader *r, plant_constants *p) {
    int64_t head[4]; /* words behind them, clocks and ticks of a frame, knots */
    r->left = 4;
    INTEGERS(head);
    if (r->left || head[1] < 1 || head[1] > MOST_CLOCKS || head[2] < 1 || head[3] < 1 || head[3] > 1000) return 0;
    r->left = head[0];
    p->clocks = head[1];
    p->frame_ticks = head[2];
    p->knots = head[3];
    DOUBLES(p->temp_lo_degc);
    DOUBLES(p->temp_step_k);
    DOUBLES(p->temp_from_degc);
    DOUBLES(p->temp_to_degc);
    for (int k = 0; k < 2; k++) integers(r, p->dac_carry[k], p->clocks);
    for (int k = 0; k < 2; k++) integers(r, p->switch_carry[k], p->clocks);
    for (int k = 0; k < 2; k++) doubles(r, p->switch_tau_s[k], p->clocks);
    DOUBLES(p->quad_lsb_v);
    DOUBLES(p->lsb_v);
    DOUBLES(p->offset_v);
    DOUBLES(p->slope_gain);
    INTEGERS(p->period);
    INTEGERS(p->delay);
    INTEGERS(p->decimation);
    INTEGERS(p->step_code);
    INTEGERS(p->code_hi);
    DOUBLES(p->normal);
    DOUBLES(p->full_steps);
    DOUBLES(p->adc_offset_v);
    DOUBLES(p->steps_per_v);
    DOUBLES(p->sensor_v);
    DOUBLES(p->sensor_v_per_k);
    double *sid[] = {&p->h_s, &p->r, &p->e1, &p->e2, &p->e3, &p->s1, &p->s2, &p->s3};
    for (int k = 0; k < 8; k++) doubles(r, sid[k], 1);
    DOUBLES(p->inject);
    DOUBLES(p->taylor);
    source *all[] = {&p->force_x, &p->force_y, &p->cv_x, &p->cv_y, &p->drive_dac, &p->sense_dac, &p->jitter};
    for (int k = 0; k < 7; k++) sources(r, all[k], 1);
    sources(r, p->white, CHANNELS);
    sources(r, p->flicker, CHANNELS);
    double *tilt[] = {&p->two_mismatch, &p->g_m_per_s2, &p->shift_scale, &p->k_vf_n_per_v, &p->softening_n_per_m,
                      &p->push_scale, &p->lead};
    for (int k = 0; k < 7; k++) doubles(r, tilt[k], 1);
    DOUBLES(p->decay);
    DOUBLES(p->gain);
    DOUBLES(p->ih4_scale);
    DOUBLES(p->ih12_scale);
    DOUBLES(p->z);
    DOUBLES(p->volts);
    DOUBLES(p->sums);
    INTEGERS(p->quadrature_code);
    p->at = r->left >= 0 ? calloc((size_t)p->knots, sizeof *p->at) : NULL;
    if (!p->at) return 0;
    for (int64_t k = 0; k < p->knots; k++) read_knot(r, &p->at[k], p->clocks);
    return r->left == 0;
}

plant_constants *plant_read(const char *path, char *error, size_t size) {
    reader r = {fopen(path, "rb"), 0};
    plant_constants *p = r.file ? calloc(1, sizeof *p) : NULL;
    if (p && !read_all(&r, p)) {
        plant_free(p);
        p = NULL;
    }
    if (!p) snprintf(error, size, "%s: %s", path, r.file ? "not the constants of this plant" : "cannot be read");
    if (r.file) fclose(r.file);
    return p;
}

void plant_free(plant_constants *p) {
    if (p) free(p->at);
    free(p);
}
