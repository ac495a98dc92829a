"""The locked loop with a host at its pins: samples are the model's, and rates mean something."""

import math
import shutil
import subprocess
from pathlib import Path

import numba
import numpy as np
import pytest

from fpga_model import sequencer
from testbench.config import Config
from testbench.errors import ConfigError, FileError
from testbench.host import export_host
from tests.testbench.rtl import test_host

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
HERE = Path(__file__).parent
DEG = math.pi / 180
FAST, MIXED = 1400, 600
# deg/s; least and greatest period of SCK (clocks), share of wrong frames, samples
SEGMENTS = ((0.0, 5, 7.8, 0.0, 467), (100.0, 5, 7.8, 0.0, 467), (-50.0, 5, 7.8, 0.0, 466), (-50.0, 5, 260, 0.33, MIXED))


def test_a_folder_with_something_else_is_not_replaced(tmp_path):
    (tmp_path / "host").mkdir()
    (tmp_path / "host" / "mine.txt").write_text("mine")
    with pytest.raises(FileError, match=r"host: is not empty and has no gyro_loop\.h"):
        export_host.export(tmp_path / "host", Config())
    assert (tmp_path / "host" / "mine.txt").read_text() == "mine"


def test_another_bus_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"^gyro host: --bus i2c: one of spi, axi is needed$"):
        export_host.export(tmp_path / "host", Config(), "i2c")
    assert not (tmp_path / "host").exists()


@pytest.mark.slow
def test_two_thousand_samples_are_the_models_and_a_rate_is_measured(tmp_path):
    """Locked, noise on: SCK of 0.1 to 5.2 MHz at any phase, a third of the frames wrong in the last segment."""
    for tool in ("verilator", "g++", "make"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed: the locked loop was NOT read")
    pytest.importorskip("systemrdl", reason="systemrdl-compiler is not installed: the C driver was NOT tried")
    from testbench.register_map import export_registers as register_map

    sim, rate_rad_s = export_host.locked_simulation(Config())
    export_host.write_loop(tmp_path, sim, rate_rad_s)
    register_map.export(tmp_path / "map")
    shutil.copy(HERE / "locked_host.cpp", tmp_path / "loop.cpp")
    shutil.copy(Path(test_host.__file__).with_name("host_bench.h"), tmp_path)
    command = "verilator --cc --exe -O3 --x-assign fast --x-initial fast --noassert -Wno-lint -Wno-fatal --Mdir built"
    command += f" -CFLAGS -std=c++17 -CFLAGS -I{tmp_path} -CFLAGS -I{tmp_path}/map/c --top-module gyro_board"
    command += " -o locked_host gyro_board.v loop.cpp map/c/gyro_spi.c map/c/gyro_driver.c"
    rtl = sorted(map(str, (tmp_path / "rtl").glob("*.v")))
    subprocess.run([*command.split(), *rtl], cwd=tmp_path, check=True, capture_output=True)
    fast = "-O1 -ffp-contract=off"
    make = ["make", "-s", "-C", "built", "-f", "Vgyro_board.mk", f"OPT_FAST={fast}", f"OPT_GLOBAL={fast}"]
    subprocess.run(make, cwd=tmp_path, check=True, capture_output=True)
    given = ["built/locked_host", "state.bin", "6", "lines.bin", *(str(v) for segment in SEGMENTS for v in segment)]
    done = subprocess.run(given, cwd=tmp_path, check=True, capture_output=True, text=True)
    *told, broken = done.stdout.splitlines()
    assert broken == "broken 0", "SDO stands around every rise of SCK"

    found = np.fromfile(tmp_path / "lines.bin", "<i8").reshape(-1, len(test_host.COLUMNS))
    lines = {name: found[:, k] for k, name in enumerate(test_host.COLUMNS)}
    segments = [(int(frames), float(mean), float(error)) for frames, mean, error in map(str.split, told)]
    sim.keep_rows = True
    for (frames, _, _), (rate_dps, *_) in zip(segments, SEGMENTS, strict=True):
        sim.advance(frames * 125, rate_dps * DEG, 25.0)
    rows = sim.columns()
    assert (rows["state"] == sequencer.LOCKED).all()
    edge = int(np.flatnonzero(lines["begin"] >= sum(s[0] for s in segments[:3]) * test_host.FRAME_CLOCKS)[0])
    test_host.checked(lines, rows, edge, FAST, MIXED, reset_clocks=0, first_frame=0)

    # bias and scale factor from the first two rates, then the third is measured
    (_, zero, of_zero), (_, hundred, of_hundred), (_, third, of_third), _ = segments
    measured = 100 * (third - zero) / (hundred - zero)
    error = math.sqrt(of_third**2 + (1.5 * of_zero) ** 2 + (0.5 * of_hundred) ** 2)
    assert error < 0.1
    assert abs(measured + 50) < 4 * error
