"""How often the diagnosis of planted faults is right: each is run by Icarus with its bundle and then diagnosed.

    python -m tests.testbench.golden.diagnosis.score --rules first --per-rule 8 --seed 1

It prints a line for each fault that is not named right, and a table of kinds. Exit code 1 if a certain name is wrong.
"""

import argparse
import collections
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.errors import FileError
from testbench.golden.bundles import bundle, export
from testbench.golden.bundles.benches import PARTS
from testbench.golden.check import rtl_run
from testbench.golden.check.diagnose import Rows, diagnose
from tests.testbench.golden.diagnosis import rtl_faults


class Judged(NamedTuple):
    """A fault, what became of it, the causes, and the CPU time of the diagnosis."""

    fault: rtl_faults.Fault
    verdict: str
    causes: list
    cpu_s: float


def logged(folder, text, stem):
    """{name: Column} of the design with another text of its block."""
    with tempfile.TemporaryDirectory() as place:
        for part in PARTS.get(stem, ()):
            shutil.copy(rtl_faults.RTL / f"{part}.v", place)
        Path(place, f"{stem}.v").write_text(text)
        return rtl_run.log(folder, bundle.read(folder).manifest, place, "icarus", 60.0)


def rows_of(folder, columns, seen=None):
    """`Rows` of a log; `seen` are the ports that count (default: all)."""
    golden = bundle.read(folder)
    manifest = golden.manifest
    results = [p["name"] for p in manifest["registers"] + manifest["outputs"]]
    return Rows(
        block=manifest["block"],
        params={p["name"]: p["raw"] for p in manifest["params"]},
        inputs=dict(zip([p["name"] for p in manifest["inputs"]], golden.stim.T.copy())),
        expected=dict(zip(results, golden.exp.T.copy())),
        got={n: np.where(columns[n].known, columns[n].values, 0) for n in results if seen is None or n in seen},
        care={n: columns[n].known.copy() for n in results if seen is None or n in seen},
        unknown=tuple(p["name"] for p in manifest["registers"] if not columns[p["name"]].known[0]),
    )


def first_difference(rows):
    """(row, names) of the first difference that the log shows, unknown values included."""
    wrong = {n: (column != rows.expected[n]) | ~rows.care[n] for n, column in rows.got.items()}
    places = {n: int(np.argmax(column)) for n, column in wrong.items() if column.any()}
    first = min(places.values(), default=None)
    return first, {n for n, place in places.items() if place == first}


def judged(folder, fault, seen=None):
    """`Judged` of one fault."""
    try:
        rows = rows_of(folder, logged(folder, fault.text, fault.stem), seen)
    except FileError as error:
        return Judged(fault, "not built: " + str(error).splitlines()[-1][:80], [], 0.0)
    if first_difference(rows)[0] is None:
        return Judged(fault, "not seen", [], 0.0)
    start = time.process_time()
    found = diagnose(rows)
    spent = time.process_time() - start
    return Judged(fault, verdict(fault, found), found, spent)


def judged_pair(folder, a, b, text):
    """How many of two faults are named, and whether each shows alone."""
    alone = [judged(folder, fault).verdict for fault in (a, b)]
    if any(said.startswith(("not seen", "not built")) for said in alone):
        return None, []
    found = diagnose(rows_of(folder, logged(folder, text, a.stem)))
    named = sum(any(c.cause == f.cause and c.register in f.registers for c in found) for f in (a, b))
    return named, found


def verdict(fault, found):
    """right, unnamed, wrong (certain), doubtful (wrong, not certain)."""
    if not found:
        return "unnamed" if fault.cause else "right"
    best = found[0]
    if best.cause == fault.cause and (best.register in fault.registers or "*" in fault.registers):
        return "right"
    return "wrong" if best.sure else "doubtful"


def table(results):
    """Markdown table of the verdicts of each kind."""
    kinds = collections.defaultdict(collections.Counter)
    for one in results:
        kinds[one.fault.kind][one.verdict.partition(":")[0]] += 1
    heads = ("right", "unnamed", "doubtful", "wrong", "not seen", "not built")
    lines = ["| kind | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
    for kind, count in kinds.items():
        lines.append(f"| {kind} | " + " | ".join(str(count[head] or "") for head in heads) + " |")
    total = collections.Counter(one.verdict.partition(":")[0] for one in results)
    return "\n".join([*lines, "| all | " + " | ".join(str(total[head]) for head in heads) + " |"])


def score_pairs(given):
    """Print how often both of two faults are named."""
    count = collections.Counter()
    with tempfile.TemporaryDirectory() as place:
        out = given.bundles or Path(place)
        for a, b, text in rtl_faults.pairs(getattr(rtl_faults, given.rules.upper()), 3 * given.pairs, given.seed):
            if not (out / a.stem / "Makefile").exists():
                export.export(a.stem, out)
            named, found = judged_pair(out / a.stem / rtl_faults.CASES[a.stem], a, b, text)
            if named is None:
                continue
            count[named] += 1
            if named < 2:
                said = "; ".join(cause.text() for cause in found[:3])
                print(f"{named} named: {a.stem}, {a.kind} {a.edit!r}, {b.kind} {b.edit!r}: {said}", flush=True)
            if count.total() == given.pairs:
                break
    print(f"{count[2]} of {count.total()} pairs: both named; {count[1]}: one; {count[0]}: none")
    return False


def main(words):
    options = argparse.ArgumentParser()
    options.add_argument("--rules", default="first", choices=("first", "second"))
    options.add_argument("--per-rule", type=int, default=8)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--bundles", type=Path)
    options.add_argument("--pairs", type=int, default=0)
    given = options.parse_args(words)
    if given.pairs:
        return score_pairs(given)
    with tempfile.TemporaryDirectory() as place:
        out, results = given.bundles or Path(place), []
        for fault in rtl_faults.drawn(getattr(rtl_faults, given.rules.upper()), given.per_rule, given.seed):
            if not (out / fault.stem / "Makefile").exists():
                export.export(fault.stem, out)
            one = judged(out / fault.stem / rtl_faults.CASES[fault.stem], fault)
            results.append(one)
            if one.verdict != "right":
                said = "; ".join(cause.text() for cause in one.causes[:2])
                print(f"{one.verdict}: {fault.kind} ({fault.cause}), {fault.stem}, {fault.edit!r}: {said}", flush=True)
    print(table(results))
    print(f"longest diagnosis {max(one.cpu_s for one in results):.1f} s of CPU")
    return any(one.verdict == "wrong" for one in results)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
