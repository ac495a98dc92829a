"""The rules of the house that code review would forget: imports, kernels without floats, no phase error anywhere."""

import ast
import functools
import importlib
import pkgutil
import re
from pathlib import Path

import pytest

from fpga_model import jit

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("fpga_model", "analog_frontend", "testbench")
ALLOWED = {
    "fpga_model": {"fpga_model"},
    "analog_frontend": {"analog_frontend", "fpga_model.jit"},
    "testbench": set(PACKAGES),
}
# Words of the register map, reset value 0: the firmware's own means against phase errors
COMPENSATION = {"phase_drive_sine", "phase_sense_sine", "phase_drive_ref", "phase_sense_ref"}


def sources(package):
    return sorted((ROOT / package).rglob("*.py"))


@functools.cache
def tree(path):
    return ast.parse(path.read_text(), str(path))


def imports(module):
    """Every module name that a tree imports, with `from a import b` as a and a.b."""
    for node in ast.walk(module):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            yield node.module, node.lineno


def wrong_imports(package, module):
    own = [(name, line) for name, line in imports(module) if name.split(".")[0] in PACKAGES]
    allowed = ALLOWED[package]
    return [(name, line) for name, line in own if not any(name == a or name.startswith(a + ".") for a in allowed)]


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_point_downwards(package):
    for path in sources(package):
        assert not wrong_imports(package, tree(path)), path


def test_a_wrong_import_would_be_seen():
    assert wrong_imports("fpga_model", ast.parse("from testbench import engine"))
    assert wrong_imports("analog_frontend", ast.parse("from fpga_model.fixed import clamp"))
    assert not wrong_imports("analog_frontend", ast.parse("from fpga_model.jit import kernel"))


def test_the_oracles_import_nothing_of_ours():
    own = [name for name, _ in imports(tree(ROOT / "tests" / "naive.py")) if name.split(".")[0] in (*PACKAGES, "tests")]
    assert own == []


COMPILED = ("kernel", "hot", "outlined", "inner", "inlined")


def kernels(module):
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef):
            if any(isinstance(d, ast.Name) and d.id in COMPILED for d in node.decorator_list):
                yield node


def own_file(name):
    """The source behind a module name or a name in a module; None for anybody else's."""
    for path in ((ROOT / name.replace(".", "/")).with_suffix(".py"), ROOT / name.replace(".", "/") / "__init__.py"):
        if name.split(".")[0] in PACKAGES and path.is_file():
            return path
    return None


def own_imports(path):
    """Our source files that a file imports, read from its syntax tree; `from a import b` is a.b where b is a module."""
    found = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found |= {own_file(alias.name) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {own_file(f"{node.module}.{alias.name}") or own_file(node.module) for alias in node.names}
    return found - {None, path}


ALL = [path for package in PACKAGES for path in sources(package)]


@functools.cache
def imported():
    """{file: our files that it imports}."""
    return {path: own_imports(path) for path in ALL}


def reached(start, ahead):
    """All that follows from `start` by steps of `ahead`; without `start`, unless a circle leads back."""
    seen, todo = set(), [start]
    while todo:
        more = ahead[todo.pop()] - seen
        seen |= more
        todo += more
    return seen


def test_the_cache_of_a_kernel_is_named_by_all_that_it_imports():
    for path in ALL:
        assert reached(path, imported()) <= set(jit.kernel_sources(path)), path
    frame = set(jit.kernel_sources(ROOT / "testbench" / "engines" / "frame.py"))
    assert ROOT / "fpga_model" / "pi.py" in frame
    assert not {path for path in frame if path.parent.name in ("run", "config", "golden", "paper")}


# ---- rooms: a folder is a room ---------------------------------------------------------------------------------------

CATALOGUES = ("fpga_model", "analog_frontend/effects", "testbench/rtl")
MOST_FILES = 16
LONGEST_CHAIN = 12  # rooms of testbench, each importing the next
MOST_LINES, MOST_PARAMETERS = 80, 8
CODE = {".py", ".v", ".vhd", ".c", ".cpp", ".h"}


def rooms():
    """{folder: folders it imports from}."""
    out = {path.parent: set() for path in ALL}
    for path, others in imported().items():
        out[path.parent] |= {other.parent for other in others} - {path.parent}
    return out


def chain(room, below, inside):
    """Longest chain of rooms, each importing the next, that begins with `room`."""
    return [room, *max((chain(r, below, inside) for r in below[room] if inside(r)), key=len, default=[])]


def test_no_file_imports_itself_by_a_detour():
    assert [path for path in ALL if path in reached(path, imported())] == []


def test_no_room_imports_upwards():
    below = rooms()
    assert [room for room in below if room in reached(room, below)] == []


def test_a_chain_of_rooms_is_short():
    below = rooms()
    longest = max((chain(room, below, lambda r: r.is_relative_to(ROOT / "testbench")) for room in below), key=len)
    assert len(longest) <= LONGEST_CHAIN, [str(room.relative_to(ROOT)) for room in longest]


def test_a_room_can_be_seen_at_once():
    for package in PACKAGES:
        for folder in {path.parent for path in (ROOT / package).rglob("*") if path.suffix in CODE}:
            files = [path for path in folder.iterdir() if path.suffix in CODE]
            name = str(folder.relative_to(ROOT))
            assert len(files) <= MOST_FILES or name in CATALOGUES, (name, len(files))


def test_the_table_of_rooms_is_that_of_the_tree():
    """A row for every folder with sources; a room of testbench imports from rooms above it."""
    listed = re.findall(r"^\| `(testbench/[\w/]+)` \|", (ROOT / "docs" / "architecture.md").read_text(), re.M)
    there = {
        p.parent.relative_to(ROOT).as_posix() for p in (ROOT / "testbench").rglob("*") if p.suffix in (".py", ".v")
    }
    assert sorted(listed) == sorted(there - {"testbench"})
    order = [name for name in listed if name.count("/") == 1]
    for room, others in rooms().items():
        name = "/".join(room.relative_to(ROOT).parts[:2])
        if name in order:
            own = {"/".join(other.relative_to(ROOT).parts[:2]) for other in others} & set(order)
            assert own <= set(order[: order.index(name) + 1]), (room, own)


NAMEDTUPLE = {"_replace", "_asdict", "_fields", "_field_defaults", "_make"}


def private_uses(module):
    """Private names of other modules of ours that a syntax tree uses."""
    ours = set()
    for node in ast.walk(module):
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in PACKAGES:
            for alias in node.names:
                if alias.name.startswith("_"):
                    yield node.lineno, alias.name
                ours.add(alias.asname or alias.name)
    for node in ast.walk(module):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ours:
            if node.attr.startswith("_") and not node.attr.startswith("__") and node.attr not in NAMEDTUPLE:
                yield node.lineno, node.attr


def test_no_module_uses_a_private_name_of_another():
    for path in ALL:
        assert list(private_uses(tree(path))) == [], path


def test_a_private_use_would_be_seen():
    assert list(private_uses(ast.parse("from testbench.run import build\nbuild._adc()")))
    assert list(private_uses(ast.parse("from testbench.run.build import _adc")))
    assert not list(private_uses(ast.parse("from testbench.run.build import Params\nParams._fields")))


def functions(path):
    return (node for node in ast.walk(tree(path)) if isinstance(node, ast.FunctionDef))


def test_a_function_fits_a_screen_or_is_a_table():
    for path in ALL:
        for function in functions(path):
            table = (ast.get_docstring(function) or "").startswith("Table:")
            assert function.end_lineno - function.lineno < MOST_LINES or table, (path, function.name)


def test_a_function_takes_few_parameters():
    for path in ALL:
        compiled = set(kernels(tree(path)))
        names = {function.name for function in compiled}
        for function in functions(path):
            given = function.args.posonlyargs + function.args.args + function.args.kwonlyargs
            if function.name not in names:
                assert len([a for a in given if a.arg != "self"]) <= MOST_PARAMETERS, (path, function.name)


def float_or_division(function):
    """Line and reason of everything in a kernel that no gate could be."""
    for node in ast.walk(function):
        if isinstance(node, ast.Constant) and isinstance(node.value, (float, complex)):
            yield node.lineno, "float literal"
        if isinstance(node, (ast.BinOp, ast.AugAssign)) and isinstance(
            node.op, (ast.Div, ast.FloorDiv, ast.Mod, ast.Pow)
        ):
            yield node.lineno, type(node.op).__name__
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in ("float", "divmod", "pow", "round")
        ):
            yield node.lineno, node.func.id


def test_fpga_kernels_hold_no_float_and_no_division():
    seen = 0
    for path in sources("fpga_model"):
        for function in kernels(tree(path)):
            seen += 1
            assert not list(float_or_division(function)), (path, function.name)
    assert seen > 40


def test_a_float_or_a_division_would_be_seen():
    for bad in ("x / 2", "x // 2", "x % 3", "x ** 2", "x * 0.5", "float(x)"):
        (function,) = kernels(ast.parse(f"@inlined\ndef f(x):\n    return {bad}"))
        assert list(float_or_division(function)), bad


def test_wiring_holds_no_arithmetic():
    for name in ("top", "control"):
        functions = list(kernels(tree(ROOT / "fpga_model" / f"{name}.py")))
        assert functions, name
        for function in functions:
            for node in ast.walk(function):
                if isinstance(node, ast.BinOp):
                    assert isinstance(node.op, (ast.BitAnd, ast.BitOr)), (name, node.lineno)
                assert not (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)), (name, node.lineno)


PHASE_WORD = re.compile(r"phase|(^|_)(phi|theta)(_|$)|(^|_)lag(_|$)|(^|_)deg($|_)(?!c)|rad$")


def fields(package):
    """(class path, field) of every NamedTuple of a package: parameters and registers."""
    root = importlib.import_module(package)
    for info in pkgutil.walk_packages(root.__path__, package + "."):
        module = importlib.import_module(info.name)
        for item in vars(module).values():
            if (
                isinstance(item, type)
                and issubclass(item, tuple)
                and item.__module__ == info.name
                and hasattr(item, "_fields")
            ):
                for field in item._fields:
                    yield f"{info.name}.{item.__name__}", field


def test_nothing_in_the_plant_is_a_phase_error():
    named = [(where, field) for where, field in fields("analog_frontend") if PHASE_WORD.search(field)]
    assert named == []


def test_the_only_phase_parameters_of_the_firmware_are_the_compensation_words():
    from fpga_model import registers

    parameters = [f for where, f in fields("fpga_model") if where.endswith("Params") and PHASE_WORD.search(f)]
    assert [f for f in parameters if not f.endswith("limit")] == []
    bank = registers.State()
    assert {f for f in bank._fields if PHASE_WORD.search(f)} == COMPENSATION
    assert all(getattr(bank, f) == 0 for f in COMPENSATION)


def test_every_block_has_a_test_and_a_header_that_is_its_page():
    from fpga_model import block

    for stem in ("fixed", *block.block_modules()):
        assert (ROOT / "tests" / "fpga_model" / f"test_{stem}.py").exists(), stem
        header = ast.get_docstring(tree(ROOT / "fpga_model" / f"{stem}.py"))
        lines = ("Rounding", "Overflow") if stem == "fixed" else ("Formats", "Latency", "Rounding", "Overflow", "Cost")
        assert all(re.search(rf"^{line} ", header, re.M) for line in lines), stem


def test_repository_speaks_of_the_product_alone():
    words = re.compile(r"/work/|\bissue #?\d|this session|helper-\d|pypi-more", re.I)
    for folder, pattern in (("docs", "*.md"), *((p, "*.py") for p in PACKAGES), ("tests", "*.py")):
        for path in (ROOT / folder).rglob(pattern):
            if path != Path(__file__):
                assert not words.search(path.read_text()), path
