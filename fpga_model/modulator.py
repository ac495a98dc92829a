"""Amplitude times sine to a DAC code, rounded and saturated, with up to two frames of delay.

    product[n+1] = amplitude[n] * sine[n]                     at en_product, else held
    code[n+1]    = clamp(round(product[n] / 2**shift))        at en_code, else held
    held1[n+1]   = code[n],   held2[n+1] = held1[n]           at en_code, else held
    out          = code, held1 or held2 for frames = 0, 1, 2

    amplitude --(x)--[product]--(round, clamp)--[code]--[held1]--[held2]
    sine -------^                                  '-------'--------'--(frames)-- out

Formats   amplitude [1,0,23]   sine [1,0,17]   product [1,1,40]   codes, lo, hi [1,19,0]   shift [0,6,0]
Latency   2 clocks from amplitude and sine to code when en_code follows en_product; frames more enables to out
Rounding  ties toward +inf at code; product is exact
Overflow  code saturates at lo and hi; product cannot overflow
Cost      102 register bits, one 24 x 18 bit product

A code of n bits has full scale 2**(n-1), so shift = 40 - (n-1): 25 for 16 bits, 21 for 20 bits. The amplitude has 24
bits: at lock the drive has 335 codes, so a step of a code would be 0.3 %; here it is 1/256 code, dithered by the sine.
"""

from typing import NamedTuple

from fpga_model import sine as table
from fpga_model.block import BIT, Block
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, bits, clamp, formats, half_up, mul_fmt, quantize, signed_bits
from fpga_model.jit import inlined

AMPLITUDE = Fmt(1, 0, 23)
SINE = table.OUT
PRODUCT = mul_fmt(AMPLITUDE, SINE)
MAX_CODE_BITS = 20
CODE = signed_bits(MAX_CODE_BITS)
LATENCY = 2
assert PRODUCT.width + 1 <= 63, "the product and its rounding constant must fit int64"


class Params(NamedTuple):
    """Machine units; build with `design`."""

    shift: bits(6)
    lo: CODE
    hi: CODE
    frames: bits(2)


class State(NamedTuple):
    """The registers."""

    product: PRODUCT = 0
    code: CODE = 0
    held1: CODE = 0
    held2: CODE = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(code_bits, frames=0, d=DEFAULT):
    """Modulator for a DAC of `code_bits` (2 .. 20 bits) with `frames` (0 .. 2 conversion periods) of extra delay.

    d  the design, whose sine it multiplies
    """
    if code_bits not in range(2, MAX_CODE_BITS + 1):
        raise ValueError(f"code_bits: {code_bits} is not from 2 to {MAX_CODE_BITS} bits")
    if frames not in (0, 1, 2):
        raise ValueError(f"frames: {frames} is not 0, 1 or 2 conversion periods")
    code = signed_bits(code_bits)
    return Params(
        shift=quantize(PRODUCT.for_design(d).f - (code_bits - 1), PARAMS_FMT.shift, "shift (bits)"),
        lo=code.lo,
        hi=code.hi,
        frames=int(frames),
    )


@inlined
def step(p, s, en_product, en_code, amplitude, sine):
    """One clock edge."""
    product, code, held1, held2 = s.product, s.code, s.held1, s.held2
    if en_product == 1:
        product = amplitude * sine
    if en_code == 1:
        code = clamp(half_up(s.product, p.shift), p.lo, p.hi)
        held1 = s.code
        held2 = s.held1
    return State(product=product, code=code, held1=held1, held2=held2)


@inlined
def out(p, s):
    """The code that the next frame takes."""
    code = s.code
    if p.frames == 1:
        code = s.held1
    elif p.frames == 2:
        code = s.held2
    return code


@inlined
def dac_code(p, amplitude, sine):
    """Code of an amplitude and a sine: what the two enables of one conversion period make of them."""
    return clamp(half_up(amplitude * sine, p.shift), p.lo, p.hi)


BLOCK = Block(
    place=50,
    inputs={"en_product": BIT, "en_code": BIT, "amplitude": AMPLITUDE, "sine": SINE},
    outputs={"out": CODE},
    latency={"product": 1, "code": LATENCY},
    cases=lambda d: {
        "dac16": design(16, d=d),
        "dac20": design(20, d=d),
        "dac16_frames1": design(16, 1, d),
        "dac20_frames2": design(20, 2, d),
        "dac2": design(2, d=d),
        # the negative limit of a real DAC is out of reach of the product: this one is not
        "narrow": design(16, d=d)._replace(lo=-20001, hi=19998),
    },
    rules={"code": ("half_up", "saturate")},
    strobes=("en_product", "en_code"),
)
