"""The SPI port of the whole design in Verilog: at every clock the model's, and a host with the C driver at its pins.

The loop is that of the plant around the RTL (`lockstep`): every pin is the model's at every clock while the host talks.
"""

import ctypes
import random
import re
import shutil
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fpga_model import fault_monitor, host, host_bus, host_words, registers, sequencer, spi_slave
from fpga_model import top as fpga
from fpga_model.block import flat
from fpga_model.design_record import DEFAULT
from testbench.config import Config
from testbench.flatten import leaves
from testbench.golden.loop import library, run
from testbench.golden.recording import board, host_board
from testbench.run import build, simulate
from testbench.tool import run_tool
from tests.fpga_model.records import uncompiled
from tests.testbench.rtl import test_rtl
from tests.testbench.rtl.test_rtl import BIT, RTL, icarus, packed, slave_rows
from tests.testbench.rtl.test_rtl_top import quick_sequencer

SAMPLE, ABORTED, BAD_READ_CRC, BAD_WRITE_CRC, HALF_PAIR, REGISTER, WRITE = range(7)
WORDS = tuple(f"word{k}" for k in range(7))
HEAD = ("kind", "begin", "taken", "end", "result", "status", "words", "address")
COLUMNS = (*HEAD, *WORDS, "ready", "period")
OK = 0
FRAME_CLOCKS = 26 * 125
RESET_CLOCKS = 2  # of the bench, which the host's clock counts and the loop's does not


# ---- the driver of the loop, with a host inside ----------------------------------------------------------------------


def face(firmware):
    """Pins of the board; it lacks those of the bank's bus."""
    return library.of_pins(board.MODULE, firmware, build.params(Config(), 25.0, 25.0).chips)


def driver_text(firmware):
    shown = face(firmware)
    known = {port for name, (port, _) in shown.inputs.items() if name not in host_board.BUS}
    text = library.driver(shown, known)
    text = text.replace('#include "verilated.h"\n', '#include "verilated.h"\n#include "host_bench.h"\n')
    member = "    Vgyro_top top{context.get()};\n"
    text = text.replace(member, member + "    Host host;\n")
    before, after = "    top.clk = 0;\n", "    top.clk = 1;\n    top.eval();\n"
    assert text.count(before) == text.count(after) == 1
    text = text.replace(
        before,
        """    Host& host = ((Design*)handle)->host;
    int pins[3];
    host.before(top.o_data_ready, pins);
    top.cs_n = pins[0]; top.sck = pins[1]; top.sdi = pins[2];
"""
        + before,
    )
    text = text.replace(after, after + "    host.behind(top.o_sdo);\n")
    return text.replace('extern "C" {\n', """extern "C" {
void host_plan(int64_t handle, int64_t seed, double fastest, double slowest, double wrong, int64_t free_running) {
    Host& host = ((Design*)handle)->host;
    host.random.seed((uint64_t)seed);
    host.first_flops.seed((uint64_t)seed);
    host.fastest = fastest; host.slowest = slowest; host.wrong = wrong; host.free_running = free_running;
}
void host_ask(int64_t handle, const int64_t* item, int64_t count) {
    ((Design*)handle)->host.list.emplace_back(item, item + count);
}
int64_t host_lines(int64_t handle, int64_t* out, int64_t most) {
    Host& host = ((Design*)handle)->host;
    if (out) std::memcpy(out, host.lines.data(), std::min((size_t)most, host.lines.size()) * sizeof(Line));
    return (int64_t)host.lines.size();
}
int64_t host_tight(int64_t handle) { return ((Design*)handle)->host.tight; }
int64_t host_left(int64_t handle) {
    Host& host = ((Design*)handle)->host;
    return (int64_t)(host.list.size() - host.at) + host.open;
}
""")  # fmt: skip


def firmware():
    """The default design with a sequencer whose states last frames: it searches, and tries again, all the time."""
    p = build.firmware(Config())
    return p._replace(control=p.control._replace(sequencer=quick_sequencer()))


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """(path of the library, folder, firmware)."""
    if shutil.which("verilator") is None:
        pytest.skip("verilator is not installed: the port of the RTL was NOT tried")
    pytest.importorskip("systemrdl", reason="systemrdl-compiler is not installed: the C driver was NOT tried")
    from testbench.register_map.export import export

    folder, p = tmp_path_factory.mktemp("host"), firmware()
    rtl = folder / "rtl"
    shutil.copytree(RTL, rtl, ignore=shutil.ignore_patterns("formal", "example", "quartus", "*.vhd"))
    host_board.write(folder, p)
    export(folder / "map")
    c = folder / "map" / "c"
    shutil.copy(Path(__file__).with_name("host_bench.h"), c)
    (folder / "driver.cpp").write_text(driver_text(p))
    command = f"verilator --cc --exe -O3 --x-initial 0 -Wno-fatal -Wno-lint -Wno-style -CFLAGS -fPIC -CFLAGS -I{c}"
    command += f" -CFLAGS -DVL_USER_FATAL -LDFLAGS -shared --top-module {board.MODULE} --prefix {library.CLASS}"
    command += f" --Mdir built -o gyro_top.so gyro_board.v driver.cpp {c}/gyro_spi.c {c}/gyro_driver.c"
    command = [*command.split(), *map(str, sorted(rtl.glob("*.v")))]
    run_tool(command, folder, "the board")
    level = ["OPT_FAST=-O1", "OPT_SLOW=-O0", "OPT_GLOBAL=-O1"]
    run_tool(["make", "-s", "-C", "built", "-f", f"{library.CLASS}.mk", *level], folder, "the board")
    return folder / "built" / "gyro_top.so", folder, p


class Board(library.Design):
    """The compiled board, with its host."""

    def __init__(self, path, shown, folder):
        own = ctypes.CDLL(str(path))
        self.own = own
        number, real, pointer = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
        own.host_plan.argtypes, own.host_plan.restype = (number, number, real, real, real, number), None
        own.host_ask.argtypes, own.host_ask.restype = (number, pointer, number), None
        own.host_lines.argtypes, own.host_lines.restype = (number, pointer, number), number
        for name in ("host_tight", "host_left"):
            getattr(own, name).argtypes, getattr(own, name).restype = (number,), number
        super().__init__(path, shown, folder)

    def plan(self, seed, fastest, slowest, wrong=0.0, free_running=0):
        """Periods of SCK in clocks, log-uniform; share of wrong frames; whether it reads each sample by itself."""
        self.own.host_plan(self.handle, seed, fastest, slowest, wrong, free_running)

    def ask(self, *items):
        for item in items:
            given = np.array(item, np.int64)
            self.own.host_ask(self.handle, given.ctypes.data, len(given))

    def served(self, most=2_000_000):
        """Edges without a converter until the list is done."""
        given = np.zeros(len(library.INPUTS), np.int64)
        given[library.INPUTS.index("drdy_n")] = 1
        for _ in range(most):
            if self.own.host_left(self.handle) == 0:
                return
            self.step(given)
        raise AssertionError("the host was not served")

    def lines(self):
        """{column: array} of the frames so far."""
        count = self.own.host_lines(self.handle, None, 0)
        found = np.zeros((count, len(COLUMNS)), np.int64)
        self.own.host_lines(self.handle, found.ctypes.data, count)
        return {name: found[:, k] for k, name in enumerate(COLUMNS)}

    @property
    def tight(self):
        return self.own.host_tight(self.handle)


def opened(built):
    path, folder, p = built
    return Board(path, face(p), folder)


# ---- the port alone, at every clock ----------------------------------------------------------------------------------


def firmware_of(values):
    """A state of the firmware that has these registers and no others: {dotted path: value}."""
    root = SimpleNamespace()
    for path, value in values.items():
        *parts, last = path.split(".")
        place = root
        for name in parts:
            if not hasattr(place, name):
                setattr(place, name, SimpleNamespace())
            place = getattr(place, name)
        setattr(place, last, value)
    return root


@icarus
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_verilog_of_the_port_is_the_model(seed, monkeypatch, tmp_path):
    """Every register and pin at every clock: frames of every kind, registers of the firmware that never rest."""
    rng, paths, p = random.Random(seed), host_board.read_paths(DEFAULT), host.design()
    inputs = {**host.INPUTS_FMT._asdict(), **{flat(path): fmt for path, fmt in paths.items()}}
    pins = {name: (fmt, None) for name, fmt in host.PINS_FMT._asdict().items()}
    block = test_rtl.Block(host, (None,), inputs, pins, rows=6000)
    monkeypatch.setitem(test_rtl.BLOCKS, "host", block)
    uncompiled(monkeypatch, host, host_words)  # they see few registers here
    fmt_in, fmt_out = [BIT, *inputs.values()], [*block.registers.values(), *host.PINS_FMT]
    s, bus, stimulus, expected, written, taken = host.State(), slave_rows(rng), [], [], 0, 0
    values = {path: fmt.lo for path, fmt in paths.items()}
    for n in range(block.rows):
        for path in rng.sample(sorted(paths), 6):
            values[path] = rng.randint(paths[path].lo, paths[path].hi)
        values["rates.slot"] = rng.choice([0, 59, 60, 60])
        rst, i = int(n < 2 or n == 3000), host.Inputs(*next(bus))
        stimulus.append(packed((rst, *i, *values.values()), fmt_in))
        expected.append(packed([*(v for _, v in leaves(s)), *host.pins(s)], fmt_out))
        written, taken = written + s.bus.bank_write, taken + s.slave.done
        s = host.State() if rst else host.step(p, s, firmware_of(values), i)
    assert min(written, taken) > 3
    source = "".join((RTL / f"{stem}.v").read_text() for stem in ("spi_slave", "host_bus", "host_words", "host"))
    found = test_rtl.under_icarus("host", None, stimulus, tmp_path, source)
    assert test_rtl.difference("host", found, expected) is None


# ---- registers over the pins -----------------------------------------------------------------------------------------


def address(register):
    return register.address << host_bus.REGISTER_AT


def word_of(lines, at):
    """Word of 48 bits of a read of both words of a register."""
    assert lines["result"][at] == OK
    return int(lines["word0"][at] | lines["word1"][at] << 32)


def written(register, raw):
    """An item of the host's list: the words of a register, which a host writes in one frame."""
    word = registers.to_bus(raw, register.fmt)
    words = 2 if register.fmt.width > host_bus.WORD_BITS else 1
    return (WRITE, address(register), words, word & host_bus.WORD_MASK, word >> host_bus.WORD_BITS)


EVERY = (*registers.MAP, *host_bus.MAP)
OF_BANK = [r for r in registers.MAP if r.access == "rw"]


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
        lines, tight = port.lines(), port.tight
    assert tight == 0, "SDO stands around every rise of SCK"
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
    from testbench.register_map.export import compiled

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
        self.port, self.sim = port, run.Alone(Config(), *DEGC, port, built[2])
        self.sim.now = (np.array([0.0]), np.array([25.0]))

    def run(self, frames, *faults):
        self.sim.faults = simulate.faults_of(faults)
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
        sim = run.Loop(Config(), *DEGC, port, built[2])
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
        assert port.tight == 0, "SDO stands around every rise of SCK"
        return port.lines(), sim.columns(), edge


def signed(values, width):
    return np.where(values >= 1 << (width - 1), values - (1 << width), values)


def test_a_host_reads_whole_samples_while_the_loop_runs(built):
    """Every pin is the model's at every clock. Two thousand samples of a locked loop: tests/testbench/host."""
    fast, mixed = 40, 25
    checked(*talked(built, 5, fast, mixed), fast, mixed)


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
