"""A DAC at an end of its range within a dwell is reported, with its rows."""

import numpy as np
import pytest

from fpga_model.rates import FRAME_CYCLES
from testbench.measured.quality.records import dac_range
from testbench.storage.record import Column, Record, TableColumn

FRAMES = 2000  # of a segment for settling, then of a dwell
SEGMENTS = {"id": ["s", "a"], "kind": ["settle", "dwell"], "loops": ["", ""], "repeat_group": ["s", "a"]}


def record(**codes):
    """Two segments with some codes of the quadrature and the sense DAC; role fit in the second."""

    def text(values):
        return TableColumn(np.array(values), "")

    edges = np.array([0, FRAMES, 2 * FRAMES]) * FRAME_CYCLES
    table = {key: text(v) for key, v in SEGMENTS.items()} | {"role": text(["none", "fit"])}
    table |= {"edge_a": TableColumn(edges[:2], ""), "edge_b": TableColumn(edges[1:], "")}
    for key in ("a_set", "detune", "temp_set", "rate_set"):
        table[key] = TableColumn(np.zeros(2), "")
    streams = {}
    for name, middle in (("dac_qsc", 60_000), ("dac_ftr", 0)):
        v = np.full(2 * FRAMES, middle)
        for rows, code in codes.get(name, ()):
            v[rows] = code
        streams[name] = Column(v, "code", 1, FRAME_CYCLES, 0, {}, 26_000_000)
    return Record(attrs={}, streams=streams, tables={"segments": table})


@pytest.mark.parametrize(
    ("name", "code"), [("dac_qsc", 65_535), ("dac_qsc", 0), ("dac_ftr", -(1 << 19)), ("dac_ftr", (1 << 19) - 1)]
)
def test_an_end_of_the_range_is_reported_with_its_rows(name, code):
    (found,) = dac_range.findings(record(**{name: [(slice(2100, 2600), code)]}))
    assert (found.place, found.column, found.rows, found.action) == ("a", name, (101, 600), "report")
    assert found.kind == "clipped"


def test_what_is_near_short_or_before_the_dwell_is_not():
    rows = slice(2100, 2600)
    assert dac_range.findings(record(dac_qsc=[(rows, 65_534)], dac_ftr=[(rows, 65_535)])) == ()
    assert dac_range.findings(record(dac_qsc=[(slice(0, FRAMES), 65_535), (slice(2100, 2110), 65_535)])) == ()
