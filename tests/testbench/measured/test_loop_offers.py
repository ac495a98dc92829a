"""The next experiment of a closed loop: what is on offer."""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.measured.closed_loop import loop_offers
from testbench.measured.record import recording_plan
from tests.testbench.measured import loop_trials


def test_corners_stay_within_what_a_plan_takes_and_the_rate_loop_has_shown():
    recorded = [c for c in loop_trials.QUICK if c.role == "fit"]
    found = loop_offers.corners(recorded)
    force = max(c.a_um * max(abs(c.rate_dps), abs(c.from_dps)) for c in recorded)
    assert len({(c.a_um, c.temperature_degc, c.detune_deg) for c in found}) == 8
    for c in found:
        assert c.a_um * abs(c.rate_dps) <= 1.01 * force
        assert c.from_dps == -c.rate_dps
        for name, (low, high, _) in recording_plan.LIMITS.items():
            assert low <= getattr(c, name) <= high
    # each two factors in balance: the effect of one is not that of another
    signs = np.sign([[c.a_um - 5, c.temperature_degc, c.detune_deg, c.rate_dps] for c in found])
    assert np.array_equal(signs.T @ signs, 8 * np.eye(4))
    # as docs/measured.md says
    assert (loop_offers.SMALLER, loop_offers.LARGER) == (0.5, 1.0)
    assert (loop_offers.TEMPERATURES_DEGC, loop_offers.DETUNINGS_DEG) == ((-40, 85), (-25, 25))


def test_the_noise_is_that_of_the_condition_most_alike():
    recorded = [c for c in loop_trials.QUICK if c.role == "fit"]
    assert loop_offers.most_similar(recorded[2]._replace(id="next", temperature_degc=-25.0), recorded).id == "cold"
    assert loop_offers.most_similar(recorded[1]._replace(id="next", a_um=8.0), recorded).id == "large"


def test_the_second_amplitude_of_a_temperature_is_the_farther_one_and_needs_no_larger_force():
    recorded = [c for c in loop_trials.QUICK if c.role == "fit"]
    found = {c.temperature_degc: c for c in loop_offers.amplitude_conditions(recorded)}
    assert {t: c.a_um for t, c in found.items()} == {25.0: 7.0, 50.0: 2.0, -20.0: 2.0, 65.0: 7.0}
    for one in recorded:
        c = found[one.temperature_degc]
        assert (c.detune_deg, c.seconds) == (one.detune_deg, one.seconds)
        assert c.a_um * max(abs(c.rate_dps), abs(c.from_dps)) <= one.a_um * max(abs(one.rate_dps), abs(one.from_dps))
    assert len(loop_offers.amplitude_conditions([*recorded, recorded[0]._replace(a_um=3.0)])) == 3


def _problem(starts=(1.0, 1.0), conditions=loop_trials.QUICK):
    """A slope of Q that a law imitates but for its last feature, and another law that nothing imitates."""
    columns = {"bend": np.array([3.0, 4.0, 0.0, 0.5]), "free": np.array([0.0, 0.0, 5.0, 0.0])}
    return SimpleNamespace(
        conditions={c.id: c for c in conditions},
        nuisances=[SimpleNamespace(name=f"plant.{n}", prior_sd=sd) for n, sd in (("dlnq_per_k", 10.0), ("qy", 1.0))],
        starts=starts,
        tangent=np.array([[30.0, 0.0], [40.0, 0.0], [0.0, 0.0], [0.0, 1.0]]),
        laws=[SimpleNamespace(name=name) for name in columns],
        column=columns.get,
        whiten_fit_rows=lambda of: of,
    )


def test_a_law_that_a_slope_over_temperature_takes_asks_for_a_second_amplitude():
    (line,) = loop_offers.describe_shadowed_laws(_problem())
    # orthogonal to the slope: 0.5, of which qy takes a half of the square; without the slope the whole law is left
    left = np.sqrt(0.5**2 / 2) / np.sqrt(25 + 0.5**2 / 2)
    assert "together with plant.dlnq_per_k: bend" in line
    assert "free" not in line
    assert f"({left:.0%} of its size remains)" in line
    assert "7 um at 25 degC, 2 um at 50 degC" in line


TWICE = [c._replace(id=f"{c.id}{a_um}", a_um=a_um) for c in loop_trials.QUICK for a_um in (4.0, 7.0)]


@pytest.mark.parametrize("other", [{"starts": ()}, {"conditions": TWICE}])
def test_nothing_is_asked_of_narrow_priors_or_where_each_temperature_has_two_amplitudes(other):
    assert loop_offers.describe_shadowed_laws(_problem(**other)) == ()
