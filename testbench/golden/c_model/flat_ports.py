"""Blocks in C with flat ports: `blocks_of_design.c`, in which a row of int64 stands for a struct.

All structs hold nothing but int64_t, so a row is copied into its struct and back; sizes are checked by the compiler.
"""

import inspect
from typing import NamedTuple

from fpga_model import block as registry
from fpga_model import control, sine, top
from fpga_model.fixed import formats
from testbench.golden.bundles import design_bundle as top_bundle
from testbench.golden.c_model.c_kinds import NUMBER, Record, StaticValue, aggregate, infer_kind, number_count
from testbench.golden.c_model.program import Program
from testbench.golden.stimulus import blocks


class CBlock(NamedTuple):
    """A block in C: its `blocks.Block`, kinds of its arguments by name, and its functions."""

    block: blocks.Block
    params: list
    kinds: dict
    runtime: bool
    step: tuple
    pins: list


def _translate(program, module, name, kinds):
    """(names of the arguments, `Signature`) of a function of a block."""
    names = list(inspect.signature(registry.python_function(getattr(module, name))).parameters)
    return names, program.function(getattr(module, name), tuple(kinds[key] for key in names))


def _params(module, params, design):
    """[(flat name, format, value, default or None)] of parameters."""
    if params is None:
        return []
    shape = formats(module.Params, design, params)
    added = registry.parameter_defaults(shape)
    values = dict(registry.leaves(params))
    return [(registry.port_name(name), fmt, int(values[name]), added.get(name)) for name, fmt in registry.leaves(shape)]


def make(program, stem, block, params, optional=None):
    """`CBlock` of a block of a firmware.

    params    parameters; None where it has none
    optional  registers with the optional parts that the firmware has; None: those at reset
    """
    module = top if stem == top_bundle.STEM else registry.block_modules()[stem]
    d, runtime = program.design, block.runtime_params
    state = optional or block.state
    structure = {"rom": sine.table(d)} if module is top else registry.structure(module, d)
    kinds = {name: StaticValue(value) for name, value in structure.items()}
    state_fmt = formats(module.State, d, state)
    kinds["s"] = infer_kind(state)
    program.declare(kinds["s"], state_fmt)
    if params is not None:
        kinds["p"] = infer_kind(params)
        program.declare(kinds["p"], formats(module.Params, d, params))
    shapes = {"i": formats(top.Inputs, d)} if module is top else registry.shapes(module, d)
    for name, shape in shapes.items():
        kinds[name] = infer_kind(shape)
        program.declare(kinds[name], shape)
    outputs = ["pins"] if module is top else list(module.BLOCK.outputs)
    return CBlock(
        block, [] if runtime else _params(module, params, d), {**{k: kinds[k] for k in shapes}, **kinds}, runtime,
        _translate(program, module, "step", kinds), [_translate(program, module, name, kinds) for name in outputs],
    )  # fmt: skip


def translate_firmware(params):
    """(Program, [CBlock]) of every block and of the whole design of a firmware (`top.Params`)."""
    design = params.design
    program = Program(design)
    program.table(sine.table(design), sine.__name__, "table")
    state = registry.reset(top.reset(design), params)
    program.declare(infer_kind(state), formats(top.State, design, state))
    program.declare(infer_kind(params), formats(top.Params, design, params))
    c_blocks = []
    for stem, block in blocks.design_blocks(design).items():
        c_blocks.append(make(program, stem, block, next(iter(block.cases.values()))))
    top_block = top_bundle.build_top_block({"firmware": params}, design)
    c_blocks.append(make(program, top_bundle.STEM, top_block, params, state))
    for name in ("amplitude", "dac_init"):
        kinds = {"p": infer_kind(params.control), "s": infer_kind(state.control)}
        _translate(program, control, name, kinds)
    return program, c_blocks


# ---- text ------------------------------------------------------------------------------------------------------------


def _argument_code(name, kind, row, first):
    """(lines that copy a part of a row into a struct, text of the argument)."""
    if kind == NUMBER:
        return [], f"{row}[{first}]"
    if isinstance(kind, Record):
        return [f"    {kind.c_name} {name};", f"    memcpy(&{name}, {row} + {first}, sizeof {name});"], f"&{name}"
    return [], f"{row} + {first}"


def _arguments(c_block, names):
    """(lines, texts) of the arguments of a function of a block."""
    lines, texts, first = [], {}, 0
    for name, kind in c_block.kinds.items():
        if isinstance(kind, StaticValue):
            continue
        row, at = ("registers", 0) if name == "s" else ("params", 0)
        if name not in ("s", "p") or (name == "p" and c_block.runtime):
            row, at = "inputs", first
            first += number_count(kind)
        if name in names:
            more, texts[name] = _argument_code(name, kind, row, at)
            lines += more
    return lines, [texts[name] for name in names if name in texts]


ROW_PARAMETER_TEXT = "const int64_t *params, const int64_t *registers, const int64_t *inputs"
UNUSED = "    (void)params, (void)registers, (void)inputs;"


def _step_text(c_block):
    stem, kind = c_block.block.stem, c_block.step[1].result
    lines, texts = _arguments(c_block, c_block.step[0])
    head = f"static void {stem}_step({ROW_PARAMETER_TEXT}, int64_t *next)"
    call = f"    {c_block.step[1].name}({', '.join([*texts, '&after'])});"
    after = f"    {kind.c_name} after;"
    return "\n".join([f"{head} {{", *lines, after, UNUSED, call, "    memcpy(next, &after, sizeof after);", "}", ""])


def _show_text(c_block):
    stem, lines, at = c_block.block.stem, [], 0
    names = {name for used, _ in c_block.pins for name in used}
    copies, _ = _arguments(c_block, names)
    for k, (used, signature) in enumerate(c_block.pins):
        _, texts = _arguments(c_block, used)
        if aggregate(signature.result):
            lines += [
                f"    {signature.result.c_name} shown_{k};",
                f"    {signature.name}({', '.join([*texts, f'&shown_{k}'])});",
            ]
            lines += [f"    memcpy(pins + {at}, &shown_{k}, sizeof shown_{k});"]
        else:
            lines += [f"    pins[{at}] = {signature.name}({', '.join(texts)});"]
        at += number_count(signature.result)
    head = f"static void {stem}_show({ROW_PARAMETER_TEXT}, int64_t *pins)"
    return "\n".join([f"{head} {{", *copies, UNUSED.replace(";", ", (void)pins;"), *lines, "}", ""])


def _int64(value):
    return f"INT64_C({value})" if value >= 0 else f"-INT64_C({-value})"


def _table(stem, what, rows):
    """Text of a table of ports, and the entry that names it."""
    if not rows:
        return "", "{NULL, 0}"
    lines = [
        f'    {{"{name}", {width}, {signed}, {later}, {_int64(value)}}},' for name, width, signed, later, value in rows
    ]
    text = "\n".join([f"static const gyro_port {stem}_{what}[] = {{", *lines, "};", ""])
    return text, f"{{{stem}_{what}, {len(rows)}}}"


def _ports_text(c_block):
    """(tables of the ports, entry of the block)."""
    b, texts, entries = c_block.block, [], []
    param_rows = [(n, f.width, int(f.s), int(default is not None), default or 0) for n, f, _, default in c_block.params]
    tables = {"params": param_rows}
    for what, ports in (("inputs", b.inputs), ("registers", b.registers), ("pins", b.pins)):
        tables[what] = [(p.name, p.width, int(p.signed), 0, p.reset or 0) for p in ports]
    for what, rows in tables.items():
        text, entry = _table(b.stem, what, rows)
        texts.append(text)
        entries.append(entry)
    nominal = "NULL"
    if c_block.params:
        nominal = f"{b.stem}_nominal"
        values = ", ".join(_int64(value) for _, _, value, _ in c_block.params)
        texts.append(f"static const int64_t {nominal}[] = {{{values}}};\n")
    entry = f'    {{"{b.stem}", {", ".join(entries)}, {nominal}, {b.stem}_step, {b.stem}_show}},'
    return "\n".join(filter(None, texts)), entry


def _sizes(c_block):
    """Lines that do not compile if a struct is not as long as its row."""
    for kind in (c_block.kinds["s"], c_block.kinds.get("p")):
        if kind is not None:
            size = f"sizeof({kind.c_name}) == {number_count(kind)} * sizeof(int64_t)"
            yield f"typedef char {kind.c_name}_is_a_row[{size} ? 1 : -1];"


def text(program, c_blocks):
    """Text of blocks_of_design.c."""
    lines = ['#include "blocks.h"', *(f'#include "{c_block.block.stem}.h"' for c_block in c_blocks), ""]
    entries = []
    for c_block in c_blocks:
        port_tables, entry = _ports_text(c_block)
        entries.append(entry)
        lines += [*_sizes(c_block), port_tables, _step_text(c_block), _show_text(c_block)]
    usual = type(program.design)()
    keys = [f'    {{"{name}", {value}, {getattr(usual, name)}}},' for name, value in program.design._asdict().items()]
    lines += ["const gyro_block gyro_blocks[] = {", *entries, "};", ""]
    lines += ["const size_t gyro_block_count = sizeof gyro_blocks / sizeof gyro_blocks[0];", ""]
    lines += ["const gyro_key gyro_design[] = {", *keys, "};", ""]
    lines += ["const size_t gyro_design_count = sizeof gyro_design / sizeof gyro_design[0];", ""]
    return "\n".join(lines)
