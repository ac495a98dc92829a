"""A netlist as and-inverter graph, simulated for 64 designs at a time: bit k of every word belongs to design k.

    write      yosys maps a netlist to two-input ANDs, inverters and flip-flops, and keeps the names of the ports
    Graph      literal 2*n is node n, 2*n + 1 its inverse; node 0 is constant 0, then inputs, flip-flops, ANDs
    run        row by row: a design is done at the first row in which an output is not as expected

No step compiles C++, so that a few thousand rows of a hundred and fifty faults take seconds.
Source  Biere, "The AIGER And-Inverter Graph (AIG) Format", 2007
"""

import re
from typing import NamedTuple

import numpy as np

from fpga_model.jit import kernel
from testbench.errors import FileError

LANES = 64
# From RTLIL with `$dff`, multiplexers and memories without write ports to AIGER text
STEPS = (
    "memory_map; opt_clean; wreduce t:$mul; techmap; opt_clean; dffunmap; setundef -undriven -zero; aigmap; opt_clean; "
    "write_aiger -ascii -symbols"
)


class Graph(NamedTuple):
    """Ports are {name: [place of each bit, least first]}; `ands` are (left, right), `latches` the next literals."""

    inputs: dict
    outputs: dict
    in_count: int
    out_literals: np.ndarray
    latches: np.ndarray
    ands: np.ndarray


def _parse_port_symbols(symbols, kind):
    """{port: positions} of the inputs or outputs."""
    position_by_bit = {}
    for position, name, bit in re.findall(rf"^{kind}(\d+) (\S+?)(?:\[(\d+)\])?$", symbols, re.M):
        position_by_bit.setdefault(name, {})[int(bit or 0)] = int(position)
    for name, positions in position_by_bit.items():
        if sorted(positions) != list(range(len(positions))):
            raise FileError(f"port {name}: bits {sorted(positions)} are not 0 .. {len(positions) - 1}")
    return {name: [positions[k] for k in range(len(positions))] for name, positions in position_by_bit.items()}


def read(path):
    """`Graph` of an AIGER text file; raises FileError if it is none that yosys writes."""
    lines = path.read_text().splitlines()
    head = lines[0].split()
    if head[:1] != ["aag"] or len(head) < 6:
        raise FileError(f"{path}: not an AIGER text: {lines[0][:40]!r}")
    _, i, n, o, a = map(int, head[1:6])
    at = np.cumsum([1, i, n, o, a])

    def read_number_rows(k, columns):
        rows = [line.split()[:columns] for line in lines[at[k] : at[k + 1]]]
        return np.array(rows, np.int64).reshape(-1, columns)

    latches, outputs, ands = read_number_rows(1, 2), read_number_rows(2, 1), read_number_rows(3, 3)
    expected = [2 * np.arange(1 + i, 1 + i + n), 2 * np.arange(1 + i + n, 1 + i + n + a)]
    if not (np.array_equal(latches[:, 0], expected[0]) and np.array_equal(ands[:, 0], expected[1])):
        raise FileError(f"{path}: nodes are not in order")
    if a and (ands[:, 1:] >= ands[:, :1]).any():
        raise FileError(f"{path}: an AND gate reads a later node")
    symbols = "\n".join(lines[at[4] :])
    ports = [_parse_port_symbols(symbols, kind) for kind in "io"]
    return Graph(*ports, i, outputs[:, 0], latches[:, 1].copy(), ands[:, 1:].copy())


def expand_bits(rows, columns, port_positions, count):
    """uint8 (rows, count): bit k of column `name` stands at position port_positions[name][k].

    rows     int64, one column per name
    columns  [(name, width)]
    Raises FileError if a port is missing or has another width.
    """
    bit_rows = np.zeros((len(rows), count), np.uint8)
    for column, (name, width) in enumerate(columns):
        have = len(port_positions.get(name, ()))
        if have != width:
            what = f"has {have} bits, not {width}" if have else "is missing"
            raise FileError(f"design: port {name} {what}")
        for k, position in enumerate(port_positions[name]):
            bit_rows[:, position] = rows[:, column] >> k & 1
    return bit_rows


@kernel
def _simulate_lanes(ands, latches, out_literals, in_count, stim, exp, mask, chosen, clear, cycles, first, initial):
    """`first[k]`: first row in which design k differs, or as it was; `initial`: flip-flops at row 0."""
    count = latches.shape[0]
    value = np.zeros(2 * (1 + in_count + count + ands.shape[0]), np.int64)
    following = np.zeros(count, np.int64)
    value[1] = -1
    begin, gates = 2 * (1 + in_count), 2 * (1 + in_count + count)
    for k in range(count):
        value[begin + 2 * k + 1] = -1
    alive = np.int64(-1)
    for n in range(-cycles, stim.shape[0]):
        row = max(n, 0)
        for k in range(in_count):
            # before row 0 the sound design alone is reset
            word = chosen[k] if n >= 0 else np.int64(0)
            if stim[row, k] or (n < 0 and k == clear):
                word = np.int64(-1)
            value[2 * k + 2] = word
            value[2 * k + 3] = ~word
        for k in range(ands.shape[0]):
            word = value[ands[k, 0]] & value[ands[k, 1]]
            value[gates + 2 * k] = word
            value[gates + 2 * k + 1] = ~word
        if n == 0:
            for k in range(count):
                initial[k] = value[begin + 2 * k]
        if n >= 0:
            bad = np.int64(0)
            for k in range(out_literals.shape[0]):
                if mask[n, k]:
                    bad |= value[out_literals[k]] ^ (-np.int64(exp[n, k]))
            bad &= alive
            if bad != 0:
                alive &= ~bad
                for k in range(LANES):
                    if bad >> k & 1:
                        first[k] = n
                if alive == 0:
                    return
        for k in range(count):
            following[k] = value[latches[k]]
        for k in range(count):
            value[begin + 2 * k] = following[k]
            value[begin + 2 * k + 1] = ~following[k]


def run(graph, stim, exp, mask, select, numbers, clear, cycles):
    """({number: first row that differs, or -1} of the designs `numbers`, flip-flops of design 0 at row 0).

    stim, exp, mask  uint8 rows of bits, as `expand_bits` gives them
    select           input port whose word chooses the design
    clear            input port that resets
    cycles           clocks of reset before row 0, with design 0
    """
    first_bad_rows, (reset,) = {}, graph.inputs[clear]
    initial_state = np.zeros(len(graph.latches), np.int64)
    for begin in range(0, len(numbers), LANES):
        some = numbers[begin : begin + LANES]
        lanes = [*some, *[some[0]] * (LANES - len(some))]
        chosen, first = np.zeros(graph.in_count, np.int64), np.full(LANES, -1, np.int64)
        for k, position in enumerate(graph.inputs[select]):
            word = sum((number >> k & 1) << lane for lane, number in enumerate(lanes))
            chosen[position] = word - (1 << LANES) if word >> (LANES - 1) else word
        netlist = graph.ands, graph.latches, graph.out_literals, graph.in_count
        _simulate_lanes(*netlist, stim, exp, mask, chosen, reset, cycles, first, initial_state)
        first_bad_rows |= dict(zip(some, first.tolist()))
    return first_bad_rows, initial_state & 1
