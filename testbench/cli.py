"""Command line `gyro`: arguments, tables and progress; no computing.

Standard output holds the result (tables, or one JSON object), standard error the progress and one line per error.
Exit codes: 0 done, 2 something the user can mend, 130 interrupted. Heavy modules are imported by the command that needs
them, so that `gyro --help` answers at once.
Source  docs/configuration.md
"""

import json
import math
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from testbench.campaign import cli as campaign_cli
from testbench.errors import ConfigError, FileError
from testbench.golden import cli as golden_cli
from testbench.measured import cli as measured_cli
from testbench.paper import cli as paper_cli
from testbench.paper import loop_cli
from testbench.version import VERSION

EXIT_MENDABLE, EXIT_INTERRUPTED = 2, 130
SHOW_PROGRESS_AFTER_S = 1.0
SHOW_PROGRESS_EVERY_S = 0.1
PLAIN_WIDTH = 120  # columns where standard output is no terminal

app = typer.Typer(
    name="gyro",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Golden reference for the firmware of a MEMS gyroscope, closed around its plant.",
)
app.add_typer(golden_cli.app)
app.add_typer(campaign_cli.app)
app.add_typer(measured_cli.app)
paper_cli.add(app)
app.command()(loop_cli.loop)

ConfigFile = Annotated[Path | None, typer.Option("--config", "-c", metavar="FILE", help="TOML configuration.")]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="One value, such as plant.fx_hz=11010; may be repeated."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]
Temperature = Annotated[float | None, typer.Option("--temperature-degc", help="Constant temperature (degC).")]


def _version(wanted: bool):
    if wanted:
        print(f"gyro {VERSION}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
):
    pass


@app.command()
def run(
    config: ConfigFile = None,
    sets: Sets = None,
    seconds: Annotated[float | None, typer.Option(help="Simulated seconds, counted from lock.")] = None,
    rate_dps: Annotated[float | None, typer.Option(help="Constant rate (deg/s).")] = None,
    temperature_degc: Temperature = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all noise.")] = None,
    no_noise: Annotated[bool, typer.Option("--no-noise", help="Switch every noise source off.")] = False,
    engine: Annotated[str | None, typer.Option(help="Engine: frame or clocked (the same bits), or baseband.")] = None,
    out: Annotated[str | None, typer.Option(metavar="DIR", help="Folder for record, pictures and report.")] = None,
    resume: Annotated[str | None, typer.Option(metavar="STATE", help="State file to start from.")] = None,
    vcd: Annotated[
        str | None, typer.Option(metavar="START_US:LENGTH_US", help="Waveforms of a window, from power-on.")
    ] = None,
    resume_run: Annotated[
        str | None,
        typer.Option(metavar="DIR", help="Continue the interrupted run in DIR; its configuration is kept there."),
    ] = None,
    gyrorec: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the run as a measurement record too, from power-on.")
    ] = None,
    as_json: Json = False,
):
    """Close the loop from power-on, lock, run the scenario, and say what was measured."""
    given = (config, sets, seconds, rate_dps, temperature_degc, seed, engine, out, resume, vcd, gyrorec)
    if resume_run is not None:
        if no_noise or any(given):
            raise ConfigError("--resume-run: the interrupted run keeps its configuration; no other option but --json")
        from testbench.checkpoint import stored_config

        _run(_load(stored_config(resume_run), ()), resume_run, True, as_json)
        return
    overrides = _overrides(
        sets,
        ("scenario.seconds", seconds, "--seconds"),
        ("scenario.rate_dps", rate_dps, "--rate-dps"),
        ("scenario.temperature_degc", temperature_degc, "--temperature-degc"),
        ("scenario.engine", engine, "--engine"),
        ("scenario.resume", resume, "--resume"),
        ("noise.seed", seed, "--seed"),
        ("output.directory", out, "--out"),
        *_window(vcd),
        *(_silence() if no_noise else ()),
    )
    checked = _load(config, overrides)
    if gyrorec is not None:
        from testbench.measured import from_run

        from_run.plan_of(checked)  # refused before anything runs
    _run(checked, checked.output.directory, False, as_json)
    if gyrorec is not None:
        with Progress(quiet=as_json) as progress:
            digest = from_run.write(checked, gyrorec, progress)
        if not as_json:
            typer.echo(f"{gyrorec}  {digest[:16]}")


def _run(config, directory, resume, as_json):
    """Do a run, or the rest of one, and show it; what is left of an interrupted one can be continued."""
    from testbench import outputs
    from testbench.checkpoint import Partial

    outputs.check_folder(directory)
    partial = Partial(directory)
    try:
        with Progress(quiet=as_json) as progress:
            progress("loading the engine", 0, 1)
            from testbench import simulate, tables

            result = simulate.run(config, progress=progress, directory=directory, resume=resume)
            shown = [tables.phases(result.summary), tables.numbers(result.summary)]
            report = shown + tables.budget_tables(*_budgets(config))
            paths = [str(path) for path in outputs.write(result, config, report, progress, directory)]
    except BaseException as problem:
        if not partial.resumable():
            partial.clear()
        elif isinstance(problem, KeyboardInterrupt):
            _say(f"to continue: gyro run --resume-run {directory}")
        raise
    partial.clear()
    if as_json:
        _print_json({**result.summary, "files": paths})
        return
    _print_tables(shown)
    _print_list("", result.notes)
    _print_list("Written:", paths)


@app.command()
def budget(config: ConfigFile = None, sets: Sets = None, temperature_degc: Temperature = None, as_json: Json = False):
    """Say where the phase errors come from, in clocks, ns and degrees, from the configuration alone."""
    overrides = _overrides(sets, ("scenario.temperature_degc", temperature_degc, "--temperature-degc"))
    checked = _load(config, overrides)
    from testbench import tables

    budgets = _budgets(checked)
    if as_json:
        _print_json(tables.budget_json(*budgets))
    else:
        _print_tables(tables.budget_tables(*budgets))


def _silence():
    """Overrides of `--no-noise`: every switch of [noise] off."""
    from testbench.config import Noise

    return [(f"noise.{key}", False, "--no-noise") for key in Noise.model_fields if key != "seed"]


def _overrides(sets, *named):
    from testbench.config import Override, parse_set

    given = [Override(path, value, source) for path, value, source in named if value is not None]
    return [parse_set(text) for text in sets or ()] + given


def _window(text):
    """Overrides of `--vcd START_US:LENGTH_US`."""
    if text is None:
        return []
    try:
        start_us, length_us = (float(part) for part in text.split(":"))
    except ValueError:
        raise ConfigError(f"--vcd: {text!r} is not of the form START_US:LENGTH_US, such as 1200000:20") from None
    return [("output.vcd_start_us", start_us, "--vcd"), ("output.vcd_length_us", length_us, "--vcd")]


def _load(path, overrides):
    from testbench.config import load

    return load(path, overrides)


def _budgets(config):
    """Budget, and the budget without the two assumptions about the paper's firmware."""
    from testbench.budget import budget
    from testbench.config import changed

    plain = {"reference_retimed": False, "frame_latency_drive": 0, "frame_latency_sense": 0}
    try:
        return budget(config), budget(changed(config, {f"firmware.{key}": value for key, value in plain.items()}))
    except ValueError as problem:
        raise ConfigError(problem) from None


# ---- output ----------------------------------------------------------------------------------------------------------


def _finite(value):
    """The same data with numbers that JSON cannot hold as null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _print_json(data):
    print(json.dumps(_finite(data), allow_nan=False))


def _console():
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else PLAIN_WIDTH)


def _print_tables(shown):
    from rich import box
    from rich.table import Table

    console = _console()
    for table in shown:
        grid = Table(title=table.title, title_justify="left", box=box.SIMPLE_HEAD, caption=table.note or None)
        grid.caption_justify = "left"
        for k, head in enumerate(table.heads):
            grid.add_column(head, justify="right" if k in table.numeric else "left", no_wrap=k in table.numeric)
        for k, row in enumerate(table.rows):
            grid.add_row(*row, style="bold" if k in table.sums else None)
        console.print(grid, markup=False)


def _print_list(head, items):
    console = _console()
    if items and head:
        console.print(head, markup=False)
    for item in items:
        console.print(f"  - {item}" if not head else f"  {item}", markup=False, soft_wrap=True)


class Progress:
    """Progress bar on standard error, when that is a terminal and the work takes more than a second.

    Called as progress(text, done, total); calls are cheap, so an engine may report every block. The time that is left
    follows from the work that was seen: a run that is continued in its middle has not done its first half in no time.
    """

    def __init__(self, quiet=False):
        self._quiet = quiet or not sys.stderr.isatty()
        self._begin = time.monotonic()
        self._bar = None
        self._task = None
        self._text = None
        self._next = 0.0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self._bar:
            self._bar.stop()

    def __call__(self, text, done, total):
        now = time.monotonic()
        if self._quiet or (self._bar is None and now - self._begin < SHOW_PROGRESS_AFTER_S):
            return
        if text == self._text and now < self._next and done < total:
            return
        self._next = now + SHOW_PROGRESS_EVERY_S
        if self._bar is None:
            self._open()
        if text != self._text:
            self._text = text
            self._bar.reset(self._task, description=text, completed=done, total=total)
        else:
            self._bar.update(self._task, completed=done, total=total)

    def _open(self):
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = TextColumn("{task.description:24}"), BarColumn(40), TaskProgressColumn(), TimeRemainingColumn()
        self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
        self._bar.start()
        self._task = self._bar.add_task("", total=1)


def _say(text):
    print(f"gyro: {' '.join(str(text).split())}", file=sys.stderr)


def main(argv=None):
    """Run the command line and exit; errors that a person can mend are one line."""
    try:
        code = app(args=argv, prog_name="gyro", standalone_mode=False)
    except (ConfigError, FileError) as problem:
        _say(problem)
        code = EXIT_MENDABLE
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        code = 0
    except Exception as problem:
        # usage errors of the argument parser, whose class typer keeps private, know their exit code and their line
        if type(problem).__name__ == "Abort":
            code = EXIT_INTERRUPTED
        elif hasattr(problem, "format_message"):
            _say(problem.format_message() or "no command; try gyro --help")
            code = EXIT_MENDABLE
        else:
            raise
    code = code if isinstance(code, int) else 0
    if code == EXIT_INTERRUPTED:
        _say("interrupted")
    sys.exit(code)


if __name__ == "__main__":
    main()
