"""The closed loop as a tracing problem: tangents, noise, and twelve trials with something hidden."""

import numpy as np
import pytest
from numba import config as numba_config

from analog_frontend.effects import law
from testbench.measured import loop_laws, loop_problem, loop_runs, loop_trials
from testbench.measured.loop_runs import EXACT, FAST, Model, Run

pytestmark = pytest.mark.skipif(numba_config.DISABLE_JIT, reason="hours without the compiler")


@pytest.fixture(scope="module")
def bank():
    return loop_trials.Bank(loop_trials.QUICK, library=False)


@pytest.fixture(scope="module")
def blank(bank):
    return bank.blank()


# ---- candidates ------------------------------------------------------------------------------------------------------


def test_candidates_have_one_name_and_one_law_each():
    everything = (*loop_laws.from_catalogue(), *loop_laws.from_grammar())
    names = [c.law.name for c in everything]
    assert len(set(names)) == len(names)
    for c in everything:
        assert bool(c.key) != bool(c.factors)
        for text in c.texts(1.5):
            assert law.parse(text).coefficient == 1.5


# ---- engines ---------------------------------------------------------------------------------------------------------


def test_a_coefficient_of_zero_is_the_model_itself(bank, blank):
    c = bank.conditions[0]
    theta = np.array([n.value for n in blank.nuisances])
    told = [blank.told(theta, {}), blank.told(theta, {"coulomb_friction": 0.0})]
    for kind in (EXACT, FAST):
        a, b = bank.bench.run([Run(m, c, 5) for m in told], bank.model, kind)
        assert (a == b).all()


def test_the_averaged_plant_moves_as_the_exact_one_does(bank, blank):
    """The fast engine gives the change by an effect to a few percent: tangents are made of it.

    Not of laws that move the frequency: they also move slips of the reference edges, in each engine at its own ticks
    (measured for Duffing: 17 % of the change at 45 degC); anchors in the exact engine take care of them.
    """
    names = [
        "damping_cubic",
        "pickoff_cubic_x",
        "feedthrough_y",
        "bias_cubic",
        "quadrature_cubic",
    ]
    names += ["coulomb_friction", "feedthrough_x", "sense_cubic"]
    size = loop_trials.lengths(blank)
    theta = np.array([n.value for n in blank.nuisances])
    c = bank.conditions[3]
    models = [Model(bank.model)] + [blank.told(theta, {n: 300.0 / size[n]}) for n in names]
    # a change of frequency moves the slips of the reference edges, a sigma in each of both engines: mean of eight draws
    runs = [Run(m, c, 60 + k) for m in models for k in range(8)]
    exact, fast = (
        np.array(bank.bench.run(runs, bank.model, kind)).reshape(len(models), 8, -1).mean(axis=1)
        for kind in (EXACT, FAST)
    )
    k = blank._rows[c.id]
    for i, name in enumerate(names, 1):
        a, b = blank.whiten(k, exact[i] - exact[0]), blank.whiten(k, fast[i] - fast[0])
        assert np.linalg.norm(a - b) < 0.05 * np.linalg.norm(a) + 3.0, name


def test_whitened_noise_is_white(bank, blank):
    """Fresh draws of the exact engine have one sigma per feature."""
    c = bank.conditions[1]
    rows = np.array(bank.bench.run([Run(Model(bank.model), c, 900 + k) for k in range(16)], bank.model, EXACT))
    z = np.array([blank.whiten(blank._rows[c.id], row - rows.mean(axis=0)) for row in rows]) * np.sqrt(16 / 15)
    n = z.size - z.shape[1]
    # chi2 of n rows has a relative sd of sqrt(2 / n); the covariance is an estimate too
    assert abs(np.mean(z**2) - 1) < 4 * np.sqrt(2 / n) + 0.1


# ---- trials ----------------------------------------------------------------------------------------------------------

THREE = ("none", "one", "two")
TWELVE = ("one", "one", "two", "none", "one", "two", "none", "one", "one")


@pytest.fixture(scope="module")
def few(bank, blank):
    return [loop_trials.trial(bank, blank, kind, 100 + k, d_range=(12.0, 60.0)) for k, kind in enumerate(THREE)]


def judged(trials):
    """Effects are found, none is named that is not there, and the fitted model is the exact engine's."""
    for t in trials:
        assert not t.false_name, (t.kind, t.seed, t.truth, t.result.sentence)
        certificate = t.result.certificates["numerical"]
        assert certificate["holds"], (t.kind, t.seed, certificate)
    return sum(t.found for t in trials)


def test_what_was_hidden_is_found_and_nothing_else(few):
    assert judged(few) == len(few), [(t.kind, t.truth, t.result.sentence) for t in few]


@pytest.mark.slow
def test_nine_more_trials(bank, blank):
    more = [loop_trials.trial(bank, blank, kind, 200 + k, d_range=(12.0, 60.0)) for k, kind in enumerate(TWELVE)]
    assert judged(more) >= len(more) - 1, [(t.kind, t.truth, t.result.sentence) for t in more]


@pytest.mark.slow
def test_a_hundred_trials():
    """Rates over a hundred trials of every kind, with the grammar beyond the catalogue."""
    bank = loop_trials.Bank(loop_trials.QUICK)
    blank = bank.blank()
    done = [loop_trials.trial(bank, blank, kind, 1000 + k) for k, kind in enumerate(loop_trials.kinds(100))]
    rows = {}
    for t in done:
        rows.setdefault(t.kind, []).append(t)
        print(t.kind, t.seed, t.truth, t.result.verdict, [e["law"] for e in t.result.effects], t.right, flush=True)
    for kind, some in rows.items():
        print(kind, sum(t.right for t in some), "right of", len(some))
    assert not [t for t in rows["none"] if t.false_name]
    singles = rows["one"]
    assert sum(t.found for t in singles) >= 0.9 * len(singles)
    holds = [t.result.certificates.get("numerical", {}).get("holds") for t in done]
    assert all(holds), holds


assert loop_problem.DRAWS % loop_runs.LANES == 0, "a group of lanes would be half empty"
