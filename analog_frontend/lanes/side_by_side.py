"""Eight plants side by side: their arrays, and where in them everything stands. Lane l of a register is plant l.

    side_by_side_linear.py   inputs, chains, modes, C/V           side_by_side_sid.py   demodulators, reference edges
    side_by_side_top.py      a block of ticks of all eight

    g       entries of the plants' matrices in the order of ENTRIES       z   linear states, order of top.State.z
    codes   of the DACs: row 2 t + which holds what is put out at the beginning of tick t of the block
    on      the SID's capacitors that follow, off those that hold: row 3 d + k; sign +-1 of demodulator d
    out     output of plant l's demodulator d at the start of tick t, at 8 (TICKS d + t) + l

The operations are those of linear.py, sid.py and noise.py in their order, so that eight plants have the bits of eight
single ones (asserted by the tests of the lanes engine).
Source    docs/architecture.md, docs/decisions/0012-lanes.md
"""

from typing import NamedTuple

import numpy as np

from analog_frontend import effects
from analog_frontend.effects import law
from analog_frontend.linear import BLOCK, INPUTS
from analog_frontend.numeric.arena import record_layout
from analog_frontend.numeric.records import split
from analog_frontend.numeric.shapes import doubles, int64s
from analog_frontend.numeric.vector import LANES
from analog_frontend.parts.propagator import DU_DRIVE, DU_SENSE, JIT_DRIVE, JIT_SENSE, PX1, PY1, U_DRIVE, U_SENSE
from analog_frontend.top import DEMODULATORS, MAX_EDGES, STATES

TICKS = BLOCK + 1
D, S, MODE, DRIVE_CV, SENSE_CV = 0, 3, 6, 10, 13  # first states in z


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
STILL = len(ENTRIES) + 2 * 24
CHAIN, CV = 15 * LANES, 15 * LANES
AT_DRIVE, AT_SENSE = 0, CHAIN
AT_CV = 2 * CHAIN
AT_PICKOFF = AT_CV + 2 * CV
AT_MODES = AT_PICKOFF + 2 * 24 * LANES
SIZE = AT_MODES + len(MOVING) * LANES
# pairs of noise sources, in `sigma` and `keys`
DACS, JITTER, FORCES, CVS = range(4)
GLITCHES, FORCE_EFFECTS, CV_EFFECTS, BOWS, LAWS = range(4, 9)  # of `flags`, after the four pairs
# a strip of ticks that stays in the first cache; a row holds one value more, for states at its end
STRIP = 16
ROW = (STRIP + 2) * LANES
D1, S1 = 0, 3 * ROW
UD, DUD, US, DUS, AD, AS, FX, FY, X, VX, Y, VY, END_VX, END_VY, NX, NY, CX1, CY1, F, PATH_X, PATH_Y = (
    k * ROW for k in (6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 25, 28, 32, 35)
)
ROWS = 38
# of each state, for laws; those of a C/V chain's first pole are not kept
STATE_OFFSETS = np.array([D1, D1 + ROW, D1 + 2 * ROW, S1, S1 + ROW, S1 + 2 * ROW, X, VX, Y, VY])
STATE_OFFSETS = np.concatenate([STATE_OFFSETS, [CX1 + k * ROW for k in range(3)], [CY1 + k * ROW for k in range(3)]])
# rows of the inputs of the modes, in the order of linear.INPUTS
FORCED_BY = (D1, D1 + ROW, D1 + 2 * ROW, S1, S1 + ROW, S1 + 2 * ROW, UD, DUD, US, DUS, AD, AS, FX, FY)
NUMBERS = 8  # scalars of sid.Params
MOST_CLOCKS = 32  # to a tick
SLOTS = 16  # most edges of a plant in a strip that go together
EDGE_INPUT_ROWS, FACTORS = 9, 15  # rows of a slot, see side_by_side_sid.py
EFFECT_INTEGERS, EFFECT_NUMBERS = (len(part) for part in split(effects.OFF))


class SideBySide(NamedTuple):
    """Arrays of eight plants, mutated in place; a first axis of eight, or lanes side by side in a flat array."""

    g: doubles(SIZE)
    z: doubles(STATES * LANES)
    codes: int64s(2 * (BLOCK + 2) * LANES)
    dac: doubles(2 * 5 * LANES)  # per DAC: lsb (V), offset (V), bow, full scale in codes, and its inverse
    carry: doubles(4 * LANES)  # per DAC: 1 where a code acts a tick later, then 1 where not
    late_area: doubles(2 * LANES)
    throws: doubles(2 * BLOCK * LANES)  # glitch areas, if `glitches`
    sigma: doubles(8 * LANES)
    keys: int64s(8 * LANES)
    on: doubles(12 * LANES)
    off: doubles(12 * LANES)
    sign: doubles(4 * LANES)
    sid: doubles(6 * LANES)  # e1 e2 e3 s1 s2 s3
    out: doubles(DEMODULATORS * TICKS * LANES)
    w: doubles(ROWS * ROW)  # scratch: rows of a strip
    peak: doubles(LANES)  # largest |x|
    flags: int64s(9)  # noise pair in use, four of them; any glitch, force effect, C/V effect, bow, law
    switch_tau_s: doubles(LANES, 2, MOST_CLOCKS)
    switch_carry: int64s(LANES, 2, MOST_CLOCKS)
    late_tau_s: doubles(LANES, DEMODULATORS, MAX_EDGES)
    late_count: int64s(LANES, DEMODULATORS)
    switch: int64s(LANES, DEMODULATORS)
    driver_s: doubles(LANES)
    slope_gain: doubles(LANES)
    h_s: doubles(LANES)
    clocks: int64s(1)  # master clocks to a tick, the same for all
    r: doubles(LANES)
    taylor: doubles(64 * LANES)
    sid_numbers: doubles(LANES, NUMBERS)
    sid_inject: doubles(LANES, 6)
    sid_taylor: doubles(LANES, 64)
    effects_i: int64s(LANES, EFFECT_INTEGERS)  # rows of effects.Params
    effects_f: doubles(LANES, EFFECT_NUMBERS)
    law_counts: int64s(LANES, 2)  # laws at force ports, at C/V ports
    law_tables: int64s(LANES, law.SLOTS, law.COLUMNS)  # tables of law.Params
    law_numbers: doubles(LANES, law.SLOTS, len(law.NUMBERS))
    law_leads: doubles(LANES, 2)
    law_temps: doubles(LANES)  # reference of temp (degC)
    law_gains: doubles(LANES, law.SLOTS)  # in this frame
    active: int64s(LANES)  # 1 for those that take part in a block; of the others nothing is of any use
    edge_counts: int64s(LANES)
    edges: int64s(LANES, MAX_EDGES * (BLOCK + 3), 2)  # clock from the block's first, and reference number
    caps: doubles(DEMODULATORS, 6)  # scratch
    fixed: doubles(LANES * DEMODULATORS, 6)  # scratch: capacitors of those with an edge
    touched: int64s(LANES * DEMODULATORS)  # which those are
    edge_inputs: doubles(SLOTS * EDGE_INPUT_ROWS * LANES)  # scratch: what an edge depends on
    factors: doubles(SLOTS * FACTORS * LANES)  # scratch: what it gives
    counters: int64s(SLOTS * LANES)  # scratch: of its jitter
    slots: int64s(LANES)  # scratch: slots of a plant's edges in the strip, or -1; the next one
    slot: int64s(LANES)
    taus_s: doubles(MAX_EDGES)  # scratch
    due: int64s(LANES)  # scratch: tick of a plant's next edge
    edge_index: int64s(LANES)  # scratch: its place in the list


AT = record_layout(SideBySide)
opened = AT.opened
