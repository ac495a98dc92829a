"""Blunders of engineers, of translators from VHDL and of readers of a specification, by rules on the text of the RTL.

The rules and their classes were written after the diagnosis was frozen, from docs/diagnosis.md and the RTL alone, by
someone who had not read its code. A fault is as in `rtl_faults`; its cause is "" for what is in no class.
"""

import collections
import re

from tests.testbench.golden.diagnosis.rtl_faults import Fault, whole
from tests.testbench.golden.diagnosis.rtl_misreadings import ACCS, LOCKS, POLES, before
from tests.testbench.golden.diagnosis.rtl_mistakes import FSM, LOOPS, edits, parameter, reached, strobed, swaps
from tests.testbench.golden.diagnosis.rtl_slips import fault

ZERO = r"\d+'s?[bdh]0+|\{[\w+\- ]+\{1'b0\}\}"
COUNTS = "over_range stuck drive rate rail"


def clocked(d, found):
    """Assignments of the clocked block, without comparisons that look alike."""
    return [m for m in found if m.start() > d.always and d.text[m.start() - 1] != "("]


def top(d, m):
    """Index of the top bit of a register, a number or an expression; None of a flag."""
    found = re.fullmatch(r"\[(.+):0\]", d.width(m[1]) or "")
    return found and found[1]


def computed(d, least, signed=False):
    """Loads of words of at least some bits, but of constants; the width of the others is a parameter."""
    for m in clocked(d, d.loads):
        high = top(d, m)
        wide = high and (not high.isdigit() or int(high) + 1 >= least) and "$clog2" not in high
        constant = re.fullmatch(rf"{ZERO}|\d+'\w+|[A-Z]\w+", m[2])
        if wide and not constant and (d.ports[m[1]][1] or not signed):
            yield m, high


def cut(d, kind, cause, found, work, value):
    """Another value of what a register loads: `t` is that value in the register's format."""
    out = []
    for m, high in found:
        sign = "signed" if d.ports[m[1]][1] else ""
        step, put = work.replace("TOP", f"({high})"), value.replace("TOP", f"({high})")
        text = f"begin : blunder reg {sign} [{high}:0] t; t = {m[2]}; {step}{m[1]} <= {put}; end"
        f = fault(d, kind, cause, m.span(), text, {d.plain(m[1])})
        out.append(f._replace(edit=" ".join(f"{m[0]} t: {step}{put}".split())))
    return out


# ---- resets and clocks ---------------------------------------------------------------------------------------------


def one_asynchronous(d):
    """One register of several has an asynchronous reset."""
    resets, kind = clocked(d, d.resets), "asynchronous reset of one register"
    return [
        Fault(kind, "async_reset", d.stem, before(d, d.text, f"always @(posedge rst) {m[0]}\n"), (d.plain(m[1]),), m[0])
        for m in resets
        if len(resets) > 1
    ]


def mid_scale(d):
    good = [m for m in clocked(d, d.resets) if re.fullmatch(ZERO, m[2]) and top(d, m)]
    return whole(d, "reset to mid-scale", "reset", lambda m: f"{{1'b1, {{{top(d, m)}{{1'b0}}}}}}", good)


DATA = {"dds": "drive_sine sense_sine drive_ref sense_ref", "spi_adc": "meta sync seen", "cordic": "x y angle",
        "isqrt": "radicand root remainder", "rate_output": "corrected scaled", "pi": "prop acc",
        "sine": "base slope fraction", "registers": "phase_drive_sine phase_sense_sine"}  # fmt: skip


def data_path(d):
    """Registers of data of one sort are all without reset."""
    groups = collections.defaultdict(list)
    for m in clocked(d, d.resets):
        groups[re.sub(r"_?t?\d$", "", m[1])].append(m)
    own = [m for m in clocked(d, d.resets) if d.plain(m[1]) in DATA.get(d.stem, "").split()]
    out = []
    for group in (*groups.values(), own):
        text = d.text
        for m in reversed(group):
            text = text[: m.start()] + text[m.end() :]
        if len(group) > 1:
            names = tuple(sorted(d.plain(m[1]) for m in group))
            edit = f"reset of {' '.join(names)} removed"
            out.append(Fault("data path without reset", "no_reset", d.stem, text, names, edit))
    return out


def output_registered(d):
    out = []
    for w in d.wires:
        if w[1] in d.ports and w[1][:2] == "o_":
            _, sign, width = d.ports[w[1]]
            kept = (
                f"reg {'signed' if sign else ''} {width} late;\n    always @(posedge clk) late <= rst ? 0 : {w[2]};\n"
            )
            text = before(d, d.edited(*w.span(2), "late"), kept)
            out.append(Fault("output registered", "late", d.stem, text, (d.plain(w[1]),), f"{w[1]} in a register"))
    return out


def falling(d):
    """A register that does not depend on itself takes its new value half a clock earlier, where others read the old.

    Benches change inputs at this edge: whether it sees the old or the new input depends on the bench.
    """
    start = d.text.index("begin", d.always)
    end, out = d.end_of(start), []
    block = d.text[d.always : end]
    for name in dict.fromkeys(m[1] for m in clocked(d, d.loads)):
        mine = [m for m in d.loads if m[1] == name]
        itself = any(re.search(rf"\b{name}\b", m[2]) for m in mine) or re.search(rf"(if|case) \(.*\b{name}\b", block)
        wires = [w[1] for w in d.wires if re.search(rf"\b{name}\b", w[2]) and w[1][:2] != "o_"]
        if not itself and not any({d.plain(name), "*"} & d.driven(w) for w in wires):
            rest = re.sub(rf"\b{name}\s*<= [^;]+;", ";", block)
            own = re.sub(rf"\b(?!{name}\b)r_\w+\s*<= [^;]+;", ";", block).replace("posedge clk", "negedge clk")
            text = f"{d.text[: d.always]}{rest}\n    {own}{d.text[end:]}"
            edit = f"{name} at negedge"
            out.append(Fault("clocked at the falling edge", "early", d.stem, text, (d.plain(name),), edit))
    return out


def two_clocks(d):
    return strobed(d, "strobe of two clocks", "condition", "{} || was")


# ---- arithmetic ----------------------------------------------------------------------------------------------------


def _up(stem, total, half, most, registers=""):
    """Edit of a sum with its rounding constant: the greatest that is dropped."""
    return stem, "rounding", f"{total} + {half}", f"{total} + {most}", registers


upward = edits("always rounded up", [
    _up("modulator", "(wide_product", "HALF)", "(HALF <<< 1) - 1)"),
    _up("pi", "{{2{r_prop[A-1]}}, r_prop} + {{2{r_acc[A-1]}}, r_acc}", "HALF_Y", "(HALF_Y <<< 1) - 1"),
    _up("notch", "r_y1", "34'sd512", "34'sd1023"),
    _up("notch", "wide_d * wide_y2", "59'sd2097152", "59'sd4194303"),
    _up("rate_output", "square_t * square_t", "32'sd16384", "32'sd32767"),
    _up("rate_output", "wide_scale_t2 * scale_square", "44'sd2048", "44'sd4095"),
    _up("rate_output", "{{2{r_bias[49]}}, r_bias}", "52'sd32768", "52'sd65535"),
    _up("rate_output", "wide_corrected * product_scale", "63'sd134217728", "63'sd268435455"),
    _up("rate_output", "(wide_acc", "half)", "half + ((k == 3'd0) ? 39'sd0 : half - 39'sd1))"),
    _up("digital_sid", "ALPHA * difference", "63'sd524288", "63'sd1048575"),
    _up("digital_sid", "gain * {{22{y[40]}}, y}", "63'sd4294967296", "63'sd8589934591"),
    _up("cordic", "r_x", "HALF_X", "(HALF_X << 1) - 1"),
    _up("cordic", "r_angle", "HALF_ANGLE", "(HALF_ANGLE << 1) - 1", "phase"),
    _up("cordic", "(y", "half)", "half + ((r_i == 5'd0) ? 0 : half - 1))"),
    _up("cordic", "(x", "half)", "half + ((r_i == 5'd0) ? 0 : half - 1))"),
    _up("sequencer", "{{24{rotation[35]}}, rotation}", "60'sd32768", "60'sd65535", f"correction {FSM}"),
    _up("sine", "r_product}", "HALF", "(HALF << 1) - 1"),
])  # fmt: skip


def _stops(stem, a, b, sign, registers=""):
    """Edit of a sum of an unsigned word and a signed one: it stops at 0 and at full scale."""
    wide = f"({{1'b0, {a}}} + {{{sign}, {b}}})"
    return stem, "saturate", f"{a} + {b};", f"({wide} >> DDS_BITS) ? {{DDS_BITS{{~{sign}}}}} : {a} + {b};", registers


overflow = edits("overflow of the other mode", [
    ("digital_sid", "wrap", "(sum < ACC_LO) ? ACC_LO[24:0] : (sum > ACC_HI) ? ACC_HI[24:0] : sum[24:0]", "sum[24:0]",
     ACCS),
    ("digital_sid", "wrap", "(rounded < CODE_LO) ? CODE_LO[23:0] : (rounded > CODE_HI) ? CODE_HI[23:0] : ", "",
     "codes_0 codes_1 codes_2 codes_3"),
    ("pi", "wrap", "(preset < lo) ? ACC_LO : (preset > hi) ? ACC_HI : ", "", "acc"),
    ("rate_output", "wrap", "(decimation > MAX_K) ? MAX_K : ", "", "k count y valid acc"),
    ("sequencer", "wrap", " && r_attempts != 8'hFF", "", "attempts"),
    ("isqrt", "saturate", "r_i + 4'd1;", "(&r_i) ? r_i : r_i + 4'd1;", "i"),
    _stops("frequency_tracker", "r_centre", "wide_y[DDS_BITS-1:0]", "wide_y[DDS_BITS-1]", "word"),
    _stops("frequency_tracker", "r_centre", "correction", "correction[DDS_BITS-1]", "centre"),
    ("cordic", "saturate", "r_angle + HALF_ANGLE;",
     "(r_angle > $signed({1'b0, {A-1{1'b1}}} - HALF_ANGLE)) ? {1'b0, {A-1{1'b1}}} : r_angle + HALF_ANGLE;", "phase"),
])  # fmt: skip


def zero_limit(d):
    pattern = r"\((\w+ (?:< (?:\w*LO|lo)|> (?:\w*HI|hi)))\) \? (?!MAX)[\w\[\]:]+ :"
    return swaps(d, "zero on overflow", "limit", pattern, lambda m: f"({m[1]}) ? 0 :")


def _misread(stem, left, right, registers, signed=True):
    """Edits of a coefficient: of the opposite sign, in a format of one fraction bit more or less."""
    rows = [("gain", f"$signed({right}) <<< 1"), ("gain", f"$signed({right}) >>> 1"), ("sign", f"-$signed({right})")]
    return [(stem, cause, left + right, left + new, registers) for cause, new in rows[: 3 if signed else 2]]


misread = edits("coefficient misread", [
    *_misread("pi", "KP = ", "{{26{kp[33]}}, kp}", "prop"),
    *_misread("pi", "KI = ", "{{26{ki[33]}}, ki}", "acc"),
    *_misread("notch", "wide_g = ", "{{35{g[23]}}, g}", "y1"),
    *_misread("notch", "wide_c = ", "{{35{c[23]}}, c}", "y1"),
    *_misread("digital_sid", "ALPHA = ", "{43'd0, alpha}", POLES, False),
    *_misread("digital_sid", "GAIN_X = ", "{42'd0, gain_x}", "codes_0 codes_1"),
    *_misread("digital_sid", "GAIN_Y = ", "{42'd0, gain_y}", "codes_2 codes_3"),
    *_misread("agc", "kicked ? ", "kick", "amplitude"),
    *_misread("modulator", "wide_amplitude = ", "{{SINE_BITS{amplitude[23]}}, amplitude}", "product"),
    *_misread("rate_output", "wide_bias_t1 = ", "{{18{bias_t1[31]}}, bias_t1}", "bias"),
    *_misread("rate_output", "wide_bias_t2 = ", "{{18{bias_t2[31]}}, bias_t2}", "bias"),
    *_misread("rate_output", "wide_scale_t1 = ", "{{20{scale_t1[23]}}, scale_t1}", "scale"),
    *_misread("rate_output", "wide_scale_t2 = ", "{{20{scale_t2[23]}}, scale_t2}", "scale"),
    *_misread("sequencer", "scaled = ", "$signed({36'd0, gain})", f"correction {FSM}")[2:],
    *(row for stem in LOOPS for row in _misread(stem, ".kp(", "loop_kp", "loop_prop")),
    *(row for stem in LOOPS for row in _misread(stem, ".ki(", "loop_ki", "loop_acc")),
])  # fmt: skip


def unsigned_constant(d):
    """`signed` left out of a constant that is compared: the comparison is unsigned."""
    out = []
    for m in re.finditer(r"(?:localparam|parameter) +signed +\[[^\]]+\] *([^;/\n]+(?:\n[^;/]+;)?)", d.text):
        registers = set()
        for name in re.findall(r"(\w+) *=", m[1]):
            for use in re.finditer(rf"\w+ [<>]=? {name}\)|\+ {name}\) >>> shift", d.text):
                registers |= set() if parameter(d, use.start()) else reached(d, use.start())
        if registers:
            put = m[0].replace(" signed", "       ", 1)
            out.append(fault(d, "signed left out of a constant", "signedness", m.span(), put, registers))
    return out


def too_narrow(d):
    return cut(d, "word two bits too narrow", "width", computed(d, 6), "", "(t <<< 2) >>> 2")


def stuck_bit(d):
    out = []
    for way in "01":
        found = [(m, high) for m, high in computed(d, 6) if not re.fullmatch(r"\w+", m[2])]
        out += cut(d, "bit of a result stuck", "stuck", found, f"t[TOP / 2] = 1'b{way}; ", "t")
    return out


# ---- numbers and bits ----------------------------------------------------------------------------------------------

wrong_bit = edits("wrong bit of a compared number", [(row[0], "comparison", *row[1:]) for row in (
    ("isqrt", "LAST = 4'd15", "LAST = 4'd11", "busy done y"),
    ("rates", "SLOTS = 6'd60", "SLOTS = 6'd28", "slot"),
    ("rates", "LAST_CYCLE = TICK_CLOCKS - 1", "LAST_CYCLE = (TICK_CLOCKS - 1) ^ 8", "tick frame"),
    ("rates", "LAST_TICK = FRAME_TICKS - 1", "LAST_TICK = (FRAME_TICKS - 1) ^ 4", "frame"),
    ("cordic", "CLOCKS = 5'd24", "CLOCKS = 5'd16", "i busy done magnitude phase x y angle"),
    ("spi_adc", "HEAD = 4'b1100", "HEAD = 4'b1000", "ok"),
    ("spi_adc", "CLOCKS[COUNT-1:0] - ONE, LAST_OF", "(CLOCKS[COUNT-1:0] - ONE) ^ (ONE << 2), LAST_OF", "*"),
    ("spi_dac", "r_lead == 2'd1 && r_left == 5'd0", "r_lead == 2'd1 && r_left == 5'd4", "sync_n sclk_en ldac_wait"),
    ("fault_monitor", "RANGE_HI = 24'sh7FFF00", "RANGE_HI = 24'sh7FFB00", "over_range stuck flags latch"),
    ("agc", "KICK = 3'd4", "KICK = 3'd5", "loop_prop loop_acc amplitude"),
    ("watchdog", "(next_age > limit)", "(next_age > (limit ^ 10'd16))", "stale"),
    ("lock_monitor", "ftr <= limit_in_2", "ftr <= (limit_in_2 ^ 24'd32)", "locked count_2"),
    ("lock_monitor", "pll > limit_out_1", "pll > (limit_out_1 ^ 24'd64)", "locked count_1"),
    ("sequencer", ">= recover)", ">= (recover ^ 16'd4))", FSM),
    ("sequencer", "frames >= {1'b0, kick}", "frames >= {1'b0, kick ^ 16'd2}", FSM),
    ("digital_sid", "r_still == still)", "r_still == (still ^ 12'd4))", "ok"),
)])  # fmt: skip

one_off = edits("number one off", [(row[0], "constant", *row[1:]) for row in (
    ("spi_dac", "r_left      <= bits;", "r_left      <= bits - 5'd1;", "left"),
    ("spi_dac", "r_lead  <= gap;", "r_lead  <= gap + 2'd1;", "lead"),
    ("isqrt", "r_root, 2'b01}", "r_root, 2'b10}", ""),
    ("cordic", "HALF_TURN = {1'b1, {A-1{1'b0}}}", "HALF_TURN = {1'b0, {A-1{1'b1}}}", "angle"),
    ("fault_monitor", "count + 12'd1", "count + 12'd2", COUNTS),
    ("lock_monitor", "+ 13'd1", "+ 13'd2", LOCKS),
    ("digital_sid", "r_stage   <= 2'd1;", "r_stage   <= 2'd2;", "stage"),
    ("digital_sid", "r_stage   <= 2'd2;", "r_stage   <= 2'd3;", "stage"),
    ("rates", "r_tick + 1'b1;", "r_tick + 2'd2;", "tick"),
    ("rates", "r_frame + 1'b1;", "r_frame + 2'd2;", "frame"),
    ("spi_adc", "r_count + ONE", "r_count + ONE + ONE", ""),
)])  # fmt: skip

OTHER_END = (("modulator", "amplitude"), ("cordic", "x_in"), ("cordic", "y_in"), ("fault_monitor", "clear"),
             ("fault_monitor", "levels"), ("digital_sid", "sample_x"), ("digital_sid", "sample_y"), ("notch", "x"),
             ("rate_output", "bias"), ("rate_output", "bias_t1"), ("rate_output", "scale"),
             ("rate_output", "temperature"), ("registers", "data"), ("agc", "setpoint"), ("agc", "magnitude"),
             ("rate_loop", "preset"), ("quadrature_loop", "sense_cos"), ("quadrature_loop", "preset"))  # fmt: skip


def other_end(d):
    """A bus of which more than a copy is used is numbered from the other end."""
    out, head = [], d.text.index("\n);") + 3
    for stem, name in OTHER_END:
        if stem == d.stem:
            _, sign, width = d.ports[name]
            bits = ", ".join(f"{name}[{k}]" for k in range(int(width[1:-3]) + 1))
            body = re.sub(rf"(?<!\.)\b{name}\b", "turned_round", d.text[head:])
            text = f"{d.text[:head]}\nwire {'signed' if sign else ''} {width} turned_round = {{{bits}}};{body}"
            found = d.driven(name)
            found = found - {"*"} | ({"loop_prop", "loop_acc"} if "*" in found else set())
            kind = "bus numbered from the other end"
            out.append(Fault(kind, "bit_order", stem, text, tuple(sorted(found)), f"{name} reversed"))
    return out


SIGNS = ("~(sense_ref[DDS_BITS-1] ^ sense_ref[DDS_BITS-2])", "~sense_ref[DDS_BITS-1]",
         "~(drive_ref[DDS_BITS-1] ^ drive_ref[DDS_BITS-2])", "~drive_ref[DDS_BITS-1]")  # fmt: skip
RATE, RAIL, DRIVE = (f"reached(next_{name}, {name})" for name in ("rate", "rail", "drive"))

positions = edits("place in a list of bits", [
    ("references", "operand", "^ sense_ref[DDS_BITS-2]", "^ sense_ref[DDS_BITS-3]", "signs"),
    ("references", "operand", "^ drive_ref[DDS_BITS-2]", "^ drive_ref[DDS_BITS-3]", "signs"),
    ("references", "operand", f"{SIGNS[3]}}}", "~drive_ref[DDS_BITS-2]}", "signs"),
    ("references", "bit_swap", f"{SIGNS[0]}, {SIGNS[1]}", f"{SIGNS[1]}, {SIGNS[0]}", "signs"),
    ("references", "bit_swap", f"{SIGNS[2]}, {SIGNS[3]}", f"{SIGNS[3]}, {SIGNS[2]}", "signs"),
    ("sine", "operand", "<= phase[DDS_BITS-1]", "<= phase[DDS_BITS-2]", "sign"),
    ("fault_monitor", "operand", f"{RAIL}, {RATE}", f"{RATE}, {RATE}", "flags latch"),
    ("fault_monitor", "operand", f"{RATE}, {DRIVE}", f"{RATE}, {RATE}", "flags latch"),
    ("fault_monitor", "bit_swap", f"{RAIL}, {RATE}", f"{RATE}, {RAIL}", "flags latch"),
    ("fault_monitor", "bit_swap", f"{RATE}, {DRIVE}", f"{DRIVE}, {RATE}", "flags latch"),
    ("lock_monitor", "bit_swap", "{next_3[12], next_2[12]", "{next_2[12], next_3[12]", "locked"),
    ("lock_monitor", "bit_swap", "next_1[12], next_0[12]}", "next_0[12], next_1[12]}", "locked"),
    ("sequencer", "bit_swap", "5'd0, r_lost, 1'b0}", "5'd0, 1'b0, r_lost}", "faults_flags faults_latch"),
])  # fmt: skip

gates = edits("gates of a word", [
    ("references", "operator", "sense_ref[DDS_BITS-1] ^ sense", "sense_ref[DDS_BITS-1] & sense", "signs"),
    ("references", "operator", "drive_ref[DDS_BITS-1] ^ drive", "drive_ref[DDS_BITS-1] & drive", "signs"),
    ("fault_monitor", "operator", "~clear) | flags", "~clear) ^ flags", "latch"),
    ("fault_monitor", "operator", "r_latch & ~clear", "r_latch ^ ~clear", "latch"),
    ("registers", "operator", "r_fault_clear) | data", "r_fault_clear) ^ data", "fault_clear"),
    ("spi_adc", "operator", "r_count & ~LOW", "r_count ^ ~LOW", "count"),
    ("spi_dac", "operator", "1'b0} & MASK", "1'b0} ^ MASK", "shift"),
    ("digital_sid", "complement", "? wide : -wide", "? wide : ~wide", ACCS),
    ("digital_sid", "complement", "x} - {{22{y[40]}}, y}", "x} + ~{{22{y[40]}}, y}", POLES),
    ("notch", "complement", "- wide_d * wide_y2", "+ ~(wide_d * wide_y2)", "y1"),
    ("sequencer", "complement", "i_setpoint} - {1'b0", "i_setpoint} + ~{1'b0", "lock_locked lock_count_0"),
])  # fmt: skip


def _chain(stem, first, one, second, two, registers=""):
    """Edit of a chain of two choices: the second is made first."""
    return stem, "priority", f"{first} ? {one} : {second} ? {two} :", f"{second} ? {two} : {first} ? {one} :", registers


chains = edits("choices in the other order", [
    _chain("rate_output", "!first", "r_k", "(decimation > MAX_K)", "MAX_K"),
    _chain("agc", "kicked", "OFF", "mode[2]", "HOLD", "loop_prop loop_acc"),
    _chain("digital_sid", "!rests", "12'd0", "(r_still >= still)", "still"),
    _chain("fault_monitor", "!symptom", "12'd0", "(count >= limit)", "limit", COUNTS),
    _chain("fault_monitor", "!bad", "16'd0", "(r_bad_frames == top)", "top"),
    _chain("fault_monitor", "bad", "16'd0", "(r_good_frames == top)", "top", "good_frames"),
    _chain("sequencer", "rewind", "16'd0", "frames[16]", "r_timer", "timer"),
    _chain("sequencer", "!drive_locked", "KICK", "sense_locked", "LOCKED", FSM),
    ("registers", "priority", "if (taken)\n                r_fault_clear <= 8'h0;\n            if (write)",
     "if (write)", "fault_clear"),
])  # fmt: skip


# ---- in no class ---------------------------------------------------------------------------------------------------


def threshold(d):
    """What is taken off a small value, and off the magnitude of a large one."""
    put = "(t > 5) ? t - 5 : (t < -5) ? t + 5 : 0"
    return cut(d, "soft threshold", "", computed(d, 16, True), "", put)


def knee(d):
    """Above an eighth of full scale a value grows half as fast."""
    at = "(1 <<< (TOP - 3))"
    put = f"(t > {at}) ? t - ((t - {at}) >>> 1) : (t < -{at}) ? t - ((t + {at}) >>> 1) : t"
    return cut(d, "soft knee", "", computed(d, 16, True), "", put)


def tens(d):
    """Not of counts, which would stay below ten."""
    found = [(m, high) for m, high in computed(d, 16) if not re.search("frames|timer", m[1])]
    return cut(d, "multiple of ten", "", found, "", "t - t % 10")


def quadratic(d):
    work = "square = t; square = (square * square) >>> (TOP + 2); "
    found = list(computed(d, 16, True))
    out = cut(d, "quadratic term", "", found, work, "t + square")
    return [f._replace(text=f.text.replace(" t; t = ", f" t; reg signed [2*({high})+1:0] square; t = ", 1))
            for f, (_, high) in zip(out, found)]  # fmt: skip


def _around(stem, a, b, end, width, registers=""):
    """Edit of a sum: the carry out of its top bit is added at the bottom, as of ones' complement."""
    return stem, "", f"{a} + {b}{end}", f"{a} + {b} + (({{1'b0, {a}}} + {{1'b0, {b}}}) >> {width}){end}", registers


around = edits("carry goes around", [
    _around("dds", "r_phase", "word", ";", "DDS_BITS"),
    *(_around("dds", "r_phase", f"off_{name}", ";", "DDS_BITS")
      for name in ("drive_sine", "sense_sine", "drive_ref", "sense_ref")),
    _around("frequency_tracker", "r_centre", "correction", ";", "DDS_BITS"),
    _around("frequency_tracker", "r_centre", "wide_y[DDS_BITS-1:0]", ";", "DDS_BITS"),
    _around("cordic", "r_angle", "atan", ";", "A"),
    _around("pi", "{r_acc[A-1], r_acc}", "{ki_e[A-1], ki_e}", ";", "(A + 1)"),
    _around("digital_sid", "{acc[24], acc}", "{{7{x[18]}}, x}", ";", "26", ACCS),
    _around("notch", "{x[23], x}", "{r_x2[23], r_x2}", ";", "25"),
])  # fmt: skip

BLUNDERS = (one_asynchronous, mid_scale, data_path, output_registered, falling, two_clocks, upward, overflow,
            zero_limit, misread, unsigned_constant, too_narrow, stuck_bit, wrong_bit, one_off, other_end, positions,
            gates, chains, threshold, knee, tens, quadratic, around)  # fmt: skip
