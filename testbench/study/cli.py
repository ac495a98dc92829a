"""`gyro study`: arguments and what is printed; no computing. `testbench.commands.main` adds this command to its own.

Source  docs/word_lengths.md
"""

from pathlib import Path
from typing import Annotated

import typer

from testbench.campaign.cli import Engines, Sets
from testbench.console.options import Json
from testbench.console.show import print_json, print_list, print_tables


def study(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN.toml", help="Plan with an axis of designs and an axis of seeds.")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="STORE", help="Folder of points, predictions and page.")],
    sets: Sets = None,
    engine_options: Engines = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0: only this one; default: one per core.")
    ] = None,
    as_json: Json = False,
):
    """Study word lengths: predict, run, compare. The same command continues after an interruption."""
    from testbench.campaign.campaign_progress import Progress
    from testbench.campaign.cli import local
    from testbench.study import study as studies
    from testbench.study import study_page

    show, engines = Progress(quiet=as_json), engine_options or ()
    result, report = studies.run(
        plan, out, local(workers), show, sets or (), engines, lambda results: study_page.write(results, out / "results")
    )
    files = list(map(str, report.files))
    if as_json:
        print_json({**study_page.as_json(result), "files": files})
    else:
        print_tables(study_page.tables(result))
        print_list("Written:", files)
    if report.failures:
        for _, text in report.failures[:5]:
            typer.echo(f"gyro: failed: {text}", err=True)
        raise typer.Exit(2)
