"""Averaged demodulators: from reference edge to reference edge in closed form, and what the converter sums of a frame.

    v(t) = Re(V(t) e^(i theta)), V a cubic over the frame;   p = 1/(1 + i w RC),   V~ + RC p V~' = V
    W_j(t) = Re(p^j (V~ - (j - 1) RC p V') e^(i theta)),  j = 1 .. 3     what the three closed stages follow
    r      = w - W at the instant a group closes; until it opens, u = t/RC later,
             w_1 = e^-u r_1 + W_1      w_2 = e^-u (r_2 + u r_1) + W_2      w_3 = e^-u (r_3 + u r_2 + u^2/2 r_1) + W_3
    noise  q_1 = (its integral over the closed time)/RC, spread over the stages as a constant voltage is

With two or three edges in a frame, the first two are done side by side; with any other number, one after the other.
A frame without one continues the curve of the frame before it.

At an edge the same W closes one group and opens the other. Edges stand at the firmware's own clocks, re-timed or not.
    mean   int w_3 dt/RC = [W_4] + sum of (r_j - what is left of it),   closed for u;  over two half periods, length l
           W_4 = Re(p^3 V~ e^(i theta)/(i w RC)), which changes its sign from edge to edge
    s'     slope at the last edge, +-((w_2 - h_2) - (1 + d) (w_3 - h_3)) / 2RC; at rest w_2 - w_3 = d w_3 at an edge
    s"     its change since the edge of the frame before, over the time between both
    s      at the frame's middle, x from that of the half periods: mean + x s' + s" (x (x - l)/2 - l^2/24)
    sinc3  sums of three frames at once, as adc.py has them: sum_j += K_j s + M_j s', by the moments of its weights;
           what s" adds to all three together is in s

Left out  terms of third order; V" in W_2 and W_3, (ring/f)^2/(w RC); the charge's ripple at f
State     `q`, float64, mutated in place: rows of four demodulators
Source    docs/plant.md, docs/decisions/0014-baseband.md
"""

import math
from typing import NamedTuple

from analog_frontend.averaged.averaged_modes import RAD_PER_LSB, unit
from analog_frontend.numeric.vector import (
    ceiling,
    four,
    high,
    join_lanes,
    lane,
    load4,
    low,
    pair,
    rows4,
    select_lanes,
    splat,
    splat4,
    store4,
    store_rows,
)
from fpga_model.jit import inlined, inner

DEMODULATORS = 4
HALF = 1 << 47
HALF_MASK = HALF - 1
TURN_MASK = 2 * HALF - 1
NOISE_INDEX_MASK = 0xFFFF  # more than the noise of a batch
# Rows of `q`, the first thirteen as the demodulators keep them from frame to frame
R1, R2, R3, H1, H2, H3, CLOSED_AT, NOISE, SIGN, AREA, BEGAN, WAITING, PAST = range(13)
S, SLOPE, CURVE, EDGE_SLOPE, UNTIL = range(13, 18)
Q_ROWS = 18


class Params(NamedTuple):
    """Times in clocks; arrays are read only."""

    rc: float
    inverse_rc: float
    steeper: float  # 1 + d, of a signal in phase
    switch: float  # reference pin to analog switch
    middle: float  # where in a frame the mean of the converter's samples stands
    spread: float  # mean square of the distance of the converter's samples from there, halved
    sampled: float  # a frame's output is that of the two half periods that end with the first edge from here on
    charge_slope: float  # what the charge of the switches adds to the mean slope (V per clock)
    charge: tuple  # what an opened switch leaves on C1 C3 C5 (V): mean of both groups, and half of their difference
    delay: int  # phase register to pin, in clocks
    retimed: int
    inverse_noise: float  # samples of C/V noise per clock
    noise_gain: float  # length of a sample / RC
    edges: int  # most edges of a frame and one more; 0: two or three in every frame
    frame_clocks: float
    inverse_frame: float
    tick_clocks: float
    inverse_tick: float


def droop(u):
    """(w_2 - w_3)/w_3 at the edge that opens a group, of a constant signal in phase with half periods of u RC."""
    e, p = math.exp(-u), 1.0 / (1.0 + 1j * math.pi / u)
    w1, w2, w3 = p.imag, (p * p).imag, (p * p * p).imag
    # a group closes with what it opened with, and W has changed its sign
    r1 = -2.0 * w1 / (1.0 - e)
    r2 = (e * u * r1 - 2.0 * w2) / (1.0 - e)
    r3 = (e * u * (r2 + 0.5 * u * r1) - 2.0 * w3) / (1.0 - e)
    return (r2 + w2) / (r3 + w3) - 1.0


@inlined
def decay(u):
    """e^-u for 0 <= u <= 0.2, to 3e-9, and to 5e-15 below 0.03; a number or lanes."""
    return 1.0 - u * (
        1.0 - u * (1.0 / 2) * (1.0 - u * (1.0 / 3) * (1.0 - u * 0.25 * (1.0 - u * 0.2 * (1.0 - u * (1.0 / 6)))))
    )


@inlined
def switch_edge_clock(p, crossing_clock):
    """When the switch follows a reference phase that enters a new half turn before clock `crossing_clock`; lanes."""
    if p.retimed:
        # half a clock off, so that the product cannot pass a whole number by its rounding
        return ceiling((crossing_clock + (p.delay - 0.5)) * p.inverse_tick) * p.tick_clocks + p.switch
    return crossing_clock + (p.delay - 1.0 + p.switch)


@inlined
def _edge_interval_terms(p, sign, closed_at, drawn, t, past, tilde, poles, total):
    """What happens between two edges, in lanes: parts of w_1 .. w_3 that do not know r, and what r is multiplied by."""
    angle = past * RAD_PER_LSB
    q = angle * angle
    c = 1.0 - q * 0.5 * (1.0 - q * (1.0 / 12) * (1.0 - q * (1.0 / 30)))
    d = angle * (1.0 - q * (1.0 / 6) * (1.0 - q * (1.0 / 20) * (1.0 - q * (1.0 / 42))))
    base_r, base_i, v0r, v0i, v1r, v1i, v2r, v2i, v3r, v3i, lag2, lag3 = tilde
    tau = t * p.inverse_frame
    vr = v0r + tau * (v1r + tau * (v2r + tau * v3r))
    vi = v0i + tau * (v1i + tau * (v2i + tau * v3i))
    er, ei = c * base_r - d * base_i, c * base_i + d * base_r
    # -V~ e^(i theta), the signal as the closing group sees it: its edges are those to 0
    gr, gi = vi * ei - vr * er, vr * ei + vi * er
    p1r, p1i, p2r, p2i, p3r, p3i, p4r, p4i = poles
    w1 = sign * (gr * p1r + gi * p1i)
    w2 = sign * ((gr * p2r + gi * p2i) + lag2)
    w3 = sign * ((gr * p3r + gi * p3i) + lag3)
    u = (t - closed_at) * p.inverse_rc
    return w1, w2, w3, sign * (gr * p4r + gi * p4i), u, decay(u), (total - drawn) * p.noise_gain


@inlined
def _advance_closed_group(swept, r1, r2, r3):
    """Capacitors of the closed group at the edge that opens it; area under the third / RC."""
    w1, w2, w3, w4, u, e, n = swept
    e1, e2, e3 = e * r1, e * (r2 + u * r1), e * (r3 + u * (r2 + u * r1 * 0.5))
    area = w4 + ((r1 - e1) + (r2 - e2) + (r3 - e3))
    return e1 + w1 + n * (1.0 - 0.5 * u), e2 + w2 + n * u * 0.5, e3 + w3 + n * u * u * (1.0 / 6), area


@inlined
def _inject_switch_charge(p, sign, grown):
    """The same with what an opened switch leaves on them."""
    a1, a2, a3, _ = grown
    return (
        a1 + (p.charge[0] + sign * p.charge[3]),
        a2 + (p.charge[1] + sign * p.charge[4]),
        a3 + (p.charge[2] + sign * p.charge[5]),
    )


@inlined
def _output_area_slope(p, sign, u, grown, h2, h3):
    """Area under the output since the last edge / RC, and its slope times 2 RC."""
    _, a2, a3, area = grown
    return sign * (area - h3 * u), sign * ((a2 - h2) - (a3 - h3) * p.steeper)


@inlined
def _two_edges(p, s, waiting, uses_old_word, old, new, phase_gap_old, phase_gap_new, tilde, poles, noise, begin):
    """The first two edges of the frame in every demodulator, eight lanes; returns the state `s` after them.

    old, new  (words, their inverses, first clock) before and after the change of the word
    What the second edge needs of the first are its time and the capacitors that it has opened, so nearly all of both is
    done side by side.
    """
    (r1, r2, r3, h1, h2, h3, closed_at, drawn, sign, area, began, waits, past_waits, picked) = s
    zero, one = splat(0.0), splat(1.0)
    number = join_lanes(splat4(0.0), splat4(1.0)) - join_lanes(waiting, waiting)
    both = join_lanes(uses_old_word, uses_old_word)
    ahead = join_lanes(phase_gap_new, phase_gap_new) + (number - both) * float(HALF)
    # the first that crosses in this frame may do so before the word has changed
    first = select_lanes(number, zero, both, zero)
    word = select_lanes(one, first, splat(old[0]), splat(new[0]))
    inverse = select_lanes(one, first, splat(old[1]), splat(new[1]))
    base = select_lanes(one, first, zero, splat(new[2]))
    ahead = select_lanes(one, first, join_lanes(phase_gap_old, phase_gap_old), ahead)
    t = switch_edge_clock(p, base + ceiling(ahead * inverse))
    past = (t - base) * word - ahead
    waited = join_lanes(waiting, splat4(0.0))
    t = select_lanes(one, waited, join_lanes(waits, waits), t)
    past = select_lanes(one, waited, join_lanes(past_waits, past_waits), past)
    total = join_lanes(
        _integral(noise, begin, low(t) * p.inverse_noise), _integral(noise, begin, high(t) * p.inverse_noise)
    )
    signs, since = join_lanes(sign, 0.0 - sign), join_lanes(closed_at, low(t))
    swept = _edge_interval_terms(p, signs, since, join_lanes(drawn, low(total)), t, past, tilde, poles, total)
    w1, w2, w3 = swept[:3]
    r1, r2, r3 = join_lanes(r1, h1 - low(w1)), join_lanes(r2, h2 - low(w2)), join_lanes(r3, h3 - low(w3))
    grown = _advance_closed_group(swept, r1, r2, r3)
    b1, b2, b3 = _inject_switch_charge(p, signs, grown)
    interval_area, slope = _output_area_slope(
        p, signs, swept[4], grown, join_lanes(h2, low(b2)), join_lanes(h3, low(b3))
    )
    pick = select_lanes(splat(p.sampled), t, select_lanes(since, splat(p.sampled - 1e-6), one, zero), zero)
    picked = select_lanes(splat4(1.0), low(pick), (area + low(interval_area), began, low(t), low(slope)), picked)
    both_areas = low(interval_area) + high(interval_area)
    picked = select_lanes(splat4(1.0), high(pick), (both_areas, closed_at, high(t), high(slope)), picked)
    closes = (low(b1) - high(w1), low(b2) - high(w2), low(b3) - high(w3))
    opens = (high(b1), high(b2), high(b3))
    return closes + opens + (high(t), high(total), sign, high(interval_area), low(t), waits, past_waits, picked)


@inlined
def _last_edge(p, s, waiting, uses_old_word, new, phase_gap_new, tilde, poles, noise, begin):
    """The third edge of the frame where there is one, and what waits for the next frame; returns the state `s`."""
    (r1, r2, r3, h1, h2, h3, closed_at, drawn, sign, area, began, _, _, picked) = s
    zero, one = splat4(0.0), splat4(1.0)
    word, inverse, base = splat4(new[0]), splat4(new[1]), splat4(new[2])
    ahead = phase_gap_new + ((2.0 - waiting) - uses_old_word) * float(HALF)
    crossed = base + ceiling(ahead * inverse)
    t = switch_edge_clock(p, crossed)
    past = (t - base) * word - ahead
    end = splat4(p.frame_clocks)
    acts = select_lanes(t, end - 1e-6, one, zero)
    # what crosses in this frame and acts in the next one
    is_deferred = select_lanes(one, acts, zero, select_lanes(crossed, end, one, zero))
    total = _integral(noise, begin, t * p.inverse_noise)
    swept = _edge_interval_terms(p, sign, closed_at, drawn, t, past, tilde, poles, total)
    w1, w2, w3 = swept[:3]
    grown = _advance_closed_group(swept, r1, r2, r3)
    interval_area, slope = _output_area_slope(p, sign, swept[4], grown, h2, h3)
    pick = select_lanes(splat4(p.sampled), t, select_lanes(closed_at, splat4(p.sampled - 1e-6), acts, zero), zero)
    picked = select_lanes(one, pick, (area + interval_area, began, t, slope), picked)
    a1, a2, a3 = _inject_switch_charge(p, sign, grown)
    after = (h1 - w1, h2 - w2, h3 - w3, a1, a2, a3, t, total, zero - sign, interval_area, closed_at)
    next_frame_waits = select_lanes(one, is_deferred, (t - end, past), (zero - one, zero))
    return select_lanes(one, acts, after, s[:11]) + next_frame_waits + (picked,)


@inlined
def _edge(p, s, n, waiting, uses_old_word, old, new, phase_gap_old, phase_gap_new, tilde, poles, noise, begin):
    """Edge n of the frame, counted from 0, where there is one, or what waits for the next frame; returns the state."""
    (r1, r2, r3, h1, h2, h3, closed_at, drawn, sign, area, began, waits, past_waits, picked) = s
    zero, one, end = splat4(0.0), splat4(1.0), splat4(p.frame_clocks)
    number = splat4(float(n)) - waiting
    # the first that crosses in this frame may do so before the word has changed
    first = select_lanes(number, zero, uses_old_word, zero)
    word = select_lanes(one, first, splat4(old[0]), splat4(new[0]))
    inverse = select_lanes(one, first, splat4(old[1]), splat4(new[1]))
    base = select_lanes(one, first, zero, splat4(new[2]))
    ahead = select_lanes(one, first, phase_gap_old, phase_gap_new + (number - uses_old_word) * float(HALF))
    crossed = base + ceiling(ahead * inverse)
    t = switch_edge_clock(p, crossed)
    past = (t - base) * word - ahead
    # one whose switch has not followed in the frame before
    was_waiting = select_lanes(number, splat4(-0.5), one, zero)
    t, past = select_lanes(one, was_waiting, waits, t), select_lanes(one, was_waiting, past_waits, past)
    acts = select_lanes(t, end - 1e-6, one, zero)
    is_deferred = select_lanes(one, acts, zero, select_lanes(crossed, end, one, zero))
    # beyond the frame nothing is read
    t_read = select_lanes(t, end, t, end)
    total = _integral(noise, begin, t_read * p.inverse_noise)
    swept = _edge_interval_terms(p, sign, closed_at, drawn, t_read, past, tilde, poles, total)
    w1, w2, w3 = swept[:3]
    grown = _advance_closed_group(swept, r1, r2, r3)
    interval_area, slope = _output_area_slope(p, sign, swept[4], grown, h2, h3)
    # the first from `sampled` on, or the last of those before it
    pick = select_lanes(closed_at, splat4(p.sampled - 1e-6), acts, zero)
    picked = select_lanes(one, pick, (area + interval_area, began, t_read, slope), picked)
    a1, a2, a3 = _inject_switch_charge(p, sign, grown)
    after = (h1 - w1, h2 - w2, h3 - w3, a1, a2, a3, t_read, total, zero - sign, interval_area, closed_at)
    # what had waited has acted
    next_frame_waits = select_lanes(one, was_waiting, (zero - one, zero), (waits, past_waits))
    next_frame_waits = select_lanes(one, is_deferred, (t - end, past), next_frame_waits)
    return select_lanes(one, acts, after, s[:11]) + next_frame_waits + (picked,)


@inlined
def _all_edges(p, q, s, waiting, uses_old_word, old, new, phase_gap_old, phase_gap_new, tilde, poles, noise, begin):
    """Any number of edges, one after the other; returns the state `s`."""
    # a frame without an edge goes on as the frame before it: one clock long, so that its area is its value
    curve = load4(q, 4 * CURVE)
    value = load4(q, 4 * S) + (load4(q, 4 * SLOPE) + curve * (0.5 * p.frame_clocks)) * p.frame_clocks
    slope = load4(q, 4 * SLOPE) + (curve * (p.frame_clocks + 0.5) - p.charge_slope)
    value = (value - curve * p.spread) * p.inverse_rc
    s = s[:13] + ((value, splat4(p.middle - 0.5), splat4(p.middle + 0.5), slope * (2.0 * p.rc)),)
    for n in range(p.edges):
        s = _edge(p, s, n, waiting, uses_old_word, old, new, phase_gap_old, phase_gap_new, tilde, poles, noise, begin)
    return s


@inlined
def _integral(noise, begin, t):
    """Integral of held noise up to `t` samples from `begin` on; sums[k] up to sample k, volts[k] the sample."""
    volts, sums, row = noise
    at = pair(begin, row + begin) + t
    # a place is never negative: with the mask the compiler knows, too
    i, j, k, m = (
        int(lane(at, 0)) & NOISE_INDEX_MASK,
        int(lane(at, 1)) & NOISE_INDEX_MASK,
        int(lane(at, 2)) & NOISE_INDEX_MASK,
        int(lane(at, 3)) & NOISE_INDEX_MASK,
    )
    sample_fraction = at + ceiling(0.0 - at)
    return four(sums[i], sums[j], sums[k], sums[m]) + four(volts[i], volts[j], volts[k], volts[m]) * sample_fraction


@inlined
def _phase_to_half_turn(phase, offsets):
    """Phase to the next half turn of each reference: sine and cosine of drive, of sense."""
    d, s = phase + offsets[0], phase + offsets[1]
    quarter = HALF >> 1
    return four(
        float(HALF - (d & HALF_MASK)),
        float(HALF - ((d + quarter) & HALF_MASK)),
        float(HALF - (s & HALF_MASK)),
        float(HALF - ((s + quarter) & HALF_MASK)),
    )


@inner
def _load_frame_state(q):
    """Rows R1 .. PAST, and what a frame picks: nothing yet."""
    zero, one = splat4(0.0), splat4(1.0)
    return rows4(q, 0, 13) + ((zero, zero, one, zero),)


@inner
def _store_frame_state(p, q, s):
    """The same from frame to frame, clocks counted from the end of this one. Mutates `q`."""
    store_rows(q, 0, 4, s[:13])
    store4(q, 4 * CLOSED_AT, s[CLOSED_AT] - p.frame_clocks)
    store4(q, 4 * BEGAN, s[BEGAN] - p.frame_clocks)


@inner
def demodulate(p, q, before, turn, offsets, base, v, poles, noise, begin):
    """All edges of a frame, the four demodulators side by side. Mutates `q`.

    before, turn  DDS phase and word at the frame's first clock; clock, phase and word where the word changes
    offsets       reference words of drive and sense
    base          (8,) e^(i theta) at the ideal edge to 1: four re, four im
    v             (24,) cubics of V~ (averaged_modes.frame); by what stages 2 and 3 are less: p^2 RC p V', 2 p^3 RC p V'
    poles         p, p^2, p^3 and 2 p^3/(i w RC) as pairs
    noise         of both channels, its integrals, and how long a channel's row is
    begin         sample of the noise with which the frame begins
    """
    phase, word_old = before
    turn_clock, turn_phase, word_new = turn
    gap_old, gap_new = _phase_to_half_turn(phase, offsets), _phase_to_half_turn(turn_phase, offsets)
    zero, one = splat4(0.0), splat4(1.0)
    old, new = (float(word_old), 1.0 / word_old, 0.0), (float(word_new), 1.0 / word_new, float(turn_clock))
    uses_old_word = select_lanes(ceiling(gap_old * old[1]), splat4(float(turn_clock)), one, zero)
    waiting = select_lanes(zero, load4(q, 4 * WAITING), one, zero)
    base_r, base_i = rows4(base, 0, 2)
    tilde = (
        base_r,
        base_i,
        pair(v[0], v[2]),
        pair(v[1], v[3]),
        pair(v[4], v[6]),
        pair(v[5], v[7]),
        pair(v[8], v[10]),
        pair(v[9], v[11]),
        pair(v[12], v[14]),
        pair(v[13], v[15]),
        pair(v[16], v[18]) * base_r - pair(v[17], v[19]) * base_i,
        pair(v[20], v[22]) * base_r - pair(v[21], v[23]) * base_i,
    )
    s = _load_frame_state(q)
    if p.edges:
        s = _all_edges(p, q, s, waiting, uses_old_word, old, new, gap_old, gap_new, tilde, poles, noise, begin)
    else:
        s = _two_edges(
            p, s, waiting, uses_old_word, old, new, gap_old, gap_new, join_lanes(tilde, tilde), poles, noise, begin
        )
        s = _last_edge(p, s, waiting, uses_old_word, new, gap_new, tilde, poles, noise, begin)
    _store_frame_state(p, q, s)
    total, since, until, slope = s[-1]
    slope = slope * (0.5 * p.inverse_rc) + p.charge_slope
    length, span = until - since, until - load4(q, 4 * UNTIL)
    # one division for all eight
    inverse = 1.0 / (length * span)
    curve = (slope - load4(q, 4 * EDGE_SLOPE)) * (length * inverse)
    # y, z: the frame's middle from the end and from the begin of both half periods
    y, z = p.middle - until, p.middle - since
    bend = (y * (y + z) * 2.0 - z * z) * (1.0 / 6) + p.spread
    store4(q, 4 * S, total * (span * inverse) * p.rc + (y + z) * (slope * 0.5) + curve * bend)
    store4(q, 4 * SLOPE, slope + curve * y)
    store4(q, 4 * EDGE_SLOPE, slope)
    store4(q, 4 * UNTIL, until - p.frame_clocks)
    if p.edges:
        store4(q, 4 * CURVE, curve)


@inlined
def bases(offset_drive, offset_sense, base):
    """e^(i theta) at the ideal edge to 1 of each reference, four re and four im. Mutates `base`."""
    quarter = HALF >> 1
    base[0], base[4] = unit((0 - offset_drive) & TURN_MASK)
    base[1], base[5] = unit((0 - offset_drive - quarter) & TURN_MASK)
    base[2], base[6] = unit((0 - offset_sense) & TURN_MASK)
    base[3], base[7] = unit((0 - offset_sense - quarter) & TURN_MASK)
