"""Runs of tracing: the clock of a run from a locked state is that of the record, and what a law begins is forgotten."""

import numpy as np
import pytest

from testbench import config
from testbench.measured.closed_loop import loop_runs
from testbench.measured.closed_loop.loop_difference_plant import disable_retiming
from testbench.measured.closed_loop.loop_runs import FAST, Model, Run
from testbench.measured.record.recording_plan import Condition

CONDITION = Condition("one", 5.0, 0.0, None, 25.0, 0.0, settle_s=1.5, seconds=0.1, role="fit")
LAW = "cv_y = 1e-5 {} cx"


@pytest.fixture(scope="module")
def bench():
    return loop_runs.Bench(1)


def change(bench, condition, law):
    """Change of V_q^2 in a dwell by a law."""
    own = config.Config()
    uniform = disable_retiming(own)
    base, moved = (Run(Model(uniform, laws), condition, 3, own, 0, True) for laws in ((), (LAW.format(law),)))
    rows = bench.run([base, moved], FAST)
    count = loop_runs.feature_count(condition) // len(loop_runs.NAMES)
    first = count * loop_runs.NAMES.index("v_q2")
    return float(np.mean((rows[1] - rows[0])[first : first + count]))


@pytest.mark.parametrize("settle_s", [1.5, 4.0])
def test_a_law_of_the_time_from_power_on_has_that_of_the_dwell(bench, settle_s):
    condition = CONDITION._replace(settle_s=settle_s)
    end_s = loop_runs.START_TICKS / 1e6 + settle_s + condition.seconds
    found = change(bench, condition, "lag(3)") / change(bench, condition, "")
    # the quadrature loop follows the law by 0.2 s
    least, most = (1 - np.exp(-t / 3) for t in (end_s - 0.4, end_s - 0.1))
    assert least < found < most


def test_a_law_that_begins_with_the_run_is_forgotten_at_the_dwell(bench, monkeypatch):
    """Against twice the time: the remainder is below a thousandth, and shorter runs leave more."""
    known = change(bench, CONDITION, "")
    monkeypatch.setattr(loop_runs, "LOCK_SETTLE_S", 5.5)
    longer = change(bench, CONDITION._replace(settle_s=4.0), "")
    assert known == pytest.approx(longer, rel=1e-3)
    monkeypatch.setattr(loop_runs, "LOCK_SETTLE_S", 0.5)
    assert change(bench, CONDITION, "") != pytest.approx(longer, rel=1e-3)


# a board of a data sheet over the default one; its V_q comes near its end slowly
SLOW = {"fx_hz": 1.0008, "fy_hz": 1.0007, "k_vf_drive_n_per_v": 1.0505, "k_vf_sense_n_per_v": 0.9648}
SLOW |= {"dcdx_f_per_m": 1.0233, "dcdy_f_per_m": 1.0561, "kq_n_per_m_per_v2": 0.9271, "kxy_n_per_m": 1.2954}
SLOW |= {"kxy_tc_below_per_k": 0.9658, "kxy_tc_above_per_k": 0.9933, "qx": 1.1447, "qy": 1.7929, "dxy_ratio": 0.7049}
SLOW |= {"tcf_per_k": 1.0337, "dlnq_per_k": 0.9742, "sid_switch_s": 1.0969, "sid_charge_mismatch": 0.5238}
SLOW |= {"drive_pole_1_s": 1.0325, "sense_pole_1_s": 1.0751}


def test_a_board_that_locks_late_is_waited_for(bench):
    condition = CONDITION._replace(a_um=4.0, from_dps=150.0, rate_dps=-60.0, temperature_degc=65.0, detune_deg=-30.0)
    own = config.Config()
    slow = config.changed(own, {f"plant.{key}": getattr(own.plant, key) * share for key, share in SLOW.items()})
    assert bench.locked_state(own, condition).tick == loop_runs.START_TICKS
    assert bench.locked_state(slow, condition).tick == 2 * loop_runs.START_TICKS
