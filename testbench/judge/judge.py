"""The one judge of the paper's numbers: each beside the model's, with role, verdict and basis.

    rows(model)    for `gyro report paper`, `gyro measured trace`, `gyro run` and the generated table of docs/paper.md

A `Model` holds what somebody computed, however it was found; what it lacks is "not computed here".
At other temperatures than 25 degC a mean is judged by its value and by its difference from 25 degC; where the paper
prints a standard deviation between cases, also by that. A mean over cases has the uncertainty of the mean.
Source    docs/paper.md
"""

import itertools
import math
from types import MappingProxyType
from typing import Any, NamedTuple

from testbench.errors import FileError
from testbench.judge import numbers as printed
from testbench.judge.number_verdict import NOT_COMPUTED, Part, Value, verdict, worst
from testbench.judge.numbers import ROOM_DEGC, Number
from testbench.judge.roles import Rule, matching_rule

NAME_OF = {
    "SF": "scale_lsb_per_dps",
    "SF nonlinearity": "nonlinearity_ppm",
    "SF asymmetry": "asymmetry_ppm",
    "Vq": "quadrature_v",
    "bias": "bias_dps",
    "BI": "instability_deg_per_h",
    "ARW": "arw_deg_per_rt_h",
    "BW": "bandwidth_hz",
    "Ad": "drive_v",
}
CASES, TEMPERATURES = ("1", "2", "3"), (-20.0, ROOM_DEGC, 50.0)


EMPTY = MappingProxyType({})


class Model(NamedTuple):
    """What the model says, as `Value`s; empty where it was not computed.

    points      {(case, degC): {name: Value}}       node_deg, rise_deg, excursion_deg   {node: Value}
    settings    {quantity: numbers}                 loop_change                         {symbol: Value}
    """

    source: str
    node_deg: Any = EMPTY
    residual_deg: Any = EMPTY
    excursion_deg: Any = EMPTY
    rise_deg: Any = EMPTY
    points: Any = EMPTY
    loop_change: Any = EMPTY
    settings: Any = EMPTY


class Row(NamedTuple):
    """A number of the paper, its role, what it claims beside the model, and the verdict with its basis."""

    number: Number
    rule: Rule
    parts: tuple
    verdict: str
    basis: str

    @property
    def part(self):
        """The part that decides: of the largest pull, else the first; None if the number claims nothing."""
        return worst(self.parts) or next(iter(self.parts), None)


def _value(model, case, temp_degc, symbol):
    return model.points.get((case, temp_degc), {}).get(NAME_OF[symbol])


def _mean(model, symbol, temp_degc, cases=CASES):
    """(`Value` of the mean over cases, standard deviation between them), or (None, None)."""
    values = [_value(model, case, temp_degc, symbol) for case in cases]
    if None in values:
        return None, None
    mean = sum(v.value for v in values) / len(values)
    sd = math.sqrt(sum((v.value - mean) ** 2 for v in values) / (len(values) - 1))
    return Value(mean, math.hypot(*(v.sigma for v in values)) / len(values)), sd


def _less(a, b):
    return None if a is None or b is None else Value(a.value - b.value, math.hypot(a.sigma, b.sigma))


def relative_change(model, symbol, pair, temp_degc):
    """abs(after - before) / abs(before) of a quantity between two cases as a `Value`; None if one is not there."""
    before, after = (_value(model, case, temp_degc, symbol) for case in pair)
    if before is None or after is None or not before.value:
        return None
    scale = abs(before.value)
    return Value(abs(after.value - before.value) / scale, math.hypot(before.sigma, after.sigma) / scale)


def _mean_parts(number, model, rows):
    symbol, temp = number.symbol, number.temp_degc
    model_mean, sd = _mean(model, symbol, temp)
    parts = [Part("mean over cases", number.values[0], number.sigma, model_mean)]
    room = printed.case_mean_row(rows, symbol, ROOM_DEGC)
    if temp != ROOM_DEGC and room and room.sigma is not None:
        paper, sigma = number.values[0] - room.values[0], math.hypot(number.sigma, room.sigma)
        parts.append(Part("minus that at 25 degC", paper, sigma, _less(model_mean, _mean(model, symbol, ROOM_DEGC)[0])))
    between = printed.std(number)
    if between is not None:
        # the spread of n draws is known to 1 / sqrt(2 (n - 1)) of itself
        sigma = between / math.sqrt(2 * (printed.CASES - 1))
        model_case_sd = None if sd is None else Value(sd, model_mean.sigma)
        parts.append(Part("standard deviation between cases", between, sigma, model_case_sd, "<"))
    return parts


def _phase_parts(number, model, rows):
    node = number.symbol.removeprefix("phi_")
    return [Part(f"node phase of {node}", number.values[0], number.sigma, model.node_deg.get(node))]


def _residual_parts(number, model, rows):
    node = number.symbol.removeprefix("phi_")
    return [Part(f"{node} after compensation", number.values[0], number.sigma, model.residual_deg.get(node))]


def _bandwidth_parts(number, model, rows):
    cases = [c for c in "12345" if c in number.case]
    return [Part(f"case {c}", number.values[0], None, _value(model, c, ROOM_DEGC, "BW"), number.bound) for c in cases]


def _pair(number):
    case_digits = tuple(c for c in number.case if c.isdigit())
    if len(case_digits) != 2:
        raise FileError(f"{number.quantity}: case {number.case[:40]!r} does not name two cases")
    return case_digits


def _change_parts(number, model, rows):
    pair, temp = _pair(number), number.temp_degc
    return [Part("relative change", number.values[0], number.sigma, relative_change(model, number.symbol, pair, temp))]


def _excursion_parts(number, model, rows):
    nodes = [text.strip().removeprefix("phi_") for text in number.symbol.split(",")]
    return [Part(node, number.values[0], None, model.excursion_deg.get(node), number.bound) for node in nodes]


def _among_parts(number, model, rows):
    pairs = itertools.combinations([c for c in number.case if c.isdigit()], 2)
    return [
        Part(
            f"{s}, {'-'.join(pair)}, {t:g} degC",
            number.values[0],
            None,
            relative_change(model, s, pair, t),
            number.bound,
        )
        for pair in pairs
        for s in number.symbol.split(",")
        for t in TEMPERATURES
    ]


def _ratio_parts(number, model, rows):
    """More than `limit` times as large: what the change 3 to 4 exceeds that by is above 0."""
    limit, parts = number.values[0], []
    for symbol in number.symbol.split(","):
        for temp in TEMPERATURES:
            large, small = (relative_change(model, symbol, pair, temp) for pair in (("3", "4"), ("4", "5")))
            more = small and Value(limit * small.value, limit * small.sigma)
            parts.append(Part(f"{symbol}, {temp:g} degC, change 3-4 minus {limit:g} times 4-5", 0.0, None,
                              _less(large, more), number.bound))  # fmt: skip
    return parts


def _loop_parts(number, model, rows):
    name = "bandwidth" if number.symbol == "dBW" else "phase"
    return [Part(f"{name}, linear loop", number.values[0], None, model.loop_change.get(name), number.bound)]


def _rise_parts(number, model, rows):
    return [Part(f"{node}, 50 minus -20 degC", 0.0, None, model.rise_deg.get(node), number.bound)
            for node in ("xe1", "xe2", "ye1", "ye2")]  # fmt: skip


def _fall_parts(number, model, rows):
    parts = []
    for pair in (("1", "2"), ("2", "3")):
        before, after = (_value(model, case, ROOM_DEGC, "Ad") for case in pair)
        parts.append(Part(f"A_d (V), case {pair[1]} minus {pair[0]}", 0.0, None, _less(after, before), number.bound))
    return parts


def _setting_parts(number, model, rows):
    have, bound = model.settings.get(number.quantity), number.bound
    have = have or model.settings.get(f"{number.quantity}, {number.symbol}")
    values = have if have and len(have) == len(number.values) else (None,) * len(number.values)
    sigma = 0.0 if len(values) > 1 else number.sigma
    return [
        Part("setting", paper, sigma, None if v is None else Value(v), bound) for paper, v in zip(number.values, values)
    ]


def _no_parts(number, model, rows):
    return []


CLAIMS = {
    "phase": _phase_parts,
    "residual": _residual_parts,
    "mean": _mean_parts,
    "bandwidth": _bandwidth_parts,
    "change": _change_parts,
    "excursion": _excursion_parts,
    "among": _among_parts,
    "ratio": _ratio_parts,
    "loop change": _loop_parts,
    "rise": _rise_parts,
    "fall": _fall_parts,
    "setting": _setting_parts,
    "absent": _no_parts,
}


PLAIN = ("phase", "residual", "mean", "change")  # claims of a number with an uncertainty, not of a bound


def judge_number(number, model, rows):
    """`Row` of one number; `rows` are all of them."""
    rule = matching_rule(number)
    if rule.claim in PLAIN and number.sigma is None:
        raise FileError(f"{number.quantity}: {number.text[:40]!r} is not a number")
    parts = tuple(CLAIMS[rule.claim](number, model, rows)) if number.values else ()
    absent = rule.reading if rule.role == "none" else NOT_COMPUTED
    return Row(number, rule, parts, *verdict(rule.role, parts, absent))


def rows(model, path=None):
    """[Row, ...] of all numbers, those of a file in place of the paper's if `path` is given."""
    printed_numbers = printed.numbers(path)
    return [judge_number(n, model, printed_numbers) for n in printed_numbers]


def phase_rows(node_deg, path=None):
    """{node: Row} of the four uncompensated phases, from {node: Value} of node phases (deg)."""
    phase_claim_rows = [r for r in rows(Model("", node_deg=node_deg), path) if r.rule.claim == "phase"]
    return {r.number.symbol.removeprefix("phi_"): r for r in phase_claim_rows}
