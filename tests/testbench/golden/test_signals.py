"""`gyro golden signals`: what a dump holds, and a map that only needs correcting."""

import subprocess

import pytest
from typer.testing import CliRunner

from testbench.errors import FileError
from testbench.golden import cli
from testbench.golden.bundles import bundle
from testbench.golden.check import signals, waves
from tests.testbench.golden.benching import RTL, need


@pytest.fixture(scope="module")
def dump(bundles, tmp_path_factory):
    """Waveform of the reference design under the bundle's own bench."""
    need("iverilog")
    folder = bundles("dds") / "default"
    out = tmp_path_factory.mktemp("dump") / "dds.vcd"
    build = ["iverilog", "-g2005", "-I.", "-s", "tb_dds", f'-DVCD_FILE="{out}"', "-o", str(out.with_suffix(".vvp"))]
    subprocess.run([*build, "tb_dds.v", str(RTL / "dds.v")], cwd=folder, check=True, timeout=60)
    subprocess.run(["vvp", "-n", str(out.with_suffix(".vvp"))], cwd=folder, check=True, capture_output=True, timeout=60)
    return out


def test_the_map_that_is_suggested_reads_the_dump(bundles, dump, tmp_path):
    folder = bundles("dds") / "default"
    said = CliRunner().invoke(
        cli.app, ["signals", str(dump), "--bundle", str(folder), "--out", str(tmp_path / "map.toml")]
    )
    assert said.exit_code == 0, said.output
    assert "tb_dds.dut.r_phase" in said.stdout
    # the bench holds reset two edges before row 0, and the stimulus begins with a reset of its own
    report = waves.check(folder, dump, tmp_path / "map.toml")
    assert set(report.ports) == {"phase", "drive_sine", "sense_sine", "drive_ref", "sense_ref"}


def test_the_map_of_a_bundles_own_waveform_begins_at_its_first_edge(bundles, tmp_path):
    """Its reset comes in the middle of the rows, and is no sign of row 0."""
    folder, out = bundles("dds") / "default", tmp_path / "map.toml"
    dump, words = folder / "golden.vcd", ["--bundle", str(folder)]
    assert CliRunner().invoke(cli.app, ["signals", str(dump), *words, "--out", str(out)]).exit_code == 0
    assert "first_edge = 0" in out.read_text()
    said = CliRunner().invoke(cli.app, ["check", str(folder), "--log", str(dump), "--map", str(out)])
    assert said.exit_code == 0, said.output
    assert len(waves.check(folder, dump, out).ports) == 5


def test_a_signal_suggests_itself_for_one_port_alone_and_only_at_its_width():
    found = [signals.Signal("t.dut.acc_q", 8), signals.Signal("t.dut.acc", 9), signals.Signal("t.dut.gain", 8)]
    assert signals.suggest_signals([("acc", 8), ("acc2", 8), ("flag", 1)], found) == {"acc": "t.dut.acc_q"}
    text = signals.skeleton([signals.Signal("t.clk", 1), signals.Signal("t.reset_n", 1), *found])
    assert '[clock]\nsignal = "t.clk"\n[reset]\nsignal = "t.reset_n"\nactive = 0\n' in text
    assert '# port = "t.dut.gain"' in text


def test_every_kind_of_dump_is_listed(bundles, tmp_path):
    folder = bundles("dds") / "default"
    (tmp_path / "a.csv").write_text("row, phase ,x\n0,1,2\n")
    assert signals.signals(tmp_path / "a.csv") == [("row", None), ("phase", None), ("x", None)]
    assert ("dds.reg.phase", 48) in signals.signals(folder / "golden.vcd")
    (tmp_path / "e.vcd").write_text("$enddefinitions $end\n")
    with pytest.raises(FileError, match="has no signal"):
        signals.text(tmp_path / "e.vcd", signals.signals(tmp_path / "e.vcd"))
    (tmp_path / "f.txt").write_text("")
    with pytest.raises(FileError, match=r"the file type \.txt is not"):
        signals.signals(tmp_path / "f.txt")


def test_fst_and_ghw_are_listed(tmp_path):
    pytest.importorskip("pywellen", reason="pywellen is not installed: FST was NOT listed")
    need("iverilog", "ghdl")
    (tmp_path / "t.v").write_text(
        'module t; reg c = 0; reg [3:0] n = 5; initial begin $dumpfile("t.fst"); $dumpvars; #1 c = 1; #1 $finish; end\n'
        "endmodule\n"
    )
    subprocess.run(["iverilog", "-o", "t.vvp", "t.v"], cwd=tmp_path, check=True, timeout=60)
    subprocess.run(["vvp", "-n", "t.vvp", "-fst"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    assert sorted(signals.signals(tmp_path / "t.fst")) == [("t.c", 1), ("t.n", 4)]
    (tmp_path / "t.vhd").write_text(
        "entity t is end entity; architecture a of t is signal n : bit_vector(3 downto 0); begin\n"
        'n <= "0101" after 1 ns; end architecture;\n'
    )
    for words in (["-a"], ["-e"], ["-r"]):
        unit, more = ("t.vhd", []) if words == ["-a"] else ("t", ["--wave=t.ghw"] if words == ["-r"] else [])
        subprocess.run(["ghdl", *words, "--std=08", unit, *more], cwd=tmp_path, check=True, timeout=60)
    assert ("t.n", 4) in signals.signals(tmp_path / "t.ghw")


def test_a_misspelt_signal_names_the_nearest(bundles, tmp_path):
    folder = bundles("dds") / "default"
    (tmp_path / "m.toml").write_text(
        'schema = "gyro-map/1.0"\n[clock]\nsignal = "dds.clk_26m"\n[ports]\nphase = "dds.reg.phaze"\n'
    )
    with pytest.raises(FileError, match=r"no signal dds\.reg\.phaze; similar: dds\.reg\.phase"):
        waves.check(folder, folder / "golden.vcd", tmp_path / "m.toml")
    assert bundle.verify(folder, strict=False)["block"] == "dds"
