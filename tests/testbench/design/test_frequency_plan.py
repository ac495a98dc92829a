"""The frequency plan against edges, tones and samples counted one by one."""

import itertools
import math
import re
from collections import deque

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from analog_frontend.parts.device import Device
from fpga_model.design_record import DEFAULT
from testbench.config import Config
from testbench.design import drive_loops, frequency_plan


def lateness_deg(f_hz, seconds, start=0.0):
    """Mean lateness (deg, less half a tick) of edges of both slopes that leave at the next tick."""
    at = (np.arange(int(2 * f_hz * seconds)) + start) / (2 * f_hz) * DEFAULT.tick_hz
    return float(np.mean(np.ceil(at) - at) - 0.5) * 360 * f_hz / DEFAULT.tick_hz


@given(st.floats(3000, 20000), st.floats(0, 1))
@example(11750.0, 0.0)
def test_no_mean_of_edges_is_further_off(f_hz, start):
    # a ratio of more places than the plan looks at wanders by half of one such place at most
    beyond = 180 * f_hz / DEFAULT.tick_hz / (frequency_plan.MOST_EDGE_PHASES + 1)
    assert abs(lateness_deg(f_hz, 0.25, start)) <= frequency_plan.slide_deg(f_hz, 0.25) + beyond


@pytest.mark.parametrize(("f_hz", "places"), [(11000.0, 11), (12500.0, 1), (10000.0, 1), (15000.0, 3)])
def test_at_an_exact_ratio_edges_stand_still(f_hz, places):
    slow = frequency_plan.slides(f_hz)[0]
    assert (slow.phase_count, slow.beat_hz) == (places, 0.0)
    seen = [lateness_deg(f_hz, 0.1, s) for s in np.linspace(0, 1, 400)]
    assert np.ptp(seen) == pytest.approx(slow.wander_deg, rel=0.03)


PULLED = [  # f (Hz), ticks a second, crossover (Hz), SID's corner (Hz), f/2Q (Hz)
    (10994.26232, 2e6, 3.0, 48.1, 0.0281),
    (3910.32144, 1e6, 3.0, 52.4, 0.526),
    (3936.98333, 1e6, 3.0, 55.1, 0.495),
    (12499.975, 1e6, 0.6, 11.0, 0.087),
    (11000.006, 1e6, 3.0, 50.0, 0.05),
]
DELAY_S = 3.6 / 8000


def dwelling(f_hz, tick_hz, crossover_hz, corner_hz, half_width_hz, seconds):
    """Lateness (deg, less half a tick) of edges that leave at the next tick, of a frequency that follows them.

    Edge by edge: phase of the resonator, three poles, PI (zero at a fifth of its crossover), delay.
    """
    step_s, kp = 0.5 / f_hz, 2 * math.pi * crossover_hz
    pole, ki = -math.expm1(-2 * math.pi * corner_hz * step_s), kp * 2 * math.pi * crossover_hz / 5 * step_s
    waiting = deque([0.0] * round(DELAY_S / step_s))
    at, lead, acc, one, two, three, late = 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, []
    for _ in range(int(seconds / step_s)):
        late.append(math.ceil(at) - at - 0.5)
        one += pole * (lead + late[-1] * f_hz / tick_hz - one)
        two += pole * (one - two)
        three += pole * (two - three)
        acc += ki * three
        waiting.append(kp * three + acc)
        off_hz = waiting.popleft()
        at += tick_hz / (2 * (f_hz + off_hz))
        lead -= step_s * (off_hz + 2 * math.pi * half_width_hz * lead)
    return np.array(late) * 360 * f_hz / tick_hz


def bounds(f_hz, tick_hz, crossover_hz, corner_hz, half_width_hz, seconds):
    """`slide_deg` of a frequency word that stands still, and of one that its loop moves."""
    d = DEFAULT._replace(tick_clocks=round(26e6 / tick_hz), frame_ticks=round(tick_hz / 8000))
    loop = drive_loops.DriveLoop(crossover_hz, crossover_hz / 5, corner_hz, half_width_hz, d.frame_hz)
    return frequency_plan.slide_deg(f_hz, seconds, d), frequency_plan.slide_deg(f_hz, seconds, d, loop)


def worst_mean(late, weights):
    """Largest distance from 0 of a weighted mean, wherever it begins."""
    return float(np.abs(np.convolve(late, weights / weights.sum(), "valid")).max())


def hann(n):
    return np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2


@pytest.mark.parametrize("board", PULLED)
def test_a_loop_that_follows_its_edges_makes_them_dwell_as_far_as_the_bound_says(board):
    """Means of 0.3 s, even ones and the phase meter's, are beyond the bound of a word that stands still."""
    late = dwelling(*board, 12.0)[int(6 * board[0]) :]
    length = int(0.3 * 2 * board[0])
    still, moved = bounds(*board, 0.3)
    assert still < worst_mean(late, np.ones(length)) <= moved
    assert worst_mean(late, hann(length)) <= moved
    # the map goes by half periods: two of them, 0.26 ms, turn a beat of 7 Hz by 0.7 deg, and its mean by 1 to 2 %
    in_the_long_run = float(np.average(late, weights=hann(len(late))))
    assert abs(in_the_long_run) == pytest.approx(bounds(*board, math.inf)[1], rel=0.02)


@settings(max_examples=12)
@given(
    st.sampled_from([(12500.0, 40), (11000.0, 500), (15000.0, 100)]),
    st.floats(-25, 25),
    st.floats(1, 5),
    st.floats(0.01, 1),
)
@example((12500.0, 40), 0.0, 3.0, 0.5)  # edges lock on the grid
@example((12500.0, 40), 2.5, 3.0, 0.5)  # they fall to and fro
def test_no_mean_that_a_loop_makes_is_further_off(ratio, beat_hz, crossover_hz, half_width_hz):
    exact_hz, p = ratio
    board = (exact_hz + beat_hz / (2 * p), 1e6, crossover_hz, crossover_hz / 0.06, half_width_hz)
    late = dwelling(*board, 3.0)[int(2 * board[0]) :]
    beyond = 180 * board[0] / DEFAULT.tick_hz / (frequency_plan.MOST_EDGE_PHASES + 1)
    assert worst_mean(late, np.ones(int(0.3 * 2 * board[0]))) <= bounds(*board, 0.3)[1] + beyond


def test_far_from_ratios_no_loop_moves_the_bound():
    """At 11002 Hz the slowest beat is 364 Hz."""
    still, moved = bounds(11002.0, 1e6, 3.0, 50.0, 0.05, 0.3)
    assert still < moved == pytest.approx(still, rel=0.01)


def test_near_a_ratio_a_coarse_word_takes_them_there():
    """Words of 32 bits on either side of f: one of them is nearer to the exact ratio than the other is to f."""
    d = DEFAULT._replace(dds_bits=32)
    step_hz = d.master_hz / 2**32
    assert frequency_plan.slides(12500.0 + 0.9 * step_hz, d)[0].beat_hz == 0.0
    fine = frequency_plan.slides(12500.0 + 2.5 * step_hz)[0].beat_hz
    assert frequency_plan.slides(12500.0 + 2.5 * step_hz, d)[0].beat_hz == pytest.approx(0.6 * fine, rel=1e-4)


def test_near_a_ratio_they_wander_with_the_beat():
    f_hz = 12500.0 + 0.02
    slow = frequency_plan.slides(f_hz)[0]
    at = np.arange(int(2 * f_hz * 4 / slow.beat_hz)) / (2 * f_hz) * DEFAULT.tick_hz
    late = np.ceil(at) - at
    jumps = np.count_nonzero(np.abs(np.diff(late)) > 0.5)
    assert jumps == pytest.approx(4, abs=1)  # one fall of the sawtooth to a beat


@given(st.floats(10, 60000), st.sampled_from([4000.0, 8000.0]))
def test_an_alias_is_where_samples_show_it(f_hz, rate_hz):
    seen = frequency_plan.alias_hz(f_hz, rate_hz)
    n = np.arange(50)
    assert np.allclose(np.cos(2 * math.pi * f_hz / rate_hz * n), np.cos(2 * math.pi * seen / rate_hz * n), atol=1e-6)
    assert 0 <= seen <= rate_hz / 2


def test_ripple_is_what_three_poles_and_three_sums_leave():
    d = Device()
    f_hz, fine = 700.0, 1 << 16
    t = np.arange(64 * 64) / d.adc_modulator_hz
    box = np.ones(64) / 64
    tone = np.exp(2j * math.pi * f_hz * t)
    for _ in range(3):
        tone = np.convolve(tone, box, "valid")
    poles = 1 / abs(1 + 2j * math.pi * f_hz * 2 * d.sid_r_ohm * d.sid_c_f) ** 3
    assert frequency_plan.ripple_db(f_hz, d) == pytest.approx(20 * math.log10(abs(tone[fine % 64]) * poles), abs=1e-6)


def line(found, word):
    return next(m for m in found if word in m.what)


def test_what_the_plan_minds():
    good = frequency_plan.plan(Device(), 25.0, 0.005)
    assert all(m.is_satisfied for m in good)
    edges = line(frequency_plan.plan(Device(fx_hz=12500.01), 25.0), "edges")
    assert not edges.is_satisfied
    assert edges.remedy == "if 12500.01 Hz is only nominal, state the measured frequency, such as 12503.7 Hz"
    assert line(frequency_plan.plan(Device(fx_hz=12503.7), 25.0), "edges").is_satisfied
    assert not line(frequency_plan.plan(Device(carrier_ppm=0.5), 25.0), "carrier").is_satisfied
    coarse = DEFAULT._replace(dds_bits=28)
    assert not line(frequency_plan.plan(Device(), 25.0, design=coarse), "DDS").is_satisfied
    # a fast demodulator lets its ripple through; at a multiple of the frames' rate sinc3 has a zero
    fast = Device(fx_hz=8500.0, sid_c_f=1e-9)
    assert not line(frequency_plan.plan(fast, 600.0), "1 f").is_satisfied
    assert line(frequency_plan.plan(fast, 25.0), "1 f").is_satisfied
    slow = line(frequency_plan.plan(Device(fx_hz=8001.0), 25.0), "1 f")
    assert slow.is_satisfied
    assert slow.distance_hz == 1.0


def test_the_plan_says_where_the_loop_leaves_the_edges():
    """The line has the mean beside the wander; a word that stands still leaves none."""
    loop, near = drive_loops.frequency_loop(Config()), Device(fx_hz=12499.9)
    assert loop.half_width_hz == pytest.approx(near.fx_hz / (2 * near.qx), rel=0.2)
    still, moved = (line(frequency_plan.plan(near, 25.0, loop=one), "edges").effect for one in (None, loop))
    assert still.endswith("their mean is wrong by up to 0.000 deg")
    off_deg = float(re.search(r"wrong by up to (\S+) deg", moved)[1])
    late = dwelling(near.fx_hz, 1e6, 3.0, loop.corner_hz, loop.half_width_hz, 12.0)[6 * 12500 :]
    known = float(re.search(r"1 s is known to (\S+) uHz", moved)[1])
    assert known == pytest.approx(1e6 * frequency_plan.word_hz(near.fx_hz, 1.0, loop), abs=0.5)
    assert off_deg == pytest.approx(float(np.average(late, weights=hann(len(late)))), rel=0.02)


@pytest.mark.parametrize("f_hz", [3925.29, 11002.3, 10981.5])
def test_within_the_gap_no_edge_of_the_loops_memory_moves(f_hz):
    """Theta turned in small steps: the longest way on which every edge keeps its tick."""
    loop = drive_loops.frequency_loop(Config())._replace(crossover_hz=30.0)
    k = np.arange(int(2 * f_hz / (2 * math.pi * 30.0)))
    steps = 40_000
    ticks = [np.ceil(k * DEFAULT.tick_hz / (2 * f_hz) + turned / steps) for turned in range(2 * steps)]
    moved = np.flatnonzero([not np.array_equal(one, other) for one, other in itertools.pairwise(ticks)])
    longest = np.diff(moved).max() / steps * f_hz / DEFAULT.tick_hz
    assert frequency_plan.gap_turns(f_hz, loop) == pytest.approx(longest, abs=f_hz / DEFAULT.tick_hz / steps * 1.01)


def test_no_wander_within_the_gap_leaves_more_of_a_mean_word():
    """The worst of all is a step in the middle, and the bound is its mean."""
    loop, f_hz, n = drive_loops.frequency_loop(Config()), 11002.3, 4000
    gap, weights = frequency_plan.gap_turns(f_hz, loop), hann(n) / hann(n).sum()
    rng = np.random.default_rng(1)
    worst = np.where(np.arange(n + 1) <= n // 2, -gap / 2, gap / 2)
    walks = [worst, *(gap * (rng.random(n + 1) - 0.5) for _ in range(50)), gap / 2 * np.sin(np.arange(n + 1) / 300)]
    means = [abs(weights @ np.diff(theta)) * n / 0.5 for theta in walks]
    assert max(means) == means[0] == pytest.approx(frequency_plan.word_hz(f_hz, 0.5, loop), rel=1e-3)


def test_rates_are_those_of_the_design():
    other = DEFAULT._replace(master_hz=24_000_000, tick_clocks=24)
    assert frequency_plan.slides(12500.0, other)[0].beat_hz == 0.0
    half = DEFAULT._replace(tick_clocks=13, frame_ticks=250)
    assert frequency_plan.slides(12500.0, half)[0].wander_deg == pytest.approx(2.25)
