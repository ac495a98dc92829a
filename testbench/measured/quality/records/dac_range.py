"""A DAC of a closed-loop record that stands at an end of its range within a dwell: the loop is open there.

    found     ENDS of the codes of a dwell with a role, or more, are the least or the largest code of their DAC
    reported  no linear model holds there: what an effect does depends on when the DAC arrives at its end
Source  docs/quality.md
"""

from testbench.measured.quality.finding import REPORT, finding
from testbench.measured.quality.sheet import Column, Sheet
from testbench.measured.record import schema
from testbench.measured.record.sessions import segments

ENDS = 0.01


def findings(record):
    """Findings about the dwells of a `testbench.storage.record.Record`."""
    out = []
    codes = {name: record.streams[name] for name in schema.DAC if name in record.streams}
    per_frame = {name: s.data for name, s in codes.items() if (s.num, s.den) == schema.PER_FRAME}
    for s in (s for s in segments(record) if s.role in ("fit", "validate")):
        for name, data in per_frame.items():
            values, (_, bits, signed, *_) = data[s.first : s.first + s.frames].astype(float), schema.STREAMS[name]
            least = -(1 << bits - 1) if signed else 0
            at = (values == least) | (values == least + (1 << bits) - 1)
            if at.any() and at.mean() >= ENDS:
                sheet = Sheet(s.id, "record", (Column(name, "code", values),))
                words = "the DAC is at an end of its range: its loop is open there, and no linear model holds"
                out.append(finding(sheet, "clipped", name, at, words, REPORT))
    return tuple(out)
