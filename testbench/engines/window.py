"""The 8 kHz window for the frame engine: the firmware's own slots, computed when somebody looks at what they change.

    DRDY ---- read of the ADC, word by word ---- valid ---- slots 1 .. SLOTS ---- rest
                                                   ^ or the watchdog's stale, at ce_8k

`play` walks a window tick by tick and leaves what the DACs take from it; `received` says what a read has brought.
Source    docs/architecture.md, docs/blocks/control.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

import numpy as np

from fpga_model import (
    agc,
    control,
    cordic,
    isqrt,
    quadrature_loop,
    rate_output,
    registers,
    sequencer,
    spi_adc,
    spi_dac,
    watchdog,
)
from fpga_model.control import SLOT_PI
from fpga_model.jit import inner, outlined
from fpga_model.rates import FRAME_TICKS, SLOT_CORDIC, SLOT_ROOT, SLOT_SEQUENCER, SLOTS, TICK_CYCLES
from testbench.engines import at_once, engine
from testbench.engines.turn import Turn, turned

SLOT_WORD = SLOT_PI + 2  # after it the frequency word holds what the loop has found
VALID_CLOCKS = 1 + spi_adc.READ_CYCLES  # from the clock in which DRDY falls to the one that sees the frame
WORD_CLOCKS = 2 * spi_adc.WORD_BITS
FIRST_CHANNEL_CLOCKS = VALID_CLOCKS - spi_adc.CHANNELS * WORD_CLOCKS + WORD_CLOCKS
LAST_ODD_TICK = FRAME_TICKS - 2  # the last load of V_q that is out when the frame ends
ZERO = np.int64(0)  # typed: Numba compiles a function anew for every constant that it is called with
HISTORY = 3  # places before a block's first tick in the buffers of codes and loads


@inner
def received(old, new, ready, clock):
    """The eight channel registers before `clock`, while a frame whose DRDY fell at `ready` is read word by word."""
    if clock > ready + VALID_CLOCKS:
        return new
    first = ready + FIRST_CHANNEL_CLOCKS
    if clock < first:
        return old
    return (
        new[0],
        new[1] if clock >= first + WORD_CLOCKS else old[1],
        new[2] if clock >= first + 2 * WORD_CLOCKS else old[2],
        new[3] if clock >= first + 3 * WORD_CLOCKS else old[3],
        new[4] if clock >= first + 4 * WORD_CLOCKS else old[4],
        new[5] if clock >= first + 5 * WORD_CLOCKS else old[5],
        new[6] if clock >= first + 6 * WORD_CLOCKS else old[6],
        new[7] if clock >= first + 7 * WORD_CLOCKS else old[7],
    )


class Window(NamedTuple):
    """The 8 kHz side: its registers, the phase that its word turns, and what the DACs were last told."""

    control: control.State
    bank: registers.State
    dog: watchdog.State
    turn: Turn
    slot: int
    restarted: int  # a new window began before the last one had ended: nothing in it is at rest
    quadrature: int  # code that V_q's DAC will hold when the frame ends


@outlined
def _steps(p, s, slot, clocks, i, bank):
    """`clocks` edges from `slot` on, of a window that began with everything at rest; the same as that many `step`.

    Most slots move one block only: SLOT_CORDIC .. SLOT_SEQUENCER - 1 the CORDIC, those behind SLOT_ROOT the square root
    and the rate output. Returns also the frequency word after SLOT_PI, where a new centre shows before the loop does.
    """
    k, end = slot, slot + clocks
    word = s.frequency_tracker.word
    while k < end:
        if k < SLOT_SEQUENCER:
            c = s.cordic
            while k < min(end, SLOT_SEQUENCER):
                c = cordic.step(c, 1 if k == SLOT_CORDIC else 0, cordic.negated(i.drive_cos), i.drive_sin)
                k += 1
            s = control.State(c, s.agc, s.frequency_tracker, s.rate_loop, s.quadrature_loop, s.rate_output, s.sequencer)
        elif k <= SLOT_ROOT:
            s = control.step(p, s, k, i, bank) if k == SLOT_SEQUENCER else control.loops(p, s, k, i, bank)
            if k <= SLOT_PI:
                word = s.frequency_tracker.word
            k += 1
        else:
            loop, root, out = s.quadrature_loop, s.quadrature_loop.root, s.rate_output
            r = control.output_params(bank)
            while k < end:
                root = isqrt.step(root, 0, 0)
                out = rate_output.step(r, out, 0, 0, 0)
                k += 1
            s = control.State(
                s.cordic,
                s.agc,
                s.frequency_tracker,
                s.rate_loop,
                quadrature_loop.State(loop.error, loop.loop, root),
                out,
                s.sequencer,
            )
    return s, word


@inner
def _inputs(p, sid_codes, old, new, ready, ok, new_ok, valid, clock, stale):
    """What the window sees at the edge `clock`."""
    codes = engine.frame_codes(p, sid_codes, received(old, new, ready, clock))
    if p.digital:
        return control.Inputs(codes[0], codes[1], codes[2], codes[3], 0, 1, stale)
    return control.Inputs(codes[0], codes[1], codes[2], codes[3], codes[4], new_ok if clock >= valid else ok, stale)


@inner
def _caught_up(p, c, bank, turn, first, count, clock, restarted, i):
    """Control, register bank and turn after `count` slots from `first` on, whose first edge is `clock`."""
    if restarted:
        for k in range(first, first + count):
            c = control.step(p.control, c, k, i, bank)
            turn = turned(turn, clock + k - first + 1, c.frequency_tracker.word)
    else:
        c, word = _steps(p.control, c, first, count, i, bank)
        turn = turned(turn, clock + SLOT_PI - first + 1, word)
        turn = turned(turn, clock + SLOT_WORD - first + 1, c.frequency_tracker.word)
    if first <= SLOT_SEQUENCER < first + count:
        bank = registers.step(bank, 0, 0, 0, 1)
    return c, bank, turn


@inner
def whole(p, s, i, bank):
    """Control after all slots of a window that began with everything at rest, and the frequency word after SLOT_PI.

    What has nothing to do in a slot is at rest there: CORDIC first, then the sequencer, the loops, root and output.
    """
    c = at_once.rotated(s.cordic, cordic.negated(i.drive_cos), i.drive_sin)
    s = control.State(c, s.agc, s.frequency_tracker, s.rate_loop, s.quadrature_loop, s.rate_output, s.sequencer)
    after = control.sequenced(p, s, i, bank)
    s = control.State(c, s.agc, s.frequency_tracker, s.rate_loop, s.quadrature_loop, s.rate_output, after)
    s, word = at_once.looped(p, s, i, bank)
    out = at_once.scaled(control.output_params(bank), s.rate_output)
    loop = s.quadrature_loop
    loop = quadrature_loop.State(loop.error, loop.loop, at_once.rooted(loop.root))
    return control.State(c, s.agc, s.frequency_tracker, s.rate_loop, loop, out, s.sequencer), word


@inner
def play(p, s, sid_codes, old, new, ready, ok, new_ok, valid, tick, n, b):
    """At most `n` ticks from `tick` on, until the window has ended; returns the state and the number of ticks.

    A window that nothing disturbs, in ticks that hold it whole, is computed at once; what the DACs take from it changes
    after certain slots.
    """
    begin = TICK_CYCLES * tick
    count = (valid + SLOTS + 1 - begin + TICK_CYCLES - 1) // TICK_CYCLES
    disturbed = s.slot != 0 or s.dog.stale == 1 or count > n
    if disturbed or valid < begin or valid >= begin + TICK_CYCLES:
        return _played(p, s, sid_codes, old, new, ready, ok, new_ok, valid, tick, n, b)
    i = _inputs(p, sid_codes, old, new, ready, ok, new_ok, valid, valid + 1, ZERO)
    c, bank, dog = s.control, s.bank, s.dog
    after, word = whole(p.control, c, i, bank)
    was, now = sequencer.outputs(c.sequencer), sequencer.outputs(after.sequencer)
    amplitudes = (
        agc.amplitude(p.control.agc, c.agc, was.agc_mode),
        agc.amplitude(p.control.agc, c.agc, now.agc_mode),
        agc.amplitude(p.control.agc, after.agc, now.agc_mode),
    )
    quadrature = s.quadrature
    dog = watchdog.step(p.watchdog, dog, 1, 1 if valid == begin else 0)
    if valid > begin:
        dog = watchdog.step(p.watchdog, dog, 0, 1)
    for k in range(count):
        # the last slot whose edge comes before the tick's first, and before that of its load
        slot = begin + TICK_CYCLES * k - 1 - valid
        b.amplitude[k] = amplitudes[0 if slot < SLOT_SEQUENCER else (1 if slot <= SLOT_PI else 2)]
        b.rate[k] = c.rate_loop.loop.y if slot <= SLOT_PI else after.rate_loop.loop.y
        slot += spi_dac.LOAD_TICK
        b.control_load[HISTORY + k] = was.dac_init if slot < SLOT_SEQUENCER else now.dac_init
        frame_tick = (tick + k) % FRAME_TICKS
        if frame_tick <= LAST_ODD_TICK and (p.quadrature_fast == 1 or frame_tick & 1 == 1):
            done = slot >= SLOT_ROOT + isqrt.LATENCY - 1
            quadrature = after.quadrature_loop.root.y if done else c.quadrature_loop.root.y
        if k > 0:
            dog = watchdog.step(p.watchdog, dog, 1, 0)
    turn = turned(s.turn, valid + SLOT_PI + 1, word)
    turn = turned(turn, valid + SLOT_WORD + 1, after.frequency_tracker.word)
    return Window(after, registers.step(bank, 0, 0, 0, 1), dog, turn, ZERO, ZERO, quadrature), count


@outlined
def _played(p, s, sid_codes, old, new, ready, ok, new_ok, valid, tick, n, b):
    """As `play`, for any window.

    Goes from one edge at which a register of the window is taken, or a window starts, to the next. The slots in between
    wait, `behind` of them from `since` on, until a taken register depends on them.
    """
    c, bank, dog, turn, slot, restarted, quadrature = s
    since, behind = slot, 0
    begin, end = TICK_CYCLES * tick, TICK_CYCLES * (tick + n)
    clock = begin
    while True:
        k, e = (clock - begin) // TICK_CYCLES, (clock - begin) % TICK_CYCLES
        frame_tick = (tick + k) % FRAME_TICKS
        finished = clock == end or (e == 0 and k > 0 and slot == 0 and valid // TICK_CYCLES != tick + k)
        go = clock == valid or (e == 0 and frame_tick == 0 and dog.stale == 1)
        later = watchdog.step(p.watchdog, dog, 1 if e == 0 else 0, 1 if clock == valid else 0)
        loading = e == spi_dac.LOAD_TICK
        # where a read overlaps the window, and in a window that cut another short, every clock is taken by itself
        alone = restarted == 1 or ready <= clock <= valid or go or later.stale != dog.stale
        last = since + behind - 1
        if behind > 0:
            words = (e == 0 or loading) and since <= SLOT_ROOT and last >= SLOT_SEQUENCER
            root = loading and last > SLOT_ROOT
            if finished or alone or slot == 0 or words or root:
                i = _inputs(p, sid_codes, old, new, ready, ok, new_ok, valid, clock - behind, dog.stale)
                c, bank, turn = _caught_up(p, c, bank, turn, since, behind, clock - behind, restarted, i)
                behind = 0
        if finished:
            return Window(c, bank, dog, turn, slot, restarted, quadrature), k
        if e == 0:
            b.amplitude[k] = control.amplitude(p.control, c)
            b.rate[k] = c.rate_loop.loop.y
        elif loading:
            b.control_load[HISTORY + k] = sequencer.outputs(c.sequencer).dac_init
            if frame_tick <= LAST_ODD_TICK and (p.quadrature_fast == 1 or frame_tick & 1 == 1):
                quadrature = c.quadrature_loop.root.y
        until = clock + 1
        if not alone:
            until = clock + (spi_dac.LOAD_TICK - e if e < spi_dac.LOAD_TICK else TICK_CYCLES - e)
            if slot != 0:
                until = min(until, clock + SLOTS - slot + 1)
            if clock < valid:
                until = min(until, valid)
        if slot != 0:
            if alone:
                i = _inputs(p, sid_codes, old, new, ready, ok, new_ok, valid, clock, dog.stale)
                c, bank, turn = _caught_up(p, c, bank, turn, slot, 1, clock, restarted, i)
            else:
                since = slot if behind == 0 else since
                behind += until - clock
            slot += until - clock
            slot = 0 if slot > SLOTS else slot
        if go:
            restarted = 1 if slot != 0 else 0
            slot = 1
        dog = later
        clock = until
