"""The plant driven by recorded words: open loop, so that neither the loops nor their delays hide what it does.

    words of each frame (`replay.DRIVEN`) --> DAC codes, reference edges (`pins`) --> plant.block --> ADC codes

The text around the plant is that of the frame engine; only where its words come from differs. Row m of the result holds
the codes that the firmware sees in frame m.
Source    docs/measured.md, docs/architecture.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

import numpy as np

from analog_frontend import tick as units
from analog_frontend import top as plant
from analog_frontend.parts import adc, dac_serial
from fpga_model import registers
from fpga_model.control import SLOT_PI
from fpga_model.design_record import DEFAULT
from fpga_model.jit import hot, inner
from fpga_model.path_clocks import dac_clocks
from fpga_model.rates import FRAME_TICKS, SLOT_SEQUENCER, TICK_CYCLES
from testbench.engines import pins
from testbench.engines.turn import change_word, still
from testbench.engines.window import SLOT_WORD
from testbench.measured.record.replay import CODES, DRIVEN

VALID, WORD_MID, WORD, AMPLITUDE_MID, AMPLITUDE, RATE, QUADRATURE = range(len(DRIVEN))
ZERO, ONE = np.int64(0), np.int64(1)


class Drive(NamedTuple):
    """What a session drove its plant with."""

    bank: registers.State  # for its phase words
    before: np.ndarray  # (len(DRIVEN),) words before the first frame
    driven: np.ndarray  # (frames, len(DRIVEN)) what each window left; valid = -1: nothing changed in this frame
    phase: np.ndarray  # (frames,) DDS phase before each frame's first edge
    rate_rad_s: np.ndarray  # (frames,)
    temp_degc: np.ndarray  # (frames,)


@inner
def _fill_tick_words(b, old, new, tick, n):
    """Amplitude and rate words of `n` ticks, in which a window may leave others. Mutates `b`."""
    for k in range(n):
        slot = TICK_CYCLES * (tick + k) - 1 - new[VALID]
        is_stale = new[VALID] < 0 or slot < SLOT_SEQUENCER
        amplitude = new[AMPLITUDE_MID] if slot <= SLOT_PI else new[AMPLITUDE]
        b.amplitude[k] = old[AMPLITUDE] if is_stale else amplitude
        b.rate[k] = old[RATE] if is_stale or slot <= SLOT_PI else new[RATE]


@inner
def _block(p, a, bank, turn, refs, staged, tick, n, b):
    """`n` ticks of the plant; returns the reference pins and the sense DAC's data register. Mutates `a` and `b`."""
    codes = a.work
    pins.dac_codes(p.fpga, p.rom, bank, turn, tick, n, b)
    _, staged = pins.words_of_ticks(p.fpga, codes.drive_codes, codes.sense_codes, n, ONE, staged, False, b)
    count, refs = pins.reference_edges(p.fpga.design, p.fpga.references, turn, bank, tick, tick + n, refs, b)
    drive_clock, sense_clock = dac_clocks(p.fpga)
    units.advance_ticks(p.plant, a, tick, n, drive_clock, sense_clock, count, b.edges)
    return refs, staged


@hot
def _run(p, a, d, refs, b, codes):
    """Every frame of a session from power-on on. Mutates `a`, `b` and `codes`."""
    staged = ZERO
    old = d.before
    for n in range(d.driven.shape[0]):
        new = d.driven[n]
        tick = FRAME_TICKS * n
        for c in range(CODES):
            codes[n, c] = a.adc.clock[adc.CODES + c]
        units.retune(p.plant, a, d.rate_rad_s[n], old[QUADRATURE], d.temp_degc[n])
        clock = TICK_CYCLES * tick
        turn = still(clock, d.phase[n], old[WORD], p.fpga.design.dds_bits)
        head = FRAME_TICKS if new[VALID] < 0 else new[VALID] // TICK_CYCLES - tick
        if head > 0:
            _fill_tick_words(b, old, new, tick, head)
            refs, staged = _block(p, a, d.bank, turn, refs, staged, tick, head, b)
        if head < FRAME_TICKS:
            turn = change_word(turn, new[VALID] + SLOT_PI + 1, new[WORD_MID])
            turn = change_word(turn, new[VALID] + SLOT_WORD + 1, new[WORD])
            _fill_tick_words(b, old, new, tick + head, FRAME_TICKS - head)
            refs, staged = _block(p, a, d.bank, turn, refs, staged, tick + head, FRAME_TICKS - head, b)
        old = new


def run(params, drive, temp_degc):
    """(frames, 5) ADC codes that a plant gives, from power-on at `temp_degc`, driven by `drive`.

    params  testbench.engines.engine.Params
    """
    codes = np.zeros((len(drive.driven), CODES), np.int64)
    chips = dac_serial.reset(dac_serial.DAC8811), dac_serial.reset(dac_serial.AD5791)
    a = plant.reset(params.plant, *(chip.code for chip in chips), temp_degc)
    refs = first_pins(drive.bank)
    a.switch[:] = [(refs >> d) & 1 for d in range(plant.DEMODULATORS)]
    _run(params, a, drive, refs, pins.buffers(), codes)
    return codes


def first_pins(bank):
    """The four reference pins just before phase 0."""
    sin_cos = {0: 0b11, 1: 0b01, 2: 0b00, 3: 0b10}  # levels in each quarter turn
    bits = DEFAULT.dds_bits
    words = ((word - 1) % (1 << bits) for word in (bank.phase_drive_ref, bank.phase_sense_ref))
    drive, sense = (sin_cos[word >> (bits - 2)] for word in words)
    return drive | sense << 2
