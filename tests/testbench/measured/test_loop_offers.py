"""The next experiment of a closed loop: what is on offer, and that recording it tells truth and rival apart."""

import tomllib

import numpy as np
import pytest

from testbench.measured.closed_loop import loop_offers, loop_runs, loop_trace
from testbench.measured.record import plan
from testbench.tracing import next_experiment
from testbench.tracing.trace import Options
from tests.testbench.measured import loop_trials

TRUTH, LIKE, CATALOGUE = "cv_y: u^3", "cv_y: abs(u) u", "feedthrough_y"
D, SEED = 10.0, 77  # sigmas; u varies by a factor of two, so cube and square are alike
CONDITIONS = tuple(c for c in loop_trials.QUICK if c.id in ("late", "large", "cold", "held"))


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


@pytest.mark.slow
def test_the_proposed_experiment_tells_truth_and_rival_apart():
    """Hidden: `TRUTH`, in the exact engine. Its rival is not excluded, until the printed condition is recorded too."""
    bank = loop_trials.Bank(CONDITIONS, only={TRUTH, LIKE, CATALOGUE})
    blank = bank.blank()
    value = D / loop_trials.lengths(blank, [TRUTH])[TRUTH]

    def traced(bank, blank):
        at = np.array([n.value for n in blank.nuisances])
        values, seen = loop_trials.recorded(bank, blank, "in", SEED, at, {TRUTH: value}, ())
        asked = bank.problem("next", values, {"next": str(len(bank.conditions))}, seen)
        return loop_trace.run(asked, Options(seed=SEED, power=False, experiments=False))

    tracer, _ = traced(bank, blank)
    rivals = [tracer.found.candidates[(name,)].fit for name in (TRUTH, LIKE)]
    offered = tracer.problem.experiments([LIKE, TRUTH])
    rows = next_experiment.table(rivals, tracer.problem, offered, 2)
    best, own = rows[0], max(r["separation"] for r in rows if not r["group"].startswith("next"))
    assert best["group"].startswith("next")
    assert best["wanted"] == 1
    assert best["separation"] > 1.5 * own
    (new,) = plan.from_dict(tomllib.loads(best["text"])).conditions
    more = new._replace(settle_s=loop_runs.SETTLE_S)
    larger = loop_trials.Bank((*bank.conditions, more), only={TRUTH, LIKE, CATALOGUE})
    larger.bench, larger.kept = bank.bench, bank.kept
    again, after = traced(larger, larger.blank())
    assert {TRUTH} in [set(c["laws"]) for c in after.causes], after.sentence
    assert {LIKE} not in [set(c["laws"]) for c in after.causes]

    def apart(tracer):
        mine, other = (tracer.found.candidates[(name,)].fit.cost for name in (TRUTH, LIKE))
        return other - mine

    # what was doubtful is not any more
    assert apart(tracer) < 9.0 < apart(again)
    (effect,) = after.effects
    assert abs(effect["value"] - value) < 4 * effect["sd"]
