"""Synthesis: the reference design passes, a latch and an undriven net are refused, page and Quartus' script."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fpga_model.rates import MASTER_HZ
from testbench.commands.main import app
from testbench.config import Config
from testbench.console.results import read_results
from testbench.errors import ConfigError, FileError
from testbench.golden.proofs import synthesis
from testbench.golden.recording import board_recording
from testbench.run import build
from tests.testbench.rtl.test_rtl import RTL, tool, yosys

sys.path.append(str(Path(__file__).resolve().parents[3] / "docs"))

import rtl_page

QUARTUS = RTL / "quartus"
tclsh = tool("tclsh")


@yosys
@pytest.mark.parametrize("name", ["analog", pytest.param("digital", marks=pytest.mark.slow)])
def test_the_design_has_no_latch_and_no_undriven_net(name):
    netlist = synthesis.synthesise(RTL, None, name)
    assert netlist.cells == {}
    assert netlist.text() == f"front end, board {name}: no latch, no undriven net"


SCLK = "assign o_adc_sclk = r_adc_sclk;"
PLANTED = {
    "an undriven net": ("top.v", SCLK, "wire nowhere; assign o_adc_sclk = nowhere;", "check"),
    "a second driver": ("top.v", SCLK, f"{SCLK} assign o_adc_sclk = r_adc_cs_n;", "check"),
    "a latch": ("sequencer.v", "        following = r_state;\n", "", "select"),
    "an asynchronous reset": ("watchdog.v", "@(posedge clk)", "@(posedge clk or posedge rst)", "Multiple edge"),
    "a missing part": ("rates.v", "module gyro_rates", "module gyro_pace", "gyro_rates"),
}  # fmt: skip


@yosys
@pytest.mark.parametrize(
    "what", [w if w == "a missing part" else pytest.param(w, marks=pytest.mark.slow) for w in PLANTED]
)
def test_what_must_not_be_there_is_refused(what, tmp_path):
    name, right, wrong, said = PLANTED[what]
    shutil.copytree(RTL, tmp_path / "rtl")
    path = tmp_path / "rtl" / name
    assert path.read_text().count(right) == 1
    path.write_text(path.read_text().replace(right, wrong))
    with pytest.raises(FileError, match=rf"(?s)synthesis for no family, board analog: yosys failed.*{said}"):
        synthesis.synthesise(tmp_path / "rtl")


def test_bad_input_is_one_clear_error(monkeypatch):
    with pytest.raises(ConfigError, match="family: 'stratix' is not one of ecp5, ice40"):
        synthesis.synthesise(RTL, "stratix")
    with pytest.raises(ConfigError, match="board: 'bread' is not one of analog, digital"):
        synthesis.synthesise(RTL, "ecp5", "bread")
    monkeypatch.setattr(synthesis.shutil, "which", lambda name: None)
    with pytest.raises(ConfigError, match="yosys: not installed"):
        synthesis.synthesise(RTL, "ecp5")


def test_the_table_counts_cells_of_each_family():
    netlists = [
        synthesis.Netlist("ecp5", "analog", {"LUT4": 7, "LUT4X": 9, "TRELLIS_FF": 3}, "Yosys 0.23 (git)", 1.0),
        synthesis.Netlist("ice40", "analog", {"SB_DFF": 2, "SB_DFFER": 3, "SB_LUT4": 1}, "Yosys 0.23 (git)", 1.0),
    ]
    table = rtl_page.netlists_table(netlists)
    assert table.heads == ("proxy", "ecp5, analog SID", "ice40, analog SID")
    assert ("4-input tables", "7", "1") in table.rows
    assert ("flip-flops", "3", "5") in table.rows
    assert table.note == "Yosys 0.23; parameters of the default configuration; not placed, not routed."


@pytest.mark.slow
@yosys
def test_the_command_leaves_what_quartus_reads(tmp_path):
    done = CliRunner().invoke(app, ["golden", "synth", "--rtl", str(RTL), "--out", str(tmp_path), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["board"] == "analog"
    assert {"gyro_board.v", "sine.hex", "cordic_atan.hex"} <= {path.name for path in tmp_path.iterdir()}
    text = (tmp_path / "gyro_board.v").read_text()
    for name, width, raw in board_recording.top_parameters(build.firmware(Config())):
        assert f".{name}({width}'h{raw:x})" in text


STUBS = """
package provide ::quartus::project 1.0
proc project_new args {puts [list project {*}$args]}
proc project_close args {}
proc set_global_assignment args {puts [list global {*}$args]}
proc set_instance_assignment args {puts [list instance {*}$args]}
proc get_ports names {return $names}
foreach name {create_clock derive_clock_uncertainty set_input_delay set_output_delay set_false_path set_max_delay
              set_max_skew} {
    proc $name args "puts \\[list $name {*}\\$args\\]"
}
"""


def told(script, folder):
    """Lines that a script of Quartus asks for, read by another Tcl whose commands only print."""
    (folder / "stubs.tcl").write_text(STUBS + f"source {script}\n")
    done = subprocess.run(["tclsh", "stubs.tcl"], cwd=folder, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@tclsh
def test_the_project_names_the_part_and_every_source(tmp_path):
    lines = told(QUARTUS / "gyro.tcl", tmp_path)
    assert "global -name DEVICE EP4CE115F23I7" in lines
    assert f"global -name TOP_LEVEL_ENTITY {board_recording.MODULE}" in lines
    sources = {line.split("/")[-1] for line in lines if "VERILOG_FILE" in line and "/" in line}
    assert sources == {path.name for path in RTL.glob("*.v")}
    ports = {name for _, name, _ in board_recording.ports()}
    named = {re.sub(r"\{|\}|\[.*", "", line.split(" -to ")[1]) for line in lines if line.startswith("instance")}
    assert named < ports
    assert not [line for line in lines if "LOCATION" in line]  # no pins


@tclsh
def test_the_constraints_cover_every_port(tmp_path):
    lines = told(QUARTUS / "gyro.sdc", tmp_path)
    (clock,) = (line for line in lines if line.startswith("create_clock"))
    period_ns = float(clock.split("-period ")[1].split()[0])
    # a picosecond short of the true period, if anything
    assert 0 <= 1e9 / MASTER_HZ - period_ns < 1e-3
    virtual = {"write", "address", "data", "sample_x", "sample_y"}
    seen = set(re.findall(r"\w+", " ".join(lines)))
    assert {name for _, name, _ in board_recording.ports()} - virtual <= seen


@yosys
@pytest.mark.slow
def test_the_page_holds_what_a_synthesis_gives():
    netlists = [synthesis.synthesise(RTL, family) for family in synthesis.MAPPERS]
    _, (stored,) = read_results(rtl_page.RESOURCES)
    if netlists[0].yosys.split()[1] not in stored.note:
        pytest.skip(f"the table is of another yosys than {netlists[0].yosys}")
    assert rtl_page.netlists_table(netlists) == stored
