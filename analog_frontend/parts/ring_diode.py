"""Capacitance to voltage: ring of four diodes under a square carrier.

    V/dC  = (E - 2 Vf - 2 n VT (g - ln cosh u) - bounce) / (Ct g)      Ct = C0 + Cp, mean over a carrier period T = 1/fc
    tau   = Cref/(4 fc Ct g) (1 + 2 Cj/Cref) + T a/(8 (1 + a + 2 Cj/Cref))          a = Ct/Cref; the delay of the mean
    Vf    = -n VT ln tanh u        a diode's drop at the end of half a period; u = Is(T) T/(2 n VT Ctail), g = u coth u

    carrier E,fc --C0+dC--A--|>|--C--+--|>|--B--C0-dC-- carrier      C, D: Cref to ground, difference to the amplifier
                          '--|<|--D--'--|<|--'                       A, B: stray to ground

(E - 2 Vf)/Ct and Cref/(4 fc Ct) are the textbook; the rest is derived, nothing is fitted:
  2 n VT   a branch with more capacitance has the larger tail current, and the mean of a half period is below its end
  bounce   C and D move together by the charge of a half period: (C0 E - 2 Vf X)/(Cref + X), X = C0 + stray
  Cj       reverse capacitance of a junction: it bridges A to C and D, so it loads v but not the bounce
  g        the diodes that block, C to B and D to A, conduct a little: g - 1 is 3e-5 at 27 degC, 2 % at 70 degC
  Is(T)    Is (T/Tn)^(XTI/n) exp((T/Tn - 1) EG/(n VT)): the gain's temperature coefficient comes out
Range     small signal: two diodes in series join C and D, so the circuit clips near 2 Vf: `limit_f` says where.
          The plant stays linear where plant.ring_saturation_on is 0, the default; else ring_cycle.py
Check     a transient ngspice run of the circuit, diodes HSMS-282x: gain, step time constant and delay within 1 % from
          -20 to 70 degC, 2 % at 85 degC. `limit_f`: within 8 % of ring_cycle.py
Drift     at 25 degC with fixed capacitances +0.73e-3 /K of the gain at 5 V; junctions take a third back
Missing   carrier images of the DACs, offset of a static dC
Source    docs/plant.md
"""

import functools
import math
from typing import NamedTuple

import mpmath
import numpy as np

from analog_frontend.parts import thermal

BOLTZMANN_V_PER_K = mpmath.mpf("1.380649e-23") / mpmath.mpf("1.602176634e-19")
ZERO_DEGC_K = mpmath.mpf("273.15")
SPICE_NOMINAL_DEGC = 27  # where a SPICE diode's parameters hold
PRECISION = 100
LIMIT_LOSS = 0.01
SATURATED, POINTS, QUARTER = 30.0, 4001, 64  # of `limit_f`: largest u e^v, points of V, of a quarter wave


class Diode(NamedTuple):
    """SPICE parameters of one diode at 27 degC (the series resistance does not matter here)."""

    is_a: float
    n: float
    cj0_f: float
    vj_v: float
    m: float
    eg_ev: float
    xti: float


HSMS_282X = Diode(is_a=2.2e-8, n=1.08, cj0_f=0.7e-12, vj_v=0.65, m=0.5, eg_ev=0.69, xti=2.0)


class Ring(NamedTuple):
    """What a ring does at one temperature."""

    gain_v_per_f: float  # V per farad of dC, dC being half the difference of the two capacitances
    tau_s: float  # delay of the mean output: the plant's pole
    settle_s: float  # time constant of its step response
    vf_v: float
    bounce_v: float
    g: float  # 1 if blocking diodes did not conduct
    stray_f: float
    textbook_gain_v_per_f: float  # (E - 2 Vf) / Ct
    textbook_tau_s: float  # Cref / (4 fc Ct)


def _kelvin(temp_degc):
    return mpmath.mpf(temp_degc) + ZERO_DEGC_K


def saturation_current_a(diode, temp_degc):
    """Is at a temperature (A), the law of SPICE."""
    t, tn = _kelvin(temp_degc), _kelvin(SPICE_NOMINAL_DEGC)
    n = mpmath.mpf(diode.n)
    exponent = (t / tn - 1) * mpmath.mpf(diode.eg_ev) / (n * BOLTZMANN_V_PER_K * t)
    return mpmath.mpf(diode.is_a) * (t / tn) ** (mpmath.mpf(diode.xti) / n) * mpmath.exp(exponent)


def n_vt_v(diode, temp_degc):
    """n k T/q of a diode (V)."""
    return mpmath.mpf(diode.n) * BOLTZMANN_V_PER_K * _kelvin(temp_degc)


def built_in_v(diode, temp_degc):
    """Built-in voltage of the Schottky junction (V): barrier minus the Fermi level's distance, which goes as T."""
    t, tn = _kelvin(temp_degc), _kelvin(SPICE_NOMINAL_DEGC)
    eg = mpmath.mpf(diode.eg_ev)
    return eg - (eg - mpmath.mpf(diode.vj_v)) * t / tn - mpmath.mpf(3) / 2 * BOLTZMANN_V_PER_K * t * mpmath.log(t / tn)


def _junction(diode, vj, v):
    """Capacitance of a junction at voltage `v`, and its derivative."""
    c = mpmath.mpf(diode.cj0_f) * (1 - v / vj) ** -mpmath.mpf(diode.m)
    return c, c * mpmath.mpf(diode.m) / (vj - v)


def _solve(diode, temp_degc, c0, cref, period, stray=None, cp=None):
    """Vf and the capacitances at one temperature, from the stray capacitance or from Cp = stray + junctions."""
    is_a, vj = saturation_current_a(diode, temp_degc), built_in_v(diode, temp_degc)
    nvt = n_vt_v(diode, temp_degc)
    vf = mpmath.mpf("0.1")
    # the tail depends on Vf through two junctions only: each pass gains more than a decimal digit
    for _ in range(60):
        reverse, slope = _junction(diode, vj, -vf)
        forward, _ = _junction(diode, vj, vf)
        loading = 2 * reverse - nvt * slope
        stray_f = stray if cp is None else cp - loading
        x = c0 + stray_f
        tail = x / (1 + x / cref) + forward + reverse
        u = is_a * period / (2 * nvt * tail)
        before, vf = vf, -nvt * mpmath.log(mpmath.tanh(u))
        if vf == before:  # every further pass gives these very bits again
            break
        if not vf < vj:
            raise ValueError(f"ring_diode: a drop of {float(vf):g} V exceeds the junction potential, {float(vj):g} V")
    return vf, nvt, stray_f, x, x + loading, reverse, u


def arguments(device, channel, temp_degc):
    """Arguments of `diode_ring` for "drive" or "sense" of a Device as it is at temp_ref."""
    return (
        thermal.device_at_temperature(device, temp_degc).carrier_v,
        device.carrier_hz * (1.0 + device.carrier_ppm * 1e-6),
        device.c0_f,
        device.cp_f,
        device.cref_drive_f if channel == "drive" else device.cref_sense_f,
        Diode(*(getattr(device, f"diode_{name}") for name in Diode._fields)),
        temp_degc if device.diode_tc_on else device.temp_ref_degc,
        device.temp_ref_degc,
    )


@functools.lru_cache(maxsize=1024)  # some 250 knots a ring: one serves many gyroscopes
def diode_ring(carrier_v, carrier_hz, c0_f, cp_f, cref_f, diode, temp_degc, temp_ref_degc=25.0):
    """A ring at `temp_degc`; `cp_f` is stray plus junctions at `temp_ref_degc`, and the stray part does not change."""
    for name, value, unit in (
        ("carrier_v", carrier_v, "V"),
        ("carrier_hz", carrier_hz, "Hz"),
        ("c0_f", c0_f, "F"),
        ("cref_f", cref_f, "F"),
    ):
        if not value > 0.0:
            raise ValueError(f"ring_diode {name}: {value} {unit} is not positive")
    with mpmath.workprec(PRECISION):
        e, c0, cp, cref = (mpmath.mpf(v) for v in (carrier_v, c0_f, cp_f, cref_f))
        period = 1 / mpmath.mpf(carrier_hz)
        stray = _solve(diode, temp_ref_degc, c0, cref, period, cp=cp)[2]
        if stray < 0:
            raise ValueError(f"ring_diode cp_f: {cp_f} F is less than the two junctions, {float(cp - stray):g} F")
        vf, nvt, _, x, ct, reverse, u = _solve(diode, temp_degc, c0, cref, period, stray=stray)
        bounce = (c0 * e - 2 * vf * x) / (cref + x)
        g = u * mpmath.coth(u)
        drive = e - 2 * vf - 2 * nvt * (g - mpmath.log(mpmath.cosh(u))) - bounce
        if not drive > 0:
            raise ValueError(
                f"ring_diode carrier_v: {carrier_v} V is too low for the diodes, which need {float(e - drive):g} V"
            )
        a, bridge = ct / cref, 2 * reverse / cref
        loss = a * (g - 1)  # of v in half a period, as a is by the ring itself
        if not 1 - a + bridge - loss > 0:
            raise ValueError(
                f"ring_diode cref_f: {cref_f} F is too small to average: it discharges within half a carrier period"
            )
        textbook_tau = cref * period / (4 * ct)
        return Ring(
            gain_v_per_f=float(drive / (ct * g)),
            tau_s=float(textbook_tau * (1 + bridge) / g + period * a / (8 * (1 + a + bridge))),
            settle_s=float(-period / 2 / mpmath.log((1 - a + bridge - loss) / (1 + a + bridge + loss))),
            vf_v=float(vf),
            bounce_v=float(bounce),
            g=float(g),
            stray_f=float(stray),
            textbook_gain_v_per_f=float((e - 2 * vf) / ct),
            textbook_tau_s=float(textbook_tau),
        )


@functools.lru_cache(maxsize=4096)
def limit_f(*ring_arguments):
    """Amplitude (F) of a sine of dC at which its fundamental has lost LIMIT_LOSS of the gain; arguments: `diode_ring`.

        dC = n VT/(g gain) ln(sinh(u e^v)/sinh(u e^-v)),  v = V/(2 n VT)     the charge that C->B and D->A let through
    Junctions and V within a half period count as for small signals: 8 % of the amplitude at most (docs/plant.md).
    """
    ring = diode_ring(*ring_arguments)
    n_vt = float(n_vt_v(*ring_arguments[5:7]))
    u = math.atanh(math.exp(-ring.vf_v / n_vt))
    volts = np.linspace(0.0, 2 * n_vt * math.log(SATURATED / u), POINTS)
    v = volts / (2 * n_vt)
    dc_f = n_vt / (ring.g * ring.gain_v_per_f) * np.log(np.sinh(u * np.exp(v)) / np.sinh(u * np.exp(-v)))
    sines = np.sin((np.arange(QUARTER) + 0.5) * math.pi / (2 * QUARTER))

    def loss(amplitude_f):
        fundamental = 2 * np.mean(np.interp(amplitude_f * sines, dc_f, volts) * sines)
        return 1 - fundamental / amplitude_f / ring.gain_v_per_f

    low_f, high_f = dc_f[1], dc_f[-1]
    for _ in range(50):
        middle_f = (low_f + high_f) / 2
        low_f, high_f = (middle_f, high_f) if loss(middle_f) < LIMIT_LOSS else (low_f, middle_f)
    return float(low_f)
