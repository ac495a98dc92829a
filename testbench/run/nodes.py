"""Node phases of a run: probes of the plant and of the pins, read by both phase meters.

    force voltage   26 means a tick from the recorded chain state, its held input and the step within the tick; the
                    chain between ticks is solved here by scipy, not by the plant's tables
    x, y, C/V       one sample a tick: smooth, so that no image folds back
    reference pins  theta at each edge of the channel's two pins: where edges lie that are even on their grid

xe1 = lag(force x) - lag(sgn sin drive);  xe2 = lag(C/V x) - lag(x);  sense likewise; y with its free line at f_y.
Their sigma: xe1 that of the force and of the pins, xe2 that of a difference of fits that see the same noise.
Source    docs/phases.md
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from fpga_model.design_record import DEFAULT
from testbench.engines.engine import PROBE_FLOATS, PROBE_INTS
from testbench.run import phase_meter
from testbench.run.phase_meter import wrap_deg

BLOCK_TICKS = 256  # whose clocks are looked at together
EDGE_TURNS = {(0, 1): 0.0, (0, 0): 0.5, (1, 1): 0.75, (1, 0): 0.25}  # (sin or cos, level) -> ideal theta


class Probe(NamedTuple):
    """What the engine recorded, and what is needed to read it."""

    ints: np.ndarray
    floats: np.ndarray
    edges: np.ndarray
    chains_s: tuple  # output poles of the drive and of the sense chain
    instants_s: tuple  # take-effect instant within the tick of each DAC
    tick_s: float
    fy_hz: float
    sense_sign: int = 1  # of the rate word: a negative word turns the force over, which is no phase
    design: object = DEFAULT  # the design record of the firmware
    fx_hz: float = 0.0  # free line of the drive mode, 0 when the loop holds it on theta
    grid_clocks: int = DEFAULT.tick_clocks  # between two instants at which a reference pin can change

    def column(self, name):
        if name in PROBE_INTS:
            return self.ints[:, PROBE_INTS.index(name)]
        return self.floats[:, PROBE_FLOATS.index(name)]


class PinLag(NamedTuple):
    """Lag of a channel's pins (turns) if edges are even on their grid, its sigma; what sgn(sin) lags beyond it."""

    mean_lag: float
    sigma: float
    sine_excess: float


class Forced(NamedTuple):
    """Force voltage over displacement (V/m, phasors at theta), poles of its output (s), instant of its DAC (s)."""

    volts_per_m: complex
    poles_s: tuple
    instant_s: float


class Readings(NamedTuple):
    """Node phases by both methods (deg), one-sigma of each, and the errors of each reference pin's edges (turns)."""

    phase_deg: dict
    sigma_deg: dict
    counter_deg: dict
    counter_resolution_deg: dict
    amplitude: dict
    lag_deg: dict  # of the C/V outputs against theta
    edges: dict
    uneven_deg: dict  # of xe1 and ye1: mean lag of this record's sgn(sin) edges beyond that of even ones
    frequency_hz: float  # mean of theta over the record
    forced: dict  # of xe2 and ye2: `Forced`
    off_deg: dict  # of xe2 and ye2: what the mode's own frequency over the record adds


def chain_means(poles_s, instant_s, tick_s, clocks=DEFAULT.tick_clocks):
    """What each of z1, z2, z3, held and step adds to the mean electrode voltage over each clock of a tick, (5, clocks).

    Means, not samples: a chain faster than a clock would fold its images back (19 mdeg with three poles of 5 ns).

    z  chain state at the tick's beginning;  held, step  old output and step (V);  instant_s  of the step in the tick
    """
    rates = 1.0 / np.asarray(poles_s)
    a = np.diag(-rates) + np.diag(rates[1:], -1)
    inverse = np.linalg.inv(a)

    def integral(t_s):
        """Integrals over 0 .. t of the free response (row of 3) and of the step response."""
        if t_s <= 0:
            return np.zeros(3), 0.0
        free = (inverse @ (expm(a * t_s) - np.eye(3)))[2]
        return free, t_s - free.sum()

    means = np.empty((5, clocks))  # of z, held and step
    clock_s = tick_s / clocks
    for i in range(clocks):
        begin, end = i * clock_s, (i + 1) * clock_s
        (free0, settled0), (free1, settled1) = integral(begin), integral(end)
        step_integral = integral(end - instant_s)[1] - integral(begin - instant_s)[1]
        means[:, i] = (*(free1 - free0), settled1 - settled0, step_integral)
    return means / clock_s


def clocked_blocks(probe, theta, step):
    """Yield theta (turns) and both electrode voltages at the clocks of some ticks, and at the clock after them.

    theta, step  phase at each tick, and what a clock adds to it (turns)
    """
    clocks = probe.design.tick_clocks
    offsets = np.arange(clocks) + 0.5
    chains = []
    for poles_s, instant_s, letter, name in zip(probe.chains_s, probe.instants_s, "ds", ("drive", "sense")):
        names = (*(f"{letter}{k}" for k in (1, 2, 3)), f"u_{name}", f"du_{name}")
        chains.append(([probe.column(n) for n in names], chain_means(poles_s, instant_s, probe.tick_s, clocks)))
    for begin in range(0, len(theta), BLOCK_TICKS):
        ticks = slice(begin, begin + BLOCK_TICKS + 1)
        most = BLOCK_TICKS * clocks + 1
        fine = (offsets * step[ticks, None] + theta[ticks, None]).ravel()[:most]
        yield fine, [(np.column_stack([c[ticks] for c in columns]) @ m).ravel()[:most] for columns, m in chains]


def edge_errors_turns(edges, reference, bits=DEFAULT.dds_bits):
    """theta (`bits` to a turn) of each edge of a reference (0..3) less the ideal one, in turns, in time order."""
    mine = edges[edges[:, 1] == reference]
    if not len(mine):
        return np.zeros(0)
    ideal = np.array([EDGE_TURNS[reference & 1, int(level)] for level in mine[:, 2]])
    return (mine[:, 0] / (1 << bits) - ideal + 0.5) % 1.0 - 0.5


def pin_lag_turns(errors):
    """Mean error of a reference's edges, Hann weighted.

    Edges are on a grid, and their errors repeat with a beat of some milliseconds. A plain mean over a number of beats
    that is not whole errs by up to 0.05 deg. The weighted mean errs by less than 0.001 deg from three beats on.
    """
    weights = np.sin(np.pi * (np.arange(len(errors)) + 0.5) / len(errors)) ** 2
    return float(weights @ errors / weights.sum())


def pin_lag(sine, cosine, grid_turns):
    """`PinLag` of a channel from the errors (turns) of the edges of its two pins, which go through the same registers.

    An edge leaves at the first instant of the grid at which it is due, after a delay that all edges share. So

        delay <= error < delay + grid      of every edge: max - grid < delay <= min

    and within these bounds nothing says where. Even edges lag by delay + grid/2 = (min + max)/2, with the sigma of a
    uniform distribution, (grid - (max - min))/sqrt(12). Edges that dwell on one side of the grid do not move it.
    """
    errors = np.concatenate([sine, cosine])
    if not len(errors):
        return PinLag(np.nan, np.inf, np.nan)
    errors = errors[0] + wrap_deg(360.0 * (errors - errors[0])) / 360.0
    mean_lag = (errors.min() + errors.max()) / 2
    sine_excess = wrap_deg(360.0 * (pin_lag_turns(sine) - mean_lag)) / 360.0
    return PinLag(float(mean_lag), float(max(grid_turns - np.ptp(errors), 0.0) / np.sqrt(12.0)), float(sine_excess))


def pickoff(theta, before, after, free, turns_per_tick):
    """`phase_meter.Reading` of a mode and of its C/V output; sigma and `off` (deg) of the difference of their lags.

    Both see the same noise, so what counts is the difference of their shares. A mode is fitted at theta's frequency f.
    Where its own over the record is f + df, which the lag of its samples one tick before shows, the difference of lags
    is `off` by df/f of itself. It is not corrected, which would take the lag to be a delay, and so counts in sigma.
    """
    free = None if free is None else free[1:]
    first, second, earlier = phase_meter.fit_samples(theta[1:], [before[1:], after[1:], before[:-1]], free)
    lag_deg, tick_deg = wrap_deg(second.lag_deg - first.lag_deg), (earlier.lag_deg - first.lag_deg) % 360.0
    shares_deg = second.shares_deg - first.shares_deg
    shares_deg = shares_deg - lag_deg / tick_deg * (earlier.shares_deg - first.shares_deg)
    off_deg = lag_deg * (tick_deg / (360.0 * turns_per_tick) - 1.0)
    return first, second, float(np.hypot(phase_meter.sum_sigma(shares_deg), off_deg)), off_deg


def _phasor(reading):
    return reading.amplitude * np.exp(-1j * np.radians(reading.lag_deg))


def read(probe):
    """`Readings` of a probe; nodes without a tone come out with a large sigma."""
    clocks, turn = probe.design.tick_clocks, 1 << probe.design.dds_bits
    theta = probe.column("theta") / turn
    step = probe.column("word") / turn
    turns_per_tick = float(step.mean()) * clocks
    phase, sigma, amplitude, counter, resolution, lag, uneven = {}, {}, {}, {}, {}, {}, {}
    volts, forced, off = [], {}, {}
    pins = {k: edge_errors_turns(probe.edges, k, probe.design.dds_bits) for k in range(4)}
    joint, crossed = phase_meter.Fit(clocks * len(theta), 2), ([], [])
    for fine, waves in clocked_blocks(probe, theta, step):
        size = min(BLOCK_TICKS * clocks, len(fine))
        joint.add(fine[:size], [wave[:size] for wave in waves])
        for crossings, wave in zip(crossed, waves):
            crossings.append(phase_meter.rising_crossings(fine, wave))
    chains = (("xe1", 0, 0), ("ye1", 1, 2))
    for (node, which, reference), crossings, force in zip(chains, crossed, joint.readings()):
        pin = pin_lag(pins[reference], pins[reference + 1], float(step.mean()) * probe.grid_clocks)
        turned_deg = 180.0 if which == 1 and probe.sense_sign < 0 else 0.0
        phase[node] = wrap_deg(force.lag_deg - 360.0 * pin.mean_lag - turned_deg)
        sigma[node] = float(np.hypot(force.sigma_deg, 360.0 * pin.sigma))
        uneven[node] = 360.0 * pin.sine_excess
        volts.append(_phasor(force))
        amplitude[node] = force.amplitude
        crossings = phase_meter.count(np.concatenate(crossings))
        rising = probe.edges[(probe.edges[:, 1] == reference) & (probe.edges[:, 2] == 1), 0] / turn
        edges = phase_meter.count(rising)
        counter[node] = wrap_deg(crossings.lag_deg - edges.lag_deg - turned_deg)
        resolution[node] = float(np.hypot(crossings.resolution_deg, edges.resolution_deg))
    ticks = np.arange(len(theta))
    free_x = (probe.fx_hz * probe.tick_s * ticks) % 1.0 if probe.fx_hz else None
    free_y = (probe.fy_hz * probe.tick_s * ticks) % 1.0
    for node, before, after, line in (("xe2", "x", "cv_x", free_x), ("ye2", "y", "cv_y", free_y)):
        pair = probe.column(before), probe.column(after)
        first, second, sigma[node], off[node] = pickoff(theta, *pair, line, turns_per_tick)
        phase[node] = wrap_deg(second.lag_deg - first.lag_deg)
        lag[after] = second.lag_deg
        amplitude[node] = first.amplitude
        amplitude[after] = second.amplitude
        which = len(forced)
        per_m = volts[which] / _phasor(first) if first.amplitude > 0 else 0.0
        forced[node] = Forced(per_m, tuple(probe.chains_s[which]), probe.instants_s[which])
        if line is None:
            first = phase_meter.count(phase_meter.rising_crossings(theta, probe.column(before)))
            second = phase_meter.count(phase_meter.rising_crossings(theta, probe.column(after)))
            counter[node] = wrap_deg(second.lag_deg - first.lag_deg)
            resolution[node] = float(np.hypot(first.resolution_deg, second.resolution_deg))
    hz = turns_per_tick / probe.tick_s
    return Readings(phase, sigma, counter, resolution, amplitude, lag, pins, uneven, hz, forced, off)
