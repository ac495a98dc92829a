"""Tables of what the laws over temperature give beside the paper, in closed form: noise, scale, bias, phases.

    shares_part   C/V noise of the default and of the parts' data sheets, by source
    noise_part    ARW at three temperatures by one source at a time, and by the best sum of them
    scale_part    scale factor with the diodes' drift, without it, and with a carrier that makes up for it
    bias_part     bias from damping, charge and leakage, with the sign at 50 degC as printed and with the other
    rise_part     phases over temperature, and the least coefficients that let all four rise

What is fitted is fitted to the very rows of the table: it shows what a law can do, and confirms nothing.
Source  docs/plant.md, docs/phases.md
"""

import functools
import math

import numpy as np
from scipy import stats
from scipy.optimize import brentq, nnls

from analog_frontend.parts import thermal
from testbench.config import Config, changed
from testbench.console.markdown import markdown
from testbench.console.text_table import Table
from testbench.judge import numbers
from testbench.paper.calibration import calibration_boards
from testbench.paper.loop import derived, temperature_tables
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters
from testbench.run.budget import NODES, budget

TEMPS = temperature_tables.TEMPS_DEGC
NO_REST = {"plant.cv_noise_v_per_rthz": 0.0}
LEVEL = 18.2e-9
VOLTAGE = NO_REST | {"plant.ina_voltage_noise_v_per_rthz": LEVEL / math.sqrt(2)}
CURRENT = NO_REST | {"plant.ina_current_noise_a_per_rthz": 1.9e-12}
CONSTANT_IC = {"plant.ina_bias_exponent": 0.0}
DATA_SHEET = CURRENT | {
    "plant.ring_noise_on": 1,
    "plant.cv_resistor_ohm": 200.0,
    "plant.ina_voltage_noise_v_per_rthz": 1.07e-9,
}
LAWS = (
    ("one density (default)", {}),
    ("resistors", NO_REST | {"plant.cv_resistor_ohm": 20e3}),
    ("amplifier voltage, collector current PTAT", VOLTAGE),
    ("amplifier voltage, collector current constant", VOLTAGE | CONSTANT_IC),
    ("amplifier current, collector current PTAT", CURRENT),
    ("amplifier current, collector current constant", CURRENT | CONSTANT_IC),
    ("ring", NO_REST | {"plant.ring_noise_on": 1}),
    ("data sheets: ring, 200 ohm, 1.07 nV, 1.9 pA", DATA_SHEET),
)
LIMIT_95 = float(stats.chi2.ppf(0.95, 2))
SUMS = (("one density", 0), ("resistors", 1), ("amplifier current", 4), ("ring", 6))


@functools.cache
def paper(symbol):
    """(values, standard uncertainties) of a mean over cases 1 to 3 at the three temperatures."""
    rows = numbers.numbers()
    found = [numbers.case_mean_row(rows, symbol, temp) for temp in TEMPS]
    return np.array([n.values[0] for n in found]), np.array([n.sigma for n in found])


@functools.cache
def _derived(items):
    config = changed(Config(), dict(items))
    return [derived.derive(config, temp) for temp in TEMPS]


def at(values):
    """`derived.Derived` at the three temperatures of the default board with these keys changed."""
    return _derived(tuple(sorted(values.items())))


def chi2(found, symbol):
    """Sum of squares of what differs from the paper, in its standard uncertainties."""
    value, sigma = paper(symbol)
    return float(np.sum(((np.asarray(found) - value) / sigma) ** 2))


def cells(values, digits):
    return [f"{v:.{digits}f}" for v in values]


# ---- noise -----------------------------------------------------------------------------------------------------------


def shares_part():
    """The table of `gyro loop` for the default, and for the parts' data sheets."""
    out = []
    for text, values in (("Default", {}), ("Data sheets", DATA_SHEET)):
        out += [f"{text}:", markdown(temperature_tables.shares(changed(Config(), values)))]
    return "\n\n".join(out)


def arw(values):
    return np.array([d.arw_deg_per_rt_h for d in at(values)])


def summed(columns):
    """(powers of the columns, ARW) of the sum of sources that meets the paper best, none below zero."""
    value, sigma = paper("ARW")
    quiet = arw(NO_REST) ** 2
    made = np.array([arw(LAWS[k][1]) ** 2 - quiet for k in columns]).T
    weight = 1 / (2 * value * sigma)
    power, _ = nnls(made * weight[:, None], (value**2 - quiet) * weight)
    return power, np.sqrt(quiet + made @ power)


def noise_part():
    """One source at a time with its level fitted, then the best sum."""
    value, sigma = paper("ARW")

    def row(text, found, loose):
        ratios = found[1] / found[0], found[2] / found[1], found[2] / found[0]
        return text, *cells(found, 4), *cells(ratios, 3), loose

    rows = [row("the paper", value, "")]
    for k, (text, values) in enumerate(LAWS):
        _, best = summed([k])
        rows.append((*row(text, arw(values), f"{chi2(best, 'ARW'):.1f}"),))
    power, best = summed([k for _, k in SUMS])
    at_room = [p * power_at_room(LAWS[k][1]) for p, (_, k) in zip(power, SUMS)]
    named = ", ".join(f"{text} {100 * share / sum(at_room):.0f} %" for (text, _), share in zip(SUMS, at_room) if share)
    rows.append(row(f"best sum; power at 25 degC: {named}", best, f"{chi2(best, 'ARW'):.1f}"))
    heads = ("source", *(f"{t:g} degC" for t in TEMPS), "25 over -20", "50 over 25", "end to end", "chi2, level fitted")
    flicker = paper("BI")[0]
    note = (
        f"ARW in deg/sqrt(h). The paper's standard uncertainty is {100 * sigma[1] / value[1]:.1f} % "
        "(`testbench/judge/numbers.py`); chi2 has two degrees of freedom where one level is fitted. "
        "Converter, DAC and damping are in every row.\n\n"
        f"With everything else of the data sheets, chi2 stays below {LIMIT_95:.2f} (95 %) up to a current noise of "
        f"{1e12 * most_current():.2f} pA/rtHz. "
        f"The paper's bias instability has the ratios {flicker[1] / flicker[0]:.3f}, {flicker[2] / flicker[1]:.3f} and "
        f"{flicker[2] / flicker[0]:.3f}; over ARW it is constant within {100 * spread(flicker / value):.1f} %."
    )
    return f"{markdown(Table('', heads, rows, numeric=tuple(range(1, 8))))}\n\n{note}"


def spread(values):
    """Largest over smallest, less 1."""
    return float(np.max(values) / np.min(values) - 1)


@functools.cache
def most_current():
    """A/rtHz of an amplifier beside ring, resistors and voltage noise at which the shape is beyond 95 %."""
    value, sigma = paper("ARW")
    quiet = arw(NO_REST) ** 2
    own = arw(CURRENT) ** 2 - quiet
    others = arw(DATA_SHEET) ** 2 - quiet - own

    def excess(current):
        made = others + own * (current / DATA_SHEET["plant.ina_current_noise_a_per_rthz"]) ** 2
        weight = 1 / (2 * value * sigma)
        power = nnls((made * weight)[:, None], (value**2 - quiet) * weight)[0][0]
        return chi2(np.sqrt(quiet + power * made), "ARW") - LIMIT_95

    return brentq(excess, 0.0, 1.9e-12, xtol=1e-14)


def power_at_room(values):
    """Power of a source in ARW^2 at 25 degC, beside all others."""
    return float(arw(values)[1] ** 2 - arw(NO_REST)[1] ** 2)


# ---- scale factor and bias -------------------------------------------------------------------------------------------


def scaled(values):
    """(factor, scale factors) with the level fitted: k_vf over factor does it."""
    value, sigma = paper("SF")
    found = np.array([d.lsb_per_dps for d in at(values)])
    factor = float(np.sum(value * found / sigma**2) / np.sum((found / sigma) ** 2))
    return factor, factor * found


def best_carrier_tc():
    """carrier_tc_per_k (1/K) of the least chi2: on a line through two of them, the law being nearly linear."""
    value, sigma = paper("SF")
    low, high = -5e-4, -3e-4
    a, b = ((scaled({"plant.carrier_tc_per_k": tc})[1] - value) / sigma for tc in (low, high))
    part = float(a @ (a - b) / ((a - b) @ (a - b)))
    return round(low + part * (high - low), 6)


def scale_part():
    """Three ways to have the diodes' drift."""
    value, _ = paper("SF")
    tc = best_carrier_tc()
    rows = [("the paper", *cells(value, 0), "", "", "")]
    for text, values in (
        ("diodes drift (default)", {}),
        ("diodes at 25 degC (`diode_tc_on = 0`)", {"plant.diode_tc_on": 0}),
        (f"`carrier_tc_per_k = {tc:.3g}`", {"plant.carrier_tc_per_k": tc}),
    ):
        factor, found = scaled(values)
        own = np.array([d.lsb_per_dps for d in at(values)])
        pulls = (found - value) / paper("SF")[1]
        rows.append((text, *cells(own, 1), f"{1 / factor:.4f}", " ".join(f"{p:+.1f}" for p in pulls),
                     f"{float(pulls @ pulls):.1f}"))  # fmt: skip
    heads = ("board", *(f"{t:g} degC" for t in TEMPS), "k_vf times", "then off by sigma", "chi2")
    return markdown(Table("", heads, rows, numeric=(1, 2, 3, 4, 6)))


@functools.cache
def bias_columns():
    """{source: bias (deg/s) at the three temperatures} of 1 % of damping, 0.1 pC, 0.1 nA."""
    none = {"plant.dxy_ratio": 0.0, "plant.sid_charge_c": 0.0}
    sources = {
        "damping": ({"plant.dxy_ratio": 0.01}, "dxy_ratio", 0.01, ""),
        "charge": ({"plant.sid_charge_c": 1e-12}, "charge", 0.1, " pC"),
        "leakage": ({"plant.sid_leakage_a": 1e-10}, "leakage", 0.1, " nA"),
    }
    out = {}
    for name, (values, text, unit, suffix) in sources.items():
        config = changed(Config(), none | values)
        found = []
        for temp in TEMPS:
            p = loop_parameters(config, temp)
            found.append(sum(derived.bias_parts_dps(p, lp.close(p)).values()))
        out[name] = np.array(found), text, unit, suffix
    return out


def bias_fit(names, sign):
    """(texts, bias, chi2) of the sources that meet the paper best; `sign` of the bias at 50 degC."""
    value, sigma = paper("bias")
    value = value * np.array([1.0, 1.0, sign])
    known = bias_columns()
    made = np.array([known[n][0] for n in names]).T
    size, *_ = np.linalg.lstsq(made / sigma[:, None], value / sigma, rcond=None)
    texts = [f"{known[n][1]} {s * known[n][2]:+.3f}{known[n][3]}" for n, s in zip(names, size)]
    pulls = (made @ size - value) / sigma
    return ", ".join(texts), made @ size, float(pulls @ pulls)


def bias_part():
    """The default, then two sources fitted, for both signs of the third bias."""
    value, _ = paper("bias")
    rows = [("the paper", *cells(value, 4), ""), ("default", *cells([d.bias_dps for d in at({})], 4), "")]
    for sign, which in ((1.0, "as printed"), (-1.0, "minus at 50 degC")):
        for names in (("damping", "charge"), ("charge", "leakage"), ("damping", "leakage")):
            texts, found, left = bias_fit(names, sign)
            rows.append((f"{which}: {texts}", *cells(found, 4), f"{left:.1f}"))
    heads = ("bias in deg/s", *(f"{t:g} degC" for t in TEMPS), "chi2, one degree of freedom")
    known, room = bias_columns(), TEMPS.index(25.0)
    per = ", ".join(f"{text} {unit:g}{suffix}: {found[room]:.3f}" for found, text, unit, suffix in known.values())
    charge, mismatch = (calibration_boards.SPREAD[f"sid_charge_{name}"] for name in ("c", "mismatch"))
    square = math.prod((a * a + a * b + b * b) / 3 for a, b in (charge, mismatch))
    found, _, unit_pc, _ = known["charge"]
    return (
        f"{markdown(Table('', heads, rows, numeric=(1, 2, 3, 4)))}\n\n"
        f"At 25 degC in deg/s, {per}. "
        "Charge and mismatch as `gyro calibrate --boards` draws them give a bias of mean 0 and "
        f"standard deviation {math.sqrt(square) * 1e12 / unit_pc * found[room]:.2f} deg/s."
    )


# ---- phases ----------------------------------------------------------------------------------------------------------


@functools.cache
def _phases(items):
    config = changed(Config(), dict(items))
    budgets = [budget(config, temp, thermal.device_at_temperature(config.device(), temp).fx_hz) for temp in TEMPS]
    return {node: [b.node_deg()[node] for b in budgets] for node in NODES}


def rises(values, node):
    """(from -20 to 25, from 25 to 50 degC) in deg."""
    deg = _phases(tuple(sorted(values.items())))[node]
    return deg[1] - deg[0], deg[2] - deg[1]


def least(node, key, reach, others=None):
    """The value of a key next to 0 from which on a phase rises over both spans."""
    return brentq(lambda v: min(rises({key: v} | (others or {}), node)), *sorted((0.0, reach)), xtol=1e-9)


def rise_part():
    """How the phases move, and what lets all four rise."""
    amplifiers = {"plant.dac_amplifier_tc_on": 1}
    boards = (
        ("default", {}),
        ("`dac_rc_tc_per_k = 1e-4`", {"plant.dac_rc_tc_per_k": 1e-4}),
        ("`dac_rc_tc_per_k = 3e-4`", {"plant.dac_rc_tc_per_k": 3e-4}),
        ("`dac_amplifier_tc_on = 1`", amplifiers),
    )
    rows = [
        (text, *(f"{1e3 * low:+.1f}, {1e3 * high:+.1f}" for low, high in (rises(values, n) for n in NODES)))
        for text, values in boards
    ]
    heads = ("board", *(f"{n} mdeg" for n in NODES))
    rc = {n: least(n, "plant.dac_rc_tc_per_k", 4e-3) for n in ("xe1", "ye1")}
    gbw = {n: least(n, "plant.opamp_gbw_tc_per_k", -4e-3, amplifiers) for n in NODES}
    return (
        f"{markdown(Table('', heads, rows, numeric=()))}\n\n"
        f"Each cell: from -20 to 25, from 25 to 50 degC. Least `dac_rc_tc_per_k` alone that lets a phase rise: xe1 "
        f"{rc['xe1']:.2e}, ye1 {rc['ye1']:.2e} /K. Least fall of the gain-bandwidth product with "
        "`dac_amplifier_tc_on = 1`: " + ", ".join(f"{n} {-gbw[n]:.2e}" for n in NODES) + " /K."
    )
