"""Rate output: bias and scale with temperature polynomials, then a boxcar mean over 2**k frames.

    t = temperature >> 8      t2 = round(t*t / 2**15)
    bias      = b0 + b1*t + b2*t2            scale = round(s0 + s1*t + s2*t2)
    corrected = clamp(round(word - bias))    scaled = clamp(round(corrected*scale))
    y         = round(mean of 2**k values of scaled),  k = decimation (7 counts as 6), taken over when a mean starts

    temperature --[t]--[t2]--(polynomials)--[bias]    [scale]              [..] register
    word -------[word]-----------------------(-)--[corrected]--(x)--[scaled]--(+)--[acc]--[y]

Formats   word [1,23,0]   temperature [1,23,0]   t [1,15,0]   t2 [0,16,0]   b0 [1,23,8]   b1, b2 [1,7,24]
          s0, scale [1,1,28]   s1, s2 [1,-17,40]   bias [1,25,24]   corrected [1,23,8]   scaled, y [1,11,20] deg/s
          acc [1,17,20]   decimation, k [0,3,0]   count [0,6,0]   stage [0,5,0]   valid [0,1,0]
Latency   6 clocks from the last en of a mean to valid; valid lasts one clock, y stays
Rounding  ties toward +inf in t2, scale, corrected, scaled and y; t is cut
Overflow  corrected, scale and scaled saturate; bias, acc and y cannot overflow
Cost      285 register bits, 7 products, the largest 32 x 30 bits; they may share a multiplier

The polynomials are around t = 0, whatever temperature that is; `design` makes register values of a calibration. s0 is
2**12 / 8651 at reset, so y is in deg/s: +-2048 with an LSB of 0.0034 deg/h. Below 2048 word LSB per deg/s no s0 gives
deg/s: it is then 0 and y reads 0. One `en` in any six clocks: a sample uses the registers for that long.
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import Fmt, add_fmt, bits, clamp, formats, half_up, mul_fmt, quantize, signed_bits, sub_fmt
from fpga_model.jit import inlined

CODE = signed_bits(24)
CODE_CUT = 8
T = signed_bits(CODE.width - CODE_CUT)
T2_CUT = 15
T2 = bits(16)
BIAS_0 = Fmt(1, 23, 8)
BIAS_T = Fmt(1, 7, 24)
BIAS = Fmt(1, 25, 24)
CORRECTED = Fmt(1, 23, 8)
SCALE = Fmt(1, 1, 28)
SCALE_T = Fmt(1, -17, 40)
SCALE_SUM = Fmt(1, 3, 40)
OUT = Fmt(1, 11, 20)
MAX_K = 6
ACC = Fmt(1, OUT.i + MAX_K, OUT.f)
SCALED_CUT = SCALE.f
# below it (word LSB per deg/s) no scale gives deg/s
LEAST_WORD_PER_DEG_S = 2.0 ** (OUT.f - CORRECTED.f) / (SCALE.hi * 2.0**-SCALE.f)
STAGES = (1 << 5) - 1
SCALE_LO, SCALE_HI = SCALE.lo, SCALE.hi
CORRECTED_LO, CORRECTED_HI = CORRECTED.lo, CORRECTED.hi
OUT_LO, OUT_HI = OUT.lo, OUT.hi
LATENCY = 6

assert half_up(T.lo * T.lo, T2_CUT) <= T2.hi, "the square must fit its register"
assert add_fmt(add_fmt(mul_fmt(BIAS_T, T), mul_fmt(BIAS_T, T2)), BIAS_0) == BIAS, "bias holds its sum exactly"
assert add_fmt(add_fmt(mul_fmt(SCALE_T, T), mul_fmt(SCALE_T, T2)), SCALE) == Fmt(1, 2, 40), "and so does the scale"
assert SCALE_SUM.width + 1 <= 63, "the scale sum and its rounding must fit int64"
assert sub_fmt(BIAS, CODE).width + 1 <= 63, "the difference and its rounding must fit int64"
assert mul_fmt(CORRECTED, SCALE).width + 1 <= 63, "the product and its rounding must fit int64"
assert ACC.width + 1 <= 63, "the boxcar sum and its rounding must fit int64"


class Params(NamedTuple):
    """What the register bank holds for this block; build with `design`."""

    bias: BIAS_0
    bias_t1: BIAS_T
    bias_t2: BIAS_T
    scale: SCALE
    scale_t1: SCALE_T
    scale_t2: SCALE_T
    decimation: bits(3)


class State(NamedTuple):
    """The registers."""

    stage: bits(5) = 0
    word: CODE = 0
    t: T = 0
    t2: T2 = 0
    bias: BIAS = 0
    scale: SCALE = 0
    corrected: CORRECTED = 0
    scaled: OUT = 0
    acc: ACC = 0
    count: bits(MAX_K) = 0
    k: bits(3) = 0
    y: OUT = 0
    valid: bits(1) = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(
    word_per_deg_s=8651.0,
    bias_deg_s=0.0,
    bias_t1=0.0,
    bias_t2=0.0,
    scale_t1=0.0,
    scale_t2=0.0,
    decimation=3,
):
    """Register values from a calibration; the default gives 2**-20 deg/s per LSB at 1 kHz, uncorrected.

    word_per_deg_s      scale factor at t = 0 (word LSB per deg/s)
    bias_deg_s          bias at t = 0 (deg/s)
    bias_t1, bias_t2    bias polynomial (word LSB per t, word LSB per t2)
    scale_t1, scale_t2  relative change of the output scale (1 per t, 1 per t2)
    decimation          k; the mean is over 2**k frames of 8 kHz
    """
    if decimation not in range(MAX_K + 1):
        raise ValueError(f"decimation: {decimation} is outside 0 .. {MAX_K}")
    if not word_per_deg_s:
        raise ValueError("word_per_deg_s: 0 LSB per deg/s has no inverse")
    scale = 2.0 ** (OUT.f - CORRECTED.f) / word_per_deg_s
    values = Params(
        bias=bias_deg_s * word_per_deg_s,
        bias_t1=bias_t1,
        bias_t2=bias_t2,
        scale=scale,
        scale_t1=scale * scale_t1,
        scale_t2=scale * scale_t2,
        decimation=decimation,
    )
    return Params(*map(quantize, values, PARAMS_FMT, Params._fields))


@inlined
def step(p, s, en, word, temperature):
    """One clock edge; `stage` walks one bit per clock behind `en`."""
    bias = s.bias
    scale = s.scale
    corrected = s.corrected
    scaled = s.scaled
    acc, count, k, y, valid = s.acc, s.count, s.k, s.y, 0
    if s.stage & 2:
        bias = (p.bias << (BIAS.f - BIAS_0.f)) + p.bias_t1 * s.t + p.bias_t2 * s.t2
        scale_sum = (p.scale << (SCALE_SUM.f - SCALE.f)) + p.scale_t1 * s.t + p.scale_t2 * s.t2
        scale = clamp(half_up(scale_sum, SCALE_SUM.f - SCALE.f), SCALE_LO, SCALE_HI)
    if s.stage & 4:
        corrected = clamp(half_up((s.word << BIAS.f) - s.bias, BIAS.f - CORRECTED.f), CORRECTED_LO, CORRECTED_HI)
    if s.stage & 8:
        scaled = clamp(half_up(s.corrected * s.scale, SCALED_CUT), OUT_LO, OUT_HI)
    if s.stage & 16:
        k = clamp(p.decimation, 0, MAX_K) if s.count == 0 else s.k
        acc = (0 if s.count == 0 else s.acc) + s.scaled
        count = s.count + 1
        if count == 1 << k:
            y = half_up(acc, k)
            count = 0
            valid = 1
    return State(
        stage=((s.stage << 1) | (1 if en else 0)) & STAGES,
        word=word if en else s.word,
        t=temperature >> CODE_CUT if en else s.t,
        t2=half_up(s.t * s.t, T2_CUT) if s.stage & 1 else s.t2,
        bias=bias,
        scale=scale,
        corrected=corrected,
        scaled=scaled,
        acc=acc,
        count=count,
        k=k,
        y=y,
        valid=valid,
    )


BLOCK = Block(
    place=190,
    inputs={"en": BIT, "word": CODE, "temperature": CODE},
    latency={"y": LATENCY, "valid": LATENCY},
    cases={"default": None},
    rules={
        "t": ("floor", None),
        "t2": ("half_up", None),
        "scale": ("half_up", "saturate"),
        "corrected": ("half_up", "saturate"),
        "scaled": ("half_up", "saturate"),
        "y": ("half_up", None),
    },
    strobes=("en",),
    wait=LATENCY,
    dense=False,
    runtime_params=True,
    split=("k", "count?"),
    relations=({"acc": 1, "count": -OUT.hi}, {"acc": 1, "count": -OUT.lo}),
    stops=tuple(1 << k for k in range(MAX_K + 1)),
)
