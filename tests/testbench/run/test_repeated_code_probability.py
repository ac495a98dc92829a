"""How often noise repeats a code: against samples of noise, and against what a healthy gyroscope sends."""

import numpy as np
import pytest

from fpga_model import digital_sid, fault_monitor
from testbench.config import Config
from testbench.run import build, repeated_code_probability
from tests.testbench.bench_setup import configured


@pytest.mark.parametrize("sigma", [0.3, 0.82, 2.6, 4.5, 5.1, 40.0])
def test_repeats_is_what_samples_of_noise_do(sigma):
    codes = np.rint(np.random.default_rng(1).normal(0.0, sigma, 400_000))
    p = np.mean(codes[1:] == codes[:-1])
    assert repeated_code_probability.repeats(sigma) == pytest.approx(p, abs=5 * np.sqrt(p / len(codes)))


def test_no_noise_repeats_for_ever():
    assert repeated_code_probability.repeats(0.0) == 1.0
    assert repeated_code_probability.alarm((0.0, 1.0), 1000) == 1.0
    assert repeated_code_probability.alarm((0.5, 0.5), 2) == pytest.approx(0.75**2)


def test_the_decision_states_what_is_computed():
    """docs/decisions/0016-frozen-channels.md: 0.108, 0.062, 0.30, 2e-17 per frame; 0.34 of the samples."""
    drive, _, sense, _ = repeated_code_probability.adc_repeats(Config())
    assert (round(drive, 3), round(sense, 3)) == (0.108, 0.062)
    assert round(repeated_code_probability.alarm(repeated_code_probability.adc_repeats(Config()), 1), 2) == 0.30
    assert 1e-17 < repeated_code_probability.adc_alarm(Config()) < 2e-17
    assert round(repeated_code_probability.sar_repeats(Config())[0], 2) == 0.34
    assert repeated_code_probability.sar_alarm(Config()) < 1e-100


@pytest.mark.parametrize(
    ("board", "noise", "stuck", "still"),
    [
        ("analog_sid", {}, True, True),
        ("analog_sid", {"noise__adc": False}, False, True),
        ("analog_sid", {"plant__adc_noise_drive_v": 1e-6}, False, True),
        ("digital_sid", {}, False, True),
        ("digital_sid", {"noise__cv": False}, False, False),
        ("digital_sid", {"plant__cv_noise_v_per_rthz": 2e-9}, False, False),
    ],
)
def test_the_checks_are_on_where_the_noise_makes_them_certain(board, noise, stuck, still):
    p = build.firmware(configured(firmware__board=board, **noise))
    assert p.control.sequencer.faults.stuck == (fault_monitor.design().stuck if stuck else 0)
    assert p.sid.still == (digital_sid.STILL_TICKS if still else 0)
