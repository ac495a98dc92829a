"""Bundles and reference RTL of other designs: boards of the repository, random designs, constants left in the RTL."""

import inspect
import re
import shutil

import pytest
from typer.testing import CliRunner

from fpga_model.block import keys
from fpga_model.design_record import DEFAULT, Design
from testbench import config
from testbench.errors import ConfigError, FileError
from testbench.golden import cli
from testbench.golden.bundles import bundle, design_bundle, design_entry, export, recompute
from testbench.golden.check import compare, rtl_run
from testbench.golden.diagnosis.cause_ranking import SURE
from testbench.golden.recording import make_recordings, recording
from testbench.golden.stimulus import blocks
from tests.testbench.engines.test_designs import BOARDS, SEED, drawn
from tests.testbench.golden.benching import VHDL, check, make
from tests.testbench.golden.resealing import reseal
from tests.testbench.rtl.test_rtl import RTL, declared, ghdl, icarus, ran, verilator, yosys

LOW_COST = BOARDS / "low_cost.toml"
KEYED = [stem for stem, block in blocks.BLOCKS.items() if keys(blocks.block_modules()[stem])]
QUICK = ("dds", "rates", "frequency_tracker")
RANDOM = range(SEED, SEED + 3)
PASSED = re.compile(r"PASS \w+/\w+: \d+ rows")


def random_board(folder, seed):
    """Configuration file of a random design."""
    path = folder / f"random_{seed}.toml"
    path.write_text(config.to_toml(config.changed(config.Config(), drawn(seed))))
    return path


@pytest.fixture(scope="module")
def low_cost(tmp_path_factory):
    """Function of a block's name: folder of its bundles of the low-cost board."""
    folder = tmp_path_factory.mktemp("low_cost")

    def of(stem):
        if not (folder / stem).exists():
            export.export(stem, folder, config=LOW_COST)
        return folder / stem

    return of


def passes(folder, sim=None, rtl=RTL):
    """Whether a design passes the bundle of a case."""
    return rtl_run.check(folder, rtl, sim).passed


# ---- bundles ---------------------------------------------------------------------------------------------------------


@icarus
@pytest.mark.parametrize("stem", QUICK)
def test_bundles_of_a_board_pass_on_the_reference_rtl(stem, low_cost):
    folder = low_cost(stem)
    cases = sorted(p.name for p in folder.iterdir() if p.is_dir())
    assert cases == sorted(design_entry.config_blocks(LOW_COST)[stem].cases)
    done = check(folder, "icarus", RTL)
    assert done.returncode == 0, done.stdout
    assert len(PASSED.findall(done.stdout)) == len(cases)
    for case in cases:
        assert passes(folder / case, "icarus")
        proof = recompute.recompute(folder / case)
        assert (proof.rows, proof.other) == (bundle.verify(folder / case)["n"], ())


def test_a_manifest_names_the_design(low_cost):
    manifest = bundle.verify(low_cost("dds") / "default")
    record = config.load(LOW_COST).design_record()
    assert manifest["design"] == record._asdict()
    assert manifest["design_params"] == [{"name": "DDS_BITS", "value": record.dds_bits}]
    assert manifest["clock"]["hz"] == record.master_hz
    assert {p["width"] for p in manifest["registers"]} == {record.dds_bits}
    assert "localparam P_DDS_BITS = 32;" in (low_cost("dds") / "default" / "params.vh").read_text()
    assert "design" not in bundle.verify(export_default(low_cost("dds").parent / "plain"))


def test_the_diagnosis_knows_the_design(low_cost):
    """The frequency tracker's word without its correction: that takes the 32 bits in which the sum wraps."""
    golden = bundle.read(low_cost("frequency_tracker") / "default")
    names = [port["name"] for port in golden.manifest["registers"]]
    column = dict(zip(names, golden.exp.T[: len(names)]))
    got = {name: values.copy() for name, values in column.items()}
    free = golden.stim[:-1, 0] == 0
    got["word"][1:][free] = ((column["centre"] - column["loop_y"]) % 2**32)[:-1][free]
    (found,) = compare.compare_bundle(golden, got).diagnosis
    assert (found.cause, found.register, found.what) == ("sign", "word", "centre - loop_y")


def export_default(folder):
    export.export("rates", folder)
    return folder / "rates" / "default"


def test_a_case_of_a_board_has_its_parameters(low_cost):
    """Of the modulators: those that the firmware is built with, and those of the block at the board's design."""
    found = design_entry.config_blocks(LOW_COST)["modulator"]
    _, params = design_entry.read_board_config(LOW_COST)
    assert found.cases["drive_modulator"] == params.drive_modulator
    assert found.cases["sense_modulator"] == params.sense_modulator
    assert found.cases["dac16"].shift == blocks.BLOCKS["modulator"].cases["dac16"].shift - 2, (
        "the sine has two bits less"
    )


@icarus
@pytest.mark.slow
@pytest.mark.parametrize("board", [*sorted(path.stem for path in BOARDS.glob("*.toml")), *RANDOM])
def test_all_bundles_of_all_boards_pass_on_the_reference_rtl(board, tmp_path):
    path = BOARDS / f"{board}.toml" if isinstance(board, str) else random_board(tmp_path, board)
    done = [found for stem in blocks.BLOCKS for found in export.export(stem, tmp_path / "out", config=path)]
    failed = [folder for folder, _ in done if not passes(folder, "icarus")]
    assert failed == []
    unproven = [folder for folder, manifest in done if not manifest["ranges"]["proven"]]
    assert unproven == []
    for folder, _ in done:
        if folder.name not in blocks.BLOCKS[folder.parent.name].cases or folder.parent.name in KEYED:
            recompute.recompute(folder)


@ghdl
@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["one case", "every case"])
@pytest.mark.parametrize("stem", [pytest.param(s, marks=[pytest.mark.slow] * (s == "pi")) for s in VHDL if s in KEYED])
def test_vhdl_takes_the_design_too(stem, every, low_cost):
    case = next(iter(blocks.BLOCKS[stem].cases))
    for folder in (p for p in low_cost(stem).iterdir() if p.is_dir() and (every or p.name == case)):
        assert passes(folder, "ghdl")
    done = check(low_cost(stem) / case, "ghdl", RTL)
    assert done.returncode == 0, done.stdout


# ---- the whole design ------------------------------------------------------------------------------------------------

BOARD_NAMES = sorted(path.stem for path in BOARDS.glob("*.toml"))
REACHED = ("STANDBY to OPEN", "SEARCH to RETUNE", "SEARCH to KICK", "reset while the ADC is read", "BALANCE to LOCKED")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The first frames of the case `reset` of the low-cost board."""
    _, firmware = design_entry.read_board_config(LOW_COST)
    r = design_bundle.shorten_recording(
        make_recordings.reset_case(recording.load("story"), firmware), 4, (recording.Window(5000, 40, ""),)
    )
    folder = tmp_path_factory.mktemp("whole") / "reset"
    design_bundle.write(r, folder, names_design=True)
    return folder


def test_a_bundle_of_the_whole_design_of_a_board(whole, tmp_path):
    manifest, d = bundle.verify(whole), config.load(LOW_COST).design_record()
    assert (manifest["frame_cycles"], manifest["tick_cycles"]) == (d.frame_clocks, d.tick_clocks)
    other = {key.upper(): value for key, value in d._asdict().items() if value != getattr(DEFAULT, key)}
    assert {entry["name"]: entry["value"] for entry in manifest["design_params"]} == other
    assert recompute.recompute(whole).rows == manifest["n"] == 41
    folder, cut = design_bundle.window(whole, 4000, 40, tmp_path / "w")
    assert (cut["n"], cut["frames"]) == (41, 2)
    assert bundle.read(folder).signatures == bundle.read(whole).signatures[:2]


@icarus
def test_the_reference_rtl_passes_the_whole_design_of_a_board(whole, tmp_path):
    done = check(whole, "icarus", RTL)
    assert done.returncode == 0, done.stdout
    assert "4 of 4 frames" in done.stdout
    done = check(whole, "icarus", faulty(tmp_path, "top.v", ".TICK_CLOCKS(TICK_CLOCKS)", ".TICK_CLOCKS(26)"))
    assert done.returncode == 2, done.stdout
    assert "frame 0 (clocks 0 .. 2999): signature: expected" in done.stdout


@pytest.mark.slow
def test_the_case_reset_of_a_board_goes_through_all_states(tmp_path):
    settings_, firmware = design_entry.read_board_config(LOW_COST)
    manifest = design_bundle.export_board(firmware, settings_, "reset", tmp_path / "top" / "reset")
    shown = " ".join(window["shows"] for window in manifest["windows"])
    assert all(text in shown for text in REACHED), shown


READOUTS = {  # of the ADC, and the master clock
    "52 MHz, divider 4": {"design.master_hz": 52_000_000, "design.adc_divider": 4, "design.frame_ticks": 250}
    | {f"design.{role}_dac": "generic" for role in ("drive", "sense", "quadrature")},
    "words of 16 bits, 5 channels": {
        "design.adc": "generic",
        "design.adc_bits": 16,
        "design.adc_word_bits": 16,
        "design.adc_channels": 5,
        "design.adc_tail_clocks": 1,
    },
}


def board_of_readout(folder, name):
    """Configuration file of a board with another readout."""
    path = folder / "readout.toml"
    path.write_text(config.to_toml(config.changed(config.Config(), READOUTS[name])))
    return path


@icarus
@pytest.mark.parametrize("name", READOUTS)
def test_another_readout_passes(name, tmp_path):
    (folder, _), *_ = export.export("spi_adc", tmp_path / "out", config=board_of_readout(tmp_path, name))
    assert passes(folder, "icarus")


@verilator
@icarus
@pytest.mark.slow
@pytest.mark.parametrize("name", READOUTS)
def test_the_whole_design_with_another_readout_passes(name, tmp_path):
    done = export.export("top", tmp_path / "out", config=board_of_readout(tmp_path, name), frames=60)
    for folder, _ in done:
        found = check(folder, "verilator", RTL)
        assert found.returncode == 0, found.stdout
        found = make(folder, "SIM=icarus", f"RTL={RTL}", "FRAMES=40")
        assert found.returncode == 0, found.stdout


@verilator
@icarus
@pytest.mark.slow
@pytest.mark.parametrize("name", [*BOARD_NAMES, *RANDOM])
def test_the_whole_design_of_every_board_passes(name, tmp_path):
    """All frames of both cases under Verilator; the loop of the board itself from power-on under Icarus too."""
    path = BOARDS / f"{name}.toml" if isinstance(name, str) else random_board(tmp_path, name)
    done = export.export("top", tmp_path / "out", config=path)
    assert [folder.name for folder, _ in done] == list(design_bundle.BOARD_CASES)
    for folder, _ in done:
        found = check(folder, "verilator", RTL)
        assert found.returncode == 0, found.stdout
    found = make(done[1][0], "SIM=icarus", f"RTL={RTL}", "FRAMES=60")
    assert found.returncode == 0, found.stdout


# ---- the reference RTL -----------------------------------------------------------------------------------------------

DESIGNS = {
    "low_cost": config.load(LOW_COST).design_record(),
    "fast_dacs": config.load(BOARDS / "fast_dacs.toml").design_record(),
    "least": Design(1_000_000, 16, 50, 24, 4, 1, 10, 8, 0, 8, 2, 16, 5, 1),
    "most": Design(200_000_000, 32, 426, 48, 12, 12, 20, 24, 8, 24, 8, 24, 8, 511),
    "cut to nothing": Design(26_000_000, 26, 125, 26, 12, 12, 13, 13, 3, 13),
}


@pytest.mark.parametrize("stem", KEYED)
@pytest.mark.parametrize("name", DESIGNS)
def test_ports_of_the_rtl_have_the_widths_of_the_design(stem, name):
    block = blocks.design_blocks(DESIGNS[name])[stem]
    for language in ("v", "vhd") if stem in VHDL else ("v",):
        text = (RTL / f"{stem}.{language}").read_text().partition("architecture")[0]
        inputs = [("clk", 1), *((p.name, p.width) for p in block.columns)]
        outputs = [
            *((f"r_{p.name}", p.width) for p in block.registers),
            *((f"o_{p.name}", p.width) for p in block.pins),
        ]
        for kind, wanted in (("input", inputs), ("output", outputs)):
            found = [entry[:2] for entry in declared(text, kind, language, DESIGNS[name])]
            assert found == wanted, kind


def sources(stem):
    return [RTL / f"{part}.v" for part in (*export.benches.PARTS.get(stem, ()), stem)]


def settings(block, case):
    """Options of Verilator that set keys and parameters."""
    given = [f"-G{name}={value}" for name, value in block.design_keys.items()]
    listed = blocks.case_parameters(block, case)
    return given + [f"-G{name}={fmt.width}'h{raw & (1 << fmt.width) - 1:x}" for name, raw, fmt in listed]


@verilator
@pytest.mark.parametrize("stem", KEYED)
@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n != "most")) for n in DESIGNS])
def test_verilator_has_no_warning_at_another_design(stem, name, tmp_path):
    block = blocks.design_blocks(DESIGNS[name])[stem]
    options = settings(block, next(iter(block.cases)))
    ran(["verilator", "--lint-only", "-Wall", "--top-module", f"gyro_{stem}", *options, *sources(stem)], tmp_path, True)


@yosys
@pytest.mark.parametrize("stem", KEYED)
def test_yosys_synthesises_another_design_without_latches(stem, tmp_path):
    block = blocks.design_blocks(DESIGNS["low_cost"])[stem]
    for path in sources(stem):
        (tmp_path / path.name).write_text(path.read_text().replace('ROM_FILE = ""', 'ROM_FILE = "rom.hex"'))
    (tmp_path / "rom.hex").write_text("".join(f"{word:x}\n" for rom in block.roms for word in rom.words))
    given = [(name, 32, value) for name, value in block.design_keys.items()]
    given += [(name, fmt.width, raw & (1 << fmt.width) - 1) for name, raw, fmt in
              blocks.case_parameters(block, next(iter(block.cases)))]  # fmt: skip
    values = "".join(f" -chparam {name} {width}'h{raw:x}" for name, width, raw in given)
    *parts, top = (path.name for path in sources(stem))
    steps = (
        *(f"read_verilog {part}" for part in parts),
        f"read_verilog -defer {top}",
        f"hierarchy -check -top gyro_{stem}{values}",
        "proc; flatten; opt; check -assert",
        "select -assert-none t:$dlatch t:$adff t:$dffsr",
    )
    ran(["yosys", "-q", "-p", "; ".join(steps)], tmp_path)


# File, an expression, the same as a number of the default design, a case that tells, and what the diagnosis calls it;
# "": nothing for certain
LEFT_IN = [
    ("rates.v", "LAST_CYCLE = TICK_CLOCKS - 1", "LAST_CYCLE = 25", "default", ""),
    ("frequency_tracker.v", "{32'd0, MASTER_HZ}", "64'd26000000", "default", "reset"),
    ("frequency_tracker.v", "<< (DDS_BITS + 1)", "<< 49", "default", "reset"),
    ("sine.v", "{DROPPED-1{1'b0}}", "{15{1'b0}}", "default", ""),
    (
        "sine.v",
        "PLACE = SINE_ADDRESS_BITS + SINE_FRACTION_BITS",
        "PLACE = SINE_ADDRESS_BITS + 10",
        "default",
        "",
    ),
    ("sine.v", "SLOPE = SINE_BITS - SINE_ADDRESS_BITS + 5", "SLOPE = 13", "default", ""),
    ("references.v", "sense_ref[DDS_BITS-1] ^", "sense_ref[47] ^", "align0_direct", ""),
    ("modulator.v", "{24{sine[SINE_BITS-1]}}", "{24{sine[17]}}", "dac16", ""),
    ("registers.v", "{32'd0, MASTER_HZ}", "64'd26000000", "default", "reset"),
    ("sequencer.v", "correction[DDS_BITS-1] ?", "correction[47] ?", "quick", "width"),
]


def faulty(folder, name, right, wrong):
    """Copy of the reference RTL with a slip."""
    shutil.copytree(RTL, folder / "rtl")
    text = (RTL / name).read_text()
    assert text.count(right) == 1
    (folder / "rtl" / name).write_text(text.replace(right, wrong))
    return folder / "rtl"


@icarus
@pytest.mark.parametrize(
    ("name", "right", "wrong", "case", "cause"),
    [slip if slip in (LEFT_IN[0], LEFT_IN[2]) else pytest.param(*slip, marks=pytest.mark.slow) for slip in LEFT_IN],
)
def test_a_number_left_in_passes_the_default_design_and_no_other(
    name, right, wrong, case, cause, bundles, low_cost, tmp_path
):
    rtl, stem = faulty(tmp_path, name, right, wrong), name.split(".")[0]
    assert passes(bundles(stem) / case, "icarus", rtl)
    report = rtl_run.check(low_cost(stem) / case, rtl, "icarus")
    assert not report.passed
    if cause:
        assert report.diagnosis[0].cause == cause
    else:
        assert all(found.share < SURE for found in report.diagnosis)


@icarus
def test_a_port_of_the_default_width_is_named(low_cost, tmp_path):
    rtl = faulty(tmp_path, "dds.v", "[DDS_BITS-1:0] r_drive_ref", "[47:0] r_drive_ref")
    with pytest.raises(FileError, match="port r_drive_ref has 48 bits, the bundle has 32"):
        rtl_run.check(low_cost("dds") / "default", rtl, "icarus")


@icarus
def test_a_design_without_the_key_is_named(low_cost, tmp_path):
    rtl = faulty(tmp_path, "rates.v", "parameter TICK_CLOCKS", "parameter CLOCKS_OF_TICK")
    path = rtl / "rates.v"
    path.write_text(path.read_text().replace("TICK_CLOCKS", "CLOCKS_OF_TICK"))
    with pytest.raises(FileError, match="parameter TICK_CLOCKS is missing"):
        rtl_run.check(low_cost("rates") / "default", rtl, "icarus")


# ---- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[design]\ntick_clocks = 25\n",
            "design.tick_clocks = 25 clocks: the serial frame of the sense DAC AD5791 takes 26",
        ),
        ("[design]\ndds_bits = 60\n", "design.dds_bits"),
        ("[design]\nmaster_hz = 36000000\n", "design.master_hz = 36000000 Hz is above 35000000 Hz"),
        ("[design]\ndds_bits = 24\nsine_address_bits = 4\n", "frequency loop with dds_bits = 24 bits"),
        ("[firmware]\nnotch_hz = 139.0\n", "firmware.notch_hz: the Verilog of the whole design has no notch"),
    ],
)
def test_a_design_that_cannot_work_is_one_clear_line(text, said, tmp_path):
    (tmp_path / "board.toml").write_text(text)
    with pytest.raises(ConfigError, match=said):
        export.export("all", tmp_path / "out", config=tmp_path / "board.toml")
    assert not (tmp_path / "out").exists()


def test_options_that_do_not_fit_are_one_clear_line(tmp_path):
    def said(*words):
        done = CliRunner().invoke(cli.app, words)
        assert isinstance(done.exception, ConfigError)
        return str(done.exception)

    given = ("export", "top", "--out", str(tmp_path), "--config", str(LOW_COST))
    assert said(*given, "--frames", "0") == "--frames = 0 is outside 1 .. 80000"
    assert said("loop", "--rtl", str(RTL), "--set", "scenario.seconds=1") == "--set scenario: needs --config"
    assert list(tmp_path.iterdir()) == []


def test_the_page_states_what_is_exported_of_a_board():
    page = (BOARDS.parent / "golden.md").read_text()
    assert all(f"| `top/{case}` |" in page for case in design_bundle.BOARD_CASES)
    assert f"from power-on for {design_bundle.BOARD_FRAMES} frames" in page
    assert inspect.signature(cli.export).parameters["frames"].default == design_bundle.BOARD_FRAMES


EDITS = [
    ({"dds_bits": 99}, r"design: dds_bits: Input should be less than or equal to 48"),
    ({"dds_bits": "32"}, r"design: .*'dds_bits': '32'"),
    ({"dds_bits": 24, "sine_address_bits": 12, "sine_fraction_bits": 12}, r"dds_bits = 24 is too few for quadrant"),
    ({"sine_bits": 10, "sine_address_bits": 10}, r"sine_bits = 10 is not above sine_address_bits"),
    ({"more": 1}, r"design: has the keys master_hz, .*, more, not master_hz"),
    ({"tick_clocks": 25}, r"clock|exp\.hex: row|design_params"),
]


@pytest.mark.parametrize(("values", "said"), EDITS)
def test_a_manifest_with_another_design_is_refused(values, said, low_cost, tmp_path):
    folder = tmp_path / "bundle"
    shutil.copytree(low_cost("rates") / "default", folder)
    reseal(folder, lambda manifest: manifest["design"].update(values))
    with pytest.raises(FileError, match=said):
        recompute.recompute(folder)


@icarus
@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([{"name": "DDS_BITS", "value": "32);"}], "design_params: 0.value: Input should be a valid integer"),
        ([{"name": "DDS BITS", "value": 32}], "'DDS BITS' is not a valid name of a port, a parameter or a block"),
        ("DDS_BITS", "design_params: content: Input should be a valid list"),
    ],
)
def test_keys_that_are_none_are_refused(given, said, low_cost, tmp_path):
    folder = tmp_path / "bundle"
    shutil.copytree(low_cost("dds") / "default", folder)
    reseal(folder, lambda manifest: manifest.update(design_params=given))
    with pytest.raises(FileError, match=said):
        rtl_run.check(folder, RTL, "icarus")


def test_a_parameter_of_a_board_outside_its_format_is_refused(low_cost, tmp_path):
    folder = tmp_path / "bundle"
    shutil.copytree(low_cost("frequency_tracker") / "frequency_tracker", folder)
    reseal(folder, lambda manifest: manifest["params"][0].update(raw=1 << 60))
    with pytest.raises(FileError, match=r"params: loop_kp = 1152921504606846976 is outside its format \[1,9,24\]"):
        recompute.recompute(folder)


def test_the_keys_of_the_record_are_those_of_the_rtl():
    """Every key of the record that is a width or a count is in the RTL of a block."""
    used = {key for stem in blocks.BLOCKS for key in keys(blocks.block_modules()[stem])}
    assert used == set(DEFAULT._fields)
