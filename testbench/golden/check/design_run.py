"""The design that is run: its sources, the simulator that reads them, and a wrapper if its names are its own.

Source  docs/foreign_designs.md
"""

import shutil
from pathlib import Path
from typing import NamedTuple

from testbench.errors import ConfigError, FileError
from testbench.golden.foreign import adapter, comparison_scope, design_map, rtl_sources
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
    port_map  `DesignMap`, or None
    style     of its reset;  clocks  {RTL port: extra clocks}
    """

    manifest: dict
    sim: str
    sources: rtl_sources.Sources
    level: str
    module: str
    wrapper: str | None
    port_map: design_map.DesignMap | None
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
    def interface_source(self):
        """Who says what the ports are."""
        return "the map" if self.wrapper else "the bundle"

    def widths(self):
        """{port or parameter of the design: bits} as the map has them; of a parameter and the reset 1."""
        if self.port_map is None:
            return {}
        port_map = self.port_map
        parameter_names = [name for _, name, _ in port_map.parameters] + [name for name, _ in port_map.constants]
        return dict.fromkeys([*parameter_names, port_map.clock, port_map.reset[0]], 1) | adapter.widths(port_map)

    def notes(self):
        """Lines for the report: parameters to which the map gives no value."""
        return () if self.port_map is None else design_map.parameter_notes(self.manifest, self.port_map)

    def hint(self, missing):
        """What helps where these ports are missing; empty if nothing is known to."""
        no_reset = self.port_map and self.port_map.reset[0] in missing
        hint_texts = ['for a design without a reset set style = "none" in [reset] of the map'] if no_reset else []
        registers = self.level == "registers" and any(name.startswith("r_") for name in missing)
        return [
            *hint_texts,
            *["level registers needs every register as a port; use --level outputs or pins"] * registers,
        ]


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
        source_sets = [rtl_sources.read_source_list(choice.files)]
    else:
        source_sets = rtl_sources.folder_sources(rtl, block) or (rtl_sources.folder_sources(rtl, top) if top else [])
    language = SIMULATORS[choice.sim].language if choice.sim else None
    usable_sources = [source_set for source_set in source_sets if language in (None, source_set.language)]
    if not usable_sources:
        file_hint = {None: f"{block}.v, .sv or .vhd", "verilog": f"{block}.v or .sv", "vhdl": f"{block}.vhd"}[language]
        hint = f", and no file of {top}; list the files with --files" if top else ""
        raise FileError(
            f"{choice.files or rtl}: no design for {choice.sim or 'any simulator'}: there is no {file_hint}{hint}"
        )
    sim = _simulator(choice.sim, [source_set.language for source_set in usable_sources], "the design")
    return sim, next(source_set for source_set in usable_sources if source_set.language == SIMULATORS[sim].language)


def select_design(manifest, rtl, choice=AS_OURS):
    """`Design` of what a user says of a folder; FileError or ConfigError with one line."""
    block, level = manifest["block"], choice.level or "registers"
    port_map = None
    if choice.map is not None or choice.top is not None:
        port_map = design_map.read(choice.map, manifest, level, choice.top)
    sim, design_sources = _sources(rtl, block, choice, port_map and port_map.top)
    text = None if port_map is None else getattr(adapter, SIMULATORS[sim].language)(manifest, port_map)
    return Design(
        manifest=manifest,
        sim=sim,
        sources=design_sources,
        level=level,
        module=adapter.adapter_name(manifest) if port_map else f"gyro_{block}",
        wrapper=text,
        port_map=port_map,
        style=port_map.style if port_map else "sync",
        clocks={} if choice.latency is None else comparison_scope.read_latency(choice.latency, manifest, level),
    )
