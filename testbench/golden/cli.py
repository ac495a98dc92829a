"""`gyro golden`: arguments and one line per bundle; no computing. `testbench.commands.main` adds this app to its own.

Source  docs/golden.md
"""

import json
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from testbench.console import options
from testbench.golden.golden_loop_cli import loop

app = typer.Typer(
    name="golden",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Golden vectors for HDL: export bundles, verify them, compare a design with them.",
)


@app.command()
def export(
    block: Annotated[str, typer.Argument(help="Block, such as dds, or top, or all.")] = "all",
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the bundles.")] = None,
    c: Annotated[
        Path | None,
        typer.Option("--c", metavar="DIR", help="Folder for the model in C; without --out also for the bundles."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", metavar="FILE", help="Configuration: its design and parameters.")
    ] = None,
    frames: Annotated[int, typer.Option(help="With --config: frames of 125 us of top, from power-on.")] = 400,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of lines.")] = False,
):
    """Write the golden bundles of a block, one folder per case: DIR/BLOCK/CASE; with --c also the firmware in C."""
    from testbench.errors import ConfigError
    from testbench.golden.bundles import bundle
    from testbench.golden.bundles.export import export as write
    from testbench.storage.files import atomic_outputs

    if out is None and c is None:
        raise ConfigError("export: one of --out DIR and --c DIR is needed")
    exported_bundles = []

    def write_bundles(folder):
        written = write(block, folder, config=config, frames=frames)
        display_root = c / "golden" if out is None else out
        exported_bundles.extend((display_root.joinpath(*path.parts[-2:]), manifest) for path, manifest in written)

    with atomic_outputs():
        files = [] if c is None else _export_c(c, config, None if out else lambda new: write_bundles(new / "golden"))
        if out is not None:
            write_bundles(out)
    if as_json:
        summaries = [
            {"folder": str(folder), "rows": m["n"], "sha256": m["manifest_sha256"]}
            | {"vectors_sha256": bundle.vectors_sha256(m)}
            for folder, m in exported_bundles
        ]
        typer.echo(json.dumps({"bundles": summaries} | ({"c_files": [str(path) for path in files]} if files else {})))
        return
    if files:
        typer.echo(f"{c}  {len(files)} files of C: make -C {c} check")
    for folder, manifest in exported_bundles:
        typer.echo(f"{folder}  {manifest['n']} rows  {manifest['manifest_sha256'][:16]}")


def _export_c(folder, config, fill):
    from testbench.golden.c_model.export_c import export as write

    return write(folder, config, fill)


@app.command()
def effect(
    name: Annotated[str, typer.Argument(help="Name of the case.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the bundle: DIR/top/NAME.")],
    laws: Annotated[list[Path] | None, typer.Option("--law", metavar="FILE", help="Law file.")] = None,
    sets: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Key of a configuration.")
    ] = None,
    frames: Annotated[int, typer.Option("--frames", help="Frames of 125 us from power-on.")] = 9400,
):
    """Run the closed loop with an effect of the plant, and write the vectors of the firmware in it."""
    from testbench.golden.bundles.effect import case, export

    folder, manifest = export(name, case(laws or (), sets or (), frames), out)
    typer.echo(f"{folder}  {manifest['n']} rows  {manifest['manifest_sha256'][:16]}")


@app.command()
def verify(
    folders: Annotated[list[Path], typer.Argument(help="Folders of bundles.")],
    again: Annotated[bool, typer.Option("--recompute", help="Compute every row and file again, and compare.")] = False,
):
    """Check the hash and the name of every file of bundles.

    Hashes prove that nothing was changed since the bundle was sealed. To prove the rows right, use --recompute.
    """
    from testbench.golden.bundles import bundle, recompute

    for folder in folders:
        if again:
            typer.echo(f"{folder}  ok  {recompute.recompute(folder).text()}")
            continue
        manifest = bundle.verify(folder)
        bundle.read(folder)
        typer.echo(f"{folder}  ok  {manifest['n']} rows  hashes agree (--recompute also checks the rows)")


@app.command()
def window(
    folder: Annotated[Path, typer.Argument(help="Folder of a bundle of the whole design: DIR/top/CASE.")],
    clock: Annotated[int | None, typer.Option("--clock", help="First clock, counted from row 0.")] = None,
    count: Annotated[int | None, typer.Option("--count", help="Number of clocks; default: one frame.")] = None,
    frame: Annotated[int | None, typer.Option("--frame", help="Number of a whole frame, instead of --clock.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder to write; default: FOLDER_CLOCK.")
    ] = None,
):
    """Write every clock of one window as a new bundle, to find the register where a signature differs."""
    from testbench.errors import ConfigError
    from testbench.golden.bundles import bundle
    from testbench.golden.bundles.design_bundle import window as write

    if (clock is None) == (frame is None):
        raise ConfigError("--clock, --frame: give one of them, not both")
    frame_clocks = bundle.verify(folder).get("frame_cycles", 0)
    first = frame * frame_clocks if clock is None else clock
    written, manifest = write(folder, first, frame_clocks if count is None else count, out)
    typer.echo(f"{written}  {manifest['n']} rows  {manifest['manifest_sha256'][:16]}")


class CheckOptions(NamedTuple):
    """Options of `gyro golden check`; those of `OF_RTL` belong to --rtl."""

    folder: Annotated[Path, typer.Argument(help="Folder of a bundle: DIR/BLOCK/CASE.")]
    rtl: Annotated[
        Path | None, typer.Option("--rtl", metavar="DIR", help="Folder of your design, which is simulated.")
    ] = None
    sim: Annotated[str | None, typer.Option("--sim", help="With --rtl: icarus, verilator or ghdl.")] = None
    level: Annotated[str | None, typer.Option("--level", help="With --rtl: pins, outputs or registers.")] = None
    files: Annotated[
        Path | None, typer.Option("--files", metavar="F.f", help="With --rtl: file that lists its sources.")
    ] = None
    top: Annotated[str | None, typer.Option("--top", help="With --rtl: your module or entity.")] = None
    latency: Annotated[
        Path | None,
        typer.Option("--latency", metavar="TOML", help="With --rtl: file of ports that come some clocks later."),
    ] = None
    timeout_s: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", help="With --rtl: time limit of build and simulation.")
    ] = 120.0
    log: Annotated[Path | None, typer.Option("--log", help="VCD, FST or GHW dump, or CSV, of your design.")] = None
    map: Annotated[
        Path | None,
        typer.Option("--map", metavar="TOML", help="File of names: of your design, or of the signals of its log."),
    ] = None
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for waveform, vectors and diagnosis of a difference; default: in build/ of the bundle.",
        ),
    ] = None
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False


OF_RTL = ("sim", "level", "files", "top", "latency")


@app.command()
@options.takes(CheckOptions)
def check(o):
    """Run your design, or read its log, and compare it with a bundle: report first divergence and likely cause."""
    from testbench.errors import ConfigError
    from testbench.golden.bundles import bundle
    from testbench.golden.check import design_run, rtl_run, top_run, waves

    if (o.rtl is None) == (o.log is None):
        raise ConfigError("check: give one of --rtl DIR and --log FILE, not both")
    if o.log is not None and o.map is None:
        raise ConfigError("check: --log needs --map TOML")
    rtl_options = {name: getattr(o, name) for name in OF_RTL}
    stray = [name for name, value in rtl_options.items() if value is not None and o.rtl is None]
    if stray:
        raise ConfigError(f"check: --{stray[0]} belongs to --rtl; --log does not use it")
    if o.rtl:
        choice = design_run.Choice(map=o.map, **rtl_options)
        is_top_bundle = bundle.verify(o.folder, strict=False)["block"] == "top"
        report = (top_run if is_top_bundle else rtl_run).check(o.folder, o.rtl, timeout_s=o.timeout_s, choice=choice)
    else:
        report = waves.check(o.folder, o.log, o.map)
    costs = _costs(report.block, report.case, report.clocks)
    written, why = (None, None) if report.passed else _package(o.out, o.folder, report)
    if o.as_json:
        tree = report.to_dict() | {"latency": [cost._asdict() for cost in costs], "written": written and str(written)}
        typer.echo(json.dumps(tree, indent=2, sort_keys=True))
    else:
        typer.echo(report.text() + "".join(f"latency           {cost.text()}\n" for cost in costs), nl=False)
        if not report.passed:
            typer.echo(f"package           {written or f'not written: {why}'}")
    raise typer.Exit(0 if report.passed else 1)


def _package(out, folder, report):
    """(folder, None) of what a difference leaves, or (None, why not): a bundle that cannot be written to is checked."""
    from testbench.errors import FileError
    from testbench.golden import divergence

    write = divergence.write_top if report.block == "top" else divergence.write_block
    try:
        return write(out or folder / divergence.BUILD_SUBFOLDER, folder, report), None
    except FileError as problem:
        if out is not None:
            raise
        return None, problem


def _costs(block, case, clocks):
    """What declared latencies cost; nothing is imported without one."""
    if not clocks:
        return []
    from testbench.golden import phase_cost

    return phase_cost.costs(block, case, clocks)


@app.command()
def signals(
    dump: Annotated[Path, typer.Argument(help="VCD, FST or GHW dump, or CSV, of your design.")],
    folder: Annotated[
        Path | None,
        typer.Option("--bundle", metavar="DIR", help="Bundle; for each of its ports a signal is suggested."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="TOML", help="File for a map with suggestions, to be corrected by hand."),
    ] = None,
):
    """List the signals of a dump; write a map of them, with suggestions for the ports of a bundle."""
    from testbench.golden.bundles import bundle
    from testbench.golden.check import signals as listed
    from testbench.storage.files import write_text

    dump_signals = listed.signals(dump)
    typer.echo(listed.text(dump, dump_signals))
    if out is not None:
        manifest = None if folder is None else bundle.verify(folder, strict=False)
        write_text(out, listed.skeleton(dump_signals, manifest, listed.is_ours(dump)))


@app.command()
def wrap(
    folder: Annotated[Path, typer.Argument(help="Folder of a bundle: DIR/BLOCK/CASE.")],
    map_path: Annotated[
        Path | None, typer.Option("--map", metavar="TOML", help="File with names, widths and reset of your design.")
    ] = None,
    level: Annotated[str, typer.Option("--level", help="pins, outputs or registers.")] = "outputs",
    latency: Annotated[
        Path | None, typer.Option("--latency", metavar="TOML", help="File of ports that come some clocks later.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="New folder; default: FOLDER_LEVEL.")] = None,
):
    """Write a folder in which `make check RTL=... FILES=...` runs a design with other port names, without Python."""
    from testbench.errors import ConfigError
    from testbench.golden.bundles import adapted_bundle as wrapped
    from testbench.golden.bundles import bundle

    out = out or folder.with_name(f"{folder.name}_{level}")
    if bundle.verify(folder, strict=False)["block"] == "top":
        manifest = wrapped.write_pin_bundle(folder, level, out, map_path, latency=latency)
        typer.echo(f"{out}  {manifest['n']} rows, {manifest['frames']} frames at level {level}")
        return
    if map_path is None:
        raise ConfigError("wrap: --map TOML is needed for a block")
    scope = wrapped.write_adapted_bundle(folder, map_path, level, out, latency)
    rows = f"{len(scope.golden.exp)} rows" + (f" from row {scope.first} of the bundle" if scope.first else "")
    typer.echo(f"{out}  {rows}, {int(scope.care.any(axis=1).sum())} compared at level {level}")
    for cost in _costs(scope.golden.manifest["block"], scope.golden.manifest["case"], scope.clocks):
        typer.echo(f"latency  {cost.text()}")


@app.command()
def ports(
    block: Annotated[str, typer.Argument(help="Block, such as dds, or all.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
):
    """List the ports of a block: parameters, inputs, registers and outputs with formats, resets, latencies, rules."""
    from testbench.console.show import print_reference
    from testbench.golden.bundles.export import select_blocks
    from testbench.golden.port_table import port_table

    print_reference([port_table(selected.stem) for selected in select_blocks(block)], as_json)


@app.command()
def ranges(
    block: Annotated[str, typer.Argument(help="Block, such as dds, or all.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
):
    """Print the proven and the observed range of every register, the headroom and the widest intermediate result."""
    from testbench.golden.bundles.export import select_blocks
    from testbench.golden.ranges import range_report

    range_entries = {
        f"{b.stem}/{case}": range_report.case_range_entry(b, case) for b in select_blocks(block) for case in b.cases
    }
    if as_json:
        typer.echo(json.dumps({"ranges": range_entries}))
    else:
        typer.echo("\n".join(range_report.text(title, data) for title, data in range_entries.items()), nl=False)
    raise typer.Exit(0 if all(data["proven"] for data in range_entries.values()) else 1)


@app.command()
def mutate(
    folder: Annotated[Path, typer.Argument(help="Folder of a bundle: DIR/BLOCK/CASE.")],
    rtl: Annotated[
        Path, typer.Option("--rtl", metavar="DIR", help="Folder of a Verilog design that passes the bundle.")
    ],
    count: Annotated[int, typer.Option("--count", help="Number of faults to try.")] = 150,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the random choice of faults.")] = 1,
    write: Annotated[bool, typer.Option("--write", help="Write the score into the bundle's manifest.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
):
    """Measure the mutation score: the share of small faults in a design that the vectors detect; needs yosys."""
    from testbench.golden.mutation.mutate import record, score_bundle

    outcome = score_bundle(folder, rtl, count, seed)
    if write:
        record(folder, outcome)
    typer.echo(json.dumps(outcome.to_dict()) if as_json else outcome.text())
    raise typer.Exit(0 if outcome.score == 1 else 1)


app.command()(loop)


@app.command()
def prove(
    block: Annotated[str, typer.Argument(help="Block with properties, such as spi_dac, or all.")],
    rtl: Annotated[Path, typer.Option("--rtl", metavar="DIR", help="Folder of a Verilog design.")],
    level: Annotated[str | None, typer.Option("--level", help="pins, outputs or registers.")] = None,
    files: Annotated[Path | None, typer.Option("--files", metavar="F.f", help="File that lists its sources.")] = None,
    top: Annotated[str | None, typer.Option("--top", help="Your module.")] = None,
    map_path: Annotated[
        Path | None, typer.Option("--map", metavar="TOML", help="File with the names of your design.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of lines.")] = False,
):
    """Prove the properties of a block, by induction or PDR: saturation, phase accumulator, SPI framing, sequencing."""
    from testbench.errors import ConfigError
    from testbench.golden.foreign.choice import Choice
    from testbench.golden.proofs import formal

    choice = Choice(level=level, files=files, top=top, map=map_path)
    if block != "all" and block not in formal.CASES:
        raise ConfigError(f"block: {block!r} has no properties; known: all, {', '.join(formal.CASES)}")
    proofs = []
    for stem in formal.CASES if block == "all" else (block,):
        for case in formal.CASES[stem]:
            proofs.append(formal.prove(stem, case, rtl, choice=choice))
            if not as_json:
                typer.echo(proofs[-1].text())
    if as_json:
        typer.echo(json.dumps({"proofs": [proof._asdict() for proof in proofs]}))
    raise typer.Exit(0 if all(proof.proven for proof in proofs) else 1)


@app.command()
def synth(
    rtl: Annotated[Path, typer.Option("--rtl", metavar="DIR", help="Folder of a Verilog design of the firmware.")],
    family: Annotated[
        str | None, typer.Option(help="ecp5 or ice40; without it only latches and undriven nets are checked.")
    ] = None,
    board: Annotated[str, typer.Option(help="analog or digital demodulator.")] = "analog",
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the board's files.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a line.")] = False,
):
    """Synthesise the whole design with yosys; fail on a latch or an undriven net. Counts of cells are estimates."""
    from testbench.golden.proofs.synthesis import synthesise

    netlist = synthesise(rtl, family, board, out)
    typer.echo(json.dumps(netlist._asdict()) if as_json else netlist.text())
