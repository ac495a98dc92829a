"""Damages of the converter's codes in a closed-loop record are reported; noise and settling are not."""

import numpy as np
import pytest

from fpga_model.rates import FRAME_CYCLES
from testbench.measured.quality.records import adc_codes
from testbench.measured.record import schema
from testbench.storage.record import Column, Record, TableColumn

FRAMES = 6000


def record(damage=None, role="validate"):
    """Two dwells of noise, settling and a line, with the codes of adc_yI damaged in the second."""
    rng, t = np.random.default_rng(4), np.arange(FRAMES)
    streams = {}
    for name in schema.ADC:
        v = 4000 * np.exp(-t / 300) * np.cos(0.109 * t) + 900 * np.sin(0.4 * t) + 60 * rng.normal(size=FRAMES)
        streams[name] = Column(np.round(v + 1e5).astype(np.int64), "code", 1, FRAME_CYCLES, 1040, {}, 26_000_000)
    v = streams["adc_yI"].data
    if damage == "spikes":
        v[[4000, 4800]] += 5000
    elif damage == "stuck":
        v[4000:4040] = v[4000]
    elif damage == "interpolated":
        v[3500:5500] = np.round(np.interp(np.arange(3500, 5500), np.arange(3500, 5500, 4), v[3500:5500:4]))
    elif damage == "duplicated":
        for stream in streams.values():
            stream.data[5000:5300] = stream.data[4000:4300]
    half = FRAMES // 2 * FRAME_CYCLES
    columns = {"id": np.array(["a", "b"]), "edge_a": np.array([0, half]), "edge_b": np.array([half, 2 * half])}
    columns["role"] = np.array(["fit", role])
    tables = {"segments": {key: TableColumn(value, "") for key, value in columns.items()}}
    return Record(attrs={}, streams=streams, tables=tables)


def test_an_undamaged_record_has_no_finding():
    assert adc_codes.findings(record()) == ()


def test_segments_without_a_role_are_not_looked_at():
    assert adc_codes.findings(record("spikes", role="none")) == ()


@pytest.mark.parametrize("damage", ["spikes", "stuck", "interpolated", "duplicated"])
def test_a_damage_is_reported_in_its_dwell(damage):
    found = adc_codes.findings(record(damage))
    assert damage in [f.kind for f in found]
    assert {(f.place, f.action) for f in found} == {("b", "report")}
