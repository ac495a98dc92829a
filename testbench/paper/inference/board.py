"""A board of the inference as configuration: keys of [nominal], which the plant follows, and of [firmware].

Source    docs/inference.md
"""

import numpy as np

from testbench.config import Config, changed
from testbench.paper.inference import forward, priors, ring_table

SAME = tuple(
    name
    for name in priors.NAMES
    if name.endswith("_per_k")
    or name.startswith(("drive_pole", "sense_pole", "sid_", "opamp", "cv_noise", "adc_noise"))
)  # keys of [nominal] by their own names
SAME += ("sense_dac_delay_s", "carrier_v", "fx_hz")


def settings(v, mode):
    """{dotted key: value} of one board; v: numbers by name, mode: choices by name."""
    one = {name: np.array([value]) for name, value in v.items()}
    cref_drive_f, cref_sense_f = forward.crefs_f(v)
    gain, _ = ring_table.rings(one["carrier_v"], np.array([cref_drive_f]))[forward.ROOM_DEGC]
    slope = forward.pickoff_f_per_m(v, gain[0])
    force = forward.force_n_per_v(v)
    kxy = forward.quadrature_n_per_m(v["fx_hz"], v["quadrature_dps"])
    (charge_c,) = forward.charge_difference_c(one, {name: np.array([choice]) for name, choice in mode.items()})
    nominal = {name: v[name] for name in SAME} | {
        "fy_hz": v["fx_hz"] - forward.SPLIT_HZ,
        "sid_charge_mismatch": charge_c / Config().plant.sid_charge_c,
        "dxy_ratio": forward.dxy_ratio(v),
        "qx": v["q"],
        "qy": v["q"],
        "cref_drive_f": cref_drive_f,
        "cref_sense_f": cref_sense_f,
        "k_vf_drive_n_per_v": force,
        "k_vf_sense_n_per_v": force,
        "kxy_n_per_m": kxy,
        "kq_n_per_m_per_v2": kxy / v["v_q_null_v"] ** 2,
        "dcdx_f_per_m": slope,
        "dcdy_f_per_m": slope,
    }
    keys = {f"nominal.{name}": float(value) for name, value in nominal.items()}
    keys |= {"nominal.diode_tc_on": int(mode["diode_tc_on"]), "firmware.amplitude_um": float(v["amplitude_um"])}
    return keys | forward.firmware_keys(mode)


def config_of(v, mode):
    """Checked configuration of one board."""
    return changed(Config(), settings(v, mode))
