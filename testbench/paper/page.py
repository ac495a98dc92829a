"""`gyro report paper`: one HTML page: figures first, then tables; each figure as files beside it.

    opening   waterfall of the phase budget, the cases beside the paper, what is predicted
    figures   the paper's, redrawn from what its text says of them, and what the project adds
    tables    the judge's rows, calibration, points, laws, noise, temperature

Source    docs/paper.md
"""

import json
from pathlib import Path

from testbench.console import figure_files, report
from testbench.console.figure_files import Picture
from testbench.judge import judge, numbers
from testbench.judge.number_verdict import NOT_COMPUTED
from testbench.paper import closed_form, judge_table, page_tables, phase_laws, simulated, temperature
from testbench.paper.calibration import calibrations
from testbench.paper.calibration.calibrate_phases import NODES
from testbench.paper.loop import loop_page, loop_pictures
from testbench.paper.measure import measure_scale, nonlinearity
from testbench.paper.pictures import boards, drive, opening, performance, sense
from testbench.run.budget import budget
from testbench.storage.files import atomic_outputs, write_text

FOLDER = "figures"  # beside the page
DRIVE = (
    "What to see: compensation of the drive phases (cases 1 to 2, 2 to 3) changes the scale factor by at most 0.25 %. "
    "The model's scale factor falls with temperature because of the diodes' threshold voltage. The paper's board "
    "compensates for this."
)
SENSE = (
    "What to see: compensation of ye1 (case 3 to 4) removes the factor 1/cos(ye1 + xe2') from the scale factor, raises "
    "the bandwidth by 0.5 Hz and removes the nonlinearity. Compensation of ye2 (case 4 to 5) changes only the "
    "zero-rate output, and only slightly."
)
COMPARISON_CAPTION = (
    "What to see: marks are values of the model with one sigma. Crosses are the paper's means of cases 1 to 3. "
    "The first table says which of these values are inputs, fitted or predicted."
)
INFLUENCE = (
    "What to see: how much each latency, pole, word length and gain changes each observable, computed with the linear "
    "loops. A table below lists the strongest influences."
)


def printed_phases():
    """{node: (deg, sigma)} of the four uncompensated phases that the paper prints."""
    phase_numbers = [n for n in numbers.numbers() if n.symbol[4:] in NODES and len(n.values) == 1 and n.values[0] > 0.1]
    return {n.symbol[4:]: (n.values[0], n.sigma) for n in phase_numbers}


def explain_case_nonlinearity(config, points, calibration):
    """{(case, temperature): (`nonlinearity.Explained`, sigma)} of cases 1 to 3."""
    ceiling_v = config.firmware.quadrature_ceiling_v
    out = {}
    for (case, temp), p in points.items():
        if case in ("1", "2", "3"):
            words = calibration["cases_deg"][case]
            residual_phases_deg = simulated.residual_phases_deg(config, calibration, words, temp)
            rates = measure_scale.RATES_DPS
            explanation = nonlinearity.explain_nonlinearity(
                rates, p["scale_words"], p["quadrature_v_of_rate"], ceiling_v, residual_phases_deg
            )
            out[case, temp] = explanation, p.get("nonlinearity_sigma_ppm") or 0.0
    return dict(sorted(out.items()))


def _missing_numbers_sentences(rows, points):
    """What a study did not compute, or "" if it computed everything."""
    missing = [k for k, row in enumerate(rows) if row.basis.startswith(NOT_COMPUTED)]
    if not missing:
        return ""
    closed_form_rows = judge.rows(closed_form.rounded_default())
    judged = sum(not closed_form_rows[k].basis.startswith(NOT_COMPUTED) for k in missing)
    cases, temps = (", ".join(f"{value:g}" for value in sorted(set(column))) for column in
                    ([int(case) for case, _ in points], [temp for _, temp in points]))  # fmt: skip
    free = sum(row.rule.role == "free" and not row.basis.startswith(NOT_COMPUTED) for row in rows)
    return (
        f"This study has only cases {cases} at {temps} degC: {len(missing)} of {len(rows)} numbers were not computed. "
        f"`gyro report numbers` judges {judged} of these for the default board, without a simulation. Of the numbers "
        f"that are neither inputs nor fitted, {free} were computed, and none agreed with the paper."
    )


def prediction_sentence(rows, points):
    """What is predicted; if nothing is, what was not computed of a study with `points`."""
    names = dict.fromkeys(judge_table.short(row.number.quantity) for row in rows if row.verdict == "predicted")
    if not names:
        sentence = "No number that is neither an input nor fitted agreed with the paper."
        return _missing_numbers_sentences(rows, points) or sentence
    return f"These numbers are neither inputs nor fitted, and agree with the paper: {'; '.join(names)}."


def _cases(points, names, *rest):
    return opening.cases(points, [c for c in names if any(k[0] == c for k in points)], *rest)


def pictures(study, parts):
    """Yield each `Picture` in the order of the page."""
    config, last, points, laws, records = study.config, parts["last"], parts["points"], parts["laws"], parts["records"]
    means, three = judge_table.paper_means() if config.is_paper_board else {}, ("1", "2", "3")
    phases = printed_phases() if config.is_paper_board else {}
    yield opening.waterfall(budget(closed_form.bare(config), 25.0), phases)
    title = "Five cases compared with the paper"
    yield _cases(points, ("1", "2", "3", "4", "5"), means, title, COMPARISON_CAPTION, "cases_beside_the_paper")
    yield drive.drive_errors(laws["drive"], config)
    if records:
        yield drive.phase_record(records, ("xe1", "xe2"), 3)
    yield _cases(points, three, means, "Fig. 4  Cases 1 to 3 over temperature", DRIVE, "fig_4_cases_1_to_3")
    yield sense.transfer_functions(last)
    yield sense.scale_by_phases(laws["sense"])
    yield sense.sense_errors(last)
    if records:
        yield drive.phase_record(records, ("ye1", "ye2"), 7)
    yield _cases(points, ("3", "4", "5"), {}, "Fig. 8  Cases 3 to 5 over temperature", SENSE, "fig_8_cases_3_to_5")
    yield sense.response(points, last)
    yield performance.scale_residuals(points, measure_scale.RATES_DPS)
    if parts["explained"]:
        yield performance.nonlinearity(parts["explained"], parts["wide"], means.get("nonlinearity_ppm", {}))
    if any(p.get("tau_s") for p in points.values()):
        yield performance.allan(points, means)
    if "noise" in laws:
        yield boards.noise_shares(laws["noise"], study.noise_lengths_s())
    if parts["boards"]:
        yield boards.residuals(parts["boards"])
    grid = temperature.GRID_DEGC
    yield boards.phase_drift(grid, temperature.phases(config, grid), temperature.phases(config, (25.0,)))
    yield Picture("influence", INFLUENCE, loop_pictures.influence(parts["influence"]))


def tables(study, parts, compared):
    """[`Table`, ...] in the order of the page."""
    config, one, points, laws = study.config, parts["calibration"], parts["points"], parts["laws"]
    out = [*judge_table.tables(compared), page_tables.calibration_table(one), page_tables.cases_table(one)]
    if parts["boards"]:
        out.append(page_tables.boards_table(parts["boards"]))
    out += [page_tables.points_table(points), page_tables.law_table(laws["scale"])]
    if parts["explained"]:
        out.append(page_tables.rail_table(parts["explained"], parts["wide"]))
    if "noise" in laws:
        out.append(page_tables.noise_table(laws["noise"], phase_laws.derived_noise(parts["last"])))
    out += [t for t in (page_tables.changes_table(points),) if t]
    configs = {
        case: calibrations.case_config(config, one["cases_deg"][case]) for case in sorted({c for c, _ in points})
    }
    out.append(page_tables.response_table(page_tables.response_difference(points, configs)))
    out.append(page_tables.temperature_table(config))
    return [*out, *loop_page.sensitivity_tables(parts["influence"]), page_tables.misprint_table(config)]


def stage_results(study):
    """{name: what a stage of a `paper_study.Study` has found, or what follows from it}."""
    one, points, laws = study.calibration(), study.points(), study.laws()
    last = calibrations.case_config(study.config, one["cases_deg"]["5"])
    return {
        "calibration": one,
        "points": points,
        "laws": laws,
        "last": last,
        "boards": study.boards(),
        "records": study.record(),
        "influence": study.influence(last),
        "explained": explain_case_nonlinearity(study.config, points, one),
        "wide": {case: rows["nonlinearity_ppm"] for case, rows in laws["rail"].items()},
    }


def write(study, path=None):
    """Write the page of a `paper_study.Study` and its figures; returns (path, verdicts)."""
    parts = stage_results(study)
    model = simulated.model(study.config, parts["calibration"], parts["points"], parts["records"])
    compared = judge.rows(model)
    notes = [
        prediction_sentence(compared, parts["points"]),
        judge_table.sentence(compared),
        "The paper: Phase error analysis for MEMS gyroscopes operational modes based on force-to-rebalance rate "
        "measurement mode, doi:10.1038/s41378-025-01144-6. Its tables, pictures and raw data are not available. "
        "The figures here are redrawn from the descriptions in its text.",
        "Two assumptions are fitted to the paper's phases and are not documented facts: references leave on the 1 MHz "
        "grid, and the sense path has one extra frame of 1 us. We searched the possible latencies and kept those "
        "nearest the paper's xe1 and ye1.",
    ]
    path = Path(path or study.directory / "paper.html")
    with atomic_outputs():
        _write_files(study, path, parts, model, compared, notes)
    return path, judge_table.counts(compared)


def _write_files(study, path, parts, model, compared, notes):
    write_text(path.parent / "judged.json", json.dumps(simulated.as_json(model), indent=1, sort_keys=True) + "\n")
    picture_html = []
    for picture in pictures(study, parts):
        files, png = figure_files.write(picture, path.parent / FOLDER)
        links = [(kind.upper(), f"{FOLDER}/{file.name}") for kind, file in files.items()]
        picture_html.append(report.picture_html(png, picture.caption, links))
    head = report.head_html("The paper's experiments on the virtual gyroscope", notes)
    write_text(
        path,
        report.page_html(
            "The paper's experiments", [*head, *picture_html, *report.tables_html(tables(study, parts, compared))]
        ),
    )
