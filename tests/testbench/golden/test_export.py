"""Export: byte-identical twice, complete, and the benches pass on right designs and fail on wrong ones."""

import hashlib
import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fpga_model import sine
from testbench.errors import ConfigError
from testbench.golden import benches, blocks, bundle, cli, export

RTL = Path(__file__).resolve().parents[3] / "testbench" / "rtl"
PINNED = Path(__file__).with_name("golden_sha256.json")
CHOSEN = ("dds", "sine", "agc")
TOOL = {"icarus": "iverilog", "verilator": "verilator", "ghdl": "ghdl"}


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("golden")
    for stem in {*CHOSEN, *(path.stem for path in RTL.glob("*.v")), *(path.stem for path in RTL.glob("*.vhd"))}:
        export.export(stem, folder)
    return folder


def hashes(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "build" not in path.relative_to(folder).parts
    }


def check(folder, sim, rtl=None):
    if shutil.which(TOOL[sim]) is None or shutil.which("make") is None:
        pytest.skip(f"{TOOL[sim]} or make is not installed: the {sim} bench was NOT run")
    command = ["make", "-s", "-C", str(folder), "check", f"SIM={sim}"]
    return subprocess.run(command + ([f"RTL={rtl}"] if rtl else []), capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("stem", CHOSEN)
def test_export_twice_is_byte_identical(out, stem, tmp_path):
    export.export(stem, tmp_path)
    assert hashes(tmp_path / stem) == hashes(out / stem)


@pytest.mark.parametrize("stem", CHOSEN)
def test_bundle_is_complete_and_reads_back(out, stem):
    folder = out / stem / "default"
    found = bundle.read(folder)
    block = blocks.BLOCKS[stem]
    regs, pins = blocks.run(block, "default", found.stim)
    assert np.array_equal(found.exp, np.column_stack([regs, pins]))
    listed = set(found.manifest["sha256"])
    assert {
        *("stim.hex", "exp.hex", "mask.hex", "vec.csv", "params.vh", "params.svh", "params_pkg.vhd", "Makefile"),
        *(f"tb_{stem}.v", f"tb_{stem}.vhd", f"test_{stem}.py", "run_vunit.py", "golden.vcd", "golden.gtkw"),
        *(f"ports/{p.name}.hex" for p in block.columns),
        *(f"ports/{name}.hex" for name, _ in benches.results(block)),
    } <= listed
    rows = (folder / "vec.csv").read_text().splitlines()
    assert len(rows) == found.manifest["n"] + 1
    assert [int(v) for v in rows[-1].split(",")][1:] == [*found.stim[-1].tolist(), *found.exp[-1].tolist()]
    assert found.manifest["families"][0] == ["idle", 0, 8]
    for path in ("test_{}.py", "run_vunit.py"):
        source = (folder / path.format(stem)).read_text()
        compile(source, path, "exec")


def digests(folder):
    """{block/case: hash of the manifest, which holds those of all files}."""
    found = sorted(folder.glob(f"*/*/{bundle.MANIFEST}"))
    return {p.parent.relative_to(folder).as_posix(): json.loads(p.read_text())["manifest_sha256"] for p in found}


def test_bundles_are_those_that_were_shipped(out):
    """To ship others: `gyro golden export all --out DIR --json`, and put the hashes into golden_sha256.json."""
    pinned = json.loads(PINNED.read_text())
    found = digests(out)
    assert found == {name: pinned[name] for name in found}


def test_rom_of_the_sine_is_the_firmwares(out):
    words = [int(line, 16) for line in (out / "sine" / "default" / "rom" / "sine.hex").read_text().split()]
    assert words == sine.ROM.tolist()
    assert "WIDTH = 36;" in (out / "sine" / "default" / "rom" / "sine.mif").read_text()


def test_no_file_names_the_version_or_this_machine(out):
    for path in (out / "dds").rglob("*"):
        if path.is_file() and path.name != bundle.MANIFEST and "build" not in path.parts:
            text = path.read_text()
            assert "0.1.0" not in text, path
            assert str(out) not in text, path


@pytest.mark.parametrize("stem", sorted(path.stem for path in RTL.glob("*.v")))
def test_icarus_bench_passes_on_the_reference_rtl(out, stem):
    done = check(out / stem, "icarus", RTL)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASS ") == len(blocks.BLOCKS[stem].cases)


@pytest.mark.parametrize("stem", sorted(path.stem for path in RTL.glob("*.vhd")))
def test_ghdl_bench_passes_on_the_reference_rtl(out, stem):
    done = check(out / stem, "ghdl", RTL)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASS ") == len(blocks.BLOCKS[stem].cases)


@pytest.mark.slow
@pytest.mark.parametrize("stem", sorted(path.stem for path in RTL.glob("*.v")))
def test_verilator_bench_passes_on_the_reference_rtl(out, stem):
    for case in blocks.BLOCKS[stem].cases:
        done = check(out / stem / case, "verilator", RTL)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "PASS " in done.stdout


@pytest.mark.parametrize(("sim", "package", "tool"), [("cocotb", "cocotb", "iverilog"), ("vunit", "vunit", "ghdl")])
def test_python_bench_passes_on_the_reference_rtl(out, sim, package, tool):
    if importlib.util.find_spec(package) is None or shutil.which(tool) is None or shutil.which("make") is None:
        pytest.skip(f"{package}, {tool} or make is not installed: the {sim} bench was NOT run")
    goal = [f"SIM={sim}", f"RTL={RTL}", f"PYTHON={sys.executable}"]
    command = ["make", "-s", "-C", str(out / "dds" / "default"), "check", *goal]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("sim", ["icarus", "ghdl"])
def test_without_a_design_the_bench_elaborates_and_says_so(out, sim):
    done = check(out / "agc" / "default", sim)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "NO DESIGN agc/default" in done.stdout


def test_a_design_that_is_not_there_is_an_error(out, tmp_path):
    done = check(out / "agc" / "default", "icarus", tmp_path)
    assert done.returncode != 0
    assert "FAIL agc/default: no design" in done.stdout


@pytest.mark.parametrize(
    ("sim", "name", "old", "new"),
    [
        ("icarus", "dds.v", "phase + off_sense_ref", "phase + off_sense_ref + 48'd1"),
        ("icarus", "sine.v", "r_sign2 ? -magnitude", "r_sign2 ? magnitude"),
        ("ghdl", "dds.vhd", "rising_edge", "falling_edge"),
    ],
)
def test_a_wrong_design_fails(out, tmp_path, sim, name, old, new):
    if not (RTL / name).is_file() or old not in (RTL / name).read_text():
        pytest.skip(f"{name} has no {old!r} to break: this mutant was NOT run")
    (tmp_path / name).write_text((RTL / name).read_text().replace(old, new))
    done = check(out / Path(name).stem / "default", sim, tmp_path)
    assert done.returncode != 0
    assert f"FAIL {Path(name).stem}/default: " in done.stdout
    assert "expected" in done.stdout


def test_an_unknown_block_is_one_clear_error(tmp_path):
    with pytest.raises(ConfigError, match="block: 'ddds' is not one of all, dds, sine"):
        export.export("ddds", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_command_line_exports_and_verifies(tmp_path):
    runner = CliRunner()
    done = runner.invoke(cli.app, ["export", "rates", "--out", str(tmp_path), "--json"])
    assert done.exit_code == 0, done.output
    (found,) = json.loads(done.output)["bundles"]
    assert found["rows"] == bundle.read(found["folder"]).manifest["n"]
    done = runner.invoke(cli.app, ["verify", found["folder"]])
    assert (done.exit_code, "ok" in done.output) == (0, True)


@pytest.mark.slow
def test_everything_is_exported_within_a_minute(tmp_path):
    code = "import sys; from testbench.golden.export import export; export('all', sys.argv[1])"
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert digests(tmp_path) == json.loads(PINNED.read_text())
