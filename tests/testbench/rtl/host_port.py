"""What the tests of both ports of a host share: rows of a port alone, and the compiled board with a host at its pins.

The host is in C++, with the C driver: `host_bench.h` at the SPI port, `axi_bench.h` at AXI4-Lite. Both have `plan`,
`left`, `broken`, and `before` and `behind` of an edge.
"""

import ctypes
import functools
import random
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from fpga_model import axi_slave, host, host_axi, host_bus, host_words, registers
from fpga_model.block import port_name
from fpga_model.design_record import DEFAULT
from testbench.config import Config
from testbench.flatten import leaves
from testbench.golden.foreign.rtl_sources import Sources
from testbench.golden.loop import from_vhdl, library
from testbench.golden.recording import board_recording, host_board
from testbench.run import build
from testbench.tool import run_tool
from tests.fpga_model import axi_host, spi_host
from tests.fpga_model.records import uncompiled
from tests.testbench.rtl import test_rtl
from tests.testbench.rtl.test_rtl import BIT, OF_HOST, RTL, any_frame, packed, slave_rows
from tests.testbench.rtl.test_rtl_top import quick_sequencer

EVERY = (*registers.MAP, *host_bus.MAP)
EVERY_BYTE, SAMPLE_RATE = axi_slave.EVERY_BYTE, host_bus.SAMPLE_RATE
OF_BANK = [r for r in registers.MAP if r.access == "rw"]


def address(register):
    return register.address << host_bus.REGISTER_AT


# ---- the port alone, at every clock ----------------------------------------------------------------------------------


def spi_frame(rng):
    """Bits of a frame: of any kind, a read of the sample, or words of a register."""
    kind, count = rng.randrange(3), rng.randint(1, 2)
    if kind == 0:
        return any_frame(rng)
    if kind == 1:
        return spi_host.text(1, SAMPLE_RATE, [0] * rng.randint(1, 4))
    return spi_host.text(
        int(rng.random() < 0.3), address(rng.choice(EVERY)), [rng.getrandbits(32) for _ in range(count)]
    )


def spi_pins(rng):
    """Pins of a host that sends frames: a function of state and reset."""
    bus = slave_rows(rng, spi_frame)
    return lambda s, rst: next(bus)


def axi_pins(rng):
    """The same of a host with requests of every kind and wait states."""
    places = [address(r) + high for r in EVERY for high in (0, 4)]
    writes = [axi_host.Write(rng.choice(places), rng.getrandbits(32), EVERY_BYTE) for _ in range(2000)]
    reads = [axi_host.Read(rng.choice([*places, SAMPLE_RATE, SAMPLE_RATE])) for _ in range(2000)]
    found = axi_host.Host(rng, writes, reads, 0.7)

    def pins(s, rst):
        nonlocal found
        given = found.before()
        if rst:
            found = axi_host.Host(rng, writes, reads, 0.7)
        else:
            found.behind(s.slave)
        return given

    return pins


class Port(NamedTuple):
    """A port: its model, its host for rows and how many, and the header of its host in C++."""

    module: object
    pins: object
    rows: int
    bench: str


PORTS = {"host": Port(host, spi_pins, 6000, "host_bench.h"), "host_axi": Port(host_axi, axi_pins, 4000, "axi_bench.h")}


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


def block_of(stem):
    """The port as `test_rtl` sees a block: registers of the firmware are inputs."""
    module, paths = PORTS[stem].module, host_board.read_paths(DEFAULT)
    inputs = {**module.INPUTS_FMT._asdict(), **{port_name(path): fmt for path, fmt in paths.items()}}
    pins = {name: (fmt, None) for name, fmt in module.PINS_FMT._asdict().items()}
    return test_rtl.Block(module, (None,), inputs, pins, rows=PORTS[stem].rows)


@functools.cache
def model(stem, seed):
    """(stimulus, what the model holds before each edge, its states): registers of the firmware never rest."""
    port, block, rng, paths = PORTS[stem], block_of(stem), random.Random(seed), host_board.read_paths(DEFAULT)
    fmt_in, fmt_out = [BIT, *block.inputs.values()], [*block.registers.values(), *port.module.PINS_FMT]
    p, s, draw = port.module.design(), port.module.State(), port.pins(rng)
    stimulus, expected, states = [], [], []
    values = {path: fmt.lo for path, fmt in paths.items()}
    with pytest.MonkeyPatch.context() as patch:
        uncompiled(patch, port.module, host_words)  # they see few registers here
        for n in range(block.rows):
            for path in rng.sample(sorted(paths), 6):
                values[path] = rng.randint(paths[path].lo, paths[path].hi)
            values["rates.slot"] = rng.choice([0, 59, 60, 60])
            rst = int(n < 2 or n == 3000)
            i = port.module.Inputs(*draw(s, rst))
            stimulus.append(packed((rst, *i, *values.values()), fmt_in))
            expected.append(packed([*(v for _, v in leaves(s)), *port.module.pins(s)], fmt_out))
            states.append(s)
            s = port.module.State() if rst else port.module.step(p, s, firmware_of(values), i)
    return stimulus, expected, states


def difference(stem, language, seed, folder, edits=()):
    """None, or the first row in which the RTL is not the model; `edits` are (right, wrong) of its text."""
    stimulus, expected, _ = model(stem, seed)
    text = "".join((RTL / f"{name}.{language}").read_text() for name in (*OF_HOST[stem], stem))
    for right, wrong in edits:
        assert text.count(right) == 1, right
        text = text.replace(right, wrong)
    run = {"v": test_rtl.under_icarus, "vhd": test_rtl.under_ghdl}[language]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(test_rtl.BLOCKS, stem, block_of(stem))
        return test_rtl.difference(stem, run(stem, None, stimulus, folder, text), expected)


# ---- the board, with a host inside -----------------------------------------------------------------------------------

CALLS = """extern "C" {
void host_plan(int64_t handle, int64_t seed, double first, double slowest, double share, int64_t free_running) {
    ((Design*)handle)->host.plan((uint64_t)seed, first, slowest, share, free_running);
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
int64_t host_left(int64_t handle) { return ((Design*)handle)->host.left(); }
"""


def face(firmware):
    """Pins of the board; it lacks those of the bank's bus."""
    return library.pin_face(board_recording.MODULE, firmware, build.params(Config(), 25.0, 25.0).chips)


def driver_text(firmware, bench):
    """The driver of the loop, with a host that is stepped before and behind each edge."""
    shown = face(firmware)
    text = library.driver(shown, {port for name, (port, _) in shown.inputs.items() if name not in host_board.BUS})
    member, before, after = (
        "    Vgyro_top top{context.get()};\n",
        "    top.clk = 0;\n",
        "    top.clk = 1;\n    top.eval();\n",
    )
    for old, new in (
        ('#include "verilated.h"\n', f'#include "verilated.h"\n#include "{bench}"\n'),
        (member, member + "    Host host;\n"),
        (before, "    Host& host = ((Design*)handle)->host;\n    host.drive(top);\n" + before),
        (after, after + "    host.hear(top);\n"),
        ('extern "C" {\n', CALLS),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


class Built(NamedTuple):
    """A compiled board."""

    path: Path
    folder: Path
    firmware: object


def firmware():
    """The default design with a sequencer whose states last frames: it searches, and tries again, all the time."""
    p = build.firmware(Config())
    return p._replace(control=p.control._replace(sequencer=quick_sequencer()))


def board_of(stem, folder, language="v", edits=()):
    """`Built` of the board with a port, in Verilog or made of its VHDL; `edits` are (right, wrong) of its text."""
    if shutil.which("verilator") is None:
        pytest.skip("verilator is not installed: the port of the RTL was NOT tried")
    pytest.importorskip("systemrdl", reason="systemrdl-compiler is not installed: the C driver was NOT tried")
    from testbench.register_map.export_registers import export

    p, rtl = firmware(), folder / "rtl"
    shutil.copytree(RTL, rtl, ignore=shutil.ignore_patterns("formal", "example", "quartus"))
    text = (rtl / f"{stem}.{language}").read_text()
    for right, wrong in edits:
        assert text.count(right) == 1
        text = text.replace(right, wrong)
    (rtl / f"{stem}.{language}").write_text(text)
    host_board.write(folder, p, PORTS[stem].module)
    if language == "vhd":
        files = [rtl / f"{name}.vhd" for name in (*OF_HOST[stem], stem)]
        for path in files:
            path.with_suffix(".v").unlink()
        found = from_vhdl.synthesise_vhdl(Sources(tuple(files), ("",) * len(files)), f"gyro_{stem}", folder, stem)
        shutil.move(found, rtl / f"{stem}.v")
        made = folder / f"{board_recording.MODULE}.v"  # synthesis leaves no parameters
        made.write_text(made.read_text().replace(f"gyro_{stem} #(.DDS_BITS(48))", f"gyro_{stem}"))
    export(folder / "map")
    c = folder / "map" / "c"
    shutil.copy(Path(__file__).with_name(PORTS[stem].bench), c)
    (folder / "driver.cpp").write_text(driver_text(p, PORTS[stem].bench))
    command = f"verilator --cc --exe -O3 --x-initial 0 -Wno-fatal -Wno-lint -Wno-style -CFLAGS -fPIC -CFLAGS -I{c}"
    command += (
        f" -CFLAGS -DVL_USER_FATAL -LDFLAGS -shared --top-module {board_recording.MODULE} --prefix {library.CLASS}"
    )
    command += f" --Mdir built -o gyro_top.so gyro_board.v driver.cpp {c}/gyro_spi.c {c}/gyro_driver.c"
    run_tool([*command.split(), *map(str, sorted(rtl.glob("*.v")))], folder, "the board")
    level = ["OPT_FAST=-O1", "OPT_SLOW=-O0", "OPT_GLOBAL=-O1"]
    run_tool(["make", "-s", "-C", "built", "-f", f"{library.CLASS}.mk", *level], folder, "the board")
    return Built(folder / "built" / "gyro_top.so", folder, p)


class Board(library.Design):
    """The compiled board, with its host, whose lines have `columns`."""

    def __init__(self, built, columns):
        own = self.own = ctypes.CDLL(str(built.path))
        number, real, pointer = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
        own.host_plan.argtypes, own.host_plan.restype = (number, number, real, real, real, number), None
        own.host_ask.argtypes, own.host_ask.restype = (number, pointer, number), None
        own.host_lines.argtypes, own.host_lines.restype = (number, pointer, number), number
        for name in ("host_broken", "host_left"):
            getattr(own, name).argtypes, getattr(own, name).restype = (number,), number
        self.columns = columns
        super().__init__(built.path, face(built.firmware), built.folder)

    def plan(self, seed, first, slowest, share=0.0, free_running=0):
        """What `Host.plan` of the bench takes."""
        self.own.host_plan(self.handle, seed, first, slowest, share, free_running)

    def ask(self, *items):
        """Put items into the host's list."""
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
        """{column: array} of what was answered so far."""
        count = self.own.host_lines(self.handle, None, 0)
        found = np.zeros((count, len(self.columns)), np.int64)
        self.own.host_lines(self.handle, found.ctypes.data, count)
        return {name: found[:, k] for k, name in enumerate(self.columns)}

    @property
    def broken(self):
        """How often the slave broke a rule of its port."""
        return self.own.host_broken(self.handle)
