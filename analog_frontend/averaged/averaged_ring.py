"""Averaged plant: what a saturating ring adds to the C/V outputs in a frame.

    v(theta_n) as ring_saturation.py adds it over a tick about theta_n, from the linear output along the slow motion
    C - i S as a square-wave demodulator sees it:  C = c1 - c3/3 + c5/5 - ...,  S = s1 + s3/3 + s5/5 + ..., up to 15
    theta_n counts from the references, so that C and S are sums with constant weights; v is odd, half a turn is enough

Source     docs/plant.md, docs/decisions/0014-baseband.md
"""

import numpy as np

from analog_frontend import ring_saturation
from analog_frontend.averaged.averaged_laws import COS, POINTS, SIN, TURN_MASK
from analog_frontend.averaged.averaged_modes import small_turn, times, unit
from analog_frontend.top import CV_X, CV_Y
from fpga_model.jit import outlined

HALF = POINTS // 2
HARMONICS = np.arange(1, HALF, 2)
_ANGLES = 2 * np.pi * (np.arange(HALF) + 0.5) / POINTS
_SIGNS = (-1.0) ** np.arange(len(HARMONICS))
WEIGHTS_C = 4.0 / POINTS * (np.cos(np.outer(_ANGLES, HARMONICS)) * _SIGNS / HARMONICS).sum(axis=1)
WEIGHTS_S = 4.0 / POINTS * (np.sin(np.outer(_ANGLES, HARMONICS)) / HARMONICS).sum(axis=1)


@outlined
def act(p, r, temp_degc, rad_per_tick, reference_turns, drive_ref, sense_ref):
    """Volts of a frame, added to r.volts, from the motion that `averaged_laws.act` has left in `r`. Mutates `r`."""
    index, weight = ring_saturation.locate(p, temp_degc)
    half_c, half_s = small_turn(0.5 * rad_per_tick)
    for channel in range(2):
        state, ref = (CV_Y, sense_ref) if channel else (CV_X, drive_ref)
        turn_c, turn_s = unit((ref - reference_turns) & TURN_MASK)
        # the motion at both ends of a tick about an angle, as cosine and sine of that angle
        begin_c, begin_s = times(turn_c, turn_s, half_c, half_s)
        end_c, end_s = times(turn_c, turn_s, half_c, -half_s)
        start_c, start_s = times(r.cosines[state], r.sines[state], begin_c, begin_s)
        stop_c, stop_s = times(r.cosines[state], r.sines[state], end_c, end_s)
        demodulated_cos, demodulated_sin = 0.0, 0.0
        for n in range(HALF):
            start_v, stop_v = COS[n] * start_c + SIN[n] * start_s, COS[n] * stop_c + SIN[n] * stop_s
            v = ring_saturation.volts(p, index, weight, channel, start_v, stop_v)
            demodulated_cos += WEIGHTS_C[n] * v
            demodulated_sin += WEIGHTS_S[n] * v
        re, im = times(demodulated_cos, -demodulated_sin, turn_c, turn_s)
        r.volts[2 * channel] += re
        r.volts[2 * channel + 1] += im
