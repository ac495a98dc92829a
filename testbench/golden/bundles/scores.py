"""Mutation scores and times of `make rtl` as they were measured last, with what they belong to.

    scores.json    one entry per bundle, with hashes of its vectors and of the design; times of the parts
    docs/rtl.md    two tables, made from it
    manifests      an export notes the score of a bundle whose vectors and design are those that were scored

    python -m testbench.golden.bundles.scores OUT     take over what `make rtl` left in OUT/golden; write the tables

Source  docs/rtl.md, docs/golden.md (how good the vectors are)
"""

import functools
import hashlib
import json
import re
import sys
from pathlib import Path

from testbench.golden.bundles import bundle
from testbench.storage.files import write_text

FILE = Path(__file__).with_name("scores.json")
PAGE = Path(__file__).resolve().parents[3] / "docs" / "rtl.md"
MUTATION, TIMES = "mutation.json", "rtl.json"
KEYS = ("block", "case", "seed", "mutants", "killed", "equivalent", "undecided", "score")


def vectors(manifest):
    """Hash of what a score of these vectors depends on: words and parameters, not benches and waves."""
    if manifest["schema"] == bundle.REPLAY_SCHEMA:
        return manifest["recording_sha256"]
    kept = [manifest["sha256"][f"{name}.hex"] for name in bundle.words_of(manifest)] + [manifest["params"]]
    return hashlib.sha256(bundle.canonical(kept).encode()).hexdigest()


def design(paths):
    """Hash of Verilog, whatever its comments and spaces."""
    texts = [re.sub(r"//[^\n]*", "", path.read_text()).split() for path in sorted(paths)]
    return hashlib.sha256(bundle.canonical(texts).encode()).hexdigest()


def entry(outcome, of_vectors, of_design, cpu_s):
    """JSON of an outcome; `of_vectors` is {case: hash}. Proved faults are counted, the others listed."""
    told = outcome.to_dict()
    listed = [s for s in told["survivors"] if s["verdict"] != "equivalent"]
    kept = [{k: s[k] for k in ("verdict", "fault", "source", "why")} for s in listed]
    return {k: told[k] for k in KEYS} | {
        "vectors": of_vectors, "design": of_design, "cpu_s": round(cpu_s, 1), "left": kept,
    }  # fmt: skip


def known_scores():
    """What is stored."""
    return json.loads(FILE.read_text())


def missing_scores(out):
    """Entries that a measurement left in a folder, else those that are stored."""
    path = out / MUTATION
    return json.loads(path.read_text()) if path.is_file() else known_scores()["mutation"]


@functools.cache
def _entries():
    return {(e["block"], case): e for e in known_scores()["mutation"] for case in e["vectors"]}


def note_score(manifest):
    """Entry for a sealed manifest's provenance: its score, if these very vectors were scored; else empty."""
    found = _entries().get((manifest["block"], manifest["case"]))
    if found is None or found["vectors"][manifest["case"]] != vectors(manifest):
        return {}
    return {"mutation": {k: v for k, v in found.items() if k not in ("vectors", "cpu_s")}}


# ---- docs/rtl.md ---------------------------------------------------------------------------------------------------


def table(entries):
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


def write_page():
    """Both tables of the page, from scores.json."""
    from testbench.console.markdown import replaced

    found = known_scores()
    text = replaced(PAGE.read_text(), "mutation", table(found["mutation"]))
    write_text(PAGE, replaced(text, "times", times(found["times"])))


def main(arguments):
    """Take over the files of a folder that are there."""
    from testbench.console.markdown import need_repository

    need_repository()
    out, found = Path(arguments[0] if arguments else "out") / "golden", known_scores()
    fresh = {key: out / name for key, name in (("mutation", MUTATION), ("times", TIMES)) if (out / name).is_file()}
    if not fresh:
        print(f"gyro: {out}: neither {MUTATION} nor {TIMES}: run make rtl first", file=sys.stderr)
        return 2
    fresh = {key: json.loads(path.read_text()) for key, path in fresh.items()}
    found = {"mutation": fresh.get("mutation", found["mutation"]), "times": found["times"] | fresh.get("times", {})}
    write_text(FILE, json.dumps(found, indent=1) + "\n")
    write_page()
    print(f"written: {FILE.name}, {PAGE.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
