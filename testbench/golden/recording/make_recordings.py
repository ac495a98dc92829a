"""Recordings that vectors of the whole firmware replay: python -m testbench.golden.recording.make_recordings [NAME ...]

    reset          all states of the sequencer in a few frames, host writes at every place, resets in the middle of
                   everything; codes of `story`, so no closed loop of its own
    registers      every bit of every word of the host where its block shows it (`registers_case`); codes of `story`
    story          analog SID: power-on, search, lock, rate steps, a rate beyond full scale, four faults, safe state
    story_digital  SID in the FPGA: power-on to lock, rate steps, saturation
    power_on       the default firmware and gyroscope from power-on to lock

`story` and `story_digital` are of a gyroscope and firmware made to be quick: demodulator poles at 306 Hz, four times
the drive force, less quadrature, modes 417 Hz apart, loops and times to match. What the plant computes in floating
point is done here, once; the files are part of the repository.
Source  docs/golden.md (recordings)
"""

import hashlib
import math
import sys
from typing import NamedTuple

import numpy as np

from fpga_model import (
    agc,
    delay,
    digital_sid,
    fault_monitor,
    frequency_tracker,
    lock_monitor,
    quadrature_loop,
    rate_loop,
    references,
    registers,
    sequencer,
    top,
)
from fpga_model.fault_monitor import CODE
from fpga_model.fixed import signed_bits
from fpga_model.rates import FRAME_CYCLES, FRAME_HZ, FRAME_TICKS
from testbench import config
from testbench.engines import engine
from testbench.errors import FileError
from testbench.flatten import leaves, names
from testbench.golden.recording import recording, registers_case, replay_recording
from testbench.golden.recording.recording import Recording, Window
from testbench.golden.stimulus.writer import Random
from testbench.run import build
from testbench.run.simulate import build_faults

DEG = math.pi / 180
TEMP_DEGC = 25.0
POLE_HZ = 306.0
FORCE = 4.0
SPLIT = 3.0
STILL_FRAMES = 8
QUICK = {
    "plant.sid_c_f": 26e-9,
    "plant.k_vf_drive_n_per_v": FORCE * 2.72e-7,
    "plant.fy_hz": 11002.3 - SPLIT * 139.0,
    "plant.kxy_n_per_m": 0.012,
    "firmware.phase_drive_ref_deg": 0.05,
    "firmware.phase_sense_ref_deg": -0.04,
    "firmware.phase_drive_sine_deg": 0.03,
    "firmware.phase_sense_sine_deg": -0.02,
}
WINDOW_CLOCKS = 160  # clocks of a window: 8 kHz work, and the DAC frames that follow
BEFORE = 10


class Case(NamedTuple):
    """A closed loop to be recorded; times in frames.

    config    a configuration, or changes of the default one
    firmware  function from the configuration to the parameters of the FPGA
    rate_dps  (first frame, deg/s), each in force until the next
    writes    (frame, register, raw)
    faults    (first frame, last frame, kind, channel, value) as in a scenario
    """

    config: object
    firmware: object
    frames: int
    row_every: int
    rate_dps: tuple = ((0, 0.0),)
    writes: tuple = ()
    faults: tuple = ()


def quick_firmware(settings):
    """The firmware of `settings` with loops and times for the quick gyroscope."""
    p, n = build.firmware(settings), build.nominal(settings)
    code_v = n["code_v_per_deg_s"] / SPLIT

    def frames(**count):
        return {f"{name}_s": k / FRAME_HZ for name, k in count.items()}

    locks = frames(agc_in=16, agc_out=40, pll_in=16, pll_out=40, ftr_in=24, ftr_out=60, qsc_in=24, qsc_out=60)
    loops = p.control._replace(
        agc=agc.design(20.0, 4.0, plant_fs_per_s=n["plant_fs_per_s"] * FORCE),
        frequency_tracker=frequency_tracker.design(30.0, 6.0),
        rate_loop=rate_loop.design(40.0, 300.0, code_v, n["adc_sense_v"], n["word_v_per_deg_s"]),
        quadrature_loop=quadrature_loop.design(6.0, code_v, n["adc_sense_v"], n["null_deg_per_s"], n["null_v"]),
        sequencer=sequencer.design(
            **frames(power_up=6, init=4, kick=12, decay=30, search=80, retune=24, timeout=600, offline=12, recover=6),
            lock=lock_monitor.design(
                **locks, ftr_in_deg_s=15.0, qsc_in_deg_s=15.0, code_per_deg_s=code_v / n["adc_sense_v"] * 2**23
            ),
            # the codes of the digital demodulator are filtered, and rest
            faults=fault_monitor.design(**frames(over_range=4, stuck=0 if p.digital else 8, drive=8, rate=8, rail=20)),
        ),
    )
    return p._replace(control=loops, sid=digital_sid.design(POLE_HZ)._replace(still=STILL_FRAMES * FRAME_TICKS))


RATES = ((0, 0.0), (540, 300.0), (600, -300.0), (660, 0.0), (700, 1500.0), (750, 0.0))
FULL = (1 << 23) - 1
CASES = {
    "story": Case(
        config=QUICK,
        firmware=quick_firmware,
        frames=1000,
        row_every=1,
        rate_dps=RATES,
        writes=(
            (300, "rate_bias", 1234),
            (301, "rate_scale_t1", -4321),
            (302, "rate_bias_t2", 77),
            (303, "decimation", 2),
            (530, "control", sequencer.RUN | sequencer.HOLD_QSC),
            (536, "control", sequencer.RUN),
            (780, "rate_fixed", -100_000),
            (781, "control", sequencer.RUN | sequencer.FIX_FTR),
            (790, "control", sequencer.RUN),
            (822, "fault_clear", fault_monitor.ALL),
            (834, "fault_clear", fault_monitor.OVER_RANGE),
            (852, "fault_clear", fault_monitor.STALE),
            (880, "control", sequencer.RUN | sequencer.CLEAR_FAULTS),
            (882, "control", sequencer.RUN),
            (985, "amplitude_fixed", 2_000_000),
            (986, "control", sequencer.RUN | sequencer.OPEN_DRIVE),
            (994, "control", 0),
        ),
        faults=(
            (820, 827, "adc_over_range", "sense_sin", 1),
            # every bit of a status word at both values
            (840, 842, "adc_bad_status", "adc", 0x43A5C6),
            (843, 845, "adc_bad_status", "adc", 0x4C5A39),
            (860, 873, "adc_stuck", "drive_cos", 1000),
            (890, 909, "adc_silent", "adc", 0),
        ),
    ),
    "story_digital": Case(
        config={**QUICK, "firmware.board": "digital_sid"},
        firmware=quick_firmware,
        frames=800,
        row_every=1,
        rate_dps=RATES,
        writes=((400, "decimation", 1), (790, "control", 0)),
        faults=((762, 775, "sample_frozen", "y", 0),),
    ),
    "power_on": Case(config={}, firmware=build.firmware, frames=9400, row_every=50),
}


def _level(points, frame):
    """Value in force of ((first, value), ...)."""
    return [value for first, value in points if first <= frame][-1]


def record_closed_loop(name, case, progress=None):
    """Run a case tick by tick; `Recording` without windows."""
    settings = case.config
    if not isinstance(settings, config.Config):
        settings = config.changed(config.Config(), settings)
    params = build.params(settings, TEMP_DEGC, TEMP_DEGC)._replace(fpga=case.firmware(settings))
    d = params.fpga.design
    state = engine.reset(params, TEMP_DEGC)
    streams, temp = engine.streams(), np.full(2, TEMP_DEGC)
    pending = [(k, *write) for k, write in enumerate(build.register_writes(settings))]
    pending += [(frame * d.frame_ticks, *write) for frame, *write in case.writes]
    adc, host, sar, closed = [], [], [], hashlib.sha256()
    for tick in range(case.frames * d.frame_ticks):
        frame = tick // d.frame_ticks
        if tick % d.frame_ticks == 0:
            row = np.array([int(value) for _, value in leaves(state.fpga)], "<i8")
            closed.update(row.tobytes())
            rate = np.full(2, _level(case.rate_dps, frame) * DEG)
            faults = build_faults([f[2:] for f in case.faults if f[0] <= frame <= f[1]])
            if progress:
                progress(name, frame, case.frames)
        write = (0, 0, 0)
        if pending and pending[0][0] == tick:
            _, register, raw = pending.pop(0)
            entry = registers.BY_NAME[register]
            write = (1, entry.address, registers.to_bus(int(raw), entry.fmt))
            host.append((tick * d.tick_clocks, 0, *write[1:]))
        sar.append((int(state.plant.sar[0]), int(state.plant.sar[1])))
        ends = -1 if faults.silent else state.drdy_cycle
        state = engine.run(params, state, 1, rate, temp, write, faults, streams)
        if ends >= 0:
            words = [int(word) for word in state.chips.adc.result]
            codes = [word - (1 << 24) if word >> 23 else word for word in words[1:]]
            adc.append((tick * d.tick_clocks + ends, words[0], *codes))
    stimulus = replay_recording.Stimulus(
        np.array(adc, np.int64),
        np.array(host, np.int64).reshape(-1, 4),
        np.array(sar if params.fpga.digital else np.zeros((0, 2)), np.int64),
    )
    return Recording(name, params.fpga, case.frames, case.row_every, stimulus, (), closed.hexdigest())


# ---- the case `reset` ------------------------------------------------------------------------------------------------

RESET_FRAMES, RESET_FROM, RESET_SEED = 72, 620, 2026
WILD = (14, 17)  # frames with random codes: the drive lock is lost, then a search fails
# Where a reset hits: clock within a frame, and what it interrupts
RESETS = (
    (27, 1, "reset in the frames of the DACs"),
    (28, 33, "reset two clocks long"),
    (28, 34, ""),
    (29, FRAME_CYCLES + 50, "reset while the ADC is read"),
    (31, 700, "reset in the 8 kHz work"),
    (32, 2000, "reset between"),
)

# After the last reset: control words from a frame on, and frames in which the words that they fix change
HOLDS = sequencer.HOLD_AGC | sequencer.HOLD_PLL | sequencer.HOLD_FTR | sequencer.HOLD_QSC
FIXES = sequencer.FIX_FTR | sequencer.FIX_QSC
CONTROLS = (
    (36, sequencer.RUN | sequencer.OPEN_DRIVE),
    (39, sequencer.RUN | sequencer.OPEN_DRIVE | FIXES),
    (44, sequencer.RUN | FIXES),
    (62, sequencer.RUN),
    (66, sequencer.RUN | HOLDS),
    (69, sequencer.RUN | sequencer.CLEAR_FAULTS),
    (70, 0),
)
FIXED = range(37, 63)


def _reset_clocks(frame_clocks):
    """[(clock, what it interrupts)] of RESETS in frames of so many clocks."""
    return [
        (frame * frame_clocks + (at if at < FRAME_CYCLES else at - FRAME_CYCLES + frame_clocks), what)
        for frame, at, what in RESETS
    ]


def _fixed_words(random, frame_clocks):
    """Host writes of CONTROLS, and of a random word to every register they put in force, in each frame of FIXED."""
    host_writes = [(frame * frame_clocks + 100, 0, 0, control) for frame, control in CONTROLS]
    excluded_registers = {"control", "fault_clear", "amplitude_setpoint", "frequency_fixed"}
    for frame in FIXED:
        for k, register in enumerate(r for r in registers.WRITABLE if r.name not in excluded_registers):
            clock = frame * frame_clocks + 400 + 150 * k + random.draw_integer(150)
            word = random.raw(register.fmt)
            host_writes.append((clock, 0, register.address, registers.to_bus(word, register.fmt)))
    return {row[0]: row for row in host_writes}


def reset_case(story, firmware=None):
    """Recording of the case `reset`, from the locked part of the story.

    firmware  of another design: with it the sequencer keeps the limits of the story, which its codes meet
    """
    q = story.params.control.sequencer
    p = story.params
    if firmware is not None:
        board_sequencer = firmware.control.sequencer
        q = q._replace(gain=board_sequencer.gain, search_limit=board_sequencer.search_limit)
        p = firmware
    frame_clocks = p.design.frame_clocks
    quick = registers_case.in_single_frames(q)._replace(search_limit=q.search_limit // 16)
    params = p._replace(
        quadrature_fast=1,
        pipe=delay.design(3),
        references=references.design(2, False),
        sense_modulator=p.sense_modulator._replace(frames=2),
        control=p.control._replace(sequencer=quick._replace(faults=quick.faults._replace(rail=1))),
    )
    adc = story.stimulus.adc.copy()
    adc[:, 0] -= RESET_FROM * FRAME_CYCLES
    adc = adc[(adc[:, 0] >= 0) & (adc[:, 0] < RESET_FRAMES * FRAME_CYCLES)]
    adc[:, 0] = adc[:, 0] * frame_clocks // FRAME_CYCLES
    random = Random(RESET_SEED)
    for frame in WILD:
        adc[frame, 2:6] = [random.raw(signed_bits(23)) for _ in range(4)]
    adc[:, 7:] = [[random.raw(CODE) for _ in row] for row in adc[:, 7:]]  # channels that the board does not use
    heat = Random(RESET_SEED + 1)
    adc[:, 6] = [heat.raw(CODE) for _ in adc]  # temperatures that no board has
    host = {}
    for write_number in range(256):
        # every address that exists, several times, with bits above its register; the clocks fall everywhere
        clock = 200 + random.draw_integer(26 * frame_clocks - 200)
        address = write_number % 24 if write_number < 240 else 24 + random.draw_integer(232)
        if address != 0 and address not in (6, 7):  # RUN, set-point and frequency stay: the walk goes on
            host[clock] = (clock, 0, address, random.draw_integer(1 << 48))
    for clock, _ in _reset_clocks(frame_clocks):
        host[clock] = (clock, 1, 0, 0)
    host |= _fixed_words(random, frame_clocks)
    rows = np.array([host[clock] for clock in sorted(host)], np.int64)
    stimulus = replay_recording.Stimulus(adc, rows, np.zeros((0, 2), np.int64))
    return Recording("reset", params, RESET_FRAMES, 1, stimulus, (), "")


# ---- windows ---------------------------------------------------------------------------------------------------------


def merge_windows(windows, end):
    """Windows in order, cut to 0 .. end, those that touch made one."""
    out = []
    for w in sorted(windows):
        first, last = max(w.first, 0), min(w.first + w.count, end)
        if out and first <= out[-1].first + out[-1].count:
            before = out.pop()
            shows = before.shows if not w.shows or w.shows in before.shows else f"{before.shows}; {w.shows}"
            first, last = before.first, max(last, before.first + before.count)
        else:
            shows = w.shows
        out.append(Window(first, last - first, shows[:128]))
    return tuple(out)


def find_windows(r):
    """What is worth every clock of a recording, found by replaying it."""
    frame_clocks = r.params.design.frame_clocks
    dense = frame_clocks if r.name == "reset" else WINDOW_CLOCKS
    starts = np.arange(r.frames) * frame_clocks
    rows = replay_recording.run(r.params, r.stimulus, r.frames, starts)
    column = {name: rows.registers[:, k] for k, name in enumerate(names(top.State()))}
    state, lock = column["control.sequencer.state"], column["control.sequencer.lock.locked"]
    flags, word = column["control.sequencer.faults.flags"], column["control.rate_loop.loop.y"]
    windows = [Window(0, dense, "power-on")]

    def work(frame, shows):
        opens = int(rows.window_at[frame])
        windows.append(Window((opens if opens >= 0 else int(starts[frame])) - BEFORE, WINDOW_CLOCKS, shows))

    def changes(values, text, most=16):
        for frame in np.flatnonzero(np.diff(values))[:most].tolist():
            work(frame, text(int(values[frame]), int(values[frame + 1])))

    changes(state, lambda a, b: f"{sequencer.STATES[a]} to {sequencer.STATES[b]}", most=64)
    changes(lock, lambda a, b: f"lock {a:04b} to {b:04b}")
    changes(flags, lambda a, b: f"flags {a:02x} to {b:02x}")
    init = np.flatnonzero(state == sequencer.INIT)
    if len(init):
        windows.append(Window(int(starts[init[0]]), WINDOW_CLOCKS, "control words of the DACs"))
    locked = np.flatnonzero(state == sequencer.LOCKED)
    if len(locked) and len(r.stimulus.adc):
        ends = r.stimulus.adc[:, 0]
        ends = int(ends[ends > starts[locked[0]]][0])
        windows.append(Window(ends - BEFORE, 520 + WINDOW_CLOCKS, "ADC read while locked"))
    railed = np.flatnonzero(np.isin(word, (r.params.control.rate_loop.loop.lo, r.params.control.rate_loop.loop.hi)))
    if len(railed):
        work(int(railed[0]) - 1, "rate word reaches its limit")
    for clock, reset, address, _ in r.stimulus.host.tolist():
        if reset:
            shows = [what for at, what in _reset_clocks(frame_clocks) if at == clock and what]
            windows.append(Window(clock - BEFORE, WINDOW_CLOCKS, shows[0] if shows else ""))
        elif address == registers.BY_NAME["control"].address:
            windows.append(Window(clock - 4, 16, "host write"))
    return merge_windows(windows, r.frames * frame_clocks)


def is_current(r):
    """Whether today's firmware, given the recorded inputs, does what that of the closed loop did."""
    rows = replay_recording.run(r.params, r.stimulus, r.frames, np.arange(r.frames) * r.params.design.frame_clocks)
    return hashlib.sha256(rows.registers.astype("<i8").tobytes()).hexdigest() == r.closed


OF_STORY = {"reset": reset_case, "registers": registers_case.case}


def make(name, progress=None):
    """`Recording` of a case, with its windows; raises FileError if it would be made of an old story."""
    if name in OF_STORY:
        story = recording.load("story")
        if not is_current(story):
            raise FileError(f"{name}: made from the recording story, which is of another firmware; record story first")
        r = OF_STORY[name](story)
    else:
        r = record_closed_loop(name, CASES[name], progress)
    return r._replace(windows=find_windows(r))


def main(chosen):
    """Record the named cases, or all of them, into the package; with --windows only find their windows again."""

    def progress(name, completed_frames, total):
        if completed_frames % 100 == 0:
            print(f"{name}: frame {completed_frames} of {total}", flush=True)

    again = "--windows" in chosen
    names_chosen = [name for name in chosen if name != "--windows"] or [*CASES, *OF_STORY]
    for name in sorted(names_chosen, key=lambda name: name in OF_STORY):  # the story first
        if again:
            r = recording.load(name)
            r = r._replace(windows=find_windows(r))
        else:
            r = make(name, progress)
        recording.save(r)
        rows = sum(w.count for w in r.windows)
        print(f"{name}: {r.frames} frames, {len(r.windows)} windows of {rows} clocks, {recording.sha256(r)[:16]}")


if __name__ == "__main__":
    main(sys.argv[1:])
