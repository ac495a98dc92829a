"""What a campaign asks of an engine, and the engines it knows by name.

    run_points(configs, sinks) -> [numbers, ...]    one dict per configuration: {name: number, text, or None}

`sinks[k].add(first_frame, frames, truth)` takes the 8 kHz rows of the scenario of configuration k, in order, in pieces
of any length (columns of `engine.FRAME_COLUMNS` and `TRUTH_COLUMNS`). A point that fails alone has an exception in
place of its dict. What a point gives must not depend on who shares its call.
No file says what is imported: a plan names an engine, and its location, "package.module:OBJECT", is that of ours here,
of an entry point of an installed package, or of the option --engine. Every worker must be able to import it.
Source  docs/campaigns.md
"""

import difflib
import importlib
import importlib.metadata
import re
from collections.abc import Callable
from typing import NamedTuple

from testbench.errors import ConfigError
from testbench.storage.sources import code_sha256


def _common_group_key(config):
    """Every point may share a call with every other."""
    return ()


class Engine(NamedTuple):
    """An engine: what plays, how many points at most in one call, which may share one, and what its numbers hang on.

    prepare        called once per process before the first point, one process of a machine at a time: compilation
    group          configuration -> key; points with equal keys may share a call
    modules        dotted names whose sources, with all they import, make the hash of the code
    equivalent_to  name of the engine that gives the same points to the last bit, under whose name they are kept; the
                   modules must be the same
    """

    run_points: Callable
    batch: int
    modules: tuple
    prepare: Callable | None = None
    group: Callable = _common_group_key
    equivalent_to: str = ""


ENGINES = {
    "frame": "testbench.campaign.builtin_engines:FRAME",
    "clocked": "testbench.campaign.builtin_engines:CLOCKED",
    "baseband": "testbench.campaign.builtin_engines:BASEBAND",
    "lanes": "testbench.campaign.builtin_engines:LANES",
}
LOCATION_KEYED_ENGINES = {  # of ours, too; points are kept under the location
    "characterise": "testbench.paper.measure.characterise:POINTS",
    "word_lengths": "testbench.study.points:POINTS",
}
ENTRY_POINTS = "ftr_gyro.engines"
OPTION = re.compile(r"([A-Za-z_][\w.-]*)=([A-Za-z_][\w.]*:[A-Za-z_]\w*)")
MEASURES = "testbench.campaign.plan.measure"


def parse_options(texts):
    """{name: location} of texts as of `--engine`, and of `LOCATION_KEYED_ENGINES`."""
    out = dict(LOCATION_KEYED_ENGINES)
    for text in texts:
        option_match = OPTION.fullmatch(text)
        if not option_match:
            raise ConfigError(f"--engine: {text!r} is not of the form NAME=package.module:OBJECT")
        if option_match[1] in ENGINES or option_match[1] in out:
            raise ConfigError(f"--engine: {text!r}: the name {option_match[1]} is already used; choose another one")
        out[option_match[1]] = option_match[2]
    return out


def _installed_engines():
    points = importlib.metadata.entry_points(group=ENTRY_POINTS)
    return {point.name: f"{point.module}:{point.attr}" for point in points}


def find(name, extra_locations, where):
    """What `load` takes for the engine that a plan names; nothing is loaded.

    extra_locations  {name: location}, those of `parse_options`
    """
    if not isinstance(name, str):
        raise ConfigError(f"{where} = {name!r} is not the name of an engine")
    if name in ENGINES:
        return name
    location_by_name = extra_locations if name in extra_locations else _installed_engines() | extra_locations
    if name in location_by_name:
        return location_by_name[name]
    if ":" in name:
        quoted = next((f'"{candidate}"' for candidate, location in location_by_name.items() if location == name), None)
        hint = quoted or f"a name, and give the option --engine NAME={name}"
        raise ConfigError(f"{where} = {name!r}: a plan cannot name code to run; write {hint}")
    names = [*ENGINES, *location_by_name]
    matches = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {matches[0]}?" if matches else f"known: {', '.join(names)}; the option --engine adds one"
    raise ConfigError(f"{where} = {name!r} is not an engine; {hint}")


def permit(engine, extra_locations, where):
    """ConfigError unless the engine that a point names is ours, of the option or installed."""
    if engine not in ENGINES and engine not in extra_locations.values() and engine not in _installed_engines().values():
        raise ConfigError(f"{where}: was computed by the engine {engine!r}; give --engine NAME={engine} to run it")


def load(name):
    """`Engine` of a name of ours, or of a place, which must not come from a file."""
    module, _, attribute = ENGINES.get(name, name).partition(":")
    try:
        engine = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as problem:
        raise ConfigError(f"engine = {name!r} cannot be loaded: {problem}") from None
    if not isinstance(engine, Engine):
        raise ConfigError(f"engine = {name!r} is a {type(engine).__name__}, not an Engine")
    return engine


def source_hash(engine):
    """Hash of the sources that a point of this engine depends on."""
    return code_sha256(*engine.modules, MEASURES)
