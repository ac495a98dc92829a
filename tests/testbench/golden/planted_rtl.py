"""Faults planted in the reference RTL by editing its text: a table of file, case, true cause, what, and the edits.

An edit is (old text, new text); the old text must stand in the file exactly once. `what` is a part of what the
diagnosis must say of a named fault where that is fixed: a number of clocks, a rounding rule. `FAULTS` have a cause;
`EQUIVALENT` change no register whatever the inputs.
"""

import re
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

RTL = Path(__file__).resolve().parents[3] / "testbench" / "rtl"


class Fault(NamedTuple):
    file: str
    case: str
    cause: str
    what: str
    edits: tuple
    inside: str = ""

    @property
    def block(self):
        """The block whose bundle tells; the file may be a part of it."""
        return self.inside or self.file.split(".")[0]

    def text(self):
        """The file with the fault; raises AssertionError if an edit does not fit exactly once."""
        text = plain((RTL / self.file).read_text())
        for old, new in self.edits:
            assert text.count(plain(old)) == 1, (self.file, old, text.count(plain(old)))
            text = text.replace(plain(old), new)
        return text


def plain(text):
    """Text with single spaces: alignment is no part of an edit."""
    return re.sub(r"[ \t]+", " ", text)


FAULTS, EQUIVALENT = [], []
ALWAYS = "    always @(posedge clk) begin\n"
PROCESS = "        if rising_edge(clk) then\n"


def fault(file, case, cause, *edits, what="", inside=""):
    FAULTS.append(Fault(file, case, cause, what, edits, inside))


def late(file, case, reset, assign, k, kind, what="clock"):
    """k registers more, under the same enable, before the one that `assign` loads; `kind` is their Verilog type."""
    name, value = (part.strip() for part in reset.rstrip("; \n").split("<="))
    target, expression = (part.strip() for part in assign.rstrip("; \n").split("<=", 1))
    assert name == target
    queue = [f"late{n}" for n in range(k)]
    chain = "".join(f" {b} <= {a};" for a, b in pairwise(queue))
    fault(
        file,
        case,
        "late",
        (ALWAYS, f"    reg {kind} {', '.join(queue)};\n{ALWAYS}"),
        (reset, reset + "".join(f" {q} <= {value};" for q in queue)),
        (assign, f"begin {queue[0]} <= {expression};{chain} {name} <= {queue[-1]}; end"),
        what=f"{k} {what}",
    )


def early(file, case, port, reset, assign, more=()):
    """A register less: the port becomes the wire in front of it."""
    name, expression = (part.strip() for part in assign.rstrip("; \n").split("<=", 1))
    fault(
        file,
        case,
        "early",
        (port, re.sub(r"output reg *", "output wire ", port)),
        (reset, ""),
        (assign, ""),
        (ALWAYS, f"    assign {name} = {expression};\n{ALWAYS}"),
        *more,
        what="1 clock",
    )


# dds.v ---------------------------------------------------------------------------------------------------------------

ZERO = "{DDS_BITS{1'b0}}"
OFFSETS = ("drive_sine", "sense_sine", "drive_ref", "sense_ref")
for n in OFFSETS:
    assign = f"r_{n} <= r_phase + off_{n};"
    fault("dds.v", "default", "sign", (f"r_phase + off_{n}", f"r_phase - off_{n}"))
    fault("dds.v", "default", "sign", (f"r_phase + off_{n}", f"off_{n} - r_phase"))
    fault("dds.v", "default", "gain", (f"+ off_{n}", f"+ {{off_{n}[46:0], 1'b0}}"))
    fault("dds.v", "default", "gain", (f"+ off_{n}", f"+ {{1'b0, off_{n}[47:1]}}"))
    fault(
        "dds.v",
        "default",
        "saturate",
        (f"r_phase + off_{n}", f"(off_{n} > ~r_phase) ? {{48{{1'b1}}}} : r_phase + off_{n}"),
    )
    fault("dds.v", "default", "reset", (f"r_{n} <= {ZERO};", f"r_{n} <= 48'h{len(n):x}00000000000;"))
    for k in (1, 2, 3):
        late("dds.v", "default", f"r_{n} <= {ZERO};", assign, k, "[47:0]")
    early("dds.v", "default", f"output reg [DDS_BITS-1:0] r_{n}", f"r_{n} <= {ZERO};", assign)
fault("dds.v", "default", "sign", ("r_phase + word", "r_phase - word"))
fault("dds.v", "default", "gain", ("r_phase + word", "r_phase + {word[46:0], 1'b0}"))
fault("dds.v", "default", "gain", ("r_phase + word", "r_phase + {1'b0, word[47:1]}"))
fault("dds.v", "default", "saturate", ("r_phase + word", "(word > ~r_phase) ? {48{1'b1}} : r_phase + word"))
fault("dds.v", "default", "reset", (f"r_phase <= {ZERO}", "r_phase <= 48'd1"))

# sine.v --------------------------------------------------------------------------------------------------------------

HALF = "+ HALF;"
Y = "r_sign2 ? -magnitude : magnitude"
fault("sine.v", "default", "rounding", (HALF, "+ 34'd0;"), what="floor")
fault("sine.v", "default", "rounding", (HALF, "+ 34'd65535;"), what="ceil")
fault("sine.v", "default", "rounding", (HALF, "+ 34'd32767;"), what="half_down")
SUM = "scaled + {{SINE_ADDRESS_BITS{1'b0}}, r_product}"
EVEN = (f"{SUM} + HALF;", f"even + 34'd32767 + {{33'd0, even[16]}};\n    wire [33:0] even = {SUM};")
fault("sine.v", "default", "rounding", EVEN, what="half_even")
SIGNED = "    wire signed [34:0] exact = {1'b0, " + SUM + "};\n    wire signed [34:0] minus = -exact;\n"
for rule, text in (
    ("floor", "minus >>> 16"),
    ("ceil", "(minus + 35'sd65535) >>> 16"),
    ("half_up", "(minus + 35'sd32768) >>> 16"),
):
    # the whole value is rounded after its sign is set: the positive half is rounded by the same rule
    positive = text.replace("minus", "exact")
    fault(
        "sine.v",
        "default",
        "rounding",
        (ALWAYS, f"{SIGNED}    wire signed [34:0] whole = r_sign2 ? {text} : {positive};\n{ALWAYS}"),
        (Y, "whole[17:0]"),
        what=f"{rule} of the signed value",
    )
fault("sine.v", "default", "sign", (Y, "r_sign2 ? magnitude : -magnitude"))
fault("sine.v", "default", "sign", (Y, "magnitude"))
fault("sine.v", "default", "sign", (Y, "-magnitude"))
fault("sine.v", "default", "sign", ("r_sign <= phase[DDS_BITS-1]", "r_sign <= ~phase[DDS_BITS-1]"))
fault("sine.v", "default", "sign", ("r_sign2    <= r_sign", "r_sign2    <= ~r_sign"))
fault("sine.v", "default", "sign", ("r_product  <= product", "r_product  <= -product"))
fault("sine.v", "default", "gain", ("r_product  <= product", "r_product  <= product << 1"))
fault("sine.v", "default", "gain", ("r_product  <= product", "r_product  <= product >> 1"))
fault("sine.v", "default", "gain", ("<= row[SLOPE-1:0]", "<= row[SLOPE-1:0] >> 1"))
fault("sine.v", "default", "gain", ("<= row[SINE_BITS+SLOPE+4:SLOPE]", "<= {row[34:13], 1'b0}"))
fault("sine.v", "default", "gain", ("= sum[SUM-1:DROPPED]", "= sum[33:17]"))
fault("sine.v", "default", "gain", ("+ {{SINE_ADDRESS_BITS{1'b0}}, r_product}", "+ {9'd0, r_product, 1'b0}"))
fault("sine.v", "default", "gain", ("{1'b0, r_base2, {SINE_FRACTION_BITS{1'b0}}}", "{2'b0, r_base2, 9'd0}"))
BASE, FRACTION = "SINE_BITS+5", "SINE_FRACTION_BITS"
for name, kind, value in (("sign", "", "1'b0"), ("base", "[22:0]", BASE), ("slope", "[12:0]", "SLOPE"),
                          ("fraction", "[9:0]", FRACTION), ("sign2", "", "1'b0"), ("base2", "[22:0]", BASE),
                          ("product", "[23:0]", "PRODUCT"), ("y", "signed [17:0]", "SINE_BITS")):  # fmt: skip
    reset = f"r_{name} <= {value if kind == '' else f'{{{value}{{1{chr(39)}b0}}}}'};"
    fault("sine.v", "default", "reset", (reset, f"r_{name} <= 1;"))
    source = {"sign": "phase[DDS_BITS-1]", "base": "row[SINE_BITS+SLOPE+4:SLOPE]", "slope": "row[SLOPE-1:0]",
              "fraction": "place[SINE_FRACTION_BITS-1:0]", "sign2": "r_sign", "base2": "r_base", "product": "product",
              "y": Y}[name]  # fmt: skip
    late("sine.v", "default", reset, f"r_{name} <= {source};", 1, kind)
late("sine.v", "default", "r_y <= {SINE_BITS{1'b0}};", f"r_y <= {Y};", 2, "signed [17:0]")
early("sine.v", "default", "output reg signed [SINE_BITS-1:0] r_y ", "r_y <= {SINE_BITS{1'b0}};", f"r_y <= {Y};")
early(
    "sine.v",
    "default",
    "output reg [SINE_BITS-SINE_ADDRESS_BITS+SINE_FRACTION_BITS+5:0] r_product",
    "r_product <= {PRODUCT{1'b0}};",
    "r_product <= product;",
)

# references.v --------------------------------------------------------------------------------------------------------

REF = "references.v"
for mask in (1, 2, 4, 8, 3, 15):
    fault(REF, "align2_retimed", "sign", ("r_signs     <= signs", f"r_signs     <= signs ^ 4'd{mask}"))
for mask in (1, 6, 15):
    fault(REF, "align2_retimed", "sign", ("r_aligned_0 <= r_signs", f"r_aligned_0 <= r_signs ^ 4'd{mask}"))
    fault(REF, "align2_retimed", "sign", ("r_retimed <= picked", f"r_retimed <= picked ^ 4'd{mask}"))
    fault(REF, "align0_direct", "sign", ("r_retimed : picked", f"r_retimed : picked ^ 4'd{mask}"))
for name in ("signs", "aligned_0", "aligned_1", "aligned_2", "retimed"):
    fault(REF, "align0_retimed", "reset", (f"r_{name} <= 4'd0;", f"r_{name} <= 4'd5;"))
for k in (1, 2):
    late(REF, "align0_retimed", "r_signs     <= 4'd0;", "r_signs     <= signs;", k, "[3:0]")
    late(REF, "align1_direct", "r_aligned_1 <= 4'd0;", "r_aligned_1 <= r_aligned_0;", k, "[3:0]")
early(REF, "align0_retimed", "output reg   [3:0] r_signs", "r_signs     <= 4'd0;", "r_signs     <= signs;")
early(REF, "align3_direct", "output reg   [3:0] r_aligned_2", "r_aligned_2 <= 4'd0;", "r_aligned_2 <= r_aligned_1;")

# delay.v -------------------------------------------------------------------------------------------------------------

WORD = "{SINE_BITS{1'b0}}"
for n in (0, 3, 7):
    source = "x" if n == 0 else f"r_taps_{n - 1}"
    assign = f"r_taps_{n} <= {source};"
    fault("delay.v", "depth8", "sign", (assign, f"r_taps_{n} <= -{source};"))
    fault("delay.v", "depth8", "gain", (assign, f"r_taps_{n} <= {source} <<< 1;"))
    fault("delay.v", "depth8", "gain", (assign, f"r_taps_{n} <= {source} >>> 1;"))
    fault("delay.v", "depth8", "reset", (f"r_taps_{n} <= {WORD};", f"r_taps_{n} <= -18'sd{n + 1};"))
    late("delay.v", "depth8", f"r_taps_{n} <= {WORD};", assign, 1, "signed [17:0]")
    late("delay.v", "depth8", f"r_taps_{n} <= {WORD};", assign, 2, "signed [17:0]")
fault("delay.v", "depth0", "sign", ("? x :", "? -x :"))
fault("delay.v", "depth3", "late", ("? r_taps_2 :", "? r_taps_3 :"), what="1 clock")
fault("delay.v", "depth8", "early", ("r_taps_6 : r_taps_7", "r_taps_6 : r_taps_6"), what="1 clock")
fault("delay.v", "depth3", "early", ("? r_taps_2 :", "? r_taps_0 :"), what="2 clocks")
fault("delay.v", "depth8", "early", ("r_taps_7 <= r_taps_6", "r_taps_7 <= r_taps_5"), what="1 clock")

# modulator.v ---------------------------------------------------------------------------------------------------------

MOD = "modulator.v"
ROUND = "(wide_product + HALF) >>> shift;"
MINUS = "(wide_product[42] ? {one} : 43'sd0)"
ONE = "    localparam signed [42:0] LOW = (43'sd1 <<< shift) - 43'sd1, LESS = HALF - 43'sd1;\n"
MOD_RULES = {
    "floor": "wide_product >>> shift;",
    "ceil": "(wide_product + LOW) >>> shift;",
    "toward_zero": "(wide_product + (wide_product[42] ? LOW : 43'sd0)) >>> shift;",
    "half_down": "(wide_product + LESS) >>> shift;",
    "half_even": "(wide_product + LESS + (wide_product[shift] ? 43'sd1 : 43'sd0)) >>> shift;",
    "half_away": "(wide_product + (wide_product[42] ? LESS : HALF)) >>> shift;",
    "half_zero": "(wide_product + (wide_product[42] ? HALF : LESS)) >>> shift;",
}
WIDE = "    wire signed [PRODUCT:0] wide_product ="
for rule, text in MOD_RULES.items():
    for case in ("dac16", "dac20"):
        fault(MOD, case, "rounding", (ROUND, text), (WIDE, ONE + WIDE), what=rule)
CLIP = "(rounded < LO) ? lo : (rounded > HI) ? hi : rounded[19:0]"
fault(MOD, "dac16", "wrap", (CLIP, "{{4{rounded[15]}}, rounded[15:0]}"))
fault(MOD, "dac20", "wrap", (CLIP, "rounded[19:0]"))
fault(MOD, "narrow", "wrap", (CLIP, "{{4{rounded[15]}}, rounded[15:0]}"))
for case in ("dac16", "dac20", "narrow"):
    fault(MOD, case, "limit", ("(rounded > HI) ? hi", "(rounded > HI) ? hi - 20'sd1"))
    fault(MOD, case, "limit", ("(rounded > HI) ? hi", "(rounded >= HI) ? hi - 20'sd1"))
fault(MOD, "narrow", "limit", ("(rounded < LO) ? lo", "(rounded < LO) ? lo + 20'sd1"))
fault(MOD, "narrow", "limit", ("(rounded < LO) ? lo", "(rounded <= LO) ? lo + 20'sd1"))
fault(MOD, "narrow", "limit", ("(rounded < LO) ? lo", "(rounded < LO - 43'sd1) ? lo - 20'sd1"))
fault(MOD, "dac16", "sign", ("wide_amplitude * wide_sine", "-(wide_amplitude * wide_sine)"))
fault(MOD, "dac16", "sign", ("= {r_product[PRODUCT-1], r_product}", "= -{r_product[PRODUCT-1], r_product}"))
fault(MOD, "dac16", "sign", ("r_held1 <= r_code", "r_held1 <= -r_code"))
fault(MOD, "dac16", "gain", ("wide_amplitude * wide_sine", "(wide_amplitude * wide_sine) <<< 1"))
fault(MOD, "dac16", "gain", ("wide_amplitude * wide_sine", "(wide_amplitude * wide_sine) >>> 1"))
fault(MOD, "dac16", "gain", (ROUND, "(wide_product + (HALF <<< 1)) >>> (shift + 1);"))
fault(MOD, "dac16", "gain", (ROUND, "(wide_product + (HALF >>> 1)) >>> (shift - 1);"))
fault(MOD, "dac20", "gain", (ROUND, "(wide_product + (HALF <<< 1)) >>> (shift + 1);"))
for name, value in (("product", "{PRODUCT{1'b0}}"), ("code", "20'sd0"), ("held1", "20'sd0"), ("held2", "20'sd0")):
    fault(MOD, "dac16", "reset", (f"r_{name} <= {value};", f"r_{name} <= 3;"))
for k in (1, 2):
    late(MOD, "dac16", "r_held2 <= 20'sd0;", "r_held2 <= r_held1;", k, "signed [19:0]", what="enable")
late(REF, "align0_retimed", "r_retimed <= 4'd0;", "r_retimed <= picked;", 1, "[3:0]", what="enable")

# pi.v ----------------------------------------------------------------------------------------------------------------

RAW = "{{2{r_prop[A-1]}}, r_prop} + {{2{r_acc[A-1]}}, r_acc}"
SUM_62 = f"    wire signed [A+1:0] sum = {RAW} + HALF_Y;"
PI_RULES = {
    "floor": "62'sd0",
    "ceil": "62'sd16777215",
    "toward_zero": "(raw[61] ? 62'sd16777215 : 62'sd0)",
    "half_down": "62'sd8388607",
    "half_even": "62'sd8388607 + (raw[24] ? 62'sd1 : 62'sd0)",
    "half_away": "(raw[61] ? 62'sd8388607 : 62'sd8388608)",
    "half_zero": "(raw[61] ? 62'sd8388608 : 62'sd8388607)",
}
for rule, text in PI_RULES.items():
    for case in ("rate", "frequency"):
        new = f"    wire signed [61:0] raw = {RAW};\n    wire signed [61:0] sum = raw + {text};"
        fault("pi.v", case, "rounding", (SUM_62, new), what=rule)
Y_CLIP = "(rounded < Y_LO) ? lo : (rounded > Y_HI) ? hi : rounded[35:0]"
ACC_CLIP = "(next_acc < SUM_LO) ? ACC_LO : (next_acc > SUM_HI) ? ACC_HI : next_acc[A-1:0]"
for case in ("rate", "extreme"):
    fault("pi.v", case, "wrap", (Y_CLIP, "rounded[35:0]"))
fault("pi.v", "rate", "wrap", (Y_CLIP, "{{12{rounded[23]}}, rounded[23:0]}"))
fault("pi.v", "odd", "wrap", (ACC_CLIP, "next_acc[A-1:0]"))
for case in ("odd", "rate"):
    fault("pi.v", case, "limit", ("(rounded > Y_HI) ? hi", "(rounded > Y_HI) ? hi - 36'sd1"))
    fault("pi.v", case, "limit", ("(rounded > Y_HI) ? hi", "(rounded >= Y_HI) ? hi - 36'sd1"))
    fault("pi.v", case, "limit", ("(rounded > Y_HI) ? hi", "(rounded > Y_HI) ? hi + 36'sd1"))
    fault("pi.v", case, "limit", ("(rounded < Y_LO) ? lo", "(rounded < Y_LO) ? lo + 36'sd1"))
    fault("pi.v", case, "limit", ("(rounded < Y_LO) ? lo", "(rounded < Y_LO) ? lo - 36'sd1"))
    fault("pi.v", case, "limit", ("ACC_HI = {hi, {F{1'b0}}}", "ACC_HI = {hi, {F{1'b0}}} - 60'sd1"))
    fault("pi.v", case, "limit", ("ACC_LO = {lo, {F{1'b0}}}", "ACC_LO = {lo, {F{1'b0}}} + 60'sd16777216"))
fault("pi.v", "odd", "sign", ("r_prop <= kp_e", "r_prop <= -kp_e"))
fault("pi.v", "odd", "sign", ("+ {ki_e[A-1], ki_e}", "- {ki_e[A-1], ki_e}"))
fault("pi.v", "odd", "sign", (RAW, "{{2{r_acc[A-1]}}, r_acc} - {{2{r_prop[A-1]}}, r_prop}"))
fault("pi.v", "odd", "sign", (RAW, "{{2{r_prop[A-1]}}, r_prop} - {{2{r_acc[A-1]}}, r_acc}"))
fault("pi.v", "rate", "sign", ("r_prop <= kp_e", "r_prop <= -kp_e"))
fault("pi.v", "rate", "sign", ("+ {ki_e[A-1], ki_e}", "- {ki_e[A-1], ki_e}"))
for case in ("odd", "rate"):
    fault("pi.v", case, "gain", ("r_prop <= kp_e", "r_prop <= kp_e <<< 1"))
    fault("pi.v", case, "gain", ("r_prop <= kp_e", "r_prop <= kp_e >>> 1"))
    fault("pi.v", case, "gain", ("+ {ki_e[A-1], ki_e}", "+ {ki_e[A-1], ki_e} * 2"))
    fault("pi.v", case, "gain", ("+ {ki_e[A-1], ki_e}", "+ {ki_e[A-1], ki_e[A-1], ki_e[A-1:1]}"))
fault("pi.v", "odd", "gain", ("rounded = sum[A+1:F]", "rounded = {sum[A+1], sum[A+1:F+1]}"))
for name, value, kind in (
    ("prop", "{A{1'b0}}", "60'sd"),
    ("acc ", "{A{1'b0}}", "60'sd"),
    ("y   ", "36'sd0", "36'sd"),
):
    for to in (1, 7):
        old = f"if (rst) begin\n r_{name} <= {value};" if name == "prop" else f"r_{name} <= {value};"
        fault("pi.v", "odd", "reset", (old, f"{old[: -len(value) - 1]}{kind}{to};"))
for k in (1, 2):
    late("pi.v", "odd", "r_y    <= 36'sd0;", f"r_y <= {Y_CLIP};", k, "signed [35:0]")
early("pi.v", "odd", "output reg signed [35:0] r_y ", "r_y    <= 36'sd0;", f"r_y <= {Y_CLIP};")

# spi_dac.v -----------------------------------------------------------------------------------------------------------

DAC = "spi_dac.v"
REVERSED = {bits: "{" + ", ".join(f"word[{n}]" for n in range(bits)) + "}" for bits in (16, 24)}
for case, bits in (("dac8811", 16), ("ad5791", 24), ("dac82002", 24)):
    fault(DAC, case, "bit_order", ("r_shift     <= word", f"r_shift     <= {REVERSED[bits]}"))
    fault(DAC, case, "bit_order", ("{r_shift[22:0], 1'b0} & MASK", "{1'b0, r_shift[23:1]}"))
for name, value in (("shift    ", "24'd0"), ("left     ", "5'd0"), ("lead     ", "2'd0")):
    fault(DAC, "ad5791", "reset", (f"r_{name}  <= {value};", f"r_{name}  <= {value[:-1]}1;"))
fault(DAC, "ad5791", "reset", ("r_shift     <= 24'd0;", "r_shift     <= 24'h800000;"))
fault(DAC, "dac8811", "sign", ("o_sdin = |(r_shift & MSB)", "o_sdin = ~|(r_shift & MSB)"))
fault(DAC, "ad5791", "sign", ("o_sdin = |(r_shift & MSB)", "o_sdin = ~|(r_shift & MSB)"))

# spi_adc.v -----------------------------------------------------------------------------------------------------------

ADC = "spi_adc.v"
fault(ADC, "default", "bit_order", ("{r_shift[22:0], 1'b0} | bit_at", "{dout, r_shift[23:1]}"))
for name, value, new in (
    ("meta      ", "1'b0", "1'b1"),
    ("sync      ", "1'b0", "1'b1"),
    ("shift     ", "24'd0", "24'd1"),
    ("status    ", "24'd0", "24'hc00000"),
    ("channels_0", "24'sd0", "24'sd1"),
    ("channels_7", "24'sd0", "-24'sd1"),
    ("ok        ", "1'b0", "1'b1"),
):
    fault(ADC, "default", "reset", (f"\n            r_{name} <= {value};\n", f"\n            r_{name} <= {new};\n"))
fault(
    ADC,
    "default",
    "reset",
    ("r_shift      <= 24'd0;\n            r_word       <= 4'd0;", "r_shift <= 24'd0;\n r_word <= 4'd1;"),
)
late(ADC, "default", "r_meta       <= 1'b0;", "r_meta  <= drdy_n;", 1, "")
late(ADC, "default", "r_sync       <= 1'b0;", "r_sync  <= r_meta;", 1, "")
late(ADC, "default", "r_sync       <= 1'b0;", "r_sync  <= r_meta;", 2, "")

# VHDL ----------------------------------------------------------------------------------------------------------------

for n in OFFSETS:
    fault(
        "dds.vhd",
        "default",
        "sign",
        (f"turns(r_phase, off_{n})", f"std_logic_vector(unsigned(r_phase) - unsigned(off_{n}))"),
    )
    fault("dds.vhd", "default", "gain", (f"turns(r_phase, off_{n})", f"turns(r_phase, off_{n}(46 downto 0) & '0')"))
    fault("dds.vhd", "default", "reset", (f"r_{n} <= (others => '0')", f"r_{n} <= (5 => '1', others => '0')"))
fault("dds.vhd", "default", "sign", ("turns(r_phase, word)", "std_logic_vector(unsigned(r_phase) - unsigned(word))"))
fault("dds.vhd", "default", "gain", ("turns(r_phase, word)", "turns(r_phase, '0' & word(47 downto 1))"))
for name in ("(not sense_ref(DDS_BITS - 1))", "(not drive_ref(DDS_BITS - 1))"):
    fault("references.vhd", "align2_retimed", "sign", (name, name.replace("not ", "")))
fault(
    "references.vhd",
    "align2_retimed",
    "sign",
    ("(drive_ref(DDS_BITS - 1) xnor drive_ref(DDS_BITS - 2))", "(drive_ref(47) xor drive_ref(46))"),
)
fault("references.vhd", "align0_retimed", "reset", ("r_retimed   <= (others => '0')", "r_retimed   <= (others => '1')"))
fault("references.vhd", "align0_retimed", "sign", ("r_retimed <= picked;", "r_retimed <= not picked;"))
for rule, text in (("floor", "0"), ("ceil", "2**24 - 1"), ("half_down", "2**23 - 1")):
    fault("pi.vhd", "rate", "rounding", ("to_signed(2**(F - 1), A + 2)", f"to_signed({text}, A + 2)"), what=rule)
fault(
    "pi.vhd",
    "rate",
    "sign",
    ("near(signed(kp) * signed(e))", "-near(signed(kp) * signed(e))"),
)
fault("pi.vhd", "rate", "sign", ("near(signed(ki) * signed(e))", "near(-(signed(ki) * signed(e)))"))
fault("pi.vhd", "odd", "gain", ("near(signed(ki) * signed(e))", "shift_left(near(signed(ki) * signed(e)), 1)"))
fault(
    "pi.vhd",
    "odd",
    "gain",
    ("kp_e := near(signed(kp) * signed(e))", "kp_e := shift_left(near(signed(kp) * signed(e)), 1)"),
)
fault(
    "pi.vhd",
    "odd",
    "limit",
    (
        "ACC_HI : signed(A - 1 downto 0) := Y_HI & (F - 1 downto 0 => '0')",
        "ACC_HI : signed(A - 1 downto 0) := (Y_HI & (F - 1 downto 0 => '0')) - 1",
    ),
)
fault(
    "pi.vhd",
    "odd",
    "wrap",
    ("std_logic_vector(clamp(rounded(A + 1 downto F)))", "std_logic_vector(rounded(A - 1 downto F))"),
)
fault("pi.vhd", "odd", "reset", ("r_y    <= (others => '0')", "r_y    <= (0 => '1', others => '0')"))
fault("spi_dac.vhd", "dac8811", "bit_order", ("kept(r_shift(22 downto 0) & '0')", "('0' & r_shift(23 downto 1))"))
fault("spi_dac.vhd", "ad5791", "bit_order", ("kept(r_shift(22 downto 0) & '0')", "('0' & r_shift(23 downto 1))"))
fault("spi_dac.vhd", "ad5791", "sign", ("o_sdin <= r_shift(LENGTH - 1)", "o_sdin <= not r_shift(LENGTH - 1)"))
fault("spi_dac.vhd", "ad5791", "reset", ("r_left      <= (others => '0')", 'r_left      <= "00001"'))

# The loops: a fault in a part shows under the part's name in the loop -------------------------------------------------

ERROR = "{2'b00, setpoint} - {1'b0, magnitude}"
fault("agc.v", "default", "sign", (ERROR, "{1'b0, magnitude} - {2'b00, setpoint}"))
fault("agc.v", "default", "sign", (ERROR, "{2'b00, setpoint} + {1'b0, magnitude}"))
fault("agc.v", "default", "gain", (ERROR, "{2'b00, setpoint} - {magnitude, 1'b0}"))
fault("agc.v", "default", "reset", ("r_error <= 26'sd0", "r_error <= 26'sd1"))
fault("agc.v", "default", "limit", ("r_loop_y >= loop_hi", "r_loop_y > loop_hi"))
fault("rate_loop.v", "default", "sign", ("r_error <= sense_sin", "r_error <= -sense_sin"))
fault("rate_loop.v", "default", "gain", ("r_error <= sense_sin", "r_error <= sense_sin >>> 1"))
fault("rate_loop.v", "default", "limit", ("r_loop_y >= loop_hi", "r_loop_y >= loop_hi - 36'sd1"))
fault("rate_loop.v", "default", "limit", ("r_loop_y <= loop_lo", "r_loop_y < loop_lo"))
fault("quadrature_loop.v", "default", "sign", ("r_error <= -wide_cos", "r_error <= wide_cos"))
fault("quadrature_loop.v", "default", "reset", ("r_error <= 25'sd0", "r_error <= 25'sd5"))
fault("quadrature_loop.v", "default", "limit", ("r_loop_y <= loop_lo", "r_loop_y < loop_lo"))
TRACKER = "frequency_tracker.v"
fault(TRACKER, "default", "sign", ("r_centre + correction", "r_centre - correction"))
fault(TRACKER, "default", "sign", ("r_centre + wide_y", "r_centre - wide_y"))
fault(TRACKER, "default", "gain", ("r_centre + correction", "r_centre + (correction <<< 1)"))
fault(TRACKER, "default", "reset", ("r_word <= NOMINAL_WORD;\n end", "r_word <= 48'd0;\n end"))
fault(TRACKER, "default", "reset", ("TWICE[DDS_BITS:1];", "TWICE[DDS_BITS:1] + 48'd1;"))
fault(TRACKER, "default", "sign", ("r_error <= phase", "r_error <= -phase"))
for loop in ("agc", "rate_loop", "quadrature_loop", "frequency_tracker"):
    fault("pi.v", "default", "rounding", ("+ HALF_Y", "+ 62'sd0"), what="floor", inside=loop)
    fault("pi.v", "default", "sign", ("+ {ki_e[A-1], ki_e}", "- {ki_e[A-1], ki_e}"), inside=loop)
    fault("pi.v", "default", "reset", ("r_y <= 36'sd0;", "r_y <= 36'sd1;"), inside=loop)
    if loop in ("agc", "rate_loop"):
        fault("pi.v", "default", "limit", ("(rounded > Y_HI) ? hi", "(rounded > Y_HI) ? hi - 36'sd1"), inside=loop)

# isqrt.v, cordic.v ---------------------------------------------------------------------------------------------------

fault("isqrt.v", "default", "limit", ("fits = ~less[19]", "fits = ~less[19] & (less != 20'd0)"))
fault(
    "isqrt.v",
    "default",
    "rounding",
    ("r_y <= next_root", "r_y <= next_root + ((fits ? less[16:0] : pair[16:0]) > {1'b0, next_root})"),
    what="half_up",
)
fault("isqrt.v", "default", "gain", ("r_radicand <= u;", "r_radicand <= u << 1;"))
fault("isqrt.v", "default", "reset", ("r_y <= 16'd0;", "r_y <= 16'd9;"))
fault("isqrt.v", "default", "reset", ("if (rst) begin\n r_radicand <= 32'd0;", "if (rst) begin\n r_radicand <= 32'd1;"))
for half, guard, kind in (("HALF_X", "r_x", "33'd"), ("HALF_ANGLE", "r_angle", "32'd")):
    for rule, value in (("floor", "0"), ("ceil", "255")):
        fault("cordic.v", "default", "rounding", (f"{guard} + {half}", f"{guard} + {kind}{value}"), what=rule)
for rule, value in (
    ("floor", "35'sd0"),
    ("ceil", "(ONE <<< r_i) - ONE"),
    ("half_down", "((ONE <<< r_i) - ONE) >>> 1"),
):
    fault("cordic.v", "default", "rounding", ("down = (x + half)", f"down = (x + ({value}))"), what=rule)
    fault("cordic.v", "default", "rounding", ("across = (y + half)", f"across = (y + ({value}))"), what=rule)
fault(
    "cordic.v",
    "default",
    "sign",
    ("r_y[W-1] ? r_angle - atan : r_angle + atan", "r_y[W-1] ? r_angle + atan : r_angle - atan"),
)
fault("cordic.v", "default", "sign", ("r_y[W-1] ? x - across : x + across", "r_y[W-1] ? x + across : x - across"))
fault("cordic.v", "default", "sign", ("turned_y = x_in[23] ? -wide_y : wide_y", "turned_y = wide_y"))
fault("cordic.v", "default", "gain", ("magnitude[W-1:G]", "magnitude[W-1:G+1]"))
fault(
    "cordic.v",
    "default",
    "gain",
    ("r_angle - atan : r_angle + atan", "r_angle - (atan >>> 1) : r_angle + (atan >>> 1)"),
)
fault("cordic.v", "default", "reset", ("r_phase <= 24'sd0;\n end", "r_phase <= 24'sd1;\n end"))

# rate_output.v, digital_sid.v ----------------------------------------------------------------------------------------

OUT = "rate_output.v"
fault(OUT, "default", "rounding", ("square_t * square_t + 32'sd16384", "square_t * square_t"), what="floor")
fault(
    OUT,
    "default",
    "rounding",
    ("square_t * square_t + 32'sd16384", "square_t * square_t + 32'sd16383"),
    what="half_down",
)
fault(
    OUT,
    "default",
    "rounding",
    ("r_t <= temperature[23:8]", "r_t <= temperature[23:8] + {15'd0, temperature[7]}"),
    what="half_up",
)
fault(OUT, "default", "sign", ("wide_bias + wide_bias_t1 * bias_t", "wide_bias - wide_bias_t1 * bias_t"))
fault(OUT, "default", "sign", ("r_word <= word", "r_word <= -word"))
fault(OUT, "default", "gain", ("r_bias <= bias_sum", "r_bias <= bias_sum <<< 1"))
fault(OUT, "default", "gain", ("wide_bias_t2 * bias_square;", "wide_bias_t2 * (bias_square <<< 1);"))
fault(OUT, "default", "wrap", ("r_scaled <= clamped_product[31:0]", "r_scaled <= rounded_product[31:0]"))
fault(OUT, "default", "reset", ("r_acc <= 38'sd0;", "r_acc <= -38'sd1;"))
fault(OUT, "default", "reset", ("r_count <= 6'd0;", "r_count <= 6'd1;"))
for rule, value in (("floor", "0"), ("ceil", "65535"), ("half_down", "32767")):
    fault(OUT, "default", "rounding", ("r_bias} + 52'sd32768", f"r_bias}} + 52'sd{value}"), what=rule)
for rule, value in (("floor", "0"), ("ceil", "268435455")):
    fault(OUT, "default", "rounding", ("product_scale + 63'sd134217728", f"product_scale + 63'sd{value}"), what=rule)
for rule, value in (("floor", "39'sd0"), ("ceil", "((39'sd1 <<< k) - 39'sd1)"), ("half_down", "(half - (k != 3'd0))")):
    fault(OUT, "default", "rounding", ("(wide_acc + half) >>> k", f"(wide_acc + {value}) >>> k"), what=rule)
fault(OUT, "default", "limit", ("? OUT_HI : rounded_product", "? OUT_HI - 35'sd1 : rounded_product"))
fault(
    OUT,
    "default",
    "limit",
    ("(rounded_scale > SCALE_HI) ? SCALE_HI", "(rounded_scale >= SCALE_HI) ? SCALE_HI - 32'sd1"),
)
fault(
    OUT,
    "default",
    "limit",
    (
        "(rounded_difference < CORRECTED_LO) ? CORRECTED_LO",
        "(rounded_difference < CORRECTED_LO) ? CORRECTED_LO + 36'sd1",
    ),
)
SID = "digital_sid.v"
for rule, value in (("floor", "63'sd0"), ("ceil", "63'sd1048575")):
    fault(SID, "default", "rounding", ("ALPHA * difference + 63'sd524288", f"ALPHA * difference + {value}"), what=rule)
for rule, value in (("floor", "63'sd0"), ("ceil", "63'sd8589934591")):
    fault(
        SID,
        "delay0",
        "rounding",
        ("{{22{y[40]}}, y} + 63'sd4294967296", f"{{{{22{{y[40]}}}}, y}} + {value}"),
        what=rule,
    )
fault(SID, "default", "sign", ("with_sign = positive ? wide : -wide", "with_sign = positive ? -wide : wide"))
fault(SID, "default", "sign", ("filtered = y + product[60:20]", "filtered = y - product[60:20]"))
fault(SID, "default", "gain", ("filtered = y + product[60:20]", "filtered = y + product[61:21]"))
fault(SID, "default", "gain", ("code_of(GAIN_X, r_pole3_0)", "code_of(GAIN_X <<< 1, r_pole3_0)"))
fault(SID, "default", "limit", ("(sum > ACC_HI) ? ACC_HI[24:0]", "(sum > ACC_HI) ? ACC_HI[24:0] - 25'sd1"))
fault(
    SID, "default", "wrap", ("(sum < ACC_LO) ? ACC_LO[24:0] : (sum > ACC_HI) ? ACC_HI[24:0] : sum[24:0]", "sum[24:0]")
)
fault(SID, "default", "reset", ("r_pole2_1 <= 41'sd0", "r_pole2_1 <= 41'sd77"))

# Monitors and the sequencer: limits that are parameters ---------------------------------------------------------------

fault("watchdog.v", "default", "limit", ("next_age > limit", "next_age >= limit"))
fault("watchdog.v", "default", "limit", ("next_age > limit", "next_age > limit + 10'd1"))
fault("watchdog.v", "default", "wrap", ("(r_age == AGE_TOP) ? AGE_TOP : r_age + 10'd1", "r_age + 10'd1"))
fault("watchdog.v", "default", "limit", ("AGE_TOP = 10'd1023", "AGE_TOP = 10'd1022"))
fault("watchdog.v", "default", "reset", ("r_age <= 10'd0;", "r_age <= rst ? 10'd3 : 10'd0;"))
SEQ = "sequencer.v"
fault(SEQ, "quick", "rounding", ("rotation} + 60'sd32768", "rotation} + 60'sd0"), what="floor")
fault(SEQ, "quick", "sign", ("r_rotation + {{12{turned[23]}}, turned}", "r_rotation - {{12{turned[23]}}, turned}"))
fault(SEQ, "quick", "limit", ("frames >= {1'b0, retune}", "frames > {1'b0, retune}"))
fault(SEQ, "quick", "limit", ("frames >= {1'b0, init}", "frames > {1'b0, init}"))

# The port of the host ------------------------------------------------------------------------------------------------

SLAVE, AXI, BUS = "spi_slave.v", "axi_slave.v", "host_bus.v"
fault(SLAVE, "default", "reset", ("r_errors <= 3'd0;", "r_errors <= 3'd5;"))
fault(SLAVE, "default", "reset", ("r_address <= 11'd0;", "r_address <= 11'd4;"))
fault(SLAVE, "default", "bit_order", ("r_shift[38:0], r_sdi", "r_sdi, r_shift[39:1]"))
fault(SLAVE, "default", "sign", ("r_words <= r_words - 3'd1", "r_words <= r_words + 3'd1"))
fault(SLAVE, "default", "gain", ("r_data <= shifted[31:0]", "r_data <= shifted[32:1]"))
fault(AXI, "default", "reset", ("r_arready <= 1'b1;\n            r_araddr", "r_arready <= 1'b0;\n            r_araddr"))
fault(AXI, "default", "reset", ("r_bresp <= OKAY;", "r_bresp <= SLVERR;"))
fault(AXI, "default", "gain", ("r_wdata <= wdata", "r_wdata <= wdata << 1"))
fault(BUS, "default", "reset", ("r_number <= 12'd0;", "r_number <= 12'd9;"))
fault(BUS, "default", "reset", ("r_status <= 19'd0;", "r_status <= 19'd1;"))
fault(BUS, "default", "sign", ("r_frames + 12'd1", "r_frames - 12'd1"))
fault(BUS, "default", "gain", ("r_high <= value[47:32]", "r_high <= value[46:31]"))

# Equivalent: 24 bits of 24 are kept; with kp = 0 prop stays 0, and acc alone never leaves the limits of y ------------

EQUIVALENT.append(Fault(DAC, "ad5791", "wrap", "", (("{r_shift[22:0], 1'b0} & MASK", "{r_shift[22:0], 1'b0}"),)))
NO_PROP = (
    ("(rounded > Y_HI) ? hi", "(rounded > Y_HI) ? hi - 36'sd1"),
    ("(mode == P_ONLY || mode == RUN)", "(mode == RUN)"),
)
for edit in NO_PROP:
    EQUIVALENT.append(Fault("pi.v", "default", "limit", "", (edit,), "quadrature_loop"))
