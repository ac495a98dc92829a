"""Dwells with ramps of rate and temperature: recorded, read back, and run by both engines."""

import numpy as np
import pytest
from numba import config as numba_config

from testbench import config as configuration
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_record, loop_runs
from testbench.measured.closed_loop.loop_runs import EXACT, FAST, Model, Run
from testbench.measured.record import checks, produce, recording_plan, schema
from testbench.measured.record.recording_plan import Condition

pytestmark = pytest.mark.skipif(numba_config.DISABLE_JIT, reason="hours without the compiler")

RATE_DPS, RAMP_DPS_S, TEMP_DEGC, RAMP_K_S = 50.0, -100.0, 20.0, 5.0
CONDITION = Condition("ramp", 5.0, RATE_DPS, None, TEMP_DEGC, settle_s=2.2, seconds=1.2)
RAMPED = CONDITION._replace(rate_ramp_dps_s=RAMP_DPS_S, temperature_ramp_k_s=RAMP_K_S)


@pytest.fixture(scope="module")
def record():
    rows = {key: getattr(RAMPED, key) for key in ("id", "settle_s", "seconds", "rate_dps", "temperature_degc")}
    ramps = {key: getattr(RAMPED, key) for key in ("rate_ramp_dps_s", "temperature_ramp_k_s")}
    return produce.record(recording_plan.from_dict({"name": "ramps", "repeats": 1, "condition": [rows | ramps]}))


def _slopes(values):
    """Change per second of the fine bins of force and frequency word, behind the first 600 ms."""
    count = len(loop_runs.fine_bins(RAMPED)) - 1
    fine = values[loop_runs.feature_count(RAMPED) :].reshape(-1, count)[:, 75:]
    t_s = np.arange(fine.shape[1]) * loop_runs.FINE / 8000
    return {name: np.polyfit(t_s, fine[loop_runs.NAMES.index(name)], 1)[0] for name in ("f_word", "force")}


def test_frequency_and_force_follow_the_ramps(record):
    """df/dt = -27e-6 f dT/dt; the force changes per deg/s as its mean does; in both engines and in a record."""
    model = configuration.Config()
    c = RAMPED._replace(settle_s=0.5)
    bench = loop_runs.Bench(1)
    flat = c._replace(rate_ramp_dps_s=0.0)
    runs = [Run(Model(model), one, 5, model) for one in (c, flat, flat._replace(rate_dps=-RATE_DPS))]
    fast, *still = bench.run(runs, FAST, fine=True)
    (exact,) = bench.run(runs[:1], EXACT, fine=True)
    at = loop_runs.NAMES.index("force") * (len(loop_runs.bins(c)) - 1)
    per_dps = (still[0][at] - still[1][at]) / (2 * RATE_DPS)
    for values in (fast, exact, loop_record.measured_features(record, "ramps", {}).values["ramp"][0]):
        slopes = _slopes(values)
        assert slopes["f_word"] == pytest.approx(-27e-6 * 11002.3 * RAMP_K_S, rel=0.01)
        assert slopes["force"] == pytest.approx(per_dps * RAMP_DPS_S, rel=0.02)


def test_a_record_with_ramps_is_checked_and_read(record):
    assert not [f for f in checks.check(record) if f.level == schema.REFUSED]
    (c,) = loop_record.measured_features(record, "ramps", {}).conditions
    assert (c.rate_dps, c.rate_ramp_dps_s) == pytest.approx((RATE_DPS, RAMP_DPS_S), rel=1e-6)
    assert (c.temperature_degc, c.temperature_ramp_k_s) == pytest.approx((TEMP_DEGC, RAMP_K_S), rel=1e-6)


def test_a_dwell_that_is_no_ramp_is_refused(record):
    table = record.tables["stimulus/rate"]
    kept = table["rate"].data.copy()
    table["rate"].data[-75:] += 20.0
    try:
        with pytest.raises(ConfigError, match=r"/stimulus/rate: .* from a straight line in segment ramp"):
            loop_record.measured_features(record, "ramps", {})
    finally:
        table["rate"].data[:] = kept
