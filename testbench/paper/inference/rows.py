"""The paper's rows as the inference takes them: value, uncertainty and where it comes from, from the running text.

    fitted     four phases; scale factor, ARW, bias instability, V_q and bias of cases 1 to 3 at three temperatures
    steps      relative change of scale factor, V_q and bias from case 3 to 4 and 4 to 5: never fitted
    sigma      of a mean of three cases: what repeats of a case scatter by, over sqrt 3; rounding is added
    log        of scale factor, V_q, ARW and bias instability ln(value) is compared, with the relative sigma

What the table of held-out rows says is read from `heldout.csv`, which stood before the first fit.
Source    docs/inference.md
"""

import csv
import math
from pathlib import Path
from typing import NamedTuple

from testbench.judge.numbers import table as numbers

TEMPERATURES_DEGC = (-20.0, 25.0, 50.0)
PHASES = ("xe1", "xe2", "ye1", "ye2")
GROUPS = {"scale_factor": "SF", "arw": "ARW", "bias_instability": "BI", "v_q": "Vq", "bias": "bias"}
UNITS = {"phases": "deg", "scale_factor": "LSB/(deg/s)", "arw": "deg/sqrt(h)", "bias_instability": "deg/h", "v_q": "V",
         "bias": "deg/s"}  # fmt: skip
STEPS = ("3to4", "4to5")
STEPPED = ("scale_factor", "v_q", "bias")
LOGARITHMIC = ("scale_factor", "arw", "bias_instability", "v_q")
HELD_OUT = Path(__file__).with_name("heldout.csv")

MODEL_DEG = 0.003  # measured phases equal the budget within this
# A_d is 1/cos near its minimum: 1e-5 of it is acos(1 - 1e-5)
MINIMUM_DEG = math.degrees(math.acos(1 - 1e-5))
# What was left of a phase after compensation: how well the paper's reading repeats (its text)
REPEATS_DEG = {"xe1": 0.0078, "xe2": MINIMUM_DEG, "ye1": 0.0079, "ye2": 0.0116}
SPREAD_V = math.sqrt((0.0077**2 + 0.0078**2 + 0.0088**2) / 3)  # standard deviations between cases, pooled
SPREAD_DPS = math.sqrt((0.0143**2 + 0.0077**2 + 0.0081**2) / 3)
# "Relative deviations below 0.09": the largest range of three cases at three temperatures is 2.47 sigma on average
ARW_SHARE = 0.09 / 2.47
RECORD_S, FLOOR_S = 3600.0, 100.0  # assumed record and averaging time of an Allan floor
FLOOR_SHARE = 1 / math.sqrt(2 * (RECORD_S / FLOOR_S - 1))


class Row(NamedTuple):
    """One number of the paper: `sigma` in the unit of the value."""

    name: str
    group: str
    temp_degc: float
    value: float
    sigma: float
    unit: str
    why: str

    @property
    def logarithmic(self):
        return self.group in LOGARITHMIC


def scale_spread_lsb(mean_lsb=8651.0, printed=(20.84, 27.06, 28.04), ye1_deg=8.8814, xe2_deg=1.2459):
    """Repeatability of a case's scale factor (LSB): the printed spread less what 1/cos moves case 3 by.

    1/cos(ye1 + xe2) of cases 1 and 2 becomes 1/cos(ye1) in case 3; of three numbers, one is `step` off: step/sqrt(3).
    """
    step = mean_lsb * (math.cos(math.radians(ye1_deg)) / math.cos(math.radians(ye1_deg + xe2_deg)) - 1)
    variance = sum(s * s for s in printed) / len(printed) - step**2 / 3
    if variance <= 0:
        raise ValueError(f"scale factor: the spread {printed} LSB is below the {step / math.sqrt(3):.3g} LSB of 1/cos")
    return math.sqrt(variance)


def _mean_of(group, value):
    """(sigma of the mean of three cases, digit that the text prints, reason)."""
    if group == "scale_factor":
        return scale_spread_lsb() / math.sqrt(3), 1.0, "spread between cases less 1/cos, over sqrt 3"
    if group == "v_q":
        return SPREAD_V / math.sqrt(3), 1e-4, "spread between cases over sqrt 3"
    if group == "bias":
        return SPREAD_DPS / math.sqrt(3), 1e-4, "spread between cases over sqrt 3"
    if group == "arw":
        return ARW_SHARE * value / math.sqrt(3), 1e-4, "bound of the deviations between cases, over sqrt 3"
    return FLOOR_SHARE * value / math.sqrt(3), 1e-4, "floor of a record of 1 h (assumed) at 100 s, over sqrt 3"


def _step_sigma(group, value_of_group):
    """Sigma of a relative change: two repeats of a case."""
    spread = {"scale_factor": scale_spread_lsb(), "v_q": SPREAD_V, "bias": SPREAD_DPS}[group]
    return math.sqrt(2) * spread / abs(value_of_group)


def _with_rounding(sigma, digit):
    return math.hypot(sigma, digit / math.sqrt(12))


def _temp(text):
    return 25.0 if text.startswith("room") else float(text)


def fitted():
    """Rows of the likelihood, phases first."""
    table = [n for n in numbers() if n["kind"].startswith("measured mean")]
    out = []
    for node in PHASES:
        value = max(float(n["value"]) for n in table if n["symbol"] == f"phi_{node}")
        sigma = _with_rounding(math.hypot(REPEATS_DEG[node], MODEL_DEG), 1e-4)
        why = "minimum of A_d, 1e-5 of it" if node == "xe2" else "what the paper left after compensation"
        out.append(Row(node, "phases", 25.0, value, sigma, "deg", why))
    for group, symbol in GROUPS.items():
        for n in table:
            if n["symbol"] == symbol and n["case"] == "mean of cases 1,2,3":
                value, temp = float(n["value"]), _temp(n["temperature_C"])
                sigma, digit, why = _mean_of(group, value)
                name = f"{group}_{temp:g}"
                out.append(Row(name, group, temp, value, _with_rounding(sigma, digit), UNITS[group], why))
    return tuple(out)


def steps():
    """Rows of the relative changes between cases, which no fit sees; absolute values, as the paper prints them."""
    means = {(row.group, row.temp_degc): row.value for row in fitted()}
    symbols = {symbol: group for group, symbol in GROUPS.items() if group in STEPPED}
    out = []
    for n in numbers():
        if n["quantity"].startswith("relative deviation rate of") and n["symbol"] in symbols:
            group, temp = symbols[n["symbol"]], _temp(n["temperature_C"])
            step = "3to4" if n["case"].startswith("case 3") else "4to5"
            sigma = _with_rounding(_step_sigma(group, means[group, temp]), 1e-4)
            why = "two repeats of a case"
            out.append(Row(f"{group}_{step}_{temp:g}", f"{group}_{step}", temp, float(n["value"]), sigma, "1", why))
    return tuple(out)


class Fold(NamedTuple):
    """Rows that one fit does not see."""

    name: str
    rule: str
    rows: tuple


def folds():
    """Folds of the committed list, in its order."""
    with HELD_OUT.open(newline="") as file:
        return tuple(Fold(n["fold"], n["rule"], tuple(n["rows"].split())) for n in csv.DictReader(file))
