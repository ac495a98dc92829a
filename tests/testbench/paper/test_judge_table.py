"""Tables of the judge's rows; page, trace and document (docs/paper.md) take the same verdicts."""

import json
import re
import sys
from pathlib import Path

import pytest

from testbench.config import Config
from testbench.judge import judge, numbers
from testbench.judge.number_verdict import NOT_COMPARABLE, NOT_COMPUTED, ROLES, VERDICTS, Value
from testbench.measured.parts import paper
from testbench.paper import closed_form, judge_table, page, page_tables, simulated
from testbench.paper.calibration.calibrate_phases import FACTOR, NODES
from testbench.run.budget import budget

ROOT = Path(__file__).resolve().parents[3]
sys.path.append(str(ROOT / "docs"))

import pages  # noqa: E402


@pytest.fixture(scope="module")
def rows():
    return judge.rows(closed_form.default())


def verdicts(rows):
    return {(r.number.key, r.number.symbol): (r.rule.role, r.verdict) for r in rows}


def study_of(model):
    """A study that found what a model says: (calibration, points)."""
    known = budget(Config())
    loop = known.node_deg() | known.loop_deg()
    found = {(c, t): {name: v.value for name, v in values.items()} for (c, t), values in model.points.items()}
    calibration = {
        "found_deg": {n: loop[n] for n in NODES},
        "found_uncertainty_deg": dict.fromkeys(NODES, 1e-9 * FACTOR),
        "residual_deg": dict.fromkeys(NODES, 0.0003),
        "uncertainty_deg": dict.fromkeys(NODES, 1e-9),
    }
    return calibration, found


def test_a_study_and_the_closed_form_are_judged_alike(rows):
    """Where both have a value, role and verdict are the same; a study reads xe2 and ye2 through the loop."""
    calibration, found = study_of(closed_form.default())
    model = simulated.model(Config(), calibration, found, {})
    node = budget(Config()).node_deg()
    for n in NODES:
        assert model.node_deg[n].value == pytest.approx(node[n], abs=1e-9), "node phase, whatever was read"
    # scatter between cases would be one of seeds
    still = {key: {name: Value(v.value) for name, v in p.items()} for key, p in model.points.items()}
    judged = verdicts(judge.rows(model._replace(points=still)))
    want = verdicts(rows)
    assert judged.keys() == want.keys()
    assert judged == want


def test_the_simulated_study_and_the_closed_form_agree_row_by_row(rows):
    """Values that a study of the default board has left: role and verdict are the same wherever both have a value."""
    kept = json.loads((ROOT / "docs" / "results" / "paper_judged.json").read_text())
    found = judge.rows(simulated.from_json(kept, Config()))
    both = [(a, b) for a, b in zip(rows, found, strict=True) if NOT_COMPUTED not in a.basis + b.basis]
    assert [(a.number.key, a.rule.role, a.verdict) for a, _ in both] == [
        (b.number.key, b.rule.role, b.verdict) for _, b in both
    ]
    assert len(both) > 60
    again = simulated.as_json(simulated.from_json(kept, Config()))
    assert json.loads(json.dumps(again)) == kept


def test_the_trace_says_what_the_judge_says(rows):
    data, _ = paper.report([numbers.PATHS[0]], {})
    listed = [(q["name"], q["case"], q["temperature"], q["role"], q["verdict"]) for q in data["questions"]]
    assert listed == [(*r.number.key, r.rule.role, r.verdict) for r in rows]
    assert data["effects"] == []
    assert judge_table.sentence(rows) in data["sentence"]
    with_rivals = [q for q in data["questions"] if q["rivals"]]
    assert len(with_rivals) >= 16
    assert all(r["predicts"] and r["experiment"] for q in with_rivals for r in q["rivals"])
    assert all(len(q["rivals"]) >= 2 for q in with_rivals)


def test_a_table_has_a_row_for_every_number_and_says_what_it_rests_on(rows):
    table, notes = judge_table.tables(rows)
    assert len(table.rows) == len(rows) == len(numbers.numbers())
    assert {cells[-2] for cells in table.rows} == set(VERDICTS)
    text = dict(notes.rows)
    for r, cells in zip(rows, table.rows):
        said = " ".join(text[mark] for mark in re.findall(r"\(\d+\)", cells[-1]))
        assert r.basis in said
        if r.rule.role in ("fitted", "free"):
            assert all(key in said for key in r.rule.rests_on)
    assert sum(judge_table.counts(rows).values()) == len(rows)


def test_the_means_for_the_pictures():
    means = judge_table.paper_means()
    assert {t: value for t, (value, _) in means["quadrature_v"].items()} == {-20.0: 4.0469, 25.0: 4.5247, 50.0: 4.7182}
    assert means["bias_dps"][50.0][0] == 0.4502
    # three cases of a standard deviation of 0.0078 V
    assert means["quadrature_v"][25.0][1] == pytest.approx(0.0078 / 3**0.5, rel=1e-4)


def test_a_study_of_two_cases_has_no_mean():
    calibration, found = study_of(closed_form.default())
    small = {key: value for key, value in found.items() if key in (("1", 25.0), ("5", 25.0))}
    rows = judge.rows(simulated.model(Config(), calibration, small, {}))
    (mean,) = [
        r for r in rows if r.number.symbol == "SF" and r.number.case == numbers.MEAN and "room" in r.number.temperature
    ]
    assert mean.verdict == NOT_COMPARABLE
    assert mean.basis.startswith("not computed here")


def test_a_small_study_says_what_it_did_not_compute():
    calibration, found = study_of(closed_form.default())
    small = {key: value for key, value in found.items() if key in (("1", 25.0), ("5", 25.0))}
    rows = judge.rows(simulated.model(Config(), calibration, small, {}))
    missing = {r.number for r in rows if r.basis.startswith(NOT_COMPUTED)}
    without = [
        r for r in judge.rows(closed_form.default()) if r.number in missing and not r.basis.startswith(NOT_COMPUTED)
    ]
    sentence = page.prediction_sentence(rows, small)
    assert f"only cases 1, 5 at 25 degC: {len(missing)} of {len(rows)} numbers were not computed" in sentence
    assert f"`gyro report numbers` judges {len(without)} of these" in sentence
    assert "neither inputs nor fitted, 3 were computed, and none agreed" in sentence


def test_a_whole_study_names_what_is_predicted(rows):
    points = closed_form.default().points
    assert "relative deviation rate of scale factor" in page.prediction_sentence(rows, points)
    computed = [r for r in rows if not r.basis.startswith(NOT_COMPUTED) and r.verdict != "predicted"]
    assert page.prediction_sentence(computed, points).startswith("No number that is neither an input nor fitted agreed")


def test_tables_of_a_calibration_name_loop_phases_with_a_prime():
    """xe2 and ye2 of a calibration are loop phases; one board without a seed is the configured one."""
    values = dict.fromkeys(NODES, 0.0)
    names = ("residual", "uncertainty", "found", "found_uncertainty", "second_pass", "second_pass_uncertainty")
    one = {f"{name}_deg": values for name in names} | {"covered": values, "seen": {}}
    tables = page_tables.calibration_table(one), page_tables.boards_table([one], True)
    assert all([row[0] for row in table.rows] == ["xe1", "xe2'", "ye1", "ye2'"] for table in tables)
    titles = [page_tables.boards_table([one] * n, is_configured).title for n, is_configured in ((1, True), (1, False))]
    assert titles == ["This board", "1 random board"]
    assert page_tables.boards_table([one] * 2).title == "2 random boards"


def test_the_document_says_what_uncertainties_are_assumed():
    text = (ROOT / "docs" / "paper.md").read_text()
    assert f"1e-5 of A_d is {numbers.method_deg('phi_xe2'):.2f} deg" in text
    share = numbers.relative_repeatability(numbers.numbers(), "BI", 25.0)
    assert f"{100 * share:.0f} % of a case at 100 s in an assumed record of one hour" in text


def test_document_trace_and_judge_have_the_same_rows(rows):
    """Role and verdict of each line of the page are those of the trace, in order."""
    text = pages.judged_part()
    lines = [line.split("|") for line in text.splitlines() if line.count("|") > 8][2:]
    written = [tuple(cell.strip() for cell in line if cell.strip() in (*ROLES, *VERDICTS)) for line in lines]
    data, _ = paper.report([numbers.PATHS[0]], {})
    assert len(written) == len(data["questions"])
    assert written == [(q["role"], q["verdict"]) for q in data["questions"]]
    assert judge_table.sentence(rows) in text
