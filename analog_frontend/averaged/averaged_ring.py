"""Averaged plant: what a saturating ring adds to the C/V outputs in a frame.

    v(theta_n) as ring_saturation.py adds it over a tick about theta_n, from the linear output along the slow motion
    C - i S as a square-wave demodulator sees it:  C = c1 - c3/3 + c5/5 - ...,  S = s1 + s3/3 + s5/5 + ..., up to 15

Source     docs/parts/averaged.md
"""

from analog_frontend import ring_saturation
from analog_frontend.averaged.averaged_laws import COS, POINTS, SIN, TURN_MASK
from analog_frontend.averaged.averaged_modes import small_turn, times, unit
from analog_frontend.top import CV_X, CV_Y
from fpga_model.jit import outlined

HARMONICS = 8  # odd ones
PARTS = tuple(1.0 / (2 * k + 1) for k in range(HARMONICS))


@outlined
def act(p, r, temp_degc, rad_per_tick, reference_turns, drive_ref, sense_ref):
    """Volts of a frame, added to r.volts, from the motion that `averaged_laws.act` has left in `r`. Mutates `r`."""
    index, weight = ring_saturation.locate(p, temp_degc)
    half_c, half_s = small_turn(0.5 * rad_per_tick)
    for channel in range(2):
        state, ref = (CV_Y, sense_ref) if channel else (CV_X, drive_ref)
        offset = ref - reference_turns
        turn_c, turn_s = unit(offset & TURN_MASK)
        seen_c, seen_s = 0.0, 0.0
        for n in range(POINTS):
            begin_c, begin_s = times(COS[n], SIN[n], half_c, -half_s)
            end_c, end_s = times(COS[n], SIN[n], half_c, half_s)
            start_v = begin_c * r.cosines[state] + begin_s * r.sines[state]
            end_v = end_c * r.cosines[state] + end_s * r.sines[state]
            v = ring_saturation.volts(p, index, weight, channel, start_v, end_v) * (2.0 / POINTS)
            c, s = times(COS[n], SIN[n], turn_c, turn_s)
            c2, s2 = times(c, s, c, s)
            sign = 1.0
            for k in range(HARMONICS):
                seen_c += sign * v * c * PARTS[k]
                seen_s += v * s * PARTS[k]
                sign = -sign
                c, s = times(c, s, c2, s2)
        re, im = times(seen_c, -seen_s, turn_c, turn_s)
        r.volts[2 * channel] += re
        r.volts[2 * channel + 1] += im
