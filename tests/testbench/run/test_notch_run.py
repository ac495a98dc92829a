"""The notch in a run: engines agree, forces are the same without it, states know it; the rate is the filtered one."""

import numba
import numpy as np
import pytest

from fpga_model import block, notch, sequencer
from fpga_model import top as fpga
from fpga_model.rates import FRAME_TICKS
from testbench.config import Config, changed
from testbench.engines import engine, frame
from testbench.errors import ConfigError, FileError
from testbench.run import build
from testbench.run.simulation import Simulation
from testbench.storage import state_file
from tests import naive
from tests.testbench.engines.test_frame import different, own

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")

OFF = Config()
ON = changed(OFF, {"firmware.notch_hz": 139.0, "firmware.notch_width_hz": 20.0})
WORDS = (400_000, -8_388_607, 8_388_607, 123_457, -1, 0, 5_000_000)
FRAMES = 12  # of each word


def begun(config):
    """(params, state) in which the host gives the force word from the first frame on."""
    params = build.params(config, 25.0, 25.0)
    state = engine.reset(params, 25.0)
    f = state.fpga
    control = f.control._replace(sequencer=f.control.sequencer._replace(state=sequencer.OPEN))
    bank = f.registers._replace(control=sequencer.RUN | sequencer.OPEN_DRIVE | sequencer.FIX_FTR)
    return params, state._replace(fpga=f._replace(control=control, registers=bank))


def after(run, params, state, word, frames):
    """(state, streams) of an engine after some frames with this word."""
    f = state.fpga
    state = own(state)._replace(fpga=f._replace(registers=f.registers._replace(rate_fixed=word)))
    streams = engine.streams(frames * FRAME_TICKS, frames + 2, 0, 0)
    rate, temp = np.full(frames + 2, 0.3), np.full(frames + 2, 25.0)
    return run(params, state, frames * FRAME_TICKS, rate, temp, (0, 0, 0), engine.Faults(), streams), streams


@pytest.mark.slow  # both engines are compiled for a firmware with one block more
def test_engines_agree_and_the_force_does_not_pass_it():
    params, fast = begun(ON)
    bare, plain = begun(OFF)
    clocked, seen = fast, set()
    for word in WORDS:
        clocked, a = after(engine.run, params, clocked, word, FRAMES)
        fast, b = after(frame.run, params, fast, word, FRAMES)
        plain, c = after(frame.run, bare, plain, word, FRAMES)
        assert different(clocked, fast) == []
        for name, one, other, without in zip(engine.Streams._fields, a, b, c):
            np.testing.assert_array_equal(one, other, err_msg=name)
            if name in ("drive_code", "sense_code"):
                np.testing.assert_array_equal(other, without, err_msg=name)
        assert fast.fpga.control.rate_loop == plain.fpga.control.rate_loop
        seen.add((fast.fpga.control.rate_output.word, plain.fpga.control.rate_output.word))
    assert any(with_notch != without for with_notch, without in seen)
    assert {without for _, without in seen} == set(WORDS)


@pytest.mark.slow  # the frame engine is compiled for it; tests/fpga_model/test_notch.py has its slot
def test_the_rate_output_takes_the_filtered_words():
    """Frame by frame: the oracle on the loop's words gives the registers and what the rate output has taken."""
    params, state = begun(ON)
    words, kept, taken = [], [], []
    for k in range(40):
        state, _ = after(frame.run, params, state, WORDS[k % len(WORDS)], 1)
        control = state.fpga.control
        words.append(control.rate_loop.loop.y)
        kept.append(tuple(control.notch))
        taken.append(control.rate_output.word)
    # the first window of the converter comes after the first frame
    begin = next(k for k, word in enumerate(words) if word)
    rows = naive.notch(*params.fpga.control.notch, [(1, word) for word in words[begin:]])[1:]
    assert kept[begin:] == rows
    assert taken[begin:] == [naive.rounded("half_up", naive.Fraction(row[2], 1 << notch.SHIFT)) for row in rows]
    assert len(set(words)) == len(WORDS)


def test_a_state_continues_only_with_the_same_notch(tmp_path):
    on, off = (Simulation(config, 25.0, 25.0) for config in (ON, OFF))
    assert on.register_count == off.register_count + 4
    assert on.layout() != off.layout()
    # no run: an engine would be compiled for it
    control = on.state.fpga.control
    control = control._replace(notch=type(control.notch)(*range(3, 7)))
    on.state = on.state._replace(fpga=on.state.fpga._replace(control=control))
    state_file.save_state(tmp_path / "on.h5", *on.dump())
    again = Simulation(ON, 25.0, 25.0)
    assert again.state.fpga != on.state.fpga
    again.restore(tmp_path / "on.h5")
    assert again.state.fpga == on.state.fpga
    with pytest.raises((ConfigError, FileError), match=r"on\.h5"):
        off.restore(tmp_path / "on.h5")
    other = Simulation(changed(ON, {"firmware.notch_hz": 120.0}), 25.0, 25.0)
    with pytest.raises(
        ConfigError, match=r"was saved with firmware\.notch_hz = 139\.0; it cannot continue with 120\.0"
    ):
        other.restore(tmp_path / "on.h5")


def test_bad_notches_are_one_clear_line():
    with pytest.raises(ConfigError, match=r"notch_width_hz: 20 Hz is outside 0 \.\. notch_hz, 12 Hz"):
        Simulation(changed(OFF, {"firmware.notch_hz": 12.0}), 25.0, 25.0)
    assert block.reset(fpga.State(), build.firmware(OFF)) == fpga.State()
