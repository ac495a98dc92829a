"""A board of the inference as configuration: keys of [nominal], which the plant follows, and of [firmware].

Source    docs/inference.md
"""

import numpy as np

from testbench.config import Config, changed
from testbench.paper.inference import forward, ring_table

NOMINAL_PRIOR_KEYS = (
    *(f"{path}_pole_{n}_s" for path in ("drive", "sense") for n in (1, 2, 3)),
    *("opamp_gbw_hz", "sid_switch_s", "fx_hz", "carrier_v", "adc_noise_sense_v"),
    *("cv_resistor_ohm", "ina_current_noise_a_per_rthz", "ina_bias_exponent", "ina_beta_exponent"),
    *("sid_flicker_v_per_rthz", "sid_flicker_exponent", "sid_charge_tc_per_k"),
    *("kxy_tc_below_per_k", "kxy_tc_above_per_k", "dlnq_per_k", "opamp_gbw_tc_per_k", "dac_rc_tc_per_k", "tcf_per_k"),
)  # keys of [nominal] by the names of their priors


def settings(v, mode):
    """{dotted key: value} of one board; v: numbers by name, mode: choices by name."""
    one = {name: np.array([value]) for name, value in v.items()}
    chosen = {name: np.array([choice]) for name, choice in mode.items()}
    cref_drive_f, cref_sense_f = forward.crefs_f(v)
    (gain,) = ring_table.rings(one["carrier_v"], np.array([cref_drive_f]), forward.ROOM_DEGC).gain_v_per_f
    slope, force = forward.pickoff_f_per_m(v, gain), forward.force_n_per_v(v)
    kxy = forward.quadrature_n_per_m(v["fx_hz"], v["quadrature_dps"])
    (charge_c,), (leaked_c,) = forward.charges_c(one, chosen)
    nominal = {name: v[name] for name in NOMINAL_PRIOR_KEYS} | {
        "fy_hz": v["fx_hz"] - forward.SPLIT_HZ,
        "qx": v["q"],
        "qy": v["q"],
        "k_vf_drive_n_per_v": force,
        "k_vf_sense_n_per_v": force,
        "kxy_n_per_m": kxy,
        "kq_n_per_m_per_v2": kxy / v["v_q_null_v"] ** 2,
        "dxy_ratio": forward.dxy_ratio(v),
        "dcdx_f_per_m": slope,
        "dcdy_f_per_m": slope * v["sense_pickoff_ratio"],
        "cref_drive_f": cref_drive_f,
        "cref_sense_f": cref_sense_f,
        "carrier_tc_per_k": forward.carrier_tc_per_k(one, chosen)[0],
        "sense_dac_delay_s": forward.sense_response_s(one, chosen)[0],
        "sid_charge_mismatch": charge_c / Config().plant.sid_charge_c,
        "sid_leakage_a": leaked_c * 2 * v["fx_hz"],
        "cv_noise_v_per_rthz": 0.0,
        "ina_voltage_noise_v_per_rthz": forward.INA_V_PER_RTHZ,
    }
    keys = {f"nominal.{name}": float(value) for name, value in nominal.items()}
    keys |= {"nominal.ring_noise_on": 1, "nominal.dac_amplifier_tc_on": 1, "nominal.ring_saturation_on": 1}
    return keys | {"firmware.amplitude_um": float(v["amplitude_um"])} | forward.firmware_keys(mode)


def board_config(v, mode):
    """Checked configuration of one board."""
    return changed(Config(), settings(v, mode))
