"""Warnings of a run's summary, from rows that are made: each doubt alone, and none of what is right."""

import numpy as np
import pytest

from fpga_model import sequencer
from testbench.config import Config, changed
from testbench.run.anomaly_warnings import BLOCK_FRAMES, BLOCKS, CODES, SETTLE_FRAMES, AnomalyDetector
from testbench.run.simulation import FRAME

FRAMES = SETTLE_FRAMES + 16 * BLOCK_FRAMES
WORDS = {"frequency_word": 119_106_000_000, "amplitude_word": 1_700_000, "quadrature_code": 33_000}


def rows(count=FRAMES, seed=1):
    """Rows of a healthy locked gyroscope, as far as the doubts look at them."""
    random = np.random.default_rng(seed)
    frames = np.zeros((count, len(FRAME)), np.int64)
    frames[:, FRAME["state"]] = sequencer.LOCKED
    for name, sigma, mean in (
        ("drive_sin", 26, 0),
        ("drive_cos", 26, -5.9e6),
        ("sense_sin", 45, 0),
        ("sense_cos", 45, 0),
    ):
        frames[:, FRAME[f"adc_{name}"]] = 10 * np.rint((random.normal(0, sigma, count) + mean) / 10)
    for name, value in WORDS.items():
        frames[:, FRAME[name]] = value + np.rint(random.normal(0, 1e-6 * value, count))
    return frames


def spike(frames, name, codes, lasts=8, period=80, first=SETTLE_FRAMES, last=FRAMES):
    """Bursts of spikes on a code."""
    for begin in range(first, last, period):
        frames[begin : begin + lasts, FRAME[name]] += codes


def ring(frames, codes, names=("sin", "cos")):
    """The sense mode swings at its distance from the drive frequency."""
    turns = 139 / 8000 * np.arange(len(frames))
    for name in names:
        frames[:, FRAME[f"adc_sense_{name}"]] += np.rint(codes * getattr(np, name)(2 * np.pi * turns)).astype(np.int64)


def warned(frames, config=None, pieces=1):
    doubts = AnomalyDetector()
    doubts.active = True
    for piece in np.array_split(frames, pieces):
        doubts.add(0, piece, None)
    return doubts.warnings(config or Config())


def test_nothing_is_said_of_a_healthy_run_and_pieces_do_not_matter():
    assert warned(rows()) == ()
    frames = rows()
    frames[-3 * BLOCK_FRAMES :, FRAME["amplitude_word"]] += 20_000
    spike(frames, "adc_drive_sin", 1000)
    ring(frames, 2000)
    frames[5000:5030, FRAME["adc_sense_cos"]] = 70
    assert warned(frames) == warned(frames, pieces=7) == warned(frames, pieces=501)
    assert len(warned(frames)) == 4


@pytest.mark.parametrize("name", ["adc_drive_sin", "adc_drive_cos", "adc_sense_sin", "adc_sense_cos"])
def test_a_code_that_repeats(name):
    frames = rows()
    frames[6000:6020, FRAME[name]] = 30
    (said,) = warned(frames)
    assert said == f"{name} repeated one code for 20 frames (2.38 ms); it may be frozen"
    (said,) = warned(frames, changed(Config(), {"design.frame_ticks": 250}))
    assert "20 frames (4.75 ms)" in said
    frames[6000:6020, FRAME["state"]] = sequencer.KICK
    assert warned(frames) == ()


@pytest.mark.parametrize("lasts", [1, 8, 16])
@pytest.mark.parametrize("name", CODES)
def test_a_code_that_jumps(name, lasts):
    frames = rows()
    spike(frames, name, -1500, lasts)
    (said,) = warned(frames, changed(Config(), {"scenario.rate_dps": [[0.0, 0.0], [1.0, 30.0]]}))
    assert said == f"{name} jumps by more than 8 times its scatter in 15 blocks of 400 frames; possible spikes"


def test_jumps_that_are_few_or_explained_are_not_said():
    frames = rows()
    spike(frames, "adc_sense_sin", 1500, last=SETTLE_FRAMES + 2 * BLOCK_FRAMES)
    assert warned(frames) == ()
    spike(frames, "adc_sense_sin", 1500, last=SETTLE_FRAMES + 5 * BLOCK_FRAMES)
    assert len(warned(frames)) == 1
    writes = [[0.1, "quadrature_fixed", 0]]
    assert warned(frames, changed(Config(), {"scenario.register_writes": writes})) == ()
    points = [[0.0, 200.0], [0.5, 200.0], [0.5, -200.0]]
    for shape in ("linear", "steps"):
        assert warned(frames, changed(Config(), {"scenario.rate_dps": points, "scenario.rate_shape": shape})) == ()
    assert len(warned(frames, changed(Config(), {"scenario.rate_dps": [[0.0, 200.0], [0.5, -200.0]]}))) == 1


def test_a_coarse_converter_jumps_by_its_steps():
    frames = rows()
    spike(frames, "adc_drive_sin", 1000, lasts=1)
    doubts = AnomalyDetector(step=1024)
    doubts.active = True
    doubts.add(0, frames, None)
    assert doubts.warnings(Config()) == ()


def test_a_sense_mode_that_swings_freely():
    frames = rows()
    ring(frames, 1000)
    (said,) = warned(frames)
    assert said == "the sense mode swings freely in 15 blocks of 400 frames; a DAC may have stopped at times"
    # a rate that changes excites it as well; a tone in one code is no mode that swings
    assert warned(frames, changed(Config(), {"scenario.rate_dps": [[0.0, 0.0], [1.0, 30.0]]})) == ()
    frames = rows()
    ring(frames, 1000, ["sin"])
    assert warned(frames) == ()


@pytest.mark.parametrize(("name", "loop"), [("drive_sin", "phase"), ("sense_sin", "rate"), ("sense_cos", "quadrature")])
def test_a_code_that_is_not_nulled(name, loop):
    frames = rows()
    frames[-8 * BLOCK_FRAMES :, FRAME[f"adc_{name}"]] += 3000
    (said,) = warned(frames)
    assert f"adc_{name} has a mean of" in said
    assert f"the {loop} loop does not null it" in said


@pytest.mark.parametrize(
    ("name", "part"), [("frequency_word", 5e-6), ("amplitude_word", -0.02), ("quadrature_code", 0.02)]
)
def test_a_word_that_drifts(name, part):
    frames = rows()
    frames[:, FRAME[name]] += np.rint(np.linspace(0, part, FRAMES) * WORDS[name]).astype(np.int64)
    (said,) = warned(frames)
    assert said.startswith(f"{name} drifted by {'+' if part > 0 else '-'}")
    # a change of temperature or rate explains it
    assert warned(frames, changed(Config(), {"scenario.rate_dps": [[0.0, 0.0], [1.0, 30.0]]})) == ()
    assert warned(frames, changed(Config(), {"scenario.temperature_degc": [[0.0, 25.0], [1.0, 30.0]]})) == ()


def test_memory_does_not_grow():
    doubts = AnomalyDetector()
    doubts.active = True
    for seed in range(10):
        doubts.add(0, rows(BLOCKS * BLOCK_FRAMES, seed), None)
        assert len(doubts.means) < BLOCKS
    assert doubts.length == 16 * BLOCK_FRAMES
    assert doubts.warnings(Config()) == ()


def test_a_checkpoint_continues_it():
    frames, one, other = rows(), AnomalyDetector(), AnomalyDetector()
    frames[-6 * BLOCK_FRAMES :, FRAME["adc_sense_sin"]] += 9000
    spike(frames, "adc_drive_cos", 700, first=7777 - BLOCK_FRAMES, last=7777 + 2 * BLOCK_FRAMES)
    ring(frames, 1000)
    one.active = other.active = True
    one.add(0, frames[:7777], None)
    other.restore(one.dump())
    for doubts in (one, other):
        doubts.add(0, frames[7777:], None)
    assert len(one.warnings(Config())) == 3
    assert one.warnings(Config()) == other.warnings(Config()) != ()
