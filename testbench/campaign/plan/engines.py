"""What a campaign asks of an engine, and the engines it knows by name.

    play(configs, sinks) -> [numbers, ...]    one dict per configuration: {name: number, text, or None if there is none}

`sinks[k].add(first_frame, frames, truth)` takes the 8 kHz rows of the scenario of configuration k, in order, in pieces
of any length (columns of `engine.FRAME_COLUMNS` and `TRUTH_COLUMNS`). A point that fails alone has an exception in
place of its dict. What a point gives must not depend on who shares its call.
No file says what is imported: a plan names an engine, and its place, "package.module:OBJECT", is that of ours here, of
an entry point of an installed package, or of the option --engine. Every worker must be able to import it.
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
PLACES = {  # of ours, too; points are kept under the place
    "characterise": "testbench.paper.measure.characterise:POINTS",
    "word_lengths": "testbench.study.points:POINTS",
}
ENTRY_POINTS = "ftr_gyro.engines"
OPTION = re.compile(r"([A-Za-z_][\w.-]*)=([A-Za-z_][\w.]*:[A-Za-z_]\w*)")
MEASURES = "testbench.campaign.plan.measure"


def parse_options(texts):
    """{name: place} of texts as of `--engine`, and of `PLACES`."""
    out = dict(PLACES)
    for text in texts:
        found = OPTION.fullmatch(text)
        if not found:
            raise ConfigError(f"--engine: {text!r} is not of the form NAME=package.module:OBJECT")
        if found[1] in ENGINES or found[1] in out:
            raise ConfigError(f"--engine: {text!r}: the name {found[1]} is taken; choose another one")
        out[found[1]] = found[2]
    return out


def _installed():
    points = importlib.metadata.entry_points(group=ENTRY_POINTS)
    return {point.name: f"{point.module}:{point.attr}" for point in points}


def find(name, own, where):
    """What `load` takes for the engine that a plan names; nothing is loaded.

    own  {name: place}, those of `parse_options`
    """
    if not isinstance(name, str):
        raise ConfigError(f"{where} = {name!r} is not the name of an engine")
    if name in ENGINES:
        return name
    places = own if name in own else _installed() | own
    if name in places:
        return places[name]
    if ":" in name:
        named = next((f'"{known}"' for known, place in places.items() if place == name), None)
        hint = named or f"a name there, and give --engine NAME={name}"
        raise ConfigError(f"{where} = {name!r}: no file can name code that would run here; write {hint}")
    known = [*ENGINES, *places]
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}; the option --engine adds one"
    raise ConfigError(f"{where} = {name!r} is not an engine; {hint}")


def permit(engine, own, where):
    """ConfigError unless the engine that a point names is ours, of the option or installed."""
    if engine not in ENGINES and engine not in own.values() and engine not in _installed().values():
        raise ConfigError(f"{where}: was made by the engine {engine!r}; --engine NAME={engine} runs it")


def load(name):
    """`Engine` of a name of ours, or of a place, which must not come from a file."""
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
