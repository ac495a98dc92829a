"""Averaged plant: the fundamental of a sine that a DAC's codes round.

    A1 = 4/pi sum over k of sqrt(1 - ((k + 1/2)/A)^2), k + 1/2 < A          A in codes, phases uniform
       = A + 4/pi sqrt(2/A) zeta(-1/2, x),   x = frac(A - 1/2), from LEAST codes on

The mean is A, the slope is not: the drive has 336 codes, and A1 rises by up to a few percent more or less than A does.
Source    docs/plant.md, docs/decisions/0014-baseband.md
"""

import math

from fpga_model.jit import outlined

LEAST = 8.0
FOUR_BY_PI = 4.0 / math.pi


@outlined
def _zeta(x):
    """Hurwitz zeta(-1/2, x) for 0 <= x <= 1, to 1e-6: four terms, then Euler and Maclaurin."""
    total = math.sqrt(x) + math.sqrt(x + 1.0) + math.sqrt(x + 2.0) + math.sqrt(x + 3.0)
    a = x + 4.0
    r = math.sqrt(a)
    return total - r * a * (2.0 / 3) + r * 0.5 - (1.0 / 24) / r


@outlined
def rounded_sine_fundamental(volts, lsb_v):
    """Amplitude (V) of the fundamental of round(sine): `volts` is that of the sine, not negative; lsb_v 0: no codes."""
    if lsb_v == 0.0:
        return volts
    codes = volts / lsb_v
    if codes < LEAST:
        total, k = 0.0, 0.5
        while k < codes:
            total += math.sqrt(1.0 - (k / codes) * (k / codes))
            k += 1.0
        return FOUR_BY_PI * total * lsb_v
    x = codes - 0.5
    return volts + FOUR_BY_PI * math.sqrt(2.0 / codes) * _zeta(x - math.floor(x)) * lsb_v
