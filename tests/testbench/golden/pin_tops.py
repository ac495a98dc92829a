"""Whole designs with the pins of the board alone, made of the reference RTL by edits of its text, for the loop.

board(folder, firmware)                  gyro_board around the design as it stands
two_clocks_more(folder, firmware, ...)   two registers more behind the sense sine
late_sense_frame(...)                    code and load of the sense path two clocks later
counting_masters(...)                    masters of the three DACs written anew: a counter each, SDIN high at rest
"""

import re
import shutil

from testbench.golden.recording import board_recording as wrapper
from tests.testbench.rtl.test_rtl import RTL

TOP = wrapper.MODULE

# A bit counter and a word that does not shift; idle SDIN is high, and registers have other names and other numbers
COUNTING = """
module gyro_spi_dac #(
    parameter [4:0] bits = 5'd24, parameter [1:0] lead = 2'd0, parameter [0:0] ldac = 1'b0,
    parameter [19:0] flip = 0, parameter [23:0] header = 0, parameter [23:0] control = 0,
    parameter [19:0] data_mask = 0, parameter [3:0] tail = 0, parameter [1:0] gap = 0, parameter [0:0] strobe = 0
) (
    input wire clk, input wire rst, input wire load, input wire [23:0] word,
    output wire r_sync_n, output wire r_sclk_en, output wire r_ldac_n, output wire o_sdin
);
    reg [5:0] count;  // clocks since the load
    reg [23:0] held;
    wire [5:0] first = lead, last = lead + bits;  // of the bits, and behind them
    wire sending = count >= first && count < last;
    wire [4:0] place = last - 6'd1 - count;
    assign r_sync_n = count >= last;
    assign r_sclk_en = sending;
    assign o_sdin = r_sync_n ? 1'b1 : held[count < first ? bits - 5'd1 : place];
    assign r_ldac_n = !(ldac && count == last + 6'd1);
    always @(posedge clk)
        if (rst) count <= 6'd63;
        else if (load) begin count <= 6'd0; held <= word; end
        else if (count != 6'd63) count <= count + 6'd1;
endmodule
"""


def edited(text, *edits):
    """A text with each (old, new) put in, which must fit exactly once."""
    for old, new in edits:
        assert text.count(old) == 1, (old, text.count(old))
        text = text.replace(old, new)
    return text


def board(folder, firmware, edits=None):
    """Write a design with the pins of the board alone; `edits` are {file: function of its text}. Returns the folder."""
    shutil.copytree(RTL, folder, ignore=shutil.ignore_patterns("formal", "example", "quartus", "*.vhd"))
    for name, edit in (edits or {}).items():
        path = folder / name
        path.write_text(edit(path.read_text()))
    wrapper.write(folder, firmware)
    return folder


def two_clocks_more(folder, firmware):
    """Two registers more between sine and modulator of the sense path."""
    late = (
        "    reg signed [SINE_BITS-1:0] more_0, more_1;\n"
        "    always @(posedge clk) begin more_0 <= rst ? 0 : r_sense_sine_y; more_1 <= rst ? 0 : more_0; end\n"
    )

    def edit(text):
        place = text.index("    gyro_delay #(")
        return edited(text[:place] + late + text[place:], (".x       (r_sense_sine_y)", ".x(more_1)"))

    return board(folder, firmware, {"top.v": edit})


def late_sense_frame(folder, firmware):
    """Code and load of the sense path two clocks later than those of the drive."""
    late = (
        "    reg [1:0] code_late, load_late;\n"
        "    always @(posedge clk) begin\n"
        "        code_late <= rst ? 0 : {code_late[0], at_code}; load_late <= rst ? 0 : {load_late[0], at_load};\n"
        "    end\n"
    )

    def edit(text):
        place = text.index("    gyro_delay #(")
        text = text[:place] + late + text[place:]
        before, after = text.split(") sense_modulator (")
        after = after.replace("(at_code)", "(code_late[1])", 1)
        before, after = f"{before}) sense_modulator ({after}".split(") sense_dac (")
        return f"{before}) sense_dac ({after.replace('(at_load)', '(load_late[1])', 1)}"

    return board(folder, firmware, {"top.v": edit})


def counting_masters(folder, firmware):
    """Masters of the DACs as counters."""

    def edit(text):
        return re.sub(r"\n *\.r_(?:shift|left|lead|ldac_wait) *\(r_\w+_dac_\w+\),", "", text)

    return board(folder, firmware, {"top.v": edit, "spi_dac.v": lambda _: COUNTING})
