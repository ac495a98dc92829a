"""The PI controller: every register at every clock, limits, mode changes without a bump, and no dead zone."""

from fractions import Fraction

import numba
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fpga_model import pi
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from fpga_model.jit import kernel
from tests import naive

ONE = 1 << pi.COEF.f


@kernel
def trace(d, p, s, en, mode, e, preset):
    """Registers before each edge, and after the last one."""
    rows = np.empty((len(en) + 1, 3), np.int64)
    for n in range(len(en) + 1):
        for k, value in enumerate(s):
            rows[n, k] = value
        if n < len(en):
            s = pi.step(d, p, s, int(en[n]), int(mode[n]), int(e[n]), int(preset[n]))
    return rows


@kernel
def enables_until_y_moves(p, s, e, most):
    """Enables with a constant error until y differs; `most` + 1 if it does not move in time."""
    y = s.y
    for n in range(1, most + 1):
        s = pi.step(DEFAULT, p, s, 1, pi.RUN, e, 0)
        # one edge more lets y show what the enable did
        s = pi.step(DEFAULT, p, s, 0, pi.RUN, e, 0)
        if s.y != y:
            return n
    return most + 1


def drive(p, inputs, s=None, d=DEFAULT):
    """Rows of a run over (en, mode, e, preset)."""
    columns = np.array(inputs, dtype=np.int64).reshape(-1, 4).T.copy()
    return trace(d, p, s or pi.State(), *columns)


def raws(fmt):
    """Raw values of a format, often at its ends and around zero."""
    near = [fmt.lo, fmt.lo + 1, -1, 0, 1, fmt.hi - 1, fmt.hi]
    return st.one_of(st.sampled_from(near), st.integers(-(1 << 26), 1 << 26), st.integers(fmt.lo, fmt.hi))


@st.composite
def params(draw):
    lo, hi = sorted((draw(raws(pi.OUT)), draw(raws(pi.OUT))))
    return pi.Params(kp=draw(raws(pi.COEF)), ki=draw(raws(pi.COEF)), lo=lo, hi=hi)


err = raws(pi.ERR).filter(pi.ERR.holds)
edge = st.tuples(st.sampled_from([1, 1, 0]), st.integers(0, 4), err, raws(pi.OUT))
running = st.tuples(st.just(1), st.just(pi.RUN), err, st.just(0))


@given(params(), st.lists(st.one_of(edge, running), max_size=40))
def test_step_is_the_documented_equation(p, inputs):
    rows = drive(p, inputs)
    assert [tuple(row) for row in rows.tolist()] == naive.pi(
        Fraction(p.kp, ONE), Fraction(p.ki, ONE), p.lo, p.hi, inputs
    )
    for fmt, lowest, highest in zip(pi.STATE_FMT, rows.min(axis=0), rows.max(axis=0), strict=True):
        assert fmt.lo <= lowest <= highest <= fmt.hi


@pytest.mark.parametrize("kp", [pi.COEF.lo, pi.COEF.hi])
@pytest.mark.parametrize("ki", [pi.COEF.lo, pi.COEF.hi])
@pytest.mark.parametrize("e", [pi.ERR.lo, pi.ERR.hi])
def test_extremes_with_the_widest_limits(kp, ki, e):
    p = pi.Params(kp, ki, pi.OUT.lo, pi.OUT.hi)
    inputs = [(1, pi.RUN, e, 0)] * 8 + [(1, pi.OFF, e, pi.OUT.lo), (1, pi.RUN, e, 0), (1, pi.OFF, e, pi.OUT.hi)] * 3
    expected = naive.pi(Fraction(kp, ONE), Fraction(ki, ONE), p.lo, p.hi, inputs)
    assert [tuple(row) for row in drive(p, inputs).tolist()] == expected


@pytest.mark.parametrize("whole", [-3, -1, 0, 1, 2**34])
def test_y_rounds_ties_up(whole):
    for fraction, up in ((0, 0), (1, 0), (ONE // 2 - 1, 0), (ONE // 2, 1), (ONE // 2 + 1, 1), (ONE - 1, 1)):
        for prop in (0, 12345, -ONE // 2):
            s = pi.State(prop=prop, acc=whole * ONE + fraction - prop)
            assert drive(pi.Params(0, 0, pi.OUT.lo, pi.OUT.hi), [(0, pi.HOLD, 0, 0)], s)[1, 2] == whole + up


# Properties the loops rely on ---------------------------------------------------------------------------------------


@given(st.integers(1, pi.COEF.hi), st.sampled_from([-1, 1]), st.sampled_from([-1, 1]), st.integers(-(2**40), 2**40))
def test_an_error_of_one_lsb_moves_the_integrator_at_every_enable(ki, sign, e, acc):
    p = pi.Params(0, sign * ki, pi.OUT.lo, pi.OUT.hi)
    rows = drive(p, [(1, pi.RUN, e, 0)] * 5, pi.State(acc=acc))
    assert np.diff(rows[:, 1]).tolist() == [sign * ki * e] * 5


@pytest.mark.parametrize("e", [-1, 1])
@pytest.mark.parametrize("fraction", [0, 1, ONE // 2 - 1, ONE // 2, ONE - 1])
@pytest.mark.parametrize("ki", [1, 3, 1000, ONE // 3, ONE - 1, ONE, 5 * ONE])
def test_an_error_of_one_lsb_moves_y_within_the_stated_time(ki, fraction, e):
    if numba.config.DISABLE_JIT and ki < 1000:
        pytest.skip("millions of steps: only with the compiler")
    stated = -(-ONE // ki)
    start = drive(pi.Params(0, 0, -99, 99), [(0, pi.RUN, 0, 0)] * 2, pi.State(acc=7 * ONE + fraction))[-1]
    moved = enables_until_y_moves(pi.Params(0, ki, -99, 99), pi.State(*start.tolist()), e, stated)
    assert moved <= stated


@given(params(), st.lists(st.one_of(edge, running), max_size=30))
def test_acc_and_y_never_leave_the_limits_once_inside(p, inputs):
    rows = drive(p, [(1, pi.OFF, 0, p.lo), (0, 0, 0, 0), *inputs])[2:]
    assert np.all((rows[:, 1] >= p.lo * ONE) & (rows[:, 1] <= p.hi * ONE))
    assert np.all((rows[:, 2] >= p.lo) & (rows[:, 2] <= p.hi))


def test_integrator_leaves_its_limit_at_the_first_error_of_the_other_sign():
    p = pi.Params(0, ONE // 4, -10, 10)
    rows = drive(p, [(1, pi.RUN, 1000, 0)] * 50 + [(1, pi.RUN, -8, 0)] * 2)
    assert rows[50, 1] == 10 * ONE
    assert rows[51:, 1].tolist() == [8 * ONE, 6 * ONE]


@given(st.integers(-1000, 1000), st.integers(-1000, 1000), st.integers(-50, 50))
def test_off_to_run_starts_from_the_preset(preset, e, kp):
    """The first y in RUN is the preset plus one proportional and one integral step, exactly."""
    p = pi.Params(kp * ONE, ONE, -(10**6), 10**6)
    rows = drive(p, [(1, pi.OFF, e, preset), (0, 0, 0, 0), (1, pi.RUN, e, 0), (0, 0, 0, 0)])
    assert rows[2, 2] == preset
    assert rows[4, 2] == preset + kp * e + e


@given(st.lists(st.sampled_from([pi.P_ONLY, pi.RUN, pi.HOLD]), max_size=20), st.integers(-(2**30), 2**30))
def test_mode_changes_without_error_leave_y_where_it_was(modes, preset):
    p = pi.Params(3 * ONE, ONE // 7, -(2**31), 2**31)
    rows = drive(p, [(1, pi.OFF, 99, preset), (0, 0, 0, 0), *((1, mode, 0, -preset) for mode in modes)])
    assert np.all(rows[2:, 2] == preset)


def test_hold_freezes_prop_and_acc_and_run_goes_on_from_them():
    p = pi.Params(2 * ONE, ONE // 2, -1000, 1000)
    rows = drive(p, [(1, pi.RUN, 20, 0)] * 3 + [(1, pi.HOLD, -500, 77)] * 4 + [(1, pi.RUN, 20, 0)])
    assert np.all(rows[3:8, :2] == [40 * ONE, 30 * ONE])
    assert rows[8].tolist() == [40 * ONE, 40 * ONE, 70]


def test_y_answers_latency_clocks_after_an_enabled_error():
    p = pi.Params(ONE, 0, -1000, 1000)
    inputs = [(int(n == 4), pi.RUN, 9, 0) for n in range(12)]
    assert np.flatnonzero(drive(p, inputs)[:, 2])[0] == 4 + pi.LATENCY


# design -------------------------------------------------------------------------------------------------------------


def test_design_quantises_gains_and_keeps_limits():
    p = pi.design(kp=-1.5, ki_per_s=1000.0, frame_hz=8000, lo=-(2**31), hi=2**31 - 1)
    assert p == (-3 * ONE // 2, ONE // 8, -(2**31), 2**31 - 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kp": 512.0}, r"kp \(LSB per LSB\): 512 does not fit format \[1,9,24\]"),
        ({"ki_per_s": -5e6}, r"ki_per_s / frame_hz .*: -625 does not fit"),
        ({"lo": -(2.0**36)}, r"lo \(LSB\): .* does not fit format \[1,35,0\]"),
        ({"hi": 2.0**35}, r"hi \(LSB\): .* does not fit"),
        ({"lo": 5, "hi": 4}, "lo: 5 LSB is above hi, 4 LSB"),
        ({"kp": 1e-8}, "kp: 1e-08 LSB per LSB rounds to zero; the smallest gain is 5.96046e-08"),
        ({"ki_per_s": 1e-4}, "ki_per_s: 0.0001 .* rounds to zero; the smallest is 0.000476837"),
        ({"frame_hz": 0}, "frame_hz: 0 Hz is not a positive rate"),
        ({"kp": float("nan")}, "kp .* is not a finite number"),
    ],
)
def test_design_refuses_with_value_limit_and_unit(change, message):
    good = {"kp": 1.0, "ki_per_s": 1.0, "frame_hz": 8000, "lo": -10, "hi": 10}
    pi.design(**good)
    with pytest.raises(ValueError, match=message):
        pi.design(**{**good, **change})


def test_design_allows_a_gain_of_exactly_zero():
    assert pi.design(0, 0, 8000, -1, 1) == (0, 0, -1, 1)


@given(
    st.integers(8, 24),
    st.integers(pi.COEF.lo, pi.COEF.hi),
    st.integers(-(10**7), 10**7),
)
def test_gains_of_fewer_fraction_bits(fraction_bits, kp, ki):
    p = pi.Params(kp, ki, -5, 5)
    lsb = Fraction(1, 2**fraction_bits)
    nearest = [round(Fraction(k, ONE) / lsb) * lsb for k in (kp, ki)]
    moved = [abs(n - Fraction(k, ONE)) > Fraction(abs(k), 20 * ONE) for n, k in zip(nearest, (kp, ki))]
    if any(moved):
        with pytest.raises(ValueError, match=rf"k[pi] = .* % off in {fraction_bits} fraction bits; the limit is 5 %"):
            pi.round_gains(p, fraction_bits)
        return
    found = pi.round_gains(p, fraction_bits)
    assert [Fraction(k, ONE) for k in (found.kp, found.ki)] == nearest
    assert (found.lo, found.hi) == (-5, 5)
    assert fraction_bits < 24 or found == p


@given(params(), st.lists(st.one_of(edge, running), max_size=40), st.integers(8, 24))
def test_step_of_a_narrow_accumulator_is_the_documented_equation(p, inputs, fraction_bits):
    d = DEFAULT._replace(accumulator_fraction_bits=fraction_bits)
    expected = naive.pi(Fraction(p.kp, ONE), Fraction(p.ki, ONE), p.lo, p.hi, inputs, fraction_bits)
    rows = drive(p, inputs, d=d)
    assert [tuple(row) for row in rows.tolist()] == expected
    for fmt, column in zip(formats(pi.State, d), rows.T, strict=True):
        assert fmt.holds(int(column.min()))
        assert fmt.holds(int(column.max()))


@example(3_037_000_500, 24)
@given(st.integers(-(1 << 33), (1 << 33) - 1), st.integers(8, 24))
def test_an_accumulator_that_would_lose_an_error_of_one_lsb_is_refused(ki, fraction_bits):
    """Told by what its steps do: an error of 1 LSB and one of -1 move acc in opposite directions, or it is refused."""
    d, p = DEFAULT._replace(accumulator_fraction_bits=fraction_bits), pi.Params(0, ki, -(1 << 34), 1 << 34)
    up, down = (int(drive(p, [(1, pi.RUN, e, 0)], d=d)[-1, 1]) for e in (1, -1))
    if ki == 0 or up * down < 0:
        pi.check_accumulator(p, fraction_bits)
    else:
        with pytest.raises(ValueError, match=f"to zero in {fraction_bits} fraction bits; ki must be above"):
            pi.check_accumulator(p, fraction_bits)


@pytest.mark.parametrize("ki", [4609, 7587, 9000, 40_000, 1 << 20])
def test_a_narrow_accumulator_changes_the_gain_of_small_errors_alone(ki):
    """Header of pi: ki of one error is 2/3 to 2 of itself, of many LSB its own; a mean of 0 moves nothing."""
    d, p = DEFAULT._replace(accumulator_fraction_bits=11), pi.Params(0, ki, -(1 << 34), 1 << 34)
    for e in (1, -1, 2, -2, 1000, -1000):
        moved = int(drive(p, [(1, pi.RUN, e, 0)], d=d)[-1, 1]) * 2**13
        assert 2 / 3 < moved / (ki * e) <= 2
        assert abs(moved - ki * e) <= 2**12
    noise = np.random.default_rng(1).permutation(np.repeat(np.arange(-20, 21), 50))
    rows = drive(p, [(1, pi.RUN, int(e), 0) for e in noise], d=d)
    ties = sum(abs(ki * int(e)) % 2**13 == 2**12 for e in noise)
    assert 0 <= rows[-1, 1] <= ties


def test_prop_and_acc_of_fewer_fraction_bits_end_in_zeros():
    p = pi.round_gains(pi.Params(3 << 20, 1 << 21, -(1 << 30), 1 << 30), 8)
    rows = drive(p, [(1, pi.RUN, e, 0) for e in (5, -7, 11, 100003)])
    assert all(value % (1 << 16) == 0 for value in rows[:, :2].ravel())
    assert np.any(rows[:, 1])


def test_header_states_formats_and_latency():
    text = " ".join(pi.__doc__.split())
    for names, fmt in {
        "e": pi.ERR, "kp, ki": pi.PARAMS_FMT.kp, "prop, acc": pi.STATE_FMT.acc, "lo, hi, preset, y": pi.STATE_FMT.y,
    }.items():  # fmt: skip
        assert f"{names} {fmt}" in text
    assert pi.PARAMS_FMT == (pi.COEF, pi.COEF, pi.OUT, pi.OUT)
    assert pi.STATE_FMT == (pi.ACC, pi.ACC, pi.OUT)
    assert f"Latency {pi.LATENCY} clocks" in text
    assert sum(fmt.width for fmt in pi.STATE_FMT) == 156
