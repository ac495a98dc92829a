"""How often the diagnosis of planted faults is right: each is run by Icarus with its bundle and then diagnosed.

    python -m tests.testbench.golden.diagnosis.score --rules first --per-rule 8 --seed 1

It prints a line for each fault that is not named right, what became of those that no row shows, and a table of kinds.
The first row and its ports are compared with those of a bench of the tests. Exit code 1 if a certain name or a first
row is wrong.
"""

import argparse
import collections
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from testbench.errors import FileError
from testbench.golden.bundles import export
from testbench.golden.bundles.benches import PARTS
from testbench.golden.check import rtl_run
from testbench.golden.check.design_run import Choice
from tests.testbench.golden.diagnosis import (
    first_row,
    rtl_blunders,
    rtl_faults,
    rtl_misreadings,
    rtl_mistakes,
    rtl_slips,
    unseen,
)

RULES = {
    "first": rtl_faults.FIRST,
    "second": rtl_faults.SECOND,
    "slips": rtl_slips.SLIPS,
    "mistakes": rtl_mistakes.MISTAKES,
    "misreadings": rtl_misreadings.MISREADINGS,
    "blunders": rtl_blunders.BLUNDERS,
}


class Judged(NamedTuple):
    """A fault, what became of it, the causes, CPU time of check and diagnosis, and if its first row is right."""

    fault: rtl_faults.Fault
    verdict: str
    causes: tuple
    cpu_s: float
    first: bool | None = None


def checked(folder, text, stem, level="registers"):
    """(report, whether row and ports of its first difference are those of our own bench) of another text of a block."""
    with tempfile.TemporaryDirectory() as place:
        for part in PARTS.get(stem, ()):
            shutil.copy(rtl_faults.RTL / f"{part}.v", place)
        Path(place, f"{stem}.v").write_text(text)
        report = rtl_run.check(folder, place, timeout_s=60.0, choice=Choice("icarus", level))
        row, ports = first_row.first(folder, place, level)
    d = report.divergence
    said = (d.cycle, {d.port, *d.also}) if d else (None, set())
    return report, said == (row, {name[2:] for name in ports})


def judged(folder, fault, level="registers"):
    """`Judged` of one fault."""
    start = time.process_time()
    try:
        report, first = checked(folder, fault.text, fault.stem, level)
    except FileError as error:
        said = str(error)
        why = "not built" if "does not build" in said else "refused"
        return Judged(fault, f"{why}: {said.splitlines()[-1][:100]}", (), 0.0, None)
    spent = time.process_time() - start
    if report.passed:
        return Judged(fault, "not seen", (), spent, first)
    if level != "registers":
        # the cause has the name of the first port that shows it
        ports = rtl_faults.Design(fault.stem).first_of(fault.registers, report.differing)
        fault = fault._replace(registers=tuple(sorted(ports)))
    return Judged(fault, verdict(fault, report.diagnosis), report.diagnosis, spent, first)


def judged_pair(folder, a, b, text):
    """How many of two faults are named, and the causes; None if one does not show alone."""
    alone = [judged(folder, fault).verdict for fault in (a, b)]
    if any(said.startswith(("not seen", "not built", "refused")) for said in alone):
        return None, []
    found = checked(folder, text, a.stem)[0].diagnosis
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
    heads = ("right", "unnamed", "doubtful", "wrong", "not seen", "refused", "not built")
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
        for a, b, text in rtl_faults.pairs(RULES[given.rules], 3 * given.pairs, given.seed):
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
    options.add_argument("--rules", default="first", choices=tuple(RULES))
    options.add_argument("--per-rule", type=int, default=8)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--bundles", type=Path)
    options.add_argument("--pairs", type=int, default=0)
    options.add_argument("--level", default="registers", choices=("outputs", "registers"))
    options.add_argument("--unseen", action="store_true", help="find out what the faults are that no row shows")
    options.add_argument("--part", default="1/1", help="K/N: every N-th fault from the K-th on")
    given = options.parse_args(words)
    if given.pairs:
        return score_pairs(given)
    part, parts = map(int, given.part.split("/"))
    with tempfile.TemporaryDirectory() as place:
        out, results = given.bundles or Path(place), []
        for fault in rtl_faults.drawn(RULES[given.rules], given.per_rule, given.seed)[part - 1 :: parts]:
            if not (out / fault.stem / "Makefile").exists():
                export.export(fault.stem, out)
            one = judged(out / fault.stem / rtl_faults.CASES[fault.stem], fault, given.level)
            results.append(one)
            if one.verdict != "right" or not one.first:
                said = "; ".join(cause.text() for cause in one.causes[:2])
                said += unseen.fate(out, fault) if one.verdict == "not seen" and given.unseen else ""
                said += "" if one.first in (True, None) else " FIRST ROW WRONG"
                print(f"{one.verdict}: {fault.kind} ({fault.cause}), {fault.stem}, {fault.edit!r}: {said}", flush=True)
    print(table(results))
    first = collections.Counter(one.first for one in results)
    print(f"first row and ports right: {first[True]}, wrong: {first[False]}")
    print(f"certain names: {sum(bool(r.causes) and r.causes[0].sure and r.verdict == 'right' for r in results)}")
    classes = sum(bool(r.causes) and r.causes[0].cause == r.fault.cause for r in results)
    print(f"first cause of the right class, in any register: {classes}")
    print(f"longest check with diagnosis {max((one.cpu_s for one in results), default=0.0):.1f} s of CPU")
    return any(one.verdict == "wrong" or one.first is False for one in results)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
