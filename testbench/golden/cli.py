"""`gyro golden`: arguments and one line per bundle; no computing. `testbench.cli` adds this app to its own.

Source  docs/golden.md
"""

import json
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="golden",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Golden vectors for HDL: export bundles, verify them, compare a design with them.",
)


@app.command()
def export(
    block: Annotated[str, typer.Argument(help="Block, such as dds, or top, or all.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the bundles.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of lines.")] = False,
):
    """Write the golden bundles of a block, one folder per case: DIR/BLOCK/CASE."""
    from testbench.golden.export import export as write

    done = write(block, out)
    if as_json:
        listed = [{"folder": str(folder), "rows": m["n"], "sha256": m["manifest_sha256"]} for folder, m in done]
        typer.echo(json.dumps({"bundles": listed}))
        return
    for folder, manifest in done:
        typer.echo(f"{folder}  {manifest['n']} rows  {manifest['manifest_sha256'][:16]}")


@app.command()
def verify(folders: Annotated[list[Path], typer.Argument(help="Folders of bundles.")]):
    """Check every hash and every name of bundles."""
    from testbench.golden.bundle import read

    for folder in folders:
        manifest = read(folder).manifest
        typer.echo(f"{folder}  ok  {manifest['n']} rows")


@app.command()
def window(
    folder: Annotated[Path, typer.Argument(help="Folder of a bundle of the whole design: DIR/top/CASE.")],
    clock: Annotated[int | None, typer.Option("--clock", help="First clock, counted from row 0.")] = None,
    count: Annotated[int | None, typer.Option("--count", help="Clocks; 3250 if not given.")] = None,
    frame: Annotated[int | None, typer.Option("--frame", help="The whole frame of this number instead.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder to write; FOLDER_CLOCK if none.")
    ] = None,
):
    """Write every clock of one place as a bundle of its own: where a signature differs, it finds the register."""
    from fpga_model.rates import FRAME_CYCLES
    from testbench.errors import ConfigError
    from testbench.golden.top import window as write

    if (clock is None) == (frame is None):
        raise ConfigError("give either --clock or --frame")
    first = frame * FRAME_CYCLES if clock is None else clock
    written, manifest = write(folder, first, FRAME_CYCLES if count is None else count, out)
    typer.echo(f"{written}  {manifest['n']} rows  {manifest['manifest_sha256'][:16]}")


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(help="Folder of a bundle: DIR/BLOCK/CASE.")],
    log: Annotated[Path, typer.Option("--log", help="VCD or FST dump, or CSV, of your design.")],
    map_path: Annotated[Path, typer.Option("--map", metavar="TOML", help="Which signal is which port.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
):
    """Compare a log of your design with a bundle: the first divergence, and what it looks like."""
    from testbench.golden.waves import check as compared

    report = compared(folder, log, map_path)
    typer.echo(report.to_json() if as_json else report.text())
    raise typer.Exit(0 if report.passed else 1)
