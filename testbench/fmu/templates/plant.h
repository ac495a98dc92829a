/* The plant of one configuration and seed: DACs, electrodes, two modes, C/V converters, demodulators, converter, noise.

   The equations and their order are those of analog_frontend of FTR gyro: every double comes out bit for bit, if products
   are not fused into sums. */
#ifndef PLANT_H
#define PLANT_H

#include <stddef.h>
#include <stdint.h>

enum { ROWS = 24, JETS = 6, CHANNELS = 5, POLES = 16, EDGES = 8, MOST_CLOCKS = 64, STATES = 16 };

typedef struct {
    int64_t key0, key1, on, half;
    double sigma;
} source;

/* At one temperature */
typedef struct {
    double jet[JETS][ROWS][ROWS], column[4][JETS][MOST_CLOCKS][ROWS], pickoff[2][4][6];
    double driver_s, kxy_n_per_m, kq_n_per_m_per_v2;
} knot;

typedef struct {
    int64_t clocks, frame_ticks, knots;
    double temp_lo_degc, temp_step_k, temp_from_degc, temp_to_degc;
    int64_t dac_carry[2][MOST_CLOCKS], switch_carry[2][MOST_CLOCKS];
    double switch_tau_s[2][MOST_CLOCKS], quad_lsb_v, lsb_v[2], offset_v[2], slope_gain;
    int64_t period, delay, decimation, step_code, code_hi;
    double normal, full_steps, adc_offset_v[CHANNELS], steps_per_v[CHANNELS], sensor_v, sensor_v_per_k;
    double h_s, r, e1, e2, e3, s1, s2, s3, inject[6], taylor[3][4][4];
    source force_x, force_y, cv_x, cv_y, drive_dac, sense_dac, jitter, white[CHANNELS], flicker[CHANNELS];
    /* steady acceleration: electrodes off their middle, analog_frontend/effects/acceleration.py */
    double two_mismatch, g_m_per_s2, shift_scale, k_vf_n_per_v, softening_n_per_m, push_scale, lead;
    double decay[POLES], gain[POLES], ih4_scale, ih12_scale;
    double z[STATES], volts[2], sums[CHANNELS][3 + POLES]; /* at power-on */
    int64_t quadrature_code;                               /* the same */
    knot *at;
} plant_constants;

typedef struct {
    double z[STATES], volts[2], coming_v[2], late_area[2], caps[4][6], late_tau_s[4][EDGES], sums[CHANNELS][3 + POLES];
    int64_t cycles[2], at_switch[4], late_count[4], due, sample, pending, conversions, codes[CHANNELS], quadrature_code;
    /* the matrix, and what it was made for */
    double rate_rad_s, temp_degc, stiffness, driver_s;
    double push_per_v, push_per_m, cv_gain; /* of the acceleration: on y'/W by electrode and by y; at the C/V output */
    int64_t made_cycles[2];
    double g[ROWS][ROWS], jet[JETS][ROWS][ROWS], column[4][JETS][ROWS], pickoff[2][4][6];
} plant_state;

/* What the pins did in a tick: codes at its end, clocks at which they changed (-1: not), edges of the references */
typedef struct {
    int64_t code[2], clock[2], edge_count, edge_clock[EDGES], edge_pin[EDGES];
} plant_pins;

plant_constants *plant_read(const char *path, char *error, size_t size); /* NULL and a text */
void plant_free(plant_constants *p);
void plant_reset(const plant_constants *p, plant_state *s);
/* A frame begins: its rate, temperature and V_q, and the acceleration along the sense gap */
void plant_retune(const plant_constants *p, plant_state *s, double rate_rad_s, double temp_degc);
void plant_accelerate(const plant_constants *p, plant_state *s, double acceleration_g);
/* One tick; returns the clock of the next one at which DRDY falls, or -1. The codes are in s->codes */
int64_t plant_step(const plant_constants *p, plant_state *s, int64_t tick, const plant_pins *pins);

#endif
