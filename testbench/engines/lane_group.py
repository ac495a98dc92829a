"""Eight gyroscopes in arrays, and the compiled loop that moves them from event to event; see lanes.py.

    blocks of all eight   up to the nearest event of any of them     block_state.ticks_to_event
        each              words, codes, edges                        block_state.advance_control, words_of_ticks
        all together      plants, converters                         side_by_side_top.advance_lanes, _convert_ticks
        each              frames that the converter has completed    block_state.after_ticks
    before and after      clocked ticks, gyroscope by gyroscope      frame.enter_block_mode, exit_block_mode

Source    docs/architecture.md, docs/decisions/0012-lanes.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend import linear
from analog_frontend import top as plant
from analog_frontend.effects import law
from analog_frontend.lanes import side_by_side, side_by_side_adc, side_by_side_top
from analog_frontend.lanes.side_by_side import MOVING, STILL
from analog_frontend.numeric.arena import float64_at, int32_at, int64_at, record_layout
from analog_frontend.numeric.records import unpack_record
from analog_frontend.numeric.shapes import doubles, int64s
from analog_frontend.numeric.vector import LANES, load, store
from analog_frontend.parts import adc, dac, propagator, sid
from fpga_model import control, digital_sid, registers, watchdog
from fpga_model import top as fpga
from fpga_model.jit import hot, inlined, outlined
from testbench.engines import engine, pins
from testbench.engines.block_state import (
    BlockState,
    advance_control,
    after_ticks,
    await_frame,
    codes_at,
    history,
    load_block_state,
    ticks_to_event,
    words_of_ticks,
)
from testbench.engines.frame import build_arrival, enter_block_mode, exit_block_mode
from testbench.engines.turn import Turn
from testbench.engines.window import HISTORY, Window
from testbench.flatten import leaves
from testbench.flatten import store as store_row

FAR = np.int64(1 << 62)
DRIVE, SENSE = plant.DRIVE, plant.SENSE
RATE, STIFFNESS, TEMP = range(3)
MOVING_ENTRY_COUNT = len(MOVING)
COLUMNS, TRUTHS = len(engine.FRAME_COLUMNS), len(engine.TRUTH_COLUMNS)


class Part(NamedTuple):
    """What is constant of one gyroscope and is read one by one; numbers only."""

    fpga: fpga.Params
    adc: adc.Params
    drive_dac: dac.Params
    sense_dac: dac.Params
    quad_lsb_v: float
    temp_lo_degc: float
    temp_step_k: float
    temp_count: int


class GroupChunk(NamedTuple):
    """What a chunk is told and where it writes, for eight, as engine.Chunk; tables of any number of temperatures."""

    begin: int
    moving: np.ndarray  # (8, knots, 6, len(MOVING)) jets of the entries that follow rate and coupling
    still: np.ndarray  # (8, knots, STILL) the other entries
    knots: np.ndarray  # (8, knots, 3) driver pole (s), k_q, k_xy
    rate_rad_s: np.ndarray  # (8, frames)
    temp_degc: np.ndarray
    streams_at: np.ndarray  # (8, 4) addresses of the streams: codes of drive and sense (int32), rows of both kinds
    code_ticks: np.ndarray  # (8,) length of the first two
    rows: np.ndarray  # (8,) length of the others
    peak_x: np.ndarray  # (8,)
    frame_ticks: int
    rom: np.ndarray


def _empty_block_state():
    s = Window(control.State(), registers.State(), watchdog.State(), Turn(0, 0, 0, 0, 0, 0, 0), 0, 0)
    eight_zeros = (0,) * 8
    return BlockState(digital_sid.State(), s, 0, 0, 0, 0, 0, 0, 0, eight_zeros, eight_zeros, 0, 0, 0, 0)


BLOCK_STATE = _empty_block_state()
BLOCK_STATE_COUNT = sum(1 for _ in leaves(BLOCK_STATE))
SID = sum(1 for _ in leaves(BLOCK_STATE.sid))
# a row begins with what only a window changes
HEAD = sum(1 for part in (BLOCK_STATE.sid, BLOCK_STATE.s.control, BLOCK_STATE.s.bank) for _ in leaves(part))
FAULTS = engine.Faults()
ROOM = linear.BLOCK + HISTORY


class Group(NamedTuple):
    """Eight gyroscopes in arrays, most of them with a first axis of eight; behind those of their plants."""

    jet: doubles(propagator.JETS * MOVING_ENTRY_COUNT * LANES)  # jets at each one's temperature, lanes side by side
    now: doubles(3 * LANES)  # rate, stiffness, temperature that the matrix was made for, lanes side by side
    block_states: int64s(LANES, BLOCK_STATE_COUNT)  # rows of BlockState
    faults: int64s(LANES, sum(1 for _ in leaves(FAULTS)))  # rows of engine.Faults
    amplitude: int64s(LANES, ROOM)  # buffers of pins.py
    rate: int64s(LANES, ROOM)
    control_load: int64s(LANES, ROOM)
    drive: int64s(LANES, ROOM)
    sense: int64s(LANES, ROOM)
    refs: int64s(LANES, ROOM)
    sar: int64s(LANES, 2, ROOM)
    drive_codes: int64s(LANES, linear.BLOCK)
    sense_codes: int64s(LANES, linear.BLOCK)
    buffered_ticks: int64s(LANES)  # ticks of a block whose words a window has left in the buffers
    acting: int64s(LANES, 2, 2)  # codes: put out now, put out from the next tick on
    late_area: doubles(LANES, 2)
    entered: int64s(LANES)  # tick
    exit_tick: int64s(LANES)  # tick, or -1
    ends: int64s(LANES)  # where the chunk ends; -1 for a place without a gyroscope
    z: doubles(LANES, plant.STATES)  # states of those that have not entered or have left
    caps: doubles(LANES, plant.DEMODULATORS, sid.CAPACITORS)


AT = record_layout(Group, side_by_side_adc.AT.sizes)
opened = AT.opened


# ---- one gyroscope of a group --------------------------------------------------------------------------------------


@inlined
def _buffers(q, v, k):
    """The buffers of one of the eight."""
    return pins.Buffers(
        q.amplitude[k], q.rate[k], q.control_load[k], q.drive[k], q.sense[k], q.refs[k], q.sar[k], v.edges[k]
    )


@outlined
def _interpolate_plant(c, floats, ints, p, k, temp_degc):
    """Jets and fixed entries of one plant at a temperature. Mutates both arrays."""
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    index, weight = 0, 0.0
    if p.temp_count > 1:
        index, weight = propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)
    after = min(index + 1, p.temp_count - 1)
    for j in range(propagator.JETS):
        for e in range(MOVING_ENTRY_COUNT):
            a = c.moving[k, index, j, e]
            q.jet[(j * MOVING_ENTRY_COUNT + e) * LANES + k] = a + weight * (c.moving[k, after, j, e] - a)
    for e in range(STILL):
        a = c.still[k, index, e]
        v.g[e * LANES + k] = a + weight * (c.still[k, after, e] - a)
    a = c.knots[k, index, 0]
    v.driver_s[k] = a + weight * (c.knots[k, after, 0] - a)


@inlined
def _retune_plant(c, floats, ints, p, k, rate_rad_s, quad_code, temp_degc):
    """Rate, coupling and temperature of one plant's next frame; 1 if its matrix changes. Mutates both arrays."""
    q = opened(floats, ints)
    volts = quad_code * p.quad_lsb_v
    kq = plant.interpolate_scalar(p, c.knots[k, :, 1], temp_degc)
    stiffness = plant.interpolate_scalar(p, c.knots[k, :, 2], temp_degc) - kq * (volts * volts)
    temp_changed = q.now[TEMP * LANES + k] != temp_degc
    motion_unchanged = q.now[RATE * LANES + k] == rate_rad_s and q.now[STIFFNESS * LANES + k] == stiffness
    if not temp_changed and motion_unchanged:
        return 0
    q.now[RATE * LANES + k] = rate_rad_s
    q.now[STIFFNESS * LANES + k] = stiffness
    q.now[TEMP * LANES + k] = temp_degc
    if temp_changed:
        _interpolate_plant(c, floats, ints, p, k, temp_degc)
    return 1


@outlined
def _combine_matrices(floats, ints):
    """The moving entries of all eight matrices, as `propagator.combine`. Mutates them."""
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    o, s = load(q.now, RATE * LANES), load(q.now, STIFFNESS * LANES)
    size = MOVING_ENTRY_COUNT * LANES
    for e in range(MOVING_ENTRY_COUNT):
        at = e * LANES
        small = (s * s) * load(q.jet, at + 5 * size) + (o * s) * load(q.jet, at + 4 * size)
        small = small + (o * o) * load(q.jet, at + 3 * size)
        matrix_entry = load(q.jet, at) + (o * load(q.jet, at + size) + (s * load(q.jet, at + 2 * size) + small))
        store(v.g, side_by_side.AT_MODES + at, matrix_entry)


@outlined
def _compute_law_gains(floats, ints, tick, frame_ticks):
    """What the laws of all eight come to in the frame of `tick`. Mutates them."""
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    for k in range(LANES):
        force, cv = v.law_counts[k, 0], v.law_counts[k, 1]
        if force or cv:
            rate, temp = q.now[RATE * LANES + k], q.now[TEMP * LANES + k]
            t_s = (tick // frame_ticks) * frame_ticks * v.h_s[k]
            table, numbers = v.law_tables[k], v.law_numbers[k]
            law.gains(force, cv, v.law_temps[k], table, numbers, rate, temp, t_s, v.law_gains[k])


@outlined
def _begin_frame(part, parts_i, parts_f, floats, ints, c, k, tick):
    """A frame of one gyroscope begins: its matrix, and its row. 1 if the matrix changes. Mutates the streams of `c`."""
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    p, g = unpack_record(part, parts_i[k], parts_f[k]), unpack_record(BLOCK_STATE, q.block_states[k], parts_f[k])
    faults = unpack_record(FAULTS, q.faults[k], parts_f[k])
    n = tick // c.frame_ticks - c.begin // c.frame_ticks
    rate_rad_s, temp_degc = c.rate_rad_s[k, n], c.temp_degc[k, n]
    v_q = faults.dac_code[2] if faults.dac[2] else g.s.quadrature
    changed = _retune_plant(c, floats, ints, p, k, rate_rad_s, v_q, temp_degc)
    row = n if c.begin % c.frame_ticks == 0 else n - 1
    if row < c.rows[k]:
        z = q.z[k]
        for i in range(plant.X, plant.VY + 1):
            z[i] = v.z[i * LANES + k]
        codes = codes_at(p.fpga, g, tick)
        frames = int64_at(c.streams_at[k, 2] + 8 * COLUMNS * row, COLUMNS)
        truth = float64_at(c.streams_at[k, 3] + 8 * TRUTHS * row, TRUTHS)
        drive, sense, quadrature = g.drive_code, g.sense_code, g.s.quadrature
        engine.record_frame(frames, truth, g.s.control, codes, drive, sense, quadrature, z, temp_degc, rate_rad_s)
    return changed


@inlined
def _store_dac_codes(v, q, k, which, part, carry, codes, n):
    """Codes of one DAC of one plant for a block: what acts at each tick, and the glitches. Mutates `v`, `q`."""
    v.codes[which * LANES + k] = q.acting[k, which, 0]
    new = 1
    if carry:
        v.codes[(2 + which) * LANES + k] = q.acting[k, which, 1]
        new = 2
    for t in range(n):
        v.codes[(2 * (new + t) + which) * LANES + k] = codes[t]
    if not carry:
        v.codes[(2 * (n + 1) + which) * LANES + k] = codes[n - 1]
    if v.flags[side_by_side.GLITCHES]:
        old = q.acting[k, which, 1]
        v.throws[which * LANES + k] = 0.0
        for t in range(n):
            throw = dac.glitch(part, old, codes[t])
            old = codes[t]
            at = t + 1 if carry else t
            if at < n:
                v.throws[(2 * at + which) * LANES + k] = throw
            else:
                q.late_area[k, which] = throw
    q.acting[k, which, 0] = v.codes[(2 * n + which) * LANES + k]
    q.acting[k, which, 1] = codes[n - 1]


@outlined
def _load_lane_state(part, parts_i, parts_f, floats, ints, c, k):
    """A gyroscope enters: its matrix, linear states and capacitors into the registers of eight. Mutates both arrays."""
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    side_by_side_adc.enter(side_by_side_adc.opened(floats, ints), k)
    _interpolate_plant(c, floats, ints, unpack_record(part, parts_i[k], parts_f[k]), k, q.now[TEMP * LANES + k])
    v.peak[k] = 0.0
    for which in range(2):
        v.late_area[which * LANES + k] = q.late_area[k, which]
        q.late_area[k, which] = 0.0
    for i in range(plant.STATES):
        v.z[i * LANES + k] = q.z[k, i]
    for d in range(plant.DEMODULATORS):
        ref = v.switch[k, d]
        v.sign[d * LANES + k] = 1.0 if ref else -1.0
        for i in range(3):
            at = (3 * d + i) * LANES + k
            v.on[at] = q.caps[k, d, i if ref else 3 + i]
            v.off[at] = q.caps[k, d, 3 + i if ref else i]


@outlined
def _unload_lane_state(floats, ints, k):
    """A gyroscope leaves: the reverse of `_load_lane_state`. Mutates both arrays."""
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    for i in range(plant.STATES):
        q.z[k, i] = v.z[i * LANES + k]
    for d in range(plant.DEMODULATORS):
        ref = v.switch[k, d]
        for i in range(3):
            at = (3 * d + i) * LANES + k
            q.caps[k, d, i if ref else 3 + i] = v.on[at]
            q.caps[k, d, 3 + i if ref else i] = v.off[at]
    side_by_side_adc.unpack_lane_sums(side_by_side_adc.opened(floats, ints), k)
    q.late_area[k, DRIVE] = v.late_area[k]
    q.late_area[k, SENSE] = v.late_area[LANES + k]


# ---- the blocks ----------------------------------------------------------------------------------------------------


@outlined
def _nearest(part, parts_i, parts_f, floats, ints, tick):
    """The tick of the nearest event of any of the eight, FAR when all have left. Mutates `exit_tick`."""
    a, q = side_by_side_adc.opened(floats, ints), opened(floats, ints)
    until = FAR
    for k in range(LANES):
        if tick < q.entered[k]:
            until = min(until, q.entered[k])
        elif q.exit_tick[k] < 0:
            p = unpack_record(part, parts_i[k], parts_f[k])
            g = unpack_record(BLOCK_STATE, q.block_states[k], parts_f[k])
            faults = unpack_record(FAULTS, q.faults[k], parts_f[k])
            lane_event_tick = ticks_to_event(p.fpga.design, p.adc, a.clock[k], faults.silent, g, tick, q.ends[k])
            if lane_event_tick == tick:
                q.exit_tick[k] = tick
            else:
                until = min(until, lane_event_tick)
    return until


@outlined
def _advance_lane_control(part, parts_i, parts_f, floats, ints, k, tick, n):
    """The 8 kHz side of one gyroscope in a block, if it has work there. Mutates both arrays."""
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    p, g = unpack_record(part, parts_i[k], parts_f[k]), unpack_record(BLOCK_STATE, q.block_states[k], parts_f[k])
    q.buffered_ticks[k] = 0
    if await_frame(p.fpga, g, tick):
        s, _, window_ticks = advance_control(p.fpga, g, tick, n, q.sar[k, :, 0], _buffers(q, v, k))
        store_row(q.block_states[k, SID:], s)
        q.buffered_ticks[k] = window_ticks


@outlined
def _write_words(part, parts_i, parts_f, floats, ints, c, k, tick, n):
    """One gyroscope's codes and edges for a block of `n` ticks. Mutates both arrays."""
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    p = unpack_record(part, parts_i[k], parts_f[k])
    g = unpack_record(BLOCK_STATE, q.block_states[k], parts_f[k])
    faults = unpack_record(FAULTS, q.faults[k], parts_f[k])
    drive_codes, sense_codes = q.drive_codes[k], q.sense_codes[k]
    b = _buffers(q, v, k)
    g, count = words_of_ticks(
        p.fpga, c.rom, g, g.s, g.sid, q.buffered_ticks[k], faults, tick, n, drive_codes, sense_codes, b
    )
    store_row(q.block_states[k, HEAD:], (g.s[2:], g[2:]))
    v.edge_counts[k] = count
    _store_dac_codes(v, q, k, DRIVE, p.drive_dac, v.carry[k] == 1.0, drive_codes, n)
    _store_dac_codes(v, q, k, SENSE, p.sense_dac, v.carry[2 * LANES + k] == 1.0, sense_codes, n)


@outlined
def _convert_ticks(part, parts_i, parts_f, floats, ints, n):
    """All converters over a block of `n` ticks: adc.convert_block's result is in `fell`. Mutates both arrays."""
    v, a, q = side_by_side.opened(floats, ints), side_by_side_adc.opened(floats, ints), opened(floats, ints)
    first = LANES
    for k in range(LANES):
        a.sensor_v[k] = adc.temperature_volts(q.now[TEMP * LANES + k])
        if v.active[k]:
            first = min(first, k)
    if side_by_side_adc.in_step(a, v.active):
        side_by_side_adc.convert_lanes(floats, ints, unpack_record(part, parts_i[first], parts_f[first]).adc, first, n)
    else:
        for k in range(LANES):
            if v.active[k]:
                side_by_side_adc.gather_plant_outputs(a, v.out, k, n)
                side_by_side_adc.unpack_lane_sums(a, k)
                p = unpack_record(part, parts_i[k], parts_f[k]).adc
                a.fell[k] = adc.convert_block(p, a.clock[k], a.lane_sums[k], a.row, n, a.sensor_v[k])
                side_by_side_adc.enter(a, k)


@outlined
def _hear(part, parts_i, parts_f, floats, ints, k, tick, until):
    """What the firmware of one gyroscope has read in a block. Mutates both arrays."""
    v, a, q = side_by_side.opened(floats, ints), side_by_side_adc.opened(floats, ints), opened(floats, ints)
    g = unpack_record(BLOCK_STATE, q.block_states[k], parts_f[k])
    faults = unpack_record(FAULTS, q.faults[k], parts_f[k])
    d = unpack_record(part, parts_i[k], parts_f[k]).fpga.design
    g = after_ticks(d, g, faults, a.clock[k], tick, until, a.fell[k], g.sid)
    store_row(q.block_states[k, HEAD:], (g.s[2:], g[2:]))
    if v.flags[side_by_side.GLITCHES]:
        for which in range(2):
            v.late_area[which * LANES + k] = v.late_area[which * LANES + k] - q.late_area[k, which]
            q.late_area[k, which] = 0.0


@outlined
def _record_codes(c, floats, ints, k, row, n):
    """The codes of a block into their streams."""
    q = opened(floats, ints)
    size = c.code_ticks[k]
    if row + n <= size:
        drive, sense = int32_at(c.streams_at[k, 0], size), int32_at(c.streams_at[k, 1], size)
        for t in range(n):
            drive[row + t] = q.drive_codes[k, t]
            sense[row + t] = q.sense_codes[k, t]


@hot
def run_lane_blocks(part, effect, parts_i, parts_f, floats, ints, c):
    """All blocks of a chunk: from each one's `entered` to its last quiet tick, which becomes `exit_tick`.

    part, effect  Kind of a Part and of an effects.Params. Mutates both arrays and the streams of `c`
    """
    v, q = side_by_side.opened(floats, ints), opened(floats, ints)
    tick = FAR
    for k in range(LANES):
        tick = min(tick, q.entered[k])
    while tick < FAR:
        changed = 0
        for k in range(LANES):
            if q.entered[k] == tick and q.exit_tick[k] < 0:
                _load_lane_state(part, parts_i, parts_f, floats, ints, c, k)
                changed += 1
        until = _nearest(part, parts_i, parts_f, floats, ints, tick)
        n, busy = until - tick, 0
        for k in range(LANES):
            v.edge_counts[k] = 0
            v.active[k] = 1 if q.entered[k] <= tick and q.exit_tick[k] < 0 else 0
            if v.active[k]:
                if tick % c.frame_ticks == 0:
                    changed += _begin_frame(part, parts_i, parts_f, floats, ints, c, k, tick)
                _advance_lane_control(part, parts_i, parts_f, floats, ints, k, tick, n)
                busy += 1
            elif q.exit_tick[k] == tick and q.entered[k] < tick:
                _unload_lane_state(floats, ints, k)
                c.peak_x[k] = v.peak[k]
        for k in range(LANES):
            if v.active[k]:
                _write_words(part, parts_i, parts_f, floats, ints, c, k, tick, n)
                _record_codes(c, floats, ints, k, tick - c.begin, n)
        if changed:
            _combine_matrices(floats, ints)
        if v.flags[side_by_side.LAWS] and (changed or tick % c.frame_ticks == 0):
            _compute_law_gains(floats, ints, tick, c.frame_ticks)
        if busy:
            side_by_side_top.advance_lanes(effect, floats, ints, tick, n)
            _convert_ticks(part, parts_i, parts_f, floats, ints, n)
        for k in range(LANES):
            if v.active[k]:
                _hear(part, parts_i, parts_f, floats, ints, k, tick, until)
        tick = until


@hot
def enter_lane(p, f, chips, a, chunk, end, drdy_cycle, row, b):
    """Clocked ticks up to the blocks; what is carried from there goes into `row`, the last codes into `b`."""
    f, chips, drdy_cycle, tick = enter_block_mode(p, f, chips, a, chunk, end, drdy_cycle)
    if tick < end:
        store_row(row, load_block_state(p.fpga, f, chips, tick, drdy_cycle))
        history(f, b)
    return f, chips, drdy_cycle, tick


@hot
def leave_lane(p, f, chips, a, chunk, end, row, tick, now):
    """From the end of the blocks to that of the chunk. `now`: rate, stiffness and temperature of the present frame."""
    plant.tune(p.plant, a, now[RATE], now[STIFFNESS], now[TEMP])
    g = unpack_record(BLOCK_STATE, row, now)
    return exit_block_mode(p, build_arrival(p.fpga.design, f, chips, g, tick, chunk.faults.status), a, chunk, end)
