"""docs/faults.md: every row against an experiment and against what is expected of the fault; hours without one."""

import math
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from fpga_model import fault_monitor, sequencer
from testbench.run.simulation import FRAME
from tests.testbench.run import fault_table

sys.path.append(str(Path(__file__).resolve().parents[3] / "docs"))

import faults_page

from testbench.console.results import read_results

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
CASES = {f"{case.board}: {case.name}": case for case in fault_table.cases()}
FROZEN = [name for name in CASES if "frozen" in name and "temperature" not in name]
QUICK = [*FROZEN, "analog_sid: ADC silent", "analog_sid: sense DAC stuck at 0", "analog_sid: one frame repeated"]
RECURRENT = [name for name in CASES if " of 10 ms" in name or " of 50 ms" in name]
WITHIN_MS = 50.0


def written():
    """Cells of the page's table by name."""
    _, (table,) = read_results("fault_table")
    return {f"{row[0]}: {row[1]}": row for row in table.rows}


def confirm(name):
    """The experiment gives what is expected, and what the page says."""
    case = CASES[name]
    row = fault_table.run(case)
    assert row.seen_by == case.expected
    assert faults_page.cells(case, row) == written()[name]
    return row


def test_the_page_has_every_case_and_no_other():
    assert list(written()) == list(CASES)
    assert len(CASES) >= 25


def test_the_page_says_what_is_expected_to_see_each_fault():
    assert {name: row[2] for name, row in written().items()} == {name: case.expected for name, case in CASES.items()}


@pytest.mark.parametrize("name", [*QUICK, *RECURRENT])
def test_faults_of_which_the_page_says_the_most(name):
    confirm(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASES if name not in [*QUICK, *RECURRENT]])
def test_every_other_fault(name):
    confirm(name)


def test_spikes_of_a_thousand_codes_are_seen_and_a_jump_of_the_rate_is_none():
    spikes = tuple(fault_table.bursts("adc_offset", "sense_sin", 1000, 1e-3, 10e-3))
    assert "adc_sense_sin jumps" in fault_table.run(fault_table.Case("", "summary", spikes)).warnings[0]
    for board in (fault_table.ANALOG, fault_table.DIGITAL):
        row = fault_table.run(fault_table.Case("", "", board=board, rate_dps=-200.0))
        assert not [text for text in row.warnings if "jumps" in text]


@pytest.mark.parametrize("name", FROZEN)
def test_a_frozen_channel_is_flagged_in_time_and_leaves_no_good_rate(name):
    """Written in the page, which `test_faults_of_which_the_page_says_the_most` holds against experiments."""
    _, _, seen_by, seen_ms, good_ms, _, state = written()[name]
    assert seen_by in ("STUCK", "STALE")
    assert float(seen_ms) <= WITHIN_MS
    assert float(good_ms) <= float(seen_ms)
    assert state == "STANDBY"


def test_each_sense_channel_of_both_boards_is_among_the_frozen():
    wanted = {"analog_sid: sense_sin frozen", "analog_sid: sense_cos frozen", "digital_sid: sample of y frozen"}
    assert wanted <= set(FROZEN)


def columns(state, flags, word=0):
    return {"state": np.array(state), "flags": np.array(flags), "rate_word": np.full(len(state), word)}


def test_what_is_seen_first():
    nominal = {"word_v_per_deg_s": 0.01}
    locked, other = [sequencer.LOCKED] * 20, [sequencer.BALANCE] * 8

    def row(state, flags, warnings=()):
        return fault_table.row_of(columns(state, flags), 3.5, warnings, nominal)

    assert row(locked, [0] * 20)[:4] == ("nothing", math.inf, "LOCKED", math.inf)
    assert row(locked, [0] * 20, ("drift",)).seen_by == "summary"
    assert row(locked, [0] * 6 + [8] * 14)[:4] == ("STUCK", 0.125 * 2.5, "LOCKED", 0.125 * 2.5)
    assert row(locked[:12] + other, [0] * 20)[:4] == ("lock", 0.125 * 8.5, "BALANCE", 0.125 * 8.5)
    # a flag that leaves the rate good
    assert row(locked, [0] * 6 + [fault_monitor.QSC_RAIL] * 14)[:4] == ("QSC_RAIL", 0.125 * 2.5, "LOCKED", math.inf)


def test_alarms_count_frames():
    frames = np.zeros((5, len(FRAME)), np.int64)
    frames[:, FRAME["state"]] = [sequencer.LOCKED] * 4 + [sequencer.KICK]
    frames[:, FRAME["flags"]] = [0, fault_monitor.STUCK, fault_monitor.QSC_RAIL, 0, 0]
    alarms = faults_page.Alarms()
    alarms.add(0, frames, None)
    assert (alarms.frames, alarms.flagged, alarms.bad) == (5, 2, 2)
    assert alarms.flags == fault_monitor.STUCK | fault_monitor.QSC_RAIL


@pytest.mark.slow
@pytest.mark.parametrize("board", [fault_table.ANALOG, fault_table.DIGITAL])
def test_no_false_alarm_in_two_hours(board):
    """57.6 million frames each; the digital board takes minutes."""
    alarms, warnings = faults_page.quiet_hours(board, 2.0)
    assert (alarms.frames, alarms.flagged, alarms.flags, alarms.bad) == (57_600_000, 0, 0, 0)
    assert warnings == ()
