"""Configuration of a run: `load` a TOML file, `changed` for a variant, `to_toml` to keep it."""

from testbench.config.load import (  # noqa: F401
    TEMPS_DEGC,
    Config,
    Design,
    Effects,
    Firmware,
    Noise,
    Nominal,
    Output,
    Override,
    Plant,
    Scenario,
    changed,
    from_dict,
    load,
    parse_set,
    phase_word,
    placeless,
    require_config,
    sections,
    to_toml,
)
