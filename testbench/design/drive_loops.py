"""Drive loops and search: crossovers by the SID's corner and the resonator's decay, words of the start-up by both.

    frequency loop   crossover DRIVE_BY_SID of the SID's corner, zero a fifth of it
    amplitude loop   the same; its proportional part alone comes to r = 2 pi f_c / (2 pi f_c + w/2Q) of the set-point
    acquire share    0.95, or REACH_ROOM r at the least gains and the least Q, where that is less
    d                tolerance of the frequency, and how far the first word is off
    search limit     SEARCH_ROOM d and the resolution
    kick             half a turn at d: sinc leaves 0.64 of the force there; at most KICK_SHARE of the set-point
    decay            until three SID poles have left SETTLED of the weakest signal: e^-x (1 + x + x^2/2) = SETTLED s
    weakest signal   s = sinc(d kick) (1 + (d / corner)^2)^-1.5 of the kick, at the least gains, and
                     fallen with the least Q until the search ends
    search           noise and the SID's offset turn it by less than CAPTURE of the frequency loop's crossover:
                     (sqrt 2 noise + 2 offset) / s / (2 pi T);  found if above DETECTION_SHARE s
    retune           until three SID poles have SETTLED
Source  docs/design_of_loops.md
"""

import cmath
import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from analog_frontend.parts import sid
from analog_frontend.parts.cv_noise import cv_density
from testbench.paper.loop.loop_parameters import loop_parameters
from testbench.run import build

DRIVE_BY_SID, ZERO_BY_CROSSOVER = 0.06, 0.2
MOST_SHARE, REACH_ROOM, LEAST_SHARE = 0.95, 0.95, 0.5
SEARCH_ROOM, LEAST_OFF_HZ = 1.1, 20.0
KICK_SHARE, SETTLED = 0.3, 0.01
LEAST_SEARCH_S, MOST_SEARCH_S = 0.06, 0.5
NOISE_ROOM, DETECTION_SHARE, CAPTURE = 8.0, 0.4, 0.25  # weakest signal over rms noise, beside the SID's offset
LEAST_SIGNAL_V = 1e-15  # stands for none
LOOP_DELAY_FRAMES = 3.6  # converter, frame, word, hold


class Words(NamedTuple):
    """Keys of [firmware] that the drive's loops and its start-up need, and what stops them ("" if nothing)."""

    keys: dict
    margin_deg: float
    weakest_v: float
    noise_v: float
    failure: str


def _settling(part):
    """x at which three equal poles have settled to `part`."""
    return brentq(lambda x: math.exp(-x) * (1 + x + x * x / 2) - part, 1e-6, 200.0)


class DriveLoop(NamedTuple):
    """What a drive loop is made of (Hz): its controller, the SID's corner, f/2Q of the drive, rate of the frames."""

    crossover_hz: float
    zero_hz: float
    corner_hz: float
    half_width_hz: float
    frame_hz: float


def frequency_loop(config):
    """`DriveLoop` of the frequency, of a configuration and the plant that it has."""
    f, d = config.firmware, config.device()
    corner_hz, half_width_hz = sid.corner_hz(d.sid_r_ohm * d.sid_c_f), d.fx_hz / (2 * d.qx)
    return DriveLoop(f.pll_crossover_hz, f.pll_zero_hz, corner_hz, half_width_hz, config.design_record().frame_hz)


def turns_per_turn(hz, loop):
    """By how much the DDS turns for a turn of error at a frequency or an array of them (Hz), complex.

    w_c (1 + w_z/s)/s, three poles of the SID, and LOOP_DELAY_FRAMES.
    """
    s = 2j * math.pi * hz
    controller = 2 * math.pi * loop.crossover_hz * (1 + 2 * math.pi * loop.zero_hz / s) / s
    return controller / (1 + 1j * hz / loop.corner_hz) ** 3 * np.exp(-s * LOOP_DELAY_FRAMES / loop.frame_hz)


def phase_margin_deg(loop):
    """Phase margin (deg) of a drive loop at its crossover, far above f/2Q."""
    return math.degrees(cmath.phase(-turns_per_turn(loop.crossover_hz, loop)))


def words(config):
    """`Words` of the nominal board and its tolerances."""
    n, unit_scales = config.nominal, build.nominal(config)
    corner = sid.corner_hz(n.sid_r_ohm * n.sid_c_f)
    tau = 1 / (2 * math.pi * corner * (1 - n.capacitor_tolerance))
    root, least = math.sqrt(n.q_tolerance), (1 - n.transducer_tolerance) ** 2
    decay = math.pi * n.fx_hz / n.qx * root
    crossover = DRIVE_BY_SID * corner
    zero = ZERO_BY_CROSSOVER * crossover
    drive = DriveLoop(crossover, zero, corner, n.fx_hz / (2 * n.qx), config.design_record().frame_hz)
    pull = 2 * math.pi * crossover * least
    reach = REACH_ROOM * pull / (pull + decay)
    off = n.fx_hz * n.f_tolerance + abs(config.firmware.nominal_frequency_hz - n.fx_hz)
    limit = SEARCH_ROOM * off + 1 / LEAST_SEARCH_S / 10
    kick_s = 0.5 / max(off, LEAST_OFF_HZ)
    full_v = unit_scales["adc_drive_v"]
    volts_per_s = unit_scales["plant_fs_per_s"] * full_v  # at the whole drive span
    setpoint_v = config.firmware.amplitude_um * unit_scales["v_per_um"]
    share = min(1.0, KICK_SHARE * setpoint_v / (volts_per_s * kick_s))
    filter_gain = math.sin(math.pi / 2) / (math.pi / 2) * (1 + (off / corner) ** 2) ** -1.5
    decay_s = _settling(SETTLED * filter_gain) * tau
    fallen = math.exp(-decay * (decay_s + MOST_SEARCH_S))
    weakest = least * share * volts_per_s * kick_s * filter_gain
    noise = math.hypot(
        n.adc_noise_drive_v, 2 * cv_density(n.device(), n.temp_ref_degc, "drive") * n.signal_gain * math.sqrt(corner)
    )
    offset = math.hypot(*loop_parameters(config).sid_offset_v)
    disturbed = math.sqrt(2) * noise + 2 * offset
    search = disturbed / max(weakest * fallen, LEAST_SIGNAL_V) / (2 * math.pi) / (CAPTURE * crossover)
    search_s = min(max(search, LEAST_SEARCH_S), MOST_SEARCH_S)
    weakest *= math.exp(-decay * (decay_s + search_s))
    failure = ""
    if reach < LEAST_SHARE:
        failure = (
            f"amplitude loop: its proportional part reaches {reach:.2g} of the set-point, below {LEAST_SHARE:g}: Q of "
            f"{n.qx:g} is too low for the SID's corner of {corner:.3g} Hz; choose a larger nominal.qx or split"
        )
    elif weakest < NOISE_ROOM * noise + 2 * offset:
        least_v = NOISE_ROOM * noise + 2 * offset
        failure = (
            f"search: the kick leaves {1e6 * weakest:.3g} uV at {off:.3g} Hz from the first frequency, below "
            f"{1e6 * least_v:.3g} uV, {NOISE_ROOM:g} times the noise and twice the SID's offset; "
            "choose a lower nominal.f_tolerance, or a larger nominal.qx or split"
        )
    keys = {
        **{f"{loop}_crossover_hz": crossover for loop in ("agc", "pll")},
        **{f"{loop}_zero_hz": zero for loop in ("agc", "pll")},
        "acquire_share": min(MOST_SHARE, reach),
        "pll_limit_hz": 1.25 * limit,
        "search_limit_hz": limit,
        "kick_s": kick_s,
        "kick_v": share * n.drive_dac_span_v,
        "drive_ceiling_v": n.drive_dac_span_v,
        "quadrature_ceiling_v": n.quad_dac_span_v,
        "decay_s": decay_s,
        "retune_s": _settling(SETTLED) * tau,
        "search_s": search_s,
        "search_min_v": DETECTION_SHARE * weakest,
        "acquire_timeout_s": min(max(2.0, 10 / (2 * math.pi * zero)), 8.0),
    }
    return Words({k: float(f"{v:.4g}") for k, v in keys.items()}, phase_margin_deg(drive), weakest, noise, failure)
