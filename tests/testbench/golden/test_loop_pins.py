"""Designs with the pins of the board alone in the loop: the ruler against closed forms, verdicts, three whole tops."""

import json
import re
import shutil
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from typer.testing import CliRunner

from fpga_model import sequencer
from fpga_model.design_record import DEFAULT
from fpga_model.rates import FRAME_HZ, FRAME_TICKS, TICK_CYCLES
from testbench.commands.main import app
from testbench.config import Config, changed, scenario
from testbench.engines import chips
from testbench.errors import ConfigError, FileError
from testbench.golden import divergence
from testbench.golden.bundles import bundle, design_bundle, recompute
from testbench.golden.loop import judgement, library, pin_meter, run
from testbench.golden.recording import make_recordings
from testbench.run import build, simulate
from tests.testbench.golden import loop_faults, loop_score, pin_tops
from tests.testbench.rtl.test_rtl import RTL

VERILATOR = pytest.mark.skipif(
    any(shutil.which(name) is None for name in library.TOOLS), reason="no verilator or compiler: no loop around RTL"
)
PARAMS = build.firmware(Config())
FACE = library.pin_face("mine", PARAMS, chips.parts(chips.dac_chips(Config().design)))
DECLARED = {port: ("IN", width) for port, width in FACE.inputs.values()} | {
    port: ("OUT", fmt.width) for _, port, fmt in FACE.observed_ports
}


def shown(lag_clocks, rates, hz=11002.3, ticks=150_000, sense_per_dps=400.0, bias_dps=7.0):
    """`PinCapture` of ideal sines whose codes lag the phase of the pins; the pins leave on the grid of ticks.

    lag_clocks  of drive and sense, from the phase to the instant at which a code changes
    """
    turns = hz / DEFAULT.master_hz
    clock = np.arange(ticks) * TICK_CYCLES + np.array([[3], [9]])
    angle = 2 * np.pi * turns * (clock - np.array(lag_clocks)[:, None])
    # the same noise in every run, as that of the plant is
    noise = np.repeat(np.random.default_rng(3).normal(0.0, 0.05, ticks // 1000), 1000)
    rate = np.repeat(rates, ticks // len(rates)) + noise
    drive = np.round(20_000 * np.sin(angle[0])).astype(np.int32)
    sense = np.round(sense_per_dps * (rate + bias_dps) * np.sin(angle[1])).astype(np.int32)
    rows = []
    for which in range(4):
        # sgn(sin) turns at 0 and 1/2, sgn(cos) at 1/4 and 3/4 of a turn
        quarters = np.arange(int(ticks * TICK_CYCLES * turns * 2)) / 2 + (which & 1) / 4
        due = np.ceil(quarters / turns / TICK_CYCLES).astype(np.int64) * TICK_CYCLES
        level = (np.arange(len(due)) + 1 + (which & 1)) % 2
        rows += [(int(a), which, int(b)) for a, b in zip(due, level, strict=True)]
    edges = np.array(sorted(rows), np.int64)
    frames = ticks // FRAME_TICKS
    codes = np.zeros((frames, 4))
    codes[:, 1] = -1e6
    at = np.arange(frames) * FRAME_TICKS * TICK_CYCLES * turns * 2 * np.pi
    # the plant's velocities are in metres: over 2 pi 11 kHz
    truth = np.stack([-5e-6 * np.cos(at), 5e-6 * hz / 11_000 * np.sin(at), 0 * at, 0 * at], axis=1)
    return pin_meter.PinCapture(drive, sense, (3, 9), edges, codes, truth)


LIMITS = pin_meter.Limits((1311, 93207, 1e4, 1e4), (13107, 1398101, 1e5, 1e5), (60, 60, 60, 60), 1e6)
RATES = (0.0, 300.0, -300.0)


def measured(*, limits=LIMITS, **given):
    one = shown(**{"lag_clocks": (50.0, 90.0), "rates": RATES} | given)
    per_frame = np.repeat(RATES, len(one.codes) // len(RATES))
    stretches, lock = pin_meter.find_plateaus(per_frame, DEFAULT, [one], limits)
    return pin_meter.measure(one, DEFAULT, stretches, lock, TICK_CYCLES), stretches


def test_lags_are_those_of_ideal_sines():
    """Half a hold of the code is added; the pins wait half a tick in the mean: both are 13 clocks."""
    found, stretches = measured()
    assert [plateau.rate_dps for plateau in stretches] == list(RATES)
    assert found.frequency_hz == pytest.approx(11002.3, abs=0.5)
    per_clock = 360.0 * 11002.3 / DEFAULT.master_hz
    for node, clocks in (("xe1", 50.0), ("ye1", 90.0)):
        assert found.lag_sigma_deg[node] < 0.25 * per_clock
        assert abs(found.lag_deg[node] - clocks * per_clock) < 3 * found.lag_sigma_deg[node] + 1e-3
    assert found.amplitude_m.mean() == pytest.approx(5e-6, rel=1e-5)


def test_lock_is_the_end_of_the_first_rest_behind_the_last_loss():
    codes = np.zeros((200, 4))
    codes[:, 1] = -1e6
    codes[:30, 1] = -5e5  # amplitude too small: lost
    codes[60, 0] = 1e6  # one frame of a wrong phase, which is a loss too
    assert pin_meter.lock_frame(codes, LIMITS, 200) == 61 + 60 + 60
    assert pin_meter.lock_frame(codes, LIMITS, 70) == -1
    # a sense error that ends later, seen from the lock of the drive on
    codes[:130, 3] = 2e4
    assert pin_meter.lock_frame(codes, LIMITS, 200) == 130 + 60
    codes[:130, 3] = 0
    assert pin_meter.lock_frame(codes, LIMITS, 200) == 61 + 60 + 60
    codes[:, 3] = 2e5
    assert pin_meter.lock_frame(codes, LIMITS, 200) == -1


def verdict(**given):
    (model, stretches), (yours, _) = measured(), measured(**given)
    return judgement.assess_design(Config(), PARAMS, model, yours, stretches)


def test_equal_runs_pass_and_each_deviation_fails_by_name():
    same = verdict()
    assert same.passed, same.text()
    assert {line.what.split(",")[0] for line in same.lines} == {
        "time to lock", "xe1", "ye1", "amplitude", "scale factor", "bias", "noise",
    }  # fmt: skip
    for given, wrong, late in (
        ({"lag_clocks": (50.0, 91.0)}, "ye1", (0.0, 1.0)),
        ({"lag_clocks": (48.0, 90.0)}, "xe1", (-2.0, 0.0)),
        ({"sense_per_dps": 401.0, "bias_dps": 7.0 * 400 / 401}, "scale factor", (0.0, 0.0)),
        ({"bias_dps": 7.3}, "bias", (0.0, 0.0)),
    ):
        found = verdict(**given)
        failed = [line.what.split(",")[0] for line in found.lines if line.verdict == judgement.FAILED]
        assert failed == [wrong], found.text()
        assert not found.passed
        assert list(found.clocks.values()) == pytest.approx(late, abs=0.1)
        assert "JUDGED FAIL" in found.text()
        assert found.to_dict()["passed"] is False


def test_a_design_that_does_not_lock_fails_at_once():
    small = verdict(limits=LIMITS._replace(magnitude=2e6))
    assert not small.passed
    assert "do not lock" in small.text()


def test_three_sigma_above_the_limit_is_not_resolved():
    line = judgement.Line("bias", "deg/s", 0.0, 0.05, 0.05, 0.04, 0.1)
    assert line.verdict == judgement.OPEN
    assert line._replace(difference=0.3).verdict == judgement.FAILED
    assert line._replace(sigma=0.03).verdict == judgement.PASSED
    # a deviation of that size fails in 95 of 100 runs
    drawn = np.random.default_rng(1).normal(line.detectable_deviation, line.sigma, 20_000)
    assert np.mean(np.abs(drawn) > line.limit) == pytest.approx(0.95, abs=0.01)


def test_the_detection_score_on_the_page_and_in_a_verdict():
    """The table is that of the file, whose faults are those that are drawn today."""
    found = judgement.detection()
    faults = loop_faults.drawn(found["faults"], found["seed"])
    planted = Counter(fault.kind for fault in faults)
    assert {kind: count for kind, (count, _) in found["kinds"].items()} == planted, loop_score.__doc__
    unseen = [loop_faults.Fault(**fault) for fault in found["unseen"]]
    assert set(unseen) <= set(faults), loop_score.__doc__
    missed = Counter(fault.kind for fault in unseen)
    assert all(seen == count - missed[kind] for kind, (count, seen) in found["kinds"].items())
    assert found["seen"] == len(faults) - len(unseen)
    page = (RTL.parents[1] / "docs" / "rtl.md").read_text()
    (table,) = json.loads((RTL.parents[1] / "docs" / "results" / "loop_detection.json").read_text())["tables"]
    assert table["rows"] == [[kind, str(count), str(seen)] for kind, (count, seen) in found["kinds"].items()]
    assert f"saw {found['seen']} of {found['faults']} planted faults" in " ".join(page.split())
    assert f"{min(planted, key=lambda k: found['kinds'][k][1] / planted[k])} " in judgement.pass_caveat()


def test_every_planted_fault_is_another_text(tmp_path):
    faults = loop_faults.drawn(loop_score.COUNT, loop_score.SEED)
    assert len({(fault.file, fault.line) for fault in faults}) == 100
    folder = loop_faults.write(tmp_path / "rtl", PARAMS, faults)
    text = "".join(path.read_text() for path in folder.glob("*.v"))
    assert all(text.count(f"{loop_faults.SELECTED} == {number})") == 1 for number in range(1, 101))


def test_ports_that_do_not_fit_are_named():
    library.check_ports(FACE, DECLARED, "mine")
    library.check_ports(FACE, {k: v for k, v in DECLARED.items() if not k.startswith("sample")}, "mine")
    with pytest.raises(FileError, match="mine: port o_refs is missing"):
        library.check_ports(FACE, {k: v for k, v in DECLARED.items() if k != "o_refs"}, "mine")
    with pytest.raises(FileError, match="port o_refs: is an output of 5 bits, not an output of 4"):
        library.check_ports(FACE, DECLARED | {"o_refs": ("OUT", 5)}, "mine")
    with pytest.raises(FileError, match="input enable is not a pin of the board"):
        library.check_ports(FACE, DECLARED | {"enable": ("IN", 1)}, "mine")


MAP = """
schema = "gyro-design-map/1.0"
top = "my_board"
[clock]
port = "clk_26m"
[reset]
port = "reset_n"
active = 0
style = "async"
[inputs]
drdy_n = "adc_ready_n"
sample_x = ""
sample_y = ""
[outputs]
refs = { port = "switches_n", invert = true }
"""
RENAMED = """
module my_board(
    input clk_26m, input reset_n, input adc_ready_n, input dout, input write, input [7:0] address, input [47:0] data,
    output o_adc_cs_n, output o_adc_sclk, output [3:0] switches_n,
    output o_drive_sync_n, output o_drive_sclk_en, output o_drive_sdin, output o_sense_sync_n, output o_sense_sclk_en,
    output o_sense_sdin, output o_sense_ldac_n, output o_quadrature_sync_n, output o_quadrature_sclk_en,
    output o_quadrature_sdin
);
    wire [3:0] refs;
    assign switches_n = ~refs;
    gyro_board firmware(
        .clk(clk_26m), .rst(~reset_n), .drdy_n(adc_ready_n), .dout(dout), .sample_x(18'd0), .sample_y(18'd0),
        .write(write), .address(address), .data(data), .o_refs(refs), .*
    );
endmodule
"""


def test_a_map_is_a_wrapper_with_the_pins_of_the_board(tmp_path):
    (tmp_path / "map.toml").write_text(MAP)
    face, made, name = library.write_map_wrapper(FACE, tmp_path / "map.toml", None, tmp_path)
    assert name == "my_board"
    text = made.read_text()
    assert face.top in text
    assert ".reset_n(~rst)" in text
    assert all(re.search(rf"output wire .*\b{port}\b", text) for _, port, _ in FACE.observed_ports)
    (tmp_path / "map.toml").write_text(MAP.replace("refs =", "reffs ="))
    with pytest.raises(FileError, match=r"map\.toml: \[outputs\]: board has no reffs; did you mean"):
        library.write_map_wrapper(FACE, tmp_path / "map.toml", None, tmp_path)


@pytest.mark.slow
@VERILATOR
def test_a_design_of_other_names_is_exact_by_its_map_and_list(tmp_path):
    config, firmware = story()
    config = changed(config, {"scenario.seconds": 0.002})
    rtl = pin_tops.board(tmp_path / "rtl", firmware)
    (rtl / "my_board.sv").write_text(RENAMED)
    (rtl / "mine.f").write_text("\n".join(sorted(path.name for path in rtl.glob("*.*v"))))
    (tmp_path / "map.toml").write_text(MAP)
    pins = run.Pins(None, rtl / "mine.f", tmp_path / "map.toml", True)
    outcome = run.run(config, rtl, tmp_path / "built", firmware=firmware, level=0, pins=pins)
    assert outcome.passed, outcome.text()


PLAYER = """library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
package rows is
    type table is array (natural range <>) of std_logic_vector({top} downto 0);
    constant ROWS : table := (
        {words});
end package;
"""
PLAYING = """library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
library played;
use played.rows.all;
entity player is
    port (
        {ports}
    );
end entity;
architecture playing of player is
    signal n : unsigned(15 downto 0) := (others => '0');
    signal now : std_logic_vector({top} downto 0);
begin
    process (clk) begin
        if rising_edge(clk) then
            if rst = '1' then
                n <= (others => '0');
            elsif n /= {last} then
                n <= n + 1;
            end if;
        end if;
    end process;
    now <= ROWS(to_integer(n));
{assigns}
end architecture;
"""


def vhdl_player(folder, words, columns):
    """A top in VHDL, of two files and a library, with the pins of the board: it plays packed words back."""
    width, places, at = sum(p.width for p in columns), {}, 0
    for p in reversed(columns):
        places[p.name] = f"({at})" if p.width == 1 else f"({at + p.width - 1} downto {at})"
        at += p.width
    kinds = {w: "std_logic" if w == 1 else f"std_logic_vector({w - 1} downto 0)" for w in range(1, 64)}
    ports = [f"{port} : in {kinds[w]}" for port, w in FACE.inputs.values()]
    ports += [f"o_{p.name} : out {kinds[p.width]}" for p in columns]
    folder.mkdir()
    listed = ",\n        ".join(f'"{word:0{width}b}"' for word in words)
    (folder / "rows.vhd").write_text(PLAYER.format(top=width - 1, words=listed))
    assigns = "\n".join(f"    o_{p.name} <= now{places[p.name]};" for p in columns)
    text = PLAYING.format(ports=";\n        ".join(ports), top=width - 1, last=len(words) - 1, assigns=assigns)
    (folder / "player.vhd").write_text(text)
    (folder / "player.f").write_text("-work played\nrows.vhd\n-work work\nplayer.vhd\n")
    return folder


@pytest.mark.slow
@VERILATOR
@pytest.mark.skipif(shutil.which("ghdl") is None, reason="ghdl is not installed: VHDL was NOT run in the loop")
def test_a_top_in_vhdl_is_what_the_loop_runs(tmp_path):
    """It plays words back through the library that the loop calls."""
    columns, rng = design_bundle.build_top_block({}).pins, np.random.default_rng(8)
    words = [int(word) for word in rng.integers(0, 1 << sum(p.width for p in columns), 300)]
    rtl = vhdl_player(tmp_path / "rtl", words, columns)
    listed = library.user_sources(rtl, "player", rtl / "player.f", tmp_path / "built")
    face = FACE._replace(top="player")
    path = library.build(rtl, PARAMS, tmp_path / "built", 0, face, listed)
    given = np.zeros(len(library.INPUTS), np.int64)
    with library.Design(path, face) as design:
        found = [design.pins, *(design.step(given) for _ in words[1:])]
        row = np.zeros(len(library.NAMES), np.int64)
        row[len(library.REGISTERS) :] = library.unpack_pin_rows(np.array(found[-1:]))[0]
        assert np.array_equal(design.read(), row)
    pins = library.unpack_pin_rows(np.array(found))
    assert [int(word) for word in bundle.pack(pins, [p.width for p in columns])] == words


@pytest.mark.skipif(shutil.which("ghdl") is None, reason="ghdl is not installed: VHDL was NOT read")
def test_vhdl_that_the_loop_cannot_take_is_one_line(tmp_path):
    columns = design_bundle.build_top_block({}).pins
    rtl = vhdl_player(tmp_path / "rtl", [1, 2], columns)
    with pytest.raises(FileError, match=r"Player: GHDL writes names in lower case; rename the top to player"):
        library.user_sources(rtl, "Player", rtl / "player.f", tmp_path)
    with pytest.raises(FileError, match=r"for VHDL list the files in order"):
        library.user_sources(rtl, "player")
    (rtl / "player.f").write_text("player.vhd\n")
    with pytest.raises(FileError, match=r"player\.f: ghdl failed with exit code 1"):
        library.user_sources(rtl, "player", rtl / "player.f", tmp_path)
    text = (
        (rtl / "player.vhd")
        .read_text()
        .replace("now <= ROWS", "other : absent port map (clk => clk);\n    now <= ROWS")
    )
    unbound = "    component absent is port (clk : in std_logic); end component;\n    signal n"
    text = text.replace("    signal n", unbound, 1)
    (rtl / "player.vhd").write_text(text)
    (rtl / "player.f").write_text("-work played\nrows.vhd\n-work work\nplayer.vhd\n")
    with pytest.raises(FileError, match=r'ghdl failed with exit code 1: .* "absent" is not bound'):
        library.user_sources(rtl, "player", rtl / "player.f", tmp_path)


def test_bad_input_is_one_clear_error(tmp_path):
    with pytest.raises(FileError, match=r"no design: mine is expected"):
        library.user_sources(tmp_path, "mine")
    with pytest.raises(FileError, match=r"absent\.f"):
        library.user_sources(tmp_path, "mine", tmp_path / "absent.f")
    done = CliRunner().invoke(app, ["golden", "loop", "--rtl", str(tmp_path), "--exact"])
    assert isinstance(done.exception, ConfigError)
    digital = changed(Config(), {"firmware.board": "digital_sid"})
    with pytest.raises(ConfigError, match="judged by the codes of the ADC"):
        run.judge_design(digital, None, build.firmware(digital))


def story(frames=(800, 1080, 1360)):
    """(Config, firmware): the quick gyroscope of the recordings at 0, 300 and -300 deg/s until these frames."""
    first, second, last = (frame / FRAME_HZ for frame in frames)
    rates = [[0.0, 0.0], [first, 300.0], [second, -300.0]]
    given = {"seconds": last, "origin": "power_on", "rate_dps": rates, "rate_shape": "steps"}
    config = changed(Config(), make_recordings.QUICK | {f"scenario.{key}": value for key, value in given.items()})
    return config, make_recordings.quick_firmware(config)


def in_loop(kind, folder, clocks=None):
    """Outcome of a design in the loop; `clocks` are declared in the configuration that the model has."""
    config, firmware = story()
    rtl = kind(folder / "rtl", firmware)
    if clocks:
        config = changed(config, {f"firmware.{key}": value for key, value in clocks.items()})
        firmware = make_recordings.quick_firmware(config)
    return run.run(config, rtl, folder / "built", firmware=firmware, level=1, pins=run.Pins(pin_tops.TOP))


@pytest.mark.slow
def test_lock_and_amplitude_at_the_pins_are_those_of_registers_and_plant():
    config, firmware = story()
    timeline = scenario.expand(config.scenario)
    sim = run.PinCaptureLoop(config, *timeline.temp_degc.limits(), None, firmware)
    sim.now = (np.zeros(1), np.array([timeline.temp_before_degc]))
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    simulate.play(sim, timeline)
    locked = int(np.argmax(sim.columns()["state"] == sequencer.LOCKED))
    limits = judgement.lock_limits(config, firmware)
    # the state follows the four bits in a frame of its own
    assert locked - pin_meter.lock_frame(sim.pin_capture().codes, limits, 800) in (0, 1)
    stretches = [pin_meter.Plateau(120_000, 138_000, 300.0)]
    found = pin_meter.measure(sim.pin_capture(), DEFAULT, stretches, locked, TICK_CYCLES)
    peak = np.abs(sim.columns()["truth_x"][960:1100]).max()
    assert found.amplitude_m.mean() == pytest.approx(peak, rel=2e-3)


@pytest.mark.slow
@VERILATOR
def test_a_design_that_does_not_settle_ends_with_one_line(tmp_path):
    outputs = [f"output o_{name}" if name != "refs" else "output [3:0] o_refs" for name in library.PINS]
    inputs = "input clk, input rst, input drdy_n, input dout, input write, input [7:0] address, input [47:0] data"
    body = "wire a = rst & ~(a ^ clk); assign o_adc_cs_n = a;"
    (tmp_path / "mine.v").write_text(f"module mine({inputs}, {', '.join(outputs)}); {body} endmodule\n")
    path = library.build(tmp_path, PARAMS, tmp_path / "built", 0, FACE, library.user_sources(tmp_path, "mine"))
    code = f"from testbench.golden.loop import library; library.Design({str(path)!r})"
    done = subprocess.run([sys.executable, "-c", code], cwd=RTL.parents[1], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    (line,) = [text for text in done.stderr.splitlines() if text.startswith("gyro: ")]
    assert "converge" in line


@pytest.mark.slow
@VERILATOR
def test_an_exact_design_passes_pin_by_pin(tmp_path):
    outcome = in_loop(pin_tops.board, tmp_path)
    assert outcome.passed, outcome.text()
    assert outcome.difference is None
    assert (outcome.registers, outcome.rows) == (0, round(outcome.seconds * DEFAULT.master_hz) + 1)
    assert outcome.text().splitlines()[1] == judgement.pass_caveat()


@pytest.mark.slow
@VERILATOR
def test_masters_written_anew_are_exact(tmp_path):
    """SDIN at rest has the other level, which no DAC reads."""
    outcome = in_loop(pin_tops.counting_masters, tmp_path)
    assert outcome.difference is None, outcome.text()
    assert outcome.passed


def test_data_counts_where_a_dac_reads_it():
    """The text of the comparison, and the list of what differs: SDIN alone depends on SYNC_N and SCLK."""
    text = library.driver(FACE, DECLARED)
    place = library.NAMES.index("sense_sdin")
    assert (
        f"if (top.o_sense_sync_n || !top.o_sense_sclk_en ? 0 : ((uint64_t)row[{place}] & 0x1u) ^ top.o_sense_sdin)"
        in text
    )
    design = object.__new__(library.Design)
    design.observed_indices, design._data = [at for at, _, _ in FACE.observed_ports], FACE.read
    for selected, running in ((0, 0), (0, 1), (1, 0), (1, 1)):
        row = np.zeros(len(library.NAMES), np.int64)
        row[library.NAMES.index("sense_sync_n")], row[library.NAMES.index("sense_sclk_en")] = 1 - selected, running
        other = row.copy()
        other[place] = 1
        assert design.differing_indices(row, other) == ([place] if selected and running else [])


def last_values(path):
    """{scope.name: value at the last change} of a VCD file, and the number of rising edges of its clock."""
    names, scopes, values, rises = {}, [], {}, 0
    for line in path.read_text().splitlines():
        word = line.split()
        if line.startswith("$scope"):
            scopes.append(word[2])
        elif line.startswith("$upscope"):
            scopes.pop()
        elif line.startswith("$var"):
            names[word[3]] = ".".join([*scopes, word[4]])
        elif line[:1] in ("0", "1"):
            values[names[line[1:]]] = int(line[0])
            rises += line[0] == "1" and names[line[1:]].endswith("clk_26m")
        elif line[:1] == "b":
            values[names[word[1]]] = int(word[0][1:], 2)
    return values, rises


def check_package(folder, difference):
    """The waveform ends with the row that differs, and differs nowhere else; the bundle is what the model computes."""
    values, rises = last_values(folder / "window.vcd")
    pins = [name.split(".")[2] for name in values if ".pin." in name and name.endswith(".golden")]
    assert len(pins) == len(library.PINS)
    wrong = {p: tuple(values[f"gyro_top.pin.{p}.{whose}"] for whose in ("golden", "yours")) for p in pins}
    assert {p: v for p, v in wrong.items() if v[0] != v[1]} == {name: (a, b) for name, a, b in difference.wrong}
    rows = min(2 * DEFAULT.frame_clocks, difference.row + 1)
    assert rises == rows + 1  # the last edge has no row behind it
    bundle = folder / "bundle" / "top" / "loop"
    manifest = json.loads((bundle / "manifest.json").read_text())
    assert manifest["windows"][0]["clock"] + manifest["windows"][0]["rows"] == difference.row + 1
    recompute.recompute(bundle)


TWO = {pin_tops.two_clocks_more: "sense_sine_registers", pin_tops.late_sense_frame: "sense_code_registers"}


@pytest.mark.slow
@VERILATOR
@pytest.mark.parametrize("kind", TWO)
def test_two_clocks_in_the_sense_path(kind, tmp_path):
    """Declared, the design is exact; not declared, it is judged as the model with these clocks would be."""
    (declared := tmp_path / "declared").mkdir()
    exact = in_loop(kind, declared, {TWO[kind]: 2})
    assert exact.difference is None, exact.text()
    outcome = in_loop(kind, tmp_path)
    assert not outcome.passed
    assert [line.what for line in outcome.verdict.lines if line.verdict == judgement.FAILED] == ["ye1"]
    divergence.write(tmp_path / "package", outcome.difference)
    check_package(tmp_path / "package", outcome.difference)
    lines = {line.what.split(",")[0]: line for line in outcome.verdict.lines}
    per_clock = 360.0 * outcome.verdict.frequency_hz / DEFAULT.master_hz
    assert abs(outcome.verdict.clocks["ye1"] - 2.0) < 3 * lines["ye1"].sigma / per_clock
    assert abs(outcome.verdict.clocks["xe1"]) < 0.1
    # the model itself, with these clocks and without them
    config, firmware = story()
    late = changed(config, {f"firmware.{TWO[kind]}": 2})
    model, other = (
        run.capture_pins(c, None, f) for c, f in ((config, firmware), (late, make_recordings.quick_firmware(late)))
    )
    verdict = run.judge_captures(config, firmware, other, model)
    for name, line in lines.items():
        same = next(k for k in verdict.lines if k.what.split(",")[0] == name)
        assert line.difference == same.difference, (line, same)
        assert line.sigma == same.sigma
