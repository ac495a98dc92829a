"""A design in a loop judged as a board is: what `pin_meter` found of it beside a run of the model, each with a limit.

    difference    of the design from the model with the same configuration, noise samples included
    sigma         of the difference: of lags from parts of the record, of the others from blocks, pair by pair
    passed        |difference| <= limit, where 3 sigma <= limit: an equal design fails in less than 0.3 % of runs.
                  With a larger sigma only |difference| > limit + 3 sigma is judged, and fails
    found_95      deviation that fails in 95 of 100 runs: limit + 1.645 sigma

Source  docs/rtl.md (a design with the pins alone)
"""

import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model import cordic
from testbench.golden.loop import pin_meter
from testbench.run import build
from testbench.run.budget import budget
from testbench.run.phase_meter import SHARES, sum_sigma, wrap_deg

SURE, POWER = 3.0, 1.645
LIMIT_CLOCKS = 0.25  # of a lag: one undeclared register fails
LIMIT_LOCK = 0.1  # of the time to lock
LIMIT_AMPLITUDE = LIMIT_SCALE = 1e-3  # of the model's
LIMIT_BIAS_DPS = 0.1
LIMIT_NOISE = 0.1  # of the model's
LEAST_SIGMA_DPS = 1e-9  # of equal runs
ANALOG = ("DAC response", "output pole")  # rows of the budget behind the pins
DETECTION = Path(__file__).with_name("detection.json")
PASSED, FAILED, OPEN = "pass", "FAIL", "not resolved"
PASS_CAVEAT_TEXT = (
    "A PASS does not cover: inputs outside this scenario; words that reach no DAC; rounding and saturation that no "
    "code of this run depends on. The vectors of the blocks cover these (gyro golden check)."
)


def detection():
    """Faults of each kind that were planted in the reference RTL, and those that the pins of a loop showed."""
    return json.loads(DETECTION.read_text())


def pass_caveat():
    """What a PASS does not show, with the kinds of planted faults that a loop missed."""
    detection_counts = detection()
    missed = sorted(
        (detected / planted, kind, planted, detected) for kind, (planted, detected) in detection_counts["kinds"].items()
    )
    missed_text = ", ".join(
        f"{kind} {detected} of {planted}" for _, kind, planted, detected in missed if detected < planted
    )
    faults, detection_count = detection_counts["faults"], detection_counts["seen"]
    return (
        f"{PASS_CAVEAT_TEXT} Of {faults} planted faults, a loop that compares pins detected {detection_count}. "
        f"Kinds of which it missed some: {missed_text}."
    )


class Line(NamedTuple):
    """One quantity: both values, their difference with its sigma, its limit; `budget` is None but for lags."""

    what: str
    unit: str
    model: float
    yours: float
    difference: float
    sigma: float
    limit: float
    budget: float | None = None

    @property
    def verdict(self):
        doubt = SURE * self.sigma
        if abs(self.difference) > self.limit + doubt:
            return FAILED
        if doubt > self.limit:
            return OPEN
        return PASSED if abs(self.difference) <= self.limit else FAILED

    @property
    def detectable_deviation(self):
        return self.limit + POWER * self.sigma

    def to_dict(self):
        return {**self._asdict(), "verdict": self.verdict, "found_95": self.detectable_deviation}


class Verdict(NamedTuple):
    """All lines, the frequency (Hz), clocks of 26 MHz that each lag is late, and whether the design found lock."""

    lines: tuple
    frequency_hz: float
    clocks: dict
    locked: bool

    @property
    def passed(self):
        return self.locked and all(line.verdict == PASSED for line in self.lines)

    def to_dict(self):
        return {
            "passed": self.passed,
            "locked": self.locked,
            "frequency_hz": self.frequency_hz,
            "clocks_late": self.clocks,
            "lines": [line.to_dict() for line in self.lines],
            "not_shown": pass_caveat(),
        }

    def text(self):
        if not self.locked:
            return "JUDGED FAIL: the loops of this design do not lock, those of the model do"
        rows = [("", "model", "yours", "difference", "sigma", "limit", "fails 95 %", "budget", "")]
        rows += [
            (
                f"{line.what.replace(', of', ' /')} ({line.unit})", f"{line.model:.6g}", f"{line.yours:.6g}",
                f"{line.difference:+.3g}", f"{line.sigma:.1g}", f"{line.limit:.2g}", f"{line.detectable_deviation:.2g}",
                "" if line.budget is None else f"{line.budget:.4f}", line.verdict,
            )
            for line in self.lines
        ]  # fmt: skip
        table_lines = ["  {:<32}{:>10}{:>10}{:>12}{:>9}{:>9}{:>12}{:>9}  {}".format(*row).rstrip() for row in rows]
        lag_clocks_text = ", ".join(f"{name} {count:+.2f}" for name, count in self.clocks.items())
        return "\n".join(
            [
                f"JUDGED {'PASS' if self.passed else 'FAIL'} by measurements at the pins, as of a board:",
                *table_lines,
                f"Lag behind the model in clocks of 26 MHz: {lag_clocks_text}.",
                pass_caveat(),
            ]
        )


def lock_limits(config, firmware):
    """`pin_meter.Limits` of a configuration."""
    lock = firmware.control.sequencer.lock
    words = dict(build.register_writes(config))
    gain = float(cordic.gain(firmware.design.cordic_iterations))
    return pin_meter.Limits(lock.limit_in, lock.limit_out, lock.frames_in, words["amplitude_setpoint"] / gain)


def _mean_sigma(values):
    """Standard deviation of the mean of correlated values."""
    shares = [part.sum() for part in np.array_split((values - values.mean()) / len(values), SHARES)]
    return sum_sigma(np.array(shares))


def _fit_rate_line(rates, means, sigmas):
    """Slope and offset through points with sigmas, weighted, and the sigma of each."""
    weights = 1 / np.maximum(sigmas, LEAST_SIGMA_DPS)
    basis = np.stack([np.array(rates), np.ones(len(rates))], axis=1) * weights[:, None]
    cov = np.linalg.inv(basis.T @ basis)
    return cov @ basis.T @ (np.array(means) * weights), np.sqrt(np.diag(cov))


def _rates(model, yours, stretches):
    """Lines of scale factor, bias and noise."""
    rates = [plateau.rate_dps for plateau in stretches]
    basis = np.stack([np.array(rates), np.ones(len(rates))], axis=1)
    slope, offset = np.linalg.lstsq(basis, np.array([ratio.mean() for ratio in model.ratio]), rcond=None)[0]
    model_rates_dps, design_rates_dps = (
        [(ratio * np.conj(slope)).real / abs(slope) ** 2 for ratio in run.ratio] for run in (model, yours)
    )  # fmt: skip
    paired = [b - a for a, b in zip(model_rates_dps, design_rates_dps, strict=True)]
    sigmas = [_mean_sigma(d) for d in paired]
    (gain, shift), (gain_sigma, shift_sigma) = _fit_rate_line(rates, [d.mean() for d in paired], sigmas)
    bias = float((offset * np.conj(slope)).real / abs(slope) ** 2)
    quiet = int(np.argmin(np.abs(rates)))
    a, b = model_rates_dps[quiet], design_rates_dps[quiet]
    # paired samples: the ratio of their spreads is known the better the more they are alike (Pitman 1939)
    correlation = float(np.corrcoef(a, b)[0, 1])
    mean_sigma = _mean_sigma(a)
    count = float(np.clip((a.std() / mean_sigma) ** 2 if mean_sigma else len(a), 4, len(a)))
    noise, noise_sigma = float(b.std() / a.std() - 1), math.sqrt(max(1 - correlation**2, 0.0) / (count - 2))
    return [
        Line("scale factor, of the model's", "1", 1.0, 1.0 + float(gain), float(gain), float(gain_sigma), LIMIT_SCALE),
        Line("bias", "deg/s", bias, bias + float(shift), float(shift), float(shift_sigma), LIMIT_BIAS_DPS),
        Line("noise, of the model's", "1", 1.0, 1.0 + noise, noise, noise_sigma, LIMIT_NOISE),
    ]


def assess_design(config, firmware, model, yours, stretches):
    """`Verdict` on a design from two `pin_meter.Measured`.

    stretches  `pin_meter.Plateau`s of the scenario
    """
    if yours.lock_frame < 0:
        return Verdict((), 0.0, {}, False)
    design, f = firmware.design, model.frequency_hz
    per_clock = 360.0 * f / design.master_hz
    planned = budget(config, frequency_hz=f)
    lines = [
        Line(
            "time to lock", "s", model.lock_frame / design.frame_hz, yours.lock_frame / design.frame_hz,
            (yours.lock_frame - model.lock_frame) / design.frame_hz, 1 / design.frame_hz,
            LIMIT_LOCK * model.lock_frame / design.frame_hz,
        )
    ]  # fmt: skip
    clocks = {}
    for name in pin_meter.NODES:
        analog = sum(row.degrees for row in planned.rows[name] if row.what.startswith(ANALOG))
        lag_difference_deg = float(wrap_deg(yours.lag_deg[name] - model.lag_deg[name]))
        sigma = math.hypot(model.lag_sigma_deg[name], yours.lag_sigma_deg[name])
        first = float(wrap_deg(model.lag_deg[name] + analog))
        clocks[name] = lag_difference_deg / per_clock
        lines.append(
            Line(
                name,
                "deg",
                first,
                first + lag_difference_deg,
                lag_difference_deg,
                sigma,
                LIMIT_CLOCKS * per_clock,
                planned.node_deg()[name],
            )
        )
    um, larger = 1e6 * float(model.amplitude_m.mean()), 1e6 * (yours.amplitude_m - model.amplitude_m)
    more, sigma = float(larger.mean()), _mean_sigma(larger)
    lines.append(Line("amplitude", "um", um, um + more, more, sigma, LIMIT_AMPLITUDE * um))
    lines += _rates(model, yours, stretches)
    return Verdict(tuple(lines), f, clocks, True)
