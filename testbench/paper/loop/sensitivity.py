"""Sensitivity of what is seen to what is built: d(observable)/d(latency, pole, word length, gain), by the linear loops.

    observables   scale factor, bias, V_q, ARW, bandwidth, peak, ring, gain margin, drive frequency, four phases
    parameters    keys of the configuration, lengths of words; each moved by a step of its own, both ways if it can be
    derivative    (O(p + h) - O(p - h)) / 2h per unit;  change = derivative times the step, in the observable's unit
    ARW           60/sqrt(2) times the one-sided density at 0.3 Hz of C/V, converter, DAC, damping; rounding as white
                  (of V_q: as the loop lets a stiffness through)

Source    docs/loop.md
"""

import math
from typing import NamedTuple

import numpy as np

from testbench.config import changed
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import LoopParameters, loop_parameters
from testbench.run.budget import budget

ARW_HZ = 0.3
OBSERVABLES = {
    "scale_factor": ("scale factor", "ppm"),
    "bias": ("bias", "deg/h"),
    "v_q": ("V_q", "mV"),
    "arw": ("ARW", "mdeg/rth"),
    "bandwidth": ("bandwidth", "Hz"),
    "peak": ("closed-loop peak", "dB"),
    "ring_tau": ("ring at the split", "ms"),
    "gain_margin": ("FTR gain margin", "dB"),
    "f_d": ("drive frequency", "mHz"),
    "xe1": ("xe1", "deg"),
    "xe2": ("xe2'", "deg"),
    "ye1": ("ye1", "deg"),
    "ye2": ("ye2'", "deg"),
}


# Changes below these are rounding of the computation, in the units above
RESOLUTION = {
    "scale_factor": 1.0,
    "bias": 0.01,
    "v_q": 1e-3,
    "arw": 1e-3,
    "bandwidth": 1e-3,
    "peak": 1e-3,
    "ring_tau": 1e-2,
    "gain_margin": 2e-3,
    "f_d": 1e-3,
    "xe1": 1e-4,
    "xe2": 1e-4,
    "ye1": 1e-4,
    "ye2": 1e-4,
}


class Parameter(NamedTuple):
    """What is moved: a configuration key or a field of `LoopParameters`, by `step` (absolute, or a share of it)."""

    name: str
    kind: str  # latency, pole, word length, gain, resonator, environment
    step: float
    unit: str
    share: bool = False
    one_sided: bool = False


def _shares(kind, names, section="plant", share=0.01):
    return [Parameter(f"{section}.{name}", kind, share, "1 %", share=True) for name in names]


PARAMETERS = (
    Parameter("firmware.pipeline_registers", "latency", 1, "register", one_sided=True),
    Parameter("firmware.reference_registers", "latency", 1, "register"),
    Parameter("firmware.frame_latency_drive", "latency", 1, "tick", one_sided=True),
    Parameter("firmware.frame_latency_sense", "latency", 1, "tick"),
    Parameter("plant.drive_dac_delay_s", "latency", 10e-9, "10 ns", one_sided=True),
    Parameter("plant.sense_dac_delay_s", "latency", 10e-9, "10 ns"),
    Parameter("plant.sid_switch_s", "latency", 10e-9, "10 ns"),
    Parameter("plant.adc_delay_s", "latency", 10e-6, "10 us", one_sided=True),
    *_shares("pole", [f"{channel}_pole_{n}_s" for channel in ("drive", "sense") for n in (1, 2, 3)]),
    *_shares("pole", ["cref_drive_f", "cref_sense_f", "opamp_gbw_hz", "sid_r_ohm"]),
    Parameter("firmware.ftr_zero_hz", "pole", 0.01, "1 %", share=True),
    Parameter("plant.adc_step_code", "word length", 10, "1 bit of the ADC", one_sided=True),
    Parameter("parts.dac_lsb_v", "word length", 1.0, "1 bit of the force DAC", share=True, one_sided=True),
    Parameter("parts.v_q_lsb_v", "word length", 1.0, "1 bit of the V_q DAC", share=True, one_sided=True),
    *_shares("gain", ["signal_gain", "dcdx_f_per_m", "dcdy_f_per_m", "carrier_v", "c0_f", "cp_f"]),
    *_shares("gain", ["k_vf_sense_n_per_v", "kq_n_per_m_per_v2", "sense_dac_span_v", "quad_dac_span_v", "adc_vref_v"]),
    *_shares("gain", ["amplitude_um", "ftr_crossover_hz", "qsc_crossover_hz"], "firmware"),
    *_shares("gain", ["sid_charge_c", "cv_noise_v_per_rthz", "adc_noise_sense_v"]),
    *_shares("resonator", ["mass_kg", "coriolis_mass_kg", "qx", "qy", "kxy_n_per_m", "dxy_ratio"]),
    Parameter("plant.fx_hz", "resonator", 1.0, "1 Hz"),
    Parameter("plant.fy_hz", "resonator", 1.0, "1 Hz"),
    Parameter("scenario.temperature_degc", "environment", 1.0, "1 K"),
)


def null_v(p: LoopParameters):
    """V_q (V) that cancels k_xy at rate 0."""
    return p.quad_span_v * math.sqrt(max(p.kxy_n_per_m, 0.0) / p.u_full_n_per_m)


def density_dps(p: LoopParameters, loop=None, f_hz=ARW_HZ):
    """One-sided density (deg/s/rtHz) of the rate at `f_hz` by source; rounding of both converters as white noise."""
    loop = loop or lp.close(p)
    lsb = advisor.dc_gain(loop) * lp.DEG
    sid_dps_per_v = math.hypot(*(abs(lp.response(loop, f_hz, c)[0]) for c in (lp.OFFSET_SIN, lp.OFFSET_COS))) / lsb
    per_frame = math.sqrt(2 * p.frame_s)
    # a tone's in-phase amplitude has twice the density of the voltage around it
    force_v = math.sqrt(2) / (p.volts_per_word * lsb)
    coriolis = 2 * p.coriolis_mass_kg * p.w_rad_s * p.amplitude_m * lp.DEG
    step_v = p.step_code / p.code_per_v
    by_stiffness = abs(lp.response(loop, f_hz, lp.STIFFNESS)[0]) / lsb
    code_n_per_m = 2 * p.u_full_n_per_m / p.quad_span_v**2 * null_v(p) * p.v_q_lsb_v
    return {
        # the sign of the reference leaves the density as it is; the difference of the two halves doubles the voltage
        "cv": sid_dps_per_v * 2 * p.cv_noise_v_per_rthz,
        "adc": sid_dps_per_v * p.adc_noise_v * per_frame,
        "adc_rounding": sid_dps_per_v * step_v / math.sqrt(12) * per_frame,
        "dac": force_v * p.dac_noise_v_per_rthz,
        "dac_rounding": force_v * p.dac_lsb_v / math.sqrt(12) * math.sqrt(2 / p.tick_hz),
        "v_q_rounding": float(by_stiffness) * code_n_per_m / math.sqrt(12) * per_frame,
        "thermomechanical": math.sqrt(2) * p.force_noise_n_per_rthz / coriolis,
    }


def arw_deg_per_rth(p: LoopParameters, loop=None):
    """Angle random walk: 60/sqrt(2) times the density of all sources together."""
    return 60 / math.sqrt(2) * math.hypot(*density_dps(p, loop).values())


def observe(config, p: LoopParameters | None = None):
    """All observables of a configuration, in the units of `OBSERVABLES`; scale factor in LSB per deg/s."""
    p = p or loop_parameters(config)
    a = advisor.analyse(p)
    phases = budget(config, frequency_hz=p.w_rad_s / (2 * math.pi))
    node, loop = phases.node_deg(), phases.loop_deg()
    return {
        "scale_factor": a.lsb_per_dps,
        "bias": 3600 * a.bias_dps,
        "v_q": 1e3 * a.v_q,
        "arw": 1e3 * arw_deg_per_rth(p),
        "bandwidth": a.bandwidth_hz,
        "peak": a.peak_db,
        "ring_tau": 1e3 * a.ring_tau_s,
        "gain_margin": a.gain_margin_up_db,
        "f_d": 1e3 * p.w_rad_s / (2 * math.pi),
        "xe1": node["xe1"],
        "xe2": loop["xe2"],
        "ye1": node["ye1"],
        "ye2": loop["ye2"],
    }


def move_parameter(config, parameter: Parameter, sign):
    """(configuration, parts, distance moved in the parameter's own unit) for one step up or down."""
    section, key = parameter.name.split(".")
    if section == "parts":
        p = loop_parameters(config)
        step = getattr(p, key) * parameter.step * sign
        return config, p._replace(**{key: getattr(p, key) + step}), step
    value = getattr(getattr(config, section), key)
    step = (value * parameter.step if parameter.share else parameter.step) * sign
    after = changed(config, {parameter.name: value + step if isinstance(value, float) else int(value + step)})
    return after, loop_parameters(after), step


class Row(NamedTuple):
    """One parameter: change of each observable for one step, and the derivative per unit of the parameter."""

    parameter: Parameter
    change: dict
    derivative: dict


def _difference(name, high, low, base):
    return 1e6 * (high - low) / base if name == "scale_factor" else high - low


def rows(config, parameters=PARAMETERS, progress=None):
    """`Row` of each parameter, in the order given."""
    base = observe(config)
    out = []
    for n, parameter in enumerate(parameters):
        up, p_up, h_up = move_parameter(config, parameter, 1)
        high = observe(up, p_up)
        if parameter.one_sided:
            low, h = base, h_up
        else:
            down, p_down, h_down = move_parameter(config, parameter, -1)
            low, h = observe(down, p_down), h_up - h_down
        differences = {name: _difference(name, high[name], low[name], base["scale_factor"]) for name in OBSERVABLES}
        derivative = {name: value / h for name, value in differences.items()}
        out.append(Row(parameter, {name: value * h_up for name, value in derivative.items()}, derivative))
        if progress:
            progress("sensitivity", n + 1, len(parameters))
    return out


def ranking(table, observable):
    """Rows that move an observable, strongest first."""
    significant_rows = [row for row in table if abs(row.change[observable]) >= RESOLUTION[observable]]
    return sorted(significant_rows, key=lambda row: -abs(row.change[observable]))


def matrix(table):
    """Changes (parameters, observables) as an array."""
    return np.array([[row.change[name] for name in OBSERVABLES] for row in table])
