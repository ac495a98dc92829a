"""From blocks back to every register: the end of a chunk of the frame engine.

What the blocks do not carry along (pipelines, shift registers, counters) has a memory of less than FLUSH ticks. So the
firmware is put together FLUSH ticks before the tick that the blocks have come to, from what they carry, the rest being
whatever it was; the clocked firmware runs up to that tick; and then it must be where the blocks are.

    blocks --> Arrived --(rebuilt)--> f, FLUSH ticks ago --(clocked ticks)--(completed)--> every register, if `arrived`

Source    docs/architecture.md, docs/decisions/0007-frame-engine.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

from analog_frontend.parts import adc_serial, dac_serial
from fpga_model import dds, digital_sid, rates, references, spi_adc, watchdog
from fpga_model import top as fpga
from fpga_model.jit import inner, outlined
from fpga_model.rates import FRAME_TICKS, TICK_CYCLES
from testbench.engines import engine
from testbench.engines.turn import phase_at

FLUSH = 8
CHANNEL_MASK = spi_adc.WORD_MASK


@inner
def _with(f, rates_, dds_, master, sid, dog, bank, c):
    """The firmware `f` with the registers of the blocks named in place of its own."""
    return fpga.State(
        rates_,
        dds_,
        f.drive_sine,
        f.sense_sine,
        f.drive_pipe,
        f.sense_pipe,
        f.references,
        f.drive_modulator,
        f.sense_modulator,
        f.drive_dac,
        f.sense_dac,
        f.quadrature_dac,
        master,
        sid,
        dog,
        bank,
        c,
    )


@outlined
def rebuilt(f, chips, s, sid, enabled, staged, tick, read, codes, status):
    """Firmware and chips of a quiet `tick` from what the blocks carry; registers of a short memory are those of `f`."""
    ok = 1 if status >> spi_adc.HEAD_SHIFT == spi_adc.HEAD else 0
    master, chip = f.adc, chips.adc
    if read:
        word = codes[spi_adc.CHANNELS - 1] & CHANNEL_MASK
        master = spi_adc.State(1, 1, 1, 0, 0, 1, 0, word, 0, status, codes, 0, ok)
        sent = adc_serial.packed(status, codes)
        chip = adc_serial.State(1, 0, 1, 0, 0, 0, 0, 0, sent, sent)
    d, e = f.dds, chips.sense
    phase = phase_at(s.turn, TICK_CYCLES * tick)
    sense = dac_serial.State(e.shift, e.count, e.sync_n, e.ldac_n, staged, staged, e.code, enabled, e.updated)
    fresh = dds.State(phase, d.drive_sine, d.sense_sine, d.drive_ref, d.sense_ref)
    f = _with(f, rates.State(0, tick % FRAME_TICKS, 0), fresh, master, sid, s.dog, s.bank, s.control)
    return f, engine.Chips(chips.drive, sense, chips.quadrature, chip)


@outlined
def completed(f, sid, dog):
    """After the flush: what has a long memory and moved during it, from the blocks."""
    line = digital_sid.State(f.sid.refs, sid.acc, sid.pole1, sid.pole2, sid.pole3, sid.stage, sid.codes, sid.valid)
    return _with(f, f.rates, f.dds, f.adc, line, dog, f.registers, f.control)


class Arrived(NamedTuple):
    """Where the blocks have come to: the tick, the firmware and chips FLUSH ticks before it, and what must be then."""

    tick: int
    drdy_cycle: int
    fpga: fpga.State
    chips: engine.Chips
    sid: digital_sid.State
    dog: watchdog.State
    phase: int
    refs: int
    drive_code: int
    sense_code: int


@inner
def arrived(p, f, chips, x):
    """1 when the flushed firmware is where the blocks are."""
    same = f.dds.phase == x.phase and references.pins(p.references, f.references) == x.refs
    return same and chips.drive.code == x.drive_code and chips.sense.code == x.sense_code
