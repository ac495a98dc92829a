"""Evidence, sets of laws, rivals: against integrals done by brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from testbench.tracing.fit import evidence
from testbench.tracing.fit.rank import Ranking
from testbench.tracing.fit.rivals import CLEAR, vuong
from testbench.tracing.problem.problem import Law


def log_p(c, least, scale):
    """ln of the prior's density, coefficient by coefficient; least: s^2."""
    return -np.log1p((c / scale) ** 2) - 0.5 * np.log(c**2 + least) - np.log(2 * np.log1p(2 * scale / least**0.5))


def brute(c_hat, cov, scale, sign):
    """Integral by quadrature over a grid, one or two coefficients."""
    inverse, least = np.linalg.inv(cov), np.diag(cov)

    def density(*c):
        c = np.array(c)
        misfit = -0.5 * (c - c_hat) @ inverse @ (c - c_hat)
        return np.exp(misfit + np.sum(log_p(c, least, scale))) * 2.0 ** np.count_nonzero(sign)

    ranges = []
    for i in range(len(c_hat)):
        low, high = c_hat[i] - 9 * np.sqrt(cov[i, i]), c_hat[i] + 9 * np.sqrt(cov[i, i])
        ranges.append((max(low, 0.0) if sign[i] > 0 else low, min(high, 0.0) if sign[i] < 0 else high))
    return np.log(integrate.nquad(density, ranges)[0])


@pytest.mark.parametrize("sign", [0, 1, -1])
@pytest.mark.parametrize("c", [0.0, 0.3])
def test_one_small_coefficient_is_the_integral_to_a_third(c, sign):
    """At d of 0 and 1.5 nothing is decided."""
    c = c if sign >= 0 else -c
    case = (np.array([c]), np.array([[0.04]]), np.array([1.5]), np.array([sign]))
    assert evidence.log_coefficients(*case) == pytest.approx(brute(*case), abs=0.3)


@pytest.mark.parametrize("sign", [0, 1, -1])
@pytest.mark.parametrize("c", [1.0, 2.0])
def test_one_coefficient_is_the_integral_to_second_order(c, sign):
    """At d of 5 and 10: left out are ln(1 + s^2 p(2) / 2 p), and s^2 beside T^2 in the tail; then s^4 p(4) / 8 p."""
    least, scale, h = 0.04, 1.5, 1e-3
    low, mid, high = log_p(np.array([c - h, c, c + h]), least, scale)
    second = 0.5 * least * ((low - 2 * mid + high) / h**2 + ((high - low) / (2 * h)) ** 2)
    tail = np.log1p(c**2 / (scale**2 + least)) - np.log1p((c / scale) ** 2)
    c = c if sign >= 0 else -c
    case = (np.array([c]), np.array([[least]]), np.array([scale]), np.array([sign]))
    assert brute(*case) - evidence.log_coefficients(*case) == pytest.approx(np.log1p(second) + tail, abs=0.008)


def test_a_law_of_which_data_do_not_see_the_plausible_size_makes_no_set():
    """Deviation 1.5, plausible 1: beside the law that is seen it adds nothing; ln Z of Laplace would reward it."""
    laws = {name: Law(name, "x", "x", "1", 1.0) for name in ("seen", "blind", "huge")}
    gram = np.diag([100.0, 1 / 1.5**2, 1e-24])
    b = gram @ np.array([2.0, 0.1, 1e9])
    length = np.sqrt(np.diag(gram))
    ranking = Ranking(tuple(laws), None, None, gram, b, length, b / length, (), ())
    assert evidence.linear_gain(ranking, ("seen",), laws) > 100
    for name in ("blind", "huge"):
        assert evidence.linear_gain(ranking, (name,), laws) is None
        assert evidence.linear_gain(ranking, ("seen", name), laws) is None


def test_two_coefficients_are_the_integral_without_signs():
    cov = np.array([[0.005, 0.003], [0.003, 0.008]])
    case = (np.array([0.4, -1.0]), cov, np.array([1.0, 2.0]), np.array([0, 0]))
    assert evidence.log_coefficients(*case) == pytest.approx(brute(*case), abs=0.05)


@given(st.floats(0.01, 1e4))
def test_the_prior_is_one_or_a_little_less(scale):
    """Its integral: 1 where the scale is far above s, pi / 4 where s hides it all; less of it costs evidence."""
    c = np.concatenate([[0.0], np.geomspace(1e-4 * min(scale, 1.0), 1e3 * max(scale, 1.0), 40000)])
    p = np.exp(log_p(c, 1.0, scale))
    assert np.pi / 4 - 0.01 < 2 * integrate.trapezoid(p, c) < 1.01


def test_a_scale_that_is_ten_times_wider_costs_little():
    """Of two laws of one d the one with the narrower plausible range is not named for that."""
    cov, sign = np.array([[1.0]]), np.array([0])
    near, far = (evidence.log_coefficients(np.array([12.0]), cov, np.array([s]), sign) for s in (100.0, 1000.0))
    assert 0.2 < near - far < 0.5


def test_a_size_beyond_the_scale_costs_what_a_power_does():
    """Four scales instead of one, at the same d: a factor of (1 + 16) / (1 + 1) in p, and the shorter logarithm."""
    cov, sign = np.array([[1.0]]), np.array([0])
    one, four = (evidence.log_coefficients(np.array([40.0]), cov, np.array([s]), sign) for s in (40.0, 10.0))
    assert one - four == pytest.approx(np.log(17 / 2) + np.log(np.log(21) / np.log(81)), abs=0.01)


def test_the_forbidden_side_costs_evidence():
    cov, scale = np.array([[0.01]]), np.array([1.0])
    right = evidence.log_coefficients(np.array([0.5]), cov, scale, np.array([1]))
    wrong = evidence.log_coefficients(np.array([-0.5]), cov, scale, np.array([1]))
    assert right - wrong > 10


def test_more_laws_cost_more_by_themselves():
    found = [evidence.Candidate((), 0.0, 0, True), evidence.Candidate(("a",), 5.0, 0, True)]
    few, many = (evidence.posterior(found, evidence.log_priors(("a", *range(n - 1))))[1] for n in (5, 500))
    assert few > 0.95 > many
    assert few == pytest.approx(1 / (1 + 5 * np.exp(-5.0)))


def test_odds_of_models_that_are_all_unlikely_are_those_of_their_difference():
    found = [evidence.Candidate((), -1e6, 0, True), evidence.Candidate(("a",), -1e6 + 2.0, 0, True)]
    assert evidence.posterior(found, {"a": 0.0}) == pytest.approx([1 / (1 + np.exp(2.0)), 1 / (1 + np.exp(-2.0))])


def test_every_law_that_is_tried_has_the_same_prior():
    priors = evidence.log_priors(tuple("abcd"))
    assert sum(np.exp(v) for v in priors.values()) == pytest.approx(1.0)
    assert evidence.log_prior(("a", "d"), priors) == pytest.approx(2 * np.log(0.25))


@pytest.mark.parametrize("size", [1, 2, 3])
def test_linear_evidence_of_many_sets_is_that_of_each_by_least_squares(size):
    """Fall of chi2 and coefficients by lstsq on the signatures themselves; the degenerate set is none."""
    rng = np.random.default_rng(2)
    s, z = rng.normal(size=(30, 6)), rng.normal(size=30)
    s[:, 5] = 2.0 * s[:, 0]
    names = tuple("abcdef")
    length = np.linalg.norm(s, axis=0)
    ranking = Ranking(names, s, s, s.T @ s, s.T @ z, length, s.T @ z / length, (), ())
    laws = {n: Law(n, "x", "x", "1", 5.0, low=-0.01 if n == "b" else -np.inf) for n in names}
    found = evidence.linear_sets(ranking, names, laws, size)
    assert len(found.fall) == len({frozenset(found.laws(i)) for i in range(len(found.fall))})
    for i, (fall, c, gain) in enumerate(zip(found.fall, found.c, found.gain)):
        at = [names.index(n) for n in found.laws(i)]
        if {0, 5} <= set(at):
            assert (fall, gain) == (0.0, -np.inf)
            continue
        x = np.linalg.lstsq(s[:, at], z, rcond=None)[0]
        assert c == pytest.approx(x)
        assert fall == pytest.approx(z @ z - np.sum((z - s[:, at] @ x) ** 2))
        cov = np.linalg.inv(s[:, at].T @ s[:, at])
        beyond = 1 in at and -0.01 - x[at.index(1)] > 2 * np.sqrt(cov[at.index(1), at.index(1)])
        assert np.isfinite(gain) != beyond


class _Space:
    def __init__(self, blocks):
        self.blocks = blocks


class _Fit:
    def __init__(self, z, space):
        self.z = z
        self.model = type("M", (), {"space": space})()


def test_rivals_equally_near_to_the_truth_are_not_told_apart():
    from testbench.tracing.problem.space import Block

    rng = np.random.default_rng(0)
    space = _Space([Block(g, "a", slice(50 * g, 50 * g + 50)) for g in range(30)])
    clear = []
    for _ in range(300):
        z, left = (
            rng.normal(size=1500),
            rng.normal(size=(2, 30)).repeat(50, axis=1),
        )  # two different misfits, equally large
        clear.append(vuong(_Fit(z + left[0], space), _Fit(z + left[1], space)) > CLEAR)
    assert np.mean(clear) < 0.035  # 1 %, three sigma of 300
    assert vuong(_Fit(z, space), _Fit(z + 1.0, space)) > CLEAR
