"""Recordings of parts in any table with a column map: as from the published formats; every error is one line."""

import numpy as np
import pytest

from testbench.errors import FileError
from testbench.measured.formats import readers, sheets
from testbench.measured.quality.finding import QualityError
from tests.testbench.measured.quality import siblings
from tests.testbench.measured.quality.mapped import mapped

NOT_NUMBERS = ("path", "sha256", "header", "comments", "names", "quality", "polar", "decibels", "regular")
NOT_NUMBERS += ("rounding_hz", "kind")


@pytest.mark.parametrize(
    ("kind", "form"), list(zip(siblings.KINDS, ("csv", "mat", "npz", "parquet", "csv", "mat", "npz")))
)
def test_a_map_gives_what_the_published_format_gives(tmp_path, kind, form):
    whole = siblings.draw(kind, np.random.default_rng(8))
    first = readers.content(siblings.write(whole, tmp_path / "published"))
    path = mapped(whole, form, tmp_path)
    second = readers.content(path)
    assert type(second) is type(first)
    for name in first._fields:
        a, b = getattr(first, name), getattr(second, name)
        if name in NOT_NUMBERS:
            continue
        if isinstance(a, dict):
            a, b = (list(d.values())[: min(len(a), len(b))] for d in (a, b))
        if kind == "sweep" and name == "s":
            a, b = first.s["s21"], second.s["s21"]
        if kind == "rest" and name in ("counts", "lsb_deg_per_s"):
            a, b = first.counts * first.lsb_deg_per_s, second.counts * second.lsb_deg_per_s
        if a is None or isinstance(a, bool):
            assert a == b
            continue
        tolerance = {"rtol": 1e-6, "atol": 1e-6 * np.max(np.abs(np.asarray(a)), initial=0)}
        np.testing.assert_allclose(np.asarray(b, complex), np.asarray(a, complex), **tolerance, err_msg=name)
    assert sheets.examine([path]) == ()


def ring(tmp_path, **changes):
    """A map of a ring-down with one line changed."""
    whole = siblings.draw("ringdown", np.random.default_rng(8))
    lines = mapped(whole, "csv", tmp_path).read_text()
    for old, new in changes.values():
        assert old in lines
        lines = lines.replace(old, new)
    (tmp_path / "map.toml").write_text(lines)
    return tmp_path / "map.toml"


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('file = "data"', 'file = "../data"', "is outside the folder of the map"),
        ('file = "data"', 'file = "nothing"', "cannot be read"),
        ('"c1"', '"c9"', "no column 'c9'; known: c0, c1"),
        ('unit = "ms"', 'unit = "mV"', "unit 'mV' is none of s, ms"),
        ("power =", "volts =", "columns.volts: is not a role of kind ring-down; known: time, power"),
        ('power = {column = "c1", unit = "mW"}', "", "needs power; add them to the map"),
        ("[head]", "[head]\ncolour = 1", "head.colour: is not a known key"),
        ('kind = "ring-down"', 'kind = "ring-down"\nextra = 1', "extra"),
        ('unit = "ms"', 'unit = "ms", range = [0, 1]', "unit: c0.*outside 0 .. 1 ms"),
    ],
)
def test_a_wrong_map_is_one_line(tmp_path, old, new, reason):
    with pytest.raises(FileError, match=reason):
        readers.content(ring(tmp_path, only=(old, new)))


def test_a_range_tells_a_slip_of_the_unit(tmp_path):
    path = ring(tmp_path, only=('unit = "ms"', 'unit = "ms", range = [0, 1000]'))
    with pytest.raises(QualityError) as refused:
        readers.content(path)
    assert [f.kind for f in refused.value.findings] == ["unit"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("% t [s], p [dBm]\n1, 2\n", "expected '% time \\[s\\]"),
        ("# Hz Z RI R 50\n1 2 3\n", "Touchstone: found '# Hz Z RI R 50'"),
        ("Date;Volt;a\n", "expected 'date;source;...'"),
        ("t,v\n1,2\n", "a table of columns t, v: write a column map"),
    ],
)
def test_the_nearest_reader_says_what_it_lacks(tmp_path, text, said):
    from testbench.measured.openers import open_problem

    (tmp_path / "x").write_text(text)
    with pytest.raises(FileError, match=said):
        open_problem([tmp_path / "x"], {})
