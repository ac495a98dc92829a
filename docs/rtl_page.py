"""Generated tables of docs/rtl.md, from testbench/golden/bundles/scores.json and docs/results/rtl_resources.json.

    python docs/rtl_page.py scores OUT    take over what `make rtl` left in OUT/golden; scores and times
    python docs/rtl_page.py resources     synthesise with yosys; cells of each family

Source  docs/rtl.md
"""

import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from testbench.console.results import write_results  # noqa: E402
from testbench.console.text_table import Table  # noqa: E402
from testbench.golden.bundles import scores  # noqa: E402
from testbench.golden.proofs import synthesis  # noqa: E402
from testbench.storage.files import write_text  # noqa: E402

RESOURCES = "rtl_resources"
# Rows of the table: what is counted, and the cells of each family
ROWS = (
    ("4-input tables", {"ecp5": r"LUT4", "ice40": r"SB_LUT4"}),
    ("carry cells (2 bits in ECP5, 1 in iCE40)", {"ecp5": r"CCU2C", "ice40": r"SB_CARRY"}),
    ("flip-flops", {"ecp5": r"TRELLIS_FF", "ice40": r"SB_DFF\w*"}),
    ("multipliers (18 x 18, 16 x 16)", {"ecp5": r"MULT18X18D", "ice40": r"SB_MAC16"}),
    ("block memories (18 kbit, 4 kbit)", {"ecp5": r"DP16KD", "ice40": r"SB_RAM40_4K\w*"}),
)


def scores_table(entries):
    """Markdown of the scores, then of every fault that is neither killed nor proved equivalent."""
    heads = ("bundle", "mutants", "killed", "equivalent", "undecided", "score", "CPU s")
    lines = [f"| {' | '.join(heads)} |", f"|---|{'---:|' * (len(heads) - 1)}"]
    for e in entries:
        counts = " | ".join(str(e[k]) for k in heads[1:5])
        lines.append(f"| `{e['block']}/{e['case']}` | {counts} | {100 * e['score']:.2f} % | {e['cpu_s']:.0f} |")
    seeds = ", ".join(sorted({str(e["seed"]) for e in entries}))
    lines += ["", f"Seed {seeds}. Neither killed nor proved equivalent:", ""]
    left = [(f"{e['block']}/{e['case']}", s) for e in entries for s in e["left"]]
    for where, s in left:
        fault, why = re.sub(r"-module \S+ ", "", s["fault"]), s["why"].replace("`", "")
        lines.append(f"- `{where}`, {s['verdict']}: `{fault}` at `{s['source']}`: {why}")
    return "\n".join(lines if left else [*lines, "- none"])


def times(took):
    """Markdown of the parts, each from the last run that had it."""
    lines = ["| part | outcome | time s | CPU s |", "|---|---|---:|---:|"]
    lines += [
        f"| {name} | {'passed' if t['passed'] else 'not all passed'} | {t['seconds']:.0f} | {t['cpu_s']:.0f} |"
        for name, t in took.items()
    ]
    total = (sum(t[k] for t in took.values()) for k in ("seconds", "cpu_s"))
    return "\n".join([*lines, "| all | | " + " | ".join(f"{t:.0f}" for t in total) + " |"])


def mutation_part():
    """Scores of the stored run."""
    return scores_table(scores.stored_scores()["mutation"])


def times_part():
    """Times of the stored run."""
    return times(scores.stored_scores()["times"])


def netlists_table(netlists):
    """Table of the counts, a column per netlist."""
    heads = [f"{n.family}, {n.board} SID" for n in netlists]
    rows = [(text, *(str(n.count(cells[n.family])) for n in netlists)) for text, cells in ROWS]
    version = re.match(r"Yosys \S+", netlists[0].yosys)[0]
    note = f"{version}; parameters of the default configuration; not placed, not routed."
    return Table("", ("proxy", *heads), rows, note, tuple(range(1, len(heads) + 1)))


def write_scores(out):
    """Take over the files of a folder that are there; returns the exit code."""
    out, known = Path(out) / "golden", scores.stored_scores()
    names = {"mutation": scores.MUTATION, "times": scores.TIMES}
    fresh = {key: json.loads((out / name).read_text()) for key, name in names.items() if (out / name).is_file()}
    if not fresh:
        print(f"gyro: {out}: neither {scores.MUTATION} nor {scores.TIMES}: run make rtl first", file=sys.stderr)
        return 2
    found = {"mutation": fresh.get("mutation", known["mutation"]), "times": known["times"] | fresh.get("times", {})}
    write_text(scores.FILE, json.dumps(found, indent=1) + "\n")
    print(f"written: {scores.FILE.name}")
    return 0


def write_resources():
    """Measure the netlists, and store their table; returns the exit code."""
    netlists = []
    for family in synthesis.MAPPERS:
        netlists.append(synthesis.synthesise(synthesis.RTL, family))
        print(netlists[-1].text(), flush=True)
    path = write_results(RESOURCES, "python docs/rtl_page.py resources", [netlists_table(netlists)])
    print(f"written: {path.name}")
    return 0


def main(arguments):
    """Write what is named; returns the exit code."""
    if arguments == ["resources"]:
        return write_resources()
    if len(arguments) in (1, 2) and arguments[0] == "scores":
        return write_scores(*arguments[1:] or ["out"])
    print("usage: python docs/rtl_page.py scores [OUT] | resources", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
