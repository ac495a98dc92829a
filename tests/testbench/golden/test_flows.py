"""Bundles in other flows: commands of simulators beside edalize's, FuseSoC, cocotb 1 and 2 inside and outside."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from testbench.golden.bundles import design_bundle
from testbench.golden.loop import library
from tests.testbench.golden.benching import RTL, need

DESIGNS = Path(__file__).with_name("designs")
ROOT = Path(__file__).resolve().parents[3]
COCOTB = ("1.9.2", "2.1.0")


def printed(folder, tool, **given):
    """Lines that `make TOOL` prints."""
    goals = [f"{key}={value}" for key, value in given.items()]
    done = subprocess.run(["make", "-s", "-C", str(folder), tool, *goals], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout
    return done.stdout.splitlines()


def generated(tool, folder, files, macros):
    """Lines of sources that edalize writes for a tool; `files` are (path, type, library)."""
    pytest.importorskip("edalize", reason="edalize is not installed: its commands were NOT compared")
    listed = [{"name": path, "file_type": kind, "logical_name": library} for path, kind, library in files]
    listed.append({"name": "params.vh", "file_type": "verilogSource", "is_include_file": True})
    listed.append({"name": f"{RTL}/any.vh", "file_type": "verilogSource", "is_include_file": True})
    defines = {name: {"datatype": "bool", "default": True, "paramtype": "vlogdefine"} for name in macros}
    edam = {"name": "x", "toplevel": "tb", "files": listed, "parameters": defines, "tool_options": {tool: {}}}
    # in a process of its own: it leaves files open
    program = f"from edalize.edatool import get_edatool as get; get({tool!r})(edam={edam!r}, work_root='.').configure()"
    subprocess.run([sys.executable, "-c", program], cwd=folder, check=True, capture_output=True, timeout=60)
    name = {"xcelium": "edalize_build_rtl.f", "vcs": "x.scr"}.get(tool, "edalize_build_rtl.tcl")
    return (folder / name).read_text().splitlines()


def words(line):
    """Words of a command whose order is free but for the last, the source."""
    *options, last = line.split()
    return (*sorted(options), last)


SOURCES = {
    "verilog": (
        "dds/default", {"RTL": RTL, "LEVEL": "outputs"}, ("LEVEL_OUTPUTS",),
        [("tb_dds.v", "verilogSource-2005", ""), (f"{RTL}/dds.v", "verilogSource-2005", "")],
    ),
    "vhdl": (
        "modulator/dac20", {"RTL": DESIGNS / "amp_mod", "FILES": "amp_mod.f"}, (),
        [("params_pkg.vhd", "vhdlSource-2008", ""),
         (f"{DESIGNS}/amp_mod/dsp/fx.vhd", "vhdlSource-2008", "dsp"),
         (f"{DESIGNS}/amp_mod/dsp/mult24x18.vhd", "vhdlSource-2008", "dsp"),
         (f"{DESIGNS}/amp_mod/amp_mod.vhd", "vhdlSource-2008", "my_lib"),
         ("tb_modulator.vhd", "vhdlSource-2008", "")],
    ),
}  # fmt: skip


@pytest.mark.parametrize("language", SOURCES)
@pytest.mark.parametrize(("tool", "theirs"), [("questa", "modelsim"), ("riviera", "rivierapro")])
def test_commands_of_questa_and_riviera_are_those_of_edalize(bundles, tmp_path, tool, theirs, language):
    case, given, macros, files = SOURCES[language]
    lines = printed(bundles(case.partition("/")[0]) / case.partition("/")[2], tool, **given)
    assert re.fullmatch(r'vsim -c -do "run -all; quit" tb_\w+', lines[-1])
    assert [words(line) for line in lines[:-1]] == [words(x) for x in generated(theirs, tmp_path, files, macros)]


@pytest.mark.parametrize("language", SOURCES)
def test_commands_of_xcelium_are_those_of_edalize(bundles, tmp_path, language):
    case, given, macros, files = SOURCES[language]
    (line,) = printed(bundles(case.partition("/")[0]) / case.partition("/")[2], "xcelium", **given)
    found = re.findall(r"-makelib .*? -endlib", line)
    theirs = generated("xcelium", tmp_path, files, macros)
    assert [words(x.removesuffix(" -endlib")) for x in found] == [words(x.removesuffix(" -endlib")) for x in theirs]
    assert re.fullmatch(r"xrun -q (-makelib .* -endlib ?)+ -top tb_\w+", line)


def test_commands_of_vcs_are_those_of_edalize(bundles, tmp_path):
    _, given, macros, files = SOURCES["verilog"]
    (line,) = printed(bundles("dds") / "default", "vcs", **given)
    theirs = generated("vcs", tmp_path, files, macros)
    head, _, rest = line.partition(" -top tb_dds ")
    assert head == "vcs -full64"
    assert sorted(rest.partition(" -o ")[0].split()) == sorted(theirs)


def test_a_level_below_registers_writes_its_vhdl_bench_first(bundles):
    case, given, _, _ = SOURCES["vhdl"]
    folder = bundles(case.partition("/")[0]) / case.partition("/")[2]
    lines = printed(folder, "questa", **given, LEVEL="outputs")
    assert lines[0] == "mkdir -p build && LEVEL=outputs sh check.sh bench >build/tb_modulator.vhd"
    subprocess.run(["sh", "-c", lines[0]], cwd=folder, check=True, timeout=60)
    text = (folder / "build" / "tb_modulator.vhd").read_text()
    assert "r_product :" not in text
    assert "o_out : out" in text


@pytest.mark.slow
@pytest.mark.parametrize("tool", ["icarus", "verilator"])
def test_fusesoc_runs_a_bundle_with_a_design_that_is_a_core(bundles, tmp_path, tool):
    pytest.importorskip("fusesoc", reason="FuseSoC is not installed: its core was NOT run")
    need(*({"icarus": ("iverilog",), "verilator": ("verilator", "g++")}[tool]))
    shutil.copytree(bundles("sine") / "default", tmp_path / "bundle")
    (tmp_path / "mine").mkdir()
    shutil.copy(RTL / "sine.v", tmp_path / "mine")
    (tmp_path / "mine" / "sine.core").write_text(
        "CAPI=2:\nname: gyro:design:sine:1.0.0\nfilesets:\n  rtl:\n    files: [sine.v]\n"
        "    file_type: verilogSource-2005\ntargets:\n  default:\n    filesets: [rtl]\n"
    )
    command = [sys.executable, "-m", "fusesoc.main", "--cores-root", ".", "run", "--target", "sim", "--tool", tool]
    done = subprocess.run([*command, "gyro:golden:sine_default", "--LEVEL_OUTPUTS"], cwd=tmp_path, capture_output=True,
                          text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "PASS sine/default: 4345 rows, 1 ports at level outputs" in done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", ["top_reset", "top_reset_pins"])
def test_fusesoc_finds_a_bundle_of_the_whole_design_and_its_pins_in_one_tree(tmp_path, name):
    pytest.importorskip("fusesoc", reason="FuseSoC is not installed: its core was NOT run")
    need("iverilog")
    design_bundle.export_case("reset", tmp_path / "top" / "reset")
    (tmp_path / "mine").mkdir()
    files = [Path(shutil.copy(path, tmp_path / "mine")).name for path in library.sources(RTL)]
    (tmp_path / "mine" / "top.core").write_text(
        f"CAPI=2:\nname: gyro:design:top:1.0.0\nfilesets:\n  rtl:\n    files: [{', '.join(files)}]\n"
        "    file_type: verilogSource-2005\ntargets:\n  default:\n    filesets: [rtl]\n"
    )
    command = [sys.executable, "-m", "fusesoc.main", "--cores-root", ".", "run", "--target", "sim"]
    done = subprocess.run([*command, f"gyro:golden:{name}", "--FRAMES=1"], cwd=tmp_path, capture_output=True,
                          text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    ports = 13 if name.endswith("_pins") else 230
    assert f" rows of {ports} ports, 1 of 72 frames" in done.stdout + done.stderr


@pytest.fixture(scope="module", params=COCOTB)
def python_of_cocotb(request, tmp_path_factory):
    """Interpreter of an environment of its own with one version of cocotb."""
    folder = tmp_path_factory.mktemp("cocotb")
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True, timeout=300)
    packages = [f"cocotb=={request.param}", "pytest"]
    done = subprocess.run(
        [folder / "bin" / "pip", "install", "-q", *packages], capture_output=True, text=True, timeout=600
    )
    if done.returncode:
        pytest.skip(f"cocotb {request.param} cannot be installed, so it was NOT run: {done.stderr[-200:]}")
    return request.param, folder / "bin" / "python"


@pytest.mark.slow
@pytest.mark.parametrize("inside", [False, True])
def test_cocotb_runs_a_bundle_inside_and_outside_of_a_pytest_project(bundles, tmp_path, python_of_cocotb, inside):
    need("iverilog")
    version, python = python_of_cocotb
    shutil.copytree(bundles("dds") / "default", tmp_path / "bundle")
    if inside:
        # the project's own settings, which name a module that the environment of cocotb lacks
        shutil.copy(ROOT / "pyproject.toml", tmp_path)
        assert "pytest_benchmark" in (tmp_path / "pyproject.toml").read_text()
    goals = ["make", "-s", "-C", str(tmp_path / "bundle"), "check", f"RTL={RTL}", f"PYTHON={python}"]
    done = subprocess.run([*goals, "SIM=cocotb"], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (0, "PASS dds/default: 3440 rows, 5 ports [cocotb]\n"), done.stdout
    if shutil.which("verilator") is None or inside:
        return
    release = float(subprocess.run(["verilator", "--version"], capture_output=True, text=True).stdout.split()[1])
    done = subprocess.run([*goals, "SIM=cocotb-verilator"], capture_output=True, text=True, timeout=300)
    if version.startswith("2") and release < 5.036:
        said = f"cocotb {version} needs Verilator 5.036 or later, this is {release:.3f}"
        assert done.stdout == f"FAIL dds/default: cocotb-verilator: {said}\n"
    else:
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("count", [2])
def test_checks_of_one_bundle_do_not_meet(bundles, tmp_path, count):
    """One right design and one wrong one at the same time: each gets its own verdict."""
    need("iverilog")
    folder, wrong = bundles("dds") / "default", tmp_path / "wrong"
    wrong.mkdir()
    text = (RTL / "dds.v").read_text()
    (wrong / "dds.v").write_text(text.replace("phase + off_sense_ref", "phase - off_sense_ref"))
    environment = {k: v for k, v in os.environ.items() if k != "PYTEST_CURRENT_TEST"}
    running = [
        subprocess.Popen(["sh", str(folder / "check.sh"), "icarus"], env={**environment, "RTL": str(rtl)},
                         stdout=subprocess.PIPE, text=True)
        for rtl in (RTL, wrong) * count
    ]  # fmt: skip
    said = [process.communicate(timeout=120)[0] for process in running]
    assert [process.returncode for process in running] == [0, 1] * count
    assert all(text.startswith("PASS ") for text in said[::2])
    assert all(text.startswith("row ") for text in said[1::2])
    assert list((folder / "build").glob("check.*")) == []
