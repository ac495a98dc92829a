"""`gyro design`: arguments and what is printed; no computing. `testbench.commands.main` adds this command to its own.

Source  docs/design_of_loops.md
"""

from pathlib import Path
from typing import Annotated

import typer

from testbench.console.options import Json
from testbench.console.progress import Progress
from testbench.console.show import print_json, print_list, print_tables


def design(
    target: Annotated[Path, typer.Argument(metavar="TARGET.toml", help="File with the board and the requirements.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write the configuration to this TOML file.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="DIR", help="Write design.html with predictions, margins and frequency plan."),
    ] = None,
    simulate: Annotated[
        bool,
        typer.Option("--simulate", help="Simulate power-on and a multisine of rate, and compare with the predictions."),
    ] = False,
    as_json: Json = False,
):
    """Design the loops for a board: a configuration that locks with its predictions, or the limit that prevents it."""
    from testbench.config import to_toml
    from testbench.run import outputs
    from testbench.storage.files import atomic_outputs, write_text

    for folder in ([report] if report else []) + ([out.parent] if out else []):
        outputs.check_folder(folder)
    with Progress(quiet=as_json) as progress:
        progress("design", 0, 1)
        from testbench.design import confirm_design, design_page, designer
        from testbench.design import target as targets

        result = designer.design(targets.load(target), str(target))
        if simulate:
            progress("simulation", 0, 1)
            result = result._replace(simulated=confirm_design.simulate_design(result))
        written = []
        with atomic_outputs():
            if out is not None:
                write_text(out, to_toml(result.config, inherited=False))
                written.append(str(out))
            if report is not None:
                written.append(str(design_page.write(result, report, progress)))
    if as_json:
        print_json({**design_page.as_json(result), "files": written})
        return
    print_tables(design_page.tables(result))
    print_list("Warnings:", result.warnings or ("none",))
    print_list("Written:", written)
