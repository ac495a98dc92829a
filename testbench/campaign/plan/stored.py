"""A plan as the store keeps it: JSON with the addresses of its points and its own SHA-256, read back by a schema.

    plans/NAME.json = canonical JSON of {name, engine, set, axes, keep, points, sha256}
    sha256          = of the canonical JSON without it; a plan of an earlier version has none

Source  docs/campaigns.md
"""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from testbench import config as configuration
from testbench.campaign.plan import plan
from testbench.campaign.plan.plan_points import KeepData, canonical
from testbench.errors import FileError
from testbench.storage import inputs

DEEPEST = 8  # lists in lists of a value
LARGEST = 1 << 63


def _check_config_value(item, depth=0):
    """A value of a configuration: number, text, switch, nothing, or lists and tables of them."""
    if isinstance(item, (list, dict)) and depth < DEEPEST:
        for one in item.values() if isinstance(item, dict) else item:
            _check_config_value(one, depth + 1)
    elif isinstance(item, (int, float)):
        if math.isnan(item) or (isinstance(item, int) and abs(item) > LARGEST):
            raise ValueError("is not a number that a configuration can have")
    elif not isinstance(item, (str, type(None))):
        raise ValueError("is nested too deep")
    return item


Value = Annotated[Any, AfterValidator(_check_config_value)]
Count = Annotated[int, Field(strict=True, ge=1, le=plan.MAX_POINTS)]
Address = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


@dataclass
class _Axis:
    name: Annotated[str, Field(pattern=f"^{plan.NAME.pattern}$")]
    length: Count
    values: dict[str, list[Value]]
    cases: list[str]


@dataclass
class _Stored:
    name: Annotated[str, Field(pattern=f"^{plan.NAME.pattern}$")]
    engine: str
    set: dict[str, dict[str, Value]]
    axes: list[_Axis]
    keep: KeepData
    points: list[Address]
    sha256: str | None = None


def _plan_digest(data):
    return hashlib.sha256(canonical(data).encode()).hexdigest()


def plan_json(campaign_plan, addresses):
    """Text of a plan and the addresses of its points, in their order."""
    axes = [axis._asdict() for axis in campaign_plan.axes]
    data = {"name": campaign_plan.name, "engine": campaign_plan.engine, "set": campaign_plan.tree, "axes": axes}
    data |= {"keep": campaign_plan.keep._asdict(), "points": list(addresses)}
    return canonical(data | {"sha256": _plan_digest(data)})


def read(path):
    """(`plan.Plan`, addresses) of a file; FileError for what is damaged, or no plan of this name."""
    data = inputs.read_json(path, limit=inputs.most_bytes())
    stored = inputs.validate_data(data, _Stored, path)
    if data.pop("sha256", None) not in (None, _plan_digest(data)):
        raise FileError(f"{path}: is damaged: its checksum does not match")
    axes = tuple(plan.Axis(a.name, a.length, a.values, tuple(a.cases)) for a in stored.axes)
    _check(stored, axes, Path(path))
    campaign_plan = plan.Plan(
        stored.name, stored.engine, stored.set, axes, stored.keep.keep(), str(path), Path("/"), {}, {}
    )
    return campaign_plan, tuple(stored.points)


def _check(stored, axes, path):
    """What the schema cannot say: lengths that belong together, names that exist."""
    if stored.name != path.stem:
        raise FileError(f"{path}: contains the plan {stored.name!r}, which is not its file name")
    sections = configuration.sections()
    for axis in axes:
        lengths = {len(values) for values in axis.values.values()} | ({len(axis.cases)} if axis.cases else set())
        if lengths != {axis.length}:
            raise FileError(
                f"{path}: axis {axis.name}: has the length {axis.length}, but lists of {sorted(lengths)} values"
            )
        for dotted in axis.values:
            section, _, key = dotted.partition(".")
            if dotted != plan.ENGINE and not (section in sections and key in sections[section].model_fields):
                raise FileError(f"{path}: axis {axis.name}: {dotted} is not a parameter of this version")
    if len({axis.name for axis in axes}) < len(axes):
        raise FileError(f"{path}: duplicate axis")
    if math.prod(axis.length for axis in axes) != len(stored.points):
        raise FileError(
            f"{path}: has {len(stored.points)} points, but its axes have {math.prod(a.length for a in axes)} places"
        )
