"""Where a compiled kernel is not the hardware: what Numba makes of six expressions, what Verilog makes of them.

The firmware avoids all of them: every accumulator is wrapped by name, every width is checked at import, no shift
reaches 63, no unsigned type is used. These tests say why, and would tell if Numba changed.
"""

import platform
import shutil
import subprocess

import numba
import numpy as np
import pytest

from fpga_model import fixed

compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="Numba is switched off: its traps were NOT tried")
icarus = pytest.mark.skipif(shutil.which("iverilog") is None, reason="no iverilog: Verilog's side was NOT tried")

VERILOG = """
module t;
  reg [31:0] a, b, sum; reg signed [63:0] x, y, product; reg [6:0] n; reg signed [31:0] p, q;
  initial begin
    a = 32'hffffffff; b = 1; sum = a + b;
    x = 64'sd1 <<< 40; y = x; product = x * y;
    $display("%0d %0d", sum, product);
    x = 1; n = 64; $display("%0d", x << n); n = 70; $display("%0d", x << n);
    p = -7; q = 2; $display("%0d %0d", p / q, p % q);
    x = 64'sh8000000000000000; y = x < 0 ? -x : x; $display("%0d", y);
  end
endmodule
"""


@icarus
def test_what_verilog_makes_of_them(tmp_path):
    (tmp_path / "t.v").write_text(VERILOG)
    subprocess.run(["iverilog", "-o", "t.vvp", "t.v"], cwd=tmp_path, check=True)
    out = subprocess.run(["vvp", "-n", "t.vvp"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert out.split() == ["0", "0", "0", "0", "-3", "-1", str(-(2**63))]


@compiled
def test_a_sum_of_two_uint32_is_wider_than_a_register():
    total = numba.njit(lambda a, b: a + b)(np.uint32(2**32 - 1), np.uint32(1))
    assert int(total) == 2**32
    assert fixed.wrap_unsigned(int(total), 32) == 0


@compiled
def test_a_product_beyond_int64_is_silent():
    product = numba.njit(lambda a, b: a * b)
    assert product(1 << 40, 1 << 40) == 0
    assert product(3 << 31, 3 << 31) == (9 << 62) - (1 << 65)


@compiled
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64", "aarch64", "arm64"), reason="up to the processor")
def test_a_shift_counts_modulo_64():
    shift = numba.njit(lambda x, n: x << n)
    assert (shift(1, 64), shift(1, 70)) == (1, 64)


@compiled
def test_uint64_and_int64_mix_in_silence():
    total = numba.njit(lambda a, b: a + b)
    total(np.uint64(1), np.int64(-2))
    (signature,) = total.nopython_signatures
    assert signature.return_type in (numba.int64, numba.float64)


@compiled
def test_the_magnitude_of_the_lowest_number_is_negative():
    assert numba.njit(lambda x: abs(x))(-(2**63)) == -(2**63)


@compiled
def test_division_and_remainder_round_down_and_not_toward_zero():
    assert numba.njit(lambda a, b: (a // b, a % b))(-7, 2) == (-4, 1)
    assert (fixed.floor(-7, 1), fixed.toward_zero(-7, 1)) == (-4, -3)
