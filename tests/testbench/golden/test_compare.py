"""The first divergence and what is said about it, against differences put in by hand."""

import json

import numpy as np
import pytest

from testbench.errors import FileError
from testbench.golden.check import diagnose as why
from testbench.golden.check.compare import MOST_INPUTS, SCHEMA, Column, compare, formats
from tests.testbench.golden import planted


def port(name, fmt, reset=None):
    return {"name": name, "fmt": list(fmt), "width": fmt.width, "signed": bool(fmt.s), "reset": reset}


def golden(block="modulator", fault=planted.NONE, seed=1):
    """(manifest, inputs, expected, got) of a planted design."""
    a = planted.case(block, seed, fault)
    registers = [port(name, *p) for name, p in a["ports"].items()]
    word = a["ports"]["product"].fmt if block == "modulator" else a["ports"]["phase"].fmt
    manifest = {
        "schema": SCHEMA,
        "block": block,
        "case": "try",
        "clock": {"name": "clk", "hz": 26_000_000},
        "n": len(a["expected"]["product" if block == "modulator" else "phase"]),
        "inputs": [port(name, word) for name in a["inputs"]],
        "registers": registers,
        "outputs": [],
        "params": [{"name": name, "raw": raw} for name, raw in a["params"].items()],
    }
    return manifest, a["inputs"], a["expected"], a["got"]


def test_equal_rows_pass_and_say_what_was_compared():
    manifest, inputs, expected, got = golden()
    report = compare(manifest, inputs, expected, {"code": got["code"], "amplitude": inputs["amplitude"]})
    assert report.passed
    assert report.ports == ("amplitude", "code")
    assert report.missing == ("product", "held1", "held2")
    assert report.text().endswith("PASS\n")
    assert json.loads(report.to_json())["passed"] is True


def test_an_input_that_has_the_name_of_a_register_keeps_its_own_values(monkeypatch):
    manifest, inputs, expected, got = golden()
    manifest["inputs"].append(manifest["registers"][0] | {"name": "code"})
    inputs["code"] = 7 * np.ones_like(got["code"])
    got["code"][41] += 3
    rows = []
    monkeypatch.setattr(why, "diagnose", lambda given: rows.append(given) or [])
    compare(manifest, inputs, expected, got)
    np.testing.assert_array_equal(rows[0].inputs["code"], inputs["code"])
    np.testing.assert_array_equal(rows[0].got["code"], got["code"])


def test_the_first_divergence_is_exact():
    manifest, inputs, expected, got = golden()
    got["held1"][300:] += 1
    got["code"][41] += 3
    report = compare(manifest, inputs, expected, got, before=4)
    d = report.divergence
    assert (d.cycle, d.port, d.error_lsb, d.is_input) == (41, "code", 3, False)
    assert d.expected == expected["code"][41]
    assert d.got == expected["code"][41] + 3
    assert d.time_ns == pytest.approx(41 / 26e6 * 1e9)
    assert [row[0] for row in d.before] == [37, 38, 39, 40, 41]
    assert report.differing == {"code": 1, "held1": manifest["n"] - 300}
    assert report.diagnosis == ()
    assert "diagnosis         unknown" in report.text()


def test_the_error_of_a_register_that_wraps_is_the_shorter_way_round():
    manifest, inputs, expected, got = golden()
    (code,) = (port for port in manifest["registers"] if port["name"] == "code")
    turn = 1 << code["width"]
    for error, overflow, shown in ((turn - 4, "wrap", -4), (4 - turn, "wrap", 4), (turn - 4, "saturate", turn - 4)):
        code["overflow"] = overflow
        wrong = got["code"].copy()
        wrong[41] += error
        d = compare(manifest, inputs, expected, {"code": wrong}).divergence
        assert (d.cycle, d.port, d.error_lsb) == (41, "code", shown)


def test_values_are_decoded_by_their_format():
    manifest, inputs, expected, got = golden()
    got["product"][7] = 1 << 39
    d = compare(manifest, inputs, expected, got).divergence
    assert d.got_value == 0.5
    assert d.expected_value == expected["product"][7] / 2**40


def test_values_have_as_many_digits_as_distinguish_them():
    manifest, inputs, expected, got = golden()
    expected["product"][7], got["product"][7] = 8589933568, 8589934591
    report = compare(manifest, inputs, expected, got)
    d = report.divergence
    assert f"  expected        8589933568 = 0.00781249907 {d.fmt}\n" in report.text()
    for want, have, texts in (
        (8589933568, 8589934591, ("0.999999881", "1")),
        (4, 3, ("4.65661e-10", "3.49246e-10")),
        (1 << 33, (1 << 33) + 1, ("1", "1.00000000012")),
        ((1 << 62) + 1, 1 << 62, ("536870912", "536870912")),
        (1 << 32, None, ("0.5", None)),
    ):
        values = (k if k is None else k / 2**33 for k in (want, have))
        assert d._replace(**dict(zip(("expected_value", "got_value"), values))).decimal_texts() == texts


def test_cells_that_are_not_judged_are_no_differences():
    manifest, inputs, expected, got = golden()
    care = np.ones(manifest["n"], bool)
    care[39] = False
    got["code"][39] += 5
    got["code"][41] += 3
    report = compare(manifest, inputs, expected, got, {"code": care}, before=2)
    names, first, _, last, legend = report.text().splitlines()[4:9]
    assert names.split()[:2] == ["cycle", "code"]
    assert first.split()[:3] == ["39", f"{expected['code'][39]}*", str(expected["product"][39])]
    assert f"{expected['code'][41]} / {got['code'][41]}" in last
    assert legend == "  (expected / got where they differ; * expected, not judged)"
    before = report.to_dict()["first"]["before"]
    assert [row["not_judged"] for row in before] == [["code"], [], []]
    assert before[0]["got"]["code"] == got["code"][39]
    assert "*" not in compare(manifest, inputs, expected, got, before=2).text()


def test_the_inputs_at_the_edge_before_the_first_difference_are_shown():
    manifest, inputs, expected, got = golden()
    got["code"][41] += 3
    report = compare(manifest, inputs, expected, got)
    edge = {name: int(column[40]) for name, column in inputs.items()}
    line = "  inputs at edge 40: " + ", ".join(f"{name} {value}" for name, value in edge.items())
    assert f"{line}\n" in report.text()
    assert report.to_dict()["first"]["inputs"] == {"edge": 40, "values": edge}
    more = {f"i_{k}": inputs["sine"] for k in range(MOST_INPUTS)}
    entries = [manifest["inputs"][0] | {"name": name} for name in more]
    many = compare(manifest | {"inputs": manifest["inputs"] + entries}, inputs | more, expected, got)
    assert f"  inputs at edge 40: {len(inputs) + MOST_INPUTS}, in window.vcd\n" in many.text()
    # before row 0 there is no edge, and an input is no result of one
    got["code"][0] += 1
    for columns in (got, {**got, "sine": inputs["sine"] + 1}):
        report = compare(manifest, inputs, expected, columns)
        assert "inputs at edge" not in report.text()
        assert report.to_dict()["first"]["inputs"] is None


def test_a_report_carries_the_diagnosis_in_text_and_json():
    report = compare(*golden(fault=("rounding", "code", "half_even")))
    assert "diagnosis         rounding: another rounding rule (code: half_even" in report.text()
    tree = json.loads(report.to_json())
    assert [found["cause"] for found in tree["diagnosis"]] == ["rounding"]
    assert tree["first"]["before"][-1]["clock"] == tree["first"]["clock"]


def test_a_wrong_stimulus_is_said_before_any_register_is_blamed():
    manifest, inputs, expected, got = golden()
    wrong = inputs["sine"].copy()
    wrong[5] += 1
    report = compare(manifest, inputs, expected, {"sine": wrong, **got})
    assert report.divergence.is_input
    assert report.diagnosis == ()
    assert "was not given the golden stimulus" in report.text()


def test_an_unknown_value_is_a_divergence_unless_masked():
    manifest, inputs, expected, got = golden()
    known = np.ones(manifest["n"], bool)
    known[:3] = False
    column = {"code": Column(got["code"], known)}
    d = compare(manifest, inputs, expected, column).divergence
    assert (d.cycle, d.got, d.error_lsb) == (0, None, None)
    care = np.ones(manifest["n"], bool)
    care[:3] = False
    assert compare(manifest, inputs, expected, column, {"code": care}).passed


def test_a_short_log_is_compared_as_far_as_it_goes():
    manifest, inputs, expected, got = golden()
    report = compare(manifest, inputs, expected, {"code": got["code"][:100]})
    assert (report.rows, report.golden_rows, report.passed) == (100, manifest["n"], True)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"schema": "other/2"}, "schema 'other/2'"),
        ({"registers": [{"name": "code"}]}, "is not a port"),
        ({"registers": [{"name": "code", "fmt": [1, 19, 0], "width": 7}]}, "width 7"),
        ({"registers": [{"name": "code", "fmt": [1, 80, 0]}]}, "81 bits, the limit is 63"),
    ],
)
def test_a_broken_manifest_is_one_clear_line(change, text):
    with pytest.raises(FileError, match="manifest: ") as problem:
        formats(golden()[0] | change)
    assert text in str(problem.value)


@pytest.mark.parametrize("got", [{"nonsense": [1]}, {}, {"code": []}, {"sine": [0, 0]}])
def test_a_log_without_anything_to_compare_is_refused(got):
    manifest, inputs, expected, _ = golden()
    with pytest.raises(FileError, match="log: "):
        compare(manifest, inputs, expected, got)
