"""Static side of a DAC: code to volts, and the glitch that a step of the code throws.

    volts(code)  = offset + lsb * code + bow * (1 - (code / full)^2) * full_volts      full = 2^(bits-1)
    glitch(a, b) = area * (number of segment borders between a and b, signed)         borders every 2^segment_bits codes

The hold is the constant input of a plant tick, the instant comes from `dac_serial`. The settling poles are the output
chain of the propagator. Off: zero `bow` and `area`, bit for bit nothing.

Span     -10 .. +10 V; LSB 305.2 uV (drive, 16 bits) and 19.07 uV (sense, 20 bits). V_q is DC, code times 5.5 V/2^16
Bow      a parabola, zero at both ends of the range: second harmonic and offset
Glitch   an area at the step's instant: in a small sine at code 0
Refused  bits outside 8 .. 24, a span outside 0 .. 20 V, a bow above 1 % of full scale
Missing  slew (analog_frontend/amplifier_use.py), settling that depends on the code; other INL: dac_levels.py
Source   docs/plant.md
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from fpga_model.jit import inlined


class Params(NamedTuple):
    """Volts per code, offset (V), bow (fraction of full scale), glitch area per segment border (V s)."""

    lsb_v: float
    offset_v: float
    bow: float
    full_code: float
    glitch_v_s: float
    segment_bits: int


def design(bits, span_v, offset_v=0.0, bow=0.0, glitch_v_s=0.0, segment_bits=14):
    """Transfer of a bipolar DAC of `bits` bits and -span_v .. +span_v (V); raises ValueError out of range."""
    if not 8 <= bits <= 24:
        raise ValueError(f"dac bits: {bits} is outside 8 .. 24 bit")
    if not 0.0 < span_v <= 20.0:
        raise ValueError(f"dac span_v: {span_v} is outside 0 .. 20 V")
    if not abs(bow) <= 0.01:
        raise ValueError(f"dac bow: {bow} is outside -0.01 .. 0.01 of full scale")
    full = float(1 << (bits - 1))
    return Params(span_v / full, offset_v, bow, full, glitch_v_s, segment_bits)


def end_share(instant_s, poles_s, tick_s):
    """Share e of a tick's end in the mean of an electrode's voltage: mean = (1 - e) v_start + e v_end.

        e = 1 + r - (t + sum of the poles) / T,   r = sum over j >= 0 of the part of a step left at T - t + j T

    of a staircase with its steps at the instant t of each tick T, behind poles; to first order in its slope.
    """
    rates = np.array([1.0 / pole for pole in poles_s])
    a = np.diag(-rates) + np.diag(rates[1:], -1)
    steady_states = np.linalg.solve(np.eye(len(rates)) - expm(a * tick_s), np.ones(len(rates)))
    step_residue = (expm(a * (tick_s - instant_s)) @ steady_states)[-1]
    return float(1.0 + step_residue - (instant_s + sum(poles_s)) / tick_s)


@inlined
def volts(p, code):
    """Output voltage (V) at rest."""
    linear = p.offset_v + p.lsb_v * code
    if p.bow == 0.0:
        return linear
    ratio = code / p.full_code
    return linear + p.bow * (1.0 - ratio * ratio) * p.lsb_v * p.full_code


@inlined
def glitch(p, old, new):
    """Area (V s) of the glitch of a step from code `old` to `new`."""
    if p.glitch_v_s == 0.0:
        return 0.0
    return p.glitch_v_s * ((new >> p.segment_bits) - (old >> p.segment_bits))
