"""Quadrature loop: an integrator on u = V_q**2, because the stiffness it trims goes with the square of the voltage.

    en        error' = -sense_cos
    en_pi     the PI of pi.py acts on error, in its mode; OFF gives the fixed value, preset
    en_root   V_q code = floor(sqrt(u)) by isqrt.py, u = loop.y

    sense_cos --(-)--[error]--(pi)--[loop.y]--u--(isqrt)--[root.y]--> V_q code     [..] register

Formats   sense_cos [1,23,0]   error [1,24,0]   preset, u [0,32,0] of (5.5 V)**2   V_q code [0,16,0] of 5.5 V
Latency   3 clocks from en to u when en_pi follows en by one clock; then 17 clocks from en_root to the V_q code
Rounding  as pi.py; the root is cut, which the integrator absorbs
Overflow  u saturates at 0 and the rail; the negated code cannot overflow its 25 bits
Cost      268 register bits, the multiplier of pi.py

On u the loop gain does not depend on the voltage; on V_q it would be 0 at 0 V. A positive residual coupling makes
sense_cos negative and u rise. V_q pushes one way only: at 0 or the rail u stops, `railed` is 1, and the sequencer sets
QSC_RAIL.
"""

from math import pi as PI
from typing import NamedTuple

from fpga_model import isqrt, pi
from fpga_model.block import BIT, Block
from fpga_model.fixed import formats, quantize, signed_bits
from fpga_model.jit import inlined
from fpga_model.rates import FRAME_HZ

CODE = signed_bits(24)
ERROR = signed_bits(25)
LATENCY = 3
assert ERROR.width <= pi.ERR.width, "the error must fit the input of the PI"
assert isqrt.RADICAND.hi <= pi.OUT.hi, "u must fit the output of the PI"


class Params(NamedTuple):
    """Machine units; build with `design`."""

    loop: pi.Params


class State(NamedTuple):
    """The registers."""

    error: ERROR = 0
    loop: pi.State = pi.State()
    root: isqrt.State = isqrt.State()


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def u_of_volts(volts, full_scale_v=5.5):
    """u of a voltage (V); full scale itself is the largest u."""
    if not 0 <= volts <= full_scale_v:
        raise ValueError(f"V_q: {volts} V is outside 0 .. {full_scale_v} V")
    return quantize(min((volts / full_scale_v) ** 2 * 2.0**32, isqrt.RADICAND.hi), isqrt.RADICAND, "u (LSB)")


def design(
    crossover_hz=1.0,
    code_v_per_deg_s=57.9e-6,
    adc_full_scale_v=4.0 / 12,
    null_deg_per_s=100.0,
    null_v=4.52,
    full_scale_v=5.5,
    rail_v=5.5,
    frame_hz=FRAME_HZ,
):
    """Integral gain from the code per residual quadrature and the quadrature per square volt.

    crossover_hz      crossover of the integrator (Hz)
    code_v_per_deg_s  SID output per residual quadrature (V/(deg/s))
    adc_full_scale_v  ADC full scale at the PGA gain of this channel (V)
    null_deg_per_s    quadrature (deg/s) that
    null_v            this voltage compensates (V)
    full_scale_v      voltage that full scale of the code stands for (V)
    rail_v            largest voltage the loop may ask for (V)
    frame_hz          rate of the enables (Hz)
    """
    code_per_deg_s = code_v_per_deg_s / adc_full_scale_v * 2**23
    u_per_deg_s = (null_v / full_scale_v) ** 2 * 2.0**32 / null_deg_per_s
    ki_per_s = 2 * PI * crossover_hz * u_per_deg_s / code_per_deg_s
    return Params(loop=pi.design(0.0, ki_per_s, frame_hz, 0, u_of_volts(rail_v, full_scale_v)))


@inlined
def step(d, p, s, en, en_pi, en_root, mode, sense_cos, preset):
    """One clock edge."""
    return State(
        error=-sense_cos if en else s.error,
        loop=pi.step(d, p.loop, s.loop, en_pi, mode, s.error, preset),
        root=isqrt.step(s.root, en_root, s.loop.y),
    )


@inlined
def railed(p, s):
    """1 when u is at 0 or at the rail."""
    return 1 if s.loop.y <= p.loop.lo or s.loop.y >= p.loop.hi else 0


BLOCK = Block(
    place=150,
    inputs={
        "en": BIT,
        "en_pi": BIT,
        "en_root": BIT,
        "mode": pi.MODE,
        "sense_cos": CODE,
        "preset": isqrt.RADICAND,
    },
    outputs={"railed": BIT},
    latency={"error": 1, "loop_y": LATENCY, "root_y": isqrt.LATENCY},
    strobes=("en", "en_pi", "en_root"),
    wait=20,
)
