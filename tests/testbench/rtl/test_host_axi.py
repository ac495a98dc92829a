"""The AXI4-Lite port of the whole design in Verilog: at every clock the model's, and a host with random wait states.

The loop is that of the plant around the RTL, as for the SPI port: every pin is the model's while the host talks.
"""

import ctypes
import random
import shutil
from pathlib import Path

import numpy as np
import pytest

from fpga_model import axi_slave, host_axi, host_bus, host_words, registers
from fpga_model.block import flat
from fpga_model.design_record import DEFAULT
from testbench.config import Config
from testbench.flatten import leaves
from testbench.golden.loop import library, run
from testbench.golden.recording import board, host_board
from testbench.tool import run_tool
from tests.fpga_model import axi_host
from tests.fpga_model.records import uncompiled
from tests.testbench.rtl import test_host, test_rtl
from tests.testbench.rtl.test_rtl import BIT, RTL, icarus, packed, ran, verilator

SAMPLE, REGISTER, WRITE, SOME_STROBES, UNALIGNED, NO_STROBE, HALF_PAIR = range(7)
REFUSED = (SOME_STROBES, UNALIGNED)
WORDS = tuple(f"word{k}" for k in range(7))
COLUMNS = ("kind", "begin", "taken", "end", "response", "address", *WORDS, "lost", "busy")
OKAY, SLVERR, EVERY_BYTE = 0, 2, 15
STEMS = ("axi_slave", "host_bus", "host_words", "host_axi")


# ---- the port alone, at every clock ----------------------------------------------------------------------------------


@verilator
@pytest.mark.parametrize("stem", ["host", "host_axi"])
def test_verilator_has_no_warning(stem, tmp_path):
    sources = [RTL / f"{name}.v" for name in (*STEMS[:3], "spi_slave", stem)]
    ran(["verilator", "--lint-only", "-Wall", "--top-module", f"gyro_{stem}", *sources], tmp_path, silent=True)


@icarus
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_verilog_of_the_port_is_the_model(seed, monkeypatch, tmp_path):
    """Every register and pin at every clock: requests of every kind, registers of the firmware that never rest."""
    rng, paths, p = random.Random(seed), host_board.read_paths(DEFAULT), host_axi.design()
    inputs = {**host_axi.INPUTS_FMT._asdict(), **{flat(path): fmt for path, fmt in paths.items()}}
    pins = {name: (fmt, None) for name, fmt in host_axi.PINS_FMT._asdict().items()}
    block = test_rtl.Block(host_axi, (None,), inputs, pins, rows=4000)
    monkeypatch.setitem(test_rtl.BLOCKS, "host_axi", block)
    uncompiled(monkeypatch, host_words, host_axi)  # they see few registers here
    fmt_in, fmt_out = [BIT, *inputs.values()], [*block.registers.values(), *host_axi.PINS_FMT]
    known = [r.address << host_bus.REGISTER_AT for r in test_host.EVERY]
    places = [at + high for at in known for high in (0, 4)]
    writes = [axi_host.Write(rng.choice(places), rng.getrandbits(32), EVERY_BYTE) for _ in range(2000)]
    reads = [axi_host.Read(rng.choice([*places, 0x280, 0x280])) for _ in range(2000)]
    host, s, stimulus, expected, written, taken = axi_host.Host(rng, writes, reads, 0.7), host_axi.State(), [], [], 0, 0
    values = {path: fmt.lo for path, fmt in paths.items()}
    for n in range(block.rows):
        for path in rng.sample(sorted(paths), 6):
            values[path] = rng.randint(paths[path].lo, paths[path].hi)
        values["rates.slot"] = rng.choice([0, 59, 60, 60])
        rst, given = int(n < 2 or n == 3000), host.before()
        i = host_axi.Inputs(*given)
        stimulus.append(packed((rst, *i, *values.values()), fmt_in))
        expected.append(packed([*(v for _, v in leaves(s)), *host_axi.pins(s)], fmt_out))
        written, taken = written + s.bus.bank_write, taken + s.bus.reading
        if n not in (0, 1, 2999, 3000):
            host.behind(s.slave)
        s = host_axi.State() if rst else host_axi.step(p, s, test_host.firmware_of(values), i)
        if rst:
            host = axi_host.Host(rng, writes, reads, 0.7)
    assert min(written, taken) > 30
    source = "".join((RTL / f"{stem}.v").read_text() for stem in STEMS)
    found = test_rtl.under_icarus("host_axi", None, stimulus, tmp_path, source)
    assert test_rtl.difference("host_axi", found, expected) is None


# ---- the driver of the loop, with a host inside ----------------------------------------------------------------------


def driver_text(firmware):
    shown = test_host.face(firmware)
    known = {port for name, (port, _) in shown.inputs.items() if name not in host_board.BUS}
    text = library.driver(shown, known)
    text = text.replace('#include "verilated.h"\n', '#include "verilated.h"\n#include "axi_bench.h"\n')
    member = "    Vgyro_top top{context.get()};\n"
    text = text.replace(member, member + "    Host host;\n")
    before, after = "    top.clk = 0;\n", "    top.clk = 1;\n    top.eval();\n"
    assert text.count(before) == text.count(after) == 1
    slave = ", ".join(f"top.o_{name}" for name in host_axi.Pins._fields)
    driven = " ".join(f"top.{name} = pins.{name};" for name in host_axi.Inputs._fields)
    text = text.replace(before, f"""    Host& host = ((Design*)handle)->host;
    const Pins& pins = host.before(Slave{{{slave}}});
    {driven}
{before}""")  # fmt: skip
    text = text.replace(after, after + "    host.behind();\n")
    return text.replace('extern "C" {\n', """extern "C" {
void host_plan(int64_t handle, int64_t seed, double busiest, double slowest, double others, int64_t free_running) {
    Host& host = ((Design*)handle)->host;
    host.random.seed((uint64_t)seed);
    host.busiest = busiest; host.slowest = slowest; host.others = others; host.free_running = free_running;
}
void host_ask(int64_t handle, const int64_t* item, int64_t count) {
    ((Design*)handle)->host.list.emplace_back(item, item + count);
}
int64_t host_lines(int64_t handle, int64_t* out, int64_t most) {
    Host& host = ((Design*)handle)->host;
    if (out) std::memcpy(out, host.lines.data(), std::min((size_t)most, host.lines.size()) * sizeof(Line));
    return (int64_t)host.lines.size();
}
int64_t host_broken(int64_t handle) { return ((Design*)handle)->host.broken; }
int64_t host_left(int64_t handle) {
    Host& host = ((Design*)handle)->host;
    return (int64_t)(host.list.size() - host.at) + host.reading + host.writing;
}
""")  # fmt: skip


def board_of(folder, edits=()):
    """(path of the library, folder, firmware) of the board; `edits` are (right, wrong) of host_axi.v."""
    if shutil.which("verilator") is None:
        pytest.skip("verilator is not installed: the port of the RTL was NOT tried")
    pytest.importorskip("systemrdl", reason="systemrdl-compiler is not installed: the C driver was NOT tried")
    from testbench.register_map.export import export

    p, rtl = test_host.firmware(), folder / "rtl"
    shutil.copytree(RTL, rtl, ignore=shutil.ignore_patterns("formal", "example", "quartus", "*.vhd"))
    text = (rtl / "host_axi.v").read_text()
    for right, wrong in edits:
        assert text.count(right) == 1
        text = text.replace(right, wrong)
    (rtl / "host_axi.v").write_text(text)
    host_board.write(folder, p, host_axi)
    export(folder / "map")
    c = folder / "map" / "c"
    shutil.copy(Path(__file__).with_name("axi_bench.h"), c)
    (folder / "driver.cpp").write_text(driver_text(p))
    command = f"verilator --cc --exe -O3 --x-initial 0 -Wno-fatal -Wno-lint -Wno-style -CFLAGS -fPIC -CFLAGS -I{c}"
    command += f" -CFLAGS -DVL_USER_FATAL -LDFLAGS -shared --top-module {board.MODULE} --prefix {library.CLASS}"
    command += f" --Mdir built -o gyro_top.so gyro_board.v driver.cpp {c}/gyro_spi.c {c}/gyro_driver.c"
    run_tool([*command.split(), *map(str, sorted(rtl.glob("*.v")))], folder, "the board")
    level = ["OPT_FAST=-O1", "OPT_SLOW=-O0", "OPT_GLOBAL=-O1"]
    run_tool(["make", "-s", "-C", "built", "-f", f"{library.CLASS}.mk", *level], folder, "the board")
    return folder / "built" / "gyro_top.so", folder, p


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return board_of(tmp_path_factory.mktemp("host_axi"))


class Board(library.Design):
    """The compiled board, with its host."""

    def __init__(self, built):
        path, folder, p = built
        own = self.own = ctypes.CDLL(str(path))
        number, real, pointer = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
        own.host_plan.argtypes, own.host_plan.restype = (number, number, real, real, real, number), None
        own.host_ask.argtypes, own.host_ask.restype = (number, pointer, number), None
        own.host_lines.argtypes, own.host_lines.restype = (number, pointer, number), number
        for name in ("host_broken", "host_left"):
            getattr(own, name).argtypes, getattr(own, name).restype = (number,), number
        super().__init__(path, test_host.face(p), folder)

    def plan(self, seed, busiest, slowest, others=0.0, free_running=0):
        """Share of clocks in which a channel goes on, log-uniform; share of other reads; whether it reads by itself."""
        self.own.host_plan(self.handle, seed, busiest, slowest, others, free_running)

    def ask(self, *items):
        for item in items:
            given = np.array(item, np.int64)
            self.own.host_ask(self.handle, given.ctypes.data, len(given))

    def served(self, most=200_000):
        """Edges without a converter until the list is done."""
        given = np.zeros(len(library.INPUTS), np.int64)
        given[library.INPUTS.index("drdy_n")] = 1
        for _ in range(most):
            if self.own.host_left(self.handle) == 0:
                return
            self.step(given)
        raise AssertionError("the host was not served")

    def lines(self):
        """{column: array} of what was answered so far."""
        count = self.own.host_lines(self.handle, None, 0)
        found = np.zeros((count, len(COLUMNS)), np.int64)
        self.own.host_lines(self.handle, found.ctypes.data, count)
        return {name: found[:, k] for k, name in enumerate(COLUMNS)}

    @property
    def broken(self):
        """Rules of the protocol that the slave broke."""
        return self.own.host_broken(self.handle)


# ---- registers over the port -----------------------------------------------------------------------------------------


def read_of(register):
    return (REGISTER, test_host.address(register), 2)


def writes_of(register, raw):
    """Items of the host's list: the words of a register."""
    word = registers.to_bus(raw, register.fmt)
    yield (WRITE, test_host.address(register), word & host_bus.WORD_MASK, EVERY_BYTE)
    if register.fmt.width > host_bus.WORD_BITS:
        yield (WRITE, test_host.address(register) + 4, word >> host_bus.WORD_BITS, EVERY_BYTE)


def words_read(lines):
    """Words of 48 bits of all reads of registers, in order."""
    at = lines["kind"] == REGISTER
    return (lines["word0"][at] | lines["word1"][at] << 32).tolist()


@pytest.mark.slow
def test_every_register_is_written_and_read_back_and_what_is_refused_changes_nothing(built):
    draw = random.Random(3)
    with Board(built) as port:
        port.plan(7, 1, 0.1)
        expected = []
        for r in (r for r in test_host.EVERY if r.access != "ro" or not r.path):
            port.ask(read_of(r))
            expected.append(registers.to_bus(r.reset, r.fmt))
        for r in test_host.OF_BANK:
            raw, at = draw.randint(r.fmt.lo, r.fmt.hi), test_host.address(r)
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
    with Board(built) as port:
        sim = run.Loop(Config(), *test_host.DEGC, port, built[2])
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
    known, compared = {test_host.address(r): r for r in registers.MAP}, 0
    for k in np.flatnonzero((kinds == REGISTER) & (lines["begin"] > test_host.FIRST_FRAME * test_host.FRAME_CLOCKS)):
        found = known.get(int(lines["address"][k]))
        if found and found.name in test_host.SHOWN:
            at = int(lines["taken"][k] - test_host.RESET_CLOCKS) // test_host.FRAME_CLOCKS
            near = {registers.to_bus(int(v), found.fmt) for v in rows[test_host.SHOWN[found.name]][at : at + 2]}
            assert int(lines["word0"][k] | lines["word1"][k] << 32) in near, found.name
            compared += 1
    assert compared > 0


@pytest.mark.slow
def test_a_torn_sample_would_be_seen(tmp_path):
    """Temperature and number of the newest sample, in place of those that the access to the rate has held."""
    ports = [(f"{f'held_{name}':<26}", name) for name in ("temperature", "number")]
    torn = [(f"{port}(r_bus_held_{name})", f"{port}(r_bus_{name})") for port, name in ports]
    with pytest.raises(AssertionError, match=r"of its frame|newest"):
        test_a_host_reads_whole_samples_while_the_loop_runs(board_of(tmp_path, torn), 40, 25)


def test_columns_are_those_of_the_bench():
    text = Path(__file__).with_name("axi_bench.h").read_text()
    assert "int64_t kind, begin, taken, end, response, address, word[7], lost, busy_e6;" in text
    assert axi_slave.SLVERR == SLVERR
