"""`gyro measured`: arguments and what is printed; no computing. `testbench.commands.main` adds this app to its own.

Standard output holds the result, standard error progress and one line per error. Exit codes: 0 done, 2 refused or
something the user can mend, 3 a record that loads but whose firmware is not the model's, 130 interrupted.
Source  docs/measured.md
"""

from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from testbench.console.options import takes
from testbench.errors import ConfigError, one_line

app = typer.Typer(
    name="measured",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Measured data: check a record, replay its firmware, find what the model cannot explain.",
)

RecordPath = Annotated[Path, typer.Argument(metavar="FILE", help="Record: HDF5 file.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
EXIT_REFUSED, EXIT_BLOCKED = 2, 3


def print_json(data):
    from testbench.console.show import print_json

    print_json(data)


def _progress(as_json):
    from testbench.console.progress import Progress

    return Progress(quiet=as_json)


def _difference_json(first):
    return None if first is None else first._asdict()


def _residual_json(residual):
    return {
        "decidable": residual.decidable,
        "why": residual.undecided,
        "frames": residual.frames,
        "compared": list(residual.compared),
        "left_out": residual.left_out,
        "differing": residual.differing,
        "first": _difference_json(residual.first),
        "verdict": residual.verdict,
        "seconds": residual.seconds,
    }


@app.command()
def check(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Record (HDF5), recording of one part, or its column map (TOML).")
    ],
    replay: Annotated[bool, typer.Option(help="Also replay the firmware on the recorded codes (R16).")] = True,
    as_json: Json = False,
):
    """Check a record by rules R01 to R33, or a recording of a part for data quality: one line per finding.

    Exit code 2 if it is refused."""
    from testbench.measured.openers import part_findings, refuse_unreadable
    from testbench.measured.quality.records import adc_codes, dac_range
    from testbench.measured.record import load_record
    from testbench.storage.record import RecordError

    part_quality = part_findings([file])
    if part_quality is not None:
        return _check_part(file, part_quality, as_json)
    refuse_unreadable(file)
    findings, residual, refused, quality = [], None, False, ()
    try:
        with _progress(as_json) as progress:
            loaded = load_record.load(file, replay, progress)
        quality = adc_codes.findings(loaded.record) + dac_range.findings(loaded.record)
        findings = [(str(f), f.level) for f in loaded.findings]
        residual = loaded.residual
    except RecordError as problem:
        findings, refused = [(text, "refused") for text in problem.findings], True
    blocked = any(level == "blocked" for _, level in findings)
    if as_json:
        finding_rows = [{"finding": text, "level": level} for text, level in findings]
        data = {"file": str(file), "accepted": not refused, "findings": finding_rows}
        data |= {"quality": [f.as_json() for f in quality]}
        print_json(data | {"r0": None if residual is None else _residual_json(residual)})
    else:
        for text, level in findings:
            typer.echo(f"{text} ({level})")
        for finding in quality:
            typer.echo(one_line(finding))
        if residual is not None:
            typer.echo(residual.verdict)
        typer.echo(one_line(f"{file}: {'refused' if refused else 'accepted'}"))
    if refused or blocked:
        raise typer.Exit(EXIT_REFUSED if refused else EXIT_BLOCKED)


def _check_part(file, findings, as_json):
    """Print the findings about a recording of a part."""
    refused = any(f.action == "refuse" for f in findings)
    if as_json:
        print_json({"file": str(file), "accepted": not refused, "quality": [f.as_json() for f in findings]})
    else:
        for finding in findings:
            typer.echo(one_line(finding))
        typer.echo(one_line(f"{file}: {'refused' if refused else 'accepted'}"))
    if refused:
        raise typer.Exit(EXIT_REFUSED)


@app.command()
def record(
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Plan of conditions, repeats and roles.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="HDF5 file to write.")],
    envelope: Annotated[
        Path | None, typer.Option(metavar="FILE", help="JSON file for the true values, which the record omits.")
    ] = None,
    plant: Annotated[
        Path | None, typer.Option(metavar="LIB", help="Shared library that replaces the built-in plant.")
    ] = None,
    plant_file: Annotated[Path | None, typer.Option(metavar="FILE", help="Text file that this library reads.")] = None,
    as_json: Json = False,
):
    """Write a measurement record of the simulated board, or of a foreign plant in a shared library."""
    import json

    from testbench.measured.record import produce, schema
    from testbench.measured.record import recording_plan as plans
    from testbench.storage.files import atomic_outputs, write_text
    from testbench.storage.record import write_record

    record_plan = plans.read(plan)
    if plant is not None:
        record_plan = plans.with_plant(record_plan, plant, plant_file or "")
    elif plant_file is not None:
        raise ConfigError("--plant-file: needs --plant, the library that reads it")
    with _progress(as_json) as progress:
        new_record = produce.record(record_plan, progress)
    with atomic_outputs():
        digest = write_record(out, new_record)
        if envelope is not None:
            write_text(envelope, json.dumps(produce.envelope(record_plan), sort_keys=True, indent=1) + "\n")
    frames = schema.frame_count(new_record)
    segments = len(new_record.tables["segments"]["id"].data)
    if as_json:
        print_json({"file": str(out), "frames": frames, "segments": segments, "content_sha256": digest})
        return
    typer.echo(f"{out}  {frames} frames  {segments} segments  {digest[:16]}")
    if new_record.attrs.get("plant_unseen"):
        typer.echo(f"not passed to the plant: {new_record.attrs['plant_unseen']}")


@app.command("import")
def import_(
    files: Annotated[
        list[Path], typer.Argument(metavar="DATA...", help="CSV, Parquet, .npz or .mat, one file per power-on.")
    ],
    columns: Annotated[
        Path | None, typer.Option("--map", metavar="F.toml", help="Required: map that says what each column is.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Required: HDF5 file to write.")
    ] = None,
    as_json: Json = False,
):
    """Make a measurement record from laboratory files; prints what was found and assumed."""
    from testbench.measured.importing import assemble
    from testbench.measured.record import checks
    from testbench.storage.record import RecordError, write_record

    missing = [name for name, value in (("--map", columns), ("--out", out)) if value is None]
    if missing:
        from testbench.measured.openers import WAYS

        raise ConfigError(f"{missing[0]}: is missing; {WAYS}")
    import_result = assemble.import_files(files, columns)
    findings = checks.check(import_result.record)
    refused = [str(f) for f in findings if f.level == "refused"]
    if refused:
        raise RecordError(columns, refused)
    digest = write_record(out, import_result.record)
    if as_json:
        rows = [{"finding": str(f), "level": f.level} for f in findings]
        return print_json({"file": str(out), "content_sha256": digest, "lines": import_result.lines, "findings": rows})
    for text in (*import_result.lines, *(f"{f} ({f.level})" for f in findings)):
        typer.echo(text)
    typer.echo(f"{out}  {digest[:16]}")


@app.command()
def convert(file: RecordPath, out: Annotated[Path, typer.Argument(metavar="FOLDER", help="New folder to write.")]):
    """Write a record as tables for other programs: a Parquet file per sample rate, a CSV file per slow log."""
    from testbench.measured.record import load_record, record_tables

    record_tables.write(out, load_record.load(file, replay=False).record)
    typer.echo(out)


@app.command()
def residuals(
    file: RecordPath,
    kind: Annotated[
        str, typer.Option(help="R1: plant driven by the recorded words; R2: simulated closed loop.")
    ] = "R2",
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change one value of the model, such as plant.qx=190000."),
    ] = None,
    as_json: Json = False,
):
    """Compare recorded and simulated data per condition and observable, with the noise of the repeats."""
    from testbench import config
    from testbench.console.text_table import Table
    from testbench.measured.importing import firmware_words
    from testbench.measured.record import check_tables, load_record
    from testbench.measured.residual import residuals as residual

    if kind not in ("R1", "R2"):
        raise ConfigError(f"--kind {kind}: expected R1 or R2")
    with _progress(as_json) as progress:
        record = firmware_words.complete_record(load_record.load(file, replay=False).record)[0]
        model = check_tables.stated_config(record)
        overrides = [config.parse_set(text) for text in sets or ()]
        if overrides:
            model = config.changed(model, {item.path: item.value for item in overrides})
        try:
            study = residual.study_residuals(record, kind, model, progress=progress)
        except ValueError as problem:
            raise ConfigError(problem) from None
    if as_json:
        rows = [row._asdict() for row in study.rows]
        print_json({"kind": kind, "engine": study.engine, "exact_words": study.exact_words, "rows": rows})
        return
    heads = ("condition", "role", "observable", "unit", "noise rms", "residual rms", "chi2 / bins")
    rows = [
        (r.group, r.role, r.observable, r.unit, f"{r.floor:.3g}", f"{r.rms:.3g}", f"{r.chi2_per_bin:.3g}")
        for r in study.rows
    ]
    noise = f"{study.dof} deviation{'s' if study.dof != 1 else ''}"
    note = f"noise from {noise} between repeats; {study.engine} engine"
    from testbench.console.show import print_tables

    print_tables([Table(f"{kind}: recorded minus predicted", heads, rows, numeric=(4, 5, 6), note=note)])


@app.command()
def calibrate(
    file: RecordPath,
    starts: Annotated[int, typer.Option(min=1, help="Number of starting points; their fits must agree.")] = 2,
    as_json: Json = False,
):
    """Fit the parameters of the record's priors to the open-loop residual of the plant, and check convergence."""
    from testbench.console.show import print_tables
    from testbench.console.text_table import Table
    from testbench.measured.importing import firmware_words
    from testbench.measured.record import load_record
    from testbench.measured.residual import calibrate_residual as calibration

    with _progress(as_json) as progress:
        loaded = load_record.load(file, progress=progress)
        if loaded.is_blocked:
            raise ConfigError(f"{file}: {loaded.residual.verdict}; physics waits for an override (R16)")
        try:
            calibration_result = calibration.calibrate(
                firmware_words.complete_record(loaded.record)[0], starts, progress=progress
            )
        except ValueError as problem:
            raise ConfigError(problem) from None
    heldout_pairs = [
        (a, b) for a, b in zip(calibration_result.before.rows, calibration_result.after.rows) if a.role == "validate"
    ]
    if as_json:
        print_json(
            {
                "values": calibration_result.values,
                "sd": calibration_result.sd,
                "converged": calibration_result.is_converged,
                "decrement": calibration_result.decrement,
                "costs": list(calibration_result.costs),
                "at_bound": list(calibration_result.at_bound),
                "directions": [d._asdict() for d in calibration_result.directions],
                "evaluations": calibration_result.evaluations,
                "heldout": [
                    {"group": a.group, "observable": a.observable, "unit": a.unit, "floor": a.floor}
                    | {"uncalibrated": a.rms, "calibrated": b.rms, "chi2_per_bin": b.chi2_per_bin}
                    for a, b in heldout_pairs
                ],
            }
        )
        return
    rows = [
        (
            p.key,
            p.unit,
            f"{p.mean:.9g}",
            f"{calibration_result.values[p.key]:.9g}",
            f"{calibration_result.sd[p.key]:.2g}",
        )
        for p in calibration_result.parameters
    ]
    tables = [Table("Parameters", ("parameter", "unit", "prior", "fitted", "sd"), rows, numeric=(2, 3, 4))]
    rows = [
        (a.group, a.observable, a.unit, f"{b.floor:.3g}", f"{a.rms:.3g}", f"{b.rms:.3g}", f"{b.chi2_per_bin:.3g}")
        for a, b in heldout_pairs
    ]
    heads = ("condition", "observable", "unit", "noise rms", "uncalibrated rms", "calibrated rms", "chi2 / bins")
    if rows:
        tables.append(Table("Held out", heads, rows, numeric=(3, 4, 5, 6)))
    print_tables(tables)
    typer.echo(
        ("converged" if calibration_result.is_converged else "NOT converged")
        + f": a further step would lower the cost by {calibration_result.decrement:.2g}"
    )
    typer.echo(f"cost of the fit from each start: {', '.join(f'{cost:.4g}' for cost in calibration_result.costs)}")
    for direction in calibration_result.directions:
        information_source = "only the prior" if direction.eigenvalue < calibration.UNSEEN else "the data"
        text = f"determined by {information_source}: {direction.words}"
        typer.echo(f"{text}  (information of the data {direction.eigenvalue:.2g} times that of the prior)")


class TraceOptions(NamedTuple):
    """Arguments and options of `gyro measured trace`."""

    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="A record, or recordings of one part; a column map (TOML) may take the place of each.",
        ),
    ]
    report: Annotated[Path | None, typer.Option(metavar="OUT.html", help="HTML page to write.")] = None
    json_file: Annotated[Path | None, typer.Option("--json", metavar="OUT.json", help="JSON result to write.")] = None
    checkpoint: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder for finished work; an interrupted trace continues from it."),
    ] = None
    alpha: Annotated[
        float | None,
        typer.Option(min=1e-4, max=0.2, help="Probability of a false alarm; default 0.002, for a part 0.02."),
    ] = None
    looks: Annotated[int, typer.Option(min=1, help="Number of traces like this one; every p is corrected for it.")] = 1
    seed: Annotated[int, typer.Option(min=0, help="Seed of null draws and bootstraps.")] = 0
    most: Annotated[
        int | None, typer.Option("--max-laws", min=1, max=6, help="Largest number of laws in one explanation.")
    ] = None
    option: Annotated[
        list[str] | None, typer.Option("--option", metavar="KEY=VALUE", help="Option for reading the files.")
    ] = None
    priors: Annotated[
        str | None, typer.Option(metavar="sheet|FILE", help="Tolerances of parameters without a prior in the record.")
    ] = None


def _pairs(option):
    """{key: value} of `--option`."""
    out = {}
    for text in option or ():
        key, equals, value = text.partition("=")
        if not key or not equals:
            raise ConfigError(f"--option {text}: expected KEY=VALUE")
        out[key] = value
    return out


@app.command()
@takes(TraceOptions)
def trace(o):
    """Find the effect that explains the residual of the model, and report the error on held-out data."""
    from testbench.measured import trace_recording
    from testbench.measured.closed_loop import loop_trace
    from testbench.measured.exam import exam, part_page
    from testbench.measured.models.part_problem import PartProblem
    from testbench.measured.openers import open_problem, refuse_singular_data
    from testbench.tracing import trace_report as page
    from testbench.tracing.figures import all_figures
    from testbench.tracing.trace import Options

    opener_options = _pairs(o.option) | ({"priors": o.priors} if o.priors else {})
    with _progress(False) as progress, refuse_singular_data(o.files):
        part_report, name = trace_recording.trace_table(o.files, opener_options), "a table of numbers"
        problem = None
        if not part_report:
            problem = open_problem(o.files, opener_options)
            part = isinstance(problem, PartProblem)
            most = o.most or (problem.most_laws if part else Options.max_laws)
            alpha = o.alpha or (exam.QUICK.alpha if part else Options.alpha)
            options = Options(alpha, o.looks, seed=o.seed, max_laws=most)
            part_report, name = trace_recording.trace_problem(problem, options, progress), problem.name
        if part_report:
            page_text = (
                part_page.page(f"Trace of {name}", trace_recording.report_section("Verdict", *part_report))
                if o.report
                else ""
            )
            _write_text_files({o.json_file: trace_recording.text(part_report[0]), o.report: page_text})
            _print_trace(part_report[0])
            if part_report[0]["verdict"] == "candidate" and not (problem.heldout_independent or problem.takes_one_file):
                typer.echo("next step: add a second recording: gyro measured trace FILE1 FILE2")
            return None
        tracer, trace_result = loop_trace.run(problem, options, progress, o.checkpoint)
    _write_text_files(
        {o.json_file: trace_result.text(), o.report: page.html(trace_result, all_figures(tracer)) if o.report else ""}
    )
    for text in problem.warnings:
        typer.echo(f"{text} (warned)")
    return _print_trace(vars(trace_result))


def _write_text_files(texts):
    """Write {path: text} together; a path that is None was not given."""
    from testbench.storage.files import atomic_outputs, write_text

    with atomic_outputs():
        for path, text in texts.items():
            if path is not None:
                write_text(path, text)


def _print_trace(trace_data):
    """Quality, verdict, effects and held-out errors of a result, by the keys of its JSON."""
    from testbench.console.show import print_tables
    from testbench.console.text_table import Table
    from testbench.measured.exam.part_page import segment_words
    from testbench.measured.quality.finding import from_json

    for finding in trace_data.get("quality", ()):
        typer.echo(one_line(from_json(finding)))
    typer.echo(f"{trace_data['verdict']}: {trace_data['sentence']}")
    rows = [
        (e["law"], e["port"], f"{e['value']:.6g}", f"{e['sd']:.2g}", e["unit"], f"{e['d']:.1f}", e["status"])
        for e in trace_data["effects"]
    ]
    heads = ("law", "port", "value", "sd", "unit", "d", "status")
    tables, rivals = [Table("Effects", heads, rows, numeric=(2, 3, 5))] if rows else [], []
    for e in trace_data["effects"]:
        if e.get("rivals"):
            rivals.append(f"{e['law']}: cannot be distinguished from: {', '.join(e['rivals'])}")
    rows = [
        (segment_words(name), h["unit"], "" if h["floor"] is None else f"{h['floor']:.3g}", f"{h['before']:.4g}")
        + (f"{h['after_one_law']:.4g}", f"{h['after']:.4g}")
        for name, h in trace_data["heldout"].items()
    ]
    heads = ("held out", "unit", "noise rms", "before", "after one law", "after")
    if rows:
        tables.append(Table("Error on held-out data", heads, rows, numeric=(2, 3, 4, 5)))
    if tables:
        print_tables(tables)
    for text in rivals:
        typer.echo(text)
    for cause in trace_data.get("causes", ())[1:]:
        sizes = ", ".join(f"{e['law']} {e['value']:.3g} {e['unit']}" for e in cause["effects"])
        typer.echo(f"alternative: {sizes} (chi2 {cause['chi2']:+.1f})")
    for row in trace_data.get("unphysical", ()):
        typer.echo(f"physically impossible: {row['why']} (chi2 {row['chi2']:.4g})")
    for row in trace_data.get("next_experiment", ())[: trace_data["verdict"] != "named"]:
        typer.echo(f"next experiment: {row['words']}")
        if row["text"]:
            typer.echo(row["text"])
