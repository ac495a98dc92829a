"""The generated tables of docs/blocks/: ports of a block, with formats, resets and rules; latencies and cases."""

from fpga_model import block
from testbench.console.markdown import markdown
from testbench.console.text_table import Table
from testbench.golden.stimulus import blocks


def _merged(ports):
    """(first name, last name, port) of ports in a row that differ by their number alone."""
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


def ports_part(stem):
    """Parameters, inputs, registers and pins of a block, latencies, cases."""
    own = blocks.BLOCKS[stem]
    given = [blocks.Port(name, fmt) for name, fmt in block.parameters(block.block_modules()[stem]).items()]
    groups = (("parameter", given), ("input", own.inputs), ("register", own.registers), ("output", own.pins))
    rows = [row for kind, ports in groups for row in _rows(kind, ports)]
    heads = ("kind", "port", "format", "reset", "rounding", "overflow")
    latency = "; ".join(f"{name} {clocks}" for name, clocks in own.latency.items())
    strobes = f" Strobes: {', '.join(own.strobes)}." if own.strobes else ""
    cases = f"Latency in clocks: {latency}.{strobes} Cases of the vectors: {', '.join(own.cases)}."
    return f"{markdown(Table('', heads, rows, numeric=(3,)))}\n\n{cases}"


def stems():
    """Every block."""
    return list(blocks.BLOCKS)
