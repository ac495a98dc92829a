"""Edges of the rate output, solved stage by stage: its coefficients are inputs, so every sum can be brought anywhere.

    t = 1, t2 = 0      scale_sum = s0*2**12 + s1,   word*2**24 - bias = (word*2**8 - b0)*2**16 - b1
    s0 = 2**28         scaled = corrected           s0 = 1    the dropped bits of the product are those of corrected

Source  fpga_model/rate_output.py
"""

import numpy as np

from fpga_model import rate_output
from fpga_model.fixed import half_up

ONE = 1 << rate_output.SCALE.f
SUM_CUT = rate_output.SCALE_SUM.f - rate_output.SCALE.f
BIAS_CUT = rate_output.BIAS.f - rate_output.CORRECTED.f
T_ONE = 1 << rate_output.CODE_CUT
half_up = getattr(half_up, "py_func", half_up)


def rounding_edge_bits(cut):
    """(bits that are cut, what is kept) at the edges of a rounding; a tie with every sign and parity."""
    half, size = 1 << (cut - 1), 1 << cut
    ties = [(half, upper_bits) for upper_bits in (2, 3, -2, -3)]
    return [(low, 2) for low in (0, 1, half - 1, half + 1, size - 1)] + ties


def _word(corrected):
    """(word, b0) with word*2**8 - b0 = corrected."""
    word = min(max(corrected >> 8, rate_output.CODE.lo), rate_output.CODE.hi)
    return {"word": word, "bias": (word << 8) - corrected}


def _scale_sums(w):
    lo, hi = rate_output.SCALE.lo, rate_output.SCALE.hi
    for low, quotient in rounding_edge_bits(SUM_CUT):
        w.operation({"scale": quotient, "scale_t1": low, "temperature": T_ONE, "word": 1 << 20})
    for scale, more in ((hi, 1), (hi, 0), (hi, -1), (lo, -1), (lo, 0), (lo, 1)):
        w.operation({"scale": scale, "scale_t1": more << SUM_CUT, "temperature": T_ONE, "word": 1 << 10})


def _corrections(w):
    lo, hi = rate_output.CORRECTED.lo, rate_output.CORRECTED.hi
    for low, quotient in rounding_edge_bits(BIAS_CUT):
        # word*2**24 - (b0*2**16 + b1): b1 takes the dropped bits away from one more than is kept
        w.operation({"scale": ONE, **_word(quotient + 1), "bias_t1": (1 << BIAS_CUT) - low, "temperature": T_ONE})
    for target_corrected in (lo - 1, lo, lo + 1, hi - 1, hi, hi + 1):
        w.operation({"scale": ONE, **_word(target_corrected)})


def _scaling(w):
    lo, hi = rate_output.OUT.lo, rate_output.OUT.hi
    for low, quotient in rounding_edge_bits(rate_output.SCALED_CUT):
        w.operation({"scale": 1, **_word((quotient << rate_output.SCALED_CUT) + low)})
    for target_output in (lo - 1, lo, lo + 1, hi - 1, hi, hi + 1):
        for scale in (ONE, 3 * ONE // 2, rate_output.SCALE.hi):
            estimate = (target_output << rate_output.SCALED_CUT) // scale
            exact = [c for c in (estimate, estimate + 1) if half_up(c * scale, rate_output.SCALED_CUT) == target_output]
            if exact and rate_output.CORRECTED.holds(exact[0]):
                w.operation({"scale": scale, **_word(exact[0])})
                break


def _means(w):
    """Sums whose cut bits are at every edge, by one sample that is not 0; 2**k samples for each mean."""
    w.append_row(rst=1)
    for k in (1, 2, 3):
        for low, upper_bits in rounding_edge_bits(k):
            w.operation({"decimation": k, "scale": ONE, **_word((upper_bits << k) + low)})
            for _ in range((1 << k) - 1):
                w.operation({"decimation": k, "scale": ONE})


def _squares(w):
    """Temperatures whose squares are at the edges of what their rounding drops: of all of them, the least."""
    t = np.arange(rate_output.T.lo, rate_output.T.hi + 1)
    low, half = (t * t) & ((1 << rate_output.T2_CUT) - 1), 1 << (rate_output.T2_CUT - 1)
    for dropped_bits in (0, 1, half - 1, half, half + 1, 2 * half - 1):
        temperatures = t[low == dropped_bits]
        for value in (temperatures[temperatures < 0][-1:], temperatures[temperatures > 0][:1]):
            if len(value):
                w.operation({"scale": ONE, "word": 256, "temperature": int(value[0]) << rate_output.CODE_CUT})


def _decimations(w):
    """Every decimation, with a change in the middle of a mean."""
    for k in range(8):
        for _ in range((1 << min(k, 6)) + 3):
            w.operation({"decimation": k, "scale": ONE, "word": w.random.raw(rate_output.CODE)})


def _resets(w):
    """Resets within a mean: of 64 at its last sample, and while a sample is on its way; then where one is ready."""
    for k, samples in ((6, 63), (3, 2)):
        w.append_row(rst=1)
        for _ in range(samples):
            w.operation({"decimation": k, "scale": ONE, "word": w.random.raw(rate_output.CODE)})
        w.append_row({"decimation": k, "scale": ONE, "en": 1}, times=1)
        w.append_row({"decimation": k, "scale": ONE}, times=2)
        w.append_row(rst=1)
    w.append_row({"scale": ONE, "en": 1, "word": 1})
    w.append_row({"scale": ONE, "word": 1}, times=w.block.wait - 1)
    w.append_row(rst=1)


def _captures(w):
    """Word and temperature are those of `en`: in each clock that follows both are others."""
    word, temperature = rate_output.CODE.hi // 3, T_ONE * (rate_output.T.hi // 3)
    for sign in (1, -1):
        first = {"scale": ONE >> 8, "bias_t1": 1 << 20, "bias_t2": 3, "scale_t1": 1 << 20, "scale_t2": 5}
        w.append_row({**first, "en": 1, "word": sign * word, "temperature": sign * temperature})
        for clock in range(w.block.wait):
            w.append_row(
                {**first, "word": ~(sign * word) ^ clock, "temperature": -(sign * temperature >> 1) ^ (clock << 12)}
            )


def _low_bits(w):
    """Each value of the low seven bits of word, t, corrected, scaled, acc and y, below high bits that change."""
    for k in range(128):
        word = (k * 0x9E3779B1 & 0x7FFF80 | k) - (1 << 22)
        t = (word & 0xFFFF) - (1 << 15)
        w.operation({"scale": ONE, "word": word, "bias": -(k ^ 0x55), "temperature": t << rate_output.CODE_CUT})


def edges_rate_output(w):
    for part in (_scale_sums, _corrections, _scaling, _means, _squares, _decimations, _resets, _captures, _low_bits):
        part(w)
