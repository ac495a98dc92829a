/* Ring diode of a C/V converter for small signals: gain (V per farad of dC) and delay at a temperature.

   Equations of analog_frontend/parts/ring_diode.py, solved in doubles:
       V/dC = (E - 2 Vf - 2 n VT (g - ln cosh u) - bounce) / (Ct g),   u = Is T/(2 n VT Ctail),   g = u coth u
       tau  = Cref/(4 fc Ct g) (1 + 2 Cj/Cref) + T a/(8 (1 + a + 2 Cj/Cref)),   a = Ct/Cref
       Vf   = -n VT ln tanh u,   bounce = (C0 E - 2 Vf X)/(Cref + X),   X = C0 + stray
   Cp is stray and junctions at the reference temperature; the stray part does not change.
*/
#ifndef SEALED_RING_H
#define SEALED_RING_H

#include <math.h>

typedef struct {
    double is_a, n, cj0, vj, m, eg, xti;
} Diode;

typedef struct {
    double gain, tau;
} Ring;

#define VOLTS_PER_KELVIN (1.380649e-23 / 1.602176634e-19)

typedef struct {
    double vf, stray, x, ct, reverse, u, nvt;
} Tail;

static double junction(const Diode *d, double vj, double v) { return d->cj0 * pow(1 - v / vj, -d->m); }

/* Vf by fixed point: `cp` < 0 where `stray` is known. */
static Tail ring_tail(const Diode *d, double degc, double c0, double cref, double period, double stray, double cp) {
    double t = degc + 273.15, tn = 300.15, vt = VOLTS_PER_KELVIN * t;
    double is = d->is_a * pow(t / tn, d->xti / d->n) * exp((t / tn - 1) * d->eg / (d->n * vt));
    double vj = d->eg - (d->eg - d->vj) * t / tn - 1.5 * vt * log(t / tn);
    Tail o = {.vf = 0.1, .nvt = d->n * vt};
    for (int pass = 0; pass < 60; pass++) {
        o.reverse = junction(d, vj, -o.vf);
        double slope = o.reverse * d->m / (vj + o.vf), loading = 2 * o.reverse - o.nvt * slope;
        o.stray = cp < 0 ? stray : cp - loading;
        o.x = c0 + o.stray;
        o.ct = o.x + loading;
        double ctail = o.x / (1 + o.x / cref) + junction(d, vj, o.vf) + o.reverse;
        o.u = is * period / (2 * o.nvt * ctail);
        o.vf = -o.nvt * log(tanh(o.u));
    }
    return o;
}

static Ring ring_at(const Diode *d, double carrier_v, double carrier_hz, double c0, double cp, double cref, double degc,
                    double ref_degc) {
    double period = 1 / carrier_hz, stray = ring_tail(d, ref_degc, c0, cref, period, 0, cp).stray;
    Tail o = ring_tail(d, degc, c0, cref, period, stray, -1);
    double bounce = (c0 * carrier_v - 2 * o.vf * o.x) / (cref + o.x), g = o.u / tanh(o.u);
    double drive = carrier_v - 2 * o.vf - 2 * o.nvt * (g - log(cosh(o.u))) - bounce;
    double a = o.ct / cref, bridge = 2 * o.reverse / cref;
    Ring out = {drive / (o.ct * g), cref * period / (4 * o.ct) * (1 + bridge) / g + period * a / (8 * (1 + a + bridge))};
    return out;
}

#endif
