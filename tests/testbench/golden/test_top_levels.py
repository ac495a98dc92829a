"""The whole design at its levels: pins alone in rows and signatures, and `golden check` on a bundle of `top`."""

import json
import re
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from fpga_model.rates import FRAME_CYCLES
from testbench.errors import ConfigError, FileError
from testbench.golden import cli
from testbench.golden.bundles import bundle, recompute, top, wrap
from testbench.golden.check import design_run, rtl_run, top_run
from testbench.golden.recording import recording, replay, signature
from tests import naive
from tests.testbench.golden import pin_tops, standin
from tests.testbench.golden.benching import RTL, make, need
from tests.testbench.storage.test_vcd import parse, sampled

CASE, FRAMES, QUIET = "reset", 3, 5000  # QUIET: a clock without a row


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Bundle of the first frames, with hardly a row: what differs is seen by signatures."""
    place = tmp_path_factory.mktemp("levels")
    top.export_case(CASE, place)
    top.window(place / "top" / CASE, FRAMES * FRAME_CYCLES - 50, 50, place / "few")
    return place / "few"


@pytest.fixture(scope="module")
def words(out):
    """Packed pins of every clock."""
    r = recording.load(CASE)
    pins = replay.run(r.params, r.stimulus, FRAMES, np.arange(FRAMES * FRAME_CYCLES)).pins
    return bundle.pack(pins, [p.width for p in top.block({CASE: r.params}).pins])


@pytest.fixture(scope="module")
def pins(out):
    wrap.pins_of(out, "pins", out.with_name("pins"))
    return out.with_name("pins")


@pytest.fixture(scope="module")
def bare():
    """The design with nothing but pins."""
    return top.block({CASE: recording.load(CASE).params})._replace(registers=())


@pytest.fixture(scope="module")
def pins_rtl(tmp_path_factory):
    """The reference RTL, whose top has no port for a register."""
    folder = shutil.copytree(RTL, tmp_path_factory.mktemp("rtl") / "mine")
    text = (folder / "top.v").read_text()
    listed = re.findall(r"(?m)^ +output (wire +(?:signed )?(?: *\[.*\])? *r_\w+),.*\n", text)
    text = re.sub(r"(?m)^ +output wire .*\br_\w+,.*\n", "", text)
    assert len(listed) == len(top.block({}).registers)
    assert "output wire" in text
    (folder / "top.v").write_text(text.replace("\n);\n", "\n);\n" + "".join(f"{net};\n" for net in listed), 1))
    return folder


def bits_of(manifest):
    """Name of the pin of each bit of a packed word, the highest first."""
    return [p["name"] for p in manifest["outputs"] for _ in range(p["width"])]


def checked(*words):
    done = CliRunner().invoke(cli.app, ["check", *map(str, words), "--json"])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, json.loads(done.output)


def test_a_bundle_of_the_pins_has_their_rows_and_the_signatures_of_them_alone(out, pins, words):
    golden, whole = bundle.read(pins), bundle.read(out)
    assert golden.manifest["registers"] == []
    assert golden.exp.shape[1] == len(whole.manifest["outputs"])
    names = [p["name"] for p in golden.manifest["outputs"]]
    want = whole.exp[:, len(whole.manifest["registers"]) :].copy()
    width, bits = bundle.total(golden.manifest["outputs"]), {n: k for k, n in enumerate(bits_of(golden.manifest))}
    for chip in ("drive", "sense", "quadrature"):
        data, select_n = names.index(f"{chip}_sdin"), names.index(f"{chip}_sync_n")
        want[want[:, select_n] == 1, data] = 0
        low, above = (width - 1 - bits[f"{chip}_{pin}"] for pin in ("sdin", "sync_n"))
        words = [word & ~(1 << low) if word >> above & 1 else word for word in words]
    assert np.array_equal(golden.exp, want)
    frames = [words[k * FRAME_CYCLES : (k + 1) * FRAME_CYCLES] for k in range(FRAMES)]
    assert list(golden.signatures) == [signature.signature(frame, width) for frame in frames]
    assert recompute.recompute(pins).rows == len(golden.exp)


@pytest.mark.parametrize("level", ["pins", pytest.param("outputs", marks=pytest.mark.slow)])
def test_a_design_with_pins_alone_passes_without_registers(out, pins_rtl, level):
    need("iverilog")
    code, tree = checked(out, "--rtl", pins_rtl, "--level", level, "--sim", "icarus")
    assert (code, tree["passed"], tree["first"], tree["level"]) == (0, True, None, level)
    assert tree["rows"] == tree["golden_rows"] == len(bundle.read(out).at)
    with pytest.raises(FileError, match="nothing was compared under icarus"):
        top_run.check(out, pins_rtl, choice=design_run.Choice("icarus"))


CHIP = """schema = "gyro-design-map/1.0"
top = "chip"
[clock]
port = "ck"
[reset]
port = "rst_n"
active = 0
[outputs]
adc_cs_n = "cs_n"
refs = "switches"
"""


@pytest.fixture(scope="module")
def chip(pins_rtl, tmp_path_factory):
    """(folder, map) of the design under names of its own: another module, clock, reset and two other pins."""
    folder = shutil.copytree(pins_rtl, tmp_path_factory.mktemp("chip") / "mine")
    text = (folder / "top.v").read_text()
    (folder / "top.v").unlink()
    head, body = text.split("\n);\n", 1)
    head = head.replace("module gyro_top", "module chip").replace("o_adc_cs_n", "cs_n").replace("o_refs", "switches")
    head = re.sub(r"\bclk\b", "ck", re.sub(r"(input +wire +)rst\b", r"\1rst_n", head))
    names = "wire clk = ck, rst = ~rst_n;\nwire o_adc_cs_n;\nwire [3:0] o_refs;\n"
    names += "assign cs_n = o_adc_cs_n;\nassign switches = o_refs;\n"
    (folder / "chip.v").write_text(f"{head}\n);\n{names}{body}")
    (folder / "chip.toml").write_text(CHIP)
    (folder / "chip.f").write_text("".join(f"{path.name}\n" for path in sorted(folder.glob("*.v"))))
    return folder, folder / "chip.toml"


def test_a_map_gives_the_whole_design_names_of_its_own(out, chip, tmp_path):
    need("iverilog")
    folder, names = chip
    words = ["--rtl", folder, "--files", folder / "chip.f", "--level", "pins", "--sim", "icarus", "--map", names]
    code, tree = checked(out, *words)
    assert (code, tree["passed"], tree["level"]) == (0, True, "pins")
    bad = shutil.copytree(folder, tmp_path / "bad")
    text, fewer = re.subn(r"\.align( *)\(references_align\)", r".align\1(2'd1)", (bad / "chip.v").read_text())
    assert fewer == 1
    (bad / "chip.v").write_text(text)
    words[1], words[3] = bad, bad / "chip.f"
    code, tree = checked(out, *words)
    assert (code, tree["first"]["name"], tree["first"]["kind"]) == (1, "refs", "pin")


@pytest.mark.slow
def test_make_check_of_a_wrapped_whole_design_needs_no_python(out, chip, tmp_path):
    need("iverilog")
    folder, names = chip
    wrap.pins_of(out, "pins", tmp_path / "pins", names)
    goals = ["SIM=icarus", f"RTL={folder}", "FILES=chip.f", "PYTHON=/nonexistent"]
    done = make(tmp_path / "pins", *goals)
    assert done.returncode == 0, done.stdout
    assert f"PASS top/{CASE}: {FRAMES * FRAME_CYCLES} clocks" in done.stdout


def test_data_of_a_dac_that_is_not_selected_is_not_judged(out, pins_rtl, words, bare, tmp_path):
    """Masters written anew, as counters, with SDIN high at rest: exact. One bit of a frame that differs: not."""
    need("iverilog")
    other = shutil.copytree(pins_rtl, tmp_path / "other")
    text = re.sub(r"\n *\.r_(?:shift|left|lead|ldac_wait) *\(r_\w+_dac_\w+\),", "", (other / "top.v").read_text())
    (other / "top.v").write_text(text)
    (other / "spi_dac.v").write_text(pin_tops.COUNTING)
    code, tree = checked(out, "--rtl", other, "--level", "pins", "--sim", "icarus")
    assert (code, tree["first"]) == (0, None)
    names = bits_of(bundle.read(out).manifest)
    selected = [not word >> (len(names) - 1 - names.index("drive_sync_n")) & 1 for word in words]
    row = QUIET + selected[QUIET:].index(True)
    bad = standin.write(tmp_path / "bad", bare, CASE, words, (row, "o_drive_sdin", 1))
    code, tree = checked(out, "--rtl", bad, "--level", "pins", "--sim", "icarus")
    assert (code, tree["first"]["clock"], tree["first"]["name"]) == (1, row, "drive_sdin")


def test_the_reference_passes_at_registers(out):
    need("iverilog")
    code, tree = checked(out, "--rtl", RTL, "--sim", "icarus")
    assert (code, tree["passed"], tree["level"]) == (0, True, "registers")


def test_a_fault_is_named_with_its_first_clock_and_pin(out, words, bare, tmp_path):
    need("iverilog")
    design = standin.write(tmp_path / "bad", bare, CASE, words, (QUIET, "o_sense_sync_n", 1))
    assert QUIET not in bundle.read(out).at
    code, tree = checked(out, "--rtl", design, "--level", "pins", "--sim", "icarus")
    ports = [(p["name"], p["width"]) for p in bundle.read(out).manifest["outputs"]]
    below = sum(width for _, width in ports[[name for name, _ in ports].index("sense_sync_n") + 1 :])
    want = words[QUIET] >> below & 1
    first = {key: tree["first"][key] for key in ("clock", "kind", "name", "expected", "got")}
    assert first == {"clock": QUIET, "kind": "pin", "name": "sense_sync_n", "expected": want, "got": 1 - want}
    assert (code, tree["passed"], tree["diagnosis"]) == (1, False, [])


def test_a_fault_in_the_rtl_shows_where_a_model_with_this_fault_does(out, pins_rtl, tmp_path):
    """One register too few behind the references: the same as a smaller `align`, which the bench does not set."""
    need("iverilog")
    bad = shutil.copytree(pins_rtl, tmp_path / "bad")
    text, fewer = re.subn(r"\.align( *)\(references_align\)", r".align\1(2'd1)", (bad / "top.v").read_text())
    assert fewer == 1
    (bad / "top.v").write_text(text)
    r = recording.load(CASE)
    assert r.params.references.align == 2
    other = r.params._replace(references=r.params.references._replace(align=1))
    at = np.arange(FRAMES * FRAME_CYCLES)
    right, wrong = (replay.run(p, r.stimulus, FRAMES, at).pins for p in (r.params, other))
    clock = int(np.flatnonzero((right != wrong).any(axis=1))[0])
    k = int(np.flatnonzero(right[clock] != wrong[clock])[0])
    tree = checked(out, "--rtl", bad, "--level", "pins", "--sim", "icarus", "--out", tmp_path / "found")[1]
    begin, golden, yours = waves(tmp_path / "found", "pin.refs")
    span = slice(begin, begin + len(golden))
    assert (golden, yours) == ([*right[span, 2]], [*wrong[span, 2]])
    first = [tree["first"][key] for key in ("clock", "name", "expected", "got")]
    assert first == [clock, tree["ports"][k], right[clock, k], wrong[clock, k]]


def waves(package, name):
    """(first clock, golden values, values of the design) of a signal of a package, a row per clock edge."""
    _, changes = parse(package / "window.vcd")
    ticks = sum(level for _, level in changes["gyro_top.clk_26m"][1]) - 1
    times = [naive.edge_picoseconds(k) for k in range(ticks)]
    first = int(re.search(r"edge (\d+);", (package / "window.vcd").read_text())[1])
    return first, *(sampled(changes[f"gyro_top.{name}.{whose}"][1], times) for whose in ("golden", "yours"))


def test_a_difference_leaves_waveform_bundle_and_diagnosis(out, tmp_path):
    """A counter that sends one bit less, in three instances of its block: one cause, named at the first."""
    need("iverilog")
    bad = shutil.copytree(RTL, tmp_path / "bad")
    text = (bad / "spi_dac.v").read_text()
    assert text.count("(r_left == 5'd1)") == 1
    (bad / "spi_dac.v").write_text(text.replace("(r_left == 5'd1)", "(r_left == 5'd2)"))
    code, tree = checked(out, "--rtl", bad, "--sim", "icarus", "--out", tmp_path / "found")
    named = tree["diagnosis"][0]
    assert (code, named["cause"], named["register"]) == (1, "comparison", "drive_dac_sync_n")
    assert tree["first"]["name"] == "drive_dac_sync_n"
    clock = tree["first"]["clock"]
    assert tree["first"]["before"][-1]["clock"] == clock
    package = tmp_path / "found"
    assert json.loads((package / "diagnosis.json").read_text())["diagnosis"] == tree["diagnosis"]
    first, golden, yours = waves(package, "reg.drive_dac_sync_n")
    assert golden.index(1, golden.index(0)) == yours.index(1, yours.index(0)) + 1
    assert first + [a == b for a, b in zip(golden, yours)].index(False) == clock
    window = bundle.read(package / "bundle" / "top" / CASE)
    assert np.array_equal(window.at, np.arange(first, first + len(golden)))
    said = make(package / "bundle" / "top" / CASE, "SIM=icarus", f"RTL={bad}", "PYTHON=false")
    assert said.returncode != 0
    assert said.stdout.startswith(f"clock {clock}: r_drive_dac_sync_n: expected 0, got 1 (hex)")


def test_what_cannot_be_compared_is_one_line(out, pins, tmp_path):
    with pytest.raises(ConfigError, match="--latency: the pins of the whole design have the clocks of gyro_top"):
        top_run.check(out, RTL, choice=design_run.Choice(latency=tmp_path))
    with pytest.raises(ConfigError, match="--map, --top: the whole design has names of its own at --level pins"):
        top_run.check(out, RTL, choice=design_run.Choice(top="mine"))
    with pytest.raises(ConfigError, match="--top: top: gyro_top is the name of the wrapper"):
        top_run.check(out, RTL, choice=design_run.Choice(top="gyro_top", level="pins"))
    (tmp_path / "later.toml").write_text(CHIP.replace("[reset]", '[reset]\nstyle = "async"'))
    with pytest.raises(ConfigError, match=r"later\.toml: reset.style: 'async' is not 'sync'"):
        wrap.pins_of(out, "pins", tmp_path / "new", tmp_path / "later.toml")
    with pytest.raises(ConfigError, match="level: 'registers' is not a level of"):
        top_run.check(pins, RTL, choice=design_run.Choice(level="registers"))
    with pytest.raises(ConfigError, match="level: 'bits' is not a level of"):
        top_run.check(out, RTL, choice=design_run.Choice(level="bits"))
    with pytest.raises(ConfigError, match="level: 'registers' is not one of pins, outputs"):
        wrap.pins_of(out, "registers", tmp_path / "new")
    with pytest.raises(FileError, match="exists and is not an empty folder"):
        wrap.pins_of(out, "pins", pins)
    with pytest.raises(FileError, match="no design for any simulator"):
        top_run.check(out, tmp_path)
    with pytest.raises(FileError, match="is run by top_run"):
        rtl_run.check(out, RTL)


@pytest.mark.slow
@pytest.mark.parametrize("sim", ["icarus", "verilator", "ghdl"])
def test_make_check_of_the_pins_needs_no_python(pins, words, bare, tmp_path, sim):
    need(*{"icarus": ("iverilog",), "verilator": ("verilator", "g++"), "ghdl": ("ghdl",)}[sim])
    folder = shutil.copytree(pins, tmp_path / "away")
    good = standin.write(tmp_path / "good", bare, CASE, words)
    goals = [f"SIM={sim}", f"RTL={good}", "PYTHON=/nonexistent"]
    done = make(folder, *goals)
    assert done.returncode == 0, done.stdout
    assert f"PASS top/{CASE}: {FRAMES * FRAME_CYCLES} clocks" in done.stdout
    bad = standin.write(tmp_path / "bad", bare, CASE, words, (QUIET, "o_adc_sclk", 1))
    done = make(folder, f"SIM={sim}", f"RTL={bad}", "PYTHON=/nonexistent")
    assert done.returncode != 0
    assert "frame 1 (clocks 3250 .. 6499): signature: expected" in done.stdout, done.stdout
