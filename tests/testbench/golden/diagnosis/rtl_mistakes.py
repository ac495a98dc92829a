"""Mistakes of engineers, translators and users of HLS, written into the reference Verilog by rules on its text.

The rules and their classes were written after the diagnosis was frozen, from docs/diagnosis.md and the RTL alone, by
someone who had not read its code. A fault is as in `rtl_faults`; its cause is "" for what is in no class.
"""

import itertools
import re

from tests.testbench.golden.diagnosis.rtl_faults import Fault
from tests.testbench.golden.diagnosis.rtl_slips import arms, decided, fault, ifs, places, words

BUS = r"\{\{([^{}]+)\{(\w+)\[([^\]]+)\]\}\}, \2(?=[,}])|\{(\w+)\[([^\]]+)\], \4(?=[,}])"
FSM = "state timer attempts lost failed"  # of `sequencer`: what its next state drives
LOOPS = ("agc", "frequency_tracker", "rate_loop", "quadrature_loop")


def parameter(d, at):
    """Whether a place is in the declaration of a constant."""
    return re.search(r"localparam[^;]*$", d.text[:at]) is not None


def reached(d, at):
    """Registers that a place drives; of an instance of `pi` those that take its error or its preset."""
    found = places(d, at)
    return found - {"*"} | {"loop_prop", "loop_acc"} if d.stem in LOOPS and "*" in found else found


def swaps(d, kind, cause, pattern, new):
    """Faults by a pattern outside of constants; `new` is a function of the hit."""
    out = []
    for m in re.finditer(pattern, d.text):
        put, registers = new(m), reached(d, m.start())
        if put is not None and put != m[0] and registers and not parameter(d, m.start()):
            out.append(fault(d, kind, cause, m.span(), put, registers))
    return out


def edits(kind, rows):
    """Rule of a list of edits: (stem, cause, old, new, registers); the registers "" are those that the text drives."""

    def rule(d):
        out = []
        for stem, cause, old, new, registers in rows:
            if stem == d.stem:
                assert d.text.count(old) == 1, (stem, old)
                at = d.text.index(old)
                driven = set(registers.split()) or reached(d, at)
                out.append(fault(d, kind, cause, (at, at + len(old)), new, driven))
        return out

    return rule


# ---- registers and strobes -----------------------------------------------------------------------------------------


def left_sides(d):
    """Two registers of a branch exchanged; what they take reads the same registers, or those of their channel."""
    out = []
    for a, b in itertools.combinations(d.loads, 2):
        plain = d.ports[a[1]][1:] == d.ports[b[1]][1:] and d.width(a[1]) and a[2] != b[2] and d.together(a, b)
        if not plain or re.search(r"'[bdh]\d+$|\b(x_|next_)", a[2] + b[2]):
            continue
        of, to = a[1][-2:], b[1][-2:]
        twin = re.fullmatch(r"_\d", of) and re.sub(rf"{of}\b", to, a[2]) == b[2]
        read = [set(re.findall(r"\br_\w+", m[2])) for m in (a, b)]
        if twin or (read[0] == read[1] and not read[0] & {a[1], b[1]}):
            text = d.edited(b.start(1), b.end(1), a[1])
            text = text[: a.start(1)] + b[1] + text[a.end(1) :]
            both = tuple(sorted((d.plain(a[1]), d.plain(b[1]))))
            out.append(Fault("left sides exchanged", "operand", d.stem, text, both, f"{a[1]} with {b[1]}"))
    return out


def labels(d):
    """Labels of two neighbours of a case exchanged: each number is off by one."""
    out, found = [], list(arms(d)) if d.stem in ("registers", "spi_adc") else []
    for (a, _, first), (b, _, second) in itertools.pairwise(found):
        one, two = d.text[slice(*a)], d.text[slice(*b)]
        text = d.edited(*b, one)
        text = text[: a[0]] + two + text[a[1] :]
        both = tuple(sorted((first | second) - {"channels_7"}))
        out.append(Fault("labels exchanged", "comparison", d.stem, text, both, f"{one} with {two}"))
    return out


def strobed(d, kind, cause, put, but=()):
    """Another condition of a branch whose condition is one input: `was` is this input a clock before."""
    out = []
    for _, span, body in ifs(d):
        name = d.text[slice(*span)]
        if d.ports.get(name, ("", 0, None))[::2] == ("input", "") and span[0] > d.always and (d.stem, name) not in but:
            text = d.edited(*span, put.format(name))
            kept = f"reg was;\n    always @(posedge clk) was <= rst ? 1'b0 : {name};\n\n    "
            text = text[: d.always] + kept + text[d.always :]
            registers = tuple(sorted(decided(d, body)))
            out.append(Fault(kind, cause, d.stem, text, registers, f"if ({name}) -> if ({put.format(name)})"))
    return out


def edge(d):
    return strobed(d, "edge of a strobe for its level", "condition", "{} && !was")


def strobe_late(d):
    """Not within the branch of another strobe, which a late one may miss: that is a condition."""
    inner = (("digital_sid", "dump"), ("frequency_tracker", "load"), ("frequency_tracker", "adjust"))
    return strobed(d, "strobe a clock late", "late", "was", inner)


def initial(d):
    """A value at power-up in the place of a reset, where the reset has a branch of its own."""
    out = []
    for m in d.resets:
        branch = d.text[d.text.rfind("if (", 0, m.start()) : m.start()]
        if branch.startswith("if (rst) begin\n"):
            text = d.edited(*m.span(), "")
            text = f"{text[: d.always]}initial {m[1]} = {m[2]};\n    {text[d.always :]}"
            out.append(Fault("initial value for a reset", "no_reset", d.stem, text, (d.plain(m[1]),), m[0]))
    return out


# ---- counts and constants ------------------------------------------------------------------------------------------


def backwards(d):
    other = {"+": "-", "-": "+"}
    pattern = r"(?<=[\w}]) ([+-]) (?=(?:\d+'d1|1'b1|ONE)\b)"
    return swaps(d, "counts the other way", "sign", pattern, lambda m: f" {other[m[1]]} ")


def from_one(d):
    """A count starts with one more. The reset is as it was."""
    kind, cause, out = "starts with one more", "constant", []
    for m in d.loads:
        count = d.width(m[1]) and m[1] not in ("r_stage", "r_word", "r_prop")
        if count and re.fullmatch(r"\d+'s?d[01]|\{\w+\{1'b0\}\}|NO_\w+|bits|lead", m[2]):
            out.append(fault(d, kind, cause, m.span(2), f"{m[2]} + 1'b1", reached(d, m.start())))
    pattern = r"(\b(?:rests|bad|symptom|rewind|last) \? \d+'d|\{is_locked, 12'd)0\b"
    return out + swaps(d, kind, cause, pattern, lambda m: f"{m[1]}1")


# ---- arithmetic ----------------------------------------------------------------------------------------------------


def _twice(stem, total, half, shift):
    """Edit of a sum with its rounding constant: it is rounded to one bit more first, and then again."""
    new = f"(((({total} + ({half} >>> 1)) >>> ({shift})) + 1) <<< ({shift}))"
    return stem, "rounding", f"{total} + {half}", new, ""


rounded_twice = edits("rounded twice", [
    ("modulator", "rounding", "(wide_product + HALF) >>> shift",
     "(((wide_product + (HALF >>> 1)) >>> (shift - 6'd1)) + 1) >>> 1", ""),
    _twice("pi", "{{2{r_prop[A-1]}}, r_prop} + {{2{r_acc[A-1]}}, r_acc}", "HALF_Y", "F - 1"),
    _twice("notch", "r_y1", "34'sd512", "9"),
    _twice("notch", "wide_g * wide_ends + wide_c * wide_behind - wide_d * wide_y2", "59'sd2097152", "21"),
    _twice("rate_output", "square_t * square_t", "32'sd16384", "14"),
    _twice("rate_output", "wide_scale + wide_scale_t1 * scale_t + wide_scale_t2 * scale_square", "44'sd2048", "11"),
    _twice("rate_output", "{{4{r_word[23]}}, r_word, 24'd0} - {{2{r_bias[49]}}, r_bias}", "52'sd32768", "15"),
    _twice("rate_output", "wide_corrected * product_scale", "63'sd134217728", "27"),
    _twice("digital_sid", "ALPHA * difference", "63'sd524288", "19"),
    _twice("digital_sid", "gain * {{22{y[40]}}, y}", "63'sd4294967296", "32"),
    _twice("cordic", "r_x", "HALF_X", "G - 1"),
    _twice("cordic", "r_angle", "HALF_ANGLE", "G - 1"),
    _twice("sequencer", "$signed({36'd0, gain}) * {{24{rotation[35]}}, rotation}", "60'sd32768", "15"),
    _twice("sine", "scaled + {{SINE_ADDRESS_BITS{1'b0}}, r_product}", "HALF", "DROPPED - 1"),
])  # fmt: skip


def operands(d, kind, cause, put):
    """Another text of an operand that is widened by its sign; `put` is a function of copies, name and top bit."""
    return swaps(d, kind, cause, BUS, lambda m: put(m[1] or "1", m[2] or m[4], m[3] or m[5]))


def low_part(d):
    return operands(d, "operand without its low bits", "width",
                    lambda n, x, top: f"{{{{{n}{{{x}[{top}]}}}}, {x}[{top}:2], 2'b00")  # fmt: skip


def high_part(d):
    return operands(d, "operand a bit too narrow", "width",
                    lambda n, x, top: f"{{{{{n}+1{{{x}[{top}-1]}}}}, {x}[{top}-1:0]")  # fmt: skip


def sign_for_zero(d):
    """An unsigned operand that is widened by its top bit."""

    def put(m):
        declared = re.search(rf"(?:input|output|wire)\b[^;,=()]*\[([^\]:]+):0\]\s*{m[2]}\b", d.text)
        return f"{{{{{m[1]}{{{m[2]}[{declared[1]}]}}}}, {m[2]}}}" if declared else None

    return swaps(d, "unsigned operand widened by its top bit", "signedness", r"\{(\d+)'[bd]0+, (\w+)\}", put)


factors = edits("factors of another product", [(*row[:1], "operand", *row[1:], "") for row in (
    ("rate_output", "wide_bias_t1 * bias_t + wide_bias_t2 * bias_square",
     "wide_bias_t1 * bias_square + wide_bias_t2 * bias_t"),
    ("rate_output", "wide_scale_t1 * scale_t + wide_scale_t2 * scale_square",
     "wide_scale_t1 * scale_square + wide_scale_t2 * scale_t"),
    ("rate_output", "wide_bias_t2 * bias_square", "wide_bias_t2 * bias_t"),
    ("rate_output", "wide_scale_t1 * scale_t ", "wide_scale_t1 * scale_square "),
    ("notch", "wide_g * wide_ends + wide_c * wide_behind", "wide_c * wide_ends + wide_g * wide_behind"),
    ("notch", "wide_c * wide_behind - wide_d * wide_y2", "wide_d * wide_behind - wide_c * wide_y2"),
    ("notch", "wide_g * wide_ends + wide_c * wide_behind - wide_d * wide_y2",
     "wide_d * wide_ends + wide_c * wide_behind - wide_g * wide_y2"),
    ("pi", "(KP * wide_e", "(KI * wide_e"),
    ("pi", "(KI * wide_e", "(KP * wide_e"),
    ("modulator", "wide_amplitude * wide_sine", "wide_amplitude * wide_amplitude"),
    ("modulator", "wide_amplitude * wide_sine", "wide_sine * wide_sine"),
)])  # fmt: skip


def point(d):
    """An operand of a sum stands one bit too high or too low."""
    kind, cause = "binary point one bit off", "gain"
    zeros = r"\{\{(\d+)\{(\w+\[\d+\])\}\}, (\w+), (\d+)'d0\}"
    out = []
    for step in (-1, 1):

        def put(m, step=step):
            return f"{{{{{int(m[1]) + step}{{{m[2]}}}}}, {m[3]}, {int(m[4]) - step}'d0}}"

        out += swaps(d, kind, cause, zeros, put)
    out += swaps(d, kind, cause, r"\{(r_acc_\d), 16'd0\}", lambda m: f"{{{m[1]}[23:0], 17'd0}}")
    out += swaps(d, kind, cause, r"\{(r_acc_\d), 16'd0\}", lambda m: f"{{{m[1]}[24], {m[1]}, 15'd0}}")
    return out + aligned(d)


aligned = edits("binary point one bit off", [(*row[:1], "gain", *row[1:]) for row in (
    ("notch", "{r_x1[23], r_x1, 10'd0}", "{r_x1, 11'd0}", ""),
    ("notch", "{r_x1[23], r_x1, 10'd0}", "{{2{r_x1[23]}}, r_x1, 9'd0}", ""),
    ("sine", "{1'b0, r_base2, {SINE_FRACTION_BITS{1'b0}}}", "{2'b00, r_base2, {SINE_FRACTION_BITS-1{1'b0}}}", ""),
    ("sine", "{{SINE_ADDRESS_BITS{1'b0}}, r_product}", "{{SINE_ADDRESS_BITS-1{1'b0}}, r_product, 1'b0}", ""),
    ("pi", ": {preset, {F{1'b0}}}", ": {preset[34:0], {F+1{1'b0}}}", ""),
    ("cordic", "turned_x <<< G", "turned_x <<< (G - 1)", ""),
    ("cordic", "turned_y <<< G", "turned_y <<< (G + 1)", ""),
    ("frequency_tracker", "{{12{r_loop_y[35]}}, r_loop_y}", "{{11{r_loop_y[35]}}, r_loop_y, 1'b0}", "word"),
    ("rate_loop", "{{12{preset[23]}}, preset}", "{{11{preset[23]}}, preset, 1'b0}", "loop_acc"),
    ("agc", "{{12{preset[23]}}, preset}", "{{11{preset[23]}}, preset, 1'b0}", "loop_acc"),
    ("quadrature_loop", "{4'd0, preset}", "{3'd0, preset, 1'b0}", "loop_acc"),
)])  # fmt: skip


# ---- choices and connections ---------------------------------------------------------------------------------------


def _arms(stem, test, a, b, registers="", cause="condition"):
    return stem, cause, f"{test} ? {a} : {b}", f"{test} ? {b} : {a}", registers


choices = edits("choice exchanged", [
    _arms("sine", "r_sign2", "-magnitude", "magnitude", "", "sign"),
    _arms("cordic", "x_in[23]", "-wide_x", "wide_x", "", "sign"),
    _arms("cordic", "x_in[23]", "-wide_y", "wide_y", "", "sign"),
    _arms("cordic", "r_y[W-1]", "x - across", "x + across", "", "sign"),
    _arms("cordic", "r_y[W-1]", "y + down", "y - down", "", "sign"),
    _arms("cordic", "r_y[W-1]", "r_angle - atan", "r_angle + atan", "", "sign"),
    _arms("cordic", "x_in[23]", "HALF_TURN", "{A{1'b0}}"),
    _arms("cordic", "(r_x == {W{1'b0}})", "24'sd0", "phase[A-1:G]"),
    _arms("isqrt", "fits", "less[16:0]", "pair[16:0]"),
    _arms("agc", "kicked", "kick", "r_loop_y[23:0]"),
    _arms("agc", "kicked", "36'sd0", "{{12{preset[23]}}, preset}", "loop_acc"),
    _arms("agc", "mode[2]", "HOLD", "mode[1:0]", "loop_prop loop_acc"),
    _arms("lock_monitor", "agc_error[25]", "-agc_error", "agc_error", "", "sign"),
    _arms("lock_monitor", "phase[23]", "-phase", "phase", "", "sign"),
    _arms("lock_monitor", "sense_sin[23]", "-sense_sin", "sense_sin", "", "sign"),
    _arms("lock_monitor", "sense_cos[23]", "-sense_cos", "sense_cos", "", "sign"),
    _arms("lock_monitor", "is_locked", "is_lost", "is_good"),
    _arms("lock_monitor", "is_locked", "frames_out", "frames_in"),
    _arms("sequencer", "correction[DDS_BITS-1]", "-correction", "correction", FSM, "sign"),
    _arms("sequencer", "found", "RETUNE", "KICK", FSM),
    _arms("sequencer", "sense_locked", "LOCKED", "BALANCE", FSM),
    _arms("sequencer", "r_control[HOLD_AGC]", "LOOP_HOLD", "LOOP_P_ONLY", "agc_mode"),
    _arms("sequencer", "(r_state == SEARCH && usable)", "r_rotation + {{12{turned[23]}}, turned}", "36'sd0"),
    _arms("sequencer", "(bad || r_control[HOLD_PLL])", "LOOP_HOLD", "LOOP_RUN", "pll_mode"),
    _arms("sequencer", "i_control[CLEAR_FAULTS]", "8'hFF", "i_clear", "faults_latch"),
    _arms("rate_output", "first", "38'sd0", "r_acc"),
    _arms("rate_output", "last", "6'd0", "count[5:0]"),
    _arms("registers", "taken", "8'h0", "r_fault_clear"),
    _arms("rates", "(r_frame == LAST_TICK[FRAME_BITS-1:0])", "NO_FRAME", "r_frame + 1'b1"),
    _arms("digital_sid", "positive", "wide", "-wide", "", "sign"),
    _arms("spi_dac", "r_sclk_en", "gap == 2'd0 && (r_left == 5'd1)", "r_lead == 2'd1 && r_left == 5'd0"),
])  # fmt: skip


def one_end(d):
    """Only one end of a saturation is left."""
    term = r"\((\w+) {} (?:\w*{}|{})\) \? [\w\[\]:]+\s*:\s*"
    low, high = term.format("<", "LO", "lo"), term.format(">", "HI", "hi")
    return swaps(d, "one end not clamped", "limit", f"{low}(?={high})", lambda m: "") + swaps(
        d, "one end not clamped", "limit", f"(?<=: ){high}|(?<=    ){high}", lambda m: ""
    )


def _pair(stem, cause, a, b, registers):
    """Two ports of an instance, each with what belongs to the other."""
    old = f".{a[0]}({a[1]}),{a[2]}.{b[0]}({b[1]})"
    return stem, cause, old, f".{a[0]}({b[1]}),{a[2]}.{b[0]}({a[1]})", registers


ports = edits("ports of an instance exchanged", [
    *(_pair(stem, "operand", ("kp", "loop_kp", " "), ("ki", "loop_ki"), "loop_prop loop_acc") for stem in LOOPS),
    *(_pair(stem, "limit", ("lo", "loop_lo", " "), ("hi", "loop_hi"), "loop_acc loop_y") for stem in LOOPS),
    _pair("sequencer", "operand", ("codes_0      ", "i_drive_sin", "\n        "), ("codes_1      ", "i_drive_cos"),
          "faults_codes_0 faults_codes_1"),
    _pair("sequencer", "operand", ("codes_2      ", "i_sense_sin", "\n        "), ("codes_3      ", "i_sense_cos"),
          "faults_codes_2 faults_codes_3"),
    _pair("sequencer", "condition", ("sense_sin", "i_sense_sin", "\n        "), ("sense_cos", "i_sense_cos"),
          "lock_locked lock_count_2 lock_count_3"),
    ("quadrature_loop", "operand", ".u(r_loop_y[31:0])", ".u(preset)", "root_radicand"),
])  # fmt: skip


def arguments(d):
    """Arguments of a call exchanged; those of `judge` are conditions, or what is compared in one."""
    kind = "arguments of a call exchanged"
    out = swaps(d, kind, "operand", r"filtered\((\w+), ([^()]+)\)", lambda m: f"filtered({m[2]}, {m[1]})")
    for pattern in (r"\b(enable\[\d\]), (judged\[\d\])(?=,)", r"\b(good\[\d\]), (lost\[\d\])(?=,)",
                    r"\b(frames_in_\d), (frames_out_\d)(?=\))"):  # fmt: skip
        out += swaps(d, kind, "condition", pattern, lambda m: f"{m[2]}, {m[1]}")
    return out


# ---- words ---------------------------------------------------------------------------------------------------------


def loaded(d, kind, cause, bits, put, signed=False):
    """Another text of a word that is loaded; `put` is a function of the load, the word and its width."""
    return [
        fault(d, kind, cause, m.span(2), put(m, x, width), {d.plain(m[1])})
        for m, x, width in words(d, bits)
        if d.ports[m[1]][1] or not signed
    ]


def neighbours(d):
    def put(m, x, width):
        return "{" + ", ".join(f"{x}[{k ^ 1}]" for k in reversed(range(width))) + "}"

    return loaded(d, "even and odd bits exchanged", "bit_swap", 2, put)


def offset_binary(d):
    return loaded(d, "offset binary", "sign", 1, lambda m, x, w: f"{m[2]} ^ {w}'d{1 << (w - 1)}", True)


# ---- in no class ---------------------------------------------------------------------------------------------------


def sign_magnitude(d):
    def put(m, x, w):
        return f"{x}[{w - 1}] ? {{1'b1, -{x}[{w - 2}:0]}} : {x}[{w - 1}:0]"

    return loaded(d, "sign and magnitude", "", 1, put, True)


def accumulated(d):
    return loaded(d, "+= for =", "", 1, lambda m, x, w: f"{m[1]} + {m[2]}")


term_missing = edits("term of a sum missing", [(*row[:1], "", *row[1:], "") for row in (
    ("dds", "r_phase + off_drive_sine", "r_phase"),
    ("dds", "r_phase + off_sense_sine", "off_sense_sine"),
    ("dds", "r_phase + off_drive_ref", "r_phase"),
    ("dds", "r_phase + off_sense_ref", "off_sense_ref"),
    ("pi", "{{2{r_prop[A-1]}}, r_prop} + {{2", "{{2"),
    ("pi", " + {{2{r_acc[A-1]}}, r_acc}", ""),
    ("notch", "{x[23], x} + ", ""),
    ("notch", " + {r_x2[23], r_x2}", ""),
    ("notch", " + wide_c * wide_behind", ""),
    ("notch", " - wide_d * wide_y2", ""),
    ("frequency_tracker", "r_centre + wide_y[DDS_BITS-1:0]", "r_centre"),
    ("agc", " - {1'b0, magnitude}", ""),
    ("sine", " + {{SINE_ADDRESS_BITS{1'b0}}, r_product}", ""),
    ("sequencer", "i_phase - r_last_phase", "i_phase"),
    ("rate_output", " + wide_bias_t1 * bias_t", ""),
    ("rate_output", " + wide_scale_t2 * scale_square", ""),
    ("rate_output", " - {{2{r_bias[49]}}, r_bias}", ""),
)])  # fmt: skip

precedence = edits("shift before the sum", [(*row[:1], "", *row[1:], "") for row in (
    ("modulator", "(wide_product + HALF) >>> shift", "wide_product + (HALF >>> shift)"),
    ("cordic", "(y + half) >>> r_i", "y + (half >>> r_i)"),
    ("cordic", "(x + half) >>> r_i", "x + (half >>> r_i)"),
    ("rate_output", "(wide_acc + half) >>> k", "wide_acc + (half >>> k)"),
)])  # fmt: skip

MISTAKES = (left_sides, labels, edge, strobe_late, initial, backwards, from_one, rounded_twice, low_part, high_part,
            sign_for_zero, factors, point, choices, one_end, ports, arguments, neighbours, offset_binary,
            sign_magnitude, accumulated, term_missing, precedence)  # fmt: skip
