"""Random trials of wide priors: a board drawn within its data sheet, with or without an effect; what is found?

    python -m tests.testbench.measured.wide_trials COUNT --first SEED

Truth is the exact engine with every parameter of the sheet drawn evenly within one tolerance, each repeat from
power-on. The analysis begins from the middle of the sheet. V_q must stay below its DAC's span: the coupling is drawn up
to MOST_COUPLING times its middle. Intervals are counted of what the record can tell (`identifiable`): those of keys
that a symmetry ties hold by their priors, all of one symmetry together.
Source    docs/wide_priors.md
"""

import argparse
import json
import math
import time

import numpy as np

from testbench import config as configuration
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_laws, loop_noise, loop_problem, loop_runs, loop_trace
from testbench.measured.closed_loop.loop_runs import EXACT, Model, Run
from testbench.measured.closed_loop.loop_symmetries import active_symmetries
from testbench.measured.record.recording_plan import Condition
from testbench.measured.wide import data_sheet, estimate
from testbench.tracing.trace import Options
from tests.testbench.measured.loop_trials import QUICK, REPEATS, TRUE_SEED, lengths

MOST_COUPLING = 1.35
NORMAL_95 = 1.96
# a second amplitude at two of the temperatures: without it the slope of Q takes what bends with the amplitude
CONDITIONS = (
    *QUICK,
    Condition("same", 7.0, 60.0, 60.0, 25.0, -15.0, settle_s=loop_runs.SETTLE_S, seconds=0.6, role="fit"),
    Condition("low", 3.0, 0.0, 0.0, 50.0, 0.0, settle_s=loop_runs.SETTLE_S, seconds=0.6, role="fit"),
)
# sizes of some 10 to 60 sigmas with narrow priors; the `d` of a trial is what wide ones leave
EFFECTS = {
    "duffing_k3_per_um2": 2e-7,
    "pickoff_cubic_x": 4e-5,
    "sense_cubic": 3e-10,
    "quadrature_cubic": 3e6,
    "feedthrough_x": 3e-4,
    "damping_cubic": 30.0,
}


def board(seed):
    """{key: value} of a board within the sheet."""
    rng, out, plant = np.random.default_rng([78, seed]), {}, configuration.Config().plant
    for key, (kind, tolerance) in data_sheet.read(data_sheet.BUNDLED_PATH).items():
        width = math.log(tolerance) if kind == "factor" else math.log1p(tolerance)
        most = math.log(MOST_COUPLING) if key == "plant.kxy_n_per_m" else width
        out[key] = getattr(plant, key.partition(".")[2]) * math.exp(rng.uniform(-width, most))
    return out


def recorded(bench, cfg, seed, conditions=CONDITIONS):
    """{condition: features of its repeats}: power-ons of a board, each with a frequency and a phase of its own."""
    per_hz = 8 * np.pi**2 * cfg.plant.mass_kg * cfg.plant.fx_hz
    rng, runs = np.random.default_rng([8, seed]), []
    for i, c in enumerate(conditions):
        for r in range(REPEATS[c.role]):
            told = Model(cfg, (f"force_x = {-per_hz * loop_noise.JITTER_HZ * float(rng.normal())!r} x",))
            late = int(rng.integers(loop_runs.MOST_DELAY_FRAMES))
            runs.append(Run(told, c, TRUE_SEED + 10_000 * seed + 100 * i + r, delay_frames=late))
    rows = iter(bench.run(runs, EXACT, fine=True))
    return {c.id: np.array([next(rows) for _ in range(REPEATS[c.role])]) for c in conditions}


def trial(seed, law=None, options=None):
    """{what: value} of a trial: verdict, effects, d of what is hidden, sds by which parameters and products are off."""
    base, bench, begun = configuration.Config(), loop_runs.Bench(1), time.process_time()
    truth = board(seed)
    hidden = {f"effects.{law}": EFFECTS[law]} if law else {}
    data = loop_problem.Measured(
        f"wide {seed}",
        CONDITIONS,
        recorded(bench, configuration.changed(base, truth | hidden), seed),
        {"trial": str(seed)},
    )
    found = estimate.estimate(data, base, data_sheet.parameters(base, data_sheet.read(data_sheet.BUNDLED_PATH)), bench)
    problem = loop_problem.LoopProblem(
        data, found.config, found.parameters, loop_laws.from_catalogue(), loop_laws.from_grammar(), bench
    )
    tracer, result = loop_trace.run(problem, options or Options(seed=seed, power=False, experiments=False))
    fit, n = tracer.fits["after"], len(problem.parameters)
    keys = [p.key for p in problem.parameters]
    values = [p.value_from_theta(t) for p, t in zip(problem.parameters, fit.point.theta)]
    off = {p.key: _off(p, x, truth[p.key]) / s for p, x, s in zip(problem.parameters, fit.point.theta, fit.sd)}
    return {
        "seed": seed,
        "hidden": law,
        "d": law and EFFECTS[law] * lengths(problem, [law])[law],
        "verdict": result.verdict,
        "found": [e["law"] for e in result.effects],
        "rms": found.rms,
        "off": off,
        "identifiable": identifiable(off, products(keys, values, fit.covariance[:n, :n], truth)),
        "heldout": [result.heldout_chi2.get("after"), result.heldout_chi2.get("limit")],
        "notes": list(result.notes),
        "seconds": time.process_time() - begun,
    }


def _off(p, theta, truth):
    """Distance to the truth in the coordinate of the linear model."""
    return p.clip_theta(theta) - p.theta(truth)


def products(keys, values, covariance, truth):
    """{words: sds from the truth} of what symmetries leave of the keys that they tie."""
    out, found = {}, dict(zip(keys, values))
    for symmetry in active_symmetries(keys).values():
        true = symmetry.invariants(truth)
        for (words, value, slopes), (_, wanted, _) in zip(symmetry.invariants(found), true):
            slope = np.array([slopes.get(key, 0.0) for key in keys])
            out[words] = float((value - wanted) / np.sqrt(slope @ covariance @ slope))
    return out


def identifiable(off, told):
    """`off` without the keys that a symmetry ties, and their products in place of them."""
    hidden = {key for s in active_symmetries(list(off)).values() for key in (s.dependent_key, *s.partners)}
    return {key: x for key, x in off.items() if key not in hidden} | told


def inside(row):
    """(intervals of 95 % that hold the truth, all) of what the record of a trial can tell."""
    return sum(abs(off) < NORMAL_95 for off in row["identifiable"].values()), len(row["identifiable"])


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("count", type=int)
    parser.add_argument("--first", type=int, default=0)
    asked, names = parser.parse_args(), [None, *EFFECTS]
    for seed in range(asked.first, asked.first + asked.count):
        try:
            print(json.dumps(trial(seed, names[seed % len(names)])), flush=True)
        except ConfigError as reason:
            print(json.dumps({"seed": seed, "failed": str(reason)}), flush=True)


if __name__ == "__main__":
    main()
