"""What every bench agrees on: names, the order of packed ports, constants, and which blocks hold others.

Source  docs/golden.md (what a design must look like)
"""

from fpga_model import wiring
from fpga_model.block import block_modules, state_modules
from testbench.golden.stimulus import levels
from testbench.golden.stimulus.blocks import BLOCKS, RESET_INPUT, case_parameters

RESET_CYCLES = 2
REPORTED_ROWS = 10  # rows that a bench reports in full


def _parts():
    """{stem: blocks that a design may build from}; an optional block is no part of the whole design."""
    parts_by_stem = {
        stem: tuple(p.__name__.rpartition(".")[2] for p in state_modules(m.State).values())
        for stem, m in block_modules().items()
    }
    used = {module.__name__.rpartition(".")[2] for module, _ in wiring.instances().values()}
    used |= {part for stem in used for part in parts_by_stem[stem]}
    return parts_by_stem | {"top": (*(stem for stem in BLOCKS if stem in used), "control")}


PARTS = _parts()

# Parameters of the whole design that name a table; a block has one, ROM_FILE
TOP_ROMS = {"SINE_ROM_FILE": "rom/sine.hex", "CORDIC_ROM_FILE": "rom/cordic_atan.hex"}

assert RESET_INPUT == "rst", "the benches name the reset"


def rom_name(block):
    """Path of the block's table inside the bundle, or None."""
    return f"rom/{block.roms[0].name}.hex" if block.roms else None


def rom_parameters(block):
    """{parameter: path inside the bundle} of the tables that a design loads."""
    if block.stem == "top":
        return TOP_ROMS
    return {"ROM_FILE": rom_name(block)} if block.roms else {}


def result_port_pairs(block):
    """(RTL port, Port) of everything compared: registers, then outputs."""
    return [(f"r_{p.name}", p) for p in block.registers] + [(f"o_{p.name}", p) for p in block.pins]


def set_params(block, case):
    """`case_parameters` but for those that no design needs."""
    unused = levels.unused_params(block)
    return [param_entry for param_entry in case_parameters(block, case) if param_entry[0] not in unused]


def block_levels(block):
    """Levels at which a block has ports; registers is always one."""
    ports_by_level = levels.levels_entry(block)
    return [level for level in levels.LEVELS if ports_by_level.get(level, True)]


def compared_port_names(block, level):
    """Names of the ports that a level judges."""
    return [name for name, _ in result_port_pairs(block)] if level == "registers" else levels.levels_entry(block)[level]


def port_count_text(block, level):
    """What a bench says of the ports that it judges."""
    count = f"{len(compared_port_names(block, level))} ports"
    return count if level == "registers" else f"{count} at level {level}"


def level_mask(block, level):
    """Packed word with a 1 in every bit that a level judges."""
    port_names, word = compared_port_names(block, level), 0
    for name, port in result_port_pairs(block):
        word = word << port.width | ((1 << port.width) - 1) * (name in port_names)
    return word


def slices(port_pairs):
    """(name, port, msb, lsb) of ports packed side by side, the first in the most significant bits."""
    remaining_bits = sum(port.width for _, port in port_pairs)
    for name, port in port_pairs:
        yield name, port, remaining_bits - 1, remaining_bits - port.width
        remaining_bits -= port.width


def total_width(port_pairs):
    return sum(port.width for _, port in port_pairs)


def input_ports(block):
    return [(port.name, port) for port in block.columns]


def half_ps(block):
    """Half a period of the clock (ps)."""
    hz = block.record.master_hz
    return (1_000_000_000_000 + hz // 2) // hz // 2


def constants(block, count):
    """(name, integer) that every language gets."""
    constant_pairs = [
        ("N_ROWS", count),
        ("RESET_CYCLES", RESET_CYCLES),
        ("HALF_PS", half_ps(block)),
        ("IN_WIDTH", total_width(input_ports(block))),
        ("OUT_WIDTH", total_width(result_port_pairs(block))),
    ]
    constant_pairs += [(f"W_{name}", port.width) for name, port in input_ports(block)]
    constant_pairs += [(f"W_{name}", port.width) for name, port in result_port_pairs(block)]
    constant_pairs += [(f"LATENCY_{name}", clocks) for name, clocks in block.latency.items() if isinstance(clocks, int)]
    return constant_pairs
