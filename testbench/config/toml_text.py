"""Values as TOML text: for error lines, and for the configuration that a record carries."""

import math
import re

SHORT_TOML_LENGTH = 60


def toml_value(value):
    """TOML text of a value; `tomllib` reads the same value back."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + re.sub(r"[\x00-\x1f\x7f]", lambda c: f"\\u{ord(c[0]):04x}", escaped) + '"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    return str(value)


def toml_key(key):
    """Key, quoted where TOML needs it."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else toml_value(key)


def short_toml(value):
    """A value as TOML, shortened to fit a line."""
    try:
        text = toml_value(value)
    except ValueError:  # an integer of more than 4300 digits
        text = "a number too long to print"
    return text if len(text) <= SHORT_TOML_LENGTH else text[: SHORT_TOML_LENGTH - 3] + "..."
