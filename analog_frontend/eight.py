"""Eight plants side by side: the ticks of `top.block`, each operation on all of them at once.

    lane l of a register is plant l. The operations are those of linear.py, sid.py and noise.py in their order, so that
    eight plants have the bits of eight single ones (asserted by the tests of the lanes engine)

    g       entries of the plants' matrices in the order of ENTRIES       z   linear states, order of top.State.z
    codes   of the DACs: row 2 t + which holds what is put out at the beginning of tick t of the block
    on      the SID's capacitors that follow, off those that hold: row 3 d + k; sign +-1 of demodulator d
    out     output of plant l's demodulator d at the start of tick t, at 4 (TICKS l + t) + d

What is not linear or happens to one plant alone (reference edges, effects) is done plant by plant with the functions
that `top` calls too.
Source    docs/architecture.md, docs/decisions/0012-lanes.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend import effects, noise, sid
from analog_frontend.linear import BLOCK, INPUTS
from analog_frontend.propagator import (
    DU_DRIVE,
    DU_SENSE,
    JIT_DRIVE,
    JIT_SENSE,
    PX1,
    PY1,
    U_DRIVE,
    U_SENSE,
)
from analog_frontend.records import taken
from analog_frontend.top import DEMODULATORS, JITTERED, MAX_EDGES, STATES, TICK_CYCLES, acting, switched
from analog_frontend.vector import LANES, aligned, integers, larger, load, splat, store, store_quads
from fpga_model.jit import inlined, outlined

TICKS = BLOCK + 1
STAGES = sid.STAGES
OUT = 4 * TICKS
D, S, MODE, DRIVE_CV, SENSE_CV = 0, 3, 6, 10, 13  # first states in z
LATER = 1 << 40


def _chain(first, u, du, jit):
    """Entries of an output chain: three inputs onto each state, then the triangle."""
    forced = [(j, first + k) for k in range(3) for j in (u, du, jit)]
    return forced + _triangle(first)


def _triangle(first):
    a, b, c = range(first, first + 3)
    return [(a, a), (b, b), (c, c), (a, b), (a, c), (b, c)]


# (input, output) of G; the pickoff's own numbers follow the C/V triangles and paths
ENTRIES = (
    _chain(D, U_DRIVE, DU_DRIVE, JIT_DRIVE)
    + _chain(S, U_SENSE, DU_SENSE, JIT_SENSE)
    + _triangle(DRIVE_CV)
    + [(DRIVE_CV + j, PX1 + k) for k in range(3) for j in range(3)]
    + _triangle(SENSE_CV)
    + [(SENSE_CV + j, PY1 + k) for k in range(3) for j in range(3)]
)
MOVING = [(j, MODE + o) for j in (*INPUTS, *range(MODE, MODE + 4)) for o in range(4)]
COLUMNS = (DU_DRIVE, DU_SENSE, JIT_DRIVE, JIT_SENSE)
STILL = len(ENTRIES) + 2 * 24
CHAIN, CV = 15 * LANES, 15 * LANES
AT_DRIVE, AT_SENSE = 0, CHAIN
AT_CV = 2 * CHAIN
AT_PICKOFF = AT_CV + 2 * CV
AT_MODES = AT_PICKOFF + 2 * 24 * LANES
SIZE = AT_MODES + len(MOVING) * LANES
# pairs of noise sources, in `sigma` and `keys`
DACS, JITTER, FORCES, CVS = range(4)
GLITCHES, FORCE_EFFECTS, CV_EFFECTS, BOWS = range(4, 8)  # of `flags`, after the four pairs
# a strip of ticks that stays in the first cache; a row holds one value more, for states at its end
STRIP = 16
ROW = (STRIP + 2) * LANES
D1, S1 = 0, 3 * ROW
UD, DUD, US, DUS, AD, AS, FX, FY, X, VX, Y, VY, END_VX, END_VY, NX, NY, CX1, CY1, F, B = (
    k * ROW for k in (6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 25, 28, 32)
)
ROWS = 44
# rows of the inputs of the modes, in the order of linear.INPUTS
FORCED_BY = (D1, D1 + ROW, D1 + 2 * ROW, S1, S1 + ROW, S1 + 2 * ROW, UD, DUD, US, DUS, AD, AS, FX, FY)
NUMBERS = 8  # scalars of sid.Params


class Eight(NamedTuple):
    """Arrays of eight plants, mutated in place; a first axis of eight, or lanes side by side in a flat array."""

    g: np.ndarray
    z: np.ndarray
    codes: np.ndarray  # (2 (BLOCK + 2) 8,) int64
    dac: np.ndarray  # (2 5 8,) per DAC: lsb (V), offset (V), bow, full scale in codes, and its inverse
    carry: np.ndarray  # (4 8,) per DAC: 1 where a code acts a tick later, then 1 where not
    late_area: np.ndarray  # (2 8,)
    throws: np.ndarray  # (2 BLOCK 8,) glitch areas, if `glitches`
    sigma: np.ndarray  # (8 8,)
    keys: np.ndarray  # (8 8,) int64
    on: np.ndarray  # (12 8,)
    off: np.ndarray
    sign: np.ndarray  # (4 8,)
    sid: np.ndarray  # (6 8,) e1 e2 e3 s1 s2 s3
    out: np.ndarray  # (8 OUT,)
    w: np.ndarray  # (ROWS ROW,) scratch: rows of a strip
    peak: np.ndarray  # (8,) largest |x|
    flags: np.ndarray  # int64: noise pair in use, four of them; any glitch, force effect, C/V effect, bow
    switch_tau_s: np.ndarray  # (8, 26)
    switch_carry: np.ndarray  # (8, 26)
    late_tau_s: np.ndarray  # (8, 4, MAX_EDGES)
    late_count: np.ndarray  # (8, 4)
    switch: np.ndarray  # (8, 4)
    jitter: np.ndarray  # (8, 3) key, key, on
    driver_s: np.ndarray  # (8,)
    slope_gain: np.ndarray  # (8,)
    sid_numbers: np.ndarray  # (8, NUMBERS)
    sid_inject: np.ndarray  # (8, 6)
    sid_taylor: np.ndarray  # (8, 64)
    caps: np.ndarray  # (4, 6) scratch
    fixed: np.ndarray  # (32, 6) scratch: capacitors of those with an edge
    touched: np.ndarray  # (32,) which those are
    taus_s: np.ndarray  # (MAX_EDGES,) scratch
    due: np.ndarray  # (8,) scratch: tick of a plant's next edge
    place: np.ndarray  # (8,) scratch: its place in the list


def eight():
    """Room for eight plants, at rest and without noise."""
    flat = {
        "g": SIZE,
        "z": STATES * LANES,
        "dac": 2 * 5 * LANES,
        "carry": 4 * LANES,
        "late_area": 2 * LANES,
        "throws": 2 * BLOCK * LANES,
        "sigma": 8 * LANES,
        "on": 12 * LANES,
        "off": 12 * LANES,
        "sign": 4 * LANES,
        "sid": 6 * LANES,
        "out": LANES * OUT,
        "w": ROWS * ROW,
        "peak": LANES,
    }
    shaped = {
        "switch_tau_s": (LANES, TICK_CYCLES),
        "late_tau_s": (LANES, DEMODULATORS, MAX_EDGES),
        "driver_s": (LANES,),
        "slope_gain": (LANES,),
        "sid_numbers": (LANES, NUMBERS),
        "sid_inject": (LANES, 6),
        "sid_taylor": (LANES, 64),
        "caps": (DEMODULATORS, 6),
        "fixed": (LANES * DEMODULATORS, 6),
        "taus_s": (MAX_EDGES,),
    }
    counted = {
        "codes": 2 * (BLOCK + 2) * LANES,
        "keys": 8 * LANES,
        "flags": 8,
        "switch_carry": (LANES, TICK_CYCLES),
        "late_count": (LANES, DEMODULATORS),
        "switch": (LANES, DEMODULATORS),
        "jitter": (LANES, 3),
        "touched": LANES * DEMODULATORS,
        "due": LANES,
        "place": LANES,
    }
    return Eight(
        **{name: aligned(size) for name, size in flat.items()},
        **{name: np.zeros(shape) for name, shape in shaped.items()},
        **{name: np.zeros(shape, np.int64) for name, shape in counted.items()},
    )


@inlined
def _noise(v, pair, counter):
    """Both sources of a pair."""
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
def _of_dac(g, at, u, du, jit):
    f = load(g, at) * u
    f = f + load(g, at + 8) * du
    return f + load(g, at + 16) * jit


@inlined
def _inputs(v, tick, first, n):
    """Rows of what acts in ticks `first` .. `first` + n - 1 of a block: outputs of the DACs, their steps, noise."""
    w = v.w
    carry_d, plain_d = load(v.carry, 0), load(v.carry, LANES)
    carry_s, plain_s = load(v.carry, 2 * LANES), load(v.carry, 3 * LANES)
    late_d, late_s = load(v.late_area, 0), load(v.late_area, LANES)
    zero = splat(0.0)
    for t in range(n):
        k = tick + first + t
        nd, ns, jd, js, fx, fy, nx, ny = zero, zero, zero, zero, zero, zero, zero, zero
        if v.flags[DACS]:
            nd, ns = _noise(v, DACS, k)
        if v.flags[JITTER]:
            jd, js = _noise(v, JITTER, JITTERED * k)
        if v.flags[FORCES]:
            fx, fy = _noise(v, FORCES, k)
        if v.flags[CVS]:
            nx, ny = _noise(v, CVS, k)
        at = 2 * (first + t) * LANES
        before, now, later = _volts(v, 0, at), _volts(v, 0, at + 16), _volts(v, 0, at + 32)
        rise = now - before
        area = (rise * jd) * plain_d + late_d
        late_d = ((later - now) * jd) * carry_d
        if v.flags[GLITCHES]:
            area = area - load(v.throws, at)
        store(w, UD + t * LANES, before + nd)
        store(w, DUD + t * LANES, rise)
        store(w, AD + t * LANES, area)
        before, now, later = _volts(v, 1, at + 8), _volts(v, 1, at + 24), _volts(v, 1, at + 40)
        rise = now - before
        area = (rise * js) * plain_s + late_s
        late_s = ((later - now) * js) * carry_s
        if v.flags[GLITCHES]:
            area = area - load(v.throws, at + LANES)
        store(w, US + t * LANES, before + ns)
        store(w, DUS + t * LANES, rise)
        store(w, AS + t * LANES, area)
        store(w, FX + t * LANES, fx)
        store(w, FY + t * LANES, fy)
        store(w, NX + t * LANES, nx)
        store(w, NY + t * LANES, ny)
    store(v.late_area, 0, late_d)
    store(v.late_area, LANES, late_s)


@inlined
def _poles(v, at, z, row, from_row, n):
    """Two chains of three poles each, of states from `z` on, triangles at `at`, driven by rows from `from_row` on."""
    g, w = v.g, v.w
    p1, p2, p3 = load(v.z, z), load(v.z, z + 8), load(v.z, z + 16)
    for t in range(0, n * LANES, LANES):
        store(w, row + t, p1)
        store(w, row + ROW + t, p2)
        store(w, row + 2 * ROW + t, p3)
        f1, f2, f3 = load(w, from_row + t), load(w, from_row + ROW + t), load(w, from_row + 2 * ROW + t)
        p1, p2, p3 = _three(g, at, p1, p2, p3, f1, f2, f3)
    store(w, row + n * LANES, p1)
    store(w, row + ROW + n * LANES, p2)
    store(w, row + 2 * ROW + n * LANES, p3)
    store(v.z, z, p1)
    store(v.z, z + 8, p2)
    store(v.z, z + 16, p3)


@inlined
def _of_dacs(v, at, u, du, area, out, n):
    """What a DAC gives to its chain."""
    g, w = v.g, v.w
    for t in range(0, n * LANES, LANES):
        x, y, z = load(w, u + t), load(w, du + t), load(w, area + t)
        store(w, out + t, _of_dac(g, at, x, y, z))
        store(w, out + ROW + t, _of_dac(g, at + 24, x, y, z))
        store(w, out + 2 * ROW + t, _of_dac(g, at + 48, x, y, z))


@inlined
def _forced(v, n):
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
        store(w, F + t, a0)
        store(w, F + ROW + t, a1)
        store(w, F + 2 * ROW + t, a2)
        store(w, F + 3 * ROW + t, a3)
        store(w, F + t + LANES, b0)
        store(w, F + ROW + t + LANES, b1)
        store(w, F + 2 * ROW + t + LANES, b2)
        store(w, F + 3 * ROW + t + LANES, b3)


@inlined
def _mode(g, o, x, vx, y, vy, forced):
    at = AT_MODES + (14 * 4 + o) * LANES
    return ((load(g, at) * x + load(g, at + 32) * vx) + (load(g, at + 64) * y + load(g, at + 96) * vy)) + forced


@inlined
def _modes(v, like, counts, numbers, n):
    """Rows X .. VY at each tick's first instant, after the impulses, and the velocities at its end."""
    g, w, z = v.g, v.w, v.z
    x, vx, y, vy = load(z, 48), load(z, 56), load(z, 64), load(z, 72)
    top = load(v.peak, 0)
    for t in range(0, n * LANES, LANES):
        if v.flags[FORCE_EFFECTS]:
            store(w, VX + t, vx)
            store(w, X + t, x)
            pushed(like, counts, numbers, w, VX + t, X + t, D1 + 2 * ROW + t)
            vx = load(w, VX + t)
        store(w, X + t, x)
        store(w, VX + t, vx)
        store(w, Y + t, y)
        store(w, VY + t, vy)
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
    store(z, 48, x)
    store(z, 56, vx)
    store(z, 64, y)
    store(z, 72, vy)
    store(v.peak, 0, top)


@inlined
def _driven(v, at, x, vx, end_vx, out, n):
    """What a mode gives to its three C/V states and three places of the path; two ticks at a time share the numbers."""
    g, w = v.g, v.w
    for t in range(0, n * LANES, 2 * LANES):
        x0, v0, x1, v1 = load(w, x + t), load(w, vx + t), load(w, x + t + 8), load(w, end_vx + t)
        u1, x2, u2 = load(w, vx + t + 8), load(w, x + t + 16), load(w, end_vx + t + 8)
        for k in range(6):
            c0, c1 = load(g, at + 8 * k), load(g, at + 8 * k + 48)
            c2, c3 = load(g, at + 8 * k + 96), load(g, at + 8 * k + 144)
            store(w, out + k * ROW + t, ((c0 * x0 + c1 * v0) + c2 * x1) + c3 * v1)
            store(w, out + k * ROW + t + 8, ((c0 * x1 + c1 * u1) + c2 * x2) + c3 * u2)


@inlined
def _paths(v, at, c, out, n):
    """The SID's path of one channel: what stands there is the mode's part; the C/V states are added."""
    g, w = v.g, v.w
    for k in range(3):
        g1, g2, g3 = load(g, at + 24 * k), load(g, at + 24 * k + 8), load(g, at + 24 * k + 16)
        for t in range(0, n * LANES, LANES):
            row = out + k * ROW + t
            p = (load(w, row) + g1 * load(w, c + t)) + g2 * load(w, c + ROW + t)
            store(w, row, p + g3 * load(w, c + 2 * ROW + t))


@inlined
def _followed(v, d, f1, f2, f3):
    """A tick of demodulator `d` without an edge; returns its output. Mutates `v.on`."""
    at = 3 * d * LANES
    e1, e2, e3 = load(v.sid, 0), load(v.sid, LANES), load(v.sid, 2 * LANES)
    w1, w2, w3 = load(v.on, at), load(v.on, at + LANES), load(v.on, at + 2 * LANES)
    w3 = e1 * w3 + (e2 * w2 + (e3 * w1 + f3))
    w2 = e1 * w2 + (e2 * w1 + f2)
    w1 = e1 * w1 + f1
    store(v.on, at, w1)
    store(v.on, at + LANES, w2)
    store(v.on, at + 2 * LANES, w3)
    return load(v.sign, d * LANES) * (w3 - load(v.off, at + 2 * LANES))


@inlined
def _output(v, d):
    at = (3 * d + 2) * LANES
    return load(v.sign, d * LANES) * (load(v.on, at) - load(v.off, at))


@inlined
def _outputs(v, t, o0, o1, o2, o3):
    store_quads(v.out, 4 * t, OUT, o0, o1, o2, o3)


@outlined
def begun(v, n, edge_counts, edges):
    """The first tick of a block of `n` at which the switches of each plant move. Mutates `v.due`, `v.place`."""
    for plant in range(LANES):
        v.place[plant] = 0
        v.due[plant] = edges[plant, 0, 0] // TICK_CYCLES if edge_counts[plant] > 0 else LATER
        for d in range(DEMODULATORS):
            if v.late_count[plant, d] > 0:
                v.due[plant] = 0
    _outputs(v, 0, _output(v, 0), _output(v, 1), _output(v, 2), _output(v, 3))


@inlined
def _grouped(v, plant, d, ref):
    """Capacitors of one demodulator of one plant as sid.py has them, into row `d` of v.caps. Mutates it."""
    for k in range(STAGES):
        at = (3 * d + k) * LANES + plant
        v.caps[d, k] = v.on[at] if ref else v.off[at]
        v.caps[d, STAGES + k] = v.off[at] if ref else v.on[at]


@outlined
def edges_of(v, tick, t, row, plant, edge_count, edges):
    """Tick `t` of a block for a plant in which switches move, in place `row` of the strip. Returns how many do.

    Leaves their capacitors in v.fixed; mutates `v`, but for the capacitors themselves.
    """
    first = v.place[plant]
    last = first
    while last < edge_count and edges[last, 0] < (t + 1) * TICK_CYCLES:
        last += 1
    v.place[plant] = last
    jitter = noise.Source(
        v.jitter[plant, 0],
        v.jitter[plant, 1],
        v.sigma[2 * LANES * JITTER + plant],
        v.jitter[plant, 2],
        0,
    )
    q = v.sid_numbers[plant]
    p = sid.Params(q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7], v.sid_inject[plant], v.sid_taylor[plant])
    gain, driver_s, w, k = v.slope_gain[plant], v.driver_s[plant], v.w, row * LANES + plant
    kept, moved = 0, 0
    for d in range(DEMODULATORS):
        count, late = acting(
            v.switch_tau_s[plant],
            v.switch_carry[plant],
            jitter,
            p.h_s,
            tick + t,
            t,
            d,
            first,
            last,
            edges,
            v.late_tau_s[plant, d],
            v.late_count[plant, d],
            v.taus_s,
        )
        v.late_count[plant, d] = late
        kept += late
        if count > 0:
            path, cv, n = (
                (B + 3 * ROW + k, CX1 + ROW + k, w[NX + k]) if d < 2 else (B + 9 * ROW + k, CY1 + ROW + k, w[NY + k])
            )
            p1, p2, p3 = w[path], w[path + ROW], w[path + 2 * ROW]
            before, v0, after, v1 = w[cv], w[cv + ROW], w[cv + LANES], w[cv + ROW + LANES]
            dv0, dv1 = (gain * before - v0) / driver_s, (gain * after - v1) / driver_s
            ref = v.switch[plant, d]
            _grouped(v, plant, d, ref)
            v.switch[plant, d] = switched(p, v.caps, d, ref, v.taus_s, count, n, p1, p2, p3, v0, dv0, v1, dv1)
            place = DEMODULATORS * plant + d
            for i in range(6):
                v.fixed[place, i] = v.caps[d, i]
            v.touched[place] = 1
            moved += 1
    v.due[plant] = edges[last, 0] // TICK_CYCLES if last < edge_count else LATER
    if kept > 0:
        v.due[plant] = t + 1
    return moved


@outlined
def repaired(v, t):
    """Capacitors and outputs of the demodulators that `edges_of` has computed, over those of a tick without an edge."""
    for place in range(LANES * DEMODULATORS):
        if v.touched[place]:
            v.touched[place] = 0
            plant, d = place // DEMODULATORS, place % DEMODULATORS
            ref = v.switch[plant, d]
            for k in range(STAGES):
                at = (3 * d + k) * LANES + plant
                v.on[at] = v.fixed[place, k if ref else STAGES + k]
                v.off[at] = v.fixed[place, STAGES + k if ref else k]
            v.sign[d * LANES + plant] = 1.0 if ref else -1.0
            v.out[OUT * plant + 4 * (t + 1) + d] = v.fixed[place, 2] - v.fixed[place, 5]


@outlined
def pushed(like, counts, numbers, w, vx, x, d3):
    """Impulses of the effects on eight velocities of row `vx`, from places `x` and drive voltages `d3`. Mutates `w`."""
    for plant in range(LANES):
        e = taken(like, counts[plant], numbers[plant])
        if e.any_force:
            w[vx + plant] = w[vx + plant] + effects.force_impulse(e, w[x + plant], w[d3 + plant])


@outlined
def added(v, like, counts, numbers, n):
    """What the effects add to the C/V noise of `n` ticks. Mutates its rows."""
    w = v.w
    for plant in range(LANES):
        e = taken(like, counts[plant], numbers[plant])
        if e.any_cv:
            for t in range(n):
                k = t * LANES + plant
                start, end = w[D1 + 2 * ROW + k], w[D1 + 2 * ROW + k + LANES]
                w[NX + k], w[NY + k] = effects.cv_volts(e, w[NX + k], w[NY + k], start, end)


@outlined
def _linear(v, like, counts, numbers, tick, first, n):
    """Everything up to the demodulators for `n` ticks (at most STRIP) of a block, from its tick `first` on."""
    _inputs(v, tick, first, n)
    _of_dacs(v, AT_DRIVE, UD, DUD, AD, B, n)
    _of_dacs(v, AT_SENSE, US, DUS, AS, B + 3 * ROW, n)
    _poles(v, AT_DRIVE + 72, 0, D1, B, n)
    _poles(v, AT_SENSE + 72, 24, S1, B + 3 * ROW, n)
    _forced(v, n)
    _modes(v, like, counts, numbers, n)
    _driven(v, AT_PICKOFF, X, VX, END_VX, B, n)
    _driven(v, AT_PICKOFF + 192, Y, VY, END_VY, B + 6 * ROW, n)
    _poles(v, AT_CV, 80, CX1, B, n)
    _poles(v, AT_CV + CV, 104, CY1, B + 6 * ROW, n)
    _paths(v, AT_CV + 48, CX1, B + 3 * ROW, n)
    _paths(v, AT_CV + CV + 48, CY1, B + 9 * ROW, n)
    if v.flags[CV_EFFECTS]:
        added(v, like, counts, numbers, n)


@inlined
def _feed(v, t, path, noise_row):
    w = v.w
    n = load(w, noise_row + t)
    return (
        load(w, path + t) + n * load(v.sid, 3 * LANES),
        load(w, path + ROW + t) + n * load(v.sid, 4 * LANES),
        load(w, path + 2 * ROW + t) + n * load(v.sid, 5 * LANES),
    )


@outlined
def _demodulated(v, tick, first, n, soonest, edge_counts, edges):
    """The demodulators over a strip. Returns the tick of the block at which a switch moves next."""
    for t in range(n):
        moved = 0
        if first + t == soonest:
            soonest = LATER
            for plant in range(LANES):
                if v.due[plant] == first + t:
                    moved += edges_of(v, tick, first + t, t, plant, edge_counts[plant], edges[plant])
                soonest = min(soonest, v.due[plant])
        f1, f2, f3 = _feed(v, t * LANES, B + 3 * ROW, NX)
        o0 = _followed(v, 0, f1, f2, f3)
        o1 = _followed(v, 1, f1, f2, f3)
        f1, f2, f3 = _feed(v, t * LANES, B + 9 * ROW, NY)
        o2 = _followed(v, 2, f1, f2, f3)
        o3 = _followed(v, 3, f1, f2, f3)
        _outputs(v, first + t + 1, o0, o1, o2, o3)
        if moved:
            repaired(v, first + t)
    return soonest


@outlined
def block(v, like, counts, numbers, tick, n, edge_counts, edges):
    """`n` ticks of all eight from `tick` on, all of one frame; v.codes holds what the DACs put out. Mutates `v`.

    like, counts, numbers     an effects.Params for its type, and the rows of integers and of floats of each plant's
    edge_counts, edges        (8,) and (8, n, 2): clock from the block's first, and reference number
    """
    begun(v, n, edge_counts, edges)
    soonest = LATER
    for plant in range(LANES):
        soonest = min(soonest, v.due[plant])
    for first in range(0, n, STRIP):
        count = min(STRIP, n - first)
        _linear(v, like, counts, numbers, tick, first, count)
        soonest = _demodulated(v, tick, first, count, soonest, edge_counts, edges)
