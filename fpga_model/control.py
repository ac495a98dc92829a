"""Wiring of the 8 kHz work: codes to loops to words, in slots of one clock each after a valid frame.

    slot     block
    1        cordic: magnitude and phase of (-drive_cos, drive_sin), there 26 clocks later
    31       sequencer: what each loop does with this very frame
    32, 33   errors, then the four PIs: amplitude and force word stand after slot 34, the DDS word after 35
    35       notch of the rate, where there is one
    36       V_q = sqrt(u), its code stands after slot 52; output word of the rate, after slot 41
    60       the last slot

    codes --[cordic]--+--[agc]---------------> amplitude        [..] block
                      +--[frequency_tracker]-> DDS word
          ------------+--[rate_loop]---------> force word --[notch]--[rate_output]--> rate
                      +--[quadrature_loop]---> V_q code
                      '--[sequencer]--> modes of all

Latency   53 clocks, 2.0 us, from a valid frame to the last word
Cost      1748 register bits; the notch has 116 more
Source    docs/decisions/0006-order-of-slots.md

Outside the slots nothing here is stepped, so that one clock enable holds every register. The code -2**23 of drive_cos
becomes 2**23 - 1 where its sign is changed. A fixed word of the register bank is the
preset of a loop only while its FIX or OPEN bit is set, else the preset is 0.
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

from fpga_model import (
    agc,
    cordic,
    fault_monitor,
    frequency_tracker,
    notch,
    quadrature_loop,
    rate_loop,
    rate_output,
    rates,
    registers,
    sequencer,
)
from fpga_model.block import BIT, Cast
from fpga_model.fixed import formats
from fpga_model.jit import inner, outlined


class Params(NamedTuple):
    """Parameters of the blocks, by the role of each."""

    agc: agc.Params
    frequency_tracker: frequency_tracker.Params
    rate_loop: rate_loop.Params
    quadrature_loop: quadrature_loop.Params
    sequencer: sequencer.Params
    notch: notch.Params | None = None


class State(NamedTuple):
    """Registers of the blocks."""

    cordic: cordic.State = cordic.State()
    agc: agc.State = agc.State()
    frequency_tracker: frequency_tracker.State = frequency_tracker.State()
    rate_loop: rate_loop.State = rate_loop.State()
    quadrature_loop: quadrature_loop.State = quadrature_loop.State()
    rate_output: rate_output.State = rate_output.State()
    sequencer: sequencer.State = sequencer.State()
    notch: notch.State | None = None


def reset(d):
    """The registers of a design at power-on."""
    return State(frequency_tracker=frequency_tracker.reset(d))


class Inputs(NamedTuple):
    """A frame of codes and what is known of it."""

    drive_sin: fault_monitor.CODE
    drive_cos: fault_monitor.CODE
    sense_sin: rate_loop.CODE
    sense_cos: quadrature_loop.CODE
    temperature: rate_output.CODE
    adc_ok: BIT
    stale: BIT


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)
SLOT_PI = rates.SLOT_LOOPS + 1
SLOT_NOTCH = rates.SLOT_ROOT - 1


@inner
def amplitude(p, s):
    """Amplitude word of the drive modulator."""
    return agc.amplitude(p.agc, s.agc, sequencer.outputs(s.sequencer).agc_mode)


@inner
def dac_init(s):
    """1 while the DAC masters send the control word."""
    return sequencer.outputs(s.sequencer).dac_init


@inner
def output_params(bank):
    """Parameters of the rate output, which are registers of the host."""
    return rate_output.Params(
        bank.rate_bias,
        bank.rate_bias_t1,
        bank.rate_bias_t2,
        bank.rate_scale,
        bank.rate_scale_t1,
        bank.rate_scale_t2,
        bank.decimation,
    )


@inner
def step_notch(p, s, at_notch, word):
    """The notch after a clock edge; None where there is none."""
    if s is None:
        return s
    return notch.step(p, s, at_notch, word)


@inner
def rate_word(s, word):
    """What the rate output takes: the word of the loop, or what the notch makes of it."""
    if s is None:
        return word
    return notch.out(s)


@inner
def loops(d, p, s, slot, i, bank):
    """One clock edge within the slots for all but the sequencer."""
    at_loops = 1 if slot == rates.SLOT_LOOPS else 0
    at_pi = 1 if slot == SLOT_PI else 0
    at_root = 1 if slot == rates.SLOT_ROOT else 0
    at_cordic = 1 if slot == rates.SLOT_CORDIC else 0
    o = sequencer.outputs(s.sequencer)
    amplitude_preset = bank.amplitude_fixed if o.fix_drive else 0
    rate_preset = bank.rate_fixed if o.fix_ftr else 0
    quadrature_preset = bank.quadrature_fixed if o.fix_qsc else 0
    return State(
        cordic=cordic.step(d, s.cordic, at_cordic, cordic.negated(i.drive_cos), i.drive_sin),
        agc=agc.step(
            d,
            p.agc,
            s.agc,
            at_loops,
            at_pi,
            o.agc_mode,
            s.cordic.magnitude,
            bank.amplitude_setpoint,
            amplitude_preset,
        ),
        frequency_tracker=frequency_tracker.step(
            d,
            p.frequency_tracker,
            s.frequency_tracker,
            at_loops,
            at_pi,
            o.pll_mode,
            s.cordic.phase,
            o.load,
            o.adjust,
            s.sequencer.correction,
            bank.frequency_fixed,
        ),
        rate_loop=rate_loop.step(
            d,
            p.rate_loop,
            s.rate_loop,
            at_loops,
            at_pi,
            o.ftr_mode,
            i.sense_sin,
            rate_preset,
        ),
        quadrature_loop=quadrature_loop.step(
            d,
            p.quadrature_loop,
            s.quadrature_loop,
            at_loops,
            at_pi,
            at_root,
            o.qsc_mode,
            i.sense_cos,
            quadrature_preset,
        ),
        rate_output=rate_output.step(
            output_params(bank),
            s.rate_output,
            at_root,
            rate_word(s.notch, s.rate_loop.loop.y),
            i.temperature,
        ),
        sequencer=s.sequencer,
        notch=step_notch(p.notch, s.notch, 1 if slot == SLOT_NOTCH else 0, s.rate_loop.loop.y),
    )


@inner
def step_sequencer(p, s, i, bank):
    """The sequencer after SLOT_SEQUENCER."""
    return sequencer.step(
        p.sequencer,
        s.sequencer,
        1,
        sequencer.Inputs(
            control=bank.control,
            clear=bank.fault_clear,
            adc_ok=i.adc_ok,
            stale=i.stale,
            drive_sin=i.drive_sin,
            drive_cos=i.drive_cos,
            sense_sin=i.sense_sin,
            sense_cos=i.sense_cos,
            magnitude=s.cordic.magnitude,
            phase=s.cordic.phase,
            setpoint=bank.amplitude_setpoint,
            drive_saturated=agc.saturated(p.agc, s.agc),
            rate_saturated=rate_loop.saturated(p.rate_loop, s.rate_loop),
            qsc_rail=quadrature_loop.railed(p.quadrature_loop, s.quadrature_loop),
        ),
    )


@outlined
def step(d, p, s, slot, i, bank):
    """One clock edge of a design `d` within the slots; `bank` is the register bank."""
    after = loops(d, p, s, slot, i, bank)
    if slot != rates.SLOT_SEQUENCER:
        return after
    return State(
        after.cordic,
        after.agc,
        after.frequency_tracker,
        after.rate_loop,
        after.quadrature_loop,
        after.rate_output,
        step_sequencer(p, s, i, bank),
        after.notch,
    )


INPUTS = {"slot": rates.SLOT, "i": Inputs, "bank": registers.State}
OUTPUTS = {"amplitude": agc.AMPLITUDE, "dac_init": BIT}
CASTS = (
    Cast("rate_loop.loop.y", rate_loop.WORD, "rate_output.word", rate_output.CODE, "bias and scale count its LSB"),
    Cast("notch.out", notch.WORD, "rate_output.word", rate_output.CODE, "bias and scale count its LSB"),
)
