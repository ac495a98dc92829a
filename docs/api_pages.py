"""Pages of the public functions and classes, read from the sources: signature and docstring, nothing is imported.

    write(folder)    one Markdown page per module of PACKAGES and PUBLIC; pages that are no longer wanted go

Numba's dispatchers hide signatures from tools that import; a syntax tree does not.
Source  docs/api.md
"""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("fpga_model", "analog_frontend")
PUBLIC = ("config/load.py", "run/simulate.py", "run/simulation.py", "run/budget.py", "errors.py")  # of testbench


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
        parts.append(f"```text\n{part}\n```" if aligned else part.replace("*", r"\*").replace("_", r"\_"))
    return "\n\n".join(parts)


def signature(node, lines):
    """`name(arguments)` of a function; of a record its name and fields, each with its comment: that holds the unit."""
    if isinstance(node, ast.FunctionDef):
        return f"{node.name}({ast.unparse(node.args)})"
    fields = [item for item in node.body if isinstance(item, ast.AnnAssign)]
    return "\n".join([f"class {node.name}", *("\n".join(lines[f.lineno - 1 : f.end_lineno]) for f in fields)])


def members(body):
    """Public functions and classes, methods behind their class."""
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from members(node.body)


def page(name, path):
    """Markdown of a module."""
    source = path.read_text()
    tree = ast.parse(source)
    lines = [f"# {name}", prose(tree)]
    for node in members(tree.body):
        lines += [f"## {node.name}", f"```python\n{signature(node, source.splitlines())}\n```", prose(node)]
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
