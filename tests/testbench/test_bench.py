"""The kernels that `make bench` times: each runs here once and does what it says; it is timed only when asked for."""

import itertools
import json

import numba
import numpy as np
import pytest

from fpga_model import sequencer
from testbench import bench, docs

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
TICKS = 25_000


@pytest.fixture(scope="module")
def locked():
    return bench.Bench(TICKS)


def test_clocked_engine(benchmark, locked):
    before = locked.sim.tick
    benchmark(locked.clocked)
    assert (locked.sim.tick - before) % TICKS == 0
    assert locked.sim.tick > before
    assert locked.sim.locked


def test_firmware_alone(benchmark, locked):
    before = locked.digital[0]
    benchmark(locked.firmware)
    after = locked.digital[0]
    assert after.control.sequencer.state == sequencer.LOCKED, "fixed codes near the set-points are no fault"
    assert after.control.sequencer.faults.flags == 0
    turned = (after.dds.phase - before.dds.phase) & bench.PHASE_MASK
    assert turned, "the DDS runs"
    assert after.adc.channels != before.adc.channels or after.control != before.control, "frames arrive"


def test_plant_alone(benchmark, locked):
    caps = locked.plant.caps.copy()
    benchmark(locked.plant_only)
    # drive codes that repeat are not a loop: the amplitude wanders, slowly
    assert 1e-6 < np.hypot(locked.plant.z[6], locked.plant.z[7]) < 1e-5
    assert np.all(np.any(locked.plant.caps != caps, axis=1)), "all four demodulators work"
    assert np.all(locked.plant.late_count == 0)


def test_references_of_the_plant_bench_toggle_twice_a_period(locked):
    """As many edges as the drive frequency says: the work of a tick is that of the real loop."""
    word, ticks = locked.word, 4000
    quadrants = [((tick * 26 * word) & bench.PHASE_MASK) >> 46 for tick in range(ticks)]
    edges = 2 * sum(a != b for a, b in itertools.pairwise(quadrants))
    assert edges == pytest.approx(4 * 2 * word * 26e6 / 2**48 * ticks * 1e-6, abs=3)


RESULT = {
    "clocked_rt": 0.75,
    "firmware_rt": 1.5,
    "plant_rt": 7.5,
    "python_rt": 0.001,
    "first_call_cold_s": 25.04,
    "first_call_warm_s": 1.26,
    "versions": {"python": "3.13.0", "numba": "0.68.1"},
    "cpu": "A processor",
}


def test_the_table_is_the_measurement():
    part = bench.speed_part(RESULT)
    assert "`python -m testbench.bench` on A processor; python 3.13.0, numba 0.68.1" in part
    assert "| clocked_rt | 0.75 | 1333 ns | 750 |" in part
    assert "| python_rt | 0.001 | 1000000 ns | 1 |" in part
    assert "| first_call_cold_s | 25.0 s |" in part
    page = "before\n<!-- speed: written by testbench.bench -->\nold\n<!-- end -->\nafter"
    once = docs.replaced(page, "speed", part)
    assert docs.replaced(once, "speed", part) == once
    assert once.startswith("before\n")
    assert once.endswith("<!-- end -->\nafter")


def test_a_measurement_is_written_whole(tmp_path, monkeypatch, capsys):
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "speed.md").write_text("<!-- speed: written by testbench.bench -->\n<!-- end -->\n")
    monkeypatch.setattr(bench, "ROOT", tmp_path)
    monkeypatch.setattr(bench, "measure", lambda: RESULT)
    assert bench.main() == 0
    assert json.loads((tmp_path / "build" / "bench.json").read_text()) == RESULT
    assert "0.75" in (tmp_path / "docs" / "speed.md").read_text()
    assert "clocked engine" in capsys.readouterr().out


def test_the_median_ignores_a_slow_round(monkeypatch):
    class Fake:
        ticks = 1000

        def clocked(self):
            pass

        firmware = plant_only = clocked

    times = iter([1e-3, 2e-3, 4e-3, 1e-3, 2e-3, 4e-3, 9.0, 9.0, 9.0])
    monkeypatch.setattr(bench, "Bench", Fake)
    monkeypatch.setattr(bench, "cpu_s", lambda work: next(times))
    assert bench.kernels(repeats=3) == {"clocked_rt": 1.0, "firmware_rt": 0.5, "plant_rt": 0.25}


def test_the_documented_numbers_come_from_a_measurement():
    """docs/speed.md holds a table with every key, written by the command that it names."""
    page = (docs.ROOT / "docs" / "speed.md").read_text()
    assert f"Measured with `{bench.COMMAND}`" in page
    for key in ("clocked_rt", "firmware_rt", "plant_rt", "python_rt", "first_call_cold_s", "first_call_warm_s"):
        assert f"| {key} |" in page
