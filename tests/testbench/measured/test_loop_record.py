"""A record as a problem: what is held out of another session, and what is not."""

from types import SimpleNamespace as Row

import numpy as np
import pytest

from fpga_model import agc, sequencer
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_record, loop_runs
from testbench.measured.record import check_tables, schema
from testbench.measured.record.sessions import segments
from testbench.run import build
from testbench.storage.record import TableColumn


@pytest.mark.parametrize(
    ("roles", "apart"),
    [
        (("fit", "", "validate"), True),
        (("fit", "validate", "fit"), False),
        (("validate", "fit", "validate"), False),
        (("", "fit", "fit"), True),
    ],
)
def test_held_out_dwells_of_a_fitted_power_on_are_not_of_another_session(monkeypatch, roles, apart):
    """Three dwells: the first two of one power-on, the last of the next."""
    dwells = [Row(first=first, role=role) for first, role in zip((100, 500, 1100), roles)]
    monkeypatch.setattr(loop_record, "sessions", lambda record: [Row(first=0), Row(first=1000)])
    monkeypatch.setattr(loop_record, "segments", lambda record: dwells)
    assert loop_record.has_independent_holdout(None) == apart


def test_set_points_are_those_of_the_registers_to_the_last_bit(small):
    model = check_tables.stated_config(small)
    nominal = build.nominal(model)
    wanted = next(raw for name, raw in schema.rows(small.tables["registers"], "name", "raw") if "setpoint" in name)
    s = segments(small)[2]
    assert loop_record.setpoints(small, model, s) == (s.a_set, s.detune)
    near, detune = loop_record.setpoints(small, model, s._replace(a_set=s.a_set * 1.003, detune=0.02))
    assert agc.setpoint(near, nominal["v_per_um"], nominal["adc_drive_v"]) == wanted
    assert detune == 0.0


def test_a_register_that_the_model_does_not_set_is_refused(own):
    table = own.tables["registers"]
    table["name"] = TableColumn(np.array(["phase_sense_ref", *table["name"].data[1:]]), "")
    s = segments(own)[2]
    with pytest.raises(
        ConfigError, match=r"/registers row 0: phase_sense_ref = \d+, but the configuration of the model sets 0"
    ):
        loop_record.setpoints(own, check_tables.stated_config(own), s)


def test_a_board_is_calm_from_its_lock_on_or_from_the_last_change(own):
    startup, settle, dwell = segments(own)[:3]
    state = own.streams["state"].data
    lock = int(np.flatnonzero(state[: dwell.first] != sequencer.LOCKED)[-1]) + 1
    assert startup.first < lock <= dwell.first
    assert loop_record.calm_from(own, dwell.first) == lock
    own.streams.pop("state")
    assert loop_record.calm_from(own, dwell.first) == settle.first
    rate = own.tables["stimulus/rate"]
    edge = (settle.first + 50) * 3250
    for key, value in (("edge", edge), ("rate", 40.0), ("unc", 50.0)):
        old = rate[key].data
        rate[key] = TableColumn(np.concatenate([old[:1], [value], old[1:]]).astype(old.dtype), rate[key].unit)
    assert loop_record.calm_from(own, dwell.first) == settle.first + 50


def test_a_record_without_a_fitted_segment_is_one_line(own):
    roles = own.tables["segments"]["role"]
    own.tables["segments"]["role"] = TableColumn(np.array(["none"] * len(roles.data)), "")
    with pytest.raises(ConfigError, match="/segments: no segment has the role fit"):
        loop_record.measured_features(own, "a", {})


def test_laws_see_the_time_from_power_on_at_which_the_dwells_were(monkeypatch):
    """Frames 14000 and 1.5 s of power-ons at 0 and 100000; a record that begins later says nothing of them."""
    powers = [Row(first=0, powered=True), Row(first=100_000, powered=True)]
    monkeypatch.setattr(loop_record, "sessions", lambda record: powers)
    dwells = [Row(first=14_000 + 12_080), Row(first=100_000 + 14_000 + 12_240)]
    assert loop_record._settle_s(None, dwells) == 1.5
    assert loop_record._settle_s(None, [Row(first=114_000 + 8_000 * 600)]) == 600.0
    powers[0] = Row(first=0, powered=False)
    assert loop_record._settle_s(None, dwells) == loop_runs.SETTLE_S
