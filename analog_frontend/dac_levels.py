"""Errors of the levels of a segmented DAC: a string of unequal elements, thermometer steps, weights of the bits below.

    e(code) = left_k + (right_k - left_k) u + sum of the errors of the bits that are set        in V, added to dac.volts
    place   = code + 2^(bits-1);  k = its top five bits;  u = the other bits / 2^(bits-5)

    place --+--[top 5 bits]--> left_k, right_k ----(+)--> e
            '--[bits - 5]----> u, weights ----------'

Texts of effects.drive_dac_levels and effects.sense_dac_levels:
    element K/N = E   element K of a string of N is E LSB too large: a ramp over its codes, kept by all codes above
    step K/N = E      thermometer element K of N: a step of E LSB where it begins
    bit B = E         the weight of bit B is E LSB too large

N is 2, 4, 8, 16 or 32; a string of fewer than 32 is a sum of elements of 32. K counts from 1 at the lowest code, B from
0; |E| is at most 64. Smooth errors cannot be distinguished from the voltmeter's curve. Clocked and frame engine only.
Port      dac_drive, dac_sense   Mechanism polynomial (piecewise)   Unit LSB of the DAC
Source    docs/measured.md, docs/effects.md
"""

import re
from typing import NamedTuple

import numpy as np

from analog_frontend.effects.ports import Info
from fpga_model.jit import inlined, kernel

INFO = Info(
    name="dac_levels",
    port="dac_drive",
    mechanism="polynomial",
    unit="LSB",
    source="all levels of a 16-bit DAC, measured twice (docs/measured_results.md)",
    fingerprint="force depends on the code: harmonics of the sine, nonlinear relation of amplitude word and force",
)
STRING_BITS = 5
ELEMENTS = 1 << STRING_BITS
MAX_BITS = 24
MAX_LSB = 64.0
START_ERRORS, END_ERRORS, WEIGHTS, SIZE = 0, ELEMENTS, 2 * ELEMENTS, 2 * ELEMENTS + MAX_BITS
TEXT = re.compile(r"\s*(element|step)\s+(\d+)/(\d+)\s*=\s*(\S+)\s*|\s*(bit)\s+(\d+)\s*=\s*(\S+)\s*")


class Params(NamedTuple):
    """Switch, width of the code, and (SIZE,) V: both ends of each of 32 elements, then the weights by bit."""

    on: int
    bits: int
    table_v: np.ndarray


OFF = Params(0, 16, np.zeros(SIZE))


def table(texts, bits):
    """(SIZE,) in LSB from texts; ValueError: no such text, out of range."""
    out = np.zeros(SIZE)
    element_indices = np.arange(ELEMENTS)
    for text in texts:
        match = TEXT.fullmatch(text) if isinstance(text, str) else None
        if not match:
            raise ValueError(f'dac levels: {text!r}: expected "element K/N = LSB", "step K/N = LSB" or "bit B = LSB"')
        kind, number, segment_count = match[1] or match[5], int(match[2] or match[6]), int(match[3] or 0)
        try:
            error = float(match[4] or match[7])
        except ValueError:
            error = np.inf
        if not abs(error) <= MAX_LSB:
            raise ValueError(f"dac levels: {text!r}: the error is outside -{MAX_LSB:g} .. {MAX_LSB:g} LSB")
        if kind == "bit":
            if number >= bits:
                raise ValueError(f"dac levels: {text!r}: bits are 0 .. {bits - 1}")
            out[WEIGHTS + number] += error
            continue
        if segment_count not in [1 << m for m in range(1, STRING_BITS + 1)] or not 1 <= number <= segment_count:
            raise ValueError(f"dac levels: {text!r}: expected K/N with N of 2, 4, 8, 16 or 32 and K of 1 .. N")
        fine = ELEMENTS // segment_count
        first = (number - 1) * fine
        if kind == "step":
            out[START_ERRORS : START_ERRORS + ELEMENTS] += error * (element_indices >= first)
            out[END_ERRORS : END_ERRORS + ELEMENTS] += error * (element_indices >= first)
        else:
            out[START_ERRORS : START_ERRORS + ELEMENTS] += error * np.clip((element_indices - first) / fine, 0.0, 1.0)
            out[END_ERRORS : END_ERRORS + ELEMENTS] += error * np.clip((element_indices + 1 - first) / fine, 0.0, 1.0)
    return out


def design(texts, bits, lsb_v):
    """Params of a DAC of `bits` bits whose LSB is `lsb_v`; no texts: OFF."""
    if not STRING_BITS < bits <= MAX_BITS:
        raise ValueError(f"dac levels: {bits} bits are outside {STRING_BITS + 1} .. {MAX_BITS}")
    if not len(texts):
        return OFF
    return Params(1, bits, table(texts, bits) * lsb_v)


@inlined
def volts(p, code):
    """What the level of `code` is too high by (V); `p` is on."""
    offset_code = code + (1 << (p.bits - 1))
    low_bit_count = p.bits - STRING_BITS
    k = offset_code >> low_bit_count
    low_code = offset_code - (k << low_bit_count)
    start_error_v = p.table_v[START_ERRORS + k]
    error = start_error_v + (p.table_v[END_ERRORS + k] - start_error_v) * (float(low_code) / float(1 << low_bit_count))
    for b in range(p.bits):
        if (offset_code >> b) & 1:
            error = error + p.table_v[WEIGHTS + b]
    return error


def errors(texts, bits):
    """Errors (LSB) of all 2^bits levels, by the kernel: what a recording of the levels would show."""
    return _all(Params(1, bits, table(texts, bits)), np.empty(1 << bits))


@kernel
def _all(p, out):
    half = len(out) >> 1
    for i in range(len(out)):
        out[i] = volts(p, i - half)
    return out
