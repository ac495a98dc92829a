"""Misreadings of a specification, slips of translators and of users of HLS, by rules on the text of the Verilog.

The rules and their classes were written from docs/diagnosis.md and the RTL alone, by someone who had not read the code
of the diagnosis. A fault is as in `rtl_faults`; its cause is "" for what is in no class.
"""

import re

from tests.testbench.golden.diagnosis.rtl_faults import Fault
from tests.testbench.golden.diagnosis.rtl_mistakes import FSM, LOOPS, edits, loaded, parameter, reached, swaps
from tests.testbench.golden.diagnosis.rtl_slips import decided, fault, ifs

POLES = " ".join(f"pole{stage}_{channel}" for stage in (1, 2, 3) for channel in range(4))
ACCS = "acc_0 acc_1 acc_2 acc_3"
CHANNELS = " ".join(f"channels_{k}" for k in range(8))
LOCKS = "locked count_0 count_1 count_2 count_3"
SEQUENCED = " ".join(f"lock_{name}" for name in LOCKS.split())
FRAMES = "bad_frames good_frames"
WATCHED = f"codes_0 codes_1 codes_2 codes_3 over_range stuck drive rate rail {FRAMES} flags latch"
FAULTS = " ".join(f"faults_{name}" for name in WATCHED.split())
COUNTED = " ".join(f"faults_{name}" for name in WATCHED.split()[4:])
ROOT = "root_radicand root_root root_remainder root_i root_busy root_done root_y"


def enabled(d, m):
    """Whether a load stands in a branch that is not taken at every clock."""
    lines = d.text[d.always : m.start()].splitlines()
    indent = [len(n) - len(n.lstrip()) for n in lines]
    k = max(k for k in range(len(lines) - 1) if lines[k].strip() and indent[k] < indent[-1])
    other = any(indent[j] == indent[k] and "else if" in lines[j] for j in range(k))
    return other or lines[k].strip() != "end else begin"


def single(d):
    """Loads of registers that have one load."""
    names = [m[1] for m in d.loads]
    return [m for m in d.loads if names.count(m[1]) == 1 and m.start() > d.always]


def reset_of(d, m):
    return next(r for r in d.resets if r[1] == m[1])


def before(d, text, kept):
    """A text with lines ahead of its first clocked block."""
    at = text.index("always @(posedge clk)")
    return f"{text[:at]}{kept}\n    {text[at:]}"


# ---- strobes, enables and resets -----------------------------------------------------------------------------------


def cleared(d):
    """A register has its reset value where it should hold: one branch more, which loads what the reset does."""
    out = []
    for _, span, body in ifs(d):
        start, end = body
        if d.stem == "delay" or span[0] < d.always or re.match(r"\s*else\b", d.text[end:]):
            continue
        for m in single(d):
            inside = d.text[start : m.start()]
            direct = inside.count("begin") - len(re.findall(r"\bend\b", inside)) == inside.lstrip().startswith("begin")
            if start < m.start() < end and direct and not re.search(r"(\)|else)\s*$", inside.strip()):
                put = f" else {m[1]} <= {reset_of(d, m)[2]};"
                f = fault(d, "cleared where it holds", "condition", (end, end), put, {d.plain(m[1])})
                out.append(f._replace(edit=f"if ({d.text[slice(*span)]}){put}"))
    return out


def every_second(d):
    """A branch is taken at every second strobe: it has one condition more."""
    out = []
    for _, span, body in ifs(d):
        name = d.text[slice(*span)]
        if d.ports.get(name, ("", 0, None))[::2] == ("input", "") and span[0] > d.always:
            kept = f"reg odd;\n    always @(posedge clk) odd <= rst ? 1'b0 : odd ^ {name};\n"
            text = before(d, d.edited(*span, f"{name} && odd"), kept)
            registers = tuple(sorted(decided(d, body)))
            out.append(Fault("every second strobe", "condition", d.stem, text, registers, f"if ({name} && odd)"))
    return out


busy = edits("start ignored while busy", [(*row[:1], "condition", *row[1:]) for row in (
    ("isqrt", "else if (start)", "else if (start && !r_busy)", "radicand root remainder i busy done y"),
    ("cordic", "else if (start)", "else if (start && !r_busy)", "x y angle i busy done magnitude phase"),
    ("spi_dac", "else if (load)", "else if (load && r_sync_n)", "shift left lead sync_n sclk_en ldac_n ldac_wait"),
    ("rates", "if (go)", "if (go && r_slot == 6'd0)", "slot"),
    ("rate_output", "if (en) begin", "if (en && r_stage == 5'd0) begin", "word t"),
    ("digital_sid", "if (dump)", "if (dump && r_stage == 2'd0)", f"{ACCS} pole1_0 pole1_1 pole1_2 pole1_3 stage"),
)])  # fmt: skip


def enable_before(d):
    """One operand of several is that of the enable before."""
    out, known = [], {m[1] for m in d.wires} | set(d.ports)
    for m in single(d):
        names = {n for n in re.findall(r"\b[a-z]\w*", m[2]) if n in known and n != m[1]}
        reset = reset_of(d, m)
        if not enabled(d, m) or len(names | ({m[1]} if m[1] in m[2] else set())) < 2:
            continue
        for name in sorted(names):
            head = re.search(rf"(?:wire|reg|input|output)\b[^;,()=]*\b{name}\b", d.text)
            width = head and re.search(r"\[[^\]]+\]", head[0])
            if width:
                kept = f"reg {'signed' if 'signed' in head[0] else ''} {width[0]} was;\n"
                put = re.sub(rf"\b{name}\b", "was", m[2])
                text = d.edited(*m.span(), f"begin was <= {name}; {m[1]} <= {put}; end")
                text = f"{text[: reset.start()]}begin was <= 0; {reset[0]} end{text[reset.end() :]}"
                edit = f"{m[1]}: {name} of the enable before"
                out.append(Fault("operand of the enable before", "late", d.stem, before(d, text, kept),
                                 (d.plain(m[1]),), edit))  # fmt: skip
    return out


def reset_late(d):
    text = d.text[: d.always] + re.sub(r"if \(rst\b", "if (held", d.text[d.always :])
    kept = "reg held = 1'b1;\n    always @(posedge clk) held <= rst;\n"
    registers = tuple(sorted({d.plain(m[1]) for m in d.resets}))
    return [Fault("reset a clock late", "late", d.stem, before(d, text, kept), registers, "rst a clock late")]


def combinational(d):
    """A register that should load at every clock is a net: its new value is seen in the place of the old one."""
    out = []
    for m in single(d):
        if not enabled(d, m) and m[1] not in m[2]:
            reset = reset_of(d, m)
            text = d.edited(*m.span(), "")
            text = text[: reset.start()] + text[reset.end() :]
            text = before(d, text, f"always @* {m[1]} = rst ? {reset[2]} : {m[2]};\n")
            out.append(Fault("net in the place of a register", "early", d.stem, text, (d.plain(m[1]),), m[0]))
    return out


tied = edits("pin of an instance tied", [(row[0], row[3], *row[1:3], row[4]) for row in (
    *((stem, ".rst(rst), .en(en_pi)", ".rst(1'b0), .en(en_pi)", "no_reset", "loop_prop loop_acc loop_y")
      for stem in LOOPS),
    *((stem, ".en(en_pi)", ".en(1'b1)", "condition", "loop_prop loop_acc") for stem in LOOPS),
    ("quadrature_loop", ".start(en_root)", ".start(1'b1)", "condition", ROOT),
    ("quadrature_loop", ".rst(rst), .start", ".rst(1'b0), .start", "no_reset", ROOT),
    ("sequencer", ".en       (en && (usable || r_state < SETTLE))", ".en(1'b1)", "condition", SEQUENCED),
    ("sequencer", ".judged   (judged)", ".judged(4'hF)", "condition", SEQUENCED),
    ("sequencer", ".rail     (i_qsc_rail)", ".rail(1'b0)", "condition", "lock_locked lock_count_3"),
    ("sequencer", ".enable   ({{2{r_state >= BALANCE}}, {2{r_state >= SETTLE}}})", ".enable(4'hF)", "condition",
          SEQUENCED),
    ("sequencer", ".en           (en)", ".en(1'b1)", "condition", FAULTS),
    ("sequencer", ".armed        (r_state > INIT)", ".armed(1'b1)", "condition", FAULTS),
    ("sequencer", ".watch_stuck  (r_state >= SEARCH || (r_state == STANDBY && r_faults_flags[STUCK]))",
          ".watch_stuck(1'b1)", "condition", COUNTED),
    ("sequencer", ".rst      (rst)", ".rst(1'b0)", "no_reset", SEQUENCED),
    ("sequencer", ".rst          (rst)", ".rst(1'b0)", "no_reset", FAULTS),
)])  # fmt: skip


# ---- inputs --------------------------------------------------------------------------------------------------------

EXCHANGED = (
    ("dds", "off_drive_sine", "off_sense_sine", "operand", "drive_sine sense_sine"),
    ("dds", "off_drive_ref", "off_sense_ref", "operand", "drive_ref sense_ref"),
    ("dds", "off_drive_sine", "off_drive_ref", "operand", "drive_sine drive_ref"),
    ("dds", "word", "off_sense_ref", "operand", "phase sense_ref"),
    ("spi_adc", "drdy_n", "dout", "operand", f"meta shift status {CHANNELS}"),
    ("rate_output", "bias", "bias_t1", "operand", "bias"),
    ("rate_output", "bias", "bias_t2", "operand", "bias"),
    ("modulator", "en_product", "en_code", "condition", "product code held1 held2"),
    ("frequency_tracker", "load", "adjust", "condition", "centre"),
    ("frequency_tracker", "en", "en_pi", "condition", "error centre loop_prop loop_acc"),
    ("agc", "en", "en_pi", "condition", "error loop_prop loop_acc"),
    ("rate_loop", "en", "en_pi", "condition", "error loop_prop loop_acc"),
    ("quadrature_loop", "en", "en_pi", "condition", "error loop_prop loop_acc"),
    ("quadrature_loop", "en_pi", "en_root", "condition", f"loop_prop loop_acc {ROOT}"),
    ("watchdog", "ce_1m", "frame", "condition", "age stale"),
    ("fault_monitor", "i_drive", "i_rate", "condition", "drive rate flags latch"),
    ("fault_monitor", "i_rate", "i_rail", "condition", "rate rail flags latch"),
    ("lock_monitor", "phase", "sense_sin", "condition", "locked count_1 count_2"),
    ("lock_monitor", "sense_sin", "sense_cos", "condition", "locked count_2 count_3"),
    ("lock_monitor", "enable", "judged", "condition", LOCKS),
    ("sequencer", "i_drive_saturated", "i_rate_saturated", "condition",
     "faults_drive faults_rate faults_flags faults_latch"),
)  # fmt: skip


def inputs(d):
    """Two inputs exchanged everywhere in a block."""
    out, head = [], d.text.index("\n);")
    for stem, a, b, cause, registers in EXCHANGED:
        if stem == d.stem:
            other = {a: b, b: a}
            body = re.sub(rf"(?<!\.)\b({a}|{b})\b", lambda m, other=other: other[m[1]], d.text[head:])
            text, registers = d.text[:head] + body, tuple(sorted(registers.split()))
            out.append(Fault("inputs exchanged", cause, stem, text, registers, f"{a} with {b}"))
    return out


# ---- arithmetic ----------------------------------------------------------------------------------------------------


def c_int(d):
    """A sum or product of more than 32 bits has the low 32 bits, with their sign."""
    out, found = [], set(FSM.split()) if d.stem == "sequencer" else set()
    for m in re.finditer(
        r"(?:wire signed \[(\d+):0\] \w+|    (?:product|difference)) = ([^;?]+ [-+*] [^;?]+);", d.text
    ):
        width = int(m[1] or 62) + 1  # those of the functions of `digital_sid` have 63 bits
        if width > 32:
            put = f"($signed({m[2]}) <<< {width - 32}) >>> {width - 32}"
            out.append(fault(d, "intermediate of 32 bits", "width", m.span(2), put, reached(d, m.start(2)) | found))
    if d.stem == "modulator":
        old = "wide_amplitude * wide_sine"
        span = (d.text.index(old), d.text.index(old) + len(old))
        put = f"($signed({old}) <<< (PRODUCT - 32)) >>> (PRODUCT - 32)"
        out.append(fault(d, "intermediate of 32 bits", "width", span, put, {"product"}))
    return out


def _clamped(stem, width, a, op, b, before_, behind, registers=""):
    """Edit of a sum that should wrap: it is clamped at the limits of its signed width."""
    wide = f"({{{a}[{width}-1], {a}}} {op} {{{b}[{width}-1], {b}}})"
    top = f"(({wide} >> {width}) & 1)"
    clamped = f"(({top} != (({wide} >> ({width}-1)) & 1)) ? {{{top} == 1, {{{width}-1{{{top} == 0}}}}}} : {a} {op} {b})"
    return stem, "saturate", f"{before_}{a} {op} {b}{behind}", f"{before_}{clamped}{behind}", registers


OFFSETS = ("off_drive_sine", "off_sense_sine", "off_drive_ref", "off_sense_ref")
angles = edits("angle clamped at half a turn", [
    _clamped("dds", "DDS_BITS", "r_phase", "+", "word", "", ";"),
    *(_clamped("dds", "DDS_BITS", "r_phase", "+", offset, "", ";") for offset in OFFSETS),
    _clamped("frequency_tracker", "DDS_BITS", "r_centre", "+", "correction", "", ";"),
    _clamped("sequencer", "24", "i_phase", "-", "r_last_phase", "", ";", f"rotation correction {FSM}"),
    _clamped("cordic", "A", "r_angle", "-", "atan", "? ", " :"),
    _clamped("cordic", "A", "r_angle", "+", "atan", ": ", ";"),
    _clamped("cordic", "A", "r_angle", "+", "HALF_ANGLE", "", ";", "phase"),
])  # fmt: skip


def unsigned_comparison(d):
    """A signed value is compared by way of a concatenation, which is unsigned."""

    def put(m):
        known = (d.ports.get(n, ("", re.search(rf"\bsigned\b[^;()]*?\b{n}\b", d.text)))[1] for n in (m[1], m[3]))
        return f"({{{m[1]}}} {m[2]} {m[3]})" if all(known) else None

    return swaps(d, "compared as a concatenation", "signedness", r"\((\w+) (<|>|<=|>=) ([A-Za-z]\w+)\)", put)


shifts = edits("shift amount one off", [(*row[:1], "gain", *row[1:], "") for row in (
    ("cordic", "(y + half) >>> r_i", "(y + half) >>> (r_i + 6'd1)"),
    ("cordic", "(x + half) >>> r_i", "(x + half) >>> (r_i + 6'd1)"),
    ("modulator", "(wide_product + HALF) >>> shift", "(wide_product + HALF) >>> (shift - 6'd1)"),
    ("modulator", "(wide_product + HALF) >>> shift", "(wide_product + HALF) >>> (shift + 6'd1)"),
    ("rate_output", "(wide_acc + half) >>> k", "(wide_acc + half) >>> (k + 4'd1)"),
    ("pi", "(KP * wide_e + HALF_PRODUCT) >>> DROPPED", "(KP * wide_e + HALF_PRODUCT) >>> (DROPPED + 1)"),
    ("pi", "(KI * wide_e + HALF_PRODUCT) >>> DROPPED", "(KI * wide_e + HALF_PRODUCT) >>> (DROPPED + 1)"),
    ("notch", "{g[22:0], 1'b0}", "g"),
    ("isqrt", "{r_radicand[29:0], 2'b00}", "{r_radicand[30:0], 1'b0}"),
)])  # fmt: skip


def _number(stem, old, registers, one="1"):
    """Edits of a coefficient: one LSB more, one less."""
    return [(stem, "constant", old, f"{old} {sign} {one}", registers) for sign in "+-"]


numbers = edits("coefficient one LSB off", [
    *_number("pi", "KP = {{26{kp[33]}}, kp}", "prop"),
    *_number("pi", "KI = {{26{ki[33]}}, ki}", "acc"),
    *_number("digital_sid", "ALPHA = {43'd0, alpha}", POLES),
    *_number("digital_sid", "GAIN_X = {42'd0, gain_x}", "codes_0 codes_1"),
    *_number("digital_sid", "GAIN_Y = {42'd0, gain_y}", "codes_2 codes_3"),
    *_number("notch", "wide_g = {{35{g[23]}}, g}", "y1"),
    *_number("notch", "wide_c = {{35{c[23]}}, c}", "y1"),
    *_number("notch", "24'sd4194304", "y1"),
    *_number("sequencer", "{36'd0, gain}", f"correction {FSM}", "60'd1"),
    *_number("agc", "kicked ? kick", "amplitude", "24'sd1"),
    *(row for stem in LOOPS for row in _number(stem, ".kp(loop_kp", "loop_prop", "34'sd1")),
    *(row for stem in LOOPS for row in _number(stem, ".ki(loop_ki", "loop_acc", "34'sd1")),
])  # fmt: skip


def _even(stem, total, half, shift, registers=""):
    """Edit of a sum with its rounding constant: one less, and the bit that rounding leaves lowest."""
    return stem, "rounding", f"{total} + {half}", f"{total} + {half} - 1 + ((({total}) >>> ({shift})) & 1)", registers


to_even = edits("ties to even", [
    ("modulator", "rounding", "(wide_product + HALF)",
     "(wide_product + HALF - 1 + ((wide_product >>> shift) & 1))", ""),
    ("rate_output", "rounding", "(wide_acc + half)",
     "(wide_acc + half + ((k == 3'd0) ? 39'sd0 : ((wide_acc >>> k) & 39'sd1) - 39'sd1))", ""),
    _even("pi", "{{2{r_prop[A-1]}}, r_prop} + {{2{r_acc[A-1]}}, r_acc}", "HALF_Y", "F"),
    _even("notch", "r_y1", "34'sd512", "10"),
    _even("notch", "wide_g * wide_ends + wide_c * wide_behind - wide_d * wide_y2", "59'sd2097152", "22"),
    _even("rate_output", "square_t * square_t", "32'sd16384", "15"),
    _even("rate_output", "wide_scale + wide_scale_t1 * scale_t + wide_scale_t2 * scale_square", "44'sd2048", "12"),
    _even("rate_output", "{{4{r_word[23]}}, r_word, 24'd0} - {{2{r_bias[49]}}, r_bias}", "52'sd32768", "16"),
    _even("rate_output", "wide_corrected * product_scale", "63'sd134217728", "28"),
    _even("digital_sid", "ALPHA * difference", "63'sd524288", "20"),
    _even("digital_sid", "gain * {{22{y[40]}}, y}", "63'sd4294967296", "33"),
    _even("cordic", "r_x", "HALF_X", "G"),
    _even("cordic", "r_angle", "HALF_ANGLE", "G", "phase"),
    _even("sequencer", "$signed({36'd0, gain}) * {{24{rotation[35]}}, rotation}", "60'sd32768", "16",
          f"correction {FSM}"),
    _even("sine", "scaled + {{SINE_ADDRESS_BITS{1'b0}}, r_product}", "HALF", "DROPPED"),
])  # fmt: skip


# ---- bits ----------------------------------------------------------------------------------------------------------


def _bit(stem, entry, registers, ways="01"):
    """Edits of a list of bits: one is constant. The lowest and the highest are not 0: that could be `width`."""
    old = entry if isinstance(entry, str) else entry[0]
    name = old if isinstance(entry, str) else entry[1]
    return [(stem, "stuck", old, old.replace(name, f"1'b{way}"), registers) for way in ways]


bits = edits("bit of a list tied", [
    *(row for name in ("rail", "rate", "drive")
      for row in _bit("fault_monitor", f"reached(next_{name}, {name})", "flags latch")),
    *_bit("fault_monitor", "reached(next_over_range, over_range)", "flags latch", "1"),
    *_bit("references", ("{~(sense_ref[DDS_BITS-1] ^ sense_ref[DDS_BITS-2])",
                         "~(sense_ref[DDS_BITS-1] ^ sense_ref[DDS_BITS-2])"), "signs", "1"),
    *_bit("references", (", ~sense_ref[DDS_BITS-1],", "~sense_ref[DDS_BITS-1]"), "signs"),
    *_bit("references", "~(drive_ref[DDS_BITS-1] ^ drive_ref[DDS_BITS-2])", "signs"),
    *_bit("references", (", ~drive_ref[DDS_BITS-1]}", "~drive_ref[DDS_BITS-1]"), "signs", "1"),
    *_bit("lock_monitor", "next_3[12]", "locked", "1"),
    *_bit("lock_monitor", "next_2[12]", "locked"),
    *_bit("lock_monitor", "next_1[12]", "locked"),
    *_bit("lock_monitor", "next_0[12]", "locked", "1"),
    *_bit("sequencer", ("{r_failed, 5'd0", "r_failed"), "faults_flags faults_latch", "1"),
    *_bit("sequencer", ("5'd0, r_lost", "r_lost"), "faults_flags faults_latch"),
    *_bit("rate_output", ("{r_stage[3:0], en}", "en"), "stage", "1"),
    *_bit("isqrt", ("{r_root[14:0], fits}", "fits"), "root y", "1"),
    *_bit("spi_adc", ("{23'd0, dout}", "dout"), f"shift status {CHANNELS}", "1"),
])  # fmt: skip

minus_for_not = edits("minus for not", [
    ("sine", "complement", "? ~kept", "? -kept", ""),
    ("fault_monitor", "complement", "& ~clear", "& -clear", ""),
    ("spi_adc", "complement", "r_count & ~LOW", "r_count & -LOW", "count"),
])  # fmt: skip


# ---- in no class ---------------------------------------------------------------------------------------------------


def rotated(d):
    return loaded(d, "rotated by four bits", "", 4, lambda m, x, w: f"{{{x}[3:0], {x}[{w - 1}:4]}}")


def parity(d):
    return loaded(d, "parity in the top bit", "", 1, lambda m, x, w: f"{{^{x}[{w - 2}:0], {x}[{w - 2}:0]}}")


def half_precision(d):
    """A signed word keeps its eleven highest bits that are not copies of the sign."""

    def put(m, x, w):
        word = f"$signed({x}[{w - 1}:0])"
        kept = (f"{x}[{k}] & (({word} >>> {k + 11}) == ({word} >>> {w - 1}))" for k in reversed(range(w - 12)))
        return f"{{{x}[{w - 1}:{w - 12}], {', '.join(kept)}}}"

    return loaded(d, "half precision", "", 1, put, True)


leaky = edits("leaky accumulator", [(*row[:1], "", *row[1:]) for row in (
    ("dds", "r_phase + word", "r_phase - (r_phase >> 5) + word", ""),
    ("pi", "next_acc = {r_acc[A-1], r_acc} +",
     "next_acc = {r_acc[A-1], r_acc} - {{6{r_acc[A-1]}}, r_acc[A-1:5]} +", "acc"),
    ("digital_sid", "sum = {acc[24], acc} +", "sum = {acc[24], acc} - {{6{acc[24]}}, acc[24:5]} +", ACCS),
    ("digital_sid", "filtered = y +", "filtered = y - {{5{y[40]}}, y[40:5]} +", POLES),
    ("rate_output", "38'sd0 : r_acc) +", "38'sd0 : r_acc - {{5{r_acc[37]}}, r_acc[37:5]}) +", ""),
    ("sequencer", "? r_rotation + {", "? r_rotation - {{5{r_rotation[35]}}, r_rotation[35:5]} + {",
     f"rotation correction {FSM}"),
    ("frequency_tracker", "r_centre + correction", "r_centre - (r_centre >> 5) + correction", ""),
    ("cordic", "r_angle - atan : r_angle + atan",
     "r_angle - (r_angle >>> 5) - atan : r_angle - (r_angle >>> 5) + atan", ""),
)])  # fmt: skip


def partial(d):
    """A product without that of the low 17 bits of its factors."""
    out = []
    for m in re.finditer(r"\b([A-Za-z]\w+) \* (\w+)\b", d.text):
        if m.start() > d.text.index("\n);") and not parameter(d, m.start()) and reached(d, m.start()):
            put = f"({m[0]} - ({m[1]} & 'sd131071) * ({m[2]} & 'sd131071))"
            out.append(fault(d, "partial product lost", "", m.span(), put, reached(d, m.start())))
    return out


MISREADINGS = (inputs, cleared, every_second, busy, enable_before, reset_late, combinational, tied, c_int, angles,
               unsigned_comparison, shifts, numbers, to_even, bits, minus_for_not, rotated, parity, half_precision,
               leaky, partial)  # fmt: skip
