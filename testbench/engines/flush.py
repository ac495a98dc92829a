"""From blocks back to every register: the end of a chunk of the frame engine.

What the blocks do not carry along (pipelines, shift registers, counters) has a memory of less than FLUSH ticks. So the
firmware is put together FLUSH ticks before the tick that the blocks have reached, from what they carry. The other
registers keep whatever they held. The clocked firmware then runs up to that tick and must agree with the blocks.

    blocks --> Arrival --(rebuilt)--> f, FLUSH ticks ago --(clocked ticks)--(complete)--> every register, if `arrive`

Source    docs/architecture.md, docs/decisions/0007-frame-engine.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

from analog_frontend.parts import adc_serial
from fpga_model import digital_sid, rates, references, spi_adc, watchdog
from fpga_model import top as fpga
from fpga_model.jit import inner, outlined
from testbench.engines import engine
from testbench.engines.turn import phase_at

FLUSH = 8
CHANNEL_MASK = spi_adc.WORD_MASK


@outlined
def rebuilt(d, f, chips, s, sid, enabled, staged, tick, read, codes, status):
    """Firmware and chips of a quiet `tick` from what the blocks carry; registers of a short memory are those of `f`."""
    ok = 1 if status >> spi_adc.HEAD_SHIFT == spi_adc.HEAD else 0
    master, chip = f.adc, chips.adc
    if read:
        word, top = codes[d.adc_channels - 1] & CHANNEL_MASK, -1 << (spi_adc.WORD_BITS - d.adc_word_bits)
        master = spi_adc.State(1, 1, 1, 0, 0, 1, 0, word, 0, status & top, codes, 0, ok)
        sent = adc_serial.frame_words(status, codes)
        chip = adc_serial.State(1, 0, 1, 0, 0, 0, 0, 0, sent, sent)
    sense = chips.sense._replace(staged=staged, latch=staged, enabled=enabled)
    # put out by the next load, V_q may be older than the flush
    quadrature = chips.quadrature._replace(staged=s.quadrature, latch=s.quadrature, code=s.quadrature)
    f = f._replace(
        rates=rates.State(0, tick % d.frame_ticks, 0),
        dds=f.dds._replace(phase=phase_at(s.turn, d.tick_clocks * tick)),
        adc=master,
        sid=sid,
        watchdog=s.dog,
        registers=s.bank,
        control=s.control,
    )
    return f, chips._replace(sense=sense, quadrature=quadrature, adc=chip)


@outlined
def complete(f, sid, dog):
    """After the flush: what has a long memory and moved during it, from the blocks."""
    return f._replace(sid=sid._replace(refs=f.sid.refs), watchdog=dog)


class Arrival(NamedTuple):
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
def arrive(p, f, chips, x):
    """1 when the flushed firmware is where the blocks are."""
    phase_pins_equal = f.dds.phase == x.phase and references.pins(p.references, f.references) == x.refs
    return phase_pins_equal and chips.drive.code == x.drive_code and chips.sense.code == x.sense_code
