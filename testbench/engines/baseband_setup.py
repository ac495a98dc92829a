"""Baseband engine, set-up: what the averaged plant is told of one gyroscope, and what it refuses.

Timing comes from the firmware's constants (slots, latencies, frames) and the plant's tick tables; nothing is fitted.

Source    docs/parts/averaged.md
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analog_frontend.averaged import averaged, averaged_laws, averaged_noise, averaged_sid
from analog_frontend.parts import adc, noise, resonator
from fpga_model import dds, rates, sine
from fpga_model.control import SLOT_PI
from fpga_model.rates import FRAME_TICKS, TICK_CYCLES
from testbench.engines.frame import DRIVE_CLOCK, SENSE_CLOCK
from testbench.engines.pins import REFERENCE_CLOCKS, SINE_CLOCKS
from testbench.engines.window import SLOT_WORD, VALID_CLOCKS
from testbench.errors import ConfigError

FRAME_CLOCKS = FRAME_TICKS * TICK_CYCLES
FRAME_S = 1 / rates.FRAME_HZ
SAMPLED_LATER = 200  # clocks behind the middle of the converter's samples: the two half periods stand around it
JITTER_LIMIT_S = 1e-11
# two or three edges in a frame, never four: three half periods, a tick less, are longer, 150 Hz beside the mode, too
SIDE_BY_SIDE_HZ = (9_500.0, 11_750.0)
# below, an output is continued over more than two frames; above, two edges may come before the word changes
DRIVE_HZ = (3_000.0, 22_000.0)
SPLIT_HZ = 500.0  # 0.4 rad a frame: the cubic of an envelope
RING_LIMIT_HZ = 5.0  # half width of a mode
CORNER_LIMIT_HZ = 100.0  # of the demodulators
CORNER_PART = 1 / 32  # of the drive frequency: a half period is at most 0.2 of RC
RATE_LIMIT_DEG_S = 1000.0


class Setup(NamedTuple):
    """What the baseband engine adds to engine.Params; times in clocks from a frame's first."""

    word0: int
    knots: np.ndarray
    force: np.ndarray  # averaged_noise.table
    sid: averaged_sid.Params
    moments: np.ndarray  # (3, 2) sums of the converter's weights, and their moments about the middle of a frame
    valid: int  # the converter's frame is valid
    drive_volts: float  # F of a DAC per LSB of its word
    drive_lsb_v: float  # of its codes; 0: not rounded
    sense_volts: float
    rc_ticks: float
    rc_frames: float
    clock_s: float
    drive_late: int  # clocks from the phase to the code that a DAC puts out
    sense_late: int
    laws: averaged_laws.Params
    drive_change: int  # clocks from the change of the frequency word to that of the drive's force
    sense_later: tuple  # cos, sin of twice the phase from there to the change of the sense force
    limit: int  # largest distance of the frequency word from word0


def _refuse(key, text):
    raise ConfigError(f'{key}: {text}; scenario.engine = "baseband" cannot run it, "frame" can')


def _mode_hz(table, mode):
    """Frequency (Hz) and half width (Hz) of a mode (0 x, 2 y) in a tick's table."""
    g = table.g_jet[len(table.tick_s) // 2][0]
    a, d = float(g[6 + mode][6 + mode]), float(g[7 + mode][7 + mode])
    product = a * d - float(g[6 + mode][7 + mode]) * float(g[7 + mode][6 + mode])
    tick_s = float(table.tick_s[0])
    turn = math.acos((a + d) / 2 / math.sqrt(product))
    return turn / (2 * math.pi * tick_s), -math.log(product) / 2 / (2 * math.pi * tick_s)


def check(p):
    """ConfigError for what is outside the validity of the averaged plant; engine.Params."""
    a, t = p.plant, p.plant.tables
    if p.fpga.digital:
        _refuse('firmware.board = "digital_sid"', "its demodulator is firmware at 1 MHz")
    if a.adc.period * a.adc.decimation != FRAME_TICKS * adc.TICK_UNITS:
        _refuse("firmware.adc_clock, plant.adc_decimation", "a conversion is not one frame of 125 us")
    for name, part, levels in (("drive", a.drive_dac, a.drive_levels), ("sense", a.sense_dac, a.sense_levels)):
        for field, value in (("bow", part.bow), ("glitch_v_s", part.glitch_v_s)):
            if value:
                _refuse(f"plant.{name}_dac_{field}", f"{value:g} is not 0")
        if levels.on:
            _refuse(
                f"effects.{name}_dac_levels",
                "it is not [], its only value here: a level's error needs the code of every tick",
            )
    for field in ("turnover", "gain_tc_per_k", "memory", "curve"):
        largest = max(map(abs, getattr(a.adc, field)))
        if largest:
            _refuse(f"effects.adc_{field}", f"{largest:g} is not 0, the only value of the averaged plant's converter")
    if (a.switch_tau_s[0] != a.switch_tau_s[1]).any():
        _refuse("plant.sid_fall_s", "it is not 0, its only value here: both edges of a reference must act alike")
    jitter = a.noise.edge_jitter
    if jitter.on and jitter.sigma > JITTER_LIMIT_S:
        _refuse("plant.clock_jitter_s", f"{jitter.sigma:g} s is above {JITTER_LIMIT_S:g} s, what may be left out")
    (fx, wide_x), (fy, wide_y) = _mode_hz(t, 0), _mode_hz(t, 2)
    if not DRIVE_HZ[0] <= fx <= DRIVE_HZ[1]:
        _refuse("plant.fx_hz", f"{fx:g} Hz is outside {DRIVE_HZ[0]:g} .. {DRIVE_HZ[1]:g} Hz")
    if not abs(fy - fx) <= SPLIT_HZ:
        _refuse("plant.fy_hz", f"{fy:g} Hz is more than {SPLIT_HZ:g} Hz from the drive mode")
    for key, wide in (("plant.qx", wide_x), ("plant.qy", wide_y)):
        if not wide <= RING_LIMIT_HZ:
            _refuse(key, f"a half width of {wide:g} Hz is above {RING_LIMIT_HZ:g} Hz")
    corner, limit = 1 / (4 * math.pi * float(t.sid_rc_s[0])), min(CORNER_LIMIT_HZ, CORNER_PART * fx)
    if not corner <= limit:
        _refuse("plant.sid_r_ohm, plant.sid_c_f", f"a corner of {corner:g} Hz is above {limit:g} Hz")


def _lags(p, valid):
    """averaged.Lags of a firmware whose converter's frame is valid at clock `valid` of a frame."""
    t, f = p.plant.tables, p.fpga
    # the first tick whose product takes the words of this window
    changed = next(k for k in range(FRAME_TICKS) if TICK_CYCLES * k - 1 - valid > SLOT_PI)
    code, change = [], []
    for frames_late, clock, carry in (
        (f.drive_modulator.frames, int(DRIVE_CLOCK), t.drive_carry[0]),
        (f.sense_modulator.frames + 1, int(SENSE_CLOCK), t.sense_carry[0]),
    ):
        ticks_late = frames_late + int(carry[clock])
        code.append((SINE_CLOCKS + f.pipe.depth) / TICK_CYCLES + ticks_late)
        change.append(changed + ticks_late + clock / TICK_CYCLES)
    turn = (valid + SLOT_WORD + 1) / TICK_CYCLES
    return averaged.Lags(tuple(code), (int(DRIVE_CLOCK), int(SENSE_CLOCK)), tuple(change), turn)


def _moments(converter):
    """Sum of the three weights of sinc3 and first moment about the mean instant (clocks): (3, 2), and that instant."""
    n = converter.decimation
    m = np.arange(n)
    weights = (m * (m - 1) / 2, (n + m - 1) * (n + m) / 2 - 3 * m * (m - 1) / 2, (n - m) * (n - m + 1) / 2)
    at = m * (converter.period / adc.UNITS_PER_CYCLE)
    middle = float(at.sum()) / n
    return np.array([[w.sum(), (w * (at - middle)).sum()] for w in weights]), middle


def most_edges(drive_hz):
    """Most edges of a demodulator in a frame, and one that waits; 0 where they are two or three."""
    if SIDE_BY_SIDE_HZ[0] <= drive_hz <= SIDE_BY_SIDE_HZ[1]:
        return 0
    half_period_s = 0.5 / (drive_hz + averaged.LIMIT_HZ)
    return math.floor(FRAME_S / half_period_s) + 2


def setup(p):
    """`Setup` of engine.Params; ConfigError for what the averaged plant does not cover."""
    check(p)
    t, converter = p.plant.tables, p.plant.adc
    last = (converter.decimation - 1) * converter.period + converter.delay
    valid = -(-last // adc.UNITS_PER_CYCLE) - FRAME_CLOCKS + VALID_CLOCKS
    if not 0 < valid < FRAME_CLOCKS - 2 * rates.SLOTS:
        _refuse("plant.adc_delay_s", f"a frame of codes is valid {valid} clocks after the frame's begin")
    tick_s = float(t.tick_s[0])
    turns_per_tick = _mode_hz(t, 0)[0] * tick_s
    word0 = round(turns_per_tick / TICK_CYCLES * 2**48)
    tables = averaged.design(t, word0, _lags(p, valid), noise.HOLD, resonator.W_RAD_PER_S)
    changes, turn = tables.change_ticks, valid + SLOT_WORD + 1
    later = 4 * math.pi * turns_per_tick * (changes[1] - changes[0])
    moments, middle = _moments(converter)
    rc_ticks = float(t.sid_rc_s[0]) / tick_s
    inject = p.plant.sid.inject
    charge = np.concatenate([(inject[:3] + inject[3:]) / 2, (inject[:3] - inject[3:]) / 2])
    sid = averaged_sid.Params(
        inverse_rc=1.0 / (rc_ticks * TICK_CYCLES),
        switch=(float(p.plant.switch_tau_s[1, 0]) / tick_s + int(p.plant.switch_carry[1, 0])) * TICK_CYCLES,
        middle=middle,
        sampled=middle + SAMPLED_LATER,
        charge_slope=float(inject[2] - inject[5]) * word0 / 2**48,
        charge=tuple(float(v) for v in charge),
        delay=REFERENCE_CLOCKS + p.fpga.references.align,
        retimed=int(p.fpga.references.retimed),
        edges=most_edges(turns_per_tick / tick_s),
        inverse_noise=1.0 / (noise.HOLD * TICK_CYCLES),
        noise_gain=noise.HOLD / rc_ticks,
    )
    # re-timed edges wait half a tick in the mean
    late = sid.delay + sid.switch + (TICK_CYCLES - 1) / 2 * sid.retimed
    # chords of the sine's table make its amplitude smaller by step^2 / 12
    table_gain = 1.0 - (math.pi / 2 / sine.ROWS) ** 2 / 12
    drive, sense = (
        part.lsb_v * sine.FULL_SCALE * table_gain / 2.0**modulator.shift
        for part, modulator in (
            (p.plant.drive_dac, p.fpga.drive_modulator),
            (p.plant.sense_dac, p.fpga.sense_modulator),
        )
    )
    return Setup(
        word0,
        tables.knots,
        averaged_noise.table(tables.force),
        sid,
        moments,
        valid,
        drive,
        p.plant.drive_dac.lsb_v,
        sense,
        rc_ticks,
        rc_ticks / FRAME_TICKS,
        tick_s / TICK_CYCLES,
        TICK_CYCLES * (1 + p.fpga.drive_modulator.frames) + SINE_CLOCKS + p.fpga.pipe.depth,
        TICK_CYCLES * (2 + p.fpga.sense_modulator.frames) + SINE_CLOCKS + p.fpga.pipe.depth,
        averaged_laws.design(p.plant.effects, p.plant.laws, averaged_laws.reference_turns(late, word0)),
        round(TICK_CYCLES * changes[0]) - turn,
        (math.cos(later), math.sin(later)),
        dds.word_of_hz(averaged.LIMIT_HZ),
    )
