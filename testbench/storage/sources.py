"""Which sources a result depends on: the modules that an engine reaches by import, and their hash.

An edit of what computes changes the hash and with it the address of every point; an edit of a page, a bench or the
command line does not. Imports are read from the source, those inside functions included.
Source  docs/campaigns.md
"""

import functools
import hashlib
import importlib.util
from pathlib import Path

from fpga_model import kernel_cache

# modules that import what they find in their folder
FINDERS = ("analog_frontend.effects.catalogue",)


def _path(module):
    """Source file of a dotted name, or None; what a package of ours names may be no module."""
    base = kernel_cache.ROOT.joinpath(*module.split("."))
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    spec = None if module.split(".")[0] in kernel_cache.PACKAGES else importlib.util.find_spec(module)
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


def _module(path):
    """Dotted name of a source of ours."""
    return ".".join(path.relative_to(kernel_cache.ROOT).with_suffix("").parts).removesuffix(".__init__")


@functools.cache
def reachable_modules(*modules):
    """Sorted dotted names of all modules of ours that these reach, themselves included."""
    path_by_module, ahead = {}, [".".join(m.split(".")[:n]) for m in modules for n in range(1, m.count(".") + 2)]
    while ahead:
        module = ahead.pop()
        if module in path_by_module or (path := _path(module)) is None:
            continue
        path_by_module[module] = path
        imported_paths = [*kernel_cache.direct_imports(path), *(path.parent.glob("*.py") if module in FINDERS else ())]
        ahead.extend(_module(source) for source in imported_paths)
    return tuple(sorted(path_by_module))


@functools.cache
def code_sha256(*modules):
    """SHA-256 over names and bytes of the sources that these modules reach."""
    return bytes_sha256(reachable_modules(*modules))


def bytes_sha256(modules):
    """SHA-256 over names and bytes of modules of ours, and of no other."""
    digest = hashlib.sha256()
    for module in modules:
        data = _path(module).read_bytes()
        digest.update(f"{module} {len(data)}\n".encode() + data)
    return digest.hexdigest()
