"""Lock of the four loops: each error compared with two limits, debounced by one counter.

    good_k = abs(error_k) <= limit_in_k      lost_k = abs(error_k) > limit_out_k      (quadrature at its rail: good)
    pending_k = lost_k if locked_k else good_k
    count_k'  = count_k + 1 while pending, 0 otherwise; when it reaches frames_in_k (not locked) or frames_out_k
                (locked), locked_k toggles and count_k' = 0

    error_k --(abs, <=, >)--[count_k]--(reached)--[bit k of locked]-->     [..] register, k = agc, pll, ftr, qsc

    loop   error                  to lock, at most   for     to lose it, above   for
    AGC    setpoint - magnitude   2 %                20 ms   20 %                50 ms
    PLL    phase                  2 deg              20 ms   30 deg              50 ms
    FTR    sense_sin              5 deg/s            50 ms   100 deg/s           50 ms
    QSC    sense_cos              5 deg/s            50 ms   100 deg/s           50 ms

Formats   locked, enable, judged [0,4,0]   count [0,12,0]   limits [0,24,0]: of agc 2**-16 of the setpoint, of pll
          2**-24 turn, of ftr and qsc code LSB (1457.1 per deg/s)   errors as their blocks give them
Latency   1 clock from en to locked; frames_in or frames_out frames from a step of the error
Rounding  the products with the setpoint are cut to one magnitude LSB
Overflow  none possible: a count never passes its limit
Cost      52 register bits, two 24 x 24 bit products

A loop that is not enabled is not locked. A loop that is enabled but not judged (held or fixed by the user) keeps its
bit and its count; the sequencer takes it for locked. A rate step of 300 deg/s loses no lock: FTR is above 100 deg/s for
20 ms, then rings through zero.
"""

from typing import NamedTuple

from fpga_model import agc, cordic, rate_loop
from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, formats, mul_fmt, quantize
from fpga_model.jit import inlined
from fpga_model.rates import FRAME_HZ

AGC, PLL, FTR, QSC = 1, 2, 4, 8
DRIVE, SENSE, ALL = AGC | PLL, FTR | QSC, 15
LIMIT = bits(24)
COUNT = bits(12)
FRACTION = 16
LATENCY = 1
assert mul_fmt(LIMIT, bits(24)).width <= 63, "limit times setpoint must fit int64"


class Params(NamedTuple):
    """Machine units, in the order agc, pll, ftr, qsc; build with `design`."""

    limit_in: [LIMIT] * 4
    limit_out: [LIMIT] * 4
    frames_in: [COUNT] * 4
    frames_out: [COUNT] * 4


class State(NamedTuple):
    """The registers."""

    locked: bits(4) = 0
    count: [COUNT] * 4 = (0, 0, 0, 0)


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


class Design(NamedTuple):
    """Limits and debounce times of the four loops, _in to lock and _out to lose it.

    agc_*           amplitude error (part of the setpoint)
    pll_*_deg       drive phase (deg)
    ftr_*, qsc_*    residual rate and residual quadrature (deg/s)
    *_s             how long the error must stay there (s)
    code_per_deg_s  sense code per residual (LSB/(deg/s))
    frame_hz        rate of the frames (Hz)
    """

    agc_in: float = 0.02
    agc_out: float = 0.20
    agc_in_s: float = 0.02
    agc_out_s: float = 0.05
    pll_in_deg: float = 2.0
    pll_out_deg: float = 30.0
    pll_in_s: float = 0.02
    pll_out_s: float = 0.05
    ftr_in_deg_s: float = 5.0
    ftr_out_deg_s: float = 100.0
    ftr_in_s: float = 0.05
    ftr_out_s: float = 0.05
    qsc_in_deg_s: float = 5.0
    qsc_out_deg_s: float = 100.0
    qsc_in_s: float = 0.05
    qsc_out_s: float = 0.05
    code_per_deg_s: float = 57.9e-6 * 12 / 4.0 * 2**23
    frame_hz: float = FRAME_HZ


def design(**values):
    """Params of a `Design`. Raises ValueError (name, value, limit) outside the ranges."""
    d = Design(**values)
    scale = (2.0**FRACTION, 2.0**24 / 360, d.code_per_deg_s, d.code_per_deg_s)
    limit_in = (d.agc_in, d.pll_in_deg, d.ftr_in_deg_s, d.qsc_in_deg_s)
    limit_out = (d.agc_out, d.pll_out_deg, d.ftr_out_deg_s, d.qsc_out_deg_s)
    time_in, time_out = (
        (d.agc_in_s, d.pll_in_s, d.ftr_in_s, d.qsc_in_s),
        (d.agc_out_s, d.pll_out_s, d.ftr_out_s, d.qsc_out_s),
    )
    for name, low, high in zip(("agc", "pll", "ftr", "qsc"), limit_in, limit_out, strict=True):
        if not 0 < low <= high:
            raise ValueError(f"{name}: the limit for lock, {low}, is outside 0 .. {high}, the limit for loss of lock")
    for name, time_s in zip(("agc", "pll", "ftr", "qsc") * 2, time_in + time_out, strict=True):
        if not round(time_s * d.frame_hz) >= 1:
            raise ValueError(f"{name}: a debounce of {time_s} s is shorter than one frame, {1 / d.frame_hz} s")
    return Params(
        tuple(quantize(v * k, LIMIT, "limit_in (LSB)") for v, k in zip(limit_in, scale, strict=True)),
        tuple(quantize(v * k, LIMIT, "limit_out (LSB)") for v, k in zip(limit_out, scale, strict=True)),
        tuple(quantize(t * d.frame_hz, COUNT, "time to lock (frames)") for t in time_in),
        tuple(quantize(t * d.frame_hz, COUNT, "time to lose lock (frames)") for t in time_out),
    )


@inlined
def _judge(p, s, k, enable, lock_mask, good, lost):
    """New lock bit (at its place in the word) and new count of loop k."""
    locked = (s.locked >> k) & 1
    count = s.count[k]
    if not (enable >> k) & 1:
        locked, count = 0, 0
    elif (lock_mask >> k) & 1:
        pending = lost if locked else good
        count = count + 1 if pending else 0
        if count >= (p.frames_out[k] if locked else p.frames_in[k]) and pending:
            locked, count = 1 - locked, 0
    return locked << k, count


@inlined
def step(p, s, en, enable, judged, agc_error, setpoint, phase, sense_sin, sense_cos, rail):
    """One clock edge."""
    if not en:
        return s
    agc, pll, ftr, qsc = abs(agc_error), abs(phase), abs(sense_sin), abs(sense_cos)
    a_good = 1 if agc <= (setpoint * p.limit_in[0]) >> FRACTION else 0
    a_lost = 1 if agc > (setpoint * p.limit_out[0]) >> FRACTION else 0
    q_good = 1 if rail or qsc <= p.limit_in[3] else 0
    q_lost = 1 if qsc > p.limit_out[3] and not rail else 0
    b0, c0 = _judge(p, s, 0, enable, judged, a_good, a_lost)
    b1, c1 = _judge(p, s, 1, enable, judged, 1 if pll <= p.limit_in[1] else 0, 1 if pll > p.limit_out[1] else 0)
    b2, c2 = _judge(p, s, 2, enable, judged, 1 if ftr <= p.limit_in[2] else 0, 1 if ftr > p.limit_out[2] else 0)
    b3, c3 = _judge(p, s, 3, enable, judged, q_good, q_lost)
    return State(b0 | b1 | b2 | b3, (c0, c1, c2, c3))


# a few frames to lock and to lose it, so that vectors walk through all states
QUICK = design(**{f"{loop}_{way}_s": 3 / FRAME_HZ for loop in ("agc", "pll", "ftr", "qsc") for way in ("in", "out")})

BLOCK = Block(
    place=160,
    inputs={
        "en": BIT,
        "enable": bits(4),
        "judged": bits(4),
        "agc_error": agc.ERROR,
        "setpoint": agc.SETPOINT,
        "phase": cordic.PHASE,
        "sense_sin": rate_loop.CODE,
        "sense_cos": rate_loop.CODE,
        "rail": BIT,
    },
    latency={"locked": LATENCY},
    cases={
        "default": design(),
        "quick": QUICK,
        "longest": design()._replace(frames_in=(COUNT.hi,) * 4, frames_out=(COUNT.hi,) * 4),
    },
    strobes=("en",),
)
