"""The search for corners: finds what is there, shrinks it, gives up on what is not, and repeats itself."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from testbench.golden.coverage import coverage
from testbench.golden.stimulus import blocks
from tests.testbench.golden import corners_search as search

ROOT = Path(__file__).resolve().parents[3]
ISQRT = blocks.BLOCKS["isqrt"]
FITS_EXACTLY = ("compare", "isqrt: pair >= trial", "0")


def test_a_boundary_is_found_shrunk_and_found_again():
    rows, tried = search.search(ISQRT, "default", FITS_EXACTLY, examples=500)
    assert 1 <= tried <= 1000
    assert FITS_EXACTLY in coverage.find_reached_goals(ISQRT, "default", search.expanded(ISQRT, "default", rows))
    starts = [values for _, values, _ in rows if values.get("start")]
    assert len(starts) == 1, "one operation is enough"
    assert search.search(ISQRT, "default", FITS_EXACTLY, examples=500) == (rows, tried)


def test_a_toggle_is_found():
    goal = ("toggle", "y", "rise 15")
    rows, _ = search.search(ISQRT, "default", goal, examples=500)
    expanded = search.expanded(ISQRT, "default", rows)
    assert goal in coverage.reached_toggle_goals(ISQRT.registers, search.results_of(ISQRT, "default", expanded))


def test_what_cannot_be_is_not_found_and_the_tries_are_counted():
    goal = ("wrap", "isqrt: wrap_unsigned(s.i + 1, COUNT_BITS)", "under")
    rows, tried = search.search(ISQRT, "default", goal, examples=40)
    assert rows is None
    assert 1 <= tried <= 41


@pytest.mark.slow
def test_the_distance_leads_to_a_place_that_chance_does_not_find():
    """A difference of two 48-bit words that is exactly one less than the limit; about two seeds of three find one."""
    block = blocks.BLOCKS["pi"]
    goal = ("clamp", "pi: clamp(preset, p.lo, p.hi)", "hi+1")
    # a process of its own: Hypothesis draws constants from whatever modules have been imported before
    code = f"""
from tests.testbench.golden import corners_search as search
from testbench.golden.stimulus import blocks
tries = (search.search(blocks.BLOCKS["pi"], "frequency", {goal!r}, examples=2000, seed=k)[0] for k in range(8))
print(next(rows for rows in tries if rows is not None))
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    rows = ast.literal_eval(done.stdout)
    assert goal in coverage.find_reached_goals(block, "frequency", search.expanded(block, "frequency", rows))


def test_nothing_is_missing_where_the_directed_families_have_it_all():
    assert search.missing(blocks.BLOCKS["watchdog"]) == {}
    assert search.explore(blocks.BLOCKS["watchdog"]) == ({}, {})


def test_an_unknown_block_is_one_clear_error(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["corners", "ddds"])
    with pytest.raises(SystemExit, match="2"):
        search.main()
    assert "block: 'ddds' is not one of dds, sine" in capsys.readouterr().err
