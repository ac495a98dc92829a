"""The linear loops against the simulated ones: registers, edges and capacitors beside some thirty linear states."""

import math

import numba
import numpy as np
import pytest

from fpga_model.rates import FRAME_HZ
from testbench.config import Config, changed, phase_word
from testbench.errors import ConfigError
from testbench.paper.loop import advisor, confirm, limit_cycles, notch_loop, sensitivity
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters
from tests.testbench.paper import growing

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")

QUIET = changed(Config(), confirm.QUIET)
LINES = np.array(confirm.LINES_HZ, float)
CASES = {
    "default, noise on": Config(),
    "default": QUIET,
    "ye1 compensated": changed(QUIET, {"firmware.phase_sense_sine_deg": 9.2324}),
    "ye2 turned": changed(QUIET, {"firmware.phase_sense_ref_deg": 6.0}),
    "xe turned": changed(QUIET, {"firmware.phase_drive_ref_deg": 3.0}),
    "references at 26 MHz": changed(QUIET, {"firmware.reference_retimed": False}),
}
STEP_AT, STEP_DPS = round(2.5 * FRAME_HZ), 100.0
STEP = np.where(np.arange(round(3.5 * FRAME_HZ)) < STEP_AT, 0.0, STEP_DPS)


@pytest.fixture(scope="module")
def runs():
    """All cases under a multisine, and three under a step."""
    sine = confirm.multisine()
    steps = [CASES["default"], CASES["references at 26 MHz"], changed(QUIET, {"plant.sid_charge_c": 0.0})]
    done = confirm.run_profiles([*CASES.values(), *steps], [sine] * len(CASES) + [STEP] * len(steps))
    for run in done:
        assert run.locked
    names = [*CASES, "step", "step at 26 MHz", "step without charge"]
    return dict(zip(names, done)), sine


@pytest.mark.parametrize("case", CASES)
def test_simulated_response_is_that_of_the_analysis(runs, case):
    """Contract: 0.05 dB and 0.3 deg up to 60 Hz. Without noise it is a tenth of that and less."""
    found, sine = runs
    seen = confirm.measured_response(found[case], sine)
    ratio = seen / (lp.response(lp.close(loop_parameters(CASES[case])), LINES) * lp.DEG)
    db, deg = 20 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))
    assert np.max(np.abs(db)) < 0.05
    assert np.max(np.abs(deg)) < 0.3
    if "noise" not in case:
        assert np.max(np.abs(db)) < 0.005
        assert np.max(np.abs(deg)) < 0.02


def test_bandwidth_of_the_simulated_default(runs):
    """24 to 30 Hz, read off the simulated lines alone."""
    found, sine = runs
    level = 20 * np.log10(np.abs(confirm.measured_response(found["default"], sine)))
    level -= level[0]
    edge = np.interp(3.0103, -level[LINES > 15], LINES[LINES > 15])
    assert 24 < edge < 30
    assert edge == pytest.approx(advisor.analyse(loop_parameters(QUIET)).bandwidth_hz, abs=0.2)


def test_rest_scale_factor_and_step(runs):
    """Bias and scale factor of the words, the step's course, the ring, and the ring behind a notch."""
    found, _ = runs
    p = loop_parameters(CASES["references at 26 MHz"])
    a, words = advisor.analyse(p), found["step at 26 MHz"].columns["rate_word"].astype(float)
    before = words[STEP_AT - 400 : STEP_AT].mean()
    assert before == pytest.approx(a.bias_dps * a.lsb_per_dps, abs=30)  # half of the converter's dead band
    assert (words[-400:].mean() - before) / STEP_DPS == pytest.approx(a.lsb_per_dps, rel=200e-6)
    time_s = (np.arange(len(words)) - STEP_AT) / FRAME_HZ
    course = (words - before) / (words[-400:].mean() - before)
    want_s, want = notch_loop.step_words(p, 0.9)
    np.testing.assert_allclose(np.interp(want_s, time_s, course), want, atol=2e-3)
    ring = notch_loop.ring_share(time_s, course)
    assert ring == pytest.approx(notch_loop.ring_share(want_s, want), rel=0.05)
    behind = notch_loop.apply_notch(notch_loop.design(a.ring_hz, 20.0), course)
    assert notch_loop.ring_share(time_s, behind) < 0.15 * ring


def test_without_noise_the_loops_rest_in_the_dead_band(runs):
    """Not one LSB moves, if references are at 26 MHz or switches inject nothing; else a line appears (docs/loop.md)."""
    found, _ = runs
    still = slice(STEP_AT - 4000, STEP_AT)
    for case in ("step at 26 MHz", "step without charge"):
        for name in ("rate_word", "quadrature_code"):
            assert np.ptp(found[case].columns[name][still]) == 0, (case, name)
    moved = found["step"].columns["rate_word"][STEP_AT - 16000 : STEP_AT]
    assert 20 < np.ptp(moved) < 200


def test_a_force_below_a_step_of_a_short_dac_is_what_rounding_makes_of_it():
    """16 bits, 0.8 codes of force: a sine of 0.64 codes makes it, and the simulated word comes to rest there."""
    settings = {"design.sense_dac": "DAC8811", "firmware.reference_retimed": False}
    config = changed(QUIET, settings)
    p = loop_parameters(config)
    a, rest = advisor.analyse(p), limit_cycles.resolution(p)
    rate_dps = 0.8 * rest.dac_lsb_dps - a.bias_dps
    (run,) = confirm.run_profiles([config], [np.full(round(3.0 * FRAME_HZ), rate_dps)])
    word = run.columns["rate_word"][-4000:].mean()
    hunted = limit_cycles.simulate_hunt(config, rate_dps, 3.0, p=p).word[-4000:].mean()
    band = rest.adc_dead_band_dps * a.lsb_per_dps
    for found in (word, hunted):
        assert limit_cycles.force_amplitude(found, 256) == pytest.approx(0.8 * 256, abs=1.1 * band)
        assert found < 0.7 * 256


@pytest.mark.parametrize(
    ("after", "writes"),
    [
        ({}, (("phase_sense_ref", phase_word(180.0)),)),  # the other sign convention
        ({"plant.sid_c_f": 25e-9}, ()),  # 318 Hz: nearly a plain low-pass, the fastest that the part allows
    ],
)
def test_what_is_unstable_grows_as_its_pole_says(after, writes):
    words = growing.exchange(QUIET, changed(QUIET, after), 0.3, writes=writes)["rate_word"]
    p = loop_parameters(changed(QUIET, after))
    if writes:
        p = p._replace(sense_turn_rad=math.pi, ye1_rad=p.ye1_rad + math.pi)
    want = advisor.analyse(p)
    assert not want.stable
    tau_s, hz = growing.growth(words)
    assert tau_s == pytest.approx(want.growth_tau_s, rel=0.15)
    assert hz == pytest.approx(want.growth_hz, abs=1.0)
    assert np.max(np.abs(words)) == 2**23 - 1


@pytest.mark.slow
def test_the_other_order_of_modes_runs_away():
    """f_x below f_y: the word goes to its rail."""
    other = {"plant.fx_hz": 10863.3, "plant.fy_hz": 11002.3, "firmware.nominal_frequency_hz": 10863.3}
    config = changed(QUIET, other)
    assert advisor.analyse(loop_parameters(config)).growth_hz == 0.0
    try:
        (run,) = confirm.run_profiles([config], [np.zeros(4000)])
    except ConfigError:
        return  # it did not even lock
    assert np.all(np.abs(run.columns["rate_word"][-400:]) == 2**23 - 1)


@pytest.mark.slow
@pytest.mark.parametrize("observable", ["scale_factor", "bandwidth"])
def test_the_three_strongest_sensitivities_are_simulated(observable):
    """The ranking's first three of an observable, each moved by five of its steps (or one register or frame)."""
    table = sensitivity.rows(QUIET)
    first = sensitivity.ranking(table, observable)[:3]
    configs = [QUIET]
    for row in first:
        whole = row.parameter.name.startswith("firmware.") and row.parameter.step >= 1
        configs.append(
            sensitivity.move_parameter(QUIET, row.parameter._replace(step=row.parameter.step * (1 if whole else 5)), 1)[
                0
            ]
        )
    if observable == "scale_factor":
        done = confirm.run_profiles(configs, [STEP] * len(configs))
        words = [run.columns["rate_word"] for run in done]
        seen = [(w[-800:].mean() - w[STEP_AT - 800 : STEP_AT].mean()) / STEP_DPS for w in words]
    else:
        sine = confirm.multisine()
        done = confirm.run_profiles(configs, [sine] * len(configs))
        seen = []
        for config, run in zip(configs, done):
            loop = lp.close(loop_parameters(config))
            ratio = np.abs(confirm.measured_response(run, sine) / (lp.response(loop, LINES) * lp.DEG))
            seen.append(advisor.bandwidth(loop)[0] + 20 * math.log10(np.interp(25, LINES, ratio)) / 0.63)
    want = [sensitivity.observe(config)[observable] for config in configs]
    scale = 1e6 / want[0] if observable == "scale_factor" else 1.0
    for k in range(1, len(configs)):
        change, predicted = (seen[k] - seen[0]) * scale, (want[k] - want[0]) * scale
        assert abs(predicted) > (1000 if observable == "scale_factor" else 0.2)
        assert change == pytest.approx(predicted, rel=0.02)
