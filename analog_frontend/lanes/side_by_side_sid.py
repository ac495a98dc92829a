"""Eight plants: the demodulators of a strip of ticks, and the ticks in which a reference edge falls.

Without an edge all 32 demodulators follow at once (`step_edgeless_ticks`). Edges are gathered, one of each plant in a
slot: what does not depend on the capacitors is computed for all eight at once, as sid.py's `edge` does; then the
capacitors change one by one. Strips that differ (an edge that acts a tick later) go by the functions that `top` calls.
Source    docs/decisions/0012-lanes.md
"""

from analog_frontend.lanes.side_by_side import (
    CX1,
    CY1,
    EDGE_INPUT_ROWS,
    FACTORS,
    JITTER,
    LANES,
    NX,
    NY,
    PATH_X,
    PATH_Y,
    ROW,
    SLOTS,
    TICKS,
    opened,
)
from analog_frontend.numeric.vector import clamp_lanes, integers, load, splat, store, store_rows
from analog_frontend.parts import noise, sid
from analog_frontend.parts.sid import STAGES, TERMS
from analog_frontend.sid_edges import DEMODULATORS, JITTERED, Switches, apply_switches, collect_switch_instants
from fpga_model.jit import inlined, outlined

LATER = 1 << 40
# rows of a slot's `edge_inputs`, and of its `factors`: q, then decays and steps of the pieces before and after the edge
BEFORE, V0, AFTER, V1, ADDED, P1, TAU = 0, 1, 2, 3, 4, 5, 8
Q, FIRST, SECOND = 0, 3, 9


@inlined
def _step_edgeless_tick(v, d, f1, f2, f3):
    """A tick of demodulator `d` without an edge; returns its output. Mutates `v.on`."""
    at = 3 * d * LANES
    e1, e2, e3 = load(v.sid, 0), load(v.sid, LANES), load(v.sid, 2 * LANES)
    w1, w2, w3 = load(v.on, at), load(v.on, at + LANES), load(v.on, at + 2 * LANES)
    w3 = e1 * w3 + (e2 * w2 + (e3 * w1 + f3))
    w2 = e1 * w2 + (e2 * w1 + f2)
    w1 = e1 * w1 + f1
    store_rows(v.on, at, LANES, (w1, w2, w3))
    return load(v.sign, d * LANES) * (w3 - load(v.off, at + 2 * LANES))


@inlined
def _output(v, d):
    at = (3 * d + 2) * LANES
    return load(v.sign, d * LANES) * (load(v.on, at) - load(v.off, at))


@outlined
def schedule_first_edges(floats, ints):
    """The first tick of a block at which the switches of each plant move. Mutates `v.due`, `v.edge_index`, `v.out`."""
    v = opened(floats, ints)
    for plant in range(LANES):
        v.edge_index[plant] = 0
        v.due[plant] = v.edges[plant, 0, 0] // v.clocks[0] if v.edge_counts[plant] > 0 else LATER
        # of one that has left, or is to come, an edge that waits is for its own next tick
        for d in range(DEMODULATORS):
            if v.active[plant] and v.late_count[plant, d] > 0:
                v.due[plant] = 0
    for d in range(DEMODULATORS):
        store(v.out, d * TICKS * LANES, _output(v, d))


# ---- edges of a strip, eight at once -------------------------------------------------------------------------------


@inlined
def _gather_strip_edges(v, tick, first, n, plant):
    """The edges of one plant in a strip, one a slot: how many; -1 where a switch acts a tick after its edge.

    Mutates v.edge_inputs, v.counters, v.which.
    """
    for d in range(DEMODULATORS):
        if v.late_count[plant, d] > 0:
            return -1
    slot, w = 0, v.w
    for k in range(v.edge_index[plant], v.edge_counts[plant]):
        t = v.edges[plant, k, 0] // v.clocks[0] - first
        if t >= n:
            break
        cycle = v.edges[plant, k, 0] - v.clocks[0] * (first + t)
        d, row = v.edges[plant, k, 1], t * LANES + plant
        ref = v.switch[plant, d]
        for i in range(v.edge_index[plant], k + 1):
            ref = ref ^ 1 if v.edges[plant, i, 1] == d else ref
        if slot == SLOTS or v.switch_carry[plant, ref, cycle] != 0:
            return -1
        cv, path, added = (CX1, PATH_X, NX) if d < 2 else (CY1, PATH_Y, NY)
        at, cv, path = slot * EDGE_INPUT_ROWS * LANES + plant, cv + ROW + row, path + row
        v.edge_inputs[at + BEFORE * LANES], v.edge_inputs[at + V0 * LANES] = w[cv], w[cv + ROW]
        v.edge_inputs[at + AFTER * LANES], v.edge_inputs[at + V1 * LANES] = w[cv + LANES], w[cv + ROW + LANES]
        v.edge_inputs[at + ADDED * LANES] = w[added + row]
        v.edge_inputs[at + P1 * LANES] = w[path]
        v.edge_inputs[at + (P1 + 1) * LANES] = w[path + ROW]
        v.edge_inputs[at + (P1 + 2) * LANES] = w[path + 2 * ROW]
        v.edge_inputs[at + TAU * LANES] = v.switch_tau_s[plant, ref, cycle]
        v.counters[slot * LANES + plant] = JITTERED * (tick + first + t) + 1 + d
        slot += 1
    return slot


@inlined
def _edge_response(v, v0, a, b, v1, s):
    """As sid.response, for an edge of each plant."""
    rise = v1 - v0
    c2 = 3.0 * rise - 2.0 * a - b
    c3 = a + b - 2.0 * rise
    q1, q2, q3 = splat(0.0), splat(0.0), splat(0.0)
    for i in range(TERMS - 1, -1, -1):
        q1 = q1 * s + _term(v, i, 0, v0, a, c2, c3, s)
        q2 = q2 * s + _term(v, i, 1, v0, a, c2, c3, s)
        q3 = q3 * s + _term(v, i, 2, v0, a, c2, c3, s)
    return q1 * s, q2 * (s * s), q3 * (s * s * s)


@inlined
def _term(v, i, j, v0, a, c2, c3, s):
    at, step = (4 * i + j) * LANES, 4 * TERMS * LANES
    inner = load(v.taylor, at + 2 * step) * c2 + s * (load(v.taylor, at + 3 * step) * c3)
    inner = load(v.taylor, at + step) * a + s * inner
    return load(v.taylor, at) * v0 + s * inner


@inlined
def _compute_edge_factors(v, slot):
    """What the edges of a slot give that does not depend on the capacitors. Mutates v.factors."""
    x, f = slot * EDGE_INPUT_ROWS * LANES, slot * FACTORS * LANES
    tau = load(v.edge_inputs, x + TAU * LANES)
    if v.flags[JITTER]:
        at = 2 * LANES * JITTER
        word, _ = noise.words(integers(v.keys, at), integers(v.keys, at + LANES), integers(v.counters, slot * LANES))
        tau = tau + load(v.sigma, at) * noise.ih4(word)
    h_s, r, gain, driver_s = load(v.h_s, 0), load(v.r, 0), load(v.slope_gain, 0), load(v.driver_s, 0)
    s = clamp_lanes(tau, splat(0.0), h_s) / h_s
    v0, v1 = load(v.edge_inputs, x + V0 * LANES), load(v.edge_inputs, x + V1 * LANES)
    dv0 = (gain * load(v.edge_inputs, x + BEFORE * LANES) - v0) / driver_s
    dv1 = (gain * load(v.edge_inputs, x + AFTER * LANES) - v1) / driver_s
    store_rows(v.factors, f, LANES, _edge_response(v, v0, dv0 * h_s, dv1 * h_s, v1, s))
    store_rows(v.factors, f + FIRST * LANES, LANES, sid.factors(r * s))
    store_rows(v.factors, f + SECOND * LANES, LANES, sid.factors(r * (1.0 - s)))


@outlined
def gather(floats, ints, tick, first, n):
    """All edges of a strip into slots, and what they give. Returns the tick of the block at which a switch moves."""
    v = opened(floats, ints)
    soonest, most = LATER, 0
    for plant in range(LANES):
        v.slot[plant] = 0
        v.slots[plant] = _gather_strip_edges(v, tick, first, n, plant)
        most = max(most, v.slots[plant])
        soonest = min(soonest, v.due[plant])
    for slot in range(most):
        _compute_edge_factors(v, slot)
    return soonest


@inlined
def _advance_segment(v, f, n, w1, w2, w3, q1, q2, q3):
    """Three capacitors, less the response at the piece's beginning, over a piece; f its factors. As sid.py's."""
    e, e2, e3 = v.factors[f], v.factors[f + LANES], v.factors[f + 2 * LANES]
    s1, s2, s3 = v.factors[f + 3 * LANES], v.factors[f + 4 * LANES], v.factors[f + 5 * LANES]
    return (
        e * w1 + (q1 + n * s1),
        e * w2 + (e2 * w1 + (q2 + n * s2)),
        e * w3 + (e2 * w2 + (e3 * w1 + (q3 + n * s3))),
    )


@inlined
def _apply_plant_edges(v, t, plant, switched_count):
    """The edges of one plant in tick `t` of the block, behind `switched_count` of others; returns the new count.

    Leaves what they give in v.fixed and v.touched.
    """
    k = v.edge_index[plant]
    while k < v.edge_counts[plant] and v.edges[plant, k, 0] < (t + 1) * v.clocks[0]:
        d, slot = v.edges[plant, k, 1], v.slot[plant]
        x, f, at = slot * EDGE_INPUT_ROWS * LANES + plant, slot * FACTORS * LANES + plant, 3 * d * LANES + plant
        ref, n = v.switch[plant, d], v.edge_inputs[x + ADDED * LANES]
        q1, q2, q3 = v.factors[f], v.factors[f + LANES], v.factors[f + 2 * LANES]
        w1, w2, w3 = v.on[at], v.on[at + LANES], v.on[at + 2 * LANES]
        w1, w2, w3 = _advance_segment(v, f + FIRST * LANES, n, w1, w2, w3, q1, q2, q3)
        opens = 0 if ref else STAGES
        demodulator_index = DEMODULATORS * plant + d
        fixed = v.fixed[demodulator_index]
        fixed[STAGES] = w1 + v.sid_inject[plant, opens]
        fixed[STAGES + 1] = w2 + v.sid_inject[plant, opens + 1]
        fixed[STAGES + 2] = w3 + v.sid_inject[plant, opens + 2]
        w1, w2, w3 = v.off[at] - q1, v.off[at + LANES] - q2, v.off[at + 2 * LANES] - q3
        p1, p2, p3 = (
            v.edge_inputs[x + P1 * LANES],
            v.edge_inputs[x + (P1 + 1) * LANES],
            v.edge_inputs[x + (P1 + 2) * LANES],
        )
        fixed[0], fixed[1], fixed[2] = _advance_segment(v, f + SECOND * LANES, n, w1, w2, w3, p1, p2, p3)
        v.switch[plant, d] = 0 if ref else 1
        v.touched[switched_count] = demodulator_index
        v.slot[plant] = slot + 1
        switched_count += 1
        k += 1
    v.edge_index[plant] = k
    v.due[plant] = v.edges[plant, k, 0] // v.clocks[0] if k < v.edge_counts[plant] else LATER
    return switched_count


# ---- one plant's tick by itself ------------------------------------------------------------------------------------


@inlined
def _load_capacitors(v, plant, d, ref):
    """Capacitors of one demodulator of one plant as sid.py has them, into row `d` of v.caps. Mutates it."""
    for k in range(STAGES):
        at = (3 * d + k) * LANES + plant
        v.caps[d, k] = v.on[at] if ref else v.off[at]
        v.caps[d, STAGES + k] = v.off[at] if ref else v.on[at]


@outlined
def _move_switches(floats, ints, tick, t, row, plant, switched_count):
    """Tick `t` of a block for a plant in which switches move, in place `row` of the strip; as `_apply_plant_edges`."""
    v = opened(floats, ints)
    edge_count, edges = v.edge_counts[plant], v.edges[plant]
    first = v.edge_index[plant]
    last = first
    while last < edge_count and edges[last, 0] < (t + 1) * v.clocks[0]:
        last += 1
    v.edge_index[plant] = last
    at, on = 2 * LANES * JITTER + plant, 1 if v.flags[JITTER] else 0
    jitter = noise.Source(v.keys[at], v.keys[at + LANES], v.sigma[at], on, 0)
    q = v.sid_numbers[plant]
    p = sid.Params(q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7], v.sid_inject[plant], v.sid_taylor[plant])
    switches = Switches(v.switch_tau_s[plant], v.switch_carry[plant], jitter, p.h_s, v.clocks[0])
    gain, driver_s, w, k = v.slope_gain[plant], v.driver_s[plant], v.w, row * LANES + plant
    deferred_total = 0
    for d in range(DEMODULATORS):
        ref, pending_taus_s, waiting = v.switch[plant, d], v.late_tau_s[plant, d], v.late_count[plant, d]
        count, deferred_count = collect_switch_instants(
            switches, tick + t, t, d, ref, first, last, edges, pending_taus_s, waiting, v.taus_s
        )
        v.late_count[plant, d] = deferred_count
        deferred_total += deferred_count
        if count > 0:
            path, cv, n = (PATH_X + k, CX1 + ROW + k, w[NX + k]) if d < 2 else (PATH_Y + k, CY1 + ROW + k, w[NY + k])
            p1, p2, p3 = w[path], w[path + ROW], w[path + 2 * ROW]
            before, v0, after, v1 = w[cv], w[cv + ROW], w[cv + LANES], w[cv + ROW + LANES]
            dv0, dv1 = (gain * before - v0) / driver_s, (gain * after - v1) / driver_s
            _load_capacitors(v, plant, d, ref)
            ref = apply_switches(p, v.caps, d, ref, v.taus_s, count, n, p1, p2, p3, v0, dv0, v1, dv1)
            v.switch[plant, d] = ref
            demodulator_index = DEMODULATORS * plant + d
            for i in range(STAGES):
                v.fixed[demodulator_index, i] = v.caps[d, i if ref else STAGES + i]
                v.fixed[demodulator_index, STAGES + i] = v.caps[d, STAGES + i if ref else i]
            v.touched[switched_count] = demodulator_index
            switched_count += 1
    v.due[plant] = edges[last, 0] // v.clocks[0] if last < edge_count else LATER
    if deferred_total > 0:
        v.due[plant] = t + 1
    return switched_count


# ---- a strip -------------------------------------------------------------------------------------------------------


@inlined
def _store_switched_demodulators(v, t, switched_count):
    """Capacitors and outputs of the demodulators with an edge in tick `t`, over those of a tick without one."""
    for i in range(switched_count):
        demodulator_index = v.touched[i]
        plant, d = demodulator_index // DEMODULATORS, demodulator_index % DEMODULATORS
        fixed = v.fixed[demodulator_index]
        for k in range(STAGES):
            at = (3 * d + k) * LANES + plant
            v.on[at] = fixed[k]
            v.off[at] = fixed[STAGES + k]
        sign = 1.0 if v.switch[plant, d] else -1.0
        v.sign[d * LANES + plant] = sign
        v.out[(d * TICKS + t + 1) * LANES + plant] = sign * (fixed[2] - fixed[5])


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
def demodulate(floats, ints, tick, first, n):
    """The demodulators over a strip of `n` ticks from tick `first` of the block on, which begins at `tick`."""
    v = opened(floats, ints)
    soonest = gather(floats, ints, tick, first, n)
    for t in range(n):
        switched_count = 0
        if first + t == soonest:
            soonest = LATER
            for plant in range(LANES):
                if v.due[plant] == first + t:
                    if v.slots[plant] < 0:
                        switched_count = _move_switches(floats, ints, tick, first + t, t, plant, switched_count)
                    else:
                        switched_count = _apply_plant_edges(v, first + t, plant, switched_count)
                soonest = min(soonest, v.due[plant])
        f1, f2, f3 = _feed(v, t * LANES, PATH_X, NX)
        g1, g2, g3 = _feed(v, t * LANES, PATH_Y, NY)
        drive = _step_edgeless_tick(v, 0, f1, f2, f3), _step_edgeless_tick(v, 1, f1, f2, f3)
        sense = _step_edgeless_tick(v, 2, g1, g2, g3), _step_edgeless_tick(v, 3, g1, g2, g3)
        store_rows(v.out, (first + t + 1) * LANES, TICKS * LANES, drive + sense)
        if switched_count:
            _store_switched_demodulators(v, first + t, switched_count)
