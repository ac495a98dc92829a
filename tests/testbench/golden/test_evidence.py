"""The quality of the vectors: every goal of every block met, or proved out of reach, or named with the reason."""

import itertools
import subprocess

import numpy as np
import pytest

from testbench.golden.bundles import bundle_provenance
from testbench.golden.coverage import coverage, coverage_evidence, unreachable
from testbench.golden.stimulus import blocks, corners, stimulus
from tests.testbench.golden import corners_search
from tests.testbench.golden.benching import but_counting, made

STEMS = tuple(blocks.BLOCKS)
CASES = [(stem, case) for stem, block in blocks.BLOCKS.items() for case in block.cases]


def results(block, case, rows):
    return coverage.side_by_side(*blocks.run(block, case, rows))


@pytest.fixture(scope="module")
def met():
    """Goals that each case meets, by (stem, case); filled on demand."""
    known = {}

    def of(stem, case):
        if (stem, case) not in known:
            block = blocks.BLOCKS[stem]
            rows, _ = made(stem, case)
            known[stem, case] = coverage.find_reached_goals(block, case, rows, results(block, case, rows))
        return known[stem, case]

    return of


@pytest.mark.parametrize("stem", but_counting(STEMS))
def test_every_goal_is_met_or_proved_out_of_reach_or_named(stem, met):
    block = blocks.BLOCKS[stem]
    found = set().union(*(met(stem, case) for case in block.cases))
    named = corners.load_corners(stem)["missing"]
    for case in block.cases:
        dead = unreachable.reasons(block, case)
        for goal in coverage.goals(block, case):
            if goal in found or goal in dead or unreachable.waiver_reason(block, goal):
                continue
            assert corners.goal_text(goal) in named, f"{case}: {goal} is not met, and nothing says why"


@pytest.mark.parametrize("stem", but_counting(STEMS))
def test_what_is_named_as_not_met_is_not_met(stem, met):
    block = blocks.BLOCKS[stem]
    spelled = {corners.goal_text(goal) for case in block.cases for goal in met(stem, case)}
    known = {corners.goal_text(goal) for case in block.cases for goal in coverage.goals(block, case)}
    for name, why in corners.load_corners(stem)["missing"].items():
        assert name in known
        assert name not in spelled
        assert why.startswith("not found in ")


@pytest.mark.parametrize(("stem", "case"), but_counting(CASES))
def test_no_vector_meets_what_is_proved_out_of_reach(stem, case, met):
    dead = unreachable.reasons(blocks.BLOCKS[stem], case)
    assert not met(stem, case) & set(dead)
    assert all(why.startswith("proved: ") for why in dead.values())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("stem", "case"), CASES)
def test_other_random_rows_do_not_meet_what_is_proved_out_of_reach(stem, case, seed):
    block = blocks.BLOCKS[stem]
    rows, families = stimulus.make_directed(block, case, seed=seed)
    first = next(first for name, first, _ in families if name.startswith(("random", "held", "controls")))
    assert not coverage.find_reached_goals(block, case, rows[first:]) & set(unreachable.reasons(block, case))


def test_the_counters_that_are_left_out_are_the_only_ones(met):
    for stem in unreachable.WAIVED_REGISTERS_BY_BLOCK:
        block = blocks.BLOCKS[stem]
        listed = {g for case in block.cases for g in coverage.goals(block, case) if unreachable.waiver_reason(block, g)}
        assert all(goal[0] in ("toggle", "clamp") for goal in listed)
        clamped = {goal[1:] for goal in listed if goal[0] == "clamp"}
        assert all("s.timer + 1" in place and outcome[:2] == "hi" for place, outcome in clamped)
        assert bool(clamped) == (stem == "sequencer")
    assert set(unreachable.WAIVED_REGISTERS_BY_BLOCK) == {"fault_monitor", "sequencer"}


@pytest.mark.parametrize(
    ("stem", "case"), [(stem, case) for stem in STEMS for case in corners.load_corners(stem)["found"]]
)
def test_found_corners_meet_their_goals(stem, case):
    block = blocks.BLOCKS[stem]
    directed = coverage.find_reached_goals(block, case, stimulus.make_directed(block, case)[0])
    for entry in corners.load_corners(stem)["found"][case]:
        goal = tuple(entry["goal"].split(" | "))
        rows = corners_search.expanded(block, case, entry["rows"])
        assert rows[0, 0] == 1
        assert goal in coverage.find_reached_goals(block, case, rows), entry["goal"]
        assert goal not in directed, f"{entry['goal']}: a directed family has it"
    assert stimulus.make(block, case)[1][-1][0] == corners.FAMILY


def test_toggles_count_what_a_plain_loop_counts():
    block = blocks.BLOCKS["modulator"]
    rows, _ = stimulus.make(block, "dac16")
    table = results(block, "dac16", rows[:300])
    for k, found in enumerate(coverage.toggles(coverage.goal_ports(block), table)):
        rose = fell = 0
        values = [int(v) & ((1 << found.width) - 1) for v in table[:, k]]
        for before, after in itertools.pairwise(values):
            rose |= after & ~before
            fell |= before & ~after
        assert (found.rose, found.fell) == (rose, fell), found.name


@pytest.mark.parametrize(
    ("stem", "case"), but_counting([("pi", "extreme"), ("delay", "depth0"), ("fault_monitor", "quick")])
)
def test_summary_counts_the_goals(stem, case, met):
    block = blocks.BLOCKS[stem]
    rows, _ = made(stem, case)
    entry = coverage_evidence.summary(block, case, rows, results(block, case, rows))
    goals, dead = coverage.goals(block, case), unreachable.reasons(block, case)
    pairs = [*entry["toggles"].values(), *entry["outcomes"].values()]
    assert sum(possible for _, possible in pairs) == len(goals) - len(dead) == len(set(goals)) - entry["proved"]
    assert sum(seen for seen, _ in pairs) == len(met(stem, case))
    for name in entry["not_met"]:
        assert tuple(name.split(" | ")) not in met(stem, case)
    if stem == "delay":
        assert entry["toggles"]["taps_0"] == [0, 0]
        assert entry["toggles"]["o_out"] == [36, 36]


def test_a_vector_without_resets_has_less_to_show():
    """The entry depends on the rows: half of them reach less."""
    block = blocks.BLOCKS["cordic"]
    rows, _ = stimulus.make(block, "default")
    whole = coverage_evidence.summary(block, "default", rows, results(block, "default", rows))
    rows = rows[:200]
    part = coverage_evidence.summary(block, "default", rows, results(block, "default", rows))
    assert part["outcomes"]["round"][0] < whole["outcomes"]["round"][0]
    assert sum(seen for seen, _ in part["toggles"].values()) < sum(seen for seen, _ in whole["toggles"].values())


def test_commit_of_the_tree_or_unknown(tmp_path):
    assert bundle_provenance.git_head(tmp_path) == "unknown"
    (tmp_path / ".git").mkdir()
    assert bundle_provenance.git_head(tmp_path) == "unknown"
    (tmp_path / ".git").rmdir()
    git = ["git", "-C", str(tmp_path), "-c", "user.name=x", "-c", "user.email=x@y.z"]
    try:
        subprocess.run([*git, "init", "-q"], check=True)
        subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "x"], check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no git: the commit of a tree was NOT read")
    head = bundle_provenance.git_head(tmp_path)
    assert len(head) == 40
    assert set(head) <= set("0123456789abcdef")


def test_stored_corners_of_another_block_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(corners, "FOLDER", tmp_path)
    corners.load_corners.cache_clear()
    try:
        assert corners.load_corners("dds") == {"found": {}, "missing": {}}
        corners.load_corners.cache_clear()
        (tmp_path / "dds.json").write_text('{"schema": "gyro-corners/1.0", "block": "pi"}')
        with pytest.raises(ValueError, match=r"dds.json: schema 'gyro-corners/1\.0' of 'pi', not .* of 'dds'"):
            corners.load_corners("dds")
    finally:
        corners.load_corners.cache_clear()


def test_stored_rows_keep_what_they_say(tmp_path, monkeypatch):
    monkeypatch.setattr(corners, "FOLDER", tmp_path)
    corners.load_corners.cache_clear()
    try:
        rows = [[2, {"word": 3}, []], [3, {"word": 7}, ["word"]]]
        corners_search.store("dds", {"default": [{"goal": "a | b | c", "rows": rows}]}, {})
        found = corners_search.expanded(
            blocks.BLOCKS["dds"], "default", corners.load_corners("dds")["found"]["default"][0]["rows"]
        )
        assert found[:, :2].tolist() == [[1, 0], [0, 3], [0, 3], [0, 7], [0, 8], [0, 9]]
        assert not np.any(found[:, 2:])
        corners_search.store("dds", {}, {})
        assert not (tmp_path / "dds.json").exists()
    finally:
        corners.load_corners.cache_clear()
