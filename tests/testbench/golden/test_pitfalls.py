"""Traps of vector files and simulators: each on the live tool that has it, and then what a bundle does about it."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from testbench.golden.bundles import bundle
from testbench.golden.stimulus.blocks import BLOCKS
from tests.testbench.golden.benching import RTL, check, need, seed

CHOSEN = ("dds", "sine", "pi")
OLD_VERILATOR = "Verilator 5.006 "


def ran(folder, *command):
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120)
    assert done.returncode == 0, done.stdout
    return done.stdout


def under_icarus(folder, text):
    (folder / "t.v").write_text(text)
    ran(folder, "iverilog", "-g2005", "-o", "t.vvp", "t.v")
    return ran(folder, "vvp", "-n", "t.vvp")


def under_verilator(folder, verilated, text, *more):
    (folder / "t.v").write_text(text)
    kept = seed(folder / "obj_dir", verilated)
    fast = ("-j", "0", "-MAKEFLAGS", f"OPT_FAST=-O0 OPT_GLOBAL=-O0{kept}")
    ran(folder, "verilator", "--binary", "--timing", *fast, "-Wno-fatal", "-Wno-lint", *more, "-o", "sim", "t.v")
    return ran(folder, "obj_dir/sim")


def version_of_verilator(folder):
    return ran(folder, "verilator", "--version")


def texts(bundles):
    """(path, text) of every file in the bundles of the chosen blocks, but what a bench built."""
    for stem in CHOSEN:
        for path in sorted(bundles(stem).rglob("*")):
            if path.is_file() and "build" not in path.relative_to(bundles(stem)).parts:
                yield path, path.read_text()


# No newline at the end of a file -------------------------------------------------------------------------------------

READ_THREE = """module t;
  reg [7:0] cut [0:2], whole [0:2];
  initial begin
    cut[2] = 8'h55;
    $readmemh("cut.hex", cut);
    $readmemh("whole.hex", whole);
    $display("%h %h", cut[2], whole[2]);
    $finish;
  end
endmodule
"""


@pytest.mark.slow
def test_a_last_word_without_a_newline_is_lost_by_old_verilators(tmp_path, verilated):
    need("iverilog", "verilator", "g++")
    (tmp_path / "cut.hex").write_text("aa\nbb\ncc")
    (tmp_path / "whole.hex").write_text("aa\nbb\ncc\n")
    assert "cc cc" in under_icarus(tmp_path, READ_THREE)
    old = version_of_verilator(tmp_path).startswith(OLD_VERILATOR)
    assert ("55 cc" if old else "cc cc") in under_verilator(tmp_path, verilated, READ_THREE)


def test_every_file_of_a_bundle_ends_with_a_newline(bundles):
    for path, text in texts(bundles):
        assert text.endswith("\n"), path
        assert not text.endswith("\n\n"), path
        assert "\r" not in text, path


# Numbers that are not plain hexadecimal ------------------------------------------------------------------------------

READ_DECIMAL = """module t;
  integer file, got;
  reg signed [16:0] found, wanted;
  initial begin
    file = $fopen("in.txt", "r");
    got = $fscanf(file, "%d", found);
    wanted = -17'sd5;
    $display("%0d %0d %b", found, wanted, found === wanted);
    $finish;
  end
endmodule
"""
READ_MINUS = """module t;
  reg [7:0] word [0:1];
  initial begin
    $readmemh("in.hex", word);
    $display("%h", word[0]);
    $finish;
  end
endmodule
"""


@pytest.mark.slow
def test_signed_decimals_compare_wrong_under_old_verilators(tmp_path, verilated):
    need("iverilog", "verilator", "g++")
    (tmp_path / "in.txt").write_text("-5\n")
    assert "-5 -5 1" in under_icarus(tmp_path, READ_DECIMAL)
    old = version_of_verilator(tmp_path).startswith(OLD_VERILATOR)
    assert ("-5 -5 0" if old else "-5 -5 1") in under_verilator(tmp_path, verilated, READ_DECIMAL)


def test_no_bench_reads_decimals(bundles):
    for path, text in texts(bundles):
        if path.suffix in (".v", ".vh", ".svh", ".vhd"):
            assert not re.search(r"\$f?s?scanf|\$fgets|\bread\s*\(", text), path


def test_a_minus_in_a_hex_file_is_no_number(tmp_path):
    need("iverilog")
    (tmp_path / "in.hex").write_text("-7F\n10\n")
    found = under_icarus(tmp_path, READ_MINUS)
    assert "Invalid input character: -" in found
    assert found.endswith("xx\n")


def test_every_hex_word_is_lower_case_twos_complement_of_full_width(bundles):
    negative = 0
    for path, text in texts(bundles):
        if path.suffix == ".hex":
            lines = text.splitlines()
            assert re.fullmatch("[0-9a-f]+", "".join(lines)), path
            assert len({len(line) for line in lines}) == 1, path
            negative += any(line[0] in "89abcdef" for line in lines)
    assert negative > 10


# Doubles as carrier --------------------------------------------------------------------------------------------------


def test_words_that_no_double_holds_are_whole(bundles):
    folder = bundles("pi") / "extreme"
    found = bundle.read(folder)
    names = [port["name"] for port in found.manifest["registers"]]
    column = found.exp[:, names.index("acc")].tolist()
    lost = [value for value in column if int(float(value)) != value]
    assert len(lost) > 100
    head, *rows = [line.split(",") for line in (folder / "vec.csv").read_text().splitlines()]
    assert [int(row[head.index("r_acc")]) for row in rows] == column
    width = BLOCKS["pi"].registers[names.index("acc")].width
    words = [int(line, 16) for line in (folder / "ports" / "r_acc.hex").read_text().split()]
    assert words == [value & (1 << width) - 1 for value in column]


# Tables --------------------------------------------------------------------------------------------------------------


def test_no_hdl_computes_a_table(bundles):
    """GHDL and others differ in the last bits of sin(): tables come from rom/, as data."""
    listed = [(path, text) for path, text in texts(bundles) if path.suffix in (".v", ".vh", ".svh", ".vhd")]
    listed += [(path, path.read_text()) for path in (*RTL.glob("*.v"), *RTL.glob("*.vhd"))]
    assert len(listed) > 30
    for path, text in listed:
        code = re.sub(r"//.*|--.*", "", text)
        assert not re.search(r"(?i)\$(sin|cos|atan2?|sqrt|pow|ln)\b|math_real|\breal\b|\$rtoi|\$itor", code), path


# Paths ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sim", ["icarus", "ghdl", *(pytest.param(sim, marks=pytest.mark.slow) for sim in ("verilator", "cocotb", "vunit"))]
)
def test_a_bench_runs_from_anywhere_and_in_a_path_with_blanks(bundles, tmp_path, sim):
    stem = "dds" if sim in ("ghdl", "vunit") else "sine"
    folder = tmp_path / "my golden vectors" / stem
    shutil.copytree(bundles(stem) / "default", folder, ignore=shutil.ignore_patterns("build"))
    rtl = tmp_path / "my designs"
    rtl.mkdir()
    for path in RTL.glob(f"{stem}.v*"):
        shutil.copy(path, rtl)
    done = check(folder, sim, rtl)
    assert done.returncode == 0, done.stdout
    assert f"PASS {stem}/default: " in done.stdout


def test_a_table_that_is_not_found_is_no_pass(bundles, tmp_path):
    need("iverilog")
    bench = tmp_path / "tb.vvp"
    ran(bundles("sine") / "default", "iverilog", "-I.", "-s", "tb_sine", "-o", bench, "tb_sine.v", RTL / "sine.v")
    found = ran(tmp_path, "vvp", "-n", bench)
    assert "Unable to open rom/sine.hex for reading" in found
    assert "PASS" not in found


# Power-up ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_registers_may_power_up_at_random(bundles, verilated, tmp_path):
    """The bench resets before it compares, and a table that $readmemh loads is not overwritten by random values."""
    need("verilator", "g++")
    folder = tmp_path / "sine"
    shutil.copytree(bundles("sine") / "default", folder, ignore=shutil.ignore_patterns("build"))
    shutil.copy(RTL / "sine.v", folder)
    shutil.copy(folder / "tb_sine.v", folder / "t.v")
    found = under_verilator(
        folder,
        verilated,
        (folder / "t.v").read_text(),
        "--x-initial",
        "unique",
        "--x-assign",
        "unique",
        "-I.",
        "sine.v",
    )
    assert "PASS sine/default: " in found
    for start in (1, 2, 3):
        found = ran(folder, "obj_dir/sim", "+verilator+rand+reset+2", f"+verilator+seed+{start}")
        assert "PASS sine/default: " in found, start


@pytest.mark.parametrize("stem", ["dds", "sine", "references", "pi"])
def test_every_register_is_reset_while_it_holds_something_else(bundles, stem):
    """A value at power-up hides a missing reset; a reset in the middle of the vectors does not."""
    untouched = {port.name for port in BLOCKS[stem].registers}
    for case in BLOCKS[stem].cases:
        found = bundle.read(bundles(stem) / case)
        before = found.exp[found.stim[:, 0] == 1]
        for k, port in enumerate(BLOCKS[stem].registers):
            if np.any(before[:, k] != port.reset):
                untouched.discard(port.name)
    assert untouched == set()
