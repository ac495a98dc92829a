"""What a campaign asks of an engine, and the engines it knows by name.

    play(configs, sinks) -> [numbers, ...]    one dict per configuration: {name: number, text, or None if there is none}

`sinks[k].add(first_frame, frames, truth)` takes the 8 kHz rows of the scenario of configuration k, in order, in pieces
of any length (columns of `engine.FRAME_COLUMNS` and `TRUTH_COLUMNS`). A point that fails alone has an exception in
place of its dict. What a point gives must not depend on who shares its call.
An engine of one's own is named by its place, "package.module:OBJECT"; every worker must be able to import it.
Source  docs/campaigns.md
"""

import difflib
import importlib
from collections.abc import Callable
from typing import NamedTuple

from testbench.storage.sources import code_sha256
from testbench.errors import ConfigError


def _all_together(config):
    """Every point may share a call with every other."""
    return ()


class Engine(NamedTuple):
    """An engine: what plays, how many points at most in one call, which may share one, and what its numbers hang on.

    prepare  called once per process before the first point, one process of a machine at a time: compilation
    group    configuration -> key; points with equal keys may share a call
    modules  dotted names whose sources, with all they import, make the hash of the code
    twin     name of the engine that gives the same points to the last bit, under whose name they are kept; the modules
             must be the same
    """

    play: Callable
    batch: int
    modules: tuple
    prepare: Callable | None = None
    group: Callable = _all_together
    twin: str = ""


ENGINES = {
    "frame": "testbench.campaign.played:FRAME",
    "clocked": "testbench.campaign.played:CLOCKED",
    "baseband": "testbench.campaign.played:BASEBAND",
    "lanes": "testbench.campaign.played:LANES",
}
MEASURES = "testbench.campaign.plan.measure"


def check_name(name, where):
    """ConfigError unless `name` is an engine's; nothing is loaded."""
    if isinstance(name, str) and (name in ENGINES or name.count(":") == 1):
        return
    near = difflib.get_close_matches(str(name), ENGINES, n=1)
    hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(ENGINES)}, or package.module:OBJECT"
    raise ConfigError(f"{where} = {name!r} is not an engine; {hint}")


def load(name):
    """`Engine` of a name."""
    module, _, attribute = ENGINES.get(name, name).partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as problem:
        raise ConfigError(f"engine = {name!r} cannot be loaded: {problem}") from None
    if not isinstance(found, Engine):
        raise ConfigError(f"engine = {name!r} is a {type(found).__name__}, not an Engine")
    return found


def code_of(engine):
    """Hash of the sources that a point of this engine depends on."""
    return code_sha256(*engine.modules, MEASURES)
