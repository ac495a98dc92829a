"""V_q's rail as the cause of the nonlinearity: the closed form against data made apart, and against the gyroscope."""

import math

import numpy as np
import pytest

from testbench.paper import closed_form, phase_laws, simulated
from testbench.paper.measure import measure_scale, nonlinearity
from tests.testbench.bench_setup import configured

RATES = np.array(measure_scale.RATES_DPS)
PHASES = {"xe2": 0.5, "ye1": 9.0, "ye2": 2.0}
CEILING_V, REST_V2, PER_DPS = 5.5, 20.25, -0.04  # V_q^2 = 20.25 - 0.04 rate; 30.25 at -250 deg/s
LOW_V2 = 12.25  # with it: 30.25 at -450, 0 at 306.25 deg/s


def made(rest_v2=REST_V2):
    """(words, V_q) of a board whose quadrature loop rails: its two equations solved rate by rate."""
    turn, leak = math.radians(PHASES["ye1"] + PHASES["xe2"]), math.radians(PHASES["ye2"] - PHASES["xe2"])
    square = rest_v2 + PER_DPS * RATES
    held = np.clip(square, 0.0, CEILING_V**2)
    force = RATES.copy()
    for k in np.flatnonzero(square != held):
        knee = (held[k] - rest_v2) / PER_DPS
        for _ in range(50):  # what is in phase must vanish: rate - force + (force's quadrature that is left) leaks in
            force[k] = RATES[k] + (force[k] - knee) * math.tan(turn) * math.tan(leak)
    return 8651.0 * force, np.sqrt(held)


def test_the_rail_alone_explains_a_railed_board():
    words, v_q = made()
    found = nonlinearity.explain_nonlinearity(RATES, words, v_q, CEILING_V, PHASES)
    assert found.ceiling_dps == pytest.approx(-250.0, rel=1e-9)
    assert math.isnan(found.zero_dps)
    assert found.rail_ppm == pytest.approx(found.measured_ppm, rel=1e-9)
    assert found.measured_ppm > 500.0
    assert found.unrailed_ppm < 1e-6


def test_both_rails_count():
    words, v_q = made(LOW_V2)
    found = nonlinearity.explain_nonlinearity(RATES, words, v_q, CEILING_V, PHASES)
    assert (found.ceiling_dps, found.zero_dps) == pytest.approx((-450.0, 306.25), rel=1e-9)
    assert found.rail_ppm == pytest.approx(found.measured_ppm, rel=1e-9)
    assert found.unrailed_ppm < 1e-6


def test_slopes_and_nonlinearity_of_the_page():
    """docs/paper.md at 25 degC: slope behind the rail, and what 22 rates make of it, from angles and rates."""
    for knee, turn, leak, slope_ppm, ppm in ((-276, 10.1757, 0.3083, 970, 253), (-304, 9.2324, 1.2517, 3550, 861)):
        grown = math.tan(math.radians(turn)) * math.tan(math.radians(leak))
        assert 1e6 * grown == pytest.approx(slope_ppm, abs=5)
        words = RATES + np.minimum(RATES - knee, 0.0) * grown / (1 - grown)
        slope, offset = np.polyfit(RATES, words, 1)
        assert np.abs(words - slope * RATES - offset).max() / slope / 500e-6 == pytest.approx(ppm, abs=2)


def test_what_is_not_the_rail_stays():
    """A bend of 1 ppm per (100 deg/s)^2 in the word is no quadrature: measured within the range, not predicted."""
    _, v_q = made()
    words = 8651.0 * RATES * (1 + 1e-6 * (RATES / 100.0) ** 2)
    found = nonlinearity.explain_nonlinearity(RATES, words, np.full_like(v_q, 4.5), CEILING_V, PHASES)
    assert math.isnan(found.ceiling_dps)
    assert math.isnan(found.zero_dps)
    assert found.rail_ppm < 1e-6 < 5.0 < found.measured_ppm == pytest.approx(found.unrailed_ppm)


def test_cases_2_and_3_of_the_gyroscope():
    """Measured by simulation and by the rail within three sigma of a reading, 6 ppm; more span leaves the noise."""
    base = configured()
    cases = closed_form.cases_deg(base)
    # loop phases of the base board, docs/phases.md, and the lead of its sense mode, docs/paper.md
    known = {"xe2": 0.9433, "ye1": 9.2324, "ye2": 1.2630 - 0.0113}
    assert simulated.mode_lead_deg(base.device()) == pytest.approx(0.0113, abs=5e-5)
    for case, more in (("2", {}), ("3", {"xe2": 0.0})):
        read = nonlinearity.read(phase_laws.set_residual_phases(base, cases[case]))
        found = nonlinearity.explain_nonlinearity(
            read["rates_dps"], read["scale_words"], read["quadrature_v_of_rate"], 5.5, known | more
        )
        assert found.measured_ppm == pytest.approx(found.rail_ppm, abs=18.0), case
        assert found.unrailed_ppm < 24.0, case
    assert found.rail_ppm > 3 * 250.0


def test_angles_are_left_where_they_are_asked_for():
    """Words of a case turned so that the budget's own phases less the words are the angles."""
    base = configured()
    last = closed_form.cases_deg(base)["5"]
    config = phase_laws.set_residual_phases(base, last, xe1=3.0, xe2=-1.0, ye1=-9.0, ye2=-6.0).firmware
    assert 3.7597 - config.phase_drive_sine_deg == pytest.approx(3.0, abs=1e-4)
    assert 0.9433 + config.phase_drive_ref_deg == pytest.approx(-1.0, abs=1e-4)
    assert 9.2324 - config.phase_sense_sine_deg == pytest.approx(-9.0, abs=1e-4)
    assert 1.2630 + config.phase_sense_ref_deg == pytest.approx(-6.0, abs=1e-4)
