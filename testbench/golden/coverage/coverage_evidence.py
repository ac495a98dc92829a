"""The quality entry of a bundle: what its rows reach in the model, of what can be reached.

    toggles     {register or pin: [seen, possible]}   edges of its bits, rise and fall counted apart
    outcomes    {kind of place: [seen, possible]}     branch, compare, round, cut, clamp, wrap (probes.py)
    proved      goals of this case that no stimulus can meet (unreachable.py)
    not_met     {goal: why} of those that no case of the block meets

What is neither seen nor named in `not_met` is met in another case of the block.
Source  docs/golden.md
"""

from testbench.golden.coverage import coverage, unreachable
from testbench.golden.stimulus import corners

KINDS = ("branch", "compare", "round", "cut", "clamp", "wrap")


def summary(block, case, rows, results):
    """The entry of one case; `results` are registers and pins of the model for these rows."""
    met, dead = coverage.find_reached_goals(block, case, rows, results), unreachable.reasons(block, case)
    missing = corners.load_corners(block.stem)["missing"]
    toggles = {port.name: [0, 0] for port in coverage.goal_ports(block)}
    outcomes = {kind: [0, 0] for kind in KINDS}
    not_met = {}
    for goal in coverage.goals(block, case):
        if goal in dead:
            continue
        count = toggles[goal[1]] if goal[0] == "toggle" else outcomes[goal[0]]
        count[0] += goal in met
        count[1] += 1
        name = corners.goal_text(goal)
        why = unreachable.waiver_reason(block, goal) or missing.get(name)
        if why and goal not in met:
            not_met[name] = why
    return {"toggles": toggles, "outcomes": outcomes, "proved": len(dead), "not_met": not_met}
