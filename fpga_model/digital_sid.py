"""Synchronous integral demodulator in firmware: sign x sample, integrate and dump, then three one-pole low-passes.

    every ce_1m   acc'   = acc + x if the reference bit is 1 else acc - x        (refs as they were at the aperture)
    at dump       acc'   = +-x,  pole1' = pole1 + round(alpha*(acc - pole1))
    1 clock on    pole2' = pole2 + round(alpha*(pole1 - pole2))
    2 clocks on   pole3' = pole3 + round(alpha*(pole2 - pole3))
    3 clocks on   code'  = clamp(round(gain*pole3)),  valid' = 1,  ok' = 0 if still is at its limit, else 1
    every ce_1m   still' = min(still + 1, limit) if a sample is that of the tick before, else 0

    sample --(+-)--(+)--[acc]--[pole1]--[pole2]--[pole3]--(x gain)--[code]-->     [..] register, four of each
    refs --[refs]---^

Formats   samples [1,17,0] of 5 V   refs 4 bits   acc [1,24,0]   pole1..3 [1,24,16]   alpha [0,0,20]
          gain [0,4,17]   codes [1,23,0]   still, limit [0,12,0] ticks   valid, ok [0,1,0]
Latency   4 clocks from dump to valid; valid lasts one clock, the codes stay
Rounding  ties toward +inf in each pole and in the code; 16 fraction bits keep the dead zone below 0.01 code
Overflow  acc saturates (never with 125 samples); the poles cannot overflow; codes and still saturate
Cost      756 register bits; 12 + 4 products per frame on one 42 x 21 bit multiplier

Order of the four: drive sin, drive cos, sense sin, sense cos, as in the reference word. `dump` acts with ce_1m only.
Each pole takes the new value of the one before, so no frame of delay is added. The poles (50 Hz, alpha = 0.038508) are
not for noise: without their lag the rate loop is unstable at the split.

A sample arrives `ref_delay` ticks after its aperture and is weighed with the references of then. One count of 4000
ticks, 4 ms, watches both samples: a frozen one rests in every tick, noise lets one rest for few ticks in a row. A limit
of 0 switches the check off. The codes are filtered and cannot tell.
The gain makes a code mean what it means on the board with the analogue demodulator: volts * 4/pi * PGA / 4 V * 2**23.
"""

from decimal import Decimal
from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import Fmt, add_fmt, bits, clamp, formats, half_up, mul_fmt, quantize, signed_bits, sub_fmt
from fpga_model.jit import inlined
from fpga_model.rates import FRAME_HZ, FRAME_TICKS

SAMPLE = signed_bits(18)
ACC = signed_bits(25)
POLE = Fmt(1, 24, 16)
ALPHA = Fmt(0, 0, 20)
GAIN = Fmt(0, 4, 17)
CODE = signed_bits(24)
STILL = bits(12)
STILL_TICKS = 4000
MAX_DELAY = 4
LATENCY = 4
PI = Decimal("3.14159265358979323846264338327950288")
SHIFT = POLE.f + GAIN.f
ACC_LO, ACC_HI = ACC.lo, ACC.hi
CODE_LO, CODE_HI = CODE.lo, CODE.hi
assert add_fmt(mul_fmt(sub_fmt(POLE, POLE), ALPHA), bits(1)).width <= 63, "a pole's product and rounding must fit"
assert add_fmt(mul_fmt(POLE, GAIN), bits(1)).width <= 63, "the scaled output and its rounding must fit"


class Params(NamedTuple):
    """Machine units; build with `design`."""

    alpha: ALPHA
    gain_x: GAIN
    gain_y: GAIN
    ref_delay: bits(3)
    still: STILL


class State(NamedTuple):
    """The registers."""

    refs: [bits(4)] * 4 = (0, 0, 0, 0)
    acc: [ACC] * 4 = (0, 0, 0, 0)
    pole1: [POLE] * 4 = (0, 0, 0, 0)
    pole2: [POLE] * 4 = (0, 0, 0, 0)
    pole3: [POLE] * 4 = (0, 0, 0, 0)
    stage: bits(2) = 0
    codes: [CODE] * 4 = (0, 0, 0, 0)
    valid: bits(1) = 0
    last: [SAMPLE] * 2 = (0, 0)
    still: STILL = 0
    ok: bits(1) = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def alpha_of_hz(pole_hz, frame_hz):
    """1 - exp(-2 pi pole / frame), the exact image of a pole at `pole_hz`, in decimal arithmetic."""
    return 1 - (-2 * PI * Decimal(pole_hz) / Decimal(frame_hz)).exp()


def design(
    pole_hz=50.0,
    pga_x=1,
    pga_y=12,
    adc_full_scale_v=4.0,
    sample_full_scale_v=5.0,
    ref_delay_ticks=1,
    samples_per_dump=FRAME_TICKS,
    frame_hz=FRAME_HZ,
):
    """Pole and gains; the mean of sign x sine is 2/pi, so a factor 2 gives the 4/pi of the analogue board.

    `still` is STILL_TICKS; where the samples have too little noise, and may really rest, it must be 0.

    pole_hz              each of the three poles (Hz)
    pga_x, pga_y         PGA gains of the board whose codes these shall equal
    adc_full_scale_v     its ADC full scale at PGA 1 (V)
    sample_full_scale_v  full scale of the 18-bit samples (V)
    ref_delay_ticks      ticks of 1 us from the aperture to the arrival of a sample
    samples_per_dump     samples per frame
    frame_hz             rate of the dumps (Hz)
    """
    if not 0 < pole_hz < frame_hz / 4:
        raise ValueError(f"pole_hz: {pole_hz} Hz is outside 0 .. {frame_hz / 4} Hz")
    if not 1 <= samples_per_dump <= ACC.hi // -SAMPLE.lo:
        raise ValueError(f"samples_per_dump: {samples_per_dump} is outside 1 .. {ACC.hi // -SAMPLE.lo}")
    if ref_delay_ticks not in range(MAX_DELAY + 1):
        raise ValueError(f"ref_delay_ticks: {ref_delay_ticks} is outside 0 .. {MAX_DELAY} ticks")
    per_sum = 2 * (sample_full_scale_v / 2**17) / samples_per_dump * 2**23 / adc_full_scale_v
    return Params(
        alpha=quantize(alpha_of_hz(pole_hz, frame_hz), ALPHA, "alpha"),
        gain_x=quantize(per_sum * pga_x, GAIN, "gain_x (code per summed sample)"),
        gain_y=quantize(per_sum * pga_y, GAIN, "gain_y (code per summed sample)"),
        ref_delay=ref_delay_ticks,
        still=STILL_TICKS,
    )


@inlined
def _apply_reference_sign(refs, k, x):
    return x if (refs >> k) & 1 else -x


@inlined
def _sum(acc, x):
    return clamp(acc + x, ACC_LO, ACC_HI)


@inlined
def _pole(alpha, y, x):
    return y + half_up(alpha * (x - y), ALPHA.f)


@inlined
def _step_poles(alpha, y, x):
    return (
        _pole(alpha, y[0], x[0]),
        _pole(alpha, y[1], x[1]),
        _pole(alpha, y[2], x[2]),
        _pole(alpha, y[3], x[3]),
    )


@inlined
def _code(gain, y):
    return clamp(half_up(gain * y, SHIFT), CODE_LO, CODE_HI)


@inlined
def step(p, s, ce_1m, dump, refs, sample_x, sample_y):
    """One clock edge."""
    line, acc, pole1, pole2, pole3, codes = s.refs, s.acc, s.pole1, s.pole2, s.pole3, s.codes
    stage, valid, last, still, ok = 0, 0, s.last, s.still, s.ok
    if s.stage == 1:
        pole2 = _step_poles(p.alpha, s.pole2, s.pole1)
        stage = 2
    elif s.stage == 2:
        pole3 = _step_poles(p.alpha, s.pole3, s.pole2)
        stage = 3
    elif s.stage == 3:
        y = s.pole3
        codes = (_code(p.gain_x, y[0]), _code(p.gain_x, y[1]), _code(p.gain_y, y[2]), _code(p.gain_y, y[3]))
        valid = 1
        ok = 0 if p.still > 0 and s.still == p.still else 1
    if ce_1m:
        now = refs if p.ref_delay == 0 else s.refs[p.ref_delay - 1]
        last = (sample_x, sample_y)
        rests = sample_x == s.last[0] or sample_y == s.last[1]
        still = clamp(s.still + 1, 0, p.still) if rests else 0
        line = (refs, s.refs[0], s.refs[1], s.refs[2])
        x = (
            _apply_reference_sign(now, 0, sample_x),
            _apply_reference_sign(now, 1, sample_x),
            _apply_reference_sign(now, 2, sample_y),
            _apply_reference_sign(now, 3, sample_y),
        )
        if dump:
            a = s.acc
            total = (a[0] << POLE.f, a[1] << POLE.f, a[2] << POLE.f, a[3] << POLE.f)
            acc = x
            pole1 = _step_poles(p.alpha, s.pole1, total)
            stage = 1
        else:
            acc = (_sum(s.acc[0], x[0]), _sum(s.acc[1], x[1]), _sum(s.acc[2], x[2]), _sum(s.acc[3], x[3]))
    return State(line, acc, pole1, pole2, pole3, stage, codes, valid, last, still, ok)


BLOCK = Block(
    place=90,
    inputs={"ce_1m": BIT, "dump": BIT, "refs": bits(4), "sample_x": SAMPLE, "sample_y": SAMPLE},
    latency={"codes": LATENCY, "valid": LATENCY},
    cases={"default": design(), "delay0": design(ref_delay_ticks=0, pole_hz=1900.0)._replace(still=5)},
    rules={
        "acc": (None, "saturate"),
        "pole1": ("half_up", None),
        "pole2": ("half_up", None),
        "pole3": ("half_up", None),
        "codes": ("half_up", "saturate"),
        "still": (None, "saturate"),
    },
    strobes=("ce_1m", "dump"),
    wait=4,
    stops=(ACC_HI << POLE.f,),
)
