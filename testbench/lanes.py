"""Lanes engine: gyroscopes side by side, eight in the registers of one core, with the bits of the frame engine.

    for each gyroscope     clocked ticks to its first quiet one                                    frame.enter
    blocks of all eight    up to the nearest event of any of them                                  carried.horizon
        gyroscope by gyroscope: words, codes, edges      carried.ahead
        all eight at once: the plants                    eight.block
        gyroscope by gyroscope: converter, frame read    adc.block, carried.behind
    for each gyroscope     from its last quiet tick: flush, clocked ticks to the end               frame.leave

Nothing of a gyroscope depends on which others stand beside it. Each has its own parameters, registers, profiles, noise
and effects; each enters and leaves by itself, so that their converters need not run in step.
Source    docs/architecture.md, docs/decisions/0012-lanes.md
"""

from __future__ import annotations  # a field may bear the name of its module

import time
from typing import NamedTuple

import numpy as np

from analog_frontend import adc, dac, eight, propagator, sid
from analog_frontend import top as plant
from analog_frontend.eight import ENTRIES, MOVING, OUT, STILL
from analog_frontend.linear import BLOCK
from analog_frontend.records import split, taken
from analog_frontend.vector import LANES, aligned, load, store
from fpga_model import control, digital_sid, registers, watchdog
from fpga_model import top as fpga
from fpga_model.jit import hot, inlined, outlined
from fpga_model.rates import FRAME_TICKS
from testbench import engine, interrupts, pins
from testbench.carried import Carried, ahead, behind, codes_at, history, horizon, taken_up
from testbench.errors import ConfigError
from testbench.flatten import leaves
from testbench.flatten import store as store_row
from testbench.frame import DRIVE_CLOCK, SENSE_CLOCK, enter, leave, put_down
from testbench.turn import Turn
from testbench.window import HISTORY, Window

FAR = np.int64(1 << 62)
ROOM = BLOCK + HISTORY
DRIVE, SENSE = plant.DRIVE, plant.SENSE
RATE, STIFFNESS, TEMP = range(3)
MOVED = len(MOVING)
CHUNK_TICKS = 400_000
STREAMS = ("drive_code", "sense_code", "frames", "truth")


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


class Group(NamedTuple):
    """Eight gyroscopes in arrays, most of them with a first axis of eight."""

    v: eight.Eight
    parts_i: np.ndarray  # rows of Part
    parts_f: np.ndarray
    effects_i: np.ndarray  # rows of effects.Params
    effects_f: np.ndarray
    moving: np.ndarray  # (8, knots, 6, len(MOVING)) jets of the entries that follow rate and coupling
    still: np.ndarray  # (8, knots, STILL) the other entries
    knots: np.ndarray  # (8, knots, 3) driver pole (s), k_q, k_xy
    jet: np.ndarray  # (6 len(MOVING) 8,) jets at each one's temperature, lanes side by side
    now: np.ndarray  # (3 8,) rate, stiffness, temperature that v.g was made for, lanes side by side
    carried: np.ndarray  # rows of Carried
    amplitude: np.ndarray  # buffers of pins.py
    rate: np.ndarray
    control_load: np.ndarray
    drive: np.ndarray
    sense: np.ndarray
    refs: np.ndarray
    sar: np.ndarray
    edges: np.ndarray
    edge_counts: np.ndarray
    drive_codes: np.ndarray  # (8, BLOCK)
    sense_codes: np.ndarray
    adc_clock: np.ndarray
    adc_sums: np.ndarray
    acting: np.ndarray  # (8, 2, 2) codes: put out now, put out from the next tick on
    late_area: np.ndarray  # (8, 2)
    entered: np.ndarray  # (8,) tick
    left: np.ndarray  # (8,) tick, or -1
    ends: np.ndarray  # (8,) where the chunk ends; -1 for a place without a gyroscope
    z: np.ndarray  # (8, 16) states of those that have not entered or have left
    caps: np.ndarray  # (8, 4, 6)


class Together(NamedTuple):
    """What a chunk is told and where it writes, for eight; as engine.Chunk."""

    begin: int
    rate_rad_s: np.ndarray  # (8, frames)
    temp_degc: np.ndarray
    faults: np.ndarray  # rows of engine.Faults
    drive_code: np.ndarray  # (8, ticks), or of no ticks
    sense_code: np.ndarray
    frames: np.ndarray  # (8, frames, columns)
    truth: np.ndarray
    peak_x: np.ndarray  # (8,)


def _carried():
    s = Window(control.State(), registers.State(), watchdog.State(), Turn(0, 0, 0, 0, 0, 0), 0, 0, 0)
    eight_zeros = (0,) * 8
    return Carried(digital_sid.State(), s, 0, 0, 0, 0, 0, 0, 0, eight_zeros, eight_zeros, 0, 0, 0, 0)


CARRIED = _carried()
CARRIED_COUNT = sum(1 for _ in leaves(CARRIED))
# a row begins with what only a window changes
HEAD = sum(1 for part in (CARRIED.sid, CARRIED.s.control, CARRIED.s.bank) for _ in leaves(part))
FAULTS = engine.Faults()


# ---- one gyroscope of a group --------------------------------------------------------------------------------------


@inlined
def _buffers(q, k):
    """The buffers of one of the eight."""
    return pins.Buffers(
        q.amplitude[k], q.rate[k], q.control_load[k], q.drive[k], q.sense[k], q.refs[k], q.sar[k], q.edges[k]
    )


@outlined
def _blended(q, p, k, temp_degc):
    """Jets and fixed entries of one plant at a temperature. Mutates `q`."""
    index, weight = 0, 0.0
    if p.temp_count > 1:
        index, weight = propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)
    after = min(index + 1, p.temp_count - 1)
    for j in range(propagator.JETS):
        for e in range(MOVED):
            a = q.moving[k, index, j, e]
            q.jet[(j * MOVED + e) * LANES + k] = a + weight * (q.moving[k, after, j, e] - a)
    for e in range(STILL):
        a = q.still[k, index, e]
        q.v.g[e * LANES + k] = a + weight * (q.still[k, after, e] - a)
    a = q.knots[k, index, 0]
    q.v.driver_s[k] = a + weight * (q.knots[k, after, 0] - a)


@inlined
def _at(p, knots, what, temp_degc):
    if p.temp_count == 1:
        return knots[0, what]
    index, weight = propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)
    return knots[index, what] + weight * (knots[index + 1, what] - knots[index, what])


@outlined
def _tuned(q, p, k, rate_rad_s, quad_code, temp_degc):
    """Rate, coupling and temperature of one plant's next frame; 1 if its matrix changes. Mutates `q`."""
    volts = quad_code * p.quad_lsb_v
    kq = _at(p, q.knots[k], 1, temp_degc)
    stiffness = _at(p, q.knots[k], 2, temp_degc) - kq * (volts * volts)
    moved = q.now[TEMP * LANES + k] != temp_degc
    same = q.now[RATE * LANES + k] == rate_rad_s and q.now[STIFFNESS * LANES + k] == stiffness
    if not moved and same:
        return 0
    q.now[RATE * LANES + k] = rate_rad_s
    q.now[STIFFNESS * LANES + k] = stiffness
    q.now[TEMP * LANES + k] = temp_degc
    if moved:
        _blended(q, p, k, temp_degc)
    return 1


@outlined
def _combined(q):
    """The moving entries of all eight matrices, as `propagator.combine`. Mutates `q.v.g`."""
    o, s = load(q.now, RATE * LANES), load(q.now, STIFFNESS * LANES)
    size = MOVED * LANES
    for e in range(MOVED):
        at = e * LANES
        small = (s * s) * load(q.jet, at + 5 * size) + (o * s) * load(q.jet, at + 4 * size)
        small = small + (o * o) * load(q.jet, at + 3 * size)
        whole = load(q.jet, at) + (o * load(q.jet, at + size) + (s * load(q.jet, at + 2 * size) + small))
        store(q.v.g, eight.AT_MODES + at, whole)


@outlined
def _recorded(q, c, p, g, k, tick):
    """A row of both streams at the frame that begins at `tick`. Mutates the streams of `c`."""
    n = tick // FRAME_TICKS - c.begin // FRAME_TICKS
    row = n if c.begin % FRAME_TICKS == 0 else n - 1
    if row < c.frames.shape[1]:
        z = q.z[k]
        for i in range(plant.X, plant.VY + 1):
            z[i] = q.v.z[i * LANES + k]
        engine.record_frame(
            c.frames[k, row],
            c.truth[k, row],
            g.s.control,
            codes_at(p.fpga, g, tick),
            g.drive_code,
            g.sense_code,
            g.s.quadrature,
            z,
            c.temp_degc[k, n],
            c.rate_rad_s[k, n],
        )


@inlined
def _put(q, k, which, part, carry, codes, n):
    """Codes of one DAC of one plant for a block: what acts at each tick, and the glitches. Mutates `q`."""
    v = q.v
    v.codes[which * LANES + k] = q.acting[k, which, 0]
    new = 1
    if carry:
        v.codes[(2 + which) * LANES + k] = q.acting[k, which, 1]
        new = 2
    for t in range(n):
        v.codes[(2 * (new + t) + which) * LANES + k] = codes[t]
    if not carry:
        v.codes[(2 * (n + 1) + which) * LANES + k] = codes[n - 1]
    if v.flags[eight.GLITCHES]:
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
def _joined(q, p, k):
    """A gyroscope enters: its matrix, linear states and capacitors into the registers of eight. Mutates `q`."""
    v = q.v
    _blended(q, p, k, q.now[TEMP * LANES + k])
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
def _parted(q, k):
    """A gyroscope leaves: the reverse of `_joined`. Mutates `q`."""
    v = q.v
    for i in range(plant.STATES):
        q.z[k, i] = v.z[i * LANES + k]
    for d in range(plant.DEMODULATORS):
        ref = v.switch[k, d]
        for i in range(3):
            at = (3 * d + i) * LANES + k
            q.caps[k, d, i if ref else 3 + i] = v.on[at]
            q.caps[k, d, 3 + i if ref else i] = v.off[at]
    q.late_area[k, DRIVE] = v.late_area[k]
    q.late_area[k, SENSE] = v.late_area[LANES + k]


# ---- the blocks ----------------------------------------------------------------------------------------------------


@outlined
def _nearest(part, q, c, tick):
    """The tick of the nearest event of any of the eight, FAR when all have left. Mutates `q`: some enter or leave."""
    until = FAR
    joined = 0
    for k in range(LANES):
        if tick < q.entered[k]:
            until = min(until, q.entered[k])
        elif q.left[k] < 0:
            p = taken(part, q.parts_i[k], q.parts_f[k])
            if tick == q.entered[k]:
                _joined(q, p, k)
                joined += 1
            g = taken(CARRIED, q.carried[k], q.parts_f[k])
            faults = taken(FAULTS, c.faults[k], q.parts_f[k])
            found = horizon(p.adc, q.adc_clock[k], faults.silent, g, tick, q.ends[k])
            if found == tick:
                q.left[k] = tick
                _parted(q, k)
                c.peak_x[k] = q.v.peak[k]
            else:
                until = min(until, found)
    if joined:
        _combined(q)
    return until


@outlined
def _tell(part, q, c, k, tick, n):
    """One gyroscope's codes and edges for a block of `n` ticks; 1 if its matrix changes. Mutates `q`, the streams."""
    p = taken(part, q.parts_i[k], q.parts_f[k])
    g = taken(CARRIED, q.carried[k], q.parts_f[k])
    faults = taken(FAULTS, c.faults[k], q.parts_f[k])
    changed = 0
    if tick % FRAME_TICKS == 0:
        frame_ = tick // FRAME_TICKS - c.begin // FRAME_TICKS
        v_q = faults.dac_code[2] if faults.dac[2] else g.s.quadrature
        changed = _tuned(q, p, k, c.rate_rad_s[k, frame_], v_q, c.temp_degc[k, frame_])
        _recorded(q, c, p, g, k, tick)
    drive_codes, sense_codes = q.drive_codes[k], q.sense_codes[k]
    g, count, known = ahead(p.fpga, g, faults, tick, n, q.sar[k, :, 0], drive_codes, sense_codes, _buffers(q, k))
    if known:
        store_row(q.carried[k], g)
    else:
        store_row(q.carried[k, HEAD:], (g.s[2:], g[2:]))
    q.edge_counts[k] = count
    _put(q, k, DRIVE, p.drive_dac, q.v.carry[k] == 1.0, drive_codes, n)
    _put(q, k, SENSE, p.sense_dac, q.v.carry[2 * LANES + k] == 1.0, sense_codes, n)
    row = tick - c.begin
    if row + n <= c.drive_code.shape[1]:
        for t in range(n):
            c.drive_code[k, row + t] = drive_codes[t]
            c.sense_code[k, row + t] = sense_codes[t]
    return changed


@outlined
def _hear(part, q, c, k, tick, until):
    """One gyroscope's converter over a block, and what it has read. Mutates `q`."""
    p = taken(part, q.parts_i[k], q.parts_f[k])
    g = taken(CARRIED, q.carried[k], q.parts_f[k])
    faults = taken(FAULTS, c.faults[k], q.parts_f[k])
    v, n = q.v, until - tick
    out = v.out[OUT * k : OUT * (k + 1)]
    sensor_v = adc.temperature_volts(q.now[TEMP * LANES + k])
    fell = adc.block(p.adc, q.adc_clock[k], q.adc_sums[k], out, n, sensor_v)
    g = behind(g, faults, q.adc_clock[k], tick, until, fell, g.sid)
    store_row(q.carried[k, HEAD:], (g.s[2:], g[2:]))
    if v.flags[eight.GLITCHES]:
        for which in range(2):
            v.late_area[which * LANES + k] = v.late_area[which * LANES + k] - q.late_area[k, which]
            q.late_area[k, which] = 0.0


@hot
def blocks(part, effect, q, c):
    """All blocks of a chunk: from each one's `entered` to its last quiet tick, which becomes `left`. Mutates `q`, `c`.

    part, effect  a Part and an effects.Params, for their types
    """
    tick = FAR
    for k in range(LANES):
        tick = min(tick, q.entered[k])
    while True:
        until = _nearest(part, q, c, tick)
        if until == FAR:
            break
        n, changed, busy = until - tick, 0, 0
        for k in range(LANES):
            q.edge_counts[k] = 0
            if q.entered[k] <= tick and q.left[k] < 0:
                changed += _tell(part, q, c, k, tick, n)
                busy += 1
        if changed:
            _combined(q)
        if busy:
            eight.block(q.v, effect, q.effects_i, q.effects_f, tick, n, q.edge_counts, q.edges)
        for k in range(LANES):
            if q.entered[k] <= tick and q.left[k] < 0:
                _hear(part, q, c, k, tick, until)
        tick = until


@hot
def _entered(p, f, chips, a, chunk, end, drdy_cycle, row, b):
    """Clocked ticks up to the blocks; what is carried from there goes into `row`, the last codes into `b`."""
    f, chips, drdy_cycle, tick = enter(p, f, chips, a, chunk, end, drdy_cycle)
    if tick < end:
        store_row(row, taken_up(p.fpga, f, chips, tick, drdy_cycle))
        history(f, b)
    return f, chips, drdy_cycle, tick


@hot
def _left(p, f, chips, a, chunk, end, row, tick, now):
    """From the end of the blocks to that of the chunk. `now`: rate, stiffness and temperature of the present frame."""
    plant.tune(p.plant, a, now[RATE], now[STIFFNESS], now[TEMP])
    g = taken(CARRIED, row, now)
    return leave(p, put_down(f, chips, g, tick, chunk.faults.status), a, chunk, end)


# ---- groups in Python ----------------------------------------------------------------------------------------------


def _column(tables, row, out):
    """Jets (knots, 6) of one entry of G at the clocks of the DACs."""
    clocked = {
        propagator.DU_DRIVE: (tables.drive_step, DRIVE_CLOCK),
        propagator.DU_SENSE: (tables.sense_step, SENSE_CLOCK),
        propagator.JIT_DRIVE: (tables.drive_jitter, DRIVE_CLOCK),
        propagator.JIT_SENSE: (tables.sense_jitter, SENSE_CLOCK),
    }
    if row in clocked:
        table, clock = clocked[row]
        return table[:, :, clock, out]
    return tables.g_jet[:, :, row, out]


def _tables(p):
    """(moving, still, knots) of a plant, as in Group without its first axis."""
    t = p.tables
    moving = np.stack([_column(t, *entry) for entry in MOVING], axis=-1)
    still = np.stack([_column(t, *entry) for entry in ENTRIES], axis=-1)
    if still[:, 1:].any():
        raise RuntimeError("an entry of a chain follows the rate: lanes would not")
    still = np.concatenate([still[:, 0], t.pickoff.reshape(len(t.pickoff), -1)], axis=1)
    return moving, still, np.stack([t.driver_s, t.kq_n_per_m_per_v2, t.kxy_n_per_m], axis=-1)


def _part(p):
    return Part(
        p.fpga,
        p.plant.adc,
        p.plant.drive_dac,
        p.plant.sense_dac,
        float(p.plant.quad_lsb_v),
        float(p.plant.temp_lo_degc),
        float(p.plant.temp_step_k),
        int(p.plant.temp_count),
    )


def _rows(records):
    """Rows of integers and of floats of up to eight records of one shape; places left over repeat the first."""
    pairs = [split(record) for record in records]
    pairs += pairs[:1] * (LANES - len(pairs))
    return np.array([i for i, _ in pairs], np.int64), np.array([f for _, f in pairs], float).reshape(LANES, -1)


def _padded(tables):
    """One array of tables with different numbers of knots; those behind the last repeat it."""
    most = max(len(table) for table in tables)
    full = [np.concatenate([table, np.repeat(table[-1:], most - len(table), axis=0)]) for table in tables]
    return np.stack(full + full[:1] * (LANES - len(full)))


class Engine:
    """Up to eight gyroscopes of the same kinds of parts: the arrays of a group, made once for their parameters.

    params  testbench.engine.Params of each
    """

    def __init__(self, params):
        if not 1 <= len(params) <= LANES:
            raise ValueError(f"lanes: {len(params)} gyroscopes, a group has 1 to {LANES}")
        if any(p.fpga.digital for p in params):
            raise ConfigError('lanes: firmware.board = "digital_sid" is run by the frame engine only')
        self.params = params
        self.part, self.effect = _part(params[0]), params[0].plant.effects
        parts_i, parts_f = _rows([_part(p) for p in params])
        effects_i, effects_f = _rows([p.plant.effects for p in params])
        moving, still, knots = (_padded(tables) for tables in zip(*(_tables(p.plant) for p in params)))
        int64 = np.int64
        self.q = Group(
            v=eight.eight(),
            parts_i=parts_i,
            parts_f=parts_f,
            effects_i=effects_i,
            effects_f=effects_f,
            moving=moving,
            still=still,
            knots=knots,
            jet=aligned(propagator.JETS * MOVED * LANES),
            now=aligned(3 * LANES),
            carried=np.zeros((LANES, CARRIED_COUNT), int64),
            amplitude=np.zeros((LANES, ROOM), int64),
            rate=np.zeros((LANES, ROOM), int64),
            control_load=np.zeros((LANES, ROOM), int64),
            drive=np.zeros((LANES, ROOM), int64),
            sense=np.zeros((LANES, ROOM), int64),
            refs=np.zeros((LANES, ROOM), int64),
            sar=np.zeros((LANES, 2, ROOM), int64),
            edges=np.zeros((LANES, plant.MAX_EDGES * ROOM, 2), int64),
            edge_counts=np.zeros(LANES, int64),
            drive_codes=np.zeros((LANES, BLOCK), int64),
            sense_codes=np.zeros((LANES, BLOCK), int64),
            adc_clock=np.zeros((LANES, adc.CODES + adc.CHANNELS), int64),
            adc_sums=np.zeros((LANES, adc.CHANNELS, adc.reset(params[0].plant.adc).sums.shape[1])),
            acting=np.zeros((LANES, 2, 2), int64),
            late_area=np.zeros((LANES, 2)),
            entered=np.zeros(LANES, int64),
            left=np.zeros(LANES, int64),
            ends=np.zeros(LANES, int64),
            z=np.zeros((LANES, plant.STATES)),
            caps=np.zeros((LANES, plant.DEMODULATORS, sid.CAPACITORS)),
        )
        for k, p in enumerate(params):
            self._constants(k, p.plant)

    def _constants(self, k, p):
        v, n = self.q.v, p.noise
        pairs = ((n.drive_dac, n.sense_dac), (n.edge_jitter,) * 2, (n.force_x, n.force_y), (n.cv_x, n.cv_y))
        for pair, sources in enumerate(pairs):
            for half, source in enumerate(sources):
                v.sigma[(2 * pair + half) * LANES + k] = source.sigma if source.on else 0.0
                v.flags[pair] |= source.on
            v.keys[2 * pair * LANES + k] = sources[0].key0
            v.keys[(2 * pair + 1) * LANES + k] = sources[0].key1
        v.jitter[k] = (n.edge_jitter.key0, n.edge_jitter.key1, n.edge_jitter.on)
        v.flags[eight.GLITCHES] |= p.drive_dac.glitch_v_s != 0.0 or p.sense_dac.glitch_v_s != 0.0
        v.flags[eight.FORCE_EFFECTS] |= p.effects.any_force
        v.flags[eight.CV_EFFECTS] |= p.effects.any_cv
        v.flags[eight.BOWS] |= p.drive_dac.bow != 0.0 or p.sense_dac.bow != 0.0
        carries = (p.tables.drive_carry[0, DRIVE_CLOCK], p.tables.sense_carry[0, SENSE_CLOCK])
        for which, (part, carry) in enumerate(zip((p.drive_dac, p.sense_dac), carries)):
            numbers = (part.lsb_v, part.offset_v, part.bow, part.full_code, 1.0 / part.full_code)
            for i, number in enumerate(numbers):
                v.dac[(5 * which + i) * LANES + k] = number
            v.carry[2 * which * LANES + k] = float(carry)
            v.carry[(2 * which + 1) * LANES + k] = 1.0 - float(carry)
        for i, name in enumerate(("e1", "e2", "e3", "s1", "s2", "s3")):
            v.sid[i * LANES + k] = getattr(p.sid, name)
        v.sid_numbers[k] = p.sid[: eight.NUMBERS]
        v.sid_inject[k], v.sid_taylor[k] = p.sid.inject, p.sid.taylor
        v.switch_tau_s[k], v.switch_carry[k] = p.switch_tau_s, p.switch_carry
        v.slope_gain[k] = p.slope_gain

    def run(self, states, ticks, rate_rad_s, temp_degc, faults, streams):
        """Advance all by `ticks` from the same tick; lists as long as the group, entries as for engine.run.

        Returns the new states, whose arrays are those of `states`, moved on.
        Raises RuntimeError if a register is not what it must be.
        """
        q, begin = self.q, states[0].tick
        if any(s.tick != begin for s in states):
            raise ValueError("lanes: the gyroscopes of a group are not at the same tick")
        end = begin + ticks
        q.ends[:], q.left[:], q.entered[:] = end, end, FAR
        chunks, entered = [], []
        for k, (p, s) in enumerate(zip(self.params, states)):
            edges = np.zeros((engine.MAX_EDGES, 2), np.int64)
            chunks.append(engine.Chunk(begin, rate_rad_s[k], temp_degc[k], 0, 0, 0, faults[k], streams[k], edges))
            f, chips, drdy_cycle, tick = _entered(
                p, s.fpga, s.chips, s.plant, chunks[k], end, s.drdy_cycle, q.carried[k], self._buffers(k)
            )
            entered.append((f, chips, drdy_cycle))
            if tick < end:
                q.entered[k], q.left[k] = tick, -1
                self._load(k, s.plant, faults[k])
        count = len(states)
        told = Together(
            begin,
            *(_stacked(values) for values in (rate_rad_s, temp_degc)),
            _rows(faults)[0],
            *(
                _stacked([getattr(o, name) for o in streams])
                for name in ("drive_code", "sense_code", "frames", "truth")
            ),
            np.zeros(LANES),
        )
        blocks(self.part, self.effect, q, told)
        after = []
        for k in range(count):
            f, chips, drdy_cycle = entered[k]
            a, failed = states[k].plant, 0
            if q.entered[k] < end:
                self._unload(k, a)
                self._hand_over(k, told, streams[k], begin)
                now = q.now.reshape(3, LANES)[:, k].copy()
                f, chips, drdy_cycle, failed = _left(
                    self.params[k], f, chips, a, chunks[k], end, q.carried[k], q.left[k], now
                )
            if failed:
                raise RuntimeError(f"lanes engine: the registers of tick {failed} are not those of the clocked engine")
            after.append(engine.State(f, chips, a, end, drdy_cycle))
        return after

    def _buffers(self, k):
        q = self.q
        return pins.Buffers(
            q.amplitude[k], q.rate[k], q.control_load[k], q.drive[k], q.sense[k], q.refs[k], q.sar[k], q.edges[k]
        )

    def _load(self, k, a, faults):
        """A plant's state into the group."""
        q, p = self.q, self.params[k].plant
        q.z[k], q.caps[k], q.late_area[k] = a.z, a.caps, a.late_area
        for fault, state in zip(faults.nan, (plant.X, plant.Y)):
            if fault:
                q.z[k, state] = np.nan
        q.v.late_tau_s[k], q.v.late_count[k], q.v.switch[k] = a.late_tau_s, a.late_count, a.switch
        q.adc_clock[k], q.adc_sums[k] = a.adc.clock, a.adc.sums
        q.now.reshape(3, LANES)[:, k] = a.now[:3]
        for which, part in enumerate((p.drive_dac, p.sense_dac)):
            q.acting[k, which] = (_code_of(part, a.volts[which]), a.codes[which])

    def _unload(self, k, a):
        """A plant's state out of the group; its matrix is left to `_left`."""
        q, p = self.q, self.params[k].plant
        a.z[:], a.caps[:], a.late_area[:] = q.z[k], q.caps[k], q.late_area[k]
        a.late_tau_s[:], a.late_count[:], a.switch[:] = q.v.late_tau_s[k], q.v.late_count[k], q.v.switch[k]
        a.adc.clock[:], a.adc.sums[:] = q.adc_clock[k], q.adc_sums[k]
        a.cycles[:] = (DRIVE_CLOCK, SENSE_CLOCK)
        a.now[:] = np.inf
        for which, part in enumerate((p.drive_dac, p.sense_dac)):
            now, coming = q.acting[k, which].tolist()
            a.volts[which], a.coming_v[which] = _volts_of(part, now), _volts_of(part, coming)
            a.codes[which] = coming

    def _hand_over(self, k, told, o, begin):
        """What the blocks wrote, into the gyroscope's own streams."""
        first, last = int(self.q.entered[k]), int(self.q.left[k])
        rows = slice(
            -(-first // FRAME_TICKS) - -(-begin // FRAME_TICKS), -(-last // FRAME_TICKS) - -(-begin // FRAME_TICKS)
        )
        o.frames[rows], o.truth[rows] = told.frames[k, rows], told.truth[k, rows]
        ticks = slice(first - begin, last - begin)
        o.drive_code[ticks], o.sense_code[ticks] = told.drive_code[k, ticks], told.sense_code[k, ticks]
        o.peak_x[0] = max(o.peak_x[0], told.peak_x[k])


class Lanes:
    """Simulations at the same tick, side by side: `Simulation.advance` for each, with the same results and streams."""

    def __init__(self, sims):
        self.groups = [sims[k : k + LANES] for k in range(0, len(sims), LANES)]
        self.engines = [Engine([sim.params for sim in group]) for group in self.groups]

    def advance(self, ticks, rate_rad_s, temp_degc, progress=None):
        """Run all by `ticks`. Rates (rad/s), temperatures (degC): a value or an array of frames for each simulation."""
        for number, (engine_, sims) in enumerate(zip(self.engines, self.groups)):
            first = number * LANES
            told = [
                (np.atleast_1d(rate_rad_s[first + k]), np.atleast_1d(temp_degc[first + k])) for k in range(len(sims))
            ]
            done = 0
            while done < ticks:
                step = min(CHUNK_TICKS, ticks - done)
                begun = sims[0].tick // FRAME_TICKS - (sims[0].tick - done) // FRAME_TICKS
                rates, temps, streams = zip(
                    *(
                        sim.chunk(step, rate[min(begun, len(rate) - 1) :], temp[min(begun, len(temp) - 1) :])
                        for sim, (rate, temp) in zip(sims, told)
                    )
                )
                started = time.perf_counter()
                with interrupts.held():
                    states = engine_.run(
                        [sim.state for sim in sims], step, rates, temps, [sim.faults for sim in sims], streams
                    )
                spent = (time.perf_counter() - started) / len(sims)
                for sim, state, stream in zip(sims, states, streams):
                    sim.seconds_spent += spent
                    sim.moved(state, stream)
                done += step
                if progress:
                    progress(first, done)


def _stacked(items):
    """(8, ...) of up to eight arrays; places left over repeat the first."""
    return np.stack([np.ascontiguousarray(item) for item in items] + [items[0]] * (LANES - len(items)))


def _volts_of(part, code):
    linear = part.offset_v + part.lsb_v * code
    if part.bow == 0.0:
        return linear
    ratio = code / part.full_code
    return linear + part.bow * (1.0 - ratio * ratio) * part.lsb_v * part.full_code


def _code_of(part, volts):
    """The code of an output voltage."""
    near = round((volts - part.offset_v) / part.lsb_v)
    reach = 1 + int(abs(part.bow) * part.full_code)
    for code in range(near - reach, near + reach + 1):
        if _volts_of(part, code) == volts:
            return code
    raise RuntimeError(f"lanes: {volts} V is the output of no DAC code")
