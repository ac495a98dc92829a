"""Drive amplitude loop: a PI on the CORDIC magnitude, and the fixed kick of the start-up.

    en      error' = setpoint - magnitude
    en_pi   the PI of pi.py acts on error, in its mode; KICK counts as OFF with preset 0
    amplitude = kick in mode KICK, else loop.y

    magnitude --(-)--[error]--(pi)--[loop.y]--(mode KICK ? kick : y)-->     [..] register
    setpoint ---^

Formats   magnitude [0,25,0]   setpoint [0,24,0]   error [1,25,0]   amplitude, kick, preset [1,0,23] of 10 V, >= 0
Latency   3 clocks from en to loop.y when en_pi follows en by one clock
Rounding  as pi.py
Overflow  error cannot overflow; loop.y saturates at 0 and the ceiling
Cost      182 register bits, the multipliers of pi.py

OFF gives the preset: 0, or AMPLITUDE_FIXED with an open drive. P_ONLY captures without wind-up, 0.9 % below the
setpoint. The loop never brakes: the word is 0 or more, and `saturated` is 1 at the ceiling alone.
"""

from math import pi as PI
from typing import NamedTuple

from fpga_model import cordic, pi
from fpga_model.block import BIT, Block
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt, bits, formats, quantize, sub_fmt
from fpga_model.jit import inlined

AMPLITUDE = Fmt(1, 0, 23)
SETPOINT = bits(24)
ERROR = sub_fmt(SETPOINT, cordic.MAGNITUDE)
LATENCY = 3
KICK = 4  # one more mode, beside those of pi.py
assert ERROR.width <= pi.ERR.width, "the error must fit the input of the PI"


class Params(NamedTuple):
    """Machine units; build with `design`."""

    loop: pi.Params
    kick: AMPLITUDE


class State(NamedTuple):
    """The registers."""

    error: ERROR = 0
    loop: pi.State = pi.State()


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


def setpoint(amplitude_um=5.0, v_per_um=0.576, adc_full_scale_v=4.0, d=DEFAULT):
    """Amplitude setpoint in magnitude LSB; 5 um gives 2.88 V at the SID output, 0.72 of the ADC's full scale.

    amplitude_um      wanted drive amplitude (um)
    v_per_um          SID output per amplitude (V/um)
    adc_full_scale_v  ADC full scale at the PGA gain of this channel (V)
    d                 the design record
    """
    gain = float(cordic.gain(d.cordic_iterations))
    return quantize(amplitude_um * v_per_um / adc_full_scale_v * 2**23 * gain, SETPOINT, "setpoint (LSB)")


def design(
    crossover_hz=3.0,
    zero_hz=0.6,
    plant_fs_per_s=12.18,
    ceiling_v=10.0,
    kick_v=10.0,
    full_scale_v=10.0,
    d=DEFAULT,
):
    """Gains from the plant d(code)/dt = plant * amplitude, seen through the CORDIC gain.

    crossover_hz    frequency of unit gain of the proportional part (Hz)
    zero_hz         PI zero (Hz)
    plant_fs_per_s  growth of the ADC code per amplitude word, both in full scales (1/s)
    ceiling_v       largest amplitude the loop may ask for (V)
    kick_v          amplitude of the start-up kick (V)
    full_scale_v    amplitude that full scale of the word stands for (V)
    d               the design record: rate of the enables, gain of the CORDIC
    """
    kp = 2 * PI * crossover_hz / (plant_fs_per_s * float(cordic.gain(d.cordic_iterations)))

    def word(volts, name):
        raw = volts / full_scale_v * 2**23
        if not 0 <= raw <= 2**23:
            raise ValueError(f"{name}: {volts} V is outside 0 .. {full_scale_v} V")
        return min(round(raw), AMPLITUDE.hi)

    return Params(
        loop=pi.design(kp, kp * 2 * PI * zero_hz, d.frame_hz, 0, word(ceiling_v, "ceiling_v")),
        kick=word(kick_v, "kick_v"),
    )


@inlined
def step(d, p, s, en, en_pi, mode, magnitude, setpoint, preset):
    """One clock edge."""
    kicked = mode == KICK
    return State(
        error=setpoint - magnitude if en else s.error,
        loop=pi.step(d, p.loop, s.loop, en_pi, pi.OFF if kicked else mode, s.error, 0 if kicked else preset),
    )


@inlined
def amplitude(p, s, mode):
    """Amplitude word of the drive modulator."""
    return p.kick if mode == KICK else s.loop.y


@inlined
def saturated(p, s):
    """1 when the loop asks for all it may have."""
    return 1 if s.loop.y >= p.loop.hi else 0


MODE = bits(3)

BLOCK = Block(
    place=120,
    inputs={
        "en": BIT,
        "en_pi": BIT,
        "mode": MODE,
        "magnitude": cordic.MAGNITUDE,
        "setpoint": SETPOINT,
        "preset": AMPLITUDE,
    },
    outputs={"amplitude": AMPLITUDE, "saturated": BIT},
    latency={"error": 1, "loop_y": LATENCY},
    strobes=("en", "en_pi"),
)
