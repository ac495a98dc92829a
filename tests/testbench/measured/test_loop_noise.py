"""Noise of features from few draws: what a coefficient's stated deviation is worth, on covariances that are known."""

import numpy as np
import pytest

from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_noise

OBSERVABLES, BINS = 8, 5
FEATURES = OBSERVABLES * BINS


def covariance(rng):
    """Of features that are alike over two orders of magnitude, as codes and words of one loop are."""
    turned, _ = np.linalg.qr(rng.normal(size=(FEATURES, FEATURES)))
    c = turned * np.logspace(0, -2, FEATURES) @ turned.T
    return c / np.sqrt(np.outer(np.diag(c), np.diag(c)))


def drawn(rng, covariances):
    """{condition: (draws, change per hertz)} of power-ons whose frequencies are those of the jitter."""
    out = {}
    for name, c in covariances.items():
        slope = np.repeat(np.arange(OBSERVABLES) == 5, BINS).astype(float)
        rows = rng.multivariate_normal(np.zeros(FEATURES), c, loop_noise.NOISE_DRAWS)
        out[name] = rows + np.outer(loop_noise.JITTER, slope), slope
    return out


def worth():
    """rms of actual / stated deviation of coefficients of random laws in one condition, the conditions unlike."""
    rng, ratios = np.random.default_rng(3), []
    for _ in range(5):
        true = {k: covariance(rng) for k in range(6)}
        draws = drawn(rng, true)
        noise, gain = loop_noise.estimate_noise(draws), loop_noise.compute_noise_gain(draws)
        for k, c in true.items():
            n = noise[k]
            stated = (n.chol @ n.chol.T) * np.outer(n.sigma, n.sigma)
            for _ in range(10):
                law = rng.normal(size=FEATURES)
                weights = np.linalg.solve(stated, law)
                weights /= weights @ law
                ratios.append(gain**2 * (weights @ c @ weights) / (weights @ stated @ weights))
    return float(np.sqrt(np.mean(ratios)))


def test_deviations_are_worth_what_they_state(monkeypatch):
    """Conditions whose noise is unlike: correlations that are pooled and nothing else state too little."""
    kept = worth()
    monkeypatch.setattr(loop_noise, "UNPOOLED_WEIGHT", 0.0)
    pooled = worth()
    assert 0.97 < kept < 1.03 < pooled


def test_draws_have_unit_variance_in_their_own_noise():
    rng = np.random.default_rng(5)
    draws = drawn(rng, {k: covariance(rng) for k in range(6)})
    noise, square = loop_noise.estimate_noise(draws), []
    for k, (rows, _) in draws.items():
        z = np.linalg.solve(noise[k].chol, (rows - rows.mean(axis=0)).T / noise[k].sigma[:, None])
        square.append(z.var(axis=1, ddof=1).mean())
    assert np.mean(square) == pytest.approx(1.0, rel=1e-9)


def test_too_few_draws_for_many_features_are_refused():
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(loop_noise.NOISE_DRAWS, OBSERVABLES * 8))
    with pytest.raises(ConfigError, match="63 deviations for 64 features"):
        loop_noise.estimate_noise({"a": (rows, np.zeros(OBSERVABLES * 8))})
