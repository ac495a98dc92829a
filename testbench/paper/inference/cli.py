"""`gyro report infer`: arguments and what is printed; no computing.

Source  docs/inference.md
"""

from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from testbench.console.options import Json, takes
from testbench.console.progress import Progress
from testbench.console.show import print_json, print_list, print_tables


class InferOptions(NamedTuple):
    """Options of `gyro report infer`."""

    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for the page, the board and the JSON file.")
    ] = Path("out/inference")
    as_json: Json = False


@takes(InferOptions)
def infer(o):
    """Infer which boards explain the paper's numbers: posterior, held-out rows and the most probable board."""
    from testbench.run import outputs

    outputs.check_folder(o.out)
    with Progress(quiet=o.as_json) as progress:
        from testbench.paper.inference import inference_files, inference_page, inference_study
        from testbench.storage.files import atomic_outputs

        results = inference_study.run_inference(progress=progress)
        with atomic_outputs():
            paths = inference_files.write(results, o.out / "paper_inferred.toml")
            written = [str(p) for p in (*paths, inference_page.write(results, o.out / "inference.html"))]
    if o.as_json:
        print_json(inference_files.round_numbers(results) | {"files": written})
        return
    print_tables([inference_page.classes_table(results), inference_page.measurements_table(results)])
    print_list("", inference_page.summary(results))
    print_list("Written:", written)


def add(reports):
    """Put the command beside the other reports."""
    reports.command()(infer)
