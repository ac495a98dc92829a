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
    "deg_s": "deg/s",
    "rad_s": "rad/s",
    "v_s": "V s",
    "degc": "degC",
    "ticks": "ticks of 1 us",
    "percent": "%",
    **{unit: unit for unit in ("s", "ns", "deg", "rad", "m", "um", "ppm", "ohm", "kg")},
    **{unit.lower(): unit for unit in ("Hz", "V", "F", "K", "C")},
}
WIDTH = 100  # characters of a signature on one line
EXTRAS = {}  # {module: function -> Markdown behind its docstring}; docs/conf.py fills it


def modules():
    """{dotted name: path} of what has a page."""
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")] + [
        ROOT / "testbench" / name for name in PUBLIC
    ]
    named = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}
    return {name: path for name, path in sorted(named.items()) if path.name != "__init__.py"}


def described_arguments(node, names):
    """({argument: description}, docstring without these lines): lines `name  text` and what continues them."""
    descriptions, rest, current = {}, [], ()
    for line in (ast.get_docstring(node) or "").split("\n"):
        found = re.match(r"\s*(\w+(?:, \w+)*) {2,}(\S.*)", line)
        if found and set(found[1].split(", ")) <= set(names):
            current = found[1].split(", ")
            descriptions |= dict.fromkeys(current, found[2])
        elif current and line.startswith("  "):
            descriptions |= {name: f"{descriptions[name]} {line.strip()}" for name in current}
        else:
            current = ()
            rest.append(line)
    return descriptions, "\n".join(rest)


def prose(node, raw=None):
    """Markdown of the docstring of a module, class or function: what is indented or in columns stays as it is."""
    raw = ast.get_docstring(node, clean=False) or "" if raw is None else raw
    indent = " " * (getattr(node, "col_offset", -4) + 4)
    parts = []
    for part in "\n".join(line.removeprefix(indent).rstrip() for line in raw.split("\n")).strip().split("\n\n"):
        lines = part.split("\n")
        first = next((k for k, line in enumerate(lines) if line.startswith(" ") or "  " in line.strip()), len(lines))
        if first:
            parts.append(escaped("\n".join(lines[:first])))
        if first < len(lines):
            aligned = textwrap.dedent("\n".join(lines[first:])).replace("`", "")
            parts.append(f"```text\n{aligned}\n```")
    return "\n\n".join(parts)


def escaped(text):
    """Plain text as Markdown: products and names keep their asterisks and underscores, `code` stays code."""
    pieces = re.split(r"(`[^`]*`)", text)
    return "".join(re.sub(r"([\\*_<\[$])", r"\\\1", p) if k % 2 == 0 else p for k, p in enumerate(pieces))


def constructor(node):
    """`__init__` of a class, or None."""
    return next((n for n in node.body if isinstance(n, ast.FunctionDef) and n.name == "__init__"), None)


def call(name, node):
    """`name(arguments)` without self, one argument to a line where they are too many for one."""
    arguments = re.sub(r"^(self|cls)(, |$)", "", ast.unparse(node.args))
    if len(name) + len(arguments) <= WIDTH:
        return f"{name}({arguments})"
    return f"{name}(\n    {arguments.replace(', ', f',{chr(10)}    ')}\n)"


def signature(node, lines, owner=""):
    """`name(arguments)` of a function; of a record its name and fields, each with its comment: that holds the unit."""
    if isinstance(node, ast.FunctionDef):
        name = f"{owner}.{node.name}" if owner else node.name
        is_property = any(ast.unparse(d) in ("property", "functools.cached_property") for d in node.decorator_list)
        return name if is_property else call(name, node)
    if begin := constructor(node):
        return f"class {call(node.name, begin)}"
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


def arguments_of(node):
    """Names of a function's arguments with their defaults as text, "" for none."""
    plain = [*node.args.posonlyargs, *node.args.args]
    defaults = dict(zip([a.arg for a in plain[::-1]], node.args.defaults[::-1]))
    defaults |= {a.arg: d for a, d in zip(node.args.kwonlyargs, node.args.kw_defaults) if d is not None}
    names = [a.arg for a in (*plain, *node.args.kwonlyargs) if a.arg not in ("self", "cls")]
    return {name: f"`{ast.unparse(defaults[name])}`" if name in defaults else "" for name in names}


def described(node, function):
    """Markdown of a docstring, then a table of the function's arguments: unit, default, meaning."""
    defaults = arguments_of(function)
    descriptions, rest = described_arguments(node, defaults)
    if not descriptions and not any(map(unit_of, defaults)):
        return prose(node)
    columns = {
        "argument": [f"`{name}`" for name in defaults],
        "unit": [unit_of(name) for name in defaults],
        "default": list(defaults.values()),
        "meaning": [escaped(descriptions.get(name, "")).replace("|", "\\|") for name in defaults],
    }
    columns = {head: cells for head, cells in columns.items() if any(cells)}
    rows = [tuple(columns), ("---",) * len(columns), *zip(*columns.values())]
    return f"{prose(node, rest)}\n\n" + "\n".join(f"| {' | '.join(row)} |" for row in rows)


def members(body, owner=""):
    """(class, node) of public functions and classes that have a docstring; methods behind their class."""
    for node in body:
        is_public = isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_")
        if is_public and not any(ast.unparse(d).endswith(".setter") for d in node.decorator_list):
            if ast.get_docstring(node):
                yield owner, node
            if isinstance(node, ast.ClassDef):
                yield from members(node.body, node.name)


def split_source(docstring):
    """(docstring without its line `Source  ...`, that line as Markdown with links to pages of docs)."""
    found = re.search(r"^Source +(.*(?:\n +.*)*)\n?", docstring, re.M)
    if not found:
        return docstring, ""
    text = " ".join(found[1].split())
    linked = re.sub(r"docs/([\w/-]+\.md)", r"[\1](../\1)", escaped(text))
    return docstring.replace(found[0], ""), f"Source: {linked}"


def page(name, path):
    """Markdown of a module."""
    source = path.read_text()
    tree = ast.parse(source)
    docstring, source_line = split_source(ast.get_docstring(tree, clean=False) or "")
    lines = [f"# {name.rpartition('.')[2]}", f"`{name}`", prose(tree, docstring), source_line]
    if name in EXTRAS:
        lines.append(EXTRAS[name]())
    for owner, node in members(tree.body):
        heading = f"### {owner}.{node.name}" if owner else f"## {node.name}"
        lines += [heading, f"```python\n{signature(node, source.splitlines(), owner)}\n```"]
        function = node if isinstance(node, ast.FunctionDef) else constructor(node)
        lines.append(described(node, function) if function else prose(node))
    return "\n\n".join(filter(None, lines)) + "\n"


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
