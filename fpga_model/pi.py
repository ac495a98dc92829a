"""PI controller with a clamped integrator, shared by the four loops; raw LSB in, raw LSB out.

    en = 1, by mode   OFF     prop = 0,             acc = clamp(preset)
                      P_ONLY  prop = round(kp*e),   acc held
                      RUN     prop = round(kp*e),   acc = clamp(acc + round(ki*e))
                      HOLD    prop and acc held (so does any other mode, and en = 0)
    every edge        y = clamp(round(prop + acc))

    e --+--(x kp)--(round)----------[prop]--(+)--(round, clamp)--[y]-->     [..] register
        |                                    |
        +--(x ki)--(round)--(+)--(clamp)---[acc]
                             ^---------------'

Formats   e [1,25,0]   kp, ki [1,9,24]   prop, acc [1,35,24]   lo, hi, preset, y [1,35,0]
Latency   2 clocks from an enabled e to y, one result per enable
Rounding  ties toward +inf; products are exact where prop and acc have 24 fraction bits: `accumulator_fraction_bits`
Overflow  acc and y saturate at lo and hi; prop cannot overflow
Cost      156 register bits, 2 less for each fraction bit less; two products of 26 x 34 bits

Modes are 0 .. 3 in this order. P_ONLY captures without wind-up. No mode change makes acc jump but OFF, whose preset is
the hand-over value. acc stops at the limit itself, so the first error of the other sign moves it back.

There is no dead zone: an error of one LSB moves acc at every enable, by ki where products are exact, and y then within
2**24 / abs(ki) enables (ki raw). `design` refuses a gain that rounds to zero.

With F < 24 fraction bits in acc, an error of 1 LSB moves it by 2/3 to 2 times ki*e. ki at or below half an LSB is
refused: the dead zone would make a limit cycle. `round_gains` rounds kp and ki alone (`coefficient_fraction_bits`).
"""

from fractions import Fraction
from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.design_record import width
from fpga_model.fixed import Fmt, add_fmt, bits, clamp, formats, half_up, mul_fmt, quantize
from fpga_model.jit import inlined

ERR = Fmt(1, 25, 0)
COEF = Fmt(1, 9, 24)
PRODUCT = mul_fmt(ERR, COEF)
PRODUCT_FRACTION = PRODUCT.f
ACC = Fmt(1, PRODUCT.i, width("accumulator_fraction_bits"))
OUT = Fmt(1, ACC.i, 0)
SHIFT = ACC.f - OUT.f
LATENCY = 2
OFF, P_ONLY, RUN, HOLD = 0, 1, 2, 3
LARGEST_SHARE = Fraction(1, 20)  # of a gain, by which fewer fraction bits may move it
assert add_fmt(PRODUCT, PRODUCT).width + 1 <= 63, "prop + acc and its rounding constant must fit int64"


class Params(NamedTuple):
    """Machine units; build with `design`."""

    kp: COEF
    ki: COEF
    lo: OUT
    hi: OUT


class State(NamedTuple):
    """The registers."""

    prop: ACC = 0
    acc: ACC = 0
    y: OUT = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def design(kp, ki_per_s, frame_hz, lo, hi):
    """Quantise physical gains; raises ValueError if one does not fit, or is so small that it would become zero.

    kp        proportional gain (output LSB per error LSB)
    ki_per_s  integral gain (output LSB per error LSB and second)
    frame_hz  rate of the enables (Hz)
    lo, hi    output limits (output LSB)
    """
    if not frame_hz > 0:
        raise ValueError(f"frame_hz: {frame_hz} Hz is not a positive rate")
    p = Params(
        kp=quantize(kp, COEF, "kp (LSB per LSB)"),
        ki=quantize(ki_per_s / frame_hz, COEF, "ki_per_s / frame_hz (LSB per LSB and frame)"),
        lo=quantize(lo, OUT, "lo (LSB)"),
        hi=quantize(hi, OUT, "hi (LSB)"),
    )
    if p.lo > p.hi:
        raise ValueError(f"lo: {lo} LSB is above hi, {hi} LSB")
    if kp and not p.kp:
        raise ValueError(f"kp: {kp:g} LSB per LSB rounds to zero; the smallest gain is {2.0**-COEF.f:g}")
    if ki_per_s and not p.ki:
        smallest = frame_hz * 2.0**-COEF.f
        raise ValueError(f"ki_per_s: {ki_per_s:g} LSB per LSB and second rounds to zero; the smallest is {smallest:g}")
    return p


def round_gains(p, fraction_bits):
    """The same `Params` with kp and ki rounded to `fraction_bits`, ties to even: what a narrower multiplier holds.

    They stay in their format, so that prop and acc end in COEF.f - fraction_bits zeros. Raises ValueError if a gain
    moves by more than LARGEST_SHARE of itself.
    """
    unit = 1 << (COEF.f - fraction_bits)
    gains = {name: round(Fraction(getattr(p, name), unit)) * unit for name in ("kp", "ki")}
    for name, gain in gains.items():
        exact = getattr(p, name)
        if abs(gain - exact) > LARGEST_SHARE * abs(exact):
            off = 100 * abs(gain / exact - 1)
            raise ValueError(
                f"{name} = {exact / 2**COEF.f:.4g} is {off:.3g} % off in {fraction_bits} fraction bits; the limit is "
                f"{float(100 * LARGEST_SHARE):g} %"
            )
    return p._replace(**gains)


def check_accumulator(p, fraction_bits):
    """Raise ValueError if ki times an error of one LSB, of either sign, rounds to nothing in `fraction_bits`."""
    half = Fraction(1, 2 << fraction_bits)
    ki = Fraction(p.ki, 1 << COEF.f)
    if ki and abs(ki) <= half:
        raise ValueError(
            f"ki = {float(ki):.4g} rounds an error of 1 LSB to zero in {fraction_bits} fraction bits; ki must be above "
            f"{float(half):.4g}, half an LSB"
        )


@inlined
def step(d, p, s, en, mode, e, preset):
    """One clock edge."""
    prop, acc = s.prop, s.acc
    fraction_bits = d.accumulator_fraction_bits
    dropped = PRODUCT_FRACTION - fraction_bits
    if en:
        if mode == OFF:
            prop = 0
            acc = clamp(preset, p.lo, p.hi) << fraction_bits
        elif mode == P_ONLY:
            prop = half_up(p.kp * e, dropped)
        elif mode == RUN:
            prop = half_up(p.kp * e, dropped)
            acc = clamp(s.acc + half_up(p.ki * e, dropped), p.lo << fraction_bits, p.hi << fraction_bits)
    return State(prop=prop, acc=acc, y=clamp(half_up(s.prop + s.acc, fraction_bits), p.lo, p.hi))


MODE = bits(2)

BLOCK = Block(
    place=60,
    inputs={"en": BIT, "mode": MODE, "e": ERR, "preset": OUT},
    latency={"prop": 1, "acc": 1, "y": LATENCY},
    cases={
        # the defaults of rate_loop and frequency_tracker, which are built from this block
        "rate": Params(kp=14937228, ki=1173167, lo=-8388607, hi=8388607),
        "frequency": Params(kp=204064551, ki=96163, lo=-1082596064, hi=1082596064),
        "odd": Params(kp=-((1 << 24) + 12345), ki=(1 << 22) + 77777, lo=-1000, hi=999),
        "extreme": Params(kp=COEF.lo, ki=COEF.hi, lo=OUT.lo, hi=OUT.hi),
    },
    rules={"prop": ("half_up", None), "acc": ("half_up", "saturate"), "y": ("half_up", "saturate")},
    strobes=("en",),
)
