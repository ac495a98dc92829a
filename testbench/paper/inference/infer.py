"""Posterior over boards: every mode enumerated; in each, draws by randomised optima with exact weights.

    cost      |H(z)|^2/2,  H = [z, (f(z) - y)/sigma]                z: standard normal by the priors
    screen    evidence of each mode with f linear about the middle of the priors; kept: within SCREEN_NATS of the best
    optimum   damped Gauss-Newton, all kept modes at once; those CUT_NATS below the best are left after FEW_STEPS
    evidence  -cost - ln det(J' J)/2, J of H: Laplace's; it says how many draws a mode gets
    draws     Q'(H(z) - e) = 0 for standard normal e, Q an orthonormal basis of J at the optimum. Their density is
              |det Q'J(z)| exp(-|Q'H(z)|^2/2), so that weights prior times likelihood over it make them exact

The effective sample size says whether they do. Where it is too small more are drawn, or the posterior is refused.
Source    docs/inference.md, docs/decisions/0017-inference-by-enumeration.md
"""

import functools
from typing import NamedTuple

import numpy as np

from testbench.errors import ConfigError
from testbench.paper.inference import forward, priors

SCREEN_NATS, CUT_NATS, LEAST_WEIGHT = 18.0, 14.0, 1e-3
STEPS, FEW_STEPS, STEP_Z = 60, 12, 1e-4
STILL = 1e-7  # relative change of the cost
EASE, STIFFEN = 0.3, 5.0
NEWTON_STEPS, NEWTON_REACH, SOLVED = 10, 1.5, 1e-5
LEAST_SIZE, MOST_TIMES = 60.0, (1, 4, 16)  # effective draws that are enough to judge coverage
SIZE = len(priors.PRIORS)


class Optimum(NamedTuple):
    """Kept modes: arrays over them, best first."""

    mode: dict  # {choice: array}
    z: np.ndarray  # (modes, priors)
    hessian: np.ndarray
    chi2: np.ndarray  # of the rows
    weight: np.ndarray  # posterior probability by Laplace


class Posterior(NamedTuple):
    """Weighted draws, the optima they came from, and how many draws they are worth."""

    optimum: Optimum
    z: np.ndarray  # (draws, priors)
    mode: dict
    weight: np.ndarray
    size: float


def jacobian(z, mode, names):
    """(f, J) of boards: (n, rows) and (n, rows, priors), by forward differences."""
    count = len(z)
    shifted_z = np.concatenate([z[None], z[None] + STEP_Z * np.eye(SIZE)[:, None]]).reshape(-1, SIZE)
    again = {name: np.tile(a, SIZE + 1) for name, a in mode.items()}
    predictions = forward.stack_predictions(shifted_z, again, names).reshape(SIZE + 1, count, len(names))
    return predictions[0], np.moveaxis((predictions[1:] - predictions[0]) / STEP_Z, 0, -1)


@functools.cache
def _middle():
    """All modes, with rows and derivatives at the middle of the priors."""
    mode, count = priors.modes()
    return mode, *jacobian(np.zeros((count, SIZE)), mode, forward.FITTED)


def screen_modes(data):
    """Modes whose evidence by the linear model is within SCREEN_NATS of the best."""
    mode, f, j = _middle()
    at = [forward.FITTED.index(name) for name in data.names]
    r, j = (data.value - f[:, at]) / data.sigma, j[:, at] / data.sigma[:, None]
    cov = np.eye(len(at)) + j @ np.swapaxes(j, 1, 2)
    evidence = -0.5 * np.einsum("mi,mi->m", r, np.linalg.solve(cov, r[..., None])[..., 0])
    evidence -= 0.5 * np.linalg.slogdet(cov)[1]
    mode_mask = evidence > evidence.max() - SCREEN_NATS
    return {name: a[mode_mask] for name, a in mode.items()}


def _linear(z, mode, data):
    """(H, J) of boards: (n, priors + rows), (n, priors + rows, priors)."""
    f, j = jacobian(z, mode, data.names)
    prior_jacobian = np.broadcast_to(np.eye(SIZE), (len(z), SIZE, SIZE))
    h = np.concatenate([z, (f - data.value) / data.sigma], axis=1)
    return h, np.concatenate([prior_jacobian, j / data.sigma[:, None]], axis=1)


def _cost(z, mode, data):
    r = (data.value - forward.stack_predictions(z, mode, data.names)) / data.sigma
    return 0.5 * np.sum(r * r, axis=1) + 0.5 * np.sum(z * z, axis=1)


def _select(mode, at):
    return {name: a[at] for name, a in mode.items()}


def _descend(z, mode, data, steps, free=1.0):
    """Damped Gauss-Newton of all boards at once: (z, cost); `free`: 0 for numbers that stay."""
    damping, cost = np.full(len(z), 1e-2), _cost(z, mode, data)
    for _ in range(steps):
        h, j = _linear(z, mode, data)
        j = j * free
        square = np.swapaxes(j, 1, 2) @ j + (damping[:, None, None] + 1 - free) * np.eye(SIZE)
        ahead = z - np.linalg.solve(square, np.einsum("mrk,mr->mk", j, h)[..., None])[..., 0]
        trial_cost = _cost(ahead, mode, data)
        better = trial_cost < cost
        gain = np.where(better, cost - trial_cost, 0.0)
        z, cost = np.where(better[:, None], ahead, z), np.where(better, trial_cost, cost)
        damping = np.where(better, damping * EASE, np.minimum(damping * STIFFEN, 1e6))
        if np.all((gain < STILL * (1 + cost)) & (better | (damping > 1e3))):
            break
    return z, cost


def optimum(data, mode=None):
    """`Optimum` over the screened modes, or over those given."""
    mode = screen_modes(data) if mode is None else mode
    z = np.zeros((len(next(iter(mode.values()))), SIZE))
    z, cost = _descend(z, mode, data, FEW_STEPS)
    mode_mask = cost < cost.min() + CUT_NATS
    mode, (z, cost) = (_select(mode, mode_mask), _descend(z[mode_mask], _select(mode, mode_mask), data, STEPS))
    h, j = _linear(z, mode, data)
    hessian = np.swapaxes(j, 1, 2) @ j
    evidence = -cost - 0.5 * np.linalg.slogdet(hessian)[1]
    weight = np.exp(evidence - evidence.max())
    order = np.argsort(-weight, kind="stable")
    chi2 = np.sum(h[:, SIZE:] ** 2, axis=1)
    return Optimum(_select(mode, order), z[order], hessian[order], chi2[order], weight[order] / weight.sum())


def fit_constrained(z, mode, data, fixed_z_by_name):
    """(z, Hessian) of one board with some numbers held: {name: z}; z (priors,), mode of numbers."""
    z, free = z.copy(), np.ones(SIZE)
    for name, value in fixed_z_by_name.items():
        k = priors.NAMES.index(name)
        z[k], free[k] = value, 0.0
    one = {name: np.array([choice]) for name, choice in mode.items()}
    for _ in range(3):
        optimum_z, _ = _descend(z[None], one, data, STEPS, free)
        z = optimum_z[0]
    _, j = _linear(z[None], one, data)
    return z, j[0].T @ j[0]


def _solve(z, mode, data, basis, noise):
    """z with Q'H(z) = noise, ln|det Q'J| there, |H|^2, and whether it was found."""
    count = len(z)
    unsolved_draws, converged = np.arange(count), np.zeros(count, bool)
    log_det, square = np.zeros(count), np.zeros(count)
    for _ in range(NEWTON_STEPS):
        h, j = _linear(z[unsolved_draws], _select(mode, unsolved_draws), data)
        q = np.swapaxes(basis[unsolved_draws], 1, 2)
        a, miss = q @ j, (q @ h[..., None])[..., 0] - noise[unsolved_draws]
        solved = np.max(np.abs(miss), axis=1) < SOLVED
        at = unsolved_draws[solved]
        converged[at], log_det[at], square[at] = True, np.linalg.slogdet(a[solved])[1], np.sum(h[solved] ** 2, axis=1)
        a, miss, unsolved_draws = a[~solved], miss[~solved], unsolved_draws[~solved]
        if not len(unsolved_draws):
            break
        step = np.linalg.solve(a, miss[..., None])[..., 0]
        size = np.max(np.abs(step), axis=1)
        z[unsolved_draws] -= step * np.minimum(1.0, NEWTON_REACH / np.maximum(size, 1e-9))[:, None]
    return z, log_det, square, converged


def posterior(data, rng, draws=1000, least=LEAST_SIZE):
    """`Posterior` of the rows: up to MOST_TIMES as many draws, until they are worth `least`; else ConfigError."""
    optima = optimum(data)
    for times in MOST_TIMES:
        post = _draw_posterior(data, rng, times * draws, optima)
        if post.size >= least:
            return post
    raise ConfigError(
        f"inference: {times * draws} weighted draws have an effective number of {post.size:.0f}, limit {least:g}"
    )


def _draw_posterior(data, rng, draws, optima):
    """`Posterior` of so many draws."""
    mode_mask = optima.weight > LEAST_WEIGHT
    mode, share = _select(optima.mode, mode_mask), optima.weight[mode_mask] / optima.weight[mode_mask].sum()
    which = np.sort(rng.choice(len(share), draws, p=share))
    _, j = _linear(optima.z[mode_mask], mode, data)
    basis, triangle = np.linalg.qr(j)
    noise = np.einsum("nij,ni->nj", basis[which], rng.standard_normal((draws, j.shape[1])))
    z = optima.z[which] + np.linalg.solve(triangle[which], noise[..., None])[..., 0]
    z, log_det, square, good = _solve(z, _select(mode, which), data, basis[which], noise)
    good &= forward.works(forward.predict(z, _select(mode, which), steps=False))
    log = np.where(good, 0.5 * np.sum(noise**2, axis=1) - 0.5 * square - log_det - np.log(share[which]), -np.inf)
    weight = np.exp(log - log.max()) if good.any() else np.zeros(draws)
    weight /= max(weight.sum(), 1e-300)
    size = float(1 / np.sum(weight**2)) if good.any() else 0.0
    return Posterior(optima, z, _select(mode, which), weight, size)


def quantile(values, weight, share):
    """Value below which `share` of the weight lies."""
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][min(np.searchsorted(total, share * total[-1]), len(values) - 1)])
