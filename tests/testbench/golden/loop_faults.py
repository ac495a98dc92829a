"""Faults planted in the reference RTL for the loop, a number of each kind, all in one design: a file selects one.

A fault is a right-hand side or a condition that is replaced: (selected == N) ? (wrong) : (right). So one build holds
all. Lines are drawn by seed, at most one fault to a line. The notch and the demodulator in the FPGA, which the
analog board has not, are left out.
"""

import re
import shutil
from typing import NamedTuple

import numpy as np

from testbench.golden.loop import library
from testbench.golden.recording import board_recording as wrapper
from tests.testbench.golden import pin_tops
from tests.testbench.rtl.test_rtl import RTL

LEFT_OUT = ("notch", "digital_sid", "spi_slave", "axi_slave", "host_bus", "host_words", "host", "host_axi")
SELECTED = "gyro_fault::selected"
PACKAGE = "package gyro_fault;\n    int selected = 0;\nendpackage\n"
STATEMENT = re.compile(r"^(\s*(?:wire [^=]*= |assign \w+ = |\w+ *<= ))(.+)(;\s*(?://.*)?)$")
CONDITION = re.compile(r"^(\s*(?:end )?(?:else )?if \()(.+)(\)(?: begin)?\s*)$")
NUMBER = re.compile(r"\b(\d+)'d(\d+)\b")
SHIFT = re.compile(r"(>>>|>>|<<) (\w+)")
REGISTER = re.compile(r"\br_\w+\b")


class Fault(NamedTuple):
    kind: str
    file: str
    line: int
    right: str
    wrong: str


def swapped(pattern, other):
    """A mutator: the first match of a pattern replaced."""
    return lambda text: re.sub(pattern, other, text, count=1)


def _more(text):
    """The first number of a text, one more; not where it would not fit."""
    found = NUMBER.search(text)
    if not found or int(found[2]) + 1 >= 1 << int(found[1]):
        return text
    return f"{text[: found.start()]}{found[1]}'d{int(found[2]) + 1}{text[found.end() :]}"


def _branches(text):
    parts = re.fullmatch(r"([^?:{}]+)\?([^?:{}]+):([^?:{}]+)", text)
    return f"{parts[1]}?{parts[3]}:{parts[2]}" if parts else text


# Of a statement outside of the reset, of a condition, and of a statement in the branch of the reset
STATEMENTS = {
    "constant one more": _more,
    "sign of a sum": swapped(r"(?<=\w) \+ (?=\w)", " - "),
    "half constant one less": swapped(r"\b(HALF\w*|half)\b", r"(\1 - 1)"),
    "shift by one more": swapped(SHIFT, r"\1 (\2 + 1)"),
    "comparison off by one": lambda t: swapped(r" < ", " <= ")(t) if " < " in t else swapped(r" > ", " >= ")(t),
    "and for or": lambda t: swapped(r" && ", " || ")(t) if " && " in t else swapped(r" \| ", " & ")(t),
    "inversion missing": swapped(r"~(?=[\w(])", ""),
    "branches exchanged": _branches,
    "least bit inverted": lambda t: f"({t}) ^ 1'b1",
}
CONDITIONS = {
    "condition always true": lambda t: (
        "1'b1" if re.fullmatch(r"\w*en\w*|\w*ce\w*|\w*load\w*|at_\w+|\w*strobe\w*", t) else t
    ),
    "condition off by one": lambda t: _more(t) if "==" in t else t,
    "and for or in a condition": lambda t: swapped(r" && ", " || ")(t),
}
RESETS = {"reset value one more": _more, "register without reset": None}
KINDS = (*STATEMENTS, *CONDITIONS, *RESETS)


def _candidates():
    """{kind: [Fault]} of all lines."""
    found = {kind: [] for kind in KINDS}

    def add(kind, path, number, right, wrong):
        if wrong != right:
            found[kind].append(Fault(kind, path.name, number, right, wrong))

    for path in sorted(RTL.glob("*.v")):
        if path.stem in LEFT_OUT:
            continue
        in_reset = False
        for number, line in enumerate(path.read_text().splitlines()):
            condition, statement = CONDITION.match(line), STATEMENT.match(line)
            if condition and condition[2] == "rst":
                in_reset = True
            elif in_reset and re.match(r"\s*end\b", line):
                in_reset = False
            elif condition:
                for kind, mutate in CONDITIONS.items():
                    add(kind, path, number, condition[2], mutate(condition[2]))
            elif statement and in_reset:
                add("reset value one more", path, number, statement[2], _more_of_reset(statement[2]))
                add("register without reset", path, number, statement[2], statement[1].split()[0])
            elif statement:
                for kind, mutate in STATEMENTS.items():
                    add(kind, path, number, statement[2], mutate(statement[2]))
    return found


def _more_of_reset(text):
    return _more(text) if NUMBER.search(text) else f"({text}) + 1"


def drawn(count, seed):
    """`count` faults, of all kinds in turn, at most one to a line."""
    rng, listed = np.random.default_rng(seed), _candidates()
    for kind in KINDS:
        rng.shuffle(listed[kind])
    found, taken = [], set()
    while len(found) < count and any(listed.values()):
        for kind in KINDS:
            while listed[kind] and len(found) < count:
                fault = Fault(*listed[kind].pop())
                if (fault.file, fault.line) not in taken:
                    taken.add((fault.file, fault.line))
                    found.append(fault._replace(line=int(fault.line)))
                    break
    return found


def write(folder, firmware, faults):
    """A design with all faults and the pins of the board; `folder`/selected says which is in force, 0 for none."""
    pin_tops.board(folder, firmware, _edits(faults))
    (folder / "gyro_fault.sv").write_text(PACKAGE)
    path = folder / f"{wrapper.MODULE}.v"
    text = path.read_text()
    path.unlink()
    # a package comes before what uses it
    names = ["gyro_fault.sv", *sorted(p.name for p in folder.glob("*.v")), "gyro_board.sv"]
    (folder / "gyro_board.sv").write_text(text.replace(");\n\n    gyro_top", f");\n{_start(folder)}\n    gyro_top", 1))
    (folder / "all.f").write_text("\n".join(names) + "\n")
    select(folder, 0)
    return folder


def write_registers(folder, faults):
    """The same with the registers of gyro_top as ports."""
    shutil.copytree(RTL, folder, ignore=shutil.ignore_patterns("formal", "example", "quartus", "*.vhd"))
    for name, edit in _edits(faults).items():
        (folder / name).write_text(edit((folder / name).read_text()))
    first, last = library.sources(folder)[0], folder / "top.v"
    first.write_text(PACKAGE + first.read_text())
    last.write_text(last.read_text().replace("\n);\n", f"\n);\n{_start(folder)}", 1))
    select(folder, 0)
    return folder


def _edits(faults):
    """{file: function of its text}."""
    edits = {}
    for number, fault in enumerate(faults, 1):
        edits.setdefault(fault.file, []).append((number, fault))

    def edit(listed):
        def edited(text):
            lines = text.splitlines()
            for number, fault in listed:
                line = lines[fault.line]
                found = STATEMENT.match(line) or CONDITION.match(line)
                assert found[2] == fault.right, (fault, line)
                chosen = f"({SELECTED} == {number}) ? ({fault.wrong}) : ({fault.right})"
                lines[fault.line] = f"{found[1]}{chosen}{found[3]}"
            return "\n".join(lines) + "\n"

        return edited

    return {name: edit(listed) for name, listed in edits.items()}


def _start(folder):
    """Text that reads which fault is in force."""
    return f"""
    integer fault_file, fault_got;
    initial begin
        fault_file = $fopen("{folder / "selected"}", "r");
        fault_got = $fscanf(fault_file, "%d", {SELECTED});
        $fclose(fault_file);
    end
"""


def select(folder, number):
    """Choose the fault that the next instance has."""
    (folder / "selected").write_text(f"{number}\n")
