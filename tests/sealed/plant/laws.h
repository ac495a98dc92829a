/* What the plant has beyond its base: laws, and mechanisms that are no law.

   law         "PORT = COEFFICIENT FACTOR ..."; ports and factors of docs/effects.md but walk and flip
   mechanism   "NAME COEFFICIENT PARAMETER", each with a memory or a threshold of its own:
     hysteresis   F_x = -c q      q follows x and slips at |q| = p (m)                      N/m, m
     play         n_y = c q       q lags behind x with a play of p (m)                      V/m, m
     jump         F_x = -c x      from p seconds after power-on                             N/m, s
     friction     F_x = -c vx     from p seconds after power-on                             N s/m, s
     hop          F_y = -c vx     from p seconds after power-on                             N s/m, s
     lagging      F_y = c (q - rate) vx     q follows the rate with a time constant p       N s^2/(m rad), s
     charging     n_x = c q cx    q follows w^2 with a time constant p                      1/V^2, s
     creep        F_y = c ln(1 + t/p) x     t from power-on                                 N/m, s
     threshold    F_y = c (|w| - p) sgn w   where |w| > p (V)                               N/V, V
     contact      F_x = -c vx     where |w| > p (V)                                         N s/m, V
     beat         F_y = c cos(2 pi p t) vx                                                  N s/m, Hz
     tilt         F_x = c cos(2 pi p t) x                                                   N/m, Hz
*/
#ifndef SEALED_LAWS_H
#define SEALED_LAWS_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FORCE_X, FORCE_Y, CV_X, CV_Y, PORTS };
enum { AT_X, AT_Y, AT_VX, AT_VY, AT_U, AT_W, AT_CX, AT_CY, STATES };
enum { PLAIN, ABS, SGN };
enum { NO_TIME, COS, SIN, LAG, STEP };
enum { MOST_LAWS = 24, MOST_FACTORS = 8, MOST_MECHANISMS = 4 };

static const char *PORT_NAMES[] = {"force_x", "force_y", "cv_x", "cv_y"};
static const char *STATE_NAMES[] = {"x", "y", "vx", "vy", "u", "w", "cx", "cy"};
static const char *TIME_NAMES[] = {"", "cos", "sin", "lag", "step"};
static const char *MECHANISM_NAMES[] = {"hysteresis", "play",  "jump",      "friction", "hop",  "lagging",
                                        "charging",   "creep", "threshold", "contact",  "beat", "tilt"};
enum { HYSTERESIS, PLAY, JUMP, FRICTION, HOP, LAGGING, CHARGING, CREEP, THRESHOLD, CONTACT, BEAT, TILT, KINDS };

typedef struct {
    int state, dress, power;
} Factor;

typedef struct {
    int port, factors, rate_power, temp_power, time;
    double coefficient, parameter;
    Factor factor[MOST_FACTORS];
} Law;

typedef struct {
    int kind;
    double coefficient, parameter;
} Mechanism;

typedef struct {
    int laws, mechanisms;
    Law law[MOST_LAWS];
    Mechanism mechanism[MOST_MECHANISMS];
} Effects;

static int among(const char *name, const char *const *names, int count) {
    for (int k = 0; k < count; k++)
        if (!strcmp(name, names[k])) return k;
    return -1;
}

/* One factor of a law: NAME, NAME^n, abs(NAME), sgn(NAME), cos(F), ...; 0 if it is none. */
static int add_factor(Law *law, char *text) {
    int power = 1, dress = PLAIN;
    char *hat = strchr(text, '^'), *open = strchr(text, '(');
    if (hat) {
        power = atoi(hat + 1);
        *hat = 0;
    }
    if (open) {
        char *close = strchr(open, ')');
        if (!close) return 0;
        *open = *close = 0;
        int time = among(text, TIME_NAMES, 5);
        if (time > 0) {
            law->time = time;
            law->parameter = strtod(open + 1, NULL);
            return 1;
        }
        dress = !strcmp(text, "abs") ? ABS : !strcmp(text, "sgn") ? SGN : -1;
        text = open + 1;
    }
    if (dress < 0 || power < 1) return 0;
    if (!strcmp(text, "rate")) return law->rate_power += power;
    if (!strcmp(text, "temp")) return law->temp_power += power;
    int state = among(text, STATE_NAMES, STATES);
    if (state < 0 || law->factors == MOST_FACTORS) return 0;
    law->factor[law->factors++] = (Factor){state, dress, power};
    return 1;
}

/* Adds the law of a text; 0 if it is none. */
static int add_law(Effects *e, const char *line) {
    char text[400], *save = NULL;
    if (strlen(line) >= sizeof text || e->laws == MOST_LAWS) return 0;
    strcpy(text, line);
    Law law = {0};
    char *token = strtok_r(text, " ", &save);
    law.port = token ? among(token, PORT_NAMES, PORTS) : -1;
    token = strtok_r(NULL, " ", &save);
    if (law.port < 0 || !token || strcmp(token, "=")) return 0;
    token = strtok_r(NULL, " ", &save);
    if (!token) return 0;
    law.coefficient = strtod(token, NULL);
    while ((token = strtok_r(NULL, " ", &save)))
        if (!add_factor(&law, token)) return 0;
    e->law[e->laws++] = law;
    return 1;
}

static int add_mechanism(Effects *e, const char *line) {
    char name[40];
    Mechanism m;
    if (sscanf(line, "%39s %lf %lf", name, &m.coefficient, &m.parameter) != 3) return 0;
    m.kind = among(name, MECHANISM_NAMES, KINDS);
    if (m.kind < 0 || e->mechanisms == MOST_MECHANISMS) return 0;
    e->mechanism[e->mechanisms++] = m;
    return 1;
}

/* Gains of the laws in a frame: coefficient, surroundings and time. */
static void law_gains(const Effects *e, double rate, double temp_k, double t_s, double *gain) {
    for (int k = 0; k < e->laws; k++) {
        const Law *law = &e->law[k];
        double g = law->coefficient * pow(rate, law->rate_power) * pow(temp_k, law->temp_power);
        double turns = 2 * M_PI * law->parameter * t_s;
        switch (law->time) {
        case COS: g *= cos(turns); break;
        case SIN: g *= sin(turns); break;
        case LAG: g *= 1 - exp(-t_s / law->parameter); break;
        case STEP: g *= t_s >= law->parameter; break;
        default: break;
        }
        gain[k] = g;
    }
}

static inline double sign(double v) { return (v > 0) - (v < 0); }

static inline double product(const Law *law, double gain, const double *at) {
    for (int k = 0; k < law->factors; k++) {
        Factor f = law->factor[k];
        double v = at[f.state], p;
        if (f.dress == ABS) v = fabs(v);
        if (f.dress == SGN) v = sign(v);
        p = v;
        for (int n = 1; n < f.power; n++) p *= v;
        gain *= p;
    }
    return gain;
}

/* Adds what a mechanism does over a step of h seconds that ends the interval before; `memory` is its own. */
static inline void mechanism_step(const Mechanism *m, double *memory, const double *at, double rate, double t, double h,
                                  double *out) {
    double c = m->coefficient, p = m->parameter, x = at[AT_X], vx = at[AT_VX], w = at[AT_W], q = *memory;
    switch (m->kind) {
    case HYSTERESIS:
        q += vx * h;
        q = q > p ? p : q < -p ? -p : q;
        out[FORCE_X] -= c * q;
        break;
    case PLAY:
        q = q < x - p ? x - p : q > x + p ? x + p : q;
        out[CV_Y] += c * q;
        break;
    case JUMP: out[FORCE_X] -= c * x * (t >= p); break;
    case FRICTION: out[FORCE_X] -= c * vx * (t >= p); break;
    case HOP: out[FORCE_Y] -= c * vx * (t >= p); break;
    case LAGGING:
        q += (rate - q) * h / p;
        out[FORCE_Y] += c * (q - rate) * vx;
        break;
    case CHARGING:
        q += (w * w - q) * h / p;
        out[CV_X] += c * q * at[AT_CX];
        break;
    case CREEP: out[FORCE_Y] += c * log1p(t / p) * x; break;
    case THRESHOLD:
        if (fabs(w) > p) out[FORCE_Y] += c * (fabs(w) - p) * sign(w);
        break;
    case CONTACT: out[FORCE_X] -= c * vx * (fabs(w) > p); break;
    case BEAT: out[FORCE_Y] += c * cos(2 * M_PI * p * t) * vx; break;
    case TILT: out[FORCE_X] += c * cos(2 * M_PI * p * t) * x; break;
    default: break;
    }
    *memory = q;
}

#endif
