"""How long an edit takes to its first result: wall time of whole processes, on a copy of the tree with its own cache.

    python -m tests.testbench.bench.edits [ROUNDS]     prints the times, and stores them in docs/results/edits.json

    first call     gyro run --seconds 1 --rate-dps 100 --seed 1, nothing compiled
    effect         a tenth of a second from lock after an edit of an effect's law, the effect on
    firmware       the first 1000 ticks of the clocked engine after an edit of fpga_model/pi.py
Source  docs/speed.md
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fpga_model.jit import PACKAGES, ROOT
from testbench.bench import machine
from testbench.console.results import write_results
from testbench.console.text_table import Table

RUN = ["-m", "testbench.commands.main", "run", "--rate-dps", "100", "--seed", "1", "--out", "out"]
TICKS = "from testbench.run import warmup; warmup.compile_clocked()"
LAW = [*RUN, "--seconds", "0.1", "--set", "effects.damping_cubic=1e3"]
CASES = {
    "first call": (None, [*RUN, "--seconds", "1"]),
    "effect": ("analog_frontend/effects/damping_cubic.py", LAW),
    "firmware": ("fpga_model/pi.py", ["-c", TICKS]),
}


def wall_s(tree, cache, arguments):
    """Wall time (s) of a Python process in a tree."""
    begin = time.perf_counter()
    environment = {**os.environ, "PYTHONPATH": str(tree), "GYRO_CACHE": str(cache)}
    subprocess.run([sys.executable, *arguments], cwd=tree, env=environment, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin


def compiled(cache):
    """Wait until no process adds to a cache any more."""
    before = -1
    while before != (now := sum(1 for _ in cache.rglob("*.kernel"))):
        before = now
        time.sleep(12)


def measure(rounds):
    """{case: wall times (s)}."""
    found = {name: [] for name in CASES}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            tree, cache = Path(folder) / "tree", Path(folder) / "cache"
            for package in PACKAGES:
                shutil.copytree(ROOT / package, tree / package, ignore=shutil.ignore_patterns("__pycache__"))
            for name, (edited, arguments) in CASES.items():
                if edited:
                    with open(tree / edited, "a") as file:
                        file.write("# edited\n")
                found[name].append(wall_s(tree, cache, arguments))
                compiled(cache)
    return found


def main():
    """Print a line for each case, and store the table."""
    rows = []
    for name, times in measure(int(sys.argv[1]) if len(sys.argv) > 1 else 3).items():
        rows.append((name, f"{statistics.median(times):.1f} s", " ".join(f"{t:.1f}" for t in times)))
        print("   ".join(rows[-1]))
    table = Table(
        "", ("after an edit of", "median wall time", "rounds, s"), rows, f"Measured on {machine.cpu()}.", (1,)
    )
    write_results("edits", "python -m tests.testbench.bench.edits", [table])


if __name__ == "__main__":
    main()
