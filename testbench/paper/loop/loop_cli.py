"""`gyro loop`: arguments and what is printed; no computing. `testbench.commands.main` adds this command to its own.

Source  docs/loop.md
"""

from pathlib import Path
from typing import Annotated

import typer

from testbench.console.options import ConfigFile, Json, Sets, load, overrides
from testbench.console.progress import Progress
from testbench.console.show import print_json, print_list, print_tables
from testbench.errors import ConfigError


def loop(
    config: ConfigFile = None,
    sets: Sets = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Simulate a multisine and a rate step, and compare with the analysis.")
    ] = False,
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="DIR", help="Write loop.html to this folder: pictures, maps, sensitivities."),
    ] = None,
    as_json: Json = False,
):
    """Analyse the force-to-rebalance loop: margins, peak, bandwidth, ringing, rounding, and warnings."""
    from testbench.run import outputs

    checked = load(config, overrides(sets))
    if report is not None:
        outputs.check_folder(report)
    with Progress(quiet=as_json) as progress:
        progress("analysis", 0, 1)
        from testbench.paper.loop import loop_page

        study = loop_page.Study(checked)
        if simulate:
            if not study.advice.stable:
                raise ConfigError(f"--simulate: {study.advice.warnings[0]}")
            progress("simulation", 0, 1)
            study.simulate()
        written = None
        if report is not None:
            written = str(loop_page.write(study, report, progress))
    if as_json:
        print_json({**loop_page.as_json(study), "files": [written] if written else []})
        return
    print_tables(loop_page.tables(study))
    print_list("Warnings:", study.warnings or ("none",))
    if written:
        print_list("Written:", [written])
