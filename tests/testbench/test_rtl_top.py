"""The reference RTL of the whole firmware: every register and pin of every clock against the model, from reset.

Two boards, analog and digital demodulator, with a sequencer whose times are frames and a watchdog of few microseconds,
so that some thousand clocks hold a start-up to LOCKED, a lost ADC and the user's fixed words. The ADC's frames come from
its own model, which answers the pins of the firmware; a row is what the registers hold before an edge.
"""

import re
from typing import NamedTuple

import numpy as np
import pytest

from analog_frontend import adc_serial
from fpga_model import control, digital_sid, fault_monitor, lock_monitor, registers, sequencer, watchdog
from fpga_model import references as references_block
from fpga_model import spi_dac
from fpga_model import top as fpga
from fpga_model.fixed import bits
from fpga_model.jit import kernel
from fpga_model.rates import FRAME_HZ
from testbench import build, engine
from testbench.config import Config
from testbench.flatten import format_leaves, leaves, store
from testbench.golden import benches, blocks
from tests.testbench.test_rtl import BIT, RTL, declared, icarus, ran, verilator, yosys

PARTS = sorted({path.name for path in RTL.glob("*.v")} - {"top.v"})
PINS = tuple(
    name
    for name in engine.PIN_COLUMNS
    if name not in ("drdy_n", "dout", "drive_code", "sense_code", "quadrature_code")
)
ADC_PERIOD = 560  # clocks between conversions: a read takes 489
GAP = (12, 18)  # conversions that do not come: the watchdog takes over


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
        lock=lock_monitor.design(**dict.fromkeys(ways, frame), agc_in=0.5, agc_out=0.6),
        faults=fault_monitor.design(2 * frame, 9 * frame, 2 * frame, 2 * frame, 3 * frame),
    )
    return p._replace(search=2)  # shorter than a gain of so few frames would allow


class Board(NamedTuple):
    """Parameters of the firmware, clocks to run, and rows in which it is reset."""

    params: fpga.Params
    rows: int
    resets: tuple


def board(digital):
    p = build.firmware(Config())
    p = p._replace(
        control=p.control._replace(sequencer=quick_sequencer()),
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
        return Board(p, 40_000, (0, 1, 777))
    return Board(p, 18_000, (0, 1, 900))


def host_writes(rows):
    """(clock, name, raw): phases and calibration early, the user's interventions late."""
    at = [(1200 + 40 * k, r.name, 0x5A5A5A5A5A5A >> k) for k, r in enumerate(registers.WRITABLE[2:6])]
    at += [(1500 + 30 * k, r.name, 0x123456789 * (k + 3)) for k, r in enumerate(registers.WRITABLE[8:14])]
    at += [(1800, "rate_scale_t1", -12345), (1820, "rate_scale_t2", 4321), (1850, "decimation", 1)]
    late = rows * 2 // 3
    at += [(late, "control", sequencer.RUN | sequencer.FIX_FTR | sequencer.FIX_QSC)]
    at += [(rows * 7 // 9, "control", sequencer.RUN | sequencer.OPEN_DRIVE | sequencer.FIX_FTR)]
    at += [(rows * 8 // 9 + 50 * k, "fault_clear", 1 << k) for k in range(8)]
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
    codes[count // 2 : count // 2 + 3, 2:4] = 0x7FFFFF, -(1 << 23)
    codes[-3:, :4] = -(1 << 23)
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
            x = noise[n, 0] + (-92_000 if refs & 2 else 92_000)
            y = noise[n, 1]
        s = reset if h[0] == 1 else fpga.step(p, s, i)
        status = 0xC00000 if count % 7 != 5 else 0x400000
        c = codes[count]
        adc = adc_serial.step(
            adc, s.adc.cs_n, s.adc.sclk, ready[n], status, (c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7])
        )
        count += ready[n]


@pytest.fixture(scope="module", params=["analog", "digital"])
def run(request):
    """(board, stimulus, registers, pins) as int64 rows."""
    b = board(request.param == "digital")
    stim = np.zeros((b.rows, len(INPUTS)), np.int64)
    regs = np.zeros((b.rows, len(REGISTERS)), np.int64)
    pins = np.zeros((b.rows, len(PINS)), np.int64)
    record(b.params, fpga.State(), adc_serial.State(), *given(b), stim, regs, pins)
    return b, stim, regs, pins


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
    pairs = zip(leaves(p), format_leaves(fpga.PARAMS_FMT), strict=True)
    return [(flat(name), int(raw) & ((1 << fmt.width) - 1), fmt.width) for (name, raw), (_, fmt) in pairs]


def bench(b):
    values = [f".{name}({width}'h{raw:x})" for name, raw, width in parameters(b.params)]
    values += ['.SINE_ROM_FILE("sine.hex")', '.CORDIC_ROM_FILE("cordic_atan.hex")']
    high, pins = sum(fmt.width for _, fmt in INPUTS), [".clk(clk)"]
    for name, fmt in INPUTS:
        pins.append(f".{name}(now[{high - 1}:{high - fmt.width}])")
        high -= fmt.width
    pins += [f".{name}({name})" for name, _ in OUTPUTS]
    wires = "\n".join(f"  wire [{fmt.width - 1}:0] {name};" for name, fmt in OUTPUTS)
    width = sum(fmt.width for _, fmt in INPUTS)
    return f"""module bench;
  reg [{width - 1}:0] stim [0:{b.rows - 1}];
  reg [{width - 1}:0] now;
  reg clk;
  integer file, n;
{wires}
  gyro_top #({", ".join(values)}) dut ({", ".join(pins)});
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


def difference(found, regs, pins):
    """None, or the first row and what differs in it. Row 0 is before the first reset: anything may stand there."""
    rows, formats = np.column_stack([regs, pins]), [fmt for _, fmt in OUTPUTS]
    expected = hexed(rows, formats)
    assert len(found) == len(expected)
    for n, (got, want) in enumerate(zip(found, expected, strict=True)):
        if n == 0 or got == want:
            continue
        if not re.fullmatch("[0-9a-f]+", got):
            return f"row {n} holds what is no number"
        word, wrong = int(got, 16), []
        for (name, fmt), value in zip(reversed(OUTPUTS), reversed(rows[n].tolist()), strict=True):
            mask = (1 << fmt.width) - 1
            if word & mask != value & mask:
                wrong.append(f"{name} = {word & mask:#x}, not {value & mask:#x}")
            word >>= fmt.width
        return f"row {n}: " + ", ".join(wrong)
    return None


# Tests --------------------------------------------------------------------------------------------------------------


@icarus
def test_verilog_holds_what_the_model_holds(run, tmp_path):
    b, stim, regs, pins = run
    assert difference(under_icarus(b, stim, tmp_path), regs, pins) is None
