"""The next experiment of a closed loop: what is on offer."""

import numpy as np

from testbench.measured.closed_loop import loop_offers
from testbench.measured.record import plan
from tests.testbench.measured import loop_trials


def test_corners_stay_within_what_a_plan_takes_and_the_rate_loop_has_shown():
    recorded = [c for c in loop_trials.QUICK if c.role == "fit"]
    found = loop_offers.corners(recorded)
    force = max(c.a_um * max(abs(c.rate_dps), abs(c.from_dps)) for c in recorded)
    assert len({(c.a_um, c.temperature_degc, c.detune_deg) for c in found}) == 8
    for c in found:
        assert c.a_um * abs(c.rate_dps) <= 1.01 * force
        assert c.from_dps == -c.rate_dps
        for name, (low, high, _) in plan.LIMITS.items():
            assert low <= getattr(c, name) <= high
    # each two factors in balance: the effect of one is not that of another
    signs = np.sign([[c.a_um - 5, c.temperature_degc, c.detune_deg, c.rate_dps] for c in found])
    assert np.array_equal(signs.T @ signs, 8 * np.eye(4))
    # as docs/measured.md says
    assert (loop_offers.SMALLER, loop_offers.LARGER) == (0.5, 1.0)
    assert (loop_offers.TEMPERATURES_DEGC, loop_offers.DETUNINGS_DEG) == ((-40, 85), (-25, 25))


def test_the_noise_is_that_of_the_condition_most_alike():
    recorded = [c for c in loop_trials.QUICK if c.role == "fit"]
    assert loop_offers.like(recorded[2]._replace(id="next", temperature_degc=-25.0), recorded).id == "cold"
    assert loop_offers.like(recorded[1]._replace(id="next", a_um=8.0), recorded).id == "large"
