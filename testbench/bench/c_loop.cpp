// The core blocks of gyro_core.v as a plain C loop over 26 MHz clocks; consumers are stepped before their producers, so
// that each reads the register its neighbour held before the edge.     usage: c_loop STATE TICKS CODES
#include "board.h"
#include "gyro_params.h"

struct Sine { int sign, base, slope, fraction, sign2, base2, product, y; };
struct Pipe { int taps[8]; };
struct Modulator { i64 product; int code, held1, held2; };
struct SpiDac { int shift, left, lead, sync_n, sclk_en, ldac_n, ldac_wait; };
struct Pi { i64 prop, acc, y; };

static struct Core {
    struct { int tick, frame, slot; } rates;
    struct { i64 phase, drive_sine, sense_sine, drive_ref, sense_ref; } dds;
    Sine drive_sine, sense_sine;
    Pipe drive_pipe, sense_pipe;
    struct { int signs, aligned[3], retimed; } references;
    Modulator drive_modulator, sense_modulator;
    SpiDac drive_dac, sense_dac, quadrature_dac;
    struct { int meta, sync, seen, busy, count, cs_n, sclk, shift, word, status, channels[8], valid, ok; } adc;
    struct {
        struct { i64 x, y, angle; int i, busy, done, magnitude, phase; } cordic;
        struct { int error; Pi loop; } agc;
        struct { int error; i64 centre, word; Pi loop; } frequency_tracker;
        struct { int error; Pi loop; } rate_loop;
        struct {
            int error;
            Pi loop;
            struct { i64 radicand; int root, remainder, i, busy, done, y; } root;
        } quadrature_loop;
    } control;
} s;

static inline i64 half_up(i64 x, int n) { return (x + ((i64)1 << n >> 1)) >> n; }
static inline i64 clamp(i64 x, i64 lo, i64 hi) { return x < lo ? lo : x > hi ? hi : x; }

static inline void pi_step(Pi &p, int en, int e, i64 kp, i64 ki, i64 lo, i64 hi) {
    p.y = clamp(half_up(p.prop + p.acc, 24), lo, hi);
    if (en) {
        p.prop = kp * e;
        p.acc = clamp(p.acc + ki * e, lo * (1 << 24), hi * (1 << 24));
    }
}

static inline void sine_step(Sine &q, i64 phase) {
    int y = (int)half_up(((i64)q.base2 << 10) + q.product, 16);
    q.y = q.sign2 ? -y : y;
    q.sign2 = q.sign;
    q.base2 = q.base;
    q.product = q.slope * (2 * q.fraction + 1);
    int place = (int)(phase >> 26);
    if (place & 1 << 20) place = ~place;
    i64 row = SINE_ROM[place >> 10 & 1023];
    q.sign = phase >> 47 & 1;
    q.base = (int)(row >> 13);
    q.slope = row & 8191;
    q.fraction = place & 1023;
}

static inline void pipe_step(Pipe &p, int x) {
    if (!PIPE_DEPTH) return;
    for (int k = 7; k; k--) p.taps[k] = p.taps[k - 1];
    p.taps[0] = x;
}

static inline int pipe_out(const Pipe &p, int x) { return PIPE_DEPTH ? p.taps[PIPE_DEPTH ? PIPE_DEPTH - 1 : 0] : x; }

static inline void modulator_step(Modulator &m, int en_product, int en_code, i64 amplitude, int y, int shift, int lo,
                                  int hi) {
    if (en_code) {
        m.held2 = m.held1;
        m.held1 = m.code;
        m.code = (int)clamp(half_up(m.product, shift), lo, hi);
    }
    if (en_product) m.product = amplitude * y;
}

static inline int modulator_out(const Modulator &m, int frames) {
    return frames == 2 ? m.held2 : frames == 1 ? m.held1 : m.code;
}

static inline void dac_step(SpiDac &d, int load, int word, int bits, int lead, int ldac) {
    d.ldac_n = load | !d.ldac_wait;
    d.ldac_wait = 0;
    if (load) {
        d.shift = word;
        d.left = bits;
        d.lead = lead;
        d.sync_n = 0;
        d.sclk_en = lead == 0;
    } else if (d.sclk_en) {
        d.shift = d.shift << 1 & ((1 << bits) - 1);
        if (d.left-- == 1) {
            d.sync_n = 1;
            d.sclk_en = 0;
            d.ldac_wait = ldac;
        }
    } else if (d.lead) d.sclk_en = d.lead-- == 1;
}

static inline int signs_of(i64 phase) {
    int half = phase >> 47 & 1, quarter = phase >> 46 & 1;
    return (half ^ 1) | (half ^ quarter ^ 1) << 1;
}

static inline int picked() {
    return REF_ALIGN ? s.references.aligned[REF_ALIGN ? REF_ALIGN - 1 : 0] : s.references.signs;
}
static inline int ref_pins() { return REF_RETIMED ? s.references.retimed : picked(); }

static void control_step(int slot) {
    auto &c = s.control;
    const int *in = s.adc.channels;
    int at_loops = slot == 32, at_pi = slot == 33;
    auto &r = c.quadrature_loop.root;
    if (slot == 36) r = {c.quadrature_loop.loop.y, 0, 0, 0, 1, 0, r.y};
    else if (!r.busy) r.done = 0;
    else {
        int pair = r.remainder << 2 | (int)(r.radicand >> 30), trial = (r.root << 2) + 1, fits = pair >= trial;
        r.root = r.root << 1 | fits;
        r.remainder = fits ? pair - trial : pair;
        r.radicand = r.radicand << 2 & 0xFFFFFFFF;
        r.done = r.i == 15;
        r.busy = !r.done;
        r.i = (r.i + 1) & 15;
        if (r.done) r.y = r.root;
    }
    c.frequency_tracker.word = (c.frequency_tracker.centre + c.frequency_tracker.loop.y) & 0xFFFFFFFFFFFF;
    pi_step(c.agc.loop, at_pi, c.agc.error, AGC_KP, AGC_KI, AGC_LO, AGC_HI);
    pi_step(c.frequency_tracker.loop, at_pi, c.frequency_tracker.error, PLL_KP, PLL_KI, PLL_LO, PLL_HI);
    pi_step(c.rate_loop.loop, at_pi, c.rate_loop.error, FTR_KP, FTR_KI, FTR_LO, FTR_HI);
    pi_step(c.quadrature_loop.loop, at_pi, c.quadrature_loop.error, QSC_KP, QSC_KI, QSC_LO, QSC_HI);
    auto &v = c.cordic;
    if (at_loops) {
        c.agc.error = (int)(SETPOINT - v.magnitude);
        c.frequency_tracker.error = v.phase;
        c.rate_loop.error = in[2];
        c.quadrature_loop.error = -in[3];
    }
    if (slot == 1) {
        int x = in[1] == -(1 << 23) ? (1 << 23) - 1 : -in[1], y = in[0];
        i64 half_turn = x < 0 ? -((i64)1 << 31) : 0;
        v = {(i64)(x < 0 ? -x : x) << 8, (i64)(x < 0 ? -y : y) * 256, half_turn, 0, 1, 0, v.magnitude, v.phase};
    } else if (!v.busy) v.done = 0;
    else if (v.i < 24) {
        i64 across = half_up(v.y, v.i), down = half_up(v.x, v.i);
        int up = v.y >= 0;
        v.x += up ? across : -across;
        v.y += up ? -down : down;
        v.angle = (int32_t)(v.angle + (up ? ATAN[v.i] : -ATAN[v.i]));
        v.i++;
    } else {
        v.busy = 0;
        v.done = 1;
        v.magnitude = (int)half_up(v.x, 8);
        v.phase = v.x ? (int32_t)(half_up(v.angle, 8) * 256) >> 8 : 0;
    }
}

static inline void adc_step(int drdy_n, int dout) {
    auto &a = s.adc;
    a.valid = 0;
    if (a.busy) {
        if (a.word == 9) {
            if (a.count++ == 53) {
                a.busy = a.count = a.word = 0;
                a.cs_n = 1;
            }
        } else if (!a.sclk) a.sclk = 1;
        else {
            a.sclk = 0;
            a.shift = (a.shift << 1 & 0xFFFFFF) | dout;
            if (++a.count == 24) {
                a.count = 0;
                if (a.word == 0) a.status = a.shift;
                else a.channels[a.word - 1] = (int)((unsigned)a.shift << 8) >> 8;
                if (++a.word == 9) {
                    a.valid = 1;
                    a.ok = a.status >> 20 == 12;
                }
            }
        }
    } else if (a.seen && !a.sync) {
        a.busy = 1;
        a.cs_n = 0;
    }
    a.seen = a.sync;
    a.sync = a.meta;
    a.meta = drdy_n;
}

static inline void clock_edge(int drdy_n, int dout) {
    int ce_1m = s.rates.tick == 0, at_code = s.rates.tick == 1, at_load = s.rates.tick == 2, go = s.adc.valid;
    int drive_word = 0, sense_word = 0, quadrature_word = 0;
    if (at_load) {
        drive_word = (modulator_out(s.drive_modulator, DRIVE_FRAMES) ^ 0x8000) & 0xFFFF;
        sense_word = 1 << 20 | (modulator_out(s.sense_modulator, SENSE_FRAMES) & 0xFFFFF);
        quadrature_word = 8 << 16 | s.control.quadrature_loop.root.y;
    }
    dac_step(s.drive_dac, at_load, drive_word, 16, 1, 0);
    dac_step(s.sense_dac, at_load, sense_word, 24, 0, 1);
    dac_step(s.quadrature_dac, at_load & s.rates.frame & 1, quadrature_word, 24, 0, 0);
    modulator_step(s.drive_modulator, ce_1m, at_code, s.control.agc.loop.y,
                   pipe_out(s.drive_pipe, s.drive_sine.y), DRIVE_SHIFT, DRIVE_LO, DRIVE_HI);
    modulator_step(s.sense_modulator, ce_1m, at_code, s.control.rate_loop.loop.y,
                   pipe_out(s.sense_pipe, s.sense_sine.y), SENSE_SHIFT, SENSE_LO, SENSE_HI);
    if (ce_1m) s.references.retimed = picked();
    s.references.aligned[2] = s.references.aligned[1];
    s.references.aligned[1] = s.references.aligned[0];
    s.references.aligned[0] = s.references.signs;
    s.references.signs = signs_of(s.dds.drive_ref) | signs_of(s.dds.sense_ref) << 2;
    pipe_step(s.drive_pipe, s.drive_sine.y);
    pipe_step(s.sense_pipe, s.sense_sine.y);
    sine_step(s.drive_sine, s.dds.drive_sine);
    sine_step(s.sense_sine, s.dds.sense_sine);
    const i64 TURN = 0xFFFFFFFFFFFF;
    s.dds.drive_sine = (s.dds.phase + PHASE_DRIVE_SINE) & TURN;
    s.dds.sense_sine = (s.dds.phase + PHASE_SENSE_SINE) & TURN;
    s.dds.drive_ref = (s.dds.phase + PHASE_DRIVE_REF) & TURN;
    s.dds.sense_ref = (s.dds.phase + PHASE_SENSE_REF) & TURN;
    s.dds.phase = (s.dds.phase + s.control.frequency_tracker.word) & TURN;
    if (s.rates.slot) control_step(s.rates.slot);
    adc_step(drdy_n, dout);
    if (++s.rates.tick == 26) {
        s.rates.tick = 0;
        s.rates.frame = s.rates.frame == 124 ? 0 : s.rates.frame + 1;
    }
    s.rates.slot = go ? 1 : s.rates.slot && s.rates.slot != 60 ? s.rates.slot + 1 : 0;
}

int main(int count, char **argument) {
    if (count != 4) fail("usage: c_loop STATE TICKS CODES");
    static Board board;
    std::vector<i64> core;
    board.load(argument[1], core);
#define FROM(field, k) field = core[k];
    CORE_REGISTERS(FROM)
    i64 ticks = std::atoll(argument[2]);
    board.drive_codes.reserve(ticks);
    board.sense_codes.reserve(ticks);
    double began = cpu_s();
    for (i64 k = 0; k < ticks; k++) {
        board.begin();
        for (int c = 0; c < TICK_CYCLES; c++) {
            clock_edge(board.drdy_n(), board.dout());
            const SpiDac &d = s.drive_dac, &e = s.sense_dac, &q = s.quadrature_dac;
            board.clock(s.adc.cs_n, s.adc.sclk, ref_pins(), d.sync_n, d.sclk_en, d.shift >> 15 & 1, e.sync_n, e.sclk_en,
                        e.shift >> 23 & 1, e.ldac_n, q.sync_n, q.sclk_en, q.shift >> 23 & 1);
        }
        board.end();
    }
    board.write(argument[3], cpu_s() - began);
#define SHOW(field, k) std::printf("register %d %lld\n", k, (long long)field);
    CORE_REGISTERS(SHOW)
    return 0;
}
