"""SPI slave: every register at every clock, and a host in time at its pins: what it writes, reads and is told."""

import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpga_model import spi_slave
from fpga_model.block import python_function
from tests import naive
from tests.fpga_model import spi_host
from tests.fpga_model.records import assert_rows, rows

MASTER_MHZ = 26
SLOTS = 512  # words that an address reaches
STEP = python_function(spi_slave.step)
SDO, FETCH, START = (python_function(getattr(spi_slave, name)) for name in ("sdo", "fetch", "start"))


@st.composite
def sampled_frames(draw):
    """Rows of inputs: frames at up to one bit in two clocks, cut or spoiled at random, or levels without a plan."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    host = spi_host.Host(rng)
    found = []

    def take(times, cs_n, sck, sdi):
        for _ in range(times):
            clear = rng.randrange(8) if rng.random() < 0.2 else 0
            found.append((cs_n, sck, sdi, rng.randrange(32), rng.getrandbits(32), clear))

    for _ in range(draw(st.integers(1, 3))):
        host.any_frame(period=5.0, most_words=3)
        take(rng.randrange(4), 0, 0, 0)
        low, high = rng.choice([(1, 1), (1, 1), (1, 2), (2, 1)])
        for bit in host.frames[-1].bits:
            take(low, 0, 0, int(bit))
            take(high, 0, 1, int(bit))
        take(rng.randrange(3), 0, 0, 0)
        take(rng.choice([1, 2, 3, 4, 9]), 1, 0, 0)
    for _ in range(draw(st.sampled_from([0, 0, 60]))):
        take(1, int(rng.random() < 0.1), rng.randrange(2), rng.randrange(2))
    return found


@settings(max_examples=40)
@given(sampled_frames())
def test_step_is_the_documented_equation(inputs):
    assert_rows(rows(spi_slave.step, spi_slave.State(), inputs), naive.spi_slave(inputs), spi_slave.STATE_FMT)


def talked(host, rng, churn=0.0):
    """What becomes of a host's frames: (input rows, states before each edge, what the memory held at each edge).

    The bus is a memory of words; with `churn` a word changes by itself in so many clocks of a hundred.
    """
    memory = {slot: rng.getrandbits(32) for slot in range(SLOTS)}
    s, inputs, states, changes = spi_slave.State(), [], [], [(0, dict(memory))]
    for n, pins in enumerate(host.pins()):
        if s.write:
            memory[s.address >> 2] = s.data
            changes.append((n, {s.address >> 2: s.data}))
        elif rng.random() < churn:
            slot = rng.choice([s.address >> 2, rng.randrange(SLOTS)])
            memory[slot] = rng.getrandbits(32)
            changes.append((n, {slot: memory[slot]}))
        row = (*pins, rng.randrange(32), memory[s.address >> 2], 0)
        inputs.append(row)
        states.append(s)
        s = STEP(s, *row)
    return inputs, states, changes


def assert_served(host, inputs, states, changes, own=()):
    """Each frame did what a host expects, and nothing else; `own` are clocks at which the memory changed by itself."""
    sdo = [SDO(s) for s in states]
    written = [(n, s.address, s.data) for n, s in enumerate(states) if s.write]
    done = [n for n, s in enumerate(states) if s.done]
    errors = 0
    for frame, following in zip(host.frames, [*host.frames[1:], None], strict=True):
        until = following.begin if following else float("inf")
        inside = [(address, word) for n, address, word in written if frame.begin < n <= until]
        complete = frame.flag == 0 and bool(frame.bits)
        wanted = [((frame.address + 4 * k) % (4 * SLOTS), word) for k, word in enumerate(frame.words)]
        assert inside == (wanted if complete and not frame.read else [])
        assert sum(frame.begin < n <= until for n in done) == int(complete and frame.read == 1)
        told = spi_host.heard(frame, sdo)
        if len(told) >= 16:
            assert int(told[:8], 2) ^ int(told[8:16], 2) == 255, "status and its complement"
            assert int(told[:8], 2) & 7 == errors, "every error is told, and none else"
            begun = [row[3] for n, row in enumerate(inputs) if abs(n - frame.begin) < 5]
            assert int(told[:8], 2) >> 3 in begun, "the bus's bits are those of the frame's beginning"
        errors |= frame.flag
        if complete and frame.read:
            data = told[24:]
            assert data[-8:] == spi_host.crc(frame.bits[:16] + data[:-8]), "the CRC of the reply"
            for k in range(len(frame.words)):
                slot = (frame.address // 4 + k) % SLOTS
                first = frame.rises[15 if k == 0 else 24 + 32 * (k - 1)]
                last = frame.rises[24 + 32 * k]
                held = [word[slot] for n, word in changes if slot in word and n < last]
                stood = [word[slot] for n, word in changes if slot in word and first < n < last]
                assert int(data[32 * k : 32 * k + 32], 2) in (held[-1 - len(stood) :]), "a word that stood there then"
    return errors


def host_of(seed, frames, **kinds):
    rng = random.Random(seed)
    host = spi_host.Host(rng)
    for _ in range(frames):
        host.any_frame(**kinds)
    return host, rng


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)])
def test_a_host_is_served_at_every_clock_and_phase(seed):
    """SCK of 0.1 to 5.2 MHz, first flip-flops that take old or new, frames wrong in every way, a bus that changes."""
    host, rng = host_of(seed, 60)
    inputs, states, changes = talked(host, rng, churn=0.02)
    assert assert_served(host, inputs, states, changes) == spi_slave.ERRORS.hi, "all errors came"


def test_the_limit_of_sck_is_that_of_the_page():
    """At 5 clocks to a bit every frame is served; at 4.2 the pins or the flip-flops lose bits."""
    host, rng = host_of(5, 60, period=spi_host.PERIOD)
    assert_served(host, *talked(host, rng))
    assert spi_slave.LEAST_PERIOD_CLOCKS == spi_host.PERIOD
    assert spi_slave.LEAST_LEVEL_CLOCKS == spi_host.LEVEL
    assert MASTER_MHZ / spi_host.PERIOD == pytest.approx(5.2)
    host, rng = host_of(5, 60, period=4.2)
    with pytest.raises(AssertionError):
        assert_served(host, *talked(host, rng))


def test_the_crc_is_the_published_one_and_finds_every_error_of_two_bits_in_the_longest_frame():
    assert naive.crc_j1850("".join(f"{c:08b}" for c in b"123456789")) ^ 255 == 0x4B, "check value of CRC-8/SAE-J1850"
    divided, left = python_function(spi_slave.divided), spi_slave.CRC_MASK
    for bit in "".join(f"{c:08b}" for c in b"123456789"):
        left = divided(left, int(bit))
    assert left ^ spi_slave.CRC_MASK == 0x4B
    length = 16 + 32 * spi_slave.COUNT_MASK + 8
    syndromes, power = set(), 1
    for _ in range(length):
        syndromes.add(power)
        power = (power << 1) ^ (0x11D if power & 0x80 else 0)
    assert len(syndromes) == length == 248, "all single errors differ, so no two of them cancel"
    assert 0 not in syndromes


def test_latency_is_that_of_the_page():
    bits = spi_host.text(0, 0x10, [0x12345678])
    inputs = [(1, 0, 0, 0, 0, 0)] * 6 + [(0, 0, 0, 0, 0, 0)] * 4
    inputs += [(0, level, int(bit), 0, 0, 0) for bit in bits for level in (0, 0, 0, 1, 1)]
    first = 10 + 3
    assert inputs[first][1] == 1
    end = len(inputs)
    found = rows(spi_slave.step, spi_slave.State(), [*inputs, *[(1, 0, 0, 0, 0, 0)] * 8])
    assert [s.bit for s in found[first : first + 4]] == [0, 0, 0, 1]
    assert [s.write for s in found[end : end + 5]] == [0, 0, 0, 1, 0]
    assert (found[end + 3].address, found[end + 3].data) == (0x10, 0x12345678)
    assert [START(s) for s in found].index(1) == 6 + spi_slave.LATENCY - 1
    assert np.sum([FETCH(s) for s in found]) == 0
    assert spi_slave.BLOCK.latency == {"sdo": 3, "write": 3, "done": 3}


def test_the_page_has_the_numbers():
    page = (Path(__file__).resolve().parents[2] / "docs" / "host_port.md").read_text()
    mhz = MASTER_MHZ / spi_host.PERIOD
    for text in (
        f"- SCK: period at least {spi_host.PERIOD:g} ({mhz:g} MHz), high and low at least {spi_host.LEVEL:g}",
        f"- SDI: at least {spi_host.SETUP_SDI:g} before and {spi_host.LEVEL:g} behind the rise of SCK",
        f"- SDO: valid until {spi_host.HOLD_SDO:g} behind the rise, "
        f"next bit at most {spi_host.PERIOD - spi_host.SETUP_SDO:g} behind it",
        f"- CS_N: low at least {spi_host.LEAD:g} before the first rise and {spi_host.LEVEL:g} behind the last, "
        f"high at least {spi_host.HIGH:g}",
        f"n = 1 .. {spi_slave.COUNT_MASK}. SDI",
    ):
        assert text in page, text
