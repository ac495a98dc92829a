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
from testbench.golden.bundles import adapted_bundle, bundle, design_bundle, recompute
from testbench.golden.check import design_run, rtl_run, top_run
from testbench.golden.recording import board_pins, recording, replay_recording, signature
from tests import naive
from tests.testbench.golden import pin_tops, standin
from tests.testbench.golden.benching import RTL, make, need
from tests.testbench.storage.test_vcd import parse, sampled

CASE, FRAMES, QUIET = "reset", 3, 5000  # QUIET: a clock without a row


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Bundle of the first frames, with hardly a row: what differs is seen by signatures."""
    place = tmp_path_factory.mktemp("levels")
    design_bundle.export_case(CASE, place / "top" / CASE)
    design_bundle.window(place / "top" / CASE, FRAMES * FRAME_CYCLES - 50, 50, place / "few")
    return place / "few"


@pytest.fixture(scope="module")
def words(out):
    """Packed pins of every clock."""
    r = recording.load(CASE)
    pins = replay_recording.run(r.params, r.stimulus, FRAMES, np.arange(FRAMES * FRAME_CYCLES)).pins
    return bundle.pack(pins, [p.width for p in design_bundle.build_top_block({CASE: r.params}).pins])


@pytest.fixture(scope="module")
def pins(out):
    adapted_bundle.write_pin_bundle(out, "pins", out.with_name("pins"))
    return out.with_name("pins")


@pytest.fixture(scope="module")
def bare():
    """The design with nothing but pins."""
    return design_bundle.build_top_block({CASE: recording.load(CASE).params})._replace(registers=())


@pytest.fixture(scope="module")
def pins_rtl(tmp_path_factory):
    """The reference RTL, whose top has no port for a register."""
    folder = shutil.copytree(RTL, tmp_path_factory.mktemp("rtl") / "mine")
    text = (folder / "top.v").read_text()
    listed = re.findall(r"(?m)^ +output (wire +(?:signed )?(?: *\[.*\])? *r_\w+),.*\n", text)
    text = re.sub(r"(?m)^ +output wire .*\br_\w+,.*\n", "", text)
    assert len(listed) == len(design_bundle.build_top_block({}).registers)
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
        data, select_n, running = (names.index(f"{chip}_{pin}") for pin in ("sdin", "sync_n", "sclk_en"))
        want[(want[:, select_n] == 1) | (want[:, running] == 0), data] = 0
        low, above, beside = (width - 1 - bits[f"{chip}_{pin}"] for pin in ("sdin", "sync_n", "sclk_en"))
        words = [word if not word >> above & 1 and word >> beside & 1 else word & ~(1 << low) for word in words]
    assert np.array_equal(golden.exp, want)
    frames = [words[k * FRAME_CYCLES : (k + 1) * FRAME_CYCLES] for k in range(FRAMES)]
    assert list(golden.signatures) == [signature.signature(frame, width) for frame in frames]
    assert recompute.recompute(pins).rows == len(golden.exp)
    within = bundle.read(out / "pins")
    assert np.array_equal(within.exp, golden.exp)
    assert within.signatures == golden.signatures
    assert recompute.recompute(out).files == len(whole.manifest["sha256"])


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
    adapted_bundle.write_pin_bundle(out, "pins", tmp_path / "pins", names)
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
    running = [word >> (len(names) - 1 - names.index("drive_sclk_en")) & 1 for word in words]
    row = QUIET + running[QUIET:].index(True)
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
    right, wrong = (replay_recording.run(p, r.stimulus, FRAMES, at).pins for p in (r.params, other))
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
    for ports, said in (
        ("adc_sclk = 1", "inputs drdy_n and dout respond to it, so recorded rows would come 1 clocks too early"),
        ("drive_sdin = 1", "one chip reads these pins together, so their clocks must be equal"),
        ("r_dds_phase = 1", "level pins compares no port r_dds_phase"),
        ("refs = -1", r"refs: -1 is not 0 \.\. 4096 clocks"),
    ):
        (tmp_path / "late.toml").write_text(f'schema = "gyro-latency/1.0"\n[ports]\n{ports}\n')
        with pytest.raises(FileError, match=said):
            adapted_bundle.write_pin_bundle(out, "pins", tmp_path / "new", latency=tmp_path / "late.toml")
    with pytest.raises(FileError, match="latencies are for level pins or outputs"):
        top_run.check(out, RTL, choice=design_run.Choice(latency=tmp_path / "late.toml"))
    with pytest.raises(ConfigError, match=r"--map, --top: .* may have other port names at --level pins only"):
        top_run.check(out, RTL, choice=design_run.Choice(top="mine"))
    with pytest.raises(ConfigError, match="--top: top: gyro_top is the name of the wrapper"):
        top_run.check(out, RTL, choice=design_run.Choice(top="gyro_top", level="pins"))
    (tmp_path / "later.toml").write_text(CHIP.replace("[reset]", '[reset]\nstyle = "async"'))
    with pytest.raises(ConfigError, match=r"later\.toml: reset.style: 'async' is not 'sync'"):
        adapted_bundle.write_pin_bundle(out, "pins", tmp_path / "new", tmp_path / "later.toml")
    with pytest.raises(ConfigError, match="level: 'registers' is not a level of"):
        top_run.check(pins, RTL, choice=design_run.Choice(level="registers"))
    with pytest.raises(ConfigError, match="level: 'bits' is not a level of"):
        top_run.check(out, RTL, choice=design_run.Choice(level="bits"))
    with pytest.raises(ConfigError, match="level: 'registers' is not one of pins, outputs"):
        adapted_bundle.write_pin_bundle(out, "registers", tmp_path / "new")
    with pytest.raises(FileError, match="exists and is not an empty folder"):
        adapted_bundle.write_pin_bundle(out, "pins", pins)
    with pytest.raises(FileError, match="no design for any simulator"):
        top_run.check(out, tmp_path)
    with pytest.raises(FileError, match="use top_run"):
        rtl_run.check(out, RTL)


LATE = {"drive_sync_n": 2, "drive_sclk_en": 2, "drive_sdin": 2, "refs": 1}


def later(words, manifest, host, clocks, reset_too):
    """Packed pins of every clock with registers more behind some pins, which the reset clears, or does not."""
    ports = manifest["outputs"]
    rows = np.array([[word >> sum(p["width"] for p in ports[k + 1 :]) & ((1 << p["width"]) - 1)
                      for k, p in enumerate(ports)] for word in words])  # fmt: skip
    resets = set(host[host[:, 1] == 1, 0].tolist()) if reset_too else set()
    for k, port in enumerate(ports):
        for _ in range(clocks.get(port["name"], 0)):
            column, held = rows[:, k].copy(), int(port["width"] == 1)
            for n in range(len(rows)):
                rows[n, k] = held
                held = 0 if n in resets else column[n]
    return bundle.pack(rows, [p["width"] for p in ports])


@pytest.mark.parametrize("reset_too", [True, False])
def test_rows_of_pins_that_come_later_are_those_of_a_design_with_more_registers(words, bare, reset_too):
    """Wherever they are not 0 they are those of either design; in blocks of any length, with resets anywhere."""
    rng = np.random.default_rng(5)
    resets = np.sort(rng.choice(len(words), 40, replace=False))
    resets[-2:] = resets[-3] + 1, resets[-3] + 2
    host = np.stack([resets, np.ones(40, np.int64), 0 * resets, 0 * resets], axis=1)
    ports = {"outputs": [bundle.port(p) for p in bare.pins]}
    exact = bundle.unpack(words, ports["outputs"])
    board, first, found = board_pins.Board(LATE), 0, []
    while first < len(exact):
        count = int(rng.integers(1, 800))
        found.append(board.read(exact[first : first + count], first, host))
        first += count
    found = np.concatenate(found)
    mine = bundle.unpack(later(words, ports, host, LATE, reset_too), ports["outputs"])
    clocks = np.arange(len(mine))
    for k, port in enumerate(ports["outputs"]):
        late = LATE.get(port["name"], 0)
        behind = np.isin(clocks[:, None] - 1 - np.arange(late), [-1, *resets]).any(axis=1) | (clocks < late)
        want = np.where(behind, 0, mine[:, k])
        if port["name"].endswith("sdin"):
            chip = port["name"].removesuffix("sdin")
            select_n, running = (board_pins.pin_column(f"{chip}{pin}") for pin in ("sync_n", "sclk_en"))
            want = np.where((mine[:, select_n] == 0) & (mine[:, running] == 1), want, 0)
        assert np.array_equal(found[:, k], want), port["name"]
    packed = [int(word) for word in bundle.pack(found, [p["width"] for p in ports["outputs"]])]
    width = sum(p["width"] for p in ports["outputs"])
    frames = [packed[k * FRAME_CYCLES : (k + 1) * FRAME_CYCLES] for k in range(FRAMES)]
    assert board.signatures(found, FRAME_CYCLES).tolist() == [signature.signature(frame, width) for frame in frames]


@pytest.mark.parametrize("reset_too", [True, False])
def test_pins_that_come_later_are_judged_where_they_come(out, words, bare, tmp_path, reset_too):
    need("iverilog")
    manifest, host = bundle.read(out).manifest, recording.load(CASE).stimulus.host
    (tmp_path / "late.toml").write_text(
        'schema = "gyro-latency/1.0"\n[ports]\n' + "".join(f"{name} = {k}\n" for name, k in LATE.items())
    )
    mine = later(words, manifest, host, LATE, reset_too)
    design = standin.write(tmp_path / "good", bare, CASE, mine)
    given = ("--rtl", design, "--level", "pins", "--sim", "icarus")
    code, tree = checked(out, *given, "--latency", tmp_path / "late.toml")
    assert (code, tree["first"]) == (0, None)
    assert tree["clocks"] == {f"o_{name}": k for name, k in LATE.items()}
    # of the lag, the references take one clock back
    lags = {cost["node"]: cost["clocks"] for cost in tree["latency"]}
    assert lags == {"xe1": 2 - 1, "ye1": -1}
    if not reset_too:
        return
    assert checked(out, *given)[0] == 1
    names = bits_of(manifest)
    row = QUIET + [word >> (len(names) - 1 - names.index("drive_sclk_en")) & 1 for word in mine[QUIET:]].index(1)
    bad = standin.write(tmp_path / "bad", bare, CASE, mine, (row, "o_drive_sdin", 1))
    code, tree = checked(out, "--rtl", bad, *given[2:], "--latency", tmp_path / "late.toml")
    assert (code, tree["first"]["clock"], tree["first"]["name"], tree["diagnosis"]) == (1, row, "drive_sdin", [])


@pytest.mark.slow
@pytest.mark.parametrize("sim", ["icarus", "verilator", "ghdl"])
def test_make_check_of_pins_that_come_later(bare, tmp_path, sim):
    """With resets in the middle of two frames."""
    need(*{"icarus": ("iverilog",), "verilator": ("verilator", "g++"), "ghdl": ("ghdl",)}[sim])
    (tmp_path / "late.toml").write_text(
        'schema = "gyro-latency/1.0"\n[ports]\n' + "".join(f"{name} = {k}\n" for name, k in LATE.items())
    )
    frames = 2
    r = design_bundle.shorten_recording(recording.load(CASE), frames, (recording.Window(3000, 600, "resets"),))
    resets = np.array([[clock, 1, 0, 0] for clock in (3100, 3101, 3500)])
    kept = r.stimulus.host[~np.isin(r.stimulus.host[:, 0], resets[:, 0])]
    host = np.concatenate([kept, resets])
    r = r._replace(stimulus=r.stimulus._replace(host=host[np.argsort(host[:, 0])]))
    manifest = design_bundle.write(r, tmp_path / "whole")
    adapted_bundle.write_pin_bundle(tmp_path / "whole", "pins", tmp_path / "pins", latency=tmp_path / "late.toml")
    recompute.recompute(tmp_path / "pins")
    rows = replay_recording.run(r.params, r.stimulus, frames, np.arange(frames * FRAME_CYCLES), registers=False).pins
    words = [int(word) for word in bundle.pack(rows, [p.width for p in bare.pins])]
    for reset_too in (True, False):
        good = standin.write(tmp_path / f"good{reset_too}", bare, CASE, later(words, manifest, host, LATE, reset_too))
        done = make(tmp_path / "pins", f"SIM={sim}", f"RTL={good}", "FRAMES=0", "PYTHON=/nonexistent")
        assert done.returncode == 0, done.stdout
    plain = standin.write(tmp_path / "plain", bare, CASE, words)
    assert make(tmp_path / "pins", f"SIM={sim}", f"RTL={plain}", "FRAMES=0", "PYTHON=/nonexistent").returncode != 0


def test_a_fault_near_the_pins_is_named_and_none_is_certain(out, pins_rtl, tmp_path):
    """A counter that sends one bit less in all three masters; references with a register too few."""
    need("iverilog")
    bad = shutil.copytree(pins_rtl, tmp_path / "dac")
    text = (bad / "spi_dac.v").read_text()
    (bad / "spi_dac.v").write_text(text.replace("(r_left == 5'd1)", "(r_left == 5'd2)"))
    tree = checked(out, "--rtl", bad, "--level", "pins", "--sim", "icarus")[1]
    assert tree["diagnosis"][0]["cause"] == "comparison"
    assert tree["diagnosis"][0]["register"].startswith("drive_dac_")
    assert max(cause["share"] for cause in tree["diagnosis"]) <= 0.5


def test_check_of_the_pins_in_the_bundle_of_all_registers(out, words, bare, tmp_path):
    need("iverilog")
    folder = shutil.copytree(out, tmp_path / "away")
    good = standin.write(tmp_path / "good", bare, CASE, words)
    done = make(folder, "SIM=icarus", f"RTL={good}", "LEVEL=pins", "PYTHON=/nonexistent")
    assert done.returncode == 0, done.stdout
    assert done.stdout.startswith(f"PASS top/{CASE}: {FRAMES * FRAME_CYCLES} clocks")
    bundle.verify(folder)
    bad = standin.write(tmp_path / "bad", bare, CASE, words, (QUIET, "o_adc_sclk", 1))
    done = make(folder, "SIM=icarus", f"RTL={bad}", "LEVEL=outputs", "PYTHON=/nonexistent")
    assert done.returncode != 0
    assert "frame 1 (clocks 3250 .. 6499): signature: expected" in done.stdout, done.stdout


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
