"""`gyro golden loop`: arguments, and what is printed; no computing.

Source  docs/rtl.md
"""

import json
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from testbench.console import options


class LoopOptions(NamedTuple):
    """Options of `gyro golden loop`."""

    rtl: Annotated[Path, typer.Option("--rtl", metavar="DIR", help="Folder of a Verilog design of the firmware.")]
    config: Annotated[
        Path | None,
        typer.Option(
            "--config", "-c", metavar="FILE", help="Scenario from power-on; default: lock, rate steps, a silent ADC."
        ),
    ] = None
    seconds: Annotated[float | None, typer.Option(help="Simulated seconds from power-on.")] = None
    sets: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Key of the configuration.")] = (
        None
    )
    build: Annotated[
        Path | None,
        typer.Option("--build", metavar="DIR", help="Folder for the compiled design; default: a temporary one."),
    ] = None
    top: Annotated[
        str | None, typer.Option("--top", metavar="NAME", help="Your top module, if it has only the pins of the board.")
    ] = None
    files: Annotated[Path | None, typer.Option("--files", metavar="F", help="File that lists its sources.")] = None
    map_path: Annotated[
        Path | None, typer.Option("--map", metavar="TOML", help="File with the names of its ports and of its top.")
    ] = None
    exact: Annotated[bool, typer.Option("--exact", help="Fail at any difference at a pin; measure no behaviour.")] = (
        False
    )
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the waveform and the bundle of a difference."),
    ] = None
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False


@options.takes(LoopOptions)
def loop(o):
    """Close the loop of plant and RTL, and compare every register with the model at every edge of 26 MHz.

    With --top or --map only the pins are compared. A design that differs is then measured at its pins, as a board is.
    """
    from testbench.config import changed
    from testbench.console.progress import Progress
    from testbench.errors import ConfigError
    from testbench.golden import divergence
    from testbench.golden.loop import run

    pins = run.Pins(o.top, o.files, o.map_path, o.exact) if o.top or o.map_path else None
    if pins is None and (o.files or o.exact):
        raise ConfigError("--files, --exact: need --top or --map")
    if o.config is None and any(text.strip().startswith("scenario.") for text in o.sets or ()):
        raise ConfigError("--set scenario: needs --config")
    overrides = options.overrides(o.sets, ("scenario.seconds", o.seconds, "--seconds"))
    chosen = options.load(o.config, overrides)
    if o.config is None:
        story = run.story(run.SECONDS if o.seconds is None else chosen.scenario.seconds)
        chosen = changed(chosen, {f"scenario.{key}": getattr(story.scenario, key) for key in run.STORY_KEYS})
    with Progress(quiet=o.as_json) as progress:
        outcome = run.run(chosen, o.rtl, o.build, progress, pins=pins)
    report = divergence.write(o.out, outcome.difference) if o.out and outcome.difference else None
    if o.as_json:
        package_summary = {"written": str(o.out), "diagnosis": report.cause_entries()} if report else {"written": None}
        typer.echo(json.dumps(outcome.to_dict() | package_summary))
    else:
        typer.echo(outcome.text() + (f"\n{report.why()}package           {o.out}" if report else ""))
    raise typer.Exit(0 if outcome.passed else 1)
