"""What a function is compiled from as it stands in this process: code and constants behind every name that it reaches.

The folder of a cached kernel is named by sources on disk. A process may have bound a name to something else: another
part in the place of ours, another constant. Its machine code is that of neither source, and must not be kept as such.
Source  docs/decisions/0015-compile-units.md
"""

import hashlib
import sys
from types import CodeType, FunctionType, ModuleType

import numpy as np

# not looked into: versions of the first are in the key; an assert that pytest rewrites names the last
LIBRARIES = sys.stdlib_module_names | {"numpy", "numba", "llvmlite", "_pytest"}
_codes, _read, _compiled = {}, {}, {}


def _digest_code(code):
    """(digest of the instructions, names that they use), those of functions inside included."""
    if code not in _codes:
        names, digest = set(code.co_names), hashlib.sha256(code.co_code)
        for item in code.co_consts:
            if isinstance(item, CodeType):
                inside, more = _digest_code(item)
                names |= more
                digest.update(inside.encode())
            else:
                digest.update(repr(item).encode())
        digest.update(" ".join(code.co_names).encode())
        _codes[code] = digest.hexdigest(), names
    return _codes[code]


def _reachable_values(dotted_path, value, names):
    """(path, value) behind a name; behind that of a module of ours, what of it has one of the other names."""
    if not isinstance(value, ModuleType):
        yield dotted_path, value
    elif value.__name__.partition(".")[0] not in LIBRARIES:
        for name in sorted(names & vars(value).keys()):
            yield from _reachable_values(f"{dotted_path}.{name}", vars(value)[name], names - {name})


def _bound(function):
    """[(path, value)] of all that the code of a function names."""
    names, global_values = _digest_code(function.__code__)[1], function.__globals__
    bound_pairs = [("", cell.cell_contents) for cell in function.__closure__ or ()]
    for name in sorted(names & global_values.keys()):
        bound_pairs += _reachable_values(name, global_values[name], names)
    return bound_pairs


def _describe(value, functions):
    """Text that tells a value from others; functions are put into their list, to be read."""
    value = getattr(value, "py_func", value)
    if isinstance(value, FunctionType):
        functions.append(value)
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, (tuple, list)):
        return f"({', '.join(_describe(item, functions) for item in value)})"
    if value is None or isinstance(value, (bool, int, float, str, bytes, np.generic)):
        return repr(value)
    return f"{type(value).__qualname__} {getattr(value, '__qualname__', '')}"


def _digest_function(function):
    """(text, functions) of a function without what those do; read again only if a name is bound to another object."""
    bindings = _bound(function)
    ids = [id(value) for _, value in bindings]
    if function not in _read or _read[function][0] != ids:
        functions = []
        lines = [f"{dotted_path} = {_describe(value, functions)}" for dotted_path, value in bindings]
        lines += [_describe(function.__defaults__, functions), _digest_code(function.__code__)[0]]
        text = hashlib.sha256("\n".join(lines).encode()).hexdigest()
        _read[function] = ids, bindings, f"{function.__module__}.{function.__qualname__} {text}", functions
    return _read[function][2:]


def _reachable_functions(function):
    """{function: (text, functions)} of a function and all that it reaches."""
    digest_by_function, ahead = {}, [function]
    while ahead:
        now = ahead.pop()
        if now not in digest_by_function:
            digest_by_function[now] = _digest_function(now)
            ahead += digest_by_function[now][1]
    return digest_by_function


def digest(function):
    """SHA-256 of everything that a Python function would be compiled from now."""
    return hashlib.sha256(
        "\n".join(sorted(text for text, _ in _reachable_functions(function).values())).encode()
    ).hexdigest()


def compiled(function):
    """Note that a function has been compiled, or loaded, as it stands now."""
    _compiled.update(_reachable_functions(function))


def outdated_functions():
    """Names of compiled functions in which a name stands for something else now: their machine code is outdated."""
    # another thread may compile meanwhile
    compiled_digests = tuple(_compiled.items())
    return sorted(f"{f.__module__}.{f.__qualname__}" for f, was in compiled_digests if _digest_function(f) != was)
