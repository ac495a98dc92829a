"""Command line `gyro`: arguments, tables and progress; no computing.

Standard output holds the result (tables, or one JSON object), standard error the progress and one line per error.
Exit codes: 0 done, 2 something the user can mend, 130 interrupted. Heavy modules are imported by the command that needs
them, so that `gyro --help` answers at once.
Source  docs/configuration.md
"""

import itertools
import os
import re
import sys
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from testbench.campaign import cli as campaign_cli
from testbench.commands import exports, reference
from testbench.console import standard
from testbench.console.options import ConfigFile, Json, Sets, Temperature, load, overrides, takes
from testbench.console.progress import Progress
from testbench.console.show import print_json, print_list, print_tables
from testbench.design import cli as design_cli
from testbench.errors import ConfigError, FileError
from testbench.golden import cli as golden_cli
from testbench.interrupts import EXIT_INTERRUPTED
from testbench.measured import cli as measured_cli
from testbench.paper import cli as paper_cli
from testbench.paper.inference import cli as inference_cli
from testbench.paper.loop import loop_cli
from testbench.study import cli as study_cli
from testbench.version import VERSION

EXIT_MENDABLE = 2

app = typer.Typer(
    name="gyro",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Golden reference for the firmware of a MEMS gyroscope, in closed loop with its plant.",
)
app.add_typer(golden_cli.app)
app.add_typer(campaign_cli.app)
app.add_typer(measured_cli.app)
paper_cli.add(app)
inference_cli.add(paper_cli.reports)
app.command()(loop_cli.loop)
app.command()(design_cli.design)
app.command()(study_cli.study)
app.command()(reference.config)
app.command()(exports.registers)
app.command()(exports.fmu)
app.command()(exports.host)


def _version(is_requested: bool):
    if is_requested:
        print(f"gyro {VERSION}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
):
    pass


class RunOptions(NamedTuple):
    """Options of `gyro run`."""

    config: ConfigFile = None
    sets: Sets = None
    seconds: Annotated[float | None, typer.Option(help="Simulated seconds, counted from lock.")] = None
    rate_dps: Annotated[float | None, typer.Option(help="Constant rate (deg/s).")] = None
    temperature_degc: Temperature = None
    seed: Annotated[int | None, typer.Option(help="Seed of all noise.")] = None
    no_noise: Annotated[bool, typer.Option("--no-noise", help="Switch every noise source off.")] = False
    engine: Annotated[str | None, typer.Option(help="Engine: frame or clocked (the same bits), or baseband.")] = None
    plant: Annotated[
        Path | None, typer.Option(metavar="LIB", help="Shared library with a plant, instead of the built-in one.")
    ] = None
    plant_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Text file that is passed to this library.")
    ] = None
    out: Annotated[str | None, typer.Option(metavar="DIR", help="Folder for record, pictures and report.")] = None
    resume: Annotated[str | None, typer.Option(metavar="STATE", help="State file to start from.")] = None
    vcd: Annotated[
        str | None, typer.Option(metavar="START_US:LENGTH_US", help="Write waveforms of a window; times from power-on.")
    ] = None
    resume_run: Annotated[
        str | None,
        typer.Option(metavar="DIR", help="Continue the interrupted run in DIR with its configuration."),
    ] = None
    discard: Annotated[bool, typer.Option("--discard", help="Discard an unfinished run in the folder.")] = False
    across_versions: Annotated[
        bool,
        typer.Option("--across-versions", help="Continue a state that another version saved; the record notes it."),
    ] = False
    gyrorec: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the run from power-on as a measurement record.")
    ] = None
    as_json: Json = False


@app.command()
@takes(RunOptions)
def run(o):
    """Simulate power-on, lock and scenario in closed loop, and print what was measured."""
    if o.resume_run is not None:
        if any(o._replace(resume_run=None, as_json=False, across_versions=False, plant=None)):
            raise ConfigError(
                "--resume-run: the interrupted run keeps its configuration; the only other options are --json, "
                "--plant and --across-versions"
            )
        from testbench.storage.checkpoint import open_partial

        partial = open_partial(o.resume_run)
        _run(load(partial.config, overrides(None, _plant(o), *_across(o))), partial, True, o.as_json)
        return
    option_overrides = overrides(
        o.sets,
        ("scenario.seconds", o.seconds, "--seconds"),
        ("scenario.rate_dps", o.rate_dps, "--rate-dps"),
        ("scenario.temperature_degc", o.temperature_degc, "--temperature-degc"),
        ("scenario.engine", o.engine, "--engine"),
        _plant(o),
        ("scenario.plant_file", o.plant_file and str(o.plant_file.absolute()), "--plant-file"),
        ("scenario.resume", o.resume, "--resume"),
        ("noise.seed", o.seed, "--seed"),
        ("output.directory", o.out, "--out"),
        *_across(o),
        *_vcd_overrides(o.vcd),
        *(_silence() if o.no_noise else ()),
    )
    checked = load(o.config, option_overrides)
    if o.gyrorec is not None:
        from testbench.measured.record import from_run

        from_run.plan_from_config(checked)  # refused before anything runs
    from testbench.storage.checkpoint import Partial

    _run(checked, Partial(checked.output.directory), False, o.as_json, o.discard)
    if o.gyrorec is not None:
        with Progress(quiet=o.as_json) as progress:
            digest = from_run.write(checked, o.gyrorec, progress)
        if not o.as_json:
            typer.echo(f"{o.gyrorec}  {digest[:16]}")


def _plant(o):
    """Override of `--plant`: no file can name a library, not even that of an interrupted run."""
    return ("scenario.plant", o.plant and str(o.plant.absolute()), "--plant")


def _across(o):
    """Overrides of `--across-versions`."""
    return [("scenario.across_versions", True, "--across-versions")] if o.across_versions else []


def _run(config, partial, resume, as_json, discard=False):
    """Do a run, or the rest of one, and show it; what is left of an interrupted one can be continued."""
    from testbench.run import outputs

    directory = partial.folder.parent
    outputs.check_folder(directory)
    with partial:
        if discard:
            partial.discard()
        if not resume:
            partial.refuse_unfinished()
        try:
            with Progress(quiet=as_json) as progress:
                progress("loading the engine", 0, 1)
                from testbench.run import run_tables, simulate
                from testbench.run.budget import budgets

                result = simulate.run(config, progress=progress, directory=partial, resume=resume)
                result_tables = [run_tables.phases(result.summary), run_tables.results_table(result.summary)]
                report = result_tables + run_tables.budget_tables(*budgets(config))
                paths = [str(path) for path in outputs.write(result, config, report, progress, directory)]
        except BaseException as problem:
            if not partial.resumable():
                partial.clear()
            elif isinstance(problem, KeyboardInterrupt):
                _print_stderr_line(f"to continue: gyro run --resume-run {directory}")
            elif isinstance(problem, MemoryError):
                raise FileError(f"{_lack(problem)}; to continue: gyro run --resume-run {directory}") from None
            raise
        partial.clear()
    if as_json:
        print_json({**result.summary, "files": paths})
        return
    print_tables(result_tables)
    print_list("", result.notes)
    print_list("Written:", paths)


@app.command()
def budget(config: ConfigFile = None, sets: Sets = None, temperature_degc: Temperature = None, as_json: Json = False):
    """Compute the contributions to each phase error in clocks, ns and degrees, without a simulation."""
    import fpga_model

    # only a ring that saturates needs a kernel; to load the compiler takes longer than the rest
    text = config.read_text(errors="replace") if config and config.is_file() else ""
    fpga_model.COMPILED = re.search(r"ring_saturation_on\s*=\s*1", f"{text} {sets}") is not None
    option_overrides = overrides(sets, ("scenario.temperature_degc", temperature_degc, "--temperature-degc"))
    checked = load(config, option_overrides)
    from testbench.run import run_tables
    from testbench.run.budget import budgets

    phase_budgets = budgets(checked)
    if as_json:
        print_json(run_tables.budget_json(*phase_budgets))
    else:
        print_tables(run_tables.budget_tables(*phase_budgets))


def _silence():
    """Overrides of `--no-noise`: every switch of [noise] off."""
    from testbench.config import Noise

    return [(f"noise.{key}", False, "--no-noise") for key in Noise.model_fields if key != "seed"]


def _vcd_overrides(text):
    """Overrides of `--vcd START_US:LENGTH_US`."""
    if text is None:
        return []
    try:
        start_us, length_us = (float(part) for part in text.split(":"))
    except ValueError:
        raise ConfigError(f"--vcd: {text!r} is not of the form START_US:LENGTH_US, such as 1200000:20") from None
    return [("output.vcd_start_us", start_us, "--vcd"), ("output.vcd_length_us", length_us, "--vcd")]


def _print_stderr_line(text):
    print(f"gyro: {' '.join(str(text).split())}", file=sys.stderr)


def _lack(problem):
    """What a MemoryError says: how much of memory was wanted, where that is known."""
    return f"out of memory: {problem}" if str(problem) else "out of memory"


def _oserror_path(problem):
    """File that a system's error is about; of a failed write only the frames of pathlib know it."""
    name, trace = problem.filename, problem.__traceback__
    while trace and not problem.filename:
        frame_self = trace.tb_frame.f_locals.get("self")
        name, trace = frame_self if isinstance(frame_self, Path) else name, trace.tb_next
    return name or "gyro"


def _check_arguments(argv):
    """ConfigError for an argument that is empty or has a NUL, and for a count of threads that Numba refuses."""
    for number, (before, text) in enumerate(itertools.pairwise(["gyro", *argv]), 1):
        name, equals, option_value = text.partition("=")
        if name.startswith("--") and equals:
            before, text = name, option_value
        option_label = before if before.startswith("-") else f"argument {number}"
        if not text:
            raise ConfigError(f"{option_label}: is empty")
        if "\0" in text:
            raise ConfigError(f"{option_label}: {text!r} contains a NUL character")
    threads = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if re.fullmatch(r"-\d+|0+", threads):
        raise ConfigError(f"NUMBA_NUM_THREADS = {threads} is below the limit 1 thread")


def _run_command_line(argv):
    """Exit code of a command line."""
    try:
        if argv is None:
            standard.settle()
        _check_arguments(sys.argv[1:] if argv is None else argv)
        code = app(args=argv, prog_name="gyro", standalone_mode=False)
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except (ConfigError, FileError) as problem:
        _print_stderr_line(problem)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except OSError as problem:  # a name that is too long, a disk that is full: the system's word on a file
        _print_stderr_line(f"{_oserror_path(problem)}: {problem.strerror or problem}")
    except MemoryError as problem:
        _print_stderr_line(f"{_lack(problem)}; end other programs, or raise the limit (ulimit -v)")
    except Exception as problem:
        # usage errors of the argument parser, whose class typer keeps private, know their exit code and their line
        if type(problem).__name__ == "Abort":
            return EXIT_INTERRUPTED
        if not hasattr(problem, "format_message"):
            raise
        _print_stderr_line(problem.format_message() or "no command; try gyro --help")
    return EXIT_MENDABLE


def main(argv=None):
    """Run the command line and exit; errors that a person can mend are one line.

    argv  arguments; None: those of this process, whose standard streams are settled first
    """
    code = _run_command_line(argv)
    if code == EXIT_INTERRUPTED:
        _print_stderr_line("interrupted")
    sys.exit(code)


if __name__ == "__main__":
    main()
