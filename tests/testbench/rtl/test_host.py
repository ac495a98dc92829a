"""The SPI port of the whole design in Verilog: at every clock the model's, and a host with the C driver at its pins.

The loop is that of the plant around the RTL (`lockstep`): every pin is the model's at every clock while the host talks.
"""

import random
import re
from operator import attrgetter

import numpy as np
import pytest

from fpga_model import fault_monitor, host, host_bus, registers, sequencer, spi_slave
from fpga_model import top as fpga
from testbench.config import Config
from testbench.golden.loop import run
from testbench.run import simulate
from tests.testbench.rtl import host_port
from tests.testbench.rtl.host_port import EVERY, OF_BANK, Board, address, board_of
from tests.testbench.rtl.test_rtl import ghdl, icarus

SAMPLE, ABORTED, BAD_READ_CRC, BAD_WRITE_CRC, HALF_PAIR, REGISTER, WRITE = range(7)
WORDS = tuple(f"word{k}" for k in range(7))
HEAD = ("kind", "begin", "taken", "end", "result", "status", "words", "address")
COLUMNS = (*HEAD, *WORDS, "ready", "period")
OK = 0
FRAME_CLOCKS = 26 * 125
RESET_CLOCKS = 2  # of the bench, which the host's clock counts and the loop's does not


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return board_of("host", tmp_path_factory.mktemp("host"))


def opened(built):
    return Board(built, COLUMNS)


# ---- the port alone, at every clock ----------------------------------------------------------------------------------


@pytest.mark.parametrize("language", [pytest.param("v", marks=icarus), pytest.param("vhd", marks=ghdl)])
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_rtl_of_the_port_is_the_model(seed, language, tmp_path):
    """Every register and pin at every clock: frames of every kind, registers of the firmware that never rest."""
    _, _, states = host_port.model("host", seed)
    assert min(sum(s.bus.bank_write for s in states), sum(s.slave.done for s in states)) > 3
    assert host_port.difference("host", language, seed, tmp_path) is None


PLANTED = [
    ("host_axi", "v", ".bus_held_number               (r_bus_held_number)", ".bus_held_number(r_bus_number)"),
    ("host", "v", ".pairs(DDS_BITS > 32 ? 8'hBC : 8'h00)", ".pairs(8'h00)"),
    ("host", "vhd", "done               => r_slave_done", "done               => '0'"),
    ("host_axi", "v", ".start             (1'b0)", ".start(o_rvalid)"),
    ("host_axi", "vhd", "unsigned(rates_slot) = SLOTS", "unsigned(rates_slot) < SLOTS"),
    ("host_axi", "vhd", 'when x"0F"', 'when x"FF"'),
]


@icarus
@ghdl
@pytest.mark.parametrize(
    "fault", [pytest.param(fault, marks=pytest.mark.slow) if n else fault for n, fault in enumerate(PLANTED)]
)
def test_a_planted_fault_in_the_port_is_seen(fault, tmp_path):
    stem, language, *edit = fault
    assert host_port.difference(stem, language, 1, tmp_path, [edit]) is not None


# ---- registers over the pins -----------------------------------------------------------------------------------------


def word_of(lines, at):
    """Word of 48 bits of a read of both words of a register."""
    assert lines["result"][at] == OK
    return int(lines["word0"][at] | lines["word1"][at] << 32)


def written(register, raw):
    """An item of the host's list: the words of a register, which a host writes in one frame."""
    word = registers.to_bus(raw, register.fmt)
    words = 2 if register.fmt.width > host_bus.WORD_BITS else 1
    return (WRITE, address(register), words, word & host_bus.WORD_MASK, word >> host_bus.WORD_BITS)


def everything():
    return [(REGISTER, address(r), 2) for r in EVERY]


def test_reset_values_are_read_and_every_register_is_written_and_read_back(built):
    """The converter is silent: the firmware waits, and its faults stand."""
    draw = random.Random(3)
    with opened(built) as port:
        port.plan(7, 5, 40)
        port.ask(*everything())
        raws = {r.name: [draw.randint(r.fmt.lo, r.fmt.hi) for _ in range(2)] for r in OF_BANK}
        for k in range(2):
            for r in OF_BANK:
                port.ask(written(r, raws[r.name][k]), (REGISTER, address(r), 2))
        port.ask(*everything())
        port.served()
        lines, broken = port.lines(), port.broken
    assert broken == 0, "SDO stands around every rise of SCK"
    assert (lines["result"] == OK).all()
    for at, r in enumerate(EVERY):
        found = word_of(lines, at)
        assert found < 1 << r.fmt.width
        if r.access != "ro" or not r.path:
            assert found == registers.to_bus(r.reset, r.fmt), r.name
    at = len(EVERY) + 1
    for k in range(2):
        for r in OF_BANK:
            assert word_of(lines, at) == registers.to_bus(raws[r.name][k], r.fmt), r.name
            at += 2
    for at, r in enumerate(EVERY, len(lines["kind"]) - len(EVERY)):
        if r.access == "rw":
            assert word_of(lines, at) == registers.to_bus(raws[r.name][1], r.fmt), f"{r.name} at the end"
    assert (lines["status"] & spi_slave.ERRORS.hi == 0).all()


def test_every_register_has_its_reset_value(built):
    """Each is the first that is read behind a reset, before any 8 kHz work: against model, SystemRDL and C header."""
    from testbench.register_map.export_registers import compiled

    _, folder, p = built
    with opened(built) as port:
        port.plan(9, 5, 5)
        for r in EVERY:
            port.reset()
            port.ask((REGISTER, address(r), 2))
            port.served()
        lines = port.lines()
    assert (lines["taken"][0], lines["end"].max() - lines["begin"].min()) < (FRAME_CLOCKS, FRAME_CLOCKS * len(EVERY))
    found = {r.name.upper(): word_of(lines, at) for at, r in enumerate(EVERY)}
    state, port_state = fpga.reset(p.design), host.State()
    for r in EVERY:
        if r in registers.MAP:
            expected = registers.read(state, r.address)
        else:
            expected = registers.to_bus(attrgetter(r.path)(port_state), r.fmt)
        assert found[r.name.upper()] == expected, r.name
    fields = 0
    for word in compiled(folder / "map" / "gyro_registers.rdl").registers():
        raw = found[re.sub("_(LO|HI)$", "", word.inst_name)] >> word.get_property("gyro_low_bit")
        for field in word.fields():
            reset = field.get_property("reset")
            if reset is not None:
                assert raw >> field.low & ((1 << field.width) - 1) == reset, (word.inst_name, field.inst_name)
                fields += 1
    assert fields > len(OF_BANK)
    macros = re.findall(r"GYRO_(\w+)_RESET INT64_C\((-?\d+)\)", (folder / "map" / "c" / "gyro_formats.h").read_text())
    by_name = {r.name.upper(): r for r in EVERY}
    for name, value in macros:
        assert found[name] == registers.to_bus(int(value), by_name[name].fmt), name
    assert {name for name, _ in macros} == {r.name.upper() for r in EVERY if r.access != "ro" or not r.path}


def talk_of_writes(built, first, writes):
    """(lines, what the pins show at the end) of writes, each followed by a read of its register; then of everything."""
    with opened(built) as port:
        port.plan(11, 5, 12)
        port.ask(*first)
        for write, register in writes:
            port.ask(write, (REGISTER, address(register), 2))
        port.ask(*everything())
        port.served()
        lines, shown = port.lines(), port.read()
    assert (lines["result"] == OK).all(), "every frame is answered"
    assert (lines["status"] & spi_slave.ERRORS.hi == 0).all(), "no write is an error"
    return lines, shown


def test_a_write_to_a_register_that_is_read_only_changes_nothing(built):
    """Two boards hear frames at the same times: they write registers that are read only, or a value that is there."""
    draw, ro, rest = random.Random(4), [], []
    same = {r.name: written(r, draw.randint(r.fmt.lo, r.fmt.hi)) for r in OF_BANK if r.name != "control"}
    for r in EVERY:
        if r.access != "ro":
            continue
        for words in ((0xFFFFFFFF,), (draw.getrandbits(32), draw.getrandbits(32))):
            ro.append(((WRITE, address(r), len(words), *words), r))
            rest.append((same["decimation" if len(words) == 1 else "phase_drive_sine"], r))
        ro.append(((WRITE, address(r) + 4, 1, draw.getrandbits(32)), r))
        rest.append((same["decimation"], r))
    (found, shown), (expected, quiet) = (talk_of_writes(built, same.values(), writes) for writes in (ro, rest))
    reads = found["kind"] == REGISTER
    assert len(np.unique(found["word0"][reads])) > len(EVERY) / 2
    for name in set(COLUMNS) - {"address"}:
        assert np.array_equal(found[name][reads], expected[name][reads]), name
    assert np.array_equal(shown, quiet)


def test_a_write_to_a_register_that_is_read_only_drops_a_low_word_that_waits(built):
    phase, pending = registers.BY_NAME["phase_sense_ref"], 1 << 3
    with opened(built) as port:
        port.plan(12, 5, 12)
        for r in [r for r in EVERY if r.access == "ro"]:
            port.ask((WRITE, address(phase), 1, 0x12345678), (WRITE, address(r), 1, 1))
            port.ask((WRITE, address(phase) + 4, 1, 0x1234), (REGISTER, address(phase), 2))
        port.served()
        lines = port.lines()
    status = lines["status"].reshape(-1, 4) & pending
    assert (status == [0, pending, 0, 0]).all()
    assert all(word_of(lines, at) == 0 for at in range(3, len(lines["kind"]), 4))


class Faulty:
    """A loop whose converter fails in many ways; the host reads the latch of faults and clears it."""

    def __init__(self, built, port):
        self.port, self.sim = port, run.PinCaptureLoop(Config(), *DEGC, port, built.firmware)
        self.sim.now = (np.array([0.0]), np.array([25.0]))

    def run(self, frames, *faults):
        self.sim.faults = simulate.build_faults(faults)
        self.sim.advance(frames * 125, 0.0, 25.0)

    def written(self, name, raw, frames=3):
        """Also without the 8 kHz work behind it, if `frames` is 0."""
        self.port.ask(written(registers.BY_NAME[name], raw))
        self.run(frames)

    def latch_and_flags(self):
        before = len(self.port.lines()["kind"])
        self.port.ask(*((REGISTER, address(registers.BY_NAME[name]), 1) for name in ("fault_clear", "flags")))
        self.run(1)
        lines = self.port.lines()
        assert len(lines["kind"]) == before + 2
        return tuple(int(lines["word0"][before + k]) for k in range(2))

    def provoke(self):
        """Faults of which none lasts: the drive is off behind them, and the converter works."""
        self.written("control", sequencer.RUN)
        self.run(40)
        self.run(20, ("adc_silent", "adc", 0))
        self.run(30, ("adc_over_range", "sense_sin", 1))
        self.run(40, ("adc_stuck", "drive_sin", 5))
        self.run(60)
        self.written("control", 0, 8)
        latch, flags = self.latch_and_flags()
        assert flags == 0
        assert latch.bit_count() >= 4, f"{latch:08b}"
        return latch


def test_ones_written_to_the_latch_of_faults_clear_these_and_no_others(built):
    draw = random.Random(5)
    with opened(built) as port:
        port.plan(13, 5, 8)
        faulty = Faulty(built, port)
        latch = faulty.provoke()
        bits = [1 << k for k in range(8)]
        draw.shuffle(bits)
        for mask in (0, 0xFF & ~latch, *bits):
            faulty.written("fault_clear", mask)
            latch &= ~mask
            assert faulty.latch_and_flags() == (latch, 0), f"{mask:08b}"
        latch = faulty.provoke()
        kept, *others = [bit for bit in bits if bit & latch]
        for bit in others:  # one frame of 8 kHz has several writes
            port.ask(written(registers.BY_NAME["fault_clear"], bit))
        faulty.run(3)
        writes = port.lines()["taken"][-len(others) :]
        assert len(others) > 2
        assert np.ptp(writes) < FRAME_CLOCKS
        assert faulty.latch_and_flags() == (kept, 0)
        # a fault that lasts stays
        silent = ("adc_silent", "adc", 0)
        faulty.run(4, silent)
        port.ask(written(registers.BY_NAME["fault_clear"], 0xFF))
        faulty.run(4, silent)
        port.ask(*((REGISTER, address(registers.BY_NAME[name]), 1) for name in ("fault_clear", "flags")))
        faulty.run(1, silent)
        assert port.lines()["word0"][-2:].tolist() == [fault_monitor.STALE] * 2


def test_what_is_not_a_whole_write_changes_nothing_and_errors_are_flagged_until_cleared(built):
    pairs = [r for r in OF_BANK if r.fmt.width > host_bus.WORD_BITS]
    errors = host_bus.MAP[-1]
    with opened(built) as port:
        port.plan(8, 5, 40)
        for r in pairs:
            port.ask((WRITE, address(r), 1, 0x12345678), (REGISTER, address(r), 2))
            port.ask((WRITE, address(r) + 8 + 4, 1, 0x1234), (REGISTER, address(r), 2))
        for r in OF_BANK:
            port.ask((BAD_WRITE_CRC, *written(r, r.fmt.hi - 1)[1:]), (REGISTER, address(r), 2))
        port.ask((REGISTER, address(errors), 1), (WRITE, address(errors), 1, 0), (REGISTER, address(errors), 1))
        port.ask((ABORTED, 0x280, 7), (REGISTER, address(errors), 1))
        port.ask((WRITE, address(errors), 1, 2), (REGISTER, address(errors), 1))
        port.ask((WRITE, address(errors), 1, 5), (REGISTER, address(errors), 1), (REGISTER, address(errors), 1))
        port.served()
        lines = port.lines()
    before = [registers.to_bus(r.reset, r.fmt) for r in pairs for _ in range(2)]
    before += [registers.to_bus(r.reset, r.fmt) for r in OF_BANK]
    reads = [k for k, kind in enumerate(lines["kind"]) if kind == REGISTER]
    assert [word_of(lines, k) for k in reads[: len(before)]] == before
    assert [int(lines["word0"][k]) for k in reads[len(before) :]] == [1, 1, 3, 1, 0, 0]
    assert lines["status"][reads[-1]] & spi_slave.ERRORS.hi == 0


# ---- the closed loop -------------------------------------------------------------------------------------------------

# columns of the frames' rows that a register shows
SHOWN = {
    "state": "state",
    "lock": "lock",
    "flags": "flags",
    "frequency": "frequency_word",
    "amplitude": "amplitude_word",
    "magnitude": "magnitude",
    "phase": "phase",
    "rate_word": "rate_word",
    "quadrature_code": "quadrature_code",
    "rate": "rate_output",
}
# The rate follows the temperature, which is another one in every frame: so each frame has its own sample
PLAN = {"decimation": 0, "rate_bias_t1": 100 << 24, "rate_bias_t2": -(20 << 24)}
DEGC = (15.0, 35.0)
FIRST_FRAME = 30  # from here on there is one window of 8 kHz work in each frame


def talked(built, seed, fast, mixed):
    """(lines of the host, rows of the model's frames, boundary between both plans) of a loop from power-on.

    fast   samples read with SCK of 3.3 to 5.2 MHz: a read is shorter than the output period
    mixed  samples read with SCK of 0.1 to 5.2 MHz, one frame of three wrong or of something else
    """
    draw = np.random.default_rng(seed)
    with opened(built) as port:
        sim = run.Loop(Config(), *DEGC, port, built.firmware)
        sim.keep_rows = True
        port.plan(seed, 5, 5)
        sim.now = (np.array([1.0]), np.array([25.0]))
        for name, raw in PLAN.items():  # before the first 8 kHz work
            port.ask(written(registers.BY_NAME[name], raw))
            sim.write(name, raw)
        sim.advance(FIRST_FRAME * 125 - len(PLAN), 1.0, 25.0)
        edge = 0
        for plan, wanted in (((5, 7.8, 0.0), fast), ((5, 260, 0.33), mixed)):
            port.plan(seed + 1, *plan, 1)
            edge, until = len(port.lines()["kind"]), wanted + int((port.lines()["kind"] == SAMPLE).sum())
            while (port.lines()["kind"] == SAMPLE).sum() < until:
                sim.advance(1250, 1.0, draw.uniform(*DEGC, 12))
        assert port.broken == 0, "SDO stands around every rise of SCK"
        return port.lines(), sim.columns(), edge


def signed(values, width):
    return np.where(values >= 1 << (width - 1), values - (1 << width), values)


def test_a_host_reads_whole_samples_while_the_loop_runs(built):
    """Every pin is the model's at every clock. Two thousand samples of a locked loop: tests/testbench/host."""
    fast, mixed = 40, 25
    checked(*talked(built, 5, fast, mixed), fast, mixed)


@pytest.mark.slow
@ghdl
def test_a_host_reads_whole_samples_of_the_port_in_vhdl(tmp_path):
    fast, mixed = 40, 25
    checked(*talked(board_of("host", tmp_path, "vhd"), 6, fast, mixed), fast, mixed)


def checked(lines, rows, edge, fast, mixed, reset_clocks=RESET_CLOCKS, first_frame=FIRST_FRAME):
    """Every sample is that of its frame in the model; what is lost is told; lines from `edge` on are slow or wrong.

    rows  of the model's frames; lines count clocks from `reset_clocks` before the first
    """
    sample = np.flatnonzero(lines["kind"] == SAMPLE)
    sample = sample[lines["begin"][sample] > first_frame * FRAME_CLOCKS]
    assert len(sample) >= fast + mixed - 1
    assert (lines["result"][sample] == OK).all()
    rate, temperature = signed(lines["word0"][sample], 32), signed(lines["word2"][sample], 16)
    status, number = lines["word4"][sample], lines["word6"][sample]
    assert not (lines["word1"] | lines["word3"] | lines["word5"])[sample].any()

    # the row of a frame: that of its number, nearest to when the sample was taken
    begun = (lines["taken"][sample] - reset_clocks) // FRAME_CLOCKS
    (k,) = set((status >> 16 & 7).tolist())
    offs = {int((begun[0] - number[0] + late) % 4096) for late in range(1 - (1 << k), 2)}
    fits = [off for off in offs if np.array_equal(rows["rate_output"][frame_row(number, off, begun)], rate)]
    assert len(fits) == 1, "the rate of every sample is that of its frame"
    row = frame_row(number, fits[0], begun)
    assert ((row - begun > -(1 << k)) & (row - begun <= 1)).all(), "the newest sample"
    assert np.array_equal(rows["adc_temperature"][row] >> 8, temperature)
    told = rows["flags"][row] | rows["state"][row] << 8 | rows["lock"][row] << 12
    assert np.array_equal(told, status & 0xFFFF)
    assert (np.diff(rate) != 0).mean() > 0.9, "frames differ"
    assert len(set(rate.tolist())) > min(20, len(rate) / 3)

    lost = (np.diff(number) % 4096 >> k) - 1
    assert (status >> 19 & 1).all(), "every sample that is read is new"
    assert np.array_equal(status[1:] >> 20 & 1, lost > 0), "OVERRUN where one was lost, and nowhere else"
    quick = sample[1:] < edge
    assert quick.sum() > fast / 2
    assert not lost[quick].any(), "none is lost while a read is shorter than the period"
    assert lost[~quick].max() > (3 >> k), "slow reads lose some"

    wrong, seen = {ABORTED: 2, BAD_READ_CRC: 1, BAD_WRITE_CRC: 1}, 0
    known = {address(r): r for r in registers.MAP}
    compared = 0
    for n, kind in enumerate(lines["kind"].tolist()):
        if kind in (SAMPLE, REGISTER):
            assert lines["status"][n] & spi_slave.ERRORS.hi == seen, "every error is told, and none else"
        seen |= wrong.get(kind, 0)
        found = known.get(int(lines["address"][n])) if kind == REGISTER else None
        if found and found.name in SHOWN and lines["taken"][n] > first_frame * FRAME_CLOCKS:
            at = int(lines["taken"][n] - reset_clocks) // FRAME_CLOCKS
            near = {registers.to_bus(int(v), found.fmt) for v in rows[SHOWN[found.name]][at : at + 2]}
            assert word_of(lines, n) in near, found.name
            compared += 1
    assert seen & 3 == 3
    assert compared > 0


def frame_row(number, off, begun):
    """Row of the frame of a number: number + off modulo 4096, nearest to the frame in which it was taken."""
    return begun + (number + off - begun + 2048) % 4096 - 2048
