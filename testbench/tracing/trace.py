"""The whole trace: calibrate, alarm, rank, refit, judge on held-out groups, say what may be said.

trace(problem) -> Result       steps and equations: docs/tracing.md
"""

from dataclasses import asdict, dataclass

import numpy as np

from testbench.tracing import next_experiment, outcome, verdict
from testbench.tracing.fit import discover, heldout, identify, specificity
from testbench.tracing.fit import posterior_fit as calibration
from testbench.tracing.fit.causes import find_causes
from testbench.tracing.fit.evidence import log_prior
from testbench.tracing.fit.rank import Signatures, rank
from testbench.tracing.fit.rivals import CLEAR, open_rivals
from testbench.tracing.fit.search import Search
from testbench.tracing.noise import noise_model
from testbench.tracing.noise.alarms import alarms
from testbench.tracing.noise.power import Power
from testbench.tracing.problem.model import Model
from testbench.tracing.problem.predictor import Failed, Predictor
from testbench.tracing.problem.problem import all_laws, check, duplicate_laws
from testbench.tracing.problem.result import Result
from testbench.tracing.problem.space import Space
from testbench.tracing.problem.trace_checkpoint import Store

ROWS_OF_DRAWS = 60_000_000  # numbers drawn for one alarm at most
FEWEST_DRAWS = 199
RANKS = 10  # null draws at least that may lie beyond an alarm at its level
DOUBT = 0.2  # p of an alarm without the laws that cost runs, below which it is taken again with them
PARTIAL = CLEAR**2  # of held-out chi2, by which each law of several, or of a partial explanation, must lower it


@dataclass(frozen=True)
class Options:
    """Thresholds and effort.

    alpha   chance of a false alarm on a clean record, by fitted and held-out data together (docs/tracing.md)
    looks   how many traces like this one the caller makes; it widens every p
    n_null  null draws of an alarm; more where its level asks for them
    """

    alpha: float = 0.002
    looks: int = 1
    n_null: int = 999
    seed: int = 0
    max_laws: int = 3
    starts: int = 2
    grammar: bool = True  # laws of the library compete with those of the catalogue
    power: bool = True
    experiments: bool = True


class Tracer:
    """One run of `trace`, step by step; what is kept is what later steps and the report need."""

    def __init__(self, problem, options, progress, checkpoint):
        check(problem)
        self.problem, self.options, self.progress = problem, options, progress
        self.store = checkpoint if isinstance(checkpoint, Store) else Store(checkpoint)
        self.predictor = Predictor(problem, self.store, progress)
        self.laws = all_laws(problem)
        self.space, self.held = Space(problem, "fit"), Space(problem, "validate")
        self.catalogue = tuple(law.name for law in problem.laws)
        self.library = tuple(law.name for law in problem.library) if options.grammar else ()
        # the same law in other parameters is tried once; laws that cost runs wait for an alarm
        self.dropped = duplicate_laws(problem, (*self.catalogue, *self.library))
        self.waiting = self.library if problem.library_late else ()
        # fitted and held-out data share the chance of a false alarm
        self.alpha = options.alpha / 2 if self.held.size else options.alpha
        self.chosen, self.untried, self.imitated = False, 0, 0.0
        self.notes, self.selections, self.rivals, self.causes = list(problem.warnings), [], [], []

    def report_progress(self, text, count=0, total=1):
        self.predictor.text = text
        if self.progress:
            self.progress(text, count, total)

    def calibrate(self):
        """Fit without laws; with the noise of the repeats if the declared one is not it."""
        self.report_progress("calibrating")
        self.base = calibration.calibrate(
            Model(self.space, self.predictor), self.options.starts, self.options.seed, progress=self.progress
        )
        if self.base.fit.failed:
            return False
        rng = np.random.default_rng([self.options.seed, 4])
        judge = not self.problem.noise_from_repeats
        self.noise = noise_model.estimate_octave_noise([self.space], rng, verdict.LEVEL, judge=judge)
        self.held_noise = noise_model.estimate_octave_noise(
            [self.space, self.held], rng, verdict.LEVEL, judge=judge
        ).loud()
        if self.noise_rejected:
            self.notes.append(
                "the repeats contradict the declared noise; variances are re-estimated by observable and octave"
            )
            self.space = Space(self.problem, "fit", self.noise)
            self.held = Space(self.problem, "validate", self.held_noise)
            self.held_noise = self.held_noise.unit_noise()
            again = Model(self.space, self.predictor)
            self.base = calibration.calibrate(again, self.options.starts, self.options.seed, self.base.fit.point)
        self.identified = identify.identify(self.base.fit)
        self.table = Signatures(self.base.fit)
        return not self.base.fit.failed

    def rank(self, fit, names):
        """`Ranking` of laws that are not in a fit."""
        return rank(fit, names, self.table.signature_columns(fit, names))

    def rankings(self, fit):
        """{"catalogue": .., "library": ..} of the laws that are not in a fit."""
        out = {}
        for label, names in (("catalogue", self.catalogue), ("library", self.library)):
            excluded_laws = {*fit.model.names, *self.dropped, *self.waiting}
            names = tuple(n for n in names if n not in excluded_laws)
            if names:
                out[label] = self.rank(fit, names)
        return out

    @property
    def noise_rejected(self):
        """True if the repeats contradict the declared noise."""
        return self.noise.p < verdict.LEVEL

    def alarm(self, fit, rankings, alpha):
        """Alarms at a fit, with draws for a level.

        In a refined space the declared noise is the refined one, the octaves' uncertainty stays.
        """
        needed_draws = max(self.options.n_null, int(np.ceil(RANKS / alpha)) - 1)
        draws = max(FEWEST_DRAWS, min(needed_draws, ROWS_OF_DRAWS // max(self.space.size, 1)))
        return alarms(self.store, fit, rankings, self.space_noise(), draws, self.options.seed)

    def space_noise(self):
        """Octaves in units of the space in use."""
        return self.noise.unit_noise() if self.noise_rejected else self.noise

    def adequate(self, fit):
        """Alarms again with the effects added, and the held-out test."""
        self.report_progress(f"checking {' + '.join(fit.model.names)}")
        refit_alarms = self.alarm(fit, self.rankings(fit), heldout.REFUSED)
        p = verdict.correct_p(refit_alarms.p_deterministic, self.options.looks)
        ok, why = self.passes(fit)
        return bool(ok and p >= heldout.REFUSED), {"p": p} | why

    def passes(self, fit):
        """(held-out chi2 within its band and no held-out rms above the floor?, why); True without held-out groups."""
        if not self.held.size:
            return True, {}
        heldout_result = self.heldout_result({"after": fit})
        exceeded_rows = heldout.exceeded_floors(heldout_result.rows)
        why = {
            "heldout_chi2": heldout_result.chi2.get("after"),
            "heldout_limit": heldout_result.limit,
            "heldout_above_floor": exceeded_rows,
        }
        return not heldout_result.failed and heldout_result.chi2[
            "after"
        ] <= heldout_result.limit and not exceeded_rows, why

    def heldout_result(self, fits):
        """`heldout.HeldoutResult` of {label: Fit}."""
        settings = self.problem.heldout_by, self.options.seed, not self.noise_rejected, self.held_noise
        return heldout.compute_fit_errors(self.problem, self.held, self.predictor, fits, *settings)

    def search(self):
        """`SearchResult` among all laws; where it is not adequate, with what discovery proposes besides."""
        tried = tuple(n for n in (*self.catalogue, *self.library) if n not in self.dropped)
        self.pool = self.rank(self.base.fit, tried)
        work = self.work = Search(self.base.fit, self.table, self.identified.scale, self.adequate, self.progress)
        search_result = work.run(self.pool, self.options.max_laws)
        if not search_result.adequate and self.library:
            self.report_progress("discovering")
            self.selections = discover.discover(self.problem, self.base.fit, self.pool, self.options.seed)
            search_result = work.run(self.pool, self.options.max_laws, discover.proposals(self.selections))
        search_result = self.prune(self.select_supported_set(search_result))
        self.posterior, self.priors = work.posterior(), work.priors
        self.rivals = [] if search_result.adequate else open_rivals(search_result)
        return search_result

    def select_supported_set(self, search_result):
        """Where the best set is not adequate: the set that fitted and held-out data together support most.

        Held-out data have chosen that set, and cannot judge it as data that took no part: see `verdict.with_search`.
        """
        refitted_sets = [n for n, c in self.work.candidates.items() if n and c.refitted]
        if search_result.adequate or not self.held.size or not refitted_sets:
            return search_result
        best = max(refitted_sets, key=lambda n: (self.work.score(n) - self.heldout_chi2(n) / 2, n))
        self.chosen = best != search_result.best
        return search_result._replace(best=best, adequate=self.work.is_adequate(best))

    def prune(self, search_result):
        """Drop laws of the best set that held-out data do not bear out, the worst first.

        Without a law chi2 of the held-out groups must be higher; by PARTIAL where others are beside it, or missing.
        """
        names, pruned = search_result.best, []
        while names and self.held.size:
            less = [tuple(n for n in names if n != law) for law in names]
            chi2 = {n: self.heldout_chi2(n) for n in less}
            worst = min(less, key=chi2.get)
            is_sufficient = len(names) == 1 and self.work.is_adequate(names)
            if chi2[worst] - self.heldout_chi2(names) >= (0.0 if is_sufficient else PARTIAL):
                break
            pruned += [law for law in names if law not in worst]
            names = worst
        if pruned:
            self.notes.append(f"not supported by held-out data: {', '.join(pruned)}")
        adequate = bool(names) and self.work.is_adequate(names)
        best = {"best": names, "adequate": adequate, "dropped": () if names else search_result.best}
        return self.work.result(search_result.pool)._replace(**best)

    def heldout_chi2(self, names):
        """chi2 of the held-out groups with a set of laws; infinite where it cannot be refitted or predicted."""
        if not self.work.refit(names):
            return np.inf
        fit = self.work.candidates[tuple(sorted(names))].fit
        (prediction,) = self.predictor([(fit.point.theta, fit.model.effects(fit.point))], self.held.which)
        return np.inf if isinstance(prediction, Failed) else float(np.sum(self.held.residual(prediction) ** 2))

    def weigh(self):
        """Drop the best set if all data, fitted and held out, give it odds below 1 / alpha against no law at all.

        So often an alarm is false, and has some best set. A set that is not adequate says of itself that it is only a
        part: one that held-out data speak against is none.
        """
        if self.found is None or not self.found.best:
            return
        best, none = (self.found.candidates[names] for names in (self.found.best, ()))
        fitted = best.log_z + log_prior(best.names, self.priors) - none.log_z
        odds, laws_text = self.heldout.log_odds, " + ".join(best.names)
        harmed = heldout.worse(self.heldout)
        if harmed:
            self.notes.append(f"{laws_text} increases the held-out error of {', '.join(harmed)}")
        if harmed or fitted + odds < -np.log(self.options.alpha) or (odds < 0.0 and not self.found.adequate):
            self.notes.append(f"{laws_text}: ln odds {fitted:.1f} from fitted data, {odds:.1f} from held-out data")
            self.found = self.found._replace(best=(), adequate=False, dropped=best.names)
            self.rivals = []
            self.compare_heldout()

    def classify(self):
        """Causes that the data do not tell from an adequate set, that one first; none where such sets say nothing."""
        if self.found is None or not self.found.best or not self.found.adequate or self.chosen:
            return
        if len(self.found.best) > 1:
            self.imitated = self.specific(self.found.best)
        if self.imitated <= verdict.MOST_IMITATED:
            self.report_progress("searching rival causes")
            self.causes, self.untried = find_causes(
                self.work, self.pool, self.found.best, lambda fit: self.passes(fit)[0]
            )
        self.posterior = self.work.posterior()

    def specific(self, best):
        """Share of the laws of the pool that sets as large as `best` imitate: `specificity.imitated_share`."""
        names = [n for n in self.pool.names if n not in self.pool.hidden]
        d = np.sqrt(max(0.0, self.base.fit.cost - self.found.fit(best).cost))
        least = specificity.detection_limit(len(names), verdict.LEVEL)
        return specificity.imitated_share(self.pool, names, len(best), d, least, verdict.MINOR)

    def run(self):
        """`Result`."""
        return self.decide() or self.conclude()

    def decide(self):
        """Calibrate, alarm, search, judge. A `Result` where nothing of it can be done, None else."""
        problem, options = self.problem, self.options
        common_fields = {"hashes": dict(problem.hashes), "options": asdict(options), "notes": self.notes}
        if problem.firmware:
            return Result(problem.name, "firmware", str(problem.firmware), **common_fields)
        if not self.calibrate():
            sentence = f"the model cannot be calibrated: {self.base.fit.failed}"
            common_fields["certificates"] = {"calibration": self.base.certificate}
            return Result(problem.name, "unexplained", sentence, **common_fields)
        alarm = self.detect()
        self.found, self.posterior = None, ([()], [1.0])
        self.decision = verdict.decide_before_search(alarm, self.alarms, self.noise, self.p)
        if self.decision is None:
            self.found = self.search()
        self.compare_heldout()
        self.decision = verdict.with_heldout(self.decision, self.heldout, self.alpha, options.looks)
        self.weigh()
        return None

    def detect(self):
        """True for a deterministic misfit; `alarms`, `ranked` and `p` say why.

        Laws that cost runs wait for an alarm without them that is in DOUBT; one with them takes its place.
        """
        self.report_progress("ranking laws")
        self.ranked = self.rankings(self.base.fit)
        self.report_progress("alarms")
        self.alarms = self.alarm(self.base.fit, self.ranked, self.alpha)
        if self.waiting and self.alarms.p_deterministic < max(DOUBT, self.alpha):
            self.report_progress("ranking laws beyond the catalogue")
            self.waiting = ()
            self.ranked = self.rankings(self.base.fit)
            self.alarms = self.alarm(self.base.fit, self.ranked, self.alpha)
        self.p = verdict.correct_p(self.alarms.p_deterministic, self.options.looks)
        self.notes += verdict.nuisance_notes(self.base.fit) if self.p < self.alpha else []
        return self.p < self.alpha

    def conclude(self):
        """`Result` of what has been decided, with what the reader needs besides."""
        self.classify()
        self.plan()
        return outcome.build_result(self, self.decision)

    def plan(self):
        """Power of this record, and what to measure next."""
        options, fit = self.options, self.base.fit
        self.power, self.experiments = {}, []
        if options.power:
            self.report_progress("power")
            level = 1 - (1 - self.alpha) ** (1 / options.looks)
            power = Power(fit, self.alarms, self.space_noise(), self.ranked, self.laws, level, options.seed)
            smallest = power.smallest()
            self.power = {"d90": smallest, "null": power.null_rate(), "check": power.detection_rate(smallest)}
        if options.experiments and self.causes:
            self.report_progress("next experiment")
            rivals = [c.fit for c in self.causes]
            if len(rivals) < 2:
                names = (n for n in self.posterior[0] if n and not set(self.found.best) <= set(n))
                rivals += [c.fit for n in names if (c := self.found.candidates[n]).refitted] or [self.base.fit]
            laws = sorted({name for cause in self.causes for name in cause.names})
            offered = self.problem.experiments(laws) if len(self.causes) > 1 else None
            rival_count = outcome.rival_count(self)
            self.experiments = next_experiment.table(rivals, self.problem, offered, rival_count, self.store)

    def final_estimate(self):
        """(theta, {law: coefficient}) that the trace has come to."""
        fit = self.fits["after"]
        return fit.point.theta, fit.model.effects(fit.point)

    def compare_heldout(self):
        """Held-out error of the calibrated model, of the best law alone, and of the best set."""
        fits = {"before": self.base.fit}
        best = self.found.best if self.found else ()
        singles = [c for n, c in self.found.candidates.items() if len(n) == 1 and c.refitted] if self.found else []
        one = max(singles, key=lambda c: c.log_z).fit if singles else self.base.fit
        fits["after_one_law"] = self.found.fit(best) if len(best) == 1 else one if best else self.base.fit
        fits["after"] = self.found.fit(best) if best else self.base.fit
        self.fits = fits
        if self.held.size:
            self.heldout = self.heldout_result(fits)
        else:
            self.heldout = heldout.HeldoutResult({}, {}, float("inf"), failed="no segment with the role validate")


def trace(problem, options=None, progress=None, checkpoint=None):
    """`Result` of a `Problem`.

    progress    function(text, done, total), or None
    checkpoint  folder in which finished work is kept, so that a killed trace goes on; or None
    Raises ConfigError for a problem that contradicts itself, FileError if the folder cannot be written.
    """
    return Tracer(problem, options or Options(), progress, checkpoint).run()
