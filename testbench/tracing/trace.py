"""The whole trace: calibrate, alarm, rank, refit, judge on held-out groups, say what may be said.

trace(problem) -> Result       steps and equations: docs/tracing.md
"""

from dataclasses import asdict, dataclass

import numpy as np

from testbench.tracing import next_experiment, outcome, verdict
from testbench.tracing.fit import calibrate as calibration
from testbench.tracing.fit import discover, heldout, identify
from testbench.tracing.fit.equivalents import exchanges
from testbench.tracing.fit.evidence import log_prior
from testbench.tracing.fit.rank import Signatures, rank
from testbench.tracing.fit.rivals import open_rivals
from testbench.tracing.fit.search import Search
from testbench.tracing.noise import noise
from testbench.tracing.noise.alarms import alarms
from testbench.tracing.noise.power import Power
from testbench.tracing.problem.checkpoint import Store
from testbench.tracing.problem.model import Model
from testbench.tracing.problem.predictor import Predictor
from testbench.tracing.problem.problem import all_laws, check
from testbench.tracing.problem.result import Result
from testbench.tracing.problem.space import Space

SAME = 0.9995  # cosine from which a law of the library is one of the catalogue
ROWS_OF_DRAWS = 60_000_000  # numbers drawn for one alarm at most
FEWEST_DRAWS = 199


@dataclass(frozen=True)
class Options:
    """Thresholds and effort. looks: how many traces like this one the caller makes; it widens every p."""

    alpha: float = 0.01
    looks: int = 1
    n_null: int = 999
    seed: int = 0
    max_laws: int = 3
    starts: int = 2
    grammar: bool = True  # laws of the library count among the looks, and may explain what the catalogue cannot
    alike: bool = True  # say which laws of the library would do as well as those that are named
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
        # laws of the library that cost a run each wait until the catalogue has failed
        self.waiting = self.library if problem.library_late else ()
        self.draws = max(FEWEST_DRAWS, min(options.n_null, ROWS_OF_DRAWS // max(self.space.size, 1)))
        self.notes, self.selections, self.rivals, self.alike = list(problem.warnings), [], [], []

    def say(self, text, done=0, total=1):
        self.predictor.text = text
        if self.progress:
            self.progress(text, done, total)

    def calibrate(self):
        """Fit without laws; with the noise of the repeats if the declared one is not it."""
        self.say("calibrating")
        self.base = calibration.calibrate(
            Model(self.space, self.predictor), self.options.starts, self.options.seed, progress=self.progress
        )
        if self.base.fit.failed:
            return False
        rng = np.random.default_rng([self.options.seed, 4])
        self.noise = noise.study(self.space, rng, self.options.alpha, judge=not self.problem.noise_from_repeats)
        if self.noise.p < self.options.alpha:
            self.notes.append("declared noise contradicted by the repeats: variances refined by observable and octave")
            self.space = Space(self.problem, "fit", self.noise)
            self.held = Space(self.problem, "validate", self.noise)
            again = Model(self.space, self.predictor)
            self.base = calibration.calibrate(again, self.options.starts, self.options.seed, self.base.fit.point)
        self.identified = identify.identify(self.base.fit)
        self.table = Signatures(self.base.fit)
        return not self.base.fit.failed

    def rank(self, fit, names):
        """`Ranking` of laws that are not in a fit."""
        return rank(fit, names, self.table.at(fit, names))

    def rankings(self, fit):
        """{"catalogue": .., "library": ..} of the laws that are not in a fit."""
        out = {}
        for label, names in (("catalogue", self.catalogue), ("library", self.library)):
            known = (*fit.model.names, *self.dropped, *self.waiting)
            names = tuple(n for n in names if n not in known)
            if names:
                out[label] = self.rank(fit, names)
        return out

    def alarm(self, fit, rankings):
        """Alarms at a fit. In a refined space the declared noise is the refined one, the octaves' uncertainty stays."""
        return alarms(self.store, fit, rankings, self.known_noise(), self.draws, self.options.seed)

    def known_noise(self):
        """Octaves in units of the space in use."""
        if self.noise.p < self.options.alpha:
            return self.noise._replace(octaves=tuple(o._replace(f=1.0) for o in self.noise.octaves))
        return self.noise

    def drop_twins(self):
        """Laws of the library that are laws of the catalogue on these data."""
        self.dropped = {}
        if not (self.library and self.catalogue) or self.waiting:
            return
        whole = self.rank(self.base.fit, (*self.catalogue, *self.library))
        c = np.abs(whole.cosines)
        for name in self.library:
            for twin in self.catalogue:
                if name in whole.names and twin in whole.names and c[whole.index(name), whole.index(twin)] > SAME:
                    self.dropped.setdefault(name, twin)

    def adequate(self, fit):
        """Alarms again with the effects added; held-out chi2 within its band, held-out rms at the floor."""
        self.say(f"checking {' + '.join(fit.model.names)}")
        found = self.alarm(fit, self.rankings(fit))
        p = verdict.correct_p(found.p_deterministic, self.options.looks)
        why = {"p": p}
        ok = p >= self.options.alpha
        if self.held.size:
            judged = self.judged({"after": fit})
            above = heldout.above_floor(judged.rows)
            why |= {"heldout_chi2": judged.chi2.get("after"), "heldout_limit": judged.limit}
            why["heldout_above_floor"] = above
            ok = ok and not judged.failed and judged.chi2["after"] <= judged.limit and not above
        return bool(ok), why

    def judged(self, fits):
        """`heldout.HeldOut` of {label: Fit}."""
        by, seed, declared = self.problem.heldout_by, self.options.seed, not self.noise.p < self.options.alpha
        return heldout.judge(self.problem, self.held, self.predictor, fits, by, seed, declared)

    def open(self):
        """Laws that may explain something now."""
        return tuple(n for n in (*self.catalogue, *self.library) if n not in self.dropped and n not in self.waiting)

    def search(self):
        """Explain by the catalogue; where that is not adequate, by catalogue and grammar."""
        library = ()
        ranking = self.rank(self.base.fit, self.open())
        work = Search(self.base.fit, self.table, self.identified.scale, self.adequate, self.progress)
        if not work.run(ranking, self.catalogue, library, 1).adequate and self.library:
            if self.waiting:
                self.say("laws beyond the catalogue")
                self.waiting = ()
                self.drop_twins()
                self.ranked = self.rankings(self.base.fit)
            library = tuple(name for name in self.open() if name in self.library)
            ranking = self.rank(self.base.fit, (*self.catalogue, *library))
        if library:
            self.say("discovering")
            self.selections = discover.discover(self.problem, self.base.fit, ranking, self.options.seed)
            pool = (*self.catalogue, *library)
            work.propose(discover.proposals(self.selections), pool, self.options.max_laws)
        found = work.run(ranking, self.catalogue, library, self.options.max_laws)
        self.posterior, self.priors = work.posterior(), work.priors
        self.rivals = [] if found.adequate else open_rivals(found)
        return found

    def weigh(self):
        """Drop the best set if all data, fitted and held out, give it odds below 1 / alpha against no law at all.

        So often an alarm is false, and has some best set. A set that is not adequate says of itself that it is only a
        part: one that held-out data speak against is none.
        """
        if self.found is None or not self.found.best:
            return
        best, none = (self.found.candidates[names] for names in (self.found.best, ()))
        fitted = best.log_z + log_prior(best.names, self.priors) - none.log_z
        held = self.heldout.log_odds
        if fitted + held < -np.log(self.options.alpha) or (held < 0.0 and not self.found.adequate):
            said = " + ".join(best.names)
            self.notes.append(f"{said}: ln odds {fitted:.1f} where fitted, {held:.1f} where held out")
            self.found = self.found._replace(best=(), adequate=False, dropped=best.names)
            self.rivals = []
            self.judge()

    def compare(self):
        """Laws of the library that would do as well as those of an adequate set."""
        if self.options.alike and self.library and self.found is not None and self.found.adequate:
            self.say("laws that would do as well")
            best = self.found.best
            like = self.problem.like(best)
            others = tuple(n for n in self.library if n in like and n not in best)
            ranking = self.rank(self.base.fit, (*best, *others))
            self.alike = exchanges(ranking, best, others, self.laws)

    def run(self):
        """`Result`."""
        return self.decide() or self.conclude()

    def decide(self):
        """Calibrate, alarm, search, judge. A `Result` where nothing of it can be done, None else."""
        problem, options = self.problem, self.options
        known = {"hashes": dict(problem.hashes), "options": asdict(options), "notes": self.notes}
        if problem.firmware:
            return Result(problem.name, "firmware", str(problem.firmware), **known)
        if not self.calibrate():
            said = f"the model cannot be calibrated: {self.base.fit.failed}"
            known["certificates"] = {"calibration": self.base.certificate}
            return Result(problem.name, "unexplained", said, **known)
        self.say("ranking laws")
        self.drop_twins()
        self.first = self.ranked = self.rankings(self.base.fit)
        self.say("alarms")
        self.alarms = self.alarm(self.base.fit, self.first)
        alarm, self.p = verdict.detection(self.alarms, options.alpha, options.looks)
        self.found, self.posterior = None, ([()], [1.0])
        self.decision = verdict.without_tracing(alarm, self.alarms, self.noise, options.alpha, self.p)
        if self.decision is None:
            self.found = self.search()
        self.judge()
        self.weigh()
        return None

    def conclude(self):
        """`Result` of what has been decided, with what the reader needs besides."""
        self.compare()
        self.plan()
        return outcome.result(self, self.decision)

    def plan(self):
        """Power of this record, and what to measure next."""
        options, fit = self.options, self.base.fit
        self.power, self.experiments = {}, []
        if options.power:
            self.say("power")
            level = 1 - (1 - options.alpha) ** (1 / options.looks)
            power = Power(fit, self.alarms, self.known_noise(), self.first, self.laws, level, options.seed)
            smallest = power.smallest()
            self.power = {"d90": smallest, "null": power.null_rate(), "check": power.checked(smallest)}
        if options.experiments and self.found is not None:
            self.say("next experiment")
            names, _ = self.posterior
            known = [self.found.candidates[n] for n in names if n]
            rivals = [
                c.fit for c in known if c.refitted and not (self.found.best and set(self.found.best) < set(c.names))
            ]
            if len(rivals) > 1:
                offered, count = self.problem.experiments, outcome.rivals_kept(self)
                self.experiments = next_experiment.table(rivals, self.problem, offered, count, self.store)

    def arrived(self):
        """(theta, {law: coefficient}) that the trace has come to."""
        fit = self.fits["after"]
        return fit.point.theta, fit.model.effects(fit.point)

    def judge(self):
        """Held-out error of the calibrated model, of the best law alone, and of the best set."""
        fits = {"before": self.base.fit}
        best = self.found.best if self.found else ()
        singles = [c for n, c in self.found.candidates.items() if len(n) == 1 and c.refitted] if self.found else []
        one = max(singles, key=lambda c: c.log_z).fit if singles else self.base.fit
        fits["after_one_law"] = self.found.fit(best) if len(best) == 1 else one if best else self.base.fit
        fits["after"] = self.found.fit(best) if best else self.base.fit
        self.fits = fits
        if self.held.size:
            self.heldout = self.judged(fits)
        else:
            self.heldout = heldout.HeldOut({}, {}, float("inf"), failed="no segment with the role validate")


def trace(problem, options=None, progress=None, checkpoint=None):
    """`Result` of a `Problem`.

    progress    function(text, done, total), or None
    checkpoint  folder in which finished work is kept, so that a killed trace goes on; or None
    Raises ConfigError for a problem that contradicts itself, FileError if the folder cannot be written.
    """
    return Tracer(problem, options or Options(), progress, checkpoint).run()
