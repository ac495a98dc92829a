"""Tables of docs/faults.md, stored in docs/results: every fault, and the hours without one.

    python docs/faults_page.py            inject every fault, store the table
    python docs/faults_page.py --hours 2  simulate both boards so long without a fault, store what rose

Source  docs/faults.md, tests.testbench.run.fault_table
"""

import argparse
import math
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from fpga_model import fault_monitor, sequencer  # noqa: E402
from fpga_model.rates import FRAME_HZ, TICK_HZ  # noqa: E402
from testbench.config import Config, changed  # noqa: E402
from testbench.console.results import write_results  # noqa: E402
from testbench.console.text_table import Table  # noqa: E402
from testbench.run import simulate  # noqa: E402
from testbench.run.anomaly_warnings import AnomalyDetector  # noqa: E402
from testbench.run.repeated_code_probability import adc_alarm, sar_alarm  # noqa: E402
from testbench.run.simulation import DEG, FRAME, Simulation  # noqa: E402
from tests.testbench.run import fault_table  # noqa: E402

HEADS = (
    "board",
    "fault",
    "seen by",
    "after ms",
    "rate_good = 0 after ms",
    "rate error before deg/s",
    "state afterwards",
)
SEED = 11


def cells(case, row):
    """One line of the table."""
    never = math.isinf(row.seen_ms), math.isinf(row.good_ms) or case.power_on
    times = ("-" if none else f"{ms:.1f}" for none, ms in zip(never, (row.seen_ms, row.good_ms)))
    error = "-" if case.power_on else f"{row.error_dps:.{0 if row.error_dps >= 10 else 3}f}"
    return (case.board, case.name, row.seen_by, *times, error, row.state)


def table(found):
    """Table of [(case, row), ...]."""
    return Table("", HEADS, [cells(case, row) for case, row in found], numeric=(3, 4, 5))


class Alarms:
    """A sink: frames that raise a flag, and frames without `rate_good`."""

    def __init__(self):
        self.frames, self.flagged, self.flags, self.bad = 0, 0, 0, 0

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        flags = frames[:, FRAME["flags"]]
        good = (frames[:, FRAME["state"]] == sequencer.LOCKED) & (flags & sequencer.DOUBTFUL == 0)
        self.frames += len(frames)
        self.flagged += int(np.count_nonzero(flags))
        self.flags |= int(np.bitwise_or.reduce(flags))
        self.bad += int(np.count_nonzero(~good))


def quiet_hours(board, hours, rate_dps=100.0):
    """(Alarms, warnings) of a locked gyroscope without a fault, default noise."""
    engine = "baseband" if board == "analog_sid" else "frame"
    config = changed(Config(), {"firmware.board": board, "noise.seed": SEED})
    sim = Simulation(config, fault_table.TEMP_DEGC, fault_table.TEMP_DEGC)
    sim.keep_codes = sim.keep_rows = False
    if simulate.start(config, sim, rate_dps * DEG, fault_table.TEMP_DEGC) is None:
        raise RuntimeError(f"faults page: board {board} does not lock")
    alarms, doubts = Alarms(), AnomalyDetector()
    doubts.active, sim.engine = True, engine
    sim.sinks = [alarms, doubts]
    sim.advance(round(hours * 3600 * TICK_HZ), rate_dps * DEG, fault_table.TEMP_DEGC)
    return alarms, doubts.warnings(config)


def hours_table(hours):
    """Table of both boards without a fault."""
    rows = []
    for board in (fault_table.ANALOG, fault_table.DIGITAL):
        alarms, warnings = quiet_hours(board, hours)
        config = changed(Config(), {"firmware.board": board})
        chance = adc_alarm(config) if board == fault_table.ANALOG else sar_alarm(config)
        expected = chance * hours * 3600 * FRAME_HZ
        raised = ", ".join(name for k, name in enumerate(fault_monitor.NAMES) if alarms.flags >> k & 1) or "none"
        counts = f"{hours:g}", str(alarms.frames), str(alarms.flagged), raised, str(alarms.bad), str(len(warnings))
        rows.append((board, *counts, f"{expected:.0e}" if expected > 1e-99 else "below 1e-99"))
    heads = ("board", "hours", "frames", "frames with a flag", "flags", "frames without rate_good", "warnings")
    return Table("", (*heads, "expected false alarms"), rows, numeric=(1, 2, 3, 5, 6, 7))


def main(arguments=None):
    """Store one table, as `arguments` (sys.argv[1:]) ask for."""
    parser = argparse.ArgumentParser(prog="python docs/faults_page.py", description=__doc__)
    parser.add_argument("--hours", type=float, help="simulate both boards without a fault for so many hours")
    options = parser.parse_args(arguments)
    if options.hours:
        command = f"python docs/faults_page.py --hours {options.hours:g}"
        write_results("fault_hours", command, [hours_table(options.hours)])
        return 0
    found = []
    for case in fault_table.cases():
        found.append((case, fault_table.run(case)))
        print(" | ".join(cells(*found[-1])), flush=True)
    write_results("fault_table", "python docs/faults_page.py", [table(found)])
    return 0


if __name__ == "__main__":
    sys.exit(main())
