"""The AXI4-Lite port of the whole design in Verilog: at every clock the model's, and a host with random wait states.

The loop is that of the plant around the RTL, as for the SPI port: every pin is the model's while the host talks.
"""

import random
from pathlib import Path

import numpy as np
import pytest

from fpga_model import axi_slave, host_bus, registers
from testbench.config import Config
from testbench.golden.loop import run
from tests.testbench.rtl import host_port, test_host
from tests.testbench.rtl.host_port import EVERY, OF_BANK, Board, address, board_of
from tests.testbench.rtl.test_rtl import OF_HOST, RTL, ghdl, icarus, ran, verilator

SAMPLE, REGISTER, WRITE, SOME_STROBES, UNALIGNED, NO_STROBE, HALF_PAIR = range(7)
REFUSED = (SOME_STROBES, UNALIGNED)
WORDS = tuple(f"word{k}" for k in range(7))
COLUMNS = ("kind", "begin", "taken", "end", "response", "address", *WORDS, "lost", "busy")
OKAY, SLVERR, EVERY_BYTE = 0, 2, 15


# ---- the port alone, at every clock ----------------------------------------------------------------------------------


@verilator
@pytest.mark.parametrize("stem", ["host", "host_axi"])
def test_verilator_has_no_warning(stem, tmp_path):
    sources = [RTL / f"{name}.v" for name in (*OF_HOST[stem], stem)]
    ran(["verilator", "--lint-only", "-Wall", "--top-module", f"gyro_{stem}", *sources], tmp_path, silent=True)


@pytest.mark.parametrize("language", [pytest.param("v", marks=icarus), pytest.param("vhd", marks=ghdl)])
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_rtl_of_the_port_is_the_model(seed, language, tmp_path):
    """Every register and pin at every clock: requests of every kind, registers of the firmware that never rest."""
    _, _, states = host_port.model("host_axi", seed)
    assert min(sum(s.bus.bank_write for s in states), sum(s.bus.reading for s in states)) > 30
    assert host_port.difference("host_axi", language, seed, tmp_path) is None


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return board_of("host_axi", tmp_path_factory.mktemp("host_axi"))


# ---- registers over the port -----------------------------------------------------------------------------------------


def read_of(register):
    return (REGISTER, address(register), 2)


def writes_of(register, raw):
    """Items of the host's list: the words of a register."""
    word = registers.to_bus(raw, register.fmt)
    yield (WRITE, address(register), word & host_bus.WORD_MASK, EVERY_BYTE)
    if register.fmt.width > host_bus.WORD_BITS:
        yield (WRITE, address(register) + 4, word >> host_bus.WORD_BITS, EVERY_BYTE)


def words_read(lines):
    """Words of 48 bits of all reads of registers, in order."""
    at = lines["kind"] == REGISTER
    return (lines["word0"][at] | lines["word1"][at] << 32).tolist()


@pytest.mark.slow
def test_every_register_is_written_and_read_back_and_what_is_refused_changes_nothing(built):
    draw = random.Random(3)
    with Board(built, COLUMNS) as port:
        port.plan(7, 1, 0.1)
        expected = []
        for r in (r for r in EVERY if r.access != "ro" or not r.path):
            port.ask(read_of(r))
            expected.append(registers.to_bus(r.reset, r.fmt))
        for r in OF_BANK:
            raw, at = draw.randint(r.fmt.lo, r.fmt.hi), address(r)
            port.ask(*writes_of(r, raw), read_of(r))
            port.ask((SOME_STROBES, at, draw.getrandbits(32), draw.randint(1, 14)), read_of(r))
            port.ask((UNALIGNED, at + draw.randint(1, 3), draw.getrandbits(32), EVERY_BYTE), read_of(r))
            port.ask((NO_STROBE, at, draw.getrandbits(32), 0), read_of(r))
            expected += [registers.to_bus(raw, r.fmt)] * 4
            if r.fmt.width > host_bus.WORD_BITS:
                port.ask((HALF_PAIR, at, draw.getrandbits(32), EVERY_BYTE), read_of(r))
                port.ask((HALF_PAIR, at ^ 8 | 4, draw.getrandbits(32), EVERY_BYTE), read_of(r))
                expected += [registers.to_bus(raw, r.fmt)] * 2
        port.served()
        lines, broken = port.lines(), port.broken
    assert broken == 0
    assert words_read(lines) == expected
    assert np.array_equal(lines["response"], np.where(np.isin(lines["kind"], REFUSED), SLVERR, OKAY))


# ---- the closed loop -------------------------------------------------------------------------------------------------


def talked(built, seed, fast, mixed):
    """(lines of the host, rows of the model's frames, boundary between both plans) of a loop from power-on.

    fast   a channel waits for at most some tens of clocks: a sample is read within the output period
    mixed  it waits for up to some thousands; one read of three is of other registers, and writes that change nothing
    """
    draw = np.random.default_rng(seed)
    with Board(built, COLUMNS) as port:
        sim = run.Loop(Config(), *test_host.DEGC, port, built.firmware)
        sim.keep_rows = True
        port.plan(seed, 1, 1)
        sim.now = (np.array([1.0]), np.array([25.0]))
        for name, raw in test_host.PLAN.items():  # before the first 8 kHz work
            port.ask(*writes_of(registers.BY_NAME[name], raw))
            sim.write(name, raw)
        sim.advance(test_host.FIRST_FRAME * 125 - len(test_host.PLAN), 1.0, 25.0)
        edge = 0
        for plan, wanted in (((1, 0.05, 0.0), fast), ((1, 1 / 4000, 0.33), mixed)):
            port.plan(seed + 1, *plan, 1)
            edge, until = len(port.lines()["kind"]), wanted + int((port.lines()["kind"] == SAMPLE).sum())
            while (port.lines()["kind"] == SAMPLE).sum() < until:
                sim.advance(1250, 1.0, draw.uniform(*test_host.DEGC, 12))
        assert port.broken == 0, "the slave keeps the rules of the protocol"
        lines = port.lines()
        sim.advance(1250, 1.0, draw.uniform(*test_host.DEGC, 12))  # rows of the last frames that were read
        return lines, sim.columns(), edge


@pytest.mark.slow
@pytest.mark.parametrize(("fast", "mixed"), [(40, 25), (1400, 600)])
def test_a_host_reads_whole_samples_while_the_loop_runs(built, fast, mixed):
    """Every pin is the model's, every sample that of its frame in the model; what is lost is told."""
    lines, rows, edge = talked(built, 5, fast, mixed)
    sample = np.flatnonzero(lines["kind"] == SAMPLE)
    sample = sample[lines["begin"][sample] > test_host.FIRST_FRAME * test_host.FRAME_CLOCKS]
    assert len(sample) >= fast + mixed - 1
    rate, temperature = test_host.signed(lines["word0"][sample], 32), test_host.signed(lines["word2"][sample], 16)
    status, number = lines["word4"][sample], lines["word6"][sample]

    # the row of a frame: that of its number, nearest to when the sample was taken
    begun = (lines["taken"][sample] - test_host.RESET_CLOCKS) // test_host.FRAME_CLOCKS
    offs = {int((begun[0] - number[0] + late) % 4096) for late in (0, 1)}
    fits = [off for off in offs if np.array_equal(rows["rate_output"][test_host.frame_row(number, off, begun)], rate)]
    assert len(fits) == 1, "the rate of every sample is that of its frame"
    row = test_host.frame_row(number, fits[0], begun)
    assert np.isin(row - begun, (0, 1)).all(), "the newest sample"
    assert np.array_equal(rows["adc_temperature"][row] >> 8, temperature), "the temperature of its frame"
    told = rows["flags"][row] | rows["state"][row] << 8 | rows["lock"][row] << 12
    assert np.array_equal(told, status & 0xFFFF)
    assert (np.diff(rate) != 0).mean() > 0.9, "frames differ"

    lost = np.diff(number) % 4096 - 1
    assert (status >> 19 & 1).all(), "every sample that is read is new"
    assert np.array_equal(status[1:] >> 20 & 1, lost > 0), "OVERRUN where one was lost, and nowhere else"
    assert np.array_equal(lines["lost"][sample][1:], lost), "the C driver counts them"
    quick = sample[1:] < edge
    assert quick.sum() > fast / 2
    assert not lost[quick].any(), "none is lost while a read is shorter than the period"
    assert lost[~quick].max() > 3, "slow reads lose some"

    kinds = lines["kind"]
    assert np.array_equal(lines["response"], np.where(np.isin(kinds, REFUSED), SLVERR, OKAY))
    assert set(range(7)) <= set(kinds.tolist())
    known, compared = {address(r): r for r in registers.MAP}, 0
    for k in np.flatnonzero((kinds == REGISTER) & (lines["begin"] > test_host.FIRST_FRAME * test_host.FRAME_CLOCKS)):
        found = known.get(int(lines["address"][k]))
        if found and found.name in test_host.SHOWN:
            at = int(lines["taken"][k] - test_host.RESET_CLOCKS) // test_host.FRAME_CLOCKS
            near = {registers.to_bus(int(v), found.fmt) for v in rows[test_host.SHOWN[found.name]][at : at + 2]}
            assert int(lines["word0"][k] | lines["word1"][k] << 32) in near, found.name
            compared += 1
    assert compared > 0


@pytest.mark.slow
@ghdl
def test_a_host_reads_whole_samples_of_the_port_in_vhdl(tmp_path):
    test_a_host_reads_whole_samples_while_the_loop_runs(board_of("host_axi", tmp_path, "vhd"), 40, 25)


@pytest.mark.slow
def test_a_torn_sample_would_be_seen(tmp_path):
    """Temperature and number of the newest sample, in place of those that the access to the rate has held."""
    ports = [(f"{f'held_{name}':<26}", name) for name in ("temperature", "number")]
    torn = [(f"{port}(r_bus_held_{name})", f"{port}(r_bus_{name})") for port, name in ports]
    with pytest.raises(AssertionError, match=r"of its frame|newest"):
        test_a_host_reads_whole_samples_while_the_loop_runs(board_of("host_axi", tmp_path, edits=torn), 40, 25)


def test_columns_are_those_of_the_bench():
    text = Path(__file__).with_name("axi_bench.h").read_text()
    assert "int64_t kind, begin, taken, end, response, address, word[7], lost, busy_e6;" in text
    assert axi_slave.SLVERR == SLVERR
