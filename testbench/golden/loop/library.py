"""A design of the whole firmware as a shared library: Verilator's C++ model behind three C functions.

    gyro_edge(h, in)      one edge of the clock with inputs as in `INPUTS`; returns pins and LDACS after it, packed
    gyro_differs(h, row)  place of the first register or pin that is not `row`, or -1; registers first, then pins.
                          SDIN of a board's top counts where its chip reads it (`board_pins`)
    gyro_read(h, row)     registers and pins, signed

All take a handle and an array of int64. What a design must have is a `Face`:

    gyro_top              that of docs/golden.md, its parameters set to those asked for; registers are its ports
                          `r_NAME`, pins `o_NAME`
    any other top         the pins of the board alone (`board_recording.ports`); parameters are its own affair.
                          GHDL's synthesis makes Verilog of VHDL

Source  docs/rtl.md; Verilator 5.006, "Connecting to C++"
"""

import contextlib
import ctypes
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fpga_model import top
from fpga_model.fixed import formats
from testbench.errors import ConfigError, FileError
from testbench.flatten import format_leaves
from testbench.golden.bundles import benches
from testbench.golden.foreign import adapter, design_map
from testbench.golden.foreign.rtl_sources import read_source_list
from testbench.golden.loop.from_vhdl import synthesise_vhdl
from testbench.golden.recording import board_pins, board_recording
from testbench.golden.stimulus.blocks import RESET_INPUT, port_name
from testbench.storage.files import write_text
from testbench.tool import run_tool

INPUTS = (RESET_INPUT, *top.Inputs._fields)
PINS = top.Pins._fields
# Dotted as in the model; the port of a register is r_ and the name with its dots as underscores, that of a pin o_
REGISTERS = tuple(name for name, _ in format_leaves(top.STATE_FMT))
NAMES = (*REGISTERS, *PINS)
ALL = range(len(NAMES))
PORTS = (*(f"r_{port_name(name)}" for name in REGISTERS), *(f"o_{name}" for name in PINS))
# Bit at which each pin begins in the word that `gyro_edge` returns: refs, of four bits, comes behind the others
REFS_AT = len(PINS)
LDACS = ("r_drive_dac_ldac_n", "r_quadrature_dac_ldac_n")
LDACS_AT = REFS_AT + 4
PIN_AT = tuple(REFS_AT if name == "refs" else k for k, name in enumerate(PINS))
TOOLS = ("verilator", "g++", "make")
TOP, CLASS = "gyro_top", "Vgyro_top"
CLOCK = "clk"
SUFFIXES = (".v", ".sv")
UNUSED = {"analog": ("sample_x", "sample_y"), "digital": ("drdy_n", "dout")}  # inputs that a board's top may lack
DECLARED = re.compile(r"VL_(IN|OUT)(?:8|16|64|W)?\(&(\w+),(\d+),(\d+)")


class Face(NamedTuple):
    """What a bench needs of a top, by the bench's own names; a port is named as the top has it.

    inputs    {name: (port, width)}, clock and reset among them
    observed_ports  [(place in NAMES, port, format)] of what is compared with the model
    pins      ports of PINS
    ldacs     ports of LDAC of the drive DAC and of that of V_q; None where the board has none
    optional  inputs that the top may lack
    read      {place of a data pin: (place of what selects its chip, place of what says that SCLK runs)}
    """

    top: str
    inputs: dict
    observed_ports: tuple
    pins: tuple
    ldacs: tuple
    optional: tuple = ()
    read: Mapping = MappingProxyType({})


def _mask(fmt):
    return (1 << fmt.width) - 1


def port_formats(design):
    """Formats of registers and pins, in the order of NAMES."""
    return (*(fmt for _, fmt in format_leaves(formats(top.State, design))), *top.PINS_FMT)


def _bench_input_ports():
    widths = {CLOCK: 1, RESET_INPUT: 1} | {n: f.width for n, f in zip(top.Inputs._fields, top.INPUTS_FMT, strict=True)}
    return {name: (name, width) for name, width in widths.items()}


def register_face(design):
    """`Face` of gyro_top: every register is a port."""
    ports = zip(PORTS, port_formats(design), strict=True)
    return Face(
        TOP, _bench_input_ports(), tuple((k, *port) for k, port in enumerate(ports)), PORTS[len(REGISTERS) :], LDACS
    )


def pin_face(name, params, chips):
    """`Face` of a top called `name` that has the pins of the board alone; `params` and `chips` of the board."""
    ports = PORTS[len(REGISTERS) :]
    observed_ports = tuple((len(REGISTERS) + k, *port) for k, port in enumerate(zip(ports, top.PINS_FMT, strict=True)))
    ldacs = tuple(f"o_{role}_ldac_n" if getattr(chips, role).has_ldac else None for role in ("drive", "quadrature"))
    read = {NAMES.index(data): tuple(map(NAMES.index, chip)) for data, chip in board_pins.READ.items()}
    return Face(
        name,
        _bench_input_ports(),
        observed_ports,
        ports,
        ldacs,
        UNUSED["digital" if params.digital else "analog"],
        read,
    )


def _difference_expression(face, observed_index, fmt, texts):
    """Text of whether what a place shows is not that of `row`; `texts` are {signal index: text of its port}."""
    text = f"((uint64_t)row[{observed_index}] & {_mask(fmt):#x}u) ^ {texts[observed_index]}"
    if observed_index not in face.read:
        return text
    select_n, running = (texts[other] for other in face.read[observed_index])
    return f"{select_n} || !{running} ? 0 : {text}"


def driver(face, top_ports):
    """Text of the C++ around Verilator's class; `top_ports` are the ports that the top has."""

    input_assignments = "\n".join(
        f"    top.{port} = in[{k}];"
        for k, port in enumerate(face.inputs[name][0] for name in INPUTS) if port in top_ports
    )  # fmt: skip
    bits = [(f"top.{port}", at) for port, at in zip(face.pins, PIN_AT, strict=True)]
    bits += [("1" if name is None else f"top.{name}", LDACS_AT + k) for k, name in enumerate(face.ldacs)]
    packed = " |\n           ".join(f"(int64_t){text} << {at}" for text, at in bits)
    compared_ports = [(k, f"top.{port}", fmt) for k, port, fmt in face.observed_ports]
    texts = {k: text for k, text, _ in compared_ports}
    wrong = [(k, _difference_expression(face, k, fmt, texts)) for k, _, fmt in compared_ports]
    tests = "\n".join(f"    d |= {text};" for _, text in wrong)
    return_statements = "\n".join(f"    if ({text}) return {k};" for k, text in wrong)
    reads = "\n".join(
        f"    row[{k}] = " + (f"(int64_t)((uint64_t){text} << {64 - fmt.width}) >> {64 - fmt.width};" if fmt.s
                              else f"(int64_t){text};")
        for k, text, fmt in compared_ports
    )  # fmt: skip
    clock = face.inputs[CLOCK][0]
    return f"""// Generated: one edge, comparison and read-out of {face.top}
#include <cstdint>
#include <cstdio>
#include <memory>
#include <unistd.h>
#include "{CLASS}.h"
#include "verilated.h"

struct Design {{
    std::unique_ptr<VerilatedContext> context{{new VerilatedContext}};
    {CLASS} top{{context.get()}};
}};

double sc_time_stamp() {{ return 0; }}

// a design that does not settle, or that stops itself: one line instead of an abort
void vl_fatal(const char* file, int line, const char*, const char* text) {{
    std::fprintf(stderr, "gyro: %s: line %d: %s\\n", file, line, text);
    _exit(2);
}}

extern "C" {{
int64_t gyro_new() {{ return (int64_t) new Design; }}

void gyro_delete(int64_t handle) {{
    Design* design = (Design*)handle;
    design->top.final();
    delete design;
}}

int64_t gyro_edge(int64_t handle, const int64_t* in) {{
    {CLASS}& top = ((Design*)handle)->top;
{input_assignments}
    top.{clock} = 0;
    top.eval();
    top.{clock} = 1;
    top.eval();
    return {packed};
}}

int64_t gyro_differs(int64_t handle, const int64_t* row) {{
    {CLASS}& top = ((Design*)handle)->top;
    uint64_t d = 0;
{tests}
    if (!d) return -1;
{return_statements}
    return -1;
}}

int64_t gyro_read(int64_t handle, int64_t* row) {{
    {CLASS}& top = ((Design*)handle)->top;
{reads}
    return 0;
}}
}}
"""


def unpack_pin_rows(words):
    """(rows, PINS) of words that `gyro_edge` has returned."""
    masks = [15 if name == "refs" else 1 for name in PINS]
    return np.stack([(words >> at) & mask for at, mask in zip(PIN_AT, masks, strict=True)], axis=1)


def check_ports(face, declared, what):
    """Raise FileError for a port that is missing, has another width or direction, or is an input without a source.

    declared  {port: (IN or OUT, width)} of the top
    """
    required_port_kinds = {port: ("IN", width) for port, width in face.inputs.values()}
    required_port_kinds |= {port: ("OUT", fmt.width) for _, port, fmt in face.observed_ports}
    required_port_kinds |= {port: ("OUT", 1) for port in face.ldacs if port}
    optional = {face.inputs[name][0] for name in face.optional}
    absent = sorted(set(required_port_kinds) - set(declared) - optional)
    if absent:
        raise FileError(f"{what}: port {', '.join(absent)} is missing")
    for port, (way, width) in required_port_kinds.items():
        if port in declared and declared[port] != (way, width):
            actual_port_text = f"{declared[port][0].lower()}put of {declared[port][1]} bits"
            raise FileError(f"{what}: port {port}: is an {actual_port_text}, not an {way.lower()}put of {width} bits")
    undriven = sorted(port for port, (way, _) in declared.items() if way == "IN" and port not in required_port_kinds)
    if undriven:
        raise FileError(f"{what}: input {', '.join(undriven)} is not a pin of the board")


def _parse_header_ports(header):
    """{port: (IN or OUT, width)} of the class that Verilator wrote."""
    declaration_matches = DECLARED.findall(Path(header).read_text())
    return {name: (way, int(high) - int(low) + 1) for way, name, high, low in declaration_matches}


def sources(rtl):
    """Files of the design in a folder: the parts that are there, then top.v; FileError if it has none."""
    rtl = Path(rtl).resolve()
    if not (rtl / "top.v").is_file():
        raise FileError(f"{rtl / 'top.v'}: no design: this file must hold the module gyro_top")
    return [path for path in (rtl / f"{stem}.v" for stem in (*benches.PARTS["top"], "top")) if path.is_file()]


def manifest(face):
    """What a `design_map` maps: the ports of a face, as those of a bundle."""
    inputs = [
        {"name": n, "width": w, "signed": n.startswith("sample")} for n, (_, w) in face.inputs.items() if n != CLOCK
    ]
    output_widths = {port: fmt.width for _, port, fmt in face.observed_ports} | {port: 1 for port in face.ldacs if port}
    outputs = [{"name": port.removeprefix("o_"), "width": width, "signed": 0} for port, width in output_widths.items()]
    levels = {"pins": list(output_widths), "outputs": list(output_widths)}
    return {"block": "board", "case": "loop", "inputs": inputs, "registers": [], "outputs": outputs, "levels": levels,
            "sha256": {}}  # fmt: skip


def write_map_wrapper(face, path, top, folder):
    """(face, Verilog file in `folder`, module) of a wrapper around a design whose ports a map names.

    top  name of the design, before that of the map
    """
    port_manifest = manifest(face)
    port_map = design_map.read(path, port_manifest, "pins", top)
    wrapper_path = Path(folder).resolve() / "wrapper.v"
    write_text(wrapper_path, adapter.verilog(port_manifest, port_map))
    return face._replace(top=adapter.adapter_name(port_manifest)), wrapper_path, port_map.top


def user_sources(rtl, name, files=None, folder="."):
    """Arguments of Verilator for a user's top `name` in folder `rtl`: a list of files, or all that lie there.

    folder  for the Verilog of a list that names VHDL
    """
    rtl = Path(rtl).resolve()
    if files is not None:
        source = read_source_list(files)
        if source.language == "vhdl":
            return [synthesise_vhdl(source, name, folder, files)]
        return [*(f"-I{path}" for path in source.includes), *(f"-D{text}" for text in source.defines), *source.files]
    paths = sorted(path for path in rtl.glob("*") if path.suffix in SUFFIXES)
    if not paths:
        hint = "; for VHDL list the files in order with --files" if [*rtl.glob("*.vhd"), *rtl.glob("*.vhdl")] else ""
        raise FileError(
            f"{rtl}: no design: {name} is expected in files {' and '.join(f'*{s}' for s in SUFFIXES)}{hint}"
        )
    return [f"-I{rtl}", *map(str, paths)]


def build(rtl, params, folder, level=2, face=None, source_arguments=None):
    """Compile the design in folder `rtl` with `params` (fpga_model.top.Params); returns the path of the library.

    level   of the C++ compiler's optimisation; 0 for a short run: the build is most of it
    face    of a top with the pins of the board alone, which takes no parameters; gyro_top if None
    source_arguments  arguments of Verilator that are its sources (`user_sources`)
    Raises ConfigError for a missing tool, FileError for a missing design, a wrong port or whatever a tool says.
    """
    for name in TOOLS:
        if shutil.which(name) is None:
            raise ConfigError(f"{name}: not installed; the loop around RTL needs {', '.join(TOOLS)}")
    folder, parameter_options = Path(folder).resolve(), []
    if face is None:
        face, source_arguments = register_face(params.design), sources(rtl)
        what = source_arguments[-1]
        folder.mkdir(parents=True, exist_ok=True)
        parameter_options = [
            f"-G{name}={width}'h{raw:x}" for name, width, raw in board_recording.top_parameters(params)
        ]
        parameter_options += [
            f'-G{name}="{path}"' for name, path in board_recording.write_roms(folder, params.design).items()
        ]
    else:
        what = f"{rtl}: {face.top}"
        folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder / "built", ignore_errors=True)
    command = "verilator --cc --exe -O3 --x-initial 0 -Wno-fatal -Wno-lint -Wno-style".split()
    command += (
        f"-CFLAGS -fPIC -CFLAGS -DVL_USER_FATAL -LDFLAGS -shared --top-module {face.top} --prefix {CLASS}".split()
    )
    command += "--Mdir built -o gyro_top.so".split()
    run_tool([*command, *parameter_options, *source_arguments, "driver.cpp"], folder, str(what))
    declared = _parse_header_ports(folder / "built" / f"{CLASS}.h")
    check_ports(face, declared, what)
    (folder / "driver.cpp").write_text(driver(face, declared))
    optimised = [f"OPT_FAST=-O{level}", "OPT_SLOW=-O0", f"OPT_GLOBAL=-O{level}"]
    run_tool(["make", "-s", "-C", "built", "-f", f"{CLASS}.mk", *optimised], folder, str(what))
    return folder / "built" / "gyro_top.so"


class Design:
    """One instance of a compiled design, reset; a context manager.

    folder                 where the design reads its tables from
    face                   `Face`; gyro_top if None
    signal_indices         of NAMES, that it shows
    handle, edge, differs  what the kernels call: numbers
    """

    def __init__(self, path, face=None, folder="."):
        self.observed_indices = ALL if face is None else tuple(index for index, _, _ in face.observed_ports)
        self._folder = folder
        self._data = {} if face is None else face.read
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
        reset_inputs = np.zeros(len(INPUTS), np.int64)
        reset_inputs[INPUTS.index(RESET_INPUT)] = reset_inputs[INPUTS.index("drdy_n")] = 1
        with contextlib.chdir(self._folder):  # its first evaluation reads the tables
            for _ in range(benches.RESET_CYCLES):
                self.pins = self.step(reset_inputs)

    def step(self, edge_inputs):
        """One edge with inputs as in INPUTS, int64; returns what `gyro_edge` does."""
        return self._library.gyro_edge(self.handle, edge_inputs.ctypes.data)

    def read(self):
        """Registers and pins, in the order of NAMES; 0 in places that the design does not show."""
        row = np.zeros(len(NAMES), np.int64)
        self._library.gyro_read(self.handle, row.ctypes.data)
        return row

    def differing_indices(self, expected, got):
        """Places in which two rows differ, as `gyro_differs` judges them."""
        unread = {k for k, (select_n, running) in self._data.items() if got[select_n] or not got[running]}
        return [k for k in self.observed_indices if expected[k] != got[k] and k not in unread]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._library.gyro_delete(self.handle)
        self.handle = 0
