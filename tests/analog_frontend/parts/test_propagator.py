"""Tables of the plant tick against the equations in physical units, solved in big integers."""

import hashlib
import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend.numeric.exact import MP
from analog_frontend.parts import device, propagator, resonator, thermal
from tests import naive

GAINS = (9.04e4, 8.97e4)
RINGS = (200e-9, 281e-9)
DPS = 150
FAR = (0, 8, 22, 25)
STATES = 22
# Entries that cancel exactly leave a residue of about 1e-106 of what cancels: 1e5 V/m times 1e-45
RESIDUE = 1e-36


def chain(_device, channel, temp_degc):
    """Stands in for the ring diode: 700 ppm/K of gain, -100 ppm/K of time constant."""
    n = ("drive", "sense").index(channel)
    warm = temp_degc - 25.0
    return GAINS[n] * (1.0 + 7e-4 * warm), RINGS[n] * (1.0 - 1e-4 * warm)


def random_device(seed):
    rng = np.random.default_rng(seed)

    def uniform(lo, hi):
        return float(rng.uniform(lo, hi))

    poles = {f"{c}_pole_{n}_s": 10.0 ** uniform(-8.5, -6.0) for c in ("drive", "sense") for n in (1, 2, 3)}
    return device.make(
        clock_ppm=uniform(-100, 100),
        fx_hz=uniform(9e3, 13e3),
        fy_hz=uniform(9e3, 13e3),
        qx=uniform(1e4, 1e6),
        qy=uniform(1e4, 1e6),
        dxy_ratio=uniform(-0.1, 0.1),
        mass_kg=uniform(1e-7, 4e-7),
        coriolis_mass_kg=uniform(1e-7, 4e-7),
        drive_dac_delay_s=uniform(0, 2.5e-6),
        sense_dac_delay_s=uniform(0, 1.2e-6),
        opamp_gbw_hz=uniform(2e6, 5e7),
        signal_gain=uniform(-10, 10),
        sid_r_ohm=uniform(3e3, 1e5),
        **poles,
    )


DEVICES = [device.make(), random_device(1), random_device(2)]


class Case:
    """One device with its tables and the numbers of its equations."""

    def __init__(self, dev):
        self.device = dev
        self.plant = propagator.build(dev, 25.0, chain)
        with mpmath.workdps(DPS):
            self.numbers = naive.gyro_numbers(dev, GAINS, RINGS)
            self.cycle = self.numbers["tick"] / 26
            # ours = physical / size
            self.size = [mpmath.mpf(1)] * 26
            self.size[7] = self.size[9] = 2 * mpmath.pi * resonator.SCALE_HZ

    def propagation(self, omega, kappa, time):
        """Exact propagation over `time`, from column to row, in the units of the tables."""
        generator = naive.gyro_generator(self.numbers, omega, kappa)
        e = naive.matrix_exponential(generator, time)
        return [[e[i][j] * self.size[j] / self.size[i] for j in range(26)] for i in range(26)]

    def slope(self, propagation, column):
        """Time derivative of one column of `propagation` at no rate and no coupling: generator times column."""
        generator = naive.gyro_generator(self.numbers, mpmath.mpf(0), mpmath.mpf(0))
        physical = [propagation[i][column] * self.size[i] for i in range(26)]
        return [sum(g * p for g, p in zip(row, physical)) / s for row, s in zip(generator, self.size)]

    def instant(self, delay_s, cycle):
        """Ticks and rest of the take-effect time of a code told at `cycle`."""
        time = cycle * self.cycle + mpmath.mpf(delay_s)
        ticks = int(mpmath.floor(time / self.numbers["tick"]))
        return ticks, time - ticks * self.numbers["tick"]


CASES = ("random 1", *(pytest.param(name, marks=pytest.mark.slow) for name in ("default", "random 2")))


@pytest.fixture(scope="module", params=CASES)
def case(request):
    with mpmath.workdps(DPS):
        yield Case(DEVICES[("default", "random 1", "random 2").index(request.param)])


def channels(case):
    plant, dev = case.plant, case.device
    return (
        (22, plant.drive_step, plant.drive_jitter, plant.drive_carry, dev.drive_dac_delay_s),
        (23, plant.sense_step, plant.sense_jitter, plant.sense_carry, dev.sense_dac_delay_s),
    )


def assert_last_bit(actual, exact, where):
    """Within one ulp, or within 1e-22; and the nearest double but for one entry in a thousand (see the count)."""
    error = abs(mpmath.mpf(float(actual)) - exact)
    assert error <= max(mpmath.mpf(math.ulp(float(exact))), mpmath.mpf("1e-22")), (where, float(actual), float(exact))
    return float(actual) == float(exact) or error < RESIDUE


def test_the_oracle_agrees_with_mpmath():
    with mpmath.workdps(60):
        numbers = naive.gyro_numbers(DEVICES[0], GAINS, RINGS)
        generator = naive.gyro_generator(numbers, mpmath.mpf(1), mpmath.mpf("0.01"))
        ours = naive.matrix_exponential(generator, numbers["tick"])
        theirs = mpmath.expm(mpmath.matrix(generator) * numbers["tick"])
        for i in range(26):
            for j in range(26):
                assert abs(ours[i][j] - theirs[i, j]) <= mpmath.mpf("1e-45") * abs(theirs[i, j])


def test_jets_are_the_taylor_coefficients_to_the_last_bit(case):
    d = mpmath.mpf(10) ** -30
    at = {(a, b): case.propagation(a * d, b * d, case.numbers["tick"]) for a, b in
          ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1))}  # fmt: skip
    differences = (
        lambda e: e[0, 0],
        lambda e: (e[1, 0] - e[-1, 0]) / (2 * d),
        lambda e: (e[0, 1] - e[0, -1]) / (2 * d),
        lambda e: (e[1, 0] - 2 * e[0, 0] + e[-1, 0]) / (2 * d * d),
        lambda e: (e[1, 1] - e[1, 0] - e[0, 1] + e[0, 0]) / (d * d),
        lambda e: (e[0, 1] - 2 * e[0, 0] + e[0, -1]) / (2 * d * d),
    )
    inputs = dict(zip((*range(16), 16, 18, 22, 23), (*range(16), 22, 23, 24, 25)))
    nearest = []
    for jet, difference in enumerate(differences):
        for row in range(24):
            for i in range(24):
                actual = case.plant.g_jet[jet, row, i]
                if row not in inputs or i >= STATES:
                    assert actual == 0.0
                    continue
                exact = difference({key: e[i][inputs[row]] for key, e in at.items()})
                nearest.append(assert_last_bit(actual, exact, (jet, row, i)))
    assert np.mean(nearest) > 0.999


def test_step_and_jitter_columns_to_the_last_bit(case):
    nearest = []
    for held, step, jitter, carry, delay_s in channels(case):
        for c in FAR:
            ticks, late = case.instant(delay_s, c)
            assert ticks == carry[c]
            e = case.propagation(mpmath.mpf(0), mpmath.mpf(0), case.numbers["tick"] - late)
            slope = case.slope(e, held)
            for i in range(STATES):
                nearest.append(assert_last_bit(step[0, c, i], e[i][held], (held, c, i)))
                nearest.append(assert_last_bit(jitter[0, c, i], -slope[i], (held, c, i, "jitter")))
        assert not step[:, :, STATES:].any()
        assert not jitter[:, :, STATES:].any()
    assert np.mean(nearest) > 0.999


def tolerance(case, omega, kappa, jets, row, i):
    """Roundings of `combine`, and the third order of the rate and coupling that a jet leaves out.

    The coupling per tick is b = 2 m_c/m |O| h + |K|/(m W) h; third order b^3/6 between modes, times what the input
    makes of the modes and the output of them; 2 covers that the modes are no unit rotation in x, v/W.
    """
    d = case.numbers
    terms = (1.0, omega, kappa, omega * omega, omega * kappa, kappa * kappa)
    rounding = 6 * 2.0**-53 * sum(abs(t * jet[i]) for t, jet in zip(terms, jets)) + 1e-22
    h = float(d["tick"])
    per_force = 1.0 / (float(d["mass_kg"]) * resonator.W_RAD_PER_S)
    b = h * (2.0 * abs(omega) * float(d["coriolis_mass_kg"] / d["mass_kg"]) + abs(kappa) * per_force)
    output = 1.0 if i < 10 else max(GAINS) * abs(float(d["signal_gain"]))
    enters = 1.0 if row < 16 else h * per_force * (1.0 if row >= 22 else 2.72e-7)
    return rounding + 2.0 * b**3 / 6.0 * output * enters


@pytest.mark.parametrize(("omega", "kappa"), [(1.7453, 0.0), (-8.7266, 0.0561), (5.0, -0.02)])
def test_combined_tables_against_the_exponential(case, omega, kappa):
    g = np.zeros((24, 24))
    propagator.combine(case.plant.g_jet, omega, kappa, g)
    e = case.propagation(mpmath.mpf(omega), mpmath.mpf(kappa), case.numbers["tick"])
    for row, held in zip((*range(16), 16, 18, 22, 23), (*range(16), 22, 23, 24, 25)):
        for i in range(STATES):
            limit = tolerance(case, omega, kappa, case.plant.g_jet[:, row], row, i)
            assert abs(e[i][held] - g[row, i]) <= limit, (row, i)
    column = np.zeros(24)
    for held, step, _, _, delay_s in channels(case):
        for c in (3,):
            propagator.combine(np.ascontiguousarray(step[:, c : c + 1]), omega, kappa, column.reshape(1, -1))
            _, late = case.instant(delay_s, c)
            e = case.propagation(mpmath.mpf(omega), mpmath.mpf(kappa), case.numbers["tick"] - late)
            for i in range(STATES):
                limit = tolerance(case, omega, kappa, step[:, c], 16, i)
                assert abs(e[i][held] - column[i]) <= limit, (held, c, i)


@pytest.mark.parametrize("c", [2, 20, 24])
def test_a_step_within_the_tick_is_two_pieces_of_propagation(case, c):
    """State, old value and step through the table equal [0, t_c) with the old and [t_c, h) with the new value."""
    omega, kappa = 0.5, 0.01
    rng = np.random.default_rng(c)
    z = rng.uniform(-1, 1, 16) * ([1.0] * 6 + [5e-6] * 4 + [1.0] * 6)
    u_old, u_new = (float(x) for x in rng.uniform(-10, 10, 2))
    given_ = np.zeros(24)
    given_[:16] = z
    for channel, (held, step, _, _, delay_s) in enumerate(channels(case)):
        g = np.zeros((24, 24))
        propagator.combine(case.plant.g_jet, omega, kappa, g)
        u, du = ((16, 17), (18, 19))[channel]
        propagator.combine(np.ascontiguousarray(step[:, c : c + 1]), omega, kappa, g[du : du + 1])
        vector = given_.copy()
        vector[u], vector[du] = u_old, u_new - u_old
        table = g.T @ vector
        _, late = case.instant(delay_s, c)
        state = [mpmath.mpf(float(x)) for x in (*z, *[0.0] * 10)]
        for time, value in ((late, u_old), (case.numbers["tick"] - late, u_new)):
            state[held] = mpmath.mpf(value)
            e = case.propagation(mpmath.mpf(omega), mpmath.mpf(kappa), time)
            state = [sum(a * b for a, b in zip(row, state)) for row in e]
        for i in range(STATES):
            # 24 products, each rounded with its sum; du and its column have a rounding of their own
            limit = 26 * 2.0**-52 * float(np.abs(g[:, i]) @ np.abs(vector)) + 1e-22
            assert abs(state[i] - table[i]) <= limit, (held, i)


@given(
    delay_s=st.one_of(st.floats(0, 1e-5), st.integers(0, 260).map(lambda n: n / 26e6), st.just(0.0)),
    ppm=st.floats(-1000, 1000),
)
def test_carry_and_rest_in_exact_rationals(delay_s, ppm):
    cycle = 1 / (26_000_000 * (1 + Fraction(ppm) / 10**6))
    with MP.workprec(MP.prec):
        cycle_mp = 1 / (26_000_000 * (1 + MP.mpf(ppm) / 10**6))
        whole, rest, carry = propagator.instants(MP.mpf(delay_s), cycle_mp)
    assert 0 <= rest < cycle_mp
    for c in range(26):
        time = c * cycle + Fraction(delay_s)
        assert carry[c] == time // (26 * cycle)
        assert abs(float((time % (26 * cycle)) - ((c + whole) % 26) * cycle) - float(rest)) < 1e-30


def test_a_delay_beyond_the_tick_is_carried():
    plant = propagator.build(device.make(sense_dac_delay_s=130e-9, drive_dac_delay_s=2.1e-6), 25.0, chain)
    # 130 ns = 3.38 cycles: cycles 23..25 of the tick take effect in the next one
    assert plant.sense_carry.tolist() == [0] * 23 + [1] * 3
    # 2.1 us = 54.6 cycles = 2 ticks and 2.6 cycles
    assert plant.drive_carry.tolist() == [2] * 24 + [3] * 2


def test_without_delay_cycle_zero_is_the_whole_tick():
    plant = propagator.build(device.make(), 25.0, chain)
    assert plant.drive_carry.tolist() == [0] * 26
    # two ways through the double-double arithmetic: six products of whole matrices, and 25 of one column
    assert np.abs(plant.drive_step[:, 0] - plant.g_jet[:, propagator.U_DRIVE]).max() < RESIDUE


def test_combine_is_the_stated_order_in_doubles():
    rng = np.random.default_rng(5)
    jet = rng.standard_normal((6, 26, 24))
    omega, kappa = 1.234, -0.0567
    a = [[[float(x) for x in row] for row in plane] for plane in jet]
    out, column = np.zeros((26, 24)), np.zeros(24)
    propagator.combine(jet, omega, kappa, out)
    for j in range(26):
        propagator.combine(np.ascontiguousarray(jet[:, j : j + 1]), omega, kappa, column.reshape(1, -1))
        for i in range(24):
            quadratic = (kappa * kappa) * a[5][j][i] + (omega * kappa) * a[4][j][i] + (omega * omega) * a[3][j][i]
            assert out[j, i] == a[0][j][i] + (omega * a[1][j][i] + (kappa * a[2][j][i] + quadratic))
        assert (column == out[j]).all()


def test_constants_of_the_default_device():
    plant = propagator.build(device.make(), 25.0, chain)
    assert plant.tick_s == 1e-6
    # 15.45 ns per unit of noise gain at 10.3 MHz
    assert plant.ina_s == pytest.approx(5 / (2 * math.pi * 10.3e6), rel=1e-15)
    assert plant.driver_s == pytest.approx(2 / (2 * math.pi * 10.3e6), rel=1e-15)
    assert plant.sid_rc_s == pytest.approx(1.59e-3, rel=1e-15)
    assert (plant.kxy_n_per_m, plant.drive_gain_v_per_m, plant.sense_ring_s) == (0.0561, GAINS[0], RINGS[1])
    # lag of the C/V output at 11 kHz: the sum of three poles, 308.2 ns = 1.220 deg at 11002.3 Hz
    w = 2 * math.pi * 11002.3
    lag = math.degrees(math.atan(w * RINGS[0]) + math.atan(w * plant.ina_s) + math.atan(w * plant.driver_s))
    assert lag == pytest.approx(1.220, abs=1e-3)


def test_pickoff_is_the_response_to_the_cubic_to_the_last_bit(case):
    """Generator of the chains with the four polynomials of Hermite as further states, by the oracle's exponential."""
    generator = naive.gyro_generator(case.numbers, mpmath.mpf(0), mpmath.mpf(0))
    tick, w = case.numbers["tick"], case.size[7]
    nearest = 0
    for channel, states, mode in ((0, (10, 11, 12, 16, 17, 18), 6), (1, (13, 14, 15, 19, 20, 21), 8)):
        n = len(states)
        a = [[generator[i][j] for j in states] + [generator[i][mode], 0, 0, 0] for i in states]
        a += [[0] * (n + k + 1) + [1 / tick] + [0] * (2 - k) for k in range(3)] + [[0] * (n + 4)]
        e = naive.matrix_exponential(a, tick)
        # 1 - 3 s^2 + 2 s^3 and so on, as values and derivatives at s = 0
        starts = ((1, 0, -6, 12), (0, w * tick, -4 * w * tick, 6 * w * tick), (0, 0, 6, -12))
        for source, start in enumerate((*starts, (0, 0, -2 * w * tick, 6 * w * tick))):
            for out in range(n):
                exact = sum(e[out][n + k] * start[k] for k in range(4))
                nearest += assert_last_bit(case.plant.pickoff[channel, source, out], exact, (channel, source, out))
    assert nearest >= 47


def test_pickoff_of_a_vibration_differs_from_the_exact_tick_in_gain_alone():
    """Against G, which knows the whole plant: 3.2e-8 of gain, (w h)^4/720, and less than 1e-9 rad of phase."""
    plant = propagator.build(device.make(), 25.0, chain)
    g = np.zeros((propagator.INPUTS, propagator.OUTPUTS))
    propagator.combine(plant.g_jet, 0.0, 0.0, g)
    state, cubic, exact, found = np.zeros(24), np.zeros(3), [], []
    state[6] = 5e-6
    for _ in range(4000):
        after = state @ g
        driven = np.array([state[6], state[7], after[6], after[7]]) @ plant.pickoff[0]
        cubic = cubic @ g[10:13, 10:13] + driven[:3]
        exact.append(after[12])
        found.append(cubic[2])
        state[:16] = after[:16]
    exact, found = np.array(exact[300:]), np.array(found[300:])
    radians = 2 * math.pi * device.make().fx_hz * plant.tick_s
    quadrature = np.gradient(exact) / math.sin(radians)
    error = np.linalg.lstsq(np.stack([exact, quadrature], axis=1), found - exact, rcond=None)[0]
    assert error[0] == pytest.approx(-(radians**4) / 720, rel=0.01)
    assert abs(error[1]) < 1e-9


def test_every_machine_builds_the_same_tables():
    plant = propagator.build(device.make(), 31.5, chain)
    digest = hashlib.sha256()
    for values in plant:
        digest.update(np.asarray(values).astype("<f8").tobytes())
    assert digest.hexdigest()[:32] == "6cbbb0cf4ca71a880eedba7cb4869dee"


def test_temperature_moves_the_tables():
    cold, warm = (propagator.build(DEVICES[0], t, chain) for t in (-20.0, 50.0))
    assert cold.kxy_n_per_m < 0.0561 < warm.kxy_n_per_m
    assert warm.drive_gain_v_per_m == GAINS[0] * (1.0 + 7e-4 * 25.0)
    assert warm.ina_s > cold.ina_s
    moved = device.make(**thermal.device_at_temperature(DEVICES[0], 50.0)._asdict())
    same = propagator.build(moved, 25.0, lambda d, c, _t: chain(d, c, 50.0))
    assert (same.g_jet == warm.g_jet).all()


# tables over temperature -------------------------------------------------------------------------------------------


def between(table, temp_degc):
    """The whole plant at a temperature within the knots, linear between two; the counts are those of the lower one."""
    index, weight = propagator.locate(table.temp_lo_degc, table.step_k, table.count, temp_degc)
    after = min(index + 1, table.count - 1)
    return propagator.Plant(
        *(stack[index] + (weight * (stack[after] - stack[index]) if weight else 0) for stack in table.stacks)
    )


@pytest.fixture(scope="module")
def knots():
    return propagator.knots(DEVICES[0], 23.1, 26.2, 0.5, chain)


def test_knots_cover_the_range_and_contain_the_corner(knots):
    assert (knots.temp_lo_degc, knots.step_k, knots.count) == (23.0, 0.5, 8)
    for n in (0, 4):
        plant = propagator.build(DEVICES[0], 23.0 + 0.5 * n, chain)
        at_knot = between(knots, 23.0 + 0.5 * n)
        for name, ours, theirs in zip(plant._fields, at_knot, plant):
            assert np.array_equal(ours, theirs), name


def test_k_xy_is_exact_between_knots(knots):
    for temp in (24.9, 25.2):
        expected = thermal.device_at_temperature(DEVICES[0], temp).kxy_n_per_m
        assert between(knots, temp).kxy_n_per_m == pytest.approx(expected, rel=4 * 2.0**-52)


@pytest.mark.parametrize("temp", [23.25, 24.75, 25.25, 26.1])
def test_interpolation_error_of_the_modes(knots, temp):
    """step^2/8 of the second derivative of e^(A h), at most h |A''| + (h |A'|)^2 and the same for the damping.

    A holds w^2/W: A' = 2 w w'/W, A'' = 2 w'^2/W with w' = w tcf; the damping w/2Q has w/2Q (dlnQ)^2 each way.
    """
    linear, direct = between(knots, temp), propagator.build(DEVICES[0], temp, chain)
    dev, h = DEVICES[0], 1e-6
    w = 2 * math.pi * dev.fx_hz
    slope = w * abs(dev.tcf_per_k)
    damping = w / dev.qx * (abs(dev.dlnq_per_k) + abs(dev.tcf_per_k)) ** 2
    second = h * (2 * slope**2 / resonator.W_RAD_PER_S + damping) + (2 * h * slope) ** 2
    bound = knots.step_k**2 / 8 * second
    error = np.abs(linear.g_jet[0, 6:10, 6:10] - direct.g_jet[0, 6:10, 6:10]).max()
    assert error <= bound + 3 * 2.0**-53
    # in the middle the error comes near it: the bound is no wild guess
    assert error > 0.3 * bound or temp == 26.1


def test_interpolation_changes_damping_and_frequency_as_stated(knots):
    """Chord and Q(T): less than 2e-6 of the damping; w^2 is a parabola in T: (tcf step)^2/8 of the frequency."""
    temp, dev = 24.25, DEVICES[0]
    poles = []
    for plant in (between(knots, temp), propagator.build(dev, temp, chain)):
        with mpmath.workdps(30):
            values, _ = mpmath.eig(mpmath.matrix(plant.g_jet[0, 6:10, 6:10].T.tolist()))
            poles.append(sorted((mpmath.log(v) for v in values), key=lambda p: p.imag))
    for ours, theirs in zip(*poles):
        # rounding: 2^-53 of an entry near 1 beside a damping of 1.7e-7 and an angle of 0.069 per tick
        assert abs(ours.real / theirs.real - 1) < 2e-6
        assert abs(ours.imag / theirs.imag - 1) < 1.01 * (dev.tcf_per_k * knots.step_k) ** 2 / 8 + 1e-15


def test_interpolation_error_of_every_other_entry(knots):
    """Bounded by step^2/8 of the second derivative that direct tables show, with 20 % for its own change."""
    temp, step = 24.25, 0.5
    linear, direct = between(knots, temp), propagator.build(DEVICES[0], temp, chain)
    low, mid, high = (propagator.build(DEVICES[0], temp + n * step, chain) for n in (-1, 0, 1))
    for name in ("g_jet", "drive_step", "sense_step", "drive_jitter", "sense_jitter"):
        a, b, c = (getattr(p, name) for p in (low, mid, high))
        second = np.abs(a - 2 * b + c)
        rounding = 8 * 2.0**-53 * np.maximum(np.abs(a), np.abs(c)) + RESIDUE
        assert (np.abs(getattr(linear, name) - getattr(direct, name)) <= 1.2 * second / 8 + rounding).all(), name


def test_locate_stays_inside_the_stack():
    assert propagator.locate(20.0, 0.5, 5, 20.0) == (0, 0.0)
    assert propagator.locate(20.0, 0.5, 5, 20.75) == (1, 0.5)
    assert propagator.locate(20.0, 0.5, 5, 22.0) == (3, 1.0)
    assert propagator.locate(20.0, 0.5, 1, 20.0) == (0, 0.0)


@pytest.mark.parametrize(
    ("args", "text"),
    [((20.0, 30.0, 0.0), "step_k"), ((30.0, 20.0, 0.5), "temp_hi_degc"), ((-80.0, 20.0, 0.5), "temp_degc")],
)
def test_knots_refuse_what_makes_no_sense(args, text):
    with pytest.raises(ValueError, match=text):
        propagator.knots(DEVICES[0], *args, chain)


def test_one_temperature_is_one_knot():
    table = propagator.knots(DEVICES[0], 31.3, 31.3, chain=chain)
    direct = propagator.build(DEVICES[0], 31.3, chain)
    assert (table.count, table.stacks.g_jet.shape) == (1, (1, 6, 24, 24))
    for ours, theirs in zip(between(table, 31.3), direct):
        assert np.array_equal(ours, theirs)


@pytest.mark.parametrize("on", [0, 1])
def test_the_ring_diode_is_asked_with_the_device(on):
    """Gain and pole of each channel reach the tables; the carrier's error and the switch of its law count."""
    from analog_frontend.parts import ring_diode

    dev = device.make(diode_tc_on=on, dcdy_f_per_m=2e-7, carrier_ppm=500.0, carrier_v=6.0, cref_sense_f=50e-12)
    plant = propagator.build(dev, 40.0)
    at = 40.0 if on else 25.0
    for cref, slope, gain, pole in (
        (32e-12, 1e-7, plant.drive_gain_v_per_m, plant.drive_ring_s),
        (50e-12, 2e-7, plant.sense_gain_v_per_m, plant.sense_ring_s),
    ):
        ring = ring_diode.diode_ring(6.0, 8e6 * (1.0 + 500.0 * 1e-6), 2e-12, 3e-12, cref, ring_diode.HSMS_282X, at)
        assert gain == pytest.approx(ring.gain_v_per_f * slope, rel=1e-15)
        assert pole == pytest.approx(ring.tau_s, rel=1e-15)
    assert plant.ina_s == pytest.approx(5 / (2 * math.pi * 10.3e6 * (1 - 0.002 * 15.0)), rel=1e-15)
