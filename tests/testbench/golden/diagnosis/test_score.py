"""Faults written into the reference RTL by rules on text, of kinds that the diagnosis was not written from."""

import random
import shutil

import pytest

from testbench.golden.bundles import bundle
from testbench.golden.diagnosis import perturb, perturb_control
from testbench.golden.diagnosis.perturb import CAUSES
from tests.testbench.golden.diagnosis import first_row, left_out, rtl_faults, score, unseen

pytestmark = pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus is not installed: no fault was TRIED")


def of_round(bundles, name, stems, most):
    faults = rtl_faults.drawn(score.RULES[name], most, 62, stems)
    return [score.judged(bundles(f.stem) / rtl_faults.CASES[f.stem], f) for f in faults]


def test_every_kind_has_a_cause_of_the_list_or_none():
    kinds = set()
    for rules in score.RULES.values():
        found = rtl_faults.drawn(rules, 5, 1)
        assert len({f.kind for f in found}) >= 15
        assert all(f.text != rtl_faults.source(f.stem) for f in found)
        kinds |= {f.cause for f in found}
    assert kinds == {*CAUSES, ""}


def test_some_faults_are_named(bundles):
    found = of_round(bundles, "second", ("dds", "isqrt", "watchdog"), 1)
    seen = [one for one in found if one.verdict != "not seen"]
    assert len(seen) >= 8
    assert sum(one.verdict == "right" for one in seen) >= 0.75 * len(seen), [one.verdict for one in found]
    assert not any(one.verdict == "wrong" for one in seen), [(one.fault.edit, one.causes) for one in seen]


def edited(stem, old, new):
    text = rtl_faults.source(stem)
    assert text.count(old) == 1
    return rtl_faults.Fault("", "", stem, text.replace(old, new), (), "")


@pytest.mark.parametrize(
    ("old", "new", "row", "ports"),
    [
        ("(r_age == AGE_TOP)", "(AGE_TOP == r_age)", None, set()),
        ("r_age   <= 10'd0", "r_age   <= 10'd1", 0, {"r_age"}),
        ("r_stale <= 1'b0", "r_stale <= 1'bx", 0, {"r_stale"}),
    ],
)
def test_the_bench_of_the_first_row_finds_it(bundles, tmp_path, old, new, row, ports):
    (tmp_path / "watchdog.v").write_text(edited("watchdog", old, new).text)
    assert first_row.first(bundles("watchdog") / "limit250", tmp_path) == (row, ports)


def named(bundles, stem, old, new, level="registers"):
    """Causes of the difference that an edit makes."""
    fault = edited(stem, old, new)
    return score.checked(bundles(stem) / rtl_faults.CASES[stem], fault.text, stem, level)[0].diagnosis


def test_a_name_is_not_certain_where_another_class_gives_the_same_rows(bundles):
    """The subtrahend ends in 01: its complement and one more are the same, where it is compared too."""
    found = named(bundles, "isqrt", "{1'b0, pair} - {1'b0, trial}", "{1'b0, pair} + ~{1'b0, trial}")
    assert {"constant", "complement"} <= {cause.cause for cause in found}
    assert not any(cause.sure for cause in found)


@pytest.mark.parametrize(
    ("stem", "old", "new"),
    [("sine", " + {{SINE_ADDRESS_BITS{1'b0}}, r_product}", ""), ("cordic", "(x + half) >>> r_i", "x + (half >>> r_i)")],
)
def test_what_no_class_has_is_not_certain_as_another(bundles, stem, old, new):
    """A term that is missing is an operand that is always 0; without its shift the CORDIC loads the old value."""
    assert not any(cause.sure for cause in named(bundles, stem, old, new))


def test_one_value_in_all_wrong_rows_makes_no_name_certain(bundles):
    """A register that is cleared where it should hold: a loop's register is 0 there as well."""
    old = "else if (en)\n            r_error <= -wide_cos"
    found = named(bundles, "quadrature_loop", old, "else\n            r_error <= en ? -wide_cos : 25'sd0")
    assert (found[0].cause, found[0].register) == ("condition", "error")
    assert not any(cause.sure for cause in found)


def test_an_edge_for_a_level_is_a_condition(bundles):
    text = edited("watchdog", "else if (ce_1m)", "else if (ce_1m && !was)").text
    always = "always @(posedge clk)"
    assert text.count(always) == 1
    text = text.replace(always, f"reg was;\n    {always} was <= ce_1m;\n    {always}")
    report, _ = score.checked(bundles("watchdog") / "limit250", text, "watchdog")
    assert report.diagnosis[0].cause == "condition"


LOADED = "r_radicand  <= u;\n            r_root      <= 16'd0;"


def test_a_constant_that_is_not_loaded_is_a_condition(bundles):
    found = named(bundles, "isqrt", LOADED, LOADED.split("\n")[0])
    assert (found[0].cause, found[0].register) == ("condition", "root")


def test_a_cause_that_a_row_refutes_is_not_certain(bundles, monkeypatch):
    """Without the right hypothesis, a register without reset explains the wrong rows; the rows with reset refute it."""
    monkeypatch.setattr(perturb_control, "load_alternatives", lambda *_: ())
    found = named(bundles, "isqrt", LOADED, LOADED.split("\n")[0])
    assert "no_reset" in {cause.cause for cause in found}
    assert not any(cause.sure for cause in found)


def without(monkeypatch, cause):
    """Leave a class without hypotheses at the nodes of the model."""
    every = perturb.node_hypotheses
    monkeypatch.setattr(perturb, "node_hypotheses", lambda *given: [h for h in every(*given) if h.cause != cause])


@pytest.mark.parametrize(
    ("stem", "old", "new", "missing"),
    [
        # one difference: the complement of the subtrahend is one less
        ("isqrt", "{1'b0, pair} - {1'b0, trial}", "{1'b0, pair} + ~{1'b0, trial}", "complement"),
        # which of two values was taken
        ("watchdog", "(r_age == AGE_TOP) ?", "(r_age == AGE_TOP - 1) ?", "comparison"),
        ("sine", "phase[DDS_BITS-2] ?", "phase[DDS_BITS-3] ?", "condition"),
    ],
)
def test_without_the_right_class_another_one_is_not_certain(bundles, monkeypatch, stem, old, new, missing):
    without(monkeypatch, missing)
    assert not any(cause.sure for cause in named(bundles, stem, old, new))


def test_values_tell_a_class(bundles):
    found = named(bundles, "rate_loop", "r_error <= sense_sin", "r_error <= sense_sin >>> 1")
    assert (found[0].cause, found[0].register, found[0].sure) == ("gain", "error", True)


@pytest.mark.parametrize(
    ("stem", "old", "new", "cause", "port"),
    [
        ("notch", "r_x2 <= r_x1", "r_x2 <= {r_x1[11:0], r_x1[23:12]}", "bit_swap", "out"),
        ("spi_dac", "r_shift     <= word", "r_shift     <= {word[11:0], word[23:12]}", "bit_swap", "sdin"),
    ],
)
def test_with_hidden_registers_a_cause_has_the_name_of_the_first_port(bundles, stem, old, new, cause, port):
    found = named(bundles, stem, old, new, "outputs")
    assert (cause, port) in {(c.cause, c.register) for c in found}
    assert {c.register for c in found} == {port}


def test_first_ports_of_a_register_in_the_text():
    design = rtl_faults.Design("isqrt")
    assert design.first_of(("remainder",), ("y", "done")) == {"y"}
    assert design.first_of(("y",), ("y", "done")) == {"y"}


def test_another_port_in_a_condition_is_planted_as_a_condition():
    found = {f.edit: f.cause for f in rtl_faults.operand(rtl_faults.Design("cordic")) if "r_phase in" in f.edit}
    assert found["turned_y: x_in -> r_phase in x_in[23] ? -wide_y : wide_y"] == "condition"


@pytest.mark.slow
def test_a_new_value_in_a_comparison_that_other_registers_share_is_early(bundles):
    found = named(bundles, "cordic", "r_y     <= next_y", "r_y     = next_y")
    assert (found[0].cause, found[0].register) == ("early", "angle")


def test_with_hidden_registers_another_bit_in_a_condition_goes_first_and_none_is_certain(bundles):
    """What is read off the rows of registers is no hypothesis there, so a name may have a rival that was not tried."""
    found = named(bundles, "sine", "phase[DDS_BITS-2] ?", "phase[DDS_BITS-3] ?", "outputs")
    assert found[0].cause == "condition"
    assert not any(cause.sure for cause in found)


def test_another_bit_in_a_condition_is_a_condition(bundles):
    found = named(bundles, "isqrt", "(r_i == LAST)", "r_i[3]")
    assert found[0].cause == "condition"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("assign o_fix_ftr = (r_state == OPEN || balancing) && r_control[FIX_FTR]",
         "assign o_fix_ftr = (r_state == OPEN || balancing) && i_control[FIX_FTR]"),
        ("(bad || r_control[HOLD_PLL]) ?", "(bad || i_control[HOLD_PLL]) ?"),
    ],
)  # fmt: skip
def test_a_flag_that_chooses_between_constants_is_operand_and_condition(bundles, old, new):
    """A design may have an expression where the model has a choice: both classes are listed, none is certain."""
    found = named(bundles, "sequencer", old, new)
    assert {"operand", "condition"} <= {cause.cause for cause in found}
    assert not any(cause.sure for cause in found)


@pytest.mark.slow
def test_an_assignment_in_the_outer_branch_is_a_condition(bundles):
    """Another register in the place of the one that is held gives the same rows: none is certain."""
    old = "if (ends) begin\n                r_sync_n    <= 1'b1;"
    found = named(bundles, "spi_dac", old, "r_sync_n    <= 1'b1;\n            if (ends) begin")
    assert "condition" in {cause.cause for cause in found if cause.register == "sync_n"}
    assert not any(cause.sure for cause in found)


def test_an_asynchronous_reset_is_named_without_registers(bundles):
    found = named(bundles, "isqrt", "always @(posedge clk)", "always @(posedge clk or posedge rst)", "outputs")
    assert found[0].cause == "async_reset"


@pytest.mark.skipif(shutil.which("yosys-abc") is None, reason="yosys is not installed: nothing was PROVED")
@pytest.mark.parametrize(
    ("old", "new", "verdict"),
    [("r_slot == SLOTS", "r_slot >= SLOTS", "equivalent"), ("SLOTS = 6'd60", "SLOTS = 6'd59", "alive")],
)
def test_a_fault_that_no_row_shows_is_proved_or_found(bundles, old, new, verdict):
    folder = bundles("rates") / "default"
    found = unseen.proved(folder, bundle.read(folder).manifest, edited("rates", old, new).text)
    assert found.verdict == verdict


@pytest.mark.skipif(shutil.which("yosys-abc") is None, reason="yosys is not installed: nothing was PROVED")
@pytest.mark.parametrize(("late", "verdict"), [("ce_1m & ~ce_1m", "equivalent"), ("ce_1m", "alive")])
def test_a_register_that_the_sound_design_lacks_is_part_of_the_search(bundles, late, verdict):
    folder, manifest = bundles("watchdog") / "limit250", bundle.read(bundles("watchdog") / "limit250").manifest
    text = rtl_faults.source("watchdog").replace(
        "always @(posedge clk)",
        f"""reg late;
    always @(posedge clk) late <= {late};
    always @(posedge clk)""",
        1,
    )
    old = "if (rst || frame)"
    assert text.count(old) == 1
    assert unseen.proved(folder, manifest, text.replace(old, "if (rst || frame || late)")).verdict == verdict


def test_without_its_class_a_fault_of_the_model_has_no_certain_name(bundles):
    block = left_out.read(bundles("dds") / rtl_faults.CASES["dds"], "dds")
    found = left_out.counted(block, 1, random.Random(7))
    assert found.faults >= 10
    assert found.certain >= found.faults / 2
    assert found.beside == 0
    assert found.without <= found.faults / 10  # docs/diagnosis.md says how many of all blocks
