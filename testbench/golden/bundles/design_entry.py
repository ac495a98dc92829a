"""The design that a bundle is of: what a configuration makes of the blocks, and the entries of a manifest.

    design         {key: value} of the whole record; without it a bundle is of the default design
    design_params  keys that the RTL takes as parameters, in capitals: [{name, value}]; none at the default design

Source  docs/golden.md (another design)
"""

from pathlib import Path

from fpga_model import design_record
from testbench.errors import ConfigError, FileError
from testbench.golden.bundles import bundle
from testbench.golden.stimulus import blocks, levels
from testbench.golden.stimulus.levels import rtl_parameters  # noqa: F401
from testbench.storage.inputs import validate_data


def entry(block):
    """Entries of the manifest of a `blocks.Block`; none for a block that no file gave a design."""
    if block.design is None:
        return {}
    design_parameters = [{"name": name, "value": value} for name, value in block.design_keys.items()]
    return {"design": block.design._asdict(), "design_params": design_parameters}


def interface(block, case):
    """Entries of the manifest that say what a design must look like: ports, parameters, levels."""
    params = [{"name": name, "raw": raw, "fmt": list(fmt)} for name, raw, fmt in blocks.case_parameters(block, case)]
    return {
        "inputs": [bundle.port(p) for p in block.columns],
        "registers": [bundle.port(p) for p in block.registers],
        "outputs": [bundle.port(p) for p in block.pins],
        "params": params,
        "unused_params": levels.unused_params(block),
        "levels": levels.levels_entry(block),
        **entry(block),
    }


def manifest_design(path, manifest):
    """Design record of a manifest, or None; FileError where it is none of this version."""
    if "design" not in manifest:
        return None
    from testbench.config.load import Design

    raw = validate_data(manifest["design"], dict[str, int], f"{path}: design")
    keys = design_record.Design._fields
    if list(raw) != list(keys):
        raise FileError(f"{path}: design: has the keys {', '.join(raw)}, not {', '.join(keys)}")
    values = validate_data(raw, Design, f"{path}: design")
    if raw["dds_bits"] < 2 + raw["sine_address_bits"] + raw["sine_fraction_bits"]:
        raise FileError(f"{path}: design: dds_bits = {raw['dds_bits']} is too few for quadrant, address and fraction")
    if raw["sine_bits"] <= raw["sine_address_bits"]:
        raise FileError(
            f"{path}: design: sine_bits = {raw['sine_bits']} is not above "
            f"sine_address_bits = {raw['sine_address_bits']}"
        )
    if raw["adc_tail_clocks"] == 0:
        raise FileError(f"{path}: design: adc_tail_clocks = 0 is below 1")
    return design_record.Design(*(getattr(values, key) for key in keys))


def read_board_config(path):
    """(Config, `top.Params`) of a configuration file; ConfigError where it cannot be built."""
    from testbench.config import load
    from testbench.run import build, design_check  # they know plant and engine, which no other export does

    config = load(Path(path))
    design_check.check(config)
    try:
        return config, build.firmware(config)
    except ValueError as problem:
        raise ConfigError(f"{path}: {problem}") from None


def config_blocks(path):
    """{stem: Block} of a configuration file, with its parameters as cases."""
    return blocks.firmware_blocks(read_board_config(path)[1])
