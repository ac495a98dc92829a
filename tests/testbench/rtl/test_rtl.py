"""The reference RTL: every register of every clock against the model, under Icarus and GHDL; ports; linters.

The benches here are ours alone and as short as can be: hex in, hex out, nothing compared in HDL. Row n is what the
registers and pins hold before edge n; the reset comes at the start and five times in the middle.
"""

import inspect
import random
import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from fpga_model import (
    axi_slave,
    dds,
    delay,
    host_bus,
    modulator,
    pi,
    references,
    sine,
    spi_adc,
    spi_dac,
    spi_slave,
    wiring,
)
from fpga_model import block as registry
from fpga_model.block import structure
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import bits
from testbench.flatten import format_leaves, leaves
from testbench.golden.stimulus import blocks as golden_blocks
from tests.fpga_model import spi_host
from tests.fpga_model.test_spi_slave import assert_served, host_of, talked

RTL = Path(__file__).resolve().parents[3] / "testbench" / "rtl"
BIT = bits(1)
TIMEOUT_S = 120


def tool(name):
    path = shutil.which(name)
    return pytest.mark.skipif(path is None, reason=f"no {name}: the RTL is not tried under it")


icarus, verilator, ghdl, yosys = (tool(name) for name in ("iverilog", "verilator", "ghdl", "yosys"))


# Stimulus -----------------------------------------------------------------------------------------------------------


def corners(fmt):
    """Ends of a format, around zero, and around every power of two: carries, ties and saturation edges."""
    powers = [sign << k for k in range(fmt.width) for sign in (1, -1)]
    near = {v + d for v in (fmt.lo, fmt.hi, 0, *powers) for d in (-1, 0, 1)}
    return sorted(v for v in near if fmt.holds(v))


def any_row(formats):
    """Rows of independent draws: an eighth ends of the format, three eighths corners, the rest small or anywhere."""
    table = [(fmt, corners(fmt), (fmt.lo, fmt.lo + 1, fmt.hi - 1, fmt.hi), min(fmt.hi, 1 << 12)) for fmt in formats]

    def value(rng, fmt, near, ends, small):
        kind = rng.randrange(8)
        if kind == 0:
            return rng.choice(ends)
        if kind < 4:
            return rng.choice(near)
        return rng.randint(max(fmt.lo, -small), small) if kind < 6 else rng.randint(fmt.lo, fmt.hi)

    return lambda rng, _: tuple(value(rng, *entry) for entry in table)


def sine_ties():
    """Phases at which rounding meets an exact half: the slope must be a multiple of 1024, so there are few."""
    ties, (base, slope) = [], sine.tables()
    for a in (k for k, rise in enumerate(slope) if rise % sine.ROWS == 0):
        for f in range(1 << sine.FRACTION_BITS):
            total = (base[a] << sine.FRACTION_BITS) + slope[a] * (2 * f + 1)
            if total % (1 << sine.PRODUCT.f) == 1 << (sine.PRODUCT.f - 1):
                ties.append((a << sine.FRACTION_BITS | f) << sine.CUT)
    return ties


def sine_row():
    """Any phase, and now and then a tie in one of the two quadrants that do not mirror."""
    anywhere, ties = any_row((sine.PHASE,)), sine_ties()

    def draw(rng, s):
        if rng.random() < 0.1:
            return (rng.choice(ties) | rng.getrandbits(1) << (sine.PHASE.width - 1),)
        return anywhere(rng, s)

    return draw


WORDS = corners(spi_dac.WORD)


def dac_row(rng, s):
    """Loads that mostly come after a frame has ended, and now and then into one."""
    idle = s.sync_n == 1 and s.ldac_wait == 0
    load = int(rng.random() < (0.2 if idle else 0.005))
    return load, rng.choice(WORDS) if rng.random() < 0.3 else rng.randrange(1 << 24)


def adc_row(rng, s):
    """DRDY falls now and then; three status words of four begin as the part's do."""
    good = s.status & 3 != 3
    head = s.word == 0 and s.count < 4 and good
    dout = spi_adc.HEAD >> (3 - s.count) & 1 if head else rng.getrandbits(1)
    return int(rng.random() < 0.7), dout


def any_frame(rng):
    """Bits of a frame of any kind."""
    host = spi_host.Host(rng)
    host.any_frame(period=spi_host.PERIOD, most_words=3)
    return host.frames[-1].bits


def slave_rows(rng, frame=any_frame):
    """Rows of a host that never ends: frames at a bit in two clocks or three."""
    while True:
        bits, low = frame(rng), rng.randrange(1, 3)
        for bit in bits:
            yield from [(0, 0, int(bit))] * low + [(0, 1, int(bit))]
        yield from [(0, 0, 0)] * rng.randrange(2) + [(1, 0, 0)] * rng.randrange(1, 6)


def slave_row(rng, s):
    """A host's pins beside a bus that answers at random; its frames go with the random numbers."""
    if not hasattr(rng, "host"):
        rng.host = slave_rows(rng)
    clear = rng.randrange(8) if rng.random() < 0.02 else 0
    return (*next(rng.host), rng.getrandbits(5), rng.getrandbits(32), clear)


def axi_row(rng, s):
    """Every channel valid and ready at random; addresses within words and strobes that are refused now and then."""
    i = {name: rng.randrange(fmt.lo, fmt.hi + 1) for name, fmt in axi_slave.BLOCK.inputs.items()}
    if rng.random() < 0.7:
        i |= {"awaddr": i["awaddr"] & ~3, "araddr": i["araddr"] & ~3, "wstrb": rng.choice([15, 15, 0])}
    return tuple(i.values())


def bus_row(rng, s):
    """A busy bus: addresses of pairs and of the sample, strobes in every second clock."""
    i = {name: rng.randrange(fmt.lo, fmt.hi + 1) for name, fmt in host_bus.BLOCK.inputs.items()}
    i["address"] = rng.choice([0x280, 0x284, 0x2A0, *(8 * k + 4 * h for k in range(9) for h in (0, 1)), i["address"]])
    return tuple(i.values())


class Block(NamedTuple):
    """One module, the parameters to try, its inputs and pins with their formats, and its stimulus."""

    module: object
    params: tuple
    inputs: dict
    pins: dict
    draw: object = None
    rows: int = 1500

    @property
    def registers(self):
        return {name.replace(".", "_"): fmt for name, fmt in format_leaves(self.module.STATE_FMT)}


def pi_params():
    whole = {"lo": pi.OUT.lo, "hi": pi.OUT.hi}
    return (
        pi.design(0.5, 2000.0, 8000, -5000, 5000),
        pi.Params(kp=1 << 23, ki=-(1 << 22), lo=-3000, hi=4000),
        pi.Params(kp=pi.COEF.lo, ki=pi.COEF.hi, **whole),
        pi.Params(kp=pi.COEF.hi, ki=pi.COEF.lo, lo=pi.OUT.lo, hi=-1),
        pi.Params(kp=-1, ki=1, lo=1, hi=1),
        pi.Params(kp=12345, ki=777, lo=1, hi=pi.OUT.hi),
    )


def modulator_params():
    lo, hi = modulator.CODE.lo, modulator.CODE.hi
    return (
        modulator.design(16),
        modulator.design(20, 1),
        modulator.design(20, 2),
        modulator.design(2),
        modulator.Params(shift=0, lo=lo, hi=hi, frames=0),
        modulator.Params(shift=41, lo=-1, hi=0, frames=3),
    )


def dds_inputs():
    names = ("word", "off_drive_sine", "off_sense_sine", "off_drive_ref", "off_sense_ref")
    return dict.fromkeys(names, dds.PHASE)


BLOCKS = {
    "dds": Block(dds, (None,), dds_inputs(), {}),
    "sine": Block(sine, (None,), {"phase": sine.PHASE}, {}, sine_row(), rows=6000),
    "references": Block(
        references,
        tuple(references.design(align, retimed) for align in range(4) for retimed in (False, True)),
        {"drive_ref": references.PHASE, "sense_ref": references.PHASE, "ce_1m": BIT},
        {"pins": (bits(4), lambda p, s, *_: references.pins(p, s))},
        rows=400,
    ),
    "modulator": Block(
        modulator,
        modulator_params(),
        {"en_product": BIT, "en_code": BIT, "amplitude": modulator.AMPLITUDE, "sine": modulator.SINE},
        {"out": (modulator.CODE, lambda p, s, *_: modulator.out(p, s))},
    ),
    "pi": Block(pi, pi_params(), {"en": BIT, "mode": bits(2), "e": pi.ERR, "preset": pi.OUT}, {}),
    "spi_dac": Block(
        spi_dac,
        (
            spi_dac.DAC8811,
            spi_dac.AD5791,
            spi_dac.DAC82002,
            spi_dac.DAC82002._replace(bits=1, lead=3, ldac=1),
            spi_dac.DIVIDED,
            spi_dac.STROBED,
            spi_dac.AD5791._replace(bits=5, gap=3),
            spi_dac.AD5791._replace(bits=23, lead=2),
        ),
        {"load": BIT, "word": spi_dac.WORD},
        {"sdin": (BIT, lambda p, s, *_: spi_dac.sdin(p, s))},
        dac_row,
    ),
    "spi_adc": Block(spi_adc, (None,), {"drdy_n": BIT, "dout": BIT}, {}, adc_row, rows=8000),
    "spi_slave": Block(
        spi_slave,
        (None,),
        spi_slave.BLOCK.inputs,
        {
            "sdo": (BIT, lambda p, s, *_: spi_slave.sdo(s)),
            "fetch": (BIT, lambda p, s, *_: spi_slave.fetch(s)),
            "start": (BIT, lambda p, s, *_: spi_slave.start(s)),
        },
        slave_row,
        rows=8000,
    ),
    "axi_slave": Block(
        axi_slave,
        (None,),
        axi_slave.BLOCK.inputs,
        {
            "address": (axi_slave.ADDRESS, lambda p, s, *_: axi_slave.address(s)),
            "write": (BIT, lambda p, s, *_: axi_slave.write(s)),
            "fetch": (BIT, lambda p, s, *_: axi_slave.fetch(s)),
            "done": (BIT, lambda p, s, *i: axi_slave.done(s, i[8])),
        },
        axi_row,
        rows=6000,
    ),
    "host_bus": Block(
        host_bus,
        tuple(host_bus.BLOCK.cases.values()),
        host_bus.BLOCK.inputs,
        {
            "rdata": (host_bus.WORD, lambda p, s, *i: host_bus.rdata(s, i[0], i[6])),
            "bus_status": (spi_slave.STATUS, lambda p, s, *i: host_bus.bus_status(s, i[12], i[13])),
            "data_ready": (BIT, lambda p, s, *_: host_bus.data_ready(s)),
        },
        bus_row,
        rows=6000,
    ),
    "delay": Block(
        delay,
        tuple(delay.design(depth) for depth in range(9)),
        {"x": delay.X},
        {"out": (delay.X, delay.out)},
        rows=120,
    ),
}
VERILOG = tuple(BLOCKS)
VHDL = ("dds", "references", "pi", "spi_dac", "spi_slave", "axi_slave", "host_bus")
CASES = [
    pytest.param(stem, k, marks=pytest.mark.slow if k else ())
    for stem, block in BLOCKS.items()
    for k in range(len(block.params))
]
# Ports of a host, which are not in top, and what is in them in the order of compilation
OF_HOST = {
    "host_words": (),
    "host": ("spi_slave", "host_bus", "host_words"),
    "host_axi": ("axi_slave", "host_bus", "host_words"),
}
VHDL_CASES = [case for case in CASES if case.values[0] in VHDL]


def packed(values, formats):
    """One row as hex: the first value in the most significant bits, two's complement."""
    word = width = 0
    for value, fmt in zip(values, formats, strict=True):
        word = word << fmt.width | (int(value) & ((1 << fmt.width) - 1))
        width += fmt.width
    return f"{word:0{-(-width // 4)}x}"


def model(stem, k, seed=1):
    """Stimulus rows (reset first) and what the model holds before each edge, as hex."""
    block = BLOCKS[stem]
    p, rng = block.params[k], random.Random(f"{stem} {k} {seed}")
    draw = block.draw or any_row(block.inputs.values())
    fmt_in = [BIT, *block.inputs.values()]
    fmt_out = [*block.registers.values(), *(fmt for fmt, _ in block.pins.values())]
    resets = {0, 1, *(rng.randrange(2, block.rows) for _ in range(5))}
    first, s = (*structure(block.module).values(), *(() if p is None else (p,))), block.module.State()
    stimulus, expected = [], []
    for n in range(block.rows):
        rst, row = int(n in resets), draw(rng, s)
        stimulus.append(packed((rst, *row), fmt_in))
        pins = [pin(p, s, *row) for _, pin in block.pins.values()]
        expected.append(packed([*(value for _, value in leaves(s)), *pins], fmt_out))
        s = block.module.State() if rst else block.module.step(*first, s, *row)
    return stimulus, expected


def difference(stem, found, expected):
    """None, or the first row and what differs in it. Row 0 is before the first reset: anything may stand there."""
    block = BLOCKS[stem]
    if len(found) != len(expected):
        return f"{len(found)} rows instead of {len(expected)}"
    formats = {**{f"r_{k}": f for k, f in block.registers.items()}, **{f"o_{k}": f for k, (f, _) in block.pins.items()}}
    for n, (got, want) in enumerate(zip(found, expected, strict=True)):
        if n == 0 or got == want:
            continue
        if not re.fullmatch("[0-9a-f]+", got):
            return f"row {n}: {got} holds what is no number"
        shift, wrong = sum(f.width for f in formats.values()), []
        for name, fmt in formats.items():
            shift -= fmt.width
            a, b = (int(text, 16) >> shift & ((1 << fmt.width) - 1) for text in (got, want))
            if a != b:
                wrong.append(f"{name} = {a:#x}, not {b:#x}")
        return f"row {n}: " + ", ".join(wrong)
    return None


# Benches ------------------------------------------------------------------------------------------------------------


def ran(command, folder, silent=False):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=TIMEOUT_S)
    said = done.stdout + done.stderr
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{said}"
    if silent:
        assert said.strip() == "", said
    return said


def slices(block):
    """Every input with the range of the stimulus word it stands in, and its width; `rst` first."""
    formats = {"rst": BIT, **block.inputs}
    high = sum(fmt.width for fmt in formats.values())
    for name, fmt in formats.items():
        yield name, high - 1, high - fmt.width, fmt.width
        high -= fmt.width


def outputs(block):
    """Every output with its width, in the order of the ports."""
    return [
        *((f"r_{name}", fmt.width) for name, fmt in block.registers.items()),
        *((f"o_{name}", fmt.width) for name, (fmt, _) in block.pins.items()),
    ]


def parameters(block, p):
    """Every parameter with its raw bits and width."""
    if p is None:
        return []
    pairs = zip(p._fields, p, block.module.PARAMS_FMT)
    return [(name, int(raw) & ((1 << fmt.width) - 1), fmt.width) for name, raw, fmt in pairs]


def verilog_bench(stem, p, rows):
    block = BLOCKS[stem]
    given = [f".{name}({width}'h{raw:x})" for name, raw, width in parameters(block, p)]
    if stem == "sine":
        given = ['.ROM_FILE("rom.hex")']
    pins = [".clk(clk)", *(f".{name}(now[{hi}:{lo}])" for name, hi, lo, _ in slices(block))]
    pins += [f".{name}({name})" for name, _ in outputs(block)]
    wires = "\n".join(f"  wire [{width - 1}:0] {name};" for name, width in outputs(block))
    width = sum(width for *_, width in slices(block))
    return f"""module bench;
  reg [{width - 1}:0] stim [0:{rows - 1}];
  reg [{width - 1}:0] now;
  reg clk;
  integer file, n;
{wires}
  gyro_{stem} {f"#({', '.join(given)}) " if given else ""}dut ({", ".join(pins)});
  initial begin
    $readmemh("stim.hex", stim);
    file = $fopen("out.hex", "w");
    clk = 0;
    for (n = 0; n < {rows}; n = n + 1) begin
      now = stim[n];
      #1 $fdisplay(file, "%h", {{{", ".join(name for name, _ in outputs(block))}}});
      clk = 1;
      #1 clk = 0;
    end
    $fclose(file);
    $finish;
  end
endmodule
"""


def vhdl_bench(stem, p):
    block = BLOCKS[stem]

    def literal(raw, width):
        return f"'{raw}'" if width == 1 else f'"{raw:0{width}b}"'

    given = [f"{name} => {literal(raw, width)}" for name, raw, width in parameters(block, p)]
    wide = sum(width for *_, width in slices(block))
    stim, out = -(-wide // 4) * 4, -(-sum(width for _, width in outputs(block)) // 4) * 4
    pins = ["clk => clk"]
    pins += [f"{name} => now({hi if w == 1 else f'{hi} downto {lo}'})" for name, hi, lo, w in slices(block)]
    high = sum(width for _, width in outputs(block))
    for name, width in outputs(block):
        pins.append(f"{name} => got({high - 1 if width == 1 else f'{high - 1} downto {high - width}'})")
        high -= width
    return f"""library ieee;
use ieee.std_logic_1164.all;
use std.textio.all;
entity bench is end entity;
architecture sim of bench is
  signal clk : std_logic := '0';
  signal now : std_logic_vector({stim - 1} downto 0) := (others => '0');
  signal got : std_logic_vector({out - 1} downto 0) := (others => '0');
begin
  dut : entity work.gyro_{stem}
    {f"generic map ({', '.join(given)})" if given else ""}
    port map ({", ".join(pins)});
  process
    file stim : text open read_mode is "stim.hex";
    file rows : text open write_mode is "out.hex";
    variable text_in, text_out : line;
    variable word : std_logic_vector({stim - 1} downto 0);
  begin
    while not endfile(stim) loop
      readline(stim, text_in);
      hread(text_in, word);
      now <= word;
      wait for 1 ns;
      hwrite(text_out, got);
      writeline(rows, text_out);
      clk <= '1';
      wait for 1 ns;
      clk <= '0';
    end loop;
    wait;
  end process;
end architecture;
"""


def write_rom(folder):
    (folder / "rom.hex").write_text("".join(f"{int(word):09x}\n" for word in sine.ROM))


def under_icarus(stem, p, stimulus, folder, source=None):
    """Rows the Verilog gives; `source` replaces its text."""
    design = folder / f"{stem}.v"
    design.write_text(source or (RTL / f"{stem}.v").read_text())
    (folder / "bench.v").write_text(verilog_bench(stem, p, len(stimulus)))
    (folder / "stim.hex").write_text("\n".join(stimulus) + "\n")
    write_rom(folder)
    ran(["iverilog", "-g2005", "-o", "bench.vvp", design.name, "bench.v"], folder)
    ran(["vvp", "-n", "bench.vvp"], folder)
    return (folder / "out.hex").read_text().split()


def under_ghdl(stem, p, stimulus, folder, source=None):
    """Rows the VHDL gives; `source` replaces its text."""
    design = folder / f"{stem}.vhd"
    design.write_text(source or (RTL / f"{stem}.vhd").read_text())
    (folder / "bench.vhd").write_text(vhdl_bench(stem, p))
    (folder / "stim.hex").write_text("\n".join(stimulus) + "\n")
    ran(["ghdl", "-a", "--std=08", design.name, "bench.vhd"], folder)
    ran(["ghdl", "--elab-run", "--std=08", "bench"], folder)
    return (folder / "out.hex").read_text().lower().split()


# Tests --------------------------------------------------------------------------------------------------------------


@icarus
@pytest.mark.parametrize(("stem", "k"), CASES)
def test_verilog_holds_what_the_model_holds(stem, k, tmp_path):
    stimulus, expected = model(stem, k)
    assert difference(stem, under_icarus(stem, BLOCKS[stem].params[k], stimulus, tmp_path), expected) is None


@ghdl
@pytest.mark.parametrize(("stem", "k"), VHDL_CASES)
def test_vhdl_holds_what_the_model_holds(stem, k, tmp_path):
    stimulus, expected = model(stem, k)
    assert difference(stem, under_ghdl(stem, BLOCKS[stem].params[k], stimulus, tmp_path), expected) is None


@icarus
@pytest.mark.parametrize("seed", [4, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(10, 16))])
def test_verilog_serves_a_host_in_time(seed, tmp_path):
    """Any SCK from 0.1 MHz to the limit, first flip-flops that take old or new: what the model reads and writes."""
    host, rng = host_of(seed, 30)
    inputs, states, changes = talked(host, rng, churn=0.02)
    assert_served(host, inputs, states, changes)
    block = BLOCKS["spi_slave"]
    fmt_in = [BIT, *block.inputs.values()]
    fmt_out = [*block.registers.values(), *(fmt for fmt, _ in block.pins.values())]
    rows = [((1, *inputs[0]), spi_slave.State())] * 2
    rows += [((0, *row), s) for row, s in zip(inputs, states, strict=True)]
    stimulus = [packed(row, fmt_in) for row, _ in rows]
    expected = [packed([*s, *(pin(None, s) for _, pin in block.pins.values())], fmt_out) for _, s in rows]
    assert difference("spi_slave", under_icarus("spi_slave", None, stimulus, tmp_path), expected) is None


# File, case, right, wrong: what a designer gets wrong, one of each kind; the stimulus must see it
PLANTED = [
    ("dds.v", 0, "r_phase + word", "r_drive_sine + word"),
    ("dds.v", 0, "r_phase + off_sense_ref", "r_phase - off_sense_ref"),
    ("sine.v", 0, "+ HALF;", "+ HALF - 34'd1;"),
    ("sine.v", 0, "{r_fraction, 1'b1}", "{r_fraction, 1'b0}"),
    ("sine.v", 0, "r_sign2 ? -", "r_sign ? -"),
    ("references.v", 1, "if (ce_1m)", "if (!ce_1m)"),
    ("references.v", 2, "r_aligned_0 :", "r_aligned_1 :"),
    ("modulator.v", 0, ">> 1;", ">> 2;"),
    ("modulator.v", 0, "(rounded > HI) ? hi", "(rounded > HI) ? rounded[19:0]"),
    ("modulator.v", 1, "r_held2 <= r_held1", "r_held2 <= r_code"),
    ("pi.v", 1, "+ HALF_Y", "+ HALF_Y - 62'sd1"),
    ("pi.v", 0, "(next_acc > SUM_HI) ? ACC_HI :", ""),
    ("pi.v", 3, "(preset > hi) ? ACC_HI :", ""),
    ("spi_dac.v", 1, "r_ldac_n    <= ~r_ldac_wait;", "r_ldac_n    <= r_ldac_wait;"),
    ("spi_dac.v", 0, "{r_shift[22:0], 1'b0}", "{1'b0, r_shift[23:1]}"),
    ("spi_dac.v", 2, "r_sync_n    <= 1'b1;\n            r_sclk_en   <= 1'b0;", "r_sync_n <= 1'b0; r_sclk_en <= 1'b0;"),
    ("spi_adc.v", 0, "TAIL_CLOCKS[COUNT-1:0] - ONE", "TAIL_CLOCKS[COUNT-1:0]"),
    ("spi_adc.v", 0, "HEAD = 4'b1100", "HEAD = 4'b1000"),
    ("spi_adc.v", 0, "4'd3: r_channels_2", "4'd3: r_channels_1"),
    ("spi_slave.v", 0, "r_read ? r_shift[39] : r_sdi", "r_read ? r_sdi : r_sdi"),
    ("spi_slave.v", 0, "{~divided, 32'd0}", "{~r_crc, 32'd0}"),
    ("spi_slave.v", 0, "good && !r_read", "ends && complete && !r_read"),
    ("axi_slave.v", 0, "!r_rvalid && !writes", "!r_rvalid"),
    ("axi_slave.v", 0, "r_wstrb == 4'h0", "!r_wstrb[0]"),
    ("host_bus.v", 0, "r_pending <= low_written", "r_pending <= low_written || r_pending"),
    ("host_bus.v", 0, "done && r_reading ?", "done ?"),
    ("delay.v", 8, "r_taps_7 <= r_taps_6", "r_taps_7 <= r_taps_5"),
    ("dds.vhd", 0, "turns(r_phase, word)", "turns(r_drive_sine, word)"),
    ("references.vhd", 5, "r_retimed when retimed = '1' else picked", "picked"),
    ("pi.vhd", 1, "2**(F - 1), A + 2", "2**(F - 1) - 1, A + 2"),
    ("spi_dac.vhd", 0, "unsigned(r_left) = 1", "unsigned(r_left) = 2"),
    ("axi_slave.vhd", 0, "r_rvalid and rready", "rready"),
    ("host_bus.vhd", 0, 'counted("00", sample)', '"00"'),
    ("spi_slave.vhd", 0, "elsif r_phase /= COMMAND or unsigned(r_bit) /= 0 then", "else"),
]


@icarus
@ghdl
@pytest.mark.parametrize(
    ("name", "k", "right", "wrong"),
    [pytest.param(*fault, marks=pytest.mark.slow) if n % 3 else fault for n, fault in enumerate(PLANTED)],
)
def test_a_planted_fault_is_seen(name, k, right, wrong, tmp_path):
    stem, language = name.split(".")
    text = (RTL / name).read_text()
    assert right in text
    stimulus, expected = model(stem, k)
    run = under_icarus if language == "v" else under_ghdl
    found = run(stem, BLOCKS[stem].params[k], stimulus, tmp_path, text.replace(right, wrong))
    assert difference(stem, found, expected) is not None


def evaluated(high, design):
    """Number of an expression in keys of the design, in capitals."""
    keys = {key.upper(): value for key, value in design._asdict().items()}
    return eval((high or "0").replace("$", "").replace("/", "//"), {"clog2": lambda n: (n - 1).bit_length()}, keys)


def declared(text, kind, language, design=DEFAULT):
    """Names, widths and signs of the declared inputs, outputs or parameters of a design, in order.

    Keys of the design are no parameters here.
    """
    if language == "v":
        head = {"input": r"input +wire", "output": r"output +(?:reg|wire)", "parameter": "parameter"}[kind]
        found = re.findall(rf"^\s*{head}( +signed)? *(?:\[(\S+):0\])? *(\w+)", text, re.M)
        listed = [(name, evaluated(high, design) + 1, bool(signed)) for signed, high, name in found]
        return [entry for entry in listed if entry[0].lower() not in design._fields]
    sort = {"input": r"in +", "output": r"out +", "parameter": ""}[kind]
    found = re.findall(rf"^\s*(\w+)\s*:\s*{sort}std_logic(?:_vector\((.+) downto 0\))?[;\s]", text, re.M)
    return [(name, evaluated(high, design) + 1) for name, high in found]


def keys(text):
    """{key of the design: default} of the parameters or generics of a file, in order."""
    known = "|".join(key.upper() for key in DEFAULT._fields)
    found = re.findall(rf"^ +(?:parameter +(?:\[31:0\] )?)?({known}) +(?:: natural :)?= (?:32'd)?(\d+)", text, re.M)
    return {name.lower(): int(value) for name, value in found}


@pytest.mark.parametrize("path", sorted(RTL.glob("*.v*")), ids=lambda path: path.name)
def test_keys_of_the_design_are_parameters_with_its_values(path):
    """All that the formats and reset values of a block, or of what it holds, depend on; no others."""
    modules = blocks_within(path.stem)
    wanted = {key for module in modules for key in registry.keys(module)}
    # the port of the host reads phases and the frequency word
    wanted |= {"dds_bits"} if path.stem in OF_HOST else set()
    found = keys(path.read_text())
    assert found == {key: value for key, value in DEFAULT._asdict().items() if key in wanted}
    assert list(found) == [key for key in DEFAULT._fields if key in wanted]


def blocks_within(stem):
    """The block, or those in control, in top or in the port of the host."""
    if stem in golden_blocks.BLOCKS:
        return [registry.block_modules()[stem]]
    if stem in OF_HOST:
        return [registry.block_modules()[name] for name in OF_HOST[stem] if name not in OF_HOST]
    where = {"control": "control.", "top": ""}[stem]
    return [module for role, (module, _) in wiring.instances().items() if role.startswith(where)]


@pytest.mark.parametrize("name", [*(f"{stem}.v" for stem in VERILOG), *(f"{stem}.vhd" for stem in VHDL)])
def test_ports_are_those_of_the_model(name):
    stem, language = name.split(".")
    block, text = BLOCKS[stem], (RTL / name).read_text()
    step = block.module.step
    names = inspect.signature(getattr(step, "py_func", step)).parameters
    arguments = [a for a in names if a not in ("d", "rom", "p", "s")]
    assert list(block.inputs) == arguments
    inputs = [("clk", BIT), ("rst", BIT), *block.inputs.items()]
    out = [(f"r_{k}", fmt) for k, fmt in block.registers.items()]
    out += [(f"o_{k}", fmt) for k, (fmt, _) in block.pins.items()]
    fields = block.module.PARAMS_FMT if block.params[0] is not None else ()
    given = list(zip(getattr(fields, "_fields", ()), fields))
    for kind, pairs in (("input", inputs), ("output", out), ("parameter", given)):
        wanted = [(k, fmt.width, bool(fmt.s)) for k, fmt in pairs]
        if language == "vhd":
            wanted = [entry[:2] for entry in wanted]
        elif (stem, kind) == ("sine", "parameter"):
            wanted = [("ROM_FILE", 1, False)]
        assert declared(text.partition("architecture")[0], kind, language) == wanted, kind


@pytest.mark.parametrize("stem", OF_HOST)
def test_both_languages_of_the_port_have_the_same_ports(stem):
    """Names, widths and order."""
    verilog, vhdl = ((RTL / f"{stem}.{language}").read_text() for language in ("v", "vhd"))
    for kind in ("input", "output"):
        found = [entry[:2] for entry in declared(verilog, kind, "v")]
        assert found == declared(vhdl.partition("architecture")[0], kind, "vhd"), kind
        assert found


def test_every_file_is_tried():
    """Here, in golden/test_benches.py, for every block with a bundle, in test_rtl_top.py or test_host*.py."""
    vhdl = {f"{stem}.vhd" for stem in (*VHDL, *OF_HOST)}
    verilog = {f"{stem}.v" for stem in (*VERILOG, *golden_blocks.BLOCKS, "control", "top", *OF_HOST)}
    files = {path.name for path in RTL.iterdir() if path.is_file()}
    assert files <= verilog | vhdl
    assert vhdl <= files
    assert {f"{stem}.v" for stem in VERILOG} <= files


@pytest.mark.parametrize("path", sorted(RTL.glob("*.v*")), ids=lambda path: path.name)
def test_text_is_plain(path):
    text = path.read_text()
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 120
    # power-up values are no part of the contract: the ROM alone is filled before the first clock
    assert re.findall(r"\binitial\b.*", text) == (
        ["initial $readmemh(ROM_FILE, rom);"] if path.name in ("sine.v", "cordic.v") else []
    )


@icarus
@pytest.mark.parametrize("stem", VERILOG)
def test_icarus_has_no_warning(stem, tmp_path):
    ran(["iverilog", "-g2005", "-Wall", "-o", "lint.vvp", RTL / f"{stem}.v"], tmp_path, silent=True)


@verilator
@pytest.mark.parametrize(("stem", "k"), CASES)
def test_verilator_has_no_warning(stem, k, tmp_path):
    given = [f"-G{name}={width}'h{raw:x}" for name, raw, width in parameters(BLOCKS[stem], BLOCKS[stem].params[k])]
    command = ["verilator", "--lint-only", "-Wall", "--top-module", f"gyro_{stem}", *given, RTL / f"{stem}.v"]
    ran(command, tmp_path, silent=True)


@ghdl
@pytest.mark.parametrize("stem", [*VHDL, *OF_HOST])
def test_ghdl_has_no_warning(stem, tmp_path):
    for name in (*OF_HOST.get(stem, ()), stem):
        ran(["ghdl", "-a", "--std=08", "--warn-error", RTL / f"{name}.vhd"], tmp_path, silent=True)


@yosys
@pytest.mark.slow  # the whole design is synthesised in tests/testbench/golden/test_synthesis.py
@pytest.mark.parametrize("stem", VERILOG)
def test_yosys_synthesises_without_latches(stem, tmp_path):
    block = BLOCKS[stem]
    given = "".join(f" -chparam {name} {width}'h{raw:x}" for name, raw, width in parameters(block, block.params[0]))
    # this front end takes no text as a parameter from outside: the ROM's name is put in place of the empty one
    text = (RTL / f"{stem}.v").read_text().replace('ROM_FILE = ""', 'ROM_FILE = "rom.hex"')
    (tmp_path / "design.v").write_text(text)
    write_rom(tmp_path)
    steps = (
        "read_verilog -defer design.v",
        f"hierarchy -check -top gyro_{stem}{given}",
        "proc; opt; check -assert",
        "select -assert-none t:$dlatch t:$adff t:$dffsr",
        f"synth -top gyro_{stem} -run coarse:fine",
        "check -assert",
    )
    ran(["yosys", "-q", "-p", "; ".join(steps)], tmp_path)
