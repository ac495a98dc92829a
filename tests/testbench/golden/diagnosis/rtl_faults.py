"""Faults written into the text of the reference Verilog by rules on text: no model, no graph, nothing of the diagnosis.

A fault is (kind, cause, file, text, registers): the kind is the rule that made it, the cause what docs/diagnosis.md
calls it ("" for what is in no class), the registers or pins those that the edited line drives.
"""

import random
import re
from pathlib import Path
from typing import NamedTuple

RTL = Path(__file__).resolve().parents[4] / "testbench" / "rtl"
# case of the bundle in which most of a block is exercised
CASES = {
    "dds": "default", "sine": "default", "delay": "depth8", "references": "align2_retimed", "modulator": "narrow",
    "pi": "odd", "spi_dac": "divided", "spi_adc": "default", "digital_sid": "delay0", "cordic": "default",
    "isqrt": "default", "agc": "default", "frequency_tracker": "narrow", "rate_loop": "default",
    "quadrature_loop": "default", "lock_monitor": "quick", "fault_monitor": "quick", "sequencer": "quick",
    "notch": "split", "rate_output": "default", "registers": "default", "watchdog": "limit250", "rates": "default",
}  # fmt: skip
# what a port in the place of a register is, by whether it feeds the register: docs/diagnosis.md
NAMED = {True: "early", False: "operand", None: None}


class Fault(NamedTuple):
    kind: str
    cause: str
    stem: str
    text: str
    registers: tuple
    edit: str


def source(stem):
    return (RTL / f"{stem}.v").read_text()


class Design:
    """The text of a module: its ports, wires, register assignments outside of the reset branch, and what feeds what."""

    def __init__(self, stem):
        self.stem, self.text = stem, source(stem)
        self.always = self.text.find("always @(posedge clk)")
        self.assigns = list(re.finditer(r"(r_\w+)\s*<= ([^;]+);", self.text))
        # the first assignment of each register in the text is that of the reset branch
        first = {}
        for m in self.assigns:
            first.setdefault(m[1], m)
        self.resets = list(first.values())
        self.loads = [m for m in self.assigns if m not in self.resets]
        self.wires = list(re.finditer(r"(?:wire|assign)\b[^;=]*?(\w+)\s*=(?!=) ([^;]+);", self.text))
        ports = re.findall(r"(input|output)\s+(?:wire|reg)\s+(signed\s+)?(\[[^\]]+\])?\s*(\w+)", self.text)
        self.ports = {name: (way, bool(sign), width or "") for way, sign, width, name in ports}

    def plain(self, name):
        return name[2:] if name[:2] in ("r_", "o_") else name

    def driven(self, name):
        """Registers and pins that a wire feeds through other wires."""
        found, ahead, seen = set(), [name], set()
        while ahead:
            now = ahead.pop()
            if now in seen:
                continue
            seen.add(now)
            if now[:2] in ("r_", "o_") and now in self.ports and now != name:
                found.add(self.plain(now))
                continue
            for m in (*self.wires, *self.loads):
                if re.search(rf"\b{now}\b", m[2]):
                    ahead.append(m[1])
            if re.search(rf"\.\w+\s*\([^()]*\b{now}\b", self.text):
                found.add("*")  # into an instance
            for m in re.finditer(rf"\bif \(.*\b{now}\b.*\)", self.text):
                ahead += list(re.findall(r"(\w+)\s*(?:<=|=(?!=))", self.text[m.end() : self.end_of(m.end())]))
        return found

    def first_of(self, registers, ports):
        """Those of some ports that registers or pins reach through the fewest registers; "*" behind an instance."""
        ahead, reached, ports = set(registers), set(), {*ports, "*"}
        while ahead and not ahead & ports:
            reached |= ahead
            ahead = {other for name in ahead for other in self.driven(f"r_{name}")} - reached
        return ahead & ports

    def of(self, m):
        """Registers and pins that an assignment drives."""
        return {self.plain(m[1])} if m[1][:2] in ("r_", "o_") else self.driven(m[1])

    def body(self):
        """Assignments whose right side computes something."""
        return [*self.loads, *self.wires]

    def width(self, name):
        return self.ports.get(name, ("", False, None))[2]

    def end_of(self, start):
        """Where the statement that begins at a place ends."""
        end, depth = start, 0
        for m in re.finditer(r"\bbegin\b|\bend\b|\bcase\b|\bendcase\b|;", self.text[start:]):
            depth += {"begin": 1, "end": -1, "case": 1, "endcase": -1}.get(m[0], 0)
            end = start + m.end()
            if depth == 0:
                break
        return end

    def feeds(self, name, register, reader):
        """Whether a register takes a port whenever the reader loads: at every clock, or in the same branch.

        The readers of a wire are the registers that it drives; None if they are of both sorts.
        """
        loads = [m for m in self.loads if m[1] == register]
        if len(loads) != 1 or loads[0][2] != name:
            return False
        lines = self.text[: loads[0].start()].splitlines()
        opened = next((n for n in reversed(lines[:-1]) if n.strip() and len(n) - len(n.lstrip()) < len(lines[-1])), "")
        if opened.strip() == "end else begin":
            return True
        driven = self.of(reader)
        readers = [reader] if reader in self.loads else [m for m in self.loads if self.plain(m[1]) in driven]
        found = {self.together(loads[0], m) for m in readers} or {False}
        return found.pop() if len(found) == 1 else None

    def together(self, a, b):
        """Whether two assignments stand in the same branch."""
        between = self.text[min(a.end(), b.end()) : max(a.start(), b.start())]
        return not re.search(r"\b(begin|end|if|else)\b", between)

    def under(self, start):
        """Registers assigned in the statement that begins at a place, without its else part."""
        end = self.end_of(start)
        found = {m[1] for m in re.finditer(r"(\w+)\s*(?:<=|=(?!=))", self.text[start:end])}
        return {self.plain(n) for n in found if n in self.ports} | {
            n for f in found - set(self.ports) for n in self.driven(f)
        }

    def edited(self, start, end, new):
        return self.text[:start] + new + self.text[end:]


def inside(d, kind, cause, pattern, new, where=None):
    """Faults by replacing a pattern inside right sides."""
    out = []
    for m in where or d.body():
        for hit in re.finditer(pattern, m[2]):
            at = m.start(2) + hit.start()
            put = new(hit) if callable(new) else hit.expand(new)
            if put is None or put == hit[0]:
                continue
            text = d.edited(at, at + len(hit[0]), put)
            out.append(Fault(kind, cause, d.stem, text, tuple(sorted(d.of(m))), f"{m[1]}: {hit[0]} -> {put}"))
    return out


def whole(d, kind, cause, new, where):
    """Faults by replacing whole right sides."""
    out = []
    for m in where:
        put = new(m)
        if put is None:
            continue
        text = d.edited(m.start(2), m.end(2), put)
        out.append(Fault(kind, cause, d.stem, text, tuple(sorted(d.of(m))), f"{m[1]}: {m[2]} -> {put}"))
    return out


# ---- kinds of the first round --------------------------------------------------------------------------------------


def rounding(d):
    return inside(d, "rounding constant missing", "rounding", r" \+ (HALF\w*|half)\b(?=[\s\S]*)", lambda h: "")


def rounding_down(d):
    return inside(d, "ties down", "rounding", r"\+ (HALF_Y|HALF)\b", lambda h: f"+ {h[1]} - 1")


def difference(d):
    return inside(d, "minus for plus", "sign", r"(?<=[\w\]})]) \+ (?=[a-z{(]|r_)(?!\{\d)(?!half|bit)", " - ")


def negated(d):
    return whole(
        d,
        "negated",
        "sign",
        lambda m: f"-{m[2]}" if re.fullmatch(r"r_\w+", m[2]) and d.ports[m[1]][1] else None,
        d.loads,
    )


def inverted(d):
    return whole(
        d,
        "inverted flag",
        "sign",
        lambda m: f"~({m[2]})" if d.width(m[1]) == "" and not re.fullmatch(r"1'b[01]", m[2]) else None,
        d.loads,
    )


def doubled(d):
    def put(m):
        return f"({m[2]}) <<< 1" if re.fullmatch(r"\w+", m[2]) and d.width(m[1]) not in ("", None) else None

    return whole(d, "twice", "gain", put, d.loads)


def halved(d):
    def put(m):
        sign = d.ports.get(m[2], ("", False, ""))[1]
        return f"{m[2]} >>> 1" if sign and re.fullmatch(r"\w+", m[2]) else None

    return whole(d, "half", "gain", put, d.loads)


def relation(d):
    other = {"<": "<=", ">": ">=", "<=": "<", ">=": ">"}
    return inside(
        d,
        "relation",
        "comparison",
        r"(?<=[\w\])]) (<=|>=|<|>) (?=[\w{(])",
        lambda h: f" {other[h[1]]} ",
        [m for m in d.wires if not re.search(r"[<>]=? (LO|HI|Y_|SUM_|ACC_|OUT_|SCALE_|CORR|CODE_|lo\b|hi\b)", m[2])],
    )


def counted(d):
    out = []
    for m in re.finditer(r"(r_\w+ (?:==|<) )(\d+)'d(\d+)", d.text):
        if m.start() < d.always - 4000 or int(m[3]) < 2:
            continue
        put = f"{m[1]}{m[2]}'d{int(m[3]) - 1}"
        line = d.text[d.text.rfind("\n", 0, m.start()) : d.text.find("\n", m.end())]
        wire = re.search(r"wire .*?(\w+) =", line)
        registers = d.driven(wire[1]) if wire else d.under(d.text.find(")", m.end()) + 1)
        out.append(
            Fault(
                "number compared",
                "comparison",
                d.stem,
                d.edited(m.start(), m.end(), put),
                tuple(sorted(registers)),
                f"{m[0]} -> {put}",
            )
        )
    return out


def limit(d):
    return inside(d, "limit off by one", "limit", r"> (\w*HI) *\) \? (\w+)", lambda h: f"> {h[1]}) ? {h[2]} - 1")


def limit_other(d):
    return inside(
        d,
        "limit of the other end",
        "limit",
        r"> (\w*?)HI *\) \? (\w*?)(HI|hi)\b",
        lambda h: f"> {h[1]}HI) ? {h[2]}{'LO' if h[3] == 'HI' else 'lo'}",
    )


def unclamped(d):
    return inside(d, "not clamped", "wrap", r"\(\w+ < \w*LO\) \? \w+ :\s*\(\w+ > \w*HI\) \? \w+ : (.+)", lambda h: h[1])


def condition(d, kind="condition inverted", put=lambda c: f"!({c})"):
    out = []
    for m in re.finditer(r"\bif \((.+)\)( begin)?\n", d.text):
        if m.start() < d.always or "rst" in m[1]:
            continue
        new = f"if ({put(m[1])}){m[2] or ''}\n"
        out.append(
            Fault(
                kind,
                "condition",
                d.stem,
                d.edited(m.start(), m.end(), new),
                tuple(sorted(d.under(m.end(1) + 1))),
                f"if ({m[1]}) -> {new.strip()}",
            )
        )
    return out


def unconditional(d):
    return condition(d, "condition missing", lambda c: "1'b1")


def never(d):
    return condition(d, "never taken", lambda c: "1'b0")


def one_more(d):
    flags = [n for n, (way, _, w) in d.ports.items() if way == "input" and w == "" and n not in ("clk", "rst")]
    return [
        f
        for flag in flags
        for f in condition(d, "one condition more", lambda c, flag=flag: f"({c}) && {flag}")
        if flag not in f.edit.split("->")[0]
    ]


def one_or(d):
    flags = [n for n, (way, _, w) in d.ports.items() if way == "input" and w == "" and n not in ("clk", "rst")]
    return [
        f
        for flag in flags
        for f in condition(d, "or another condition", lambda c, flag=flag: f"({c}) || {flag}")
        if flag not in f.edit.split("->")[0]
    ]


def operand(d):
    """Another port of the same width and sign in the place of one; not next to a wire that only widens it."""
    out = []
    for m in d.body():
        for old in sorted(set(re.findall(r"\b[a-z]\w+\b", m[2]))):
            mine = d.ports.get(old)
            if mine is None or mine[2] == "":
                continue
            for name, port in d.ports.items():
                if (
                    name not in (old, m[1])
                    and port[1:] == mine[1:]
                    and name[:2] != "o_"
                    and not re.search(rf"\b{name}\b", m[2])
                ):
                    text = d.edited(m.start(2), m.end(2), re.sub(rf"\b{old}\b", name, m[2]))
                    # what a register takes without a condition is its new value: docs/diagnosis.md calls that early
                    cause = NAMED[d.feeds(name, old, m)]
                    if cause is None:
                        continue
                    # of a condition it is another condition, on that page too
                    test, _, ways = m[2].partition("?")
                    if cause == "operand" and ways and old in test and not re.search(rf"\b{old}\b", ways):
                        cause = "condition"
                    out.append(
                        Fault(
                            "wrong operand",
                            cause,
                            d.stem,
                            text,
                            tuple(sorted(d.of(m))),
                            f"{m[1]}: {old} -> {name} in {m[2][:40]}",
                        )
                    )
    return out


def reset_value(d):
    def put(m):
        if not re.fullmatch(r"\d+'s?[bd]\d+|\{.*\}", m[2]):
            return None
        return "1'b0" if m[2] == "1'b1" else "1'b1"

    return whole(d, "reset value", "reset", put, d.resets)


def no_reset(d):
    out = []
    for m in d.resets:
        text = d.edited(m.start(), m.end(), "")
        if re.search(r"if \(rst[^\n]*\)\s*(end|else)", text):
            continue
        out.append(Fault("no reset", "no_reset", d.stem, text, (d.plain(m[1]),), f"{m[0]} removed"))
    return out


def late(d):
    """One register more under the same condition, with the same reset."""
    out = []
    for m in d.loads:
        loads = [other for other in d.loads if other[1] == m[1]]
        reset = next(r for r in d.resets if r[1] == m[1])
        if len(loads) != 1 or "\n" in reset[0]:
            continue
        width, sign = d.width(m[1]), "signed" if d.ports[m[1]][1] else ""
        text = d.edited(m.start(), m.end(), f"begin late <= {m[2]}; {m[1]} <= late; end")
        text = text[: reset.start()] + f"begin late <= {reset[2]}; {reset[0]} end" + text[reset.end() :]
        at = text.find("    always @(posedge clk)")
        text = text[:at] + f"    reg {sign} {width} late;\n" + text[at:]
        out.append(Fault("register too many", "late", d.stem, text, (d.plain(m[1]),), f"{m[0]} one register later"))
    return out


def late_input(d):
    out = []
    for name, (way, sign, width) in d.ports.items():
        if way == "output" or name in ("clk", "rst"):
            continue
        for m in d.body():
            if not re.search(rf"\b{name}\b", m[2]):
                continue
            text = d.edited(m.start(2), m.end(2), re.sub(rf"\b{name}\b", "was", m[2]))
            place = text.find("\n);") + 3
            kept = f"reg {'signed' if sign else ''} {width} was;\n always @(posedge clk) was <= rst ? 0 : {name};"
            text = f"{text[:place]}\n{kept}\n{text[place:]}"
            out.append(
                Fault("input late", "late", d.stem, text, tuple(sorted(d.of(m))), f"{m[1]}: {name} a clock late")
            )
    return out


def blocking(d):
    """A blocking assignment: those below it read the new value."""
    out = []
    for m in d.loads:
        if re.search(r"\b" + m[1] + r"\b", m[2]):
            continue
        below = [o for o in d.loads if o.start() > m.end() and re.search(rf"\b{m[1]}\b", o[2]) and o[1] != m[1]]
        if len(below) == 1 and "\n" not in m[0]:
            text = d.edited(m.start(), m.end(), f"{m[1]} = {m[2]};")
            # the clocked reset stays as it is: a register is assigned in one style by most tools, by these in both
            out.append(Fault("blocking assignment", "early", d.stem, text, (d.plain(below[0][1]),), f"{m[0]} blocking"))
    return out


def too_early(d):
    """A register is left out for one reader: it takes what feeds the register."""
    out = []
    for m in d.loads:
        feed = re.fullmatch(r"\w+", m[2])
        loads = [o for o in d.loads if o[1] == m[1]]
        if not feed or len(loads) != 1:
            continue
        for o in d.body():
            if (
                o is m
                or not re.search(rf"\b{m[1]}\b", o[2])
                or d.ports.get(m[2], (0, 0, None))[1:] != d.ports[m[1]][1:]
            ):
                continue
            text = d.edited(o.start(2), o.end(2), re.sub(rf"\b{m[1]}\b", m[2], o[2]))
            cause = NAMED[d.feeds(m[2], m[1], o)]
            if cause is None or re.search(rf"\b{m[2]}\b", o[2]):
                continue
            out.append(
                Fault("register left out", cause, d.stem, text, tuple(sorted(d.of(o))), f"{o[1]}: {m[1]} -> {m[2]}")
            )
    return out


def glitch(d):
    """Outside of the list: one rare value goes wrong by a pattern."""
    return whole(
        d,
        "glitch",
        "",
        lambda m: (
            f"({m[2]}) ^ ((({m[2]}) & 7'h7f) == 7'd77 ? 8'h5a : 8'h00)"
            if re.fullmatch(r"\w+", m[2])
            and len(re.findall(r"\d+", d.width(m[1]) or ""))
            and (d.width(m[1]) or "[0").split(":")[0][1:].isdigit()
            and int(d.width(m[1]).split(":")[0][1:]) > 10
            else None
        ),
        d.loads,
    )


def three_quarters(d):
    """Outside of the list: a factor of 3/4."""
    return whole(
        d,
        "factor 3/4",
        "",
        lambda m: (
            f"{m[2]} - ({m[2]} >>> 2)" if d.ports.get(m[2], ("", False))[1] and re.fullmatch(r"\w+", m[2]) else None
        ),
        d.loads,
    )


FIRST = (rounding, rounding_down, difference, negated, inverted, doubled, halved, relation, counted, limit, limit_other,
         unclamped, condition, unconditional, never, one_more, one_or, operand, reset_value, no_reset, late, late_input,
         blocking, too_early, glitch, three_quarters)  # fmt: skip


# ---- kinds of the second round, written after the diagnosis was frozen -----------------------------------------------


def asynchronous(d):
    resets = tuple(d.plain(m[1]) for m in d.resets)
    text = d.text.replace("always @(posedge clk)", "always @(posedge clk or posedge rst)")
    return (
        [Fault("asynchronous reset", "async_reset", d.stem, text, resets, "or posedge rst")] if text != d.text else []
    )


def zero_extended(d):
    return inside(
        d,
        "sign not extended",
        "signedness",
        r"\{\{?(\w+(?:\+\d)?)\{\w+\[[\w-]+\]\}\}",
        lambda h: "{{" + h[1] + "{1'b0}}" if h[0].startswith("{{") else None,
    )


def logical(d):
    return inside(
        d,
        "logical shift",
        "signedness",
        r">>>",
        ">>",
        [m for m in d.wires if re.search(rf"signed[^;=]*\b{m[1]} =", d.text)],
    )


def narrow(d):
    """The top bit of an unsigned register is lost."""

    def put(m):
        found = re.fullmatch(r"\[(\d+):0\]", d.width(m[1]) or "")
        return (
            f"({m[2]}) & {int(found[1]) + 1}'d{(1 << int(found[1])) - 1}"
            if found and not d.ports[m[1]][1] and not re.fullmatch(r"\d+'d\d+", m[2])
            else None
        )

    return whole(d, "top bit lost", "width", put, d.loads)


def step_of_two(d):
    return inside(d, "number added", "constant", r"([+-]) (\d+)'s?d1\b", lambda h: f"{h[1]} {h[2]}'d2")


def wrong_word(d):
    found = re.search(r"initial (\$readmemh\(\w+, (\w+)\);)", d.text)
    out = []
    for place in (3, 5, 9, 14) if found else ():
        text = d.edited(
            found.start(), found.end(), f"initial begin {found[1]} {found[2]}[{place}] = {found[2]}[{place}] + 1; end"
        )
        first = {"sine": ("base", "slope"), "cordic": ("angle",)}[d.stem]
        out.append(Fault("word of a table", "constant", d.stem, text, first, f"word {place} + 1"))
    return out


def _names(d, least):
    """Loads of a plain port or wire of a known width: (assignment, width)."""
    for m in d.loads:
        found = re.fullmatch(r"\[(\d+):0\]", d.width(m[1]) or "")
        same = d.ports.get(m[2], ("", False, None))[2] == d.width(m[1])
        if re.fullmatch(r"\w+", m[2]) and found and same and int(found[1]) + 1 >= least:
            yield m, int(found[1]) + 1


def swapped(d):
    out = []
    for m, width in _names(d, 4):
        x = m[2]
        text = d.edited(m.start(2), m.end(2), f"{{{x}[{width - 1}:3], {x}[1], {x}[2], {x}[0]}}")
        out.append(Fault("two bits exchanged", "bit_swap", d.stem, text, (d.plain(m[1]),), f"{m[0]} bits 1 and 2"))
    return out


def reversed_(d):
    out = []
    for m, width in _names(d, 8):
        text = d.edited(m.start(2), m.end(2), "{" + ", ".join(f"{m[2]}[{k}]" for k in range(width)) + "}")
        out.append(Fault("bits reversed", "bit_order", d.stem, text, (d.plain(m[1]),), f"{m[0]} reversed"))
    return out


def ones_complement(d):
    return inside(d, "~x for -x", "complement", r"(?<=[?:] )-(?=[a-z])", "~")


def bitwise(d):
    """Between two comparisons or flags it is a condition: docs/diagnosis.md."""
    other = {"&": "|", "|": "&", "^": "|"}

    def put(hit):
        return f" {other[hit[1]]} "

    found = inside(d, "operation on bits", "operator", r"(?<=[\w\])]) ([&|^]) (?=[~\w({])", put)
    flags = {d.plain(m[1]) for m in d.body() if m[1] in d.ports and d.width(m[1]) == ""}
    return [f._replace(cause="condition") if set(f.registers) <= flags else f for f in found]


def priority(d):
    """The branch behind the reset goes before it."""
    found = re.search(r"if \(rst\)( begin)?\n([\s\S]*?)else if \(([^\n]+)\)( begin)?\n", d.text[d.always :])
    if not found or "else" in found[2].replace("end else", ""):
        return []
    start = d.always + found.start()
    text = d.edited(start, start + len("if (rst)"), f"if (rst && !({found[3]}))")
    registers = {d.plain(m[1]) for m in d.resets}  # all lack their reset where the branch is taken
    return [Fault("reset behind a branch", "priority", d.stem, text, tuple(sorted(registers)), found[3])]


def stuck(d):
    out = []
    for m in d.loads:
        found = re.fullmatch(r"\[(\d+):0\]", d.width(m[1]) or "")
        if found and int(found[1]) >= 3 and re.fullmatch(r"\w+", m[2]):
            for put, said in ((f"{m[2]} | {int(found[1]) + 1}'sd4", "1"), (f"{m[2]} & ~{int(found[1]) + 1}'sd4", "0")):
                out.append(
                    Fault(
                        "stuck bit",
                        "stuck",
                        d.stem,
                        d.edited(m.start(2), m.end(2), put),
                        (d.plain(m[1]),),
                        f"{m[0]} bit 2 at {said}",
                    )
                )
    return out


def saturating(d):
    if d.stem != "dds":
        return []
    out = []
    for m in d.loads:
        a, b = m[2].split(" + ")
        put = f"({b} > ~{a}) ? {{DDS_BITS{{1'b1}}}} : {m[2]}"
        out.append(
            Fault(
                "saturates",
                "saturate",
                d.stem,
                d.edited(m.start(2), m.end(2), put),
                (d.plain(m[1]),),
                f"{m[0]} saturates",
            )
        )
    return out


def next_address(d):
    edits = {"sine": ("rom[place[PLACE-1:SINE_FRACTION_BITS]]", "rom[place[PLACE-1:SINE_FRACTION_BITS] + 1'b1]"),
             "cordic": ("rom[r_i]", "rom[r_i + 1'b1]")}  # fmt: skip
    if d.stem not in edits:
        return []
    old, new = edits[d.stem]
    first = {"sine": ("base", "slope"), "cordic": ("angle",)}[d.stem]
    return [Fault("address of a table", "constant", d.stem, d.text.replace(old, new), first, new)]


def mixed(d):
    """Outside of the list: another port is mixed in."""
    out = []
    for m, _ in _names(d, 8):
        for name, port in d.ports.items():
            if name not in (m[1], m[2]) and port[2] == d.width(m[1]) and port[0] == "input":
                text = d.edited(m.start(2), m.end(2), f"{m[2]} ^ ({name} >> 1)")
                out.append(
                    Fault("another port mixed in", "", d.stem, text, (d.plain(m[1]),), f"{m[0]} ^ ({name} >> 1)")
                )
    return out


def fifth_gain(d):
    """Outside of the list: a factor of 5/4 of a wire."""
    return whole(
        d,
        "factor 5/4",
        "",
        lambda m: (
            f"{m[2]} + ({m[2]} >>> 2)"
            if re.fullmatch(r"\w+", m[2]) and len(re.findall(rf"wire signed[^;=]*\b{m[2]} =", d.text))
            else None
        ),
        d.loads,
    )


SECOND = (asynchronous, zero_extended, logical, narrow, step_of_two, wrong_word, swapped, reversed_, ones_complement,
          bitwise, priority, stuck, saturating, next_address, mixed, fifth_gain)  # fmt: skip


def drawn(rules, per_rule, seed, stems=tuple(CASES)):
    """Up to `per_rule` faults of each rule, spread over the blocks."""
    r = random.Random(seed)
    designs = {stem: Design(stem) for stem in stems}
    out = []
    for rule in rules:
        every = {stem: rule(d) for stem, d in designs.items()}
        every = {stem: r.sample(found, len(found)) for stem, found in every.items() if found}
        picked = []
        while len(picked) < per_rule and every:
            for stem in r.sample(sorted(every), len(every)):
                if len(picked) < per_rule:
                    picked.append(every[stem].pop())
                if not every[stem]:
                    del every[stem]
        out += picked
    return out


def _change(base, text):
    """(start, end, new) of the one change between two texts."""
    start = next((k for k, (a, b) in enumerate(zip(base, text)) if a != b), min(len(base), len(text)))
    end = next((k for k, (a, b) in enumerate(zip(base[::-1], text[::-1])) if a != b), 0)
    end = min(end, len(base) - start, len(text) - start)
    return start, len(base) - end, text[start : len(text) - end]


def both(a, b):
    """The text with two faults of one module, or None where their changes meet."""
    base = source(a.stem)
    (start, end, new), (begin, stop, put) = sorted((_change(base, a.text), _change(base, b.text)))
    return base[:start] + new + base[end:begin] + put + base[stop:] if end < begin else None


def pairs(rules, count, seed):
    """`count` pairs of faults of one block in different registers, as (fault, fault, text)."""
    r, faults, out = random.Random(seed), {}, []
    for f in drawn(rules, 40, seed):
        if f.cause:
            faults.setdefault(f.stem, []).append(f)
    while len(out) < count:
        stem = r.choice(sorted(faults))
        a, b = r.sample(faults[stem], 2) if len(faults[stem]) > 1 else (None, None)
        if a is None or set(a.registers) & set(b.registers) or "*" in a.registers + b.registers:
            continue
        text = both(a, b)
        if text is not None and a.registers and b.registers:
            out.append((a, b, text))
    return out
