"""Statements of a kernel in C, and with them a whole function.

A local name is declared where it is first assigned, and unknown again behind the block of that place. One that stands
for a record is a pointer: kernels never change what they have made.
"""

import ast
import re
from typing import NamedTuple

from testbench.golden.c_model.c_kinds import NUMBER, StaticValue, aggregate, c_name
from testbench.golden.c_model.expressions import Expressions, Unsupported, Value, address, bare


class Signature(NamedTuple):
    """A function in C: kinds of the Python arguments, kind of the result, and its text."""

    name: str
    kinds: tuple
    result: object
    head: str
    text: str


def _uses(nodes, name):
    return sum(isinstance(part, ast.Name) and part.id == name for node in nodes for part in ast.walk(node))


class Body(Expressions):
    """One function of given kinds of arguments."""

    def __init__(self, program, func, tree):
        super().__init__(program, func.__module__, func.__globals__)
        self.tree, self.results, self.declared = tree, [], set()
        stored = [part for part in ast.walk(tree) if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)]
        self.local = {part.id for part in stored}

    def _add_result_kind(self, kind):
        if self.results and self.results[0] != kind:
            raise Unsupported(f"{self.tree.name}: its results have two kinds")
        self.results.append(kind)

    # ---- blocks ------------------------------------------------------------------------------------------------------

    def write_statements(self, statements):
        """Write statements; True if they return."""
        for statement in statements:
            if isinstance(statement, ast.Return):
                self._return(statement.value)
                return True
            if isinstance(statement, ast.If):
                if self._if(statement):
                    return True
            elif isinstance(statement, ast.Assign) and len(statement.targets) == 1:
                self._assign(statement.targets[0], statement.value)
            elif isinstance(statement, ast.AugAssign):
                both = ast.BinOp(ast.Name(statement.target.id, ast.Load()), statement.op, statement.value)
                self._assign(statement.target, both)
            elif not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)):
                raise Unsupported(ast.unparse(statement))
        return False

    def _write_block(self, statements):
        """A block of its own: what it declares ends with it."""
        declared, env = set(self.declared), dict(self.env)
        self.depth += 1
        ended = self.write_statements(statements)
        self.depth -= 1
        self.declared, self.env = declared, env
        return ended

    def _if(self, statement):
        """True if both ways return, or the one that is known to be taken."""
        test = self.test(statement.test)
        if isinstance(test, bool):
            return self.write_statements(statement.body if test else statement.orelse)
        self.line(f"if ({bare(test)}) {{")
        ended = self._write_block(statement.body)
        return self._otherwise(statement.orelse) and ended

    def _otherwise(self, statements):
        """The other way of an `if`; an `elif` is written as one where its condition makes nothing."""
        ended = True
        while len(statements) == 1 and isinstance(statements[0], ast.If):
            before = len(self.lines)
            test = self.test(statements[0].test)
            if isinstance(test, bool) or len(self.lines) > before:
                del self.lines[before:]
                break
            self.line(f"}} else if ({bare(test)}) {{")
            ended &= self._write_block(statements[0].body)
            statements = statements[0].orelse
        if not statements:
            self.line("}")
            return False
        self.line("} else {")
        ended &= self._write_block(statements)
        self.line("}")
        return ended

    def _return(self, node):
        kind = self.kind(node)
        self._add_result_kind(kind)
        if isinstance(kind, StaticValue):
            return
        if aggregate(kind):
            self.fill("result", kind, node)
            self.line("return;")
        else:
            self.line(f"return {bare(self.number(node))};")

    # ---- names -------------------------------------------------------------------------------------------------------

    def _assign(self, target, node):
        if isinstance(target, ast.Tuple):
            self._assign_all(target.elts, node)
        elif isinstance(target, ast.Name):
            kind = self.kind(node)
            if isinstance(kind, StaticValue):
                self.env[target.id] = Value(kind)
            else:
                self._set(target.id, self.value(node))
        else:
            raise Unsupported(ast.unparse(target))

    def _set(self, name, value):
        """Give a local name a value."""
        local = c_name(name)
        if isinstance(self.env.get(name, value).kind, StaticValue) or self.env.get(name, value).kind != value.kind:
            raise Unsupported(f"{self.tree.name}: {name} has two kinds")
        text = bare(value.text)
        if name in self.declared:
            self.line(f"{local} = {text};")
        else:
            star = f"const {value.kind.c_name} *" if aggregate(value.kind) else "int64_t "
            self.line(f"{star}{local} = {text};")
            self.declared.add(name)
        self.env[name] = Value(value.kind, local)

    def _assign_all(self, targets, node):
        """Several names at once; values that a name before them changes are taken first."""
        if not isinstance(node, ast.Tuple):
            sequence_value = self.value(node)
            element_kind = sequence_value.kind.of
            for k, target in enumerate(targets):
                self._set(target.id, Value(element_kind, address(element_kind, f"{sequence_value.text}[{k}]")))
            return
        names = [target.id for target in targets]
        hazard = any(_uses([part], name) for k, part in enumerate(node.elts) for name in names[:k])
        if not hazard:
            for target, part in zip(targets, node.elts, strict=True):
                self._assign(target, part)
            return
        values = []
        for name, part in zip(names, node.elts, strict=True):
            element_value = self.value(part)
            if element_value.kind != NUMBER:
                raise Unsupported(ast.unparse(node))
            self.scratch.append(f"int64_t new_{c_name(name)};")
            self.line(f"new_{c_name(name)} = {bare(element_value.text)};")
            values.append(Value(NUMBER, f"new_{c_name(name)}"))
        for name, value in zip(names, values):
            self._set(name, value)

    # ---- the function ------------------------------------------------------------------------------------------------

    def function(self, name, kinds):
        """`Signature` of the function for arguments of these kinds."""
        heads, unused = [], []
        for item, kind in zip(self.tree.args.args, kinds, strict=True):
            local = c_name(item.arg)
            self.env[item.arg] = Value(kind, local)
            self.declared.add(item.arg)
            if isinstance(kind, StaticValue):
                continue
            heads.append(f"const {kind.c_name} *{local}" if aggregate(kind) else f"int64_t {local}")
            unused.append((item.arg, local))
        if not self.write_statements(self.tree.body):
            raise Unsupported(f"{self.tree.name}: a path through it returns nothing")
        result = self.results[0]
        if isinstance(result, StaticValue):
            return Signature(name, kinds, result, "", "")
        if aggregate(result):
            heads.append(f"{result.c_name} *result")
        head = f"{'void' if aggregate(result) else 'int64_t'} {name}({', '.join(heads) or 'void'})"
        if self.lines and self.lines[-1] == "    return;":
            self.lines.pop()
        written = "\n".join(self.lines)
        idle = [f"    (void){local};" for _, local in unused if not _mentions(written, local)]
        scratch = [f"    {text}" for text in dict.fromkeys(self.scratch)]
        note = (ast.get_docstring(self.tree) or "").split("\n")[0]
        comment = f"/* {note} */\n" if note else ""
        body = "\n".join([*scratch, *idle, written])
        return Signature(name, kinds, result, head, f"{comment}inline {head} {{\n{body}\n}}\n")


def _mentions(text, name):
    return re.search(rf"\b{name}\b", text) is not None
