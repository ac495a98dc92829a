"""From a board to the rows of the paper in closed form: arrays of boards at once, nothing simulated.

    phases   360 f (registers, frames, holds, waits of `budget`; DAC response) + poles by arctan
    x        -A e^(j xe2), A by the amplitude loop: constant at the converter, so it goes against the pickoff's gain,
             of which the diodes take 1 % (V/V1)^2, V1 by `ring_diode.limit_f`
    y        where both codes of the sense channel are zero: the demodulator's offset over pickoff's gain and phase ye2
    force    K W e^(-j (ye1 + xe2)) = w A (2 m_c Omega + d_xy) - j kappa A + j F0 e^(-j xe2),  F0 = D y
             real part: the word W; imaginary part: kappa = k_xy - k_q V_q^2;  D = m (w_y^2 - w^2 + j w w_y/Q)
    noise    density of the word for a voltage behind the demodulator, which both codes' rest gives
    cases    what compensation leaves of the four phases: words that null them at 25 degC

Residuals count from the undisplaced pin. The loop analysis gives the same numbers by another way (tests).
Source    docs/inference.md
"""

import functools
import math
from typing import NamedTuple

import numpy as np

from analog_frontend.parts.noise import BOLTZMANN_J_PER_K, ZERO_DEGC_K
from testbench.config import Config, changed
from testbench.paper.inference import priors, ring_table, rows
from testbench.paper.loop import loop_parameters as loop_parts
from testbench.run.budget import budget

ROOM_DEGC = 25.0
SPLIT_HZ = 139.0  # the text's
DEG = math.pi / 180
LEAST_V = 0.1
DROP_V_PER_K = -2.35e-3  # of two diodes and what goes with them: it keeps the gain of a ring at 4 V
INA_V_PER_RTHZ = 1.07e-9  # AD8597, each of two inputs
CASES = (1, 2, 3, 4, 5)
COMPENSATED = {"xe1": 2, "xe2": 3, "ye1": 4, "ye2": 5}  # from this case on
FITTED = tuple(row.name for row in rows.fitted_rows())
STEPPED = tuple(row.name for row in rows.steps())


class Fixed(NamedTuple):
    """Numbers of the default board that no prior moves."""

    volts_per_word: float  # of the DAC, without the droop of its hold
    tick_s: float
    code_per_v: float
    step_code: float
    frame_s: float
    mass_kg: float
    ina_noise_gain: float
    driver_noise_gain: float
    signal_gain: float
    sid_r_ohm: float
    sid_c_f: float


@functools.cache
def fixed_board_numbers():
    config = Config()
    p, d = loop_parts.loop_parameters(config), config.device()
    flat_v = p.volts_per_word / np.sinc(p.w_rad_s / (2 * math.pi) / p.tick_hz)
    return Fixed(
        flat_v, 1 / p.tick_hz, p.code_per_v, p.step_code, p.frame_s, d.mass_kg, d.ina_noise_gain, d.driver_noise_gain,
        d.signal_gain, d.sid_r_ohm, d.sid_c_f,
    )  # fmt: skip


def _tick_grid_gain(hz):
    """What the grid of ticks leaves of a tone: of a hold, and of references on it."""
    return np.sinc(hz * fixed_board_numbers().tick_s)


def firmware_keys(mode):
    """{key: value} of [firmware] of one mode."""
    net = int(mode["net_registers"])
    return {
        "firmware.pipeline_registers": max(net, 0),
        "firmware.reference_registers": 1 + max(-net, 0),
        "firmware.reference_retimed": bool(mode["reference_retimed"]),
        "firmware.frame_latency_drive": int(mode["frame_latency_drive"]),
        "firmware.frame_latency_sense": int(mode["frame_latency_sense"]),
    }


CLOCKED = ("net_registers", "reference_retimed", "frame_latency_drive", "frame_latency_sense")
PARTS_OF_A_LAG = ("output pole", "DAC response", "ring diode", "instrumentation", "unity driver")


@functools.cache
def _clocked_s():
    """What registers, frames, hold and wait of each mode make of xe1 and ye1 (s); (11, 2, 2, 2, 2)."""
    choices = {c.name: c.choices for c in priors.CHOICES}
    delays_s = np.empty((*(len(choices[name]) for name in CLOCKED), 2))
    for at in np.ndindex(delays_s.shape[:-1]):
        mode = {name: choices[name][k] for name, k in zip(CLOCKED, at)}
        lags = budget(changed(Config(), firmware_keys(mode))).rows
        for k, node in enumerate(("xe1", "ye1")):
            delays_s[*at, k] = sum(row.seconds for row in lags[node] if not row.what.startswith(PARTS_OF_A_LAG))
    return delays_s


def clocked_s(mode):
    """(drive, sense): what clocks make of xe1 and ye1 (s); arrays."""
    least = priors.CHOICES[0].choices[0]
    at = tuple(mode[name] - (least if name == "net_registers" else 0) for name in CLOCKED)
    return np.moveaxis(_clocked_s()[at], -1, 0)


def carrier_tc_per_k(v, mode):
    """Drift of the carrier: none, or that of two diodes' drop, with an error."""
    drift_per_k = DROP_V_PER_K / v["carrier_v"] + v["carrier_tc_error_per_k"]
    return np.where(mode["carrier_compensated"] == 1, drift_per_k, 0.0)


def _warm(v, mode, temp_degc):
    """What temperature makes of the numbers, by the laws of `thermal`; rings of the drive and of the sense channel."""
    dt, share = temp_degc - ROOM_DEGC, (temp_degc + ZERO_DEGC_K) / (ROOM_DEGC + ZERO_DEGC_K)
    carrier_v = v["carrier_v"] * (1 + carrier_tc_per_k(v, mode) * dt)
    kxy_tc = v["kxy_tc_below_per_k"] if dt < 0 else v["kxy_tc_above_per_k"]
    current = share ** ((v["ina_bias_exponent"] - v["ina_beta_exponent"]) / 2)
    gbw = 1 + v["opamp_gbw_tc_per_k"] * dt
    return {
        "f": v["fx_hz"] * (1 + v["tcf_per_k"] * dt),
        "fy": (v["fx_hz"] - SPLIT_HZ) * (1 + v["tcf_per_k"] * dt),
        "q": v["q"] * np.exp(v["dlnq_per_k"] * dt),
        "gbw": v["opamp_gbw_hz"] * gbw,
        "poles": (1 + v["dac_rc_tc_per_k"] * dt, 1 / gbw, 1 / gbw),
        "quadrature": v["quadrature_dps"] * (1 + kxy_tc * dt),
        "charge": 1 + v["sid_charge_tc_per_k"] * dt,
        "leakage": 2 ** (dt / 10),
        "current": v["ina_current_noise_a_per_rthz"] * current,
        "voltage": INA_V_PER_RTHZ * share ** (1 - v["ina_bias_exponent"] / 2),
        "flicker": v["sid_flicker_v_per_rthz"] * share ** v["sid_flicker_exponent"],
        "rings": [ring_table.rings(carrier_v, cref_f, temp_degc) for cref_f in crefs_f(v)],
    }


def _phases(v, mode, warm, clocks_s):
    """{node: deg} of xe1 and ye1 as node, xe2 and ye2 as loop phases; what both C/V chains and the force leave."""
    w, c = 2 * math.pi * warm["f"], fixed_board_numbers()
    poles = [
        [np.arctan(w * v[f"{path}_pole_{n}_s"] * drift) for n, drift in enumerate(warm["poles"], 1)]
        for path in ("drive", "sense")
    ]
    amplifiers = [np.arctan(w * gain / (2 * math.pi * warm["gbw"])) for gain in (c.ina_noise_gain, c.driver_noise_gain)]
    chains = [[np.arctan(w * ring.tau_s), *amplifiers] for ring in warm["rings"]]
    switch = w * v["sid_switch_s"]
    rad = {
        "xe1": w * clocks_s[0] + sum(poles[0]),
        "ye1": w * (clocks_s[1] + sense_response_s(v, mode)) + sum(poles[1]),
        "xe2": sum(chains[0]) - switch,
        "ye2": sum(chains[1]) - switch,
    }
    passed = [np.prod([np.cos(angle) for angle in chain], axis=0) for chain in (*chains, poles[1])]
    return {node: angle / DEG for node, angle in rad.items()}, passed


def sense_response_s(v, mode):
    """From latch to the start of the sense DAC's output."""
    return np.where(mode["response_in_pole"] == 1, 0.0, v["sense_dac_delay_s"])


class Board(NamedTuple):
    """What forces on y are made of at one temperature; arrays."""

    w: np.ndarray
    amplitude_m: np.ndarray
    coriolis_n: np.ndarray  # per deg/s
    damping_n: np.ndarray  # of d_xy
    per_word_n: np.ndarray
    sense_v_per_m: np.ndarray
    dynamic_n_per_m: np.ndarray  # D, complex
    kxy_n_per_m: np.ndarray
    kq_n_per_m_per_v2: np.ndarray
    offset_v: np.ndarray
    damper_n_s_per_m: np.ndarray


def coriolis_n_per_dps(hz, amplitude_m):
    """2 m_c w A pi/180: force on y of 1 deg/s."""
    return 2 * fixed_board_numbers().mass_kg * 2 * math.pi * hz * amplitude_m * DEG


def quadrature_n_per_m(hz, quadrature_dps):
    """Stiffness whose force at any amplitude is that of a rate: 2 m_c w Omega."""
    return 2 * fixed_board_numbers().mass_kg * 2 * math.pi * hz * quadrature_dps * DEG


def force_n_per_v(v):
    """k_vf that makes the largest word the full scale, without phase errors, at 25 degC."""
    full_v = fixed_board_numbers().volts_per_word * 2**23
    return coriolis_n_per_dps(v["fx_hz"], v["amplitude_um"] * 1e-6) * v["full_scale_dps"] / full_v


def pickoff_f_per_m(v, gain_v_per_f):
    """dC/dx that gives the pickoff's voltage at the ring."""
    return v["pickoff_v"] / (v["amplitude_um"] * 1e-6 * gain_v_per_f)


def crefs_f(v):
    """Capacitors (F) of the drive's and the sense's ring."""
    return tuple(v["cref_f"] * (1 + side * v["cref_ratio"] / 2) for side in (-1, 1))


def dxy_ratio(v):
    """d_xy / d_x that makes the bias of `damping_dps` at 25 degC: a rate is 2 m_c of force, the damping m w/Q."""
    return v["damping_dps"] * DEG * 2 * v["q"] / (2 * math.pi * v["fx_hz"])


def _offset_v(charge_c, hz):
    """Offset of a code: on-time means rise by 2 dQ R f a stage, the last capacitor is held a quarter above its mean."""
    c = fixed_board_numbers()
    return charge_c / c.sid_c_f * (6 * c.sid_r_ohm * c.sid_c_f * hz + 0.25)


def _charge_per_dps(v, b):
    """Difference of charge (C) whose offset, at 25 degC and without phase errors, is a rate of 1 deg/s."""
    volts = b.sense_v_per_m * b.coriolis_n / np.abs(b.dynamic_n_per_m)
    return volts / _offset_v(1.0, v["fx_hz"])


def _loss(v, ring):
    """Share of the drive's signal that the conducting diodes take at the set-point."""
    return 0.01 * (v["pickoff_v"] / ring.limit_v) ** 2


def _board(v, mode, warm, passed, room):
    """`Board` without the demodulator's offset."""
    c = fixed_board_numbers()
    w, wy = 2 * math.pi * warm["f"], 2 * math.pi * warm["fy"]
    edges = np.where(mode["reference_retimed"] == 1, _tick_grid_gain(warm["f"]), 1.0)
    drive, sense = warm["rings"]
    ring_gain_ratio = drive.gain_v_per_f * (1 - _loss(v, drive)) / (room.gain_v_per_f * (1 - _loss(v, room)))
    amplitude = v["amplitude_um"] * 1e-6 / (ring_gain_ratio * passed[0] * edges)
    slope = pickoff_f_per_m(v, room.gain_v_per_f)
    damper = c.mass_kg * w / warm["q"]
    kxy = quadrature_n_per_m(v["fx_hz"], warm["quadrature"])
    return Board(
        w,
        amplitude,
        coriolis_n_per_dps(warm["f"], amplitude),
        dxy_ratio(v) * damper * w * amplitude,
        force_n_per_v(v) * c.volts_per_word * _tick_grid_gain(warm["f"]) * passed[2],
        sense.gain_v_per_f * slope * v["sense_pickoff_ratio"] * c.signal_gain * passed[1] * 4 / math.pi * edges,
        c.mass_kg * (wy**2 - w**2 + 1j * w * wy / warm["q"]),
        kxy,
        quadrature_n_per_m(v["fx_hz"], v["quadrature_dps"]) / v["v_q_null_v"] ** 2,
        np.zeros_like(w),
        c.mass_kg * wy / warm["q"],
    )


def _arw_and_instability(v, b, warm, temp_degc):
    """ARW and bias instability: a volt behind the demodulator is |D| / (pickoff, Coriolis force) deg/s in any case."""
    c, ring, kt = fixed_board_numbers(), warm["rings"][1], BOLTZMANN_J_PER_K * (temp_degc + ZERO_DEGC_K)
    per_v = np.abs(b.dynamic_n_per_m) / (b.sense_v_per_m * b.coriolis_n)
    per_frame = math.sqrt(2 * c.frame_s)
    cv_square = (
        ring.noise_v_per_rthz**2
        + (warm["current"] * ring.noise_ohm) ** 2
        + 2 * warm["voltage"] ** 2
        + 4 * kt * v["cv_resistor_ohm"]
    )
    square = (
        (per_v * 2 * c.signal_gain) ** 2 * cv_square
        + (per_v * v["adc_noise_sense_v"] * per_frame) ** 2
        + (per_v * c.step_code / c.code_per_v / math.sqrt(12) * per_frame) ** 2
        + 2 * 4 * kt * b.damper_n_s_per_m / b.coriolis_n**2
    )
    floor = 3600 * math.sqrt(2 * math.log(2)) * warm["flicker"] * per_v
    return {"arw": 60 / math.sqrt(2) * np.sqrt(square), "bias_instability": floor}


def _positive_v_q_square(v_squared):
    """V_q^2 (V^2), continued below LEAST_V smoothly and above 0, so that a search finds its way back."""
    least = LEAST_V**2
    return np.where(v_squared > least, v_squared, least / (2 - np.minimum(v_squared / least, 1)))


def works(predictions, span_v=5.5):
    """Whether boards hold quadrature at rest: V_q above LEAST_V and within its DAC's span at every temperature."""
    volts = np.stack([predictions[f"v_q_{temp:g}"] for temp in rows.TEMPERATURES_DEGC])
    return np.all((volts > LEAST_V) & (volts < span_v), axis=0)


def _case(b, rad):
    """Scale factor, V_q and bias of one case at one temperature; rad: residuals."""
    angle = rad["ye1"] + rad["xe2"]
    cosine = np.cos(angle)
    # equal offsets of both codes: F0 = D y, y = (j - 1) offset e^(j ye2) / pickoff
    force = -(1 + 1j) * b.dynamic_n_per_m * b.offset_v / b.sense_v_per_m * np.exp(1j * (rad["ye2"] - rad["xe2"]))
    in_phase = b.damping_n + force.real
    kappa = (in_phase * np.sin(angle) / cosine + force.imag) / b.amplitude_m
    return {
        "scale_factor": b.coriolis_n / (b.per_word_n * cosine),
        "v_q": np.sqrt(_positive_v_q_square((b.kxy_n_per_m - kappa) / b.kq_n_per_m_per_v2)),
        "bias": in_phase / b.coriolis_n,
    }


def _room(v, mode):
    """Phases, the drive's ring, and charge per deg/s, at 25 degC."""
    warm = _warm(v, mode, ROOM_DEGC)
    phases_deg, passed = _phases(v, mode, warm, clocked_s(mode))
    room = warm["rings"][0]
    return phases_deg, room, _charge_per_dps(v, _board(v, mode, warm, passed, room))


def charges_c(v, mode):
    """(difference of the charge that two switches inject, of what leaks in half a turn) at 25 degC; arrays (C)."""
    _, _, per_dps = _room(v, mode)
    return v["offset_dps"] * per_dps, v["leakage_dps"] * per_dps


def drift_deg(v, mode, low_degc=-20.0, high_degc=50.0):
    """{node: deg} by which phases rise from one temperature to another."""
    low, high = (_phases(v, mode, _warm(v, mode, t), clocked_s(mode))[0] for t in (low_degc, high_degc))
    return {node: high[node] - low[node] for node in rows.PHASES}


class BoardRows(NamedTuple):
    """Rows of boards: {node: deg}, {(group, temperature): value} of noise, {(case, group, temperature): value}."""

    phases: dict
    noise: dict
    cases: dict


def compute_board_rows(z, mode, cases=CASES):
    """`BoardRows` of boards: z (boards, priors), mode of arrays; `cases` of the five register sets."""
    v = priors.board_numbers(z)
    room_deg, room, per_dps = _room(v, mode)
    phases = {node: room_deg[node] for node in ("xe1", "xe2", "ye1")}
    phases["ye2"] = room_deg["ye2"] + np.where(mode["ye2_at_pin"] == 1, 360 * v["fx_hz"] * v["sid_switch_s"], 0.0)
    out = BoardRows(phases, {}, {})
    for temp in rows.TEMPERATURES_DEGC:
        warm = _warm(v, mode, temp)
        now, passed = _phases(v, mode, warm, clocked_s(mode))
        # what leaks in half a turn goes against the frequency, which moves too little to count
        charge_c = per_dps * (v["offset_dps"] * warm["charge"] + v["leakage_dps"] * warm["leakage"])
        b = _board(v, mode, warm, passed, room)._replace(offset_v=_offset_v(charge_c, warm["f"]))
        out.noise.update({(group, temp): value for group, value in _arw_and_instability(v, b, warm, temp).items()})
        for case in cases:
            rad = {n: (now[n] - (room_deg[n] if case >= COMPENSATED[n] else 0.0)) * DEG for n in rows.PHASES}
            out.cases.update({(case, group, temp): value for group, value in _case(b, rad).items()})
    return out


def relative_case_change(before, after):
    """Relative change; a number of exactly 0 has none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return (after - before) / np.abs(before)


def predict(z, mode, steps=True):
    """{name: array} of fitted rows, and of steps between cases: z (boards, priors), mode of arrays."""
    board_rows = compute_board_rows(z, mode, CASES if steps else CASES[:3])
    out = dict(board_rows.phases) | {f"{group}_{temp:g}": value for (group, temp), value in board_rows.noise.items()}
    for temp in rows.TEMPERATURES_DEGC:
        for group in rows.STEPPED:
            out[f"{group}_{temp:g}"] = sum(board_rows.cases[case, group, temp] for case in (1, 2, 3)) / 3
            for step in rows.STEPS if steps else ():
                before, after = (board_rows.cases[int(case), group, temp] for case in step.split("to"))
                out[f"{group}_{step}_{temp:g}"] = relative_case_change(before, after)
    return out


def stack_predictions(z, mode, names=FITTED):
    """Fitted rows as an array (boards, names); scale factor, ARW, bias instability and V_q as logarithms."""
    predictions = predict(z, mode, steps=False)
    return np.stack([np.log(predictions[n]) if n in LOGARITHMIC else predictions[n] for n in names], axis=-1)


LOGARITHMIC = frozenset(row.name for row in rows.fitted_rows() if row.logarithmic)
