"""Concurrent starts and kills of every command that writes: python -m tests.kills [--minutes M] [--seed S] [--only N]

    run, campaign               60 pairs of starts, 60 kills: 20 each of TERM, INT, KILL
    dask, paper, golden, trace  12 pairs, 15 kills: 5 each
    every other command that writes several files   3 pairs, 3 kills
    cache                       runs on a damaged kernel cache

A case is drawn by its seed, so `--only N --seed S` repeats it. With `--minutes` all names take turns until the time
is over. Prints a line for each wrong case, then a table of counts; the exit code is 1 if anything was wrong.
"""

import argparse
import itertools
import signal
import sys
import tempfile
import time
from collections import Counter

from tests import kills_cache, kills_campaign, kills_golden, kills_run, kills_writers

CASES = {**kills_run.CASES, **kills_campaign.CASES, **kills_golden.CASES, **kills_writers.CASES, **kills_cache.CASES}
MANY, FEW, FEWEST = (60, 60), (12, 15), (3, 3)  # pairs, kills
COUNTS = dict.fromkeys(CASES, FEW) | dict.fromkeys(kills_writers.CASES, FEWEST) | {"run": MANY, "campaign": MANY}
QUICK = ("run", "campaign", "golden", "tracing", "dask")  # a case takes seconds, of the others a minute
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGKILL)


def drawn(name, seed):
    """(kind, seed, call) of all cases of a name, pairs and kills by turns."""
    pair, kill = CASES[name]
    pairs, kills = COUNTS[name]
    one = [("pair", seed + k, lambda folder, k=k: pair(seed + k, folder)) for k in range(pairs)]
    two = [
        (SIGNALS[k % 3].name, seed + k, lambda folder, k=k: kill(seed + k, folder, SIGNALS[k % 3]))
        for k in range(kills)
    ]
    return [case for both in itertools.zip_longest(one, two) for case in both if case is not None]


def turns(names, seed):
    """(name, kind, seed, call): a case of each name in turn, until all are done."""
    for step in itertools.zip_longest(*(drawn(name, seed) for name in names)):
        yield from ((name, *case) for name, case in zip(names, step) if case is not None)


def run(names, seed, minutes=None):
    """(Counter of (name, kind), lines of what was wrong)."""
    began, done, wrong = time.monotonic(), Counter(), []
    for name, kind, number, call in turns(names, seed):
        if minutes is not None and time.monotonic() - began > 60 * minutes:
            break
        with tempfile.TemporaryDirectory() as folder:
            said = call(folder)
        done[name, kind] += 1
        if said is not None:
            wrong.append(f"{name} {kind} --seed {number}: {said}")
            print(wrong[-1], flush=True)
    return done, wrong


def main(argv=None):
    """Do the cases, print the counts."""
    parser = argparse.ArgumentParser(prog="python -m tests.kills")
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=sorted(CASES), action="append")
    given = parser.parse_args(argv)
    done, wrong = run(given.only or list(CASES), given.seed, given.minutes)
    kinds = ("pair", *(number.name for number in SIGNALS))
    print("".join(f"{head:>10}" for head in ("", *kinds)))
    for name in given.only or CASES:
        print(f"{name:>10}" + "".join(f"{done[name, kind]:10d}" for kind in kinds))
    print(f"{len(wrong)} of {sum(done.values())} cases wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
