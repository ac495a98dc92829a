/* A second plant of the gyroscope behind the plant port, for records whose truth is not made by the product's own.

   From the equations of docs/plant.md and its modules; no code and no number of analog_frontend. What is different:
     state        each mode is one complex number in a frame that turns with it; chains; capacitors
     integration  variation of constants: staircases behind three poles act on a mode in closed form (chain.h); coupling,
                  laws and noise as impulses in the middle of a step, `own.steps` steps to a tick (1, 2, 4 ..)
     C/V          steady response of the three poles to the turning mode, plus what forces add, at the points of Gauss
     converter    integrators and combs; noise: xoshiro256++, ziggurat
     drawn here   by `board`: delays of DACs and of each switch, instants of the converter and of DRDY

   own text, one line each: steps; board, delay_sd_s, drdy_spread_ticks (what is drawn); cv_noise, adc_noise, flicker
                            (factors), adc_colour; law.N = "...", mechanism.N = ... (laws.h)
*/
#include <math.h>
#include <stdio.h>

#include "gyro_plant.h"

#include "chain.h"
#include "converter.h"
#include "demodulator.h"
#include "laws.h"
#include "random.h"
#include "ring.h"

enum { MOST_STEPS = 16, MOST_EVENTS = 32, DRIVE = 0, SENSE = 1, NOISE_TICKS = 4 };

typedef struct {
    double at; /* ticks from the first instant of the tick to come */
    int demodulator, level;
} Event;

/* Everything that moves. */
typedef struct {
    Complex z[2];
    double chain[2][3], held[2], coming[2], cv[2][3], caps[4][2][3], force[2], memory[MOST_MECHANISMS];
    int level[4], pin[4], events;
    int64_t clock[2];
    Event event[MOST_EVENTS];
    Converter adc;
    Stream cv_noise, force_noise, jitter;
} State;

/* What a temperature makes of the plant, and a step of it. */
typedef struct {
    Complex l, turn, half, c_low, c_high, c_half, c_end; /* c_..: of z at a point of the step to the C/V output */
    double wd, sigma, mass_inverse, k_vf, force_noise, push[3], cv_gain;
    Decay cv;
    Chain chain;
    int step_of; /* in which step of a tick the DAC steps */
    int late;    /* 1 if what a tick tells acts in the next one */
} Axis;

typedef struct {
    const char *text;
    int steps;
    double tc, tick, step, cv_noise, span[3], dac_delay[2], inject[2];
    double switch_delay[4], offset_ticks, ready_ticks; /* drawn, as part of the delays of the DACs */
    double temperature, rate, damping, coupling, gyration, switch_fall, jitter;
    Axis axis[2];
    Weights full;
    ConverterParams adc;
    Effects effects;
    double gain[MOST_LAWS];
    double k_xy, k_q, coriolis_mass, ref_degc, rc_now;
    State s;
    char error[200];
} Plant;

#define PLANT_KEYS                                                                                                     \
    "clock_ppm clock_jitter_s carrier_hz carrier_ppm drive_dac_span_v sense_dac_span_v quad_dac_span_v "                \
    "drive_dac_delay_s sense_dac_delay_s drive_pole_1_s drive_pole_2_s drive_pole_3_s sense_pole_1_s sense_pole_2_s "  \
    "sense_pole_3_s mass_kg coriolis_mass_kg fx_hz fy_hz qx qy kxy_n_per_m dxy_ratio k_vf_drive_n_per_v "              \
    "k_vf_sense_n_per_v kq_n_per_m_per_v2 carrier_v carrier_tc_per_k c0_f cp_f dcdx_f_per_m dcdy_f_per_m "             \
    "cref_drive_f cref_sense_f diode_is_a diode_n diode_cj0_f diode_vj_v diode_m diode_eg_ev diode_xti diode_tc_on "   \
    "opamp_gbw_hz ina_noise_gain driver_noise_gain signal_gain sid_r_ohm sid_c_f sid_switch_s sid_fall_s "             \
    "sid_charge_c sid_charge_mismatch sid_charge_tc_per_k adc_vref_v adc_pga_drive adc_pga_sense adc_delay_s "         \
    "adc_step_code adc_noise_drive_v adc_noise_sense_v cv_noise_v_per_rthz sid_flicker_v_per_rthz "                    \
    "drive_dac_noise_v_per_rthz sense_dac_noise_v_per_rthz temp_ref_degc tcf_per_k dlnq_per_k kxy_tc_below_per_k "     \
    "kxy_tc_above_per_k opamp_gbw_tc_per_k dac_rc_tc_per_k dac_amplifier_tc_on sid_rc_tc_per_k"
#define NOISE_KEYS "thermomechanical cv dac adc flicker jitter"

/* A number of [plant]; NAN if the configuration lacks it. */
static double number(const Plant *p, const char *key) {
    char whole[64];
    snprintf(whole, sizeof whole, "plant.%s", key);
    return gyro_number(p->text, whole, NAN);
}

static int switched_on(const Plant *p, const char *key) { return gyro_number(p->text, key, 1) != 0; }

/* One mode and its paths at a temperature. */
static void axis_design(Plant *p, int a, double degc) {
    Axis *x = &p->axis[a];
    const char *name = a ? "sense" : "drive";
    char key[64];
#define OF(pattern) (snprintf(key, sizeof key, pattern, name), number(p, key))
    double dt = degc - number(p, "temp_ref_degc"), w0 = 2 * M_PI * number(p, a ? "fy_hz" : "fx_hz");
    w0 *= 1 + number(p, "tcf_per_k") * dt;
    double q = number(p, a ? "qy" : "qx") * exp(number(p, "dlnq_per_k") * dt), mass = number(p, "mass_kg");
    x->sigma = w0 / (2 * q);
    x->wd = sqrt(w0 * w0 - x->sigma * x->sigma);
    x->l = (Complex){-x->sigma, x->wd};
    x->mass_inverse = 1 / mass;
    x->k_vf = OF("k_vf_%s_n_per_v");
    double h = p->step;
    x->turn = rotated(x->l, h);
    x->half = rotated(x->l, h / 2);
    double rc = 1 + number(p, "dac_rc_tc_per_k") * dt, gbw = 1 + number(p, "opamp_gbw_tc_per_k") * dt;
    double slow = number(p, "dac_amplifier_tc_on") ? 1 / gbw : rc;
    double tau[3] = {OF("%s_pole_1_s") * rc, OF("%s_pole_2_s") * slow, OF("%s_pole_3_s") * slow};
    chain_design(&x->chain, tau, x->l, h);
    /* C/V: ring, instrumentation amplifier, driver with the signal gain */
    Diode d = {number(p, "diode_is_a"), number(p, "diode_n"),     number(p, "diode_cj0_f"), number(p, "diode_vj_v"),
               number(p, "diode_m"),    number(p, "diode_eg_ev"), number(p, "diode_xti")};
    double carrier = number(p, "carrier_v") * (1 + number(p, "carrier_tc_per_k") * dt);
    double carrier_hz = number(p, "carrier_hz") * (1 + 1e-6 * number(p, "carrier_ppm"));
    double ring_degc = number(p, "diode_tc_on") ? degc : number(p, "temp_ref_degc");
    Ring ring = ring_at(&d, carrier, carrier_hz, number(p, "c0_f"), number(p, "cp_f"), OF("cref_%s_f"), ring_degc,
                        number(p, "temp_ref_degc"));
    double amplifier = 1 / (2 * M_PI * number(p, "opamp_gbw_hz") * gbw), gain = number(p, "signal_gain");
    double poles[3] = {ring.tau, number(p, "ina_noise_gain") * amplifier, number(p, "driver_noise_gain") * amplifier};
    Complex c = {ring.gain * number(p, a ? "dcdy_f_per_m" : "dcdx_f_per_m") / x->wd, 0};
    double through[3];
    for (int k = 0; k < 3; k++) {
        c = mul(c, inverse((Complex){1 + x->l.re * poles[k], x->l.im * poles[k]}));
        if (k == 2) c = scaled(c, gain);
        through[k] = -c.im;
    }
    x->cv_gain = gain;
    x->cv = decay(poles, gain, h);
    /* what a steady acceleration adds over a step: Simpson's rule over the decay, 16 pieces */
    for (int k = 0; k < 3; k++) x->push[k] = 0;
    for (int n = 0; n <= 16; n++) {
        Decay at = decay(poles, gain, h * n / 16);
        double weight = h / 48 * (n == 0 || n == 16 ? 1 : n % 2 ? 4 : 2);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j <= i; j++) x->push[i] += weight * at.m[i][j] * through[j];
    }
    x->c_end = c;
    x->c_low = mul(c, rotated(x->l, GAUSS_LOW * h));
    x->c_high = mul(c, rotated(x->l, GAUSS_HIGH * h));
    x->c_half = mul(c, x->half);
    /* forces: Brownian, and the noise of the DAC; white, one number for NOISE_TICKS ticks */
    double kelvin = degc + 273.15, d_n = mass * w0 / q;
    double brownian = switched_on(p, "noise.thermomechanical") ? 4 * 1.380649e-23 * kelvin * d_n : 0;
    double volts = switched_on(p, "noise.dac") ? x->k_vf * OF("%s_dac_noise_v_per_rthz") : 0;
    x->force_noise = sqrt((brownian + volts * volts) / (2 * NOISE_TICKS * p->tick));
    if (a == DRIVE) p->damping = number(p, "dxy_ratio") * d_n;
#undef OF
}

/* Where in a tick a DAC's output changes. */
static void dac_instant(Plant *p, int a) {
    Axis *x = &p->axis[a];
    double at = (p->s.clock[a] * p->tc + p->dac_delay[a]) / p->tick;
    x->late = (int)floor(at);
    at -= x->late;
    x->step_of = (int)(at * p->steps);
    chain_step_at(&x->chain, x->l, (at * p->steps - x->step_of) * p->step);
}

static void at_temperature(Plant *p, double degc) {
    double dt = degc - number(p, "temp_ref_degc");
    for (int a = 0; a < 2; a++) {
        axis_design(p, a, degc);
        dac_instant(p, a);
    }
    double slope = dt < 0 ? number(p, "kxy_tc_below_per_k") : number(p, "kxy_tc_above_per_k");
    p->k_xy = number(p, "kxy_n_per_m") * (1 + slope * dt);
    double rc = number(p, "sid_r_ohm") * number(p, "sid_c_f") * (1 + number(p, "sid_rc_tc_per_k") * dt);
    p->rc_now = rc;
    p->full = weights(p->step / rc);
    double charge = number(p, "sid_charge_c") * (1 + number(p, "sid_charge_tc_per_k") * dt) / number(p, "sid_c_f");
    p->inject[1] = charge;
    p->inject[0] = charge * (1 - number(p, "sid_charge_mismatch"));
    p->temperature = degc;
}

/* C/V output in a step: of z at its begin, what forces added, and the transient at both ends. */
static inline double cv_at(const Axis *x, double part, double h, Complex z, Complex dz, double from, double to) {
    Complex c = mul(x->c_end, rotated(x->l, part * h));
    return c.re * z.im + c.im * z.re + part * (x->c_end.re * dz.im + x->c_end.im * dz.re) + from + part * (to - from);
}

typedef struct {
    Complex z, dz;
    double low, high, from, to, held;
} Output; /* of a C/V chain over a step */

/* A demodulator whose switch moves in this step: piece by piece. */
static void demodulate_edges(Plant *p, int d, const Output *o, double begin, double end) {
    State *s = &p->s;
    const Axis *x = &p->axis[d / 2];
    double from = 0;
    for (int k = 0; k <= s->events; k++) {
        int last = k == s->events;
        Event *e = last ? NULL : &s->event[k];
        if (!last && (e->demodulator != d || e->at >= end)) continue;
        double to = last ? 1 : fmax(from, (e->at - begin) / (end - begin));
        double length = to - from;
        if (length > 0) {
            Weights w = weights(length * p->step / p->rc_now);
            double low = cv_at(x, from + GAUSS_LOW * length, p->step, o->z, o->dz, o->from, o->to) + o->held;
            double high = cv_at(x, from + GAUSS_HIGH * length, p->step, o->z, o->dz, o->from, o->to) + o->held;
            charged(&w, s->caps[d][s->level[d]], low, high);
        }
        if (!last && e->level != s->level[d]) {
            for (int n = 0; n < 3; n++) s->caps[d][s->level[d]][n] += p->inject[s->level[d]];
            s->level[d] = e->level;
        }
        from = to;
    }
}

static void demodulate(Plant *p, const Output *o, double begin, double end) {
    State *s = &p->s;
    unsigned moving = 0;
    for (int k = 0; k < s->events; k++)
        if (s->event[k].at < end) moving |= 1u << s->event[k].demodulator;
    for (int d = 0; d < 4; d++) {
        const Output *c = &o[d / 2];
        if (moving >> d & 1)
            demodulate_edges(p, d, c, begin, end);
        else
            charged(&p->full, s->caps[d][s->level[d]], c->low + c->held, c->high + c->held);
    }
    if (moving) {
        int kept = 0;
        for (int k = 0; k < s->events; k++)
            if (s->event[k].at >= end) s->event[kept++] = s->event[k];
        s->events = kept;
    }
}

/* Forces (N) and volts in the middle of a step. */
static void beyond(Plant *p, const double *at, double t, double *out) {
    for (int k = 0; k < p->effects.laws; k++) out[p->effects.law[k].port] += product(&p->effects.law[k], p->gain[k], at);
    for (int k = 0; k < p->effects.mechanisms; k++)
        mechanism_step(&p->effects.mechanism[k], &p->s.memory[k], at, p->rate, t, p->step, out);
}

/* One step of a tick; `next` are the voltages of its DACs, `noise` volts at the C/V outputs. */
static void integrate(Plant *p, int j, double t, const double *next, const double *noise) {
    State *s = &p->s;
    Output o[2];
    Complex push[2];
    double mean[2], at[STATES], out[PORTS] = {s->force[0], s->force[1], 0, 0};
    for (int a = 0; a < 2; a++) {
        Axis *x = &p->axis[a];
        push[a] = chain_advance(&x->chain, s->chain[a], &s->held[a], next[a], x->step_of == j, &mean[a]);
        push[a] = scaled(push[a], x->k_vf * x->mass_inverse);
        Complex middle = add(mul(x->half, s->z[a]), scaled(push[a], 0.5));
        at[AT_X + a] = middle.im / x->wd;
        at[AT_VX + a] = middle.re - x->sigma * at[AT_X + a];
        at[AT_U + a] = mean[a];
        at[AT_CX + a] = x->c_half.re * s->z[a].im + x->c_half.im * s->z[a].re + s->cv[a][2];
    }
    /* of the velocities half of what the coupling itself changes: without it rate would damp the drive mode */
    double fx = 0, fy = 0, half = p->step / 2;
    for (int pass = 0; pass < 2; pass++) {
        double vx = at[AT_VX] + half * p->axis[DRIVE].mass_inverse * fx;
        double vy = at[AT_VY] + half * p->axis[SENSE].mass_inverse * fy;
        fx = -p->coupling * at[AT_Y] - p->damping * vy + p->gyration * vy;
        fy = -p->coupling * at[AT_X] - p->damping * vx - p->gyration * vx;
    }
    out[FORCE_X] += fx;
    out[FORCE_Y] += fy;
    if (p->effects.laws || p->effects.mechanisms) beyond(p, at, t, out);
    for (int a = 0; a < 2; a++) {
        Axis *x = &p->axis[a];
        double kick = out[a] * x->mass_inverse * p->step, *cv = s->cv[a];
        double acceleration = x->mass_inverse * (x->k_vf * mean[a] + out[a]);
        Complex z = s->z[a], dz = add(push[a], scaled(x->half, kick));
        o[a] = (Output){z, dz, 0, 0, cv[2], 0, noise[a] + out[CV_X + a]};
        s->z[a] = add(mul(x->turn, z), dz);
        decayed(&x->cv, cv);
        for (int k = 0; k < 3; k++) cv[k] += x->push[k] * acceleration;
        o[a].to = cv[2];
        double ramp = x->c_end.re * dz.im + x->c_end.im * dz.re + o[a].to - o[a].from;
        o[a].low = x->c_low.re * z.im + x->c_low.im * z.re + GAUSS_LOW * ramp + o[a].from;
        o[a].high = x->c_high.re * z.im + x->c_high.im * z.re + GAUSS_HIGH * ramp + o[a].from;
    }
    demodulate(p, o, (double)j / p->steps, (double)(j + 1) / p->steps);
}

static void demodulated(const State *s, double *volts, double sensor_v) {
    for (int d = 0; d < 4; d++) volts[d] = s->caps[d][1][2] - s->caps[d][0][2];
    volts[4] = sensor_v;
}

static void add_edge(Plant *p, double tick, int pin) {
    State *s = &p->s;
    int level = s->pin[pin] ^= 1;
    double late = p->switch_delay[pin] + (level ? 0 : p->switch_fall) + p->jitter * normal(&s->jitter);
    if (s->events < MOST_EVENTS) s->event[s->events++] = (Event){tick + late / p->tick, pin, level};
}

static int64_t drdy(const Plant *p, int64_t frame) {
    return 3250 * frame + (int64_t)ceil(26 * (63 * SAMPLE_TICKS + p->offset_ticks + p->ready_ticks));
}

static void tell(const Plant *p, int64_t clock, gyro_adc *adc) {
    int64_t n = clock >= 3250 ? clock / 3250 - 1 : 0;
    while (drdy(p, n) < clock) n++;
    for (int k = 0; k < CHANNELS; k++) adc->code[k] = p->s.adc.code[k];
    for (int k = 0; k < 2; k++) adc->drdy[k] = drdy(p, n + k) - clock;
}

GYRO_EXPORT int32_t gyro_plant_step(void *plant, const gyro_pins *pins, double rate, double degc, gyro_adc *adc,
                                    double motion[4]) {
    Plant *p = plant;
    State *s = &p->s;
    int64_t told[2] = {pins->drive_clock, pins->sense_clock};
    int moved = 0;
    for (int a = 0; a < 2; a++)
        if (told[a] >= 0 && told[a] != s->clock[a]) s->clock[a] = told[a], moved = 1;
    if (degc != p->temperature)
        at_temperature(p, degc);
    else if (moved)
        for (int a = 0; a < 2; a++) dac_instant(p, a);
    double v_q = pins->quadrature_code * p->span[2] / 65536, sensor_v = 0.1453 + 490e-6 * (degc - 25);
    p->coupling = p->k_xy - p->k_q * v_q * v_q;
    p->gyration = 2 * p->coriolis_mass * rate;
    p->rate = rate;
    law_gains(&p->effects, rate, degc - p->ref_degc, pins->tick / 125 * 125 * p->tick, p->gain);
    double volts[MOST_STEPS + 1][CHANNELS];
    demodulated(s, volts[p->steps], sensor_v);
    int64_t edge = 0;
    for (int64_t i = 0; i < pins->ticks; i++) {
        for (; edge < pins->edge_count && pins->edge[edge][0] < 26 * (i + 1); edge++)
            add_edge(p, pins->edge[edge][0] / 26.0 - i, (int)pins->edge[edge][1]);
        double code_v[2] = {pins->drive_code[i] * p->span[0] / 32768, pins->sense_code[i] * p->span[1] / 524288};
        double next[2], noise[2];
        for (int a = 0; a < 2; a++) {
            next[a] = p->axis[a].late ? s->coming[a] : code_v[a];
            s->coming[a] = code_v[a];
            noise[a] = p->cv_noise * normal(&s->cv_noise);
        }
        if ((pins->tick + i) % NOISE_TICKS == 0)
            for (int a = 0; a < 2; a++) s->force[a] = p->axis[a].force_noise * normal(&s->force_noise);
        memcpy(volts[0], volts[p->steps], sizeof volts[0]);
        for (int j = 0; j < p->steps; j++) {
            integrate(p, j, (pins->tick + i) * p->tick + (j + 0.5) * p->step, next, noise);
            demodulated(s, volts[j + 1], sensor_v);
        }
        converter_tick(&s->adc, &p->adc, volts, p->steps);
        for (int k = 0; k < s->events; k++) s->event[k].at -= 1;
    }
    tell(p, 26 * (pins->tick + pins->ticks), adc);
    if (motion)
        for (int a = 0; a < 2; a++) {
            motion[2 * a] = s->z[a].im / p->axis[a].wd;
            motion[2 * a + 1] = s->z[a].re - p->axis[a].sigma * motion[2 * a];
        }
    if (!isfinite(s->z[0].re) || !isfinite(s->z[1].re)) {
        snprintf(p->error, sizeof p->error, "second plant: motion is not finite at tick %lld", (long long)pins->tick);
        return 1;
    }
    return 0;
}

GYRO_EXPORT int32_t gyro_plant_reset(void *plant, int64_t seed, int64_t drive_code, int64_t sense_code, double degc,
                                     gyro_adc *adc) {
    Plant *p = plant;
    State *s = &p->s;
    memset(s, 0, sizeof *s);
    s->cv_noise = stream((uint64_t)seed, 11);
    s->force_noise = stream((uint64_t)seed, 12);
    s->jitter = stream((uint64_t)seed, 13);
    converter_begin(&s->adc, (uint64_t)seed, p->offset_ticks);
    double held[2] = {drive_code * p->span[0] / 32768, sense_code * p->span[1] / 524288};
    for (int a = 0; a < 2; a++) {
        s->held[a] = s->coming[a] = held[a];
        for (int k = 0; k < 3; k++) s->chain[a][k] = held[a];
    }
    at_temperature(p, degc);
    /* at rest under the held voltages: the spring carries the force, the C/V output shows it */
    for (int a = 0; a < 2; a++) {
        Axis *x = &p->axis[a];
        double w2 = x->wd * x->wd + x->sigma * x->sigma, force = x->k_vf * held[a] * x->mass_inverse;
        s->z[a] = (Complex){x->sigma * force / w2, x->wd * force / w2};
        for (int n = 0; n < 4000; n++) {
            decayed(&x->cv, s->cv[a]);
            for (int k = 0; k < 3; k++) s->cv[a][k] += x->push[k] * force;
        }
    }
    tell(p, 0, adc);
    return 0;
}

/* Delays and instants of this board: those of the configuration, and what `own` lets `board` draw. */
static void draw_instants(Plant *p, const char *own) {
    Stream draw = stream((uint64_t)gyro_number(own, "board", 0), 1);
    double sd = gyro_number(own, "delay_sd_s", 0), spread = gyro_number(own, "drdy_spread_ticks", 0);
    p->dac_delay[DRIVE] = number(p, "drive_dac_delay_s") + sd * normal(&draw);
    p->dac_delay[SENSE] = number(p, "sense_dac_delay_s") + sd * normal(&draw);
    double common = number(p, "sid_switch_s") + 0.7 * sd * normal(&draw);
    for (int d = 0; d < 4; d++) p->switch_delay[d] = common + 0.3 * sd * normal(&draw);
    /* in 2^-20 ticks, so that the sum of all sampling instants has no rounding */
    p->offset_ticks = number(p, "adc_delay_s") / p->tick + floor(spread * uniform(&draw) * 0x1p20) * 0x1p-20;
    p->ready_ticks = 1.5e-6 / p->tick + spread * uniform(&draw);
}

/* Lines `law.N = "..."` and `mechanism.N = ...` of the user's own text; a message if one is none. */
static void read_effects(Plant *p, const char *own) {
    while (*own) {
        size_t length = strcspn(own, "\n");
        char line[400] = "";
        if (length < sizeof line) memcpy(line, own, length), line[length] = 0;
        char *value = strstr(line, " = ");
        if (value) {
            value += 3;
            size_t last = strlen(value);
            if (*value == '"' && last > 1) value[last - 1] = 0, value++;
            int good = strncmp(line, "law.", 4) ? 1 : add_law(&p->effects, value);
            if (!strncmp(line, "mechanism.", 10)) good = add_mechanism(&p->effects, value);
            if (!good) {
                snprintf(p->error, sizeof p->error, "second plant: %.120s is no law and no mechanism", line);
                return;
            }
        }
        own += length + (own[length] == '\n');
    }
}

GYRO_EXPORT int32_t gyro_plant_abi(void) { return GYRO_PLANT_ABI; }

/* Calls `each` for "SECTION.NAME" of a list of names. */
static int all_keys(const char *section, const char *names, int (*each)(const char *key, void *to), void *to) {
    while (*names) {
        size_t length = strcspn(names, " ");
        char key[64];
        snprintf(key, sizeof key, "%s.%.*s", section, (int)length, names);
        if (!each(key, to)) return 0;
        names += length + (names[length] == ' ');
    }
    return 1;
}

static int append(const char *key, void *to) { return strcat(strcat(to, key), " "), 1; }

static int present(const char *key, void *to) {
    Plant *p = to;
    if (!isnan(gyro_number(p->text, key, NAN))) return 1;
    return snprintf(p->error, sizeof p->error, "second plant: the configuration has no %s", key), 0;
}

GYRO_EXPORT const char *gyro_plant_keys(void) {
    static char keys[4000];
    if (!*keys) {
        all_keys("plant", PLANT_KEYS, append, keys);
        all_keys("noise", NOISE_KEYS " seed", append, keys);
    }
    return keys;
}

GYRO_EXPORT void gyro_plant_destroy(void *plant) {
    if (plant) free((char *)((Plant *)plant)->text);
    free(plant);
}

GYRO_EXPORT void *gyro_plant_create(const char *configuration, const char *own, char *error, int64_t error_size) {
    Plant *p = calloc(1, sizeof *p);
    if (!p) return NULL;
    ziggurat_tables();
    char *text = malloc(strlen(configuration) + 1);
    if (!text) return free(p), NULL;
    p->text = strcpy(text, configuration);
    p->steps = (int)gyro_number(own, "steps", 2);
    if (p->steps < 1 || p->steps > MOST_STEPS || gyro_number(configuration, "clock.tick_clocks", 26) != 26)
        snprintf(p->error, sizeof p->error, "second plant: steps = %d, limits 1 .. %d; ticks of 26 clocks", p->steps,
                 MOST_STEPS);
    else if (all_keys("plant", PLANT_KEYS, present, p) && fmax(number(p, "drive_dac_delay_s"),
                                                                 number(p, "sense_dac_delay_s")) > 1e-6)
        snprintf(p->error, sizeof p->error, "second plant: the delay of a DAC is above 1 us");
    if (!*p->error) read_effects(p, own);
    if (*p->error) {
        snprintf(error, (size_t)error_size, "%s", p->error);
        gyro_plant_destroy(p);
        return NULL;
    }
    p->tc = 1 / (gyro_number(configuration, "clock.master_hz", 26e6) * (1 + 1e-6 * number(p, "clock_ppm")));
    p->tick = 26 * p->tc;
    p->step = p->tick / p->steps;
    p->cv_noise = switched_on(p, "noise.cv") * gyro_number(own, "cv_noise", 1) * number(p, "cv_noise_v_per_rthz") *
                  fabs(number(p, "signal_gain")) / sqrt(2 * p->tick);
    p->switch_fall = number(p, "sid_fall_s");
    p->jitter = switched_on(p, "noise.jitter") * number(p, "clock_jitter_s");
    p->span[0] = number(p, "drive_dac_span_v");
    p->span[1] = number(p, "sense_dac_span_v");
    p->span[2] = number(p, "quad_dac_span_v");
    draw_instants(p, own);
    double white = switched_on(p, "noise.adc") * gyro_number(own, "adc_noise", 1);
    double flicker = switched_on(p, "noise.flicker") * gyro_number(own, "flicker", 1) * number(p, "sid_flicker_v_per_rthz");
    for (int k = 0; k < CHANNELS; k++) {
        int sense = k == GYRO_SENSE_SIN || k == GYRO_SENSE_COS;
        p->adc.vref[k] = number(p, "adc_vref_v") / number(p, sense ? "adc_pga_sense" : "adc_pga_drive");
        p->adc.rms[k] = white * number(p, sense ? "adc_noise_sense_v" : "adc_noise_drive_v");
        p->adc.flicker[k] = k == GYRO_TEMPERATURE ? 0 : flicker;
    }
    p->adc.colour = gyro_number(own, "adc_colour", 0);
    p->adc.step = number(p, "adc_step_code");
    p->k_q = number(p, "kq_n_per_m_per_v2");
    p->coriolis_mass = number(p, "coriolis_mass_kg");
    p->ref_degc = number(p, "temp_ref_degc");
    p->temperature = NAN;
    return p;
}

GYRO_EXPORT const char *gyro_plant_error(void *plant) { return ((Plant *)plant)->error; }

GYRO_EXPORT int64_t gyro_plant_state_size(void *plant) { return (void)plant, (int64_t)sizeof(State); }

GYRO_EXPORT int32_t gyro_plant_save(void *plant, unsigned char *state) {
    memcpy(state, &((Plant *)plant)->s, sizeof(State));
    return 0;
}

GYRO_EXPORT int32_t gyro_plant_load(void *plant, const unsigned char *state) {
    memcpy(&((Plant *)plant)->s, state, sizeof(State));
    ((Plant *)plant)->temperature = NAN;
    return 0;
}
