"""Which sources a result depends on: the modules that an engine reaches by import, and their hash.

An edit of what computes changes the hash and with it the address of every point; an edit of a page, a bench or the
command line does not. Imports are read from the source, those inside functions included.
Source  docs/campaigns.md
"""

import ast
import functools
import hashlib
import importlib.util
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("fpga_model", "analog_frontend", "testbench")
# modules that import what they find in their folder
FINDERS = ("analog_frontend.effects.catalogue",)


def _path(module):
    """Source file of a dotted name, or None; what a package of ours names may be no module."""
    base = ROOT.joinpath(*module.split("."))
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    found = None if module.split(".")[0] in PACKAGES else importlib.util.find_spec(module)
    return Path(found.origin) if found and found.origin and found.origin.endswith(".py") else None


def _imported(path):
    """Dotted names that a source imports, `from a import b` as a and a.b, with all packages above them."""
    for node in ast.walk(ast.parse(path.read_bytes(), str(path))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            parts = name.split(".")
            if parts[0] in PACKAGES:
                yield from (".".join(parts[:n]) for n in range(1, len(parts) + 1))


@functools.cache
def reached(*modules):
    """Sorted dotted names of all modules of ours that these reach, themselves included."""
    seen, ahead = {}, [".".join(m.split(".")[:n]) for m in modules for n in range(1, m.count(".") + 2)]
    while ahead:
        module = ahead.pop()
        if module in seen or (path := _path(module)) is None:
            continue
        seen[module] = path
        ahead.extend(_imported(path))
        if module in FINDERS:
            ahead.extend(f"{module.rpartition('.')[0]}.{found.stem}" for found in path.parent.glob("*.py"))
    return tuple(sorted(seen))


@functools.cache
def code_sha256(*modules):
    """SHA-256 over names and bytes of the sources that these modules reach."""
    digest = hashlib.sha256()
    for module in reached(*modules):
        data = _path(module).read_bytes()
        digest.update(f"{module} {len(data)}\n".encode() + data)
    return digest.hexdigest()
