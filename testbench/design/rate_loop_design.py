"""Rate loop: demodulator, crossover and zero for a bandwidth, by an exhaustive search over real parts.

    P, D     code per word and per rate of the sampled loop, FTR open and QSC closed, from `paper.loop.loop`
    C(z)     g (1/(2 pi f_zero) + T / (1 - 1/z)): the PI for the gain g, T one frame
    L = -C P,   word = C D / (1 - C P) rate
    g of a bandwidth f   |C D / (1 - C P)| at f is 1/sqrt(2) of |D / P| at rest; with C = g c a quadratic:
                         g^2 (2 |c D|^2 / T0^2 - |c P|^2) + 2 g Re(c P) - 1 = 0,   its least positive root
    admitted             first crossing of -3 dB is at f, peak and least |1 + L| within their limits, poles inside
    chosen               the largest least |1 + L| over the corners of the tolerances

    corners     of split, SID capacitors, and loop gain (force transducer, pickoff with its capacitors)
    capacitors  E12, for the board's resistor: corners from a fifth of the split to 1.2 times it

At the split the integrator lags by 90 deg and the SID by 3 atan(split / corner). Together they must lie between 180 and
360 deg: this bounds the corner, and with it the bandwidth.
Source  docs/design_of_loops.md
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from testbench.config import changed
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters

E12 = (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2)
CORNER_BY_SPLIT = 0.2, 1.2
ZEROS_BY_SPLIT = np.geomspace(0.15, 3.0, 14)
BANDWIDTHS_BY_SPLIT = np.geomspace(0.01, 0.8, 110)  # steps of 4 %
HALF_POWER_DB = 20 * math.log10(0.5) / 2
COARSE = 5  # bandwidths between two of the first look for the largest
NEARLY = (0.9, 0.6, 0.0)  # parts of the most robust choice that are tried, one after the other


class Limits(NamedTuple):
    """What a loop must keep: peak (dB), least |1 + L| of the nominal board and at the corners of the tolerances."""

    peak_db: float = 1.5
    modulus: float = 0.5
    modulus_at_corners: float = 0.25


class Tolerances(NamedTuple):
    """Relative tolerances of a board around its nominal values (1)."""

    f: float = 0.005
    q: float = 2.0
    transducer: float = 0.1
    capacitor: float = 0.1
    split: float = 0.1


class Choice(NamedTuple):
    """A rate loop: SID capacitor, crossover and zero of the PI, and what they come to."""

    sid_c_f: float
    crossover_hz: float
    zero_hz: float
    bandwidth_hz: float
    peak_db: float
    modulus: float
    worst_modulus: float


class Opened(NamedTuple):
    """Responses of the loop with the FTR open, at the frequencies of a grid; `dc_ratio` is D / P at 0 Hz."""

    hz: np.ndarray
    word: np.ndarray  # P, code per word
    rate: np.ndarray  # D, code per rad/s
    dc_ratio: float
    p: object  # the LoopParameters
    frame: object


def capacitors(split_hz, r_ohm):
    """E12 values (F) whose SID corner lies within CORNER_BY_SPLIT of the split."""
    low, high = (1 / (4 * math.pi * r_ohm * ratio * abs(split_hz)) for ratio in reversed(CORNER_BY_SPLIT))
    decades = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1)
    every = (float(f"{mantissa}e{d}") for d in decades for mantissa in E12)
    return [c for c in every if low <= c <= high]


def grid(p, *more_hz):
    """Frequencies (Hz): logarithmic to 3/16 of the frame rate, dense at the split, BANDWIDTHS_BY_SPLIT, `more_hz`."""
    split, width = abs(p.split_hz), p.wy_rad_s / (4 * math.pi * p.qy)
    reach = np.geomspace(max(width, 1e-3) / 5, split / 2, 70)
    rough = np.geomspace(min(0.05, split / 300), 0.1875 / p.frame_s, 130)
    return np.unique(
        np.concatenate([rough, split - reach, split + reach, [split], split * BANDWIDTHS_BY_SPLIT, more_hz])
    )


def open_loop_response(p, hz):
    """`Opened` of the parts at frequencies (Hz)."""
    frame = lp.frame(p)
    a, b, codes, codes_b, word_in, _ = lp.assemble(frame, lp.gains(p), 0.0, 1.0, broken=True)

    def responses(z):
        both = np.broadcast_to(np.stack([word_in, b[:, lp.RATE]], axis=1), (len(z), len(a), 2))
        code_response = codes[0] @ np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, both)
        return code_response[:, 0], code_response[:, 1] + codes_b[0, lp.RATE]

    word, rate = responses(np.exp(2j * math.pi * hz * p.frame_s))
    # not 0 Hz itself: the opened integrator of u stands there
    low = responses(np.exp(2j * math.pi * np.array([1e-4]) * p.frame_s))
    return Opened(hz, word, rate, float(abs(low[1][0] / low[0][0])), p, frame)


def controller(o, zero_hz):
    """C(z) for an integral gain of 1 word per code and second, with the sign that the board's firmware has."""
    z = np.exp(2j * math.pi * o.hz * o.p.frame_s)
    return math.copysign(1.0, o.p.word_ki) * (1 / (2 * math.pi * zero_hz) + o.p.frame_s / (1 - 1 / z))


def gain_of_bandwidth(o, c, at):
    """Size of the integral gain at which the response at grid point `at` is 3 dB below rest; NaN if there is none."""
    cp, cd = c[at] * o.word[at], c[at] * o.rate[at]
    square = 2 * abs(cd) ** 2 / o.dc_ratio**2 - abs(cp) ** 2
    roots = np.roots([square, 2 * cp.real, -1.0])
    positive = [r.real for r in roots if abs(r.imag) < 1e-12 * abs(r) and r.real > 0]
    return min(positive, default=math.nan)


def closed_db(o, c, gain):
    """Closed loop over rest (dB) at the grid."""
    return 20 * np.log10(np.abs(gain * c * o.rate / (1 - gain * c * o.word)) / o.dc_ratio)


def modulus(o, c, gain):
    """Least |1 + L| over the grid."""
    return float(np.min(np.abs(1 - gain * c * o.word)))


def with_gains(p, gain, zero_hz):
    """LoopParameters with a PI of this integral gain (word per code and second, without its sign) and zero (Hz)."""
    gain = math.copysign(gain, p.word_ki)
    return p._replace(word_ki=gain * p.frame_s, word_kp=gain / (2 * math.pi * zero_hz))


def is_stable(o, gain, zero_hz):
    """Whether all poles of the closed loop lie inside the unit circle."""
    k = lp.gains(with_gains(o.p, gain, zero_hz))
    return bool(np.max(np.abs(np.linalg.eigvals(lp.assemble(o.frame, k)[0]))) < 1)


class Board(NamedTuple):
    """A capacitor with the opened loop of the nominal board and of the corners: [(Opened, gain factor), ...]."""

    sid_c_f: float
    nominal: Opened
    corners: list


def with_capacitor(config, sid_c_f):
    """The configuration with another SID capacitor."""
    return changed(config, {"nominal.sid_c_f": sid_c_f})


def gain_factors(tolerances):
    """Least and largest loop gain over nominal: force transducer, and pickoff with its capacitors."""
    t, c = tolerances.transducer, tolerances.capacitor
    return (1 - t) ** 2 / (1 + c), (1 + t) ** 2 / (1 - c)


def build_board(config, sid_c_f, tolerances, *more_hz):
    """`Board` of a configuration; without tolerances it has no corners."""
    p = loop_parameters(with_capacitor(config, sid_c_f))
    o = open_loop_response(p, grid(p, *more_hz))
    corners = []
    for split_by, sid_by in itertools.product((-1, 1), (-1, 1)) if tolerances else ():
        split_hz, sid_hz = (
            p.split_hz * (1 + split_by * tolerances.split),
            p.sid_hz / (1 + sid_by * tolerances.capacitor),
        )
        q = advisor.vary_parameters(p, split_hz=split_hz, sid_hz=sid_hz)
        at = open_loop_response(q, grid(q))
        corners += [(at, factor) for factor in gain_factors(tolerances)]
    return Board(sid_c_f, o, corners)


def boards(config, tolerances, *more_hz):
    """`Board`s of all capacitors that come into question."""
    split = config.nominal.fx_hz - config.nominal.fy_hz
    return [build_board(config, c, tolerances, *more_hz) for c in capacitors(split, config.nominal.sid_r_ohm)]


class Met(NamedTuple):
    """A point of the search: which limits it keeps."""

    board: Board
    zero_hz: float
    gain: float
    bandwidth_hz: float
    peak_db: float
    modulus: float
    is_satisfied: bool


def evaluate_point(b, zero_hz, at, limits):
    """`Met` for a board, a zero and the grid point of the bandwidth; None where no gain gives that bandwidth."""
    o = b.nominal
    c = controller(o, zero_hz)
    gain = gain_of_bandwidth(o, c, at)
    if not gain > 0:
        return None
    levels = closed_db(o, c, gain)[:at]
    if len(levels) and levels.min() < HALF_POWER_DB:
        return None
    peak = max(float(levels.max(initial=0.0)), 0.0)
    least = modulus(o, c, gain)
    return Met(b, zero_hz, gain, float(o.hz[at]), peak, least, peak <= limits.peak_db and least >= limits.modulus)


def feasible_points(bands, bandwidth_hz, limits):
    """`Met` points of all boards and zeros at a bandwidth that keep the limits of the nominal board."""
    points = []
    for b in bands:
        at = int(np.argmin(np.abs(b.nominal.hz - bandwidth_hz)))
        for zero_hz in ZEROS_BY_SPLIT * abs(b.nominal.p.split_hz):
            met = evaluate_point(b, float(zero_hz), at, limits)
            if met and met.is_satisfied:
                points.append(met)
    return points


def worst_modulus(met):
    """Least |1 + L| over the corners of the tolerances, gains kept; 0 if a corner is unstable."""
    least = met.modulus
    for o, factor in met.board.corners:
        least = min(least, modulus(o, controller(o, met.zero_hz), met.gain * factor))
    return least


def best(mets, limits, nearly=NEARLY[0]):
    """(Met, least |1 + L| at the corners) of the best of some points, or None.

    Of those within `nearly` of the most robust, the one with the fastest SID: start-up and drive loops wait for it.
    """
    rated_points = [(worst_modulus(m), m) for m in mets]
    enough = max(nearly * max((worst for worst, _ in rated_points), default=0.0), limits.modulus_at_corners)
    ranked = sorted(rated_points, key=lambda pair: (pair[0] < enough, pair[1].board.sid_c_f, -pair[0]))
    for worst, m in ranked:
        if worst < limits.modulus_at_corners:
            continue
        stable = [is_stable(m.board.nominal, m.gain, m.zero_hz)]
        stable += [is_stable(o, m.gain * factor, m.zero_hz) for o, factor in m.board.corners]
        if all(stable):
            return m, worst
    return None


def choose(config, bands, bandwidth_hz, limits, nearly=NEARLY[0]):
    """`Choice` for a bandwidth that the boards have at a grid point, or None if no point keeps the limits."""
    best_point = best(feasible_points(bands, bandwidth_hz, limits), limits, nearly)
    if best_point is None:
        return None
    m, worst = best_point
    p = m.board.nominal.p
    per_hz = abs(p.word_ki) / p.frame_s / config.firmware.ftr_crossover_hz
    return Choice(m.board.sid_c_f, float(m.gain / per_hz), m.zero_hz, m.bandwidth_hz, m.peak_db, m.modulus, worst)


def most(bands, limits):
    """Largest bandwidth (Hz) of BANDWIDTHS_BY_SPLIT that keeps the limits; 0.0 if none of every COARSE does."""
    split = abs(bands[0].nominal.p.split_hz)
    falling = [float(ratio * split) for ratio in BANDWIDTHS_BY_SPLIT[::-1]]
    first = next(
        (k for k in range(0, len(falling), COARSE) if best(feasible_points(bands, falling[k], limits), limits)), None
    )
    if first is None:
        return 0.0
    finer = falling[max(first - COARSE + 1, 0) : first]
    return next((hz for hz in finer if best(feasible_points(bands, hz, limits), limits)), falling[first])
