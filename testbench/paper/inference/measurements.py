"""Which one measurement would decide: the information that a reading is expected to give.

    modes     H(mode) - E H(mode | m): bits about the discrete assumptions, m drawn from the posterior with its error
    numbers   log2(1 + var/sigma^2)/2: bits about what is read itself, as if it were normal

Both from the weighted draws of the posterior. A reading's error is that of an ordinary instrument.
Source    docs/inference.md
"""

import math
from typing import NamedTuple

import numpy as np

from testbench.paper.inference import forward, priors

READINGS = 400  # readings drawn for an expectation


class Candidate(NamedTuple):
    """A measurement: what a board would show, and one standard deviation of the reading."""

    name: str
    unit: str
    sigma: float
    read: object  # (numbers, mode, `BoardRows`) -> array


def _drift(node):
    def read(v, mode, board_rows):
        return forward.drift_deg(v, mode)[node]

    return read


CANDIDATES = (
    Candidate("oscilloscope at a reference pin: edges on the grid of 1 us or not", "1", 0.05,
              lambda v, mode, rows: 1.0 * mode["reference_retimed"]),
    Candidate("oscilloscope: delay from reference to the sense DAC's latch", "ns", 5.0,
              lambda v, mode, rows: 1e9 * forward.clocked_s(mode)[1]),
    Candidate("delay from the sense DAC's latch to its output", "ns", 5.0,
              lambda v, mode, rows: 1e9 * forward.sense_response_s(v, mode)),
    Candidate("carrier at 50 degC minus that at -20 degC", "mV", 5.0,
              lambda v, mode, rows: 1e3 * 70 * v["carrier_v"] * forward.carrier_tc_per_k(v, mode)),
    Candidate("xe1 at 50 degC minus that at -20 degC", "deg", 0.008, _drift("xe1")),
    Candidate("ye1 at 50 degC minus that at -20 degC", "deg", 0.008, _drift("ye1")),
    Candidate("ye2' at 50 degC minus that at -20 degC", "deg", 0.012, _drift("ye2")),
    Candidate("xe2' by symmetric detuning", "deg", 0.001, lambda v, mode, rows: rows.phases["xe2"]),
    Candidate("delay from the pin to the analog switch", "ns", 2.0,
              lambda v, mode, rows: 1e9 * v["sid_switch_s"]),
    Candidate("drive frequency", "Hz", 1.0, lambda v, mode, rows: v["fx_hz"]),
    Candidate("ln of the drive amplitude, by vibrometer", "1", 0.02, lambda v, mode, rows: np.log(v["amplitude_um"])),
    Candidate("ln of x at the ring's output", "1", 0.02, lambda v, mode, rows: np.log(v["pickoff_v"])),
    Candidate("ln of the ring-down time of x at 50 degC over that at -20 degC", "1", 0.02,
              lambda v, mode, rows: 70 * v["dlnq_per_k"]),
    Candidate("ln of the quadrature at V_q = 0", "1", 0.02, lambda v, mode, rows: np.log(v["quadrature_dps"])),
    Candidate("offset of the sense codes at 50 degC with the drive off, as rate", "deg/s", 0.02,
              lambda v, mode, rows: v["offset_dps"] * (1 + 25 * v["sid_charge_tc_per_k"]) + 2**2.5 * v["leakage_dps"]),
)  # fmt: skip


class Worth(NamedTuple):
    """What a candidate is expected to tell, in bits."""

    name: str
    unit: str
    sigma: float
    predicted: float  # posterior mean and standard deviation of the reading
    spread: float
    mode_bits: float
    number_bits: float


def _entropy(p):
    return -np.sum(np.where(p > 0, p * np.log2(np.maximum(p, 1e-300)), 0.0), axis=-1)


def worth(post, rng, choice=None):
    """([Worth, ...] best first, bits open) about all modes, or about one discrete assumption."""
    names = [choice] if choice else [c.name for c in priors.CHOICES]
    keys = np.stack([post.mode[name] for name in names], axis=1)
    _, which = np.unique(keys, axis=0, return_inverse=True)
    member = np.equal(which.ravel()[:, None], np.arange(which.max() + 1)).astype(float)
    v, board_rows = priors.board_numbers(post.z), forward.compute_board_rows(post.z, post.mode, ())
    prior_bits = float(_entropy(post.weight @ member))
    out = []
    for c in CANDIDATES:
        value = np.asarray(c.read(v, post.mode, board_rows), float)
        mean = float(post.weight @ value)
        spread = math.sqrt(max(float(post.weight @ (value - mean) ** 2), 0.0))
        drawn = rng.choice(value, READINGS, p=post.weight) + c.sigma * rng.standard_normal(READINGS)
        log = -0.5 * ((drawn[:, None] - value) / c.sigma) ** 2
        likely = post.weight * np.exp(log - log.max(axis=1, keepdims=True))
        after = (likely / likely.sum(axis=1, keepdims=True)) @ member
        bits = prior_bits - float(np.mean(_entropy(after)))
        out.append(
            Worth(c.name, c.unit, c.sigma, mean, spread, max(bits, 0.0), 0.5 * math.log2(1 + (spread / c.sigma) ** 2))
        )
    return sorted(out, key=lambda w: -w.mode_bits), prior_bits
