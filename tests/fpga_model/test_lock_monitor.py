"""The lock monitor: every register at every clock, both limits to the LSB, and the table of its page."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import cordic, lock_monitor
from fpga_model.fixed import signed_bits
from tests import naive
from tests.fpga_model.records import assert_rows, raws, rows

SMALL = lock_monitor.Params((3000, 100, 200, 300), (6000, 500, 200, 400), (3, 2, 1, 4), (2, 3, 4, 1))
SETPOINT = 10_000
CODE = signed_bits(24)

near_limits = st.tuples(
    st.sampled_from([0] + [s * v + d for s in (-1, 1) for v in (457, 915) for d in (-1, 0, 1)]),
    st.sampled_from([0] + [s * v + d for s in (-1, 1) for v in (100, 500) for d in (-1, 0, 1)]),
    st.sampled_from([0] + [s * v + d for s in (-1, 1) for v in (200,) for d in (-1, 0, 1)]),
    st.sampled_from([0] + [s * v + d for s in (-1, 1) for v in (300, 400) for d in (-1, 0, 1)]),
)
anywhere = st.tuples(raws(signed_bits(26)), raws(cordic.PHASE), raws(CODE), raws(CODE))
edge = st.tuples(
    st.sampled_from([1, 1, 1, 0]),
    st.sampled_from([15, 15, 15, 3, 0, 12, 5]),
    st.sampled_from([15, 15, 15, 11, 4, 0]),
    st.one_of(near_limits, near_limits, anywhere),
    st.sampled_from([SETPOINT, SETPOINT, SETPOINT, 0, 2**24 - 1]),
    st.sampled_from([0, 0, 1]),
    st.integers(1, 5),
)


def lanes(word):
    return {k for k in range(4) if (word >> k) & 1}


def run(p, inputs):
    return rows(lambda s, *i: lock_monitor.step(p, s, *i), lock_monitor.State(), inputs)


def expected_rows(p, inputs):
    locks = naive.Locks(p)
    expected = [locks.row()]
    for en, enable, judged, agc_error, setpoint, phase, sense_sin, sense_cos, rail in inputs:
        if en:
            locks.frame(lanes(enable), lanes(judged), agc_error, setpoint, phase, sense_sin, sense_cos, rail)
        expected.append(locks.row())
    return expected


def flatten(edges):
    return [
        (en, enable, judged, e[0], setpoint, e[1], e[2], e[3], rail)
        for en, enable, judged, e, setpoint, rail, times in edges
        for _ in range(times)
    ]


QUICK = lock_monitor.design(**dict(zip(lock_monitor.Design._fields, [0.02, 0.2, 1e-3, 5e-4] * 4)))


@given(st.sampled_from([SMALL, QUICK]), st.lists(edge, max_size=25))
def test_step_is_the_documented_equation(p, edges):
    inputs = flatten(edges)
    assert_rows(run(p, inputs), expected_rows(p, inputs), lock_monitor.STATE_FMT)


def frames(n, **errors):
    e = {"agc_error": 0, "setpoint": SETPOINT, "phase": 0, "sense_sin": 0, "sense_cos": 0, "rail": 0, **errors}
    return [(1, 15, 15, *e.values())] * n


@pytest.mark.parametrize(
    ("error", "k", "limit_in", "limit_out"),
    [
        # 3000 and 6000 of 65536 of the setpoint, cut: 457 and 915
        ("agc_error", 0, 457, 915),
        ("phase", 1, 100, 500),
        ("sense_sin", 2, 200, 200),
        ("sense_cos", 3, 300, 400),
    ],
)
@pytest.mark.parametrize("sign", [-1, 1])
def test_limits_and_times_are_exact(error, k, limit_in, limit_out, sign):
    bit, n_in, n_out = 1 << k, SMALL.frames_in[k], SMALL.frames_out[k]

    def locked(inputs):
        return [s.locked & bit for s in run(SMALL, inputs)]

    assert not any(locked(frames(20, **{error: sign * (limit_in + 1)})))
    assert locked(frames(n_in, **{error: sign * limit_in}))[-2:] == [0, bit]
    lost = frames(n_in) + frames(20, **{error: sign * limit_out})
    assert locked(lost)[n_in:] == [bit] * 21
    lost = frames(n_in) + frames(n_out, **{error: sign * (limit_out + 1)})
    assert locked(lost)[n_in:] == [bit] * n_out + [0]


def test_a_railed_quadrature_loop_is_locked_whatever_its_code():
    inputs = frames(4, sense_cos=2**23 - 1, rail=1) + frames(9, sense_cos=-(2**23), rail=1)
    assert [s.locked & lock_monitor.QSC for s in run(SMALL, inputs)][4:] == [lock_monitor.QSC] * 10


def test_criteria_of_the_page():
    """The table of the header holds the default limits and times of `design`."""
    d = lock_monitor.Design._field_defaults
    lines = [" ".join(line.split()) for line in lock_monitor.__doc__.splitlines()]
    for key, error in (("agc", "setpoint - magnitude"), ("pll", "phase"), ("ftr", "sense_sin"), ("qsc", "sense_cos")):
        scale, unit, text = {"agc": (100, "", "%"), "pll": (1, "_deg", "deg")}.get(key, (1, "_deg_s", "deg/s"))
        cells = [
            f"{scale * d[f'{key}_{way}{unit}']:g} {text} {1e3 * d[f'{key}_{way}_s']:g} ms" for way in ("in", "out")
        ]
        assert f"{key.upper()} {error} {cells[0]} {cells[1]}" in lines, key


def test_defaults_in_machine_units():
    p = lock_monitor.design()
    assert p.limit_in == (1311, 93207, 7286, 7286)
    assert p.limit_out[2] == pytest.approx(100 * 57.9e-6 * 3 * 2**23, abs=1)
    assert p.frames_in == (160, 160, 400, 400)
    assert p.frames_out == (400, 400, 400, 400)


@pytest.mark.parametrize("wrong", [{"agc_in": 0.3}, {"pll_in_deg": 0}, {"ftr_in_s": 5e-5}, {"qsc_out_s": 1.0}])
def test_design_refuses(wrong):
    with pytest.raises(ValueError, match=r"agc|pll|ftr|time to lose lock"):
        lock_monitor.design(**wrong)
