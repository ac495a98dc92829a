"""Truth of a sealed record: drawn from its seed, by the strata.

    seed    SHA-256 of the kind of run, the hash of the tracing source and the number of the record
    order   strata in random order, so that any part of a run is a fair sample of it

Source    docs/sealed.md
"""

import hashlib

import numpy as np

from testbench.config import Config
from testbench.errors import ConfigError
from testbench.measured.wide import data_sheet
from tests.sealed import strata as tables

DELAY_SHARE = 1.26  # sd of a path's delay in sd of one that the plant draws: its DAC's, and the switches'
POLES = ("plant.sense_pole_1_s", "plant.drive_pole_1_s")
COUPLING = "plant.kxy_n_per_m"
SIDES = (-1, 1)


def seed_of(*parts):
    """A seed below 2^53 of texts and numbers."""
    return int.from_bytes(hashlib.sha256("\n".join(map(str, parts)).encode()).digest()[:6], "big")


def order(strata, run):
    """Kinds of all records of a run in their order."""
    kinds = [kind for kind in tables.KINDS for _ in range(strata.counts.get(kind, 0))]
    return [kinds[k] for k in np.random.default_rng(seed_of(run, "order")).permutation(len(kinds))]


def _sides(effect):
    """{side: largest coefficient there} that physics allows."""
    limits = {-1: -effect.low, 1: effect.high}
    return {side: limits[side] for side in SIDES if limits[side] > 0 and effect.sign in (0, side)}


def _range(strata, effect, per_unit, sine):
    """(least, most, d from which it is clear of a rival at an angle): those of [effect], its scales and its limits."""
    low, high = strata.effect["d"]
    most = min(strata.effect["scales"] * effect.first, max(_sides(effect).values()))
    return low, min(high, most * per_unit), strata.effect["apart"] / max(sine, 1e-9)


def choices(strata, space, kind):
    """[(effect, least d, most d, rival)] of a stratum: what can be drawn in it."""
    inside = [e.name for e in strata.inside]
    out = []
    for effect in strata.outside if kind == "outside" else strata.inside:
        if effect.name not in space.size:
            continue
        rival, sine = space.rival(effect.name, inside)
        low, high, clear = _range(strata, effect, space.size[effect.name], sine)
        if kind == "outside":
            high = strata.effect["d"][1]
        low, high = (low, min(high, clear)) if kind == "near" else (max(low, clear), high)
        if low < high:
            out.append((effect, low, high, rival))
    if not out:
        raise ConfigError(f"strata: nothing can be drawn for {kind}: no effect of that d under these conditions")
    return out


def _sign(effect, value, rng):
    """Coefficient with a side that physics allows."""
    return value * float(rng.choice([side for side, most in _sides(effect).items() if value <= most]))


def sheet_values(strata, seed):
    """{key: middle} of a data sheet that is off the board, evenly within one tolerance of each of its keys."""
    rng, plant, out = np.random.default_rng([seed, 2]), Config().plant, {}
    for key, (kind, tolerance) in data_sheet.read(data_sheet.BUNDLED_PATH).items():
        width = np.log(tolerance) if kind == "factor" else np.log1p(tolerance)
        # the quadrature of the sheet's own board must be within reach of V_q
        most = min(width, np.log(strata.wide["most_coupling"])) if key == COUPLING else width
        out[key] = float(getattr(plant, key.removeprefix("plant.")) * np.exp(rng.uniform(-width, most)))
    return out


def truth(strata, space, kind, seed):
    """Everything that a record hides, in plain numbers."""
    rng = np.random.default_rng(seed)
    delay_sd = strata.plant["delay_sd_s"]
    values = {}
    for key, (mean, sd, _) in strata.priors.items():
        own = np.sqrt(sd**2 - (DELAY_SHARE * delay_sd) ** 2) if key in POLES else sd
        values[key] = float(mean + own * rng.normal())
    lines = {"board": int(rng.integers(1 << 40)), "delay_sd_s": delay_sd}
    lines["drdy_spread_ticks"] = strata.plant["drdy_spread_ticks"]
    for key in ("cv_noise", "adc_noise"):
        lines[key] = float(np.exp(strata.noise["level_sd"] * rng.normal()))
    if kind == "null_coloured":
        lines["adc_colour"] = float(rng.choice([-1, 1]) * rng.uniform(*strata.noise["colour"]))
    if kind == "null_flicker":
        lines["flicker"] = float(rng.uniform(*strata.noise["flicker"]))
    out = {"kind": kind, "seed": int(seed), "values": values, "effect": None}
    if kind not in tables.NULLS:
        effect, low, high, rival = (found := choices(strata, space, kind))[rng.integers(len(found))]
        d = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        value = _sign(effect, d / space.size[effect.name], rng)
        lines["effects"] = effect.lines(value)
        values |= effect.values(value, values)
        apart = d * space.rival(effect.name, [e.name for e in strata.inside])[1]
        out["effect"] = {"name": effect.name, "value": value, "d": d, "rival": rival, "apart": float(apart)}
    return out | {"own": tables.own_text(strata, lines)}
