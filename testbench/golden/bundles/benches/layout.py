"""What every bench agrees on: names, the order of packed ports, constants, and which blocks hold others.

Source  docs/golden.md (what a design must look like)
"""

from fpga_model import wiring
from fpga_model.block import declared, parts_of
from testbench.golden.stimulus import levels
from testbench.golden.stimulus.blocks import BLOCKS, RESET_INPUT, case_parameters

RESET_CYCLES = 2
SHOWN = 10  # rows that a bench reports in full


def _parts():
    """{stem: blocks that a design may build from}; an optional block is no part of the whole design."""
    found = {
        stem: tuple(p.__name__.rpartition(".")[2] for p in parts_of(m.State).values()) for stem, m in declared().items()
    }
    used = {module.__name__.rpartition(".")[2] for module, _ in wiring.instances().values()}
    used |= {part for stem in used for part in found[stem]}
    return found | {"top": (*(stem for stem in BLOCKS if stem in used), "control")}


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


def results(block):
    """(RTL port, Port) of everything compared: registers, then outputs."""
    return [(f"r_{p.name}", p) for p in block.registers] + [(f"o_{p.name}", p) for p in block.pins]


def set_params(block, case):
    """`params_of` but for those that no design needs."""
    unused = levels.unused_params(block)
    return [found for found in case_parameters(block, case) if found[0] not in unused]


def levels_of(block):
    """Levels at which a block has ports; registers is always one."""
    stated = levels.levels_entry(block)
    return [level for level in levels.LEVELS if stated.get(level, True)]


def judged_at(block, level):
    """Names of the ports that a level judges."""
    return [name for name, _ in results(block)] if level == "registers" else levels.levels_entry(block)[level]


def counted(block, level):
    """What a bench says of the ports that it judges."""
    count = f"{len(judged_at(block, level))} ports"
    return count if level == "registers" else f"{count} at level {level}"


def mask_of(block, level):
    """Packed word with a 1 in every bit that a level judges."""
    seen, word = judged_at(block, level), 0
    for name, port in results(block):
        word = word << port.width | ((1 << port.width) - 1) * (name in seen)
    return word


def slices(named):
    """(name, port, msb, lsb) of ports packed side by side, the first in the most significant bits."""
    left = sum(port.width for _, port in named)
    for name, port in named:
        yield name, port, left - 1, left - port.width
        left -= port.width


def width_of(named):
    return sum(port.width for _, port in named)


def inputs_of(block):
    return [(port.name, port) for port in block.columns]


def half_ps(block):
    """Half a period of the clock (ps)."""
    hz = block.record.master_hz
    return (1_000_000_000_000 + hz // 2) // hz // 2


def constants(block, count):
    """(name, integer) that every language gets."""
    listed = [
        ("N_ROWS", count),
        ("RESET_CYCLES", RESET_CYCLES),
        ("HALF_PS", half_ps(block)),
        ("IN_WIDTH", width_of(inputs_of(block))),
        ("OUT_WIDTH", width_of(results(block))),
    ]
    listed += [(f"W_{name}", port.width) for name, port in inputs_of(block)]
    listed += [(f"W_{name}", port.width) for name, port in results(block)]
    listed += [(f"LATENCY_{name}", clocks) for name, clocks in block.latency.items() if isinstance(clocks, int)]
    return listed
