"""Noise with level and colour: whitening and likelihood against a dense covariance, draws against both."""

import numpy as np
import pytest

from testbench.measured.models.row_noise import Noise


def dense(a, sd, white_sd):
    """Covariance from the autoregression's own impulse response, long enough to have settled."""
    n, settled = len(sd), 4000
    response = np.zeros(settled)
    for k in range(settled):
        response[k] = float(k == 0) + sum(x * response[k - 1 - j] for j, x in enumerate(a) if k > j)
    lags = np.array([response[: settled - k] @ response[k:] for k in range(n)])
    rho = lags / lags[0]
    return np.outer(sd, sd) * rho[np.abs(np.subtract.outer(range(n), range(n)))] + white_sd**2 * np.eye(n)


@pytest.mark.parametrize("a", [[], [0.8], [1.0, -0.34, 0.15]])
@pytest.mark.parametrize("white_sd", [0.0, 0.3])
def test_whitening_is_that_of_the_dense_covariance(a, white_sd):
    rng, n = np.random.default_rng(1), 40
    sd, v = np.exp(rng.normal(size=n)), rng.normal(size=(n, 3))
    noise = Noise(np.array(a), 0.0, sd, (0,), white_sd)
    root = np.linalg.cholesky(dense(a, sd, white_sd))
    rows, logs = noise.innovations(v)
    np.testing.assert_allclose(rows, np.linalg.solve(root, v), atol=1e-9)
    assert logs == pytest.approx(2 * np.sum(np.log(np.diag(root))), abs=1e-9)
    np.testing.assert_array_equal(noise.whiten(v[:, 0]), rows[:, 0])


def test_draws_are_white_once_whitened_also_behind_gaps():
    noise = Noise.from_autocorrelation([1.0, 0.8, 0.6], np.linspace(0.5, 2.0, 60))._replace(white_sd=0.4)
    part = noise.select_rows(np.r_[0:20, 30:60])
    assert part.starts == (0, 20)
    z = part.whiten(part.draw_many(50, 4000, np.random.default_rng(2)))
    np.testing.assert_allclose(z @ z.T / 4000, np.eye(50), atol=0.12)
