"""Pages of modules, read from the sources: docstring, ports of a block, facts of an effect, functions and classes.

    write(folder)    one Markdown page per module of PACKAGES and PUBLIC; pages that are no longer wanted go

Numba's dispatchers hide signatures from tools that import; a syntax tree does not.
Source  docs/api.md
"""

import ast
import re
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("fpga_model", "analog_frontend")
PUBLIC = ("config/load.py", "run/simulate.py", "run/simulation.py", "run/budget.py", "errors.py")  # of testbench
# unit by the end of an argument's name, as docs/conventions.md has it
UNITS = {
    "dps": "deg/s",
    "rad_s": "rad/s",
    "degc": "degC",
    "ticks": "ticks of 1 us",
    "percent": "%",
    **{unit: unit for unit in ("s", "ns", "deg", "rad", "m", "um", "ppm", "ohm", "kg")},
    **{unit.lower(): unit for unit in ("Hz", "V", "N", "F", "K")},
}
EXTRAS = {}  # {module: function -> Markdown behind its docstring}; docs/conf.py fills it


def modules():
    """{dotted name: path} of what has a page."""
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")] + [
        ROOT / "testbench" / name for name in PUBLIC
    ]
    named = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}
    return {name: path for name, path in sorted(named.items()) if ast.parse(path.read_text()).body}


def prose(node):
    """Markdown of the docstring of a module, class or function: what is indented or in columns stays as it is."""
    raw = ast.get_docstring(node, clean=False) or ""
    indent = " " * (getattr(node, "col_offset", -4) + 4)
    parts = []
    for part in "\n".join(line.removeprefix(indent).rstrip() for line in raw.split("\n")).strip().split("\n\n"):
        aligned = any(line.startswith(" ") or "  " in line for line in part.splitlines())
        parts.append(f"```text\n{textwrap.dedent(part)}\n```" if aligned else escaped(part))
    return "\n\n".join(parts)


def escaped(text):
    """Plain text as Markdown: products and names keep their asterisks and underscores, `code` stays code."""
    pieces = re.split(r"(`[^`]*`)", text)
    return "".join(re.sub(r"([\\*_<\[$])", r"\\\1", p) if k % 2 == 0 else p for k, p in enumerate(pieces))


def signature(node, lines):
    """`name(arguments)` of a function; of a record its name and fields, each with its comment: that holds the unit."""
    if isinstance(node, ast.FunctionDef):
        return f"{node.name}({ast.unparse(node.args)})"
    fields = [item for item in node.body if isinstance(item, ast.AnnAssign)]
    return "\n".join([f"class {node.name}", *("\n".join(lines[f.lineno - 1 : f.end_lineno]) for f in fields)])


def unit_of(name):
    """Unit that the end of a name says, or ""."""
    if "_per_" in name:
        return "1/s" if name.endswith("_per_s") and name.count("_") == 2 else ""
    for length in (2, 1):
        end = "_".join(name.split("_")[-length:])
        if end in UNITS and end != name:
            return UNITS[end]
    return UNITS["ticks"] if name == "ticks" else ""


def arguments_table(node):
    """Markdown table of a function's arguments with unit and default; "" where nothing is known of any."""
    every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    plain = [*node.args.posonlyargs, *node.args.args]
    defaults = dict(zip([a.arg for a in plain[::-1]], node.args.defaults[::-1]))
    defaults |= {a.arg: d for a, d in zip(node.args.kwonlyargs, node.args.kw_defaults) if d is not None}
    rows = [
        (f"`{a.arg}`", unit_of(a.arg), f"`{ast.unparse(defaults[a.arg])}`" if a.arg in defaults else "")
        for a in every
        if a.arg not in ("self", "cls")
    ]
    if not any(unit for _, unit, _ in rows):
        return ""
    return "\n".join(["| argument | unit | default |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in rows)])


def members(body, owner=""):
    """(heading, node) of public functions and classes; methods, one level lower, behind their class."""
    for node in body:
        is_public = isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_")
        if is_public and not any(ast.unparse(d).endswith(".setter") for d in node.decorator_list):
            yield f"### {owner}.{node.name}" if owner else f"## {node.name}", node
            if isinstance(node, ast.ClassDef):
                yield from members(node.body, node.name)


def page(name, path):
    """Markdown of a module."""
    source = path.read_text()
    tree = ast.parse(source)
    lines = [f"# {name}", prose(tree)]
    if name in EXTRAS:
        lines.append(EXTRAS[name]())
    for heading, node in members(tree.body):
        lines += [heading, f"```python\n{signature(node, source.splitlines())}\n```"]
        if isinstance(node, ast.FunctionDef) and (table := arguments_table(node)):
            lines.append(table)
        lines.append(prose(node))
    return "\n\n".join(lines) + "\n"


def write(folder):
    """Write all pages into `folder`; what has not changed is left alone."""
    folder.mkdir(parents=True, exist_ok=True)
    pages = {f"{name}.md": page(name, path) for name, path in modules().items()}
    for path in folder.glob("*.md"):
        if path.name not in pages:
            path.unlink()
    for name, text in pages.items():
        if not (folder / name).exists() or (folder / name).read_text() != text:
            (folder / name).write_text(text)
