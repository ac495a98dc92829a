"""Ports of a block as a table: parameters, inputs, registers, outputs, with formats, resets and rules.

Source  docs/golden.md
"""

from fpga_model import block
from testbench.console.text_table import Table
from testbench.golden.stimulus import blocks

HEADS = ("kind", "port", "format", "reset", "rounding", "overflow")


def _merged(ports):
    """(first name, last name, port) of successive ports that differ by their number alone."""
    rows = []
    for port in ports:
        base = port.name.rstrip("0123456789")
        same = rows and base.endswith("_") and rows[-1][0].startswith(base) and rows[-1][2][1:] == port[1:]
        if same:
            rows[-1][1] = port.name
        else:
            rows.append([port.name, port.name, port])
    return rows


def _rows(kind, ports):
    for first, last, port in _merged(ports):
        name = first if first == last else f"{first} .. {last.rpartition('_')[2]}"
        reset = "-" if port.reset is None else str(port.reset)
        yield kind, name, str(port.fmt), reset, port.rounding or "-", port.overflow or "-"


def port_table(stem):
    """Table of a block's ports; its note has latencies in clocks, strobes and the cases of its vectors."""
    declared = blocks.BLOCKS[stem]
    parameters = [blocks.Port(name, fmt) for name, fmt in block.parameters(block.block_modules()[stem]).items()]
    groups = (
        ("parameter", parameters),
        ("input", declared.inputs),
        ("register", declared.registers),
        ("output", declared.pins),
    )
    rows = [row for kind, ports in groups for row in _rows(kind, ports)]
    latency = "; ".join(f"{name} {clocks}" for name, clocks in declared.latency.items())
    strobes = f" Strobes: {', '.join(declared.strobes)}." if declared.strobes else ""
    note = f"Latency in clocks: {latency}.{strobes} Cases of the vectors: {', '.join(declared.cases)}."
    return Table(f"{stem}: ports", HEADS, rows, note, (3,))
