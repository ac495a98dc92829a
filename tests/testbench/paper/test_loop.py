"""The linear loops against oracles that know nothing of them: circuits at the carrier, formulas, a stability map."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from testbench.config import Config, load
from testbench.errors import ConfigError
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters
from tests.testbench.paper import switched_rc
from tests.testbench.paper.carrier import Carrier

DEFAULT = loop_parameters(Config())


def decibel(ratio):
    return 20 * math.log10(abs(ratio))


# ---- the demodulator -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("f_hz", [0.5, 20.0, 60.0, 139.0])
@pytest.mark.parametrize("angle_rad", [0.0, 0.3, -1.0, math.pi / 2])
def test_the_averaged_demodulator_is_the_switched_one(f_hz, angle_rad):
    """V - j V'/w through 4/pi and three poles, against matrix exponentials of both half periods."""
    carrier_hz, rc_s = 11002.3, 1.59e-3
    s, w = 2j * math.pi * f_hz, 2 * math.pi * carrier_hz
    v = -1j * np.exp(1j * angle_rad)
    in_phase, rate = (1j * v).real, (1j * -1j * v / w).real
    want = (in_phase + s * rate) * switched_rc.averaged(f_hz, rc_s)
    found = switched_rc.response(f_hz, carrier_hz, rc_s, angle_rad)
    scale = abs(switched_rc.averaged(f_hz, rc_s))
    assert abs(found - want) < 2e-4 * scale * max(f_hz / 139, 0.02)
    # without V' the difference is what a loop at the split feels: nearly a degree
    if angle_rad == math.pi / 2:
        assert abs(found) / scale == pytest.approx(abs(s) / w * 4 / math.pi / (4 / math.pi), rel=0.02)


# ---- the plant within a frame ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("word", "rate_dps"), [(8000.0, 0.0), (0.0, 1.0)])
def test_open_loop_is_that_of_the_circuits_at_the_carrier(word, rate_dps):
    """Word or rate switched on: sine and cosine channel over 60 frames, phases, gains and the split's beat included."""
    oracle = Carrier(DEFAULT)
    want = np.array([oracle.frame(word, rate_dps * lp.DEG) for _ in range(60)])
    a, b, out = lp._plant(DEFAULT)
    inputs, n = b @ np.array([rate_dps * lp.DEG, 0.0, word]), len(a)
    phi = expm(np.block([[a, inputs[:, None]], [np.zeros((1, n + 1))]]) * DEFAULT.frame_s)
    state, found = np.append(np.zeros(n), 1.0), np.zeros((60, 2))
    for k in range(60):
        state = phi @ state
        found[k] = out @ state[:n]
    reach = np.max(np.abs(want[:, 0]))
    np.testing.assert_allclose(found, want, atol=0.005 * reach)
    assert np.max(np.abs(found[-1])) > 0.1 * reach


@pytest.mark.parametrize("stages", [3, 1])
def test_closed_loop_is_that_of_the_circuits_at_the_carrier(stages):
    """Three stages of 50 Hz settle as the loop says; one plain pole of 500 Hz grows as its pole says."""
    p = DEFAULT if stages == 3 else DEFAULT._replace(sid_stages=1, sid_hz=500.0, sid_switched=False)
    # the oracle's word acts at the end of the frame after the conversion's
    p = p._replace(word_acts_s=DEFAULT.frame_s - 1e-9)
    frames = 400
    want = Carrier(p, stages).closed(frames, 1.0 * lp.DEG)
    loop = lp.close(p, qsc=0.0)
    inputs = np.zeros((frames, 4))
    inputs[:, lp.RATE] = lp.DEG
    found, _ = lp.simulate_words(loop, inputs)
    reach = np.max(np.abs(want))
    assert bool(reach > 2e4) is (stages == 1)
    np.testing.assert_allclose(found[1:], want[:-1], atol=(5e-4 if stages == 3 else 0.02) * reach)
    if stages == 1:
        pole = lp.poles(loop)[0]
        swing = [np.ptp(want[k : k + 60]) for k in (200, 335)]
        assert math.log(swing[1] / swing[0]) == pytest.approx(-135 * DEFAULT.frame_s / pole.tau_s, rel=0.1)


def test_the_frame_is_the_matrix_exponential_of_its_parts():
    fr = lp.frame(DEFAULT)
    a, _, _ = lp._plant(DEFAULT)
    np.testing.assert_allclose(fr.f, expm(a * DEFAULT.frame_s), rtol=0, atol=1e-9 * np.max(np.abs(fr.f)))
    # weights of the converter: its three frames add up to a gain of one
    assert np.sum(fr.d[:, 0, lp.IN_SIN]) == pytest.approx(1.0, abs=1e-12)


# ---- closed loop -----------------------------------------------------------------------------------------------------


def test_scale_factor_bias_and_v_q_are_those_of_the_forces():
    """At rest both demodulated components vanish: complex forces balance, whatever the loop's gains are."""
    p = DEFAULT
    loop = lp.close(p)
    turn = p.ye1_rad + p.xe2_rad
    # the scale factor (word LSB per deg/s) without any phase error, turned
    ideal = 2 * p.coriolis_mass_kg * p.w_rad_s * p.amplitude_m * lp.DEG / (p.k_vf_n_per_v * p.volts_per_word)
    assert advisor.dc_gain(loop) * lp.DEG == pytest.approx(ideal / math.cos(turn), rel=2e-5)
    still = lp.steady_state(loop, (0.0, p.kxy_n_per_m, 0.0, 0.0))
    assert abs(still[lp.WORD]) < 0.01
    null = 4.52
    assert advisor.volts(p, still[lp.U]) == pytest.approx(null, abs=1e-4)
    # a rate needs V_q^2 to fall by its part in quadrature, 100 tan(turn) of 100 deg/s
    turned = lp.steady_state(loop, (100 * lp.DEG, p.kxy_n_per_m, 0.0, 0.0))
    share = advisor.volts(p, turned[lp.U]) ** 2 / null**2
    assert 1 - share == pytest.approx(math.tan(turn), rel=2e-3)


def test_the_numbers_of_the_default_loop():
    """25.6 Hz, 1.2 dB, 12.5 dB, 32 dB, ring of 0.30 s; the contract's 24 to 30 Hz."""
    a = advisor.advise(DEFAULT)
    assert a.stable
    assert 24 <= a.bandwidth_hz <= 30
    assert a.bandwidth_hz == pytest.approx(25.6, abs=0.3)
    assert a.peak_db == pytest.approx(1.2, abs=0.2)
    assert a.gain_margin_up_db == pytest.approx(12.5, abs=0.3)
    assert a.qsc_margin_up_db == pytest.approx(32, abs=0.5)
    assert a.ring_tau_s == pytest.approx(0.30, abs=0.02)
    assert a.split_db == pytest.approx(-0.3, abs=0.3)
    assert [round(c.hz) for c in sorted(a.crossings)] == [14, 138, 140]


def test_a_margin_is_where_the_loop_becomes_unstable():
    a = advisor.analyse(DEFAULT)
    for db, stable in ((a.gain_margin_up_db - 0.05, True), (a.gain_margin_up_db + 0.05, False)):
        assert (lp.radius(lp.close(DEFAULT, ftr=10 ** (db / 20))) < 1) is stable
    # and a phase margin is where |1 + L| would vanish: more lag, put where the word acts
    worst = min(a.crossings, key=lambda c: c.delay_us)
    values = lp.return_ratio(DEFAULT, np.array([worst.hz]))[0]
    assert abs(values) == pytest.approx(1.0, abs=1e-6)
    assert abs(1 + values * np.exp(-1j * math.radians(worst.lag_deg))) < 1e-6


def edge_hz(ye1_deg, ye2_deg):
    return advisor.bandwidth(lp.close(advisor.set_sense_phases(DEFAULT, ye1_deg, ye2_deg)))[0]


def test_bandwidth_over_the_sense_phases():
    """Wanted: a change below 0.4 Hz. phi_ye2 alone keeps it; phi_ye1 does up to 7 deg, at 9 deg it is half a hertz."""
    base = edge_hz(0, 1.26)
    for ye2 in (-6, 0, 6):
        assert abs(edge_hz(0, ye2) - base) < 0.4
    for ye1 in (-9, -4.5, 4.5, 7):
        assert abs(edge_hz(ye1, 1.26) - base) < 0.4
    for ye1 in (-9, 9):
        for ye2 in (-6, 6):
            assert abs(edge_hz(ye1, ye2) - edge_hz(ye1, 1.26)) < 0.4
    assert edge_hz(0, 0) - edge_hz(9, 6) == pytest.approx(0.82, abs=0.03)
    at_nine = base - edge_hz(9, 1.26)
    assert 0.4 < at_nine < 0.6
    # two thirds of it are loop gain, which goes with cos(ye1 + ye2'): 1 % of gain is 0.21 Hz
    gain = math.cos(math.radians(9 + 1.26)) / math.cos(math.radians(1.26))
    straight = advisor.set_sense_phases(DEFAULT, 0, 1.26)
    slower, by_one_percent = (
        advisor.bandwidth(lp.close(advisor.vary_parameters(straight, crossover=g)))[0] for g in (gain, 0.99)
    )
    assert base - by_one_percent == pytest.approx(0.21, abs=0.01)
    assert base - slower == pytest.approx(at_nine * 2 / 3, rel=0.15)


def configured(*sets):
    return loop_parameters(load(None, sets))


@pytest.mark.parametrize(
    ("sets", "hz"),
    [
        (("firmware.phase_sense_ref_deg=180",), None),  # the other sign convention
        (("plant.fx_hz=10863.3", "plant.fy_hz=11002.3", "firmware.nominal_frequency_hz=10863.3"), None),  # other order
        (("plant.sid_c_f=53e-9",), 139),  # 150 Hz
        (("plant.sid_c_f=25e-9",), 139),  # 318 Hz: nearly no lag
    ],
)
def test_what_must_be_unstable_is(sets, hz):
    """The other sign or order runs away, a SID that does not lag oscillates at the split."""
    a = advisor.advise(configured(*sets))
    assert not a.stable
    assert a.warnings[0].startswith("unstable")
    if hz is None:
        assert a.growth_hz < 0.5
        assert "diverges" in a.warnings[0]
    else:
        assert a.growth_hz == pytest.approx(hz, abs=6)


def test_a_plain_low_pass_is_unstable_with_any_gain():
    """One pole of 500 Hz instead of the three, integrator alone: unstable above 0.1 Hz."""
    plain = DEFAULT._replace(sid_stages=1, sid_hz=500.0, sid_switched=False)
    assert not advisor.analyse(plain).stable
    for kc_hz in (0.1, 1.0, 15.0):
        p = plain._replace(word_kp=0.0, word_ki=plain.word_ki * kc_hz / 15)
        worst = lp.poles(lp.close(p))[0]
        assert abs(worst.z) > 1
        assert worst.hz == pytest.approx(139, abs=10)
    # the integrator alone behind the three slow poles is stable: it is their lag that does it
    slow = DEFAULT._replace(word_kp=0.0)
    assert lp.radius(lp.close(slow)) < 1


@pytest.mark.parametrize(
    ("f3_hz", "stable"), [(20, True), (50, True), (100, True), (150, False), (200, False), (400, False)]
)
def test_sid_corners_of_the_stability_map(f3_hz, stable):
    """A SID corner above the split's lag makes the loop unstable."""
    assert (lp.radius(lp.close(advisor.vary_parameters(DEFAULT, sid_hz=float(f3_hz)))) < 1) is stable


@pytest.mark.parametrize(
    ("split_hz", "f3_hz", "stable"), [(40, 50, False), (120, 50, True), (400, 50, True), (60, 80, False)]
)
def test_splits_of_the_stability_map(split_hz, f3_hz, stable):
    p = advisor.retune_split(DEFAULT, float(split_hz))
    assert (lp.radius(lp.close(advisor.vary_parameters(p, sid_hz=float(f3_hz)))) < 1) is stable


def test_a_map_marks_what_is_unstable():
    m = advisor.stability_map(DEFAULT, "sid_hz", [50.0, 400.0], "split_hz", [40.0, 139.0])
    assert np.isfinite(m.peak_db).tolist() == [[False, False], [True, False]]
    assert m.peak_db[1, 0] == pytest.approx(advisor.analyse(DEFAULT).peak_db, abs=0.2)
    with pytest.raises(ValueError, match="none of"):
        advisor.vary_parameters(DEFAULT, sid=50.0)


def test_warnings_name_number_and_limit():
    weak = advisor.advise(advisor.vary_parameters(DEFAULT, crossover=3.0))
    assert any(w.startswith("gain margin") and "6 dB" in w for w in weak.warnings)
    assert any(w.startswith("closed-loop peak") for w in weak.warnings)
    quiet = advisor.advise(DEFAULT._replace(ye1_rad=0.01))
    assert quiet.warnings == ()
    silent = advisor.advise(DEFAULT._replace(ye1_rad=0.01, adc_noise_v=0.0, cv_noise_v_per_rthz=0.0))
    (line,) = silent.warnings
    assert "+-12.4 deg/h" in line


@pytest.mark.parametrize(
    ("sets", "text"),
    [
        (("firmware.board='digital_sid'",), "firmware.board"),
        (("firmware.adc_clock='free_running'",), "firmware.adc_clock"),
        (("plant.adc_decimation=128",), "plant.adc_decimation"),
    ],
)
def test_what_the_analysis_is_not_made_for_is_refused(sets, text):
    with pytest.raises(ConfigError, match=text):
        configured(*sets)


def test_step_and_response_are_of_one_loop():
    """Time against frequency domain: the sum of the step's differences, transformed, is the response."""
    loop = lp.close(DEFAULT)
    frames = 60_000
    inputs = np.zeros((frames, 4))
    inputs[:, lp.RATE] = 1.0
    words, _ = lp.simulate_words(loop, inputs)
    impulse = np.diff(words, prepend=0.0)
    for f in (1.0, 20.0, 60.0):
        z = np.exp(2j * math.pi * f * DEFAULT.frame_s)
        direct = np.sum(impulse * z ** -np.arange(frames)) * np.sqrt(z)
        assert decibel(direct / lp.response(loop, f)[0]) == pytest.approx(0, abs=1e-3)
