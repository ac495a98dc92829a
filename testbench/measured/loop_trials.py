"""Random trials of tracing on records of our own loop: something hidden, or nothing; what does the verdict say?

    none      the calibrated model is the truth
    one two   effects of the catalogue                      in    a law of the grammar beyond the catalogue
    out       outside every grammar: something that jumps or creeps in time
    firmware  a changed rounding in the board's firmware: found by replay, never by tracing

Sizes are drawn log-uniform in d, sigmas that are left after the nuisances have taken their part. Truth is the exact
engine with parameters drawn from the priors and noise of its own; the analysis knows neither.
Source    docs/measured.md
"""

from typing import NamedTuple

import numpy as np

from testbench import config as configuration
from testbench.measured import loop_laws, loop_problem, loop_runs, loop_trace
from testbench.measured.loop_runs import EXACT, Model, Run
from testbench.measured.parameters import Parameter
from testbench.measured.plan import Condition
from testbench.tracing.trace import Options

KINDS = ("none", "one", "two", "in", "out")
SHARES = (0.25, 0.35, 0.15, 0.15, 0.10)
TRUE_SEED = 5 * 10**12

QUICK = tuple(
    Condition(name, a, rate, before, temp, settle_s=0.25, seconds=0.6, role=role)
    for name, a, rate, before, temp, role in (
        ("nominal", 5.0, 50.0, 0.0, 25.0, "fit"),
        ("small", 3.0, -50.0, 50.0, 25.0, "fit"),
        ("large", 6.5, 0.0, -100.0, 25.0, "fit"),
        ("warm", 4.0, 90.0, -90.0, 45.0, "fit"),
        ("held", 5.7, -80.0, 30.0, 45.0, "validate"),
    )
)
FULL = tuple(
    Condition(name, a, rate, before, temp, settle_s=0.5, seconds=4.0, role=role)
    for name, a, rate, before, temp, role in (
        ("nominal", 5.0, 50.0, 0.0, 25.0, "fit"),
        ("small", 3.0, -50.0, 50.0, 25.0, "fit"),
        ("large", 6.5, 0.0, -100.0, 25.0, "fit"),
        ("warm", 4.0, 90.0, -90.0, 45.0, "fit"),
        ("held", 5.7, -80.0, 30.0, 32.0, "validate"),
        ("cold", 4.5, 20.0, 70.0, 5.0, "validate"),
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


def nuisances():
    """`Parameter`s of the trials."""
    return tuple(Parameter(key, unit, mean, sd, False, 0.0, 1e12) for key, unit, mean, sd in PRIORS)


class Trial(NamedTuple):
    """What was hidden, and what the verdict says of it."""

    kind: str
    seed: int
    truth: tuple  # ((name or law text, coefficient, d), ...)
    result: object

    @property
    def right(self):
        """The verdict is the one that MEASURED.md wants for this kind."""
        names = {name for name, _, _ in self.truth}
        found = {row["law"] for row in self.result.effects}
        verdict = self.result.verdict
        if self.kind == "none":
            return verdict == "none"
        if self.kind == "out":
            return verdict in ("unexplained", "confounded")
        listed = [found, *(set(row["laws"]) for row in self.result.confounded)]
        return (verdict == "named" and found == names) or (verdict == "confounded" and any(names <= s for s in listed))

    @property
    def found(self):
        """The effects that explain most are those that were hidden, whatever else the verdict says."""
        return {row["law"] for row in self.result.effects} == {name for name, _, _ in self.truth}

    @property
    def false_name(self):
        """A named effect that is not there."""
        names = {name for name, _, _ in self.truth}
        return self.result.verdict == "named" and not {row["law"] for row in self.result.effects} <= names


class Bank:
    """Conditions, engines and tangents that all trials share."""

    def __init__(self, conditions, repeats=2, threads=loop_runs.THREADS, library=True, progress=None):
        self.conditions, self.repeats = conditions, repeats
        self.bench, self.kept = loop_runs.Bench(threads), loop_problem.Kept()
        self.model = configuration.Config()
        self.catalogue = loop_laws.from_catalogue()
        self.library = loop_laws.from_grammar() if library else ()
        self.progress = progress

    def problem(self, name, values, hashes=None):
        """`LoopProblem` of measured features."""
        data = loop_problem.Measured(name, self.conditions, values, hashes or {})
        return loop_problem.LoopProblem(
            data, self.model, nuisances(), self.catalogue, self.library, self.bench, self.kept, self.progress
        )

    def blank(self):
        """A problem whose data are all zero: for its tangents."""
        shape = {c.id: loop_runs.NAMES for c in self.conditions}
        sizes = {c: len(shape[c]) for c in shape}
        values = {c.id: np.zeros((self.repeats, sizes[c.id] * (len(loop_runs.bins(c)) - 1))) for c in self.conditions}
        return self.problem("blank", values)


def lengths(problem):
    """{law: d of a coefficient of 1}: what the nuisances leave of each law on the fitted conditions, priors counted."""
    z, laws = [], {name: [] for name in problem.candidates}
    for c in problem.measured_.conditions:
        if c.role == "fit":
            k, root = problem._rows[c.id], np.sqrt(len(problem.measured_.values[c.id]))
            z.append(root * problem.whiten(k, problem.tangent[c.id]))
            for name in laws:
                laws[name].append(root * problem.whiten(k, problem.column[c.id][name]))
    j = np.concatenate(z)
    sd = np.array([n.prior_sd for n in problem.nuisances])
    j = np.concatenate([j, np.diag(1.0 / sd)])
    q, _ = np.linalg.qr(j / np.linalg.norm(j, axis=0))
    out = {}
    for name, parts in laws.items():
        s = np.concatenate([*parts, np.zeros(len(sd))])
        out[name] = float(np.linalg.norm(s - q @ (q.T @ s)))
    return out


def drawn(bank, problem, kind, seed, d_range=(8.0, 60.0)):
    """(theta, laws, texts, truth) of a trial."""
    rng = np.random.default_rng([7, seed])
    theta = np.array([n.value + n.prior_sd * rng.normal() for n in problem.nuisances])
    size = lengths(problem)
    effects, texts, truth = {}, (), []
    pool = [c for c in (bank.library if kind == "in" else bank.catalogue) if np.isfinite(size[c.law.name])]
    pool = [c for c in pool if size[c.law.name] * c.law.scale > 1e-3]
    if kind in ("one", "two", "in"):
        for k in rng.choice(len(pool), 2 if kind == "two" else 1, replace=False):
            law = pool[k].law
            d = float(np.exp(rng.uniform(*np.log(d_range))))
            value = d / size[law.name] * (law.sign or rng.choice([-1, 1]))
            effects[law.name] = value
            truth.append((law.name, value, d))
    if kind == "out":
        at = loop_runs.START_TICKS / 1e6 + 0.5 + 0.4 * rng.random()
        text = (
            f"force_x = {{}} step({at:.3f}) x",
            f"force_x = {{}} step({at:.3f}) vx",
            f"force_y = {{}} step({at:.3f}) vx",
        )
        which = int(rng.integers(3))
        scale = (1e-7, 3e-11, 3e-10)[which] * float(np.exp(rng.uniform(0.0, 2.0)))
        texts = (text[which].format(scale),)
        truth.append((texts[0], scale, np.nan))
    return theta, effects, texts, tuple(truth)


def trial(bank, problem, kind, seed, options=None, d_range=(8.0, 60.0)):
    """`Trial` of a kind; `problem` is `bank.blank()`."""
    theta, effects, texts, truth = drawn(bank, problem, kind, seed, d_range)
    told = problem.told(theta, effects)
    told = Model(told.config, (*told.laws, *texts))
    rng = np.random.default_rng([8, seed])

    def powered():
        """The board of one power-on, whose frequency no power-on before has had."""
        k_n_per_m = problem.per_hz * loop_problem.JITTER_HZ * rng.normal()
        return Model(told.config, (*told.laws, f"force_x = {-k_n_per_m!r} x"))

    runs = [
        Run(powered(), c, TRUE_SEED + 10_000 * seed + 100 * i + r)
        for i, c in enumerate(bank.conditions)
        for r in range(bank.repeats)
    ]
    found = bank.bench.run(runs, bank.model, EXACT)
    values = {c.id: np.array(found[bank.repeats * i : bank.repeats * (i + 1)]) for i, c in enumerate(bank.conditions)}
    asked = bank.problem(f"trial {seed}", values, {"trial": str(seed)})
    _, result = loop_trace.run(asked, options or Options(seed=seed, power=False, experiments=False))
    return Trial(kind, seed, truth, result)


def kinds(count, seed=0):
    """Kinds of `count` trials by their shares."""
    return [str(k) for k in np.random.default_rng([11, seed]).choice(KINDS, count, p=SHARES)]


def table(trials):
    """Markdown: right verdicts and false names per kind, with 95 % Clopper-Pearson intervals."""
    from scipy.stats import beta

    lines = ["| hidden | trials | right verdict [95 %] | effects found | named, not there | certificate holds |"]
    lines.append("|---|---:|---|---:|---:|---:|")
    for kind in KINDS:
        some = [t for t in trials if t.kind == kind]
        if some:
            n, k = len(some), sum(t.right for t in some)
            lo = beta.ppf(0.025, k, n - k + 1) if k else 0.0
            hi = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
            found, held = (
                sum(t.found for t in some),
                sum(bool(t.result.certificates.get("numerical", {}).get("holds")) for t in some),
            )
            false = sum(t.false_name for t in some)
            lines.append(f"| {kind} | {n} | {k} = {k / n:.0%} [{lo:.0%} .. {hi:.0%}] | {found} | {false} | {held} |")
    return "\n".join(lines)


def main(count, first=1000):
    """Run trials and print each, then the table."""
    bank = Bank(QUICK)
    blank, done = bank.blank(), []
    for k, kind in enumerate(kinds(count)):
        t = trial(bank, blank, kind, first + k)
        done.append(t)
        found = [(e["law"], round(e["d"], 1)) for e in t.result.effects]
        print(t.kind, t.seed, t.truth, t.result.verdict, found, "right" if t.right else "WRONG", flush=True)
    print(table(done))


if __name__ == "__main__":
    import sys

    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
