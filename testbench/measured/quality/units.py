"""Numbers in another unit than their column says, where a range, physics or the file's own head can tell.

any          values outside the limits of their column
meters       readings 1000^k times their source; spread 300 times the noise or a 300th of it; kelvin for degC
ring-down    decay 30 times faster or slower than frequency and quality of the head say, or a quality above MOST_Q
spectrum     frequency of the head 1000^k times those of the rows; power that is positive and small, or spans 1000 times
sweep        angles that never leave -pi .. pi; decibels that are all magnitudes
rest         full scale of a 16-bit word beyond any gyroscope
"""

import numpy as np

from testbench.measured.quality.finding import REPORT, finding
from testbench.measured.quality.rows.series import neighbour_residual
from testbench.measured.quality.sheet import SETTING, SIGNAL, SLOW

FACTORS = {
    1e3: "1000",
    1e-3: "1/1000",
    1e6: "10^6",
    1e-6: "10^-6",
    1e9: "10^9",
    57.29578: "180/pi",
    1 / 57.29578: "pi/180",
}
LN_FACTOR_TOLERANCE = 0.25  # of ln: how near a ratio is to a factor
FAR_OFF = 30.0
MOST_Q = 1e11
DB = 10.0 / np.log(10.0)
FALL_DB = 25.0
LEAST = 1e-3  # of the largest power: positive decibels do not come so near to 0
FULL_SCALE_DEG_S = (1.0, 1e5)  # of 2^15 counts


def unit_factor_text(ratio):
    """Words of the factor that a ratio is near to, or ""."""
    if not (np.isfinite(ratio) and ratio > 0):
        return ""
    return next((words for f, words in FACTORS.items() if abs(np.log(ratio / f)) < LN_FACTOR_TOLERANCE), "")


def check_limits(sheet):
    """Findings about columns that leave their limits."""
    for c in sheet.columns:
        low, high = c.limits
        out = (c.values < low) | (c.values > high)
        if np.mean(out) > 0.02:
            worst = c.values[out][np.argmax(np.abs(c.values[out]))]
            words = f"{worst:.4g} is outside {low:g} .. {high:g} {c.unit}: wrong unit or wrong column"
            yield finding(sheet, "unit", c.name, out, words)


def _check_meter_units(sheet):
    (source,) = sheet.columns_by_role(SETTING)
    for c in sheet.columns_by_role(SIGNAL):
        slope = abs(np.polyfit(source.values, c.values, 1)[0])
        words = unit_factor_text(slope)
        if words:
            text = f"readings are {slope:.4g} times their source: a unit is wrong by a factor of {words}"
            yield finding(sheet, "unit", c.name, None, text)
            continue
        spread = sheet.column(f"spread of {c.name}")
        if spread is not None and np.median(spread.values) > 0:
            noise = np.quantile(np.abs(neighbour_residual(sheet.reorder_values(c.course))), 0.9) / 1.645
            ratio = np.median(spread.values) / max(noise, 1e-300)
            if not 1 / 300 < ratio < 300:
                text = f"spread is {ratio:.3g} times the noise of the readings: not in V"
                yield finding(sheet, "unit", spread.name, None, text)
    for c in sheet.columns_by_role(SLOW):
        if "temp" in c.name.lower() and 200 < np.median(c.values) < 420:
            yield finding(sheet, "unit", c.name, None, "temperature in kelvin: only its differences are used", REPORT)


def decay_rate(t, p):
    """Rate (1/s) of the power's decay: a straight line from its top (median of nine rows) down by FALL_DB."""
    smooth = np.array([np.median(p[max(k - 4, 0) : k + 5]) for k in range(len(p))])
    top = int(np.argmax(smooth))
    low = np.flatnonzero(smooth[top:] < smooth[top] - min(FALL_DB, 0.7 * np.ptp(smooth)))
    end = top + int(low[0]) if len(low) else len(p)
    return float(-np.polyfit(t[top:end], p[top:end], 1)[0] / DB) if end - top > 3 else np.nan


def _not_logarithm(sheet):
    p = sheet.column("power").values
    if np.all(p > 0) and (p.max() < 1.0 or p.min() < LEAST * p.max()):
        yield finding(
            sheet, "unit", "power", None, f"all positive, {p.min():.2g} .. {p.max():.2g}: a linear power, not dBm"
        )


def _check_ringdown_units(sheet):
    yield from _not_logarithm(sheet)
    f, q = sheet.stated.get("frequency_hz", np.nan), sheet.stated.get("quality", np.nan)
    rate = decay_rate(sheet.column("time").values, sheet.column("power").values)
    if not (f > 0 and rate > 0):
        return
    decay_quality = 2 * np.pi * f / rate
    if q > 0 and not 1 / FAR_OFF < decay_quality / q < FAR_OFF:
        words = f"the decay corresponds to a quality factor of {decay_quality:.3g}, the header says {q:.3g}"
        yield finding(sheet, "unit", "time", None, words + ": time or frequency in another unit")
    elif decay_quality > MOST_Q:
        words = f"the decay corresponds to a quality factor of {decay_quality:.3g}, above {MOST_Q:g}: "
        words += "time or frequency in another unit"
        yield finding(sheet, "unit", "time", None, words)


def _spectrum(sheet):
    yield from _not_logarithm(sheet)
    f, x = sheet.stated.get("frequency_hz", np.nan), sheet.column("frequency").values
    words = unit_factor_text(f / np.mean(x)) if f > 0 else ""
    if words:
        yield finding(sheet, "unit", "frequency", None, f"the header's frequency is {words} times that of the rows")


def _check_sweep_units(sheet):
    angle, size = sheet.column("s21 angle").values, sheet.column("s21").values
    if np.max(np.abs(angle)) < 3.15 < 100 * np.ptp(angle) and np.max(np.abs(angle)) > 1.5:
        yield finding(sheet, "unit", "s21 angle", None, "all within -pi .. pi: radians, but the header says degrees")
    if np.all(size > 0) and np.max(size) < 1.0 and np.min(size) < 0.5 * np.max(size):
        yield finding(sheet, "unit", "s21", None, "all between 0 and 1: magnitudes, but the header says decibels")


def _check_stationary_units(sheet):
    full = 2**15 * sheet.stated["lsb_deg_per_s"]
    low, high = FULL_SCALE_DEG_S
    if not low <= full <= high:
        words = f"LSB: 2^15 counts are {full:.3g} deg/s, outside {low:g} .. {high:g}"
        yield finding(sheet, "unit", "lsb", None, words)


RULES = {"meters": _check_meter_units, "ringdown": _check_ringdown_units, "spectrum": _spectrum}
RULES |= {"sweep": _check_sweep_units, "rest": _check_stationary_units}


def check(sheet):
    """Findings about a sheet."""
    findings = list(check_limits(sheet))
    if not findings and sheet.kind in RULES:
        findings += RULES[sheet.kind](sheet)
    return findings
