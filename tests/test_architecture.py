"""The rules of the house that code review would forget: imports, kernels without floats, no phase error anywhere."""

import ast
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


def test_a_kernel_is_compiled_only_from_what_its_cache_folder_is_named_by():
    trees = {path: tree(path) for package in PACKAGES for path in sources(package)}
    imported = {}
    for path, module in trees.items():
        names = {name for name, _ in imports(module)} | {
            f"{node.module}.{alias.name}"
            for node in ast.walk(module)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        imported[path] = {own_file(name) for name in names} - {None}
    compiled = {path for path, module in trees.items() if any(kernels(module))}
    assert len(compiled) > 70
    wrong = []
    for path in compiled:
        named = {p for pattern in jit.sources_of(path) for p in ROOT.glob(pattern)}
        seen, todo = {path}, [path]
        while todo:
            todo += (more := imported[todo.pop()] - seen)
            seen |= more
        wrong += [(path.name, other.name) for other in seen & compiled - named]
    assert wrong == []
    assert {path.parent.name for path in compiled if jit.sources_of(path) == jit.ALL} == {"bench"}


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


def test_every_block_has_test_and_page():
    helpers = {"__init__", "jit", "rounding_aliases", "top", "control"}
    for path in sources("fpga_model"):
        if path.stem not in helpers:
            assert (ROOT / "tests" / "fpga_model" / f"test_{path.stem}.py").exists(), path.stem
            assert (ROOT / "docs" / "blocks" / f"{path.stem}.md").exists(), path.stem


def test_repository_speaks_of_the_product_alone():
    words = re.compile(r"/work/|\bissue #?\d|this session|helper-\d|pypi-more", re.I)
    for folder, pattern in (("docs", "*.md"), *((p, "*.py") for p in PACKAGES), ("tests", "*.py")):
        for path in (ROOT / folder).rglob(pattern):
            if path != Path(__file__):
                assert not words.search(path.read_text()), path
