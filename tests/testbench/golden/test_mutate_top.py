"""Wiring mutants: rows 64 at a time against plain evaluation, the judge's verdicts joined, the design itself (slow)."""

import re
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbench.errors import ConfigError, FileError
from testbench.golden.loop import library
from testbench.golden.mutation import miter, mutant_judge, mutate, mutate_top
from testbench.golden.recording import recording
from tests.testbench.rtl.test_rtl import RTL

NO_TOOLS = pytest.mark.skipif(any(shutil.which(name) is None for name in mutate.TOOLS), reason="no yosys")
LEAVES, ROWS = 6, 150


def graph_of(draws):
    """`miter.Net` over LEAVES leaves whose ANDs are drawn: (place, inverted, place, inverted)."""
    net, literals = miter.Net(LEAVES), [2 * (k + 1) for k in range(LEAVES)]
    for a, na, b, nb in draws:
        literals.append(net.both(literals[a % len(literals)] ^ na, literals[b % len(literals)] ^ nb))
    return net, literals


def plain(net, literal, bits):
    """Value of a literal for one row of leaves."""
    node, flip = divmod(literal, 2)
    if node == 0:
        return flip
    if node < net.first:
        return int(bits[node - 1]) ^ flip
    left, right = net.ands[node - net.first]
    return (plain(net, left, bits) & plain(net, right, bits)) ^ flip


places = st.tuples(st.integers(0, 30), st.integers(0, 1), st.integers(0, 30), st.integers(0, 1))


@settings(max_examples=60, deadline=None)
@given(st.lists(places, min_size=1, max_size=12), st.integers(0, 2**32), st.integers(1, ROWS))
def test_the_first_row_is_that_of_a_plain_evaluation(draws, seed, count):
    net, literals = graph_of(draws)
    rows = np.random.default_rng(seed).integers(0, 2, (count, LEAVES))
    design = mutate_top._Design.__new__(mutate_top._Design)
    design.judge = type("Judge", (), {"net": net})
    design._where = [((k, 0, 0), k + 1) for k in range(LEAVES)]
    for literal in (literals[-1], literals[-1] ^ 1):
        wanted = [n for n, bits in enumerate(rows) if plain(net, literal, bits)]
        assert design.find_first_true_row(literal, rows) == (wanted[0] if wanted else -1)


@settings(max_examples=40, deadline=None)
@given(st.lists(places, min_size=1, max_size=12), st.integers(0, 2**32))
def test_a_compact_graph_computes_the_same(draws, seed):
    from testbench.golden.mutation.aig import Graph

    net, literals = graph_of(draws)
    outs = np.array([literals[-1], literals[-1] ^ 1, 0, 1, literals[0]])
    nodes = [divmod(x, 2) for x in outs.tolist()]
    before = Graph({}, {}, LEAVES - 1, outs, np.array([literals[-1]]), np.array(net.ands, np.int64).reshape(-1, 2))
    after = miter.compact(before)
    assert len(after.ands) <= len(net.ands)
    again = miter.Net(LEAVES)
    found, following = again.copy(after, [2 * (k + 1) for k in range(LEAVES)])
    for bits in np.random.default_rng(seed).integers(0, 2, (8, LEAVES)):
        values = [plain(net, 2 * node + flip, bits) for node, flip in nodes]
        assert [plain(again, x, bits) for x in found] == values
        assert [plain(again, x, bits) for x in following] == values[:1]


def test_ranges_of_numbers_are_compared_right():
    for signed, width in ((False, 4), (True, 4), (True, 1), (False, 1)):
        lowest = -(1 << width - 1) if signed else 0
        for lo in range(lowest, lowest + (1 << width)):
            for hi in range(lo, lowest + (1 << width)):
                net = miter.Net(width)
                bounds = net.bound_literals([2 * (k + 1) for k in range(width)], signed, lo, hi)
                for value in range(lowest, lowest + (1 << width)):
                    bits = [value >> k & 1 for k in range(width)]
                    assert all(plain(net, x, bits) for x in bounds) == (lo <= value <= hi)


def test_equivalent_in_every_case_or_not_at_all():
    same, alive = mutant_judge.Verdict("equivalent", "in every state", []), mutant_judge.Verdict("alive", "x", [{}])
    assert mutate_top._worst(iter([same, same])) is same
    assert mutate_top._worst(iter([same, alive])) is alive
    rest = iter([alive, same])
    assert mutate_top._worst(rest) is alive
    assert next(rest) is same  # nothing is judged once it is known


def test_ranges_that_are_tried_are_those_of_the_loops():
    params = recording.load("reset").params
    tried = mutate_top._ranges(params)
    ports = dict(zip(library.PORTS, library.port_formats(params.design), strict=True))
    limit = params.control.agc.loop.hi
    assert tried["r_control_agc_loop_y"] == (True, 0, limit)
    assert tried["r_control_agc_loop_acc"] == (True, 0, limit << 24)
    assert tried["r_control_quadrature_loop_loop_prop"] == (True, 0, 0)  # it has no proportional part
    assert all(ports[port].s and ports[port].holds(lo) and ports[port].holds(hi) for port, (_, lo, hi) in tried.items())


def test_bad_numbers_are_named():
    for given_ in ({"count": 0}, {"seed": -1}):
        with pytest.raises(ConfigError, match="count, seed: "):
            mutate_top.score_wiring(RTL, **given_)


@NO_TOOLS
def test_a_missing_design_is_named(tmp_path):
    with pytest.raises(FileError, match=re.escape(f"{tmp_path / 'top.v'}: no design")):
        mutate_top.score_wiring(tmp_path)


@NO_TOOLS
@pytest.mark.slow
def test_the_wiring_of_the_reference_design():
    outcome = mutate_top.score_wiring(RTL, ("reset",), count=20)
    assert outcome.mutants == 20
    assert outcome.killed + outcome.equivalent == 20, outcome.text()


@NO_TOOLS
@pytest.mark.slow
def test_a_wrong_wire_has_no_score(tmp_path):
    for path in RTL.glob("*.v"):
        shutil.copy(path, tmp_path)
    text = (tmp_path / "top.v").read_text()
    wrong = re.sub(r"(\.sense_sin\s*\()code_sense_sin(\))", r"\1code_sense_cos\2", text, count=1)
    assert wrong != text
    (tmp_path / "top.v").write_text(wrong)
    with pytest.raises(FileError, match="top/reset: the design differs from the model at clock"):
        mutate_top.score_wiring(tmp_path, ("reset",), count=1)
