"""Changes of the plant that no record of the loop shows: what they move is a product or a difference to the data.

    scale   a parameter times s, partners times s^power: the same codes (rounding aside)
    delay   a delay and partners later by one time: the same codes at later instants of a turn
    tied    the column of `dependent_key` follows from those of its partners, so that no rounding fixes the direction:
            scale  held dy/dheld = - sum power partner dy/dpartner;   delay  dy/dheld = - sum dy/dpartner
    weak    directions d, |d| = 1, in units of the priors, along which large columns of J cancel: max |d_k J_k| >
            HIDDEN |J d|. What is left there is mostly error of the columns' steps, so the change along d is measured
            m    = (f(u + h d) - f(u - h d)) / 2 h
            J <- J + sum (m - J d) d'
Source    docs/wide_priors.md
"""

from typing import NamedTuple

import numpy as np


class Symmetry(NamedTuple):
    """A direction in which the data see nothing; partners {key: power} of a scale, {key: 1.0} of a delay."""

    name: str
    dependent_key: str
    partners: dict
    delay: bool
    experiment: str

    def column(self, values, columns):
        """Change per unit of `dependent_key` from those of its partners; both {key: ...}."""
        if self.delay:
            return -sum(columns[key] for key in self.partners)
        return (
            -sum(power * values[key] * columns[key] for key, power in self.partners.items())
            / values[self.dependent_key]
        )

    def invariants(self, values):
        """[(words, value, {key: slope})] of what the symmetry leaves, one of each partner."""
        dependent, out = values[self.dependent_key], []
        for key, power in self.partners.items():
            if self.delay:
                out.append(
                    (
                        f"{_parameter_name(key)} - {_parameter_name(self.dependent_key)}",
                        values[key] - dependent,
                        {key: 1.0, self.dependent_key: -1.0},
                    )
                )
                continue
            value = values[key] * dependent**-power
            words = f"{_parameter_name(key)} {'/' if power > 0 else '*'} {_parameter_name(self.dependent_key)}"
            out.append((words, value, {key: value / values[key], self.dependent_key: -power * value / dependent}))
        return out


MOTION = Symmetry(
    "absolute motion",
    "plant.dcdx_f_per_m",
    {"plant.dcdy_f_per_m": 1.0, "plant.k_vf_drive_n_per_v": -1.0, "plant.k_vf_sense_n_per_v": -1.0},
    False,
    "the amplitude of x in metres: stroboscopic or laser vibrometer, or the voltage at a known gap",
)
DELAY = Symmetry(
    "instant of the demodulator",
    "plant.sid_switch_s",
    {"plant.drive_pole_1_s": 1.0, "plant.sense_pole_1_s": 1.0},
    True,
    "a phase counter between a reference pin and a force electrode (/counter/Vxm_vs_sgnsin)",
)
SYMMETRIES = (MOTION, DELAY)
HIDDEN = 10.0  # times a change of the data: columns of steps hold to some percent
WEAK_STEP_SIGMAS = 30.0  # sigmas by which the step along a weak direction moves all features, far above their rounding
REACH = 0.5  # sd of the priors: the largest such step
NOTHING = 1e-9  # of the largest singular value: no data see it
# never fitted: it scales with every force, and with nothing else
MASS = "mass_kg: only force and stiffness per mass are observable (k_vf / mass, k_xy / mass, k_q / mass)"
MASS_EXPERIMENT = "a known force or added mass"


def _parameter_name(key):
    return key.partition(".")[2]


def identifiability_lines(keys, theta, covariance):
    """What no record shows of parameters, and the products that it does show with their sd; () if nothing is tied."""
    values, out = dict(zip(keys, theta)), []
    for s in active_symmetries(keys).values():
        texts = []
        for words, value, slopes in s.invariants(values):
            g = np.array([slopes.get(key, 0.0) for key in keys])
            texts.append(f"{words} = {value:.6g} +- {np.sqrt(g @ covariance @ g):.2g}")
        group = ", ".join(map(_parameter_name, (s.dependent_key, *s.partners)))
        out.append(f"not identifiable: {s.name} ({group}); identifiable: {'; '.join(texts)}; to fix it: {s.experiment}")
    return (*out, f"not identifiable: {MASS}; to fix it: {MASS_EXPERIMENT}") if out else ()


def active_symmetries(keys):
    """{held key: Symmetry} of those whose parameters are all among `keys`."""
    return {s.dependent_key: s for s in SYMMETRIES if {s.dependent_key, *s.partners} <= set(keys)}


def weak(columns):
    """[(direction, step)] of whitened columns (features, parameters) per unit of the priors: see the module."""
    _, sizes, directions = np.linalg.svd(columns, full_matrices=False)
    parts = np.abs(directions * np.linalg.norm(columns, axis=0)).max(axis=1)
    some = (sizes > NOTHING * sizes[0]) & (parts > HIDDEN * sizes)
    return [(d, min(WEAK_STEP_SIGMAS / size, REACH)) for d, size in zip(directions[some], sizes[some])]


def correct_columns(columns, directions, measured):
    """Columns (n, parameters) whose changes along orthonormal directions are the measured ones (directions, n)."""
    if not len(directions):
        return columns
    direction_basis = np.array(directions)
    return columns + (np.array(measured) - direction_basis @ columns.T).T @ direction_basis
