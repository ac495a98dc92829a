"""The plant: one tick of 1 us, the step that every engine calls.

    pins --> [dac: volts] --> in ==(G)==> out --> [sid x 4] --> [adc] --> codes, DRDY
             take-effect instants     ^         reference edges
    effects: force impulses -> z      |         volts at the C/V outputs
    noise:   forces, DAC, C/V, edges, ADC       rate, V_q and temperature make G (`retune`, once a frame)

Order of a tick (frozen: another order would flip LSBs within seconds)
    1 force impulses of the effects at the tick's first instant       4 SID: full ticks, or pieces at reference edges
    2 inputs: held and new DAC voltages, jitter, noise forces         5 ADC: modulator samples that fall in the tick
    3 out = sum_j G[j] in[j], j ascending from 0.0                     6 what falls later is carried to the next tick

State is arrays, mutated in place; `reset` makes them, `copy` keeps them. Everything that crosses is a pin: DAC codes
with the clock at which each took effect, reference edges with theirs, ADC codes with the clock of DRDY.
V_q takes effect at the frame's `retune`: it is DC, its settling within a microsecond changes no phase.
Source    docs/architecture.md, docs/parts/
"""

from typing import NamedTuple

import numpy as np

from analog_frontend import adc, dac, effects, noise, propagator, sid
from analog_frontend.propagator import (
    DU_DRIVE,
    DU_SENSE,
    F_X,
    F_Y,
    INPUTS,
    JIT_DRIVE,
    JIT_SENSE,
    OUTPUTS,
    PX1,
    PY1,
    U_DRIVE,
    U_SENSE,
)
from fpga_model.jit import inner, outlined

STATES = 16
V_DRIVE, V_SENSE, X, VX, Y, VY, CV_X, CV_Y = 2, 5, 6, 7, 8, 9, 12, 15
DEMODULATORS = sid.DEMODULATORS
MAX_EDGES = sid.MAX_EDGES
DRIVE, SENSE = 0, 1
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
    quad_lsb_v: float
    tables: propagator.Plant  # stacked over temperature knots, one or more
    temp_lo_degc: float
    temp_step_k: float
    temp_count: int
    switch_tau_s: np.ndarray  # (26,) instant within its tick at which the analog switch follows an edge at clock c
    switch_carry: np.ndarray  # (26,) 1 if that tick is the next one
    sid: sid.Params
    adc: adc.Params
    noise: Noise
    effects: effects.Params
    sar_lsb_v: float
    slope_gain: float  # last op-amp of the C/V chains


class State(NamedTuple):
    """Arrays, mutated in place."""

    z: np.ndarray  # (16,) linear state
    g: np.ndarray  # (24, 24) the matrix of this frame
    jet: np.ndarray  # (6, 24, 24) its jet at this temperature
    column_jet: np.ndarray  # (4, 6, 24) step and jitter columns of both DACs at their clocks
    now: np.ndarray  # (6,) rate, k_xy, temperature, driver pole, clocks that g was made for
    volts: np.ndarray  # (2,) DAC outputs now
    late_step: np.ndarray  # (2,) steps that act in the next tick
    late_area: np.ndarray  # (2,) their impulse (jitter, glitch), V s
    codes: np.ndarray  # (2,) DAC codes now
    cycles: np.ndarray  # (2,) clock of each DAC's last step
    caps: np.ndarray  # (4, 6) capacitors of the SID
    switch: np.ndarray  # (4,) references as the analog switches see them
    late_tau_s: np.ndarray  # (4, MAX_EDGES) edges whose switch acts in the next tick
    late_count: np.ndarray  # (4,)
    adc: adc.State
    sar: np.ndarray  # (2,) samples taken one tick ago, which the converters hand over now
    inputs: np.ndarray  # (24,) scratch of a tick
    out: np.ndarray  # (24,)
    taus_s: np.ndarray  # (MAX_EDGES,)


class Pins(NamedTuple):
    """What the firmware's chips did in a tick: codes at its end, clock of the change (-1: none), reference edges."""

    drive_code: int
    drive_cycle: int
    sense_code: int
    sense_cycle: int
    edge_count: int


def reset(p, drive_code, sense_code, temp_degc):
    """Everything at rest: DAC outputs at their power-on codes, settled; capacitors empty."""
    s = State(
        z=np.zeros(STATES),
        g=np.zeros((INPUTS, OUTPUTS)),
        jet=np.zeros((propagator.JETS, INPUTS, OUTPUTS)),
        column_jet=np.zeros((4, propagator.JETS, OUTPUTS)),
        now=np.full(6, np.inf),
        volts=np.array([dac.volts(p.drive_dac, drive_code), dac.volts(p.sense_dac, sense_code)]),
        late_step=np.zeros(2),
        late_area=np.zeros(2),
        codes=np.array([drive_code, sense_code]),
        cycles=np.zeros(2, np.int64),
        caps=sid.reset(),
        switch=np.zeros(DEMODULATORS, np.int64),
        late_tau_s=np.zeros((DEMODULATORS, MAX_EDGES)),
        late_count=np.zeros(DEMODULATORS, np.int64),
        adc=adc.reset(p.adc),
        sar=np.zeros(2, np.int64),
        inputs=np.zeros(INPUTS),
        out=np.zeros(OUTPUTS),
        taus_s=np.zeros(MAX_EDGES),
    )
    s.z[0:3] = s.volts[DRIVE]
    s.z[3:6] = s.volts[SENSE]
    return s


def copy(s):
    """A state that shares nothing with `s`."""
    return State(*(adc.State(*map(np.copy, a)) if isinstance(a, adc.State) else np.copy(a) for a in s))


@outlined
def _blend(p, s, temp_degc):
    """Jets at a temperature and at the present clocks of the DACs."""
    index, weight = 0, 0.0
    if p.temp_count > 1:
        index, weight = propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)
    after = min(index + 1, p.temp_count - 1)
    t = p.tables
    d, e = s.cycles[DRIVE], s.cycles[SENSE]
    for j in range(propagator.JETS):
        for i in range(INPUTS):
            for o in range(OUTPUTS):
                a = t.g_jet[index, j, i, o]
                s.jet[j, i, o] = a + weight * (t.g_jet[after, j, i, o] - a)
        for o in range(OUTPUTS):
            a = t.drive_step[index, j, d, o]
            s.column_jet[0, j, o] = a + weight * (t.drive_step[after, j, d, o] - a)
            a = t.sense_step[index, j, e, o]
            s.column_jet[1, j, o] = a + weight * (t.sense_step[after, j, e, o] - a)
            a = t.drive_jitter[index, j, d, o]
            s.column_jet[2, j, o] = a + weight * (t.drive_jitter[after, j, d, o] - a)
            a = t.sense_jitter[index, j, e, o]
            s.column_jet[3, j, o] = a + weight * (t.sense_jitter[after, j, e, o] - a)
    s.now[NOW_DRIVER] = t.driver_s[index] + weight * (t.driver_s[after] - t.driver_s[index])
    s.now[NOW_CYCLE_DRIVE] = d
    s.now[NOW_CYCLE_SENSE] = e


@outlined
def _columns(s):
    """Rows of G for steps and jitter at the present clocks of the DACs."""
    for k in range(4):
        row = DU_DRIVE if k == 0 else (DU_SENSE if k == 1 else (JIT_DRIVE if k == 2 else JIT_SENSE))
        propagator.column(
            s.column_jet[k].reshape(propagator.JETS, 1, OUTPUTS), 0, s.now[NOW_RATE], s.now[NOW_STIFFNESS], s.g[row]
        )


@inner
def blended(p, values, temp_degc):
    """A scalar of the tables at a temperature."""
    if p.temp_count == 1:
        return values[0]
    index, weight = propagator.locate(p.temp_lo_degc, p.temp_step_k, p.temp_count, temp_degc)
    return values[index] + weight * (values[index + 1] - values[index])


@outlined
def retune(p, s, rate_rad_s, quad_code, temp_degc):
    """Make G for a rate (rad/s), a V_q code and a temperature (degC); does nothing if nothing changed."""
    volts = quad_code * p.quad_lsb_v
    kq = blended(p, p.tables.kq_n_per_m_per_v2, temp_degc)
    stiffness = blended(p, p.tables.kxy_n_per_m, temp_degc) - kq * (volts * volts)
    moved = s.now[NOW_TEMP] != temp_degc
    moved = moved or s.now[NOW_CYCLE_DRIVE] != s.cycles[DRIVE] or s.now[NOW_CYCLE_SENSE] != s.cycles[SENSE]
    if not moved and s.now[NOW_RATE] == rate_rad_s and s.now[NOW_STIFFNESS] == stiffness:
        return
    s.now[NOW_RATE] = rate_rad_s
    s.now[NOW_STIFFNESS] = stiffness
    s.now[NOW_TEMP] = temp_degc
    if moved:
        _blend(p, s, temp_degc)
    propagator.combine(s.jet, rate_rad_s, stiffness, s.g)
    _columns(s)


@inner
def _dac_step(p, s, which, part, carry, code, cycle, jitter_s):
    """Step (V) and impulse area (V s) of one DAC that act in this tick; later ones are kept for the next."""
    step, area = s.late_step[which], s.late_area[which]
    s.late_step[which] = 0.0
    s.late_area[which] = 0.0
    if cycle >= 0 and code != s.codes[which]:
        rise = dac.volts(part, code) - dac.volts(part, s.codes[which])
        throw = rise * jitter_s - dac.glitch(part, s.codes[which], code)
        s.codes[which] = code
        if carry:
            s.late_step[which] = rise
            s.late_area[which] = throw
        else:
            step += rise
            area += throw
    return step, area


@outlined
def _multiply(g, v, out):
    """out[o] = sum over j, ascending, of g[j, o] v[j]; the loop over o vectorises and does not change a bit."""
    for o in range(OUTPUTS):
        out[o] = 0.0
    for j in range(INPUTS):
        a = v[j]
        for o in range(OUTPUTS):
            out[o] += g[j, o] * a


@inner
def step(p, s, tick, pins, edges):
    """One tick. `edges` (n, 2): clock and reference number of each edge of the four reference pins, in time order.

    Returns the clock of the next tick at which DRDY_N falls, or -1; the codes are in s.adc.
    """
    t, z = p.tables, s.z
    if pins.drive_cycle >= 0:
        s.cycles[DRIVE] = pins.drive_cycle
    if pins.sense_cycle >= 0:
        s.cycles[SENSE] = pins.sense_cycle
    if s.now[NOW_CYCLE_DRIVE] != s.cycles[DRIVE] or s.now[NOW_CYCLE_SENSE] != s.cycles[SENSE]:
        _blend(p, s, s.now[NOW_TEMP])
        _columns(s)
    effects.apply_forces(p.effects, z)

    v, out = s.inputs, s.out
    for i in range(STATES):
        v[i] = z[i]
    jitter = noise.white(p.noise.edge_jitter, 6 * tick)
    step_v, area = _dac_step(
        p, s, DRIVE, p.drive_dac, t.drive_carry[0, s.cycles[DRIVE]], pins.drive_code, pins.drive_cycle, jitter
    )
    v[U_DRIVE] = s.volts[DRIVE] + noise.white(p.noise.drive_dac, tick)
    v[DU_DRIVE] = step_v
    v[JIT_DRIVE] = area
    s.volts[DRIVE] += step_v
    jitter = noise.white(p.noise.edge_jitter, 6 * tick + 1)
    step_v, area = _dac_step(
        p, s, SENSE, p.sense_dac, t.sense_carry[0, s.cycles[SENSE]], pins.sense_code, pins.sense_cycle, jitter
    )
    v[U_SENSE] = s.volts[SENSE] + noise.white(p.noise.sense_dac, tick)
    v[DU_SENSE] = step_v
    v[JIT_SENSE] = area
    s.volts[SENSE] += step_v
    v[F_X] = noise.white(p.noise.force_x, tick)
    v[F_Y] = noise.white(p.noise.force_y, tick)

    _multiply(s.g, v, out)

    noise_x, noise_y = effects.cv_volts(
        p.effects, noise.white(p.noise.cv_x, tick), noise.white(p.noise.cv_y, tick), z[V_DRIVE], out[V_DRIVE]
    )
    sensor = adc.temperature_volts(s.now[NOW_TEMP])
    before = (sid.output(s.caps, 0), sid.output(s.caps, 1), sid.output(s.caps, 2), sid.output(s.caps, 3), sensor)
    busy = pins.edge_count + s.late_count[0] + s.late_count[1] + s.late_count[2] + s.late_count[3]
    if busy == 0:
        for d in range(DEMODULATORS):
            first = PX1 if d < 2 else PY1
            sid.full(
                p.sid, s.caps, d, s.switch[d], noise_x if d < 2 else noise_y, out[first], out[first + 1], out[first + 2]
            )
    else:
        _switch(p, s, tick, pins.edge_count, edges, noise_x, noise_y, z, out)
    for i in range(STATES):
        z[i] = out[i]
    after = (sid.output(s.caps, 0), sid.output(s.caps, 1), sid.output(s.caps, 2), sid.output(s.caps, 3), sensor)
    return adc.step(p.adc, s.adc.clock, s.adc.sums, before, after)


@outlined
def _switch(p, s, tick, edge_count, edges, noise_x, noise_y, z, out):
    """The demodulators of a tick in which a reference changes, now or by an edge of the tick before."""
    gain, driver_s = p.slope_gain, s.now[NOW_DRIVER]
    taus = s.taus_s
    for d in range(DEMODULATORS):
        count = s.late_count[d]
        for k in range(count):
            taus[k] = s.late_tau_s[d, k]
        late = 0
        for k in range(edge_count):
            if edges[k, 1] == d:
                cycle = edges[k, 0]
                tau = p.switch_tau_s[cycle] + noise.white(p.noise.edge_jitter, 6 * tick + 2 + d)
                if p.switch_carry[cycle] != 0:
                    s.late_tau_s[d, late] = max(tau, 0.0)
                    late += 1
                else:
                    taus[count] = min(max(tau, 0.0), p.sid.h_s)
                    count += 1
        s.late_count[d] = late
        first = PX1 if d < 2 else PY1
        cv = CV_X if d < 2 else CV_Y
        n = noise_x if d < 2 else noise_y
        if count == 0:
            sid.full(p.sid, s.caps, d, s.switch[d], n, out[first], out[first + 1], out[first + 2])
        else:
            s.switch[d] = sid.edges(
                p.sid,
                s.caps,
                d,
                s.switch[d],
                taus,
                count,
                n,
                out[first],
                out[first + 1],
                out[first + 2],
                z[cv],
                (gain * z[cv - 1] - z[cv]) / driver_s,
                out[cv],
                (gain * out[cv - 1] - out[cv]) / driver_s,
            )


@outlined
def sar_code(p, s, tick, channel):
    """Sample of a C/V output at the tick's first instant, 18 bit; for the board without the analog SID."""
    noise_x, noise_y = effects.cv_volts(
        p.effects, noise.white(p.noise.cv_x, tick), noise.white(p.noise.cv_y, tick), s.z[V_DRIVE], s.z[V_DRIVE]
    )
    volts = s.z[CV_X] + noise_x if channel == 0 else s.z[CV_Y] + noise_y
    ratio = volts / p.sar_lsb_v
    if not ratio < 131071.0:
        return 131071
    if ratio < -131072.0:
        return -131072
    return int(np.floor(ratio + 0.5))
