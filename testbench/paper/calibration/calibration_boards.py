"""Random boards: parts drawn from their spreads. Firmware and rates are those of the base; noise has a seed of its own.

Board k of seed s is the same board however many are drawn. Ranges of output chains, switch, charge, op amps and clock
are assumptions from data sheets; 5 % capacitors and a 5 % pickoff are ours.
Source    docs/paper.md
"""

import numpy as np

from testbench import config as configuration

# key of [plant] -> (low, high), uniform; frequencies are drawn below
SPREAD = {
    "qx": (1e5, 4e5),
    "qy": (1e5, 4e5),
    "kxy_n_per_m": (0.035, 0.055),
    "dxy_ratio": (-0.05, 0.05),
    "k_vf_drive_n_per_v": (2.72e-7 * 0.95, 2.72e-7 * 1.05),
    "k_vf_sense_n_per_v": (2.72e-7 * 0.95, 2.72e-7 * 1.05),
    "dcdx_f_per_m": (0.95e-7, 1.05e-7),
    "dcdy_f_per_m": (0.95e-7, 1.05e-7),
    "drive_pole_1_s": (40e-9, 170e-9),
    "drive_pole_2_s": (20e-9, 60e-9),
    "drive_pole_3_s": (20e-9, 60e-9),
    "sense_pole_1_s": (34e-9, 170e-9),
    "sense_pole_2_s": (11e-9, 32e-9),
    "sense_pole_3_s": (20e-9, 60e-9),
    "sense_dac_delay_s": (80e-9, 180e-9),
    "cref_drive_f": (32e-12 * 0.95, 32e-12 * 1.05),
    "cref_sense_f": (45e-12 * 0.95, 45e-12 * 1.05),
    "opamp_gbw_hz": (8.2e6, 12.4e6),
    "sid_c_f": (159e-9 * 0.95, 159e-9 * 1.05),
    "sid_switch_s": (80e-9, 150e-9),
    "sid_charge_c": (0.5e-12, 1.5e-12),
    "sid_charge_mismatch": (-0.1, 0.1),
    "clock_ppm": (-2.0, 2.0),
    "carrier_ppm": (-50.0, 50.0),
}
FX_PART, SPLIT_HZ = 0.005, (120.0, 160.0)


def draw(base, seed, number):
    """Configuration of board `number` of a seed."""
    rng = np.random.default_rng([seed, number])
    values = {f"plant.{name}": float(rng.uniform(*span)) for name, span in SPREAD.items()}
    values["plant.fx_hz"] = base.plant.fx_hz * (1 + float(rng.uniform(-FX_PART, FX_PART)))
    values["plant.fy_hz"] = values["plant.fx_hz"] - float(rng.uniform(*SPLIT_HZ))
    values["noise.seed"] = int(rng.integers(1, 2**31))
    return configuration.changed(base, values)


def random_boards(base, seed, count):
    """Boards 0 .. count - 1 of a seed."""
    return [draw(base, seed, k) for k in range(count)]
