"""What a point is: a text that holds everything its result depends on, and the hash of that text, its address.

    identity = canonical JSON of {schema, config, engine, keep, code}
               config  every key of every section but [output], which says where and not what; a state file to start
                       from is named by its hash
               keep    what is measured; code  hash of the sources that the engine reaches
    address  = SHA-256 of identity, 64 hex digits

A worker is given the identity and nothing else, so a point that is rerun alone gets what it got in its campaign.
Source  docs/campaigns.md
"""

import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from testbench import config as configuration
from testbench.campaign.plan import engines
from testbench.campaign.plan.measure import Keep
from testbench.errors import ConfigError, FileError
from testbench.storage import inputs

SCHEMA = "gyropoint/1"
STATE = "sha256:"
STATE_NAME = re.compile("sha256:([0-9a-f]{64})")
Frames = Annotated[int, Field(strict=True, ge=1, le=1 << 31)]
PROFILES = ("rate_dps", "temperature_degc")  # may hold integers, which are no other profile than floats


class Point(NamedTuple):
    """A point of a plan: its number, its place on each axis, what it is, its address, and what `engines.load` takes."""

    number: int
    index: tuple
    identity: str
    address: str
    engine: str


def canonical(data):
    """JSON text with sorted keys and no blanks; inf is `Infinity`."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"))


def point_address(identity):
    """SHA-256 of an identity."""
    return hashlib.sha256(identity.encode()).hexdigest()


def _floats(value):
    if isinstance(value, (list, tuple)):
        return [_floats(item) for item in value]
    return float(value)


def point_identity(config, engine, keep, state_sha256=""):
    """Identity of a checked configuration; `state_sha256` of the file in scenario.resume, if there is one."""
    tree = config.model_dump(mode="json", exclude={"output": True, "scenario": {"engine"}})
    for name in PROFILES:
        tree["scenario"][name] = _floats(tree["scenario"][name])
    tree["scenario"]["resume"] = STATE + state_sha256 if state_sha256 else ""
    engine_object = engines.load(engine)
    engine_name, code = engine_object.equivalent_to or engine, engines.source_hash(engine_object)
    return canonical({"schema": SCHEMA, "config": tree, "engine": engine_name, "keep": keep._asdict(), "code": code})


@dataclass
class KeepData:
    """`Keep` as plain data."""

    streams: dict[str, Frames]
    statistics: dict[str, list[str]]
    frames: Frames
    tau_s: list[Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]]

    def keep(self):
        """As a `Keep`."""
        return Keep(self.streams, self.statistics, self.frames, self.tau_s)


@dataclass
class _Identity:
    schema: str
    config: dict[str, dict[str, Any]]
    engine: str
    keep: KeepData
    code: str


def parse_identity(identity):
    """Identity as an object; FileError for what is none of this version's."""
    data = inputs.parse_json(identity, "point")
    if data.get("schema") != SCHEMA:
        raise FileError(f"point: schema {str(data.get('schema'))[:40]!r} is not that of this version, {SCHEMA}")
    return inputs.validate_data(data, _Identity, "a point that this version cannot read")


class Task(NamedTuple):
    """A point as a worker needs it."""

    config: object
    keep: Keep
    code: str


def state_path(data, states):
    """Path of the state file that a parsed identity starts from, or None."""
    resume = str(data.config.get("scenario", {}).get("resume", ""))
    digest_match = STATE_NAME.fullmatch(resume)
    if resume and not digest_match:
        raise FileError(f"point: scenario.resume: {resume[:80]!r} is not the hash of a state file")
    return Path(states) / f"{digest_match[1]}.h5" if digest_match else None


def read_task(identity, states):
    """`Task` of an identity; `states` is the folder of state files by hash."""
    data = parse_identity(identity)
    tree, keep = data.config, data.keep
    if state := state_path(data, states):
        tree["scenario"]["resume"] = str(state)
    # a campaign keeps its own files, so a run writes none and takes no checkpoints
    tree["output"] = {"record": False, "pictures": False, "html": False, "state": False, "checkpoint_s": 0.0}
    try:
        config = configuration.from_dict(tree, "point")
    except ConfigError as problem:
        raise FileError(f"a point that this version cannot read: {problem}") from None
    statistics = {name: tuple(kinds) for name, kinds in keep.statistics.items()}
    return Task(config, keep.keep()._replace(statistics=statistics, tau_s=tuple(keep.tau_s)), data.code)
