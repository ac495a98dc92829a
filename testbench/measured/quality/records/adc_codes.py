"""Data quality of a closed-loop record: the converter's codes within dwells with a role, beyond rules R01 to R33.

    found     blocks that come again, runs that stand still, single codes far off their neighbours, codes drawn between
              others; all are reported, none refuses: the replay of the firmware (R16) judges the codes of a record
    not here  rails and dead channels (R10), gaps (R07), units (R03, R19)
Source  docs/quality.md
"""

import numpy as np

from fpga_model.rates import FRAME_CYCLES
from testbench.measured.quality import duplicated, interpolated, spikes, stuck
from testbench.measured.quality.finding import REPORT, finding
from testbench.measured.quality.sheet import Column, Sheet
from testbench.measured.record import schema

LEAST_FRAMES = 256


def _check_interpolated(sheet):
    """Codes exactly between their neighbours, more often than noise of several codes makes."""
    for c in sheet.columns:
        mask = interpolated.on_a_line(c.values, None, 1.0)
        if mask.any():
            yield finding(sheet, "interpolated", c.name, mask, "codes lie exactly between their neighbours")


CHECKS = (duplicated.check, stuck.check, spikes.check, _check_interpolated)


def findings(record):
    """Findings about the dwells of a `testbench.storage.record.Record`."""
    out, edge0 = [], record.streams["adc_xI"].edge0
    for name, role, a, b in schema.rows(record.tables["segments"], "id", "role", "edge_a", "edge_b"):
        if role == "none":
            continue
        first, last = (max(0, -(-(edge - edge0) // FRAME_CYCLES)) for edge in (a, b))
        codes = {stream: record.streams[stream].data[first:last].astype(float) for stream in schema.ADC}
        alive = {stream: v for stream, v in codes.items() if len(v) >= LEAST_FRAMES and np.ptp(v) > 0}
        columns = tuple(Column(stream, "code", v, fast=True) for stream, v in alive.items())
        if columns:
            sheet = Sheet(str(name), "record", columns)
            out += [f._replace(action=REPORT) for check in CHECKS for f in check(sheet)]
    return tuple(out)
