"""What effects that are off cost: instructions of the frame engine per tick, with their ports and with these cut out.

Where the code comes to lie moves the engine's time by more than an effect that is off; the count of executed
instructions, by Valgrind, is the same in every run. Both trees are compiled for the same processor, so that Valgrind
knows its instructions; the difference of two runs of different length leaves out the start.

    python -m tests.testbench.bench.ports_off       some ten minutes
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from fpga_model.jit import ROOT

PACKAGES = ("fpga_model", "analog_frontend", "testbench")
# file, test of a port, what stands there in a plant that has no ports
CUTS = (
    ("analog_frontend/top.py", "if laws.force or laws.cv:", "if False:"),
    ("analog_frontend/top.py", "p.effects.any_force or laws.force)", "False)"),
    ("analog_frontend/sid_edges.py", "if p.effects.any_cv or p.laws.cv or p.ring.on:", "if False:"),
    ("analog_frontend/top.py", "if levels.on:", "if False:"),
    ("analog_frontend/linear.py", "if e.any_force or laws.force:", "if False:"),
    ("analog_frontend/parts/adc.py", "if p.errors_on[c]:", "if False:"),
)
TICKS = (25_000, 125_000)
COMPILED_FOR = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx,+avx2,+bmi,+bmi2,+sse4.2,+popcnt"}
PLAY = "from testbench.bench import kernels; kernels.advance(kernels.gyroscope('frame', locked=False, codes=False), {})"
COUNTED = re.compile(r"Collected : (\d+)")
TIMEOUT_S = 1800


def copied(folder, cut):
    """The packages in `folder`, without ports if `cut`; ValueError if a test of a port is not where it was."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name, port, absent in CUTS if cut else ():
        path = folder / name
        source = path.read_text()
        if source.count(port) != 1:
            raise ValueError(f"{name}: {port!r} stands there {source.count(port)} times, not once")
        path.write_text(source.replace(port, absent))
    return folder


def instructions(folder, ticks):
    """Instructions of a process that plays `ticks`; compiled before, so that it only loads."""
    environment = {**os.environ, **COMPILED_FOR, "PYTHONPATH": str(folder), "GYRO_CACHE": str(folder / "cache")}
    play = [sys.executable, "-c", PLAY.format(ticks)]
    subprocess.run(play, env=environment, cwd=folder, check=True, timeout=TIMEOUT_S)
    counter = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", *play]
    told = subprocess.run(
        counter, env=environment, cwd=folder, check=True, timeout=TIMEOUT_S, capture_output=True, text=True
    )
    return int(COUNTED.search(told.stderr)[1])


def per_tick(folder):
    """Instructions of a tick: the difference of a long and a short run, over theirs."""
    short, long = TICKS
    return (instructions(folder, long) - instructions(folder, short)) / (long - short)


def main():
    """Print both counts and the part of the engine that the tests of the ports are."""
    if shutil.which("valgrind") is None:
        sys.exit("valgrind is not installed: nothing was counted")
    with tempfile.TemporaryDirectory() as temporary:
        with_ports, without = (per_tick(copied(Path(temporary) / name, name == "cut")) for name in ("whole", "cut"))
    print(f"{with_ports:.2f} instructions per tick with ports, {without:.2f} without: {with_ports / without - 1:+.2%}")


if __name__ == "__main__":
    main()
