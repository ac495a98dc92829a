"""Results of a run and its phase budget as tables.

A summary is the object that `gyro run --json` prints, a budget the `Budget` of `testbench.run.budget`.
Source  docs/phases.md
"""

from analog_frontend import amplifier_use
from testbench.console.text_table import Table, to_decimals
from testbench.judge import phases as judged
from testbench.run.budget import NODES
from testbench.run.phase_meter import wrap_deg

# stands wherever a phase of the paper stands beside one of ours
FITTED = (
    "We searched the possible latencies and kept those nearest the paper's xe1 and ye1. The capacitors of xe2 and ye2 "
    "were chosen to fit. Agreement with the paper therefore confirms nothing."
)
NODE_TEXT = {
    "xe1": "drive: reference pin to force",
    "xe2": "drive: x to C/V output",
    "ye1": "sense: reference pin to force",
    "ye2": "sense: y to C/V output",
}


def phases(summary):
    """Measured phases beside the budget and the paper."""
    measured, budget = summary.get("phase_deg") or {}, summary.get("budget_deg", {})
    spread, published = summary.get("phase_sigma_deg") or {}, summary.get("paper_deg") or {}
    verdict_by_node = summary.get("paper_verdict") or {}
    rows = []
    for node in NODES:
        have, want, paper = measured.get(node), budget.get(node), published.get(node)
        is_compared = not verdict_by_node.get(node) or judged.is_compared(verdict_by_node[node])
        row = (
            node,
            NODE_TEXT[node],
            to_decimals(have, 4),
            to_decimals(spread.get(node), 4),
            to_decimals(want, 4),
            to_decimals(None if have is None or want is None else wrap_deg(have - want), 4),
            to_decimals(paper, 4),
            to_decimals(None if have is None or paper is None or not is_compared else have - paper, 4),
        )
        rows.append(row)
    heads = ("phase", "from .. to", "measured deg", "1 sigma", "budget deg", "difference", "paper deg", "difference")
    column_count = len(heads) if any(v is not None for v in published.values()) else len(heads) - 2
    rows = [row[:column_count] for row in rows]
    return Table("Phase errors (a lag is positive)", heads[:column_count], rows, numeric=tuple(range(2, column_count)))


# Key of the summary -> (text, unit, digits, factor).
NUMBERS = {
    "lock_time_s": ("time from power-on to lock", "s", 3, 1),
    "drive_frequency_hz": ("drive frequency, mean of the DDS word", "Hz", 4, 1),
    "amplitude_m": ("drive amplitude", "um", 5, 1e6),
    "rate_lsb_per_dps": ("scale factor", "LSB/(deg/s)", 2, 1),
    "quadrature_v": ("quadrature voltage V_q", "V", 4, 1),
    "real_time_factor": ("simulated seconds per second", "", 2, 1),
}


def results_table(summary):
    """The other results of a run."""
    rows = [("all loops locked", "yes" if summary.get("locked") else "NO", "")]
    for key, (text, unit, digits, factor) in NUMBERS.items():
        value = summary.get(key)
        rows.append((text, to_decimals(None if value is None else value * factor, digits), unit))
    for node, value in (summary.get("loop_phase_deg") or {}).items():
        rows.append((f"loop phase {node}' (node phase minus the switch delay)", to_decimals(value, 4), "deg"))
    if summary.get("codes_sha256"):
        kind, _, digest = summary["codes_sha256"].rpartition(":")
        what = "hash of all ADC codes and words" if kind else "hash of all DAC and ADC codes"
        rows.append((what, digest[:16], "sha-256, first 16"))
    return Table("Results", ("quantity", "value", "unit"), rows)


def _verdicts(budget):
    return judged.verdicts(budget.node_deg(), nonzero_words=budget.nonzero_words)


def budget_node(budget, node, assumption_free_deg=None):
    """What contributes to one phase; `assumption_free_deg` is its value without assumptions about the firmware."""
    budget_entries = [(row, "") for row in budget.rows[node]]
    budget_entries.append((None, f"node phase {node}"))
    if node in budget.loop_rows:
        budget_entries += [(row, "") for row in budget.loop_rows[node]]
        budget_entries.append((None, f"loop phase {node}'"))
    rows, total = [], [0.0, 0.0, 0.0]
    for row, text in budget_entries:
        if row is None:
            rows.append((text, to_decimals(total[0], 2), to_decimals(total[1], 2), to_decimals(total[2], 4), ""))
            continue
        total = [total[0] + row.clocks, total[1] + row.ns, total[2] + row.degrees]
        rows.append(
            (row.what, to_decimals(row.clocks, 2), to_decimals(row.ns, 2), to_decimals(row.degrees, 4), row.assumed)
        )
    if assumption_free_deg is not None:
        rows.append(("without re-timed references and extra frames", "", "", to_decimals(assumption_free_deg, 4), ""))
    paper = budget.paper_deg[node]
    paper_verdict = None if paper is None else _verdicts(budget)[node]
    if paper_verdict:
        rows.append(("the paper measured (node phase)", "", "", to_decimals(paper, 4), paper_verdict["verdict"]))
    sums = tuple(k for k, (row, _) in enumerate(budget_entries) if row is None)
    title = f"{node}  {NODE_TEXT[node]}, at {budget.frequency_hz:.1f} Hz"
    note = "Entries with a text on the right are assumptions, not facts about the board."
    if paper_verdict:
        note = "Entries with a text on the right are fitted or assumed, not facts about the paper's board. "
        if judged.is_compared(paper_verdict):
            keys = ", ".join(paper_verdict["rests_on"])
            note += f"{paper_verdict['basis']}. This depends on the fitted values {keys}. {FITTED}"
        else:
            note += judged.sentence(node, paper_verdict)
    if any(row.is_user_value for row, _ in budget_entries if row):
        note += ' "given" marks a value that your configuration changes.'
    note = " ".join((note, *(f"{line}." for dac_node, line in budget.dac_notes if dac_node == node)))
    if node == "xe2":
        amplifier_notes = (amplifier_use.sentence(budget.amplifiers), *amplifier_use.warnings(budget.amplifiers))
        note = " ".join((note, budget.ring, *amplifier_notes))
    return Table(title, ("contribution", "clocks", "ns", "deg", "fitted or assumed"), rows, note, (1, 2, 3), sums)


def budget_tables(budget, plain=None):
    """One table for each of the four phases; `plain` is the budget without re-timed references and extra frames."""
    assumption_free_deg = plain.node_deg() if plain else {}
    return [budget_node(budget, node, assumption_free_deg.get(node)) for node in NODES]


def budget_json(budget, plain=None):
    """A budget as plain data."""

    def row(item):
        return {
            "what": item.what,
            "clocks": item.clocks,
            "ns": item.ns,
            "deg": item.degrees,
            "assumed": item.assumed,
        }

    return {
        "frequency_hz": budget.frequency_hz,
        "phase_deg": budget.node_deg(),
        "loop_phase_deg": budget.loop_deg(),
        "paper_deg": dict(budget.paper_deg),
        "paper_verdict": _verdicts(budget) if any(budget.paper_deg.values()) else None,
        **({"without_assumptions_deg": plain.node_deg()} if plain else {}),
        "ring": budget.ring,
        "dac_notes": [line for _, line in budget.dac_notes],
        "amplifier_use": [u._asdict() for u in budget.amplifiers],
        "rows": {node: [row(item) for item in rows] for node, rows in budget.rows.items()},
        "loop_rows": {node: [row(item) for item in rows] for node, rows in budget.loop_rows.items()},
    }
