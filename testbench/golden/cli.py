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
    from testbench.golden import bundle

    for folder in folders:
        manifest = bundle.verify(folder)
        bundle.read(folder)
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
    rtl: Annotated[Path | None, typer.Option("--rtl", metavar="DIR", help="Folder of your design; it is run.")] = None,
    sim: Annotated[str | None, typer.Option("--sim", help="With --rtl: icarus, verilator or ghdl.")] = None,
    timeout_s: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", help="With --rtl: when to stop a design that hangs.")
    ] = 120.0,
    log: Annotated[Path | None, typer.Option("--log", help="VCD, FST or GHW dump, or CSV, of your design.")] = None,
    map_path: Annotated[
        Path | None, typer.Option("--map", metavar="TOML", help="With --log: which signal is which port.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
):
    """Run your design, or read its log, and compare it with a bundle: the first divergence, and what it looks like."""
    from testbench.errors import ConfigError
    from testbench.golden import rtl_run, waves

    if (rtl is None) == (log is None):
        raise ConfigError("check: one of --rtl DIR and --log FILE is needed")
    if log is not None and map_path is None:
        raise ConfigError("check: --log needs --map TOML")
    if (map_path is not None and log is None) or (sim is not None and rtl is None):
        raise ConfigError("check: --map belongs to --log, --sim to --rtl")
    report = rtl_run.check(folder, rtl, sim, timeout_s) if rtl else waves.check(folder, log, map_path)
    typer.echo(report.to_json() if as_json else report.text())
    raise typer.Exit(0 if report.passed else 1)


@app.command()
def ranges(
    block: Annotated[str, typer.Argument(help="Block, such as dds, or all.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
):
    """Proven and seen range of every register, headroom, and the widest intermediate result."""
    from testbench.golden import range_report
    from testbench.golden.export import chosen

    found = {f"{b.stem}/{case}": range_report.of_vectors(b, case) for b in chosen(block) for case in b.cases}
    if as_json:
        typer.echo(json.dumps({"ranges": found}))
    else:
        typer.echo("\n".join(range_report.text(title, data) for title, data in found.items()), nl=False)
    raise typer.Exit(0 if all(data["proven"] for data in found.values()) else 1)


@app.command()
def mutate(
    folder: Annotated[Path, typer.Argument(help="Folder of a bundle: DIR/BLOCK/CASE.")],
    rtl: Annotated[Path, typer.Option("--rtl", metavar="DIR", help="Folder of a Verilog design that passes it.")],
    count: Annotated[int, typer.Option("--count", help="Faults to try.")] = 150,
    seed: Annotated[int, typer.Option("--seed", help="Of the choice of faults.")] = 1,
    jobs: Annotated[int, typer.Option("--jobs", help="Survivors judged at a time.")] = 1,
    write: Annotated[bool, typer.Option("--write", help="Note the outcome in the bundle's manifest.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
):
    """Mutation score: what share of small faults in a design the vectors see; needs yosys and verilator."""
    from testbench.golden.mutate import record, score

    outcome = score(folder, rtl, count, seed, jobs)
    if write:
        record(folder, outcome)
    typer.echo(json.dumps(outcome.to_dict()) if as_json else outcome.text())
    raise typer.Exit(0 if outcome.score == 1 else 1)
