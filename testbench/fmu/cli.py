"""`gyro fmu`: arguments and what is printed; no computing. `testbench.commands.main` adds it to its commands.

Source  docs/fmu.md
"""

from pathlib import Path
from typing import Annotated

import typer

from testbench.console.options import ConfigFile, Json, Sets, load, overrides
from testbench.console.show import print_json, print_list


def fmu(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write.")],
    config: ConfigFile = None,
    sets: Sets = None,
    fmi: Annotated[str, typer.Option("--fmi", metavar="VERSION", help="Version of FMI: 3.0 or 2.0.")] = "3.0",
    as_json: Json = False,
):
    """Write firmware and plant as FMUs for co-simulation; configuration, seed and temperatures are fixed."""
    from testbench.fmu.export import export

    paths = [str(path) for path in export(out, load(config, overrides(sets)), fmi)]
    if as_json:
        print_json({"files": paths})
    else:
        print_list("Written:", paths)
