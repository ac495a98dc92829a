"""The converter against boxcars, closed forms and exact integer time."""

import math
from fractions import Fraction

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analog_frontend.parts import adc, noise
from fpga_model.jit import kernel

CYCLE_S = 1 / 26e6
MODULATOR_HZ = 512e3
FRAME_S = 125e-6


@kernel
def play(p, s, at_start, at_end, codes, ready):
    """Feed one chord per tick to four channels, its start to the sensor's; codes and edge number per fall of DRDY."""
    out = np.zeros(8)
    row = 0
    for k in range(at_start.size):
        out[:4], out[4:] = at_start[k], at_end[k]
        clock = adc.convert_block(p, s.clock, s.sums, out, 1, at_start[k])
        if clock >= 0:
            ready[row] = 26 * k + clock
            for c in range(5):
                codes[row, c] = s.clock[adc.CODES + c]
            row += 1
    return row


def run_chords(p, at_start, at_end, first_cycles=0.0):
    """(codes, edge numbers) of every conversion that became ready."""
    rows = len(at_start) // 25 + 2
    codes, ready = np.zeros((rows, 5), np.int64), np.zeros(rows, np.int64)
    count = play(
        p, adc.reset(p, first_cycles), np.ascontiguousarray(at_start), np.ascontiguousarray(at_end), codes, ready
    )
    return codes[:count], ready[:count]


def run(p, volts, first_cycles=0.0):
    return run_chords(p, np.asarray(volts)[:-1], np.asarray(volts)[1:], first_cycles)


# filter -------------------------------------------------------------------------------------------------------------


def sinc3(f, n=64):
    return abs(math.sin(n * math.pi * f / MODULATOR_HZ) / (n * math.sin(math.pi * f / MODULATOR_HZ))) ** 3


def response(f, decimation=64):
    """Gain and delay of a tone from the input to the codes, by least squares at the alias the codes show.

    The tick that holds a modulator instant gets the tone's value at that very instant, so no chord is in the way.
    """
    p = adc.design(step_code=1, decimation=decimation, pga=(1,) * 5)
    instants = np.arange(64 * 400) / MODULATOR_HZ
    volts = np.zeros(400 * 125 + 3)
    volts[np.floor(instants * 1e6 + 1e-6).astype(int)] = 3.9 * np.sin(2 * np.pi * f * instants)
    codes, _ = run_chords(p, volts, volts)
    y = codes[4:, 0] * 4.0 / 2**23 / 3.9
    last = instants[decimation - 1 :: decimation][4 : 4 + len(y)]
    basis = np.stack([np.sin(2 * np.pi * f * last), np.cos(2 * np.pi * f * last)], axis=1)
    a, b = np.linalg.lstsq(basis, y, rcond=None)[0]
    return math.hypot(a, b), -math.atan2(b, a) / (2 * np.pi * f)


@pytest.mark.parametrize("f", [30.3, 139.0, 1003.0, 2092.0, 3207.0])
def test_gain_and_delay_are_those_of_sinc3(f):
    gain, delay = response(f)
    # codes are 1.2e-7 of the tone apart
    assert gain == pytest.approx(sinc3(f), abs=1e-7)
    assert delay % (1 / f) == pytest.approx(3 * 63 / (2 * MODULATOR_HZ), abs=1e-9)
    assert delay % (1 / f) == pytest.approx(184.57e-6, abs=0.01e-6)


def test_minus_three_decibels_at_2092_hz():
    assert 20 * math.log10(response(2092.0)[0]) == pytest.approx(-3.01, abs=0.02)


@pytest.mark.parametrize(("f", "decibels"), [(11000.3, -40.2), (22000.7, -65.1)])
def test_carrier_and_its_double_alias_as_sinc3_says(f, decibels):
    gain, delay = response(f)
    assert gain == pytest.approx(sinc3(f), abs=1e-7)
    assert 20 * math.log10(gain) == pytest.approx(decibels, abs=0.1)
    turns = (delay - 3 * 63 / (2 * MODULATOR_HZ)) * f
    assert abs(turns - round(2 * turns) / 2) < 1e-3


@pytest.mark.parametrize("decimation", [16, 64, 128])
def test_codes_are_three_boxcars_of_the_input(decimation):
    rng = np.random.default_rng(3)
    volts = rng.uniform(-3.0, 3.0, 2000)
    first, ppm = 17.3, 113.0
    p = adc.design(decimation=decimation, period=adc.modulator_period(ppm), conversion_delay_s=1.5e-6)
    codes, ready = run(p, volts, first)
    period_s = 1 / (MODULATOR_HZ * (1 + ppm * 1e-6))
    instants = first * CYCLE_S + period_s * np.arange(int(1999e-6 / period_s) - 1)
    samples = np.interp(instants, np.arange(2000) * 1e-6, volts)
    box = np.ones(decimation)
    # the sensor's voltage is one number per tick, the others are chords
    held = volts[np.floor(instants / 1e-6).astype(int)]
    for c, gain in enumerate((1, 1, 12, 12, 1)):
        seen = held if c == adc.TEMPERATURE else samples
        filtered = np.convolve(np.convolve(np.convolve(seen, box), box), box) / decimation**3
        x = filtered[decimation - 1 : len(samples) : decimation] * gain * 2**23 / 40
        want = np.clip(10 * np.floor(x + 0.5), -(2**23), 2**23 - 1)
        got = codes[:, c]
        away = np.abs(x - np.floor(x) - 0.5)[: len(got)]
        assert len(got) >= len(samples) // decimation - 1
        assert (got == want[: len(got)])[away > 1e-6].all()
    expected = instants[decimation - 1 :: decimation][: len(ready)] / CYCLE_S + 39
    assert (ready == np.ceil(expected - 1e-6)).all()


def test_a_step_settles_in_three_frames():
    codes, _ = run(adc.design(step_code=1, pga=(1,) * 5), np.full(1000, 1.0))
    assert codes[2:, 0].tolist() == [2**21] * len(codes[2:])
    assert 0 < codes[0, 0] < codes[1, 0] < 2**21


# codes --------------------------------------------------------------------------------------------------------------


@given(st.floats(-5.0, 5.0), st.sampled_from([1, 10, 80]), st.sampled_from([1, 6, 12]))
def test_codes_round_to_the_nearest_step_and_clamp(volts, step_code, pga):
    p = adc.design(step_code=step_code, pga=(pga,) * 5)
    exact = Fraction(volts) * pga * 2**23 / 4
    got = adc.code(p, 1, volts)
    if exact >= 2**23:
        assert got == 2**23 - 1
    elif exact <= -(2**23):
        assert got == -(2**23)
    else:
        assert got in (2**23 - 1, -(2**23)) or got % step_code == 0
        # half a step, and the rounding of one product; the clamp to 2^23 - 1 takes up to one code more
        clamped = 1 if got == 2**23 - 1 else 0
        assert abs(got - exact) <= Fraction(step_code, 2) + clamped + Fraction(1, 10**6)


@given(st.integers(16, 24), st.floats(-4.5, 4.5))
def test_codes_of_a_narrower_converter_are_left_justified(bits, volts):
    step = 2 ** (24 - bits)
    p = adc.design(step_code=step, code_hi=2**23 - step, pga=(1,) * 5)
    got = adc.code(p, 0, volts)
    nearest = math.floor(Fraction(volts) / 4 * 2 ** (bits - 1) + Fraction(1, 2))
    lo, hi = -(2 ** (bits - 1)), 2 ** (bits - 1) - 1
    assert got == step * min(max(nearest, lo), hi)


def test_ties_go_up():
    p = adc.design(step_code=8, pga=(1,) * 5, vref_v=4.0)
    lsb = 4.0 / 2**23
    assert [adc.code(p, 0, k * lsb) for k in (-12, -4, 4, 12, 20)] == [-8, 0, 8, 16, 24]


def test_what_is_no_number_reads_as_full_scale():
    p = adc.design()
    assert adc.code(p, 0, math.nan) == 0x7FFFFF
    assert adc.code(p, 0, math.inf) == 0x7FFFFF
    assert adc.code(p, 0, -math.inf) == -0x800000
    assert adc.code(p, 0, 1e300) == 0x7FFFFF
    assert adc.code(p, 0, 3.9999999) == 0x7FFFFF
    assert adc.code(p, 0, -3.9999999) == -0x800000
    assert adc.code(p, 0, 3.9999) == 8388400


def test_an_overload_is_forgotten_after_three_frames():
    volts = np.full(1200, 1.0)
    volts[200] = math.nan
    codes, _ = run(adc.design(), volts)
    # the two chords that touch the sample at 200 us spoil frame 1, which lives in three conversions
    assert codes[1:4, 0].tolist() == [0x7FFFFF] * 3
    assert codes[4:, 0].tolist() == [2097150] * len(codes[4:])


def test_offset_gain_and_bend():
    p = adc.design(step_code=1, offset_v=(1e-3, 0, 0, 0, 0), gain_error=(0, 1e-3, 0, 0, 0), inl=(0, 0, 8e-6, 0, 0))
    plain = adc.design(step_code=1)
    assert adc.code(p, 0, 1.0) - adc.code(plain, 0, 1.0) == round(1e-3 * 2**21)
    assert adc.code(p, 1, 1.0) - adc.code(plain, 1, 1.0) == round(1e-3 * 2**21)
    assert adc.code(p, 2, 0.0) == 0
    u = 1 / math.sqrt(3)
    bend = adc.code(p, 2, u * 4 / 12) - adc.code(plain, 2, u * 4 / 12)
    assert bend == pytest.approx(-8e-6 * 2 / (3 * math.sqrt(3)) * 2**23, abs=1)


def test_noise_has_its_rms_and_its_own_stream_per_channel():
    rms = 12.4e-6
    p = adc.design(seed=5, step_code=1, pga=(1,) * 5, noise_v=(rms,) * 4 + (0.0,))
    codes, _ = run(p, np.zeros(125 * 4000))
    volts = codes * 4.0 / 2**23
    assert (codes[:, 4] == 0).all()
    lsb = 4.0 / 2**23
    want = math.sqrt(rms**2 + lsb**2 / 12)
    # four sigma of a variance estimate
    assert volts[:, :4].std(axis=0) == pytest.approx(np.full(4, want), rel=4 / math.sqrt(2 * len(codes)))
    assert np.abs(np.corrcoef(volts[:, :4].T) - np.eye(4)).max() < 4.5 / math.sqrt(len(codes))


def test_flicker_goes_in_before_the_gain():
    p = adc.design(seed=5, step_code=1, flicker_v_per_rthz=(1e-3,) * 5)
    codes, _ = run(p, np.zeros(125 * 50))
    f = noise.flicker(5, "flicker_2", 1e-3)
    state = noise.flicker_reset(f)
    want = [math.floor(noise.flicker_step(f, state, k) * 12 * 2**21 + 0.5) for k in range(len(codes))]
    assert codes[:, 2].tolist() == np.clip(want, -(2**23), 2**23 - 1).tolist()


# time ---------------------------------------------------------------------------------------------------------------


@kernel
def falls(p, s, ticks, ready):
    out = np.zeros(8)
    row = 0
    for k in range(ticks):
        clock = adc.convert_block(p, s.clock, s.sums, out, 1, 0.0)
        if clock >= 0:
            if row < ready.size:
                ready[row] = 26 * k + clock
            row += 1
    return row


@pytest.mark.parametrize("ppm", [0.0, 37.0, -20000.0])
def test_data_ready_keeps_exact_time_over_many_frames(ppm):
    frames = 1000 if numba.config.DISABLE_JIT else 100000
    period = adc.modulator_period(ppm)
    p = adc.design(period=period)
    ready = np.zeros(frames, np.int64)
    count = falls(p, adc.reset(p, 3.25), int((frames + 2) * 125 / (1 + ppm * 1e-6)) + 5, ready)
    assert count >= frames
    units = [round(3.25 * 2**32) + (64 * k + 63) * period + 39 * 2**32 for k in range(frames)]
    assert ready.tolist() == [-(-u // 2**32) for u in units]
    if ppm == 0.0:
        assert set(np.diff(ready)) == {3250}
    else:
        drift = (ready[-1] - ready[0]) / (3250 * (frames - 1)) - 1
        assert drift == pytest.approx(1 / (1 + ppm * 1e-6) - 1, abs=1e-6)


@given(st.floats(0.0, 50.0), st.floats(26.0, 300.0))
def test_data_ready_may_fall_at_any_clock_of_a_later_tick(first, delay_cycles):
    p = adc.design(conversion_delay_s=delay_cycles / 26e6 + 1e-15, decimation=16)
    ready = np.zeros(3, np.int64)
    falls(p, adc.reset(p, first), 150, ready)
    unit = [round(Fraction(first) * 2**32) + (16 * k + 15) * p.period + p.delay for k in range(3)]
    assert ready.tolist() == [-(-u // 2**32) for u in unit]


def test_synchronous_period_is_exact():
    assert adc.modulator_period() == adc.SYNCHRONOUS_PERIOD == 1625 * 2**27


def test_sensor_is_145_millivolts_at_room():
    assert adc.temperature_volts(25.0) == pytest.approx(0.1453)
    assert adc.temperature_volts(35.0) - adc.temperature_volts(25.0) == pytest.approx(4.9e-3)


def test_impossible_converters_are_refused():
    for bad, word in (
        ({"pga": (5, 1, 1, 1, 1)}, "pga"),
        ({"noise_v": (0.0,)}, "noise_v"),
        ({"conversion_delay_s": 0.9e-6}, "conversion_delay_s"),
        ({"period": 20 << 32}, "period"),
        ({"decimation": 8}, "decimation"),
        ({"step_code": 0}, "step_code"),
    ):
        with pytest.raises(ValueError, match=word):
            adc.design(**bad)
    with pytest.raises(ValueError, match="first_cycles"):
        adc.reset(adc.design(), 60.0)


@kernel
def play_blocks(p, s, out, cuts, codes, ready):
    """The same voltages in blocks of `cuts` ticks."""
    row, tick = 0, 0
    for n in cuts:
        before = adc.clocks_to_ready(p, s.clock, 0)
        clock = adc.convert_block(p, s.clock, s.sums, out[4 * tick :], n, 0.1)
        if clock >= 0:
            if clock != before:
                return -1
            ready[row] = 26 * tick + clock
            for c in range(5):
                codes[row, c] = s.clock[adc.CODES + c]
            row += 1
        tick += n
    return row


@pytest.mark.parametrize("ppm", [0.0, 3500.0, -20000.0])
def test_blocks_change_nothing_and_the_next_fall_is_foretold(ppm):
    p = adc.design(seed=2, period=adc.modulator_period(ppm), noise_v=(1e-5,) * 5, flicker_v_per_rthz=(1e-7,) * 5)
    rng = np.random.default_rng(3)
    out = rng.uniform(-0.3, 0.3, 4 * 4001)
    results = []
    for cuts in (np.ones(4000, np.int64), np.array([125, 1, 99, 124, 51] * 10), np.full(40, 100)):
        s = adc.reset(p, 1.5)
        codes, ready = np.zeros((40, 5), np.int64), np.zeros(40, np.int64)
        count = play_blocks(p, s, out, cuts, codes, ready)
        results.append((count, codes.tolist(), ready.tolist(), s.clock.tolist(), s.sums.tolist()))
    assert results[0] == results[1] == results[2]
    assert results[0][0] >= 31
