"""Parts and units: what is included, what is linked to, and that what is linked to is there."""

import shutil
import subprocess
import sys
import textwrap

import pytest

from fpga_model import jit
from fpga_model.jit import ROOT

pytestmark = pytest.mark.skipif(jit.DISABLED, reason="nothing is compiled")

MODULES = {
    "low": """
        from fpga_model.jit import unit

        @unit
        def tripled(x):
            return 3 * x
        """,
    "high": """
        from fpga_model.jit import hot, inlined
        from fpga_model import low

        @inlined
        def more(x):
            return low.tripled(x) + 1

        @hot
        def answer(x):
            return more(more(x))
        """,
}
ANSWER = "from fpga_model import high; print(high.answer(2), sum(high.answer.stats.cache_hits.values()))"
THREADS = """
from concurrent.futures import ThreadPoolExecutor
from fpga_model import high
with ThreadPoolExecutor(8) as pool:
    print(*set(pool.map(high.answer, [2] * 64)))
"""


@pytest.fixture
def tree(tmp_path):
    """A package with a unit and a caller of it, and a cache of its own."""
    package = tmp_path / "tree" / "fpga_model"
    package.mkdir(parents=True)
    for name in ("__init__", "bound", "jit", "kernel_cache", "linkage", "replacing", "shared_files"):
        (package / f"{name}.py").write_text((ROOT / "fpga_model" / f"{name}.py").read_text())
    for name, text in MODULES.items():
        (package / f"{name}.py").write_text(textwrap.dedent(text))
    return tmp_path / "tree"


def said(tree, code=ANSWER, cache=None):
    # -B: an edit of the same length within a second would leave Python's own bytecode valid
    environment = {"PATH": "/usr/bin:/bin", "GYRO_CACHE": str(cache or tree / "cache"), "HOME": str(tree)}
    done = subprocess.run([sys.executable, "-B", "-c", code], cwd=tree, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


REMOVED = """
import shutil
from fpga_model import high
print(high.answer(2))
shutil.rmtree(CACHE)
print(high.answer(2.0))
"""


def test_a_cache_that_is_removed_meanwhile_is_made_anew(tree):
    assert said(tree, REMOVED.replace("CACHE", repr(str(tree / "cache")))) == ["22", "22.0"]
    assert list((tree / "cache").rglob("answer-*.kernel"))


@pytest.mark.slow
def test_two_copies_of_the_same_sources_do_not_disturb_each_other_in_one_cache(tree, tmp_path):
    """The list of what a caller links to is that of its own copy: symbols of the other one are not there."""
    copy = tmp_path / "copy"
    shutil.copytree(tree, copy)
    cached = "from fpga_model import high, jit; print(jit.is_cached(high.answer))"
    assert said(tree, cached, tmp_path / "both") == ["False"]
    other = "import numba; numba.njit(lambda x: x)(1); " + ANSWER  # symbols are numbered: these get others
    assert [said(one, code, tmp_path / "both")[1] for one, code in ((tree, ANSWER), (copy, other))] == ["0", "0"]
    assert said(tree, cached, tmp_path / "both") == ["True"]
    assert [said(one, cache=tmp_path / "both") for one in (tree, copy, tree)] == [["22", "1"]] * 3


@pytest.mark.slow
def test_a_caller_from_the_cache_finds_what_it_calls_and_compiles_what_is_gone(tree):
    assert said(tree) == ["22", "0"]
    assert said(tree) == ["22", "1"]
    for path in (tree / "cache").rglob("tripled-*.kernel"):
        path.unlink()
    assert said(tree)[0] == "22"
    assert said(tree) == ["22", "1"]
    for path in (tree / "cache").rglob("answer-*.kernel"):
        path.unlink()
    assert said(tree) == ["22", "0"]


@pytest.mark.slow
def test_other_arguments_leave_what_is_in_the_cache(tree):
    said(tree)
    assert said(tree, ANSWER.replace("answer(2)", "answer(2.0)")) == ["22.0", "0"]
    assert said(tree, ANSWER.replace("answer(2)", "answer(2), high.answer(2.0)")) == ["22", "22.0", "2"]


@pytest.mark.slow
def test_threads_that_call_at_once_leave_the_list_whole(tree):
    said(tree)
    assert said(tree, THREADS) == ["22"]
    assert said(tree) == ["22", "1"]


def test_an_edit_of_the_caller_leaves_the_unit_compiled(tree):
    said(tree)
    before = set((tree / "cache").rglob("tripled-*.kernel"))
    path = tree / "fpga_model" / "high.py"
    path.write_text(path.read_text().replace("+ 1", "+ 2"))
    assert said(tree) == ["26", "0"]
    assert set((tree / "cache").rglob("tripled-*.kernel")) == before
    path = tree / "fpga_model" / "low.py"
    path.write_text(path.read_text().replace("3 * x", "4 * x"))
    assert said(tree) == ["42", "0"]


REPLACED = """
import numba
from fpga_model import bound, high, low
low.tripled = numba.njit(lambda x: 5 * x)
print(high.answer(2), sum(high.answer.stats.cache_hits.values()))
low.tripled = numba.njit(lambda x: 6 * x)
print(*bound.outdated_functions())
"""


def test_what_a_process_replaces_in_memory_runs_there_with_a_warm_cache_and_nowhere_else(tree):
    assert said(tree) == ["22", "0"]
    for _ in range(2):
        assert said(tree, REPLACED)[::2] == ["56", "fpga_model.high.more"]
    assert said(tree) == ["22", "1"]


def test_two_processes_on_one_empty_cache_compile_once(tree):
    code = f"import time\n{ANSWER}"
    environment = {"PATH": "/usr/bin:/bin", "GYRO_CACHE": str(tree / "cache"), "HOME": str(tree)}
    pair = [
        subprocess.Popen([sys.executable, "-c", code], cwd=tree, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    hits = sorted(int(child.communicate()[0].split()[1]) for child in pair)
    assert hits == [0, 1]


def test_constants_make_no_specialisations(tree):
    code = """
from fpga_model.jit import hot, inlined
@inlined
def added(x, k):
    return x + k
@hot
def all_of_them(x):
    return added(x, 1) + added(x, 2) + added(x, 3)
print(all_of_them(1), len(added.overloads))
"""
    (tree / "fpga_model" / "many.py").write_text(code)
    assert said(tree, "import fpga_model.many") == ["9", "1"]
