"""The four phases of a run or of a budget beside the paper's: verdicts, and sentences that say what they rest on.

Source    docs/phases.md, docs/paper.md
"""

from testbench.judge.judge import phase_rows
from testbench.judge.number_verdict import NOT_COMPARABLE, Value

NODES = ("xe1", "xe2", "ye1", "ye2")
COUNTS = {2: "two", 3: "three", 4: "four"}


def verdicts(node_deg, sigma_deg=None, nonzero_words=None):
    """{node: {"verdict", "basis", "rests_on"}} of node phases (deg) with their standard uncertainties.

    nonzero_words   {node: keys of its compensation words}; such a phase is not the one that the paper prints
    """
    sigma = sigma_deg or {}
    rows = phase_rows({n: Value(v, sigma.get(n) or 0.0) for n, v in node_deg.items()})
    out = {n: {"verdict": rows[n].verdict, "basis": rows[n].basis, "rests_on": list(rows[n].rule.rests_on)}
           for n in NODES}  # fmt: skip
    for node, keys in (nonzero_words or {}).items():
        if keys:
            basis = f"{' and '.join(keys)} {'is' if len(keys) == 1 else 'are'} set"
            out[node] = {"verdict": NOT_COMPARABLE, "basis": basis, "rests_on": []}
    return out


def is_compared(verdict):
    """True for a verdict of `verdicts` on a phase that is the paper's."""
    return verdict["verdict"] != NOT_COMPARABLE


def sentence(node, verdict):
    """One sentence for the verdict on a phase."""
    if not is_compared(verdict):
        return f"{node} is not compared with the paper: {verdict['basis']}."
    return f"Compared with the paper, {node} is {verdict['verdict']}: {verdict['basis']}."


def sentences(verdict_by_node):
    """Sentences for `verdicts`: one to a phase, and one on the fitted values behind them."""
    keys = dict.fromkeys(key for node in NODES for key in verdict_by_node[node]["rests_on"])
    count = COUNTS[sum(is_compared(verdict_by_node[n]) for n in NODES)]
    return [
        *(sentence(n, verdict_by_node[n]) for n in NODES),
        f"These {count} verdicts depend on the fitted values {', '.join(keys)}.",
    ]
