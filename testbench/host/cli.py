"""`gyro host`: arguments and what is printed; no computing. `testbench.commands.main` adds it to its commands.

Source  docs/blocks/host.md
"""

from pathlib import Path
from typing import Annotated

import typer

from testbench.console.options import ConfigFile, Json, Sets, load, overrides
from testbench.console.show import print_json, print_list


def host(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write; an older one is replaced.")],
    config: ConfigFile = None,
    sets: Sets = None,
    bus: Annotated[str, typer.Option("--bus", metavar="BUS", help="Port of the host: spi or axi (AXI4-Lite).")] = "spi",
    as_json: Json = False,
):
    """Write the RTL with a port of the host, closed around the plant and locked, with a host in C that reads it."""
    from testbench.host.export import export

    paths = [str(path) for path in export(out, load(config, overrides(sets)), bus)]
    if as_json:
        print_json({"files": paths})
    else:
        print_list("Written:", paths)
