"""A study killed at 20 random moments and started again: the bytes of the undisturbed one."""

import random
import subprocess
import sys
import time

import pytest

KILLS, MOST_S = 20, 3600.0
NOT_NUMBERS = {"lock", "timings.json"}


def begun(folder):
    return subprocess.Popen([sys.executable, "-m", "tests.testbench.paper.killed_study", str(folder)])


def numbers_of(folder):
    """{path: bytes} of numbers, page and pictures; what a store keeps has times in it, the page has its values."""
    files = [p for p in folder.rglob("*") if p.is_file() and p.name not in NOT_NUMBERS]
    return {p.relative_to(folder): p.read_bytes() for p in files if p.relative_to(folder).parts[0] != "store"}


@pytest.mark.slow
def test_a_study_killed_at_random_moments_ends_with_the_same_bytes(tmp_path):
    for name in ("compiles", "undisturbed"):
        start = time.monotonic()
        assert begun(tmp_path / name).wait(MOST_S) == 0
        whole_s = time.monotonic() - start
    wanted = numbers_of(tmp_path / "undisturbed")
    assert numbers_of(tmp_path / "compiles") == wanted
    assert {path.suffix for path in wanted} == {".json", ".toml", ".html", ".png", ".svg", ".pdf", ".csv"}
    rng, kills, studies = random.Random(20), 0, 0
    while kills < KILLS:
        folder, ended = tmp_path / f"killed_{studies}", False
        studies += 1
        while not ended:
            child = begun(folder)
            try:
                # the last study is left to end
                child.wait(rng.uniform(0.0, whole_s) if kills < KILLS else MOST_S)
                assert child.returncode == 0
                ended = True
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
                kills += 1
        found = numbers_of(folder)
        assert found.keys() == wanted.keys()
        assert [str(path) for path in wanted if found[path] != wanted[path]] == []
    print(f"{kills} kills in {studies} studies of {whole_s:.0f} s")
