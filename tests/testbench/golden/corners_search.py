"""Search for short rows that meet goals which the directed families of a block miss; the search is Hypothesis's.

    python -m tests.testbench.golden.corners_search [BLOCK ...] [--examples N]      all blocks, or those named: minutes

The result replaces testbench/golden/stimulus/corners_found/BLOCK.json, which an export replays.

A candidate is a reset and a few pieces: an operation with values of its inputs, repeated. The distance of a place's
operands from the wanted outcome leads the search (`target`), and what is found is shrunk before it is stored.
Source  docs/golden.md; MacIver, Donaldson, ECOOP 2020 (shrinking)
"""

import argparse
import json
import math
import random
from typing import NamedTuple

import numpy as np
from hypothesis import HealthCheck, Phase, find, settings, target
from hypothesis import strategies as st
from hypothesis.errors import NoSuchExample

from fpga_model import sequencer
from testbench.golden.coverage import coverage, probes, unreachable
from testbench.golden.stimulus import blocks, corners, stimulus
from testbench.golden.stimulus.writer import Writer
from testbench.storage.files import write_text

EXAMPLES = 3000
SEED = 1
HEALTHY = {
    "en": 1,
    "i_adc_ok": 1,
    "i_control": sequencer.RUN,
    "i_magnitude": 1 << 23,
    "i_setpoint": 1 << 23,
}
PRELUDE_ROWS = 70  # frames that bring the quick sequencer to LOCKED


class Shape(NamedTuple):
    """How the candidates of a block are made: values that are usual, what runs before, how an operation looks."""

    usual: dict
    prelude: object
    pieces: int
    longest: int


def shape_of(block):
    if block.stem == "sequencer":
        return Shape(HEALTHY, st.integers(0, PRELUDE_ROWS), 6, 6)
    return Shape(dict.fromkeys(block.strobes, 1), st.just(0), 6, 3)


def value_of(port):
    """Values of an input: its corners, anything, or near 0."""
    if port.width == 1:
        return st.integers(0, 1)
    # the search moves in steps of at most 2**20: wide values are drawn in two parts
    low = 18 if port.width > 24 else 0
    parts = st.tuples(st.integers(port.fmt.lo >> low, port.fmt.hi >> low), st.integers(0, (1 << low) - 1))
    small = st.integers(max(port.fmt.lo, -300), min(port.fmt.hi, 300))
    return st.one_of(
        small, st.sampled_from(stimulus.corners(port.fmt)), parts.map(lambda pair: (pair[0] << low) + pair[1])
    )


def operations(block, usual, longest):
    """Strategy of one piece: [[times, values, counting inputs], ...]."""
    free = {port.name: value_of(port) for port in block.inputs}
    values = st.fixed_dictionaries({}, optional=free)
    if block.stem == "digital_sid":
        sample = value_of(next(port for port in block.inputs if port.name == "sample_x"))
        return st.tuples(sample, st.integers(1, 70), st.integers(1, 4)).map(_dumps)
    if block.wait and block.stem != "spi_adc":
        quiet = dict.fromkeys(block.strobes, 0)
        return values.map(lambda v: [[1, {**usual, **v}, []], [block.wait, {**v, **quiet}, []]])
    counting = ["i_drive_sin"] if block.stem == "sequencer" else []
    return st.tuples(st.integers(1, longest), values).map(lambda tv: [[tv[0], {**usual, **tv[1]}, counting]])


def _dumps(drawn):
    """`repeat` dumps of a sum of `times` equal samples, in all four channels."""
    sample, times, repeat = drawn
    values = {"refs": 15, "sample_x": sample, "sample_y": sample}
    piece = [[times, {"ce_1m": 1, **values}, []], [1, {"ce_1m": 1, "dump": 1, "refs": 15}, []], [4, {"refs": 15}, []]]
    return piece * repeat


def candidates(block):
    """Strategy of whole candidates: rows as they are stored."""
    usual, prelude, pieces, longest = shape_of(block)
    body = st.lists(operations(block, usual, longest), min_size=1, max_size=pieces)

    def joined(drawn):
        before, found = drawn
        head = [[before, usual, ["i_drive_sin"]]] if before else []
        return head + [row for piece in found for row in piece]

    return st.tuples(prelude, body).map(joined)


class Judge:
    """Whether stored rows meet a goal, with the distance that leads the search."""

    def __init__(self, block, case, goal):
        self.block, self.case, self.goal = block, case, goal
        self.examples = 0
        self.probed = None if goal[0] == "toggle" else probes.build_probed_step(block, case, watched=goal)

    def __call__(self, rows):
        self.examples += 1
        every = expanded(self.block, self.case, rows)
        if self.probed is None:
            results = results_of(self.block, self.case, every)
            return self.goal in coverage.reached_toggle_goals(coverage.goal_ports(self.block), results)
        self.probed.clear()
        probes.follow(self.block, self.case, self.probed, every.tolist())
        if self.goal in self.probed.reached_goals():
            return True
        if self.probed.nearest is not None:
            target(-math.log2(1 + self.probed.nearest))
        return False


def expanded(block, case, rows):
    """int64 rows of one entry, a reset first."""
    w = Writer(block, case)
    w.family(corners.FAMILY)
    corners.append_corner(w, rows)
    return np.array(w.rows, np.int64)


def results_of(block, case, rows):
    regs, pins = blocks.run(block, case, rows)
    return coverage.side_by_side(regs, pins)


def search(block, case, goal, examples=EXAMPLES, seed=SEED):
    """(stored rows that meet the goal, or None; candidates tried)."""
    judge = Judge(block, case, goal)
    chosen = settings(
        max_examples=examples,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate, Phase.target, Phase.shrink],
    )
    try:
        found = find(candidates(block), judge, settings=chosen, random=random.Random(seed))
    except NoSuchExample:
        return None, judge.examples
    return tidy(block, found), judge.examples


def missing(block):
    """{goal: cases in which it is not proved unreachable} for the goals that no directed family meets."""
    met, wanted = set(), {}
    for case in block.cases:
        rows, _ = stimulus.make_directed(block, case)
        met |= coverage.find_reached_goals(block, case, rows)
        dead = unreachable.reasons(block, case)
        for goal in coverage.goals(block, case):
            if goal not in dead:
                wanted.setdefault(goal, []).append(case)
    return {
        goal: cases for goal, cases in wanted.items() if goal not in met and not unreachable.waiver_reason(block, goal)
    }


def explore(block, examples=EXAMPLES, say=print):
    """What `store` takes: found rows by case, and the goals that were not found."""
    found, not_found, met = {}, {}, set()
    for goal, cases in missing(block).items():
        name, tried = corners.goal_text(goal), 0
        # the last case has the shorter times or the faster poles
        for case in reversed(cases):
            if goal in met:
                break
            rows, count = search(block, case, goal, examples)
            tried += count
            if rows is not None:
                met |= coverage.find_reached_goals(block, case, expanded(block, case, rows))
                found.setdefault(case, []).append({"goal": name, "rows": rows})
                say(f"{block.stem}/{case}: found in {tried}: {name}", flush=True)
        if goal not in met:
            not_found[goal] = f"not found in {tried} examples"
            say(f"{block.stem}: not found in {tried}: {name}", flush=True)
    return found, {corners.goal_text(goal): why for goal, why in not_found.items() if goal not in met}


def tidy(block, rows):
    """Rows without values that are idle anyway."""
    idle = {port.name: block.idle.get(port.name, 0) for port in block.inputs}
    return [[times, {k: v for k, v in values.items() if v != idle[k]}, counting] for times, values, counting in rows]


def store(stem, found, missing):
    """Write what a search has found; a block with nothing to say has no file."""
    if not found and not missing:
        corners.corner_path(stem).unlink(missing_ok=True)
        return
    data = {"schema": corners.SCHEMA, "block": stem, "found": found, "missing": missing}
    write_text(corners.corner_path(stem), json.dumps(data, indent=1) + "\n")
    corners.load_corners.cache_clear()


def main():
    """Search again for the corners of the named blocks, and store them."""
    parser = argparse.ArgumentParser(description="Search for stimulus corners that the directed families miss.")
    parser.add_argument("blocks", nargs="*", metavar="BLOCK", help="blocks to search; all if none is named")
    parser.add_argument("--examples", type=int, default=EXAMPLES, help="candidates for each goal")
    given = parser.parse_args()
    unknown = sorted(set(given.blocks) - set(blocks.BLOCKS))
    if unknown:
        parser.error(f"block: {unknown[0]!r} is not one of {', '.join(blocks.BLOCKS)}")
    for stem in given.blocks or blocks.BLOCKS:
        store(stem, *explore(blocks.BLOCKS[stem], given.examples))


if __name__ == "__main__":
    main()
