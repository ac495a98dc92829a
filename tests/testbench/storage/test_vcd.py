"""Waveforms: an independent reader finds every register at every edge; the viewers' set-ups name what is there."""

import itertools
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vcd.reader import TokenKind, tokenize

from fpga_model.fixed import Fmt
from testbench.errors import FileError
from testbench.storage import vcd
from testbench.storage.vcd import Signal
from tests import naive


def parse(path):
    """(timescale, {dotted name: (width, [(time, value)])}) as pyvcd reads the file."""
    scopes, names, changes, now, scale = [], {}, {}, 0, None
    with open(path, "rb") as file:
        for token in tokenize(file):
            if token.kind is TokenKind.TIMESCALE:
                scale = token.data
            elif token.kind is TokenKind.SCOPE:
                scopes.append(token.data.ident)
            elif token.kind is TokenKind.UPSCOPE:
                scopes.pop()
            elif token.kind is TokenKind.VAR:
                span = None if token.data.size == 1 else (token.data.size - 1, 0)
                assert token.data.bit_index == span
                assert token.data.id_code not in names, "identifiers must be unique"
                names[token.data.id_code] = ".".join([*scopes, token.data.reference])
                changes[names[token.data.id_code]] = (token.data.size, [])
            elif token.kind is TokenKind.CHANGE_TIME:
                assert token.data >= now
                now = token.data
            elif token.kind is TokenKind.CHANGE_SCALAR:
                changes[names[token.data.id_code]][1].append((now, int(token.data.value)))
            elif token.kind is TokenKind.CHANGE_VECTOR:
                changes[names[token.data.id_code]][1].append((now, token.data.value))
    return scale, changes


def sampled(changes, times):
    """Value at each time: the last change at or before it."""
    stamps = np.array([t for t, _ in changes])
    return [changes[k][1] for k in np.searchsorted(stamps, times, side="right") - 1]


@st.composite
def windows(draw):
    widths = draw(st.lists(st.tuples(st.integers(1, 64), st.booleans()), min_size=1, max_size=6))
    listed = [Signal(f"block{k % 3}.reg{k}", width, is_signed) for k, (width, is_signed) in enumerate(widths)]
    count = draw(st.integers(1, 40))
    columns = []
    for _, width, is_signed in listed:
        lo, hi = (-(1 << (width - 1)), (1 << (width - 1)) - 1) if is_signed or width == 64 else (0, (1 << width) - 1)
        corner = st.sampled_from([lo, hi, 0, max(lo, -1), min(hi, 1)])
        columns.append(draw(st.lists(corner | st.integers(lo, hi), min_size=count, max_size=count)))
    return listed, np.array(columns, np.int64).T


@settings(max_examples=60)
@given(windows(), st.sampled_from([1, 3, 4096]))
def test_every_register_is_there_at_every_edge(tmp_path_factory, window, block_rows):
    listed, rows = window
    path = tmp_path_factory.mktemp("vcd") / "run.vcd"
    before = vcd.BLOCK_ROWS
    vcd.BLOCK_ROWS = block_rows
    try:
        vcd.write_vcd(path, rows, listed, first_edge=7)
    finally:
        vcd.BLOCK_ROWS = before
    scale, changes = parse(path)
    assert str(scale) == "1 ps"
    times = [naive.edge_picoseconds(k) for k in range(len(rows))]
    for column, signal in enumerate(listed):
        width, found = changes[f"gyro.{signal.name}"]
        assert width == signal.width
        want = [value & ((1 << width) - 1) for value in rows[:, column].tolist()]
        assert sampled(found, times) == want
        assert all(a[1] != b[1] for a, b in itertools.pairwise(found)), "a value that stays is not written again"
    _, clock = changes["gyro.clk_26m"]
    assert [t for t, level in clock if level] == [naive.edge_picoseconds(k) for k in range(len(rows) + 1)]
    assert [t for t, level in clock if not level] == [naive.edge_picoseconds(2 * k + 1, 52) for k in range(len(rows))]


@pytest.mark.parametrize("block_rows", [1, 4096])
def test_what_is_not_known_is_x(tmp_path, monkeypatch, block_rows):
    monkeypatch.setattr(vcd, "BLOCK_ROWS", block_rows)
    rows, known = np.array([[1, 5], [1, 5], [1, 5], [0, 6]]), np.ones((4, 2), bool)
    known[1, 0] = known[2, :] = False
    vcd.write_vcd(tmp_path / "run.vcd", rows, [Signal("a", 1), Signal("b", 3)], is_valid=known)
    text = (tmp_path / "run.vcd").read_text()
    found = [re.findall(rf"^(\S+?) ?{re.escape(ident)}$", text, re.M) for ident in ('"', "#")]
    assert found == [["1", "x", "0"], ["b101", "bxxx", "b110"]]
    assert sum(line.startswith("#") for line in text.splitlines()) == 2 * 4 + 1


def test_times_are_the_nearest_picoseconds_far_from_the_start():
    edges = [0, 1, 12, 13, 26_000_000, 10**12 + 7]
    assert vcd.picoseconds(edges).tolist() == [naive.edge_picoseconds(k) for k in edges]


def test_the_clock_of_another_design(tmp_path):
    vcd.write_vcd(tmp_path / "run.vcd", np.arange(5)[:, None], [Signal("a", 4)], clock_hz=24_000_000)
    _, changes = parse(tmp_path / "run.vcd")
    _, clock = changes["gyro.clk_26m"]
    assert [t for t, level in clock if level] == [0, 41_667, 83_333, 125_000, 166_667, 208_333]
    assert "/ 24 MHz" in (tmp_path / "run.vcd").read_text()


def test_many_signals_have_short_unique_identifiers():
    ids = [vcd._identifier(k) for k in range(10_000)]
    assert len(set(ids)) == len(ids)
    assert max(map(len, ids)) == 3
    assert all(33 <= ord(c) <= 126 for c in "".join(ids))


def test_a_hundred_thousand_rows_are_written_whole(tmp_path):
    count = 100_000
    edge = np.arange(count)
    slow = [np.repeat(edge[:100] * (k + 1), 1000) for k in range(40)]
    rows = np.array([edge * 119_000_000_003 % (1 << 48), edge & 1, edge >> 3 & 1, *slow], np.int64).T
    listed = [Signal("dds.phase", 48), Signal("pins.a", 1), Signal("pins.b", 1)]
    listed += [Signal(f"slow.r{k}", 24) for k in range(40)]
    vcd.write_vcd(tmp_path / "run.vcd", rows, listed)
    with open(tmp_path / "run.vcd", "rb") as file:
        text = file.read()
    ident = re.search(rb"\$var reg 48 (\S+) phase", text)[1]
    found = re.findall(rb"^b([01]{48}) " + re.escape(ident) + b"$", text, re.MULTILINE)
    assert [int(word, 2) for word in found] == rows[:, 0].tolist()
    assert text.endswith(f"#{naive.edge_picoseconds(count)}\n1!\n".encode())


def test_formats_become_widths_and_signs():
    listed = vcd.signals(["a", "b"], [Fmt(1, 0, 17), Fmt(0, 0, 48)])
    assert listed == [Signal("a", 18, True), Signal("b", 48, False)]


@pytest.mark.parametrize(
    ("rows", "listed", "words"),
    [
        ([[1]], [Signal("a", 1), Signal("b", 1)], "int64 rows of 2 columns"),
        ([[2]], [Signal("a", 1)], "signal a: 2..2 is outside 0..1, its 1 bits"),
        ([[-1]], [Signal("a", 8)], "outside 0..255"),
        ([[-129]], [Signal("a", 8, True)], "outside -128..127"),
        ([[1]], [Signal("a", 0)], "width 0"),
        ([[1]], [Signal("a", 65)], "width 65"),
        ([[1, 1]], [Signal("a.b", 1), Signal("a.b.c", 1)], "b is the name of both a signal and a scope"),
        ([[1, 1]], [Signal("a.b", 1), Signal("a.b", 1)], "is a duplicate"),
        (np.zeros((0, 1), np.int64), [Signal("a", 1)], "int64 rows"),
        ([[1.5]], [Signal("a", 1)], "int64 rows"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, rows, listed, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        vcd.write_vcd(tmp_path / "run.vcd", rows, listed)
    assert list(tmp_path.iterdir()) == []


def test_an_unwritable_place_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match=r"run\.vcd: cannot be written: "):
        vcd.write_vcd(tmp_path / "file" / "run.vcd", [[1]], [Signal("a", 1)])


# ---- set-ups of viewers ----------------------------------------------------------------------------------------------

LISTED = [
    Signal("pins.sync_n", 1),
    Signal("pins.sdin", 1),
    Signal("dds.phase", 48),
    Signal("sine.y", 18, True),
    Signal("loops.agc.acc", 50, True),
    Signal("frame", 7),
    *(Signal(f"many.r{k}", 8) for k in range(20)),
]


@pytest.fixture
def window(tmp_path):
    rows = np.zeros((4, len(LISTED)), np.int64)
    return vcd.write_window(tmp_path / "run.vcd", rows, LISTED, analog=("sine.y",))


def test_gtkwave_set_up_names_every_signal_with_a_format_that_fits(window):
    _, changes = parse(window[0])
    lines = window[1].read_text().splitlines()
    assert '[dumpfile] "run.vcd"' in lines
    flags, shown, opened = {}, [], []
    flag = None
    for line in lines:
        if line.startswith("@"):
            flag = int(line[1:], 16)
        elif line.startswith("gyro."):
            name = line.partition("[")[0]
            shown.append(name)
            flags[name] = flag
            width = changes[name][0]
            assert line == (name if width == 1 else f"{name}[{width - 1}:0]")
        elif line.startswith("-") and len(line) > 1:
            if flag in (0x800200, 0xC00200):
                opened.append(line)
            else:
                assert flag in (0x1000200, 0x1401200), "begin and end of a group must match"
                assert opened.pop() == line
    assert opened == []
    assert sorted(shown) == sorted(changes)
    assert flags["gyro.dds.phase"] == vcd.GTKW_HEX
    assert flags["gyro.sine.y"] == vcd.GTKW_SIGNED | vcd.GTKW_ANALOG
    assert flags["gyro.loops.agc.acc"] == vcd.GTKW_SIGNED
    assert flags["gyro.frame"] == vcd.GTKW_UNSIGNED
    assert flags["gyro.pins.sdin"] == vcd.GTKW_BINARY


def test_surfer_set_up_focuses_the_item_it_formats(window):
    _, changes = parse(window[0])
    items, focus, formats = [], None, {}
    for line in window[2].read_text().splitlines():
        command, _, word = line.partition(" ")
        if command in ("variable_add", "divider_add"):
            items.append(word)
        elif command == "item_focus":
            letters = word.partition("_")[0]
            focus = int("".join(f"{ord(c) - ord('a'):x}" for c in letters), 16)
        elif command == "item_set_format":
            formats[items[focus]] = word
        else:
            assert command in ("#", "item_unfocus", "zoom_fit")
    assert [item for item in items if item.startswith("gyro.")] == list(changes)
    wanted = {f"gyro.{s.name}": "Signed" if s.signed else "Unsigned" for s in LISTED if s.width > 1}
    assert formats == {**wanted, "gyro.dds.phase": "Hexadecimal"}
