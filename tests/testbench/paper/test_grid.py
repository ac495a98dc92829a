"""Lateness of reference edges from words and stamps, against a pin that is clocked one by one here."""

import numpy as np
import pytest

from fpga_model.design_record import DEFAULT
from testbench.paper.calibration import grid

TURN = 1 << 48
FRAMES = 160
OFFSET = 123_456_789_012_345
EACH_TICK = grid.Grid(26)
# 24 MHz, 32 bits; 52 MHz with ticks of half a microsecond
SHORT = DEFAULT._replace(master_hz=24_000_000, tick_clocks=24, dds_bits=32)
FAST = DEFAULT._replace(master_hz=52_000_000, frame_ticks=250)


def pins(words, start, offset, grid_clocks, turn=TURN, frame_clocks=3250):
    """(instants, lateness in turns less half a step) of each edge: a phase accumulator and a pin sampled on a grid."""
    phase, held, instants, lateness = start + offset, None, [], []
    for clock in range(len(words) * frame_clocks + 1):
        if clock % grid_clocks == 0:
            level = phase % turn < turn // 2
            if held is not None and level != held:
                instants.append(clock // grid_clocks)
                lateness.append((phase % (turn // 2)) / turn - int(words[0]) * grid_clocks / turn / 2)
            held = level
        phase += int(words[min(clock // frame_clocks, len(words) - 1)])
    return np.array(instants), np.array(lateness)


def words_of(hz, master_hz=26e6, turn=TURN):
    """A frequency that a loop moves by some millihertz."""
    rng = np.random.default_rng(8)
    return np.round((hz + 0.005 * rng.normal(size=FRAMES)) / master_hz * turn).astype(np.int64)


@pytest.mark.parametrize(
    ("hz", "at", "frame_clocks"),
    [
        (11002.4386, EACH_TICK, 3250),
        pytest.param(10989.32, EACH_TICK, 3250, marks=pytest.mark.slow),
        (11000.0, grid.Grid(1), 3250),
        pytest.param(11002.4386, grid.Grid(24, SHORT), 3000, marks=pytest.mark.slow),
        (11002.4386, grid.Grid(26, FAST), 6500),
    ],
)
def test_lateness_is_that_of_the_pin(hz, at, frame_clocks):
    """Stamps of the last quarter tell the mean lateness of all; a pin with another word and sgn(cos) follow."""
    turn = 1 << at.design.dds_bits
    words, start, offset = words_of(hz, at.design.master_hz, turn), 98_765_432_109_876 % turn, OFFSET % turn
    instants, own = pins(words, start, offset, at.clocks, turn, frame_clocks)
    last = instants[3 * len(instants) // 4 :]
    begun = grid.start(words, last, offset, at)
    slack = int(grid.SLACK * words[0] * at.clocks)
    assert any(begun.low - slack <= start + k * turn // 2 <= begun.high + slack for k in range(-2, 3))
    ones = np.ones(FRAMES)
    found = grid.mean_edge_delay(words, ones, begun, offset, at)
    assert found.deg == pytest.approx(360 * own.mean(), abs=3 * found.sd_deg + 1e-3)
    for other in (0, offset + turn // 4):
        _, lateness = pins(words, start, other, at.clocks, turn, frame_clocks)
        found = grid.mean_edge_delay(words, ones, begun, other, at)
        assert found.deg == pytest.approx(360 * lateness.mean(), abs=3 * found.sd_deg + 1e-3)


def test_edges_that_stand_on_the_grid_leave_a_wide_start():
    """At 10 kHz exactly every edge has one lateness; a step less one edge's place is what remains unknown."""
    words = np.full(FRAMES, TURN // 2600, np.int64)
    instants, own = pins(words, 5_000_000_000_000, 0, 26)
    begun = grid.start(words, instants, 0, EACH_TICK)
    step = int(words[0]) * 26
    assert begun.high - begun.low > 0.9 * step
    found = grid.mean_edge_delay(words, np.ones(FRAMES), begun, 0, EACH_TICK)
    assert found.sd_deg == pytest.approx(360 * step / TURN / np.sqrt(12), rel=0.1)
    assert abs(found.deg - 360 * own.mean()) < 2 * found.sd_deg


def test_stamps_of_another_record_are_refused():
    words = words_of(11002.4386)
    instants, _ = pins(words, 0, 0, 26)
    with pytest.raises(ValueError, match="differ from the frequency words by"):
        grid.start(words + words // 1000, instants, 0, EACH_TICK)
    with pytest.raises(ValueError, match="none is within the 160 recorded frames"):
        grid.start(words, instants + FRAMES * 125, 0, EACH_TICK)


def test_a_line_of_lateness_is_that_of_the_pin():
    """The largest of 300 frequencies, against the sum over the edges of the pin themselves."""
    words, start = words_of(11002.4386), 5_000_000_000_000
    instants, own = pins(words, start, 0, 26)
    begun = grid.start(words, instants, 0, EACH_TICK)
    sizes = {
        omega: 360 * abs(np.mean(own * np.exp(1j * omega * (instants // 125)))) for omega in np.linspace(0.1, 3, 300)
    }
    omega = max(sizes, key=sizes.get)
    found = grid.line_deg(words, np.ones(FRAMES), begun, 0, EACH_TICK, omega)
    assert sizes[omega] > 0.05
    assert found == pytest.approx(sizes[omega], rel=0.05)
