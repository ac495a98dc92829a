"""AXI4-Lite slave: every register at every clock; a host with random wait states: what it writes, reads and is told."""

import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpga_model import axi_slave
from fpga_model.block import python_function
from tests import naive
from tests.fpga_model import axi_host
from tests.fpga_model.records import assert_rows, rows

PAGE = Path(__file__).resolve().parents[2] / "docs" / "host_port.md"
INPUTS = tuple(axi_slave.BLOCK.inputs)
STEP = python_function(axi_slave.step)
ADDRESS, WRITE, FETCH, DONE = (
    python_function(getattr(axi_slave, name)) for name in ("address", "write", "fetch", "done")
)
OKAY, SLVERR = 0, 2
SLOTS = 512


@st.composite
def levels(draw):
    """Rows of inputs: every channel valid and ready at random, busy or slow, rules kept or not."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    found = []
    for _ in range(draw(st.integers(0, 4))):
        share = {name: rng.choice([0.0, 0.1, 0.5, 0.9, 1.0]) for name in INPUTS}
        for _ in range(rng.randrange(30)):
            row = {name: rng.randrange(fmt.lo, fmt.hi + 1) for name, fmt in axi_slave.BLOCK.inputs.items()}
            row |= {n: int(rng.random() < share[n]) for n, fmt in axi_slave.BLOCK.inputs.items() if fmt.width == 1}
            if rng.random() < 0.7:
                row |= {"awaddr": row["awaddr"] & ~3, "araddr": row["araddr"] & ~3, "wstrb": rng.choice([0, 15, 15])}
            found.append(tuple(row.values()))
    return found


@settings(max_examples=80)
@given(levels())
def test_step_is_the_documented_equation(inputs):
    assert_rows(rows(axi_slave.step, axi_slave.State(), inputs), naive.axi_slave(inputs), axi_slave.STATE_FMT)


def requests(rng, count):
    """Writes and reads of few words, so that they meet; some with strobes or an address that is refused."""

    def address():
        return rng.choice([4 * rng.randrange(6), 4 * rng.randrange(6), 4 * rng.randrange(SLOTS), rng.randrange(2048)])

    def strobes():
        return rng.choice([15, 15, 15, 0, rng.randrange(16)])

    writes = [axi_host.Write(address(), rng.getrandbits(32), strobes()) for _ in range(count)]
    return writes, [axi_host.Read(address()) for _ in range(count)]


def talked(host, rng):
    """What becomes of a host's requests: (inputs, states, pins of the bus, {slot: [(clock, word)]}) at each edge."""
    memory = {slot: [(-1, rng.getrandbits(32))] for slot in range(SLOTS)}
    s, inputs, states = axi_slave.State(), [], []
    while host.open:
        assert host.clock < 20_000, "the host waits for ever"
        slot, pins = ADDRESS(s) >> 2, host.before()
        row = (*pins, memory[slot][-1][1])
        inputs.append(row)
        states.append(s)
        if WRITE(s):
            memory[slot].append((host.clock, s.wdata))
        after = STEP(s, *row)
        host.behind(s)
        s = after
    return inputs, states, memory


def assert_served(host, states, memory):
    """Each write did what its response says, each read has a word that stood while it was under way."""
    written = iter([(n, ADDRESS(s), s.wdata) for n, s in enumerate(states) if WRITE(s)])
    for w in host.of_writes:
        refused = w.address % 4 != 0 or w.strobes not in (0, 15)
        assert w.response == (SLVERR if refused else OKAY)
        assert min(w.end - t for t in w.taken) >= axi_slave.LATENCY
        if not refused and w.strobes:
            clock, address, data = next(written)
            assert (address, data) == (w.address, w.data)
            assert max(w.taken) < clock < w.end
    assert next(written, None) is None, "nothing else is written"
    for r in host.of_reads:
        assert r.response == (SLVERR if r.address % 4 else OKAY)
        if r.address % 4:
            assert r.word == 0
            continue
        held = memory[r.address >> 2]
        stood = {word for k, (n, word) in enumerate(held) if k + 1 == len(held) or held[k + 1][0] > r.taken}
        before = {word for n, word in held if n < r.end}
        assert r.word in stood & before, "a word that stood between request and response"
    assert sum(FETCH(s) for s in states) == sum(r.address % 4 == 0 for r in host.of_reads)


@pytest.mark.parametrize("busy", [0.05, 0.5, 1.0])
def test_a_host_with_random_wait_states_is_served(busy):
    rng = random.Random(f"axi {busy}")
    host = axi_host.Host(rng, *requests(rng, 60), busy)
    _, states, memory = talked(host, rng)
    assert_served(host, states, memory)
    assert {w.response for w in host.of_writes} == {r.response for r in host.of_reads} == {OKAY, SLVERR}


def test_a_read_behind_the_response_of_a_write_has_what_was_written():
    rng = random.Random(2)
    for data in (0x12345678, 0xFFFFFFFF, 0):
        host = axi_host.Host(rng, [axi_host.Write(0x40, data, 15)])
        talked(host, rng)
        assert host.of_writes[0].response == OKAY
    s, word = axi_slave.State(), None
    for pins in [(1, 0x40, 1, 7, 15, 1, 0, 0, 1), *[(0, 0, 0, 0, 0, 1, 1, 0x40, 1)] * 6]:
        if WRITE(s):
            word = s.wdata
        s = STEP(s, *pins, word if ADDRESS(s) == 0x40 and word is not None else 0)
    assert (s.rdata, s.rresp) == (7, OKAY)


def row(**given):
    return tuple({**dict.fromkeys(INPUTS, 0), "bready": 1, "rready": 1, **given}[name] for name in INPUTS)


ASKED = row(awvalid=1, awaddr=8, wvalid=1, wdata=5, wstrb=15)


def test_latency_is_that_of_the_page():
    found = rows(STEP, axi_slave.State(), [ASKED, *[row()] * 4])
    assert [WRITE(s) for s in found] == [0, 1, 0, 0, 0, 0]
    assert [s.bvalid for s in found] == [0, 0, 1, 0, 0, 0]
    found = rows(STEP, axi_slave.State(), [row(arvalid=1, araddr=8), row(word=9), *[row()] * 3])
    assert [FETCH(s) for s in found] == [0, 1, 0, 0, 0, 0]
    assert [s.rvalid for s in found] == [0, 0, 1, 0, 0, 0]
    assert found[2].rdata == 9
    assert [DONE(s, 1) for s in found] == [0, 0, 1, 0, 0, 0]
    assert not any(DONE(s, 0) for s in found)


def test_a_host_without_wait_states_has_an_access_in_two_clocks_of_each_kind():
    """Writes and reads together: neither kind stops the other."""
    every = row(awvalid=1, wvalid=1, wstrb=15, arvalid=1)
    found = rows(STEP, axi_slave.State(), [every] * 40)
    assert sum(WRITE(s) for s in found) == sum(FETCH(s) for s in found) == 20
    only = rows(STEP, axi_slave.State(), [row(arvalid=1)] * 40)
    assert sum(FETCH(s) for s in only) == 20
    stopped = rows(STEP, axi_slave.State(), [row(awvalid=1, wvalid=1, wstrb=15, arvalid=1, bready=0)] * 40)
    assert sum(WRITE(s) for s in stopped) == 1, "one response waits"
    assert sum(FETCH(s) for s in stopped) == 20, "and reads go on"


def test_the_page_has_the_numbers():
    page = PAGE.read_text()
    taken = [row(arvalid=1)] * 7 + [row()] * 3
    found = rows(STEP, axi_slave.State(), taken)
    words = [n for n, s in enumerate(found) if DONE(s, 1)]
    assert words == [2, 4, 6, 8]
    assert f"The response is seen {axi_slave.LATENCY} clocks after the edge that takes the request" in page
