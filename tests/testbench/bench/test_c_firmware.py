"""The firmware in C, closed around the plant in C++: the codes of the engines, without undefined behaviour."""

import numba
import numpy as np
import pytest

from testbench.bench import c_firmware, kernels, peers
from testbench.console import results
from tests.testbench.bench.test_bench_peers import QUICK, checked, exported, joined, needs  # noqa: F401

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
TICKS, SECONDS = 100_000, 10
SANITIZERS = ("-O1", "-g", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@needs("g++", "gcc")
def test_the_firmware_in_c_equals_the_clocked_engine(exported):  # noqa: F811
    codes = peers.run("c", peers.build_c(exported.folder, QUICK), exported.folder, TICKS)
    checked(codes, exported.long, TICKS)


@needs("g++", "gcc")
@pytest.mark.slow
def test_ten_seconds_equal_the_frame_engine(tmp_path):
    """All codes, all registers and every double of the plant; the hash of a run is over these codes."""
    sim = kernels.gyroscope("frame")
    peers.export(sim, kernels.RATE_RAD_S, tmp_path)
    count = SECONDS * 1_000_000
    parts = [peers.reference(sim, kernels.RATE_RAD_S, TICKS) for _ in range(count // TICKS)]
    codes = peers.run("c", peers.build_c(tmp_path), tmp_path, count)
    checked(codes, joined(parts), count)


@needs("g++", "gcc")
@pytest.mark.slow
def test_sanitizers_find_nothing_in_the_closed_loop(exported, tmp_path):  # noqa: F811
    """Firmware, chips and plant: addresses and undefined behaviour, 12 500 ticks."""
    for name in ("state.bin", "state.hex"):
        (tmp_path / name).write_bytes((exported.folder / name).read_bytes())
    (tmp_path / "model").symlink_to(exported.folder / "model")
    codes = peers.run("c", peers.build_c(tmp_path, SANITIZERS), tmp_path, 12_500)
    assert peers.differences(exported.long, codes) == []
    assert len(np.unique(codes.drive)) > 100


@needs("g++", "gcc")
@pytest.mark.slow
def test_both_are_timed(tmp_path):
    spent = c_firmware.measure_cpu_times(tmp_path, rounds=2, processes=1, ticks=12_500)
    assert set(spent) == {c_firmware.CLOCKED, c_firmware.C}
    assert all(len(times) == 2 and min(times) > 0.0 for times in spent.values())


def test_the_ratio_is_that_of_rounds():
    """Three rounds in which the machine is 1, 2 and 4 times slow: the ratio does not see it."""
    spent = {c_firmware.CLOCKED: [2.0, 4.0, 8.0], c_firmware.C: [1.0, 2.0, 4.0]}
    rows = c_firmware.table(spent).rows
    assert rows[0] == (c_firmware.CLOCKED, "4 s", "2 .. 8", "1.00")
    assert rows[1] == (c_firmware.C, "2 s", "1 .. 4", "2.00")


def test_the_page_has_the_measurement():
    command, (table,) = results.read_results("speed_c_firmware")
    assert command == c_firmware.COMMAND
    (ratio,) = (row[3] for row in table.rows if row[0] == c_firmware.C)
    assert float(ratio) >= 1.5
