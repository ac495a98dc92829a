"""The whole firmware: wiring only. Every block reads the registers its neighbours held before the edge.

    [dds]--+--[drive_sine]--[drive_pipe]--[drive_modulator]--[drive_dac]--> DAC8811 pins
           +--[sense_sine]--[sense_pipe]--[sense_modulator]--[sense_dac]--> AD5791 pins
           +--[references]--> four pins                 [quadrature_dac]--> DAC82002 pins
    ADS1298 pins --[adc]--+                                  ^
    SAR samples ---[sid]--+--[control] (8 kHz)---------------'      [rates] [watchdog] [registers]

    clock of the tick   what
    0                   products of both modulators; references retimed
    1                   codes
    2                   words to the DAC masters
    19                  drive code at the DAC's output
    0, 1 of the next    V_q and sense code at the DAC's output

Latency   from the phase register to the drive DAC's output 24 clocks: DDS output 1, sine 3, product and code 2, load 1,
          frame 17; to the sense DAC's output 32, its frame being 25; to a reference pin 3, or the next tick
Cost      4412 register bits in 217 registers
Source    docs/architecture.md

One record of parameters, one of registers, one step per clock edge at 26 MHz. With `digital` = 1 the codes come from
the demodulator in the FPGA (`sid`), else from the ADC behind the analog one. The 8 kHz work starts with a valid
frame, or from ce_8k while the ADC is stale. `quadrature_fast` = 1 sends V_q at up to 1 MHz, which breaks the SYNC high
time of DAC82002.
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

from fpga_model import (
    control,
    dds,
    delay,
    design_record,
    digital_sid,
    isqrt,
    modulator,
    path_clocks,
    rates,
    references,
    registers,
    sine,
    spi_adc,
    spi_dac,
    watchdog,
)
from fpga_model.block import Cast
from fpga_model.fixed import bits, formats, signed_bits
from fpga_model.jit import inlined, inner

CODE = signed_bits(24)
TEMPERATURE_CHANNEL = 4


class Params(NamedTuple):
    """Parameters of the blocks, by the role of each; `quadrature_fast` sends V_q at up to 1 MHz, else 500 kHz.

    design  rates and word lengths of all blocks
    paths   clocks that one path has beyond the other; None for the design as it is drawn
    """

    design: design_record.Design
    digital: bits(1)
    quadrature_fast: bits(1)
    pipe: delay.Params
    references: references.Params
    drive_modulator: modulator.Params
    sense_modulator: modulator.Params
    drive_dac: spi_dac.Params
    sense_dac: spi_dac.Params
    quadrature_dac: spi_dac.Params
    sid: digital_sid.Params
    watchdog: watchdog.Params
    control: control.Params
    paths: path_clocks.Params | None = None


class State(NamedTuple):
    """Every register of the design."""

    rates: rates.State = rates.State()
    dds: dds.State = dds.State()
    drive_sine: sine.State = sine.State()
    sense_sine: sine.State = sine.State()
    drive_pipe: delay.State = delay.State()
    sense_pipe: delay.State = delay.State()
    references: references.State = references.State()
    drive_modulator: modulator.State = modulator.State()
    sense_modulator: modulator.State = modulator.State()
    drive_dac: spi_dac.State = spi_dac.State()
    sense_dac: spi_dac.State = spi_dac.State()
    quadrature_dac: spi_dac.State = spi_dac.State()
    adc: spi_adc.State = spi_adc.State()
    sid: digital_sid.State = digital_sid.State()
    watchdog: watchdog.State = watchdog.State()
    registers: registers.State = registers.State()
    control: control.State = control.State()


class Inputs(NamedTuple):
    """Pins of the ADC, samples of the two SAR converters, and the host's bus."""

    drdy_n: bits(1)
    dout: bits(1)
    sample_x: digital_sid.SAMPLE
    sample_y: digital_sid.SAMPLE
    write: bits(1)
    address: registers.ADDRESS
    data: registers.DATA


class Pins(NamedTuple):
    """Output pins; all come from registers alone."""

    adc_cs_n: bits(1)
    adc_sclk: bits(1)
    refs: bits(4)
    drive_sync_n: bits(1)
    drive_sclk_en: bits(1)
    drive_sdin: bits(1)
    sense_sync_n: bits(1)
    sense_sclk_en: bits(1)
    sense_sdin: bits(1)
    sense_ldac_n: bits(1)
    quadrature_sync_n: bits(1)
    quadrature_sclk_en: bits(1)
    quadrature_sdin: bits(1)


def reset(d):
    """Every register of a design at power-on."""
    return State(registers=registers.reset(d), control=control.reset(d))


INPUTS_FMT = formats(Inputs)
PINS_FMT = formats(Pins)
PARAMS_FMT = formats(Params)._replace(design=())  # the design is structure
STATE_FMT = formats(State)


@inlined
def pins(p, s):
    """What the pins show."""
    d, e, q = s.drive_dac, s.sense_dac, s.quadrature_dac
    return Pins(
        s.adc.cs_n,
        s.adc.sclk,
        references.pins(p.references, s.references),
        d.sync_n,
        d.sclk_en,
        spi_dac.sdin(p.drive_dac, d),
        e.sync_n,
        e.sclk_en,
        spi_dac.sdin(p.sense_dac, e),
        e.ldac_n,
        q.sync_n,
        q.sclk_en,
        spi_dac.sdin(p.quadrature_dac, q),
    )


@inlined
def other_ldacs(s):
    """LDAC_N of the drive and of V_q's DAC: registers, no pins, as no part of the default board has the pin."""
    return s.drive_dac.ldac_n, s.quadrature_dac.ldac_n


@inner
def codes(p, s):
    """The frame of codes that the 8 kHz work reads."""
    if p.digital:
        c = s.sid.codes
        return control.Inputs(c[0], c[1], c[2], c[3], 0, s.sid.ok, s.watchdog.stale)
    c = s.adc.channels
    return control.Inputs(c[0], c[1], c[2], c[3], c[TEMPERATURE_CHANNEL], s.adc.ok, s.watchdog.stale)


@inner
def step(p, rom, s, i):
    """One clock edge. `rom`: `sine.table` of the design."""
    r, bank, angles, d = s.rates, s.registers, s.dds, p.design
    ce_1m = rates.ce_1m(r)
    ce_8k = rates.ce_8k(r)
    frame = s.sid.valid if p.digital else s.adc.valid
    go = frame | (s.watchdog.stale & ce_8k)

    drive_pipe, sense_pipe = path_clocks.pipes(p.pipe, p.paths)
    drive_code, sense_code = path_clocks.codes(p.paths)
    drive_tick, sense_tick = path_clocks.loads(p.paths)
    at_load, drive_load = rates.tick_enable(r, spi_dac.LOAD_TICK), rates.tick_enable(r, drive_tick)
    sense_load = rates.tick_enable(r, sense_tick)
    c = s.control
    init, amplitude, drive_word, sense_word, quadrature_word, quadrature_load = 0, 0, 0, 0, 0, 0
    if ce_1m:
        amplitude = control.amplitude(p.control, c)
    if at_load | drive_load | sense_load:
        init = control.dac_init(c)
        quadrature_load = at_load & rates.quadrature_due(d, r.frame, p.quadrature_fast)
        drive_word = spi_dac.frame(p.drive_dac, modulator.out(p.drive_modulator, s.drive_modulator), init)
        sense_word = spi_dac.frame(p.sense_dac, modulator.out(p.sense_modulator, s.sense_modulator), init)
        quadrature_word = spi_dac.frame(p.quadrature_dac, c.quadrature_loop.root.y, init)

    is_sequencer_slot = 1 if r.slot == rates.SLOT_SEQUENCER else 0
    work = c
    if r.slot != 0:
        work = control.step(d, p.control, c, r.slot, codes(p, s), bank)
    sid = s.sid
    if p.digital:
        sid = digital_sid.step(
            p.sid, s.sid, ce_1m, ce_8k, references.pins(p.references, s.references), i.sample_x, i.sample_y
        )
    return State(  # by position: Numba 0.68 refuses so many keywords
        rates.step(d, r, go),
        dds.step(
            d,
            angles,
            c.frequency_tracker.word,
            bank.phase_drive_sine,
            bank.phase_sense_sine,
            bank.phase_drive_ref,
            bank.phase_sense_ref,
        ),
        sine.step(d, rom, s.drive_sine, angles.drive_sine),
        sine.step(d, rom, s.sense_sine, angles.sense_sine),
        delay.step(drive_pipe, s.drive_pipe, s.drive_sine.y),
        delay.step(sense_pipe, s.sense_pipe, s.sense_sine.y),
        references.step(d, p.references, s.references, angles.drive_ref, angles.sense_ref, ce_1m),
        modulator.step(
            p.drive_modulator,
            s.drive_modulator,
            ce_1m,
            rates.tick_enable(r, drive_code),
            amplitude,
            delay.out(drive_pipe, s.drive_pipe, s.drive_sine.y),
        ),
        modulator.step(
            p.sense_modulator,
            s.sense_modulator,
            ce_1m,
            rates.tick_enable(r, sense_code),
            c.rate_loop.loop.y,
            delay.out(sense_pipe, s.sense_pipe, s.sense_sine.y),
        ),
        spi_dac.step(p.drive_dac, s.drive_dac, drive_load, drive_word),
        spi_dac.step(p.sense_dac, s.sense_dac, sense_load, sense_word),
        spi_dac.step(p.quadrature_dac, s.quadrature_dac, quadrature_load, quadrature_word),
        spi_adc.step(d, s.adc, i.drdy_n, i.dout),
        sid,
        watchdog.step(p.watchdog, s.watchdog, ce_1m, frame),
        registers.step(d, bank, i.write, i.address, i.data, is_sequencer_slot),
        work,
    )


INPUTS = {"i": Inputs}
CASTS = (
    Cast(
        "control.quadrature_loop.root.y",
        isqrt.ROOT,
        "quadrature_dac.frame.code",
        spi_dac.CODE,
        "a positive code; the frame keeps its low 16 bits",
    ),
)
