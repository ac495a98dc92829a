"""A gyroscope at rest: a vibration is found on its axis and at its frequency, and none where there is none."""

import numpy as np
import pytest

from analog_frontend.effects import rate_vibration
from testbench.errors import FileError
from testbench.measured.exam.staged import add_in_stages
from testbench.measured.formats import gyro_npz
from testbench.measured.openers import open_problem
from testbench.measured.parts import gyro_stationary
from tests.testbench.measured.parts import made


def test_a_vibration_is_found_on_its_axis(tmp_path):
    path = made.rest(tmp_path / "a.zip", np.random.default_rng(1), (1, 12.0, 15.0, 0.2), axes=2)
    found = add_in_stages(open_problem([path.with_name("a.zip.npz")], {}), most=1).json
    law = found["effects"][0]["law"]
    assert law.startswith("y: vibration")
    assert abs(np.log(float(law.split()[-2]) / 12.0)) < 0.07
    row = found["heldout"]["spectrum y"]
    assert row["after"] < 1.2 * row["floor"]
    assert row["before"] > 1.5 * row["floor"]
    other = found["heldout"]["spectrum x"]
    assert other["after"] == other["after_one_law"] == other["before"], "no law acts on x"


def test_a_broad_hump_is_not_the_vibration_that_was_tried(tmp_path):
    """Noise of quality 0.6: a line's frequency and width are carried out of their priors by it."""
    made.rest(tmp_path / "h", np.random.default_rng(1), (1, 9.0, 0.6, 0.4), axes=2)
    found = add_in_stages(open_problem([tmp_path / "h.npz"], {}), most=1).json
    assert found["effects"] == []
    assert found["superseded"][0].startswith("y: vibration")
    assert found["verdict"] in ("unexplained", "noise-model")


def test_white_noise_gains_no_effect(tmp_path):
    made.rest(tmp_path / "b", np.random.default_rng(2), axes=1)
    assert add_in_stages(open_problem([tmp_path / "b.npz"], {}), most=1).json["effects"] == []


def test_a_line_has_its_power():
    hz = np.linspace(0.001, 2000, 2_000_000)
    assert np.trapezoid(gyro_stationary.line(hz, 20.0, 12.0), hz) == pytest.approx(1.0, rel=1e-3)


def test_the_effects_profile_has_the_rms_and_the_frequency():
    t, x = np.array(rate_vibration.profile(400.0, 5.0, 10.0, 0.3, 1)).T
    assert np.std(x) == pytest.approx(0.3, rel=0.1)
    power = np.abs(np.fft.rfft(x)) ** 2
    centre = np.fft.rfftfreq(len(x), t[1])[np.argmax(np.convolve(power, np.ones(51), "same"))]
    assert centre == pytest.approx(5.0, rel=0.05)
    assert rate_vibration.profile(1.0, 5.0, 10.0, 0.0, 1) == []


@pytest.mark.parametrize(
    "held",
    [
        {"a": np.zeros((30000, 3), int)},
        {"a": np.zeros((5, 3), int), "l_deg_s": 1.0, "f_hz": 1.0},
        {"a": np.array([{}], object)},
    ],
)
def test_an_archive_of_another_form_is_refused(tmp_path, held):
    np.savez(tmp_path / "x.npz", **held)
    with pytest.raises(FileError):
        gyro_npz.read(tmp_path / "x.npz")
