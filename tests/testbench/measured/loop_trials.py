"""Random trials of tracing on records of our own loop: something hidden, or nothing; what does the verdict say?

    none      the calibrated model is the truth
    one two   effects of the catalogue                      in    a law of the grammar, CLEAR_D and more of it beside
                                                                  each other law
    out       outside every grammar: something that jumps in time
    flicker   nothing, but flicker noise three times the declared one

Sizes are drawn log-uniform in d, sigmas that are left after the nuisances have taken their part. Truth is the exact
engine (lanes) with parameters drawn from the priors and noise of its own, every repeat from power-on; the analysis
knows neither, and its tangents are those of the averaged plant.

Source    docs/measured.md
"""

import time

import numpy as np

from testbench import config as configuration
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_laws, loop_noise, loop_problem, loop_runs, loop_trace
from testbench.measured.closed_loop.loop_runs import EXACT, FAST, Model, Run
from testbench.measured.record.recording_plan import Condition
from testbench.measured.residual.parameters import Parameter
from testbench.tracing.problem.result import plain_value
from testbench.tracing.problem.space import Space
from testbench.tracing.trace import Options

REPEATS = {"fit": 2, "validate": 4}  # power-ons differ by their frequency: an rms of few of them scatters
KINDS = ("none", "flicker", "one", "two", "in", "out")
SHARES = (0.2, 0.1, 0.35, 0.15, 0.1, 0.1)
FLICKER = 3.0
SMALL = 3  # members of a class that is right
PLAUSIBLE = 5.0  # scales of a law, which is the sd of its prior
CLEAR_D = 8.0
TRUE_SEED = 5 * 10**12
REDRAWS, REDRAWN = 5, 10**6  # boards drawn in place of one that loses its lock, and how far on their seeds are

# chosen of forty random ones so that laws of the catalogue are least alike (largest mean of sin, capped at 0.6): three
# of them detuned and at three temperatures, since nothing else tells drive from damping laws
QUICK = tuple(
    Condition(name, a, rate, before, temp, detune, settle_s=loop_runs.SETTLE_S, seconds=0.6, role=role)
    for name, a, rate, before, temp, detune, role in (
        ("late", 4.0, -150.0, -150.0, 25.0, -15.0, "fit"),
        ("large", 7.0, 180.0, -60.0, 50.0, 0.0, "fit"),
        ("cold", 5.5, 0.0, 60.0, -20.0, 15.0, "fit"),
        ("hot", 4.0, -60.0, 150.0, 65.0, -30.0, "fit"),
        ("held", 5.0, 100.0, -100.0, 0.0, 10.0, "validate"),
        ("other", 6.2, -80.0, 30.0, 45.0, -10.0, "validate"),
    )
)
# key, unit, mean, sd of the prior: a board that has been calibrated before
PRIORS = (
    ("plant.fx_hz", "Hz", 11002.3, 1e-5),
    ("plant.fy_hz", "Hz", 10863.3, 1e-3),
    ("plant.qx", "1", 2e5, 4.0),
    ("plant.qy", "1", 2e5, 100.0),
    ("plant.kxy_n_per_m", "N/m", 0.0561, 1e-6),
    ("plant.dxy_ratio", "1", 0.03, 2e-5),
    ("plant.k_vf_sense_n_per_v", "N/V", 2.72e-7, 5e-13),
    ("plant.dcdx_f_per_m", "F/m", 1e-7, 2e-13),
    ("plant.sense_pole_1_s", "s", 68e-9, 5e-11),
    ("plant.drive_pole_1_s", "s", 100e-9, 5e-11),
)


def nuisances(priors=PRIORS):
    """`Parameter`s of the trials."""
    return tuple(Parameter(key, unit, mean, sd, False, 0.0, 1e12) for key, unit, mean, sd in priors)


def told(kind, seed, truth, result, seconds):
    """A trial in plain numbers: what was hidden, what the verdict says of it."""
    names, verdict = {name for name, _, _ in truth}, result.verdict
    holds = [_is(cause["effects"], names) for cause in result.causes]
    right = any(holds) and len(holds) <= SMALL
    if kind in ("none", "flicker"):
        right = not result.effects and verdict in ("none", "noise-model")[: 1 + (kind == "flicker")]
    elif kind == "out":
        right = verdict == "unexplained"
    out = {"kind": kind, "seed": seed, "truth": [list(row) for row in truth], "verdict": verdict, "right": right}
    out |= {"class": [row["laws"] for row in result.causes], "false_name": bool(holds) and not any(holds)}
    out["found"] = [[row["law"], row["value"], row["sd"], row["d"]] for row in result.effects]
    out |= {"detected": verdict in ("named", "confounded", "unexplained"), "p_global": result.p_global}
    out["heldout"] = {
        key: [row["floor"], row["before"], row["after"], *row["after_ci"], row["expected"]]
        for key, row in result.heldout.items()
    }
    out["heldout_chi2"], out["sentence"] = result.heldout_chi2, result.sentence
    out["numerical"] = result.certificates.get("numerical", {}).get("sigma")
    out["seconds"] = round(seconds, 1)
    return plain_value(out)


def _is(effects, names):
    """True if the laws of a cause, each with its other names, are those of `names`."""
    said = [{e["law"], *e["same_as"]} for e in effects]
    return len(said) == len(names) and all(any(name in s for s in said) for name in names)


class Bank:
    """Conditions, engines and tangents that all trials share.

    only  names of the laws of catalogue and grammar that are tried; None: all
    """

    def __init__(self, conditions, threads=loop_runs.THREADS, priors=PRIORS, only=None):
        self.conditions, self.repeats, self.priors = conditions, REPEATS, priors
        self.bench, self.kept = loop_runs.Bench(threads), loop_problem.LoopCache()
        self.model = configuration.Config()
        self.catalogue, self.library = (
            tuple(c for c in laws if only is None or c.law.name in only)
            for laws in (loop_laws.from_catalogue(), loop_laws.from_grammar())
        )

    def problem(self, name, values, hashes=None, densities=None):
        """`LoopProblem` of measured features."""
        data = loop_problem.Measured(name, self.conditions, values, hashes or {}, densities or {})
        wanted = nuisances(self.priors)
        return loop_problem.LoopProblem(data, self.model, wanted, self.catalogue, self.library, self.bench, self.kept)

    def blank(self):
        """A problem whose data are all zero: for its tangents."""
        values = {}
        for c in self.conditions:
            fine = len(loop_runs.NAMES) * (len(loop_runs.fine_bins(c)) - 1)
            values[c.id] = np.zeros((self.repeats[c.role], loop_runs.feature_count(c) + fine))
        return self.problem("blank", values)


class Left:
    """What the nuisances leave of a change of the fitted conditions' features, in sigmas, priors counted."""

    def __init__(self, problem):
        self.problem, self.space = problem, Space(problem, "fit")
        sd = np.array([n.prior_sd for n in problem.nuisances])
        j = np.concatenate([self._stacked(problem.tangent), np.diag(1.0 / sd)])
        self.q, _ = np.linalg.qr(j / np.linalg.norm(j, axis=0))
        self.tail = np.zeros(len(sd))

    def _stacked(self, change):
        groups = zip(self.space.groups, self.space.weights)
        return np.concatenate([w * self.space.whiten_rows(g.members[0], change[g.name]) for g, w in groups])

    def rest(self, change):
        """{condition: change} less what the nuisances take, whitened, with the priors' rows."""
        s = np.concatenate([self._stacked(change), self.tail])
        return s - self.q @ (self.q.T @ s)

    def __call__(self, change):
        """d of {condition: change}."""
        return float(np.linalg.norm(self.rest(change)))


def lengths(problem, names):
    """{law: d of a coefficient of 1}; 0 where the plant fails."""
    left, columns = Left(problem), {name: problem.column(name) for name in names}
    return {name: left(c) if all(np.isfinite(v).all() for v in c.values()) else 0.0 for name, c in columns.items()}


def apart(problem, library, catalogue):
    """{law of the library: part of its d that the other law which is most like it does not explain}."""
    left = Left(problem)

    def unit(name):
        v = left.rest(problem.column(name))
        return v / max(np.linalg.norm(v), 1e-300)

    every = {law.name: unit(law.name) for law in (*catalogue, *library)}
    alike = {law.name: max(abs(every[law.name] @ v) for n, v in every.items() if n != law.name) for law in library}
    return {name: float(np.sqrt(max(0.0, 1 - c**2))) for name, c in alike.items()}


def jumped(bank, problem, text, scale):
    """d of a coefficient of `scale` of a law outside every grammar, by the averaged plant."""
    models = Model(bank.model), Model(bank.model, (text.format(scale),))
    runs = [Run(m, c, 1, bank.model) for m in models for c in bank.conditions]
    found = np.array(bank.bench.run(runs, FAST, fine=True), object)
    before, after = found[: len(bank.conditions)], found[len(bank.conditions) :]
    return Left(problem)({c.id: y - x for c, x, y in zip(bank.conditions, before, after)})


def largest(problem, law):
    """Largest coefficient that a trial hides: within the limits of key and physics, plausible by the law's scale."""
    return min(problem.tangents.largest(law.name), PLAUSIBLE * law.scale)


def drawn(bank, problem, kind, seed, d_range=(8.0, 60.0)):
    """(theta, laws, texts, truth) of a trial."""
    rng = np.random.default_rng([7, seed])
    theta = np.array([n.value + n.prior_sd * rng.normal() for n in problem.nuisances])
    effects, texts, truth = {}, (), []
    if kind in ("one", "two", "in"):
        pool = [c.law for c in (bank.library if kind == "in" else bank.catalogue)]
        size = lengths(problem, [law.name for law in pool])
        most = {law.name: size[law.name] * largest(problem, law) for law in pool}
        pool = [law for law in pool if most[law.name] > d_range[0]]
        least = dict.fromkeys(size, d_range[0])
        if kind == "in":
            # nearer to another law, nothing could tell the two apart
            sines = apart(problem, pool, [c.law for c in bank.catalogue])
            least = {name: d_range[0] / max(s, 1e-9) for name, s in sines.items()}
            pool = [law for law in pool if least[law.name] < min(d_range[1], most[law.name])]
        for k in rng.choice(len(pool), 2 if kind == "two" else 1, replace=False):
            law = pool[k]
            d = float(np.exp(rng.uniform(np.log(least[law.name]), np.log(min(d_range[1], most[law.name])))))
            value = float(d / size[law.name] * (law.sign or rng.choice([-1, 1])))
            effects[law.name] = value
            truth.append((law.name, value, d))
    if kind == "out":
        at = loop_runs.START_TICKS / 1e6 + loop_runs.SETTLE_S + 0.2 + 0.3 * rng.random()
        text = (
            f"force_x = {{}} step({at:.3f}) x",
            f"force_x = {{}} step({at:.3f}) vx",
            f"force_y = {{}} step({at:.3f}) vx",
        )
        which = int(rng.integers(3))
        d, scale = float(np.exp(rng.uniform(*np.log(d_range)))), (1e-5, 3e-11, 3e-10)[which]
        value = scale * d / jumped(bank, problem, text[which], scale)
        texts = (text[which].format(value),)
        truth.append((texts[0], value, d))
    return theta, effects, texts, tuple(truth)


def recorded(bank, problem, kind, seed, theta, effects, texts):
    """{condition: features of its repeats}, and densities, in the exact engine; ConfigError without a lock."""
    board = problem.model_at(theta, effects)
    if kind == "flicker":
        level = "plant.sid_flicker_v_per_rthz"
        louder = {level: FLICKER * bank.model.plant.sid_flicker_v_per_rthz}
        board = board._replace(config=configuration.changed(board.config, louder))
    board = Model(board.config, (*board.laws, *texts))
    rng = np.random.default_rng([8, seed])

    def powered(c, number):
        """A power-on, with a frequency and a phase of its own."""
        own = problem.shift_drive_mode(board, loop_noise.JITTER_HZ * rng.normal())
        return Run(
            own, c, TRUE_SEED + 10_000 * seed + number, delay_frames=int(rng.integers(loop_runs.MOST_DELAY_FRAMES))
        )

    runs = [powered(c, 100 * i + r) for i, c in enumerate(bank.conditions) for r in range(bank.repeats[c.role])]
    rows = iter(bank.bench.run(runs, EXACT, take=loop_runs.with_densities))
    both = {c.id: [next(rows) for _ in range(bank.repeats[c.role])] for c in bank.conditions}
    return {g: np.array([v for v, _ in some]) for g, some in both.items()}, {
        g: [d for _, d in s] for g, s in both.items()
    }


def trial(bank, problem, kind, seed, options=None, d_range=(CLEAR_D, 60.0)):
    """(`told` of a trial of a kind, its Result); `problem` is `bank.blank()`."""
    begun = time.perf_counter()
    for again in range(REDRAWS):
        theta, effects, texts, truth = drawn(bank, problem, kind, seed + again * REDRAWN, d_range)
        try:
            values, seen = recorded(bank, problem, kind, seed, theta, effects, texts)
            break
        except ConfigError:
            # a board that loses its lock gives no record
            if again == REDRAWS - 1:
                raise
    asked = bank.problem(f"trial {seed}", values, {"trial": str(seed)}, seen)
    _, result = loop_trace.run(asked, options or Options(seed=seed, power=False, experiments=False))
    return told(kind, seed, truth, result, time.perf_counter() - begun), result


def kinds(count, seed=0):
    """Kinds of `count` trials by their shares."""
    return [str(k) for k in np.random.default_rng([11, seed]).choice(KINDS, count, p=SHARES)]
