"""All of a firmware in C: what each module of `fpga_model` needs of constants, tables, structs and functions.

A function is written when it is first called, once for each kind of its arguments, and so stands behind what it calls.
"""

import inspect
import re
from dataclasses import dataclass, field

from fpga_model.block import python_function
from fpga_model.fixed import formats
from testbench.golden.c_model.body import Body
from testbench.golden.c_model.c_kinds import Array, Record, StaticValue, c_name, infer_kind, prefix
from testbench.golden.c_model.expressions import Unsupported, literal
from testbench.golden.ranges.interpreter import read_function_source

DESIGN = "design"


@dataclass
class Part:
    """What a module has in C: {name: text} in order, but for functions and structs, which are texts in order."""

    constants: dict = field(default_factory=dict)
    structs: dict = field(default_factory=dict)
    tables: dict = field(default_factory=dict)
    functions: list = field(default_factory=list)

    @property
    def header(self):
        """All texts of the header."""
        declarations = [f"#define {name} {text}" for name, text in self.constants.items()]
        declarations += [f"extern const int64_t {name}[{len(words)}];" for name, words in self.tables.items()]
        header_sections = [
            "\n".join(declarations) + "\n",
            *self.structs.values(),
            *(function.text for function in self.functions),
        ]
        return "\n".join(header_sections)


class Program:
    """The C of a design record; `record` must know each NamedTuple whose shape depends on the configuration."""

    def __init__(self, design):
        self.design = design
        self.parts, self.signatures, self.records, self.tables, self.used_names = {}, {}, {}, {}, set()

    def part(self, module):
        return self.parts.setdefault(module.rpartition(".")[2], Part())

    # ---- constants and tables ----------------------------------------------------------------------------------------

    def constant(self, module, name, value):
        """Name of a constant of a module."""
        text = f"{prefix(module)}_{name}".upper().replace(".", "_").replace("__", "_")
        self.part(module).constants[text] = f"INT64_C({value})" if value >= 0 else f"(-INT64_C({-value}))"
        return text

    def key(self, name):
        """Name of a key of the design record."""
        return self.constant(f"fpga_model.{DESIGN}", name, getattr(self.design, name))

    def table(self, words, module, name):
        """Name of a table of integers; the first that uses it gives it."""
        if id(words) not in self.tables:
            text = f"{prefix(module)}_{name}".lower().replace("__", "_")
            self.part(module).tables[text] = [int(word) for word in words]
            self.tables[id(words)] = text, words  # kept, so that the id stays its own
        return self.tables[id(words)][0]

    # ---- records -----------------------------------------------------------------------------------------------------

    def declare(self, kind, shape=None):
        """Write the struct of a kind, with formats as comments where a shape of formats has them."""
        if isinstance(kind, Array):
            self.declare(kind.of, shape and shape[0])
            return
        if not isinstance(kind, Record) or kind.type in self.records:
            return
        lines = []
        for name, item in kind.members:
            fmt = getattr(shape, name, None)
            self.declare(item, fmt)
            size, of = (f"[{item.count}]", fmt and fmt[0]) if isinstance(item, Array) else ("", fmt)
            note = f" /* {of} */" if type(of).__name__ == "Fmt" else ""
            lines.append(f"    {item.c_name} {c_name(name)}{size};{note}")
        self.records[kind.type] = kind
        struct = kind.c_name
        self.part(kind.type.__module__).structs[struct] = "\n".join(["typedef struct {", *lines, f"}} {struct};\n"])

    def record(self, of):
        """Kind of a NamedTuple."""
        if of not in self.records:
            shape = formats(of, self.design)
            self.declare(infer_kind(shape), shape)
        return self.records[of]

    # ---- functions ---------------------------------------------------------------------------------------------------

    def function(self, func, kinds):
        """`Signature` of a function of a kernel for kinds of arguments, written once."""
        func = python_function(func)
        key = func, kinds
        if key not in self.signatures:
            if not inspect.isfunction(func):
                raise Unsupported(f"call of {func!r}")
            for kind in kinds:
                if not isinstance(kind, StaticValue):
                    self.declare(kind)
            plain = f"{prefix(func.__module__)}_{func.__name__.lstrip('_')}"
            names = (plain if n == 1 else f"{plain}_{n}" for n in range(1, 100))
            name = next(name for name in names if name not in self.used_names)
            self.used_names.add(name)
            try:
                self.signatures[key] = Body(self, func, read_function_source(func).tree).function(name, kinds)
            except (Unsupported, AttributeError, KeyError) as error:
                raise Unsupported(f"{func.__module__}.{func.__name__}: {error}") from error
            if self.signatures[key].text:
                self.part(func.__module__).functions.append(self.signatures[key])
        return self.signatures[key]

    # ---- texts -------------------------------------------------------------------------------------------------------

    def includes(self, stem, text):
        """Stems of the parts that a text names."""
        names = "|".join(sorted(map(re.escape, self.parts), key=len, reverse=True))
        part_stems = {name.lower() for name in re.findall(rf"\bgyro_({names})_", text, re.I)}
        return sorted(part_stems - {stem})

    def header(self, stem):
        """Text of STEM.h."""
        text = self.parts[stem].header
        guard = f"GYRO_{stem.upper()}_H"
        lines = [f"#ifndef {guard}", f"#define {guard}", "", '#include "integers.h"']
        lines += [f'#include "{name}.h"' for name in self.includes(stem, text)]
        linkage = ["#ifdef __cplusplus", 'extern "C" {', "#endif"], ["#ifdef __cplusplus", "}", "#endif"]
        return "\n".join([*lines, "", *linkage[0], "", text.strip(), "", *linkage[1], "", "#endif", ""])

    def source(self, stem):
        """Text of STEM.c: tables, and the functions for a linker."""
        part = self.parts[stem]
        lines = [f'#include "{stem}.h"', ""]
        for name, words in part.tables.items():
            rows = [", ".join(literal(word) for word in words[k : k + 8]) for k in range(0, len(words), 8)]
            lines += [f"const int64_t {name}[{len(words)}] = {{", *(f"    {row}," for row in rows), "};", ""]
        lines += [f"extern inline {signature.head};" for signature in part.functions]
        return "\n".join([*lines, ""])
