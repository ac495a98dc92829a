"""The search of the rate loop against `paper.loop`, which builds the closed loop as one matrix."""

import math

import numpy as np
import pytest

from testbench.config import Config, changed
from testbench.design import margins, rate_loop_design
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters

BANDWIDTH_HZ = 25.0
TURNED = changed(Config(), {"nominal.fy_hz": 2 * 11002.3 - 10863.3})


@pytest.fixture(scope="module", params=("f_y below f_x", "f_y above f_x"))
def point(request):
    """(configuration with the gains of a point of the search, the point)."""
    config = Config() if request.param == "f_y below f_x" else TURNED
    b = rate_loop_design.build_board(config, 100e-9, None, BANDWIDTH_HZ)
    at = int(np.argmin(np.abs(b.nominal.hz - BANDWIDTH_HZ)))
    met = rate_loop_design.evaluate_point(b, 180.0, at, rate_loop_design.Limits(3.0, 0.3))
    per_hz = abs(b.nominal.p.word_ki) / b.nominal.p.frame_s / config.firmware.ftr_crossover_hz
    keys = {"nominal.sid_c_f": 100e-9, "firmware.ftr_zero_hz": 180.0, "firmware.ftr_crossover_hz": met.gain / per_hz}
    return changed(config, keys), met


def test_the_gain_gives_the_bandwidth(point):
    config, met = point
    a = advisor.analyse(loop_parameters(config))
    assert a.stable
    assert met.is_satisfied
    assert a.bandwidth_hz == pytest.approx(BANDWIDTH_HZ, rel=2e-4)  # coefficients of 2^-24
    assert max(a.peak_db, 0.0) == pytest.approx(met.peak_db, abs=0.02)
    assert a.modulus_margin == pytest.approx(met.modulus, rel=0.01)


def test_the_closed_loop_is_that_of_the_matrix(point):
    config, met = point
    loop = lp.close(loop_parameters(config))
    hz = met.board.nominal.hz
    c = rate_loop_design.controller(met.board.nominal, met.zero_hz)
    mine = rate_loop_design.closed_db(met.board.nominal, c, met.gain)
    other = 20 * np.log10(np.abs(lp.response(loop, hz)) / abs(advisor.dc_gain(loop)))
    assert np.max(np.abs(mine - other)) < 0.01


def test_margins_are_those_of_the_poles(point):
    config, met = point
    found = margins.margins(met.board.nominal, met.zero_hz, met.gain)
    a = advisor.analyse(loop_parameters(config))
    assert found.gain_db == pytest.approx(a.gain_margin_up_db, abs=0.1)
    assert found.phase_deg == pytest.approx(min(min(c.lag_deg, c.lead_deg) for c in a.crossings), abs=0.5)


def test_capacitors_are_of_the_series():
    found = rate_loop_design.capacitors(139.0, 10e3)
    low, high = (r * 139.0 for r in rate_loop_design.CORNER_BY_SPLIT)
    corners = [1 / (4 * math.pi * 10e3 * c) for c in found]
    assert all(low <= f <= high for f in corners)
    decades = [c / 10 ** math.floor(math.log10(c)) for c in found]
    assert all(min(abs(m - e) for e in rate_loop_design.E12) < 1e-9 for m in decades)
    ratios = np.diff(np.log10(found))
    assert np.all(ratios > 0.06)
    assert np.all(ratios < 0.1)


def test_a_corner_of_the_tolerances_counts():
    """The least distance over the corners is that of a board that stands there."""
    tolerances = rate_loop_design.Tolerances()
    b = rate_loop_design.build_board(Config(), 82e-9, tolerances, BANDWIDTH_HZ)
    at = int(np.argmin(np.abs(b.nominal.hz - BANDWIDTH_HZ)))
    met = rate_loop_design.evaluate_point(b, 200.0, at, rate_loop_design.Limits())
    p = rate_loop_design.with_gains(b.nominal.p, met.gain, met.zero_hz)
    least = math.inf
    for split in (0.9, 1.1):
        for sid in (1 / 0.9, 1 / 1.1):
            for factor in rate_loop_design.gain_factors(tolerances):
                q = advisor.vary_parameters(p, split_hz=p.split_hz * split, sid_hz=p.sid_hz * sid, crossover=factor)
                least = min(least, float(np.min(np.abs(1 + lp.return_ratio(q, b.corners[0][0].hz)))))
    assert rate_loop_design.worst_modulus(met) == pytest.approx(least, rel=0.05)
