"""Lateness of reference edges from words and stamps, against a pin that is clocked one by one here."""

import numpy as np
import pytest

from testbench.paper.calibration import grid

TURN = 1 << 48
FRAMES = 160
OFFSET = 123_456_789_012_345


def pins(words, start, offset, grid_clocks):
    """(instants, lateness in turns less half a step) of each edge: a phase accumulator and a pin sampled on a grid."""
    phase, held, instants, lateness = start + offset, None, [], []
    for clock in range(len(words) * 3250 + 1):
        if clock % grid_clocks == 0:
            level = phase % TURN < TURN // 2
            if held is not None and level != held:
                instants.append(clock // grid_clocks)
                lateness.append((phase % (TURN // 2)) / TURN - int(words[0]) * grid_clocks / TURN / 2)
            held = level
        phase += int(words[min(clock // 3250, len(words) - 1)])
    return np.array(instants), np.array(lateness)


def words_of(hz):
    """A frequency that a loop moves by some millihertz."""
    rng = np.random.default_rng(8)
    return np.round((hz + 0.005 * rng.normal(size=FRAMES)) / 26e6 * TURN).astype(np.int64)


@pytest.mark.parametrize(("hz", "grid_clocks"), [(11002.4386, 26), (10989.32, 26), (11000.0, 1)])
def test_lateness_is_that_of_the_pin(hz, grid_clocks):
    """Stamps of the last quarter tell the mean lateness of all; a pin with another word and sgn(cos) follow."""
    words, start = words_of(hz), 98_765_432_109_876
    instants, own = pins(words, start, OFFSET, grid_clocks)
    last = instants[3 * len(instants) // 4 :]
    begun = grid.start(words, last, OFFSET, grid_clocks)
    slack = int(grid.SLACK * words[0] * grid_clocks)
    assert any(begun.low - slack <= start + k * TURN // 2 <= begun.high + slack for k in range(-2, 3))
    ones = np.ones(FRAMES)
    found = grid.late(words, ones, begun, OFFSET, grid_clocks)
    assert found.deg == pytest.approx(360 * own.mean(), abs=3 * found.sd_deg + 1e-3)
    for other in (0, OFFSET + TURN // 4):
        _, lateness = pins(words, start, other, grid_clocks)
        found = grid.late(words, ones, begun, other, grid_clocks)
        assert found.deg == pytest.approx(360 * lateness.mean(), abs=3 * found.sd_deg + 1e-3)


def test_edges_that_stand_on_the_grid_leave_a_wide_start():
    """At 10 kHz exactly every edge has one lateness; a step less one edge's place is what remains unknown."""
    words = np.full(FRAMES, TURN // 2600, np.int64)
    instants, own = pins(words, 5_000_000_000_000, 0, 26)
    begun = grid.start(words, instants, 0, 26)
    step = int(words[0]) * 26
    assert begun.high - begun.low > 0.9 * step
    found = grid.late(words, np.ones(FRAMES), begun, 0, 26)
    assert found.sd_deg == pytest.approx(360 * step / TURN / np.sqrt(12), rel=0.1)
    assert abs(found.deg - 360 * own.mean()) < 2 * found.sd_deg


def test_stamps_of_another_record_are_refused():
    words = words_of(11002.4386)
    instants, _ = pins(words, 0, 0, 26)
    with pytest.raises(ValueError, match="edges disagree with the words by"):
        grid.start(words + words // 1000, instants, 0, 26)
    with pytest.raises(ValueError, match="none within the 160 frames"):
        grid.start(words, instants + FRAMES * 125, 0, 26)


def test_a_line_of_lateness_is_that_of_the_pin():
    """The largest of 300 frequencies, against the sum over the edges of the pin themselves."""
    words, start = words_of(11002.4386), 5_000_000_000_000
    instants, own = pins(words, start, 0, 26)
    begun = grid.start(words, instants, 0, 26)
    sizes = {
        omega: 360 * abs(np.mean(own * np.exp(1j * omega * (instants // 125)))) for omega in np.linspace(0.1, 3, 300)
    }
    omega = max(sizes, key=sizes.get)
    found = grid.line_deg(words, np.ones(FRAMES), begun, 0, 26, omega)
    assert sizes[omega] > 0.05
    assert found == pytest.approx(sizes[omega], rel=0.05)
