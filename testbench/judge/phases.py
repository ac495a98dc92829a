"""The four phases of a run or of a budget beside the paper's: verdicts, and sentences that say what they rest on.

Source    docs/phases.md, docs/paper.md
"""

from testbench.judge.judge import phase_rows
from testbench.judge.number_verdict import Value

NODES = ("xe1", "xe2", "ye1", "ye2")


def verdicts(node_deg, sigma_deg=None):
    """{node: {"verdict", "basis", "rests_on"}} of node phases (deg) with their standard uncertainties."""
    sigma = sigma_deg or {}
    rows = phase_rows({n: Value(v, sigma.get(n) or 0.0) for n, v in node_deg.items()})
    return {n: {"verdict": rows[n].verdict, "basis": rows[n].basis, "rests_on": list(rows[n].rule.rests_on)}
            for n in NODES}  # fmt: skip


def sentences(verdict_by_node):
    """Sentences for `verdicts`: one to a phase, and one on the fitted values behind them."""
    keys = dict.fromkeys(key for node in NODES for key in verdict_by_node[node]["rests_on"])
    return [
        *(
            f"Compared with the paper, {n} is {verdict_by_node[n]['verdict']}: {verdict_by_node[n]['basis']}."
            for n in NODES
        ),
        f"These four verdicts depend on the fitted values {', '.join(keys)}.",
    ]
