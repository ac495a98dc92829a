"""Configuration of a run: `load` a TOML file, `changed` for a variant, `to_toml` to keep it."""

from testbench.config.load import (
    Config,
    Firmware,
    Noise,
    Output,
    Override,
    Scenario,
    changed,
    from_dict,
    load,
    parse_set,
    phase_word,
    sections,
    to_toml,
)

__all__ = [
    "Config",
    "Firmware",
    "Noise",
    "Output",
    "Override",
    "Scenario",
    "changed",
    "from_dict",
    "load",
    "parse_set",
    "phase_word",
    "sections",
    "to_toml",
]
