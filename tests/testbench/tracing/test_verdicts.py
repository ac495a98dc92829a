"""Verdicts of whole traces on data whose truth is known, over many seeds; the long ones are marked slow."""

import numpy as np
import pytest
from scipy.stats import binom, norm

from testbench.tracing.trace import Options, Tracer, trace
from tests.testbench.tracing.toys import FIT, LAWS, Toy

QUICK = Options(n_null=299, power=False, experiments=False)
CLEAR = tuple(law for law in LAWS if law.name != "quintic")  # x^2 and x^4 look alike here: cosine 0.96
# coefficient of one sigma after projection, from the Gram matrix at the priors' middles
SIGMA = {"duffing": 0.0047, "selfheat": 0.0148, "centrifugal": 0.0151, "pickoff": 0.0032}
SIGMA |= {"damping": 0.0022, "latency": 0.010, "feed": 0.0089}


def planted(seed, count, low, high):
    """{law: coefficient} of `count` laws with sizes of low .. high sigmas."""
    rng = np.random.default_rng([seed, 99])
    chosen = rng.choice(sorted(SIGMA), count, replace=False)
    return {
        n: float(SIGMA[n] * rng.uniform(low, high) * (1 if n == "latency" else rng.choice([-1, 1]))) for n in chosen
    }


def run(seed, effects, **how):
    return trace(Toy(seed, effects, laws=CLEAR, **how), QUICK)


def singles(seeds, low, high):
    """(detected, right first, wrongly named, named, held-out errors / floor) of traces with one effect."""
    detected = right = wrong = named = 0
    ratios = []
    for seed in seeds:
        effects = planted(seed, 1, low, high)
        result = run(seed, effects)
        found = {e["law"] for e in result.effects}
        if result.verdict in ("named", "confounded", "unexplained"):
            detected += 1
            right += found == set(effects)
        if result.verdict == "named":
            named += 1
            wrong += found != set(effects)
            ratios += [h["after"] / h["floor"] for h in result.heldout.values()]
    return detected, right, wrong, named, ratios


def nulls(seeds, **how):
    """How many traces without an effect name one, or see something that repeats."""
    results = [run(seed, {}, **how) for seed in seeds]
    return sum(bool(r.effects) for r in results), [r.verdict for r in results]


def few_or(many, few=2):
    """Parametrizes `count`: a few records always, many in the long run."""
    return pytest.mark.parametrize("count", [few, pytest.param(many, marks=pytest.mark.slow)])


@few_or(12)
def test_nothing_is_named_where_nothing_is_missing(count):
    named, verdicts = nulls(range(count))
    assert named == 0
    assert verdicts.count("none") >= count - count // 6


def test_none_needs_held_out_data_that_agree():
    """At rest the fitted conditions do not see Omega^2 x; the held-out ones turn."""
    at_rest = [(a, t, 0.0) for a, t, _ in FIT]
    result = run(3, {"centrifugal": 0.4}, conditions=at_rest)
    assert result.verdict == "unexplained"
    assert "no alarm, but the held-out data disagree with the model (chi2 / rows" in result.sentence
    assert result.heldout_chi2["after"] > result.heldout_chi2["limit"]
    assert result.effects == result.causes == []
    assert run(3, {}, conditions=at_rest).verdict == "none"


def test_alpha_follows_from_the_rates_that_are_promised():
    """At most 1 of 100 nulls with a chance of 98 %, at least 118 of 120 effects of 8 sigmas with one of 95 %."""
    alpha = Options().alpha
    assert binom.cdf(1, 100, alpha) >= 0.98 > binom.cdf(1, 100, 1.1 * alpha)
    missed = 0.0068
    assert binom.cdf(2, 120, missed) >= 0.95 > binom.cdf(2, 120, 1.1 * missed)
    # ten statistics, and 170 laws that are looked at one by one, by Bonferroni; half of alpha is that of held-out data
    threshold = norm.isf(alpha / 2 / 10 / 170 / 2)
    assert round(threshold, 1) == 5.0, "docs/tracing.md, Alarms"
    assert norm.sf(8 - threshold) < missed / 5
    found = trace(Toy(7), Options(experiments=False)).power_d90.values()
    assert max(row["d"] for row in found) - norm.isf(0.1) + norm.isf(missed) < 8


@pytest.mark.parametrize("sds", [0.0, 8.0])
def test_a_calibrated_parameter_far_from_its_prior_is_no_record_without_a_misfit(sds):
    """What acts as a nuisance does is fitted by it, and leaves nothing in the rows."""
    problem = Toy(7)
    *others, zro = problem.nuisances
    problem.nuisances = (*others, zro._replace(value=problem.theta[-1] - sds * zro.prior_sd))
    result = trace(problem, QUICK)
    told = [note for note in result.notes if "standard deviations from its prior" in note]
    if not sds:
        assert (result.verdict, told) == ("none", [])
    else:
        assert result.verdict == "unexplained"
        assert result.unexplained["loudest_statistic"] == "prior"
        (note,) = told
        assert note.startswith("zro = ")
        assert float(note.split(": ")[1].split()[0]) == pytest.approx(sds, abs=0.3)


class Unsupported(Toy):
    """No data can support its pickoff law."""

    def insufficient_data_reason(self, law):
        return "its time constant is 3 s, and the dwells last 1 s" if law == "pickoff" else ""


def test_what_the_data_cannot_support_is_not_named_however_well_it_fits():
    effects = {"pickoff": 20 * SIGMA["pickoff"]}
    problem = Toy(1, effects, laws=CLEAR)
    assert trace(problem, QUICK).verdict == "named"
    found = trace(Unsupported(1, effects, laws=CLEAR), QUICK)
    assert found.verdict == "unexplained"
    assert not found.causes
    assert "time constant is 3 s" in found.sentence
    assert [e["law"] for e in found.effects] == ["pickoff"]
    assert trace(Unsupported(1, {"feed": 20 * SIGMA["feed"]}, laws=CLEAR), QUICK).verdict == "named"
    problem.least_d = 40.0
    found = trace(problem, QUICK)
    assert found.verdict == "unexplained"
    assert "sigma with all nuisance parameters fitted, 40 needed" in found.sentence


@few_or(8)
def test_undeclared_flicker_raises_no_effect_and_is_called_noise(count):
    named, verdicts = nulls(range(count), flicker=3.0)
    assert named == 0
    assert verdicts.count("noise-model") >= count - count // 8


def test_flicker_that_only_repeats_know_does_not_make_a_right_answer_unexplained():
    """Held-out means are judged in units of the noise that all repeats bear out, held-out ones with them."""
    result = run(1, {"latency": 0.517}, flicker=3.0)
    assert (result.verdict, [e["law"] for e in result.effects]) == ("named", ["latency"])
    assert result.noise["findings"]
    assert result.heldout_chi2["after"] < result.heldout_chi2["limit"]
    outside = run(4, {"step": 0.5}, flicker=3.0)
    assert outside.verdict == "unexplained"
    assert outside.heldout_chi2["after"] > outside.heldout_chi2["limit"]


@few_or(12)
def test_single_causes_come_first(count):
    detected, right, wrong, named, _ = singles(range(count), 12, 40)
    assert detected == count
    assert right >= count - count // 12
    assert wrong == 0
    assert named >= count // 2


@few_or(4, 1)
def test_pairs_are_found_whole(count):
    exact = 0
    for seed in range(count):
        effects = planted(seed, 2, 20, 60)
        exact += {e["law"] for e in run(seed, effects).effects} == set(effects)
    assert exact >= count - count // 4


@pytest.mark.parametrize(("effects", "asked"), [({"friction": 0.15}, True), ({}, False)])
def test_laws_that_cost_runs_are_asked_where_an_alarm_without_them_is_in_doubt(effects, asked):
    """A law of the library takes part in the alarm as if it did not wait; a clean record never asks for it."""
    problem = Toy(3, effects)
    plain = trace(problem, Options(power=False, experiments=False))
    problem.library_late = True
    tracer = Tracer(problem, Options(power=False, experiments=False), None, None)
    result = tracer.run()
    assert (tracer.waiting == ()) is asked
    assert ("library" in tracer.ranked) is asked
    assert ("library" in result.alarms["refined"]["p"]) is asked
    assert result.verdict == plain.verdict
    if asked:
        assert (result.verdict, result.p_global) == ("named", plain.p_global)


def test_a_law_outside_the_catalogue_comes_from_the_library_with_a_file():
    result = run(3, {"friction": 0.15})
    assert [e["law"] for e in result.effects] == ["friction"]
    assert result.verdict == "named"
    assert 'law = "friction"' in result.discovery["files"]["friction"]


def test_what_no_law_describes_is_unexplained():
    result = run(4, {"step": 0.5})
    assert result.verdict == "unexplained"
    assert all(e["status"] != "named" for e in result.effects)
    assert result.unexplained["worst_cell"]["observable"] == "f"


@few_or(6)
def test_without_repeats_the_trace_says_so_and_needs_the_held_out_groups(count):
    found = run(2, {"feed": 0.4}, repeats=1)
    assert found.verdict == "named"
    assert found.certificates["repeats"]["R14"]
    noisy, verdicts = nulls(range(count), flicker=3.0, repeats=1)
    assert "named" not in verdicts, verdicts
    assert noisy == 0


def test_confounded_laws_are_listed_with_what_would_separate_them():
    effects = {"duffing": 0.0047 * 9}
    result = trace(Toy(5, effects), Options(n_null=299, power=False))
    assert result.verdict == "confounded"
    sets = [c["laws"] for c in result.causes]
    assert ["duffing"] in sets
    assert len(sets) > 1
    best = result.next_experiment[0]
    assert best["condition"]["A"] >= 1.5  # the powers of x part where the amplitude is large
    assert best["gain"] > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("how", [{}, {"noise": 1.2}, {"flicker": 1.5}, {"flicker": 3.0}, {"repeats": 4}])
def test_rates_of_nulls(how):
    count = 200 if how in ({}, {"flicker": 3.0}) else 100
    found, verdicts = nulls(range(1000, 1000 + count), **how)
    print("nulls", how, count, "effects", found, {v: verdicts.count(v) for v in sorted(set(verdicts))})
    rang = count - verdicts.count("none") - verdicts.count("noise-model")
    assert verdicts.count("named") == 0
    assert binom.sf(found - 1, count, 0.01) > 0.01
    assert binom.sf(rang - 1, count, Options().alpha) > 0.01


@pytest.mark.slow
def test_rates_of_singles_and_their_errors():
    detected, right, wrong, named, ratios = singles(range(3000, 3200), 8, 60)
    print("singles", detected, right, wrong, named, np.quantile(ratios, [0.05, 0.5, 0.95]))
    assert detected >= 0.95 * 200
    assert right >= 0.95 * detected
    assert wrong <= 0.05 * named
    assert np.median(ratios) < 1.06  # 96 correlated rows: a single ratio scatters by some 10 %
    covered = total = 0
    for seed in range(5000, 5120):
        effects = planted(seed, 1, 12, 60)
        for e in run(seed, effects).effects:
            if e["law"] in effects:
                total += 1
                covered += abs(e["value"] - effects[e["law"]]) < 1.96 * e["sd"]
    print("intervals", covered, total)
    assert total >= 114
    assert 0.9 <= covered / total <= 0.99


@pytest.mark.slow
def test_rates_at_the_level_of_the_promised_rates():
    """Nulls that ring, which the binomial law allows at 1 %, and effects of 8 to 9 sigmas that are missed."""
    count = 400
    verdicts = [run(seed, {}).verdict for seed in range(10000, 10000 + count)]
    rang = sum(verdict not in ("none", "noise-model") for verdict in verdicts)
    assert binom.sf(rang - 1, count, Options().alpha) > 0.01
    detected, right, wrong, named, _ = singles(range(10000, 10060), 8, 9)
    print("nulls that ring", rang, "detected", detected, "right", right, "named", named, "wrongly", wrong)
    assert binom.cdf(detected, 60, 118 / 120) > 0.01
    assert wrong <= 2


@pytest.mark.slow
def test_rates_of_small_effects():
    detected, right, wrong, named, _ = singles(range(6000, 6100), 4, 8)
    print("small", detected, right, wrong, named)
    assert wrong <= 0.05 * max(named, 1)
    assert right >= 0.85 * detected


@pytest.mark.slow
def test_rates_of_pairs_and_of_laws_outside_the_catalogue():
    exact = alike = 0
    for seed in range(4000, 4060):
        effects = planted(seed, 2, 15, 60)
        result = run(seed, effects)
        # of a cosine of 0.93: alike laws are no pair
        alike += set(effects) == {"duffing", "selfheat"} and result.verdict == "unexplained"
        exact += {e["law"] for e in result.effects} == set(effects)
    print("pairs", exact, "alike and unexplained", alike)
    assert exact + alike >= 0.95 * 60
    exact = 0
    for seed in range(60):
        rng = np.random.default_rng([seed, 7])
        name = ("friction", "hot", "centripetal")[seed % 3]
        size = {"friction": 0.0061, "hot": 0.0134, "centripetal": 0.0054}[name]
        effects = {name: float(size * rng.uniform(15, 60) * rng.choice([-1, 1]))}
        exact += {e["law"] for e in run(seed, effects).effects} == set(effects)
    print("outside the catalogue", exact)
    assert exact >= 0.9 * 60
