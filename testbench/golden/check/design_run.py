"""The design that is run: its sources, the simulator that reads them, and a wrapper if its names are its own.

Source  docs/foreign_designs.md
"""

import shutil
from pathlib import Path
from typing import NamedTuple

from testbench.errors import ConfigError, FileError
from testbench.golden.foreign import design_map, judged, sources, wrapper
from testbench.golden.foreign.choice import AS_OURS, Choice  # noqa: F401
from testbench.golden.foreign.design_map import LIBRARY


class Simulator(NamedTuple):
    """A simulator: its program, and the language of its designs."""

    program: str
    language: str


SIMULATORS = {
    "icarus": Simulator("iverilog", "verilog"),
    "verilator": Simulator("verilator", "verilog"),
    "ghdl": Simulator("ghdl", "vhdl"),
}


class Design(NamedTuple):
    """What is built and run.

    manifest  of the bundle, or of the part of it that is judged
    module    what the bench instantiates
    wrapper   text around the design, or None
    named     `DesignMap`, or None
    style     of its reset;  clocks  {RTL port: extra clocks}
    """

    manifest: dict
    sim: str
    sources: sources.Sources
    level: str
    module: str
    wrapper: str | None
    named: design_map.DesignMap | None
    style: str
    clocks: dict

    @property
    def language(self):
        return SIMULATORS[self.sim].language

    @property
    def library(self):
        """VHDL library of files without one: not that of the wrapper."""
        return LIBRARY if self.wrapper else "work"

    @property
    def whose(self):
        """Who says what the ports are."""
        return "the map" if self.wrapper else "the bundle"

    def widths(self):
        """{port or parameter of the design: bits} as the map has them; of a parameter and the reset 1."""
        if self.named is None:
            return {}
        named = self.named
        own = [name for _, name, _ in named.parameters] + [name for name, _ in named.constants]
        return dict.fromkeys([*own, named.clock, named.reset[0]], 1) | wrapper.widths(named)

    def hint(self, missing):
        """What helps where these ports are missing; empty if nothing is known to."""
        found = ['a design without a reset has style = "none"'] if self.named and self.named.reset[0] in missing else []
        registers = self.level == "registers" and any(name.startswith("r_") for name in missing)
        return [*found, *["level registers needs every register, another --level does not"] * registers]


def _simulator(sim, languages, what):
    """Name of the simulator: the one asked for, or one that is installed for a language of the design."""
    if sim is not None and sim not in SIMULATORS:
        raise ConfigError(f"sim: {sim!r} is not one of {', '.join(SIMULATORS)}")
    names = [sim] if sim else [k for k, s in SIMULATORS.items() if s.language in languages]
    for name in names:
        if shutil.which(SIMULATORS[name].program):
            return name
    raise FileError(f"{SIMULATORS[names[0]].program}: not installed; {names[0]} is needed to run {what}")


def _sources(rtl, block, choice, top):
    """(simulator, Sources) of a design."""
    if choice.sim is not None and choice.sim not in SIMULATORS:
        raise ConfigError(f"sim: {choice.sim!r} is not one of {', '.join(SIMULATORS)}")
    if not Path(rtl).is_dir():
        raise FileError(f"{rtl}: not a folder")
    if choice.files is not None:
        listed = [sources.of_list(choice.files)]
    else:
        listed = sources.of_folder(rtl, block) or (sources.of_folder(rtl, top) if top else [])
    wanted = SIMULATORS[choice.sim].language if choice.sim else None
    fits = [found for found in listed if wanted in (None, found.language)]
    if not fits:
        own = {None: f"{block}.v, .sv or .vhd", "verilog": f"{block}.v or .sv", "vhdl": f"{block}.vhd"}[wanted]
        hint = f", nor {top}, and no --files list" if top else ""
        raise FileError(
            f"{choice.files or rtl}: no design for {choice.sim or 'any simulator'}: there is no {own}{hint}"
        )
    sim = _simulator(choice.sim, [found.language for found in fits], "the design")
    return sim, next(found for found in fits if found.language == SIMULATORS[sim].language)


def chosen(manifest, rtl, choice=AS_OURS):
    """`Design` of what a user says of a folder; FileError or ConfigError with one line."""
    block, level = manifest["block"], choice.level or "registers"
    named = None
    if choice.map is not None or choice.top is not None:
        named = design_map.read(choice.map, manifest, level, choice.top)
    sim, found = _sources(rtl, block, choice, named and named.top)
    text = None if named is None else getattr(wrapper, SIMULATORS[sim].language)(manifest, named)
    return Design(
        manifest=manifest,
        sim=sim,
        sources=found,
        level=level,
        module=wrapper.name_of(manifest) if named else f"gyro_{block}",
        wrapper=text,
        named=named,
        style=named.style if named else "sync",
        clocks={} if choice.latency is None else judged.read_latency(choice.latency, manifest, level),
    )
