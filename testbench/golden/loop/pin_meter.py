"""What a board shows of a design in a loop: lags, rate, amplitude and lock, from the pins and the motion alone.

    phase of a force    codes of a DAC are fitted by sine, cosine and offset over each block of 1 ms
    lag xe1 or ye1      mean of that phase at the edges of the channel's two reference pins, less the ideal one; what
                        the analog output adds is that of the budget
    rate                a block's sense force over its drive force is, at rest of y, slope times rate plus bias
    lock                the four limits of `fpga_model.lock_monitor`, on the codes that the ADC has sent

No register is read, so that a design without register ports and the model are measured by one ruler.
Source  docs/rtl.md (a design with the pins alone)
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from testbench.run import nodes
from testbench.run.run_statistics import amplitude_m

BLOCK_S = 1e-3
PARTS = 8  # of a plateau, whose scatter gives the sigma of a lag
LEAST_S = 2 * PARTS * BLOCK_S  # of a plateau
NODES = ("xe1", "ye1")
DRIVE_LOOPS = 2  # the first of the four


class PinCapture(NamedTuple):
    """What one run has shown.

    drive, sense  codes at the end of each tick
    latched       clock of a tick at which each of them changes
    edges         (n, 3): clock, reference pin, level
    codes         (frames, 4): drive sin, drive cos, sense sin, sense cos as the ADC has sent them
    truth         (frames, 4): x, vx, y, vy
    """

    drive: np.ndarray
    sense: np.ndarray
    latched: tuple
    edges: np.ndarray
    codes: np.ndarray
    truth: np.ndarray


class Plateau(NamedTuple):
    """Ticks in which the loops rest at one rate (deg/s)."""

    first: int
    last: int
    rate_dps: float


class Measured(NamedTuple):
    """Results of one run; phases (deg) and their sigma by node, None where no lock was found.

    amplitude_m  of the drive motion, frame by frame
    ratio        sense over drive force of the blocks of each plateau, complex
    """

    lock_frame: int
    frequency_hz: float = 0.0
    lag_deg: dict | None = None
    lag_sigma_deg: dict | None = None
    amplitude_m: np.ndarray | None = None
    ratio: tuple = ()


class Limits(NamedTuple):
    """Of lock, as `lock_monitor.Params` has them: errors to lock and to lose it, frames; and the set-point."""

    limit_in: tuple
    limit_out: tuple
    frames_in: tuple
    magnitude: float  # set-point, in codes


def lock_frame(codes, limits, end):
    """First frame before `end` from which all four errors have been small for their times, and large no more; or -1.

    Errors of the sense loops count from the lock of the drive on: before, there is no signal.
    """
    x = codes[:end].astype(float)
    magnitude, phase = np.hypot(x[:, 0], x[:, 1]), np.abs(np.arctan2(x[:, 0], -x[:, 1])) / (2 * np.pi) * 2**24
    errors = (
        np.abs(magnitude / limits.magnitude - 1) * 2**16,
        phase,
        np.abs(x[:, 2]),
        np.abs(x[:, 3]),
    )
    latest_lock_frame, start = 0, 0
    every = zip(errors, limits.limit_in, limits.limit_out, limits.frames_in, strict=True)
    for loop, (error, small, large, frames) in enumerate(every):
        start = latest_lock_frame if loop == DRIVE_LOOPS else start
        lost = np.flatnonzero(error > large)
        bad = np.flatnonzero(error > small)
        # the last run of small errors that is long enough, behind the last loss
        begins = [max(b, start) for b in (0, *(bad + 1).tolist())]
        ends = [*bad.tolist(), len(error)]
        after = lost[-1] if len(lost) else -1
        runs = [b for b, e in zip(begins, ends, strict=True) if e - b >= frames and b > after]
        if not runs:
            return -1
        latest_lock_frame = max(latest_lock_frame, runs[0] + frames)
    return int(latest_lock_frame)


def find_plateaus(rates_dps, design, runs, limits):
    """(plateaus of a scenario, `lock_frame` of each of the runs).

    A plateau is the second half of a stretch of one rate behind the later lock, of LEAST_S or more.

    rates_dps  (frames,) of what is judged, the first rate up to lock
    design     design record of the firmware
    """
    borders = [0, *(np.flatnonzero(np.diff(rates_dps)) + 1).tolist(), len(rates_dps)]
    locks = [lock_frame(run.codes, limits, borders[1]) for run in runs]
    plateaus = []
    for begin, end in pairwise(borders):
        begin_at = max(begin, *locks)
        first, last = (begin_at + end) // 2 * design.frame_ticks, end * design.frame_ticks
        if min(locks) >= 0 and last - first >= LEAST_S * design.tick_hz:
            plateaus.append(Plateau(first, last, float(rates_dps[begin])))
    return plateaus, *locks


def _fit_force_blocks(codes, plateau, latched, turns_per_clock, clocks, ticks):
    """(complex amplitude at phase 0 of time 0, middle clock) of each block of a plateau."""
    count = (plateau.last - plateau.first) // ticks
    at = (plateau.first + np.arange(count * ticks)).reshape(count, ticks) * clocks + latched + clocks / 2
    y = codes[plateau.first : plateau.first + count * ticks].reshape(count, ticks).astype(float)
    angle = 2 * np.pi * ((at * turns_per_clock) % 1.0)
    basis = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)
    gram = basis @ basis.transpose(0, 2, 1)
    a = np.linalg.solve(gram, basis @ y[:, :, None])[:, :, 0]
    return a[:, 0] + 1j * a[:, 1], at.mean(axis=1)


def _edge_errors(force, middles, edges, first_pin, turns_per_clock):
    """Phase of a force (turns) at the edges of two pins in a plateau, less the ideal one: an array for each pin."""
    inside = (edges[:, 0] >= middles[0]) & (edges[:, 0] < middles[-1])
    turned = np.interp(edges[:, 0], middles, np.unwrap(np.angle(force))) / (2 * np.pi)
    pins = []
    for pin in (first_pin, first_pin + 1):
        mine = inside & (edges[:, 1] == pin)
        ideal = np.array([nodes.EDGE_TURNS[pin & 1, int(level)] for level in edges[mine, 2]])
        pins.append(edges[mine, 0] * turns_per_clock + turned[mine] - ideal)
    return pins


def _lag(plateaus, grid_turns):
    """(lag, sigma) of a force (deg) from `_edge_errors` of some plateaus; a grid of so many turns."""
    pins = [np.concatenate(errors) for errors in zip(*plateaus, strict=True)]
    if not all(map(len, pins)):
        return 0.0, np.inf
    # the sign of a rate turns its force over: modulo half a turn
    pins = [pins[0][0] + (errors - pins[0][0] + 0.25) % 0.5 - 0.25 for errors in pins]
    common_lag_turns = nodes.pin_lag(*pins, grid_turns).mean_lag
    # edges leave room within their grid, or the noise of the force widens it: either leaves the middle in doubt
    doubt = abs(grid_turns - np.ptp(np.concatenate(pins))) / np.sqrt(12.0)
    return float((-360.0 * common_lag_turns + 90.0) % 180.0 - 90.0), float(360.0 * doubt)


def _frequency(edges, plateau, clocks):
    """Turns per clock, from the rising edges of the drive's sgn(sin) in a plateau."""
    is_rising_edge = (edges[:, 1] == 0) & (edges[:, 2] == 1)
    is_rising_edge &= (edges[:, 0] >= plateau.first * clocks) & (edges[:, 0] < plateau.last * clocks)
    at = edges[is_rising_edge, 0]
    if len(at) < 2:
        return 0.0
    return (len(at) - 1) / float(at[-1] - at[0])


def measure(capture, design, stretches, locked, grid_clocks):
    """`Measured` of a run on the plateaus `stretches`, with its `lock_frame`; `design`: record of the firmware.

    grid_clocks  between two instants at which a reference pin can change
    """
    clocks, ticks = design.tick_clocks, round(BLOCK_S * design.tick_hz)
    turns = [_frequency(capture.edges, plateau, clocks) for plateau in stretches]
    if locked < 0 or not stretches or not all(turns):
        return Measured(-1)
    errors, ratios, amplitudes = {name: [] for name in NODES}, [], []
    most = max(abs(plateau.rate_dps) for plateau in stretches)
    for plateau, turn in zip(stretches, turns, strict=True):
        drive, at = _fit_force_blocks(capture.drive, plateau, capture.latched[0], turn, clocks, ticks)
        sense, sense_at = _fit_force_blocks(capture.sense, plateau, capture.latched[1], turn, clocks, ticks)
        errors["xe1"].append(_edge_errors(drive, at, capture.edges, 0, turn))
        # a force is read where it is largest
        if abs(plateau.rate_dps) == most:
            errors["ye1"].append(_edge_errors(sense, sense_at, capture.edges, 2, turn))
        ratios.append(sense / drive)
        frames = slice(plateau.first // design.frame_ticks, plateau.last // design.frame_ticks)
        x, vx = capture.truth[frames, 0], capture.truth[frames, 1]
        amplitudes.append(amplitude_m(x, vx, turn * design.master_hz, 1.0))
    lags = {name: _lag(phase_errors, grid_clocks * float(np.mean(turns))) for name, phase_errors in errors.items()}
    return Measured(
        lock_frame=locked,
        frequency_hz=float(np.mean(turns)) * design.master_hz,
        lag_deg={name: lag for name, (lag, _) in lags.items()},
        lag_sigma_deg={name: sigma for name, (_, sigma) in lags.items()},
        amplitude_m=np.concatenate(amplitudes),
        ratio=tuple(ratios),
    )
