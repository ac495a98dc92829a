"""One dictionary of rounding and overflow, asserted on live tools: Python, NumPy, APyTypes, Icarus, GHDL's fixed_pkg.

The table of truth first, then random sets; formats are [s,i,f]. An APyTypes number of `int_bits` and
`frac_bits` is [1, int_bits - 1, frac_bits], sfixed(l downto -f) is [1,l,f], ufixed(l downto -f) is [0,l+1,f].
"""

import math
import random
import shutil
import subprocess
from fractions import Fraction

import apytypes
import numpy as np
import pytest

from fpga_model import fixed
from fpga_model.fixed import Fmt
from fpga_model.rounding_aliases import ALIASES
from tests import naive

RULES = sorted(fixed.ROUNDINGS)

# What each rule makes of these values
VALUES = [Fraction(v) for v in ("0.5", "1.5", "2.5", "-0.5", "-1.5", "-2.5", "0.25", "-0.25", "0.75", "-0.75")]
TRUTH = {
    "floor": (0, 1, 2, -1, -2, -3, 0, -1, 0, -1),
    "toward_zero": (0, 1, 2, 0, -1, -2, 0, 0, 0, 0),
    "half_even": (0, 2, 2, 0, -2, -2, 0, 0, 1, -1),
    "half_up": (1, 2, 3, 0, -1, -2, 0, 0, 1, -1),
    "half_away": (1, 2, 3, -1, -2, -3, 0, 0, 1, -1),
    "half_zero": (0, 1, 2, 0, -1, -2, 0, 0, 1, -1),
    "half_down": (0, 1, 2, -1, -2, -3, 0, 0, 1, -1),
    "ceil": (1, 2, 3, 0, -1, -2, 1, 0, 1, 0),
}
QUARTERS = [int(value * 4) for value in VALUES]


def tool(*names):
    absent = [name for name in names if shutil.which(name) is None]
    return pytest.mark.skipif(bool(absent), reason=f"no {', '.join(absent)}: its words for rounding were NOT tried")


def ran(folder, *command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def cast(raw, src, dst, rule, saturate):
    """Raw number of format `src` in format `dst`: our rounding first, then our overflow."""
    n = src.f - dst.f
    whole = fixed.ROUNDINGS[rule](raw, n) if n > 0 else raw << -n
    if saturate:
        return fixed.clamp(whole, dst.lo, dst.hi)
    return fixed.wrap(whole, dst.width) if dst.s else fixed.wrap_unsigned(whole, dst.width)


def raws(rng, fmt):
    """A raw number of a format: an end of it, a power of two or a tie with its neighbours, or any."""
    kind = rng.randrange(4)
    near = (fmt.lo, fmt.hi, 0)[rng.randrange(3)] if kind == 0 else rng.choice((1, -1)) << rng.randrange(fmt.width)
    if kind < 2:
        return min(max(near + rng.randrange(-2, 3), fmt.lo), fmt.hi)
    if kind == 2:
        half = 1 << rng.randrange(fmt.width)
        return min(max((rng.randint(fmt.lo, fmt.hi) // half | 1) * half, fmt.lo), fmt.hi)
    return rng.randint(fmt.lo, fmt.hi)


def same_everywhere(results):
    """Pairs of rules whose results are the same for every input of a set: it could not tell one from the other."""
    return [(a, b) for a in results for b in results if a < b and results[a] == results[b]]


# The table ----------------------------------------------------------------------------------------------------------


def test_truth_table_covers_every_rule():
    assert set(TRUTH) == set(fixed.ROUNDINGS)
    assert same_everywhere(TRUTH) == []


@pytest.mark.parametrize("rule", RULES)
def test_truth_table(rule):
    assert tuple(fixed.ROUNDINGS[rule](raw, 2) for raw in QUARTERS) == TRUTH[rule]
    assert tuple(naive.rounded(rule, v) for v in VALUES) == TRUTH[rule]


# Python and NumPy ---------------------------------------------------------------------------------------------------

LIVE_PYTHON = {
    "//": lambda k, n: k // (1 << n),
    ">>": lambda k, n: k >> n,
    "math.floor": lambda k, n: math.floor(Fraction(k, 1 << n)),
    "math.ceil": lambda k, n: math.ceil(Fraction(k, 1 << n)),
    "int": lambda k, n: int(Fraction(k, 1 << n)),
    "math.trunc": lambda k, n: math.trunc(Fraction(k, 1 << n)),
    "astype(int)": lambda k, n: int((np.array([k]) / (1 << n)).astype(int)[0]),
    "round": lambda k, n: round(Fraction(k, 1 << n)),
    "numpy.round": lambda k, n: int(np.round(np.float64(k) / (1 << n))),
}


def test_every_name_of_python_is_tried():
    assert set(LIVE_PYTHON) == {key.partition(":")[2] for key in ALIASES if key.startswith("python:")}


@pytest.mark.parametrize("name", LIVE_PYTHON)
def test_python_names_round_as_their_alias_says(name):
    rule, func = ALIASES[f"python:{name}"], LIVE_PYTHON[name]
    assert tuple(func(raw, 2) for raw in QUARTERS) == TRUTH[rule]
    rng = random.Random(1)
    for _ in range(2000):
        # 53 bits, which a double holds
        raw, n = raws(rng, Fmt(1, 52, 0)), rng.randrange(1, 52)
        assert func(raw, n) == fixed.ROUNDINGS[rule](raw, n), (raw, n)


# APyTypes -----------------------------------------------------------------------------------------------------------

APY_RULES = {key.partition(":")[2]: rule for key, rule in ALIASES.items() if key.startswith("apytypes:")}
APY_OVERFLOW = {apytypes.OverflowMode.SAT: True, apytypes.OverflowMode.WRAP: False}
OPERATIONS = 100_000


def apy(raw, fmt):
    return apytypes.APyFixed(raw, int_bits=fmt.i + 1, frac_bits=fmt.f)


def apy_raw(number):
    """(format, raw number) of an APyFixed."""
    bits, width = number.to_bits(), number.bits
    fmt = Fmt(1, number.int_bits - 1, number.frac_bits)
    return fmt, bits - (1 << width) if bits >> (width - 1) else bits


def signed_format(rng, widest):
    """A signed format of 2 .. `widest` bits; the point may stand outside of it."""
    width = rng.randint(2, widest)
    f = rng.randint(-8, width + 8)
    return Fmt(1, width - 1 - f, f)


def aligned(raw, fmt, f):
    return raw << (f - fmt.f)


def ours(kind, a, x, b, y):
    """(format, raw number) of a sum, difference or product after our growth rules."""
    if kind == "mul":
        return fixed.mul_fmt(a, b), x * y
    fmt = (fixed.add_fmt if kind == "add" else fixed.sub_fmt)(a, b)
    return fmt, aligned(x, a, fmt.f) + (1 if kind == "add" else -1) * aligned(y, b, fmt.f)


def two_operands(rng, kind):
    """Two formats whose result has at most 63 bits."""
    while True:
        a, b = signed_format(rng, 62), signed_format(rng, 62)
        fmt = {"add": fixed.add_fmt, "sub": fixed.sub_fmt, "mul": fixed.mul_fmt}[kind](a, b)
        if fmt.width <= fixed.MAX_WIDTH:
            return a, b


def test_every_rule_of_ours_has_a_name_in_apytypes():
    assert set(APY_RULES.values()) == set(fixed.ROUNDINGS)


@pytest.mark.parametrize("kind", ["add", "sub", "mul"])
def test_apytypes_adds_subtracts_and_multiplies_as_we_do(kind):
    rng = random.Random(kind)
    widest = 0
    for _ in range(OPERATIONS // 4):
        a, b = two_operands(rng, kind)
        x, y = raws(rng, a), raws(rng, b)
        left, right = apy(x, a), apy(y, b)
        result = left + right if kind == "add" else left - right if kind == "sub" else left * right
        fmt, raw = apy_raw(result)
        assert (fmt, raw) == ours(kind, a, x, b, y), (a, x, b, y)
        widest = max(widest, fmt.width)
    assert widest == fixed.MAX_WIDTH


@pytest.mark.parametrize("mode", list(APY_OVERFLOW))
@pytest.mark.parametrize("name", sorted(APY_RULES))
def test_apytypes_casts_as_we_do(name, mode):
    rule, saturate = APY_RULES[name], APY_OVERFLOW[mode]
    quantization = getattr(apytypes.QuantizationMode, name)
    rng = random.Random(f"{name} {saturate}")
    found = {key: [] for key in RULES}
    rounded = overflowed = 0
    for _ in range(OPERATIONS // 4 // (len(APY_RULES) * len(APY_OVERFLOW)) + 1):
        while True:
            src, dst = signed_format(rng, 63), signed_format(rng, 62)
            # what is shifted to the left has to fit our int64, and at most 62 bits are dropped
            if src.width + dst.f - src.f <= 63 and src.f - dst.f <= 62:
                break
        raw = raws(rng, src)
        number = apy(raw, src).cast(int_bits=dst.i + 1, frac_bits=dst.f, quantization=quantization, overflow=mode)
        fmt, got = apy_raw(number)
        want = cast(raw, src, dst, rule, saturate)
        assert (fmt, got) == (dst, want), (raw, src, dst)
        for key in RULES:
            found[key].append(cast(raw, src, dst, key, saturate))
        rounded += src.f > dst.f
        overflowed += not dst.holds(cast(raw, src, Fmt(1, 62 - dst.f, dst.f), rule, False))
    assert same_everywhere(found) == []
    assert min(rounded, overflowed) > 300


# Verilog ------------------------------------------------------------------------------------------------------------

VERILOG = """
module t;
  integer q; real r; reg signed [63:0] x, one; reg [5:0] n;
  integer file, got;
  initial begin
    file = $fopen("in.txt", "r");
    one = 64'sd1;
    while ($fscanf(file, "%d %d", x, n) == 2) begin
      r = x; r = r / (one <<< n); q = r;
      $display("%0d %0d %0d %0d", x >>> n, x / (one <<< n), $rtoi(r), q);
    end
  end
endmodule
"""
VERILOG_NAMES = (">>>", "/", "$rtoi", "real to integer")


@tool("iverilog", "vvp")
def test_verilog_names_round_as_their_alias_says(tmp_path):
    assert {f"verilog:{name}" for name in VERILOG_NAMES} == {key for key in ALIASES if key.startswith("verilog:")}
    rng = random.Random(2)
    # an integer of Verilog has 32 bits
    jobs = [(raw, 2) for raw in QUARTERS] + [(raws(rng, Fmt(1, 30, 0)), rng.randrange(1, 30)) for _ in range(2000)]
    (tmp_path / "t.v").write_text(VERILOG)
    (tmp_path / "in.txt").write_text("".join(f"{raw} {n}\n" for raw, n in jobs))
    ran(tmp_path, "iverilog", "-o", "t.vvp", "t.v")
    rows = [tuple(map(int, line.split())) for line in ran(tmp_path, "vvp", "-n", "t.vvp").splitlines()]
    assert len(rows) == len(jobs)
    for name, column in zip(VERILOG_NAMES, zip(*rows), strict=True):
        rule = ALIASES[f"verilog:{name}"]
        assert column[: len(QUARTERS)] == TRUTH[rule], name
        assert list(column) == [fixed.ROUNDINGS[rule](raw, n) for raw, n in jobs], name


@tool("iverilog", "vvp")
def test_an_assignment_in_verilog_wraps_as_we_do(tmp_path):
    widths = (1, 2, 3, 8, 24, 31, 32, 33, 48, 61, 62)
    rng = random.Random(3)
    jobs = [raws(rng, Fmt(1, 62, 0)) for _ in range(1000)]
    regs = "\n".join(f"  reg signed [{w - 1}:0] s{w}; reg [{w - 1}:0] u{w};" for w in widths)
    sets = "\n".join(f'      s{w} = x[k]; u{w} = x[k]; $write("%0d %0d ", s{w}, u{w});' for w in widths)
    text = f"""module t;
  reg signed [63:0] x [0:{len(jobs) - 1}];
  integer k;
{regs}
  initial begin
    $readmemh("in.hex", x);
    for (k = 0; k < {len(jobs)}; k = k + 1) begin
{sets}
      $write("\\n");
    end
  end
endmodule
"""
    (tmp_path / "t.v").write_text(text)
    (tmp_path / "in.hex").write_text("".join(f"{raw & (1 << 64) - 1:016x}\n" for raw in jobs))
    ran(tmp_path, "iverilog", "-o", "t.vvp", "t.v")
    rows = [tuple(map(int, line.split())) for line in ran(tmp_path, "vvp", "-n", "t.vvp").splitlines()]
    want = [tuple(v for w in widths for v in (fixed.wrap(x, w), fixed.wrap_unsigned(x, w))) for x in jobs]
    assert rows == want


# VHDL: IEEE fixed_pkg -----------------------------------------------------------------------------------------------

# sfixed and ufixed with bounds that a line of in.txt gives: signed, source left and right, result left and right, bits
VHDL = """
library ieee;
use ieee.std_logic_1164.all;
use ieee.fixed_float_types.all;
use ieee.fixed_pkg.all;
use std.textio.all;
entity t is end entity;
architecture a of t is
begin
  process
    file jobs : text open read_mode is "in.txt";
    file found : text open write_mode is "out.txt";
    variable text_in, text_out : line;
    variable is_signed, l, r, l2, r2 : integer;

    procedure job(is_signed, l, r, l2, r2 : integer) is
      variable bits : std_logic_vector(l - r downto 0);
      variable s : sfixed(l downto r);
      variable u : ufixed(l downto r);
      variable sr : sfixed(l2 downto r2);
      variable ur : ufixed(l2 downto r2);
    begin
      read(text_in, bits);
      s := to_sfixed(bits, l, r);
      u := to_ufixed(bits, l, r);
      for rule in fixed_round_style_type loop
        for limit in fixed_overflow_style_type loop
          sr := resize(s, l2, r2, limit, rule);
          ur := resize(u, l2, r2, limit, rule);
          if is_signed = 1 then
            write(text_out, to_slv(sr));
          else
            write(text_out, to_slv(ur));
          end if;
          write(text_out, ' ');
        end loop;
      end loop;
      writeline(found, text_out);
    end procedure;
  begin
    while not endfile(jobs) loop
      readline(jobs, text_in);
      read(text_in, is_signed);
      read(text_in, l);
      read(text_in, r);
      read(text_in, l2);
      read(text_in, r2);
      job(is_signed, l, r, l2, r2);
    end loop;
    wait;
  end process;
end architecture;
"""
# in the order of declaration in fixed_float_types: fixed_round, fixed_truncate; fixed_saturate, fixed_wrap
VHDL_COLUMNS = [(name, saturate) for name in ("fixed_round", "fixed_truncate") for saturate in (True, False)]


def resized(folder, jobs):
    """What fixed_pkg makes of (raw, source, result) under every pair of its rules: one list per job."""
    lines = []
    for raw, src, dst in jobs:
        bounds = [bound for fmt in (src, dst) for bound in (fmt.i - 1 + fmt.s, -fmt.f)]
        lines.append(f"{src.s} {' '.join(map(str, bounds))} {raw & (1 << src.width) - 1:0{src.width}b}\n")
    (folder / "t.vhd").write_text(VHDL)
    (folder / "in.txt").write_text("".join(lines))
    ran(folder, "ghdl", "-a", "--std=08", "t.vhd")
    ran(folder, "ghdl", "--elab-run", "--std=08", "t")
    found = []
    for line, (_, _, dst) in zip((folder / "out.txt").read_text().splitlines(), jobs, strict=True):
        words = [int(word, 2) for word in line.split()]
        found.append([word - (1 << dst.width) if dst.s and word >> (dst.width - 1) else word for word in words])
    return found


@tool("ghdl")
def test_fixed_pkg_rounds_the_table_as_its_alias_says(tmp_path):
    src, dst = Fmt(1, 3, 2), Fmt(1, 3, 0)
    found = resized(tmp_path, [(raw, src, dst) for raw in QUARTERS])
    for (name, _), column in zip(VHDL_COLUMNS, zip(*found), strict=True):
        assert column == TRUTH[ALIASES[f"fixed_pkg:{name}"]], name


@tool("ghdl")
def test_fixed_pkg_resizes_as_we_do(tmp_path):
    rng, jobs = random.Random(4), []
    while len(jobs) < 4000:
        s = rng.randrange(2)
        src, dst = ((lambda w, f: Fmt(s, w - s - f, f))(rng.randint(2, 62), rng.randint(-4, 40)) for _ in range(2))
        # at least one bit of the source stays, and our int64 holds what is shifted to the left
        if src.width + dst.f - src.f <= 62 and src.f - dst.f < src.width:
            jobs.append((raws(rng, src), src, dst))
    found = resized(tmp_path, jobs)
    results = {}
    for (name, saturate), column in zip(VHDL_COLUMNS, zip(*found), strict=True):
        rule = ALIASES[f"fixed_pkg:{name}"]
        wrong = [job for job, got in zip(jobs, column) if got != cast(*job, rule, saturate)]
        assert wrong == [], (name, saturate, len(wrong), wrong[0])
        results[f"{name} {saturate}"] = column
    assert same_everywhere(results) == []


@tool("ghdl")
def test_fixed_pkg_does_not_round_when_the_result_begins_above_the_guard_bit(tmp_path):
    """Half of the result's LSB is above the source: fixed_round drops the bits, and what is below zero becomes -1."""
    src, dst = Fmt(1, 2, 0), Fmt(1, 6, -4)
    found = resized(tmp_path, [(raw, src, dst) for raw in (-4, -1, 0, 3)])
    assert found == [[-1] * 4, [-1] * 4, [0] * 4, [0] * 4]
    assert [cast(raw, src, dst, "half_even", True) for raw in (-4, -1, 0, 3)] == [0] * 4
