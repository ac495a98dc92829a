"""`gyro golden check --rtl`: right designs pass under every simulator, wrong ones report, bad ones give one line."""

import hashlib
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from testbench.errors import ConfigError, FileError
from testbench.golden import cli
from testbench.golden.bundles import bundle
from testbench.golden.check import compare, loggers, rtl_run

RTL = Path(__file__).resolve().parents[3] / "testbench" / "rtl"
SUFFIX = {"icarus": "v", "verilator": "v", "ghdl": "vhd"}
TOOLS = {"icarus": "iverilog", "verilator": "verilator", "ghdl": "ghdl"}


def installed(sim):
    if shutil.which(TOOLS[sim]) is None:
        pytest.skip(f"{TOOLS[sim]} is not installed: {sim} was NOT tried")


@pytest.fixture(scope="module")
def out(bundles):
    """Folder of some blocks' bundles."""
    return {bundles(block).parent for block in ("pi", "sine", "dds")}.pop()


def design(folder, block, suffix, *changes):
    """A copy of the reference design with texts changed, each of which must be there."""
    text = (RTL / f"{block}.{suffix}").read_text()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    (folder / f"{block}.{suffix}").write_text(text)
    return folder


def all_hashes(folder):
    return {p: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize(
    ("sim", "name"),
    [("icarus", "sine/default"), ("ghdl", "dds/default"),
     *(pytest.param(*entry, marks=pytest.mark.slow)
       for entry in (("icarus", "pi/extreme"), ("ghdl", "pi/rate"), ("verilator", "sine/default")))],
)  # fmt: skip
def test_the_reference_designs_pass_and_the_bundle_stays_as_it_was(out, sim, name):
    installed(sim)
    before = all_hashes(out)
    report = rtl_run.check(out / name, RTL, sim)
    assert report.passed, report.text()
    assert report.rows == report.golden_rows
    assert report.missing == ()
    assert all_hashes(out) == before


@pytest.mark.parametrize("sim", ["icarus", "ghdl", pytest.param("verilator", marks=pytest.mark.slow)])
def test_every_simulator_gives_the_same_report(out, tmp_path, sim):
    installed(sim)
    old = {"v": " + HALF_Y;", "vhd": " + to_signed(2**(F - 1), A + 2)"}[SUFFIX[sim]]
    new = {"v": ";", "vhd": ""}[SUFFIX[sim]]
    report = rtl_run.check(out / "pi" / "rate", design(tmp_path, "pi", SUFFIX[sim], (old, new)), sim)
    d = report.divergence
    assert (d.cycle, d.port, d.error_lsb, d.is_input) == (37, "y", -1, False)
    assert list(report.differing) == ["y"]
    (cause,) = report.diagnosis
    assert (cause.cause, cause.register, cause.share) == ("rounding", "y", 1.0)
    assert cause.what.startswith("floor (")


def test_the_command_prints_the_report_of_logs_and_its_exit_code_tells(out, tmp_path):
    installed("icarus")
    run = CliRunner()
    good = run.invoke(cli.app, ["check", str(out / "dds" / "default"), "--rtl", str(RTL)])
    assert good.exit_code == 0
    assert good.stdout.startswith("dds/default: 3440 of 3440 rows, 5 ports: PASS")
    design(tmp_path, "dds", "v", ("r_phase + off_sense_ref", "r_phase - off_sense_ref"))
    bad = run.invoke(cli.app, ["check", str(out / "dds" / "default"), "--rtl", str(tmp_path), "--json"])
    assert bad.exit_code == 1
    tree = json.loads(bad.stdout)
    (cause,) = tree["diagnosis"]
    assert (tree["passed"], cause["cause"], cause["register"], cause["share"]) == (False, "sign", "sense_ref", 1.0)
    assert (tree["first"]["kind"], tree["first"]["name"]) == ("output", "sense_ref")
    assert tree["first"]["before"][-1]["clock"] == tree["first"]["clock"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "one of --rtl DIR and --log FILE"),
        (["--rtl", "x", "--log", "y"], "one of --rtl DIR and --log FILE"),
        (["--log", "y"], "--log needs --map"),
        (["--log", "y", "--map", "z", "--sim", "icarus"], "--sim belongs to --rtl"),
        (["--log", "y", "--map", "z", "--level", "pins"], "--level belongs to --rtl"),
    ],
)
def test_a_wrong_choice_of_options_is_one_line(out, words, said):
    found = CliRunner().invoke(cli.app, ["check", str(out / "dds" / "default"), *words])
    assert isinstance(found.exception, ConfigError)
    assert said in str(found.exception)


HANG = "initial forever begin end\nendmodule"
BROKEN = {
    "syntax": ("icarus", "v", ("end else begin", "end else begun"), "does not build under icarus"),
    "syntax in VHDL": ("ghdl", "vhd", ("end if;", "end iff;"), "does not build under ghdl"),
    "port missing": ("icarus", "v", ("r_y", "r_z"), "port r_y is missing"),
    "port missing in VHDL": ("ghdl", "vhd", ("r_y", "r_z"), "port r_y is missing"),
    "width": ("icarus", "v", ("[35:0] r_y ", "[34:0] r_y "), "port r_y has 35 bits, the bundle has 36"),
    "width of an input": ("icarus", "v", ("[25:0] e,", "[27:0] e,"), "port e has 28 bits"),
    "width in VHDL": (
        "ghdl", "vhd",
        ("r_y    : out std_logic_vector(35 downto 0)", "r_y    : out std_logic_vector(36 downto 0)"),
        "port r_y does not have the 36 bits of the bundle",
    ),
    "input left open": ("icarus", "v", ("rst,     // synchronous, active high", "rst, more,"), "input more"),
    "parameter missing": ("icarus", "v", ("34'sd0,  // [1,9,24]\n    parameter signed [33:0] ki",
                                          "34'sd0,\n    parameter signed [33:0] kj"), "parameter ki is missing"),
    "reset of the other polarity": (
        "icarus", "v", ("if (rst)", "if (!rst)"), "reset has the other polarity; set active = 0 in [reset] of a map",
    ),
    "parameter missing in VHDL": ("ghdl", "vhd", ("kp", "kq"), "parameter kp is missing"),
    "parameter without a value in VHDL": (
        "ghdl", "vhd", ("        kp : std", "        most : natural;\n        kp : std"),
        "parameter most is not in the bundle; give it a value in [constants] of a map",
    ),
    "an input as an output": (
        "icarus", "v", ("input  wire signed                           [25:0] e,", "output wire signed [25:0] e,"),
        "port e is an output of the design, but an input in the bundle",
    ),
    "an input as an output in VHDL": (
        "ghdl", "vhd", ("e      : in  std", "e      : out std"),
        "port e is an output of the design, but an input in the bundle",
    ),
    "an output as an input": (
        "icarus", "v", ("output reg  signed                           [35:0] r_y      // [1,35,0]\n);",
                        "input wire signed [35:0] r_y);\n    reg signed [35:0] mine;"),
        "port r_y has no driver: the design declares it as an input, or does not assign it",
    ),
    "an output as an input in VHDL": (
        "ghdl", "vhd", ("r_y    : out std_logic_vector(35 downto 0)       -- [1,35,0]",
                        "r_y    : in std_logic_vector(35 downto 0); mine : out std_logic_vector(35 downto 0)"),
        "port r_y has no driver: the design declares it as an input, or does not assign it",
    ),
    "never starts": ("icarus", "v", ("if (rst)", "if (1'b1)"), "stays in reset, has no clock or never starts"),
    "ends early": ("icarus", "v", ("endmodule", "initial #1000000 $finish;\nendmodule"), "ended after 24 of 4297 rows"),
    "prints without end": ("icarus", "v", ("endmodule", 'initial while (1) $display("%0100d", 0);\nendmodule'),
                           "prints more than 4 MiB"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_a_design_that_cannot_be_run_is_one_clear_error(out, tmp_path, name):
    sim, suffix, change, said = BROKEN[name]
    installed(sim)
    assigned = [(text, "mine <=") for text in ("r_y <=", "r_y    <=")] if "mine" in change[1] else []
    folder = design(tmp_path, "pi", suffix, change, *assigned)
    with pytest.raises(FileError) as problem:
        rtl_run.check(out / "pi" / "rate", folder, sim)
    assert said in str(problem.value)
    assert str(folder / f"pi.{suffix}") in str(problem.value) or "vvp" in str(problem.value)
    assert len(str(problem.value).splitlines()) <= 1 + rtl_run.LINES


@pytest.mark.parametrize(
    ("change", "sim", "said"),
    [
        pytest.param(("rst,     // synchronous, active high", "rst, more,"), "verilator",
                     "input more is not in the bundle", marks=pytest.mark.slow),
        pytest.param(("[35:0] r_y ", "[34:0] r_y "), "verilator",
                     "port r_y has 35 bits, the bundle has 36", marks=pytest.mark.slow),
        pytest.param(("r_y", "r_z"), "verilator", "port r_y is missing", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_verilator_says_it_in_the_same_words(out, tmp_path, change, sim, said):
    installed(sim)
    with pytest.raises(FileError, match=said):
        rtl_run.check(out / "pi" / "rate", design(tmp_path, "pi", "v", change), sim)


def test_a_design_that_hangs_is_killed(out, tmp_path):
    installed("icarus")
    begun = time.monotonic()
    with pytest.raises(FileError, match=r"vvp: stopped after 1 s: the design hangs or is slow"):
        rtl_run.check(out / "pi" / "rate", design(tmp_path, "pi", "v", ("endmodule", HANG)), "icarus", timeout_s=1.0)
    assert time.monotonic() - begun < 20


def test_what_is_not_there_is_said(out, tmp_path, monkeypatch):
    folder = out / "pi" / "rate"
    with pytest.raises(FileError, match=r"no design for any simulator: there is no pi\.v, \.sv or \.vhd"):
        rtl_run.check(folder, tmp_path)
    with pytest.raises(FileError, match=r"no design for ghdl: there is no pi\.vhd"):
        rtl_run.check(folder, tmp_path, "ghdl")
    with pytest.raises(FileError, match="not a folder"):
        rtl_run.check(folder, tmp_path / "no", "icarus")
    with pytest.raises(ConfigError, match="'vcs' is not one of icarus, verilator, ghdl"):
        rtl_run.check(folder, RTL, "vcs")
    with pytest.raises(ConfigError, match="is not above 0"):
        rtl_run.check(folder, RTL, "icarus", timeout_s=0.0)
    monkeypatch.setenv("PATH", str(tmp_path))
    for sim in (None, "icarus", "ghdl"):
        with pytest.raises(FileError, match="not installed"):
            rtl_run.check(folder, RTL, sim)


def test_an_unknown_bit_makes_the_value_unknown(out, tmp_path):
    """A register that is never reset holds x until it is loaded, which no two-state log could show."""
    installed("icarus")
    report = rtl_run.check(out / "dds" / "default", design(tmp_path, "dds", "v",
                           ("r_phase      <= {DDS_BITS{1'b0}};", "")), "icarus")  # fmt: skip
    assert (report.divergence.cycle, report.divergence.port, report.divergence.got) == (0, "phase", None)
    assert [(cause.cause, cause.register) for cause in report.diagnosis] == [("no_reset", "phase")]


def test_a_manifest_whose_names_are_no_names_makes_no_bench(out):
    manifest = bundle.read(out / "dds" / "default").manifest
    for change in ({"block": "dds dut(); initial $system"}, {"inputs": [{**manifest["inputs"][0], "name": "a;b"}]},
                   {"inputs": manifest["inputs"][1:]}):  # fmt: skip
        for language in (loggers.verilog, loggers.vhdl):
            with pytest.raises(FileError, match="manifest"):
                language({**manifest, **change})


def test_a_line_of_a_bench_tells_its_port(out):
    text = loggers.vhdl(bundle.read(out / "pi" / "rate").manifest)
    lines = text.splitlines()
    found = [loggers.port_of_line(text, n + 1) for n in range(len(lines))]
    assert [name for name in found if name] == ["kp", "ki", "lo", "hi", "clk", "rst", "en", "mode", "e", "preset",
                                                "r_prop", "r_acc", "r_y"]  # fmt: skip
    assert loggers.port_of_line(text, len(lines) + 9) is None


def test_the_whole_design_is_sent_to_its_own_bench(out, monkeypatch):
    golden = bundle.read(out / "dds" / "default")
    top = golden._replace(manifest={**golden.manifest, "block": "top"})
    monkeypatch.setattr(bundle, "read", lambda folder: top)
    with pytest.raises(FileError, match="golden/top/story: bundle of the whole design; use top_run"):
        rtl_run.check("golden/top/story", RTL)
    with pytest.raises(FileError, match="run its bench"):
        compare.compare_bundle(top, {"phase": [0]})


def test_the_example_of_the_page_is_the_output(out, tmp_path):
    """docs/golden.md shows the report on a PI without its rounding constant, character by character."""
    installed("icarus")
    page = (RTL.parents[1] / "docs" / "golden.md").read_text()
    shown = page.partition("```text\n")[2].partition("```")[0]
    folder = design(tmp_path, "pi", "v", (" + HALF_Y;", ";"))
    assert shown == rtl_run.check(out / "pi" / "rate", folder, "icarus").text()


def test_exit_code_2_means_that_nothing_was_compared(out, tmp_path):
    """Through the program itself, because the frame of the command line turns errors into codes."""
    command = [sys.executable, "-m", "testbench.commands.main", "golden", "check", str(out / "pi" / "rate")]
    done = subprocess.run([*command, "--rtl", str(tmp_path)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert "no design" in done.stderr
