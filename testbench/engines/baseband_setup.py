"""Baseband engine, set-up: what the averaged plant is told of one gyroscope, and what it refuses.

Timing comes from the firmware's constants (slots, latencies, frames) and the plant's tick tables; nothing is fitted.

Source    docs/plant.md
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analog_frontend.averaged import averaged, averaged_laws, averaged_modes, averaged_noise, averaged_sid
from analog_frontend.parts import adc, noise, resonator
from fpga_model import rates, sine, spi_dac
from fpga_model.control import SLOT_PI
from fpga_model.path_clocks import dac_clocks
from testbench.engines.pins import REFERENCE_CLOCKS, SINE_CLOCKS
from testbench.engines.turn import WIDEST
from testbench.engines.window import SLOT_WORD, last_load_tick, valid_clocks
from testbench.errors import ConfigError

SAMPLED_LATER = 4 / 65  # of a frame behind the middle of the converter's samples: two half periods stand around it
JITTER_LIMIT_S = 1e-11
# Limits in turns a frame: Hz at 8 kHz.
# two or three edges in a frame, never four, and one of them behind `SAMPLED_LATER`, 150 Hz beside the mode, too
SIDE_BY_SIDE = (1.1875, 1.46875)  # 9500 .. 11750 Hz
# below, an output is continued over more than two frames; above, two edges may come before the word changes
DRIVE = (0.375, 2.75)  # 3 .. 22 kHz
DRIVE_TICK = 0.022  # turns a tick, 22 kHz at 1 MHz: an edge is carried by a small angle
SPLIT = 0.0625  # 500 Hz, 0.4 rad: the cubic of an envelope
RING = 0.000625  # 5 Hz, half width of a mode
CORNER = 0.0125  # 100 Hz, of the demodulators
LEAST_UNROUNDED_CODE = 1 << 18  # codes of the sense DAC: those of 20 bits are not rounded
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
    sense_lsb_v: float
    rc_ticks: float
    rc_frames: float
    clock_s: float
    drive_delay_clocks: int  # clocks from the phase to the code that a DAC puts out
    sense_delay_clocks: int
    laws: averaged_laws.Params
    drive_change: int  # clocks from the change of the frequency word to that of the drive's force
    sense_later: tuple  # cos, sin of twice the phase from there to the change of the sense force
    limit: int  # largest distance of the frequency word from word0
    frame_clocks: int
    turn_clock: int  # the frequency word changes
    turn_ticks: float
    rad_per_word: float  # phase of a tick per frequency word (turns / 2^48)
    batch_mask: int  # frames whose noise is drawn at once, a power of two, less 1
    batch_samples: int
    frame_samples: float


def _reject(key, text):
    raise ConfigError(f'{key}: {text}; scenario.engine = "baseband" cannot run it; use "frame"')


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
    a, t, d = p.plant, p.plant.tables, p.fpga.design
    if p.fpga.digital:
        _reject('firmware.board = "digital_sid"', "its demodulator is firmware at 1 MHz")
    if p.fpga.paths is not None:
        _reject("firmware.*_sine_registers, *_code_registers", "they are not 0, the only value that it supports")
    if a.adc.period * a.adc.decimation != d.frame_ticks * a.adc.tick_units:
        _reject("firmware.adc_clock, plant.adc_decimation", f"a conversion is not one frame of {1e6 / d.frame_hz:g} us")
    for name, part, levels in (("drive", a.drive_dac, a.drive_levels), ("sense", a.sense_dac, a.sense_levels)):
        for field, value in (("bow", part.bow), ("glitch_v_s", part.glitch_v_s)):
            if value:
                _reject(f"plant.{name}_dac_{field}", f"{value:g} is not 0")
        if levels.on:
            _reject(
                f"effects.{name}_dac_levels",
                "it is not [], the only value that it supports: a level's error needs the code of every tick",
            )
    for field in ("turnover", "gain_tc_per_k", "memory", "curve"):
        largest = max(map(abs, getattr(a.adc, field)))
        if largest:
            _reject(f"effects.adc_{field}", f"{largest:g} is not 0, the only value of the averaged plant's converter")
    if (a.switch_tau_s[0] != a.switch_tau_s[1]).any():
        _reject(
            "plant.sid_fall_s",
            "it is not 0, the only value that it supports: both edges of a reference must act equally",
        )
    jitter = a.noise.edge_jitter
    if jitter.on and jitter.sigma > JITTER_LIMIT_S:
        _reject(
            "plant.clock_jitter_s",
            f"{jitter.sigma:g} s is above {JITTER_LIMIT_S:g} s, the largest jitter that it may neglect",
        )
    (fx, wide_x), (fy, wide_y) = _mode_hz(t, 0), _mode_hz(t, 2)
    lo, hi = drive_hz(d, _valid(p) + SLOT_WORD + 1)
    if not lo <= fx <= hi:
        _reject("plant.fx_hz", f"{fx:g} Hz is outside {lo:g} .. {hi:g} Hz")
    if not abs(fy - fx) <= SPLIT * d.frame_hz:
        _reject("plant.fy_hz", f"{fy:g} Hz is more than {SPLIT * d.frame_hz:g} Hz from the drive mode")
    for key, wide in (("plant.qx", wide_x), ("plant.qy", wide_y)):
        if not wide <= RING * d.frame_hz:
            _reject(key, f"a half width of {wide:g} Hz is above {RING * d.frame_hz:g} Hz")
    corner, limit = 1 / (4 * math.pi * float(t.sid_rc_s[0])), min(CORNER * d.frame_hz, CORNER_PART * fx)
    if not corner <= limit:
        _reject("plant.sid_r_ohm, plant.sid_c_f", f"a corner of {corner:g} Hz is above {limit:g} Hz")


def drive_hz(d, turn_clock):
    """Least and largest frequency (Hz) of the drive mode in a design whose word changes at this clock of a frame."""
    one_edge = d.master_hz / (2 * turn_clock) - averaged.LIMIT_TURNS * d.frame_hz
    return DRIVE[0] * d.frame_hz, min(DRIVE[1] * d.frame_hz, DRIVE_TICK * d.tick_hz, one_edge)


def _valid(p):
    """Clock of a frame at which the converter's codes are valid; ConfigError if the window does not fit behind it."""
    converter, clocks = p.plant.adc, p.fpga.design.frame_clocks
    last = (converter.decimation - 1) * converter.period + converter.delay
    valid = -(-last // adc.UNITS_PER_CYCLE) - clocks + valid_clocks(p.fpga.design)
    # the last load of V_q of the frame takes what the window has left
    loaded = p.fpga.design.tick_clocks * last_load_tick(p.fpga)
    if not 0 < valid < min(clocks - 2 * rates.SLOTS, loaded - rates.SLOTS):
        _reject("plant.adc_delay_s", f"a frame of codes is valid {valid} clocks after the start of the frame")
    return valid


def _dac_delay_ticks(f):
    """Ticks by which the outputs of both DACs follow their loads; fpga.Params."""
    return tuple(spi_dac.update_delay_ticks(f.design, part, spi_dac.LOAD_TICK) for part in (f.drive_dac, f.sense_dac))


def _lags(p, valid):
    """averaged.Lags of a firmware whose converter's frame is valid at clock `valid` of a frame."""
    t, f, d = p.plant.tables, p.fpga, p.fpga.design
    drive_clock, sense_clock = dac_clocks(f)
    dac_delay_ticks = _dac_delay_ticks(f)
    # the first tick whose product takes the words of this window
    changed = next(k for k in range(d.frame_ticks) if d.tick_clocks * k - 1 - valid > SLOT_PI)
    code, change = [], []
    for code_delay_ticks, clock, carry in (
        (f.drive_modulator.frames + dac_delay_ticks[0], drive_clock, t.drive_carry[0]),
        (f.sense_modulator.frames + dac_delay_ticks[1], sense_clock, t.sense_carry[0]),
    ):
        output_ticks = code_delay_ticks + int(carry[clock])
        code.append((SINE_CLOCKS + f.pipe.depth) / d.tick_clocks + output_ticks)
        change.append(changed + output_ticks + clock / d.tick_clocks)
    turn = (valid + SLOT_WORD + 1) / d.tick_clocks
    return averaged.Lags(
        d.tick_clocks, d.frame_ticks, d.frame_hz, tuple(code), (drive_clock, sense_clock), tuple(change), turn
    )


def _moments(converter):
    """Sum of the three weights of sinc3 and first moment about the mean instant (clocks): (3, 2), and that instant.

    Third, half the mean square of the distance from there: what a curve adds to the sums of all three together.
    """
    n = converter.decimation
    m = np.arange(n)
    weights = (m * (m - 1) / 2, (n + m - 1) * (n + m) / 2 - 3 * m * (m - 1) / 2, (n - m) * (n - m + 1) / 2)
    at = m * (converter.period / adc.UNITS_PER_CYCLE)
    middle = float(at.sum()) / n
    spread = float((sum(weights) * (at - middle) ** 2).sum()) / (2 * n**3)
    return np.array([[w.sum(), (w * (at - middle)).sum()] for w in weights]), middle, spread


def most_edges(d, drive_hz):
    """Most edges of a demodulator in a frame of a design, and one that waits; 0 where they are two or three."""
    turns, tick = drive_hz / d.frame_hz, 1 / d.frame_ticks
    least, most = (0.5 / (turns + s * averaged.LIMIT_TURNS) for s in (1, -1))  # half periods, in frames
    if SIDE_BY_SIDE[0] <= turns <= SIDE_BY_SIDE[1] and 3 * least - tick > 1 > 0.5 + SAMPLED_LATER + most + tick:
        return 0
    return math.floor((1 + tick) / least) + 2


def setup(p):
    """`Setup` of engine.Params; ConfigError for what the averaged plant does not cover."""
    check(p)
    t, f, d = p.plant.tables, p.fpga, p.fpga.design
    valid = _valid(p)
    tick_s = float(t.tick_s[0])
    turns_per_tick = _mode_hz(t, 0)[0] * tick_s
    word0 = round(turns_per_tick / d.tick_clocks * 2**WIDEST)
    lags = _lags(p, valid)
    tables = averaged.design(t, word0, lags, noise.HOLD, resonator.W_RAD_PER_S)
    changes, turn = tables.change_ticks, valid + SLOT_WORD + 1
    later = 4 * math.pi * turns_per_tick * (changes[1] - changes[0])
    moments, middle, spread = _moments(p.plant.adc)
    rc_ticks = float(t.sid_rc_s[0]) / tick_s
    sid = _demodulators(p, word0, turns_per_tick / tick_s, middle, spread)
    # re-timed edges wait half a tick in the mean
    edge_lag_clocks = sid.delay + sid.switch + (d.tick_clocks - 1) / 2 * sid.retimed
    # chords of the sine's table make its amplitude smaller by step^2 / 12
    table_gain = 1.0 - (math.pi / 2 / (1 << d.sine_address_bits)) ** 2 / 12
    drive, sense = (
        part.lsb_v * sine.OUT.for_design(d).hi * table_gain / 2.0**modulator.shift
        for part, modulator in ((p.plant.drive_dac, f.drive_modulator), (p.plant.sense_dac, f.sense_modulator))
    )
    drive_delay_clocks, sense_delay_clocks = (
        d.tick_clocks * (1 + modulator.frames + ticks) + SINE_CLOCKS + f.pipe.depth
        for modulator, ticks in zip((f.drive_modulator, f.sense_modulator), _dac_delay_ticks(f))
    )
    force = averaged_noise.table(tables.force)
    frames, samples = averaged_noise.batch(force, d.frame_ticks)
    return Setup(
        word0,
        tables.knots,
        force,
        sid,
        moments,
        valid,
        drive,
        p.plant.drive_dac.lsb_v,
        sense,
        p.plant.sense_dac.lsb_v if f.sense_modulator.hi < LEAST_UNROUNDED_CODE else 0.0,
        rc_ticks,
        rc_ticks / d.frame_ticks,
        tick_s / d.tick_clocks,
        drive_delay_clocks,
        sense_delay_clocks,
        averaged_laws.design(
            p.plant.effects, p.plant.laws, averaged_laws.reference_turns(edge_lag_clocks, word0), d.tick_clocks * word0
        ),
        round(d.tick_clocks * changes[0]) - turn,
        (math.cos(later), math.sin(later)),
        round(averaged.LIMIT_TURNS * d.frame_hz * 2**WIDEST / d.master_hz),
        d.frame_clocks,
        turn,
        lags.turn_ticks,
        d.tick_clocks * averaged_modes.RAD_PER_LSB,
        frames - 1,
        samples,
        d.frame_ticks / noise.HOLD,
    )


def _demodulators(p, word0, drive_hz, middle, spread):
    """averaged_sid.Params; `middle`, `spread` of the converter's samples (clocks)."""
    t, d, references = p.plant.tables, p.fpga.design, p.fpga.references
    tick_s, inject = float(t.tick_s[0]), p.plant.sid.inject
    rc_ticks = float(t.sid_rc_s[0]) / tick_s
    charge = np.concatenate([(inject[:3] + inject[3:]) / 2, (inject[:3] - inject[3:]) / 2])
    return averaged_sid.Params(
        rc=rc_ticks * d.tick_clocks,
        inverse_rc=1.0 / (rc_ticks * d.tick_clocks),
        steeper=1.0 + averaged_sid.droop(1.0 / (2.0 * drive_hz * float(t.sid_rc_s[0]))),
        switch=(float(p.plant.switch_tau_s[1, 0]) / tick_s + int(p.plant.switch_carry[1, 0])) * d.tick_clocks,
        middle=middle,
        spread=spread,
        sampled=middle + SAMPLED_LATER * d.frame_clocks,
        charge_slope=float(inject[2] - inject[5]) * word0 / 2**WIDEST,
        charge=tuple(float(v) for v in charge),
        delay=REFERENCE_CLOCKS + references.align,
        retimed=int(references.retimed),
        edges=most_edges(d, drive_hz),
        inverse_noise=1.0 / (noise.HOLD * d.tick_clocks),
        noise_gain=noise.HOLD / rc_ticks,
        frame_clocks=float(d.frame_clocks),
        inverse_frame=1.0 / d.frame_clocks,
        tick_clocks=float(d.tick_clocks),
        inverse_tick=1.0 / d.tick_clocks,
    )
