"""Toy problems for the tracing core. Their data come from loops over scalars here, not from their own predict."""

import math

import numpy as np
from scipy.linalg import solve_triangular

from testbench.tracing.problem.problem import Law, Nuisance, Observable, PredictionFailed, Problem, Segment

BINS = 16
TIME = (np.arange(BINS) + 0.5) / BINS
FIT = [  # amplitude, temperature in degC, rate in deg/s
    (0.3, 25.0, 0.0),
    (0.7, 25.0, 200.0),
    (1.0, -20.0, -200.0),
    (1.2, 50.0, 100.0),
    (1.5, 0.0, -100.0),
    (1.7, 40.0, 0.0),
    (0.5, 10.0, 150.0),
    (1.6, 25.0, -150.0),
]
HELD = [(0.6, 0.0, 150.0), (1.3, 40.0, -150.0), (1.5, 25.0, 80.0)]
SCALE_F, SCALE_A = 0.05, 0.02  # noise of one bin


def kernel(n, flicker=1.0):
    """Covariance of bins in units of one bin's white variance: white, and a slow part; flicker scales its sd."""
    i = np.arange(n)
    return np.eye(n) + 0.15 * flicker**2 * np.exp(-np.abs(i[:, None] - i[None]) / 8.0)


def truth_scalar(name, t, A, T, rate, theta, c):
    """One feature, in plain floats: the 'nature' of the toy."""
    f0, tcf, ln_g, ln_tau, zro = theta
    rise = 1.0 - math.exp(-t / math.exp(ln_tau))
    x = A * rise
    if name == "f":
        y = f0 + tcf * (T - 25.0) / 45.0
        y += c.get("duffing", 0.0) * x**2 + c.get("quintic", 0.0) * x**4
        y += c.get("selfheat", 0.0) * A**2 * (1.0 - math.exp(-t / 2.0))
        y += c.get("centrifugal", 0.0) * (rate / 200.0) ** 2
        y += c.get("hot", 0.0) * (T - 25.0) / 45.0 * x**2
        y += c.get("springy", 0.0) * x**2 * (1.0 + 0.1 * A)
        y += c.get("step", 0.0) * (1.0 if t > 0.6 and A > 1.1 else 0.0)
        return y
    y = math.exp(ln_g) * x + zro + 0.3 * rate / 200.0
    y += c.get("pickoff", 0.0) * x**3
    y += c.get("damping", 0.0) * x**3 * (T - 25.0) / 45.0
    y += c.get("friction", 0.0) * (1.0 if x > 0.6 else 0.0)
    y += c.get("centripetal", 0.0) * (rate / 200.0) ** 2 * A
    y += c.get("latency", 0.0) * (rate / 200.0) * math.exp(-t / 0.1)
    y += c.get("feed", 0.0) / (0.3 + A)
    y += c.get("leak", 0.0) / (0.4 + A) + c.get("seep", 0.0) / (0.2 + A)
    return y


LAWS = (
    Law("duffing", "force_x", "-k3 x^3", "Hz", 1.0),
    Law("quintic", "force_x", "-k5 x^5", "Hz", 1.0),
    Law("selfheat", "force_x", "self-heating A^2", "Hz", 1.0),
    Law("centrifugal", "force_x", "Omega^2 x", "Hz", 1.0),
    Law("pickoff", "cv_x", "x + e x^3", "V", 0.5, kind="instrument"),
    Law("damping", "force_x", "-d3(T) x^2 v", "V", 0.5),
    Law("latency", "word", "late FTR", "V", 0.5, sign=1),
    Law("feed", "cv_y", "y + e u", "V", 0.5),
)
LIBRARY = (
    Law("friction", "force_x", "sgn v", "V", 0.5, term=(("sgn v", 1.0),)),
    Law("hot", "force_x", "T x^3", "Hz", 0.5, term=(("T", 1.0), ("x", 3.0))),
    Law("centripetal", "force_y", "Omega^2 x", "V", 0.5, term=(("rate", 2.0), ("x", 1.0))),
)
# like feed (cosine 0.9989) and like duffing (0.9998): at 60 sigmas 2.8 and 1.2 sigmas are left beside the other
NEAR = (
    Law("leak", "cv_y", "y + e u, less so at small A", "V", 0.5),
    Law("springy", "force_x", "-k3(A) x^3", "Hz", 1.0),
)
NUISANCES = (
    Nuisance("f0", "Hz", 10.0, math.inf),
    Nuisance("tcf", "Hz", 0.0, 1.0),
    Nuisance("ln_g", "", 0.0, 0.1),
    Nuisance("ln_tau", "", math.log(0.15), 0.2),
    Nuisance("zro", "V", 0.0, 0.1),
)


class Toy(Problem, adds="declared theta effects without"):
    """Two observables over time in some conditions; `effects` is what nature has and the base model lacks."""

    def __init__(
        self, seed=0, effects=None, repeats=2, flicker=1.0, noise=1.0, library=LIBRARY, laws=LAWS, conditions=FIT
    ):
        rng = np.random.default_rng(seed)
        self.name, self.laws, self.library, self.nuisances = "toy", laws, library, NUISANCES
        self.hashes = {"toy": f"{seed} {effects} {repeats} {flicker} {noise}"}
        self.declared = {"f": SCALE_F**2 * kernel(BINS), "a": SCALE_A**2 * kernel(BINS)}
        self._chol = {k: np.linalg.cholesky(v) for k, v in self.declared.items()}
        real = {
            "f": (noise * SCALE_F) ** 2 * kernel(BINS, flicker),
            "a": (noise * SCALE_A) ** 2 * kernel(BINS, flicker),
        }
        draw = {k: np.linalg.cholesky(v) for k, v in real.items()}
        sd = [0.5 if math.isinf(n.prior_sd) else n.prior_sd for n in NUISANCES]
        self.theta = np.array([n.value for n in NUISANCES]) + np.array(sd) * rng.normal(size=len(sd))
        self.effects = dict(effects or {})
        observables = (Observable("f", "Hz", slice(0, BINS)), Observable("a", "V", slice(BINS, 2 * BINS)))
        segments, self._y, self._conditions = [], [], []
        for role, rows in (("fit", conditions), ("validate", HELD)):
            for i, (A, T, rate) in enumerate(rows):
                clean = [
                    [truth_scalar(o, t, A, T, rate, self.theta.tolist(), self.effects) for t in TIME]
                    for o in ("f", "a")
                ]
                for r in range(repeats):
                    segments.append(
                        Segment(f"{role}{i}.{r}", {"A": A, "T": T, "rate": rate}, f"{role}{i}", r, role, observables)
                    )
                    noisy = [np.array(row) + draw[o] @ rng.normal(size=BINS) for o, row in zip(("f", "a"), clean)]
                    self._y.append(np.concatenate(noisy))
                    self._conditions.append((A, T, rate))
        self.segments = tuple(segments)

    def without(self, role):
        """Take out all segments with a role."""
        kept = [k for k, s in enumerate(self.segments) if s.role != role]
        self._y, self._conditions = [self._y[k] for k in kept], [self._conditions[k] for k in kept]
        self.segments = tuple(self.segments[k] for k in kept)

    def observed_features(self, k):
        return self._y[k]

    def predict(self, points, which):
        out = []
        for theta, c in points:
            if not np.all(np.abs(theta[2:4]) < 20):
                raise PredictionFailed("logarithm out of range")
            out.append([self._features(theta, c, *self._conditions[k]) for k in which])
        return out

    def _features(self, theta, c, A, T, rate):
        f0, tcf, ln_g, ln_tau, zro = theta
        x = -A * np.expm1(-TIME * np.exp(-ln_tau))
        w, warm = rate / 200, (T - 25) / 45
        f = f0 + tcf * warm + c.get("duffing", 0) * x * x + c.get("quintic", 0) * (x * x) ** 2
        f = f - c.get("selfheat", 0) * A * A * np.expm1(-TIME / 2) + c.get("centrifugal", 0) * w * w
        f = f + (c.get("hot", 0) * warm + c.get("springy", 0) * (1 + 0.1 * A)) * x * x
        cubic = c.get("pickoff", 0) + c.get("damping", 0) * warm
        a = np.exp(ln_g) * x + zro + 0.3 * w + cubic * x**3 + c.get("friction", 0) * (x > 0.6)
        a = a + c.get("centripetal", 0) * w * w * A
        a = a + c.get("latency", 0) * w * np.exp(-TIME / 0.1) + c.get("feed", 0) / (0.3 + A)
        a = a + c.get("leak", 0) / (0.4 + A)
        return np.concatenate([f, a])

    def whiten(self, k, v):
        parts = [
            solve_triangular(self._chol[o], v[s], lower=True)
            for o, s in (("f", slice(0, BINS)), ("a", slice(BINS, 2 * BINS)))
        ]
        return np.concatenate(parts)

    def noise_draw(self, k, rng):
        return np.concatenate([self._chol[o] @ rng.normal(size=BINS) for o in ("f", "a")])

    def repeatability_rms(self, k):
        return {o: float(np.sqrt(np.diag(self.declared[o]).mean())) for o in ("f", "a")}
