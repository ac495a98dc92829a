"""What this record would have seen: the smallest effects, and how often the alarm rings for nothing.

    d_90,k = q_k + 1.2816 s_k       q: the catalogue statistic at which the smallest p of all looks becomes alpha
                                    s_k: spread of t_k in null draws of the alarm (above 1 where the noise is estimated)
The other statistics only add power, so d_90 is an upper limit of the true one; pseudo-experiments at d_90 check it.
Null rate: simulated means and contrasts of the declared noise, octaves estimated anew, through the same projection.
Source    Clopper & Pearson (1934); docs/tracing.md
"""

import copy

import numpy as np
from scipy.stats import beta

from testbench.tracing.fit.rank import Projection
from testbench.tracing.noise import noise_model as noises
from testbench.tracing.noise.alarms import declared_draws, null_statistics, refined_view
from testbench.tracing.noise.statistics import TAIL, tail_p

Z90 = 1.2816
TRIALS = 200


def clopper_pearson(k, n, level=0.95):
    """Exact interval of a rate of k in n."""
    a = (1 - level) / 2
    return [float(beta.ppf(a, k, n - k + 1)) if k else 0.0, float(beta.ppf(1 - a, k + 1, n - k)) if k < n else 1.0]


def smallest_p(reference, statistics):
    """Smallest p over the statistics of each column, by the tails of the reference draws."""
    return np.min([tail_p(v, null) for v, null in zip(statistics, reference)], axis=0)


def threshold(reference, alpha):
    """Smallest p at which the alarm rings, alpha of all null draws."""
    return float(np.quantile(smallest_p(reference, reference), alpha))


class Power:
    """Thresholds of the alarm of a finished trace at its base fit, and its rates."""

    def __init__(self, base, alarms, noise, rankings, laws, alpha, seed):
        self.base, self.alarms, self.laws = base, alarms, laws
        self.space, self.noise, self.rankings = base.model.space, noise, rankings
        self.alpha = alpha if alarms.model_based else alpha / 2  # two alarms share it
        self.crit = threshold(alarms.reference, self.alpha)
        self.rng = np.random.default_rng([seed, 5])
        # projection and rankings in the units of the alarm
        self.projection, self.alarm_rankings = Projection(base.jacobian, base.model.prior_columns()), rankings
        if not alarms.model_based:
            self.projection, _, _, self.alarm_rankings = refined_view(base, rankings, noise)

    def _draw(self, count):
        if self.alarms.model_based:
            return declared_draws(self.space, count, self.rng)
        return self.noise.refined_draws(self.space, count, self.rng)

    def _project_draws(self, noise):
        """TRIALS draws as a fit leaves them, priors drawn too."""
        return self.projection.project_with_priors(noise, self.rng.normal(size=(self.projection.priors, TRIALS)))

    def smallest(self):
        """{law: {d, value, unit}}: effects that this record would have shown with 90 %."""
        draws, looked = self._project_draws(self._draw(TRIALS)), self.alarms.statistics.names
        out = {}
        for label, ranking in self.alarm_rankings.items():
            null = np.sort(self.alarms.reference[looked.index(label)]) if label in looked else None
            base = self.rankings[label]
            for i, name in enumerate(ranking.names):
                law, length = self.laws[name], ranking.length[i]
                if length == 0 or null is None:
                    out[name] = {
                        "d": None,
                        "value": None,
                        "unit": law.unit,
                        "why": "these data are not sensitive to it",
                    }
                    continue
                spread = max(1.0, float(np.std(ranking.signatures[:, i] @ draws[: self.space.size] / length)))
                d = _statistic_at(null, self.crit) + Z90 * spread
                value = d / length
                out[name] = {"d": float(value * base.length[i]), "value": float(value), "unit": law.unit}
        return out

    def detection_rate(self, smallest):
        """Share of pseudo-experiments at d_90 that ring, for the law seen best: {law, trials, rang, ci}."""
        detectable_laws = [(row["d"], name) for name, row in smallest.items() if row["d"] is not None]
        if not detectable_laws:
            return None
        _, name = min(detectable_laws)
        (ranking,) = [r for r in self.alarm_rankings.values() if name in r.names]
        signal = ranking.signatures[:, ranking.index(name)] * smallest[name]["value"]
        side = -1.0 if self.laws[name].sign < 0 else 1.0
        noise = self._draw(TRIALS) + side * signal[:, None]
        statistics = self.alarms.statistics.evaluate(self._project_draws(noise))
        rang = int(np.sum(smallest_p(self.alarms.reference, statistics) <= self.crit))
        return {"law": name, "trials": TRIALS, "rang": rang, "ci": clopper_pearson(rang, TRIALS)}

    def null_rate(self):
        """False alarms of this record's alarm in simulated nulls: {trials, rang, rate, ci, alpha}."""
        rang = 0
        if self.alarms.model_based:
            fresh = null_statistics(self.alarms.statistics, self.projection, self._draw, TRIALS, self.rng)
            rang = int(np.sum(smallest_p(self.alarms.reference, fresh) <= self.crit))
        else:
            for _ in range(TRIALS):
                rang += self._pseudo_null() <= self.crit
        counts = {"trials": TRIALS, "rang": int(rang), "rate": rang / TRIALS, "alpha": self.alpha}
        return counts | {"ci": clopper_pearson(int(rang), TRIALS)}

    def _pseudo_null(self):
        """Smallest p of one simulated record without any effect, octaves estimated from its own contrasts."""
        space, fit = copy.copy(self.space), self.base
        space.contrasts = [self.rng.normal(size=c.shape) for c in space.contrasts]
        simulated_noise = noises.estimate_octave_noise([space], self.rng, judge=False)
        projection, _, statistics, _ = refined_view(fit, self.rankings, simulated_noise)
        prior = self.rng.normal(size=(projection.priors, 1))
        residual = projection.project_with_priors(
            simulated_noise.whitener(space)(self.rng.normal(size=(space.size, 1))), prior
        )
        return float(smallest_p(self.alarms.reference, statistics.evaluate(residual))[0])


def _statistic_at(null, p):
    """Value of a statistic whose `tail_p` is p."""
    low, high = np.quantile(null, TAIL)
    most, least = (1 - t for t in TAIL)
    if p >= least or high <= low:
        return float(np.quantile(null, 1 - p))
    return float(high + np.log(least / p) * (high - low) / np.log(most / least))


def limits(ranking, laws):
    """{law: 95 % limits of its coefficient} when nothing was found: +- 1.96 sd, one-sided for laws with a sign."""
    out = {}
    for i, name in enumerate(ranking.names):
        length, law = ranking.length[i], laws[name]
        if length > 0:
            c, sd = ranking.t[i] / length, 1 / length
            low, high = (c - 1.96 * sd, c + 1.96 * sd)
            if law.sign > 0:
                low, high = 0.0, max(c, 0.0) + 1.645 * sd
            elif law.sign < 0:
                low, high = min(c, 0.0) - 1.645 * sd, 0.0
            out[name] = {"low": float(low), "high": float(high), "unit": law.unit}
    return out
