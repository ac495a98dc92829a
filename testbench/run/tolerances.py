"""Boards within the tolerances of [nominal]: random plants that one firmware must work with.

Draw k of a seed is the same plant however many are drawn. Frequencies, splits, transducers and capacitors are uniform,
Q is uniform in its logarithm; both Q, and all parts of one kind, are drawn one by one.
Source    docs/boards/README.md
"""

import math

import numpy as np

from testbench.config import changed

TRANSDUCERS = ("k_vf_drive_n_per_v", "k_vf_sense_n_per_v", "dcdx_f_per_m", "dcdy_f_per_m")
CAPACITORS = ("c0_f", "cp_f", "cref_drive_f", "cref_sense_f", "sid_c_f")


def draw(config, seed, number):
    """The configuration with plant `number` of a seed in place of its own; the noise has a seed of its own, too."""
    rng, nominal = np.random.default_rng([seed, number]), config.nominal

    def off(tolerance):
        return 1.0 + float(rng.uniform(-tolerance, tolerance))

    fx_hz = nominal.fx_hz * off(nominal.f_tolerance)
    values = {"fx_hz": fx_hz, "fy_hz": fx_hz - (nominal.fx_hz - nominal.fy_hz) * off(nominal.split_tolerance)}
    reach = math.log(nominal.q_tolerance) / 2
    values |= {name: getattr(nominal, name) * math.exp(float(rng.uniform(-reach, reach))) for name in ("qx", "qy")}
    values |= {name: getattr(nominal, name) * off(nominal.transducer_tolerance) for name in TRANSDUCERS}
    values |= {name: getattr(nominal, name) * off(nominal.capacitor_tolerance) for name in CAPACITORS}
    plant_overrides = {f"plant.{name}": value for name, value in values.items()}
    return changed(config, plant_overrides | {"noise.seed": int(rng.integers(1, 2**31))})
