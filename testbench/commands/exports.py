"""`gyro registers`, `fmu` and `host`: a folder written for other tools; no computing.

Source  docs/register_map.md, docs/fmu.md, docs/host_port.md
"""

from pathlib import Path
from typing import Annotated

import typer

from testbench.console.options import ConfigFile, Json, Sets, load, overrides
from testbench.console.show import print_json, print_list, print_reference

Folder = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder to write; an earlier export there is replaced.")
]


def _print_written(paths, as_json):
    files = [str(path) for path in paths]
    if as_json:
        print_json({"files": files})
    else:
        print_list("Written:", files)


def registers(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder to write; without it the map is printed.")
    ] = None,
    config: ConfigFile = None,
    sets: Sets = None,
    as_json: Json = False,
):
    """Print the register map, or write it as SystemRDL, C header with driver, UVM register model, IP-XACT and HTML."""
    if out is None:
        from testbench.commands.reference_tables import register_table

        print_reference([register_table()], as_json)
        return
    from testbench.register_map.export_registers import export

    _print_written(export(out, load(config, overrides(sets))), as_json)


def fmu(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write.")],
    config: ConfigFile = None,
    sets: Sets = None,
    fmi: Annotated[str, typer.Option("--fmi", metavar="VERSION", help="Version of FMI: 3.0 or 2.0.")] = "3.0",
    as_json: Json = False,
):
    """Write firmware and plant as FMUs for co-simulation; configuration, seed and temperatures are fixed."""
    from testbench.fmu.export_fmu import export

    _print_written(export(out, load(config, overrides(sets)), fmi), as_json)


def host(
    out: Folder,
    config: ConfigFile = None,
    sets: Sets = None,
    bus: Annotated[str, typer.Option("--bus", metavar="BUS", help="Port of the host: spi or axi (AXI4-Lite).")] = "spi",
    as_json: Json = False,
):
    """Write the RTL with a host port, in closed loop with the plant and locked, and a C program that reads it."""
    from testbench.host.export_host import export

    _print_written(export(out, load(config, overrides(sets)), bus), as_json)
