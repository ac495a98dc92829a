"""`gyro calibrate`, `gyro characterise`, `gyro report paper`: arguments and what is printed; no computing.

Source  docs/paper.md
"""

from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from testbench.console.options import ConfigFile, Json, Sets, load, overrides, takes
from testbench.console.progress import Progress
from testbench.console.show import print_json, print_list, print_reference, print_tables

reports = typer.Typer(
    name="report", no_args_is_help=True, pretty_exceptions_enable=False, help="Write pages about many runs."
)


def calibrate(
    config: ConfigFile = None,
    sets: Sets = None,
    boards: Annotated[
        int, typer.Option(min=1, max=1000, help="Number of random boards; 1 without --seed: the configured board.")
    ] = 1,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed for the boards' parts and noise.")] = None,
    temperature_degc: Annotated[float, typer.Option("--temperature-degc", help="Oven temperature (degC).")] = 25.0,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Write cases 1 to 5 to this folder, as TOML.")
    ] = None,
    engine: Annotated[
        str | None, typer.Option(help="frame: exact, the default; baseband: fast, phases within 3 mdeg.")
    ] = None,
    as_json: Json = False,
):
    """Calibrate the four phases as the paper does, from reset values, with signals that a laboratory can measure."""
    checked = load(config, overrides(sets))
    from testbench.errors import ConfigError

    with Progress(quiet=as_json) as progress:
        from testbench.paper.calibration import calibrations

        if engine not in (None, "frame", "baseband"):
            raise ConfigError(f"--engine = {engine!r}: the calibration needs frame or baseband")
        results = calibrations.many(checked, boards, seed, temperature_degc, boards == 1, progress, engine)
        paths = calibrations.write_cases(results, checked, seed, out) if out else []
    summary = calibrations.summary(results)
    if as_json:
        print_json({"boards": results, "summary": summary, "seed": seed, "files": [str(p) for p in paths]})
        return
    from testbench.paper import page_tables

    tables = [page_tables.calibration_table(results[0]), page_tables.cases_table(results[0])] if boards == 1 else []
    print_tables([*tables, page_tables.boards_table(results, boards == 1 and seed is None)])
    print_list("Written:", [str(p) for p in paths])


def characterise(
    config: ConfigFile = None,
    sets: Sets = None,
    temperature_degc: Annotated[float, typer.Option("--temperature-degc", help="Oven temperature (degC).")] = 25.0,
    seconds: Annotated[float, typer.Option(min=10.0, max=36000.0, help="Length of the record at rest (s).")] = 120.0,
    as_json: Json = False,
):
    """Measure scale factor on 22 rates, bias, V_q, Allan deviation, bandwidth, drive frequency and drive voltage."""
    checked = load(config, overrides(sets))
    with Progress(quiet=as_json) as progress:
        from testbench.paper.measure import characterise as measure

        steps = iter(range(10))
        results = measure.characterise(
            checked,
            lambda text: progress(text, next(steps), 5),
            measure.choose_engine(checked),
            seconds,
            temperature_degc,
        )
    if as_json:
        print_json(results)
        return
    from testbench.console.text_table import Table
    from testbench.paper import judge_table, page_tables

    rows = [
        (head, judge_table.format_value(results.get(name), digits)) for name, head, digits in page_tables.POINT_COLUMNS
    ]
    print_tables([Table(f"At {temperature_degc:g} degC", ("quantity", "value"), rows)])


class PaperOptions(NamedTuple):
    """Options of `gyro report paper`."""

    config: ConfigFile = None
    sets: Sets = None
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the study and its page.")] = Path(
        "out/paper"
    )
    small: Annotated[
        bool, typer.Option("--small", help="Cases 1 and 5 at 25 degC, short records, no random boards; 1 to 7 minutes.")
    ] = False
    boards: Annotated[int | None, typer.Option(min=0, max=1000, help="Number of random boards to calibrate (20).")] = (
        None
    )
    rest_s: Annotated[
        float | None, typer.Option(min=10.0, help="Length of the record at rest at each point (600 s).")
    ] = None
    record_s: Annotated[
        float | None, typer.Option(min=0.0, help="Length of the phase record (7200 s; 0: no record).")
    ] = None
    workers: Annotated[int | None, typer.Option(min=0, help="Worker processes; 0: only this one.")] = None
    as_json: Json = False


@reports.command()
@takes(PaperOptions)
def paper(o):
    """Repeat the paper's experiments and compare the results with its numbers on one page.

    The experiments are the calibration, and five cases at three temperatures. The same command continues after an
    interruption.
    """
    checked = load(o.config, overrides(o.sets))
    with Progress(quiet=o.as_json) as progress:
        from testbench.paper import page, paper_study

        size = paper_study.SMALL if o.small else paper_study.FULL
        size_overrides = {"boards": o.boards, "rest_s": o.rest_s, "record_s": o.record_s}
        size = size._replace(**{k: v for k, v in size_overrides.items() if v is not None})
        job = paper_study.Study(checked, o.out, size, workers=o.workers, progress=progress)
        with job.lock_folder():
            job.run()
            path, verdicts = page.write(job)
    if o.as_json:
        print_json({"page": str(path), "verdicts": verdicts, "seconds": job.stages.seconds})
        return
    print_list("", [f"{k}: {v} numbers" for k, v in verdicts.items()])
    print_list("Written:", [str(path)])


@reports.command()
def numbers(as_json: Json = False):
    """Compare each number of the paper with the closed-form value of the default board."""
    from testbench.judge import judge
    from testbench.paper import closed_form, judge_table

    rows = judge.rows(closed_form.rounded_default())
    if not as_json:
        print_list("", [judge_table.sentence(rows)])
    print_reference(judge_table.tables(rows), as_json)


def add(app):
    """Put the commands into the command line."""
    app.command()(calibrate)
    app.command()(characterise)
    app.add_typer(reports)
