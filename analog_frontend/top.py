"""The plant: ticks of 1 us, one at a time or up to 125 in a block; the one step that every engine calls.

    pins --> [dac: volts] --> [linear: chains, modes, C/V, path] --> [sid x 4] --> [adc] --> codes, DRDY
             take-effect instants     ^                              reference edges
    effects: force impulses -> x      |         volts at the C/V outputs
    noise:   forces, DAC, C/V, edges, ADC       rate, V_q and temperature make G (`retune`, once a frame)

Order of a tick (frozen: another order would flip LSBs within seconds)
    1 inputs: held and new DAC voltages, jitter, noise forces         4 SID: full ticks, or pieces at reference edges
    2 force impulses of the effects at the tick's first instant       5 ADC: modulator samples that fall in the tick
    3 the linear step, as frozen in linear.py                         6 what falls later is carried to the next tick

A block runs each stage over all of its ticks before the next stage; no bit depends on where blocks end.
State is arrays, mutated in place; `reset` makes them, `copy` keeps them. Everything that crosses is a pin: DAC codes
with the clock at which each took effect, reference edges with theirs, ADC codes with the clock of DRDY.
V_q takes effect at the frame's `retune`: it is DC, its settling within a microsecond changes no phase.
Late      instant = clock Tc + delay; an event whose delay passes the end of the tick acts in the next one
NaN       in x or y reaches everything behind it and reads as full scale; the firmware's over-range flag sees it
Source    docs/architecture.md, docs/plant.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend import dac_levels, effects, linear, ring_saturation, sid_edges
from analog_frontend.effects import law
from analog_frontend.linear import (
    CV_NOISE_X,
    CV_NOISE_Y,
    IN_DU_DRIVE,
    IN_DU_SENSE,
    IN_FX,
    IN_FY,
    IN_JIT_DRIVE,
    IN_JIT_SENSE,
    IN_U_DRIVE,
    IN_U_SENSE,
    JITTER_DRIVE,
    JITTER_SENSE,
    LEVEL_DRIVE,
    LEVEL_SENSE,
    STATE_ROWS,
    STRIDE,
)
from analog_frontend.numeric.shapes import doubles, int64s, zeros
from analog_frontend.numeric.vector import LANES, load, store
from analog_frontend.parts import adc, dac, noise, propagator, sid
from analog_frontend.parts.propagator import (
    DU_DRIVE,
    DU_SENSE,
    F_X,
    F_Y,
    INPUTS,
    JIT_DRIVE,
    JIT_SENSE,
    OUTPUTS,
    U_DRIVE,
    U_SENSE,
)
from analog_frontend.port import foreign
from analog_frontend.sid_edges import JITTERED
from fpga_model.jit import inner, outlined

STATES = 16
V_DRIVE, V_SENSE, X, VX, Y, VY, FIRST_CV, CV_X, CV_Y = 2, 5, 6, 7, 8, 9, 10, 12, 15
ONE = np.int64(1)  # typed: Numba compiles a function anew for every constant that it is called with
DEMODULATORS = sid.DEMODULATORS
MAX_EDGES = sid.MAX_EDGES
DRIVE, SENSE = 0, 1
# Inputs that act through the modes: only these, and only for the four outputs from X on, change with rate and coupling
MOVING_ROWS = (*range(10), U_DRIVE, U_SENSE, F_X, F_Y)
COLUMN_ROWS = (DU_DRIVE, DU_SENSE, JIT_DRIVE, JIT_SENSE)
DRIVE_ROWS = (IN_U_DRIVE, IN_DU_DRIVE, IN_JIT_DRIVE, LEVEL_DRIVE, JITTER_DRIVE)
SENSE_ROWS = (IN_U_SENSE, IN_DU_SENSE, IN_JIT_SENSE, LEVEL_SENSE, JITTER_SENSE)
# what `retune` last used
NOW_RATE, NOW_STIFFNESS, NOW_TEMP, NOW_DRIVER, NOW_CYCLE_DRIVE, NOW_CYCLE_SENSE = range(6)


class Noise(NamedTuple):
    """Sources of the plant outside the ADC; each has its own stream and its own switch."""

    force_x: noise.Source
    force_y: noise.Source
    cv_x: noise.Source
    cv_y: noise.Source
    drive_dac: noise.Source
    sense_dac: noise.Source
    edge_jitter: noise.Source


class Params(NamedTuple):
    """Everything constant in a run; arrays are read only."""

    drive_dac: dac.Params
    sense_dac: dac.Params
    drive_levels: dac_levels.Params
    sense_levels: dac_levels.Params
    quad_lsb_v: float
    frame_ticks: int  # the surroundings of a law are those of a frame's first instant
    tables: propagator.Plant  # stacked over temperature knots, one or more
    temp_lo_degc: float
    temp_step_k: float
    temp_count: int
    switch_tau_s: np.ndarray  # (2, clocks) instant in its tick of the switch after a fall or rise at clock c
    switch_carry: np.ndarray  # (2, clocks) 1 if that tick is the next one
    sid: sid.Params
    adc: adc.Params
    noise: Noise
    effects: effects.Params
    laws: law.Params
    sar_lsb_v: float
    slope_gain: float  # last op-amp of the C/V chains
    ring: ring_saturation.Params = ring_saturation.OFF
    port: foreign.Params = foreign.NONE


class Work(NamedTuple):
    """What a block is told and what it computes with; nothing in it outlives the block."""

    drive_codes: int64s(linear.BLOCK)  # DAC codes at the end of each tick
    sense_codes: int64s(linear.BLOCK)
    w: doubles(linear.ROWS * STRIDE)  # rows of linear.py
    demodulated: doubles(4 * STRIDE)  # output of demodulator d at the start of tick t at 4 t + d
    taus_s: doubles(MAX_EDGES)
    gains: doubles(law.SLOTS)


class State(NamedTuple):
    """Arrays, mutated in place."""

    z: doubles(STATES)
    g: doubles(INPUTS, OUTPUTS)  # the matrix of this frame
    jet: doubles(propagator.JETS, INPUTS, OUTPUTS)  # its jet at this temperature
    column_jet: doubles(4, propagator.JETS, OUTPUTS)  # step and jitter columns of both DACs at their clocks
    pickoff: doubles(2, 4, 6)  # from both ends of a tick to C/V and SID path, at this temperature
    now: doubles(6)  # rate, k_xy, temperature, driver pole, clocks that g was made for
    volts: doubles(2)  # DAC outputs now
    coming_v: doubles(2)  # DAC outputs that act in the next tick: those of a late step, or the same
    late_area: doubles(2)  # impulse (jitter, glitch) of a late step, V s
    codes: int64s(2)  # DAC codes now
    cycles: int64s(2)  # clock of each DAC's last step
    caps: doubles(DEMODULATORS, sid.CAPACITORS)
    switch: int64s(DEMODULATORS)  # references as the analog switches see them
    late_tau_s: doubles(DEMODULATORS, MAX_EDGES)  # edges whose switch acts in the next tick
    late_count: int64s(DEMODULATORS)
    adc: adc.State
    sar: int64s(2)  # samples taken one tick ago, which the converters hand over now
    work: Work


class Pins(NamedTuple):
    """What the firmware's chips did in a tick: codes at its end, clock of the change (-1: none), reference edges."""

    drive_code: int
    drive_cycle: int
    sense_code: int
    sense_cycle: int
    edge_count: int


def _dac_output_volts(part, levels, code):
    error = dac_levels.volts(levels, code) if levels.on else 0.0
    return dac.volts(part, code) + error


def reset(p, drive_code, sense_code, temp_degc):
    """Everything at rest: DAC outputs at their power-on codes, settled; capacitors empty."""
    s = zeros(State, adc=adc.reset(p.adc), work=zeros(Work))
    s.now[:] = np.inf
    s.codes[:] = drive_code, sense_code
    s.volts[DRIVE] = _dac_output_volts(p.drive_dac, p.drive_levels, drive_code)
    s.volts[SENSE] = _dac_output_volts(p.sense_dac, p.sense_levels, sense_code)
    s.coming_v[:] = s.volts
    s.z[0:3] = s.volts[DRIVE]
    s.z[3:6] = s.volts[SENSE]
    return s


def copy(s):
    """A state that shares nothing with `s`."""

    def copy_field(item):
        if isinstance(item, Work):
            return zeros(Work)
        return adc.State(*map(np.copy, item)) if isinstance(item, adc.State) else np.copy(item)

    return State(*map(copy_field, s))


@outlined
def _blend(p, s, temp_degc):
    """Jets at a temperature and at the present clocks of the DACs."""
    index, weight = 0, 0.0
    if p.temp_count > 1:
        index, weight = propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)
    after = min(index + 1, p.temp_count - 1)
    t = p.tables
    d, e = s.cycles[DRIVE], s.cycles[SENSE]
    columns = (t.drive_step, d), (t.sense_step, e), (t.drive_jitter, d), (t.sense_jitter, e)
    for j in range(propagator.JETS):
        for i in range(INPUTS):
            # what the pickoff's cubic stands for is left zero: no engine reads it
            for o in range(OUTPUTS if FIRST_CV <= i < STATES else FIRST_CV):
                a = t.g_jet[index, j, i, o]
                s.jet[j, i, o] = a + weight * (t.g_jet[after, j, i, o] - a)
        for k, (table, clock) in enumerate(columns):
            for o in range(FIRST_CV):
                a = table[index, j, clock, o]
                s.column_jet[k, j, o] = a + weight * (table[after, j, clock, o] - a)
    for c in range(2):
        for i in range(4):
            for o in range(6):
                a = t.pickoff[index, c, i, o]
                s.pickoff[c, i, o] = a + weight * (t.pickoff[after, c, i, o] - a)
    s.now[NOW_DRIVER] = t.driver_s[index] + weight * (t.driver_s[after] - t.driver_s[index])
    s.now[NOW_CYCLE_DRIVE] = d
    s.now[NOW_CYCLE_SENSE] = e


@inner
def _columns(s):
    """Rows of G for steps and jitter at the present clocks of the DACs."""
    jet, g = s.column_jet.reshape(-1), s.g.reshape(-1)
    rate, stiffness = s.now[NOW_RATE], s.now[NOW_STIFFNESS]
    for k in range(4):
        for first in range(0, STATES, LANES):
            at = k * propagator.JETS * OUTPUTS + first
            propagator.combine_lanes(jet, at, OUTPUTS, rate, stiffness, g, COLUMN_ROWS[k] * OUTPUTS + first)


@inner
def interpolate_scalar(p, values, temp_degc):
    """A scalar of the tables at a temperature."""
    if p.temp_count == 1:
        return values[0]
    index, weight = propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)
    return values[index] + weight * (values[index + 1] - values[index])


@inner
def retune(p, s, rate_rad_s, quad_code, temp_degc):
    """Make G for a rate (rad/s), a V_q code and a temperature (degC); does nothing if nothing changed."""
    if p.port.step != 0:  # a library has no G: it is told the three numbers, the code in place of a stiffness
        s.now[NOW_RATE], s.now[NOW_STIFFNESS], s.now[NOW_TEMP] = rate_rad_s, quad_code, temp_degc
        return
    volts = quad_code * p.quad_lsb_v
    kq = interpolate_scalar(p, p.tables.kq_n_per_m_per_v2, temp_degc)
    tune(p, s, rate_rad_s, interpolate_scalar(p, p.tables.kxy_n_per_m, temp_degc) - kq * (volts * volts), temp_degc)


@inner
def tune(p, s, rate_rad_s, stiffness, temp_degc):
    """As `retune`, for a coupling stiffness (N/m)."""
    needs_blend = s.now[NOW_TEMP] != temp_degc
    needs_blend = needs_blend or s.now[NOW_CYCLE_DRIVE] != s.cycles[DRIVE] or s.now[NOW_CYCLE_SENSE] != s.cycles[SENSE]
    if not needs_blend and s.now[NOW_RATE] == rate_rad_s and s.now[NOW_STIFFNESS] == stiffness:
        return
    s.now[NOW_RATE] = rate_rad_s
    s.now[NOW_STIFFNESS] = stiffness
    s.now[NOW_TEMP] = temp_degc
    if needs_blend:
        _blend(p, s, temp_degc)
        propagator.combine(s.jet, rate_rad_s, stiffness, s.g)
    else:
        # the chains and the C/V feel neither rate nor coupling: their entries stay
        jet, g = s.jet.reshape(-1), s.g.reshape(-1)
        for k in range(len(MOVING_ROWS)):
            at = MOVING_ROWS[k] * OUTPUTS + X
            propagator.combine_lanes(jet, at, INPUTS * OUTPUTS, rate_rad_s, stiffness, g, at)
    _columns(s)


@inner
def _dac(s, w, which, part, levels, carry, codes, n, rows):
    """Rows of one DAC: its output at each tick, step and impulse area that act in it. Mutates.

    A code acts in its own tick or, with `carry`, in the next one. `rows`: the first holds the noise and becomes output
    and noise; then step, impulse area, level and jitter.
    """
    noisy, du, area, level, jitter = rows
    first = level * STRIDE
    w[first] = s.volts[which]
    if carry:
        w[first + 1] = s.coming_v[which]
    new = first + 2 if carry else first + 1
    for t in range(n):
        w[new + t] = dac.volts(part, codes[t])
    if levels.on:
        for t in range(n):
            w[new + t] = w[new + t] + dac_levels.volts(levels, codes[t])
    s.volts[which] = w[first + n]
    s.coming_v[which] = w[new + n - 1]
    for t in range(0, n, LANES):
        before = load(w, first + t)
        rise = load(w, first + t + 1) - before
        store(w, du * STRIDE + t, rise)
        store(w, noisy * STRIDE + t, before + load(w, noisy * STRIDE + t))
        store(w, area * STRIDE + t, rise * load(w, jitter * STRIDE + t))
    pending_area = s.late_area[which]
    s.late_area[which] = 0.0
    if carry:
        # each impulse is drawn with its code and acts a tick later
        for t in range(n):
            throw = (w[new + t] - w[new + t - 1]) * w[jitter * STRIDE + t]
            w[area * STRIDE + t] = pending_area
            pending_area = throw
        s.late_area[which] = pending_area
    else:
        w[area * STRIDE] = w[area * STRIDE] + pending_area
    if part.glitch_v_s != 0.0:
        old = s.codes[which]
        for t in range(n):
            throw = dac.glitch(part, old, codes[t])
            old = codes[t]
            at = t + 1 if carry else t
            if at < n:
                w[area * STRIDE + at] = w[area * STRIDE + at] - throw
            else:
                s.late_area[which] = s.late_area[which] - throw
    s.codes[which] = codes[n - 1]


@outlined
def _foreign(p, s, tick, n, drive_cycle, sense_cycle, edge_count, edges):
    """`advance_ticks` of the plant behind the port; each row of its motion shows what it is at the end. Mutates `s`."""
    port, w, now = p.port, s.work.w, s.now
    port.pins[foreign.QUADRATURE_CODE] = int(now[NOW_STIFFNESS])
    fell = foreign.run_library(
        port,
        p.adc,
        s.adc.clock,
        tick,
        n,
        drive_cycle,
        sense_cycle,
        s.work,
        edge_count,
        edges,
        now[NOW_RATE],
        now[NOW_TEMP],
    )
    for k in range(foreign.MOTIONS):
        s.z[X + k] = port.motion[k]
    for t in range(n):
        w[linear.X * STRIDE + t] = port.motion[0]
    s.codes[DRIVE], s.codes[SENSE] = s.work.drive_codes[n - 1], s.work.sense_codes[n - 1]
    return fell


@inner
def step(p, s, tick, pins, edges):
    """One tick: a block of one. `edges` (n, 2): clock and reference number of each edge, in time order. Mutates `s`.

    Returns the clock of the next tick at which DRDY_N falls, or -1; the codes are in s.adc.
    """
    s.work.drive_codes[0] = pins.drive_code
    s.work.sense_codes[0] = pins.sense_code
    ready = advance_ticks(p, s, tick, ONE, pins.drive_cycle, pins.sense_cycle, pins.edge_count, edges)
    return ready - p.adc.tick_clocks if ready >= 0 else -1


@inner
def advance_ticks(p, s, tick, n, drive_cycle, sense_cycle, edge_count, edges):
    """`n` ticks from `tick` on, all of one frame; the DAC codes stand in s.work. Mutates `s`.

    drive_cycle, sense_cycle  clock within each tick at which a DAC's output is told to change; -1 for never
    edges (edge_count, 2)     clock from the block's first, and reference number, of each edge of the four reference
                              pins, in time order
    Returns the clock from the block's first at which DRDY_N falls, 26 .. 26 n + 25, or -1; the codes are in s.adc.
    """
    if p.port.step != 0:
        return _foreign(p, s, tick, n, drive_cycle, sense_cycle, edge_count, edges)
    t, w = p.tables, s.work.w
    if drive_cycle >= 0:
        s.cycles[DRIVE] = drive_cycle
    if sense_cycle >= 0:
        s.cycles[SENSE] = sense_cycle
    if s.now[NOW_CYCLE_DRIVE] != s.cycles[DRIVE] or s.now[NOW_CYCLE_SENSE] != s.cycles[SENSE]:
        _blend(p, s, s.now[NOW_TEMP])
        _columns(s)
    for k in range(STATES):
        w[STATE_ROWS[k] * STRIDE] = s.z[k]
    # whole registers: what stands behind the last tick is not read, and a loop without a rest is faster
    on, padded_ticks = p.noise, (n + LANES - 1) // LANES * LANES
    noise.fill_hold_rows(on.drive_dac, on.sense_dac, tick, w, IN_U_DRIVE * STRIDE, IN_U_SENSE * STRIDE, n)
    noise.fill_hold_rows(on.force_x, on.force_y, tick, w, IN_FX * STRIDE, IN_FY * STRIDE, n)
    noise.fill_hold_rows(on.cv_x, on.cv_y, tick, w, CV_NOISE_X * STRIDE, CV_NOISE_Y * STRIDE, n)
    jitter, rows = on.edge_jitter, (JITTER_DRIVE * STRIDE, JITTER_SENSE * STRIDE)
    noise.fill_rows(jitter, jitter, JITTERED * tick, JITTERED, w, rows[DRIVE], rows[SENSE], padded_ticks)
    carry = t.drive_carry[0, s.cycles[DRIVE]]
    _dac(s, w, DRIVE, p.drive_dac, p.drive_levels, carry, s.work.drive_codes, n, DRIVE_ROWS)
    carry = t.sense_carry[0, s.cycles[SENSE]]
    _dac(s, w, SENSE, p.sense_dac, p.sense_levels, carry, s.work.sense_codes, n, SENSE_ROWS)
    linear.chains(s.g, w, n)
    laws = p.laws
    if laws.force or laws.cv:
        rate, temp = s.now[NOW_RATE], s.now[NOW_TEMP]
        t_s = (tick // p.frame_ticks) * p.frame_ticks * p.sid.h_s
        law.gains(laws.force, laws.cv, laws.temp_ref_degc, laws.table, laws.numbers, rate, temp, t_s, s.work.gains)
    linear.modes(s.g, w, n, p.effects, laws, s.work.gains)
    linear.pickoffs(s.g, s.pickoff, w, n, p.effects.any_force or laws.force)
    for k in range(STATES):
        s.z[k] = w[STATE_ROWS[k] * STRIDE + n]
    sid_edges.demodulate(p, s, tick, n, edge_count, edges, s.now[NOW_DRIVER], s.now[NOW_TEMP])
    sensor_v = adc.temperature_volts(s.now[NOW_TEMP])
    return adc.convert_block(p.adc, s.adc.clock, s.adc.sums, s.work.demodulated, n, sensor_v)


@outlined
def sar_code(p, s, tick, channel):
    """Sample of a C/V output at the tick's first instant, 18 bit; for the board without the analog SID."""
    noise_x, noise_y = noise.hold_sample(p.noise.cv_x, tick), noise.hold_sample(p.noise.cv_y, tick)
    noise_x, noise_y = effects.cv_volts(p.effects, noise_x, noise_y, s.z[V_DRIVE], s.z[V_DRIVE])
    return quantize_sar(p, s.z[CV_X] + noise_x if channel == 0 else s.z[CV_Y] + noise_y)


@inner
def aperture_noise(p, work, t, drive_v):
    """As `sar_code` draws it, for tick `t` of the last block: noise and effects at both C/V outputs (V)."""
    return effects.cv_volts(
        p.effects, work.w[CV_NOISE_X * STRIDE + t], work.w[CV_NOISE_Y * STRIDE + t], drive_v, drive_v
    )


@inner
def quantize_sar(p, volts):
    """Code of an 18-bit sample; not a number reads as plus full scale."""
    ratio = volts / p.sar_lsb_v
    if not ratio < 131071.0:
        return 131071
    if ratio < -131072.0:
        return -131072
    return int(np.floor(ratio + 0.5))
