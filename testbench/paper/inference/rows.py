"""The paper's rows as the inference takes them: value and uncertainty from the judge's list, by its one rule.

    fitted     four phases; scale factor, ARW, bias instability, V_q and bias of cases 1 to 3 at three temperatures
    steps      relative change of scale factor, V_q and bias from case 3 to 4 and 4 to 5: never fitted
    added      to a phase: what its closed form may differ from a measured one
    log        of scale factor, ARW, bias instability and V_q ln(value) is compared, with the relative sigma

`heldout.csv` lists the rows that a fit does not see. It stood before the first fit.
Source    docs/inference.md
"""

import csv
import math
from pathlib import Path
from typing import NamedTuple

from testbench.judge import numbers as printed

TEMPERATURES_DEGC = (-20.0, 25.0, 50.0)
PHASES = {"xe1": "case 1", "xe2": "case 3", "ye1": "case 3", "ye2": "case 4"}
GROUPS = {"scale_factor": "SF", "arw": "ARW", "bias_instability": "BI", "v_q": "Vq", "bias": "bias"}
UNITS = {"phases": "deg", "scale_factor": "LSB/(deg/s)", "arw": "deg/sqrt(h)", "bias_instability": "deg/h", "v_q": "V",
         "bias": "deg/s"}  # fmt: skip
STEPS = {"3to4": "case 3", "4to5": "case 4 vs"}
STEPPED = ("scale_factor", "v_q", "bias")
LOGARITHMIC = ("scale_factor", "arw", "bias_instability", "v_q")
HELDOUT_PATH = Path(__file__).with_name("heldout.csv")

MODEL_DEG = 0.003  # measured phases equal the budget within this


class Row(NamedTuple):
    """One number of the paper: `sigma` in the unit of the value."""

    name: str
    group: str
    temp_degc: float
    value: float
    sigma: float
    unit: str
    digit: float

    @property
    def logarithmic(self):
        return self.group in LOGARITHMIC


def _paper_row(number, name, group, unit, more=0.0):
    temp = number.temp_degc
    return Row(name, group, temp, number.values[0], math.hypot(number.sigma, more), unit, printed.step(number.text))


def fitted_rows():
    """Rows of the likelihood, phases first."""
    table, out = printed.numbers(), []
    for node, case in PHASES.items():
        (number,) = (n for n in table if n.symbol == f"phi_{node}" and n.case.startswith(case))
        out.append(_paper_row(number, node, "phases", "deg", MODEL_DEG))
    for group, symbol in GROUPS.items():
        for temp in TEMPERATURES_DEGC:
            number = printed.case_mean_row(table, symbol, temp)
            out.append(_paper_row(number, f"{group}_{temp:g}", group, UNITS[group]))
    return tuple(out)


def steps():
    """Rows of the relative changes between cases, which no fit sees; absolute values, as the paper prints them."""
    table, out = printed.numbers(), []
    for group in STEPPED:
        for step, case in STEPS.items():
            for n in table:
                is_group_change = n.quantity.startswith("relative deviation rate of") and n.symbol == GROUPS[group]
                if is_group_change and n.case.startswith(case):
                    out.append(_paper_row(n, f"{group}_{step}_{n.temp_degc:g}", f"{group}_{step}", "1"))
    return tuple(out)


def repeats_dps():
    """{temperature: standard deviation of one case's bias}."""
    table = printed.numbers()
    return {
        temp: printed.relative_repeatability(table, "bias", temp)
        * abs(printed.case_mean_row(table, "bias", temp).values[0])
        for temp in TEMPERATURES_DEGC
    }


class Fold(NamedTuple):
    """Rows that one fit does not see."""

    name: str
    rule: str
    rows: tuple


def folds():
    """Folds of the committed list, in its order."""
    with HELDOUT_PATH.open(newline="") as file:
        return tuple(Fold(n["fold"], n["rule"], tuple(n["rows"].split())) for n in csv.DictReader(file))
