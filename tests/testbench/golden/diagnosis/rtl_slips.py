"""Slips of an engineer, written into the reference Verilog by rules on its text: the kinds of the judged round.

The rules were written after the diagnosis was frozen, from docs/diagnosis.md and the RTL alone. A fault is as in
`rtl_faults`: its cause is what that page calls it, "" for what is in no class.
"""

import re

from tests.testbench.golden.diagnosis.rtl_faults import Fault, inside, whole

# an operand of a sum: a concatenation, or a name with at most one index
NAME = r"(?:\{(?:[^{}]|\{[^{}]*\})*\}|\b(?:r_|[a-z])\w*(?:\[[^\]]*\])?)"


def driven(d, name):
    """Registers and pins that a wire feeds, also through the combinational blocks."""
    found = d.driven(name)
    for m in re.finditer(r"(?<!localparam )\b(\w+) = ([^;]+);", d.text[d.text.find("always @*") :]):
        if re.search(rf"\b{name}\b", m[2]) and m[1] != name:
            found |= {d.plain(m[1])} if m[1] in d.ports else d.driven(m[1])
    return found


def of(d, m):
    """Registers and pins that an assignment drives."""
    return d.of(m) if m[1][:2] in ("r_", "o_") else driven(d, m[1])


def places(d, start):
    """Registers and pins that the text at a place drives: an assignment, or a function with its callers."""
    for m in (*d.wires, *d.assigns):
        if m.start() <= start < m.end():
            return of(d, m)
    for f in re.finditer(r"function [^;]*?(\w+);[\s\S]*?endfunction", d.text):
        if f.start() <= start < f.end():
            callers = [m for m in (*d.loads, *d.wires) if f"{f[1]}(" in m[2]]
            return set().union(*(of(d, m) for m in callers)) | ({"*"} if f"{f[1]}(" in f[0].split(";", 1)[1] else set())
    for m in re.finditer(r"(?<!localparam )\b(\w+) = ([^;]+);", d.text):
        if m.start() <= start < m.end():
            return {d.plain(m[1])} if m[1] in d.ports else driven(d, m[1])
    return set()


def fault(d, kind, cause, span, put, registers):
    """Fault by another text of a span."""
    text, old = d.edited(*span, put), d.text[slice(*span)]
    return Fault(kind, cause, d.stem, text, tuple(sorted(registers)), " ".join(f"{old} -> {put}".split())[:160])


def replaced(d, kind, cause, pattern, new):
    """Faults by a pattern anywhere in assignments and functions; `new` may be a function of the hit."""
    out = []
    for m in re.finditer(pattern, d.text):
        put = new(m) if callable(new) else m.expand(new)
        registers = places(d, m.start())
        if put is not None and put != m[0] and registers:
            out.append(fault(d, kind, cause, m.span(), put, registers))
    return out


def table(kind, cause, rows):
    """Rule of a list of edits: (stem, old, new, registers); the registers "" are those that the text drives."""

    def rule(d):
        out = []
        for stem, old, new, registers in rows:
            if stem == d.stem:
                at = d.text.index(old)
                assert d.text.count(old) == 1, (stem, old)
                driven = set(registers.split()) or places(d, at)
                out.append(fault(d, kind, cause, (at, at + len(old)), new, driven))
        return out

    return rule


def ifs(d):
    """(start, condition span, body span) of each `if` but those of the reset."""
    for m in re.finditer(r"\bif \(", d.text):
        depth, end = 1, m.end()
        while depth:
            depth += {"(": 1, ")": -1}.get(d.text[end], 0)
            end += 1
        if not re.search(r"\brst\b", d.text[m.end() : end]):
            yield m.start(), (m.end(), end - 1), (end, d.end_of(end))


def decided(d, span):
    """Registers of a condition's branch and of its else branches."""
    start, end = span
    while more := re.match(r"\s*else( if \([^\n]*\))?", d.text[end:]):
        end = d.end_of(end + more.end())
    found = {m[1] for m in re.finditer(r"(\w+)\s*(?:<=|=(?!=))(?= [^;\n]*;)", d.text[start:end])}
    registers = {d.plain(n) for n in found if n in d.ports}
    for name in found - set(d.ports):
        registers |= d.driven(name)
    return registers or places(d, start)


def terms(text, word):
    """Spans of the terms between a word that stands in no parenthesis."""
    depth, last, out = 0, 0, []
    for k, c in enumerate(text):
        depth += (c in "([{") - (c in ")]}")
        if depth == 0 and text.startswith(word, k):
            out.append((last, k))
            last = k + len(word)
    return [*out, (last, len(text))] if out else []


def conditions(d):
    """(span, registers) of conditions: of each `if`, and of wires of one bit that are no pins."""
    for _, span, body in ifs(d):
        yield span, decided(d, body)
    for m in d.wires:
        head = d.text[m.start() : m.start(2)]
        if m[1][:2] not in ("o_", "r_") and "[" not in head and re.search(r"[&|]{2}", m[2]):
            yield m.span(2), driven(d, m[1])


# ---- differences ---------------------------------------------------------------------------------------------------


def exchanged(d):
    pattern = rf"(?<!\* )({NAME}) - ({NAME}|\d+'s?d\d+)(?! \*)"
    return replaced(d, "operands of a difference exchanged", "sign", pattern, r"\2 - \1")


def no_carry(d):
    return replaced(d, "minus without its carry", "complement", rf"(?<!\* )({NAME}) - ({NAME})(?! \*)", r"\1 + ~\2")


# ---- conditions ----------------------------------------------------------------------------------------------------


def of_another(d):
    """Another branch's condition. A stage of a pipeline instead of another one is a clock early or late."""
    out, found = [], [f for f in ifs(d) if f[0] > d.always and " <= " in d.text[slice(*f[2])]]
    stage = {"en": -1} | {f"r_stage[{k}]": k for k in range(5)}
    for _, span, body in found:
        old = d.text[slice(*span)]
        for new in sorted({d.text[slice(*other[1])] for other in found}):
            if new in old or old in new or re.split(r" [=<>]", old)[0] == re.split(r" [=<>]", new)[0]:
                continue
            cause = "condition"
            if d.stem == "rate_output" and old in stage and new in stage:
                cause = "late" if stage[new] > stage[old] else "early"
            out.append(fault(d, "condition of another branch", cause, span, new, decided(d, body)))
    return out


def other_order(d):
    """Two branches in the other order; not of one register's two values, which cannot meet."""
    out = []
    for _, span, body in ifs(d):
        more = re.match(r"\s*else (?=if \()", d.text[body[1] :])
        second = more and next(f for f in ifs(d) if f[0] == body[1] + more.end())
        if not second:
            continue
        one, two = d.text[slice(*span)], d.text[slice(*second[1])]
        if re.match(r"r_\w+ == \w+$", one) and re.match(re.escape(one.split(" ")[0]) + r" == \w+$", two):
            continue
        put = f"{two}){d.text[slice(*second[2])]}{more[0]}if ({one}){d.text[slice(*body)]}"
        registers = decided(d, body)
        f = fault(d, "branches in the other order", "priority", (span[0], second[2][1]), put, registers)
        out.append(f._replace(edit=f"if ({one}) else if ({two}): exchanged"))
    return out


def term_lost(d):
    out = []
    for (start, end), registers in conditions(d):
        found = [(word, terms(d.text[start:end], word)) for word in (" && ", " || ")]
        if "?" in d.text[start:end] or all(spans for _, spans in found):
            continue
        for word, spans in found:
            for a, b in spans:
                if "8'hFF" in d.text[start + a : start + b]:
                    continue  # a saturation
                cut = (start + a - len(word), start + b) if a else (start + a, start + b + len(word))
                out.append(fault(d, "term of a condition lost", "condition", cut, "", registers))
    return out


def and_or(d):
    out = []
    for (start, end), registers in conditions(d):
        for m in re.finditer(r"&&|\|\|", d.text[start:end]):
            put = "||" if m[0] == "&&" else "&&"
            span = (start + m.start(), start + m.end())
            f = fault(d, "and for or of conditions", "condition", span, put, registers)
            out.append(f._replace(edit=f"{d.text[start:end]}: {m[0]} at {m.start()} -> {put}"))
    return out


def bit_beside(d):
    """Another bit of a word in a condition."""
    names = "HOLD_AGC HOLD_PLL HOLD_FTR HOLD_QSC FIX_FTR FIX_QSC OPEN_DRIVE OVER_RANGE STALE STUCK RATE_SATURATED"
    after = dict(zip(names.split(), names.split()[1:]))
    kind, cause = "bit of the neighbour in a condition", "condition"
    found = replaced(d, kind, cause, r"\[([A-Z]+_?[A-Z]*)\]", lambda m: f"[{after[m[1]]}]" if m[1] in after else None)
    found += replaced(d, kind, cause, r"\b(?!frames)(\w+)\[(\d+)\](?= \?)", lambda m: f"{m[1]}[{int(m[2]) - 1}]")
    found += replaced(
        d, kind, cause, r"\b(r_y\[W|phase\[DDS_BITS)-([12])\](?= \?)", lambda m: f"{m[1]}-{int(m[2]) + 1}]"
    )
    lock = r"\b(enable|judged|r_locked|good|lost)\[(\d)\](?=,)"
    return found + replaced(d, kind, cause, lock, lambda m: f"{m[1]}[{(int(m[2]) + 1) % 4}]")


def arms(d):
    """(label span, arm span, registers) of the arms of the clocked `case`s."""
    for m in re.finditer(r"^ +((?:\d+'[hd])\w+|KICK|DECAY|SEARCH|RETUNE|ACQUIRE|SETTLE|BALANCE):", d.text, re.M):
        end = d.end_of(m.end())
        while more := re.match(r"\s*else( if \([^\n]*\))?", d.text[end:]):
            end = d.end_of(end + more.end())
        registers = d.under(m.end()) | ({"channels_7"} if d.stem == "spi_adc" else set())
        yield m.span(1), (m.start(), end), registers


def no_arm(d):
    return [fault(d, "branch of a case missing", "condition", arm, "", registers) for _, arm, registers in arms(d)]


def label(d):
    out = []
    for (start, end), _, registers in arms(d):
        m = re.fullmatch(r"(8'h|4'd)(\w+)", d.text[start:end])
        if m:
            put = f"8'h{int(m[2], 16) ^ 0x20:02X}" if m[1] == "8'h" else f"4'd{int(m[2]) ^ 8}"
            out.append(fault(d, "wrong bit of a label", "comparison", (start, end), put, registers))
    return out


def forgotten(d):
    """A constant that a branch of several statements no longer loads."""
    out = []
    for m in d.loads:
        line = d.text.rfind("\n", 0, m.start())
        if re.fullmatch(r"\d+'s?[bd]\d+|\{\w+\{1'b0\}\}|[A-Z]\w+", m[2]) and not d.text[line : m.start()].strip():
            if not re.search(r"(\)|else)\s*$", d.text[: m.start()]):
                out.append(fault(d, "constant not loaded", "condition", m.span(), "", {d.plain(m[1])}))
    return out


def outer(d):
    """A register that is loaded in the branch around its own one."""
    out = []
    for start, span, body in ifs(d):
        if d.text[:start].rstrip().endswith("else") or not re.match(r"\s*begin", d.text[slice(*body)]):
            continue
        for m in d.loads:
            line = d.text.rfind("\n", 0, m.start())
            direct = d.text.count("begin", body[0], m.start()) - len(
                re.findall(r"\bend\b", d.text[body[0] : m.start()])
            )
            if body[0] < m.start() < body[1] and direct == 1 and not d.text[line : m.start()].strip():
                if re.search(r"(\)|else)\s*$", d.text[: m.start()]) or not re.search(
                    r"(;|\bbegin|\bend)\s*$", d.text[:start]
                ):
                    continue
                text = d.text[:start] + m[0] + "\n" + d.text[start : m.start()] + d.text[m.end() :]
                edit = f"{m[0]} before if ({d.text[slice(*span)]})"
                out.append(Fault("loaded in the outer branch", "condition", d.stem, text, (d.plain(m[1]),), edit))
    return out


# ---- words ---------------------------------------------------------------------------------------------------------


def lane(d):
    """The wire, part or gain of another channel."""

    def put(m):
        return f"{m[1]}{(int(m[2]) + 1) % 4}"

    found = []
    if d.stem in ("digital_sid", "lock_monitor"):
        found = inside(d, "wire of another channel", "operand", r"\b(x_|next_)([0-3])\b", put, d.loads)
        found += inside(d, "wire of another channel", "operand", r"(?<=\{)(r_acc_)([0-3])\b", put, d.loads)
    other = {"X": "Y", "Y": "X"}
    return found + inside(d, "wire of another channel", "operand", r"GAIN_([XY])", lambda m: f"GAIN_{other[m[1]]}")


def words(d, bits):
    """(load, word, its width) of loads of a whole name, or of its low bits, of a multiple of some bits."""
    for m in d.loads:
        found = re.fullmatch(r"(\w+?)(?:\[(\d+):0\])?", m[2])
        width = re.fullmatch(r"\[(\d+):0\]", d.width(m[1]) or "")
        if found and width and found[1] in d.ports:
            top = int(width[1])
            mine = found[2] is None and d.width(found[1]) == f"[{top}:0]"
            if (mine or found[2] == width[1]) and (top + 1) % bits == 0 and top + 1 >= 16:
                yield m, found[1], top + 1


def byte_order(d):
    out = []
    for m, x, width in words(d, 8):
        put = "{" + ", ".join(f"{x}[{k + 7}:{k}]" for k in range(0, width, 8)) + "}"
        out.append(fault(d, "bytes in the other order", "bit_swap", m.span(2), put, {d.plain(m[1])}))
    return out


def half_words(d):
    out = []
    for m, x, width in words(d, 2):
        put = f"{{{x}[{width // 2 - 1}:0], {x}[{width - 1}:{width // 2}]}}"
        out.append(fault(d, "halves exchanged", "bit_swap", m.span(2), put, {d.plain(m[1])}))
    return out


def list_order(d):
    """Flags of a list from the other end."""
    out = []
    for m in d.body():
        found = re.search(r"\{([\s\S]+)\}", m[2])
        parts = terms(found[1], ",") if found else []
        listed = [found[1][a:b].strip() for a, b in parts]
        if len(listed) > 2 and not any(re.search(r":|^[a-z_]+$|'d|^r_\w+$", x) for x in listed):
            span = (m.start(2) + found.start(), m.start(2) + found.end())
            put = "{" + ", ".join(reversed(listed)) + "}"
            out.append(fault(d, "list of bits from the other end", "bit_order", span, put, d.of(m)))
    return out


shifted = table("shifted to the other side", "bit_order", [
    ("isqrt", "{r_root[14:0], fits}", "{fits, r_root[15:1]}", ""),
    ("spi_dac", "{r_shift[22:0], 1'b0} & MASK", "{1'b0, r_shift[23:1]} & MASK", ""),
    ("spi_adc", "{r_shift[22:0], 1'b0} | bit_at", "{1'b0, r_shift[23:1]} | (bit_at << 23)", ""),
    ("rate_output", "{r_stage[3:0], en}", "{en, r_stage[4:1]}", ""),
])  # fmt: skip


def slice_beside(d):
    """Bits one place lower, or higher where there is one."""
    out = []
    for step in (-1, 1):

        def put(m, step=step):
            high, low = int(m[2]) + step, int(m[3]) + step
            width = re.search(rf"\[(\d+):0\]\s*{m[1]}\b", d.text)
            inside_ = width and high <= int(width[1]) and low >= 0
            return f"{m[1]}[{high}:{low}]" if inside_ and high - low > 6 else None

        out += replaced(d, "slice a bit beside", "gain", r"\b([a-z]\w+)\[(\d+):(\d+)\]", put)
    return out


def sum_narrow(d):
    """The result of a signed sum or product without its top bit."""
    where = [m for m in d.wires if re.search(r"signed\s*\[", d.text[m.start() : m.start(2)])
             and re.search(r" [-+*] ", m[2]) and "?" not in m[2] and ">>>" not in m[2]]  # fmt: skip
    return whole(d, "sum without its top bit", "width", lambda m: f"($signed({m[2]}) <<< 1) >>> 1", where)


def low_bits(d):
    def put(m):
        width = re.fullmatch(r"\[(\d+):0\]", d.width(m[1]) or "")
        fits = width and int(width[1]) > 6 and not re.fullmatch(r"\d+'s?[bdh]\w+|[A-Z]\w+|\{.*1'b0\}\}", m[2])
        return f"({m[2]}) & ~3" if fits else None

    return whole(d, "two low bits lost", "width", put, d.loads)


def not_signed(d):
    """`signed` left out of a declaration of what is compared or shifted."""
    out = []
    for m in re.finditer(r"(?:input )?(?:wire|(?<!output )reg) +signed +(\[[^\]]+\])?\s*(\w+)", d.text):
        n, registers = m[2], set()
        for use in re.finditer(
            rf"(?<=[=(] )[^;=]*\b{n} (?:[<>]=?) [^;]+|[^;]*\b{n}\b[^;]*>>>|\({n} [<>]=? ", d.text[m.end() :]
        ):
            registers |= places(d, m.end() + use.end() - 1)
        if registers:
            put = m[0].replace("signed", "      ", 1)
            out.append(fault(d, "signed left out", "signedness", m.span(), put, registers))
    return out


# ---- numbers -------------------------------------------------------------------------------------------------------

compared = table("limit of a count off by one", "comparison", [
    ("isqrt", "LAST = 4'd15", "LAST = 4'd14", "busy done y"),
    ("rates", "LAST_CYCLE = TICK_CLOCKS - 1", "LAST_CYCLE = TICK_CLOCKS", "tick frame"),
    ("rates", "LAST_TICK = FRAME_TICKS - 1", "LAST_TICK = FRAME_TICKS", "frame"),
    ("rates", "SLOTS = 6'd60", "SLOTS = 6'd59", "slot"),
    ("cordic", "CLOCKS = 5'd24", "CLOCKS = 5'd23", "i busy done magnitude phase x y angle"),
    ("spi_adc", "LAST_CLOCK = CLOCKS[COUNT-1:0] - ONE", "LAST_CLOCK = CLOCKS[COUNT-1:0]", "*"),
    ("spi_adc", "LAST_OF_TAIL = TAIL_CLOCKS[COUNT-1:0] - ONE", "LAST_OF_TAIL = TAIL_CLOCKS[COUNT-1:0]", "*"),
    ("spi_adc", "HEAD = 4'b1100", "HEAD = 4'b1101", "ok"),
    ("fault_monitor", "RANGE_HI = 24'sh7FFF00", "RANGE_HI = 24'sh7FFF01", "over_range stuck flags"),
    ("spi_dac", "(r_left == 5'd1)", "(r_left == 5'd2)", ""),
])  # fmt: skip

wrong_limit = table("another limit", "limit", [
    ("digital_sid", "ACC_LO = -26'sd16777216", "ACC_LO = -26'sd16777215", "acc_0 acc_1 acc_2 acc_3"),
    ("digital_sid", "ACC_HI = 26'sd16777215", "ACC_HI = 26'sd8388607", "acc_0 acc_1 acc_2 acc_3"),
    ("digital_sid", "CODE_LO = -30'sd8388608", "CODE_LO = -30'sd8388607", "codes_0 codes_1 codes_2 codes_3"),
    ("digital_sid", "CODE_HI = 30'sd8388607", "CODE_HI = 30'sd4194303", "codes_0 codes_1 codes_2 codes_3"),
    ("notch", "Y_LO = -37'sd8589934592", "Y_LO = -37'sd8589933568", "y1"),
    ("rate_output", "SCALE_HI = {3'b000, {29{1'b1}}}", "SCALE_HI = {4'b0000, {28{1'b1}}}", "scale"),
    ("rate_output", "CORRECTED_LO = {5'b11111, 31'd0}", "CORRECTED_LO = {5'b11111, 31'd1}", "corrected"),
    ("rate_output", "OUT_HI = {4'b0000, {31{1'b1}}}", "OUT_HI = {5'b00000, {30{1'b1}}}", "scaled"),
    ("rate_output", "MAX_K = 3'd6", "MAX_K = 3'd5", "k count y valid acc"),
    ("modulator", "(rounded < LO) ? lo :", "(rounded < LO) ? -hi :", ""),
    ("pi", "(preset > hi) ? ACC_HI", "(preset > hi) ? ACC_HI - 1", ""),
    ("watchdog", "AGE_TOP = 10'd1023", "AGE_TOP = 10'd1022", "age stale"),
])  # fmt: skip

other_ties = table("ties to the other side", "rounding", [
    ("modulator", "(wide_product + HALF)", "(wide_product + HALF - (wide_product < 0 ? 1 : 0))", ""),
    ("pi", "+ HALF_Y;", "+ HALF_Y + {A+2{r_prop + r_acc < 0}};", ""),
    ("notch", "r_y1 + 34'sd512", "r_y1 + (r_y1 < 0 ? 34'sd511 : 34'sd512)", ""),
    ("notch", "+ 59'sd2097152", "+ 59'sd2097151", ""),
    ("sequencer", "+ 60'sd32768", "+ (rotation < 0 ? 60'sd32767 : 60'sd32768)", ""),
    ("rate_output", "+ 44'sd2048", "+ 44'sd2047", ""),
    ("rate_output", "+ 52'sd32768", "+ 52'sd32767", ""),
    ("rate_output", "square_t * square_t + 32'sd16384", "square_t * square_t + 32'sd16383", ""),
    ("digital_sid", "+ 63'sd524288", "+ 63'sd524287", ""),
])  # fmt: skip

cut = table("cut toward zero", "rounding", [
    ("modulator", "(wide_product + HALF)", "(wide_product + (wide_product < 0 ? 2 * HALF - 1 : 0))", ""),
    ("notch", "r_y1 + 34'sd512", "r_y1 + (r_y1 < 0 ? 34'sd1023 : 34'sd0)", ""),
    ("sequencer", "+ 60'sd32768", "+ (rotation < 0 ? 60'sd65535 : 60'sd0)", ""),
    ("cordic", "across = (y + half)", "across = (y + (y < 0 ? (ONE <<< r_i) - 1 : 0))", ""),
    ("rate_output", "+ 63'sd134217728", "+ ((r_corrected[31] ^ r_scale[29]) ? 63'sd268435455 : 63'sd0)", ""),
    ("rate_output", "(wide_acc + half)", "(wide_acc + (wide_acc < 0 ? (39'sd1 <<< k) - 1 : 0))", ""),
])  # fmt: skip

no_stop = table("count does not stop", "wrap", [
    ("watchdog", "(r_age == AGE_TOP) ? AGE_TOP : ", "", ""),
    ("fault_monitor", "(count >= limit) ? limit : count", "count", ""),
    ("fault_monitor", "(r_bad_frames == top) ? top : ", "", ""),
    ("fault_monitor", "(r_good_frames == top) ? top : ", "", ""),
    ("sequencer", "frames[16] ? r_timer : ", "", ""),
    ("digital_sid", "(r_still >= still) ? still : ", "", ""),
])  # fmt: skip

row_before = table("row of a table before", "constant", [
    ("sine", "rom[place[PLACE-1:SINE_FRACTION_BITS]]", "rom[place[PLACE-1:SINE_FRACTION_BITS] - 1'b1]", "base slope"),
    ("cordic", "rom[r_i]", "rom[r_i - 1'b1]", "angle"),
    ("sine", "initial $readmemh(ROM_FILE, rom);",
     "initial begin $readmemh(ROM_FILE, rom); rom[77] = rom[77] - 1; end", "slope base"),
    ("sine", "initial $readmemh(ROM_FILE, rom);",
     "initial begin $readmemh(ROM_FILE, rom); rom[900] = rom[900] + (1 << SLOPE); end", "base"),
    ("cordic", "initial $readmemh(ROM_FILE, rom);",
     "initial begin $readmemh(ROM_FILE, rom); rom[7] = rom[7] - 1; end", "angle"),
    ("cordic", "initial $readmemh(ROM_FILE, rom);",
     "initial begin $readmemh(ROM_FILE, rom); rom[20] = rom[20] - 1; end", "angle"),
])  # fmt: skip


# ---- registers -----------------------------------------------------------------------------------------------------


def all_ones(d):
    good = [m for m in d.resets if re.search(r"'s?[bdh]0+$|1'b0\}\}$", m[2])]
    return whole(d, "reset to all ones", "reset", lambda m: "~0" if d.width(m[1]) else None, good)


def top_bit(d):
    """The reset leaves the top bit of a register as it is."""
    out = []
    for m in d.resets:
        width = re.fullmatch(r"\[(\d+):0\]", d.width(m[1]) or "")
        if width and re.search(r"'s?[bdh]0+$", m[2]):
            put = f"{m[1]}[{int(width[1]) - 1}:0] <= 0;"
            out.append(fault(d, "top bit not reset", "no_reset", m.span(), put, {d.plain(m[1])}))
    return out


def stale(d):
    """A wire that a register takes a clock late."""
    out = []
    for w in d.wires:
        head = d.text[w.start() : w.start(2)]
        if w[1][:2] in ("o_", "r_") or not head.startswith("wire"):
            continue
        sign = "signed" if "signed" in head else ""
        width = (re.search(r"\[[^\]]+\]", head) or [""])[0]
        for m in d.loads:
            if re.search(rf"\b{w[1]}\b", m[2]):
                text = d.edited(*m.span(2), re.sub(rf"\b{w[1]}\b", "was", m[2]))
                kept = f"reg {sign} {width} was;\n    always @(posedge clk) was <= rst ? 0 : {w[1]};\n    "
                at = text.find("always @(posedge clk)")
                text = text[:at] + kept + text[at:]
                edit = f"{m[1]}: {w[1]} a clock late"
                out.append(Fault("wire a clock late", "late", d.stem, text, (d.plain(m[1]),), edit))
    return out


def forwarded(d):
    """A register reads what another one of its branch is about to take."""
    out = []
    for m in d.loads:
        others = [o for o in d.loads if o[1] == m[1]]
        plain = not re.search(r"[{?]|<<<|>>>|^\w+$", m[2]) and d.width(m[1])
        for o in d.loads if len(others) == 1 and plain else ():
            if o is not m and re.search(rf"\b{m[1]}\b", o[2]) and o[1] != m[1] and d.together(m, o):
                put = f"({m[2]})".join(re.split(rf"\b{m[1]}\b", o[2]))
                out.append(fault(d, "next value taken", "early", o.span(2), put, {d.plain(o[1])}))
    return out


# ---- in no class ---------------------------------------------------------------------------------------------------


def half_carry(d):
    """The carry out of the low 12 bits of a sum is lost."""

    def put(m):
        found = re.fullmatch(rf"({NAME}) \+ ({NAME})", m[2])
        a, b = found.groups() if found else ("", "")
        return f"{m[2]} - ((({a} & 'sd4095) + ({b} & 'sd4095)) & 'sd4096)" if found else None

    return whole(d, "carry of the low bits lost", "", put, d.body())


def gray(d):
    return [fault(d, "Gray code", "", m.span(2), f"{m[2]} ^ ({m[2]} >> 1)", {d.plain(m[1])}) for m, _, _ in words(d, 1)]


def averaged(d):
    out = []
    for m, x, _ in words(d, 1):
        if d.ports[x][1] and d.ports[m[1]][1] and "[" not in m[2]:
            put = f"({x} >>> 1) + ({m[1]} >>> 1)"
            out.append(fault(d, "mean with the old value", "", m.span(2), put, {d.plain(m[1])}))
    return out


SLIPS = (exchanged, no_carry, of_another, other_order, term_lost, and_or, bit_beside, no_arm, label, forgotten, outer,
         lane, byte_order, half_words, list_order, shifted, slice_beside, sum_narrow, low_bits, not_signed, compared,
         wrong_limit, other_ties, cut, no_stop, row_before, all_ones, top_bit, stale, forwarded, half_carry, gray,
         averaged)  # fmt: skip
