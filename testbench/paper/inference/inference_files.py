"""The study as files: a configuration that `gyro run --config` takes, and everything behind it as JSON.

Numbers are written with DIGITS significant digits, so that a repeat on the same machine gives the same bytes.
Source    docs/inference.md
"""

import json
import math

from testbench.config.toml_text import toml_value
from testbench.paper.inference import priors
from testbench.storage.files import write_text

DIGITS = 6


def round_numbers(value):
    """Plain data with its numbers to DIGITS significant digits; what is not finite becomes null."""
    if isinstance(value, dict):
        return {str(k): round_numbers(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [round_numbers(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


def toml_text(results, json_name):
    """The most probable board as TOML, with the ranked modes as comments."""
    chosen, lines = results["board"], []
    lines += ["# The most probable board for the paper's numbers, written by `gyro report infer`; not a measurement."]
    lines += [f"# Posterior, covariance, held-out rows: {json_name}. Limits: docs/inference.md.", "#"]
    lines += ["# Modes, most probable first: " + ", ".join(c.name for c in priors.CHOICES)]
    for mode in results["modes"]:
        choices = ", ".join(str(mode["choices"][c.name]) for c in priors.CHOICES)
        lines += [f"#   {mode['weight']:.3f}   chi2 {mode['chi2']:.1f} of 19 rows   {choices}"]
    sections = {}
    for key, value in chosen["settings"].items():
        section, name = key.split(".")
        sections.setdefault(section, []).append(f"{name} = {toml_value(round_numbers(value))}")
    for section, keys in sections.items():
        lines += ["", f"[{section}]", *keys]
    return "\n".join(lines) + "\n"


def write(results, board_path):
    """Write FILE.toml and FILE.json beside it; returns both paths."""
    json_path = board_path.with_suffix(".json")
    write_text(json_path, json.dumps(round_numbers(results), indent=1) + "\n")
    write_text(board_path, toml_text(results, json_path.name))
    return board_path, json_path
