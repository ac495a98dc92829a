"""What is wrong in a configuration, in one clear line: where, what, the limit, the unit, what to write instead.

`sections` is always {section name: its pydantic model}.
Source  docs/configuration.md
"""

import difflib
import math
import re
from typing import Literal, get_args, get_origin

from testbench.config.toml_text import short_toml, toml_value

# Unit suffix of a key -> quantity and factor to its SI unit; what a mistaken unit can be converted with.
SUFFIXES = {
    **{f"{p}m": ("length", f) for p, f in (("", 1.0), ("m", 1e-3), ("u", 1e-6), ("n", 1e-9), ("p", 1e-12))},
    **{f"{p}s": ("time", f) for p, f in (("", 1.0), ("m", 1e-3), ("u", 1e-6), ("n", 1e-9), ("p", 1e-12))},
    **{f"{p}hz": ("frequency", f) for p, f in (("", 1.0), ("m", 1e-3), ("k", 1e3), ("meg", 1e6))},
    **{f"{p}v": ("voltage", f) for p, f in (("", 1.0), ("m", 1e-3), ("u", 1e-6), ("n", 1e-9))},
    **{f"{p}f": ("capacitance", f) for p, f in (("", 1.0), ("n", 1e-9), ("p", 1e-12), ("f", 1e-15))},
    **{f"{p}ohm": ("resistance", f) for p, f in (("", 1.0), ("k", 1e3), ("meg", 1e6))},
    **{f"{p}g": ("mass", f) for p, f in (("k", 1.0), ("", 1e-3), ("m", 1e-6), ("u", 1e-9))},
    **dict.fromkeys(("deg", "degree", "degrees"), ("angle", 1.0)),
    **dict.fromkeys(("rad",), ("angle", 180 / math.pi)),
    **dict.fromkeys(("dps", "deg_per_s"), ("rate", 1.0)),
    **dict.fromkeys(("rps", "rad_per_s", "rad_s"), ("rate", 180 / math.pi)),
    **dict.fromkeys(("degc", "celsius", "c"), ("temperature", 1.0)),
    **{name: ("ratio", f) for name, f in (("ppm", 1e-6), ("percent", 1e-2), ("ppb", 1e-9))},
}
WRITTEN = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s].*?)?\s*")


def _suffix(key):
    """(stem, suffix) of a key whose name ends in a known unit, the longest suffix first; else (key, None)."""
    parts = key.split("_")
    for first in range(1, len(parts)):
        suffix = "_".join(parts[first:]).lower()
        if suffix in SUFFIXES and parts[first - 1] != "per":
            return "_".join(parts[:first]), suffix
    return key, None


def convert(value, have, want):
    """Number in unit suffix `want` from one in `have`, rounded to 12 digits; None if they measure different things."""
    if have not in SUFFIXES or want not in SUFFIXES or SUFFIXES[have][0] != SUFFIXES[want][0]:
        return None
    return float(f"{value * SUFFIXES[have][1] / SUFFIXES[want][1]:.12g}")


def spaced_unit(info):
    unit = (info.json_schema_extra or {}).get("unit", "") if info else ""
    return f" {unit}" if unit else ""


def number_limits(info):
    """(lo, hi) of a number's field; None where there is none."""
    lo = next((m.ge for m in info.metadata if hasattr(m, "ge")), None)
    hi = next((m.le for m in info.metadata if hasattr(m, "le")), None)
    return lo, hi


def literal_choices(info):
    return get_args(info.annotation) if get_origin(info.annotation) is Literal else ()


def number_text(value):
    return f"{value:g}" if isinstance(value, float) else str(value)


def _invalid_key_line(sections, section, key, value, path):
    """Line for a key that does not exist: same quantity in another unit, nearest name, or another section's key."""
    fields = sections[section].model_fields
    stem, suffix = _suffix(key)
    for other in fields:
        other_stem, other_suffix = _suffix(other)
        if other_suffix and other_stem == stem:
            line = f"{path} is not a known key; this quantity is in{spaced_unit(fields[other])}: {section}.{other}"
            fits = suffix and isinstance(value, (int, float)) and not isinstance(value, bool)
            converted = convert(value, suffix, other_suffix) if fits else None
            return line if converted is None else f"{line} = {number_text(converted)}"
    if homes := _homes(sections, key):
        return f"{path} is not a known key; {key} belongs in {homes}"
    close_matches = difflib.get_close_matches(key, fields, n=1, cutoff=0.5)
    hint = f"; did you mean {section}.{close_matches[0]}?" if close_matches else f"; [{section}] has {_some(fields)}"
    return f"{path} is not a known key{hint}"


def _homes(sections, key):
    """Text that names the sections with a key, or ""."""
    return " or ".join(f"[{name}]" for name, model in sections.items() if key in model.model_fields)


def _some(names):
    names = list(names)
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _not_a_number(path, value, info, key):
    """Line for a value that is no number: a text with a unit gets the number to write."""
    integer = info.annotation is int
    number_match = WRITTEN.fullmatch(value) if isinstance(value, str) else None
    if not number_match or math.isinf(float(number_match[1])):
        return f"{path} = {short_toml(value)} is not {'an integer' if integer else 'a number'}{_span(info)}"
    magnitude, unit = float(number_match[1]), number_match[2] or ""
    have = unit.lower().replace("/", "_per_").replace("^", "").replace("°", "deg").replace("µ", "u")
    has_key_unit = not unit or unit == spaced_unit(info).strip()
    converted = magnitude if has_key_unit else convert(magnitude, have, _suffix(key)[1])
    if converted is None:
        write = f"{unit} cannot be converted to it"
    else:
        write = f"write {key} = {number_text(int(converted) if integer else converted)}"
    in_unit = spaced_unit(info) and f" in{spaced_unit(info)}"
    return f"{path} = {short_toml(value)} is text; the key needs a bare number{in_unit}: {write}"


def explain(error, sections, source, origin):
    """One line for one pydantic error."""
    loc = [part for part in error["loc"] if isinstance(part, str)]
    path = ".".join(loc[:2])
    label = origin.get(path, source)
    kind, value = error["type"], error["input"]
    section = loc[0] if loc else ""
    info = sections[section].model_fields.get(loc[1]) if section in sections and len(loc) > 1 else None
    if kind == "value_error":
        problem = error["ctx"]["error"]
        path += problem.where
        return f"{origin.get(path.split('[')[0], label)}: {path} {problem.text}"
    if kind == "extra_forbidden" and len(loc) == 1:
        close_matches = difflib.get_close_matches(section, sections, n=1, cutoff=0.5)
        homes = _homes(sections, section)
        if homes:
            hint = f"{section} belongs in {homes}"
        else:
            hint = f"did you mean [{close_matches[0]}]?" if close_matches else f"known: {', '.join(sections)}"
        what = f"[{section}] is not a known section" if isinstance(value, dict) else f"{section} is not in a section"
        return f"{label}: {what}; {hint}"
    if kind == "extra_forbidden":
        return f"{label}: {_invalid_key_line(sections, section, loc[1], value, path)}"
    if kind in ("model_type", "model_attributes_type") or info is None:
        return f"{label}: {path} = {short_toml(value)} is not a section; write [{path}] and its keys below"
    if kind == "greater_than_equal":
        limit = number_text(error["ctx"]["ge"])
        return f"{label}: {path} = {short_toml(value)} is below the limit {limit}{spaced_unit(info)}"
    if kind == "less_than_equal":
        limit = number_text(error["ctx"]["le"])
        return f"{label}: {path} = {short_toml(value)} is above the limit {limit}{spaced_unit(info)}"
    if kind == "finite_number":
        return f"{label}: {path} = {short_toml(value)} is not finite{_span(info)}"
    if kind == "literal_error":
        choices = literal_choices(info)
        close_matches = difflib.get_close_matches(str(value), [str(c) for c in choices], n=1, cutoff=0.5)
        hint = f"; did you mean {close_matches[0]}?" if close_matches else ""
        choices_text = " | ".join(map(toml_value, choices))
        return f"{label}: {path} = {short_toml(value)} is none of {choices_text}{spaced_unit(info)}{hint}"
    if kind == "bool_type":
        return f"{label}: {path} = {short_toml(value)} is not true or false"
    if kind == "string_type":
        return f"{label}: {path} = {short_toml(value)} is not a text in quotes"
    return f"{label}: {_not_a_number(path, value, info, loc[1])}"


def _span(info):
    lo, hi = number_limits(info)
    return f" ({number_text(lo)} to {number_text(hi)}{spaced_unit(info)})" if hi is not None else ""
