"""Truth of a sealed record: drawn from its seed, by the strata.

    seed    SHA-256 of the kind of run, the hash of the tracing source and the number of the record
    order   strata in random order, so that any part of a run is a fair sample of it

Source    docs/sealed.md
"""

import hashlib

import numpy as np

from testbench.errors import ConfigError
from tests.sealed import strata as tables

DELAY_SHARE = 1.26  # sd of a path's delay in sd of one that the plant draws: its DAC's, and the switches'
POLES = ("plant.sense_pole_1_s", "plant.drive_pole_1_s")
SIDES = (-1, 1)


def seed_of(*parts):
    """A seed below 2^53 of texts and numbers."""
    return int.from_bytes(hashlib.sha256("\n".join(map(str, parts)).encode()).digest()[:6], "big")


def order(strata, run):
    """Kinds of all records of a run in their order."""
    kinds = [kind for kind in tables.KINDS for _ in range(strata.counts.get(kind, 0))]
    return [kinds[k] for k in np.random.default_rng(seed_of(run, "order")).permutation(len(kinds))]


def _range(strata, effect, per_unit, sine):
    """(least, most) d of an effect whose rival is at an angle: those of [effect], its scales and its limits."""
    low, high = strata.effect["d"]
    return low, min(high, strata.effect["scales"] * effect.first * per_unit), strata.effect["apart"] / max(sine, 1e-9)


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
    sides = [s for s in SIDES if effect.low <= s * value <= effect.high and effect.sign in (0, s)]
    return value * float(rng.choice(sides or [effect.sign or 1]))


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
