"""`gyro campaign`: arguments and what is printed; no computing. `testbench.commands.main` adds this app to its own.

Standard output holds the result, standard error the progress. Exit codes: 0 every point is finished, 2 something the
user can mend (points that failed among it), 130 interrupted.
Source  docs/campaigns.md
"""

import math
import os
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from testbench.console.options import Json, takes
from testbench.console.show import print_json, print_tables
from testbench.console.text_table import Table

app = typer.Typer(
    name="campaign",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Run sweeps and Monte Carlo studies from a plan, resumable, on this machine or on a Dask cluster.",
)

StorePath = Annotated[Path, typer.Argument(metavar="STORE", help="Folder of a campaign's results.")]
Name = Annotated[
    str | None, typer.Argument(metavar="[PLAN]", help="Name of a plan; required only if the store has several.")
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Replace one value in the section set of the plan; may be repeated."
    ),
]
Engines = Annotated[
    list[str] | None,
    typer.Option("--engine", metavar="NAME=PLACE", help="Add an engine, at package.module:OBJECT; may be repeated."),
]
EXIT_FAILED = 2
MOST_PRINTED_FAILURES = 5


class RunOptions(NamedTuple):
    """Options of `gyro campaign run`."""

    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="The plan.")]
    out: Annotated[
        Path, typer.Option("--out", metavar="STORE", help="Folder of the results; may contain those of other plans.")
    ]
    sets: Sets = None
    engine_options: Engines = None
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0: only this one; default: one per core.")
    ] = None
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, such as tls://10.0.0.1:8786.")
    ] = None
    unencrypted_scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="The same, unencrypted: anyone who reaches it can run code as you."),
    ] = None
    cluster: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Start a Dask cluster of N workers on this machine.")
    ] = None
    as_json: Json = False


@app.command()
@takes(RunOptions)
def run(o):
    """Run the missing points of a plan and write its results. The same command continues after an interruption."""
    from testbench.errors import ConfigError

    if sum(choice is not None for choice in (o.workers, o.scheduler, o.unencrypted_scheduler, o.cluster)) > 1:
        raise ConfigError("--workers, --scheduler, --unencrypted-scheduler and --cluster: give only one of them")
    from testbench.campaign import execute
    from testbench.campaign.campaign_progress import Progress
    from testbench.campaign.plan.plan import read

    campaign_plan = read(o.plan, o.sets or (), o.engine_options or ())
    try:
        report = execute.run(campaign_plan, o.out, _executor(o), Progress(quiet=o.as_json))
    except KeyboardInterrupt:
        typer.echo("gyro: finished points are kept; run the same command again to continue", err=True)
        raise
    _print_report(report, o.as_json)
    if report.failures:
        raise typer.Exit(EXIT_FAILED)


def _executor(o):
    if (o.scheduler, o.unencrypted_scheduler, o.cluster) == (None, None, None):
        return local(o.workers)
    from testbench.campaign.cluster import Cluster

    address = o.unencrypted_scheduler if o.scheduler is None else o.scheduler
    return Cluster(address, o.cluster or 0, o.unencrypted_scheduler is not None)


def local(workers):
    """Executor of so many processes on this machine; 0: this one, None: one to a core."""
    from testbench.campaign.pool import InProcessExecutor, Pool

    if workers == 0:
        return InProcessExecutor()
    return Pool(workers or os.cpu_count() or 1)


def _print_report(report, as_json):
    if as_json:
        rejected, failures = (
            [{"point": address, "error": text} for address, text in point_errors]
            for point_errors in (report.rejected, report.failures)
        )
        files = [str(path) for path in report.files]
        print_json({**report._asdict(), "rejected": rejected, "failures": failures, "files": files})
        return
    typer.echo(f"{report.name}: {report.points} points, {report.reused} finished earlier, {report.done} in this run")
    if report.failures:
        typer.echo(f"{len(report.failures)} points failed; run the same command again to retry them:")
    for address, text in report.failures[:MOST_PRINTED_FAILURES]:
        typer.echo(f"  {address[:12]}  {text}")
    if len(report.failures) > MOST_PRINTED_FAILURES:
        typer.echo(f"  and {len(report.failures) - MOST_PRINTED_FAILURES} more")
    for path in report.files:
        typer.echo(f"  {path}")


@app.command()
def check(
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="The plan.")],
    sets: Sets = None,
    engine_options: Engines = None,
    as_json: Json = False,
):
    """Check every point of a plan, and print its axes and its number of points."""
    from testbench.campaign.plan import plan as plans

    campaign_plan = plans.read(plan, sets or (), engine_options or ())
    points, _ = plans.points(campaign_plan)
    unique = len({point.address for point in points})
    axes = [{"name": a.name, "length": a.length, "parameters": list(a.values)} for a in campaign_plan.axes]
    if as_json:
        print_json({"name": campaign_plan.name, "points": len(points), "different": unique, "axes": axes})
        return
    for axis in axes:
        typer.echo(f"{axis['name']:<16} {axis['length']:>6}  {', '.join(axis['parameters'])}")
    typer.echo(f"{len(points)} points, {unique} of them different")


@app.command()
def status(store: StorePath, as_json: Json = False):
    """Print finished and failed points of every plan in a store, damaged files, and the process that runs there."""
    from testbench.campaign.status import store_status
    from testbench.campaign.store import Store

    results_store = Store.open_folder(store)
    plans, damaged, lines = store_status(results_store)
    busy = results_store.busy()
    if as_json:
        owner = results_store.owner() if busy else ""
        print_json({"busy": busy, "owner": owner, "plans": plans, "damaged": damaged, "journal": lines})
    else:
        _print_status(plans, damaged, lines)
        typer.echo(f"running: {results_store.owner()}" if busy else "no campaign is running in this store")
    if damaged:
        raise typer.Exit(EXIT_FAILED)


def _print_status(plans, damaged, lines):
    for item in plans:
        failed = f", {len(item['failed'])} failed" if item["failed"] else ""
        typer.echo(f"{item['name']:<20} {item['finished']}/{item['points']} points finished{failed}")
        for address, text in item["failed"][:MOST_PRINTED_FAILURES]:
            typer.echo(f"  {address[:12]}  {text}")
    for text in damaged:
        typer.echo(text)
    if lines:
        typer.echo(f"{len(lines)} unreadable lines of journals are ignored; the first: {lines[0]}")


def _only(store, name):
    from testbench.campaign import collect
    from testbench.errors import ConfigError

    names = collect.plan_names(store)
    if name is None and len(names) != 1:
        raise ConfigError(f"{store.path}: holds {len(names)} plans; name one of: {', '.join(names) or 'none'}")
    return name or names[0]


@app.command()
def show(store: StorePath, name: Name = None, as_json: Json = False):
    """Print the axes of a plan, and mean, standard deviation and range of each number over the finished points."""
    from testbench.campaign import collect
    from testbench.campaign.campaign_progress import Running
    from testbench.campaign.store import Store

    results_store = Store.open_folder(store)
    name = _only(results_store, name)
    stored_plan = collect.read_stored_plan(results_store, name)
    point_data, faults = collect.load(results_store, stored_plan.addresses)
    heads, table = collect.rows(stored_plan, point_data)
    first = 3 + sum(len(a.values) + bool(a.cases) for a in stored_plan.plan.axes)
    numbers = {}
    for k, head in enumerate(heads[first:], first):
        values = [row[k] for row in table if isinstance(row[k], float) and math.isfinite(row[k])]
        running = Running()
        for value in values:
            running.add(value)
        if values:
            numbers[head] = {
                "count": len(values),
                "mean": running.mean,
                "std": running.std,
                "min": min(values),
                "max": max(values),
            }
    axes = [{"name": a.name, "length": a.length, "parameters": list(a.values)} for a in stored_plan.plan.axes]
    finished = sum(row[2] for row in table)
    if as_json:
        print_json({"name": name, "points": len(table), "finished": finished, "axes": axes, "numbers": numbers})
        return _end(faults)
    axis_rows = [(a["name"], str(a["length"]), ", ".join(a["parameters"])) for a in axes]
    lines = [
        (head, str(n["count"]), *(f"{n[key]:.8g}" for key in ("mean", "std", "min", "max")))
        for head, n in numbers.items()
    ]
    title = f"{name}: {finished} of {len(table)} points finished"
    print_tables(
        [
            Table(title, ("axis", "length", "parameters"), axis_rows),
            Table("Numbers", ("name", "points", "mean", "std", "min", "max"), lines, numeric=(1, 2, 3, 4, 5)),
        ]
    )
    _end(faults)


def _end(faults):
    """Say which finished points did not count, one line each; the exit code says that there are some."""
    for text in faults.values():
        typer.echo(f"{text}; gyro campaign run computes it again", err=True)
    if faults:
        raise typer.Exit(EXIT_FAILED)


@app.command(name="collect")
def collect_command(store: StorePath, name: Name = None):
    """Write the results of a plan from its finished points, also if the campaign was interrupted."""
    from testbench.campaign import collect
    from testbench.campaign.store import Store

    results_store = Store.open_folder(store)
    with results_store.hold_lock():
        paths, faults = collect.write(results_store, _only(results_store, name))
    for path in paths:
        typer.echo(path)
    _end(faults)


@app.command()
def table(
    store: StorePath,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.parquet", help="File to write.")],
    name: Name = None,
):
    """Write the table of a plan as Parquet (needs pyarrow)."""
    from testbench.campaign import collect
    from testbench.campaign.store import Store

    results_store = Store.open_folder(store)
    faults = collect.write_parquet(results_store, _only(results_store, name), out)
    typer.echo(out)
    _end(faults)


@app.command()
def rerun(
    store: StorePath,
    point: Annotated[str, typer.Argument(metavar="POINT", help="Address of the point, or its first digits.")],
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="File to write the point to.")] = None,
    engine_options: Engines = None,
    as_json: Json = False,
):
    """Run one finished point again on this machine, and compare it with its file byte for byte."""
    from testbench.campaign.rerun import rerun as rerun_point

    report = rerun_point(store, point, out, engine_options or ())
    if as_json:
        print_json(report._asdict())
    else:
        typer.echo(f"{report.address}  {'identical' if report.identical else 'DIFFERENT'}  {report.bytes} bytes")
        for name in report.differ:
            typer.echo(f"  {name} differs")
    if not report.identical:
        raise typer.Exit(EXIT_FAILED)
