"""Time-interval counter between a reference pin and an electrode voltage, as it stands on a bench.

    lag = mean of theta at the crossings of the voltage - mean of theta at the edges of the pin
    each mean: Hann weighted over the gate, rising and falling slopes alike, the voltage at LEVELS trigger levels

Both slopes, so that an offset of the converter cancels. Several levels, because a staircase of few codes crosses one
level at few of its possible instants: 0.006 deg with 335 codes and one level. Hann: edges on a grid beat slowly.
Instants are rounded to RESOLUTION_S. theta stands for time in periods; it is common to both channels and cancels.
Source    docs/paper.md
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from testbench.nodes import edge_errors_turns
from testbench.phase_meter import PHASE_TURN, wrap_deg

RESOLUTION_S = 20e-12  # a good bench counter
LEVELS = 31
SPAN = 0.35  # trigger levels lie within this part of the amplitude
TABLE = 1000  # instants within a tick
PINS = {"drive": 0, "sense": 2}  # sgn(sin); sgn(cos) is the next one


class Gate(NamedTuple):
    """What one gate has caught: theta of each event less the ideal one (turns), in time order, and when (s)."""

    voltage: np.ndarray
    pin: np.ndarray
    pin_cos: np.ndarray
    span_s: float


def _responses(poles_s, instant_s, tick_s):
    """Electrode voltage at TABLE + 1 instants of a tick: weights of the chain state, of the held input, of the step."""
    rates = 1.0 / np.asarray(poles_s)
    a = np.diag(-rates) + np.diag(rates[1:], -1)
    once = expm(a * (tick_s / TABLE))
    free = np.empty((TABLE + 1, 3))
    state = np.eye(3)
    for k in range(TABLE + 1):
        free[k] = state[2]
        state = state @ once
    settled = 1.0 - free.sum(axis=1)
    late = np.arange(TABLE + 1) - instant_s / tick_s * TABLE
    step = np.interp(late, np.arange(TABLE + 1), settled, left=0.0)
    return free, settled, step


def crossings_turns(probe, channel):
    """theta (turns) of the crossings of an electrode's voltage less the ideal one, both slopes, all levels."""
    letter, which = ("d", 0) if channel == "drive" else ("s", 1)
    z = np.stack([probe.column(f"{letter}{k}") for k in (1, 2, 3)], axis=1)
    held, step = probe.column(f"u_{channel}"), probe.column(f"du_{channel}")
    tables = _responses(probe.chains_s[which], probe.instants_s[which], probe.tick_s)
    theta, word = probe.column("theta") / PHASE_TURN, probe.column("word") / PHASE_TURN
    v = z[:, 2]
    amplitude = np.sqrt(2.0) * v.std()
    out = []
    for level in SPAN * amplitude * np.linspace(-1.0, 1.0, LEVELS):
        above = v >= level
        ticks = np.flatnonzero(above[1:] != above[:-1])
        rising = ~above[ticks]
        part = _instants(z[ticks], held[ticks], step[ticks], level, rising, tables)
        part = np.round(part * probe.tick_s / RESOLUTION_S) * RESOLUTION_S / probe.tick_s
        at = theta[ticks] + part * 26 * word[ticks]
        turned = 0.5 if which == 1 and probe.sense_sign < 0 else 0.0
        ideal = np.where(rising, 0.0, 0.5) + turned
        shift = np.arcsin(level / amplitude) / (2 * np.pi)
        ideal = ideal + np.where(rising, shift, -shift)
        out.append(np.stack([ticks + part, (at - ideal + 0.5) % 1.0 - 0.5], axis=1))
    events = np.concatenate(out)
    return events[np.argsort(events[:, 0], kind="stable"), 1]


def _instants(z, held, step, level, rising, tables):
    """Part of a tick at which the voltage passes `level`, by bisection in the table and a straight line within it."""
    free, settled, late = tables

    def voltage(k):
        return np.einsum("ij,ij->i", z, free[k]) + settled[k] * held + late[k] * step

    low, high = np.zeros(len(z), np.int64), np.full(len(z), TABLE)
    while np.any(high - low > 1):
        mid = (low + high) // 2
        crossed = (voltage(mid) >= level) == rising
        low, high = np.where(crossed, low, mid), np.where(crossed, mid, high)
    before, after = voltage(low), voltage(high)
    part = np.where(after != before, (level - before) / np.where(after != before, after - before, 1.0), 0.0)
    return (low + np.clip(part, 0.0, 1.0)) / TABLE


def gate(probe, channel):
    """`Gate` of a recorded segment."""
    pin = PINS[channel]
    return Gate(
        crossings_turns(probe, channel),
        edge_errors_turns(probe.edges, pin),
        edge_errors_turns(probe.edges, pin + 1),
        len(probe.ints) * probe.tick_s,
    )


def _hann_mean(errors, first, last):
    """Hann-weighted mean of errors (turns) between two parts of the record, wrapped about their own middle."""
    part = errors[int(first * len(errors)) : int(last * len(errors))]
    centre = np.angle(np.mean(np.exp(2j * np.pi * part))) / (2 * np.pi)
    weights = np.sin(np.pi * (np.arange(len(part)) + 0.5) / len(part)) ** 2
    off = (part - centre + 0.5) % 1.0 - 0.5
    return centre + float(weights @ off / weights.sum())


class Reading(NamedTuple):
    """Lag of the voltage behind sgn(sin) and, as a check, behind sgn(cos) (deg), and the spread of its parts."""

    lag_deg: float
    cos_lag_deg: float
    spread_deg: float


def read(gates):
    """`Reading` of gates that follow each other without a gap."""
    voltage, pin, pin_cos = (np.concatenate([getattr(g, name) for g in gates]) for name in Gate._fields[:3])

    def lag(pins, first, last):
        return wrap_deg(360.0 * (_hann_mean(voltage, first, last) - _hann_mean(pins, first, last)))

    parts = [lag(pin, k / 4, k / 4 + 0.5) for k in range(3)]
    return Reading(float(lag(pin, 0, 1)), float(lag(pin_cos, 0, 1)), float(np.std(parts, ddof=1)))
