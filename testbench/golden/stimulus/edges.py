"""Edges that the formats do not say: truncation carries, ties, saturation edges +-1 LSB, solved per block and case.

`edges_STEM` belongs to the block STEM.

Source  docs/conventions.md (formats)
"""

import itertools
import math

import numpy as np

from fpga_model import dds, modulator, notch, registers, sine, spi_dac
from testbench.golden.stimulus.edges_digital_sid import edges_digital_sid  # noqa: F401
from testbench.golden.stimulus.edges_pi import edges_loop, edges_pi  # noqa: F401
from testbench.golden.stimulus.edges_rate_output import edges_rate_output  # noqa: F401
from testbench.golden.stimulus.writer import around, wrap_to_format

ALTERNATE = int("01" * 24, 2)
EDGE_WORDS = 4000  # words that are tried for an edge of the notch


def _inverse(odd, n):
    return pow(odd, -1, 1 << n)


def edges_dds(w):
    """Every sum at all ones, just over and at 0: with the phase at 0, at all ones and in between."""
    top = dds.PHASE.for_design(w.block.record).hi
    offsets = [port.name for port in w.wide if port.name != "word"]
    for phase in (0, 1, top, top - 1, (top + 1) >> 1, top >> 1):
        for total in (top - 1, top, top + 1, top + 2):
            w.append_row(rst=1)
            w.append_row({"word": phase})
            w.append_row(dict.fromkeys(offsets, (total - phase) % (top + 1)))
            w.append_row({"word": (total - phase) % (top + 1)}, times=2)
    _edges_phase(w)


def edges_sine(w):
    """The edges of the phase, places for each edge of the rounding in all quadrants, then every word of the table."""
    _edges_phase(w)
    d = w.block.record
    base, slope = np.array(sine.tables(d), np.int64)
    middle = 2 * np.arange(1 << d.sine_fraction_bits) + 1
    total = (base[:, None] << d.sine_fraction_bits) + slope[:, None] * middle
    cut, index_bits = sine.PRODUCT.for_design(d).f, d.sine_address_bits + d.sine_fraction_bits
    low, odd, half = total & ((1 << cut) - 1), (total >> cut) & 1, 1 << (cut - 1)
    indices = [np.flatnonzero(low == bits)[:2] for bits in (0, 1, half - 1, half + 1, 2 * half - 1)]
    indices += [np.flatnonzero((low == half) & (odd == parity)) for parity in (0, 1)]
    for index in np.concatenate(indices).tolist():
        for quadrant in range(4):
            mirrored = index if quadrant % 2 == 0 else ~index & ((1 << index_bits) - 1)
            w.append_row({"phase": ((quadrant << index_bits) | mirrored) << (d.dds_bits - 2 - index_bits)})
    for word in range(1 << d.sine_address_bits):
        w.append_row({"phase": word << (d.dds_bits - 2 - d.sine_address_bits)})
    w.append_row(times=3)


def _edges_phase(w):
    """The quadrant edges and the edges of what is cut below them, +-1 LSB, in every phase input."""
    values, d = [], w.block.record
    turn, quarter = 1 << d.dds_bits, 1 << (d.dds_bits - 2)
    cell = quarter >> (d.sine_address_bits + d.sine_fraction_bits)
    row = cell << d.sine_fraction_bits
    for quadrant in range(4):
        for offset in (0, 1, cell >> 1, cell - 1, cell, row - 1, row):
            values += [(quadrant * quarter + offset) % turn, (quadrant * quarter - offset) % turn]
    for value in values:
        w.operation({port.name: value for port in w.wide})


def edges_modulator(w):
    """Products whose dropped bits are 0, 1, a half +-1, all ones; and codes at both limits +-1 LSB."""
    p, carrier = w.block.cases[w.case], modulator.SINE.for_design(w.block.record)
    both, full = {"en_product": 1, "en_code": 1}, carrier.hi
    for low in (0, 1, (1 << (p.shift - 1)) - 1, 1 << (p.shift - 1), (1 << (p.shift - 1)) + 1, (1 << p.shift) - 1):
        for factor in (1, 3, full >> 1, full, -1, -(full >> 1) - 2, -full):
            solved = low * _inverse(factor, p.shift) % (1 << min(p.shift, 24))
            for lift in (0, 1 << 23):
                w.append_row({**both, "amplitude": wrap_to_format(solved + lift, modulator.AMPLITUDE), "sine": factor})
    for limit in (p.lo, p.hi):
        for offset_lsb in range(-2, 3):
            for tie in (-1, 0, 1):
                target_product = ((limit + offset_lsb) << p.shift) + (1 << (p.shift - 1)) + tie
                for factor in (full, carrier.lo):
                    amplitude = target_product // factor
                    for step in (0, 1):
                        if modulator.AMPLITUDE.holds(amplitude + step):
                            w.append_row({**both, "amplitude": amplitude + step, "sine": factor})
    for limit in (p.lo, p.hi):
        for target in around(limit, modulator.CODE._replace(i=modulator.CODE.i + 1)):
            amplitude = (target << p.shift) // full
            if modulator.AMPLITUDE.holds(amplitude):
                w.append_row({**both, "amplitude": amplitude, "sine": full})
    w.append_row(times=3)


def edges_cordic(w):
    lo, hi = -(1 << 23), (1 << 23) - 1
    for x, y in itertools.product((lo, lo + 1, -1, 0, 1, hi), repeat=2):
        w.operation({"x_in": x, "y_in": y})
    # an LSB of phase at half a turn is y = 2.7 at x = lo
    half_turn = [(lo, y) for y in (1, -1, 2, -2, 3, -3, 4, -4)]
    for x, y in ((1000, 1000), (-1000, 1000), (3, 4), (hi, 1), *half_turn):
        w.operation({"x_in": x, "y_in": y})


def edges_isqrt(w):
    for root in (1, 2, 3, 255, 256, 257, 4095, 46340, 65534, 65535):
        for u in (root * root - 1, root * root, root * root + 1):
            w.operation({"u": u})


def edges_registers(w):
    for address in [*range(len(registers.WRITABLE) + 2), registers.FIRST_READ_ONLY, 255]:
        target_register = registers.BY_ADDRESS.get(address)
        top = target_register.fmt.for_design(w.block.record).hi if target_register else 0
        for data in (0, 1, top, min(top + 1, registers.DATA.hi), registers.DATA.hi, 1 << 47, ALTERNATE, ALTERNATE << 1):
            w.append_row({"write": 1, "address": address, "data": data})
            w.append_row({"address": address, "data": data ^ registers.DATA.hi})
    for write, acknowledge in itertools.product((0, 1), repeat=2):
        w.append_row({"write": 1, "address": 1, "data": 0xA5})
        w.append_row({"write": write, "address": 1, "data": 0x5A, "taken": acknowledge})
        w.append_row(times=1)
    for register in registers.WRITABLE:
        w.append_row({"write": 1, "address": register.address, "data": registers.DATA.hi})
    w.append_row(rst=1)


def edges_spi_dac(w):
    """Frames as the modulator makes them: header and code in both formats, and the control word."""
    p = w.block.cases[w.case]
    make = getattr(spi_dac.frame, "py_func", spi_dac.frame)
    for code in (0, 1, -1, p.data_mask >> 1, -(p.data_mask >> 1) - 1, p.data_mask):
        w.operation({"word": make(p, code, 0)})
    w.operation({"word": make(p, 0, 1)})


def edges_notch(w):
    """Words after a reset: the last makes the sum what it shall be, the one before is searched until it can."""
    p, fraction_bits = w.block.cases[w.case], notch.COEF_BITS
    step, half = p.g << notch.SHIFT, 1 << (fraction_bits - 1)

    def compute_feedback_sum(*words):
        """What the sum holds beside the next word."""
        x1 = x2 = y1 = y2 = feedback_sum = 0
        for x in words:
            y = min(max((step * x + feedback_sum + half) >> fraction_bits, notch.Y_LO), notch.Y_HI)
            x1, x2, y1, y2 = x, x1, y, y1
            feedback_sum = step * x2 + p.c * ((x1 << notch.SHIFT) - y1) - (2 * p.g - notch.ONE) * y2
        return feedback_sum

    def append_words(*words):
        w.append_row(rst=1)
        for x in words:
            w.append_row({"en": 1, "x": x})
        w.append_row(times=2)

    # an LSB of the last word adds `step`: sums modulo twice what is dropped repeat after `period` words
    turns = math.gcd(step, 2 << fraction_bits)
    period = (2 << fraction_bits) // turns
    inverse = _inverse(step // turns, period.bit_length() - 1)
    for low, odd, sign in itertools.product((0, 1, half - 1, half, half + 1, 2 * half - 1), (0, 1), (1, -1)):
        for first in range(0, 4 * EDGE_WORDS, 3):
            missing = (odd << fraction_bits) + low - compute_feedback_sum(first)
            if missing % turns == 0:
                append_words(first, missing // turns * inverse % period + sign * (1 << 22) // period * period)
                break
    top = notch.WORD.hi
    ways = [(end, *before) for end in (1, -1) for before in ((), (top,), (-top,))]
    for edge, offset_lsb, (end, *before) in itertools.product((notch.Y_LO, notch.Y_HI), (-1, 0, 1), ways):
        for word in range(end * top, end * (top - EDGE_WORDS), -end):
            feedback_sum = compute_feedback_sum(*before, word)
            last = ((edge + offset_lsb) * (1 << fraction_bits) - feedback_sum) // step
            if not notch.WORD.holds(last):
                break
            if (step * last + feedback_sum + half) >> fraction_bits == edge + offset_lsb:
                append_words(*before, word, last)
                break


edges_references = _edges_phase
edges_agc = edges_frequency_tracker = edges_rate_loop = edges_quadrature_loop = edges_loop
