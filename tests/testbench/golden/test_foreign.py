"""Designs that were not written from ours pass at their level, fail with the right words, and bad input is one line."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from testbench import config
from testbench.errors import ConfigError, FileError
from testbench.golden import cli, phase_cost
from testbench.golden.bundles import adapted_bundle, bundle
from testbench.golden.check import design_run, rtl_run
from testbench.golden.foreign import comparison_scope, design_map, rtl_sources
from testbench.golden.stimulus import levels
from testbench.golden.stimulus.blocks import BLOCKS
from testbench.paper.loop import derived
from tests.testbench.golden.benching import NEEDS, need
from tests.testbench.golden.benching import check as make_check

DESIGNS = Path(__file__).with_name("designs")
ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "foreign_designs.md"
TOOLS = {"icarus": "iverilog", "verilator": "verilator", "ghdl": "ghdl"}
# Design: bundle, level, list, a fault (file, text, other text), and the port that differs first
DESIGNED = {
    "loop_filter": (
        "pi/rate", "outputs", "loop_filter.f", ("loop_filter.sv", "62'sd8388608", "62'sd0"), ("output", "y"),
    ),
    "dac_link": (
        "spi_dac/ad5791", "pins", None, ("dac_link.v", "NBITS - 5'd1 : index - sck", "5'd0 : index + sck"),
        ("pin", "sdin"),
    ),
    "nco": ("dds/default", "outputs", "nco.f", ("nco.v", "tune_h + carry", "tune_h"), ("output", "drive_sine")),
    "polar": ("cordic/default", "outputs", "polar.f", ("polar.v", "zs[24] + 32'd128", "zs[24]"), ("output", "phase")),
    "amp_mod": (
        "modulator/dac20_frames2", "outputs", "amp_mod.f", ("dsp/fx.vhd", "n - 1) + 1", "n - 1)"), ("output", "out"),
    ),
}  # fmt: skip


def installed(sim):
    if shutil.which(TOOLS[sim]) is None:
        pytest.skip(f"{TOOLS[sim]} is not installed: {sim} was NOT tried")


def choice(name, level, listed=None, folder=DESIGNS, sim=None):
    folder = folder / name
    late = folder / "latency.toml"
    return design_run.Choice(
        sim, level, listed and folder / listed, None, folder / "map.toml", late if late.is_file() else None
    )


# a fault is diagnosed, which takes seconds: one design is enough for the fast set, where make runs two others
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "nco" else pytest.mark.slow) for name in DESIGNED]
)
def test_a_design_passes_and_fails_where_its_fault_is(bundles, tmp_path, name):
    case, level, listed, fault, first = DESIGNED[name]
    stem, _, case = case.partition("/")
    installed("ghdl" if fault[0].endswith("vhd") else "icarus")
    folder = bundles(stem) / case
    report = rtl_run.check(folder, DESIGNS / name, choice=choice(name, level, listed))
    assert report.passed, report.text()
    stated = bundle.read(folder).manifest["levels"][level]
    assert {re.sub("^[ro]_", "", port) for port in stated} == set(report.ports)
    wrong = tmp_path / name
    shutil.copytree(DESIGNS / name, wrong)
    file, old, new = fault
    text = (wrong / file).read_text()
    assert old in text
    (wrong / file).write_text(text.replace(old, new))
    report = rtl_run.check(folder, wrong, choice=choice(name, level, listed, tmp_path))
    late = f"row n of {first[1]} is cycle n + 1 of the design" in report.text()
    assert late == (wrong / "latency.toml").is_file()
    found = report.to_dict()
    assert (found["passed"], found["first"]["kind"], found["first"]["name"]) == (False, *first)
    assert found["first"]["expected"] != found["first"]["got"]


# Levels ---------------------------------------------------------------------------------------------------------------


def test_the_levels_of_a_block_are_those_of_the_wiring():
    """Against the pins that the page of the architecture lists, and against what the text of the model reads."""
    page = (ROOT / "docs" / "architecture.md").read_text()
    assert "SYNC or CS, gated SCLK, SDIN, LDAC of three DACs" in page
    assert levels.levels_entry(BLOCKS["spi_dac"])["pins"] == ["r_sync_n", "r_sclk_en", "r_ldac_n", "o_sdin"]
    assert levels.levels_entry(BLOCKS["spi_adc"])["pins"] == ["r_cs_n", "r_sclk"]
    assert levels.levels_entry(BLOCKS["references"])["pins"] == ["o_pins"]
    for stem, block in BLOCKS.items():
        stated = levels.levels_entry(block)
        assert set(stated["pins"]) <= set(stated["outputs"]), stem
        assert stated["outputs"], stem
        assert {f"o_{p.name}" for p in block.pins} <= set(stated["outputs"]), stem
    assert "s.loop.y" in (ROOT / "fpga_model" / "rate_loop.py").read_text()
    assert levels.levels_entry(BLOCKS["pi"])["outputs"] == ["r_y"]


def test_a_parameter_that_nothing_reads_is_not_needed(bundles):
    assert levels.unused_params(BLOCKS["spi_dac"]) == ["flip", "header", "control", "data_mask", "tail"]
    assert [stem for stem, block in BLOCKS.items() if levels.unused_params(block)] == ["spi_dac"]
    assert "flip" not in (bundles("spi_dac") / "ad5791" / "tb_spi_dac.v").read_text()


def test_the_bench_of_a_level_needs_only_its_ports(bundles, tmp_path):
    need("iverilog")
    text = (ROOT / "testbench" / "rtl" / "pi.v").read_text()
    for name in ("r_prop", "r_acc"):
        text, count = re.subn(rf"\n    output reg [^\n]* {name},[^\n]*", "", text)
        assert count == 1
        text = text.replace("\n);\n", f"\n);\n    reg signed [ACCUMULATOR_FRACTION_BITS+35:0] {name};\n", 1)
    (tmp_path / "pi.v").write_text(text)
    folder = bundles("pi") / "rate"
    assert make_check(folder, "icarus", tmp_path).returncode != 0

    def run(**more):
        done = subprocess.run(["sh", str(folder / "check.sh"), "icarus"], env={**os.environ, **more},
                              capture_output=True, text=True, timeout=300)  # fmt: skip
        return done.returncode, done.stdout

    passed = "PASS pi/rate: 4297 rows, 1 ports at level outputs [icarus]\n"
    assert run(RTL=str(tmp_path), LEVEL="outputs") == (0, passed)
    assert run(LEVEL="pins") == (2, "FAIL pi/rate: level pins: pi is judged at: outputs registers\n")
    assert list((folder / "build").glob("check.*")) == []


def test_a_late_port_is_judged_where_no_reset_has_cleared_it(bundles, tmp_path):
    golden = bundle.read(bundles("dds") / "default")
    names = [name for name, _ in levels.compared_ports(golden.manifest, "registers")]
    k, column = 2, names.index("r_drive_sine")
    found = comparison_scope.build_scope(golden, "outputs", "sync", {"r_drive_sine": k})
    exp, mask = comparison_scope.delayed_rows(found)
    reset, rows = golden.stim[:, 0], len(golden.exp)
    for row in range(rows):
        # the slow way: a row shows what the model has k rows before, unless a reset lies between
        free = row >= k and not reset[row - k : row].any()
        assert (mask[row, column] != 0) == free, row
        assert not free or exp[row, column] == golden.exp[row - k, column]
    assert not mask[:, names.index("r_phase")].any()
    path = tmp_path / "late.toml"
    for text, level, said in (
        ("drive_sine = 1", "registers", "level registers allows none"),
        ("phase = 1", "outputs", "level outputs compares no port phase; it compares r_drive_sine"),
        ("drive_sine = -1", "outputs", r"drive_sine: -1 is not 0 \.\. 4096 clocks"),
    ):
        path.write_text(f'schema = "gyro-latency/1.0"\n[ports]\n{text}\n')
        with pytest.raises(FileError, match=said):
            comparison_scope.read_latency(path, golden.manifest, level)


def test_a_latency_file_without_a_table_is_one_line(tmp_path):
    (tmp_path / "l.toml").write_text('schema = "gyro-latency/1.0"\nports = 3\n')
    manifest = {"block": "dds", "registers": [], "outputs": [], "levels": levels.levels_entry(BLOCKS["dds"])}
    with pytest.raises(FileError, match=r"l\.toml: ports: 3 is not a table of port = clocks"):
        comparison_scope.read_latency(tmp_path / "l.toml", manifest, "outputs")


@pytest.mark.parametrize(
    ("block", "text", "said"),
    [
        (
            "spi_adc",
            "sclk = 1",
            r"sclk: inputs drdy_n and dout respond to it, so recorded rows would come 1 ",
        ),
        ("spi_dac", "sdin = 1", "one chip reads .*, so their clocks must be equal: sclk_en 0, sdin 1, sync_n 0"),
    ],
)
def test_a_latency_that_no_recorded_row_can_judge_is_refused(tmp_path, block, text, said):
    own = BLOCKS[block]
    manifest = {"block": block, "registers": [bundle.port(p) for p in own.registers],
                "outputs": [bundle.port(p) for p in own.pins], "levels": levels.levels_entry(own)}  # fmt: skip
    (tmp_path / "l.toml").write_text(f'schema = "gyro-latency/1.0"\n[ports]\n{text}\n')
    with pytest.raises(FileError, match=said):
        comparison_scope.read_latency(tmp_path / "l.toml", manifest, "pins")
    (tmp_path / "l.toml").write_text('schema = "gyro-latency/1.0"\n[ports]\n')
    assert comparison_scope.read_latency(tmp_path / "l.toml", manifest, "pins") == {}


def test_what_a_clock_costs_is_what_a_register_of_the_configuration_costs():
    """The same lag as a pipeline register of the firmware, which the closed form knows by another way."""
    plain = config.Config()
    more = config.changed(plain, {"firmware.pipeline_registers": plain.firmware.pipeline_registers + 1})
    before, after = (derived.derive(c, 25.0) for c in (plain, more))
    found = {cost.node: cost for cost in phase_cost.costs("sine", "default", {"r_y": 1}, plain)}
    for node in ("xe1", "ye1"):
        expected = getattr(after, f"{node}_deg") - getattr(before, f"{node}_deg")
        # the drive frequency moves with xe1, and each lag with it
        assert found[node].degrees == pytest.approx(expected, rel=1e-4)
    ppm = 1e6 * (after.lsb_per_dps / before.lsb_per_dps - 1)
    assert sum(cost.scale_ppm for cost in found.values()) == pytest.approx(ppm, rel=1e-3)
    bias = after.bias_dps - before.bias_dps
    assert sum(cost.bias_dps for cost in found.values()) == pytest.approx(bias, rel=1e-2)
    # and as a register of one path
    for node, key in (("xe1", "drive_sine_registers"), ("ye1", "sense_code_registers")):
        alone = derived.derive(config.changed(plain, {f"firmware.{key}": getattr(plain.firmware, key) + 1}), 25.0)
        assert found[node].bias_dps == pytest.approx(alone.bias_dps - before.bias_dps, abs=1e-9)
        ppm = 1e6 * (alone.lsb_per_dps / before.lsb_per_dps - 1)
        assert found[node].scale_ppm == pytest.approx(ppm, rel=1e-3, abs=1e-6)
    late = dict.fromkeys(("r_drive_sine", "r_sense_sine", "r_drive_ref", "r_sense_ref"), 3)
    assert [(cost.node, cost.clocks) for cost in phase_cost.costs("dds", "default", late)] == [("xe1", 0), ("ye1", 0)]
    assert phase_cost.costs("pi", "rate", {"r_y": 1}) == []
    (cost,) = phase_cost.costs("dds", "default", {"r_sense_sine": 1})
    assert f"latency           {cost.text()}\n" in PAGE.read_text()


def test_a_design_without_reset_is_judged_between_two_resets(bundles):
    golden = bundle.read(bundles("dds") / "default")
    found = comparison_scope.build_scope(golden, "outputs", "none")
    rows = len(found.golden.exp)
    reset = golden.stim[:, 0]
    assert not reset[found.first : found.first + rows - 1].any()
    assert found.first == 0 or reset[found.first - 1]
    resets = [p["reset"] for p in golden.manifest["registers"]]
    assert found.golden.exp[0, : len(resets)].tolist() == resets
    assert found.golden.manifest["reset"]["cycles"] == 0


# Folders that need no Python ------------------------------------------------------------------------------------------


FAST = {("loop_filter", "icarus"), ("amp_mod", "ghdl")}
RUNS = [(name, sim) for name in DESIGNED
        for sim in (("ghdl", "vunit") if name == "amp_mod" else ("icarus", "verilator", "cocotb"))]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "sim"), [pytest.param(*run, marks=() if run in FAST else pytest.mark.slow) for run in RUNS]
)
def test_a_wrapped_folder_checks_by_make_alone(bundles, tmp_path, name, sim):
    case, level, listed, (file, old, new), _ = DESIGNED[name]
    stem, _, case = case.partition("/")
    need(*NEEDS[sim])
    own, out = tmp_path / name, tmp_path / "w"
    shutil.copytree(DESIGNS / name, own)
    late = own / "latency.toml"
    found = adapted_bundle.write_adapted_bundle(
        bundles(stem) / case, own / "map.toml", level, out, late if late.is_file() else None
    )
    goals = ["make", "-s", "-C", str(out), "check", f"SIM={sim}", f"RTL={own}", f"FILES={listed or file}",
             f"PYTHON={sys.executable}"]  # fmt: skip
    done = subprocess.run(goals, capture_output=True, text=True, timeout=300)
    count = len(levels.levels_entry(BLOCKS[stem])[level])
    ports = "1 port" if count == 1 else f"{count} ports"
    said = f"PASS {stem}/{case}: {len(found.golden.exp)} rows, {ports} at level {level} [{sim}]\n"
    assert (done.returncode, done.stdout) == (0, said), done.stdout + done.stderr
    (own / file).write_text((own / file).read_text().replace(old, new))
    done = subprocess.run(goals, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2
    assert "rows differ, the first is row " in done.stdout
    with pytest.raises(FileError, match="is not empty"):
        adapted_bundle.write_adapted_bundle(bundles(stem) / case, own / "map.toml", level, out)


def test_a_folder_that_cannot_be_written_is_one_line(bundles, tmp_path):
    with pytest.raises(FileError, match="/dev/null/w: cannot be written: "):
        adapted_bundle.write_adapted_bundle(
            bundles("dds") / "default", DESIGNS / "nco" / "map.toml", "outputs", Path("/dev/null/w")
        )


def test_verilator_keeps_both_verdicts_of_a_bench_that_resets_nothing(bundles, tmp_path):
    """The loop over the rows is the first thing that waits: 5.006 took the count of errors behind it for 0."""
    installed("verilator")
    own, out = DESIGNS / "nco", tmp_path / "w"
    adapted_bundle.write_adapted_bundle(
        bundles("dds") / "default", own / "map.toml", "outputs", out, own / "latency.toml"
    )
    assert "RESET_CYCLES = 0;" in (out / "params.vh").read_text()
    command = ["verilator", "--cc", "--timing", "-Wno-fatal", "-Wno-lint", "-Wno-style", "-I.", "-DLEVEL_OUTPUTS",
               "--top-module", "tb_dds", "--Mdir", "c", "tb_dds.v", "golden_dds.v", own / "half_adder48.v",
               own / "nco.v"]  # fmt: skip
    subprocess.run(command, cwd=out, check=True, capture_output=True, timeout=60)
    text = "".join(path.read_text() for path in (out / "c").glob("*.cpp"))
    assert ('"PASS dds/default: ' in text, '"FAIL dds/default: ' in text) == (True, True)


def test_a_row_that_differs_is_never_a_pass(bundles, tmp_path):
    """A simulator whose bench names a row and then says PASS."""
    need("iverilog")
    said = "row 3: r_y: expected 1, got 0 (hex)\nPASS pi/rate: 4297 rows, 3 ports"
    (tmp_path / "vvp").write_text(f"#!/bin/sh\nprintf '{said}\\n'\n")
    (tmp_path / "vvp").chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "RTL": str(ROOT / "testbench" / "rtl")}
    done = subprocess.run(["sh", str(bundles("pi") / "rate" / "check.sh"), "icarus"], env=environment,
                          capture_output=True, text=True, timeout=60)  # fmt: skip
    assert done.returncode == 1
    assert done.stdout.endswith("FAIL pi/rate: the bench did not get to its end [icarus]\n")


# Bad input ------------------------------------------------------------------------------------------------------------

MAP = (DESIGNS / "loop_filter" / "map.toml").read_text()
BAD_MAPS = {
    "unknown port": ("y = ", "yy = ", r"\[outputs\]: pi has no yy; did you mean y\?"),
    "unknown input": ("en = ", "enn = ", r"\[inputs\]: pi has no enn; did you mean en\?"),
    "map to nothing": ('y = "act_o"', 'y = ""', r'"" leaves this port out, but level outputs compares it'),
    "two drivers": (
        "ctl_i[38]", "ctl_i[37]", r"port ctl_i of the design has two drivers: \[inputs\] en and \[inputs\] mode",
    ),
    "two drivers of the reset": (
        "ctl_i[38]", "arst_i", r"port arst_i of the design has two drivers: \[reset\] and \[inputs\] en",
    ),
    "an input as an output": ("act_o", "ctl_i", r"port ctl_i of the design is an input \(of"),
    "bit without driver": ("ctl_i[38]", "ctl_i[39]", r"bit 38 of input ctl_i of the design has no driver"),
    "polarity": ("active = 1", "active = 2", r"reset.active: 2 is not 0 or 1"),
    "style": ('"async"', '"later"', r"reset.style: 'later' is not one of sync, async, none"),
    "schema": ("map/1.0", "map/2.0", r"schema: 'gyro-design-map/2.0' is not gyro-design-map/1.0"),
    "name": ('"act_o"', '"a;b"', r"\[outputs\] r_y: 'a;b' is not a name"),
    "two values": ('ki = "KI"', 'ki = "KP"', r"parameter KP of the design has two values"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_MAPS)
def test_a_bad_map_is_one_line(bundles, tmp_path, name):
    old, new, said = BAD_MAPS[name]
    assert old in MAP
    (tmp_path / "m.toml").write_text(MAP.replace(old, new))
    with pytest.raises(FileError, match=said) as problem:
        adapted_bundle.write_adapted_bundle(bundles("pi") / "rate", tmp_path / "m.toml", "outputs", tmp_path / "w")
    assert len(str(problem.value).splitlines()) == 1
    assert not (tmp_path / "w").exists()


BAD_RUNS = {
    "port that the design lacks": ('"act_o"', '"act_oo"', "port act_oo is missing"),
    "wrong width": (
        "width = 32", "width = 31", "port err_i has 32 bits, the map has 31",
    ),
    "stays in reset": ("active = 1", "active = 0", "stays in reset"),
    "no such module": ('"loop_filter"', '"loop_fitler"', "no module or entity loop_fitler; name yours with --top"),
    "no such parameter": ('"KI"', '"KII"', r"parameter KII is missing; .* in \[parameters\] of a map"),
    "no such reset": ("arst_i", "arst", 'port arst is missing; .* for a design without a reset set style = "none"'),
}  # fmt: skip


TYPED = '{ name = "SHIFT_BITS", type = "integer" }'


@pytest.mark.parametrize("name", BAD_RUNS)
def test_a_map_that_the_design_contradicts_is_an_error(bundles, tmp_path, name):
    installed("icarus")
    old, new, said = BAD_RUNS[name]
    assert old in MAP
    shutil.copytree(DESIGNS / "loop_filter", tmp_path / "d")
    (tmp_path / "d" / "map.toml").write_text(MAP.replace(old, new))
    with pytest.raises(FileError, match=said):
        rtl_run.check(bundles("pi") / "rate", tmp_path / "d", choice=choice("d", "outputs", "loop_filter.f", tmp_path))


@pytest.mark.parametrize(
    ("level", "shift", "said"),
    [("outputs", '"SHIFT_BITS"', "SHIFT_BITS has another type than the map says"),
     ("registers", TYPED, "port r_product is missing; level registers needs every register")],
)  # fmt: skip
def test_what_ghdl_refuses_is_said_in_our_words(bundles, tmp_path, level, shift, said):
    installed("ghdl")
    shutil.copytree(DESIGNS / "amp_mod", tmp_path / "d")
    text = (tmp_path / "d" / "map.toml").read_text()
    assert text.count(TYPED) == 1
    (tmp_path / "d" / "map.toml").write_text(text.replace(TYPED, shift))
    with pytest.raises(FileError, match=said):
        rtl_run.check(bundles("modulator") / "dac16", tmp_path / "d", choice=choice("d", level, "amp_mod.f", tmp_path))


@pytest.mark.parametrize("case", ["divided", pytest.param("strobed", marks=pytest.mark.slow)])
def test_one_map_is_for_every_bundle_of_a_block(bundles, case):
    """Also with parameters that some bundles do not list: `DESIGNED` has one without gap and strobe."""
    installed("icarus")
    listed = {p["name"] for p in bundle.read(bundles("spi_dac") / "ad5791").manifest["params"]}
    assert listed.isdisjoint(("gap", "strobe"))
    report = rtl_run.check(bundles("spi_dac") / case, DESIGNS / "dac_link", choice=choice("dac_link", "pins"))
    assert report.passed, report.text()


def test_a_list_names_files_folders_macros_and_libraries(tmp_path):
    for name in ("a.sv", "b.v", "inc/c.svh", "deep/d.v"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "deep" / "d.f").write_text("d.v +define+Q")
    (tmp_path / "x.f").write_text("// list\n+incdir+inc a.sv # one\n-DP=3 -f deep/d.f\nb.v\ninc/c.svh\n")
    found = rtl_sources.read_source_list(tmp_path / "x.f")
    assert [path.name for path in found.files] == ["a.sv", "d.v", "b.v"]
    assert (found.defines, found.includes[0].name, found.language) == (("P=3", "Q"), "inc", "verilog")
    (tmp_path / "e.vhd").write_text("")
    (tmp_path / "x.f").write_text("-work one e.vhd\n")
    assert rtl_sources.read_source_list(tmp_path / "x.f").libraries == ("one",)
    for text, said in (("no.v", "line 1: no file"), ("-y lib", "line 1: -y is none of"), ("+incdir+no", "no folder"),
                       ("-f x.f", "the list names itself"), ("", "names no source file"), ("-work", "needs a value"),
                       ("a.sv e.vhd", "Verilog and VHDL in one list")):  # fmt: skip
        (tmp_path / "x.f").write_text(text)
        with pytest.raises(FileError, match=said):
            rtl_sources.read_source_list(tmp_path / "x.f")


LISTS = {
    "bad.f": "-y lib\n",
    "own.f": "-f own.f\n",
    "a.f": "pi.v\n-f ./deep/b.f\n",
    "deep/b.f": "-f ../a.f\n",
    "work.f": "pi.v\n-work\n",
    "empty.f": "// nothing\n",
}


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ("no.v", "FILES: no file {rtl}/no.v"),
        ("no.f", "no list {rtl}/no.f"),
        ("bad.f", "{rtl}/bad.f: -y is none of +incdir+, +define+, -I, -D, -work, -f"),
        ("own.f", "{rtl}/own.f: the list names itself"),
        ("a.f", "{rtl}/./deep/../a.f: the list names itself"),
        ("work.f", "{rtl}/work.f: -work needs a value"),
        ("empty.f", "FILES: empty.f names no source file"),
        ("deep", "FILES: no file {rtl}/deep"),
    ],
)
def test_make_says_what_is_wrong_with_a_list(bundles, tmp_path, files, said):
    need("iverilog")
    rtl = tmp_path / "mit Ümlaut & @"
    (rtl / "deep").mkdir(parents=True)
    shutil.copy(ROOT / "testbench" / "rtl" / "pi.v", rtl)
    for name, text in LISTS.items():
        (rtl / name).write_text(text)
    goals = ["make", "-s", "-C", str(bundles("pi") / "rate"), "check", f"RTL={rtl}", f"FILES={files}"]
    done = subprocess.run(goals, capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stdout) == (2, f"FAIL pi/rate: {said.format(rtl=rtl)}\n")


def test_a_file_that_is_listed_twice_is_read_once(bundles):
    need("iverilog")
    goals = ["make", "-s", "-C", str(bundles("pi") / "rate"), "check", "SIM=icarus", "FILES=pi.v pi.v"]
    done = subprocess.run([*goals, f"RTL={ROOT / 'testbench' / 'rtl'}"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "PASS pi/rate: 4297 rows, 3 ports [icarus]\n")


DESIGN = "module gyro_pi;\n{}\nendmodule\n"
STOPPED = {
    "does not build": ("assign x = ;", {}, "the design does not build"),
    "an elaboration without end": (
        "function f(input a); while (1) f = a; endfunction\nlocalparam A = f(1);", {"TIMEOUT": "2"},
        "stopped after 2 s: the design hangs or is slow (TIMEOUT=seconds)",
    ),
    "TIMEOUT": ("", {"TIMEOUT": "soon"}, "TIMEOUT: soon is no number of seconds"),
    "FRAMES": ("", {"FRAMES": "few"}, "FRAMES: few is no number of frames"),
    "no Python": ("", {"SIM": "cocotb", "PYTHON": "python9"}, "cocotb: python9 is not installed"),
}  # fmt: skip


@pytest.mark.parametrize("name", STOPPED)
def test_make_ends_in_one_line_and_in_time(bundles, tmp_path, name):
    need("iverilog")
    text, given, said = STOPPED[name]
    (tmp_path / "pi.v").write_text(DESIGN.format(text))
    command = ["make", "-s", "-C", str(bundles("pi") / "rate"), "check"]
    environment = {"SIM": "icarus", "RTL": str(tmp_path), **given}
    done = subprocess.run([*command, *(f"{key}={value}" for key, value in environment.items())], capture_output=True,
                          text=True, timeout=20)  # fmt: skip
    own = f" [{environment['SIM']}]" if name in ("does not build", "an elaboration without end") else ""
    assert done.returncode == 2
    assert done.stdout.endswith(f"FAIL pi/rate: {said}{own}\n")
    assert f"{tmp_path}/pi.v:2: " in done.stdout or len(done.stdout.splitlines()) == 1


def test_a_bundle_that_cannot_be_written_to_is_one_line_of_make(bundles, tmp_path):
    need("iverilog")
    shutil.copytree(bundles("pi") / "rate", tmp_path / "b", ignore=shutil.ignore_patterns("build"))
    (tmp_path / "b" / "build").write_text("")
    done = make_check(tmp_path / "b", "icarus", ROOT / "testbench" / "rtl")
    assert done.stdout.startswith(f"FAIL pi/rate: {tmp_path}/b/build: no folder to write into\n")
    assert done.returncode == 2


def test_a_parameter_that_the_map_leaves_out_is_a_note(bundles, tmp_path):
    installed("icarus")
    shutil.copytree(DESIGNS / "loop_filter", tmp_path / "d")
    (tmp_path / "d" / "map.toml").write_text(MAP.replace('ki = "KI"\n', "").replace("y = ", "r_y = "))
    report = rtl_run.check(
        bundles("pi") / "rate", tmp_path / "d", choice=choice("d", "outputs", "loop_filter.f", tmp_path)
    )
    note = "parameter ki is not in [parameters] of the map; the design uses its own value"
    assert not report.passed
    assert report.text().endswith(f"note              {note}\n")
    assert report.to_dict()["notes"] == (note,)
    assert report._replace(divergence=None).text().endswith(f": PASS\nnote              {note}\n")
    manifest = bundle.read(bundles("pi") / "rate").manifest
    for old, new, notes in (
        ("", "", ()),
        ('ki = "KI"\n', "[constants]\nKI = 3\n", ()),
        ('kp = "KP"\nki = "KI"\n', "", ("parameters kp, ki are not in [parameters] of the map; "
                                      "the design uses its own values",)),
    ):  # fmt: skip
        text = MAP.replace(old, "")
        (tmp_path / "m.toml").write_text(text if not new.startswith("[constants]") else f"{text}{new}")
        assert design_map.parameter_notes(manifest, design_map.read(tmp_path / "m.toml", manifest, "outputs")) == notes
    # no register of spi_dac depends on flip, header, ...
    manifest = bundle.read(bundles("spi_dac") / "ad5791").manifest
    dac_link = design_map.read(DESIGNS / "dac_link" / "map.toml", manifest, "pins")
    assert design_map.parameter_notes(manifest, dac_link) == ()


def test_the_folder_of_a_block_is_refused_with_its_cases(bundles, tmp_path):
    shutil.copytree(bundles("pi"), tmp_path / "pi")
    for words in (["wrap", str(tmp_path / "pi"), "--map", "m.toml"], ["check", str(tmp_path / "pi"), "--rtl", "."]):
        found = CliRunner().invoke(cli.app, words)
        assert str(found.exception) == (
            f"{tmp_path / 'pi'}: the folder of a block; give that of a case: {', '.join(sorted(BLOCKS['pi'].cases))}"
        )
        # what `wrap` writes beside the cases is none of them
        (tmp_path / "pi" / "rate_outputs").mkdir(exist_ok=True)
        (tmp_path / "pi" / "rate_outputs" / "manifest.json").write_text('{"of_bundle": ""}')


# docs/foreign_designs.md ----------------------------------------------------------------------------------------------


def test_the_command_prints_the_one_format(bundles, tmp_path):
    installed("icarus")
    own = DESIGNS / "loop_filter"
    words = ["check", str(bundles("pi") / "rate"), "--rtl", str(own), "--files", str(own / "loop_filter.f"), "--map",
             str(own / "map.toml"), "--latency", str(own / "latency.toml"), "--level", "outputs"]  # fmt: skip
    done = CliRunner().invoke(cli.app, [*words, "--json"])
    tree = json.loads(done.stdout)
    assert (done.exit_code, tree["passed"], tree["first"], tree["diagnosis"]) == (0, True, None, [])
    part = PAGE.read_text().partition("## Result")[2].partition("## Limits")[0]
    assert set(re.findall(r"^\| `(\w+)`", part, re.M)) <= tree.keys()
    nco = ["wrap", str(bundles("dds") / "default"), "--map", str(DESIGNS / "nco" / "map.toml")]
    wrapped = CliRunner().invoke(cli.app, [*nco, "--out", str(tmp_path / "w")])
    first = json.loads((tmp_path / "w" / "manifest.json").read_text())["first_row"]
    assert first > 0
    assert f"rows from row {first} of the bundle, " in wrapped.stdout
    found = CliRunner().invoke(cli.app, [*words[:-1], "pin"])
    assert isinstance(found.exception, ConfigError)
    assert "level: 'pin' is not one of pins, outputs, registers" in str(found.exception)


def test_the_files_of_the_page_are_read(bundles, tmp_path):
    text = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.S)
    manifest = bundle.read(bundles("pi") / "rate").manifest
    (tmp_path / "m.toml").write_text(text[0])
    found = design_map.read(tmp_path / "m.toml", manifest, "outputs")
    assert (found.top, found.style, found.reset) == ("pi_core", "async", ("reset_n", 0))
    assert found.parameters == (("kp", "KP", ""),)
    (tmp_path / "l.toml").write_text(text[1])
    manifest = bundle.read(bundles("dds") / "default").manifest
    assert comparison_scope.read_latency(tmp_path / "l.toml", manifest, "outputs") == {
        "r_drive_sine": 1,
        "r_sense_sine": 1,
    }


@pytest.mark.parametrize(("case", "strobe"), [("pi/rate", "en"), ("cordic/default", "start")])
def test_strobes_come_in_successive_clocks(bundles, case, strobe):
    """What the page of the vectors says of them, and what a design that shares a multiplier cannot follow."""
    golden = bundle.read(bundles(case.partition("/")[0]) / case.partition("/")[2])
    rows = golden.stim[:, [p["name"] for p in golden.manifest["inputs"]].index(strobe)]
    assert (rows[1:] & rows[:-1]).any()
