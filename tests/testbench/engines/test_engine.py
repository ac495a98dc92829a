"""Clocked engine: same bits in any chunks, after a restart, interpreted; registers in format; faults flagged."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from fpga_model import fault_monitor, rates, sequencer
from fpga_model import top as fpga
from fpga_model.jit import kernel
from fpga_model.rates import TICK_HZ
from fpga_model.sine import ROM
from testbench import flatten
from testbench.engines import engine
from testbench.run import simulate
from testbench.storage import state_file
from tests.testbench.bench_setup import configured, quiet


def fingerprint(state):
    """Every register and every bit of the plant."""
    digest = hashlib.sha256(repr([int(v) for _, v in flatten.leaves((state.fpga, state.chips))]).encode())
    for name, array in flatten.leaves(state.plant):
        if not name.startswith("work."):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def locked_file(tmp_path_factory):
    """State file of the default gyroscope, 50 ms after lock."""
    checked = configured()
    sim = simulate.Simulation(checked, 25.0, 25.0)
    assert simulate.start(checked, sim, 0.1, 25.0) is not None
    sim.advance(50_000, 0.1, 25.0)
    path = tmp_path_factory.mktemp("state") / "locked.h5"
    state_file.save_state(path, *sim.dump())
    return path


def resumed(path, **values):
    sim = simulate.Simulation(configured(**values), 25.0, 25.0)
    sim.restore(path)
    sim.now = (np.full(1, 0.1), np.full(1, 25.0))
    return sim


def test_chunks_do_not_matter(locked_file):
    whole, parts = resumed(locked_file), resumed(locked_file)
    whole.advance(3000, 0.1, 25.0)
    for ticks in (1, 7, 124, 125, 126, 617, 1000, 1000):
        parts.advance(ticks, 0.1, 25.0)
    assert fingerprint(whole.state) == fingerprint(parts.state)
    assert whole.codes_sha256() == parts.codes_sha256()


def test_a_restart_continues_to_the_same_bits(locked_file, tmp_path):
    one = resumed(locked_file)
    one.advance(1033, 0.1, 25.0)
    state_file.save_state(tmp_path / "mid.h5", *one.dump())
    two = resumed(tmp_path / "mid.h5")
    one.advance(2000, 0.1, 25.0)
    two.advance(2000, 0.1, 25.0)
    assert fingerprint(one.state) == fingerprint(two.state)


INTERPRETED = """
import sys
import numpy as np
from tests.testbench.engines.test_engine import fingerprint, resumed
sim = resumed(sys.argv[1])
sim.advance(int(sys.argv[2]), 0.1, 25.0)
print(fingerprint(sim.state))
"""


@pytest.mark.slow  # firmware, plant and rounding one by one: test_jit_equals_python_*.py, test_portable.py
def test_jitted_equals_interpreted(locked_file):
    ticks = 160  # a whole frame: ADC read, loops, sequencer
    sim = resumed(locked_file)
    sim.advance(ticks, 0.1, 25.0)
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-c", INTERPRETED, str(locked_file), str(ticks)]
    out = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=300)
    assert out.stdout.strip() == fingerprint(sim.state)


@kernel
def one_edge(p, s, i):
    return fpga.step(p, ROM, s, i)


@pytest.mark.slow  # one edge of the whole firmware is compiled for it; tests/testbench/storage/test_vcd.py has windows
def test_a_trace_is_the_registers_before_each_edge(locked_file):
    """Each row, stepped once with the pins that it shows, is the next row."""
    sim = resumed(locked_file)
    sim.window = (sim.tick + 1, 300)
    sim.advance(400, 0.1, 25.0)
    pins, rows = np.split(sim.rows, [len(engine.PIN_COLUMNS)], axis=1)
    assert rows.shape == (300 * 26, sim.register_count)
    drdy, dout = (engine.PIN_COLUMNS.index(name) for name in ("drdy_n", "dout"))
    for n in (*range(200), *range(3000, 3400)):
        state = flatten.rebuild(sim.state.fpga, rows[n])
        inputs = fpga.Inputs(int(pins[n, drdy]), int(pins[n, dout]), 0, 0, 0, 0, 0)
        after = one_edge(sim.params.fpga, state, inputs)
        assert [v for _, v in flatten.leaves(after)] == rows[n + 1].tolist(), n


def test_every_register_stays_within_its_format():
    """Over a whole start-up at 400 deg/s, in a window of each phase of it."""
    formats = list(flatten.format_leaves(fpga.STATE_FMT))
    names = flatten.names(fpga.State())
    assert [name for name, _ in formats] == names
    checked = configured()
    sim = simulate.Simulation(checked, 25.0, 25.0)
    lo = np.array([fmt.lo for _, fmt in formats])
    hi = np.array([fmt.hi for _, fmt in formats])
    for start_us in (1, 301_000, 305_000, 420_000, 480_000, 560_000, 1_000_000):
        sim.window, sim.rows = (start_us, 260), None
        sim.advance(start_us + 300 - sim.tick, 7.0, 25.0)
        rows = sim.rows[:, len(engine.PIN_COLUMNS) :]
        bad = np.flatnonzero(np.any((rows < lo) | (rows > hi), axis=0))
        assert not len(bad), [(names[k], formats[k][1], rows[:, k].min(), rows[:, k].max()) for k in bad]


def test_top_record_holds_the_blocks_its_names_say():
    """The state is built by position; a swap of two fields would go unseen by Numba."""
    fresh = fpga.State()
    sim = simulate.Simulation(quiet(), 25.0, 25.0)
    sim.advance(10, 0.0, 25.0)
    for name in fresh._fields:
        assert type(getattr(sim.state.fpga, name)) is type(getattr(fresh, name)), name


def test_effects_that_are_off_are_bit_for_bit_nothing(locked_file):
    plain, off = resumed(locked_file), resumed(locked_file)
    plain.advance(5000, 0.1, 25.0)
    # the flags of both stages on, so that every effect is asked and says no
    asked = off.params.plant.effects._replace(any_force=1, any_cv=1)
    off.params = off.params._replace(plant=off.params.plant._replace(effects=asked))
    off.advance(5000, 0.1, 25.0)
    assert fingerprint(plain.state) == fingerprint(off.state)


@pytest.mark.parametrize(
    ("key", "value"), [("duffing_k3_per_um2", 1e-7), ("drive_cubic_per_v2", 1e-3), ("feedthrough_y", 1e-5)]
)
def test_effects_that_are_on_are_something(locked_file, key, value):
    plain, on = resumed(locked_file), resumed(locked_file, **{f"effects__{key}": value})
    plain.advance(5000, 0.1, 25.0)
    on.advance(5000, 0.1, 25.0)
    assert fingerprint(plain.state) != fingerprint(on.state)


def test_each_noise_source_has_its_own_switch(locked_file):
    seen = {}
    for source in ("thermomechanical", "cv", "adc", "flicker", "jitter", "dac"):
        sim = resumed(locked_file, **{f"noise__{source}": False})
        sim.advance(2000, 0.1, 25.0)
        seen[source] = fingerprint(sim.state)
    sim = resumed(locked_file)
    sim.advance(2000, 0.1, 25.0)
    seen["all on"] = fingerprint(sim.state)
    assert len(set(seen.values())) == len(seen)


def play(locked_file, faults, seconds=0.2, **values):
    """Flags latched by a scenario with faults that starts at lock."""
    sim = resumed(locked_file, scenario__seconds=seconds, scenario__faults=faults, **values)
    simulate.play(sim, simulate.scenario.expand(sim.config.scenario))
    return sim, sim.state.fpga.control.sequencer.faults.latch, sim.columns()


FAULTS = [
    (["adc_over_range", "drive_sin", 1], "OVER_RANGE", 0.001),
    (["adc_over_range", "sense_cos", -1], "OVER_RANGE", 0.001),
    (["adc_silent", "adc", 0], "STALE", 0.0003),
    (["adc_bad_status", "adc", 0], "STALE", 0.0),
    (["plant_nan", "x", 0], "OVER_RANGE", 0.001),
]


@pytest.mark.parametrize(("fault", "flag", "debounce_s"), FAULTS)
def test_faults_set_their_flag_after_the_debounce(locked_file, fault, flag, debounce_s):
    begin_s = 0.01
    _, latch, c = play(locked_file, [[begin_s, *fault, 0.05]], seconds=0.08)
    bit = 1 << fault_monitor.NAMES.index(flag)
    assert latch & bit
    raised_s = np.argmax(c["flags"] & bit != 0) / 8000
    # a frame of the filter, one of the transfer and one of the record more than the debounce
    assert begin_s + debounce_s * 0.9 <= raised_s <= begin_s + debounce_s + 4 / 8000


@pytest.mark.parametrize("channel", simulate.scenario.ADC_CHANNELS[:4])
def test_one_frozen_channel_is_seen(locked_file, channel):
    _, latch, c = play(locked_file, [[0.01, "adc_frozen", channel, 0, 0.06]], seconds=0.1)
    bit = 1 << fault_monitor.NAMES.index("STUCK")
    assert latch & bit
    raised_s = np.argmax(c["flags"] & bit != 0) / 8000
    assert 0.01 + 32 / 8000 <= raised_s <= 0.01 + 36 / 8000


def test_a_dead_drive_loses_lock_and_restarts(locked_file):
    """The drive DAC's output stuck at zero: the amplitude decays, lock is lost and the sequence starts again."""
    sim, latch, c = play(locked_file, [[0.01, "dac_stuck", "drive", 0, 5.0]], seconds=3.0, noise__seed=1)
    assert latch & fault_monitor.LOST_LOCK
    assert np.any(c["state"] == sequencer.KICK)
    assert not sim.locked


def test_a_force_dac_at_its_rail_is_flagged_and_the_drive_holds(locked_file):
    """1000 deg/s want 10.4 V of 10 V."""
    sim = resumed(locked_file)
    sim.advance(round(0.3 * TICK_HZ), np.radians(1000.0), 25.0)
    s = sim.state.fpga.control.sequencer
    assert s.faults.latch & fault_monitor.RATE_SATURATED
    assert abs(sim.state.fpga.control.rate_loop.loop.y) == 2**23 - 1
    assert s.lock.locked & 0b0011 == 0b0011


def test_a_free_running_converter_locks_the_loops_too():
    checked = configured(firmware__adc_clock="free_running", plant__adc_clock_ppm=1234.5)
    sim = simulate.Simulation(checked, 25.0, 25.0)
    assert simulate.start(checked, sim, 0.0, 25.0) is not None
    assert sim.state.fpga.rates.slot <= rates.SLOTS


PINNED = {
    "analog_sid": "9d33b28d265d1e07b356b8ca66f23972e442be60d67d85e62e9066f65d44f10a",
    "digital_sid": "a85dc1ed2359bb2c955eba81361a3286c916cb8388d5bc2ffd96dac84a4d841c",
}


@pytest.mark.parametrize("board", PINNED)
def test_the_hash_of_all_codes_is_pinned(board):
    """Bit exactness across machines, versions and CPU targets: 1.5 s from power-on through lock, noise on."""
    checked = configured(firmware__board=board)
    sim = simulate.Simulation(checked, 25.0, 25.0)
    assert simulate.start(checked, sim, 0.3, 25.0) is not None
    sim.advance(1_500_000 - sim.tick, 0.3, 25.0)
    assert sim.codes_sha256() == PINNED[board]
