"""A record as the firmware lived it: sessions from power-on to power-on, each with what it was fed.

    session    frames between two power-ons; edges inside it count from its own first one
    Stimulus   the recorded conversions that the firmware saw, and the host's writes
    segments   the named parts of the time line, by frames

Source    docs/measured.md
"""

import itertools
from typing import NamedTuple

import numpy as np

from fpga_model import registers
from fpga_model.rates import FRAME_CYCLES
from testbench.measured.record import schema
from testbench.measured.record.replay import CODES, Stimulus

UNSEEN = "no_conversion"  # reason of a gap in which the firmware itself saw no frame


class Session(NamedTuple):
    """Frames first .. first + frames - 1 of a record."""

    first: int
    frames: int
    powered: bool  # it begins with a power-on

    @property
    def rows(self):
        """Its rows in streams of one row a frame."""
        return slice(self.first, self.first + self.frames)


class Segment(NamedTuple):
    """A row of /segments, in frames of the record."""

    id: str
    first: int
    frames: int
    kind: str
    loops: str
    a_set: float
    detune: float
    temp_set: float
    rate_set: float
    repeat_group: str
    role: str


def sessions(record):
    """Every `Session` of a checked record, in order."""
    frames = schema.frame_count(record)
    starts = (record.tables["power_on"]["edge"].data // FRAME_CYCLES).tolist()
    bounds = sorted({0, *starts, frames})
    return [Session(a, b - a, a in starts) for a, b in itertools.pairwise(bounds)]


def segments(record):
    """Every `Segment` of a checked record, in order."""
    out = []
    for name, a, b, *segment_fields in schema.rows(record.tables["segments"], *schema.TABLES["segments"]):
        first = -(-a // FRAME_CYCLES)
        out.append(Segment(name, first, b // FRAME_CYCLES - first, *segment_fields))
    return out


def received_rows(record, session):
    """(rows,) of bool: conversions of a session that the firmware saw, and (rows,) those that nobody recorded."""
    edge0 = record.streams["adc_xI"].edge0
    edges = edge0 + FRAME_CYCLES * np.arange(session.first, session.first + session.frames, dtype=np.int64)
    saw, lost = np.ones(session.frames, bool), np.zeros(session.frames, bool)
    for a, b, reason in schema.rows(record.tables["gaps"], "edge_a", "edge_b", "reason"):
        inside = (edges >= a) & (edges < b)
        saw &= ~inside
        if reason != UNSEEN:
            lost |= inside
    return saw, lost


def stimulus(record, session):
    """`Stimulus` of a session, edges from its own power-on; without `adc_ok` every conversion that was seen is good."""
    saw, _ = received_rows(record, session)
    names = ("adc_xI", "adc_xQ", "adc_yI", "adc_yQ", "adc_temperature")
    codes = np.zeros((int(saw.sum()), CODES), np.int64)
    for k, name in enumerate(names):
        if name in record.streams:
            codes[:, k] = record.streams[name].data[session.rows][saw]
    edge0 = record.streams["adc_xI"].edge0
    valid = (edge0 + FRAME_CYCLES * np.arange(session.frames, dtype=np.int64))[saw]
    ok = np.ones(len(codes), np.int64)
    if "adc_ok" in record.streams:
        ok = record.streams["adc_ok"].data[session.rows][saw].astype(np.int64)
    return Stimulus(codes, ok, valid, writes(record, session))


def writes(record, session):
    """(n, 3) edge, address, data on the bus, of the register log within a session; registers of ours only."""
    begin, end = FRAME_CYCLES * session.first, FRAME_CYCLES * (session.first + session.frames)
    out = [
        (edge - begin, registers.BY_NAME[name].address, registers.to_bus(raw, registers.BY_NAME[name].fmt))
        for edge, name, raw in schema.rows(record.tables["registers"], "edge", "name", "raw")
        if begin <= edge < end and name in registers.BY_NAME
    ]
    return np.array(out, np.int64).reshape(-1, 3)
