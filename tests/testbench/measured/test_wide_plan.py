"""Conditions for wide priors: two amplitudes at a temperature separate what a slope of Q imitates; offsets are seen."""

import numpy as np
import pytest

from testbench import config as configuration
from testbench.measured.closed_loop import loop_problem, loop_runs
from testbench.measured.closed_loop.loop_difference_plant import disable_retiming
from testbench.measured.closed_loop.loop_runs import FAST, Run
from testbench.measured.wide import data_sheet
from testbench.measured.wide.averaged_loop import AveragedLoop
from tests.testbench.measured.loop_trials import QUICK
from tests.testbench.measured.wide_trials import CONDITIONS, recorded

SEED = 900
OFFSET = "plant.sid_charge_mismatch"  # the offset of all demodulators goes with it


def _left(columns, law):
    """Sigmas of a law that nuisances leave with their priors, by a projection of our own."""
    a = np.concatenate([columns, np.eye(columns.shape[1])])
    b = np.concatenate([law, np.zeros(columns.shape[1])])
    return np.linalg.norm(b - a @ np.linalg.lstsq(a, b, rcond=None)[0])


@pytest.mark.slow
def test_a_second_amplitude_at_a_temperature_leaves_twice_as_much_of_a_cubic_pickoff():
    """Sigmas that the wide nuisances leave of it, beside the conditions without it."""
    model, bench = configuration.Config(), loop_runs.Bench(1)
    wanted = data_sheet.parameters(model, data_sheet.read(data_sheet.BUNDLED_PATH))
    data = loop_problem.Measured("plan", CONDITIONS, recorded(bench, model, SEED), {})
    loop = AveragedLoop(data, model, wanted, bench)
    sigma = loop.sigma(loop.mean(np.zeros(len(wanted)), 8)[1])
    _, columns = loop.columns(np.zeros(len(wanted)), range(len(wanted)), sigma, 3.0)

    def features(pickoff):
        changed = configuration.changed(model, {"effects.pickoff_cubic_x": pickoff})
        told = loop_runs.Model(disable_retiming(changed))
        slow = [c._replace(settle_s=c.settle_s + 3.0) for c in loop.conditions]
        return np.concatenate(bench.run([Run(told, c, 7, model, 0, True) for c in slow], FAST))

    law, columns = (features(1e-4) - features(-1e-4)) / 10 / sigma, columns / sigma[:, None]

    def left(names):
        rows = np.isin(np.array([c.id for c in loop.conditions])[loop.condition], names)
        return _left(columns[rows], law[rows])

    before = left([c.id for c in QUICK])
    assert left([c.id for c in CONDITIONS]) > 2 * before


@pytest.mark.slow
def test_an_offset_of_the_demodulators_is_no_other_parameter_of_the_sheet():
    """A factor of 2 of it: the sheet's parameters leave more than 10 sigmas, so the record itself gives its size."""
    model, bench = configuration.Config(), loop_runs.Bench(1)
    wanted = data_sheet.parameters(model, data_sheet.read(data_sheet.BUNDLED_PATH))
    uniform = loop_runs.Model(disable_retiming(model))
    rows = bench.run([Run(uniform, c, SEED, None, 0, True) for c in CONDITIONS], FAST)
    data = loop_problem.Measured("offset", CONDITIONS, {c.id: row[None] for c, row in zip(CONDITIONS, rows)}, {})
    loop = AveragedLoop(data, model, wanted, bench)
    sigma = loop.sigma(loop.mean(np.zeros(len(wanted)), 8)[1])
    _, columns = loop.columns(np.zeros(len(wanted)), range(len(wanted)), sigma, 3.0)
    columns = columns / sigma[:, None]
    offset = np.array([p.key == OFFSET for p in wanted])
    left = _left(columns[:, ~offset], columns[:, offset][:, 0])
    print(f"offset: {np.linalg.norm(columns[:, offset]):.0f} sigmas, {left:.0f} are left")
    assert left > 10
