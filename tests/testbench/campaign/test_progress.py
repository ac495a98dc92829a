"""What is said on the way: counts, the time that is left, running means; lines without a terminal, nothing if quiet."""

import io
import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbench.campaign.campaign_progress import LINE_EVERY_S, Progress, Running, clock
from testbench.campaign.pool import InProcessExecutor
from testbench.campaign.work import Outcome


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=50))
def test_running_mean_and_spread(values):
    running = Running()
    for value in values:
        running.add(value)
    assert running.mean == pytest.approx(statistics.fmean(values), abs=1e-8)
    assert running.std == pytest.approx(statistics.stdev(values), rel=1e-6, abs=1e-6)


def test_clock():
    assert [clock(s) for s in (0, 59.6, 3723, math.nan)] == ["0:00:00", "0:01:00", "1:02:03", "-:--:--"]


def told(terminal, points=10, quiet=False):
    said, now = [], [100.0]
    progress = Progress(quiet, terminal, said.append, lambda: now[0])
    progress.set_totals(points + 5, 5, InProcessExecutor())
    with progress:
        for k in range(points):
            now[0] += LINE_EVERY_S / 4
            failed = k == 3
            numbers = {} if failed else {"drive_frequency_hz": 11000.0 + k, "locked": True, "lock_time_s": None}
            progress.add(Outcome("a", "failed" if failed else "done", "", numbers, 1.0, 0.0 if failed else 2.0))
    return progress, said


def test_lines_without_a_terminal():
    _, said = told(terminal=False)
    assert said[0] == "15 points, 5 of them finished earlier"
    assert said[1] == "9/15 points, 1 failed, 0.4 points/s, 0.6 x real time, 1 workers, 0:00:15 left"
    assert said[-1] == "15/15 points, 1 failed, 0.4 points/s, 0.72 x real time, 1 workers, 0:00:00 left"
    assert len(said) == 4


def test_quiet_is_quiet():
    assert told(terminal=False, quiet=True)[1] == []


def test_the_picture_has_bar_line_and_means():
    from rich.console import Console

    progress, _ = told(terminal=False)
    text = io.StringIO()
    Console(file=text, width=100).print(progress._picture())
    lines = text.getvalue().splitlines()
    assert lines[0].strip("━ ") == "", "the bar has a line of its own"
    assert lines[1].startswith("15/15 points")
    assert "drive_frequency_hz" in text.getvalue()
    values = [11000.0 + k for k in range(10) if k != 3]
    assert progress.headline_numbers()[0] == (
        "drive_frequency_hz",
        *map(pytest.approx, (statistics.fmean(values), statistics.stdev(values))),
    )
    assert f"+- {statistics.stdev(values):.3g}" in text.getvalue()


def test_a_terminal_gets_a_live_picture(capsys):
    _, said = told(terminal=True)
    assert said[-1].startswith("15/15 points")
    assert len(said) == 2, "what is between is in the picture"


def test_nothing_is_known_before_the_first_point():
    progress = Progress(False, False, lambda text: None, lambda: 0.0)
    progress.set_totals(3, 0, InProcessExecutor())
    assert "-:--:-- left" in progress.line()
