"""Why the scale factor's line bends: V_q at its ceiling, or at 0, leaves quadrature, which leaks into the rate.

    The force of a rate f leaves f tan(turn) as quadrature, turn = ye1 + xe2'; V_q takes it until it is at a rail.
    From there on (f - knee) tan(turn) is left, of which tan(leak), leak = ye2' - xe2', is read as rate:

        f = rate                                                        between the knees
        f = knee + (rate - knee) / (1 - tan(turn) tan(leak))            behind one

    knees   rates at which V_q^2, a line over the rates between them, is the ceiling's square, and 0
    within  nonlinearity of the rates between the knees alone, over the same full scale

Units   rates in deg/s, phases in deg, nonlinearity in ppm of 500 deg/s
Source  docs/paper.md
"""

import math
from typing import NamedTuple

import numpy as np

from testbench.paper.calibration.bench import Bench
from testbench.paper.measure import measure_scale
from testbench.paper.measure.characterise import WARM_S, choose_engine

RAILED_PART = 2e-3  # of the ceiling: closer to a rail V_q is taken to be at it


class Explained(NamedTuple):
    """Nonlinearity (ppm) of a point: as measured, of the rates between the knees, by the rails alone; the knees."""

    measured_ppm: float
    unrailed_ppm: float
    rail_ppm: float
    ceiling_dps: float  # nan: V_q does not reach it
    zero_dps: float


def read(config):
    """{"nonlinearity_ppm", "asymmetry_ppm", "rates_dps", "scale_words", "quadrature_v_of_rate"} of the 22 rates."""
    bench = Bench(config, engine=choose_engine(config))
    bench.settle(WARM_S)
    words, codes, _ = measure_scale.sweep(bench)
    rates = measure_scale.rates_dps(bench)
    scale = measure_scale.fit(rates, words)
    return {"nonlinearity_ppm": scale.nonlinearity_ppm, "asymmetry_ppm": scale.asymmetry_ppm, "rates_dps": list(rates),
            "scale_words": words.tolist(), "quadrature_v_of_rate": bench.quadrature_v(codes).tolist()}  # fmt: skip


def unrailed_mask(v_q, ceiling_v):
    """Which V_q are at no rail."""
    margin = RAILED_PART * ceiling_v
    return (np.asarray(v_q) > margin) & (np.asarray(v_q) < ceiling_v - margin)


def knees_dps(rates, v_q, ceiling_v):
    """Rates at which V_q reaches its ceiling and 0, by the line of V_q^2 over the rates between; nan: at none."""
    rates, v_q = np.asarray(rates), np.asarray(v_q)
    inside, middle = unrailed_mask(v_q, ceiling_v), ceiling_v / 2
    slope, offset = np.polyfit(rates[inside], v_q[inside] ** 2, 1)
    ends = ((v_q > middle, ceiling_v**2), (v_q < middle, 0.0))
    return tuple(float((end - offset) / slope) if (~inside & side).any() else math.nan for side, end in ends)


def rail_words(rates, knees, turn_deg, leak_deg):
    """Rates (deg/s) as they are read, with V_q at a rail on the far side of each knee that is not nan."""
    read = np.array(rates, float)
    bent = 1 - math.tan(math.radians(turn_deg)) * math.tan(math.radians(leak_deg))
    for knee in knees:
        railed_mask = (np.asarray(rates) - knee) * knee > 0  # of nan: none
        read[railed_mask] = knee + (read[railed_mask] - knee) / bent
    return read


def explain_nonlinearity(rates, words, v_q, ceiling_v, phases_deg):
    """`Explained` of 22 mean words and V_q; `phases_deg` what is left of xe2, ye1 and ye2."""
    rates, words = np.asarray(rates), np.asarray(words)
    knees, inside = knees_dps(rates, v_q, ceiling_v), unrailed_mask(v_q, ceiling_v)
    inner = measure_scale.fit(rates[inside], words[inside])
    part = float(np.abs(rates[inside]).max() / np.abs(rates).max())
    turn, leak = phases_deg["ye1"] + phases_deg["xe2"], phases_deg["ye2"] - phases_deg["xe2"]
    return Explained(
        measure_scale.fit(rates, words).nonlinearity_ppm,
        inner.nonlinearity_ppm * part,
        measure_scale.fit(rates, rail_words(rates, knees, turn, leak)).nonlinearity_ppm,
        *knees,
    )
