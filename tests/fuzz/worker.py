"""Many inputs in one process: `python -m tests.fuzz.worker CORPUS KIND FIRST COUNT`, a line of JSON before and after.

An input is made by its kind and its number alone. The process ends after a finding that leaves traces in it.
"""

import json
import os
import random
import re
import resource
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

from tests.fuzz import commands, kinds, watch

LONGEST_S, MOST_KB = 20.0, 1_000_000
MOST_MEMORY = 1 << 33  # address space: the machine is not to suffer from what is found here
LONGEST_MESSAGE = 2000
KINDS = kinds.KINDS | commands.KINDS


def one(corpus, kind, number):
    """(what was found wrong or "", accepted) of one input."""
    from testbench.errors import ConfigError, FileError

    rng = random.Random(f"{kind} {number}")
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        try:
            read = KINDS[kind](rng, corpus, Path(folder))
        except Exception as error:
            return "the input cannot be made: " + "".join(traceback.format_exception(error)), False
        began = os.times()[:4]
        try:
            with watch.over() as seen, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                warnings.simplefilter("error", RuntimeWarning)
                read()
            problem, accepted = "", True
        except (ConfigError, FileError) as refusal:
            problem, accepted = "", False
            if len(str(refusal)) > LONGEST_MESSAGE or "\n" in str(refusal):
                problem = f"a message of {len(str(refusal))} characters: {str(refusal)[:200]}"
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            problem, accepted = "".join(traceback.format_exception(error)), False
    if seen:
        problem = f"runs what it names: {'; '.join(seen)[:300]}"
    # of this process and its children: other processes on the machine do not count; the parent limits the wall clock
    seconds = sum(os.times()[:4]) - sum(began)
    if seconds > LONGEST_S:
        problem = problem or f"took {seconds:.0f} s"
    return problem, accepted


def peak_kb():
    """Largest memory of this process; getrusage would count that of the process that it was forked from, too."""
    return int(re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())[1])


def main(corpus, kind, first, count):
    """Print [number] before and [number, problem, accepted] after each input."""
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    # what is said goes to the parent; what commands and libraries print does not
    out = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for number in range(first, first + count):
        print(json.dumps([number]), file=out, flush=True)
        problem, accepted = one(corpus, kind, number)
        peak = max(peak_kb(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
        if peak > MOST_KB:
            problem = problem or f"took {peak / 1e6:.2f} GB"
        print(json.dumps([number, problem, accepted]), file=out, flush=True)
        if problem.endswith(" GB"):
            break  # the peak of a process stays


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
