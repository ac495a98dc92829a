"""Time-interval counter between a reference pin and an electrode voltage, as it stands on a bench.

    lag = mean of theta at the crossings of the voltage - mean of theta at the edges of the pin
    each mean: Hann weighted over the gate, rising and falling slopes alike, the voltage at LEVELS trigger levels

Both slopes, so that an offset of the converter cancels. Several levels, because a staircase of few codes crosses one
level at few of its possible instants: 0.006 deg with 335 codes and one level, 0.001 deg with 31 that stand still, so
they move from slope to slope. Hann: edges on a grid beat slowly.
Instants are rounded to RESOLUTION_S. theta stands for time in periods; it is common to both channels and cancels.
It also stamps the edges of a pin: which clock of the board each has left with (`stamps`).
Source    docs/paper.md
"""

import functools
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from fpga_model.jit import kernel
from testbench.run.nodes import edge_errors_turns
from testbench.run.phase_meter import wrap_deg

RESOLUTION_S = 20e-12  # a good bench counter
LEVELS = 31
GOLDEN = 0.6180339887498949  # of their spacing: from slope to slope they move by it
SPAN = 0.35  # trigger levels lie within this part of the amplitude
TABLE = 1000  # instants within a tick
PINS = {"drive": 0, "sense": 2}  # sgn(sin); sgn(cos) is the next one


class Gate(NamedTuple):
    """What one gate has caught: theta of each event less the ideal one (turns), in time order."""

    voltage: np.ndarray
    pin: np.ndarray
    pin_cos: np.ndarray


@functools.cache
def _responses(poles_s, instant_s, tick_s):
    """Electrode voltage at TABLE + 1 instants of a tick: weights of the chain state, of the held input, of the step."""
    rates = 1.0 / np.asarray(poles_s)
    a = np.diag(-rates) + np.diag(rates[1:], -1)
    transition_matrix = expm(a * (tick_s / TABLE))
    free = np.empty((TABLE + 1, 3))
    state = np.eye(3)
    for k in range(TABLE + 1):
        free[k] = state[2]
        state = state @ transition_matrix
    settled = 1.0 - free.sum(axis=1)
    instants_since_step = np.arange(TABLE + 1) - instant_s / tick_s * TABLE
    step = np.interp(instants_since_step, np.arange(TABLE + 1), settled, left=0.0)
    return free, settled, step


def crossings_turns(probe, channel):
    """theta (turns) of the crossings of an electrode's voltage less the ideal one, both slopes, all levels."""
    letter, which = ("d", 0) if channel == "drive" else ("s", 1)
    z = np.stack([probe.column(f"{letter}{k}") for k in (1, 2, 3)], axis=1)
    chain_input, step = probe.column(f"u_{channel}"), probe.column(f"du_{channel}")
    tables = _responses(tuple(probe.chains_s[which]), probe.instants_s[which], probe.tick_s)
    turn = 1 << probe.design.dds_bits
    theta, word = probe.column("theta") / turn, probe.column("word") / turn
    amplitude = np.sqrt(2.0) * z[:, 2].std()
    levels = SPAN * amplitude * np.linspace(-1.0, 1.0, LEVELS)
    ticks, part, level, rising = _crossings(z, chain_input, step, levels, *tables)
    part = np.round(part * probe.tick_s / RESOLUTION_S) * RESOLUTION_S / probe.tick_s
    at = theta[ticks] + part * probe.design.tick_clocks * word[ticks]
    turned = 0.5 if which == 1 and probe.sense_sign < 0 else 0.0
    shift = np.arcsin(level / amplitude) / (2 * np.pi)
    ideal = np.where(rising, shift, 0.5 - shift) + turned
    order = np.argsort(ticks + part, kind="stable")
    return ((at - ideal + 0.5) % 1.0 - 0.5)[order]


@kernel
def _crossings(z, chain_input, step, levels, free, settled, step_response):
    """(tick, part of it, level, rising) at which the voltage passes a level: bisection in the table, then a line."""
    ticks, parts, at, rises = [0], [0.0], [0.0], [False]
    spacing, slope, rising = levels[1] - levels[0], 0, False
    for n in range(len(z) - 1):
        begin, end = z[n, 2], z[n + 1, 2]
        if (end > begin) != rising:
            rising, slope = end > begin, slope + 1
        off = ((slope * GOLDEN) % 1.0 - 0.5) * spacing
        for i in range(len(levels)):
            level = levels[i] + off
            if (begin >= level) == (end >= level):
                continue
            low, high, before, after = 0, TABLE, begin, end
            while high - low > 1:
                k = (low + high) // 2
                v = z[n, 0] * free[k, 0] + z[n, 1] * free[k, 1] + z[n, 2] * free[k, 2]
                v += settled[k] * chain_input[n] + step_response[k] * step[n]
                if (v >= level) == rising:
                    high, after = k, v
                else:
                    low, before = k, v
            line = (level - before) / (after - before) if after != before else 0.0
            ticks.append(n)
            parts.append((low + min(max(line, 0.0), 1.0)) / TABLE)
            at.append(level)
            rises.append(rising)
    return np.array(ticks[1:]), np.array(parts[1:]), np.array(at[1:]), np.array(rises[1:])


def stamps(probe, channel):
    """Clocks since the segment's first at which the edges of a channel's sgn(sin) have left, both slopes."""
    mine = probe.edges[probe.edges[:, 1] == PINS[channel], 0]
    theta, word = probe.column("theta"), probe.column("word")
    turn = 1 << probe.design.dds_bits
    begun = np.concatenate([[0], np.cumsum((np.diff(theta)) % turn)])
    since = np.cumsum(np.concatenate([(mine[:1] - theta[0]) % turn, np.diff(mine) % turn]))
    tick = np.searchsorted(begun, since, "right") - 1
    return probe.design.tick_clocks * tick + np.round((since - begun[tick]) / word[tick]).astype(np.int64)


def gate(probe, channel):
    """`Gate` of a recorded segment."""
    pin = PINS[channel]
    return Gate(
        crossings_turns(probe, channel),
        *(edge_errors_turns(probe.edges, pin + cosine, probe.design.dds_bits) for cosine in (0, 1)),
    )


def _hann_mean(errors):
    """Hann-weighted mean of errors (turns), wrapped about their own middle."""
    centre = np.angle(np.mean(np.exp(2j * np.pi * errors[::64]))) / (2 * np.pi)
    weights = np.sin(np.pi * (np.arange(len(errors)) + 0.5) / len(errors)) ** 2
    off = (errors - centre + 0.5) % 1.0 - 0.5
    return centre + float(weights @ off / weights.sum())


class Reading(NamedTuple):
    """Lag of the voltage behind sgn(sin) and, as a check, behind sgn(cos) (deg)."""

    lag_deg: float
    cos_lag_deg: float


def read(gates):
    """`Reading` of gates that follow each other without a gap."""
    voltage, pin, pin_cos = (
        _hann_mean(np.concatenate([getattr(g, name) for g in gates])) for name in ("voltage", "pin", "pin_cos")
    )
    return Reading(float(wrap_deg(360.0 * (voltage - pin))), float(wrap_deg(360.0 * (voltage - pin_cos))))
