"""The comparators give the codes, registers and doubles of the clocked engine: an independent check of both."""

import re
import shutil

import numba
import numpy as np
import pytest

from fpga_model.rates import FRAME_TICKS
from testbench.bench import kernels, peers
from testbench.console import markdown
from testbench.golden.loop import library

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
TICKS, SHORT = 100_000, 1_250
QUICK = ("-O1", "-ffp-contract=off")  # builds in half the time, runs at half the speed


def needs(*tools):
    absent = [name for name in tools if shutil.which(name) is None]
    return pytest.mark.skipif(bool(absent), reason=f"not installed: {', '.join(absent)}")


class Exported:
    """A locked state in a folder, and what the clocked engine made of it."""

    def __init__(self, folder):
        sim = kernels.gyroscope("clocked")
        self.folder = folder
        peers.export(sim, kernels.RATE_RAD_S, folder)
        self.short = peers.reference(sim, kernels.RATE_RAD_S, SHORT)
        rest = peers.reference(sim, kernels.RATE_RAD_S, TICKS - SHORT)
        self.long = joined([self.short, rest])


def joined(parts):
    """`Codes` of runs one after the other."""
    return parts[-1]._replace(
        **{k: np.concatenate([getattr(part, k) for part in parts]) for k in ("drive", "sense", "adc")}
    )


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    return Exported(tmp_path_factory.mktemp("peers"))


def checked(codes, reference, ticks):
    assert len(codes.drive) == len(codes.sense) == ticks == len(reference.drive)
    assert len(codes.adc) == ticks // FRAME_TICKS == len(reference.adc)
    assert set(codes.registers) == set(reference.registers) == set(library.REGISTERS)
    assert len(codes.plant) == len(reference.plant) == peers.PLANT_STATES
    assert len(np.unique(codes.drive)) > 100, "the loop works"
    assert peers.differences(reference, codes) == []
    assert codes.cpu_s > 0.0


@needs("g++", "iverilog")
def test_the_rtl_in_icarus_equals_the_clocked_engine(exported):
    codes = peers.run("icarus", peers.build_icarus(exported.folder), exported.folder, SHORT)
    checked(codes, exported.short, SHORT)


@pytest.mark.slow
@needs("g++", "make", "verilator")
def test_the_rtl_in_verilator_equals_the_clocked_engine(exported):
    codes = peers.run("verilator", peers.build_verilator(exported.folder, QUICK), exported.folder, TICKS)
    checked(codes, exported.long, TICKS)


@pytest.mark.slow
@needs("g++", "make", "verilator")
def test_twenty_seconds_of_the_frame_engine_equal_the_rtl(tmp_path):
    """Long enough for sums in another order to flip a code; here not a bit of the plant differs."""
    sim = kernels.gyroscope("frame")
    peers.export(sim, kernels.RATE_RAD_S, tmp_path)
    parts = [peers.reference(sim, kernels.RATE_RAD_S, TICKS) for _ in range(200)]
    codes = peers.run("verilator", peers.build_verilator(tmp_path), tmp_path, 200 * TICKS)
    checked(codes, joined(parts), 200 * TICKS)


@pytest.mark.slow
@needs("g++", "iverilog")
def test_a_constant_that_is_one_off_would_be_seen(exported, tmp_path):
    for path in exported.folder.glob("*.*"):
        shutil.copy(path, tmp_path)
    design = tmp_path / peers.DESIGN
    gain = re.search(r"rate_loop_loop_ki\(34'h([0-9a-f]+)\)", design.read_text())
    design.write_text(design.read_text().replace(gain[0], f"rate_loop_loop_ki(34'h{int(gain[1], 16) + 1:x})"))
    found = peers.differences(exported.short, peers.run("icarus", peers.build_icarus(tmp_path), tmp_path, SHORT))
    assert any("rate_loop.loop.acc" in line or "sense DAC" in line for line in found), found


def test_a_difference_is_named(exported):
    good = exported.short
    as_peer = good._replace(adc=np.concatenate([good.adc[1:], good.adc[:1]]))
    assert peers.differences(good, as_peer) == []
    drive = good.drive.copy()
    drive[7] += 1
    assert peers.differences(good, as_peer._replace(drive=drive)) == [
        f"drive DAC, tick 7: code {drive[7]} instead of {drive[7] - 1}"
    ]
    adc = as_peer.adc.copy()
    adc[2, 3] = 5
    assert peers.differences(good, as_peer._replace(adc=adc))[0].startswith("ADC channel 3, frame 2: code 5 instead of")
    phase = good.registers["dds.phase"]
    registers = good.registers | {"dds.phase": phase + 1}
    assert peers.differences(good, as_peer._replace(registers=registers)) == [
        f"register dds.phase: {phase + 1} instead of {phase}"
    ]
    plant = good.plant.copy()
    plant[0] = np.nextafter(plant[0], 1e9)
    assert peers.differences(good, as_peer._replace(plant=plant))[0].startswith("plant state 0: ")
    # a shorter run is compared as far as it goes
    cut = as_peer._replace(drive=drive[:7], sense=good.sense[:7], adc=as_peer.adc[:1], registers=registers, plant=plant)
    assert peers.differences(good, cut) == []


def test_what_is_compared_is_what_the_page_says():
    page = " ".join((markdown.ROOT / "docs" / "speed.md").read_text().split())
    assert f"every one of the {len(library.REGISTERS)} registers at the end" in page
    assert f"the plant's {peers.PLANT_STATES} voltages and displacements" in page


def test_what_the_comparators_do_not_know_is_refused(tmp_path):
    unlocked = kernels.gyroscope("clocked", locked=False)
    with pytest.raises(ValueError, match="does not support: a gyroscope that is not locked"):
        peers.export(unlocked, kernels.RATE_RAD_S, tmp_path)
    bent = kernels.gyroscope("clocked", locked=False, changes={"effects.duffing_k3_per_um2": 1e-7})
    with pytest.raises(ValueError, match="does not support: effects"):
        peers.export(bent, kernels.RATE_RAD_S, tmp_path)
    for change, what in (
        ({"firmware.notch_hz": 300.0}, "a notch"),
        ({"firmware.sense_sine_registers": 1}, "extra clock"),
    ):
        changed = kernels.gyroscope("clocked", locked=False, changes=change)
        with pytest.raises(ValueError, match=f"does not support: {what}"):
            peers.export(changed, kernels.RATE_RAD_S, tmp_path)
    with pytest.raises(ValueError, match=r"ticks: 1000000 is above \d+, one chunk"):
        peers.reference(unlocked, kernels.RATE_RAD_S, 1_000_000)


def test_a_tool_that_is_not_there_or_fails_is_one_line(tmp_path, monkeypatch):
    with pytest.raises(peers.Missing, match=r"^no-such-tool is not installed$"):
        peers.tool("no-such-tool")
    monkeypatch.setenv("CXX", "false")
    with pytest.raises(peers.Missing, match=r"^false failed: no message$"):
        peers.build_icarus(tmp_path)


@needs("gcc")
def test_the_peak_is_a_speed(tmp_path):
    pairs = peers.peak_pairs_per_s(peers.build_peak(tmp_path), rounds=1_000_000)
    assert 1e8 < pairs < 1e12
