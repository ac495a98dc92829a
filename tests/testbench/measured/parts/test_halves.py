"""Coefficients of two disjoint halves of each published set, fitted apart, agree within their stated intervals.

python -m pytest -s -m slow tests/testbench/measured/parts/test_halves.py   with GYRO_DATA_DIR set
The laws are those of docs/results/measured_parts.json. Halves are sessions, files or sweeps where there are two, else
the stretches of one file that choose and that judge.
"""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from testbench.measured import sets_report
from testbench.measured.exam import exam, exam_intervals
from testbench.measured.formats import registry
from testbench.measured.openers import open_problem
from testbench.measured.parts.part import Part
from testbench.tracing.trace import Tracer

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not os.environ.get(registry.FOLDER), reason=f"{registry.FOLDER} is not set"),
]
KEPT = json.loads((Path(__file__).parents[4] / "docs" / "results" / "measured_parts.json").read_text())
OTHER = {"fit": "validate", "validate": "fit"}


def exchanged(problem):
    """The same problem with the roles of its segments exchanged; their local unknowns are their own in both."""
    if isinstance(problem, Part):
        problem.all_pieces = tuple(p._replace(role=OTHER.get(p.role, p.role)) for p in problem.all_pieces)
        problem._show("validate")
    else:
        problem.segments = tuple(s._replace(role=OTHER[s.role]) for s in problem.segments)
    return problem


def dated(paths, folder):
    """Copies of ring-downs of one sample, each pair of dates exchanged: what was fitted is judged."""
    texts = [p.read_text() for p in sorted(paths)]
    line = re.compile(r"% Date and time: .*")
    dates = [line.search(text)[0] for text in texts]
    out = []
    for k, text in enumerate(texts):
        other = dates[k ^ 1] if (k ^ 1) < len(texts) else dates[k]
        out.append(folder / f"{k}.txt")
        out[-1].write_text(line.sub(other, text, count=1))
    return out


def halves(set_name, paths, options, folder):
    """Two problems whose fitted segments are disjoint; None if a file has no second half."""
    if set_name == "dac16_levels":
        return [open_problem(paths, options | {"fit": k}) for k in ("1", "2")]
    if set_name == "mems_ringdown" and len(paths) > 1:
        return [open_problem(paths, options), open_problem(dated(paths, folder), options)]
    if set_name == "quartz_vna":
        return [open_problem([path], options) for path in sorted(paths)]
    if set_name == "mems_ringdown":
        return None  # level and rate of a run are nuisances of its fitted blocks
    return [open_problem(paths, options), exchanged(open_problem(paths, options))]


def coefficients(problem, names):
    """{coefficient: (value, stated sd)} of the laws that a problem has, fitted together."""
    names = [name for name in names if name in problem.laws_by_name()]
    fit = exam.fit_nested_laws(problem, names)[-1] if isinstance(problem, Part) else fitted(problem, names)
    own, sd = {n.name for n in problem.nuisances}, exam_intervals.stated_sd(fit)
    found = enumerate(n.name for n in fit.model.problem.nuisances)
    return {n: (float(fit.point.theta[k]), float(sd[k])) for k, n in found if n not in own}


def fitted(problem, names):
    tracer = Tracer(exam.absorb(problem, names), exam.QUICK, None, None)
    assert tracer.calibrate()
    return tracer.base.fit


def test_halves_agree(tmp_path):
    shares, z = {}, []
    for set_name in ("dac16_levels", "dmm_linearity", "gyro_static", "mems_ringdown", "quartz_vna", "silverbox"):
        mine, seen = [], set()
        for number, (label, paths, options) in enumerate(sets_report.jobs(registry.paths(set_name))):
            (kept,) = (job for job in KEPT[set_name]["jobs"] if job["label"] == label)
            names = [e["law"] for e in kept["effects"]]
            folder = tmp_path / f"{set_name} {number}"
            folder.mkdir()
            both = halves(set_name, paths, options, folder) if names and not seen & set(paths) else None
            seen |= set(paths)
            if both:
                one, two = (coefficients(problem, names) for problem in both)
                mine += [(one[n][0] - two[n][0]) / np.hypot(one[n][1], two[n][1]) for n in one if n in two]
        shares[set_name] = f"{np.sum(np.abs(mine) < 1.96)} of {len(mine)}"
        z += mine
    print(shares, f"together {np.mean(np.abs(z) < 1.96):.3f} of {len(z)}")
    assert np.mean(np.abs(z) < 1.96) >= 0.9
