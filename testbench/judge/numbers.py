"""The numbers that the paper prints, each with a standard uncertainty by one rule for all.

    rounding         half a step of the last printed digit as a rectangle: step / sqrt(12)
    max fluctuation  a bound a on the readings as a rectangle: a / sqrt(3); std of one record as it is
    phase            what was left of it once it was compensated by its own reading: how well readings repeat
    std, n cases     s / sqrt(n), the spread that the law of the scale factor explains taken out of s before
    < a, n cases     relative deviations below a, uniform: range a / sqrt(3), over the mean range of n draws
    change           sqrt(2) times the repeatability of one case, over the mean
    xe2              besides, its method: the text finds it by the least A_d, which goes as 1/cos about its minimum.
                     A_d resolved to r (assumed) leaves acos(1 - r) of angle
    Allan floor      no spread is printed: 1/sqrt(2 (T/tau - 1)) of a case, T/tau averages in a record of T (assumed)

Each is taken together with the rounding. A bound has no uncertainty.
Source    JCGM 100:2008 (GUM), 4.3; docs/paper.md; testbench/judge/measured_numbers.csv, statements.csv
"""

import csv
import math
import re
from pathlib import Path
from typing import NamedTuple

from testbench.errors import FileError
from testbench.storage.inputs import read_lines

FOLDER = Path(__file__).parent
PATHS = FOLDER / "measured_numbers.csv", FOLDER / "statements.csv"
HEAD = "quantity,symbol,case,temperature_C,value"
COLUMNS = (*HEAD.split(","), "std_or_max_fluctuation", "unit", "kind", "source_sentence_location")
ROOM_DEGC, MOST, CASES = 25.0, 1e9, 3
MEAN = "mean of cases 1,2,3"
RANGE_OF_THREE = 3 / math.sqrt(math.pi)  # mean range of three normal draws, in standard deviations
COMPENSATED = " compensated)"
LEAST_DRIVE, RESOLVED = "phi_xe2", 1e-5  # found by the least A_d; relative change of A_d that is seen, assumed
FLOOR, RECORD_S, FLOOR_S = "BI", 3600.0, 100.0  # assumed: record and averaging time of an Allan floor
DIGITS = r"[-+]?\d*\.?\d+(?:e[-+]?\d+)?"


class Number(NamedTuple):
    """One printed number; `values` are the numbers in its text, `bound` says that it is one, `sigma` is standard."""

    quantity: str
    symbol: str
    case: str
    temperature: str
    text: str
    spread: str
    unit: str
    kind: str
    place: str
    values: tuple
    bound: str
    sigma: float | None

    @property
    def temp_degc(self):
        """Temperature (degC), 25 for the room's; None where the row is of no single one."""
        if self.temperature.startswith("room"):
            return ROOM_DEGC
        return float(self.temperature) if re.fullmatch(DIGITS, self.temperature) else None

    @property
    def key(self):
        """What no other number has: quantity, case and temperature."""
        return self.quantity, self.case, self.temperature


BOUNDS = (("<", "<"), ("within", "<"), ("falls", "<"), (">", ">"), ("increased by more than", ">"), ("rise", ">"))


def _parse_number_row(row):
    """`Number` of a row of the list, without its uncertainty."""
    text = row["value"]
    bound = next((sign for word, sign in BOUNDS if text.startswith(word)), "")
    values = tuple(float(v) for v in re.findall(DIGITS, text.replace("+-", "")))
    if bound and not values:
        values = (0.0,)
    return Number(*(row[name] for name in COLUMNS), values, bound, None)


def step(text):
    """Step of the last printed digit of a number: 0.0001 of "3.7647"."""
    return 10.0 ** -len(text.partition(".")[2])


def std(number):
    """Standard deviation that a row prints, or None."""
    std_match = re.search(rf"std ({DIGITS})", number.spread)
    return float(std_match.group(1)) if std_match else None


def case_mean_row(rows, symbol, temp_degc):
    """The row of a quantity's mean over cases 1 to 3 at a temperature, or None."""
    mean_rows = [n for n in rows if n.symbol == symbol and n.case == MEAN and n.temp_degc == temp_degc]
    return mean_rows[0] if len(mean_rows) == 1 and mean_rows[0].values else None


def _phase_rad(rows, symbol, case):
    phase_rows = [n for n in rows if n.symbol == symbol and n.case.startswith(case) and n.values]
    return math.radians(phase_rows[0].values[0]) if phase_rows else 0.0


def explained_sd(rows, symbol):
    """Relative standard deviation between cases 1, 2, 3 that 1/cos(ye1 + xe2) of the paper's own phases makes."""
    if symbol != "SF":
        return 0.0
    ye1, xe2 = _phase_rad(rows, "phi_ye1", "case 3"), _phase_rad(rows, "phi_xe2", "case 3")
    # two cases with xe2, one without it: their standard deviation is the step over sqrt(3)
    return abs(math.cos(ye1) / math.cos(ye1 + xe2) - 1) / math.sqrt(3)


def method_deg(symbol):
    """Standard uncertainty (deg) of how the text finds a phase: where A_d, as 1/cos, is RESOLVED above its least."""
    return math.degrees(math.acos(1 - RESOLVED)) if symbol == LEAST_DRIVE else 0.0


def relative_repeatability(rows, symbol, temp_degc):
    """Relative standard deviation of one case: what is not explained, of a floor its method's; None if neither."""
    mean = case_mean_row(rows, symbol, temp_degc)
    if mean is None or not mean.values[0]:
        return None
    if symbol == FLOOR and std(mean) is None:
        return 1 / math.sqrt(2 * (RECORD_S / FLOOR_S - 1))
    if std(mean) is not None:
        unexplained_variance = (std(mean) / abs(mean.values[0])) ** 2 - explained_sd(rows, symbol) ** 2
        return math.sqrt(max(unexplained_variance, 0.0))
    among = [n for n in rows if n.quantity.startswith("relative deviations of") and symbol in n.symbol.split(",")]
    return among[0].values[0] / math.sqrt(3) / RANGE_OF_THREE if among and among[0].values else None


def _standard_uncertainty(number, rows):
    """Standard uncertainty of a printed number by the rules above; None for a bound or where there is no number."""
    if number.bound or len(number.values) != 1 or not re.fullmatch(DIGITS, number.text):
        return None
    rounding, value = step(number.text) / math.sqrt(12), number.values[0]
    if number.case == MEAN:
        share = relative_repeatability(rows, number.symbol, number.temp_degc)
        return math.hypot(rounding, (share or 0.0) * abs(value) / math.sqrt(CASES))
    if number.quantity.startswith("relative deviation rate"):
        share = relative_repeatability(rows, number.symbol, number.temp_degc)
        return math.hypot(rounding, math.sqrt(2) * (share or 0.0))
    fluctuation = re.search(rf"fluctuation < ({DIGITS})", number.spread)
    printed_sigma = std(number) or (float(fluctuation.group(1)) / math.sqrt(3) if fluctuation else 0.0)
    residuals_deg = [n.values[0] for n in rows if n.symbol == number.symbol and n.values and COMPENSATED in n.case]
    residual_phase_deg = residuals_deg[0] if residuals_deg and number.symbol.startswith("phi_") else 0.0
    return math.hypot(rounding, printed_sigma, residual_phase_deg, method_deg(number.symbol))


def table(path=PATHS[0]):
    """Rows of a list in CSV as dicts, all columns as texts; FileError names path and line."""
    lines = [line for _, line in read_lines(path)]
    if not lines or not lines[0].startswith(HEAD):
        raise FileError(f"{path}: line 1: expected a line that begins with {HEAD}")
    rows = csv.DictReader(lines)
    try:
        # a row that ends early has empty cells
        return [{name: row.get(name) or "" for name in COLUMNS} for row in rows]
    except csv.Error as problem:
        raise FileError(f"{path}: line {rows.line_num}: {problem}") from None


def read(path):
    """[Number, ...] of a list in CSV; FileError names the path and what is wrong."""
    rows = [_parse_number_row(row) for row in table(path)]
    for n in rows:
        if not all(math.isfinite(v) and abs(v) < MOST for v in n.values):
            raise FileError(f"{path}: {n.symbol}: {n.text[:40]!r} is not a number below {MOST:g}")
        if n.kind.startswith("measured") and not n.bound and not re.fullmatch(DIGITS, n.text):
            raise FileError(f"{path}: {n.symbol}: {n.text[:40]!r} is not a number")
    return [n._replace(sigma=_standard_uncertainty(n, rows)) for n in rows]


def numbers(path=None):
    """The printed numbers, those of a file in their place if one is given, and the statements of the text."""
    printed, statements = (read(p) for p in (path or PATHS[0], PATHS[1]))
    return [*printed, *statements]
