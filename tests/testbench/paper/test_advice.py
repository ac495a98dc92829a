"""Rounding, notch, sensitivities, and what `gyro loop` says and writes."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from testbench.commands import main as cli
from testbench.config import Config, changed
from testbench.paper.loop import advisor, limit_cycles, loop_page, notch_loop, sensitivity
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters
from tests.testbench.paper import browser, growing

CONFIG = Config()
DEFAULT = loop_parameters(CONFIG)


# ---- rounding --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0.3, 0.5, 0.6, 0.71, 1.0, 1.7, 5.3, 40.0])
def test_force_of_a_rounded_sine_is_its_first_harmonic(size):
    turns = (np.arange(200_000) + 0.5) / 200_000
    sine = np.sin(2 * math.pi * turns)
    for words in (16, 256):  # to a code of 20 bits, of 16 bits
        want = 2 * np.mean(np.floor(size * sine + 0.5) * sine) * words
        found = limit_cycles.force_amplitude(words * size, words)
        assert found == pytest.approx(want, abs=1.25e-3 * words)
        assert limit_cycles.force_amplitude(-words * size, words) == -found


def test_rounding_vanishes_in_a_large_sine():
    for size in (200.3, 255.9):
        assert limit_cycles.force_amplitude(16 * size, 16) == pytest.approx(16 * size, abs=0.5)


def test_the_dead_band_is_half_a_step_of_the_converter():
    """57.9 uV per deg/s behind a gain of 12: 5 of 1457 codes per deg/s, and noise that is five steps."""
    rest = limit_cycles.resolution(DEFAULT)
    assert 3600 * rest.adc_dead_band_dps == pytest.approx(12.4, abs=0.2)
    assert 3600 * rest.dac_lsb_dps == pytest.approx(6.66, rel=0.03)
    assert rest.v_q_lsb_dps == pytest.approx(2 * 100 * (5.5 / 65536) / 4.52, rel=0.02)
    assert rest.dither == pytest.approx(5.2, abs=0.3)


def test_the_step_of_the_force_is_that_of_the_design():
    """16 bits instead of 20; nothing else of the rounding depends on the force DAC."""
    short = changed(CONFIG, {"design.sense_dac": "DAC8811"})
    fine, coarse = limit_cycles.resolution(DEFAULT), limit_cycles.resolution(loop_parameters(short))
    assert coarse.dac_lsb_dps == pytest.approx(16 * fine.dac_lsb_dps, rel=0.01)
    assert coarse.adc_dead_band_dps == pytest.approx(fine.adc_dead_band_dps, rel=1e-3)


def test_quantised_loops_follow_the_linear_ones_and_rest_within_the_dead_band():
    """From the linear rest a rate step of 0.1 deg/s: the word arrives within the dead band, then nothing moves."""
    frames = 16_000
    rate = np.where(np.arange(frames) < 4000, 0.0, 0.1)
    run = limit_cycles.simulate_hunt(CONFIG, rate, frames * DEFAULT.frame_s)
    assert np.ptp(run.word[:4000]) == 0
    late = run.word[-2000:]
    moved = (late.mean() - run.word[0]) / (advisor.dc_gain(lp.close(DEFAULT)) * lp.DEG)
    assert moved == pytest.approx(0.1, abs=2 * limit_cycles.resolution(DEFAULT).adc_dead_band_dps)
    assert np.ptp(run.codes[-2000:, 0]) <= 10


def test_a_finer_converter_lets_v_q_hunt():
    """With steps of one code the error of one V_q code is seen: the integrator goes to and fro between two codes."""
    run = limit_cycles.simulate_hunt(CONFIG, 0.0, 2.0, p=DEFAULT._replace(step_code=1.0))
    late = run.quadrature_code[-8000:]
    assert np.ptp(late) == 1
    assert np.count_nonzero(np.diff(late)) >= 4
    coarse = limit_cycles.simulate_hunt(CONFIG, 0.0, 2.0)
    assert np.ptp(coarse.quadrature_code[-8000:]) == 0


def test_noise_of_five_steps_removes_the_dead_band():
    """Means of the word follow a rate far below the dead band."""
    dither = limit_cycles.resolution(DEFAULT).code_noise
    words = [
        limit_cycles.simulate_hunt(CONFIG, rate, 6.0, code_noise=dither).word[-32_000:].mean() for rate in (0.0, 0.002)
    ]
    assert words[1] - words[0] == pytest.approx(0.002 * 8794, rel=0.2)


# ---- notch -----------------------------------------------------------------------------------------------------------


def test_a_notch_takes_the_ring_where_it_stands():
    e = notch_loop.effect(DEFAULT)
    assert 100 * e.ring_without == pytest.approx(0.34, abs=0.02)
    assert e.ring_with < 0.1 * e.ring_without
    assert abs(e.bandwidth_with_hz - e.bandwidth_without_hz) < 0.2
    assert e.delay_ms == pytest.approx(0.165, abs=0.01)
    assert e.left_db[0] < -60
    # half its width off, half of the power is left
    assert e.left_db[10] == pytest.approx(-3, abs=0.4)
    assert e.left_db[2] == pytest.approx(-14, abs=1)


def test_in_front_of_the_pi_a_notch_takes_the_damping_of_the_ring_away():
    """So it stands behind the loop: the ring lasts 13 times as long, although the loop is stable."""
    loop, inside = lp.close(DEFAULT), notch_loop.close_with_notch(DEFAULT, notch_loop.design(139.0, 20.0))
    assert lp.radius(inside) < 1
    split = DEFAULT.split_hz
    assert advisor.ringing_pole(loop, split).tau_s == pytest.approx(0.308, abs=0.01)
    assert advisor.ringing_pole(inside, split).tau_s == pytest.approx(4.13, abs=0.1)
    # far away and narrow, it changes nothing
    harmless = notch_loop.close_with_notch(DEFAULT, notch_loop.design(1900.0, 0.5))
    assert advisor.bandwidth(harmless)[0] == pytest.approx(advisor.bandwidth(loop)[0], abs=0.01)


def test_the_analysis_knows_the_notch_of_the_firmware():
    assert not loop_page.Study(CONFIG).in_firmware
    study = loop_page.Study(changed(CONFIG, {"firmware.notch_hz": 137.0, "firmware.notch_width_hz": 8.0}))
    assert (study.notch.centre_hz, study.notch.width_hz) == (137.0, 8.0)
    assert loop_page.as_json(study)["notch"]["in_firmware"]
    titles = [table.title for table in loop_page.tables(study)]
    assert "The firmware's notch in the rate output, 137.0 Hz, 8 Hz wide" in titles
    # it stands behind the loop: no margin is another
    assert study.advice == loop_page.Study(CONFIG).advice


def test_a_notch_is_one_at_rest_and_refuses_nonsense():
    n = notch_loop.design(139.0, 20.0)
    assert abs(notch_loop.gain(n, 0.001)[0]) == pytest.approx(1.0, abs=1e-9)
    assert notch_loop.apply_notch(n, np.full(50, 7.0)).tolist() == pytest.approx([7.0] * 50)
    with pytest.raises(ValueError, match="notch_width_hz: 200 Hz is outside"):
        notch_loop.design(139.0, 200.0)
    assert notch_loop.effect(advisor.vary_parameters(DEFAULT, sid_hz=400.0)) is None


# ---- growth ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tau_s", "hz"), [(0.02, 0.0), (0.03, 137.0)])
def test_growth_reads_what_grows(tau_s, hz):
    t = np.arange(4000) / 8000
    words = 100 * (np.exp(t / tau_s) * np.cos(2 * math.pi * hz * t) - 1)
    found = growing.growth(words)
    assert found[0] == pytest.approx(tau_s, rel=0.05)
    assert found[1] == pytest.approx(hz, abs=0.5)
    with pytest.raises(ValueError, match="growth"):
        growing.growth(np.zeros(4000))


# ---- sensitivity -----------------------------------------------------------------------------------------------------


def test_noise_adds_up_to_the_arw_of_the_default_device():
    """0.134 to 0.138 deg/sqrt(h) (docs/plant.md), of which C/V is nearly all; damping 7.8e-4."""
    assert 0.134 <= sensitivity.arw_deg_per_rth(DEFAULT) <= 0.138
    share = sensitivity.density_dps(DEFAULT)
    assert share["thermomechanical"] * 60 / math.sqrt(2) == pytest.approx(7.8e-4, rel=0.02)
    assert share["cv"] > 5 * share["adc"] > 50 * share["adc_rounding"]


def test_rounding_of_v_q_hardly_reaches_the_rate():
    """Its quadrature as white noise, passed on no more than the leak ye1 + xe2' of a loop that is open for it."""
    quadrature = limit_cycles.resolution(DEFAULT).v_q_lsb_dps / math.sqrt(12) * math.sqrt(2 / 8000)
    leak = math.tan(DEFAULT.ye1_rad + DEFAULT.xe2_rad)
    assert 0 < sensitivity.density_dps(DEFAULT)["v_q_rounding"] < quadrature * leak
    assert sensitivity.null_v(DEFAULT) == pytest.approx(4.52, abs=1e-4)
    (row,) = sensitivity.rows(CONFIG, [parameter("v_q_lsb_v")])
    assert all(abs(row.change[name]) < least for name, least in sensitivity.RESOLUTION.items())


def parameter(name):
    (found,) = [p for p in sensitivity.PARAMETERS if p.name.endswith("." + name)]
    return found


def test_derivatives_are_those_that_formulas_give():
    names = ("sense_dac_delay_s", "k_vf_sense_n_per_v", "fx_hz", "cv_noise_v_per_rthz", "adc_step_code")
    table = sensitivity.rows(CONFIG, [parameter(name) for name in names])
    delay, force, mode, noise, step = (row.change for row in table)
    # 10 ns of 1/f_d are 0.0396 deg; the scale factor goes with tan(ye1 + xe2')
    turn = DEFAULT.ye1_rad + DEFAULT.xe2_rad
    assert delay["ye1"] == pytest.approx(360 * 11002.3 * 10e-9, rel=1e-4)
    assert delay["scale_factor"] == pytest.approx(1e6 * math.tan(turn) * delay["ye1"] * lp.DEG, rel=1e-2)
    assert force["scale_factor"] == pytest.approx(-1e4, rel=1e-3)
    assert mode["f_d"] == pytest.approx(1000, rel=1e-3)
    assert noise["arw"] / (1e3 * sensitivity.arw_deg_per_rth(DEFAULT)) == pytest.approx(0.01 * 0.976, rel=0.02)
    assert step["arw"] > 0
    first = sensitivity.ranking(table, "scale_factor")
    assert [row.parameter.name for row in first[:2]] == ["plant.k_vf_sense_n_per_v", "plant.sense_dac_delay_s"]
    assert sensitivity.matrix(table).shape == (5, len(sensitivity.OBSERVABLES))


def test_every_parameter_exists_and_can_be_moved():
    for p in sensitivity.PARAMETERS:
        _, after, h = sensitivity.move_parameter(CONFIG, p, 1)
        assert h
        assert after != DEFAULT or p.name.startswith(("plant.drive", "plant.adc_delay"))
    said = f"{len(sensitivity.PARAMETERS)} parameters against {len(sensitivity.OBSERVABLES)} observables"
    assert said in (Path(__file__).parents[3] / "docs/loop.md").read_text()


# ---- command line and page -------------------------------------------------------------------------------------------


def called(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        cli.main(["loop", *arguments])
    out, err = capsys.readouterr()
    return stop.value.code, out, err


def test_json_of_the_default_loop(capsys):
    code, out, _ = called(capsys, "--json")
    said = json.loads(out)
    assert code == 0
    assert said["stable"] is True
    assert 24 <= said["bandwidth_hz"] <= 30
    assert said["warnings"][0].startswith("ye1 + xe2' = 10.18 deg")
    assert said["warnings"][1].startswith("Ring diode: ")
    assert len(said["crossings"]) == 3


def test_a_margin_that_does_not_exist_is_none_with_its_reason():
    rows = {row[0]: row[1:] for row in loop_page.tables(loop_page.Study(CONFIG))[0].rows}
    assert rows["FTR gain margin, downwards"] == ("none", "stable down to -60 dB")
    assert rows["FTR gain margin, upwards"][1] == "dB"


def test_tables_of_an_unstable_loop(capsys):
    code, out, _ = called(capsys, "--set", "plant.sid_c_f=25e-9")
    assert code == 0
    assert "unstable: oscillates at 136" in " ".join(out.split())
    code, _, err = called(capsys, "--set", "plant.sid_c_f=25e-9", "--simulate")
    assert code == 2
    assert err.count("\n") == 1


def test_a_board_without_this_analysis_is_one_line(capsys):
    code, _, err = called(capsys, "--set", "firmware.board=digital_sid")
    assert code == 2
    assert "analog_sid" in err
    assert err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("stable", [True, False])
def test_the_page_is_written_whole(tmp_path, stable):
    config = CONFIG if stable else changed(CONFIG, {"plant.sid_c_f": 25e-9})
    path = loop_page.write(
        loop_page.Study(config), tmp_path, coarse=13, parameters=[parameter("fx_hz"), parameter("sid_switch_s")]
    )
    text = path.read_text()
    assert text.count("<figure>") == (7 if stable else 1)
    assert "Misprints of the paper" in text
    assert ("unstable" in text.split("<table>")[0]) is not stable
    assert [p.name for p in tmp_path.iterdir()] == ["loop.html"]
    shown = browser.parsed(text)
    assert shown.pictures == len(shown.captions)
    assert all(len(caption) > 60 for caption in shown.captions)
    if browser.BROWSER:
        (tmp_path / "seen").mkdir()
        shown, picture = browser.seen(path, tmp_path / "seen")
        assert picture.stat().st_size > 50_000
        values = {row[0]: row[1] for row in shown.rows if len(row) == 3}
        assert values["FTR gain margin, upwards"] == ("12.6" if stable else "-")
