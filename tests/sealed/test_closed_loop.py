"""The second plant inside the product's loop: what the firmware settles at, beside the product's own plant."""

import shutil

import pytest

from testbench.measured.closed_loop import loop_record, loop_runs
from testbench.measured.record import plan as plans
from testbench.measured.record import produce
from tests.sealed import strata
from tests.testbench.bench_setup import QUIET

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
# largest difference that an observable may have, and in which unit: Hz, or parts of its own size
LIMITS = {"f_word": (1e-6, False), "amplitude": (1e-5, True), "force": (2e-5, True), "v_q2": (2e-5, True)}


def last_bins(plan):
    """{condition: {observable: mean over the last bin of a dwell}}."""
    out = {}
    for name, rows in loop_record.measured_features(produce.record(plan), "x", {}).values.items():
        condition = next(c for c in plan.conditions if c.id == name)
        v = rows[0][: loop_runs.size(condition)].reshape(len(loop_runs.NAMES), -1)[:, -1]
        out[name] = dict(zip(loop_runs.NAMES, v))
    return out


@pytest.mark.slow
def test_the_loop_settles_where_it_does_around_the_products_plant(tmp_path):
    """Without noise, four conditions: drive frequency, amplitude, rebalance force and V_q squared."""
    table = strata.read()
    own = tmp_path / "own.txt"
    own.write_text(strata.own_text(table, {}))
    foreign = strata.plan(table, "second", 7, QUIET, own, 1, ("fit",), 0.0)
    found, wanted = last_bins(foreign), last_bins(plans.with_plant(foreign, ""))
    for name, row in wanted.items():
        for observable, (limit, relative) in LIMITS.items():
            off = found[name][observable] - row[observable]
            share = off / (row[observable] if relative else 1.0)
            print(f"{name:6s} {observable:10s} {row[observable]:.9g} {share:+.1e}")
            if abs(row[observable]) > 0.05:
                assert abs(share) < limit, (name, observable)
