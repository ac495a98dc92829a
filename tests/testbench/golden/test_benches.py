"""Every bench on every reference design, and the words and exit codes of `make check`."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from testbench.golden.bundles import benches, bundle
from testbench.golden.stimulus import blocks
from tests.testbench.golden.benching import COUNTING, RTL, VERILOG, VHDL, check, make, need, seed

PAGE = Path(__file__).resolve().parents[3] / "docs" / "golden.md"
SLOW = pytest.mark.slow


# One simulator proves the bench of a block in the fast set, on one of its cases; every other pair is slow
FAST = {
    **{(stem, next(iter(block.cases))): "icarus" for stem, block in blocks.BLOCKS.items() if stem not in COUNTING},
    ("spi_dac", "dac8811"): "ghdl",
    ("references", "align0_retimed"): "ghdl",
}


def matrix(stems, sim, first_case=False):
    """(block, case) of a simulator, slow but for those of `FAST`."""
    listed = []
    for stem in stems:
        for case in list(blocks.BLOCKS[stem].cases)[: 1 if first_case else None]:
            listed.append(pytest.param(stem, case, marks=() if FAST.get((stem, case)) == sim else SLOW))
    return listed


def passes(bundles, stem, case, sim, rtl=RTL):
    done = check(bundles(stem) / case, sim, rtl)
    assert done.returncode == 0, done.stdout
    assert f"PASS {stem}/{case}: " in done.stdout
    assert done.stdout.rstrip().endswith(f"[{sim}]")


@pytest.mark.parametrize(("stem", "case"), matrix(VERILOG, "icarus"))
def test_icarus(bundles, stem, case):
    passes(bundles, stem, case, "icarus")


@pytest.mark.parametrize(("stem", "case"), matrix(VHDL, "ghdl"))
def test_ghdl(bundles, stem, case):
    passes(bundles, stem, case, "ghdl")


@pytest.mark.parametrize(("stem", "case"), matrix(VERILOG, "verilator"))
def test_verilator(bundles, verilated, stem, case):
    seed(bundles(stem) / case / "build" / "verilator", verilated)
    passes(bundles, stem, case, "verilator")


@pytest.mark.parametrize(("stem", "case"), matrix(VERILOG, "cocotb"))
def test_cocotb(bundles, stem, case):
    passes(bundles, stem, case, "cocotb")


@pytest.mark.parametrize(("stem", "case"), matrix(VERILOG, "cocotb-verilator", first_case=True))
def test_cocotb_on_verilator(bundles, stem, case):
    passes(bundles, stem, case, "cocotb-verilator")


@pytest.mark.parametrize(("stem", "case"), matrix(VHDL, "vunit"))
def test_vunit(bundles, stem, case):
    passes(bundles, stem, case, "vunit")


def test_every_block_is_in_the_fast_set():
    """And every simulator: dds passes in each of them, see the plain check below; wrong designs fail in three."""
    assert {stem for stem, _ in FAST} | COUNTING == set(VERILOG) == set(blocks.BLOCKS)
    assert set(FAST.values()) == {"icarus", "ghdl"}


# No design -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sim", "stem"),
    [pytest.param(sim, stem, marks=() if (sim == "ghdl" and stem not in {*VHDL, *COUNTING}) or stem == "dds" else SLOW)
     for sim in ("icarus", "ghdl") for stem in blocks.BLOCKS],
)  # fmt: skip
def test_every_bench_elaborates_without_a_design(bundles, stem, sim):
    case = next(iter(blocks.BLOCKS[stem].cases))
    done = check(bundles(stem) / case, sim)
    assert (done.returncode, done.stdout) == (
        0,
        f"NO DESIGN {stem}/{case}: the bench elaborates, no design was given [{sim}]\n",
    )


@pytest.mark.slow
@pytest.mark.parametrize("sim", ["verilator", "cocotb", "vunit"])
@pytest.mark.parametrize("stem", blocks.BLOCKS)
def test_slower_benches_without_a_design(bundles, verilated, stem, sim):
    case = next(iter(blocks.BLOCKS[stem].cases))
    seed(bundles(stem) / case / "build" / "verilator", verilated)
    done = check(bundles(stem) / case, sim)
    assert done.returncode == 0, done.stdout
    assert done.stdout.startswith(f"NO DESIGN {stem}/{case}: ")


def test_a_design_that_is_not_there_is_an_error(bundles, tmp_path):
    done = check(bundles("agc") / "default", "icarus", tmp_path)
    assert done.returncode != 0
    assert f"FAIL agc/default: no design {tmp_path}/agc.v, .sv or .vhd, and no FILES" in done.stdout
    done = check(bundles("agc") / "default", "icarus", "nowhere")
    assert done.returncode != 0
    assert f"FAIL agc/default: no folder nowhere, seen from {bundles('agc')}/default\n" in done.stdout


# Every simulator at once ---------------------------------------------------------------------------------------------


def test_plain_check_runs_every_simulator_that_has_a_design_and_writes_into_build_alone(bundles, verilated):
    need("iverilog", "verilator", "g++", "ghdl")
    folder = bundles("dds") / "default"
    seed(folder / "build" / "verilator", verilated)
    shipped = {name.partition("/")[0] for name in bundle.read(folder).manifest["sha256"]}
    done = make(bundles("dds"), f"RTL={RTL}")
    assert done.returncode == 0, done.stdout
    assert {path.name for path in folder.iterdir()} == shipped | {bundle.MANIFEST, "build"}
    said = [line.rpartition(" ")[2] for line in done.stdout.splitlines() if line.startswith("PASS dds/default: ")]
    assert said == ["[icarus]", "[verilator]", "[ghdl]", "[cocotb]", "[vunit]"]


def test_plain_check_names_what_it_skips_and_why(bundles, tmp_path):
    need("iverilog", "ghdl")
    shutil.copy(RTL / "dds.vhd", tmp_path)
    done = make(bundles("dds"), f"RTL={tmp_path}")
    assert done.returncode == 0, done.stdout
    for sim in ("icarus", "verilator", "cocotb"):
        assert f"SKIPPED dds/default: no dds.v in {tmp_path} [{sim}]\n" in done.stdout
    assert done.stdout.count("PASS ") == 2


def test_parts_in_a_language_in_which_the_block_is_not_are_no_design(bundles):
    """The folder has pi.vhd, which agc holds, and agc.v alone."""
    need("ghdl")
    done = check(bundles("agc") / "default", "ghdl", RTL)
    assert done.returncode == 2
    assert done.stdout.startswith(f"FAIL agc/default: ghdl: no agc.vhd in {RTL}\n")


@pytest.mark.slow
def test_one_simulator_that_fails_fails_the_check_and_the_others_still_run(bundles, tmp_path):
    need("iverilog", "verilator", "g++", "ghdl")
    (tmp_path / "dds.v").write_text((RTL / "dds.v").read_text())
    (tmp_path / "dds.vhd").write_text((RTL / "dds.vhd").read_text().replace("rising_edge", "falling_edge"))
    done = make(bundles("dds"), f"RTL={tmp_path}")
    assert done.returncode != 0
    for sim in ("icarus", "verilator", "cocotb"):
        assert f"5 ports [{sim}]" in done.stdout
    for sim in ("ghdl", "vunit"):
        assert f"rows differ, the first is row 10 [{sim}]" in done.stdout


@pytest.mark.slow
def test_every_case_of_a_block_is_run_although_one_fails(bundles, tmp_path):
    need("iverilog")
    text = (RTL / "delay.v").read_text()
    assert "r_taps_7 <= r_taps_6" in text
    (tmp_path / "delay.v").write_text(text.replace("r_taps_7 <= r_taps_6", "r_taps_7 <= r_taps_5"))
    done = check(bundles("delay"), "icarus", tmp_path)
    assert done.returncode != 0
    verdicts = [line for line in done.stdout.splitlines() if line.startswith(("PASS", "FAIL"))]
    assert len(verdicts) == len(blocks.BLOCKS["delay"].cases)
    assert any(line.startswith("FAIL delay/depth8: ") for line in verdicts)


# Wrong designs -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sim", "name", "old", "new"),
    [
        ("icarus", "dds.v", "phase + off_sense_ref", "phase + off_sense_ref + 48'd1"),
        ("icarus", "sine.v", "r_sign2 ? -magnitude", "r_sign2 ? magnitude"),
        pytest.param("verilator", "dds.v", "phase + off_sense_ref", "phase + off_sense_ref + 48'd1", marks=SLOW),
        ("cocotb", "dds.v", "phase + off_sense_ref", "phase + off_sense_ref + 48'd1"),
        ("ghdl", "dds.vhd", "rising_edge", "falling_edge"),
        pytest.param("vunit", "dds.vhd", "rising_edge", "falling_edge", marks=SLOW),
    ],
)
def test_a_wrong_design_fails(bundles, tmp_path, sim, name, old, new):
    stem, text = Path(name).stem, (RTL / name).read_text()
    assert old in text
    (tmp_path / name).write_text(text.replace(old, new))
    done = check(bundles(stem) / "default", sim, tmp_path)
    assert done.returncode != 0
    lines = done.stdout.splitlines()
    rows = [line for line in lines if line.startswith("row ")]
    assert len({line.split(":")[0] for line in rows}) == benches.REPORTED_ROWS
    assert all(": expected " in line and line.endswith(f"(hex) [{sim}]") for line in rows)
    assert [line for line in lines if line.startswith(f"FAIL {stem}/default: ") and "rows differ" in line]


@pytest.mark.parametrize(
    "sim", ["icarus", "ghdl", *(pytest.param(sim, marks=SLOW) for sim in ("verilator", "cocotb", "vunit"))]
)
def test_a_design_that_does_not_compile_fails_with_the_tools_own_words(bundles, tmp_path, sim):
    (tmp_path / "dds.v").write_text("module gyro_dds (input wire clk;\nendmodule\n")
    (tmp_path / "dds.vhd").write_text("entity gyro_dds is port (clk : in bit\nend entity;\n")
    done = check(bundles("dds") / "default", sim, tmp_path)
    assert done.returncode != 0
    # cocotb and VUnit build and run in one
    why = "the bench did not get to its end" if sim in ("cocotb", "vunit") else "the design does not build"
    assert f"FAIL dds/default: {why} [{sim}]" in done.stdout
    assert "dds.v" in done.stdout


@pytest.mark.parametrize(
    ("sim", "got"),
    [("icarus", "got x"), pytest.param("cocotb", "(binary)", marks=SLOW), ("ghdl", "got XXXXXXXXXXXX")],
)
def test_a_register_that_is_never_driven_fails(bundles, tmp_path, sim, got):
    name = "dds.vhd" if sim == "ghdl" else "dds.v"
    lines = (RTL / name).read_text().splitlines()
    kept = [line for line in lines if not line.strip().replace(" ", "").startswith("r_phase<=")]
    assert len(kept) < len(lines)
    (tmp_path / name).write_text("\n".join(kept) + "\n")
    done = check(bundles("dds") / "default", sim, tmp_path)
    assert done.returncode != 0, done.stdout
    first = next(line for line in done.stdout.splitlines() if line.startswith("row "))
    assert first.startswith("row 0: r_phase: expected 0"), done.stdout
    assert got in first


# Machines that lack something ----------------------------------------------------------------------------------------


def machine(folder, lacks):
    """PATH of a machine that has every tool of this one but those for which `lacks` holds."""
    folder.mkdir()
    for place in os.environ["PATH"].split(os.pathsep):
        for path in Path(place).glob("*"):
            if not lacks(path.name) and not (folder / path.name).exists() and os.access(path, os.X_OK):
                (folder / path.name).symlink_to(path)
    return str(folder)


def no_python(name):
    return "python" in name or name.startswith("py")


@pytest.mark.slow
def test_a_bundle_needs_no_python(bundles, tmp_path):
    need("iverilog", "verilator", "g++", "ghdl")
    path = machine(tmp_path / "bin", no_python)
    done = make(bundles("dds"), f"RTL={RTL}", "PYTHON=python3", PATH=path)
    assert done.returncode == 0, done.stdout
    assert [f"[{sim}]" in done.stdout for sim in ("icarus", "verilator", "ghdl")] == [True] * 3
    assert done.stdout.count("PASS ") == 3
    for sim in ("cocotb", "vunit"):
        assert f"SKIPPED dds/default: python3 is not installed [{sim}]\n" in done.stdout


def test_a_simulator_that_is_not_installed(bundles, tmp_path):
    need("iverilog")
    path = machine(tmp_path / "bin", lambda name: no_python(name) or name.startswith(("ghdl", "verilator")))
    done = make(bundles("dds"), f"RTL={RTL}", "PYTHON=python3", PATH=path)
    assert done.returncode == 0, done.stdout
    assert "5 ports [icarus]\n" in done.stdout
    for sim in ("ghdl", "verilator"):
        assert f"SKIPPED dds/default: {sim} is not installed [{sim}]\n" in done.stdout
    done = make(bundles("dds"), f"RTL={RTL}", "SIM=ghdl", PATH=path)
    assert done.returncode != 0
    assert "FAIL dds/default: ghdl: ghdl is not installed\n" in done.stdout
    path = machine(tmp_path / "bare", lambda name: no_python(name) or name.startswith(("ghdl", "verilator", "iveri")))
    done = make(bundles("dds"), f"RTL={RTL}", "PYTHON=python3", PATH=path)
    assert done.returncode != 0
    assert "FAIL dds/default: no simulator could be run\n" in done.stdout


def test_an_unknown_simulator_is_an_error(bundles):
    done = make(bundles("dds") / "default", "SIM=modelsim")
    assert done.returncode != 0
    assert "FAIL dds/default: modelsim: there is no simulator of this name\n" in done.stdout


# docs/golden.md -------------------------------------------------------------------------------------------------------


def without_counts(text):
    return re.sub(r"\d+ (of \d+ )?rows", "N rows", text)


def test_the_page_shows_what_a_bench_says(bundles, tmp_path):
    need("iverilog", "ghdl")
    page = {without_counts(line.strip()) for line in PAGE.read_text().splitlines()}
    path = machine(tmp_path / "bin", lambda name: no_python(name) or name.startswith("verilator"))
    bare = tmp_path / "bare"  # a Python without these modules
    bare.mkdir()
    (bare / "python3").write_text("#!/bin/sh\nexit 1\n")
    (bare / "python3").chmod(0o755)
    said = make(bundles("dds"), f"RTL={RTL}", "PYTHON=python3", PATH=f"{bare}{os.pathsep}{path}").stdout
    shown = [without_counts(line) for line in said.splitlines() if "verilator" not in line]
    assert len(shown) == 4
    assert set(shown) <= page
    text = (RTL / "dds.v").read_text()
    (tmp_path / "dds.v").write_text(text.replace("phase + off_sense_ref", "phase + off_sense_ref + 48'd1"))
    said = check(bundles("dds") / "default", "icarus", tmp_path).stdout.splitlines()
    assert {without_counts(said[0]), without_counts(next(x for x in said if x.startswith("FAIL")))} <= page


@pytest.mark.slow
def test_the_commands_of_the_page_work(bundles, tmp_path):
    need("iverilog", "ghdl")
    (block,) = re.findall(r"```sh\n(.*?)```", PAGE.read_text(), re.S)
    folder = tmp_path / "default"
    shutil.copytree(bundles("dds") / "default", folder, ignore=shutil.ignore_patterns("build"))
    (tmp_path / "bin").mkdir()
    python = tmp_path / "bin" / "python3"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    environment = {k: v for k, v in os.environ.items() if k != "PYTEST_CURRENT_TEST"}
    environment |= {"RTL": str(RTL), "PATH": f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(["sh", "-e"], input=block, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(re.findall(r"^PASS dds/default: ", done.stdout, re.M)) == 3
    assert "pass 1 of 1" in re.sub(r"\x1b\[[\d;]*m", "", done.stdout)
    assert "$enddefinitions" in (folder / "build" / "dds.vcd").read_text()
