"""The strata of a sealed run: tests/sealed/strata.toml, checked, and plans of the record module from it.

Source    docs/sealed.md
"""

import functools
import hashlib
import tomllib
from pathlib import Path
from typing import NamedTuple

from testbench.config import changed
from testbench.errors import ConfigError
from testbench.measured.record import recording_plan as plans
from tests.sealed import effects, second_plant

FILE = Path(__file__).with_name("strata.toml")
NULLS = ("null_white", "null_coloured", "null_flicker")
INSIDE = ("clear", "near")
KINDS = (*NULLS, *INSIDE, "outside")


class Strata(NamedTuple):
    """Tables of the file, its hash, and the effects of both sides."""

    counts: dict
    effect: dict
    wide: dict
    noise: dict
    plant: dict
    plan: dict
    every: dict
    priors: dict
    inside: tuple
    outside: tuple
    sha256: str


@functools.cache
def read(path=FILE):
    """`Strata` of a file; ConfigError for a kind that there is not."""
    data = path.read_bytes()
    tables = tomllib.loads(data.decode())
    if unknown := set(tables["counts"]) - set(KINDS):
        raise ConfigError(f"{path}: counts.{min(unknown)} is no stratum; there are {', '.join(KINDS)}")
    outside = effects.outside(tables.pop("outside"))
    return Strata(**tables, inside=effects.inside(), outside=outside, sha256=hashlib.sha256(data).hexdigest())


def own_text(strata, lines):
    """Text for the second plant alone: {key: value} and lines of effects."""
    told = {"steps": strata.plant["steps"]} | {k: v for k, v in lines.items() if k != "effects"}
    return "".join(f"{key} = {value!r}\n" for key, value in told.items()) + lines.get("effects", "")


def plan(strata, name, seed, values, own, repeats=None, roles=("fit", "validate"), scatter_hz=None, model=None):
    """`record.plan.Plan` of a record of the second plant.

    values  {key: value} of the board's configuration;   own  file of the second plant's own text
    model   configuration of a board without deviations; None is the default one
    """
    conditions = [strata.every | c for c in strata.plan["condition"] if c.get("role", "fit") in roles]
    priors = [{"param": p, "mean": m, "sd": sd, "unit": unit} for p, (m, sd, unit) in strata.priors.items()]
    tree = {
        "name": name,
        "repeats": repeats or strata.plan["repeats"],
        "seed": seed,
        "fx_scatter_hz": strata.plan["fx_scatter_hz"] if scatter_hz is None else scatter_hz,
        "truth": values,
        "condition": conditions,
        "prior": priors,
    }
    checked = plans.from_dict(tree, name)
    if model is not None:
        checked = checked._replace(model=model, truth=changed(model, values))
    return plans.with_plant(checked, second_plant.compiled(), own)
