"""Run the fuzzers: `python -m tests.fuzz [--minutes M] [--seed S] [--kind K] [--count N]`; counts by kind, findings.

Kinds take turns in batches of one process each, two processes at a time. Input n of a kind is made by n alone, so
`--kind K --seed n --count 1` repeats it.
"""

import argparse
import contextlib
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from tests.fuzz import corpus, kinds
from tests.fuzz.worker import KINDS, LONGEST_S

BATCH, FIRST_S = 40, 60.0  # inputs to a process; time for its imports besides
ROOT = Path(__file__).resolve().parents[2]


class Finding(NamedTuple):
    """What was wrong, and how it is repeated."""

    kind: str
    number: int
    problem: str

    def text(self):
        """Command that repeats it, and what is seen then."""
        return f"python -m tests.fuzz --kind {self.kind} --seed {self.number} --count 1\n{self.problem.strip()}\n"


def _lines(process, limit_s):
    """Lines of a process; None when the next one does not come in time."""
    left, within = b"", limit_s + FIRST_S
    while True:
        ready, _, _ = select.select([process.stdout], [], [], within)
        block = os.read(process.stdout.fileno(), 1 << 16) if ready else None
        if not block:
            if block is None:
                yield None
            return
        *whole, left = (left + block).split(b"\n")
        yield from (json.loads(line) for line in whole)
        within = limit_s


def batch(folder, kind, first, count):
    """(inputs, accepted, findings) of inputs first .. first + count - 1; a process that dies is followed by another."""
    done, accepted, findings, end = 0, 0, [], first + count
    while first < end:
        command = [sys.executable, "-m", "tests.fuzz.worker", str(folder), kind, str(first), str(end - first)]
        env = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=env) as process:
            at, problem = first, None
            for line in _lines(process, 3 * LONGEST_S):
                if line is None:
                    problem = f"no end within {3 * LONGEST_S:g} s"
                    break
                at = line[0]
                if len(line) == 3:
                    done, accepted, first = done + 1, accepted + line[2], at + 1
                    findings += [Finding(kind, at, line[1])] if line[1] else []
            if problem is None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(10)
            process.kill()
        if process.returncode and first < end:
            findings.append(Finding(kind, at, problem or f"the process ended with {process.returncode}"))
            done, first = done + 1, at + 1
    return done, accepted, findings


def run(folder, chosen, seed, minutes=None, count=None, size=BATCH):
    """({kind: inputs}, {kind: accepted}, findings): all of `count` inputs of each kind, or what `minutes` allow."""
    began, inputs, accepted, findings = time.monotonic(), Counter(), Counter(), []

    def turn(kind, first, size):
        if minutes is not None and time.monotonic() - began > 60 * minutes:
            return
        done, taken, found = batch(folder, kind, first, size)
        inputs[kind] += done
        accepted[kind] += taken
        findings.extend(found)
        for finding in found:
            print(finding.text(), flush=True)

    with ThreadPoolExecutor(2) as pool:
        number = 0
        while (number < count) if count else time.monotonic() - began < 60 * minutes:
            size = min(size, count - number) if count else size
            list(pool.map(lambda kind, n=number, s=size: turn(kind, seed + n, s), chosen))
            number += size
    return inputs, accepted, findings


def main(argv=None):
    """Command line; exit code 1 if there is a finding."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", action="append", choices=sorted(KINDS))
    parser.add_argument("--count", type=int, help="inputs of each kind, instead of a time")
    given = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="fuzz-corpus-") as folder:
        corpus.make(folder)
        chosen = [k for k in given.kind or KINDS if (Path(folder) / kinds.NEEDED.get(k, "")).exists()]
        minutes = None if given.count else given.minutes
        inputs, accepted, findings = run(Path(folder), chosen, given.seed, minutes, given.count)
    for kind in chosen:
        found = sum(finding.kind == kind for finding in findings)
        print(f"{kind:<12} {inputs[kind]:>6} inputs  {accepted[kind]:>6} read  {found:>3} findings")
    print(
        f"{'all':<12} {sum(inputs.values()):>6} inputs  {sum(accepted.values()):>6} read  {len(findings):>3} findings"
    )
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
