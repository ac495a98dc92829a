"""Intervals of a data sheet's parameters: which of those that a trace has printed hold the board of the envelope?

    off      (found - true) / sd      positive parameters in logarithms; found and sd of the fit with its laws
    product  in place of the parameters that a symmetry ties: value and sd of the line `identifiable`
A board's own delays come from its seed, within the second plant. Their sd is added to that of an instant.
Source    docs/sealed.md
"""

import math
import re

from testbench.config import Config
from testbench.measured.closed_loop.loop_symmetries import active_symmetries
from testbench.measured.wide import data_sheet
from tests.sealed import strata
from tests.sealed.draw import DELAY_SHARE

PRODUCT = re.compile(r"(\w+ [-/*] \w+) = (\S+) \+- ([^\s;]+)")


def offs(sealed, said):
    """{parameter or product: (found - true) / sd} of an envelope and of the result that was traced from a sheet."""
    cfg, delay_sd_s = Config(), strata.read().plant["delay_sd_s"]
    tolerances = data_sheet.read(data_sheet.BUNDLED_PATH)
    truth = {key: getattr(cfg.plant, key.partition(".")[2]) for key in tolerances} | {
        key: value for key, value in sealed["values"].items() if key in tolerances
    }
    rows = {n["name"]: n for n in said["nuisances"]}
    found = {}
    symmetries = active_symmetries(list(tolerances)).values()
    hidden = {key for s in symmetries for key in (s.dependent_key, *s.partners)}
    for p in data_sheet.parameters(cfg, tolerances):
        if p.key not in hidden:
            found[p.key] = _off(p, rows[p.key], truth[p.key])
    told = {words: (float(value), float(sd)) for words, value, sd in PRODUCT.findall("\n".join(said["notes"]))}
    for s in symmetries:
        for words, true, _ in s.invariants(truth):
            value, sd = told[words]
            found[words] = (value - true) / (math.hypot(sd, DELAY_SHARE * delay_sd_s) if s.delay else sd)
    return found


def _off(p, row, true):
    if not p.logarithmic:
        return (row["after"] - true) / row["sd"]
    # about the board where the stages have ended; the prior's sd there is its own times that value
    return (row["after"] - p._replace(start=row["prior_sd"] / p.scale).theta(true)) / row["sd"]
