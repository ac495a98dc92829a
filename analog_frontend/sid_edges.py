"""The demodulators of a block: stretches without a reference edge, and the ticks in which a switch moves.

    edge at clock c --> switch_tau_s[level, c] + jitter --> instant in its tick, or in the next one (switch_carry)
A tick without an edge is one step of the capacitors (`sid.step_edgeless_ticks`), one with edges is pieces
(`sid.edge`). `p` and `s` are `Params` and `State` of the plant.
Source    analog_frontend/parts/sid.py, analog_frontend/top.py
"""

from typing import NamedTuple

import numpy as np

from analog_frontend import effects, linear, ring_saturation
from analog_frontend.effects import law
from analog_frontend.linear import (
    CV_ADDED_X,
    CV_ADDED_Y,
    CV_NOISE_X,
    CV_NOISE_Y,
    CX2,
    CX3,
    CY2,
    CY3,
    D3,
    FEED,
    PATH,
    STRIDE,
)
from analog_frontend.numeric.vector import LANES, load, splat, store
from analog_frontend.parts import noise, sid
from fpga_model.jit import inlined, inner

DEMODULATORS = sid.DEMODULATORS
JITTERED = 1 + DEMODULATORS  # hashes of edge jitter per tick: one for both DACs, one for an edge of each demodulator


@inner
def demodulate(p, s, tick, n, edge_count, edges, driver_s, temp_degc):
    """The four demodulators through a block. Mutates. driver_s: pole of the C/V's last op-amp, at this temperature."""
    w, out = s.work.w, s.work.demodulated
    added = CV_NOISE_X
    if p.effects.any_cv or p.laws.cv or p.ring.on:
        laws, ring = p.laws, p.ring
        index, weight = ring_saturation.locate(ring, temp_degc)
        cx, cy = CX3 * STRIDE, CY3 * STRIDE
        x, y, drive = CV_NOISE_X * STRIDE, CV_NOISE_Y * STRIDE, D3 * STRIDE
        added = CV_ADDED_X
        for t in range(n):
            x_volts, y_volts = effects.cv_volts(p.effects, w[x + t], w[y + t], w[drive + t], w[drive + t + 1])
            if laws.cv:
                gain = s.work.gains
                law_x, law_y = law.volts(
                    laws.force, laws.cv, laws.table, laws.numbers, gain, w, linear.STATE_OFFSETS, t, t + 1
                )
                x_volts, y_volts = x_volts + law_x, y_volts + law_y
            if ring.on:
                x_volts = x_volts + ring_saturation.volts(ring, index, weight, 0, w[cx + t], w[cx + t + 1])
                y_volts = y_volts + ring_saturation.volts(ring, index, weight, 1, w[cy + t], w[cy + t + 1])
            w[CV_ADDED_X * STRIDE + t] = x_volts
            w[CV_ADDED_Y * STRIDE + t] = y_volts
    for c in range(2):
        noisy, path, feed = (added + c) * STRIDE, (PATH + 3 * c) * STRIDE, (FEED + 3 * c) * STRIDE
        s1, s2, s3 = splat(p.sid.s1), splat(p.sid.s2), splat(p.sid.s3)
        for t in range(0, n, LANES):
            v = load(w, noisy + t)
            store(w, feed + t, load(w, path + t) + v * s1)
            store(w, feed + STRIDE + t, load(w, path + STRIDE + t) + v * s2)
            store(w, feed + 2 * STRIDE + t, load(w, path + 2 * STRIDE + t) + v * s3)
    for d in range(DEMODULATORS):
        out[d] = sid.output(s.caps, d)
    t, k, clocks = 0, 0, p.adc.tick_clocks
    deferred_count = s.late_count[0] + s.late_count[1] + s.late_count[2] + s.late_count[3]
    while t < n:
        until = t
        if deferred_count == 0:
            until = min(edges[k, 0] // clocks, n) if k < edge_count else n
        if until > t:
            sid.step_edgeless_ticks(p.sid, s.caps, s.switch, w, FEED, STRIDE, t, until, out)
            t = until
        else:
            last = k
            while last < edge_count and edges[last, 0] < (t + 1) * clocks:
                last += 1
            deferred_count = _switch(p, s, tick + t, t, k, last, edges, added, driver_s)
            k = last
            t += 1


class Switches(NamedTuple):
    """How the analog switches follow the reference edges; arrays as in `Params` of the plant."""

    tau_s: np.ndarray
    carry: np.ndarray
    jitter: noise.Source
    h_s: float
    tick_clocks: int


@inlined
def collect_switch_instants(p, tick, t, d, ref, first, last, edges, pending_taus_s, pending_count, taus):
    """Instants within `tick`, tick `t` of a block, at which the switches of demodulator `d` move: how many, in `taus`.

    p            Switches
    ref          where the switches stand at the tick's begin
    first, last  the tick's reference edges in `edges`. An edge whose switch acts in the next tick is kept in
    `pending_taus_s`; those kept before act now. Returns also how many are kept. Mutates `taus` and `pending_taus_s`
    """
    count, deferred_count = pending_count, 0
    for k in range(count):
        taus[k] = pending_taus_s[k]
        ref = 0 if ref else 1
    for k in range(first, last):
        if edges[k, 1] == d:
            cycle = edges[k, 0] - p.tick_clocks * t
            ref = 0 if ref else 1
            tau = p.tau_s[ref, cycle] + noise.white_sample(p.jitter, JITTERED * tick + 1 + d)
            if p.carry[ref, cycle] != 0:
                pending_taus_s[deferred_count] = max(tau, 0.0)
                deferred_count += 1
            else:
                taus[count] = min(max(tau, 0.0), p.h_s)
                count += 1
    return count, deferred_count


@inlined
def apply_switches(p, caps, d, ref, taus, count, n, p1, p2, p3, v0, dv0, v1, dv1):
    """A tick of demodulator `d` in which its switches move `count` times; returns the reference. Mutates `caps`."""
    if count == 1:
        ref = 0 if ref else 1
        sid.edge(p, caps, d, ref, taus[0], n, p1, p2, p3, v0, dv0, v1, dv1)
        return ref
    return sid.edges(p, caps, d, ref, taus, count, n, p1, p2, p3, v0, dv0, v1, dv1)


@inner
def _switch(p, s, tick, t, first, last, edges, added, driver_s):
    """Tick `t` of a block, in which a reference changes, now or by an edge of the tick before.

    Returns how many edges act in the next tick.
    """
    taus, w = s.work.taus_s, s.work.w
    switches = Switches(p.switch_tau_s, p.switch_carry, p.noise.edge_jitter, p.sid.h_s, p.adc.tick_clocks)
    deferred_total = 0
    for d in range(DEMODULATORS):
        waiting = s.late_count[d]
        count, deferred_count = collect_switch_instants(
            switches, tick, t, d, s.switch[d], first, last, edges, s.late_tau_s[d], waiting, taus
        )
        s.late_count[d] = deferred_count
        deferred_total += deferred_count
        path = (PATH if d < 2 else PATH + 3) * STRIDE + t
        n = w[(added if d < 2 else added + 1) * STRIDE + t]
        p1, p2, p3 = w[path], w[path + STRIDE], w[path + 2 * STRIDE]
        if count == 0:
            sid.step_edgeless_tick(p.sid, s.caps, d, s.switch[d], n, p1, p2, p3)
        else:
            cv = (CX3 if d < 2 else CY3) * STRIDE + t
            before = (CX2 if d < 2 else CY2) * STRIDE + t
            v0, v1 = w[cv], w[cv + 1]
            dv0, dv1 = (p.slope_gain * w[before] - v0) / driver_s, (p.slope_gain * w[before + 1] - v1) / driver_s
            s.switch[d] = apply_switches(p.sid, s.caps, d, s.switch[d], taus, count, n, p1, p2, p3, v0, dv0, v1, dv1)
        s.work.demodulated[4 * (t + 1) + d] = sid.output(s.caps, d)
    return deferred_total
