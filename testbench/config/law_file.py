"""Law files: an effect that data discovered, or somebody wrote, as TOML that any run can switch on.

    schema = "gyrolaw/1.0"
    name = "x_cubed"                                    letters, digits, _
    laws = ["force_x = -2.5e9 x^3"]                     as in effects.law
    sd = [1.2e7]                                        optional: of each coefficient
    [provenance]                                        optional texts: record, sha256, created, verdict

    [effects]                                           in a configuration beside it
    files = ["x_cubed.toml"]

Source    docs/effects.md
"""

import re
from typing import NamedTuple

from testbench.config.toml_text import short_toml, toml_key, toml_value
from testbench.errors import ConfigError
from testbench.storage.files import write_text
from testbench.storage.inputs import read_toml

SCHEMA = "gyrolaw/1.0"
KEYS = ("schema", "name", "laws", "sd", "provenance")


class LawFile(NamedTuple):
    """What a law file holds; `laws` are texts in the form that `law.parse` reads."""

    name: str
    laws: tuple
    sd: tuple = ()
    provenance: tuple = ()  # ((name, text), ...)


def parse_law_file(tree, where):
    """`LawFile` of a dict; ConfigError with one line."""
    from analog_frontend.effects import law

    extra_keys = set(tree) - set(KEYS)
    if extra_keys or tree.get("schema") != SCHEMA:
        what = f"{min(extra_keys)} is not a key here" if extra_keys else f"schema = {short_toml(tree.get('schema'))}"
        raise ConfigError(f'{where}: {what}; a law file has schema = "{SCHEMA}" and {", ".join(KEYS[1:])}')
    name, laws = tree.get("name"), tree.get("laws")
    if not isinstance(name, str) or not re.fullmatch(r"\w{1,64}", name):
        raise ConfigError(f"{where}: name = {short_toml(name)} is not 1 to 64 letters, digits or _")
    if not isinstance(laws, list) or not laws or not all(isinstance(text, str) for text in laws):
        raise ConfigError(f"{where}: laws = {short_toml(laws)} is not a list of texts")
    sd = tree.get("sd", [])
    numbers = isinstance(sd, list) and all(isinstance(v, (int, float)) and v > 0 for v in sd)
    if not numbers or (sd and len(sd) != len(laws)):
        raise ConfigError(f"{where}: sd = {short_toml(sd)} is not a positive number for each law")
    about = tree.get("provenance", {})
    if not isinstance(about, dict) or not all(isinstance(v, str) for v in about.values()):
        raise ConfigError(f"{where}: provenance = {short_toml(about)} is not a table of texts")
    try:
        laws = tuple(str(law.parse(text)) for text in laws)
    except ValueError as problem:
        raise ConfigError(f"{where}: {problem}") from None
    return LawFile(name, laws, tuple(float(v) for v in sd), tuple(about.items()))


def read(path):
    """`LawFile` of a TOML file."""
    return parse_law_file(read_toml(path), str(path))


def text(item):
    """The TOML text of a `LawFile`."""
    lines = [f'schema = "{SCHEMA}"', f"name = {toml_value(item.name)}", f"laws = {toml_value(list(item.laws))}"]
    lines += [f"sd = {toml_value(list(item.sd))}"] if item.sd else []
    if item.provenance:
        lines += ["", "[provenance]", *(f"{toml_key(key)} = {toml_value(v)}" for key, v in item.provenance)]
    return "\n".join(lines) + "\n"


def write(path, item):
    """Write a `LawFile`, beside and renamed."""
    write_text(path, text(item))
