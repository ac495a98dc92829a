"""Simulated recordings of a part with nothing missing, through the same pipeline: how often is an effect named?

    recording   the calibrated model of the file, without laws, and a draw of the file's own noise
    python -m testbench.measured.nulls FILE... [--count 100] [--seed 0] [--option KEY=VALUE]
Source    docs/measured_results.md
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from testbench.measured.exam import exam
from testbench.measured.exam.staged import ALPHA, absorb, add_in_stages
from testbench.measured.openers import open_problem
from testbench.measured.parts.part import Part
from testbench.tracing.trace import Options, Tracer


def nulls(problem, count, seed=0, true_laws=(), say=None):
    """Names of the effects of each of `count` recordings of `problem`'s part; `true_laws`: those of its truth.

    The noise is that of the file; the model that is traced has the known laws in it.
    """
    if isinstance(problem, Part):
        return exam.nulls(problem, count, seed, say)
    now = absorb(problem, list(true_laws))
    tracer = Tracer(now, Options(n_null=199, max_laws=1, power=False, experiments=False), None, None)
    if not tracer.calibrate():
        raise RuntimeError("the calibration of the file failed")
    theta = tracer.base.fit.point.theta
    clean = now.predict([(theta, {})], list(range(len(now.segments))))[0]
    out = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        data = [mean + now.noise_draw(i, rng) for i, mean in enumerate(clean)]
        staged = add_in_stages(now.replace_data(data), Options(ALPHA, seed=k), 1)
        out.append([e["law"] for e in staged.json["effects"]])
        if say:
            say(f"{k + 1}: {out[-1]}, {staged.json['verdict']}")
    return out


def main(arguments=None):
    """Prints JSON: recordings, those with a named effect, their names."""
    parser = argparse.ArgumentParser(prog="python -m testbench.measured.nulls")
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--option", action="append", default=[])
    options = parser.parse_args(arguments)
    problem = open_problem(options.files, dict(text.split("=", 1) for text in options.option))
    effect_names = nulls(
        problem, options.count, options.seed, say=lambda text: print(text, file=sys.stderr, flush=True)
    )
    hits = [names for names in effect_names if names]
    print(json.dumps({"problem": problem.name, "recordings": len(effect_names), "named": len(hits), "names": hits}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
