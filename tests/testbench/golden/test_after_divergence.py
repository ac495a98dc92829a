"""What a design does behind its first difference: the converter answers it as in a replay, conversions come again."""

import shutil

import numpy as np
import pytest

from analog_frontend.parts import adc_serial
from fpga_model.design_record import DEFAULT
from testbench.golden.loop import after_divergence, library
from testbench.golden.recording import recording, replay_recording
from tests.testbench.golden import top_score
from tests.testbench.golden.diagnosis import rtl_faults


class Played:
    """A design that plays rows of registers and pins back."""

    def __init__(self, rows):
        self.values, self.n = np.column_stack([rows.registers, rows.pins]), 0

    def read(self):
        return self.values[self.n]

    def step(self, given):
        self.n += 1
        pins = self.values[min(self.n, len(self.values) - 1), len(library.REGISTERS) :]
        return sum(int(value) << at for value, at in zip(pins, library.PIN_AT, strict=True))


def test_the_inputs_are_those_of_a_replay():
    r, count = recording.load("reset"), after_divergence.FRAMES * DEFAULT.frame_clocks
    adc, host, sar = r.stimulus
    given = replay_recording.Stimulus(adc, host[(host[:, 1] == 0)], sar)
    rows = replay_recording.run(r.params, given, after_divergence.FRAMES, np.arange(count))
    assert rows.inputs[:, 1:3].any(axis=0).all()  # DRDY_N and DOUT
    assert rows.inputs[:, 5].any()  # a host write
    found = after_divergence.simulate_continuation(Played(rows), adc_serial.State(), given, 0, DEFAULT)
    assert np.array_equal(found.inputs, rows.inputs)
    assert np.array_equal(found.values, np.column_stack([rows.registers, rows.pins]))


def test_conversions_come_again_a_frame_apart():
    codes = np.arange(30).reshape(3, 10)
    codes[:, 0] = 100, 3350, 6600
    rows = codes.copy(), np.zeros((0, 4), np.int64), np.zeros((0, 2), np.int64)
    found = after_divergence.extend_stimulus(replay_recording.Stimulus(*rows), 7000, DEFAULT).adc
    assert np.array_equal(found[:3], codes)
    assert found[3:, 0].tolist() == [9850, 13100, 16350, 19600]
    assert np.array_equal(found[3:, 1:], codes[[0, 1, 2, 0], 1:])
    none = replay_recording.Stimulus(rows[0][:0], *rows[1:])
    assert after_divergence.extend_stimulus(none, 7000, DEFAULT) is none


@pytest.mark.slow
@pytest.mark.skipif(any(shutil.which(name) is None for name in library.TOOLS), reason="no verilator or compiler")
def test_faults_in_the_loop_are_named():
    """One of each kind: of those that show at least three in four are named right, and none wrongly for certain."""
    found = top_score.scored(rtl_faults.FIRST, 1, 5, lambda one: None)
    count = {verdict: sum(one.verdict == verdict for one in found) for verdict in ("right", "wrong", "not seen")}
    assert count["wrong"] == 0
    assert count["right"] >= 0.75 * (len(found) - count["not seen"]) >= 6
