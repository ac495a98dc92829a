"""Wide priors: gains, phases, latencies and offsets off within their sheet come out as parameters, and as no effect."""

import numpy as np
import pytest

from testbench import config as configuration
from testbench.measured.closed_loop import loop_laws, loop_problem, loop_runs, loop_trace
from testbench.measured.closed_loop.loop_symmetries import DELAY, MOTION
from testbench.measured.wide import data_sheet, estimate
from testbench.tracing.trace import Options
from tests.testbench.measured.loop_trials import QUICK
from tests.testbench.measured.wide_trials import recorded

SEED = 900
# share by which each is off, and the symmetry whose product or difference the record shows in place of it
OFF = {
    "plant.k_vf_sense_n_per_v": 0.08,
    "plant.sense_pole_1_s": 0.08,
    "plant.drive_pole_1_s": -0.08,
    "plant.sid_charge_mismatch": 0.6,
}
KINDS = {
    "gain": (MOTION, "plant.k_vf_sense_n_per_v"),
    "phase": (DELAY, "plant.sense_pole_1_s"),
    "latency": (DELAY, "plant.drive_pole_1_s"),
    "offset": (None, "plant.sid_charge_mismatch"),
}


@pytest.fixture(scope="module")
def found():
    """(result, {key: truth}, keys, values, covariance, {key: middle of the sheet}) of one record of such a board."""
    base, bench = configuration.Config(), loop_runs.Bench(1)
    wanted = data_sheet.parameters(base, data_sheet.read(data_sheet.BUNDLED_PATH))
    middle = {p.key: p.mean for p in wanted}
    truth = middle | {key: middle[key] * (1 + share) for key, share in OFF.items()}
    values = recorded(bench, configuration.changed(base, truth), SEED, QUICK)
    data = loop_problem.Measured("constants", QUICK, values, {"trial": "constants"})
    begun = estimate.estimate(data, base, wanted, bench)
    laws = loop_laws.from_catalogue(), loop_laws.from_grammar()
    problem = loop_problem.LoopProblem(data, begun.config, begun.parameters, *laws, bench)
    tracer, result = loop_trace.run(problem, Options(seed=SEED, power=False, experiments=False))
    fit, n = tracer.fits["after"], len(problem.parameters)
    values = [p.value_from_theta(t) for p, t in zip(problem.parameters, fit.point.theta)]
    return result, truth, [p.key for p in problem.parameters], values, fit.covariance[:n, :n], middle


def _shown(kind, values):
    """(what the record shows of a kind, {key: slope}) at {key: value}."""
    symmetry, key = KINDS[kind]
    if symmetry is None:
        return values[key], {key: 1.0}
    return symmetry.invariants(values)[list(symmetry.partners).index(key)][1:]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_within_its_sheet_comes_out_as_its_parameter(found, kind):
    """Seen with five deviations or more, within three of the truth."""
    _, truth, keys, values, covariance, middle = found
    (value, slopes), (true, _), (nominal, _) = (_shown(kind, of) for of in (dict(zip(keys, values)), truth, middle))
    slope = np.array([slopes.get(k, 0.0) for k in keys])
    sd = np.sqrt(slope @ covariance @ slope)
    print(f"{kind}: {value:.6g} +- {sd:.2g}, true {true:.6g}, middle {nominal:.6g}")
    assert abs(true - nominal) > 5 * sd
    assert abs(value - true) < 3 * sd


@pytest.mark.slow
def test_constants_within_their_sheet_are_no_effect(found):
    result = found[0]
    assert result.verdict == "none", result.sentence
    assert not result.effects
