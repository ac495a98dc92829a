"""The firmware's 8 kHz side on recorded ADC codes: every word that it must have written, bit for bit, without a plant.

    recorded codes, edge at which each frame is valid --+--> watchdog, register bank, control, DDS phase --> words
    register writes with their edges -------------------'                                              '--> DAC codes

    advance   edge by edge (`window.edge`) where something happens: a write, a stale window, one window cut short
              otherwise from event to event, a window at once (`window.run_undisturbed`)

A row holds what the registers hold before its edge, as in every trace; a DAC code in it is that of the chip's output.
Source    docs/measured.md, docs/architecture.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

import numpy as np

from fpga_model import control, modulator, registers, sequencer, sine, spi_dac, watchdog
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import wrap_unsigned
from fpga_model.jit import hot, inner, outlined
from fpga_model.rates import FRAME_CYCLES, FRAME_TICKS, SLOTS, TICK_CYCLES
from testbench.engines import window
from testbench.engines.pins import SINE_CLOCKS
from testbench.engines.turn import Turn, phase_at
from testbench.engines.window import first_channel_clocks, last_load_tick, valid_clocks
from testbench.errors import ConfigError

WINDOW_WORDS = (
    "amplitude_word",
    "rate_word",
    "quadrature_code",
    "magnitude",
    "phase",
    "state",
    "lock",
    "flags",
    "rate_output",
)
WORDS = (
    "frequency_word",
    *WINDOW_WORDS,
    "agc_acc",
    "pll_acc",
    "ftr_acc",
    "qsc_acc",
    "dac_drv",
    "dac_ftr",
    "dac_qsc",
    "nco_phase",
)
# What the window of a frame left: clock at which its codes were valid (-1: no plain window), then what acts from when
DRIVEN = ("valid", "word_mid", "word", "amplitude_mid", "amplitude", "rate", "quadrature")
CODES = 5  # of a conversion: four demodulators, temperature
FAR = np.int64(1 << 62)
ZERO, ONE = np.int64(0), np.int64(1)
AMPLITUDE, RATE, QUADRATURE = range(3)
ROM = sine.table()  # of the default design, the only one that records are of


class Side(NamedTuple):
    """The 8 kHz side between two edges; integers only."""

    clock: int  # the next edge
    w: window.Window
    old: tuple  # eight channels before, and after, the read whose frame is valid at `valid`
    new: tuple
    valid: int
    ok: int
    conversion: int  # rows of the stimulus done
    write: int


class Stimulus(NamedTuple):
    """What was recorded, int64, sorted by edge; edges count from power-on."""

    codes: np.ndarray  # (conversions, CODES)
    ok: np.ndarray  # (conversions,) status word good
    valid: np.ndarray  # (conversions,) edge at which the firmware sees the frame complete
    writes: np.ndarray  # (writes, 3) edge, address, data


class Rows(NamedTuple):
    """Where a replay writes; `codes` of length zero switches them off, `driven` of length one keeps the last only."""

    words: (
        np.ndarray
    )  # (frames + 1, len(WORDS)) before the first edge of each frame; of the last row the DAC codes only
    driven: np.ndarray  # (frames, len(DRIVEN)) of the window in each frame
    codes: np.ndarray  # (ticks, 2) drive and sense code at the end of each tick


def power_on():
    """The firmware at edge 0."""
    c = control.State()
    word = c.frequency_tracker.word
    zero = (0,) * 8
    w = window.Window(c, registers.State(), watchdog.State(), Turn(0, 0, word, word, 0, word, DEFAULT.dds_bits), 0, 0)
    return Side(0, w, zero, zero, -1, 0, 0, 0)


def phase(s):
    """Phase accumulator before edge s.clock, where no window is in progress."""
    return (s.w.turn.phase + (s.clock - s.w.turn.clock) * s.w.turn.word) % (1 << 48)


def rows(frames, driven=False, ticks=0):
    """Buffers for so many frames."""
    return Rows(
        np.zeros((frames + 1, len(WORDS)), np.int64),
        np.zeros((frames if driven else 1, len(DRIVEN)), np.int64),
        np.zeros((ticks, 2), np.int64),
    )


@inner
def _channels(x, k):
    return (x.codes[k, 0], x.codes[k, 1], x.codes[k, 2], x.codes[k, 3], x.codes[k, 4], ZERO, ZERO, ZERO)


@inner
def _window_inputs(p, s, clock):
    """What a window sees at an edge; channels change word by word while a frame is read."""
    c = window.receive(DEFAULT, s.old, s.new, s.valid - valid_clocks(DEFAULT), clock)
    return control.Inputs(c[0], c[1], c[2], c[3], c[4], s.ok, s.w.dog.stale)


@inner
def _tick_watchdog(p, dog, ticks):
    """The watchdog after `ticks` enables without a frame."""
    age = min(dog.age + ticks, watchdog.AGE_TOP)
    return watchdog.State(age, 1 if ticks > 0 and age > p.limit else dog.stale)


@inner
def _enables(begin, end):
    """Edges in begin .. end - 1 that enable the 1 MHz work."""
    return (end + TICK_CYCLES - 1) // TICK_CYCLES - (begin + TICK_CYCLES - 1) // TICK_CYCLES


@outlined
def _edge(p, s, x, coming, writing):
    """One clock edge of the 8 kHz side."""
    clock = s.clock
    valid = 1 if clock == coming else 0
    host = window.NO_HOST
    if writing == clock:
        host = (ONE, x.writes[s.write, 1], x.writes[s.write, 2])
    w = window.edge(p, s.w, _window_inputs(p, s, clock), clock, valid, host)
    ok = x.ok[s.conversion] if valid else s.ok
    return Side(clock + 1, w, s.old, s.new, s.valid, ok, s.conversion + valid, s.write + host[0])


@inner
def _replace_watchdog(w, dog):
    """The same with another watchdog."""
    return window.Window(w.control, w.bank, dog, w.turn, w.slot, w.quadrature)


@inner
def _run_window(p, s, x, row):
    """A window that nothing disturbs, at once, from the edge that sees its frame valid. Mutates `row`."""
    clock, end = s.clock, s.clock + SLOTS + 1
    i = control.Inputs(s.new[0], s.new[1], s.new[2], s.new[3], s.new[4], x.ok[s.conversion], ZERO)
    w, word = window.run_undisturbed(p, s.w, i, clock)
    row[0] = clock
    row[1] = word
    row[3] = control.agc.amplitude(p.control.agc, s.w.control.agc, sequencer.outputs(w.control.sequencer).agc_mode)
    _store_outputs(p, w.control, row)
    w = _replace_watchdog(w, _tick_watchdog(p.watchdog, watchdog.State(ZERO, ZERO), _enables(clock + 1, end)))
    return Side(end, w, s.old, s.new, s.valid, x.ok[s.conversion], s.conversion + 1, s.write)


@inner
def _store_outputs(p, c, row):
    """What acts after a window. Mutates `row`."""
    row[2] = c.frequency_tracker.word
    row[4] = control.amplitude(p.control, c)
    row[5] = c.rate_loop.loop.y
    row[6] = c.quadrature_loop.root.y


@inner
def _skip_idle(p, s, clock):
    """At a later edge, nothing having happened meanwhile."""
    w = _replace_watchdog(s.w, _tick_watchdog(p.watchdog, s.w.dog, _enables(s.clock, clock)))
    return Side(clock, w, s.old, s.new, s.valid, s.ok, s.conversion, s.write)


@inner
def _read(x, s):
    """The read of the next frame has begun: its words come in one by one."""
    old, k = window.receive(DEFAULT, s.old, s.new, s.valid - valid_clocks(DEFAULT), s.clock), s.conversion
    return Side(s.clock, s.w, old, _channels(x, k), x.valid[k], s.ok, k, s.write)


@inner
def _first_word(coming):
    """Edge at which the first channel of a frame that is valid at `coming` changes."""
    return coming - valid_clocks(DEFAULT) + first_channel_clocks(DEFAULT)


@inner
def _calm(p, s, x, begin, end, until):
    """1 when all that happens from `begin`, where `s` is, to `end` is one window that is over by `until`."""
    k = s.conversion
    if s.clock != begin or s.w.slot != 0 or k >= x.valid.shape[0] or s.w.dog.age + FRAME_TICKS > p.watchdog.limit:
        return False
    if (
        x.valid[k] < begin
        or x.valid[k] + SLOTS >= until
        or (s.write < x.writes.shape[0] and x.writes[s.write, 0] < end)
    ):
        return False
    return k + 1 >= x.valid.shape[0] or _first_word(x.valid[k + 1]) - SLOTS > end


@outlined
def advance(p, s, x, until, plain, row):
    """All edges before `until`; `plain` = 0 forbids windows at once. Mutates `row`, what the last window left."""
    while s.clock < until:
        coming = x.valid[s.conversion] if s.conversion < x.valid.shape[0] else FAR
        writing = x.writes[s.write, 0] if s.write < x.writes.shape[0] else FAR
        if coming != s.valid and s.clock + SLOTS >= _first_word(coming):
            s = _read(x, s)
        if s.w.slot == 0:
            boundary = (s.clock + FRAME_CYCLES - 1) // FRAME_CYCLES * FRAME_CYCLES
            if s.w.dog.stale == 0:
                enable = (s.clock + TICK_CYCLES - 1) // TICK_CYCLES * TICK_CYCLES
                rises = enable + TICK_CYCLES * (p.watchdog.limit - s.w.dog.age)
                boundary = (rises // FRAME_CYCLES + 1) * FRAME_CYCLES
            at = min(until, coming, writing, boundary)
            if coming != s.valid:
                at = min(at, max(_first_word(coming) - SLOTS, s.clock + 1))
            if at > s.clock:
                s = _skip_idle(p, s, at)
                continue
            end = s.clock + SLOTS + 1
            if plain and s.clock == coming and s.w.dog.stale == 0 and writing >= end and until >= end:
                s = _run_window(p, s, x, row)
                continue
        s = _edge(p, s, x, coming, writing)
    return s


@inner
def _sine(p, s, tick, offset):
    """Sine that a modulator takes in `tick`."""
    phase = phase_at(s.w.turn, TICK_CYCLES * tick - SINE_CLOCKS - p.pipe.depth)
    return sine.phase_sine(p.design, ROM, wrap_unsigned(phase + offset, p.design.dds_bits))


@inner
def _drive_code(p, s, tick):
    """Code that the drive modulator makes in `tick`, whose first edge is s.clock."""
    y = _sine(p, s, tick, s.w.bank.phase_drive_sine)
    return modulator.dac_code(p.drive_modulator, control.amplitude(p.control, s.w.control), y)


@inner
def _sense_code(p, s, tick):
    """Code that the sense modulator makes in `tick`, whose first edge is s.clock."""
    y = _sine(p, s, tick, s.w.bank.phase_sense_sine)
    return modulator.dac_code(p.sense_modulator, s.w.control.rate_loop.loop.y, y)


@inner
def _store(row, s):
    c = s.w.control
    row[0] = c.frequency_tracker.word
    row[1] = c.agc.loop.y
    row[2] = c.rate_loop.loop.y
    row[3] = c.quadrature_loop.root.y
    row[4] = c.cordic.magnitude
    row[5] = c.cordic.phase
    row[6] = c.sequencer.state
    row[7] = c.sequencer.lock.locked
    row[8] = c.sequencer.faults.flags
    row[9] = c.rate_output.y
    row[10] = c.agc.loop.acc
    row[11] = c.frequency_tracker.loop.acc
    row[12] = c.rate_loop.loop.acc
    row[13] = c.quadrature_loop.loop.acc
    row[17] = phase_at(s.w.turn, s.clock)


@hot
def run(p, s, x, o, order, plain):
    """Frames from s.clock, a frame boundary, on; returns the side at the end. Mutates `o`.

    order  (3, 2) clock before the end of a frame, and kind, of what a row's DAC codes depend on, in time order
    """
    first = s.clock // FRAME_CYCLES
    lag_drive, lag_sense = p.drive_modulator.frames, 1 + p.sense_modulator.frames
    for n in range(o.words.shape[0] - 1):
        following = o.words[n + 1]
        _store(o.words[n], s)
        begin, end = FRAME_CYCLES * (first + n), FRAME_CYCLES * (first + n + 1)
        driven = o.driven[n] if o.driven.shape[0] > 1 else o.driven[0]
        driven[0] = -1
        driven[1] = s.w.control.frequency_tracker.word
        driven[3] = control.amplitude(p.control, s.w.control)
        _store_outputs(p, s.w.control, driven)
        for k in range(FRAME_TICKS if FRAME_TICKS * n < o.codes.shape[0] else 0):
            tick = FRAME_TICKS * (first + n) + k
            s = advance(p, s, x, TICK_CYCLES * tick, plain, driven)
            at = FRAME_TICKS * n + k
            if at + lag_drive < o.codes.shape[0]:
                o.codes[at + lag_drive, 0] = _drive_code(p, s, tick)
            if at + lag_sense < o.codes.shape[0]:
                o.codes[at + lag_sense, 1] = _sense_code(p, s, tick)
        calm = plain and o.codes.shape[0] == 0 and _calm(p, s, x, begin, end, end - order[0, 0])
        if calm:
            s = _run_window(p, _skip_idle(p, _read(x, s), x.valid[s.conversion]), x, driven)
        for j in range(3):
            until = max(s.clock, end - order[j, 0])
            s = _skip_idle(p, s, until) if calm else advance(p, s, x, until, plain, driven)
            if order[j, 1] == AMPLITUDE:
                following[14] = _drive_code(p, s, s.clock // TICK_CYCLES)
            elif order[j, 1] == RATE:
                following[15] = _sense_code(p, s, s.clock // TICK_CYCLES)
            else:
                following[16] = s.w.control.quadrature_loop.root.y
        s = _skip_idle(p, s, end) if calm else advance(p, s, x, end, plain, driven)
    return s


def order(p):
    """(3, 2): when the codes at a frame's end were decided, in clocks before it, and which (`run`).

    Raises ConfigError for a firmware with a notch or clocks of one path, which a replay does not have.
    """
    if p.control.notch is not None:
        raise ConfigError("firmware.notch_hz: a record cannot be replayed with a notch; set it to 0")
    if p.paths is not None:
        raise ConfigError(
            "firmware.*_sine_registers, *_code_registers: a record cannot be replayed with them; set them to 0"
        )
    ticks = ((1 + p.drive_modulator.frames, AMPLITUDE), (2 + p.sense_modulator.frames, RATE))
    code_decisions = [(TICK_CYCLES * n, kind) for n, kind in ticks]
    code_decisions.append((TICK_CYCLES * (FRAME_TICKS - last_load_tick(p)) - spi_dac.LOAD_TICK, QUADRATURE))
    return np.array(sorted(code_decisions, reverse=True), np.int64)
