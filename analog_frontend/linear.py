"""The linear part of a block of plant ticks: output chains, modes, C/V chains, the SID's path; frozen to the last bit.

    g[j, o]   the matrix of the frame (propagator.py: row = input, column = output)       t   tick of the block
    q         its `pickoff`: what the cubic through both ends of a tick gives
    chains    f_k = (g u + g du) + g jit           d1' = g d1 + f_1      d2' = g d2 + (g d1 + f_2)
                                                   d3' = g d3 + ((g d1 + g d2) + f_3)
    forced    sum over INPUTS in their order, from the first product
    modes     o' = ((g x + g vx) + (g y + g vy)) + forced
    b_k       ((q x + q vx) + q x') + q vx'        the ends of the mode's tick, before any impulse of the next one
    C/V       c1' = g c1 + b_1     c2' = g c2 + (g c1 + b_2)     c3' = g c3 + ((g c1 + g c2) + b_3)
    path      p_k = ((b_k + g c1) + g c2) + g c3

    u du jit --[chains]-- d, s --+--[modes]-- x vx y vy --[C/V]-- c --[path]-- p
    forces, noise ---------------'

Entries of g that are zero by structure (a chain does not feel the mode) are not multiplied.
Blocks     of 1 .. 128 ticks in an arena of rows, row R of tick t at R * STRIDE + t. How ticks are cut into blocks
           changes no bit: recursions run tick by tick, everything else eight ticks at a time
Source     docs/architecture.md, docs/decisions/0007-frame-engine.md
"""

import numpy as np

from analog_frontend import effects
from analog_frontend.effects import law
from analog_frontend.numeric.vector import LANES, load, splat, store, store_rows
from analog_frontend.parts.propagator import (
    DU_DRIVE,
    DU_SENSE,
    F_X,
    F_Y,
    JIT_DRIVE,
    JIT_SENSE,
    PX1,
    PY1,
    U_DRIVE,
    U_SENSE,
)
from fpga_model.jit import inlined, outlined

BLOCK = 128
# At least one value more than ticks: the states after the last tick stand behind it. 21 cache lines, because rows
# whose distance is near a multiple of 4096 bytes slow each other down.
STRIDE = 168

# Rows. The first fourteen stand in the order of INPUTS; states are those at a tick's first instant.
D1, D2, D3, S1, S2, S3 = range(6)
IN_U_DRIVE, IN_DU_DRIVE, IN_U_SENSE, IN_DU_SENSE, IN_JIT_DRIVE, IN_JIT_SENSE, IN_FX, IN_FY = range(6, 14)
X, VX, Y, VY = range(14, 18)
CX1, CX2, CX3, CY1, CY2, CY3 = range(18, 24)
FORCED_CHAIN = 24  # 6 rows
FORCED_MODES = 30  # 4 rows
B_CV = 34  # 6 rows: b of the C/V states, drive then sense
PATH = 40  # 6 rows: the SID's path, drive then sense
LEVEL_DRIVE, LEVEL_SENSE = 46, 47  # DAC outputs without noise
CV_NOISE_X, CV_NOISE_Y = 48, 49
FEED = 50  # 6 rows: what a tick gives to the closed capacitors, drive then sense
JITTER_DRIVE, JITTER_SENSE = 56, 57
CV_ADDED_X, CV_ADDED_Y = 58, 59  # noise and effects
END_VX, END_VY = 60, 61  # velocities at the end of a tick, where an impulse changes them before the next
ROWS = 62

INPUTS = (0, 1, 2, 3, 4, 5, U_DRIVE, DU_DRIVE, U_SENSE, DU_SENSE, JIT_DRIVE, JIT_SENSE, F_X, F_Y)
STATE_ROWS = (D1, D2, D3, S1, S2, S3, X, VX, Y, VY, CX1, CX2, CX3, CY1, CY2, CY3)
FORCED_COUNT = len(INPUTS)
STATE_OFFSETS = np.array(STATE_ROWS) * STRIDE  # of each state, for laws


@inlined
def _fill_chain_forcing(g, w, n, first, u, du, jit, in_u, in_du, in_jit):
    """What its DAC gives to the three states of a chain."""
    for t in range(0, n, LANES):
        for k in range(3):
            f = splat(g[in_u, first + k]) * load(w, u * STRIDE + t)
            f = f + splat(g[in_du, first + k]) * load(w, du * STRIDE + t)
            f = f + splat(g[in_jit, first + k]) * load(w, jit * STRIDE + t)
            store(w, (FORCED_CHAIN + first + k) * STRIDE + t, f)


@inlined
def _pairs_of_three(g, w, n, a, row_a, from_a, b, row_b, from_b):
    """Two chains of three poles, states from `a` and `b` of z in rows from `row_*`, driven by rows from `from_*`.

    Both in one loop: each waits for its own last tick, and the other fills the time.
    """
    a11, a22, a33, a12, a13, a23 = g[a, a], g[a + 1, a + 1], g[a + 2, a + 2], g[a, a + 1], g[a, a + 2], g[a + 1, a + 2]
    b11, b22, b33, b12, b13, b23 = g[b, b], g[b + 1, b + 1], g[b + 2, b + 2], g[b, b + 1], g[b, b + 2], g[b + 1, b + 2]
    i, j, fi, fj = row_a * STRIDE, row_b * STRIDE, from_a * STRIDE, from_b * STRIDE
    p1, p2, p3 = w[i], w[i + STRIDE], w[i + 2 * STRIDE]
    q1, q2, q3 = w[j], w[j + STRIDE], w[j + 2 * STRIDE]
    for t in range(n):
        p3 = a33 * p3 + ((a13 * p1 + a23 * p2) + w[fi + 2 * STRIDE + t])
        q3 = b33 * q3 + ((b13 * q1 + b23 * q2) + w[fj + 2 * STRIDE + t])
        p2 = a22 * p2 + (a12 * p1 + w[fi + STRIDE + t])
        q2 = b22 * q2 + (b12 * q1 + w[fj + STRIDE + t])
        p1 = a11 * p1 + w[fi + t]
        q1 = b11 * q1 + w[fj + t]
        w[i + t + 1] = p1
        w[i + STRIDE + t + 1] = p2
        w[i + 2 * STRIDE + t + 1] = p3
        w[j + t + 1] = q1
        w[j + STRIDE + t + 1] = q2
        w[j + 2 * STRIDE + t + 1] = q3


@outlined
def chains(g, w, n):
    """The two output chains: rows D1 .. S3 from their inputs. Mutates `w`."""
    _fill_chain_forcing(g, w, n, D1, IN_U_DRIVE, IN_DU_DRIVE, IN_JIT_DRIVE, U_DRIVE, DU_DRIVE, JIT_DRIVE)
    _fill_chain_forcing(g, w, n, S1, IN_U_SENSE, IN_DU_SENSE, IN_JIT_SENSE, U_SENSE, DU_SENSE, JIT_SENSE)
    _pairs_of_three(g, w, n, D1, D1, FORCED_CHAIN, S1, S1, FORCED_CHAIN + 3)


@inlined
def _sums(g, w, n, column, row):
    """Sums over INPUTS into four outputs from `column` on, in rows from `row` on.

    Sixteen ticks at a time, eight at the end: eight sums wait for each other's latency and share what they load.
    """
    first, t = row * STRIDE, 0
    while t + LANES < n:
        x, y = load(w, t), load(w, t + LANES)
        c0, c1 = splat(g[0, column]), splat(g[0, column + 1])
        c2, c3 = splat(g[0, column + 2]), splat(g[0, column + 3])
        a0, a1, a2, a3 = c0 * x, c1 * x, c2 * x, c3 * x
        b0, b1, b2, b3 = c0 * y, c1 * y, c2 * y, c3 * y
        for k in range(1, FORCED_COUNT):
            j = INPUTS[k]
            x, y = load(w, k * STRIDE + t), load(w, k * STRIDE + t + LANES)
            c0, c1 = splat(g[j, column]), splat(g[j, column + 1])
            c2, c3 = splat(g[j, column + 2]), splat(g[j, column + 3])
            a0, a1, a2, a3 = a0 + c0 * x, a1 + c1 * x, a2 + c2 * x, a3 + c3 * x
            b0, b1, b2, b3 = b0 + c0 * y, b1 + c1 * y, b2 + c2 * y, b3 + c3 * y
        store_rows(w, first + t, STRIDE, (a0, a1, a2, a3))
        store_rows(w, first + t + LANES, STRIDE, (b0, b1, b2, b3))
        t += 2 * LANES
    if t < n:
        x = load(w, t)
        a0, a1 = splat(g[0, column]) * x, splat(g[0, column + 1]) * x
        a2, a3 = splat(g[0, column + 2]) * x, splat(g[0, column + 3]) * x
        for k in range(1, FORCED_COUNT):
            j = INPUTS[k]
            x = load(w, k * STRIDE + t)
            a0, a1 = a0 + splat(g[j, column]) * x, a1 + splat(g[j, column + 1]) * x
            a2, a3 = a2 + splat(g[j, column + 2]) * x, a3 + splat(g[j, column + 3]) * x
        store_rows(w, first + t, STRIDE, (a0, a1, a2, a3))


@inlined
def _step_modes(g, w, n, e, laws, gains, pushed):
    f = FORCED_MODES * STRIDE
    x, vx, y, vy = w[X * STRIDE], w[VX * STRIDE], w[Y * STRIDE], w[VY * STRIDE]
    for t in range(n):
        if pushed:
            add_x = effects.force_impulse(e, x, law.start_state(w, STATE_OFFSETS, law.U, t, t + 1, laws.leads))
            if laws.force:
                law_x, law_y = law.impulses(laws.force, laws.table, gains, w, STATE_OFFSETS, t, t + 1, laws.leads)
                add_x, vy = add_x + law_x, vy + law_y
                w[VY * STRIDE + t] = vy
            vx = vx + add_x
            w[VX * STRIDE + t] = vx
        nx = ((g[6, 6] * x + g[7, 6] * vx) + (g[8, 6] * y + g[9, 6] * vy)) + w[f + t]
        nvx = ((g[6, 7] * x + g[7, 7] * vx) + (g[8, 7] * y + g[9, 7] * vy)) + w[f + STRIDE + t]
        ny = ((g[6, 8] * x + g[7, 8] * vx) + (g[8, 8] * y + g[9, 8] * vy)) + w[f + 2 * STRIDE + t]
        nvy = ((g[6, 9] * x + g[7, 9] * vx) + (g[8, 9] * y + g[9, 9] * vy)) + w[f + 3 * STRIDE + t]
        if pushed:
            w[END_VX * STRIDE + t] = nvx
            w[END_VY * STRIDE + t] = nvy
        x, vx, y, vy = nx, nvx, ny, nvy
        w[X * STRIDE + t + 1] = x
        w[VX * STRIDE + t + 1] = vx
        w[Y * STRIDE + t + 1] = y
        w[VY * STRIDE + t + 1] = vy


@outlined
def modes(g, w, n, e, laws, gains):
    """The two modes: rows X .. VY; effects and laws push the velocities before each tick. Mutates `w`."""
    _sums(g, w, n, 6, FORCED_MODES)
    # two loops, so that effects that are off cost one branch a block
    if e.any_force or laws.force:
        _step_modes(g, w, n, e, laws, gains, True)
    else:
        _step_modes(g, w, n, e, laws, gains, False)


@inlined
def _fill_pickoff_forcing(q, w, n, x, vx, end_vx, out):
    """What a mode gives to its C/V states and SID path: three rows from `out`, three from that of its path.

    q       (4, 6)
    x, vx   first places of the mode's rows; end_vx  of the velocity at the end of tick 0
    """
    for t in range(0, n, LANES):
        x0, v0, x1, v1 = load(w, x + t), load(w, vx + t), load(w, x + t + 1), load(w, end_vx + t)
        for k in range(6):
            b = ((splat(q[0, k]) * x0 + splat(q[1, k]) * v0) + splat(q[2, k]) * x1) + splat(q[3, k]) * v1
            row = k if k < 3 else PATH - B_CV + k - 3
            store(w, out + row * STRIDE + t, b)


@inlined
def _add_cv_to_sid_path(g, w, n, first, row, column, out):
    """The SID's path of one channel: what stands there is b; the C/V states are added."""
    for t in range(0, n, LANES):
        c1, c2, c3 = load(w, row * STRIDE + t), load(w, (row + 1) * STRIDE + t), load(w, (row + 2) * STRIDE + t)
        for k in range(3):
            at = (out + k) * STRIDE + t
            p = (load(w, at) + splat(g[first, column + k]) * c1) + splat(g[first + 1, column + k]) * c2
            store(w, at, p + splat(g[first + 2, column + k]) * c3)


@outlined
def pickoffs(g, q, w, n, pushed):
    """C/V states and the SID's paths: rows CX1 .. CY3 and PATH. Mutates `w`.

    q       (2, 4, 6) of both channels
    pushed  whether effects push the velocities between ticks
    """
    x_end, y_end = (END_VX * STRIDE, END_VY * STRIDE) if pushed else (VX * STRIDE + 1, VY * STRIDE + 1)
    _fill_pickoff_forcing(q[0], w, n, X * STRIDE, VX * STRIDE, x_end, B_CV * STRIDE)
    _fill_pickoff_forcing(q[1], w, n, Y * STRIDE, VY * STRIDE, y_end, (B_CV + 3) * STRIDE)
    _pairs_of_three(g, w, n, 10, CX1, B_CV, 13, CY1, B_CV + 3)
    _add_cv_to_sid_path(g, w, n, 10, CX1, PX1, PATH)
    _add_cv_to_sid_path(g, w, n, 13, CY1, PY1, PATH + 3)


@inlined
def largest(w, n, row):
    """Largest magnitude in places 1 .. n of a row."""
    top = 0.0
    for t in range(1, n + 1):
        top = max(top, abs(w[row * STRIDE + t]))
    return top
