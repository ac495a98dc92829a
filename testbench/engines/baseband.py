"""Baseband engine: the averaged plant with the firmware's own 8 kHz window, for hours of data and for fitting.

    chunk   clocked ticks | blocks of the frame engine | frames of the averaged plant | blocks, flush, clocked ticks
            to a quiet one | to a frame's first instant | (baseband_frames.py)         | to the chunk's end

State in and out are those of the other engines: what one has begun another continues. Rows come from everywhere, codes
of single ticks from nowhere; a chunk of less than CHUNK_FRAMES, the first third of a second after power-on, the phase
meter and windows of registers are run by the frame engine, with its bits.
Source    docs/plant.md, docs/decisions/0014-baseband.md
"""

from __future__ import annotations  # a field may bear the name of its module

import collections
import math
import threading

import numpy as np

from analog_frontend.parts import adc
from fpga_model import sequencer
from fpga_model.jit import hot, inner
from testbench.engines import engine, frame
from testbench.engines.baseband_frames import frames
from testbench.engines.baseband_setup import RATE_LIMIT_DEG_S, setup
from testbench.engines.baseband_state import give_state, slow, take_state
from testbench.engines.frame import advance_blocks, begin_blocks, build_arrival, enter_block_mode, exit_block_mode
from testbench.engines.pins import buffers
from testbench.engines.turn import WIDEST, phase_at, widen_word
from testbench.errors import ConfigError

TAIL_FRAMES = 2  # of a chunk, for the way back to every register
ZERO = np.int64(0)
QUIET = engine.Faults()


@inner
def _ready(p, u, g, clock, tick):
    """1 when the averaged plant may go on from a frame's first instant: the firmware is up, one conversion a frame."""
    at = p.fpga.design.tick_clocks * tick
    calm = g.enabled == 1 and g.s.slot == 0 and g.s.dog.stale == 0 and g.new_ok == 1
    calm = calm and sequencer.outputs(g.s.control.sequencer).dac_init == 0
    return calm and g.valid == at + u.valid and clock[adc.DUE] == 0 and clock[adc.SAMPLE] == 0


@hot
def _run(p, u, b, f, chips, a, chunk, end, drdy_cycle, w):
    """A chunk; returns firmware, chips, clock of DRDY, tick of a failed flush or 0, and a frequency word
    too far from resonance or 0."""
    f, chips, drdy_cycle, tick = enter_block_mode(p, f, chips, a, chunk, end, drdy_cycle)
    if tick == end:
        return f, chips, drdy_cycle, ZERO, ZERO
    d, frame_ticks = p.fpga.design, p.fpga.design.frame_ticks
    g = begin_blocks(p, f, chips, a, chunk.faults, tick, drdy_cycle, w)
    last = (end // frame_ticks - TAIL_FRAMES) * frame_ticks
    far = ZERO
    while tick < last - frame_ticks:
        g, tick = advance_blocks(p, a, chunk, g, tick, end, (tick // frame_ticks + 1) * frame_ticks, w)
        if _ready(p, u, g, a.adc.clock, tick):
            take_state(p, u, b, g, a, tick)
            c, bank, turn, quadrature, old, new, tick = frames(
                p,
                u,
                b,
                g.s.control,
                g.s.bank,
                widen_word(d, phase_at(g.s.turn, d.tick_clocks * tick)),
                widen_word(d, g.s.turn.word),
                g.s.quadrature,
                g.channels,
                g.coming,
                chunk,
                tick,
                (last - tick) // frame_ticks,
                a.adc.clock,
                a.adc.sums,
            )
            far = ZERO if tick == last else widen_word(d, turn.word)
            g = give_state(p, u, b, g, a, c, bank, turn, quadrature, old, new, tick, w)
            break
    g, tick = advance_blocks(p, a, chunk, g, tick, end, end, w)
    f, chips, drdy_cycle, failed = exit_block_mode(
        p, build_arrival(d, f, chips, g, tick, chunk.faults.status), a, chunk, end
    )
    return f, chips, drdy_cycle, failed, far


class _RecentSetups(threading.local):
    """(parameters, Setup, Slow) of the gyroscopes that a thread has run last: several may take turns."""

    def __init__(self):
        self.last = collections.deque(maxlen=8)


_RECENT_SETUPS = _RecentSetups()


def prepare(p, existing_setup=None):
    """(Setup, Slow) of engine.Params, made once while few take turns; `existing_setup`: a Setup that is at hand.

    ConfigError outside the averaged plant's validity.
    """
    for params, u, b in _RECENT_SETUPS.last:
        if params is p:
            return u, b
    u, b = existing_setup or setup(p), slow()
    _RECENT_SETUPS.last.append((p, u, b))
    return u, b


def run(p, s, ticks, rate_rad_s, temp_degc, host, faults, o):
    """As `engine.run`, within the tolerances of docs/plant.md.

    Raises ConfigError outside the averaged plant's validity, RuntimeError if a register is not what it must be.
    """
    if faults != QUIET:
        raise ConfigError('scenario.faults: scenario.engine = "baseband" cannot run them; use "frame"')
    u, b = prepare(p)
    fastest = math.degrees(float(np.abs(rate_rad_s).max()))
    if not fastest <= RATE_LIMIT_DEG_S:
        raise ConfigError(
            f"scenario.rate_dps: {fastest:g} deg/s is above {RATE_LIMIT_DEG_S:g} deg/s, "
            'the limit of scenario.engine = "baseband"; use "frame"'
        )
    if o.probe_ints.shape[0] or o.registers.shape[0]:
        return frame.run(p, s, ticks, rate_rad_s, temp_degc, host, faults, o)
    end = s.tick + ticks
    edges = np.zeros((engine.MAX_EDGES, 2), np.int64)
    chunk = engine.Chunk(s.tick, rate_rad_s, temp_degc, *host, faults, o, edges)
    f, chips, drdy_cycle, failed, far = _run(p, u, b, s.fpga, s.chips, s.plant, chunk, end, s.drdy_cycle, buffers())
    if failed:
        raise RuntimeError(f"baseband engine: the registers of tick {failed} are not those of the clocked engine")
    if far:
        lsb_hz = p.fpga.design.master_hz / 2**WIDEST
        hz = (far - u.word0) * lsb_hz
        raise ConfigError(
            f"frequency_word: {hz:+.1f} Hz from the drive mode exceeds the averaged plant's limit of "
            f"{u.limit * lsb_hz:g} Hz, within {ticks} ticks from {s.tick}; "
            'use scenario.engine = "frame"'
        )
    return engine.State(f, chips, s.plant, end, drdy_cycle)
