"""The second plant inside the product's loop: what the firmware settles at, beside the product's own plant."""

import shutil

import numpy as np
import pytest
from scipy import stats

from testbench import config as configuration
from testbench.measured.closed_loop import loop_record, loop_runs
from testbench.measured.record import produce
from testbench.measured.record import recording_plan as plans
from tests.sealed import strata
from tests.testbench.bench_setup import QUIET

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
EVEN = {"firmware.reference_retimed": False}
LATER_S = (0.0, 0.05, 0.1)  # dwells that begin later have another dither of the edges of references
QUAD_LSB_V = configuration.Config().plant.quad_dac_span_v / 2**16
# last place of the firmware's word behind an observable: Hz, V, V, V^2 at some V_q^2
LAST_PLACE = {
    "f_word": lambda _: 26e6 / 2**48,
    "amplitude": lambda _: 10 / 2**23,
    "force": lambda _: 10 / 2**23,
    "v_q2": lambda v2: 2 * np.sqrt(v2) * QUAD_LSB_V,
}


def last_bins(plan, later_s):
    """(observable, condition): mean over the last bin of a dwell that begins later."""
    moved = [c._replace(settle_s=c.settle_s + later_s) for c in plan.conditions]
    rows = loop_record.measured_features(produce.record(plan._replace(conditions=tuple(moved))), "x", {}).values
    bins = [rows[c.id][0][: loop_runs.feature_count(c)].reshape(len(loop_runs.NAMES), -1)[:, -1] for c in moved]
    return np.array(bins).T[[loop_runs.NAMES.index(name) for name in LAST_PLACE]]


@pytest.fixture(scope="module")
def settled(tmp_path_factory):
    """{plant: (start, observable, condition)} without noise: product, second plant with two and four steps a tick."""
    table, folder, out = strata.read(), tmp_path_factory.mktemp("own"), {}
    for steps in (2, 4):
        own = folder / f"{steps}.txt"
        own.write_text(strata.own_text(table, {"steps": steps}))
        made = strata.plan(table, "second", 7, QUIET, own, 1, ("fit",), 0.0)
        even = (configuration.changed(part, EVEN) for part in (made.model, made.truth))
        made = made._replace(**dict(zip(("model", "truth"), even)))
        out[steps] = np.array([last_bins(made, s) for s in LATER_S])
    out["product"] = np.array([last_bins(plans.with_plant(made, ""), s) for s in LATER_S])
    return out


@pytest.mark.slow
def test_the_loop_settles_where_it_does_around_the_products_plant(settled):
    """Drive frequency, amplitude, rebalance force and V_q squared differ by no more than three causes can move them.

    step    error of the second plant, of second order: 4/3 of what four steps instead of two change
    dither  edges are at whole clocks: scatter over dwells that begin later, of all three plants, two-sided 1e-4
    place   the last one of the word
    References leave at any clock: on the 1 MHz grid their edges slip, and two runs differ by 1e-5 Hz.
    """
    mean = {name: rows.mean(axis=0) for name, rows in settled.items()}
    difference = np.abs(mean[2] - mean["product"])
    step = 4 / 3 * np.abs(mean[2] - mean[4])
    inside = np.array([rows - rows.mean(axis=0) for rows in settled.values()])
    plants, starts, _, conditions = inside.shape
    freedom = plants * conditions * (starts - 1)
    scatter = np.sqrt((inside**2).sum(axis=(0, 1, 3)) / freedom)[:, None]
    dither = stats.t.ppf(1 - 0.5e-4, freedom) * scatter * np.sqrt(2 / starts)
    place = np.array([[of(v) for v in row] for of, row in zip(LAST_PLACE.values(), mean["product"])])
    for name, *rows in zip(LAST_PLACE, difference, step, dither, place):
        print(name, *(f"{np.max(v):.1e}" for v in rows))
    assert np.all(difference < step + dither + place)
    # a clock is 7e-5 Hz, see below
    assert np.all((step + dither + place)[0] < 1e-5)


@pytest.mark.slow
def test_a_clock_of_the_switches_moves_the_frequency_by_the_slope_of_its_phase():
    """f/(2Q) of the phase of a clock, 7e-5 Hz, with the drive 15 deg beside its resonance: 7 % more."""
    made = strata.plan(strata.read(), "own", 7, QUIET, "", 1, ("fit",), 0.0)
    made = plans.with_plant(made, "")
    made = made._replace(conditions=made.conditions[:1], truth=configuration.changed(made.truth, EVEN))
    plant, clock_s = made.truth.plant, 1 / 26e6
    late = {"plant.sid_switch_s": plant.sid_switch_s + clock_s}
    hz = [last_bins(made._replace(truth=configuration.changed(made.truth, more)), 0.0)[0, 0] for more in ({}, late)]
    wanted = plant.fx_hz / (2 * plant.qx) * 2 * np.pi * plant.fx_hz * clock_s / np.cos(np.deg2rad(15.0)) ** 2
    assert abs(hz[1] - hz[0]) == pytest.approx(wanted, rel=0.1)
