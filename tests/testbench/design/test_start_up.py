"""The predicted start-up against the engine, board by board."""

import numpy as np
import pytest

from testbench.config import Config, changed
from testbench.design import start_up
from testbench.paper.loop import confirm
from testbench.run import simulate
from testbench.run.simulation import Simulation

QUIET = changed(Config(), confirm.QUIET)
CASES = {
    "default": {},
    "45 Hz below": {"plant.fx_hz": 10957.3, "plant.fy_hz": 10818.3},
    "weak": {"plant.k_vf_drive_n_per_v": 2.4e-7, "plant.dcdx_f_per_m": 0.9e-7, "plant.qx": 1.4e5},
    "slow SID": {"plant.sid_c_f": 175e-9},
}


def locked_s(config, limit_s=5.0):
    sim = Simulation(config, 25.0, 25.0)
    sim.keep_codes = sim.keep_rows = False
    return simulate.start(config, sim, 0.0, 25.0, limit_s=limit_s)


@pytest.mark.parametrize("name", CASES)
def test_lock_is_when_the_engine_locks(name):
    config = changed(QUIET, CASES[name])
    assert start_up.predict(config).lock_s == pytest.approx(locked_s(config), rel=0.01)


def test_what_the_search_cannot_find_is_said():
    far = start_up.predict(changed(QUIET, {"plant.fx_hz": 11100.0, "plant.fy_hz": 10961.0}))
    assert far.lock_s is None
    assert "firmware.search_limit_hz = 80" in far.failure
    assert far.found_hz == pytest.approx(97.7, abs=0.5)
    deaf = start_up.predict(changed(QUIET, {"plant.dcdx_f_per_m": 1e-9}))
    assert deaf.lock_s is None
    assert "firmware.search_min_v" in deaf.failure


def test_the_slowest_is_the_last_and_a_failure_is_later_than_all():
    found = [start_up.StartUp(0.0, 0.4, 0.5, 0.6, t) for t in (1.0, 2.0)]
    assert start_up.slowest(found).lock_s == 2.0
    failed = start_up.StartUp(0.0, 0.4, None, None, None, "nothing")
    assert start_up.slowest([*found, failed]) is failed
    assert start_up.promised_s(failed) is None


def test_corners_stand_at_the_tolerances():
    n = Config().nominal
    found = [c.plant for c in start_up.corners(Config())]
    assert {round(p.fx_hz / n.fx_hz, 6) for p in found} == {0.995, 1.005}
    assert {round(p.sid_c_f / n.sid_c_f, 6) for p in found} == {0.9, 1.1}
    assert {round(p.dcdy_f_per_m / p.dcdx_f_per_m, 6) for p in found} == {round(0.9 / 1.1, 6), round(1.1 / 0.9, 6)}
    assert {round((p.fx_hz - p.fy_hz) / (n.fx_hz - n.fy_hz), 6) for p in found} == {0.9, 1.1}
    assert np.ptp([np.log(p.qx) for p in found]) == pytest.approx(np.log(n.q_tolerance))
