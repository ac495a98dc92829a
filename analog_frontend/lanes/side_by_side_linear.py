"""Eight plants: noise, DAC outputs, output chains, modes and C/V of a strip of ticks, each operation on all at once.

Operand for operand what linear.py and top.py do with one plant. Effects act plant by plant, with the functions that
`top` calls too.
Source    docs/decisions/0012-lanes.md
"""

from analog_frontend import effects
from analog_frontend.effects import law
from analog_frontend.lanes.side_by_side import (
    AD,
    AS,
    AT_CV,
    AT_DRIVE,
    AT_MODES,
    AT_PICKOFF,
    AT_SENSE,
    BOWS,
    CV,
    CV_EFFECTS,
    CVS,
    CX1,
    CY1,
    D1,
    DACS,
    DUD,
    DUS,
    END_VX,
    END_VY,
    FORCE_EFFECTS,
    FORCED_BY,
    FORCES,
    FX,
    FY,
    GLITCHES,
    JITTER,
    NX,
    NY,
    PATH_X,
    PATH_Y,
    ROW,
    STATE_OFFSETS,
    UD,
    US,
    VX,
    VY,
    F,
    X,
    Y,
    opened,
)
from analog_frontend.numeric.records import unpack_record
from analog_frontend.numeric.vector import LANES, integers, larger, load, splat, store, store_rows
from analog_frontend.parts import noise
from analog_frontend.parts.noise import HOLD
from analog_frontend.sid_edges import JITTERED
from fpga_model.jit import inlined, outlined


@inlined
def _noise_pair_samples(v, pair, counter):
    """Sample number `counter` of both sources of a pair."""
    at = 2 * LANES * pair
    x, y = noise.words(integers(v.keys, at), integers(v.keys, at + LANES), counter)
    return load(v.sigma, at) * noise.ih4(x), load(v.sigma, at + LANES) * noise.ih4(y)


@inlined
def _volts(v, which, at):
    """Output of one DAC for the codes at `at`."""
    k = 5 * LANES * which
    code = integers(v.codes, at)
    linear = load(v.dac, k + LANES) + load(v.dac, k) * code
    if v.flags[BOWS]:
        ratio, lsb_v, full = load(v.dac, k + 4 * LANES) * code, load(v.dac, k), load(v.dac, k + 3 * LANES)
        linear = linear + load(v.dac, k + 2 * LANES) * (1.0 - ratio * ratio) * lsb_v * full
    return linear


@inlined
def _three(g, at, p1, p2, p3, f1, f2, f3):
    """A chain of three poles with its triangle at `at`, driven by f."""
    n3 = load(g, at + 16) * p3 + ((load(g, at + 32) * p1 + load(g, at + 40) * p2) + f3)
    n2 = load(g, at + 8) * p2 + (load(g, at + 24) * p1 + f2)
    n1 = load(g, at) * p1 + f1
    return n1, n2, n3


@inlined
def _step_dac_chain(g, at, p1, p2, p3, u, du, jit):
    """A tick of a DAC's chain, from its numbers at `at`: three of the inputs for each pole, then the triangle."""
    f1 = load(g, at) * u + load(g, at + 8) * du + load(g, at + 16) * jit
    f2 = load(g, at + 24) * u + load(g, at + 32) * du + load(g, at + 40) * jit
    f3 = load(g, at + 48) * u + load(g, at + 56) * du + load(g, at + 64) * jit
    return _three(g, at + 72, p1, p2, p3, f1, f2, f3)


@inlined
def _fill_input_rows(v, tick, first, n):
    """Rows of what acts in ticks `first` .. `first` + n - 1 of a block: outputs of the DACs, their steps, noise."""
    w = v.w
    carry_d, plain_d = load(v.carry, 0), load(v.carry, LANES)
    carry_s, plain_s = load(v.carry, 2 * LANES), load(v.carry, 3 * LANES)
    pending_area_d, pending_area_s = load(v.late_area, 0), load(v.late_area, LANES)
    zero = splat(0.0)
    nd, ns, jd, js, fx, fy, nx, ny = zero, zero, zero, zero, zero, zero, zero, zero
    begin = tick + first
    sample, new = begin // HOLD, 0
    for t in range(n):
        if t == new:
            if v.flags[DACS]:
                nd, ns = _noise_pair_samples(v, DACS, sample)
            if v.flags[FORCES]:
                fx, fy = _noise_pair_samples(v, FORCES, sample)
            if v.flags[CVS]:
                nx, ny = _noise_pair_samples(v, CVS, sample)
            sample += 1
            new = sample * HOLD - begin
        if v.flags[JITTER]:
            jd, js = _noise_pair_samples(v, JITTER, JITTERED * (begin + t))
        at = 2 * (first + t) * LANES
        before, now, later = _volts(v, 0, at), _volts(v, 0, at + 16), _volts(v, 0, at + 32)
        rise = now - before
        area = (rise * jd) * plain_d + pending_area_d
        pending_area_d = ((later - now) * jd) * carry_d
        if v.flags[GLITCHES]:
            area = area - load(v.throws, at)
        store(w, UD + t * LANES, before + nd)
        store(w, DUD + t * LANES, rise)
        store(w, AD + t * LANES, area)
        before, now, later = _volts(v, 1, at + 8), _volts(v, 1, at + 24), _volts(v, 1, at + 40)
        rise = now - before
        area = (rise * js) * plain_s + pending_area_s
        pending_area_s = ((later - now) * js) * carry_s
        if v.flags[GLITCHES]:
            area = area - load(v.throws, at + LANES)
        store(w, US + t * LANES, before + ns)
        store(w, DUS + t * LANES, rise)
        store(w, AS + t * LANES, area)
        store(w, FX + t * LANES, fx)
        store(w, FY + t * LANES, fy)
        store(w, NX + t * LANES, nx)
        store(w, NY + t * LANES, ny)
    store(v.late_area, 0, pending_area_d)
    store(v.late_area, LANES, pending_area_s)


@inlined
def _chains(v, n):
    """Both DACs' output chains: rows D1 .. S3."""
    g, w, z = v.g, v.w, v.z
    d1, d2, d3 = load(z, 0), load(z, 8), load(z, 16)
    s1, s2, s3 = load(z, 24), load(z, 32), load(z, 40)
    for t in range(0, n * LANES, LANES):
        store_rows(w, D1 + t, ROW, (d1, d2, d3, s1, s2, s3))
        d1, d2, d3 = _step_dac_chain(g, AT_DRIVE, d1, d2, d3, load(w, UD + t), load(w, DUD + t), load(w, AD + t))
        s1, s2, s3 = _step_dac_chain(g, AT_SENSE, s1, s2, s3, load(w, US + t), load(w, DUS + t), load(w, AS + t))
    store_rows(w, D1 + n * LANES, ROW, (d1, d2, d3, s1, s2, s3))
    store_rows(z, 0, LANES, (d1, d2, d3, s1, s2, s3))


@inlined
def _fill_mode_forcing(v, n):
    """What all inputs give to the modes, in the order of INPUTS; two ticks at a time share the matrix."""
    g, w = v.g, v.w
    for t in range(0, n * LANES, 2 * LANES):
        a0, a1, a2, a3 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        b0, b1, b2, b3 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        for k in range(14):
            x, y = load(w, FORCED_BY[k] + t), load(w, FORCED_BY[k] + t + LANES)
            at = AT_MODES + 32 * k
            c0, c1, c2, c3 = load(g, at), load(g, at + 8), load(g, at + 16), load(g, at + 24)
            if k == 0:
                a0, a1, a2, a3 = c0 * x, c1 * x, c2 * x, c3 * x
                b0, b1, b2, b3 = c0 * y, c1 * y, c2 * y, c3 * y
            else:
                a0, a1, a2, a3 = a0 + c0 * x, a1 + c1 * x, a2 + c2 * x, a3 + c3 * x
                b0, b1, b2, b3 = b0 + c0 * y, b1 + c1 * y, b2 + c2 * y, b3 + c3 * y
        store_rows(w, F + t, ROW, (a0, a1, a2, a3))
        store_rows(w, F + t + LANES, ROW, (b0, b1, b2, b3))


@inlined
def _mode(g, o, x, vx, y, vy, forced):
    at = AT_MODES + (14 * 4 + o) * LANES
    return ((load(g, at) * x + load(g, at + 32) * vx) + (load(g, at + 64) * y + load(g, at + 96) * vy)) + forced


@inlined
def _advance_modes(v, kind, floats, ints, n):
    """Rows X .. VY at each tick's first instant, after the impulses, and the velocities at its end."""
    g, w, z = v.g, v.w, v.z
    x, vx, y, vy = load(z, 48), load(z, 56), load(z, 64), load(z, 72)
    top = load(v.peak, 0)
    for t in range(0, n * LANES, LANES):
        if v.flags[FORCE_EFFECTS]:
            store_rows(w, X + t, ROW, (x, vx, y, vy))
            push(kind, floats, ints, t)
            vx, vy = load(w, VX + t), load(w, VY + t)
        store_rows(w, X + t, ROW, (x, vx, y, vy))
        x_ = _mode(g, 0, x, vx, y, vy, load(w, F + t))
        vx_ = _mode(g, 1, x, vx, y, vy, load(w, F + ROW + t))
        y_ = _mode(g, 2, x, vx, y, vy, load(w, F + 2 * ROW + t))
        vy_ = _mode(g, 3, x, vx, y, vy, load(w, F + 3 * ROW + t))
        store(w, END_VX + t, vx_)
        store(w, END_VY + t, vy_)
        top = larger(top, x_)
        x, vx, y, vy = x_, vx_, y_, vy_
    store(w, X + n * LANES, x)
    store(w, Y + n * LANES, y)
    store_rows(z, 48, LANES, (x, vx, y, vy))
    store(v.peak, 0, top)


@inlined
def _pickoff_input(g, at, x0, v0, x1, v1):
    return ((load(g, at) * x0 + load(g, at + 48) * v0) + load(g, at + 96) * x1) + load(g, at + 144) * v1


@inlined
def _add_cv_terms(g, at, b, p1, p2, p3):
    return ((b + load(g, at) * p1) + load(g, at + 8) * p2) + load(g, at + 16) * p3


@inlined
def _pickoff(v, at, cv, z, x, vx, end_vx, row, path, n):
    """A mode's C/V chain (rows from `row`) and what it gives to the SID (rows from `path`).

    at, cv  places of the numbers of the mode's motion, and of the chain's triangle with those of the path behind it
    """
    g, w = v.g, v.w
    p1, p2, p3 = load(v.z, z), load(v.z, z + 8), load(v.z, z + 16)
    for t in range(0, n * LANES, LANES):
        x0, v0, x1, v1 = load(w, x + t), load(w, vx + t), load(w, x + t + LANES), load(w, end_vx + t)
        store_rows(w, row + ROW + t, ROW, (p2, p3))
        store(w, path + t, _add_cv_terms(g, cv + 48, _pickoff_input(g, at + 24, x0, v0, x1, v1), p1, p2, p3))
        store(w, path + ROW + t, _add_cv_terms(g, cv + 72, _pickoff_input(g, at + 32, x0, v0, x1, v1), p1, p2, p3))
        store(w, path + 2 * ROW + t, _add_cv_terms(g, cv + 96, _pickoff_input(g, at + 40, x0, v0, x1, v1), p1, p2, p3))
        f1, f2 = _pickoff_input(g, at, x0, v0, x1, v1), _pickoff_input(g, at + 8, x0, v0, x1, v1)
        p1, p2, p3 = _three(g, cv, p1, p2, p3, f1, f2, _pickoff_input(g, at + 16, x0, v0, x1, v1))
    store_rows(w, row + ROW + n * LANES, ROW, (p2, p3))
    store_rows(v.z, z, LANES, (p1, p2, p3))


@outlined
def push(kind, floats, ints, at):
    """Impulses of effects and laws on eight pairs of velocities of the tick at `at`. Mutates v.w."""
    v = opened(floats, ints)
    w = v.w
    for plant in range(LANES):
        e, force = unpack_record(kind, v.effects_i[plant], v.effects_f[plant]), v.law_counts[plant, 0]
        if e.any_force or force:
            k = at + plant
            leads = v.law_leads[plant]
            add_x = effects.force_impulse(e, w[X + k], law.start_state(w, STATE_OFFSETS, law.U, k, k + LANES, leads))
            if force:
                table, gains = v.law_tables[plant], v.law_gains[plant]
                law_x, law_y = law.impulses(force, table, gains, w, STATE_OFFSETS, k, k + LANES, leads)
                add_x = add_x + law_x
                w[VY + k] = w[VY + k] + law_y
            w[VX + k] = w[VX + k] + add_x


@outlined
def add_rows(kind, floats, ints, n):
    """What effects and laws add to the C/V noise of `n` ticks. Mutates its rows."""
    v = opened(floats, ints)
    w = v.w
    for plant in range(LANES):
        e = unpack_record(kind, v.effects_i[plant], v.effects_f[plant])
        force, cv = v.law_counts[plant, 0], v.law_counts[plant, 1]
        if e.any_cv or cv:
            for t in range(n):
                k = t * LANES + plant
                start, end = w[D1 + 2 * ROW + k], w[D1 + 2 * ROW + k + LANES]
                x_volts, y_volts = effects.cv_volts(e, w[NX + k], w[NY + k], start, end)
                if cv:
                    table, numbers, gains = v.law_tables[plant], v.law_numbers[plant], v.law_gains[plant]
                    law_x, law_y = law.volts(force, cv, table, numbers, gains, w, STATE_OFFSETS, k, k + LANES)
                    x_volts, y_volts = x_volts + law_x, y_volts + law_y
                w[NX + k], w[NY + k] = x_volts, y_volts


@outlined
def linear(kind, floats, ints, tick, first, n):
    """Everything up to the demodulators for `n` ticks (at most STRIP) of a block, from its tick `first` on."""
    v = opened(floats, ints)
    _fill_input_rows(v, tick, first, n)
    _chains(v, n)
    _fill_mode_forcing(v, n)
    _advance_modes(v, kind, floats, ints, n)
    _pickoff(v, AT_PICKOFF, AT_CV, 80, X, VX, END_VX, CX1, PATH_X, n)
    _pickoff(v, AT_PICKOFF + 192, AT_CV + CV, 104, Y, VY, END_VY, CY1, PATH_Y, n)
    if v.flags[CV_EFFECTS]:
        add_rows(kind, floats, ints, n)
