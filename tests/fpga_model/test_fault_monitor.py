"""The fault monitor: every register at every clock, each symptom to the frame, and the sticky latch."""

import inspect
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import fault_monitor as fm
from tests import naive
from tests.fpga_model.records import assert_rows, rows

SMALL = fm.Params(over_range=3, stuck=4, drive=2, rate=1, rail=5, top=7)
flag = st.sampled_from([0, 0, 1])
code = st.sampled_from([0, 1, -1, 0x7FFEFF, 0x7FFF00, -0x7FFEFF, -0x7FFF00, -(2**23), 2**23 - 1])
calm = st.sampled_from([(1, 2, 3, 4), (1, 2, 3, 5)])
edge = st.tuples(
    st.sampled_from([1, 1, 1, 0]),
    st.sampled_from([1] * 8 + [0]),
    st.sampled_from([1, 1, 1, 0]),
    st.one_of(calm, st.tuples(code, code, code, code)),
    flag,
    flag,
    flag,
    st.sampled_from([1, 1, 0]),
    st.sampled_from([0, 0, fm.LOST_LOCK, fm.SEARCH_FAILED, fm.LOST_LOCK | fm.SEARCH_FAILED]),
    st.one_of(st.just(0), st.integers(0, 255)),
    st.integers(1, 5),
)


def run(p, inputs):
    return rows(lambda s, *i: fm.step(p, s, *i), fm.State(), inputs)


def expected_rows(p, inputs):
    faults = naive.Faults(p)
    expected = [faults.row()]
    for en, *values in inputs:
        if en:
            levels = [
                n for bit, n in ((fm.LOST_LOCK, "lost_lock"), (fm.SEARCH_FAILED, "search_failed")) if values[7] & bit
            ]
            faults.frame(*values[:7], levels, values[8])
        expected.append(faults.row())
    return expected


def frame(fresh=1, codes=(1, 2, 3, 4), drive=0, rate=0, rail=0, watch=1, levels=0, clear=0, armed=1, en=1):
    return (en, armed, fresh, codes, drive, rate, rail, watch, levels, clear)


def moving(n, **what):
    """Frames whose codes change."""
    return [frame(codes=(k, 2 + k, 3 + k, 4 + k), **what) for k in range(n)]


@given(st.sampled_from([SMALL, fm.Params(0, 0, 0, 0, 0, 1), fm.design()]), st.lists(edge, max_size=25))
def test_step_is_the_documented_equation(p, edges):
    inputs = [tuple(e[:-1]) for e in edges for _ in range(e[-1])]
    assert_rows(run(p, inputs), expected_rows(p, inputs), fm.STATE_FMT)


@pytest.mark.parametrize("what", ["drive", "rate", "rail"])
@pytest.mark.parametrize("p", [SMALL, fm.design()])
def test_flags_rise_with_the_last_frame_of_the_debounce(what, p):
    n = getattr(p, what)
    bit = {"drive": fm.DRIVE_SATURATED, "rate": fm.RATE_SATURATED, "rail": fm.QSC_RAIL}[what]
    flags = [s.flags for s in run(p, moving(n + 2, **{what: 1}) + moving(1))]
    assert flags == [0] * n + [bit] * 3 + [0]


@pytest.mark.parametrize("code", [0x7FFF00, -0x7FFF00, 2**23 - 1, -(2**23)])
@pytest.mark.parametrize("lane", range(4))
def test_over_range_of_every_channel(code, lane):
    codes = tuple(code if k == lane else k for k in range(4))
    p = SMALL._replace(stuck=0)
    assert [s.flags for s in run(p, [frame(codes=codes)] * 4)] == [0, 0, 0, fm.OVER_RANGE, fm.OVER_RANGE]
    below = tuple((code - 1 if code > 0 else code + 1) if k == lane and abs(code) == 0x7FFF00 else k for k in range(4))
    assert not any(s.flags for s in run(p, [frame(codes=below)] * 9))


@pytest.mark.parametrize("frozen", [(lane,) for lane in range(4)] + [(0, 1, 2, 3)])
def test_stuck_is_any_code_that_rests(frozen):
    def moved(n):
        return frame(codes=tuple(c + (0 if k in frozen else n) for k, c in enumerate((1, 2, 3, 4))))

    # the first frame moves the codes from their reset values
    found = [s.flags for s in run(SMALL, [moved(n) for n in range(6)] + [frame(codes=(70, 70, 70, 70))])]
    assert found == [0] * 5 + [fm.STUCK] * 2 + [0]


def test_codes_that_move_or_are_clipped_are_not_stuck():
    assert not any(s.flags for s in run(SMALL, [frame(codes=(n, -n, 3 * n, 7 - n)) for n in range(9)]))
    for limit in (fm.RANGE_LIMIT, -fm.RANGE_LIMIT, 2**23 - 1, -(2**23)):
        found = run(SMALL._replace(over_range=0), [frame(codes=(n, limit, 3 * n, 7 - n)) for n in range(9)])
        assert not any(s.flags for s in found)


def test_one_frame_in_which_all_codes_move_starts_the_count_again():
    # of SMALL.stuck = 4 frames
    turns = [frame(codes=(n if k == 3 else 1, 2 * n, 3 * n, 4 * n)) for n, k in enumerate([0, 1, 2, 3] * 4)]
    assert not any(s.flags for s in run(SMALL, turns))


def test_stale_counts_and_recovery():
    found = run(SMALL, moving(3) + [frame(fresh=0)] * 4 + moving(2))
    assert [s.flags for s in found] == [0] * 4 + [fm.STALE] * 4 + [0] * 2
    assert [s.bad_frames for s in found] == [0] * 4 + [1, 2, 3, 4] + [0] * 2
    assert [s.good_frames for s in found] == [0, 1, 2, 3] + [0] * 4 + [1, 2]


def test_long_counts_saturate():
    for p in (SMALL, fm.design()):
        for name, fresh in (("good_frames", 1), ("bad_frames", 0)):
            for count in (p.top - 1, p.top):
                s = fm.State(**{name: count})
                assert getattr(fm.step(p, s, *frame(fresh=fresh)), name) == p.top
    assert fm.design().top == 2**16 - 1


def test_latch_is_sticky_and_a_live_fault_cannot_be_cleared():
    found = run(SMALL, [frame(fresh=0), *moving(2), frame(clear=fm.RATE_SATURATED), frame(clear=fm.STALE)])
    assert [s.latch for s in found] == [0, fm.STALE, fm.STALE, fm.STALE, fm.STALE, 0]
    assert run(SMALL, [frame(fresh=0, clear=fm.STALE)])[-1].latch == fm.STALE


def test_table_of_the_header():
    d = {k: v.default for k, v in inspect.signature(fm.design).parameters.items()}
    names = {
        "OVER_RANGE": "over_range_s",
        "STUCK": "stuck_s",
        "DRIVE_SATURATED": "drive_s",
        "RATE_SATURATED": "rate_s",
        "QSC_RAIL": "rail_s",
    }
    p = fm.design()
    for name, parameter in names.items():
        frames = getattr(p, parameter.removesuffix("_s"))
        assert any(
            f" {name} " in line and f"  {1e3 * d[parameter]:g} ms, {frames} frames  " in line
            for line in fm.__doc__.splitlines()
        ), name


def test_flags_of_the_header_are_the_bits():
    listed = re.findall(r"^    (\d) ([A-Z_]+) ", fm.__doc__, re.M)
    assert [(int(bit), name) for bit, name in listed] == list(enumerate(fm.NAMES))


def test_design_refuses_what_its_counters_do_not_hold():
    with pytest.raises(ValueError, match="rail_s"):
        fm.design(rail_s=1.0)
    with pytest.raises(ValueError, match="top"):
        fm.design(top=2**16)
