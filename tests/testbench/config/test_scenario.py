"""Scenario: profiles against exact interpolation, events in order, every mistake refused with its place."""

import itertools
import math
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbench import config
from testbench.config import scenario
from testbench.config.scenario import FAULT_OFF, FAULT_ON, WRITE, Event, Problem
from tests import naive


def made(**values):
    return config.changed(config.load(), {f"scenario.{key}": value for key, value in values.items()}).scenario


times = st.integers(0, 40).map(lambda k: k / 16)
values = st.integers(-100, 100).map(lambda k: k / 4)
profiles = st.lists(st.tuples(times, values), min_size=1, max_size=6).map(lambda rows: sorted(rows, key=lambda r: r[0]))


@given(profiles, st.booleans())
def test_a_profile_is_the_exact_interpolation_at_the_middle_of_each_frame(points, steps):
    if any(points[k][0] == points[k + 2][0] for k in range(len(points) - 2)):
        return
    timeline = scenario.expand(made(rate_dps=points, seconds=0.5, rate_shape="steps" if steps else "linear"))
    assert timeline.frames == 4000
    for frame in (0, 1, 499, 500, 2000, 3999):
        exact = naive.profile_at(points, (Fraction(frame) + Fraction(1, 2)) / 8000, steps)
        assert timeline.rate_rad_s.frame_values(frame)[0] == pytest.approx(math.radians(exact), rel=1e-12, abs=1e-12)
    assert timeline.rate_before_rad_s == math.radians(points[0][1])


@given(profiles, st.lists(times, min_size=1), st.booleans())
def test_a_profile_at_its_own_points(points, when, steps):
    values_at = scenario.sample(points, np.array(when), steps)
    # at the very instant of a jump a line has two values
    jumps = {a[0] for a, b in itertools.pairwise(points) if a[0] == b[0]}
    for t_s, value in zip(when, values_at):
        if steps or t_s not in jumps:
            assert value == pytest.approx(float(naive.profile_at(points, Fraction(t_s), steps)), abs=1e-12)


def test_a_jump_falls_between_two_frames():
    timeline = scenario.expand(made(rate_dps=[[0, 0], [0.1, 0], [0.1, 100]], seconds=0.2))
    assert np.all(timeline.rate_rad_s.frame_values(0, 800) == 0)
    assert np.all(timeline.rate_rad_s.frame_values(800, 800) == math.radians(100))


def test_a_constant_is_held_and_temperature_stays_in_degc():
    timeline = scenario.expand(made(rate_dps=-30, temperature_degc=[[0, 20], [1, 30]], seconds=1.0))
    assert np.all(timeline.rate_rad_s.frame_values(0, 8000) == math.radians(-30))
    assert timeline.temp_degc.frame_values(0)[0] == pytest.approx(20 + 10 * 0.5 / 8000)
    assert timeline.temp_before_degc == 20


@given(profiles, st.booleans(), st.integers(1, 30_000))
def test_limits_are_those_of_all_frames(points, steps, milliseconds):
    if any(points[k][0] == points[k + 2][0] for k in range(len(points) - 2)):
        return
    shape = "steps" if steps else "linear"
    profile = scenario.expand(made(rate_dps=points, seconds=milliseconds / 1000, rate_shape=shape)).rate_rad_s
    values = profile.frame_values(0, profile.frames)
    assert profile.limits() == (values.min(), values.max())


def test_parts_of_a_profile_are_those_of_the_whole():
    profile = scenario.expand(made(rate_dps=[[0, -3], [0.3, 70], [0.31, 0.1]], seconds=0.4)).rate_rad_s
    whole = profile.frame_values(0, 3200)
    assert np.array_equal(np.concatenate([profile.frame_values(k, 100) for k in range(0, 3200, 100)]), whole)
    assert profile.frame_values(-5, 5).tolist() == [whole[0]] * 5
    assert profile.frame_values(3200, 5).tolist() == [whole[-1]] * 5


def test_a_broken_frame_counts_as_one():
    timeline = scenario.expand(made(seconds=0.0011))
    assert (timeline.ticks, timeline.frames) == (1100, 9)


def test_events_are_sorted_by_tick_and_ends_come_before_beginnings():
    faults = [
        [0.4, "adc_over_range", "sense_sin", 1, 5.0],
        [0.1, "dac_stuck", "drive", -3, math.inf],
        [0.3, "adc_stuck", "sense_sin", 7, 0.1],
    ]
    writes = [[0.1, "control", 1], [0.05, "phase_drive_sine", 123]]
    events = scenario.expand(made(seconds=0.5, faults=faults, register_writes=writes)).events
    assert events == (
        Event(50_000, WRITE, "phase_drive_sine", "", 123),
        Event(100_000, WRITE, "control", "", 1),
        Event(100_000, FAULT_ON, "dac_stuck", "drive", -3),
        Event(300_000, FAULT_ON, "adc_stuck", "sense_sin", 7),
        Event(400_000, FAULT_OFF, "adc_stuck", "sense_sin", 0),
        Event(400_000, FAULT_ON, "adc_over_range", "sense_sin", 1),
    )


@given(st.floats(0, 0.4), st.floats(1e-9, 1e6))
def test_a_fault_lasts_at_least_a_tick_and_ends_within_the_run(t_s, duration_s):
    events = scenario.build_events(made(seconds=0.5, faults=[[t_s, "plant_nan", "x", 0, duration_s]]), 500_000, 1e6)
    on = events[0].tick
    assert on == round(t_s * 1e6)
    for off in events[1:]:
        assert on < off.tick < 500_000
        assert off.tick - on == max(1, round(duration_s * 1e6))
    assert len(events) == (2 if on + max(1, round(duration_s * 1e6)) < 500_000 else 1)


@pytest.mark.parametrize(
    ("value", "where", "words"),
    [
        ([], "", "no points"),
        ([1], "[0]", "of the form [t_s, deg/s]"),
        ([[0, 1], [0]], "[1]", "of the form"),
        ([[0, 1], [1, 2], [0.5, 3]], "[2]", "before its predecessor at 1 s"),
        ([[0, 1], [1, 2], [1, 3], [1, 4]], "[3]", "third point at 1 s"),
        ([[-1, 1]], "[0]", "start at 0 s"),
        ([[0, 1], [1, 11]], "[1]", "= 11 is above the limit 10 deg/s"),
        (-11, "", "= -11 is below the limit -10 deg/s"),
        (True, "", "not a number"),
        (math.nan, "", "not finite"),
        (10**400, "", "not finite"),
        ("fast", "", "not a number"),
        ({"t": 1}, "", "not a number"),
    ],
)
def test_a_wrong_profile_is_refused_with_its_place(value, where, words):
    with pytest.raises(Problem) as caught:
        scenario.profile_points(value, -10, 10, "deg/s")
    assert caught.value.where == where
    assert words in caught.value.text


GOOD = {"adc_stuck": 1, "adc_over_range": -1, "adc_bad_status": 0xFFFFFF, "dac_stuck": 1, "adc_lost_bit": 25}


def test_every_fault_kind_can_be_written_on_every_channel():
    for kind, fault in scenario.FAULTS.items():
        for channel in fault.channels:
            assert scenario.check_faults([[0, kind, channel, GOOD.get(kind, 0), 1]])


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ([0, "adc_stuck", "sense_sin", 1 << 23, 1], "above the limit 8388607 code"),
        ([0, "adc_stuck", "sense_sin", -(1 << 23) - 1, 1], "below the limit -8388608 code"),
        ([0, "dac_stuck", "drive", 1 << 15, 1], "above the limit 32767"),
        ([0, "dac_stuck", "quadrature", -1, 1], "below the limit 0"),
        ([0, "adc_over_range", "sense_sin", 0, 1], "-1 or 1"),
        ([0, "adc_stuck", "sense_sin", 1.5, 1], "not an integer"),
        ([0, "adc_stuck", "drive", 1, 1], "is not a channel of adc_stuck; did you mean drive_sin?"),
        ([0, "nonsense", "drive", 1, 1], "is not a kind of fault; known:"),
        ([0, "adc_stuck", "sense_sin", 1, 0], "duration"),
        ([0, "adc_stuck", "sense_sin", 1, math.nan], "duration"),
        ([0, "adc_stuck", "sense_sin", 1], "of the form"),
        ("adc_stuck", "of the form"),
        ([0, ["list"], "drive", 1, 1], "not a kind of fault"),
    ],
)
def test_a_wrong_fault_is_refused(row, words):
    with pytest.raises(Problem) as caught:
        scenario.check_faults([row])
    assert caught.value.where == "[0]"
    assert words in caught.value.text


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ([0, "controll", 1], '"controll" is not a writable register; did you mean control?'),
        ([0, "rate_word", 1], "not a writable register"),
        ([0, "phase_drive_sine", 1 << 48], "is above the limit 281474976710655 of its format [0,0,48]"),
        ([0, "phase_drive_sine", -1], "is below the limit 0"),
        ([0, "phase_drive_sine", 0.5], "registers take raw words"),
        ([0, "phase_drive_sine"], "of the form"),
        ([0, ["list"], 1], "not a writable register"),
    ],
)
def test_a_wrong_register_write_is_refused(row, words):
    with pytest.raises(Problem) as caught:
        scenario.check_register_writes([row])
    assert words in caught.value.text


@pytest.mark.parametrize(
    ("faults", "writes", "where"),
    [
        ([[1, "plant_nan", "x", 0, 1]], [], ".faults[0]"),
        ([], [[0, "control", 1], [2, "control", 1]], ".register_writes[1]"),
        ([[0, "adc_stuck", "sense_sin", 0, 0.5], [0.4, "adc_over_range", "sense_sin", 1, 1]], [], ".faults[1]"),
    ],
)
def test_events_outside_the_run_and_overlapping_faults_are_refused(faults, writes, where):
    with pytest.raises(Problem) as caught:
        scenario.check_times(SimpleNamespace(seconds=1.0, faults=faults, register_writes=writes))
    assert caught.value.where == where


def test_faults_that_touch_do_not_overlap():
    faults = [[0, "adc_stuck", "sense_sin", 0, 0.5], [0.5, "adc_stuck", "sense_sin", 1, 0.5]]
    scenario.check_times(SimpleNamespace(seconds=1.0, faults=faults, register_writes=[]))
