"""The 8 kHz window for the frame engine: the firmware's own slots, computed when something reads what they change.

    DRDY ---- read of the ADC, word by word ---- valid ---- slots 1 .. SLOTS ---- rest
                                                   ^ or the watchdog's stale, at ce_8k

`advance_window` walks it tick by tick and leaves what the DACs take from it; `receive` returns what a read has brought.
Source    docs/architecture.md, fpga_model/control.py
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

import numpy as np

from fpga_model import (
    agc,
    control,
    cordic,
    isqrt,
    path_clocks,
    rates,
    registers,
    sequencer,
    spi_adc,
    spi_dac,
    watchdog,
)
from fpga_model.control import SLOT_PI
from fpga_model.jit import inlined, inner, outlined
from fpga_model.rates import SLOT_ROOT, SLOT_SEQUENCER, SLOTS
from testbench.engines import closed_form_window, engine
from testbench.engines.turn import Turn, change_word

SLOT_WORD = SLOT_PI + 2  # after it the frequency word holds what the loop has found
ZERO, ONE = np.int64(0), np.int64(1)
NO_HOST = (ZERO, ZERO, ZERO)  # write, address, data
HISTORY = 3  # places before a block's first tick in the buffers of codes and loads


@inlined
def last_load_tick(p):
    """The last tick of a frame whose load of V_q is out when the frame ends; fpga.Params."""
    mask = rates.quadrature_mask(p.design, p.quadrature_fast)
    return (
        (p.design.frame_ticks - spi_dac.update_delay_ticks(p.design, p.quadrature_dac, spi_dac.LOAD_TICK, mask + 1))
        & ~mask
    ) - 1


@inlined
def valid_clocks(d):
    """Clocks from the one in which DRDY falls to the one that sees the frame."""
    return 1 + spi_adc.read_clocks(d)


@inlined
def first_channel_clocks(d):
    """Clocks from the one in which DRDY falls to the one that sees the first channel."""
    return 1 + spi_adc.DRDY_TO_CS_CLOCKS + 2 * spi_adc.word_clocks(d)


@inner
def receive(d, old, new, ready, clock):
    """The eight channel registers before `clock`, while a frame whose DRDY fell at `ready` is read word by word."""
    if clock > ready + valid_clocks(d):
        return new
    first, word = ready + first_channel_clocks(d), spi_adc.word_clocks(d)
    if clock < first:
        return old
    return (
        new[0],
        new[1] if clock >= first + word else old[1],
        new[2] if clock >= first + 2 * word else old[2],
        new[3] if clock >= first + 3 * word else old[3],
        new[4] if clock >= first + 4 * word else old[4],
        new[5] if clock >= first + 5 * word else old[5],
        new[6] if clock >= first + 6 * word else old[6],
        new[7] if clock >= first + 7 * word else old[7],
    )


class Window(NamedTuple):
    """The 8 kHz side: its registers, the phase that its word turns, and what the DACs were last told."""

    control: control.State
    bank: registers.State
    dog: watchdog.State
    turn: Turn
    slot: int
    quadrature: int  # code that V_q's DAC will hold when the frame ends


@inner
def _window_inputs(p, sid, old, new, ready, ok, new_ok, valid, clock, stale):
    """What the window sees at the edge `clock`."""
    codes = engine.frame_codes(p, sid.codes, receive(p.design, old, new, ready, clock))
    if p.digital:
        return control.Inputs(codes[0], codes[1], codes[2], codes[3], 0, sid.ok, stale)
    return control.Inputs(codes[0], codes[1], codes[2], codes[3], codes[4], new_ok if clock >= valid else ok, stale)


@inner
def edge(p, s, i, clock, valid, host):
    """The 8 kHz side after the edge `clock`, wired as in fpga_model.top; `host` is (write, address, data)."""
    c, d = s.control, p.design
    if s.slot != 0:
        c = control.step(d, p.control, c, s.slot, i, s.bank)
    slot = s.slot + 1 if 0 < s.slot < SLOTS else 0
    if valid == 1 or (clock % (d.tick_clocks * d.frame_ticks) == 0 and s.dog.stale == 1):
        slot = 1
    return Window(
        c,
        registers.step(d, s.bank, host[0], host[1], host[2], 1 if s.slot == SLOT_SEQUENCER else 0),
        watchdog.step(p.watchdog, s.dog, 1 if clock % d.tick_clocks == 0 else 0, valid),
        change_word(s.turn, clock + 1, c.frequency_tracker.word),
        slot,
        s.quadrature,
    )


@inner
def run_window(d, p, s, i, bank):
    """Control after all slots of a window that began with everything at rest, and the frequency word after SLOT_PI.

    What has nothing to do in a slot is at rest there: CORDIC first, then the sequencer, the loops, root and output.
    """
    s = s._replace(cordic=closed_form_window.rotate(d, s.cordic, cordic.negated(i.drive_cos), i.drive_sin))
    s = s._replace(sequencer=control.step_sequencer(p, s, i, bank))
    s, word = closed_form_window.close_loops(d, p, s, i, bank)
    out = closed_form_window.scale_rate(control.output_params(bank), s.rate_output)
    loop = s.quadrature_loop._replace(root=closed_form_window.root(s.quadrature_loop.root))
    return s._replace(quadrature_loop=loop, rate_output=out), word


@inner
def run_undisturbed(p, s, i, valid):
    """The 8 kHz side after a window of its own, and the frequency word after SLOT_PI; the watchdog is as before."""
    after, word = run_window(p.design, p.control, s.control, i, s.bank)
    turn = change_word(s.turn, valid + SLOT_PI + 1, word)
    turn = change_word(turn, valid + SLOT_WORD + 1, after.frequency_tracker.word)
    bank = registers.step(p.design, s.bank, ZERO, ZERO, ZERO, ONE)
    return Window(after, bank, s.dog, turn, ZERO, s.quadrature), word


@inner
def advance_window(p, s, sid, old, new, ready, ok, new_ok, valid, tick, n, b):
    """At most `n` ticks from `tick` on, until the window has ended; returns the state and the number of ticks.

    A window that nothing disturbs, in ticks that hold it whole, is computed at once; what the DACs take from it changes
    after certain slots.
    """
    clocks, frame_ticks = p.design.tick_clocks, p.design.frame_ticks
    begin = clocks * tick
    count = (valid + SLOTS + 1 - begin + clocks - 1) // clocks
    disturbed = s.slot != 0 or s.dog.stale == 1 or count > n
    if disturbed or valid < begin or valid >= begin + clocks:
        return _advance_by_edge(p, s, sid, old, new, ready, ok, new_ok, valid, tick, n, b)
    i = _window_inputs(p, sid, old, new, ready, ok, new_ok, valid, valid + 1, ZERO)
    c, dog = s.control, s.dog
    window, _ = run_undisturbed(p, s, i, valid)
    after = window.control
    was, now = sequencer.outputs(c.sequencer), sequencer.outputs(after.sequencer)
    amplitudes = (
        agc.amplitude(p.control.agc, c.agc, was.agc_mode),
        agc.amplitude(p.control.agc, c.agc, now.agc_mode),
        agc.amplitude(p.control.agc, after.agc, now.agc_mode),
    )
    quadrature = s.quadrature
    first, last = tick % frame_ticks, last_load_tick(p)
    _, sense_load = path_clocks.loads(p.paths)
    dog = watchdog.step(p.watchdog, dog, 1, 1 if valid == begin else 0)
    if valid > begin:
        dog = watchdog.step(p.watchdog, dog, 0, 1)
    for k in range(count):
        # the last slot whose edge comes before the tick's first, and before that of its load
        slot = begin + clocks * k - 1 - valid
        b.amplitude[k] = amplitudes[0 if slot < SLOT_SEQUENCER else (1 if slot <= SLOT_PI else 2)]
        b.rate[k] = c.rate_loop.loop.y if slot <= SLOT_PI else after.rate_loop.loop.y
        b.control_load[HISTORY + k] = was.dac_init if slot + sense_load < SLOT_SEQUENCER else now.dac_init
        slot += spi_dac.LOAD_TICK
        frame_tick = first + k
        if frame_tick <= last and rates.quadrature_due(p.design, frame_tick, p.quadrature_fast) == 1:
            root_ready = slot >= SLOT_ROOT + isqrt.LATENCY - 1
            quadrature = after.quadrature_loop.root.y if root_ready else c.quadrature_loop.root.y
        if k > 0:
            dog = watchdog.step(p.watchdog, dog, 1, 0)
    return Window(after, window.bank, dog, window.turn, ZERO, quadrature), count


@outlined
def _advance_by_edge(p, s, sid, old, new, ready, ok, new_ok, valid, tick, n, b):
    """As `advance_window`, for any window, edge by edge."""
    clocks, frame_ticks, last = p.design.tick_clocks, p.design.frame_ticks, last_load_tick(p)
    _, sense_load = path_clocks.loads(p.paths)
    for k in range(n):
        if k > 0 and s.slot == 0 and valid // clocks != tick + k:
            return s, k
        frame_tick = (tick + k) % frame_ticks
        b.amplitude[k] = control.amplitude(p.control, s.control)
        b.rate[k] = s.control.rate_loop.loop.y
        for e in range(clocks):
            clock = clocks * (tick + k) + e
            if e == sense_load:
                b.control_load[HISTORY + k] = sequencer.outputs(s.control.sequencer).dac_init
            if e == spi_dac.LOAD_TICK:
                due = rates.quadrature_due(p.design, frame_tick, p.quadrature_fast)
                if due == 1 and frame_tick <= last:
                    s = s._replace(quadrature=s.control.quadrature_loop.root.y)
            i = _window_inputs(p, sid, old, new, ready, ok, new_ok, valid, clock, s.dog.stale)
            s = edge(p, s, i, clock, 1 if clock == valid else 0, NO_HOST)
    return s, n
