"""What many gyroscopes cost: wall time over cores, memory, and whole runs of a campaign.

cores    the lanes engine with a group of eight on each core, in threads, and the frame engine with a gyroscope on each,
         in processes: wall time, so the machine must have nothing else to do
memory   of a gyroscope in lanes: its arrays in the group, and what a process grows by
run      a point of a campaign from power-on over lock to the end of half a second: CPU time
"""

import contextlib
import json
import os
import resource
import statistics
import sys
import time
from pathlib import Path

from analog_frontend.numeric.vector import LANES
from fpga_model.rates import TICK_HZ
from testbench import config as configuration
from testbench.bench import kernels
from testbench.campaign import builtin_engines
from testbench.campaign.plan.measure import Keep, Keeper
from testbench.console.text_table import Table

REPEATS = 5
TICKS = 400_000
MEMORY_TICKS = 1_000_000
MEMORY_GROUPS = 2, 10
GROWN = "import json; from testbench.bench import many; print(json.dumps(many.measure_lane_memory({}, {})))"
KEEP = Keep({"rate_word": 8}, {})
THREADS, PROCESSES = "lanes engine, threads", "frame engine, processes"


def core_counts():
    """1, 2, 4 ... and all cores."""
    most = os.cpu_count() or 1
    return sorted({1 << k for k in range(most.bit_length()) if 1 << k <= most} | {most})


def _wall_s(work, *arguments):
    began = time.perf_counter()
    work(*arguments)
    return time.perf_counter() - began


def _in_processes(processes, ticks):
    for process in processes:
        process.ask("frame", ticks)
    for process in processes:
        process.answer()


def cores(repeats=REPEATS, ticks=TICKS):
    """{engine: {cores: wall time (s) per simulated second of one gyroscope}}, medians of rounds by turns."""
    counts = core_counts()
    with contextlib.ExitStack() as stack:
        served = [stack.enter_context(contextlib.closing(kernels.Served())) for _ in range(counts[-1])]
        sides = {n: kernels.SideBySide(LANES * n, n) for n in counts}
        works = {(THREADS, n): (LANES * n, sides[n].advance, ticks) for n in counts}
        works |= {(PROCESSES, n): (n, _in_processes, served[:n], ticks) for n in counts}
        spent = {case: [] for case in works}
        for _ in range(repeats + 1):
            for case, (gyroscopes, *call) in works.items():
                spent[case].append(_wall_s(*call) / (gyroscopes * ticks / TICK_HZ))
    out = {}
    for (name, n), times in spent.items():
        out.setdefault(name, {})[str(n)] = statistics.median(times[1:])  # the first round warms up
    return out


def run(repeats=REPEATS, seconds=0.5):
    """CPU time (s) of a point of a campaign on the frame engine, median of `repeats`."""
    quiet = {"scenario.diagnose": False, "output.record": False, "output.checkpoint_s": 0.0}
    point = configuration.changed(configuration.Config(), {"scenario.seconds": seconds, **quiet})
    spent = [kernels.cpu_s(builtin_engines.run_frame_points, [point], [Keeper(KEEP)]) for _ in range(repeats + 1)]
    return statistics.median(spent[1:])  # the first one warms up


# ---- memory, in processes of their own -------------------------------------------------------------------------------


def measure_lane_memory(groups, ticks=MEMORY_TICKS):
    """Bytes of a gyroscope's arrays in its group, and of this process in memory, with so many groups of eight."""
    side = kernels.SideBySide(LANES * groups)
    side.advance(ticks)
    return {"arrays": side.lanes.engines[0].nbytes / LANES, "process": _resident()}


def _resident():
    """Bytes of this process in memory; where the system does not say, its peak."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * resource.getpagesize()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def memory(groups=MEMORY_GROUPS, ticks=MEMORY_TICKS):
    """Bytes of a gyroscope in lanes: `arrays` of the group, and `process`, by which a process grows."""
    # the first process may have to compile, which takes memory of its own
    _, few, many = (json.loads(kernels.output(GROWN.format(n, ticks))) for n in (groups[0], *groups))
    more = LANES * (groups[1] - groups[0])
    return {"arrays": many["arrays"], "process": (many["process"] - few["process"]) / more}


# ---- showing ---------------------------------------------------------------------------------------------------------


def cores_table(result):
    """Wall time over cores."""
    rows = []
    for name, cases in result["cores"].items():
        base = next(iter(cases.values()))
        rows += [(name, n, f"{1e3 * value:.3g} ms", f"{base / value:.2f}") for n, value in cases.items()]
    heads = ("engine", "cores", "wall time per simulated second of a gyroscope", "times one core")
    return Table("Cores", heads, rows, "", (1, 2, 3))


def sentences(result):
    """Memory of a gyroscope in lanes, and the cost of a whole run."""
    sizes = result["memory_bytes_per_lane"]
    return (
        f"A gyroscope in lanes takes {sizes['arrays'] / 1e3:.0f} kB in the arrays of its group, and "
        f"{sizes['process'] / 1e6:.1f} MB of the process between two chunks, with its state, tables, last codes and "
        "hash.\n\n"
        f"A point of a campaign from power-on over lock and 0.5 s takes {result['run_cpu_s']:.3f} s of CPU."
    )
