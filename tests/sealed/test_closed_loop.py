"""The second plant inside the product's loop: what the firmware settles at, beside the product's own plant."""

import shutil

import pytest

from testbench import config as configuration
from testbench.measured.closed_loop import loop_record, loop_runs
from testbench.measured.record import plan as plans
from testbench.measured.record import produce
from tests.sealed import strata
from tests.testbench.bench_setup import QUIET

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
EVEN = {"firmware.reference_retimed": False}
# largest difference that an observable may have, and in which unit: Hz, or parts of its own size
LEAST = 0.05  # V: of less no share is asserted
LIMITS = {"f_word": (5e-6, False), "amplitude": (1e-5, True), "force": (1e-5, True), "v_q2": (1e-5, True)}


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
    """Without noise, four conditions: drive frequency, amplitude, rebalance force and V_q squared.

    References leave at any clock: on the 1 MHz grid their edges slip, and two runs differ by 1e-5 Hz.
    """
    table = strata.read()
    own = tmp_path / "own.txt"
    own.write_text(strata.own_text(table, {}))
    foreign = strata.plan(table, "second", 7, QUIET, own, 1, ("fit",), 0.0)
    even = (configuration.changed(part, EVEN) for part in (foreign.model, foreign.truth))
    foreign = foreign._replace(**dict(zip(("model", "truth"), even)))
    found, wanted = last_bins(foreign), last_bins(plans.with_plant(foreign, ""))
    off = {}
    for name, row in wanted.items():
        for observable, (_, relative) in LIMITS.items():
            share = (found[name][observable] - row[observable]) / (row[observable] if relative else 1.0)
            print(f"{name:6s} {observable:10s} {row[observable]:.9g} {share:+.1e}")
            if abs(row[observable]) > LEAST:
                off[name, observable] = abs(share)
    assert all(share < LIMITS[observable][0] for (_, observable), share in off.items()), off
