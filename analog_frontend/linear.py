"""The linear part of a block of plant ticks: output chains, modes, C/V chains, the SID's path; frozen to the last bit.

    g[j, o]   the matrix of the frame (propagator.py: row = input, column = output)       t   tick of the block
    chains    f_k = (g u + g du) + g jit           d1' = g d1 + f_1      d2' = g d2 + (g d1 + f_2)
                                                   d3' = g d3 + ((g d1 + g d2) + f_3)
    forced    sum over INPUTS in their order, from the first product
    modes     o' = ((g x + g vx) + (g y + g vy)) + forced
    b         forced, then + g x, + g vx, + g y, + g vy one after the other
    C/V       c1' = g c1 + b_1     c2' = g c2 + (g c1 + b_2)     c3' = g c3 + ((g c1 + g c2) + b_3)
    path      p_k = ((b_k + g c1) + g c2) + g c3

    u du jit --[chains]-- d, s --+--[modes]-- x vx y vy --+--[C/V]-- c --[path]-- p
    forces, noise ---------------'        forced ---------'

Entries of g that are zero by structure (a chain does not feel the mode) are not multiplied.
Blocks     of 1 .. 128 ticks in an arena of rows, row R of tick t at R * STRIDE + t. How ticks are cut into blocks
           changes no bit: recursions run tick by tick, everything else eight ticks at a time
Source     docs/architecture.md, docs/decisions/0007-frame-engine.md
"""

from analog_frontend import effects
from analog_frontend.propagator import DU_DRIVE, DU_SENSE, F_X, F_Y, JIT_DRIVE, JIT_SENSE, PX1, PY1, U_DRIVE, U_SENSE
from analog_frontend.vector import LANES, load, splat, store
from fpga_model.jit import inlined, outlined

BLOCK = 128
STRIDE = BLOCK + LANES  # one value more than ticks: the states after the last tick stand behind it

# Rows. The first eighteen stand in the order of SOURCES; states are those at a tick's first instant.
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
ROWS = 60

INPUTS = (0, 1, 2, 3, 4, 5, U_DRIVE, DU_DRIVE, U_SENSE, DU_SENSE, JIT_DRIVE, JIT_SENSE, F_X, F_Y)
SOURCES = (*INPUTS, 6, 7, 8, 9)
STATE_ROWS = (D1, D2, D3, S1, S2, S3, X, VX, Y, VY, CX1, CX2, CX3, CY1, CY2, CY3)
FORCED_COUNT, SOURCE_COUNT = len(INPUTS), len(SOURCES)


@inlined
def _chain(g, w, n, first, u, du, jit, in_u, in_du, in_jit):
    f1, f2, f3 = (
        (FORCED_CHAIN + first) * STRIDE,
        (FORCED_CHAIN + first + 1) * STRIDE,
        (FORCED_CHAIN + first + 2) * STRIDE,
    )
    for t in range(0, n, LANES):
        for k in range(3):
            f = splat(g[in_u, first + k]) * load(w, u * STRIDE + t) + splat(g[in_du, first + k]) * load(
                w, du * STRIDE + t
            )
            store(w, f1 + k * STRIDE + t, f + splat(g[in_jit, first + k]) * load(w, jit * STRIDE + t))
    g11, g22, g33 = g[first, first], g[first + 1, first + 1], g[first + 2, first + 2]
    g12, g13, g23 = g[first, first + 1], g[first, first + 2], g[first + 1, first + 2]
    r1, r2, r3 = first * STRIDE, (first + 1) * STRIDE, (first + 2) * STRIDE
    d1, d2, d3 = w[r1], w[r2], w[r3]
    for t in range(n):
        d3 = g33 * d3 + ((g13 * d1 + g23 * d2) + w[f3 + t])
        d2 = g22 * d2 + (g12 * d1 + w[f2 + t])
        d1 = g11 * d1 + w[f1 + t]
        w[r1 + t + 1] = d1
        w[r2 + t + 1] = d2
        w[r3 + t + 1] = d3


@outlined
def chains(g, w, n):
    """The two output chains: rows D1 .. S3 from their inputs. Mutates `w`."""
    _chain(g, w, n, D1, IN_U_DRIVE, IN_DU_DRIVE, IN_JIT_DRIVE, U_DRIVE, DU_DRIVE, JIT_DRIVE)
    _chain(g, w, n, S1, IN_U_SENSE, IN_DU_SENSE, IN_JIT_SENSE, U_SENSE, DU_SENSE, JIT_SENSE)


@inlined
def _sums(g, w, t, column, count, row):
    """Sum over the first `count` of SOURCES into `column` for sixteen ticks: two registers hide each other's latency."""
    c = splat(g[0, column])
    a, b = c * load(w, t), c * load(w, t + LANES)
    for k in range(1, count):
        c = splat(g[SOURCES[k], column])
        a = a + c * load(w, k * STRIDE + t)
        b = b + c * load(w, k * STRIDE + t + LANES)
    store(w, row * STRIDE + t, a)
    store(w, row * STRIDE + t + LANES, b)


@outlined
def modes(g, w, n, e):
    """The two modes: rows X .. VY; effects push the velocity before each tick. Mutates `w`."""
    for t in range(0, n, 2 * LANES):
        for o in range(4):
            _sums(g, w, t, 6 + o, FORCED_COUNT, FORCED_MODES + o)
    f = FORCED_MODES * STRIDE
    x, vx, y, vy = w[X * STRIDE], w[VX * STRIDE], w[Y * STRIDE], w[VY * STRIDE]
    for t in range(n):
        if e.any_force:
            vx = vx + effects.force_impulse(e, x, w[D3 * STRIDE + t])
            w[VX * STRIDE + t] = vx
        nx = ((g[6, 6] * x + g[7, 6] * vx) + (g[8, 6] * y + g[9, 6] * vy)) + w[f + t]
        nvx = ((g[6, 7] * x + g[7, 7] * vx) + (g[8, 7] * y + g[9, 7] * vy)) + w[f + STRIDE + t]
        ny = ((g[6, 8] * x + g[7, 8] * vx) + (g[8, 8] * y + g[9, 8] * vy)) + w[f + 2 * STRIDE + t]
        nvy = ((g[6, 9] * x + g[7, 9] * vx) + (g[8, 9] * y + g[9, 9] * vy)) + w[f + 3 * STRIDE + t]
        x, vx, y, vy = nx, nvx, ny, nvy
        w[X * STRIDE + t + 1] = x
        w[VX * STRIDE + t + 1] = vx
        w[Y * STRIDE + t + 1] = y
        w[VY * STRIDE + t + 1] = vy


@inlined
def _pickoff(g, w, n, first, row, b):
    """C/V chain whose first state is number `first` of z, in rows from `row`."""
    g11, g22, g33 = g[first, first], g[first + 1, first + 1], g[first + 2, first + 2]
    g12, g13, g23 = g[first, first + 1], g[first, first + 2], g[first + 1, first + 2]
    r1, r2, r3 = row * STRIDE, (row + 1) * STRIDE, (row + 2) * STRIDE
    b1, b2, b3 = b * STRIDE, (b + 1) * STRIDE, (b + 2) * STRIDE
    c1, c2, c3 = w[r1], w[r2], w[r3]
    for t in range(n):
        c3 = g33 * c3 + ((g13 * c1 + g23 * c2) + w[b3 + t])
        c2 = g22 * c2 + (g12 * c1 + w[b2 + t])
        c1 = g11 * c1 + w[b1 + t]
        w[r1 + t + 1] = c1
        w[r2 + t + 1] = c2
        w[r3 + t + 1] = c3


@inlined
def _path(g, w, n, first, row, column, out):
    """The SID's path of one channel: what stands there is b; the C/V states are added."""
    for t in range(0, n, LANES):
        c1, c2, c3 = load(w, row * STRIDE + t), load(w, (row + 1) * STRIDE + t), load(w, (row + 2) * STRIDE + t)
        for k in range(3):
            at = (out + k) * STRIDE + t
            p = (load(w, at) + splat(g[first, column + k]) * c1) + splat(g[first + 1, column + k]) * c2
            store(w, at, p + splat(g[first + 2, column + k]) * c3)


@outlined
def pickoffs(g, w, n):
    """C/V states and the SID's paths: rows CX1 .. CY3 and PATH. Mutates `w`."""
    for t in range(0, n, 2 * LANES):
        for o in range(6):
            _sums(g, w, t, 10 + o, SOURCE_COUNT, B_CV + o)
            _sums(g, w, t, PX1 + o, SOURCE_COUNT, PATH + o)
    _pickoff(g, w, n, 10, CX1, B_CV)
    _pickoff(g, w, n, 13, CY1, B_CV + 3)
    _path(g, w, n, 10, CX1, PX1, PATH)
    _path(g, w, n, 13, CY1, PY1, PATH + 3)


@inlined
def largest(w, n, row):
    """Largest magnitude in places 1 .. n of a row."""
    top = 0.0
    for t in range(1, n + 1):
        top = max(top, abs(w[row * STRIDE + t]))
    return top
