"""A Verilog design of the whole firmware as a shared library: Verilator's C++ model behind three C functions.

    gyro_edge(h, in)      one edge of the clock with inputs as in `INPUTS`; returns pins and LDACS after it, packed
    gyro_differs(h, row)  place of the first register or pin that is not `row`, or -1; registers first, then pins
    gyro_read(h, row)     registers and pins, signed

All take a handle and an array of int64. The design is `gyro_top` of docs/golden.md, its parameters set to those asked
for; registers are its ports `r_NAME`, pins `o_NAME`.
Source  docs/rtl.md; Verilator 5.006, "Connecting to C++"
"""

import ctypes
import re
import shutil
from pathlib import Path

import numpy as np

from fpga_model import top
from fpga_model.fixed import formats
from testbench.errors import ConfigError, FileError
from testbench.flatten import format_leaves
from testbench.golden.bundles import benches
from testbench.golden.recording import board
from testbench.golden.stimulus.blocks import RESET_INPUT, flat
from testbench.tool import run_tool

INPUTS = (RESET_INPUT, *top.Inputs._fields)
PINS = top.Pins._fields
# Dotted as in the model; the port of a register is r_ and the name with its dots as underscores, that of a pin o_
REGISTERS = tuple(name for name, _ in format_leaves(top.STATE_FMT))
NAMES = (*REGISTERS, *PINS)
PORTS = (*(f"r_{flat(name)}" for name in REGISTERS), *(f"o_{name}" for name in PINS))
# Bit at which each pin begins in the word that `gyro_edge` returns: refs, of four bits, comes behind the others
REFS_AT = len(PINS)
LDACS = ("r_drive_dac_ldac_n", "r_quadrature_dac_ldac_n")
LDACS_AT = REFS_AT + 4
PIN_AT = tuple(REFS_AT if name == "refs" else k for k, name in enumerate(PINS))
TOOLS = ("verilator", "g++", "make")


def _mask(fmt):
    return (1 << fmt.width) - 1


def formats_of(design):
    """Formats of registers and pins, in the order of NAMES."""
    return (*(fmt for _, fmt in format_leaves(formats(top.State, design))), *top.PINS_FMT)


def driver(design):
    """Text of the C++ around Verilator's class."""
    found_formats = formats_of(design)
    given = "\n".join(f"    top.{name} = in[{k}];" for k, name in enumerate(INPUTS))
    bits = [(f"o_{name}", at) for name, at in zip(PINS, PIN_AT, strict=True)]
    bits += [(name, LDACS_AT + k) for k, name in enumerate(LDACS)]
    packed = " |\n           ".join(f"(int64_t)top.{name} << {at}" for name, at in bits)
    tests = "\n".join(
        f"    d |= ((uint64_t)row[{k}] & {_mask(fmt):#x}u) ^ top.{port};"
        for k, (port, fmt) in enumerate(zip(PORTS, found_formats, strict=True))
    )
    found = "\n".join(
        f"    if (((uint64_t)row[{k}] & {_mask(fmt):#x}u) != top.{port}) return {k};"
        for k, (port, fmt) in enumerate(zip(PORTS, found_formats, strict=True))
    )
    reads = "\n".join(
        f"    row[{k}] = " + (f"(int64_t)((uint64_t)top.{port} << {64 - fmt.width}) >> {64 - fmt.width};" if fmt.s
                              else f"(int64_t)top.{port};")
        for k, (port, fmt) in enumerate(zip(PORTS, found_formats, strict=True))
    )  # fmt: skip
    return f"""// Generated: one edge, comparison and read-out of gyro_top
#include <cstdint>
#include <memory>
#include "Vgyro_top.h"
#include "verilated.h"

struct Design {{
    std::unique_ptr<VerilatedContext> context{{new VerilatedContext}};
    Vgyro_top top{{context.get()}};
}};

double sc_time_stamp() {{ return 0; }}

extern "C" {{
int64_t gyro_new() {{ return (int64_t) new Design; }}

void gyro_delete(int64_t handle) {{
    Design* design = (Design*)handle;
    design->top.final();
    delete design;
}}

int64_t gyro_edge(int64_t handle, const int64_t* in) {{
    Vgyro_top& top = ((Design*)handle)->top;
{given}
    top.clk = 0;
    top.eval();
    top.clk = 1;
    top.eval();
    return {packed};
}}

int64_t gyro_differs(int64_t handle, const int64_t* row) {{
    Vgyro_top& top = ((Design*)handle)->top;
    uint64_t d = 0;
{tests}
    if (!d) return -1;
{found}
    return -1;
}}

int64_t gyro_read(int64_t handle, int64_t* row) {{
    Vgyro_top& top = ((Design*)handle)->top;
{reads}
    return 0;
}}
}}
"""


def sources(rtl):
    """Files of the design in a folder: the parts that are there, then top.v; FileError if it has none."""
    rtl = Path(rtl).resolve()
    if not (rtl / "top.v").is_file():
        raise FileError(f"{rtl / 'top.v'}: no design: gyro_top is looked for there")
    return [path for path in (rtl / f"{stem}.v" for stem in (*benches.PARTS["top"], "top")) if path.is_file()]


def build(rtl, params, folder, level=2):
    """Compile the design in folder `rtl` with `params` (fpga_model.top.Params); returns the path of the library.

    level  of the C++ compiler's optimisation; 0 for a short run: the build is most of it
    Raises ConfigError for a missing tool, FileError for a missing design, a missing port or whatever a tool says.
    """
    for name in TOOLS:
        if shutil.which(name) is None:
            raise ConfigError(f"{name}: not installed; the loop around RTL needs {', '.join(TOOLS)}")
    files, folder = sources(rtl), Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "driver.cpp").write_text(driver(params.design))
    given = [f"-G{name}={width}'h{raw:x}" for name, width, raw in board.settings(params)]
    given += [f'-G{name}="{path}"' for name, path in board.write_roms(folder, params.design).items()]
    command = "verilator --cc --exe --build -O3 --x-initial 0 -Wno-fatal -Wno-lint -Wno-style".split()
    command += ["-MAKEFLAGS", f"OPT_FAST=-O{level} OPT_SLOW=-O0 OPT_GLOBAL=-O{level}"]
    command += "-CFLAGS -fPIC -LDFLAGS -shared --top-module gyro_top --Mdir built -o gyro_top.so".split()
    command += [*given, *files, "driver.cpp"]
    try:
        run_tool(command, folder, str(files[-1]))
    except FileError as problem:
        absent = sorted(set(re.findall(r"has no member named .(\w+)", str(problem))))
        raise FileError(f"{files[-1]}: port {', '.join(absent)} is missing" if absent else problem) from None
    return folder / "built" / "gyro_top.so"


class Design:
    """One instance of a compiled design, reset; a context manager.

    handle, edge, differs  what the kernels call: numbers
    """

    def __init__(self, path):
        self._library = ctypes.CDLL(str(path))
        for name in ("gyro_edge", "gyro_differs", "gyro_read"):
            function = getattr(self._library, name)
            function.restype, function.argtypes = ctypes.c_int64, (ctypes.c_int64, ctypes.c_void_p)
        self._library.gyro_new.restype = ctypes.c_int64
        self._library.gyro_delete.argtypes = (ctypes.c_int64,)
        self._library.gyro_delete.restype = None
        self.handle = self._library.gyro_new()
        self.edge, self.differs = (
            ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value for name in ("gyro_edge", "gyro_differs")
        )
        self.pins = 0
        self.reset()

    def reset(self):
        """As every bench does: `rst` over two edges."""
        given = np.zeros(len(INPUTS), np.int64)
        given[INPUTS.index(RESET_INPUT)] = given[INPUTS.index("drdy_n")] = 1
        for _ in range(benches.RESET_CYCLES):
            self.pins = self._library.gyro_edge(self.handle, given.ctypes.data)

    def read(self):
        """Registers and pins, in the order of NAMES."""
        row = np.zeros(len(NAMES), np.int64)
        self._library.gyro_read(self.handle, row.ctypes.data)
        return row

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._library.gyro_delete(self.handle)
        self.handle = 0
