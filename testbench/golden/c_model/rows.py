"""Blocks in C with flat ports: `blocks_of_design.c`, in which a row of int64 stands for a struct.

All structs hold nothing but int64_t, so a row is copied into its struct and back; sizes are checked by the compiler.
"""

import inspect
from typing import NamedTuple

from fpga_model import block as registry
from fpga_model import control, sine, top
from fpga_model.fixed import formats
from testbench.golden.bundles import top as top_bundle
from testbench.golden.c_model.kinds import NUMBER, Known, Record, aggregate, count_of, kind_of
from testbench.golden.c_model.program import Program
from testbench.golden.stimulus import blocks


class Made(NamedTuple):
    """A block in C: its ports, kinds of its arguments by name, and its functions."""

    ports: blocks.Block
    params: list
    kinds: dict
    runtime: bool
    step: tuple
    pins: list


def _called(program, module, name, kinds):
    """(names of the arguments, `Signature`) of a function of a block."""
    names = list(inspect.signature(registry.python_of(getattr(module, name))).parameters)
    return names, program.function(getattr(module, name), tuple(kinds[key] for key in names))


def _params(module, like, design):
    """[(flat name, format, value, default or None)] of parameters."""
    if like is None:
        return []
    shape = formats(module.Params, design, like)
    added = registry.later(shape)
    values = dict(registry.leaves(like))
    return [(registry.flat(name), fmt, int(values[name]), added.get(name)) for name, fmt in registry.leaves(shape)]


def make(program, stem, ports, like, optional=None):
    """`Made` of a block of a firmware.

    like      parameters; None where it has none
    optional  registers with the optional parts that the firmware has; None: those at reset
    """
    module = top if stem == top_bundle.STEM else registry.declared()[stem]
    d, runtime = program.design, ports.runtime_params
    state = optional or ports.state
    structure = {"rom": sine.table(d)} if module is top else registry.structure(module, d)
    kinds = {name: Known(value) for name, value in structure.items()}
    state_fmt = formats(module.State, d, state)
    kinds["s"] = kind_of(state)
    program.declare(kinds["s"], state_fmt)
    if like is not None:
        kinds["p"] = kind_of(like)
        program.declare(kinds["p"], formats(module.Params, d, like))
    shapes = {"i": formats(top.Inputs, d)} if module is top else registry.shapes(module, d)
    for name, shape in shapes.items():
        kinds[name] = kind_of(shape)
        program.declare(kinds[name], shape)
    outputs = ["pins"] if module is top else list(module.BLOCK.outputs)
    return Made(
        ports, [] if runtime else _params(module, like, d), {**{k: kinds[k] for k in shapes}, **kinds}, runtime,
        _called(program, module, "step", kinds), [_called(program, module, name, kinds) for name in outputs],
    )  # fmt: skip


def of_firmware(params):
    """(Program, [Made]) of every block and of the whole design of a firmware (`top.Params`)."""
    design = params.design
    program = Program(design)
    program.table(sine.table(design), sine.__name__, "table")
    state = registry.reset(top.reset(design), params)
    program.declare(kind_of(state), formats(top.State, design, state))
    program.declare(kind_of(params), formats(top.Params, design, params))
    made = []
    for stem, found in blocks.design_blocks(design).items():
        made.append(make(program, stem, found, next(iter(found.cases.values()))))
    whole = top_bundle.block({"firmware": params}, design)
    made.append(make(program, top_bundle.STEM, whole, params, state))
    for name in ("amplitude", "dac_init"):
        kinds = {"p": kind_of(params.control), "s": kind_of(state.control)}
        _called(program, control, name, kinds)
    return program, made


# ---- text ------------------------------------------------------------------------------------------------------------


def _unpacked(name, kind, row, first):
    """(lines that copy a part of a row into a struct, text of the argument)."""
    if kind == NUMBER:
        return [], f"{row}[{first}]"
    if isinstance(kind, Record):
        return [f"    {kind.c_name} {name};", f"    memcpy(&{name}, {row} + {first}, sizeof {name});"], f"&{name}"
    return [], f"{row} + {first}"


def _arguments(made, names):
    """(lines, texts) of the arguments of a function of a block."""
    lines, texts, first = [], {}, 0
    for name, kind in made.kinds.items():
        if isinstance(kind, Known):
            continue
        row, at = ("registers", 0) if name == "s" else ("params", 0)
        if name not in ("s", "p") or (name == "p" and made.runtime):
            row, at = "inputs", first
            first += count_of(kind)
        if name in names:
            more, texts[name] = _unpacked(name, kind, row, at)
            lines += more
    return lines, [texts[name] for name in names if name in texts]


GIVEN = "const int64_t *params, const int64_t *registers, const int64_t *inputs"
UNUSED = "    (void)params, (void)registers, (void)inputs;"


def _step_text(made):
    stem, kind = made.ports.stem, made.step[1].result
    lines, texts = _arguments(made, made.step[0])
    head = f"static void {stem}_step({GIVEN}, int64_t *next)"
    call = f"    {made.step[1].name}({', '.join([*texts, '&after'])});"
    after = f"    {kind.c_name} after;"
    return "\n".join([f"{head} {{", *lines, after, UNUSED, call, "    memcpy(next, &after, sizeof after);", "}", ""])


def _show_text(made):
    stem, lines, at = made.ports.stem, [], 0
    names = {name for used, _ in made.pins for name in used}
    copies, _ = _arguments(made, names)
    for k, (used, found) in enumerate(made.pins):
        _, texts = _arguments(made, used)
        if aggregate(found.result):
            lines += [
                f"    {found.result.c_name} shown_{k};",
                f"    {found.name}({', '.join([*texts, f'&shown_{k}'])});",
            ]
            lines += [f"    memcpy(pins + {at}, &shown_{k}, sizeof shown_{k});"]
        else:
            lines += [f"    pins[{at}] = {found.name}({', '.join(texts)});"]
        at += count_of(found.result)
    head = f"static void {stem}_show({GIVEN}, int64_t *pins)"
    return "\n".join([f"{head} {{", *copies, UNUSED.replace(";", ", (void)pins;"), *lines, "}", ""])


def _number(value):
    return f"INT64_C({value})" if value >= 0 else f"-INT64_C({-value})"


def _table(stem, what, rows):
    """Text of a table of ports, and the entry that names it."""
    if not rows:
        return "", "{NULL, 0}"
    lines = [
        f'    {{"{name}", {width}, {signed}, {later}, {_number(value)}}},' for name, width, signed, later, value in rows
    ]
    text = "\n".join([f"static const gyro_port {stem}_{what}[] = {{", *lines, "};", ""])
    return text, f"{{{stem}_{what}, {len(rows)}}}"


def _ports_text(made):
    """(tables of the ports, entry of the block)."""
    b, texts, entries = made.ports, [], []
    params = [(n, f.width, int(f.s), int(default is not None), default or 0) for n, f, _, default in made.params]
    tables = {"params": params}
    for what, ports in (("inputs", b.inputs), ("registers", b.registers), ("pins", b.pins)):
        tables[what] = [(p.name, p.width, int(p.signed), 0, p.reset or 0) for p in ports]
    for what, rows in tables.items():
        text, entry = _table(b.stem, what, rows)
        texts.append(text)
        entries.append(entry)
    nominal = "NULL"
    if made.params:
        nominal = f"{b.stem}_nominal"
        values = ", ".join(_number(value) for _, _, value, _ in made.params)
        texts.append(f"static const int64_t {nominal}[] = {{{values}}};\n")
    entry = f'    {{"{b.stem}", {", ".join(entries)}, {nominal}, {b.stem}_step, {b.stem}_show}},'
    return "\n".join(filter(None, texts)), entry


def _sizes(made):
    """Lines that do not compile if a struct is not as long as its row."""
    for kind in (made.kinds["s"], made.kinds.get("p")):
        if kind is not None:
            size = f"sizeof({kind.c_name}) == {count_of(kind)} * sizeof(int64_t)"
            yield f"typedef char {kind.c_name}_is_a_row[{size} ? 1 : -1];"


def text(program, made):
    """Text of blocks_of_design.c."""
    lines = ['#include "blocks.h"', *(f'#include "{found.ports.stem}.h"' for found in made), ""]
    entries = []
    for found in made:
        ports, entry = _ports_text(found)
        entries.append(entry)
        lines += [*_sizes(found), ports, _step_text(found), _show_text(found)]
    usual = type(program.design)()
    keys = [f'    {{"{name}", {value}, {getattr(usual, name)}}},' for name, value in program.design._asdict().items()]
    lines += ["const gyro_block gyro_blocks[] = {", *entries, "};", ""]
    lines += ["const size_t gyro_block_count = sizeof gyro_blocks / sizeof gyro_blocks[0];", ""]
    lines += ["const gyro_key gyro_design[] = {", *keys, "};", ""]
    lines += ["const size_t gyro_design_count = sizeof gyro_design / sizeof gyro_design[0];", ""]
    return "\n".join(lines)
