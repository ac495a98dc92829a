"""The verdict: what may be said, by alarms, search and held-out groups; nothing is named by one of them alone.

firmware     the problem says that the firmware is not the model's: physics waits
none         no alarm, and held-out data agree
noise-model  only the declared noise is contradicted: no physical effect is named
named        one cause: the model is adequate, nothing else does as well, the coefficients are not the prior's
confounded   one class of two to five causes, each as good as the others: the next experiment splits it
candidate    a class of at most five, and no data from another file or session that could confirm it
unexplained  no set is adequate, or too many are, or only one that held-out data chose, or held-out data alone disagree;
             what is known about the rest is reported, partial laws beside it
"""

from typing import NamedTuple

import numpy as np

from testbench.tracing.fit.causes import MOST
from testbench.tracing.fit.identify import unseen_directions
from testbench.tracing.fit.rank import Projection
from testbench.tracing.noise.statistics import LEAST_PULL_SHARE

LEVEL = 0.01  # of the tests of noise; that of alarms is `Options.alpha`, of an explanation `heldout.REFUSED`
LEAST_HELDOUT_ODDS = 1.0  # ln odds by held-out data alone, for a name
LEAST_FREE_D = 3.0
MINOR = 0.1  # of the largest d of a set, below which a law beside it is no cause
MOST_IMITATED = 0.02  # of the laws left out that sets as large may imitate: the share of names that may be false
MOST_NUMERICAL = 0.5  # sigmas, of the analysis engine against the exact one
FAR = 4.0  # sds of a nuisance's way from its prior, from which an alarm tells it


class Decision(NamedTuple):
    """Verdict and the reason in one sentence."""

    verdict: str
    sentence: str


class Evidence(NamedTuple):
    """What stands behind a set beside its fit."""

    heldout: bool  # there are held-out groups
    independent: bool  # they are of another file or session
    confirmed: bool  # they show the change; needed without repeats, or if the declared noise is rejected
    doubtful: str  # why the noise is not to be trusted; "" if it is
    chosen: bool = False  # by held-out data, where the set that fits best is refused: they cannot judge it too
    untried: int = 0  # sets as near as those of the class that were not refitted
    imitated: float = 0.0  # `specificity.imitated_share` of sets of this many laws
    unsupported: str = ""  # of `unsupported_law_reason`
    heldout_odds: float = np.inf  # ln odds of the set by held-out data alone


def free_d(fit, identifiability):
    """{law: d} of a fit's laws when directions that only priors hold are free: small means confounded with those."""
    n, loose = len(fit.point.theta), unseen_directions(identifiability)
    out = {}
    for i, law in enumerate(fit.model.laws):
        columns = np.delete(fit.jacobian, n + i, axis=1)
        prior_columns = np.delete(fit.model.prior_columns(), n + i, axis=1)
        if loose.shape[1]:
            columns = np.concatenate([columns, fit.jacobian[:, :n] @ loose], axis=1)
            prior_columns = np.concatenate([prior_columns, np.zeros((len(prior_columns), loose.shape[1]))], axis=1)
        s = fit.jacobian[:, n + i : n + i + 1]
        out[law.name] = float(
            np.linalg.norm(Projection(columns, prior_columns).project_with_priors(s)) * abs(fit.point.c[i])
        )
    return out


def nuisance_notes(fit):
    """Notes on nuisances that the data have moved by more than FAR of the deviations that noise and prior allow."""
    out, prior_nuisances, prior_pulls = [], fit.model.priors, np.abs(fit.model.prior_rows(fit.point))
    allowed = np.sqrt(
        np.maximum(1 - (fit.sd[prior_nuisances] / fit.model.sd[prior_nuisances]) ** 2, LEAST_PULL_SHARE**2)
    )
    for j in prior_nuisances[prior_pulls > FAR * allowed]:
        nuisance, value = fit.model.problem.nuisances[j], fit.point.theta[j]
        unit = nuisance.unit if nuisance.unit != "1" else ""
        away = abs(value - nuisance.value) / nuisance.prior_sd
        out.append(
            f"{f'{nuisance.name} = {value:.8g} {unit}'.strip()}: {away:.3g} prior standard deviations from its prior"
        )
    return out


def corrections(fit):
    """Laws of a fit that are smaller than a MINOR part of the largest, in sigmas: they may mend its shape."""
    n = len(fit.point.theta)
    d = np.abs(fit.point.c) / fit.sd[n:]
    return [law.name for law, size in zip(fit.model.laws, d) if size < MINOR * d.max()]


def naming_obstacle(problem, converged):
    """Why nothing may be named: "before" is not certified, or the engine's own error is too large; "" if neither."""
    if not converged:
        return "the calibration has not converged"
    certificate = problem.numerical_certificate or {}
    if "failed" in certificate:
        return f"the exact engine does not confirm the fitted point ({certificate['failed']})"
    numerical = certificate.get("sigma")
    if numerical is not None and not numerical < MOST_NUMERICAL:
        return f"the numerical error of the engine is {numerical:.3g} sigma, limit {MOST_NUMERICAL} sigma"
    return ""


def unsupported_law_reason(problem, fit):
    """Why a law of a fit is not named, however well it fits: data cannot support it, or show too little; "" if not."""
    n = len(fit.point.theta)
    for law, d in zip(fit.model.laws, np.abs(fit.point.c) / fit.sd[n:]):
        if why := problem.insufficient_data_reason(law.name):
            return why
        if d < problem.least_d:
            return f"{law.name} has only {d:.2g} sigma with all nuisance parameters fitted, {problem.least_d:g} needed"
    return ""


def correct_p(p, n_traces):
    """Sidak: p of the smallest of `n_traces` such p."""
    return float(-np.expm1(n_traces * np.log1p(-min(p, 1 - 1e-15)))) if n_traces > 1 else float(p)


def decide_before_search(has_misfit, alarms, noise, p):
    """`Decision` when nothing deterministic was found; None if tracing must go on."""
    if has_misfit:
        return None
    declared = alarms.declared.p_global
    if noise.octaves and (noise.p < LEVEL or declared < LEVEL):
        if noise.p < LEVEL:
            return Decision(
                "noise-model",
                f"the repeats have no common misfit (p = {p:.2g}); their noise differs from the declared noise "
                f"(p = {noise.p:.2g}): {noise.worst}" + (f"; largest jump: {noise.jump}" if noise.jump else ""),
            )
        return Decision(
            "noise-model",
            f"the misfit exceeds the declared noise (p = {declared:.2g}), but the repeats do not show that it is the "
            f"same in all of them (p = {p:.2g}); more repeats would decide",
        )
    return Decision("none", f"no misfit above the noise (p = {p:.2g})")


def with_heldout(decision, heldout_result, alpha, n_traces):
    """`Decision` "none" stays only if data that no fit has seen agree with the calibrated model; others as they are."""
    p = correct_p(heldout_result.p, n_traces)
    if decision is None or decision.verdict != "none" or p >= alpha:
        return decision
    last = heldout_result.chi2.get("after")
    chi2_text = (
        heldout_result.failed
        if last is None
        else f"chi2 / rows {last:.3g}, limit {heldout_result.limit:.3g}, p = {p:.2g}"
    )
    return Decision(
        "unexplained",
        f"the fitted data raise no alarm, but the held-out data disagree with the model ({chi2_text}): an effect is "
        "missing",
    )


def with_search(search_result, causes, free, evidence, blocked):
    """`Decision` after the search.

    causes    `causes.Cause`s that do as well as each other;   free  `free_d` of the best set
    evidence  `Evidence`;   blocked  why nothing may be named whatever is found; "" if nothing is in the way
    """
    best, laws, doubtful = (
        search_result.best,
        " + ".join(search_result.best or search_result.dropped),
        evidence.doubtful,
    )
    if laws and doubtful and evidence.heldout and not evidence.confirmed:
        return Decision("noise-model", f"{doubtful}, and {laws} is not confirmed by held-out data")
    if search_result.dropped:
        return Decision(
            "unexplained",
            f"the model lacks an effect; {laws} fits best, but fitted and held-out data together do not support it",
        )
    if not best:
        what = f", or the noise is larger than declared ({doubtful})" if doubtful else ""
        return Decision("unexplained", f"the model lacks an effect{what}; none of the laws tried explains the misfit")
    if blocked:
        return Decision("unexplained", f"{laws} explains a part of the misfit, but it is not named: {blocked}")
    if not search_result.adequate:
        return Decision(
            "unexplained", f"{laws} explains a part of the misfit; none of the laws tried explains the remainder"
        )
    minor = corrections(search_result.fit(best))
    if minor:
        what = f"{', '.join(minor)} may only correct the shape of a law that was not tried"
        return Decision("unexplained", f"{laws} explains a part of the misfit; {what}")
    if evidence.chosen:
        what = "held-out data were used to choose it, because the set that fits best is rejected"
        return Decision("unexplained", f"{laws} explains the misfit, but {what}; no other data confirm it")
    if evidence.imitated > MOST_IMITATED:
        what = f"sets of {len(best)} laws imitate {evidence.imitated:.0%} of the laws that are left out"
        return Decision("unexplained", f"{laws} explains the misfit, but at this effect size {what}; none is named")
    if evidence.untried:
        what = f"{evidence.untried} sets of laws that fit about as well were not refitted"
        return Decision(
            "unexplained", f"{laws} explains the misfit, but {what}; its class may be incomplete, so none is named"
        )
    if evidence.unsupported:
        return Decision("unexplained", f"{laws} explains the misfit, but {evidence.unsupported}; it is not named")
    if evidence.heldout and evidence.independent and evidence.heldout_odds < LEAST_HELDOUT_ODDS:
        what = f"ln odds {evidence.heldout_odds:.2g}, {LEAST_HELDOUT_ODDS:g} needed"
        return Decision(
            "unexplained", f"{laws} explains the misfit, but held-out data do not confirm it ({what}); it is not named"
        )
    if len(causes) > MOST:
        return Decision(
            "unexplained", f"{laws} explains the misfit, and so do {MOST} or more other causes; no class is named"
        )
    names = " or ".join(" + ".join(c.names) for c in causes)
    gauge = [law for law in best if free[law] < LEAST_FREE_D]
    more = (
        f"; {', '.join(gauge)}: confounded with nuisance parameters that only their priors constrain" if gauge else ""
    )
    if not (evidence.heldout and evidence.independent):
        caution = f"; {doubtful}" if doubtful else ""
        why = "the held-out data are from the fitted file" if evidence.heldout else "no data were held out"
        return Decision("candidate", f"explained by {names}, but not confirmed: {why}{caution}{more}")
    if gauge or len(causes) > 1:
        alike = "; these data cannot distinguish them" if len(causes) > 1 else ""
        return Decision("confounded", f"explained by {names}{alike}{more}")
    return Decision(
        "named", f"explained by {laws}, and by none of the other {len(search_result.pool) - len(best)} laws tried"
    )
