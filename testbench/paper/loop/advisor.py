"""Loop advisor: what a configuration's loops do, how far they are from doing worse, and what to mind.

    margins     L broken at the force word, quadrature loop closed: gain by the poles themselves, phase at every |L| = 1
    closed loop bandwidth (-3 dB of the scale factor), peak within it, what is left at the split, and how long it rings
    maps        stability over SID corner, split, crossover and zero, everything else as configured
    warnings    each with the number, the limit and why it matters

Source    docs/loop.md
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from testbench.paper.loop import limit_cycles
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import LoopParameters

GAIN_LIMIT_DB = 60.0


class Crossing(NamedTuple):
    """Where |L| = 1: frequency, and by how much more lag or lead L would come to -1."""

    hz: float
    lag_deg: float
    lead_deg: float

    @property
    def delay_us(self):
        return self.lag_deg / 360 / self.hz * 1e6


class Advice(NamedTuple):
    """Numbers of the loops; None where there is none, all but `stable` and `growth_tau_s` if they are unstable."""

    stable: bool
    growth_tau_s: float | None  # of the fastest growing pole
    growth_hz: float | None
    gain_margin_up_db: float | None  # factor on both FTR gains before a pole leaves the circle
    gain_margin_down_db: float | None
    qsc_margin_up_db: float | None
    crossings: tuple
    modulus_margin: float | None  # least |1 + L|
    delay_margin_us: float | None
    bandwidth_hz: float | None
    peak_db: float | None
    peak_hz: float | None
    split_db: float | None  # closed loop at the ring's frequency, against 0 Hz
    ring_hz: float | None
    ring_tau_s: float | None
    lsb_per_dps: float | None
    bias_dps: float | None
    v_q: float | None
    warnings: tuple


def _fine_grid(a, frame_s):
    """Frequencies (Hz): logarithmic up to 3/8 of the frame rate, and dense around every lightly damped pole."""
    most_hz = 0.375 / frame_s
    grid = [np.geomspace(0.05, most_hz, 900)]
    for z in np.linalg.eigvals(a):
        if abs(z) > 0.5 and z.imag > 1e-9:
            s = np.log(z) / frame_s
            hz, width = s.imag / (2 * math.pi), max(abs(s.real) / (2 * math.pi), 1e-3)
            if hz < most_hz:
                reach = np.geomspace(width / 10, hz / 2, 200)
                grid += [hz - reach, hz + reach, [hz]]
    return np.unique(np.concatenate(grid))


def _margin(make, up):
    """Factor (dB) on a gain at which the radius reaches 1, upwards or downwards; None within +-60 dB."""
    sign = 1.0 if up else -1.0

    def excess(db):
        return lp.radius(make(10 ** (sign * db / 20))) - 1.0

    low = 0.0
    for high in np.arange(1.0, GAIN_LIMIT_DB + 1, 1.0):
        if excess(high) > 0:
            return float(brentq(excess, low, high, xtol=1e-3))
        low = high
    return None


def _crossings(a, word_in, word, frame_s):
    def ratio(hz):
        z = np.exp(2j * math.pi * np.atleast_1d(hz) * frame_s)
        return -lp.resolvent(a, z, word_in) @ word

    grid = _fine_grid(a, frame_s)
    values = ratio(grid)
    size = np.log(np.abs(values))
    crossings = []
    for k in np.flatnonzero(size[:-1] * size[1:] < 0):
        hz = brentq(lambda f: math.log(abs(ratio(f)[0])), grid[k], grid[k + 1], xtol=1e-9)
        lag = math.degrees(np.angle(-ratio(hz)[0])) % 360
        crossings.append(Crossing(float(hz), float(lag), float(360 - lag)))
    return tuple(crossings), float(np.min(np.abs(1 + values)))


def bandwidth(loop):
    """(bandwidth Hz, peak dB, peak Hz): first frequency 3.01 dB below rest, and the largest value up to there."""
    dc = abs(dc_gain(loop))

    def level_db(hz):
        return 20 * np.log10(np.abs(lp.response(loop, hz)) / dc)

    grid = np.geomspace(0.2, 0.25 / loop.frame_s, 400)
    levels = level_db(grid)
    past_edge_indices = np.flatnonzero(levels < -3.0103)
    if not len(past_edge_indices) or past_edge_indices[0] == 0:
        return None, None, None
    k = int(past_edge_indices[0])
    edge = float(brentq(lambda f: level_db(f)[0] + 3.0103, grid[k - 1], grid[k], xtol=1e-6))
    fine = np.linspace(grid[max(int(np.argmax(levels[:k])) - 1, 0)], grid[min(int(np.argmax(levels[:k])) + 1, k)], 60)
    top = level_db(fine)
    return edge, float(np.max(top)), float(fine[np.argmax(top)])


def dc_gain(loop):
    """Word LSB per rad/s at rest."""
    return float(loop.row @ lp.steady_state(loop, (1.0, 0.0, 0.0, 0.0)))


def ringing_pole(loop, split_hz):
    """The pole pair of the sense mode at the split, as the closed loop has it."""
    split_poles = [p for p in lp.poles(loop) if 0.5 * abs(split_hz) < p.hz < 1.5 * abs(split_hz) + 5]
    return max(split_poles, key=lambda p: abs(p.z)) if split_poles else None


def analyse(p: LoopParameters):
    """`Advice` for the parts, without warnings."""
    fr, k = lp.frame(p), lp.gains(p)
    row = np.zeros(len(fr.f) + lp.TAIL)
    row[lp.WORD_BEFORE] = 1.0

    def make_scaled_loop(ftr=1.0, qsc=1.0):
        return lp.Loop(*lp.assemble(fr, k, ftr, qsc)[:2], row, None, None, p.frame_s)

    loop = make_scaled_loop()
    worst = lp.poles(loop)[0]
    if abs(worst.z) >= 1:
        return Advice(False, -worst.tau_s, worst.hz, *(None,) * 3, (), *(None,) * 11, ())
    a, _, _, _, word_in, word = lp.assemble(fr, k, broken=True)
    crossings, modulus = _crossings(a, word_in, word, p.frame_s)
    edge, peak_db, peak_hz = bandwidth(loop)
    shaken = ringing_pole(loop, p.split_hz)
    lsb = dc_gain(loop) * lp.DEG
    still = lp.steady_state(loop, (p.dxy_n_s_per_m / (2 * p.coriolis_mass_kg), p.kxy_n_per_m, *p.sid_offset_v))
    at_ring = abs(lp.response(loop, shaken.hz)[0]) * lp.DEG / abs(lsb) if shaken else None
    return Advice(
        stable=True,
        growth_tau_s=None,
        growth_hz=None,
        gain_margin_up_db=_margin(lambda g: make_scaled_loop(ftr=g), True),
        gain_margin_down_db=_margin(lambda g: make_scaled_loop(ftr=g), False),
        qsc_margin_up_db=_margin(lambda g: make_scaled_loop(qsc=g), True),
        crossings=crossings,
        modulus_margin=modulus,
        delay_margin_us=min((c.delay_us for c in crossings), default=None),
        bandwidth_hz=edge,
        peak_db=peak_db,
        peak_hz=peak_hz,
        split_db=20 * math.log10(at_ring) if at_ring else None,
        ring_hz=float(shaken.hz) if shaken else None,
        ring_tau_s=float(shaken.tau_s) if shaken else None,
        lsb_per_dps=lsb,
        bias_dps=float(still[lp.WORD_BEFORE]) / lsb,
        v_q=volts(p, still[lp.U]),
        warnings=(),
    )


def volts(p: LoopParameters, u):
    """V_q (V) of u; NaN below 0, where the loop would rail."""
    return math.sqrt(u / 2.0**32) * p.quad_span_v if u >= 0 else math.nan


WARN = {
    "gain_margin_db": 6.0,
    "phase_margin_deg": 35.0,
    "peak_db": 3.0,
    "ring_tau_s": 0.5,
    "split_db": 3.0,
    "leak_deg": 5.0,
    "dither_steps": 0.5,
}


BAND_HZ = 24.0, 30.0  # of the paper's board


def warnings(p: LoopParameters, a: Advice, band_hz=BAND_HZ):
    """What to mind, one line each: number, limit, reason."""
    out = []
    if not a.stable:
        kind = f"oscillates at {a.growth_hz:.1f} Hz" if a.growth_hz > 0.5 else "diverges"
        out.append(f"unstable: {kind}, growing by a factor of e every {1e3 * a.growth_tau_s:.3g} ms")
        if p.split_hz * p.word_ki * p.cv_v_per_m * p.k_vf_n_per_v < 0:
            out.append(
                f"split {p.split_hz:.1f} Hz has the opposite sign of the nominal board's split, for which the loops "
                "are designed"
            )
        return tuple(out)
    lag = p.sid_stages * math.degrees(math.atan(abs(p.split_hz) / p.sid_hz))
    if a.gain_margin_up_db is not None and a.gain_margin_up_db < WARN["gain_margin_db"]:
        out.append(f"gain margin {a.gain_margin_up_db:.1f} dB is below {WARN['gain_margin_db']:g} dB")
    closest = min(a.crossings, key=lambda c: min(c.lag_deg, c.lead_deg), default=None)
    if closest and min(closest.lag_deg, closest.lead_deg) < WARN["phase_margin_deg"]:
        side = "lag" if closest.lag_deg < closest.lead_deg else "lead"
        out.append(
            f"phase margin {min(closest.lag_deg, closest.lead_deg):.0f} deg of {side} at {closest.hz:.1f} Hz is below "
            f"{WARN['phase_margin_deg']:g} deg; the SID lags {lag:.0f} deg at the split, and 180 deg is best"
        )
    if a.peak_db is not None and a.peak_db > WARN["peak_db"]:
        out.append(f"closed-loop peak {a.peak_db:.1f} dB at {a.peak_hz:.1f} Hz is above {WARN['peak_db']:g} dB")
    low_hz, high_hz = band_hz
    if a.bandwidth_hz is not None and not low_hz <= a.bandwidth_hz <= high_hz:
        out.append(f"bandwidth {a.bandwidth_hz:.1f} Hz is outside {low_hz:g} .. {high_hz:g} Hz")
    if a.ring_tau_s is not None and a.ring_tau_s > WARN["ring_tau_s"]:
        out.append(f"ringing at the split has a time constant of {a.ring_tau_s:.2f} s, above {WARN['ring_tau_s']:g} s")
    if a.split_db is not None and a.split_db > WARN["split_db"]:
        out.append(
            f"closed-loop gain {a.split_db:+.1f} dB at {a.ring_hz:.1f} Hz is above {WARN['split_db']:g} dB: vibration "
            "at this frequency disturbs the rate"
        )
    turn_deg = math.remainder(math.degrees(p.ye1_rad - p.sense_turn_rad + p.xe2_rad), 360.0)
    if abs(turn_deg) > WARN["leak_deg"]:
        off, leak = 100 / math.cos(lp.DEG * turn_deg) - 100, 100 * math.tan(lp.DEG * turn_deg)
        out.append(
            f"ye1 + xe2' = {turn_deg:.2f} deg is above {WARN['leak_deg']:g} deg: the scale factor changes by "
            f"{off:+.2f} %, and V_q must cancel {leak:.1f} % of the rate"
        )
    r = limit_cycles.resolution(p)
    if r.dither < WARN["dither_steps"]:
        out.append(
            f"noise at the converter is {r.dither:.2f} of its step, below {WARN['dither_steps']:g}: changes of "
            f"the rate within +-{3600 * r.adc_dead_band_dps:.1f} deg/h do not change the output"
        )
    return tuple(out)


def advise(p: LoopParameters, band_hz=BAND_HZ):
    """`Advice` with its warnings; `band_hz` is where the bandwidth should be."""
    a = analyse(p)
    return a._replace(warnings=warnings(p, a, band_hz))


# ---- maps ------------------------------------------------------------------------------------------------------------

AXES = {
    "sid_hz": ("SID corner", "Hz"),
    "split_hz": ("split", "Hz"),
    "crossover": ("FTR gain", "times"),
    "zero": ("FTR zero", "times"),
}


def vary_parameters(p: LoopParameters, **values):
    """LoopParameters with other `sid_hz`, `split_hz` (f_x stays), `crossover` or `zero` (factors on the configured)."""
    for name, value in values.items():
        if name == "sid_hz":
            p = p._replace(sid_hz=value)
        elif name == "split_hz":
            p = p._replace(wy_rad_s=p.w_rad_s - 2 * math.pi * value)
        elif name == "crossover":
            p = p._replace(word_kp=p.word_kp * value, word_ki=p.word_ki * value)
        elif name == "zero":
            p = p._replace(word_kp=p.word_kp / value)
        else:
            raise ValueError(f"map: {name} is none of {', '.join(AXES)}")
    return p


def set_sense_phases(p, ye1_deg, ye2_deg):
    """LoopParameters whose sense path has these phases (ye1 node, ye2' loop), lags in deg."""
    cv_lag_rad = sum(math.atan(p.w_rad_s * tau) for tau in p.cv_s)
    return p._replace(ye1_rad=math.radians(ye1_deg), switch_rad=cv_lag_rad - math.radians(ye2_deg))


def retune_split(p: LoopParameters, split_hz):
    """LoopParameters at another split with the FTR gains scaled as a designer would: the mode's goes with 1/split."""
    factor = split_hz / p.split_hz
    return vary_parameters(p, split_hz=split_hz, crossover=factor)


class Map(NamedTuple):
    """Closed-loop maximum (dB over rest, up to 400 Hz) on a grid; infinite where unstable."""

    x: str
    y: str
    x_values: np.ndarray
    y_values: np.ndarray
    peak_db: np.ndarray  # (y, x)


MAP_HZ = np.geomspace(2.0, 400.0, 48)


def stability_map(p: LoopParameters, x, x_values, y, y_values, progress=None, keep_gain=True):
    """`Map` of two of `AXES`.

    keep_gain  the FTR gains follow the split, so that the crossover stays what is configured
    """
    peak = np.empty((len(y_values), len(x_values)))
    for j, yv in enumerate(y_values):
        for i, xv in enumerate(x_values):
            changes = {x: float(xv), y: float(yv)}
            q = p
            if keep_gain and "split_hz" in changes:
                q = retune_split(q, changes.pop("split_hz"))
            loop = lp.close(vary_parameters(q, **changes))
            if lp.radius(loop) >= 1:
                peak[j, i] = math.inf
                continue
            split_pole = ringing_pole(loop, q.split_hz)
            f = np.append(MAP_HZ, split_pole.hz) if split_pole else MAP_HZ
            peak[j, i] = 20 * math.log10(np.max(np.abs(lp.response(loop, f))) / abs(dc_gain(loop)))
        if progress:
            progress("stability map", j + 1, len(y_values))
    return Map(x, y, np.asarray(x_values), np.asarray(y_values), peak)
