"""Evidence, sets of laws, rivals: against integrals done by brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from testbench.tracing import evidence
from testbench.tracing.rivals import CLEAR, vuong


def brute(c_hat, cov, scale, sign):
    """Integral by quadrature over a grid, one or two coefficients."""
    inverse, least = np.linalg.inv(cov), np.diag(cov)
    whole = np.prod(2 * np.log(1 + 2 * scale / np.sqrt(least)))

    def density(*c):
        c = np.array(c)
        prior = 1 / np.prod((1 + (c / scale) ** 2) * np.sqrt(c**2 + least)) / whole
        return np.exp(-0.5 * (c - c_hat) @ inverse @ (c - c_hat)) * prior * 2.0 ** np.count_nonzero(sign)

    ranges = []
    for i in range(len(c_hat)):
        low, high = c_hat[i] - 9 * np.sqrt(cov[i, i]), c_hat[i] + 9 * np.sqrt(cov[i, i])
        ranges.append((max(low, 0.0) if sign[i] > 0 else low, min(high, 0.0) if sign[i] < 0 else high))
    return np.log(integrate.nquad(density, ranges)[0])


@pytest.mark.parametrize("sign", [0, 1, -1])
@pytest.mark.parametrize(("c", "bound"), [(0.0, 0.3), (0.3, 0.3), (1.0, 0.08), (2.0, 0.06)])
def test_one_coefficient_is_the_integral(c, bound, sign):
    """d of 0, 1.5, 5 and 10: to 0.3, and to 6 / d^2: half of (ln p)'' + (ln p)'^2, p from 1/c to 1/c^3."""
    c = c if sign >= 0 else -c
    case = (np.array([c]), np.array([[0.04]]), np.array([1.5]), np.array([sign]))
    assert evidence.log_coefficients(*case) == pytest.approx(brute(*case), abs=bound)


def test_two_coefficients_are_the_integral_without_signs():
    cov = np.array([[0.005, 0.003], [0.003, 0.008]])
    case = (np.array([0.4, -1.0]), cov, np.array([1.0, 2.0]), np.array([0, 0]))
    assert evidence.log_coefficients(*case) == pytest.approx(brute(*case), abs=0.05)


@given(st.floats(0.01, 1e4))
def test_the_prior_is_one_whatever_the_scale(scale):
    """Its integral, over a logarithm of c on either side."""
    c = np.concatenate([[0.0], np.geomspace(1e-4, 1e3 * max(scale, 1.0), 40000)])
    p = 1 / (1 + (c / scale) ** 2) / np.sqrt(c**2 + 1.0) / np.log(1 + 2 * scale)
    assert integrate.trapezoid(p, c) == pytest.approx(1.0, abs=0.4)


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


def test_priors_of_a_catalogue_and_of_a_library_are_ninety_and_ten_percent():
    catalogue, library = tuple("abc"), tuple("defghij")
    priors = evidence.log_priors(catalogue, library)
    assert sum(np.exp(priors[name]) for name in catalogue) == pytest.approx(0.9)
    assert sum(np.exp(priors[name]) for name in library) == pytest.approx(0.1)
    assert evidence.log_prior(("a", "d"), priors) == pytest.approx(np.log(0.3 * 0.1 / 7))
    assert np.exp(evidence.log_priors((), library)["d"]) == pytest.approx(1 / 7)


class _Space:
    def __init__(self, blocks):
        self.blocks = blocks


class _Fit:
    def __init__(self, z, space):
        self.z = z
        self.model = type("M", (), {"space": space})()


def test_rivals_equally_near_to_the_truth_are_not_told_apart():
    from testbench.tracing.space import Block

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
