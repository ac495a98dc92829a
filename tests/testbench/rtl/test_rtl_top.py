"""The reference RTL of the whole firmware: every register and pin of every clock against the model, from reset.

Two boards, analog and digital demodulator, with a sequencer whose times are frames and a watchdog of few microseconds,
so that some thousand clocks hold a start-up to LOCKED, a lost ADC and the user's fixed words. The ADC's frames come
from its own model, which answers the pins of the firmware; a row is what the registers hold before an edge.
"""

import functools
import re
from typing import NamedTuple

import numpy as np
import pytest

from analog_frontend.parts import adc_serial
from fpga_model import (
    agc,
    control,
    dds,
    digital_sid,
    fault_monitor,
    lock_monitor,
    pi,
    rates,
    registers,
    sequencer,
    spi_dac,
    watchdog,
)
from fpga_model import references as references_block
from fpga_model import top as fpga
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import bits
from fpga_model.jit import kernel
from fpga_model.rates import FRAME_HZ
from fpga_model.sine import ROM
from testbench.config import Config
from testbench.engines import engine
from testbench.flatten import format_leaves, leaves, store
from testbench.golden.bundles import benches
from testbench.golden.stimulus import blocks
from testbench.run import build
from tests.testbench.rtl.test_rtl import BIT, RTL, declared, evaluated, icarus, ran, verilator, yosys

PARTS = sorted({path.name for path in RTL.glob("*.v")} - {"top.v"})
PINS = tuple(
    name for name in engine.PIN_COLUMNS if name not in ("drdy_n", "dout", "drive_code", "sense_code", "quadrature_code")
)
FEW = 5000  # rows that the fast set compares at most
ADC_PERIOD = 560  # clocks between conversions: a read takes 489
GAP = (16, 20)  # conversions that do not come: the watchdog takes over


def flat(name):
    return name.replace(".", "_")


def signals(prefix, formats):
    return [(prefix + flat(name), fmt) for name, fmt in format_leaves(formats)]


INPUTS = [("rst", BIT), *zip(fpga.Inputs._fields, fpga.INPUTS_FMT)]
REGISTERS = signals("r_", fpga.STATE_FMT)
OUTPUTS = REGISTERS + [(f"o_{name}", bits(4) if name == "refs" else BIT) for name in PINS]


# Stimulus -----------------------------------------------------------------------------------------------------------


def quick_sequencer():
    """Every state for a frame or few."""
    frame = 1 / FRAME_HZ
    ways = [f"{loop}_{way}_s" for loop in ("agc", "pll", "ftr", "qsc") for way in ("in", "out")]
    names = ("power_up_s", "init_s", "kick_s", "decay_s", "retune_s", "recover_s")
    p = sequencer.design(
        **dict.fromkeys(names, frame),
        search_s=24 * frame,
        timeout_s=9 * frame,
        offline_s=4 * frame,
        search_limit_hz=800.0,
        lock=lock_monitor.design(
            **dict.fromkeys(ways, 2 * frame), agc_in=0.5, agc_out=0.6, pll_in_deg=60, pll_out_deg=70
        ),
        faults=fault_monitor.design(*[2 * frame] * 5),
    )
    return p._replace(search=2)  # shorter than a gain of so few frames would allow


class Board(NamedTuple):
    """Parameters of the firmware, clocks to run, and rows in which it is reset."""

    params: fpga.Params
    rows: int
    resets: tuple


def board(digital):
    p = build.firmware(Config())
    c = p.control
    # gains that bring every loop to its limits within frames
    loops = {name: getattr(c, name) for name in ("agc", "frequency_tracker", "rate_loop", "quadrature_loop")}
    loops = {
        name: q._replace(loop=q.loop._replace(kp=1 << 27, ki=min(q.loop.ki << 6, pi.COEF.hi)))
        for name, q in loops.items()
    }
    p = p._replace(
        control=c._replace(sequencer=quick_sequencer(), **loops),
        watchdog=watchdog.Params(limit=40),
    )
    if digital:
        p = p._replace(
            digital=1,
            quadrature_fast=1,
            pipe=p.pipe._replace(depth=3),
            references=p.references._replace(align=2, retimed=1 - p.references.retimed),
            sense_modulator=p.sense_modulator._replace(frames=2),
            drive_modulator=p.drive_modulator._replace(frames=1),
            sid=digital_sid.design(pole_hz=1900.0),
            watchdog=watchdog.Params(limit=300),
        )
        return Board(p, 56_000, (0, 1, 777))
    return Board(p, 32_000, (0, 1, 900))


def host_writes(rows):
    """(clock, name, raw): phases and calibration early, the user's interventions late."""
    words = (0x5A5A5A5A5A5A, 0xA5A5A5A5A5A5, 0x123456789ABC, 0xFEDCBA987654)
    at = [(1200 + 40 * k, register.name, word) for k, (register, word) in enumerate(zip(registers.WRITABLE[2:], words))]
    at += [(1400, "amplitude_setpoint", 9_900_000), (1430, "frequency_fixed", 0x1BBA000000)]
    at += [(1500 + 30 * k, r.name, 0x123456789 * (k + 3)) for k, r in enumerate(registers.WRITABLE[8:14])]
    at += [(1700, "rate_scale", 0x7000000), (1730, "rate_scale_t1", -12345), (1760, "rate_scale_t2", 4321)]
    at += [(1790, "decimation", 1), (1800, "identity", 0), (1810, "rate_bias", 77)]
    at += [(rows * 12 // 16, "control", sequencer.RUN | sequencer.FIX_FTR | sequencer.FIX_QSC)]
    at += [(rows * 14 // 16, "control", sequencer.RUN | sequencer.OPEN_DRIVE | sequencer.FIX_FTR)]
    at += [(rows * 15 // 16 + 97 * k, "fault_clear", 1 << k) for k in range(8)]
    return sorted(at)


def given(b):
    """Arrays by clock: [rst, write, address, data], DRDY of the ADC, and the codes of a conversion."""
    rng = np.random.default_rng(20260131 + b.params.digital)
    host = np.zeros((b.rows, 4), np.int64)
    host[list(b.resets), 0] = 1
    for clock, name, raw in host_writes(b.rows):
        register = registers.BY_NAME[name]
        host[clock, 1:] = 1, register.address, raw & registers.DATA.hi
    ready = np.zeros(b.rows, np.int64)
    ready[ADC_PERIOD // 2 :: ADC_PERIOD] = 1
    count = int(ready.sum())
    codes = np.zeros((count + 1, 8), np.int64)
    codes[:, 0] = rng.integers(-2000, 2000, count + 1)
    codes[:, 1] = rng.integers(-6_200_000, -5_900_000, count + 1)  # near the setpoint
    codes[:, 2:8] = rng.integers(-3000, 3000, (count + 1, 6))
    codes[:, 4] = rng.integers(-(1 << 23), 1 << 23, count + 1)
    codes[8:10, 1] = 0  # nothing found in the first search
    codes[27:33, 2:4] = 0x7FFFFF, -(1 << 23)
    codes[33:36, 1] = -5_300_000
    codes[37:40] = codes[36]  # nothing moves
    codes[42:45, 1] = 0  # the drive is lost
    codes[49:52, :4] = -(1 << 23)
    clocks = np.flatnonzero(ready)
    ready[clocks[GAP[0] : GAP[1]]] = 0
    noise = rng.integers(-4000, 4000, (b.rows, 2))
    return host, ready, codes, noise


@kernel
def record(p, reset, adc, host, ready, codes, noise, stim, regs, pins):
    """Rows of inputs, registers and pins; the SAR samples are the references of a tick ago, with noise."""
    s, count, x, y = reset, 0, 0, 0
    for n in range(stim.shape[0]):
        row, h = stim[n], host[n]
        i = fpga.Inputs(adc.drdy_n, adc_serial.dout(adc), x, y, h[1], h[2], h[3])
        row[0] = h[0]
        store(row[1:], i)
        store(regs[n], s)
        refs = references_block.pins(p.references, s.references)
        store(
            pins[n],
            (
                s.adc.cs_n,
                s.adc.sclk,
                refs,
                s.drive_dac.sync_n,
                s.drive_dac.sclk_en,
                spi_dac.sdin(p.drive_dac, s.drive_dac),
                s.sense_dac.sync_n,
                s.sense_dac.sclk_en,
                spi_dac.sdin(p.sense_dac, s.sense_dac),
                s.sense_dac.ldac_n,
                s.quadrature_dac.sync_n,
                s.quadrature_dac.sclk_en,
                spi_dac.sdin(p.quadrature_dac, s.quadrature_dac),
            ),
        )
        if s.rates.tick == 0:
            x = noise[n, 0] + (-88_000 if refs & 2 else 88_000)
            y = noise[n, 1]
        s = reset if h[0] == 1 else fpga.step(p, ROM, s, i)
        status = 0xC00000 if count % 7 != 5 else 0x400000
        c = codes[count]
        eight = (c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7])
        adc = adc_serial.step(adc_serial.WORD_BITS, adc, s.adc.cs_n, s.adc.sclk, ready[n], status, eight)
        count += ready[n]


@functools.cache
def recorded(digital):
    """(board, stimulus, registers, pins), the last three as int64 rows."""
    b = board(digital)
    stim = np.zeros((b.rows, len(INPUTS)), np.int64)
    regs = np.zeros((b.rows, len(REGISTERS)), np.int64)
    pins = np.zeros((b.rows, len(PINS)), np.int64)
    record(b.params, fpga.State(), adc_serial.State(), *given(b), stim, regs, pins)
    return b, stim, regs, pins


@functools.cache
def expected(digital, rows=None):
    """What the registers and pins hold before each edge, or the first ones, as hex."""
    _, _, regs, pins = recorded(digital)
    return hexed(np.column_stack([regs, pins])[:rows], [fmt for _, fmt in OUTPUTS])


def hexed(rows, formats):
    """One hex number per row: the first value in the most significant bits, two's complement."""
    total = sum(fmt.width for fmt in formats)
    digits, lines = -(-total // 4), []
    for begin in range(0, len(rows), 2000):
        part = rows[begin : begin + 2000]
        field = np.zeros((len(part), digits * 4 + (digits % 2) * 4), np.uint8)
        at = field.shape[1] - total
        for values, fmt in zip(part.T, formats, strict=True):
            for k in range(fmt.width):
                field[:, at + k] = values >> (fmt.width - 1 - k) & 1
            at += fmt.width
        lines += [line.tobytes().hex()[digits % 2 :] for line in np.packbits(field, axis=1)]
    return lines


# Bench --------------------------------------------------------------------------------------------------------------


def parameters(p):
    """(name, raw bits, width) of every parameter."""
    pairs = list(zip(leaves(p), format_leaves(fpga.PARAMS_FMT), strict=True))
    assert all(fmt.holds(raw) for (_, raw), (_, fmt) in pairs)
    return [(flat(name), int(raw) & ((1 << fmt.width) - 1), fmt.width) for (name, raw), (_, fmt) in pairs]


def instance(b, expression):
    """gyro_top with the board's parameters, as `dut`; `expression(name, high, low)` gives an input."""
    values = [f".{name}({width}'h{raw:x})" for name, raw, width in parameters(b.params)]
    values += ['.SINE_ROM_FILE("sine.hex")', '.CORDIC_ROM_FILE("cordic_atan.hex")']
    high, pins = sum(fmt.width for _, fmt in INPUTS), [".clk(clk)"]
    for name, fmt in INPUTS:
        pins.append(f".{name}({expression(name, high - 1, high - fmt.width)})")
        high -= fmt.width
    pins += [f".{name}({name})" for name, _ in OUTPUTS]
    return f"  gyro_top #({', '.join(values)}) dut ({', '.join(pins)});"


def bench(b):
    wires = "\n".join(f"  wire [{fmt.width - 1}:0] {name};" for name, fmt in OUTPUTS)
    width = sum(fmt.width for _, fmt in INPUTS)
    return f"""module bench;
  reg [{width - 1}:0] stim [0:{b.rows - 1}];
  reg [{width - 1}:0] now;
  reg clk;
  integer file, n;
{wires}
{instance(b, lambda _, high, low: f"now[{high}:{low}]")}
  initial begin
    $readmemh("stim.hex", stim);
    file = $fopen("out.hex", "w");
    clk = 0;
    for (n = 0; n < {b.rows}; n = n + 1) begin
      now = stim[n];
      #1 $fdisplay(file, "%h", {{{", ".join(name for name, _ in OUTPUTS)}}});
      clk = 1;
      #1 clk = 0;
    end
    $fclose(file);
    $finish;
  end
endmodule
"""


def board_top(b):
    """The design with its parameters set: yosys takes neither texts nor so many numbers from outside."""
    ports = ["input wire clk", *(f"input wire [{fmt.width - 1}:0] {name}" for name, fmt in INPUTS)]
    ports += [f"output wire [{fmt.width - 1}:0] {name}" for name, fmt in OUTPUTS]
    return f"module board ({', '.join(ports)});\n{instance(b, lambda name, *_: name)}\nendmodule\n"


def write_roms(folder):
    for stem in ("sine", "cordic"):
        for path, text in benches.rom_files(blocks.BLOCKS[stem]).items():
            (folder / path.split("/")[-1]).write_text(text)


def under_icarus(b, stim, folder, changed=None):
    """Rows the Verilog gives; `changed` is {file: text} in place of the file."""
    sources = []
    for name in ("top.v", *PARTS):
        path = RTL / name
        if changed and name in changed:
            path = folder / name
            path.write_text(changed[name])
        sources.append(path)
    (folder / "bench.v").write_text(bench(b))
    (folder / "stim.hex").write_text("\n".join(hexed(stim, [fmt for _, fmt in INPUTS])) + "\n")
    write_roms(folder)
    ran(["iverilog", "-g2005", "-s", "bench", "-o", "bench.vvp", "bench.v", *sources], folder)
    ran(["vvp", "-n", "bench.vvp"], folder)
    return (folder / "out.hex").read_text().split()


def difference(found, digital):
    """None, or the first row and what differs in it. Row 0 is before the first reset: anything may stand there."""
    for n, (got, want) in enumerate(zip(found, expected(digital, FEW if len(found) <= FEW else None), strict=False)):
        if n == 0 or got == want:
            continue
        if not re.fullmatch("[0-9a-f]+", got):
            return f"row {n} holds what is no number"
        a, b, wrong = int(got, 16), int(want, 16), []
        for name, fmt in reversed(OUTPUTS):
            mask = (1 << fmt.width) - 1
            if (a ^ b) & mask:
                wrong.append(f"{name} = {a & mask:#x}, not {b & mask:#x}")
            a, b = a >> fmt.width, b >> fmt.width
        return f"row {n}: " + ", ".join(wrong)
    return None


# Tests --------------------------------------------------------------------------------------------------------------

BOARDS = pytest.mark.parametrize(
    "digital", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["analog", "digital"]
)


@icarus
@pytest.mark.parametrize(
    ("digital", "rows"),
    [(False, 3000), *(pytest.param(digital, None, marks=pytest.mark.slow) for digital in (False, True))],
)
def test_verilog_holds_what_the_model_holds(digital, rows, tmp_path):
    """All rows, or the first ones: start-up, host writes, resets."""
    b, stim, _, _ = recorded(digital)
    b = b._replace(rows=rows or b.rows)
    found = under_icarus(b, stim[: b.rows], tmp_path)
    assert len(found) == b.rows
    assert difference(found, digital) is None


def test_the_stimulus_moves_every_register():
    """In one of the two boards; the parts have no other lead and LDAC. Every state but none, every fault, every pin."""
    still, flags, states = set(dict(REGISTERS)), 0, set()
    for digital in (False, True):
        _, _, regs, pins = recorded(digital)
        still &= {name for (name, _), column in zip(REGISTERS, regs.T, strict=True) if np.ptp(column) == 0}
        assert all(np.ptp(column) > 0 for column in pins.T)
        column = {name: regs[:, k] for k, (name, _) in enumerate(REGISTERS)}
        flags |= int(np.bitwise_or.reduce(column["r_control_sequencer_faults_flags"]))
        states |= set(column["r_control_sequencer_state"].tolist())
        assert (column["r_rates_slot"] == rates.SLOTS).sum() > 10
    assert still == {
        *(f"r_{part}_dac_ldac_{name}" for part in ("drive", "quadrature") for name in ("n", "wait")),
        "r_sense_dac_lead",
        "r_quadrature_dac_lead",
    }
    assert flags == fault_monitor.ALL
    assert states == set(range(len(sequencer.STATES)))


# File, rows, right, wrong: one slip of each kind that wiring allows
PLANTED = [
    ("top.v", 2200, "off_sense_ref (r_registers_phase_sense_ref", "off_sense_ref (r_registers_phase_drive_ref"),
    ("top.v", 4500, "CODE_TICK = 5'd1", "CODE_TICK = 5'd0"),
    ("top.v", 200, "== QUADRATURE_ONES;", "!= QUADRATURE_ONES;"),
    ("top.v", 1600, "init && control_word", "control_word"),
    ("top.v", 15000, "(r_watchdog_stale && ce_8k)", "r_watchdog_stale"),
    ("top.v", 15000, "? 24'sd0 : r_adc_channels_4", "? 24'sd0 : r_adc_channels_5"),
    ("control.v", 800, "SLOT_SEQUENCER = 6'd31", "SLOT_SEQUENCER = 6'd30"),
    ("control.v", 800, "SLOT_ROOT = 6'd36", "SLOT_ROOT = 6'd35"),
    ("control.v", 32000, "? CODE_HI : -drive_cos", "? CODE_LO : -drive_cos"),
    ("control.v", 32000, "fix_qsc ? bank", "fix_ftr ? bank"),
]


@icarus
@pytest.mark.parametrize(
    ("name", "rows", "right", "wrong"),
    [pytest.param(*slip, marks=pytest.mark.slow) if slip[1] >= 15_000 else slip for slip in PLANTED],
)
def test_a_planted_slip_is_seen(name, rows, right, wrong, tmp_path):
    text = (RTL / name).read_text()
    assert text.count(right) == 1
    b, stim, _, _ = recorded(False)
    found = under_icarus(b._replace(rows=rows), stim[:rows], tmp_path, {name: text.replace(right, wrong)})
    assert len(found) == rows
    assert difference(found, False) is not None


def test_ports_of_top_are_those_of_the_model():
    text = (RTL / "top.v").read_text()
    wanted = {
        "input": [("clk", BIT), *INPUTS],
        "output": OUTPUTS,
        "parameter": [*signals("", fpga.PARAMS_FMT), ("SINE_ROM_FILE", BIT), ("CORDIC_ROM_FILE", BIT)],
    }
    for kind, pairs in wanted.items():
        assert declared(text, kind, "v") == [(name, fmt.width, bool(fmt.s)) for name, fmt in pairs], kind


def test_ports_of_control_are_those_of_the_model():
    text = (RTL / "control.v").read_text()
    given_at = [("slot", rates.STATE_FMT.slot), *((k, digital_sid.CODE) for k in control.Inputs._fields[:5])]
    given_at += [("adc_ok", BIT), ("stale", BIT)]
    for name, width, signed in declared(text, "input", "v")[2 + len(given_at) :]:
        fmt = registers.BY_NAME[name.removeprefix("bank_")].fmt
        assert (width, signed) == (fmt.width, bool(fmt.s)), name
    wanted = {
        "input": [("clk", BIT), ("rst", BIT), *given_at],
        "output": [*signals("r_", control.STATE_FMT), ("o_amplitude", agc.AMPLITUDE), ("o_dac_init", BIT)],
        "parameter": [*signals("", control.PARAMS_FMT), ("CORDIC_ROM_FILE", BIT)],
    }
    for kind, pairs in wanted.items():
        found = declared(text, kind, "v")[: len(pairs) if kind == "input" else None]
        assert found == [(name, fmt.width, bool(fmt.s)) for name, fmt in pairs], kind


def test_constants_are_those_of_the_model():
    """Numbers that are no parameters: slots, clocks of a tick, lengths, and the register map."""

    def constants(stem):
        text = (RTL / f"{stem}.v").read_text()
        return {name: int(value, base(kind)) for name, kind, value in re.findall(r"(\w+) = \d+'s?([dhb])(\w+)", text)}

    def base(kind):
        return {"d": 10, "h": 16, "b": 2}[kind]

    slots = {"SLOT_CORDIC", "SLOT_SEQUENCER", "SLOT_LOOPS", "SLOT_ROOT"}
    found = constants("control")
    assert {name: found[name] for name in slots} == {name: getattr(rates, name) for name in slots}
    assert found["SLOT_PI"] == control.SLOT_PI
    found = constants("top")
    ticks = (spi_dac.CODE_TICK, spi_dac.LOAD_TICK, rates.SLOT_SEQUENCER)
    assert (found["CODE_TICK"], found["LOAD_TICK"], found["SLOT_SEQUENCER"]) == ticks
    found = constants("rates")
    assert found["SLOTS"] == rates.SLOTS
    found = constants("sequencer")
    assert [found[name] for name in sequencer.STATES] == list(range(len(sequencer.STATES)))
    assert constants("fault_monitor")["RANGE_HI"] == fault_monitor.RANGE_LIMIT


def test_register_bank_is_the_map():
    """Addresses, widths, reset values and order, from the text alone; how they act is in the bundle."""
    text = (RTL / "registers.v").read_text()
    head, _, body = text.partition("if (rst) begin")
    reset, _, decoded = body.partition("end else begin")
    # resets of words of the DDS are expressions: the bundle tells their values
    resets = re.findall(r"r_(\w+) +<= (\d+)'s?h(\w+);", reset)
    assert [(name, int(width), int(raw, 16)) for name, width, raw in resets] == [
        (r.name, r.fmt.width, registers.to_bus(r.reset, r.fmt)) for r in registers.WRITABLE if r.fmt != dds.PHASE
    ]
    cases = re.findall(r"8'h(\w+): r_(\w+) +<= (.*)data\[(\S+):0\];", decoded)
    waiting = {"rw": "", "w1c": "(taken ? 8'h0 : r_fault_clear) | "}
    assert [(int(at, 16), name, kept, evaluated(high, DEFAULT) + 1) for at, name, kept, high in cases] == [
        (r.address, r.name, waiting[r.access], r.fmt.width) for r in registers.WRITABLE
    ]
    comments = re.findall(r"r_(\w+),? +// 0x(\w+) (\S+)", head)
    assert [(name, int(address, 16), fmt) for name, address, fmt in comments] == [
        (r.name, r.address, str(r.fmt)) for r in registers.WRITABLE
    ]


@icarus
def test_icarus_has_no_warning(tmp_path):
    sources = [RTL / name for name in ("top.v", *PARTS)]
    ran(["iverilog", "-g2005", "-Wall", "-s", "gyro_top", "-o", "lint.vvp", *sources], tmp_path, silent=True)


@verilator
@BOARDS
def test_verilator_has_no_warning(digital, tmp_path):
    values = [f"-G{name}={width}'h{raw:x}" for name, raw, width in parameters(recorded(digital)[0].params)]
    values += ['-GSINE_ROM_FILE="sine.hex"', '-GCORDIC_ROM_FILE="cordic_atan.hex"']
    sources = [RTL / name for name in ("top.v", *PARTS)]
    ran(["verilator", "--lint-only", "-Wall", "--top-module", "gyro_top", *values, *sources], tmp_path, silent=True)


@pytest.mark.slow
@yosys
@BOARDS
def test_yosys_synthesises_without_latches(digital, tmp_path):
    (tmp_path / "board.v").write_text(board_top(board(digital)))
    write_roms(tmp_path)
    steps = (
        *(f"read_verilog -defer {RTL / name}" for name in ("top.v", *PARTS)),
        "read_verilog board.v",
        "hierarchy -check -top board",
        "proc; flatten; opt; check -assert",
        "select -assert-none t:$dlatch t:$adff t:$dffsr",
        "synth -top board -run coarse:fine",
        "check -assert",
    )
    ran(["yosys", "-q", "-p", "; ".join(steps)], tmp_path)
