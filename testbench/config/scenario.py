"""Scenario: what happens during a run, as profiles and a sorted list of events.

    rate_rad_s, temp_degc   `frame_values(k)` in force during frame k (125 us): the value at the middle of the frame
    events                  register writes and faults, each at a 1 us tick, sorted

A profile is a number or points [t_s, value]: joined by straight lines, where two points at one time are a jump, or held
until the next point (`steps`). Before its first point and after its last one a profile keeps their values.
Time counts ticks of the 26 MHz clock from the scenario's origin, lock or power-on.
Source  docs/configuration.md
"""

import difflib
import math
import textwrap
from typing import NamedTuple

import numpy as np

from fpga_model.design_record import DEFAULT
from testbench.config.toml_text import short_toml

DEG = math.pi / 180

ADC_CHANNELS = ("drive_sin", "drive_cos", "sense_sin", "sense_cos", "temperature")
SAMPLES = ("x", "y")
CODE_LO, CODE_HI = -(1 << 23), (1 << 23) - 1
DAC_CODES = {
    "drive": (-(1 << 15), (1 << 15) - 1),
    "sense": (-(1 << 19), (1 << 19) - 1),
    "quadrature": (0, (1 << 16) - 1),
}


class Problem(ValueError):
    """What is wrong (`text`), and where inside the value (`where`, such as "[2]")."""

    def __init__(self, where, text):
        super().__init__(f"{where} {text}".strip())
        self.where = where
        self.text = text


class FaultKind(NamedTuple):
    """A fault that can be injected: its channels, the limits and unit of its value, and what it does."""

    channels: tuple
    lo: int
    hi: int
    unit: str
    doc: str


FAULTS = {
    "adc_stuck": FaultKind(ADC_CHANNELS, CODE_LO, CODE_HI, "code", "the channel repeats this code"),
    "adc_frozen": FaultKind(ADC_CHANNELS, 0, 0, "", "the channel repeats the code of the frame before"),
    "adc_over_range": FaultKind(ADC_CHANNELS, -1, 1, "sign", "the channel sits at its negative or positive rail"),
    "adc_offset": FaultKind(ADC_CHANNELS, CODE_LO, CODE_HI, "code", "the value is added to the channel's code"),
    "adc_gain": FaultKind(ADC_CHANNELS, -0xFFFF, 0xFFFF, "/ 65536", "the channel's code is multiplied by this value"),
    "adc_swapped": FaultKind(
        ADC_CHANNELS, 0, len(ADC_CHANNELS) - 1, "", "the channel gives the code of the channel with this number"
    ),
    "adc_lost_bit": FaultKind(
        ("adc",), 25, 143, "bit", "this bit is lost, later bits come one early; for words of n bits: n + 1 .. 6 n - 1"
    ),
    "adc_silent": FaultKind(("adc",), 0, 0, "", "DRDY_N never falls"),
    "adc_bad_status": FaultKind(("adc",), 0, (1 << 24) - 1, "word", "every frame starts with this status word"),
    "dac_stuck": FaultKind(tuple(DAC_CODES), -(1 << 19), (1 << 19) - 1, "code", "the output repeats this code"),
    "sample_stuck": FaultKind(SAMPLES, -(1 << 17), (1 << 17) - 1, "code", "the C/V sample repeats this code"),
    "sample_frozen": FaultKind(SAMPLES, 0, 0, "", "the C/V sample repeats the sample of the tick before"),
    "plant_nan": FaultKind(("x", "y"), 0, 0, "", "the displacement is not a number"),
}

WRITE, FAULT_ON, FAULT_OFF = "write", "fault_on", "fault_off"


class Event(NamedTuple):
    """Something that happens at a tick: a register write, or a fault that begins or ends."""

    tick: int
    action: str
    name: str
    channel: str
    value: int


class Profile(NamedTuple):
    """Values of a profile frame by frame, computed where they are needed: an hour has 28.8 million frames."""

    points: tuple  # ((t_s, value), ...)
    steps: bool
    factor: float  # to the unit wanted
    frames: int
    frame_s: float

    def frame_values(self, first, count=1):
        """Values of frames first .. first + count - 1; before and after the profile its first and last one."""
        if len(self.points) == 1:
            return np.full(count, self.points[0][1] * self.factor)
        frame = np.clip(np.arange(first, first + count), 0, self.frames - 1)
        return sample(self.points, (frame + 0.5) * self.frame_s, self.steps) * self.factor

    def limits(self):
        """(least, greatest) value of all frames: between its points a profile is monotone."""
        candidate_frames = {0, self.frames - 1}
        for t_s, _ in self.points:
            frame = min(int(t_s / self.frame_s), self.frames)
            candidate_frames |= {k for k in range(frame - 2, frame + 3) if 0 <= k < self.frames}
        values = [float(self.frame_values(k)[0]) for k in candidate_frames]
        return min(values), max(values)


class Timeline(NamedTuple):
    """A scenario ready to run, `ticks` long."""

    ticks: int
    frames: int
    rate_rad_s: Profile
    temp_degc: Profile
    rate_before_rad_s: float
    temp_before_degc: float
    events: tuple


# ---- checks; they raise Problem and return what they understood ------------------------------------------------------


def _check_finite_number(value, where, what):
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise Problem(where, f"= {short_toml(value)}: {what} is not a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise Problem(where, f"= {short_toml(value)}: {what} is not finite")
    return number


def _check_item(item, where, length, shape):
    if not isinstance(item, (list, tuple)) or len(item) != length:
        raise Problem(where, f"= {short_toml(item)} is not of the form {shape}")
    return item


def profile_points(value, lo, hi, unit):
    """Points ((t_s, value), ...) of a profile: a number or [[t_s, value], ...] with values within lo..hi."""
    if isinstance(value, (list, tuple)):
        if not value:
            raise Problem("", "= [] has no points")
        rows = [(f"[{k}]", *_check_item(item, f"[{k}]", 2, f"[t_s, {unit}]")) for k, item in enumerate(value)]
    else:
        rows = [("", 0.0, value)]
    points = []
    for where, t_s, level in rows:
        t_s = _check_finite_number(t_s, where, "the time")
        level = _check_finite_number(level, where, "the value")
        if level > hi:
            raise Problem(where, f"= {level:g} is above the limit {hi:g} {unit}")
        if level < lo:
            raise Problem(where, f"= {level:g} is below the limit {lo:g} {unit}")
        if t_s < 0:
            raise Problem(where, f"is at {t_s:g} s; times start at 0 s")
        if points and t_s < points[-1][0]:
            raise Problem(where, f"is at {t_s:g} s, before its predecessor at {points[-1][0]:g} s")
        if len(points) > 1 and t_s == points[-2][0]:
            raise Problem(where, f"is the third point at {t_s:g} s; a jump has two points")
        points.append((t_s, level))
    return tuple(points)


def nearest(name, allowed_names):
    """Hint on a name that is not among the known ones."""
    close_matches = difflib.get_close_matches(str(name), allowed_names, n=1, cutoff=0.5)
    return (
        f"did you mean {close_matches[0]}?"
        if close_matches
        else f"known: {textwrap.shorten(', '.join(allowed_names), 280, placeholder=' ...')}"
    )


def writable_registers():
    """Name -> number format of every register that a scenario may write."""
    from fpga_model import registers

    return {entry.name: entry.fmt for entry in registers.WRITABLE}


def check_register_writes(value):
    """((t_s, name, raw), ...) of [[t_s, register, raw value], ...]."""
    if not isinstance(value, (list, tuple)):
        raise Problem("", f"= {short_toml(value)} is not a list of [t_s, register, raw value]")
    register_formats = writable_registers() if value else {}
    writes = []
    for k, item in enumerate(value):
        where = f"[{k}]"
        t_s, name, raw = _check_item(item, where, 3, "[t_s, register, raw value]")
        t_s = _check_finite_number(t_s, where, "the time")
        if not isinstance(name, str) or name not in register_formats:
            raise Problem(where, f"= {short_toml(name)} is not a writable register; {nearest(name, register_formats)}")
        if isinstance(raw, bool) or not isinstance(raw, int):
            raise Problem(
                where, f"= {short_toml(raw)}: the value of {name} is not an integer; registers take raw words"
            )
        fmt = register_formats[name]
        if not fmt.holds(raw):
            side, limit = ("above", fmt.hi) if raw > fmt.hi else ("below", fmt.lo)
            raise Problem(where, f"= {raw}: the value of {name} is {side} the limit {limit} of its format {fmt}")
        writes.append((t_s, name, raw))
    return tuple(writes)


def check_laws(value):
    """`law.Law`s of a list of texts."""
    from analog_frontend.effects import law

    if not isinstance(value, (list, tuple)) or not all(isinstance(text, str) for text in value):
        raise Problem("", f'= {short_toml(value)} is not a list of texts such as "force_x = -2.5e9 x^3"')
    if len(value) > law.SLOTS:
        raise Problem("", f"has {len(value)} laws, above the limit {law.SLOTS}")
    try:
        return tuple(law.parse(text) for text in value)
    except ValueError as problem:
        raise Problem("", f": {problem}") from None


def check_faults(value):
    """((t_s, kind, channel, value, duration_s), ...) of the list in the file."""
    if not isinstance(value, (list, tuple)):
        raise Problem("", f"= {short_toml(value)} is not a list of [t_s, kind, channel, value, duration_s]")
    faults = []
    for k, item in enumerate(value):
        where = f"[{k}]"
        t_s, kind, channel, level, duration_s = _check_item(item, where, 5, "[t_s, kind, channel, value, duration_s]")
        t_s = _check_finite_number(t_s, where, "the time")
        if not isinstance(kind, str) or kind not in FAULTS:
            raise Problem(where, f"= {short_toml(kind)} is not a kind of fault; {nearest(kind, FAULTS)}")
        fault = FAULTS[kind]
        if channel not in fault.channels:
            raise Problem(
                where, f"= {short_toml(channel)} is not a channel of {kind}; {nearest(channel, fault.channels)}"
            )
        if isinstance(level, bool) or not isinstance(level, int):
            raise Problem(where, f"= {short_toml(level)}: the value of {kind} is not an integer")
        lo, hi = DAC_CODES[channel] if kind == "dac_stuck" else (fault.lo, fault.hi)
        if not lo <= level <= hi:
            side, limit = ("above", hi) if level > hi else ("below", lo)
            raise Problem(where, f"= {level}: the value of {kind} is {side} the limit {limit} {fault.unit}".rstrip())
        if kind == "adc_over_range" and level == 0:
            raise Problem(where, "= 0: the value of adc_over_range is -1 or 1, the sign of the rail")
        if isinstance(duration_s, bool) or not isinstance(duration_s, (int, float)) or not duration_s > 0:
            raise Problem(
                where, f"= {short_toml(duration_s)}: the duration is not a number above 0 s (inf: to the end)"
            )
        faults.append((t_s, kind, channel, level, float(duration_s)))
    return tuple(faults)


def check_columns(value):
    """The list of columns of the record as a tuple of names."""
    if not isinstance(value, (list, tuple)):
        raise Problem("", f"= {short_toml(value)} is not a list of names")
    if value:
        from testbench.storage.spool import FIELDS

        for k, name in enumerate(value):
            if not isinstance(name, str) or name not in FIELDS:
                raise Problem(f"[{k}]", f"= {short_toml(name)} is not a column of the record; {nearest(name, FIELDS)}")
    return tuple(value)


def check_times(scenario):
    """Every event lies within the scenario, and no channel has two faults at once."""
    for key in ("register_writes", "faults"):
        for k, item in enumerate(getattr(scenario, key)):
            if not 0 <= item[0] < scenario.seconds:
                raise Problem(
                    f".{key}[{k}]", f"is at {item[0]:g} s, outside 0 to {scenario.seconds:g} s (scenario.seconds)"
                )
    busy = {}
    for k, (t_s, kind, channel, _, duration_s) in enumerate(scenario.faults):
        for begin_s, end_s, other in busy.setdefault((kind[:3], channel), []):
            if t_s < end_s and begin_s < t_s + duration_s:
                raise Problem(f".faults[{k}]", f"overlaps faults[{other}] on {channel}")
        busy[kind[:3], channel].append((t_s, t_s + duration_s, k))


# ---- expansion -------------------------------------------------------------------------------------------------------


def sample(points, t_s, steps=False):
    """Values of a profile at the times `t_s`."""
    times, values = np.array(points, float).T
    if steps:
        return values[np.clip(np.searchsorted(times, t_s, side="right") - 1, 0, None)]
    return np.interp(t_s, times, values)


def build_events(scenario, ticks, tick_hz):
    """Events sorted by tick; those at one tick keep the order of the file, ends before beginnings."""
    events = [
        Event(round(t_s * tick_hz), WRITE, name, "", raw)
        for t_s, name, raw in check_register_writes(scenario.register_writes)
    ]
    for t_s, kind, channel, level, duration_s in check_faults(scenario.faults):
        on = round(t_s * tick_hz)
        off = on + max(1, round(min(duration_s * tick_hz, ticks + 1)))
        events.append(Event(on, FAULT_ON, kind, channel, level))
        if off < ticks:
            events.append(Event(off, FAULT_OFF, kind, channel, 0))
    return tuple(sorted(events, key=lambda event: (event.tick, event.action != FAULT_OFF)))


def expand(scenario, design=DEFAULT):
    """`Timeline` of a checked [scenario] section, in ticks and frames of a design record."""
    ticks, frame_s = round(scenario.seconds * design.tick_hz), design.frame_ticks / design.tick_hz
    frames = -(-ticks // design.frame_ticks)
    rate = profile_points(scenario.rate_dps, -math.inf, math.inf, "deg/s")
    temp = profile_points(scenario.temperature_degc, -math.inf, math.inf, "degC")
    return Timeline(
        ticks,
        frames,
        Profile(rate, scenario.rate_shape == "steps", DEG, frames, frame_s),
        Profile(temp, False, 1.0, frames, frame_s),
        rate[0][1] * DEG,
        temp[0][1],
        build_events(scenario, ticks, design.tick_hz),
    )
