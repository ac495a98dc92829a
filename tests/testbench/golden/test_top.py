"""Bundles of the whole firmware: complete, identical twice, refused when touched; benches that find what is wrong."""

import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fpga_model import top as firmware
from fpga_model.rates import FRAME_CYCLES
from testbench.engines import engine
from testbench.errors import ConfigError, FileError
from testbench.flatten import leaves
from testbench.golden import cli
from testbench.golden.bundles import benches, bundle, design_bundle
from testbench.golden.bundles.top_benches.layout import DEFAULT_FRAMES
from testbench.golden.recording import recording, replay_recording, signature
from testbench.golden.stimulus import blocks
from tests.testbench.golden import standin
from tests.testbench.golden.benching import NEEDS, RTL, make, need
from tests.testbench.golden.resealing import reseal
from tests.testbench.golden.test_export import pin_of

PINNED = Path(__file__).with_name("golden_sha256.json")
PLAYED = 3  # frames that the stand-in plays
QUIET = 5000  # clock of `reset` without a row: only the signature sees it
CASE = "reset"
END = recording.load(CASE).frames * FRAME_CYCLES  # clocks of the case


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("top")
    design_bundle.export_case(CASE, folder / "top" / CASE)
    return folder / "top"


@pytest.fixture(scope="module")
def played(out):
    """Packed rows of the first frames, clock by clock, and the design whose they are."""
    folder, _ = design_bundle.window(out / CASE, 0, PLAYED * FRAME_CYCLES, out.parent / "played")
    return [int(line, 16) for line in (folder / "exp.hex").read_text().split()]


@pytest.fixture(scope="module")
def design():
    r = recording.load(CASE)
    return design_bundle.build_top_block({CASE: r.params})


@pytest.fixture(scope="module")
def good(out, played, design):
    return standin.write(out.parent / "good", design, CASE, played)


def check(folder, sim, rtl=None, frames=PLAYED):
    need(*NEEDS[sim])
    if sim in ("cocotb", "vunit"):
        pytest.importorskip(sim, reason=f"{sim} is not installed: its bench was NOT run")
    return make(folder, f"SIM={sim}", f"FRAMES={frames}", *([f"RTL={rtl}"] if rtl else []))


def hashes(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "build" not in path.relative_to(folder).parts
    }


# ---- the bundle ------------------------------------------------------------------------------------------------------


def test_bundle_is_complete_and_reads_back(out, design):
    r, found = recording.load(CASE), bundle.read(out / CASE)
    rows = replay_recording.run(r.params, r.stimulus, r.frames, found.at)
    assert np.array_equal(found.stim, rows.inputs)
    assert np.array_equal(found.exp, np.column_stack([rows.registers, rows.pins]))
    assert found.signatures == tuple(signature.remainder_signature(words) for words in rows.remainders)
    assert len(found.signatures) == r.frames
    for window in r.windows:
        assert set(range(window.first, window.first + window.count)) <= set(found.at.tolist())
    assert set(range(0, r.frames * FRAME_CYCLES, FRAME_CYCLES)) <= set(found.at.tolist())
    listed = set(found.manifest["sha256"])
    assert {
        *(f"{name}.hex" for name in ("stim", "exp", "at", "sig", "adc", "host", "sar")),
        *("vec.csv", "params.vh", "params.svh", "params_pkg.vhd", "Makefile", "golden.vcd", "golden.gtkw"),
        *("tb_top.v", "tb_top.vhd", "tb_top_vunit.vhd", "cocotb_top.v", "test_top.py", "run_vunit.py"),
        *("rom/sine.hex", "rom/sine.mif", "rom/cordic_atan.hex", "rom/cordic_atan.mif"),
        *(f"ports/{p.name}.hex" for p in design.columns),
        *(f"ports/{name}.hex" for name, _ in benches.result_port_pairs(design)),
    } <= listed
    lines = (out / CASE / "vec.csv").read_text().splitlines()
    assert [int(v) for v in lines[-1].split(",")] == [found.at[-1], *found.stim[-1], *found.exp[-1]]
    assert len(lines) == len(found.at) + 1


def test_every_register_of_the_design_is_a_port_with_its_rules(design):
    assert [p.name for p in design.registers] == [blocks.port_name(name) for name, _ in leaves(firmware.State())]
    rules = {p.name: (p.rounding, p.overflow) for p in design.registers}
    assert rules["control_agc_loop_acc"] == ("half_up", "saturate")
    assert rules["drive_modulator_code"] == ("half_up", "saturate")
    assert rules["dds_phase"] == (None, "wrap")
    assert rules["control_sequencer_faults_bad_frames"] == (None, "saturate")
    assert [p.name for p in design.pins] == [name for name in engine.PIN_COLUMNS if name in firmware.Pins._fields]


def test_pins_are_those_of_the_clocked_engine():
    from testbench.config import Config
    from testbench.run import build

    params = build.params(Config(), 25.0, 25.0)
    state, streams = (
        engine.reset(params, 25.0),
        engine.streams(ticks=250, edges=6500, register_count=replay_recording.REGISTERS),
    )
    engine.run(params, state, 250, np.zeros(4), np.full(4, 25.0), engine.NO_WRITE, engine.Faults(), streams)
    adc = recording.load("power_on").stimulus.adc
    none = np.zeros((0, 4), np.int64), np.zeros((0, 2), np.int64)
    rows = replay_recording.run(
        params.fpga, replay_recording.Stimulus(adc[adc[:, 0] < 6500], *none), 2, np.arange(6500)
    )
    assert np.array_equal(rows.registers, streams.registers)
    at = {name: k for k, name in enumerate(engine.PIN_COLUMNS)}
    assert np.array_equal(rows.pins, streams.pins[:, [at[name] for name in firmware.Pins._fields]])
    assert np.array_equal(rows.inputs[:, 1:3], streams.pins[:, [at["drdy_n"], at["dout"]]])


def test_signatures_are_the_definition_applied_to_every_clock(out, played, design):
    width = sum(p.width for _, p in benches.result_port_pairs(design))
    stored = [int(line, 16) for line in (out / CASE / "sig.hex").read_text().split()]
    for frame in range(PLAYED):
        rows = played[frame * FRAME_CYCLES : (frame + 1) * FRAME_CYCLES]
        assert signature.signature(rows, width) == stored[frame]
    assert len(set(stored)) == len(stored)


def test_reset_in_the_middle_loads_the_reset_values_in_one_clock(out):
    found = bundle.read(out / CASE)
    resets = np.flatnonzero(found.stim[:, 0])
    values = [port["reset"] for port in found.manifest["registers"]]
    assert len(resets) == sum(recording.load(CASE).stimulus.host[:, 1])
    for row in resets:
        assert found.at[row + 1] == found.at[row] + 1
        assert found.exp[row + 1, : len(values)].tolist() == values


def test_bundle_is_the_one_that_was_shipped(out):
    assert pin_of(bundle.verify(out / CASE)) == json.loads(PINNED.read_text())[f"{design_bundle.STEM}/{CASE}"]


@pytest.mark.slow
@pytest.mark.parametrize("case", design_bundle.CASES)
def test_export_again_is_byte_identical(out, case, tmp_path):
    manifest = design_bundle.export_case(case, tmp_path / "top" / case)
    assert pin_of(manifest) == json.loads(PINNED.read_text())[f"{design_bundle.STEM}/{case}"]
    assert case != CASE or hashes(tmp_path / "top" / case) == hashes(out / case)


def test_an_export_loads_neither_plant_nor_engine():
    code = "import sys, testbench.golden.bundles.export as e; print(*sorted(m for m in sys.modules if '.' in m))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "testbench.golden.bundles.design_bundle" in loaded
    assert {m for m in loaded if m.startswith("analog_frontend.")} == {
        "analog_frontend.parts",
        "analog_frontend.parts.adc_serial",
    }
    assert not loaded & {
        "testbench.engines.engine",
        "testbench.run.build",
        "testbench.run.simulate",
        "testbench.golden.recording.make_recordings",
    }


def test_waves_show_the_windows_at_their_own_times(out):
    pywellen = pytest.importorskip("pywellen")
    found = bundle.read(out / CASE)
    wave = pywellen.Waveform(str(out / CASE / "golden.vcd"))
    slot = next(var for var in wave.all_vars() if var.full_name.split(" ")[0].endswith("reg.rates_slot"))
    changes = [(int(time), int(value)) for time, value in slot.signal]
    k = [port["name"] for port in found.manifest["registers"]].index("rates_slot")
    row = int(np.flatnonzero(found.exp[:, k] == 30)[0])
    assert ((2 * 500_000 * int(found.at[row]) + 13) // 26, 30) in changes


def test_the_page_states_the_cases_and_the_frames_that_are_run():
    page = (RTL.parents[1] / "docs" / "golden.md").read_text()
    for case in design_bundle.CASES:
        r = recording.load(case)
        cells = f"| `{case}` | {r.frames} | {r.frames * FRAME_CYCLES} | {len(design_bundle.row_clocks(r))} |"
        assert cells in page
    for sim, frames in DEFAULT_FRAMES.items():
        assert f"| {sim} | {frames or 'all'} |" in page


# ---- damage ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def copy(out, tmp_path):
    return Path(shutil.copytree(out / CASE, tmp_path / CASE, ignore=shutil.ignore_patterns("build")))


@pytest.mark.parametrize("name", ["at", "stim", "exp", "sig", "adc", "host", "sar"])
def test_a_changed_missing_or_unlisted_file_is_refused(copy, name):
    path = copy / f"{name}.hex"
    text = path.read_text()
    path.write_text(text + "0\n")
    with pytest.raises(FileError, match=rf"{name}\.hex: SHA-256 does not match"):
        bundle.verify(copy)
    path.unlink()
    with pytest.raises(FileError, match=rf"{name}\.hex: missing"):
        bundle.verify(copy)
    path.write_text(text)
    reseal(copy, lambda m: m["sha256"].pop(f"{name}.hex"))
    with pytest.raises(FileError, match=rf"{name}\.hex is not listed"):
        bundle.verify(copy)


@pytest.mark.parametrize(
    "name", ["exp", "host", *(pytest.param(n, marks=pytest.mark.slow) for n in ("at", "sig", "adc"))]
)
def test_truncated_hex_is_refused_even_with_the_right_hash(copy, name):
    path = copy / f"{name}.hex"
    text = path.read_text()
    for cut, expected in ((text[:-1], "truncated"), (text[: text.rindex("\n", 0, -1) + 1], "rows, expected")):
        path.write_text(cut)
        reseal(copy)
        with pytest.raises(FileError, match=expected):
            bundle.read(copy)


@pytest.mark.parametrize("name", ["at", "adc", "host"])
def test_clocks_that_do_not_rise_or_leave_the_case_are_refused(copy, name):
    path = copy / f"{name}.hex"
    lines = path.read_text().splitlines()
    last = "ffffffff" + lines[-1][8:]
    for wrong in ([*lines[1::-1], *lines[2:]], [*lines[:-1], last]):
        path.write_text("\n".join(wrong) + "\n")
        reseal(copy)
        with pytest.raises(FileError, match=rf"the clocks do not strictly increase within 0 \.\. {END - 1}$"):
            bundle.read(copy)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda m: m.update(schema="gyro-golden-replay/2.0"), "schema is 'gyro-golden-replay/2.0'"),
        (lambda m: m.pop("frames"), "frames is missing"),
        (lambda m: m.update(conversions=-1), "conversions is -1"),
        (lambda m: m.update(windows="none"), "windows is missing or not of type list"),
    ],
)
def test_a_manifest_without_its_counts_is_refused(copy, change, text):
    reseal(copy, change)
    with pytest.raises(FileError, match=text):
        bundle.read(copy)


# ---- windows ---------------------------------------------------------------------------------------------------------


def test_window_holds_every_clock_of_its_place_and_the_same_signatures(out, tmp_path):
    folder, manifest = design_bundle.window(out / CASE, 3 * FRAME_CYCLES - 7, 40, tmp_path / "w")
    found, whole = bundle.read(folder), bundle.read(out / CASE)
    assert set(range(3 * FRAME_CYCLES - 7, 3 * FRAME_CYCLES + 33)) <= set(found.at.tolist())
    assert manifest["frames"] == 4
    assert found.signatures == whole.signatures[:4]
    assert manifest["recording_sha256"] != whole.manifest["recording_sha256"]
    assert design_bundle.window(out / CASE, 0, 1)[0] == out / f"{CASE}_0"
    assert design_bundle.window(out / CASE / "pins", 0, 1)[0] == out / f"{CASE}_pins_0"


def test_places_outside_the_case_are_refused(out, tmp_path):
    for clock, count in ((-1, 5), (END - 4, 5), (0, 0), (0, design_bundle.MAX_WINDOW + 1)):
        with pytest.raises(ConfigError, match="is outside"):
            design_bundle.window(out / CASE, clock, count, tmp_path / "w")
    assert not (tmp_path / "w").exists()


def test_window_of_another_recording_or_of_a_block_is_refused(copy, tmp_path):
    reseal(copy, lambda m: m.update(recording_sha256="0" * 64))
    with pytest.raises(FileError, match="export it again"):
        design_bundle.window(copy, 0, 5, tmp_path / "w")
    reseal(copy, lambda m: m.update(case="nothing"))
    with pytest.raises(FileError, match="is not one of reset, story"):
        design_bundle.window(copy, 0, 5, tmp_path / "w")
    from testbench.golden.bundles.export import export

    ((folder, _),) = export("isqrt", tmp_path)
    with pytest.raises(ConfigError, match="has a row for every clock"):
        design_bundle.window(folder, 0, 5, tmp_path / "w")


def test_command_line(out, tmp_path):
    run = CliRunner().invoke
    done = run(cli.app, ["verify", str(out / CASE)])
    assert done.exit_code == 0, done.output
    assert f"{len(bundle.read(out / CASE).at)} rows" in done.output
    done = run(cli.app, ["window", str(out / CASE), "--frame", "1", "--out", str(tmp_path / "w")])
    assert done.exit_code == 0, done.output
    assert bundle.read(tmp_path / "w").at[-FRAME_CYCLES] == FRAME_CYCLES
    for wrong in ([], ["--frame", "1", "--clock", "5"]):
        assert isinstance(run(cli.app, ["window", str(out / CASE), *wrong]).exception, ConfigError)


# ---- benches ---------------------------------------------------------------------------------------------------------

SIMS = list(NEEDS)
QUICK = ("icarus", "ghdl", "cocotb")


@pytest.mark.parametrize("sim", [s if s in QUICK else pytest.param(s, marks=pytest.mark.slow) for s in SIMS])
def test_bench_elaborates_without_a_design(out, sim):
    done = check(out / CASE, sim)
    assert done.returncode == 0, done.stdout
    assert "NO DESIGN top/reset: " in done.stdout


def test_a_folder_without_the_design_is_an_error(out, tmp_path):
    done = check(out / CASE, "icarus", tmp_path)
    assert done.returncode != 0
    assert "no design" in done.stdout


@pytest.mark.parametrize("sim", [s if s == "icarus" else pytest.param(s, marks=pytest.mark.slow) for s in SIMS])
def test_bench_passes_on_a_design_that_plays_the_rows(out, good, sim):
    frames = 1 if sim in ("ghdl", "vunit") else PLAYED  # GHDL takes a second for a frame
    done = check(out / CASE, sim, good, frames)
    assert done.returncode == 0, done.stdout
    assert "PASS top/reset: " in done.stdout


@pytest.mark.parametrize("sim", ["icarus", *(pytest.param(sim, marks=pytest.mark.slow) for sim in ("ghdl", "cocotb"))])
def test_bench_names_clock_register_and_both_values(out, played, design, tmp_path, sim):
    bad = standin.write(tmp_path / "bad", design, CASE, played, (40, "r_dds_phase", 1 << 20))
    done = check(out / CASE, sim, bad, 1)
    assert done.returncode != 0
    lo = next(lo for name, _, _, lo in benches.slices(benches.result_port_pairs(design)) if name == "r_dds_phase")
    want = played[40] >> lo & ((1 << 48) - 1)
    values = f"expected {want:x}, got {want ^ 1 << 20:x}"
    text = done.stdout.lower().replace(f"expected {want:012x}", f"expected {want:x}")
    assert f"clock 40: r_dds_phase: {values}" in text.replace(
        f"got {want ^ 1 << 20:012x}", f"got {want ^ 1 << 20:x}"
    ), text
    assert "clock 41:" not in text
    assert "frame 0" in text


@pytest.mark.slow
@pytest.mark.parametrize("sim", ["icarus", "verilator"])
def test_signature_finds_the_frame_and_its_window_the_register(out, played, design, tmp_path, sim):
    at = bundle.read(out / CASE).at
    assert QUIET not in at
    bad = standin.write(tmp_path / "bad", design, CASE, played, (QUIET, "r_control_agc_loop_acc", 1))
    done = check(out / CASE, sim, bad)
    assert done.returncode != 0
    assert "frame 1 (clocks 3250 .. 6499): signature: expected" in done.stdout
    assert "FAIL top/reset: 1 of 3 frames differ, all" in done.stdout
    assert "gyro golden window --frame 1" in done.stdout
    folder, _ = design_bundle.window(out / CASE, FRAME_CYCLES, FRAME_CYCLES, tmp_path / "window")
    done = check(folder, sim, bad, 0)
    assert f"clock {QUIET}: r_control_agc_loop_acc: expected" in done.stdout
    assert "FAIL top/reset: 1 of " in done.stdout


@pytest.mark.parametrize("sim", ["icarus", pytest.param("ghdl", marks=pytest.mark.slow)])
def test_a_stuck_chip_select_shows_as_a_wrong_input(out, played, design, tmp_path, sim):
    # the converter answers the pins: without a falling CS_N it sends nothing
    rows = list(played)
    low = {name: lo for name, _, _, lo in benches.slices(benches.result_port_pairs(design))}["o_adc_cs_n"]
    rows = [word | 1 << low for word in rows]
    bad = standin.write(tmp_path / "bad", design, CASE, rows)
    done = check(out / CASE, sim, bad, 2)
    assert "o_adc_cs_n: expected 0, got 1" in done.stdout
    assert "clock 3244: dout: expected 1, got 0" in done.stdout


LONGER = [("icarus", 0), ("verilator", 0), ("cocotb", 2), ("cocotb-verilator", 2)]


@pytest.mark.parametrize(
    ("sim", "frames"), [("icarus", 4), *(pytest.param(*entry, marks=pytest.mark.slow) for entry in LONGER)]
)
def test_reference_rtl_passes(out, sim, frames):
    done = check(out / CASE, sim, RTL, frames)
    assert done.returncode == 0, done.stdout
    assert "PASS top/reset" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in design_bundle.CASES if case != CASE])
def test_reference_rtl_passes_every_other_case(tmp_path, case):
    design_bundle.export_case(case, tmp_path / "top" / case)
    done = check(tmp_path / "top" / case, "verilator", RTL, 0)
    assert done.returncode == 0, done.stdout
    assert f"PASS top/{case}" in done.stdout
