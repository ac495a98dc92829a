"""The firmware in C around the plant in C++ against the clocked engine: equal codes, then CPU time by turns.

    python -m testbench.bench.c_firmware    prints the table and writes it to docs/speed.md

CPU seconds per simulated second. The clocked engine runs in several processes by turns, because its speed differs from
process to process. All registers at every clock are computed by both; the C keeps no hash of its codes.
Source    docs/speed.md, docs/c_model.md
"""

import contextlib
import itertools
import statistics
import sys

from fpga_model.rates import TICK_HZ
from testbench.bench import kernels, machine, measure_speed, peers
from testbench.console.markdown import ROOT, need_repository
from testbench.console.results import write_results
from testbench.console.text_table import Table

COMMAND = "python -m testbench.bench.c_firmware"
NAME = "c"
TICKS = 100_000
ROUNDS, PROCESSES = 10, 5
CLOCKED, C = "clocked engine", "firmware in C, plant in C++"


def measure_cpu_times(folder, rounds=ROUNDS, processes=PROCESSES, ticks=TICKS):
    """{what: CPU seconds per simulated second of each round}; RuntimeError if a code, register or double differs."""
    sim = kernels.gyroscope("clocked")
    peers.export(sim, kernels.RATE_RAD_S, folder)
    command = peers.build_c(folder)
    codes = peers.run(NAME, command, folder, ticks)
    for line in peers.differences(peers.reference(sim, kernels.RATE_RAD_S, ticks), codes):
        raise RuntimeError(f"the firmware in C differs from the clocked engine: {line}")
    with contextlib.ExitStack() as stack:
        served = [stack.enter_context(contextlib.closing(kernels.Served())) for _ in range(processes)]
        turns = itertools.cycle(served)
        works = {
            CLOCKED: lambda: next(turns).cpu_s("clocked", ticks),
            C: lambda: peers.run(NAME, command, folder, ticks).cpu_s,
        }
        measure_speed.rounds(works, processes)
        spent = measure_speed.rounds(works, rounds)
    return {what: [TICK_HZ / ticks * time_s for time_s in times] for what, times in spent.items()}


def table(spent):
    """Median and spread of each, and the clocked engine's time relative to it: the median of the rounds' ratios."""
    rows = []
    for what, times in spent.items():
        ratio = statistics.median(one / other for one, other in zip(spent[CLOCKED], times))
        least, most = min(times), max(times)
        rows.append((what, f"{statistics.median(times):.3g} s", f"{least:.3g} .. {most:.3g}", f"{ratio:.2f}"))
    heads = ("what", "CPU s / simulated s", "least .. most", "clocked / this")
    versions = machine.versions() | peers.versions()
    text = ", ".join(f"{name} {versions[name]}" for name in ("python", "numba", "gcc") if versions[name])
    return Table("Firmware in C", heads, rows, f"{machine.cpu()}; {text}", (1, 2, 3))


def main():
    """Measure, print, write."""
    from testbench.console.show import print_tables

    need_repository()
    cpu_time_table = table(measure_cpu_times(ROOT / "build" / "bench"))
    print_tables([cpu_time_table])
    note = f"Measured on {cpu_time_table.note}."
    write_results("speed_c_firmware", COMMAND, [cpu_time_table._replace(title="", note=note)])
    print("written: docs/results/speed_c_firmware.json")
    return 0


if __name__ == "__main__":
    sys.exit(main())
