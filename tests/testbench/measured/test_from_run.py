"""`gyro run --gyrorec`: the record passes every rule and replays to 0 LSB, or is refused."""

import pytest
from numba import config as numba_config

from testbench import config
from testbench.errors import ConfigError
from testbench.measured.record import from_run, load_record


@pytest.mark.skipif(numba_config.DISABLE_JIT, reason="minutes without the compiler")
def test_the_record_of_a_run_replays(tmp_path):
    made = config.changed(config.Config(), {"scenario.seconds": 0.05, "scenario.rate_dps": 10.0, "noise.seed": 4})
    from_run.write(made, tmp_path / "run.h5")
    loaded = load_record.load(tmp_path / "run.h5")
    assert loaded.residual.decidable
    assert loaded.residual.first is None
    assert not loaded.is_blocked


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"scenario.rate_dps": [[0.0, 0.0], [1.0, 10.0]]}, "rate_dps"),
        ({"scenario.faults": [[0.5, "adc_silent", "adc", 0, 0.1]]}, "faults"),
        ({"scenario.origin": "power_on"}, "origin"),
    ],
)
def test_what_a_record_of_one_condition_cannot_hold(values, said):
    with pytest.raises(ConfigError, match=said):
        from_run.plan_from_config(config.changed(config.Config(), values))
