"""Force-to-rebalance loop: a PI nulls the Coriolis component of y; its output word is the measured rate.

    en      error' = sense_sin
    en_pi   the PI of pi.py acts on error, in its mode; OFF gives the fixed word, preset

    sense_sin --[error]--(pi)--[loop.y]-->     [..] register

Formats   sense_sin, error [1,23,0]   preset, loop.y [1,0,23] of 10 V
Latency   3 clocks from en to loop.y when en_pi follows en by one clock
Rounding  as pi.py
Overflow  loop.y saturates at +-limit, never at the minimum of its format
Cost      180 register bits, the multipliers of pi.py

With the Coriolis force along sgn(sin), a positive rate makes sense_sin positive, so the gains are positive. The zero
at 100 Hz keeps the lead small: at the split of 139 Hz the resonance of y needs the lag of the three 50 Hz poles. The
limit is 970 deg/s; the minimum is left out, so that both saturation rates are equal.
"""

from math import pi as PI
from typing import NamedTuple

from fpga_model import pi
from fpga_model.block import BIT, Block
from fpga_model.fixed import Fmt, formats, signed_bits
from fpga_model.jit import inlined
from fpga_model.rates import FRAME_HZ

CODE = signed_bits(24)
WORD = Fmt(1, 0, 23)
LATENCY = 3
assert CODE.width <= pi.ERR.width, "a code must fit the input of the PI"


class Params(NamedTuple):
    """Machine units; build with `design`."""

    loop: pi.Params


class State(NamedTuple):
    """The registers."""

    error: CODE = 0
    loop: pi.State = pi.State()


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(
    crossover_hz=15.0,
    zero_hz=100.0,
    code_v_per_deg_s=57.9e-6,
    adc_full_scale_v=4.0 / 12,
    word_v_per_deg_s=10.31e-3,
    dac_full_scale_v=10.0,
    limit=1.0,
    frame_hz=FRAME_HZ,
):
    """Gains from the two scale factors of y: what one deg/s of residual gives, and what one deg/s of force costs.

    crossover_hz      crossover of the integrator alone (Hz)
    zero_hz           PI zero (Hz)
    code_v_per_deg_s  SID output per residual rate (V/(deg/s))
    adc_full_scale_v  ADC full scale at the PGA gain of this channel (V)
    word_v_per_deg_s  force voltage per rate (V/(deg/s))
    dac_full_scale_v  voltage that full scale of the word stands for (V)
    limit             largest word (full scales)
    frame_hz          rate of the enables (Hz)
    """
    if not 0 < limit <= 1:
        raise ValueError(f"limit: {limit} is outside 0 .. 1 full scale")
    word_per_code = (word_v_per_deg_s / dac_full_scale_v) / (code_v_per_deg_s / adc_full_scale_v)
    ki_per_s = 2 * PI * crossover_hz * word_per_code
    top = min(round(limit * 2**23), WORD.hi)
    return Params(loop=pi.design(ki_per_s / (2 * PI * zero_hz), ki_per_s, frame_hz, -top, top))


@inlined
def step(d, p, s, en, en_pi, mode, sense_sin, preset):
    """One clock edge."""
    return State(
        error=sense_sin if en else s.error,
        loop=pi.step(d, p.loop, s.loop, en_pi, mode, s.error, preset),
    )


@inlined
def saturated(p, s):
    """1 when the word is at one of its limits."""
    return 1 if s.loop.y >= p.loop.hi or s.loop.y <= p.loop.lo else 0


BLOCK = Block(
    place=140,
    inputs={"en": BIT, "en_pi": BIT, "mode": pi.MODE, "sense_sin": CODE, "preset": WORD},
    outputs={"saturated": BIT},
    holds={"loop.y": WORD},
    latency={"error": 1, "loop_y": LATENCY},
    strobes=("en", "en_pi"),
)
