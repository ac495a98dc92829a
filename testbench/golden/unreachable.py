"""Goals that no stimulus can meet, each with the reason: dead by arithmetic, or by the parameters of a case.

    fixed places    read parameters and constants alone: one outcome in a case
    place claims    a pattern of the place, outcomes, and an argument in words; some depend on the parameters
    bounds          intervals of registers; a bit that is the same all over its interval cannot toggle
    multiples       registers that are always multiples of a power of two; the bits below cannot toggle

A claim is an argument, not an observation: tests try to break each with random rows, and no vector may contradict it.
Source  docs/golden.md
"""

import ast
import functools
import re
from typing import NamedTuple

import numpy as np

from fpga_model import digital_sid, fault_monitor, isqrt, lock_monitor, modulator, pi, rates, registers, sine, spi_adc
from testbench.golden import blocks, coverage
from testbench.golden.edges_pi import ONE, even_part


class Claim(NamedTuple):
    """`place` is searched in the name of a place; `holds` takes (block, case) and is None when it always does."""

    stem: str
    place: str
    outcomes: tuple
    reason: str
    holds: object = None


BEYOND = ("-1", "0", "+1")
COUNTS = "the operand is a count plus 1, so at least 1"
RISING = "a count rises by one and starts again at its limit, so it never passes it"
UNSIGNED = "the operand is unsigned"

CLAIMS = (
    Claim("dds", r"wrap_unsigned", ("under",), UNSIGNED),
    Claim("isqrt|quadrature_loop", r"wrap_unsigned\(s\.radicand << 2", ("under", "hi"), f"{UNSIGNED}, its low bits 0"),
    Claim("isqrt|quadrature_loop", r"wrap_unsigned\(s\.i \+ 1", ("under", "lo"), COUNTS),
    Claim("registers", r"wrap_unsigned\(data", ("under",), UNSIGNED),
    Claim("registers", r"wrap\(data", ("under", "lo"), UNSIGNED),
    Claim("spi_adc", r"wrap\(shift", ("under", "lo"), UNSIGNED),
    Claim("watchdog", r"clamp\(s\.age \+ 1", ("lo-1", "lo"), COUNTS),
    Claim("rate_output", r"clamp\(p\.decimation", ("lo-1",), UNSIGNED),
    Claim("cordic", r"s\.i < ITERATIONS", ("+1",), "i stops at ITERATIONS"),
    Claim("cordic", r"half_up\(s\.x, ", ("tie-even", "tie-odd"), "x is never negative"),
    Claim("lock_monitor|sequencer", r"_judge(#\d)?: count >= ", ("+1",), RISING),
    Claim(
        "lock_monitor|sequencer", r"_judge(#\d)?: pending #2", ("no",), "a count is at its limit only while pending"
    ),
    Claim("fault_monitor|sequencer", r"clamp\((count|s\.\w+_frames) \+ 1", ("lo-1", "lo"), COUNTS),
    Claim("fault_monitor|sequencer", r"_count(#\d)?: clamp\(count", ("lo+1",), "the limit is 0, which is hi as well",
          lambda block, case: False),
    Claim("sequencer", r"clamp\(s\.timer \+ 1", ("lo-1", "lo"), COUNTS),
    Claim("sequencer", r"clamp\(s\.attempts \+ failed", ("lo-1",), UNSIGNED),
    Claim("sequencer", r"_following: frames (<|>=) p\.", ("+1",), "the timer starts again at the limit of its state"),
    Claim("sequencer", r"_following: usable #3", ("no",), "the line is in a branch where usable is true"),
    Claim("sequencer", r"fault_monitor\.step: en$", ("no",), "the sequencer passes 1"),
)  # fmt: skip
