"""Bus of the host: every register at every clock, pairs of words, and a sample that is read whole or not at all."""

import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpga_model import host_bus, registers, sequencer
from fpga_model.block import python_function
from fpga_model.design_record import DEFAULT
from tests import naive
from tests.fpga_model.records import assert_rows, rows

PAGE = Path(__file__).resolve().parents[2] / "docs" / "host_port.md"
INPUTS = tuple(host_bus.BLOCK.inputs)
SAMPLE, ERRORS = 8 * 0x50, 8 * 0x54
PHASE = 8 * 2
DEFAULT_PARAMS, NARROW = host_bus.design(), host_bus.design(DEFAULT._replace(dds_bits=32))
RDATA, STATUS, READY = (python_function(getattr(host_bus, name)) for name in ("rdata", "bus_status", "data_ready"))


def row(**given):
    return tuple(given.get(name, 0) for name in INPUTS)


def run(inputs, p=DEFAULT_PARAMS):
    return rows(lambda s, *i: host_bus.step(p, s, *i), host_bus.State(), inputs)


@st.composite
def hosts(draw):
    """Rows of a bus: reads and writes of few addresses, frames with and without a new rate."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    places = [SAMPLE, SAMPLE, SAMPLE + 4, SAMPLE + 8, ERRORS, PHASE, PHASE, PHASE + 4, 8 * 7, 8 * 7 + 4, 8 * 6, 0x600]
    busy = draw(st.sampled_from([0.1, 0.4, 0.9]))
    found = []
    for _ in range(draw(st.integers(0, 60))):
        i = {name: rng.randrange(fmt.lo, fmt.hi + 1) for name, fmt in host_bus.BLOCK.inputs.items()}
        i |= {name: int(rng.random() < busy) for name, fmt in host_bus.BLOCK.inputs.items() if fmt.width == 1}
        i["address"] = rng.choice(places) if rng.random() < 0.9 else rng.randrange(2048)
        if rng.random() < 0.5:
            i["write"] = 0
        found.append(row(**i))
    return found


@settings(max_examples=60)
@given(hosts(), st.sampled_from([((2, 3, 4, 5, 7), DEFAULT_PARAMS), ((), NARROW), ((1, 6), host_bus.Params(0x42))]))
def test_step_is_the_documented_equation(inputs, pairs_and_params):
    pairs, p = pairs_and_params
    assert_rows(run(inputs, p), naive.host_bus(pairs, inputs), host_bus.STATE_FMT)


def test_a_pair_is_written_in_one_clock_or_not_at_all():
    def written(*accesses):
        inputs = [row(write=1, address=address, data=data) for address, data in accesses]
        return [(s.bank_address, s.bank_data) for s in run([*inputs, row()])[1:] if s.bank_write]

    whole = (2, 0x1234_89AB_CDEF)
    assert written((PHASE, 0x89ABCDEF), (PHASE + 4, 0xFFFF1234)) == [whole], "bits above the register are dropped"
    assert written((PHASE, 0x89ABCDEF)) == [], "a low word alone"
    assert written((PHASE + 4, 0x1234)) == [], "a high word alone"
    assert written((PHASE, 1), (PHASE, 0x89ABCDEF), (PHASE + 4, 0x1234)) == [whole], "the last low word counts"
    assert written((PHASE, 1), (PHASE + 8 + 4, 2)) == [], "the high word of another register"
    assert written((PHASE, 1), (0x30, 5), (PHASE + 4, 2)) == [(6, 5)], "another write between them"
    assert written((PHASE, 1), (PHASE + 4, 2), (PHASE + 4, 3)) == [(2, 0x0002_0000_0001)], "one low word, one pair"
    assert written((0x30, 0xFFFFFFFF), (0x34, 7)) == [(6, 0xFFFFFFFF)], "a register of one word has no high word"
    narrow = run([row(write=1, address=PHASE, data=7), row()], NARROW)
    assert (narrow[1].bank_write, narrow[1].bank_data) == (1, 7), "phases of 32 bits are one word"


def test_a_pair_is_read_of_one_clock():
    value, later = 0xAAAA_0000_1111, 0xBBBB_0000_2222
    s = run([row(fetch=1, address=PHASE, value=value)])[-1]
    assert RDATA(s, PHASE, later) == 0x2222
    assert RDATA(s, PHASE + 4, later) == 0xAAAA, "the word that was latched"
    assert RDATA(s, PHASE + 8 + 4, later) == 0, "no low word of this register was read"


def sample(rate, k=0):
    return row(frame=1, valid=1, rate=rate, temperature=rate + 1, state=sequencer.LOCKED, lock=15, k=k)


TAKE, DONE, START = row(fetch=1, address=SAMPLE), row(done=1), row(start=1)


@pytest.mark.parametrize(
    ("inputs", "unread", "number"),
    [
        ([], 0, 0),
        ([sample(5)], 1, 0),
        ([sample(5), sample(6)], 2, 1),
        ([sample(5), START, TAKE, DONE], 0, 0),
        ([sample(5), START, TAKE, START], 1, 0),
        ([sample(5), START, TAKE, sample(6), DONE], 1, 1),
        ([sample(5), START, TAKE, sample(6), START], 2, 1),
        ([sample(5), START, TAKE, sample(6), sample(7), DONE], 2, 2),
        ([sample(5), START, DONE], 1, 0),
        ([sample(5), sample(6), START, TAKE, DONE], 0, 1),
        ([row(frame=1), row(frame=1), sample(7)], 1, 2),
    ],
)
def test_what_is_read_counts_as_read_and_what_is_lost_as_lost(inputs, unread, number):
    """An aborted read (START without DONE) leaves its sample unread; one that comes meanwhile is new."""
    s = run([*inputs, row()])[-1]
    assert (s.unread, s.number) == (unread, number)
    assert READY(s) == int(unread > 0)


def test_the_sample_of_a_read_is_of_one_frame():
    """Its words stay while frames go on, until the next read of its rate."""
    s = run([sample(5, k=3), TAKE, sample(6), sample(7)])[-1]
    assert (s.held_temperature, s.held_number, s.number) == (6, 0, 2)
    assert s.held_status == sequencer.LOCKED << 8 | 15 << 12 | 3 << 16 | host_bus.NEW
    assert run([sample(5), sample(6), TAKE])[-1].held_status & host_bus.OVERRUN


def test_the_status_of_a_frame():
    s = run([row(write=1, address=PHASE), sample(1), sample(2)])[-1]
    assert host_bus.STATUS_BITS == ("PENDING", "LOCKED", "FAULT", "OVERRUN", "DATA_READY")
    assert STATUS(s, 0, 0) == 0b11001
    assert STATUS(host_bus.State(), 4, sequencer.LOCKED) == 0b00110


def test_addresses_and_words_are_those_of_the_map():
    assert host_bus.SAMPLE_RATE == SAMPLE
    assert host_bus.ERRORS_REGISTER * 8 == ERRORS
    found = run([row(write=1, address=ERRORS, data=0xFFFFFFFD), row()])
    assert [s.clear for s in found] == [0, 5, 0]
    two_words = {r.address for r in registers.WRITABLE if r.fmt.width > 32}
    assert {k for k in range(8) if DEFAULT_PARAMS.pairs >> k & 1} == two_words
    assert NARROW.pairs == 0
    assert host_bus.sample_status_fields() == {
        "FLAGS": (0, 8), "STATE": (8, 4), "LOCK": (12, 4), "K": (16, 3), "NEW": (19, 1), "OVERRUN": (20, 1)
    }  # fmt: skip


def test_the_page_has_the_map():
    page = PAGE.read_text()
    for r in host_bus.MAP:
        assert f"- 0x{r.address:02X} {r.name.upper()}, {r.fmt}" in page
    for k, name in enumerate(host_bus.STATUS_BITS):
        assert f"{k + 3} {name}" in page
    bits = next(r for r in host_bus.MAP if r.name == "sample_status").doc.removeprefix("of the sample: ")
    assert f"bits {bits}" in page
