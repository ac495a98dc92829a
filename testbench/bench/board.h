// What is soldered around the FPGA, at pin level: digital sides of three DACs and of the ADC, and the plant.
// The same equations, in the same order, as analog_frontend/: every double must come out bit for bit.
// Effects, DAC bow and glitches, INL and digital SID are left out; locked_state.py exports no gyroscope that has them.
#pragma once
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <vector>

typedef int64_t i64;

enum { TICK_CYCLES = 26, FRAME_TICKS = 125, ROWS = 24, JETS = 6, CHANNELS = 5, POLES = 16, EDGES = 8 };

static double cpu_s() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static void fail(const char *what) {
    std::fprintf(stderr, "%s\n", what);
    std::exit(1);
}

// ---- noise.py ------------------------------------------------------------------------------------------------------

struct Source { i64 key0, key1, on, half; double sigma; };

static inline void words(i64 key0, i64 key1, i64 counter, i64 &x, i64 &y) {
    const i64 MASK = 0xFFFFFFFF, MULTIPLIER = 0x4F1BBCDD, WEYL = 0x9E3779B9;
    x = counter & MASK;
    y = (counter >> 32) ^ key1;
    for (int round = 0; round < 7; round++) {
        i64 p = x * MULTIPLIER;
        x = (p >> 31) ^ y ^ ((key0 + round * WEYL) & MASK);
        y = p & MASK;
    }
}

static inline i64 sum4(i64 key0, i64 key1, i64 counter) {
    i64 x, y;
    words(key0, key1, counter, x, y);
    return (x & 0xFFFF) + (x >> 16) + (y & 0xFFFF) + (y >> 16) - 2 * 65535;
}

static double IH4_SCALE, IH12_SCALE;

static inline double white(const Source &p, i64 counter) {
    if (!p.on) return 0.0;
    i64 x, y, sum = -510;
    words(p.key0, p.key1, counter, x, y);
    for (i64 word = p.half ? y : x; word; word >>= 8) sum += word & 0xFF;
    return p.sigma * (sum * IH4_SCALE);
}

static const i64 HOLD = 5;

static inline double held(const Source &p, i64 tick) { return white(p, tick / HOLD); }

static double white_fine(const Source &p, i64 counter) {
    i64 first = 3 * counter;
    i64 sum = sum4(p.key0, p.key1, first) + sum4(p.key0, p.key1, first + 1) + sum4(p.key0, p.key1, first + 2);
    return p.sigma * (sum * IH12_SCALE);
}

static double flicker_step(const Source &p, const double *decay, const double *gain, double *state, i64 counter) {
    double total = 0.0;
    for (int block = 0; block < POLES / 4; block++) {
        i64 x, y;
        words(p.key0, p.key1, POLES / 4 * counter + block, x, y);
        i64 part[4] = {x & 0xFFFF, x >> 16, y & 0xFFFF, y >> 16};
        double *s = state + 4 * block;
        for (int k = 0; k < 4; k++) s[k] = decay[4 * block + k] * s[k] + gain[4 * block + k] * (part[k] - 32767.5);
        total = total + ((s[0] + s[1]) + (s[2] + s[3]));
    }
    return p.sigma * total;
}

// ---- dac_serial.py, adc_serial.py ----------------------------------------------------------------------------------

struct DacChip { int shift, count, sync_n, ldac_n, staged, latch, code, enabled, updated; };

template <int BITS, int EXACT, int HAS_LDAC, int ADDRESS_MASK, int ADDRESS, int CONTROL, int DATA_MASK, int FLIP,
          int SIGN>
static inline void dac_clock(DacChip &s, int sync_n, int sclk_en, int sdin, int ldac_n) {
    s.updated = 0;
    int rose = sync_n && !s.sync_n, fell = !sync_n && s.sync_n;
    if (fell) s.count = 0;
    if (rose && (!EXACT || s.count == BITS)) {
        int place = s.shift & ADDRESS_MASK;
        if (place == ADDRESS) {
            int data = (s.shift & DATA_MASK) ^ FLIP;
            s.staged = data - ((data & SIGN) << 1);
            if (!HAS_LDAC || !ldac_n) {
                s.latch = s.staged;
                s.updated = 1;
            }
        } else if (CONTROL >= 0 && place == CONTROL) {
            s.enabled = (s.shift & (1 << 3 | 1 << 2)) == 0;
            s.updated = 1;
        }
    }
    if (HAS_LDAC && !ldac_n && s.ldac_n) {
        s.latch = s.staged;
        s.updated = 1;
    }
    if (sync_n != s.sync_n || ldac_n != s.ldac_n) s.code = s.enabled ? s.latch : 0;
    if (!sync_n && sclk_en) {
        s.shift = (s.shift << 1 | sdin) & 0xFFFFFF;
        s.count++;
    }
    s.sync_n = sync_n;
    s.ldac_n = ldac_n;
}

struct AdcChip { int cs_n, sclk, drdy_n, pulse, out, shift, left, word, result[9], frame[9]; };

static inline void adc_clock(AdcChip &s, int cs_n, int sclk, int loaded, const i64 *codes) {
    int was_low = !s.drdy_n, pulsing = s.pulse;
    if (pulsing && --s.pulse == 0) s.drdy_n = 0;
    if (loaded) {
        s.result[0] = 0xC00000;
        for (int k = 0; k < 8; k++) s.result[k + 1] = k < CHANNELS ? (int)(codes[k] & 0xFFFFFF) : 0;
        if (was_low) {
            s.drdy_n = 1;
            s.pulse = 4;
        } else if (!pulsing) s.drdy_n = 0;
    }
    if (cs_n != s.cs_n) {
        s.out = s.shift = s.left = s.word = 0;
        if (!cs_n) std::memcpy(s.frame, s.result, sizeof s.frame);
    } else if (!cs_n && sclk != s.sclk) {
        if (sclk) {
            if (s.left) s.left--;
            else if (s.word != 9) {
                s.shift = s.frame[s.word++];
                s.left = 23;
            }
            s.out = s.shift >> 23 & 1;
            s.shift = s.shift << 1 & 0xFFFFFF;
        } else if (!loaded && !pulsing) s.drdy_n = 1;
    }
    s.cs_n = cs_n;
    s.sclk = sclk;
}

// ---- sid.py --------------------------------------------------------------------------------------------------------

struct Sid { double h_s, r, e1, e2, e3, s1, s2, s3, inject[6], taylor[3][4][4]; };

static inline void sid_full(const Sid &p, double *w, double n, double p1, double p2, double p3) {
    double w1 = w[0], w2 = w[1], w3 = w[2];
    w[0] = p.e1 * w1 + (p1 + n * p.s1);
    w[1] = p.e1 * w2 + (p.e2 * w1 + (p2 + n * p.s2));
    w[2] = p.e1 * w3 + (p.e2 * w2 + (p.e3 * w1 + (p3 + n * p.s3)));
}

static double series(const Sid &p, int j, double c0, double c1, double c2, double c3, double s) {
    const double (*a)[4] = p.taylor[j];
    double total = 0.0;
    for (int i = 3; i >= 0; i--)
        total = total * s + (a[0][i] * c0 + s * (a[1][i] * c1 + s * (a[2][i] * c2 + s * (a[3][i] * c3))));
    double power = s;
    for (int k = 0; k < j; k++) power = power * s;
    return total * power;
}

static void response(const Sid &p, double v0, double dv0, double v1, double dv1, double s, double *q) {
    double a = dv0 * p.h_s, b = dv1 * p.h_s, rise = v1 - v0;
    double c2 = 3.0 * rise - 2.0 * a - b, c3 = a + b - 2.0 * rise;
    for (int j = 0; j < 3; j++) q[j] = series(p, j, v0, a, c2, c3, s);
}

static void segment(double *w, double n, double u, const double *q, const double *f) {
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

static i64 sid_edges(const Sid &p, double *caps, i64 ref, const double *taus, int count, double n, const double *whole,
                     double v0, double dv0, double v1, double dv1) {
    double s = 0.0, q[3] = {0.0, 0.0, 0.0}, f[3];
    for (int i = 0; i < count; i++) {
        double t = taus[i] / p.h_s, *group = caps + (ref ? 0 : 3);
        std::memcpy(f, q, sizeof f);
        response(p, v0, dv0, v1, dv1, t, q);
        segment(group, n, p.r * (t - s), q, f);
        for (int k = 0; k < 3; k++) group[k] = group[k] + p.inject[(ref ? 0 : 3) + k];
        ref = !ref;
        s = t;
    }
    segment(caps + (ref ? 0 : 3), n, p.r * (1.0 - s), whole, q);
    return ref;
}

// ---- the board -----------------------------------------------------------------------------------------------------

struct Board {
    // what goes to the FPGA
    int drdy_n() const { return adc.drdy_n; }
    int dout() const { return adc.out; }

    // time
    i64 tick, drdy_cycle;
    int cycle, drive_cycle, sense_cycle, edge_count, edge[EDGES][2], refs;
    // chips
    DacChip drive, sense, quadrature;
    AdcChip adc;
    // plant, state
    alignas(64) double g[ROWS][ROWS];
    double z[16], jet[JETS][ROWS][ROWS], column_jet[4][JETS][ROWS], pickoff[2][4][6], rate_now, stiffness_now;
    double volts[2], coming[2], late_area[2], caps[4][6], late_tau[4][EDGES], sums[CHANNELS][3 + POLES];
    i64 cycles[2], at_switch[4], late_count[4], due, sample, pending, conversions, adc_codes[CHANNELS];
    // plant, constants
    double rate, kq, kxy, quad_lsb, lsb[2], offset[2], switch_tau[2][TICK_CYCLES], slope_gain, driver_s, sensor_v;
    double normal, full_steps, adc_offset[CHANNELS], steps_per_v[CHANNELS], decay[POLES], gain[POLES];
    i64 switch_carry[2][TICK_CYCLES], dac_carry[2], period, delay, decimation, step_code;
    Source force_x, force_y, cv_x, cv_y, drive_noise, sense_noise, jitter, adc_white[CHANNELS], adc_flicker[CHANNELS];
    Sid sid;
    // results
    std::vector<int32_t> drive_codes, sense_codes;
    std::vector<i64> frames;

    void load(const char *path);
    void write(const char *path, double spent) const;
    void begin();   // before the first clock of a tick
    void clock(int adc_cs_n, int adc_sclk, int now, int d_sync_n, int d_sclk_en, int d_sdin, int s_sync_n,
               int s_sclk_en, int s_sdin, int s_ldac_n, int q_sync_n, int q_sclk_en, int q_sdin);
    void end();     // after the last

private:
    void retune();
    void dac_step(int which, i64 code, double jitter_s, double &step, double &area);
    void switches(double noise_x, double noise_y, const double *after, const double *p);
    i64 code(int channel, double volts_in) const;
    i64 convert(const double *start, const double *stop);
    void plant();
};

inline void Board::begin() {
    cycle = 0;
    drive_cycle = sense_cycle = -1;
    edge_count = 0;
    if (tick % FRAME_TICKS == 0) {
        frames.insert(frames.end(), adc_codes, adc_codes + CHANNELS);
        retune();
    }
}

inline void Board::clock(int adc_cs_n, int adc_sclk, int now, int d_sync_n, int d_sclk_en, int d_sdin, int s_sync_n,
                         int s_sclk_en, int s_sdin, int s_ldac_n, int q_sync_n, int q_sclk_en, int q_sdin) {
    dac_clock<16, 0, 0, 0, 0, -1, 0xFFFF, 0x8000, 0x8000>(drive, d_sync_n, d_sclk_en, d_sdin, 1);
    dac_clock<24, 1, 1, 0xF << 20, 0x1 << 20, 0x2 << 20, 0xFFFFF, 0, 0x80000>(sense, s_sync_n, s_sclk_en, s_sdin,
                                                                              s_ldac_n);
    dac_clock<24, 1, 0, 0xFF << 16, 0x08 << 16, -1, 0xFFFF, 0, 0>(quadrature, q_sync_n, q_sclk_en, q_sdin, 1);
    adc_clock(adc, adc_cs_n, adc_sclk, cycle == drdy_cycle, adc_codes);
    if (drive.updated) drive_cycle = cycle;
    if (sense.updated) sense_cycle = cycle;
    if (now != refs) {
        for (int d = 0; d < 4; d++)
            if ((now ^ refs) >> d & 1 && edge_count < EDGES) {
                edge[edge_count][0] = cycle;
                edge[edge_count++][1] = d;
            }
        refs = now;
    }
    cycle++;
}

inline void Board::end() {
    plant();
    drive_codes.push_back(drive.code);
    sense_codes.push_back(sense.code);
    tick++;
}

inline void Board::retune() {
    double v = quadrature.code * quad_lsb, stiffness = kxy - kq * (v * v);
    if (rate_now == rate && stiffness_now == stiffness) return;
    rate_now = rate;
    stiffness_now = stiffness;
    double o = rate, k = stiffness, oo = o * o, ok = o * k, kk = k * k;
    for (int i = 0; i < ROWS; i++) {
        // rows of the DACs' steps and jitter stand apart, for the clock at which each DAC changes
        int column = i == 17 ? 0 : i == 19 ? 1 : i == 20 ? 2 : i == 21 ? 3 : -1;
        for (int c = 0; c < ROWS; c++) {
            double e[JETS];
            for (int n = 0; n < JETS; n++) e[n] = column < 0 ? jet[n][i][c] : column_jet[column][n][c];
            double small = (kk * e[5] + ok * e[4]) + oo * e[3];
            g[i][c] = e[0] + (o * e[1] + (k * e[2] + small));
        }
    }
}

// Step (V) and impulse area (V s) of one DAC that act in this tick; with `carry` a code acts a tick later.
inline void Board::dac_step(int which, i64 code, double jitter_s, double &step, double &area) {
    double told = offset[which] + lsb[which] * code, next = dac_carry[which] ? coming[which] : told;
    step = next - volts[which];
    if (dac_carry[which]) {
        area = late_area[which];
        late_area[which] = (told - next) * jitter_s;
    } else {
        area = step * jitter_s + late_area[which];
        late_area[which] = 0.0;
    }
    volts[which] = next;
    coming[which] = told;
}

inline void Board::plant() {
    if ((drive_cycle >= 0 && drive_cycle != cycles[0]) || (sense_cycle >= 0 && sense_cycle != cycles[1]))
        fail("a DAC changed at another clock of the tick than when the state was exported");
    double in[ROWS], out[16], b[4], p[6];
    std::memcpy(in, z, sizeof z);
    in[16] = volts[0] + held(drive_noise, tick);
    in[18] = volts[1] + held(sense_noise, tick);
    Source second = jitter;
    second.half = 1;
    dac_step(0, drive.code, white(jitter, 5 * tick), in[17], in[20]);
    dac_step(1, sense.code, white(second, 5 * tick), in[19], in[21]);
    in[22] = held(force_x, tick);
    in[23] = held(force_y, tick);

    // forced part of the modes
    static const int FORCED[] = {1, 2, 3, 4, 5, 16, 17, 18, 19, 20, 21, 22, 23};
    for (int o = 0; o < 4; o++) b[o] = g[0][6 + o] * in[0];
    for (int j : FORCED)
        for (int o = 0; o < 4; o++) b[o] = b[o] + g[j][6 + o] * in[j];
    for (int o = 6; o < 10; o++)
        out[o] = ((g[6][o] * z[6] + g[7][o] * z[7]) + (g[8][o] * z[8] + g[9][o] * z[9])) + b[o - 6];
    for (int c = 0; c < 2; c++) {
        int a = 3 * c, u = 16 + 2 * c, jit = 20 + c;
        double f[3];
        for (int k = 0; k < 3; k++)
            f[k] = (g[u][a + k] * in[u] + g[u + 1][a + k] * in[u + 1]) + g[jit][a + k] * in[jit];
        out[a] = g[a][a] * z[a] + f[0];
        out[a + 1] = g[a + 1][a + 1] * z[a + 1] + (g[a][a + 1] * z[a] + f[1]);
        out[a + 2] = g[a + 2][a + 2] * z[a + 2] + ((g[a][a + 2] * z[a] + g[a + 1][a + 2] * z[a + 1]) + f[2]);
        // the cubic through both ends of the mode's tick, into the C/V states and the path
        double d[6];
        int x = 6 + 2 * c;
        const double (*q)[6] = pickoff[c];
        for (int o = 0; o < 6; o++)
            d[o] = ((q[0][o] * z[x] + q[1][o] * z[x + 1]) + q[2][o] * out[x]) + q[3][o] * out[x + 1];
        a = 10 + 3 * c;
        const double *e = d + 3;
        out[a] = g[a][a] * z[a] + d[0];
        out[a + 1] = g[a + 1][a + 1] * z[a + 1] + (g[a][a + 1] * z[a] + d[1]);
        out[a + 2] = g[a + 2][a + 2] * z[a + 2] + ((g[a][a + 2] * z[a] + g[a + 1][a + 2] * z[a + 1]) + d[2]);
        for (int k = 0; k < 3; k++) {
            int o = 16 + 3 * c + k;
            p[3 * c + k] = ((e[k] + g[a][o] * z[a]) + g[a + 1][o] * z[a + 1]) + g[a + 2][o] * z[a + 2];
        }
    }

    double noise_x = held(cv_x, tick), noise_y = held(cv_y, tick), start[CHANNELS], stop[CHANNELS];
    for (int d = 0; d < 4; d++) start[d] = caps[d][2] - caps[d][5];
    start[4] = stop[4] = sensor_v;
    if (edge_count + late_count[0] + late_count[1] + late_count[2] + late_count[3] == 0) {
        for (int d = 0; d < 4; d++) {
            const double *q = p + (d < 2 ? 0 : 3);
            sid_full(sid, caps[d] + (at_switch[d] ? 0 : 3), d < 2 ? noise_x : noise_y, q[0], q[1], q[2]);
        }
    } else switches(noise_x, noise_y, out, p);
    std::memcpy(z, out, sizeof z);
    for (int d = 0; d < 4; d++) stop[d] = caps[d][2] - caps[d][5];
    drdy_cycle = convert(start, stop);
}

inline void Board::switches(double noise_x, double noise_y, const double *after, const double *p) {
    double taus[2 * EDGES];
    for (int d = 0; d < 4; d++) {
        int count = (int)late_count[d], late = 0;
        i64 ref = at_switch[d] ^ (count & 1);
        for (int k = 0; k < count; k++) taus[k] = late_tau[d][k];
        for (int k = 0; k < edge_count; k++) {
            if (edge[k][1] != d) continue;
            ref ^= 1;
            double tau = switch_tau[ref][edge[k][0]] + white(jitter, 5 * tick + 1 + d);
            tau = tau < 0.0 ? 0.0 : tau;
            if (switch_carry[ref][edge[k][0]]) late_tau[d][late++] = tau;
            else taus[count++] = tau > sid.h_s ? sid.h_s : tau;
        }
        late_count[d] = late;
        const double *q = p + (d < 2 ? 0 : 3);
        int cv = d < 2 ? 12 : 15;
        double n = d < 2 ? noise_x : noise_y;
        if (count == 0) sid_full(sid, caps[d] + (at_switch[d] ? 0 : 3), n, q[0], q[1], q[2]);
        else
            at_switch[d] = sid_edges(sid, caps[d], at_switch[d], taus, count, n, q, z[cv],
                                     (slope_gain * z[cv - 1] - z[cv]) / driver_s, after[cv],
                                     (slope_gain * after[cv - 1] - after[cv]) / driver_s);
    }
}

inline i64 Board::code(int channel, double volts_in) const {
    double x = (volts_in + adc_offset[channel]) * steps_per_v[channel];
    if (x != x || x >= full_steps) return (1 << 23) - 1;
    if (x <= -full_steps) return -(1 << 23);
    i64 rounded = (i64)std::floor(x + 0.5) * step_code;
    return rounded > (1 << 23) - 1 ? (1 << 23) - 1 : rounded < -(1 << 23) ? -(1 << 23) : rounded;
}

inline i64 Board::convert(const double *start, const double *stop) {
    const i64 TICK_UNITS = (i64)TICK_CYCLES << 32, NOT_PENDING = -((i64)1 << 61);
    if (due < TICK_UNITS) {
        double frac = due * (1.0 / TICK_UNITS);
        i64 n = decimation, m = sample, rise = (m * (m - 1)) >> 1;
        double w[3] = {(double)rise, (double)((((n + m - 1) * (n + m)) >> 1) - 3 * rise),
                       (double)(((n - m) * (n - m + 1)) >> 1)};
        for (int c = 0; c < CHANNELS; c++) {
            double v = start[c] + frac * (stop[c] - start[c]);
            for (int k = 0; k < 3; k++) sums[c][k] = sums[c][k] + w[k] * v;
        }
        sample = m + 1;
        if (sample == n) {
            sample = 0;
            pending = due + delay;
            for (int c = 0; c < CHANNELS; c++) {
                double v = sums[c][2] * normal;
                if (adc_white[c].on) v = v + white_fine(adc_white[c], conversions);
                if (adc_flicker[c].on) v = v + flicker_step(adc_flicker[c], decay, gain, sums[c] + 3, conversions);
                adc_codes[c] = code(c, v);
                sums[c][2] = sums[c][1];
                sums[c][1] = sums[c][0];
                sums[c][0] = 0.0;
            }
            conversions++;
        }
        due = due + period;
    }
    due -= TICK_UNITS;
    if (pending == NOT_PENDING) return -1;
    i64 left = pending - TICK_UNITS, at = (left + ((i64)1 << 32) - 1) >> 32;
    pending = at < TICK_CYCLES ? NOT_PENDING : left;
    return at < TICK_CYCLES ? at : -1;
}

// ---- files: little-endian 64-bit words, in the order of locked_state.py ---------------------------------------------------

struct Reader {
    std::vector<i64> content;
    size_t at = 0;
    explicit Reader(const char *path) {
        FILE *file = std::fopen(path, "rb");
        if (!file) fail("cannot read the exported state");
        i64 word;
        while (std::fread(&word, sizeof word, 1, file) == 1) content.push_back(word);
        std::fclose(file);
    }
    i64 next() {
        if (at == content.size()) fail("the exported state is too short");
        return content[at++];
    }
    void read(int &to) { to = (int)next(); }
    void read(i64 &to) { to = next(); }
    void read(double &to) {
        i64 word = next();
        std::memcpy(&to, &word, sizeof word);
    }
    void read(Source &s) { read(s.key0, s.key1, s.on, s.half, s.sigma); }
    void read(DacChip &c) {
        read(c.shift, c.count, c.sync_n, c.ldac_n, c.staged, c.latch, c.code, c.enabled, c.updated);
    }
    void read(AdcChip &c) {
        read(c.cs_n, c.sclk, c.drdy_n, c.pulse, c.out, c.shift, c.left, c.word, c.result, c.frame);
    }
    void read(Sid &s) { read(s.h_s, s.r, s.e1, s.e2, s.e3, s.s1, s.s2, s.s3, s.inject, s.taylor); }
    template <class T, size_t N> void read(T (&to)[N]) { for (T &item : to) read(item); }
    template <class A, class B, class... More> void read(A &a, B &b, More &...more) {
        read(a);
        read(b, more...);
    }
};

inline void Board::load(const char *path) {
    Reader r(path);
    r.read(tick, drdy_cycle, refs, drive, sense, quadrature, adc);
    r.read(z, jet, column_jet, pickoff, volts, coming, late_area, caps, late_tau, sums);
    r.read(cycles, at_switch, late_count, due, sample, pending, conversions, adc_codes);
    r.read(rate, kq, kxy, quad_lsb, lsb, offset, switch_tau, slope_gain, driver_s, sensor_v);
    r.read(normal, full_steps, adc_offset, steps_per_v, decay, gain);
    r.read(switch_carry, dac_carry, period, delay, decimation, step_code);
    r.read(force_x, force_y, cv_x, cv_y, drive_noise, sense_noise, jitter, adc_white, adc_flicker);
    r.read(sid, IH4_SCALE, IH12_SCALE);
    if (r.at != r.content.size()) fail("the exported state is too long");
    rate_now = stiffness_now = INFINITY;
    if (tick % FRAME_TICKS) fail("the exported state is not at the beginning of a frame");
}

// two integers (ticks, frames), CPU time, linear state and capacitors at the end, then the codes
inline void Board::write(const char *path, double spent) const {
    FILE *file = std::fopen(path, "wb");
    if (!file) fail("cannot write the codes");
    i64 head[2] = {(i64)drive_codes.size(), (i64)frames.size() / CHANNELS};
    std::fwrite(head, sizeof head, 1, file);
    std::fwrite(&spent, sizeof spent, 1, file);
    std::fwrite(z, sizeof z, 1, file);
    std::fwrite(caps, sizeof caps, 1, file);
    std::fwrite(drive_codes.data(), 4, drive_codes.size(), file);
    std::fwrite(sense_codes.data(), 4, sense_codes.size(), file);
    std::fwrite(frames.data(), 8, frames.size(), file);
    if (std::fclose(file)) fail("cannot write the codes");
}
