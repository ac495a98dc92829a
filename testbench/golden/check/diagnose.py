"""Why a design differs from golden rows: causes in order of rank; none where no hypothesis explains the rows.

    every register of the block is seen   each register and pin by one step from the design's own rows
    only some ports are seen              the whole block with one fault, from golden rows on
    the whole design                      each of its blocks whose registers are wrong, as the first
    of it the pins alone                  each block that leads to a wrong pin, as the second

Source    docs/diagnosis.md
"""

from typing import NamedTuple

import numpy as np

from fpga_model import top
from fpga_model.block import block_modules, leaves
from fpga_model.design_record import DEFAULT
from testbench.golden.diagnosis import design_graph, elaborate
from testbench.golden.diagnosis.cause_ranking import MOST_REPORTED_CAUSES, Cause, hidden_causes, rank_causes
from testbench.golden.diagnosis.fault_search import Search
from testbench.golden.diagnosis.node_rows import Rows as Wires
from testbench.golden.diagnosis.partial_observation import HiddenRegisterSearch
from testbench.golden.recording import board_pins, recording

MOST_SHIFT = 8  # clocks
PINS_ONLY_DIVISOR = 2  # a cause at the pins of the whole design may as well be in a block that leads to no pin
LEAST_ROWS = 4  # wrong rows of a register of the whole design, below which its cause is not certain


class Rows(NamedTuple):
    """What a diagnosis reads. Columns are int64 arrays of one length.

    block           stem of the block; of one that is not ours nothing is said
    params          {name: raw}
    inputs          {name: column}, `rst` among them
    expected, got   {name: column} of registers and pins; `got` may lack any
    care            {name: bool column} of the rows of `got` that count
    undefined_registers  names of registers that are not known in row 0, behind the reset
    design          record of the design that the rows are of
    """

    block: str
    params: dict
    inputs: dict
    expected: dict
    got: dict
    care: dict
    undefined_registers: tuple = ()
    design: object = DEFAULT


def _shift_causes(rows):
    """[Cause] if every port that is seen comes the same number of clocks late or early: the log, not a register."""
    differing = [name for name, column in rows.got.items() if np.any((column != rows.expected[name])[rows.care[name]])]
    if len(differing) < 2:
        return []
    for k in range(1, MOST_SHIFT + 1):
        for cause, log, golden in (
            ("late", slice(k, None), slice(None, -k)),
            ("early", slice(None, -k), slice(k, None)),
        ):
            columns = [(c[log], rows.expected[n][golden], rows.care[n][log]) for n, c in rows.got.items()]
            if all(np.array_equal(have[counts], want[counts]) for have, want, counts in columns):
                return [Cause(cause, differing[0], 1.0, f"all ports by {k} clock{'s' * (k > 1)}")]
    return []


def diagnose(rows):
    """[Cause] of the difference of `Rows`, in order of rank; empty if unknown, or if there is no difference."""
    shift_causes = _shift_causes(rows)
    if not shift_causes and rows.block == "top":
        return _design_causes(rows)
    if shift_causes or rows.block not in block_modules():
        return shift_causes
    try:
        net = elaborate.block_net(rows.block, rows.params, rows.design)
    except (elaborate.Unsupported, KeyError):
        return []
    count = len(next(iter(rows.expected.values())))
    inputs = {"rst": np.zeros(count, np.int64), **rows.inputs}
    required_inputs = {name.removeprefix("in ") for name in net.fmts if name.startswith("in ")}
    if not required_inputs <= set(inputs) or not set(net.reset) <= set(rows.expected):
        return []
    got = {name: column for name, column in rows.got.items() if name in net.roots}
    care = {name: rows.care[name] for name in got}
    leaves = {("in", name): column for name, column in inputs.items()}
    if not set(net.reset) <= set(got):
        leaves |= {("reg", name): rows.expected[name] for name in net.reset}
        return hidden_causes(HiddenRegisterSearch(net, leaves, got, care, rows.expected))
    register_columns = {name: np.where(care[name], got[name], rows.expected[name]) for name in net.reset}
    leaves |= {("reg", name): column for name, column in register_columns.items()}
    search = Search(net, leaves, got, care, rows.expected)
    return _search_causes(rows, search)[0]


def _search_causes(rows, search):
    """([Cause], number of registers and pins at fault) of a `Search` on rows."""
    first = list(_first_row_causes(rows, search))
    names = {c.register for c in first}
    count = len(names | set(search.faulty))
    ranked_causes = (c for c in rank_causes(search, names) if c.register not in rows.undefined_registers)
    return [*(c._replace(share=c.share / count) for c in first), *ranked_causes], count


def _design_causes(rows):
    """[Cause] of the whole design: block by block, each with what the registers of the design gave it.

    Blocks of one module with the same cause are one fault. Without a reset in the rows the first row alone is no proof.
    """
    params = recording.params_from("manifest", list(rows.params), list(rows.params.values()), rows.design)
    registers = [design_graph.report_name(name) for name, _ in leaves(top.State())]
    if not set(registers) <= set(rows.expected):
        return []
    try:
        net, instances = design_graph.wire_design(params)
    except elaborate.Unsupported:
        return []
    if not set(registers) <= set(rows.got):
        return _pins_only_causes(rows, net, instances, registers)
    register_columns = {name: np.where(rows.care[name], rows.got[name], rows.expected[name]) for name in registers}
    columns = {("in", name): column for name, column in (rows.inputs | register_columns).items()}
    wires = Wires(net, columns, len(register_columns[registers[0]]))
    valid_rows = np.logical_and.reduce([rows.care[name] for name in registers])
    groups, total = {}, 0
    for one in instances.values():
        names = {name: port for name, port in one.names.items() if port in rows.got}
        if not any(np.any((rows.got[p] != rows.expected[p]) & rows.care[p]) for p in names.values()):
            continue
        instance_causes, count = _instance_causes(rows, one, names, wires, valid_rows)
        total += count
        for cause in instance_causes:
            design_cause = cause._replace(register=one.names[cause.register], share=cause.share * count)
            groups.setdefault((cause.cause, *one.homes[cause.register]), []).append(design_cause)
    merged = [causes[0]._replace(share=sum(c.share for c in causes) / total) for causes in groups.values()]
    return sorted(merged, key=lambda cause: -cause.share)[:MOST_REPORTED_CAUSES]


def _pins_only_causes(rows, net, instances, registers):
    """[Cause] of the whole design of which the pins alone are seen, none of them certain.

    A block that leads to a wrong pin is given what golden registers give it. The cause must explain every wrong pin:
    in one block, or in the same way in several instances of it.
    """
    care = dict(rows.care)
    for data, chip in board_pins.READ.items():
        for of in (rows.got, rows.expected):
            care[data] = care[data] & (of[chip[0]] == 0) & (of[chip[1]] == 1)
    wrong = {pin for pin, column in rows.got.items() if np.any((column != rows.expected[pin]) & care[pin])}
    golden = rows.inputs | {name: rows.expected[name] for name in registers}
    wires = Wires(net, {("in", name): column for name, column in golden.items()}, len(rows.inputs["rst"]))
    per_instance, modules = [], set()
    for path, one in instances.items():
        pins = {name: pin for name, pin in design_graph.instance_top_pins(path).items() if pin in rows.got}
        if not wrong & set(pins.values()):
            continue
        wrong -= set(pins.values())
        modules.add(one.module)
        instance_net = elaborate.block_net(one.module.__name__.rpartition(".")[2], one.params, rows.design)
        leaf_columns = {("in", name): wires.node_column(node) for name, node in one.ports.items()}
        leaf_columns |= {("reg", name): rows.expected[one.names[name]] for name in instance_net.reset}
        leaf_columns["in", "rst"] = rows.inputs["rst"]
        pin_columns = [{name: of[pin] for name, pin in pins.items()} for of in (rows.got, care, rows.expected)]
        causes = hidden_causes(HiddenRegisterSearch(instance_net, leaf_columns, *pin_columns), every=True)
        per_instance.append({(c.cause, c.what): c._replace(register=one.names[c.register]) for c in causes})
    if wrong or len(modules) != 1:
        return []
    both = set.intersection(*map(set, per_instance))
    share = min((cause.share for of in per_instance for cause in of.values()), default=0.0) / PINS_ONLY_DIVISOR
    common_causes = {}
    for key in per_instance[0]:
        if key in both:
            cause = per_instance[0][key]._replace(share=share)
            common_causes.setdefault((cause.cause, cause.register), cause)
    return list(common_causes.values())[:MOST_REPORTED_CAUSES]


def _instance_causes(rows, one, names, wires, valid_rows):
    """([Cause], registers and pins at fault) of a `design_graph.Wired`; `names`: its registers and pins."""
    net = elaborate.block_net(one.module.__name__.rpartition(".")[2], one.params, rows.design)
    block_rows = rows._replace(
        expected={name: rows.expected[port] for name, port in names.items()},
        got={name: rows.got[port] for name, port in names.items()},
        # what follows from a value that nobody knows is not judged
        care={name: rows.care[port] & np.r_[True, valid_rows[:-1]] for name, port in names.items()},
        undefined_registers=tuple(name for name, port in names.items() if port in rows.undefined_registers),
    )
    leaf_columns = {("in", name): wires.node_column(node) for name, node in one.ports.items()}
    leaf_columns["in", "rst"] = rows.inputs["rst"]
    for name in net.reset:
        leaf_columns["reg", name] = np.where(block_rows.care[name], block_rows.got[name], block_rows.expected[name])
    search = Search(net, leaf_columns, block_rows.got, block_rows.care, block_rows.expected)
    causes, count = _search_causes(block_rows, search)
    wrong = {name: np.count_nonzero(target.wrong) for name, target in search.targets.items()}
    return [c._replace(share=c.share / 2) if 0 < wrong[c.register] < LEAST_ROWS else c for c in causes], count


def _first_row_causes(rows, search):
    """Causes that row 0 shows: a register unknown behind the reset, or another value there and nothing wrong later."""
    for name in search.net.reset:
        value = int(rows.got[name][0])
        if name in rows.undefined_registers:
            # where most are not reset, it is not a register that lacks its reset
            if 2 * len(rows.undefined_registers) <= len(search.net.reset) or len(rows.undefined_registers) == 1:
                # a branch before the reset gives the same
                yield Cause("no_reset", name, 0.5, "unknown after the reset")
        elif name not in search.faulty and rows.care[name][0] and value != rows.expected[name][0]:
            # one that is never repeated may also be missing; one that is, is right there
            yield Cause("reset", name, 0.5, f"{value} for {rows.expected[name][0]}")
