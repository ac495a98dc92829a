"""The rate output: every register at every clock, each rounding and limit, the boxcar, and the unit of its result."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import rate_output as ro
from tests import naive
from tests.fpga_model.records import assert_rows, raws, rows

NOMINAL = ro.design()
params = st.builds(
    ro.Params,
    raws(ro.BIAS_0),
    raws(ro.BIAS_T),
    raws(ro.BIAS_T),
    raws(ro.SCALE, [NOMINAL.scale]),
    raws(ro.SCALE_T),
    raws(ro.SCALE_T),
    st.integers(0, 7),
)
sample = st.tuples(raws(ro.CODE), raws(ro.CODE), st.integers(ro.LATENCY, ro.LATENCY + 2), st.integers(0, 7))


def expected_rows(p, samples):
    """Registers of the pipeline from the oracle's values: each value enters its register `age` clocks after en."""
    units = {"bias": 8, "bias_t1": 24, "bias_t2": 24, "scale": 28, "scale_t1": 40, "scale_t2": 40}
    c = {name: Fraction(getattr(p, name), 2**f) for name, f in units.items()}
    steps, means = naive.rate_output(c, [(word, t, k) for word, t, _, k in samples])
    ends = dict(means)
    s = dict.fromkeys(ro.State._fields, 0)
    expected = [tuple(s.values())]
    members = []
    for n, (word, _, gap, decimation) in enumerate(samples):
        t, t2, bias, scale, corrected, scaled = steps[n]
        for clock in range(gap):
            s["stage"] = 1 << clock if clock < 5 else 0
            s["valid"] = 0
            if clock == 0:
                s.update(word=word, t=t)
            elif clock == 1:
                s.update(t2=t2)
            elif clock == 2:
                s.update(bias=int(bias * 2**24), scale=int(scale * 2**28))
            elif clock == 3:
                s.update(corrected=int(corrected * 2**8))
            elif clock == 4:
                s.update(scaled=int(scaled * 2**20))
            elif clock == 5:
                if not members:
                    s.update(k=min(decimation, 6))
                members.append(scaled)
                s.update(acc=int(sum(members) * 2**20), count=len(members))
                if n in ends:
                    s.update(count=0, y=int(ends[n] * 2**20), valid=1)
                    members = []
            expected.append(tuple(s.values()))
    return expected


def inputs_of(samples):
    return [(int(c == 0), w, t, k) for w, t, gap, k in samples for c in range(gap)]


def run(p, inputs):
    """The decimation may change at any time, so it comes with the inputs."""
    return rows(lambda s, en, w, t, k: ro.step(p._replace(decimation=k), s, en, w, t), ro.State(), inputs)


@given(params, st.lists(sample, max_size=20))
def test_step_is_the_documented_equation(p, samples):
    assert_rows(run(p, inputs_of(samples)), expected_rows(p, samples), ro.STATE_FMT)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("k", range(8))
def test_full_scale_through_every_boxcar(k, sign):
    """The worst sum of every length, and the limits of corrected and scaled."""
    p = ro.Params(-sign * 2**31 if sign > 0 else 2**31 - 1, 0, 0, 2**29 - 1, 0, 0, k)
    samples = [(2**23 - 1 if sign > 0 else -(2**23), 0, ro.LATENCY, k)] * (2 ** min(k, 6))
    found = run(p, inputs_of(samples))
    assert_rows(found, expected_rows(p, samples), ro.STATE_FMT)
    assert found[-1].valid == 1
    assert found[-1].y == (ro.OUT.hi if sign > 0 else ro.OUT.lo)
    assert sum(s.valid for s in found) == 1


@pytest.mark.parametrize("t", [-(2**15), -1, 0, 1, 2**15 - 1])
@pytest.mark.parametrize("coef", ["lo", "hi"])
def test_extremes_of_the_polynomials(t, coef):
    p = ro.Params(*(getattr(f, coef) for f in ro.PARAMS_FMT[:6]), 0)
    samples = [(w, t << 8, ro.LATENCY, 0) for w in (ro.CODE.lo, 0, ro.CODE.hi)]
    assert_rows(run(p, inputs_of(samples)), expected_rows(p, samples), ro.STATE_FMT)


def test_latency():
    found = run(NOMINAL, inputs_of([(1000, 0, 9, 0)]))
    assert [n for n, s in enumerate(found) if s.valid] == [ro.LATENCY]


def test_default_is_deg_per_s_at_1_khz():
    samples = [(8651 * 100, 0, 6, NOMINAL.decimation)] * 16
    found = run(NOMINAL, inputs_of(samples))
    assert [n for n, s in enumerate(found) if s.valid] == [8 * 6, 16 * 6]
    assert found[-1].y / 2**20 == pytest.approx(100, rel=0.5 / NOMINAL.scale + 2**-27)


def test_calibration_in_physical_units():
    p = ro.design(word_per_deg_s=8600.0, bias_deg_s=0.5, bias_t1=0.01, scale_t1=-3e-6, decimation=0)
    t = 2000
    word = round(8600 * (30 + 0.5) + 0.01 * t)
    found = run(p, inputs_of([(word, t << 8, 6, 0)]))
    assert found[-1].y / 2**20 == pytest.approx(30 * (1 - 3e-6 * t), rel=2e-6)


@pytest.mark.parametrize(
    "wrong", [{"decimation": 7}, {"word_per_deg_s": 0}, {"word_per_deg_s": 1000}, {"bias_t1": 200.0}]
)
def test_design_refuses(wrong):
    with pytest.raises(ValueError, match=r"decimation|word_per_deg_s|scale|bias_t1"):
        ro.design(**wrong)
