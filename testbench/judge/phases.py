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


def sentences(phase_verdicts):
    """Sentences for `verdicts`: one to a phase, and one on the fitted values behind them."""
    keys = dict.fromkeys(key for node in NODES for key in phase_verdicts[node]["rests_on"])
    return [
        *(f"Beside the paper, {phase_verdicts[n]['verdict']}: {phase_verdicts[n]['basis']}." for n in NODES),
        f"These four rest on the fitted values {', '.join(keys)}.",
    ]
