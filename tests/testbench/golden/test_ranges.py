"""Range proofs: nothing leaves a proven range, too narrow formats are caught, hints cannot make a claim false."""

import importlib
import json
import random
import re
from pathlib import Path as File
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from fpga_model import cordic, digital_sid, isqrt, modulator, rate_output, sequencer, sine
from fpga_model.fixed import Fmt, bits, clamp, half_up, signed_bits
from testbench.golden import cli
from testbench.golden.bundles import bundle, export
from testbench.golden.ranges import range_report, range_wiring, ranges
from testbench.golden.ranges.interpreter import Interpreter, Unsupported, read_function_source
from testbench.golden.ranges.intervals import Lin, Path, Run
from testbench.golden.stimulus import blocks
from testbench.golden.stimulus.blocks import Block, Port
from tests.testbench.golden.benching import made

CASES = [(stem, case) for stem, block in blocks.BLOCKS.items() for case in block.cases]
# the sequencer's cases take seconds to prove; the pinned manifests hold what comes out
LONG = {("sequencer", "quick"), ("sequencer", "fastest")}
FAST_CASES = [pytest.param(*case, marks=pytest.mark.slow if case in LONG else ()) for case in CASES]


def proven(stem, case=None):
    block = blocks.BLOCKS[stem]
    return {one.name: one.proven for one in ranges.analyse_case(stem, case or next(iter(block.cases))).registers}


def assert_inside(stem, case, regs, pins):
    found = ranges.analyse_case(stem, case)
    for one, ends in zip(
        (*found.registers, *found.pins), range_report.column_min_max(np.column_stack([regs, pins])), strict=True
    ):
        assert one.proven[0] <= ends[0], (stem, case, one.name, ends)
        assert ends[1] <= one.proven[1], (stem, case, one.name, ends)


# ---- every block -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("stem", "case"), FAST_CASES)
def test_every_register_is_proven_and_no_result_needs_more_than_63_bits(stem, case):
    found = ranges.analyse_case(stem, case)
    assert found.problems == ()
    assert found.sound
    for one in found.registers:
        assert one.fmt.holds(one.proven[0])
        assert one.fmt.holds(one.proven[1])
        assert one.headroom >= 0
    assert all(-(1 << 62) <= result.lo <= result.hi < 1 << 63 for result in found.results)


@pytest.mark.parametrize(("stem", "case"), FAST_CASES)
def test_vectors_stay_inside(stem, case):
    block = blocks.BLOCKS[stem]
    stim, _ = made(stem, case)
    assert_inside(stem, case, *blocks.run(block, case, stim))


@settings(max_examples=60)
@given(st.sampled_from(sorted({*CASES} - LONG)), st.integers(0, 2**32), st.sampled_from((0.02, 0.3, 0.9)))
def test_random_simulation_stays_inside(which, seed, busy):
    """Corners and noise in every input, control inputs busy or rare."""
    stem, case = which
    block, rng = blocks.BLOCKS[stem], random.Random(seed)

    def pick(port):
        if port.width == 1:
            return int(rng.random() < (0.01 if port.name == "rst" else busy))
        if rng.random() < 0.5:
            return rng.choice((port.fmt.lo, port.fmt.hi, 0, 1))
        return rng.randint(port.fmt.lo, port.fmt.hi)

    rows = []
    for _ in range(60):
        row = [pick(port) for port in block.columns]
        rows += [row] * rng.choice((1, 1, 3, 12))
    assert_inside(stem, case, *blocks.run(block, case, np.array(rows, np.int64)))


# ---- as tight as can be ----------------------------------------------------------------------------------------------


def test_ranges_that_are_known_exactly():
    assert proven("sine")["y"] == (-sine.FULL_SCALE, sine.FULL_SCALE)
    assert proven("isqrt")["root"] == (0, (1 << 16) - 1)
    assert proven("isqrt")["remainder"] == (0, 2 * isqrt.ROOT.hi)
    assert proven("modulator", "dac16")["held2"] == (-(1 << 15), (1 << 15) - 1)
    assert proven("modulator")["product"] == (modulator.AMPLITUDE.hi * modulator.SINE.lo, 1 << 40)
    assert proven("rates") == {"tick": (0, 25), "frame": (0, 124), "slot": (0, 60)}
    assert proven("rate_output")["y"] == (rate_output.OUT.lo, rate_output.OUT.hi)
    assert proven("rate_output")["acc"] == (64 * rate_output.OUT.lo, 64 * rate_output.OUT.hi)
    # from an LSB below its top the last step of a pole rounds to nothing
    assert proven("digital_sid")["pole3_0"] == (digital_sid.ACC_LO << 16, (digital_sid.ACC_HI << 16) - 1)
    assert proven("lock_monitor")["count_2"] == (0, 399)


@pytest.mark.slow
def test_the_rotation_of_the_search_is_exact():
    lo, hi = proven("sequencer")["rotation"]
    frames = blocks.BLOCKS["sequencer"].cases["quick"].search
    assert lo == sequencer.PHASE.lo * frames
    assert sequencer.PHASE.hi * frames <= hi < -lo


def test_the_cordic_needs_no_lemma():
    """Intervals per rotation bound x by 1.5 * 2**32 and so fit; the true top is K*sqrt(2)*2**31, in the same bits."""
    lo, hi = proven("cordic")["x"]
    assert (lo, hi >> 32) == (0, 1)
    assert hi.bit_length() == int(float(cordic.gain()) * 2**31.5).bit_length() == cordic.X.width


# ---- planted faults --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stem", "name", "fmt"),
    [
        ("sine", "y", Fmt(1, -1, 17)),
        ("isqrt", "remainder", bits(16)),
        ("pi", "acc", Fmt(1, 22, 24)),
        ("cordic", "x", Fmt(0, 24, 8)),
        ("cordic", "i", bits(4)),
        ("rates", "slot", bits(5)),
        ("digital_sid", "pole2_1", Fmt(1, 23, 16)),
        ("rate_output", "acc", Fmt(1, 16, 20)),
        ("lock_monitor", "count_3", bits(8)),
        ("spi_adc", "count", bits(5)),
        pytest.param("sequencer", "rotation", Fmt(1, 3, 24), marks=pytest.mark.slow),
    ],
)
def test_a_register_that_is_one_bit_too_narrow_is_caught(stem, name, fmt):
    block = blocks.BLOCKS[stem]
    (old,) = [port.fmt for port in block.registers if port.name == name]
    assert fmt.width < old.width
    narrow = block._replace(registers=tuple(p._replace(fmt=fmt) if p.name == name else p for p in block.registers))
    found = ranges.analyse(narrow, next(iter(block.cases.values())))
    assert not found.sound
    assert any(text.startswith(f"{name}: ") and "width only" in text for text in found.problems), found.problems
    (one,) = [one for one in found.registers if one.name == name]
    assert one.proven is None
    assert one.headroom is None


class Bad(NamedTuple):
    """Registers of the planted blocks."""

    a: int = 0
    b: int = 0


def _grows(s, x):
    return Bad(a=s.a + x, b=s.a)


def _bounded(s, x):
    return Bad(a=clamp(s.a + x, -100, 100), b=half_up(s.a, 2))


def _wide(s, x):
    product = s.a * s.a * s.a * s.a * s.a * s.a * s.a * s.a
    return Bad(a=x, b=1 if product > 5 else 0)


def _shifts(s, x):
    return Bad(a=x, b=(1 << s.a) & 1)


def _reaches(s, x):
    return Bad(a=x, b=(3, 5, 7)[s.a & 3])


def _divides(s, x):
    return Bad(a=x // 2, b=0)


def _counts(s, x):
    return Bad(a=0 if s.a == 100 else s.a + 1, b=x)


RUNNER = """def run(p, s, stim, _regs, _pins):
    reset = s
    for n in range(stim.shape[0]):
        r = stim[n]
        s = reset if r[0] == 1 else p(s, r[1])
"""


def planted(step):
    fmt = signed_bits(9)
    block = Block(
        stem="planted",
        inputs=(Port("x", signed_bits(9)),),
        state=Bad(),
        registers=(Port("a", fmt, 0), Port("b", fmt, 0)),
        pins=(),
        cases={"default": None},
        run=None,
        source=(RUNNER, {}),
        latency={},
    )
    return ranges.analyse(block, step)


def test_a_sum_that_grows_for_ever_is_not_proven():
    found = planted(_grows)
    assert [one.proven for one in found.registers] == [None, (-256, 255)]
    assert any("a: -512 .. 510 exceeds [1,8,0]; not proven: width only" in text for text in found.problems)


def test_the_same_sum_with_a_clamp_is_proven():
    found = planted(_bounded)
    assert found.problems == ()
    assert [one.proven for one in found.registers] == [(-100, 100), (-25, 25)]
    assert [one.headroom for one in found.registers] == [1, 3]


def test_a_result_beyond_63_bits_is_caught():
    found = planted(_wide)
    assert [one.proven for one in found.registers] == [(-256, 255), (0, 1)]
    assert found.widest.bits == 66  # an eighth power to us is a seventh times the first: it may be negative
    assert len([text for text in found.problems if "66 bits, above 63" in text]) == 1
    assert "test_ranges._wide, line " in found.problems[0]


def test_a_shift_count_and_an_index_out_of_range_are_caught():
    assert any("shift by -256 .. 255, outside 0 .. 62" in text for text in planted(_shifts).problems)
    assert any("index 0 .. 3 of 3 entries" in text for text in planted(_reaches).problems)


def test_what_is_not_understood_is_refused_by_name_and_line():
    line = _divides.__code__.co_firstlineno + 1
    with pytest.raises(Unsupported, match=rf"test_ranges\._divides, line {line}: x // 2 is not understood"):
        planted(_divides)


# ---- hints ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("stem", "name"), [("sine", "y"), ("isqrt", "remainder"), ("rate_output", "y")])
def test_without_its_relation_a_proof_fails_and_says_so(stem, name):
    found = ranges.analyse(blocks.BLOCKS[stem]._replace(relations=()), None)
    assert any(text.startswith(f"{name}: ") for text in found.problems)


@pytest.mark.parametrize("stem", ["isqrt", "rates", "spi_dac"])
def test_wrong_hints_make_no_false_claim(stem):
    block = blocks.BLOCKS[stem]
    case, params = next(iter(block.cases.items()))
    names = [port.name for port in block.registers]
    relation = {names[0]: 1, names[1]: -7}
    found = ranges.analyse(block._replace(split=(f"{names[-1]}?",), relations=(relation,), stops=(3, 5)), params)
    stim, _ = made(stem, case)
    regs, _ = blocks.run(block, case, stim)
    for one, ends in zip(found.registers, range_report.column_min_max(regs), strict=True):
        assert one.proven is None or one.proven[0] <= ends[0] <= ends[1] <= one.proven[1]


# ---- domain ----------------------------------------------------------------------------------------------------------


def _program(s, x, y):
    a = x + 3 * y - (x >> 2)
    b = (a ^ y) if x > y else (a & 7) * y
    c = abs(b) if x & 4 and not y < -3 else ~b
    d = (5, -2, 9, 1)[x & 3] + clamp(c, -9, 20)
    e = half_up(x * y, 3) | (1 << (y & 3))
    if b == d or e >= 7:
        d, e = e - d, b
    d &= 63
    return a, b, c, d, e


@settings(max_examples=3 * settings.default.max_examples)
@given(st.tuples(*[st.integers(-40, 40)] * 4), st.integers(0, 10**9))
def test_one_evaluation_covers_every_number(ends, seed):
    """Every result of the program on numbers lies in what the interpreter says for the box around them."""
    (xl, xh), (yl, yh) = sorted(ends[:2]), sorted(ends[2:])
    path = Path(Run())
    box = path.new(xl, xh, key="x"), path.new(yl, yh, key="y")
    ways = Interpreter().function(_program, [0, *box], {}, path)
    spans = [[way.value_interval(item) for item in value] for way, value in ways]
    rng = random.Random(seed)
    for _ in range(20):
        found = _program(0, rng.randint(xl, xh), rng.randint(yl, yh))
        assert any(all(lo <= v <= hi for v, (lo, hi) in zip(found, span)) for span in spans)


def test_a_mean_stays_in_the_hull():
    path = Path(Run())
    x, y = path.new(-1000, 500), path.new(-200, 900)
    mean = path.add(y, path.shr(path.add(path.mul(77, path.add(x, y, -1)), 512), 10))
    exact = [b + ((77 * (a - b) + 512) >> 10) for a in (-1000, 500) for b in (-200, 900)]
    assert path.value_interval(mean) == (min(exact), max(exact))


def test_a_condition_narrows_what_it_speaks_of():
    path = Path(Run())
    x, y = path.new(0, 100), path.new(0, 100)
    assert path.compare("<", x, y)
    assert (path.value_interval(x), path.value_interval(y)) == ((0, 99), (1, 100))
    assert path.value_interval(path.add(y, x, -1)) == (1, 100)
    assert path.compare("!=", x, 0)
    assert path.value_interval(x) == (1, 99)
    assert not path.copy().compare(">=", x, 100)


def test_a_register_is_one_name_in_every_form():
    path = Path(Run())
    x = path.new(0, 9)
    assert path.add(x, x, -1) == 0
    assert path.shr(path.shl(x, 4), 4) == x
    assert path.bitwise("&", x, 15) is x
    assert isinstance(path.add(x, 1), Lin)
    assert hash(path.add(x, 1)) == hash(path.add(1, x))


# ---- the whole design ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_proofs_hold_together_in_the_whole_design():
    found = range_wiring.instances()
    within_others, optional = {"pi", "isqrt", "lock_monitor", "fault_monitor"}, {"notch"}
    assert {one.stem for one in found.values()} == set(blocks.BLOCKS) - within_others - optional
    for name, one in found.items():
        assert one.analysis.sound, name
        assert [link.port for link in one.links] == [port.name for port in blocks.BLOCKS[one.stem].inputs]
        assert all(link.fits_format for link in one.links), name


@pytest.mark.slow
def test_a_wire_that_brings_too_much_is_seen(monkeypatch):
    block = blocks.BLOCKS["agc"]
    inputs = tuple(p._replace(fmt=bits(24)) if p.name == "magnitude" else p for p in block.inputs)
    monkeypatch.setitem(blocks.BLOCKS, "agc", block._replace(inputs=inputs))
    links = {link.port: link for link in range_wiring.instances.__wrapped__()["control.agc"].links}
    assert (links["magnitude"].fits_format, links["magnitude"].spare) == (False, -1)
    assert all(link.fits_format for port, link in links.items() if port != "magnitude")


# ---- report ----------------------------------------------------------------------------------------------------------


def test_the_bundle_holds_the_report(tmp_path):
    export.export("modulator", tmp_path)
    golden = bundle.read(tmp_path / "modulator" / "narrow")
    data = golden.manifest["ranges"]
    ports = {one["name"]: one for one in data["ports"]}
    assert ports["code"] == {
        "name": "code",
        "fmt": [1, 19, 0],
        "proven": [-20001, 19998],
        "seen": [-20001, 19998],
        "headroom_bits": 4,
        "proof": "induction",
    }
    assert (data["proven"], data["limit_bits"], data["widest"]["bits"]) == (True, 63, 42)
    text = (tmp_path / "modulator" / "narrow" / "RANGES.md").read_text()
    assert "all 5 ports proven" in text
    assert re.search(r"^    code +\[1,19,0\] +-20001 +19998 +-20001 +19998 +4$", text, re.M)


def test_a_register_without_proof_is_shown_as_width_only(monkeypatch):
    block = blocks.BLOCKS["rates"]
    hinted = block._replace(stops=())
    monkeypatch.setattr(ranges, "analyse_cached", lambda _, p, __: ranges.analyse(hinted._replace(registers=narrow), p))
    narrow = tuple(p._replace(fmt=bits(5)) if p.name == "slot" else p for p in block.registers)
    data = range_report.case_range_entry(block, "default")
    assert not data["proven"]
    assert "not proven:" in range_report.verdict(data)
    assert re.search(r"^    slot .* - +- +0 +60 +width only$", range_report.text("rates/default", data), re.M)


def test_command_line():
    done = CliRunner().invoke(cli.app, ["ranges", "isqrt", "--json"])
    assert done.exit_code == 0, done.output
    data = json.loads(done.output)["ranges"]["isqrt/default"]
    assert data["relations"] == ["1*remainder + -2*root"]
    done = CliRunner().invoke(cli.app, ["ranges", "isqrt"])
    assert done.exit_code == 0
    assert "Relations proven with them: 1*remainder + -2*root." in done.output


def test_hints_name_registers_that_exist():
    for block in blocks.BLOCKS.values():
        names = {port.name for port in block.registers}
        assert {name.rstrip("?") for name in block.split} <= names
        assert {name for one in block.relations for name in one} <= names


def test_every_kernel_of_the_blocks_was_read():
    """The widest results come from the blocks themselves: none is skipped by a hook."""
    for stem, case in CASES:
        if stem != "delay" and (stem, case) not in LONG:
            modules = {result.function.split(".")[0] for result in ranges.analyse_case(stem, case).results}
            assert modules & {stem, "fixed", "pi"}, stem
    step = importlib.import_module("fpga_model.pi").step
    assert read_function_source(step).name == "pi.step"
    assert File(step.py_func.__code__.co_filename if hasattr(step, "py_func") else step.__code__.co_filename).exists()
