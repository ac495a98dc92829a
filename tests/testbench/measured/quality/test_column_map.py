"""Recordings of parts in any table with a column map: as from the published formats; every error is one line."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from testbench.errors import FileError
from testbench.measured import cli
from testbench.measured.formats import readers, sheets
from testbench.measured.quality.finding import QualityError
from tests.testbench.measured.parts import recordings
from tests.testbench.measured.quality import siblings
from tests.testbench.measured.quality.mapped import mapped

PAGE = Path(__file__).resolve().parents[4] / "docs" / "quality.md"
EXAMPLES = re.findall(r"^    kind = .*(?:\n(?:    .*)?)*", PAGE.read_text(), re.M)
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
        ('power = {column = "c1", unit = "mW"}', "", "needs power or amplitude, one of them; add them to the map"),
        ('unit = "mW"', 'unit = "mV"', "is none of dBm, .*uW, nW; .* write the role amplitude"),
        ('power = {column = "c1", unit = "mW"}', 'power = "c1"', 'power: expected {column = "NAME", unit = "UNIT"}'),
        ('column = "c1"', "column = 1", "power: expected {column = .*name as text"),
        (
            'kind = "ring-down"',
            'kind = "ringdown"',
            "kind 'ringdown' is unknown; known: ring-down, .*nearest is ring-d",
        ),
        ('kind = "ring-down"', "", "is TOML, but no column map .*it has no kind"),
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
        ("t,v\n1,2\n", "a table of columns t, v; for the closed loop .*gyro measured import .* write a column map"),
    ],
)
def test_the_nearest_reader_says_what_it_lacks(tmp_path, text, said):
    from testbench.measured.openers import open_problem

    (tmp_path / "x").write_text(text)
    with pytest.raises(FileError, match=said):
        open_problem([tmp_path / "x"], {})


def output(*arguments):
    """What `gyro measured` prints; an error is its text."""
    done = CliRunner().invoke(cli.app, [str(a) for a in arguments])
    return done.output + str(done.exception or "")


def ring_maps(folder, role, unit, of_power_uw):
    """Maps of two ring-downs with cubic damping, 0.06 P^2; their columns are functions of the power (uW)."""
    t, paths = np.linspace(0.0, 40.0, 240), []
    for k, level in enumerate((1.0, 0.7)):
        power = recordings.decay(t, level, 0.1, lambda p: 0.06 * p * p, np.random.default_rng(3 + k))
        column = of_power_uw(10 ** ((power + 30) / 10))
        np.savetxt(folder / f"{k}.csv", np.c_[t, column], delimiter=",", header="t,v", comments="")
        paths.append(folder / f"monday{k}.toml")
        lines = ('kind = "ring-down"', f'file = "{k}.csv"', "[columns]", 'time = {column = "t", unit = "s"}')
        paths[-1].write_text("\n".join((*lines, f'{role} = {{column = "v", unit = "{unit}"}}')))
    return paths


@pytest.mark.parametrize(
    ("role", "unit", "of_power_uw", "law_unit"),
    [("power", "nW", lambda p: 1e3 * p, "1/(s uW)"), ("amplitude", "mV", np.sqrt, "1/(s mV^2)")],
)
def test_two_ring_downs_by_maps_are_repeats(tmp_path, role, unit, of_power_uw, law_unit):
    """Runs are called as their maps; an amplitude a has the law of the power a^2, in its own unit."""
    paths = ring_maps(tmp_path, role, unit, of_power_uw)
    from testbench.measured.openers import open_problem

    problem = open_problem(paths, {})
    assert {s.name: s.role for s in problem.segments}.keys() == {"run_monday0", "run_monday1"}
    assert problem.heldout_independent
    data = tmp_path / "data.json"
    text = output("trace", *paths, "--json", data)
    assert "run monday" in text
    assert "add a second recording" not in text
    (effect,) = json.loads(data.read_text())["effects"]
    assert (effect["law"], effect["status"], effect["unit"]) == ("damping_cubic", "named", law_unit)
    assert effect["value"] == pytest.approx(0.06, rel=0.05)


def test_a_single_ring_down_says_what_confirms_it(tmp_path):
    text = output("trace", ring_maps(tmp_path, "power", "uW", lambda p: p)[0])
    assert text.startswith("candidate")
    assert "odd blocks of run monday0" in text
    assert "next step: add a second recording: gyro measured trace FILE1 FILE2" in text


def test_maps_of_equal_name_in_two_folders_are_two_runs(tmp_path):
    paths = []
    for k, name in enumerate("ab"):
        (tmp_path / name).mkdir()
        paths.append(ring_maps(tmp_path / name, "power", "uW", lambda p, k=k: p * 1.1**k)[k].rename(
            tmp_path / name / "run.toml"))  # fmt: skip
    from testbench.measured.openers import open_problem

    assert {s.name for s in open_problem(paths, {}).segments} == {"run_run-1", "run_run-2"}


def levels_map(folder, codes, under_columns=""):
    """Map of levels at codes."""
    np.savetxt(folder / "l.csv", np.c_[codes, 1e-3 * codes], delimiter=",", header="c,v", comments="")
    text = 'kind = "levels"\nfile = "l.csv"\n[columns]\ncode = {column = "c"}\n' + under_columns
    (folder / "levels.toml").write_text(text + ("" if under_columns else '[[levels]]\ncolumn = "v"\nunit = "V"\n'))
    return folder / "levels.toml"


@pytest.mark.parametrize(
    ("codes", "reason"),
    [
        (256 * np.arange(256), r"256 levels: found 0 \.\. 65280 in steps of 256; expected N = 2\^9 .* kind meters"),
        (np.arange(256), r"found 0 \.\. 255 in steps of 1; expected N = 2\^9"),
        (np.arange(512) // 2, r"512 levels: found 0 \.\. 255 in steps of 1 \(256 different\)"),
    ],
)
def test_levels_at_other_codes_are_described(tmp_path, codes, reason):
    with pytest.raises(FileError, match=reason):
        readers.content(levels_map(tmp_path, codes))


def test_512_levels_are_read_and_their_codes_need_no_unit(tmp_path):
    assert readers.content(levels_map(tmp_path, np.arange(512))).bits == 9


@pytest.mark.parametrize("line", ['levels = {column = "v", unit = "V"}', '[levels]\ncolumn = "v"\nunit = "V"'])
def test_several_columns_stand_outside(tmp_path, line):
    path = levels_map(tmp_path, np.arange(512), line)
    with pytest.raises(FileError, match=r"levels: several columns are allowed, so write \[\[levels\]\] outside"):
        readers.content(path)


def test_a_wrong_or_misplaced_file_is_told_the_way(tmp_path):
    bench, csv = tmp_path / "bench.toml", tmp_path / "t.csv"
    bench.write_text('[columns]\nadc_xI = {column = "a"}\n[[segment]]\nid = "d"\nkind = "sweep"\n')
    csv.write_text("t,v\n1,2\n")
    assert f"gyro measured import DATA --map {bench} -o FILE.h5" in output("trace", bench)
    part = ring_maps(tmp_path, "power", "uW", lambda p: p)[0]
    assert f"column map of a part; run gyro measured trace {part}" in output(
        "import", csv, "--map", part, "-o", tmp_path / "x.h5"
    )
    for arguments in (("trace", csv), ("check", csv), ("import", csv)):
        text = output(*arguments)
        assert "gyro measured import FILE --map MAP.toml -o FILE.h5" in text
        assert "write a column map, docs/quality.md" in text
    assert f"{csv}: unknown kind of content" in output("trace", part, csv)


def test_files_that_are_not_traced_together_are_told(tmp_path):
    paths = []
    for kind in ("meters", "rest"):
        for k in range(2):
            (tmp_path / f"{kind}{k}").mkdir()
            paths.append(mapped(siblings.draw(kind, np.random.default_rng(k)), "npz", tmp_path / f"{kind}{k}"))
    quality = ("--option", "quality=report")
    assert "2 files of kind meters, which takes one; trace each by itself" in output("trace", *paths[:2], *quality)
    assert "files of several kinds (meters, rest)" in output("trace", *paths[1:3], *quality)


def test_rivals_are_printed_under_the_effects(capsys):
    effect = {"law": "gain", "port": "adc", "value": 1.0, "sd": 0.1, "unit": "uV", "d": 9.0, "status": "confounded"}
    cli._print_trace(
        {"verdict": "confounded", "sentence": "", "effects": [effect | {"rivals": ["bow", "drift"]}], "heldout": {}}
    )
    assert "gain: cannot be distinguished from: bow, drift" in capsys.readouterr().out


@pytest.mark.parametrize("text", EXAMPLES, ids=lambda text: tomllib.loads(text)["kind"])
def test_the_maps_of_the_page_are_read(tmp_path, text):
    data, ramp = tomllib.loads(text), np.linspace(0.1, 1.0, 512)
    roles = [*data["columns"].values(), *(r for v in data.values() if isinstance(v, list) for r in v)]
    columns = {r["column"]: np.arange(512) if r["column"] == "code" else ramp for r in roles}
    np.savetxt(tmp_path / data["file"], np.c_[*columns.values()], delimiter=",", header=",".join(columns), comments="")
    (tmp_path / "map.toml").write_text(text)
    assert readers.content(tmp_path / "map.toml") is not None


def test_the_page_has_a_map_of_the_usual_kinds():
    assert {tomllib.loads(text)["kind"] for text in EXAMPLES} >= {"ring-down", "levels", "meters", "sweep"}


def test_a_toml_file_is_never_a_table(tmp_path):
    for name, text, reason in (
        ("a.toml", "t,v\n1,2\n", "is not TOML"),
        ("b.bin", "[plan]\nrepeats = 2\n", "is TOML, but no column map"),
        ("c.txt", "Sample = A7\nt,v\n1,2\n", "unknown kind of content"),
    ):
        (tmp_path / name).write_text("\n" * 3000 + text)
        assert reason in output("trace", tmp_path / name)
