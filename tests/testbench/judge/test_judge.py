"""The numbers of the paper (docs/paper.md): their uncertainty, their roles, and the one verdict."""

import csv
import math
import re
from pathlib import Path

import pytest

from testbench.config import Config
from testbench.errors import FileError
from testbench.judge import judge, numbers, roles
from testbench.judge.judge import Model
from testbench.judge.number_verdict import (
    CONTRADICTED,
    FITTED,
    INPUT,
    NOT_COMPARABLE,
    PREDICTED,
    ROLES,
    VERDICTS,
    K,
    Part,
    Value,
    verdict,
)
from testbench.paper import closed_form

LISTED = numbers.numbers()


def number(symbol, case, temperature=""):
    (found,) = [n for n in LISTED if n.symbol == symbol and n.case.startswith(case) and
                n.temperature.startswith(temperature)]  # fmt: skip
    return found


def points(values, cases="12345", temps=judge.TEMPERATURES):
    """The same values in every case and at every temperature."""
    return {(c, t): {name: Value(v) for name, v in values.items()} for c in cases for t in temps}


# ---- numbers ---------------------------------------------------------------------------------------------------------


def test_every_line_of_both_lists_is_a_number():
    lines = [row for path in numbers.PATHS for row in csv.reader(path.read_text().splitlines()[1:])]
    assert [n.text for n in LISTED] == [row[4] for row in lines]
    assert len({(n.key, n.symbol) for n in LISTED}) == len(LISTED)


def test_uncertainties_by_hand():
    """Phases: rounding, fluctuation or standard deviation, what was left; means over three cases; changes."""
    rounding = 1e-4 / math.sqrt(12)
    assert number("phi_xe1", "case 1").sigma == pytest.approx(math.sqrt(rounding**2 + 0.0077**2 / 3 + 0.0078**2))
    # A_d goes as 1/cos: 1 + angle^2 / 2, and 1e-5 of it is seen
    assert number("phi_xe2", "case 3").sigma == pytest.approx(
        math.hypot(rounding, 0.0073 / math.sqrt(3), math.degrees(math.sqrt(2e-5))), rel=1e-5
    )
    # 36 averages of 100 s in an hour, of each of three cases
    assert number("BI", "mean", "room").sigma == pytest.approx(3.8333 / math.sqrt(2 * 35 * 3), rel=1e-6)
    assert number("phi_ye1", "case 3").sigma == pytest.approx(math.sqrt(rounding**2 + 0.0015**2 + 0.0079**2))
    assert number("Vq", "mean", "room").sigma == pytest.approx(math.hypot(0.0078 / math.sqrt(3), rounding))
    # 8651 less 1/cos: two cases with xe2, one without
    step = 8651 * (math.cos(math.radians(8.8814)) / math.cos(math.radians(10.1273)) - 1)
    assert step == pytest.approx(31.55, abs=0.01)
    rest = math.sqrt(27.06**2 - step**2 / 3)
    assert number("SF", "mean", "room").sigma == pytest.approx(math.hypot(rest / math.sqrt(3), 1 / math.sqrt(12)))
    assert number("SF", "case 3 vs", "room").sigma == pytest.approx(math.hypot(math.sqrt(2) * rest / 8651, rounding))
    # "below 0.09" between three cases; three draws have a mean range of 1.6926 standard deviations
    case = 0.09 / math.sqrt(3) / 1.692569 * 0.1337
    assert number("ARW", "mean", "room").sigma == pytest.approx(math.hypot(case / math.sqrt(3), rounding), rel=1e-5)
    assert number("BW", "cases 1").sigma is None


@pytest.mark.parametrize(
    ("symbol", "case", "bound", "value"),
    [
        ("BW", "cases 1", "<", 30.0),
        ("Q", "device", ">", 200000.0),
        ("phi_xe1, phi_xe2", "cases", "<", 0.009),
        ("SF,bias,Vq,ARW", "case 3", ">", 2.5),
        ("phases", "unc", ">", 0.0),
        ("Ad", "cases", "<", 0.0),
    ],
)
def test_bounds_are_read_with_their_side(symbol, case, bound, value):
    n = number(symbol, case)
    assert (n.bound, n.values) == (bound, (value,))


def test_a_list_that_is_none_is_one_line(tmp_path):
    path = tmp_path / "n.csv"
    path.write_text("a,b\n")
    with pytest.raises(FileError, match="line 1: expected a line that begins with quantity,symbol"):
        numbers.read(path)
    path.write_text(numbers.HEAD + "\nx,SF,c,room,1e12\n")
    with pytest.raises(FileError, match="SF: '1e12' is not a number below 1e"):
        numbers.read(path)
    path.write_text(f"{numbers.HEAD},std_or_max_fluctuation,unit,kind\nx,SF,c,room,abc,,,measured mean\n")
    with pytest.raises(FileError, match="SF: 'abc' is not a number"):
        numbers.read(path)


def test_a_change_of_one_case_is_one_line(tmp_path):
    path = tmp_path / "n.csv"
    path.write_text(numbers.PATHS[0].read_text().replace("case 4 vs case 5", "case 4", 1))
    with pytest.raises(FileError, match="relative deviation rate of scale factor: case 'case 4' does not name two"):
        judge.rows(Model(""), path)


# ---- roles -----------------------------------------------------------------------------------------------------------


def test_every_number_has_exactly_one_declared_rule():
    for n in LISTED:
        rule = roles.matching_rule(n)
        assert rule is not roles.OTHER, n.key
        assert rule.role in ROLES
        assert rule.claim in judge.CLAIMS
        assert rule.rests_on or rule.role in ("none", "input"), n.key
    used = {roles.matching_rule(n) for n in LISTED}
    assert set(roles.RULES) == used, "a rule that no number has"


def test_roles_know_no_number_of_the_paper():
    """No printed value and no result: what is declared before cannot follow from what is judged."""
    text = Path(roles.__file__).read_text().split('"""', 2)[2]
    printed = {n.text for n in LISTED if re.fullmatch(r"[-+]?\d+\.\d{2,}|\d{4,}", n.text)}
    assert printed
    assert not [value for value in printed if value in text]


def test_what_the_reading_of_xe2_says():
    """A_d is 1/cos near its minimum; the switch's delay as a phase."""
    assert f"1e-5 of A_d is {math.degrees(math.acos(1 - 1e-5)):.2f} deg" in roles.NODE_XE2
    plant = Config().plant
    assert f"lower the model's value by {360 * plant.fx_hz * plant.sid_switch_s:.2f} deg" in roles.NODE_XE2


# ---- the verdict -----------------------------------------------------------------------------------------------------


def at(pull, bound=""):
    return Part("x", 1.0, 0.3, Value(1.0 + pull * 0.5, 0.4), bound)  # 0.5 together


@pytest.mark.parametrize(("role", "met"), [("input", INPUT), ("fitted", FITTED), ("free", PREDICTED)])
def test_a_verdict_follows_from_role_and_combined_uncertainty(role, met):
    assert verdict(role, [at(K - 0.01)])[0] == met
    assert verdict(role, [at(0.01 - K)])[0] == met
    assert verdict(role, [at(K + 0.01)])[0] == CONTRADICTED
    assert verdict(role, [at(-K - 0.01)])[0] == CONTRADICTED
    assert verdict(role, [at(-9.0, "<"), at(9.0, ">"), at(K - 0.01, "<")])[0] == met
    assert verdict(role, [at(0.0), at(K + 0.01, "<")])[0] == CONTRADICTED, "each part must be met"
    assert verdict(role, [at(0.0), Part("y", 1.0, 0.1, None)]) == (NOT_COMPARABLE, "not computed here: y")
    assert verdict(role, [at(K + 1), Part("y", 1.0, 0.1, None)])[0] == CONTRADICTED
    assert verdict(role, [Part("z", 0.0, None, Value(0.0))])[0] == met
    assert verdict(role, [Part("z", 0.0, None, Value(1e-9))])[0] == CONTRADICTED, "no uncertainty, no tolerance"


def test_what_has_no_counterpart_is_never_judged():
    assert verdict("none", [at(0.0)], "not available") == (NOT_COMPARABLE, "not available")


def row(rows, n):
    return next(r for r in rows if r.number == n)


def test_the_ratio_is_judged_by_all_four_quantities():
    """Scale factor, V_q and ARW change ten times as much; bias does not: contradicted, by the bias."""
    n = number("SF,bias,Vq,ARW", "case 3")
    names = [judge.NAME_OF[s] for s in n.symbol.split(",")]
    values = points(dict.fromkeys(names, 1.0))
    for t in judge.TEMPERATURES:
        values["3", t] = dict.fromkeys(names, Value(1.10))
        values["5", t] = dict.fromkeys(names, Value(1.01))
    assert row(judge.rows(Model("", points=values)), n).verdict == PREDICTED
    values["5", 50.0] = values["5", 50.0] | {"bias_dps": Value(1.05)}
    found = row(judge.rows(Model("", points=values)), n)
    assert found.verdict == CONTRADICTED
    assert found.basis.startswith("bias, 50 degC")
    del values["5", -20.0]["arw_deg_per_rt_h"]
    values["5", 50.0] = dict.fromkeys(names, Value(1.01))
    assert row(judge.rows(Model("", points=values)), n).verdict == NOT_COMPARABLE


def test_phases_that_rise_are_judged_by_each_of_the_four():
    rise = dict.fromkeys(("xe1", "xe2", "ye1", "ye2"), Value(0.01, 0.001))
    n = number("phases", "unc")
    assert row(judge.rows(Model("", rise_deg=rise)), n).verdict == PREDICTED
    assert row(judge.rows(Model("", rise_deg=rise | {"ye1": Value(-0.01, 0.001)})), n).verdict == CONTRADICTED


def test_a_mean_is_judged_by_value_trend_and_spread():
    """Each of the three alone makes it contradicted."""
    cold = number("SF nonlinearity", "mean", "-20")

    def judged(low, room, spread):
        values = points({"nonlinearity_ppm": room})
        for case, share in zip("123", (-1, 0, 1)):
            values[case, -20.0] = {"nonlinearity_ppm": Value(low + share * spread)}
        return row(judge.rows(Model("", points=values)), cold)

    assert judged(351.0, 325.0, 5.0).verdict == PREDICTED
    assert judged(371.0, 325.0, 5.0).verdict == CONTRADICTED
    assert judged(351.0, 351.0, 5.0).basis.startswith("minus that at 25 degC")
    assert judged(351.0, 325.0, 12.0).basis.startswith("standard deviation between cases")


def test_without_a_model_nothing_is_predicted_and_no_table_is_available():
    rows = judge.rows(Model("nothing"))
    assert {r.verdict for r in rows} == {NOT_COMPARABLE}
    tables = [r for r in rows if r.number.kind == "missing"]
    assert {r.basis for r in tables} == {"not available"}
    assert len(tables) == 7


def test_what_is_put_in_otherwise_is_contradicted():
    n = number("|fy-fx|", "device")
    assert judge.judge_number(n, Model("", settings={n.quantity: (139.2,)}), LISTED).verdict == INPUT
    assert judge.judge_number(n, Model("", settings={n.quantity: (20.0,)}), LISTED).verdict == CONTRADICTED


# ---- what has no simulation ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rows():
    return judge.rows(closed_form.default())


def test_the_default_board_by_budget_and_linear_loop(rows):
    """Against sums made here: the verdict follows from |difference| and the two uncertainties alone."""
    for r in rows:
        pulls = []
        for p in r.parts:
            if p.model is not None:
                less = p.model.value - p.paper
                less = less if not p.bound else max(less, 0.0) if p.bound == "<" else min(less, 0.0)
                both = math.sqrt((p.sigma or 0.0) ** 2 + p.model.sigma**2)
                pulls.append(abs(less) / both if both else math.inf if less else 0.0)
        if r.rule.role != "none" and pulls:
            assert (r.verdict == CONTRADICTED) == (max(pulls) > 2), r.number.key
    assert {r.verdict for r in rows} == set(VERDICTS)
    fitted = [r for r in rows if r.verdict == FITTED]
    assert all(r.rule.role == "fitted" for r in fitted)


def test_cases_are_the_budgets_words():
    words = closed_form.cases_deg(Config())
    assert set(words["1"].values()) == {0.0}
    for case, moved in zip("2345", ("phase_drive_sine", "phase_drive_ref", "phase_sense_sine", "phase_sense_ref")):
        before = words[str(int(case) - 1)]
        assert [k for k in before if before[k] != words[case][k]] == [moved]
