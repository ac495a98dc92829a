"""Properties of the RTL: proven of the reference design, and each fails soon after reset where it is broken."""

import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from testbench.commands.main import app
from testbench.errors import ConfigError, FileError
from testbench.golden.bundles.benches import layout
from testbench.golden.foreign.choice import Choice
from testbench.golden.proofs import formal
from testbench.golden.stimulus import blocks
from tests.testbench.rtl.test_rtl import RTL, yosys

pytestmark = yosys
CHECKERS = formal.PROPERTIES
DAC = Path(__file__).with_name("designs") / "dac_link"
KICK_TO = "if (frames >= {1'b0, kick}) following = DECAY;"
STALE = "wire bad = r_faults_flags[STALE] || r_faults_flags[STUCK]"
SOON = ("LAST_WORD = ADC_CHANNELS[3:0]", "LAST_WORD = 4'd0")  # a frame of the ADC that ends after its status word


def kick_to(state):
    return ((KICK_TO, KICK_TO.replace("DECAY", state)),)


NO_RUN = "(!i_control[RUN])\n            following = "
IDLE = "r_valid <= 1'b0;\n            if"


def no_run(state):
    return ((f"{NO_RUN}IDLE", f"{NO_RUN}{state}"),)


def begins(phase):
    """A slave that is in a phase at reset."""
    return "r_phase    <= COMMAND", f"r_phase    <= {phase}"


ADDED = "(taken ? 8'h0 : r_fault_clear) | data[7:0]"  # ones of FAULT_CLEAR
FREE = "r_awready <= 1'b1;\n                r_wready  <= 1'b1;\n                r_bvalid"  # a write is served


def combinational(name, level):
    """An output of the AXI slave that is 0 while an input is: a path from the host to the host within a clock."""
    block = blocks.BLOCKS["axi_slave"]
    ports = {"clk": ("input", 1)} | {port.name: ("input", port.width) for port in block.columns}
    ports |= {port: ("output", found.width) for port, found in layout.result_port_pairs(block)}
    declared = ", ".join(f"{way} wire [{width - 1}:0] {port}" for port, (way, width) in ports.items())
    joined = ", ".join(f".{port}({'own' if port == f'r_{name}' else port})" for port in ports)
    outer = f"wire own; assign r_{name} = own && {level}; inner held({joined});"
    return (
        ("module gyro_axi_slave (", "module inner ("),
        ("endmodule", f"endmodule\nmodule gyro_axi_slave({declared}); {outer} endmodule"),
    )


# Block, case: {property: edits (right, wrong) of the block's file that break it}
PLANTED = {
    ("dds", "default"): {
        "resets": (("r_phase      <= {DDS_BITS{1'b0}}", "r_phase      <= 48'd1"),),
        "advances_by_word": (("r_phase + word", "r_phase - word"),),
        "skips_no_quarter": (("r_phase + word", "r_phase + {word[46:0], 1'b0}"),),
        "sines_apart": (("r_phase + off_sense_sine", "r_phase + off_drive_sine"),),
        "references_apart": (("r_phase + off_sense_ref", "r_phase - off_sense_ref"),),
        "sine_and_reference_apart": (("r_phase + off_drive_ref", "r_phase + word + off_drive_ref"),),
    },
    ("pi", "rate"): {
        "y_within": (("(rounded > Y_HI) ? hi : rounded[35:0]", "rounded[35:0]"),),
        "acc_within": (("(next_acc > SUM_HI) ? ACC_HI : next_acc[59:0]", "next_acc[59:0]"),),
        "resets": (("r_y    <= 36'sd0", "r_y    <= 36'sd1"),),
        "no_negative_from_positive": (("(rounded > Y_HI) ? hi", "(rounded > Y_HI) ? lo"),),
        "no_positive_from_negative": (("(rounded < Y_LO) ? lo", "(rounded < Y_LO) ? hi"),),
        "y_at_its_limit": (("(rounded > Y_HI) ? hi", "(rounded > Y_HI) ? hi - 36'sd1"),),
        "preset_taken": (("(preset > hi) ? ACC_HI", "(preset > hi) ? ACC_LO"),),
        "with_the_error": (("{r_acc[59], r_acc} + {ki_e", "{r_acc[59], r_acc} - {ki_e"),),
        "holds": (("else if (mode == RUN)", "else if (mode == P_ONLY)"),),
    },
    ("modulator", "narrow"): {
        "code_within": (("(rounded > HI) ? hi : rounded[19:0]", "rounded[19:0]"),),
        "out_within": (("r_held2 : r_code;", "r_held2 : r_code + 20'sd1;"),),
        "held_within": (("r_held1 <= r_code", "r_held1 <= r_code + 20'sd1"),),
        "resets": (("r_code    <= 20'sd0", "r_code    <= 20'sd1"),),
        "no_negative_from_positive": (("(rounded > HI) ? hi", "(rounded > HI) ? lo"),),
        "no_positive_from_negative": (("(rounded < LO) ? lo", "(rounded < LO) ? hi"),),
        "at_the_top": (("(rounded > HI) ? hi", "(rounded > HI) ? hi - 20'sd1"),),
        "at_the_bottom": (("(rounded < LO) ? lo", "(rounded < LO) ? lo + 20'sd1"),),
        "moves_on": (("r_held2 <= r_held1", "r_held2 <= r_code"),),
        "holds": (("if (en_code) begin", "if (en_code || en_product) begin"),),
    },
    ("spi_dac", "dac8811"): {
        "leads_then_clocks": (("r_sclk_en   <= (lead == 2'd0)", "r_sclk_en   <= 1'b1"),),
        "no_bit_in_the_lead": (("r_lead  <= gap;", "r_lead  <= gap + 2'd1;"),),
    },
    ("spi_dac", "ad5791"): {
        "clock_only_in_frame": (("r_sclk_en   <= 1'b0;\n                r_ldac", "r_sclk_en   <= 1'b1;\nr_ldac"),),
        "loads_in_frame": (("r_sync_n    <= 1'b0", "r_sync_n    <= 1'b1"),),
        "bits_add_up": (("r_left - 5'd1", "r_left - 5'd2"),),
        "never_too_many": (("(r_left == 5'd1)", "(r_left == 5'd0)"),),
        "rest_to_come": (("{r_shift[22:0], 1'b0}", "{r_shift[22:0], 1'b1}"),),
        "gone_is_the_head": (("|(r_shift & MSB)", "|(r_shift & (MSB >> 1))"),),
        "frame_is_the_word": (("(r_left == 5'd1)", "(r_left == 5'd2)"),),
        "ldac_outside_frames": (
            ("~strobe;\n            r_ldac_wait <= 1'b0;\n        end else begin",
             "1'b0;\n            r_ldac_wait <= 1'b0;\n        end else begin"),
        ),
        "ldac_one_clock": (("~r_ldac_wait", "~r_ldac_wait & r_ldac_n"),),
        "ldac_after_frame": (("r_ldac_wait <= ldac", "r_ldac_wait <= 1'b0"),),
        "waits_one_clock": (("wait <= 1'b0;\n            if (", "wait <= r_ldac_wait;\n            if ("),),
        "ldac_follows": (("~r_ldac_wait", "1'b1"),),
    },
    ("spi_adc", "default"): {
        "busy_is_selected": (("r_cs_n <= 1'b0", "r_cs_n <= 1'b1"),),
        "clock_only_selected": ((IDLE, IDLE.replace("if", "r_sclk <= dout; if")),),
        "idle_is_clear": (("r_word       <= 4'd0", "r_word       <= 4'd1"),),
        "words_are_nine": (("r_word + 4'd1", "r_word + 4'd11"),),
        "word_of_24": ((" CLOCKS[COUNT-1:0] - ONE", " CLOCKS[COUNT-1:0]"),),
        "falls_add_up": (("next;\n                    if (half_ends)",
                          "next + ONE;\n                    if (half_ends)"),),
        "rises_add_up": (("r_sclk  <= half_ends", "r_sclk  <= dout"),),
        "begins_with_ready": (("r_seen && !r_sync", "r_seen || !r_sync"),),
        "ends_complete": (("r_sclk  <= half_ends;", "r_sclk  <= half_ends; r_cs_n <= dout;"),),
        "valid_is_complete": (SOON,),
        "valid_one_clock": (SOON, (IDLE, IDLE.replace("1'b0", "r_valid"))),
        "valid_comes": (("r_word + 4'd1", "TAIL"),),
        "bits_of_the_falls": (("{23'd0, dout}", "{23'd0, drdy_n}"),),
        "last_channel": (SOON,),
        "judged_by_head": (SOON,),
    },
    ("spi_slave", "default"): {
        "phases_exist": (begins("3'd6"),),
        "idle_is_clear": (("r_bit      <= 5'd0", "r_bit      <= 5'd1"),),
        "command_is_short": (("r_bit      <= 5'd0", "r_bit      <= 5'd16"),),
        "checks_are_bytes": (begins("CHECK"), ("r_bit      <= 5'd0", "r_bit      <= 5'd8")),
        "only_reads_check_the_command": (begins("CHECK"),),
        "complete_waits": (begins("COMPLETE"), ("r_bit      <= 5'd0", "r_bit      <= 5'd1")),
        "bits_add_up": (("r_bit   <= r_bit + 5'd1", "r_bit   <= r_bit + 5'd2"),),
        "too_long_is_longer": (begins("TOO_LONG"),),
        "words_remain": (begins("DATA"),),
        "words_as_asked": (begins("CHECK"),),
        "last_word_is_one": (begins("TAIL"), ("r_words    <= 3'd0", "r_words    <= 3'd2")),
        "reads_as_asked": (begins("DATA"),),
        "refused_as_asked": (begins("DATA"),),
        "crc_of_command_and_words": (("8'h1D", "8'h1F"),),
        "bits_are_kept": (("{r_shift[38:0], r_sdi}", "{r_shift[38:0], r_sck_seen}"),),
        "spoiled_by_the_crc": (begins("COMPLETE"),),
        "second_follows": (begins("DATA"), ("r_second   <= 1'b0", "r_second   <= 1'b1")),
        "second_is_written": (("r_second   <= 1'b0", "r_second   <= 1'b1"),),
        "first_is_kept": (begins("DATA"), ("r_second   <= 1'b0", "r_second   <= 1'b1")),
        "address_is_kept": (begins("DATA"),),
        "writes_between_frames": (("follows || (good && !r_read)", "follows || rises"),),
        "data_is_the_word": (("r_write    <= 1'b0", "r_write    <= 1'b1"),),
        "data_has_its_address": (("r_write    <= 1'b0", "r_write    <= 1'b1"),),
        "ends_once": (("r_active   <= !r_cs_n", "r_active   <= 1'b1"),),
        "right_is_written": (("(good && !r_read)", "(ends && !r_read)"),),
        "right_is_done": (("good && r_read", "ends"),),
        "never_both": (("(good && !r_read)", "ends"), ("good && r_read", "ends")),
        "wrong_is_flagged": (("3'd0 : WRONG_LENGTH", "3'd0 : WRONG_CRC"),),
        "empty_is_nothing": (("empty ? 3'd0", "empty ? WRONG_LENGTH"),),
        "flags_stay": (("(r_errors & ~clear) | wrong", "wrong"),),
        "fetched": (("rises && r_read && (", "rises && (!r_read || "), ("{rdata, 8'd0}", "{rdata, 8'd1}")),
        "out_moves_with_sck": (("if (!r_active)\n", "if (!r_second)\n"),),
        "out_is_the_top": (("o_sdo = r_shift[39]", "o_sdo = r_shift[38]"),),
        "start_once": (("!r_cs_n && !r_active", "!r_active"),),
    },
    ("axi_slave", "default"): {
        "resets": (("r_bvalid  <= 1'b0;\n            r_bresp", "r_bvalid  <= 1'b1;\n            r_bresp"),),
        "bvalid_stays": (("if (bready)", "if (rready)"),),
        "bresp_stays": (("if (bready)", "if (wvalid) r_bresp <= OKAY; if (bready)"),),
        "rvalid_stays": (("if (rready)", "if (bready)"),),
        "word_stays": (("if (rready)", "if (arvalid) r_rdata <= word; if (rready)"),),
        "response_after_both": (("!r_awready && !r_wready && !r_bvalid", "!r_awready && !r_bvalid"),),
        "word_after_request": (("!r_arready && !r_rvalid", "!r_rvalid"),),
        "one_response_per_address": (("!r_wready && !r_bvalid", "!r_wready"),),
        "one_response_per_data": ((FREE, FREE.replace("r_wready  <= 1'b1", "r_wready  <= wvalid")),),
        "one_word_per_request": (("!r_arready && !r_rvalid", "!r_arready"),),
        "awready_of_the_past": combinational("awready", "wvalid"),
        "wready_of_the_past": combinational("wready", "awvalid"),
        "arready_of_the_past": combinational("arready", "arvalid"),
        "bvalid_of_the_past": combinational("bvalid", "bready"),
        "rvalid_of_the_past": combinational("rvalid", "rready"),
        "responses_known": (("SLVERR = 2'b10", "SLVERR = 2'b11"),),
        "address_is_kept": (("r_awaddr  <= awaddr", "r_awaddr  <= araddr"),),
        "data_is_kept": (("r_wdata  <= wdata", "r_wdata  <= word"),),
        "read_address_is_kept": (("r_araddr  <= araddr", "r_araddr  <= awaddr"),),
        "write_as_asked": (("writes ? r_awaddr : r_araddr", "every ? r_araddr : r_awaddr"),),
        "write_once": ((FREE, FREE.replace("1'b1;", "awvalid;", 1)),),
        "refused_changes_nothing": (("writes && aligned && every", "writes && aligned"),),
        "response_is_right": (("r_wstrb == 4'h0", "r_wstrb == 4'h3"),),
        "okay_is_written": (("writes && aligned && every", "writes && aligned && every && !arvalid"),),
        "fetch_as_asked": (("writes ? r_awaddr : r_araddr", "r_wready ? r_awaddr : r_araddr"),),
        "word_of_the_access": (("aligned ? word : 32'd0", "aligned ? wdata : 32'd0"),),
        "unaligned_is_refused": (("r_rresp   <= aligned ? OKAY", "r_rresp   <= reads ? OKAY"),),
        "one_access": (("!r_rvalid && !writes", "!r_rvalid"),),
        "read_waits_one_clock": (("if (reads) begin", "if (reads && rready) begin"),),
        "done_is_taken": (("r_rvalid && rready", "r_rvalid"),),
    },
    ("registers", "default"): {
        "resets": (("r_rate_scale         <= 30'sh793569E", "r_rate_scale         <= 30'sh793569D"),),
        "word_arrives": (("r_decimation         <= data[2:0]", "r_decimation         <= data[3:1]"),),
        "others_rest": (("if (write)", "if (write || taken)"),),
        "ones_are_held": ((ADDED, "data[7:0]"),),
        "ones_arrive": ((ADDED, "taken ? 8'h0 : r_fault_clear | data[7:0]"),),
        "taken_empties": (("if (taken)", "if (taken && !write)"),),
        "no_one_by_itself": ((ADDED, "r_fault_clear | data[7:0]"),),
    },
    ("host_bus", "default"): {
        "counts_to_two": (("r_unread           <= 2'd0", "r_unread           <= 2'd3"),),
        "unread_at_least_after": (("r_unread_after     <= 2'd0", "r_unread_after     <= 2'd1"),),
        "pending_is_open": (("r_pending <= low_written", "r_pending <= write"),),
        "low_is_kept": (("if (low_written) begin", "if (word_written) begin"),),
        "low_alone_changes_nothing": (("word_written = write && !second && !pair", "word_written = write && !second"),),
        "pair_in_one_clock": (("{data[15:0], r_low}", "{data[15:0], data}"),),
        "high_alone_changes_nothing": (("r_pending && {5'd0", "{5'd0"),),
        "word_at_once": (("{16'd0, data};", "{r_high, data};"),),
        "no_write_by_itself": (("r_bank_write <= word_written", "r_bank_write <= !pair"),),
        "errors_cleared_by_their_register": (("SPI_ERRORS = 8'h54", "SPI_ERRORS = 8'h55"),),
        "high_latched_with_low": (("if (fetch && !second) begin", "if (fetch && second) begin"),),
        "low_is_read": (("!second ? value[31:0]", "!second ? value[47:16]"),),
        "high_is_latched": (("r_high_of == register ?", "r_bank_address == register ?"),),
        "frames_count": (("if (frame)", "if (frame && !take)"),),
        "sample_of_one_frame": (("if (sample) begin", "if (frame) begin"),),
        "taken_as_it_was": (("{overrun, ready, r_status}", "{ready, overrun, r_status}"),),
        "held_is_held": (("if (take) begin", "if (take || sample) begin"),),
        "none_lost_unseen": (("done && r_reading ?", "done ?"),),
        "counted_from_the_take": (("after = take ? 2'd0", "after = start ? 2'd0"),),
        "read_while_taken": (("r_reading && !start && !done", "r_reading && !done"),),
        "new_until_the_frame": (("!frame && (r_fresh || valid)", "!frame && valid"),),
        "ready_is_unread": (("ready = r_unread != 2'd0", "ready = r_unread == 2'd1"),),
        "status_is_told": (("LOCKED = 4'd12", "LOCKED = 4'd11"),),
        "resets": (("r_reading          <= 1'b0", "r_reading          <= 1'b1"),),
    },
    ("sequencer", "quick"): {
        "states_exist": (("POWER_UP = 4'd0", "POWER_UP = 4'd13"),),
        "resets": (("r_timer      <= 16'd0", "r_timer      <= 16'd1"),),
        "waits_for_enable": (("end else if (en) begin\n            r_state", "end else begin\n            r_state"),),
        "init_after_power_up": no_run("INIT"),
        "never_back_to_power_up": no_run("POWER_UP"),
        "idle_before_drive": (("{1'b0, init}) following = IDLE", "{1'b0, init}) following = KICK"),),
        "stop_is_obeyed": no_run("STANDBY"),
        "open_on_request_only": (("(i_control[OPEN_DRIVE])", "(!i_control[OPEN_DRIVE])"),),
        "bad_frames_switch_off": (("r_faults_bad_frames >= offline", "r_faults_bad_frames > offline"),),
        "first_kick_after_good_frames": (("r_faults_good_frames >= recover", "r_faults_good_frames + 1 >= recover"),),
        "acquire_after_retune": kick_to("ACQUIRE"),
        "retune_after_search": kick_to("RETUNE"),
        "settle_after_acquire": kick_to("SETTLE"),
        "balance_needs_drive": kick_to("BALANCE"),
        "locked_after_balance": kick_to("LOCKED"),
        "locked_needs_sense": kick_to("LOCKED"),
        "no_drive_before_kick": (("o_agc_mode = {1'b0, LOOP_OFF}", "o_agc_mode = {1'b0, LOOP_RUN}"),),
        "no_tracking_before_acquire": (("(r_state >= ACQUIRE)", "(r_state >= KICK)"),),
        "no_force_before_balance": (("balancing = (r_state >= BALANCE)", "balancing = (r_state >= KICK)"),),
        "no_quadrature_before_balance": (("balancing = (r_state >= BALANCE)", "balancing = (r_state >= KICK)"),),
        "stale_loops_hold": (*kick_to("ACQUIRE"), (STALE, "wire bad = r_faults_flags[STUCK]")),
        "init_words_in_init": (("o_dac_init = (r_state == INIT)", "o_dac_init = (r_state <= INIT)"),),
        "good_only_locked": (("o_rate_good = o_locked && !(bad", "o_rate_good = !(bad"),),
    },
}  # fmt: skip
STEPS = {"spi_adc": 60, "spi_dac": 40, "sequencer": 24, "spi_slave": 20}  # clocks from reset; 8 for the others
ALL = [(*where, name) for where, edits in PLANTED.items() for name in edits]
QUICK = ("advances_by_word", "falls_add_up")


def planted(where, name, folder):
    """Folder of a design with the edits of a property."""
    stem, _ = where
    rtl = folder / "rtl"
    shutil.copytree(RTL, rtl, ignore=shutil.ignore_patterns("formal"))
    path = rtl / f"{stem}.v"
    text = path.read_text()
    for right, wrong in PLANTED[where][name]:
        assert text.count(right) == 1, right
        text = text.replace(right, wrong)
    path.write_text(text)
    return rtl


QUICK_PROOFS = [
    (stem, formal.CASES[stem][0]) for stem in ("modulator", "spi_dac", "spi_adc", "spi_slave")
]  # the command proves dds


@pytest.mark.parametrize(
    ("stem", "case"),
    [
        pytest.param(stem, case, marks=() if (stem, case) in QUICK_PROOFS else pytest.mark.slow)
        for stem, cases in formal.CASES.items()
        for case in cases
    ],
)
def test_the_reference_design_has_the_properties(stem, case):
    proof = formal.prove(stem, case, RTL)
    assert proof.proven, proof.text()
    assert proof.properties == formal.labels((CHECKERS / f"{stem}.v").read_text())
    assert 1 <= proof.steps <= formal.MAX_STEPS
    assert proof.text().startswith(f"PROVEN {stem}/{case}: {len(proof.properties)} properties, any number of clocks")


@pytest.mark.parametrize(
    ("stem", "case", "name"),
    [pytest.param(*entry, marks=() if entry[2] in QUICK else pytest.mark.slow) for entry in ALL],
)
def test_each_property_fails_where_it_is_broken(stem, case, name, tmp_path):
    """That property alone, in a run from reset: a counterexample, not a proof that did not come off."""
    proof = formal.prove(stem, case, planted((stem, case), name, tmp_path), [name], STEPS.get(stem, 8), base_only=True)
    assert not proof.proven
    assert re.fullmatch(r"a property fails \d+ clocks after power-on", proof.why), proof.text()


def test_every_property_is_broken_once():
    for stem in formal.CASES:
        names = formal.labels((CHECKERS / f"{stem}.v").read_text())
        assert len(set(names)) == len(names) > 5
        broken = [name for (block, _), edits in PLANTED.items() if block == stem for name in edits]
        assert sorted(broken) == sorted(names), stem
    assert {path.stem for path in CHECKERS.glob("*.v")} == set(formal.CASES)


@pytest.mark.slow
def test_without_a_fault_the_search_from_reset_finds_nothing():
    """What the planted designs are searched with does not call a sound one broken."""
    for stem, case in (("spi_adc", "default"), ("spi_dac", "ad5791")):
        proof = formal.prove(stem, case, RTL, steps=STEPS[stem], base_only=True)
        assert "no failure" in proof.why, proof.text()


@pytest.mark.parametrize("stem", formal.CASES)
def test_limits_are_those_of_the_proof(stem):
    """What the properties take for granted of the parameters: lo <= 0 <= hi."""
    for case in formal.CASES[stem]:
        raw = {name: value for name, value, _ in blocks.case_parameters(blocks.BLOCKS[stem], case)}
        assert raw.get("lo", 0) <= 0 <= raw.get("hi", 0)


def test_bad_input_is_one_clear_error(tmp_path, monkeypatch):
    with pytest.raises(ConfigError, match="sine/default: has no proof; known: dds, modulator"):
        formal.prove("sine", "default", RTL)
    with pytest.raises(ConfigError, match="dds: has no property flies; known: resets"):
        formal.prove("dds", "default", RTL, ["flies"])
    with pytest.raises(FileError, match=r"no dds\.v or \.sv; a proof reads Verilog"):
        formal.prove("dds", "default", tmp_path)
    with pytest.raises(FileError, match="not a folder"):
        formal.prove("dds", "default", tmp_path / "no")
    text = (RTL / "dds.v").read_text()
    for edited, said in (
        (
            text.replace("[DDS_BITS-1:0] r_phase", "[DDS_BITS-2:0] r_phase"),
            "port r_phase of the design has 47 bits, not 48",
        ),
        (text.replace("output reg  [DDS_BITS-1:0] r_phase,", ""), "r_phase"),
        (text.replace("always", "always_if", 1), r"dds\.v:\d+: ERROR: syntax error"),
    ):
        assert edited != text
        (tmp_path / "dds.v").write_text(edited)
        with pytest.raises(FileError, match=said) as problem:
            formal.prove("dds", "default", tmp_path)
        assert len(str(problem.value).splitlines()) == 1
    with pytest.raises(ConfigError, match="no property of sequencer uses only ports of level outputs"):
        formal.prove("sequencer", "quick", RTL, choice=Choice(level="outputs"))
    own = (DAC / "map.toml").read_text()
    (tmp_path / "map.toml").write_text(own.replace('"async"', '"none"'))
    with pytest.raises(ConfigError, match="the induction begins with a reset"):
        formal.prove("spi_dac", "ad5791", DAC, choice=Choice(level="pins", map=tmp_path / "map.toml"))
    monkeypatch.setattr(formal.shutil, "which", lambda name: None)
    with pytest.raises(ConfigError, match="yosys: not installed"):
        formal.prove("dds", "default", RTL)


IN_FRAMES = ("clock_only_in_frame", "loads_in_frame", "ldac_outside_frames", "ldac_one_clock")


@pytest.mark.parametrize(
    ("right", "wrong", "name"),
    [
        ("<= GATES[ahead]", "<= !GATES[ahead]", "clock_only_in_frame"),
        ("ahead == LAST + 1)", "ahead == T_LEAD + 3)", "ldac_outside_frames"),
        ("ahead == LAST + 1)", "ahead >= LAST + 1)", "ldac_one_clock"),
        ("ahead = go ? 8'd0 :", "ahead =", "loads_in_frame"),
    ],
)
def test_a_design_of_other_architecture_is_proven_at_its_level(tmp_path, right, wrong, name):
    """What speaks of pins alone, with an asynchronous reset and names of its own."""
    text = (DAC / "dac_link.v").read_text()
    assert text.count(right) == 1
    choice = Choice(level="pins", map=DAC / "map.toml")
    proof = formal.prove("spi_dac", "ad5791", DAC, IN_FRAMES, choice=choice)
    assert (proof.proven, proof.properties, proof.unseen) == (True, IN_FRAMES, ()), proof.text()
    (tmp_path / "dac_link.v").write_text(text.replace(right, wrong))
    alone = formal.prove("spi_dac", "ad5791", tmp_path, [name], 12, True, choice=choice)
    assert re.fullmatch(r"a property fails \d+ clocks after power-on", alone.why), alone.text()


WORD = "frame_is_the_word"


def test_what_no_induction_reaches_is_proven_by_an_invariant_or_fails_later(tmp_path):
    """The word of a frame without its shift register: the last bit of a wrong one comes 25 clocks after the load."""
    choice = Choice(level="pins", map=DAC / "map.toml")
    proof = formal.prove("spi_dac", "ad5791", DAC, [WORD], choice=choice)
    assert (proof.proven, proof.invariant) == (True, (WORD,)), proof.text()
    assert "any number of clocks (induction over 12; PDR: frame_is_the_word)" in proof.text()
    text, right = (DAC / "dac_link.v").read_text(), "NBITS - 5'd1 : index - sck"
    assert text.count(right) == 1
    (tmp_path / "dac_link.v").write_text(text.replace(right, "5'd0 : index + sck"))
    proof = formal.prove("spi_dac", "ad5791", tmp_path, [WORD], choice=choice)
    assert (proof.proven, proof.why) == (False, "a property fails 26 clocks after power-on")


@pytest.mark.slow
def test_each_property_is_proven_by_what_reaches_it(tmp_path, monkeypatch):
    choice = Choice(level="pins", map=DAC / "map.toml")
    proof = formal.prove("spi_dac", "ad5791", DAC, choice=choice)
    assert set(proof.properties) == {*IN_FRAMES, WORD}
    assert len(proof.unseen) == len(formal.labels((CHECKERS / "spi_dac.v").read_text())) - 5
    assert (proof.proven, proof.invariant) == (True, (WORD,)), proof.text()
    monkeypatch.setattr(formal, "INVARIANT", "read_aiger proof.aig")
    proof = formal.prove("spi_dac", "ad5791", DAC, choice=choice)
    assert proof.why == "no failure within 12 clocks, and no proof of frame_is_the_word; all others are proven"


def test_the_command_says_what_is_proven(tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    shutil.copy(RTL / "dds.v", own)  # a user's folder: the design, and nothing of ours beside it
    done = CliRunner().invoke(app, ["golden", "prove", "dds", "--rtl", str(own), "--json"])
    assert done.exit_code == 0, done.output
    (found,) = json.loads(done.output)["proofs"]
    assert (found["block"], found["proven"]) == ("dds", True)
    rtl = planted(("dds", "default"), "advances_by_word", tmp_path)
    done = CliRunner().invoke(app, ["golden", "prove", "dds", "--rtl", str(rtl)])
    assert done.exit_code == 1
    assert re.match(r"FAIL dds/default: 6 properties: a property fails \d+ clocks after power-on", done.output)
