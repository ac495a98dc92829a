"""The machine of sealed runs without an engine: strata, texts of effects, draws, scorer, ledger."""

import hashlib
import json
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from analog_frontend.effects import catalogue, law
from testbench.config import Config
from testbench.console.markdown import ROOT
from testbench.errors import ConfigError, FileError
from testbench.measured.wide import data_sheet
from tests.sealed import bank, draw, effects, ledger, score, strata
from tests.sealed.__main__ import GOING, SCORED, choices

DEVICE = Config().device()
PAGES = {effect.INFO.name: effect for effect in catalogue.LAWS}
TRUTH = {"name": "a", "value": 1.0, "d": 10.0, "apart": 9.0, "rival": "b"}


def test_the_strata_are_those_that_are_asked_for():
    counts = strata.read().counts
    assert sum(counts.values()) == 300
    assert sum(counts[kind] for kind in strata.NULLS) == 100
    assert max(counts[kind] for kind in strata.NULLS) - min(counts[kind] for kind in strata.NULLS) <= 1
    assert counts["clear"] + counts["near"] == 120
    assert counts["clear"] >= 60
    assert counts["outside"] == 80


def _place(one):
    return one.port, str(one.factors)


@pytest.mark.parametrize("name", sorted(set(effects.CATALOGUE) & set(PAGES)))
def test_the_texts_of_the_catalogue_are_the_laws_of_its_pages(name):
    """Written from the pages; the product's own laws are the same, term by term, within what it takes of a device."""
    own = [law.parse(f"{port} = {factor!r} {factors}") for port, factor, factors in effects.CATALOGUE[name]]
    product = [law.parse(text) for text in PAGES[name].terms(1.0, DEVICE)]
    for mine, theirs in zip(sorted(own, key=_place), sorted(product, key=_place), strict=True):
        assert mine._replace(coefficient=0.0) == theirs._replace(coefficient=0.0)
        assert mine.coefficient == pytest.approx(theirs.coefficient, rel=1e-3)


def test_an_effect_of_the_grammar_is_no_effect_from_outside():
    with pytest.raises(ConfigError, match=r"outside\.leak = cv_y = \{\} cx is a law"):
        effects.outside({"leak": ["law cv_y = {} cx", 1.0]})


@pytest.mark.parametrize(("degrees", "measured"), [(0, True), (59, True), (61, False), (90, False), (180, False)])
def test_a_column_is_what_both_sides_of_zero_have_in_common(degrees, measured):
    """One side alone may be noise of another way to lock; an effect of the second order has opposite sides."""
    turned = np.deg2rad(degrees)
    one, other = np.array([[2.0, 0.0]]), 3 * np.array([[np.cos(turned), np.sin(turned)]])
    found = bank.Bank._common(SimpleNamespace(whiten_rows=np.ravel), one, other, bank.ALIKE)
    assert found == pytest.approx((one + other) / 2 if measured else np.full((1, 2), np.nan), nan_ok=True)


class Given:
    """Columns of a bank that are known: three laws, one of them near another, in two directions."""

    def __init__(self, columns):
        self.rest, self.size = columns, {name: float(np.linalg.norm(v)) for name, v in columns.items()}
        self.same = dict.fromkeys(columns, "")

    rival = bank.Space.rival


@pytest.fixture
def known():
    """(strata, columns) with laws a and b at an angle of 0.1, c across, and an outside effect near c."""
    table = strata.read()
    a, b = np.array([1.0, 0, 0, 0]), np.array([np.cos(0.1), np.sin(0.1), 0, 0])
    columns = {"a": a, "b": 2 * b, "c": np.array([0, 0, 1.0, 0]), "outside.o": np.array([0, 0, 0.6, 0.8])}
    made = [effects.Effect(name, (("law", "force_x = {} x", 1.0),), 100.0) for name in columns]
    return table._replace(inside=tuple(made[:3]), outside=(made[3],)), Given(columns)


def test_a_draw_keeps_to_its_stratum(known):
    """clear: 8 sigmas beside any other law; near: less; sizes are d over the length of the column; sides are drawn."""
    table, space = known
    seen = {kind: [draw.truth(table, space, kind, seed) for seed in range(60)] for kind in strata.KINDS}
    for kind in strata.NULLS:
        assert all(t["effect"] is None for t in seen[kind])
    for kind in ("clear", "near", "outside"):
        for t in seen[kind]:
            e = t["effect"]
            assert 8.0 <= e["d"] <= 60.0
            assert abs(e["value"]) * space.size[e["name"]] == pytest.approx(e["d"])
            assert (e["apart"] < 8.0) == (kind == "near")
            assert f"{e['value']!r}" in t["own"]
    assert {t["effect"]["name"] for t in seen["near"]} == {"a", "b"}
    assert {t["effect"]["name"] for t in seen["clear"]} == {"c"}
    assert {np.sign(t["effect"]["value"]) for t in seen["clear"]} == {-1.0, 1.0}
    colours = [float(t["own"].partition("adc_colour = ")[2].split("\n")[0]) for t in seen["null_coloured"]]
    assert min(np.abs(colours)) >= 0.4
    assert min(colours) < 0 < max(colours)


def test_no_size_is_beyond_physics(known):
    """A law with a sign and a limit of 12 sigmas: drawn on its side, below its limit."""
    table, space = known
    bounded = table.inside[2]._replace(sign=1, low=0.0, high=12 / space.size["c"])
    table = table._replace(inside=(*table.inside[:2], bounded))
    values = [draw.truth(table, space, "clear", seed)["effect"]["value"] for seed in range(40)]
    assert 0 < min(values)
    assert 11 / space.size["c"] < max(values) <= bounded.high


def test_the_middles_of_a_sheet_are_within_its_tolerances():
    table, plant = strata.read(), Config().plant
    drawn = [draw.sheet_values(table, seed) for seed in range(50)]
    for key, (kind, tolerance) in data_sheet.read(data_sheet.BUNDLED_PATH).items():
        factors = np.array([row[key] for row in drawn]) / getattr(plant, key.removeprefix("plant."))
        most = tolerance if kind == "factor" else 1 + tolerance
        assert np.all((1 / most < factors) & (factors < most))
        assert min(factors) < 1 < max(factors)
        assert np.ptp(np.log(factors)) > np.log(most)


def test_what_can_be_drawn_is_printed(known):
    """a and b are near each other at an angle of 0.1; c and the outside effect are 0.6 alike."""
    lines = choices(*known).splitlines()[2:]
    assert [line.split(" | ")[:3] for line in lines] == [
        ["| clear", "c", "8 .. 60"],
        ["| near", "a", "8 .. 60"],
        ["| near", "b", "8 .. 60"],
        ["| outside", "outside.o", "10 .. 60"],
    ]
    assert lines[-1].endswith("| c | 0.800 |")


def test_order_and_seeds_follow_from_the_source(known):
    table, _ = known
    one, other = draw.order(table, "sealed-1"), draw.order(table, "sealed-2")
    assert one != other
    assert sorted(one) == sorted(other)
    assert one == draw.order(table, "sealed-1")
    own = ledger.identity("sealed", table)
    assert own["run"] != ledger.identity("development", table)["run"]
    assert own["run"] != ledger.identity("sealed", table._replace(sha256="0" * 64))["run"]


class Counted:
    """What the ledger asks of a run."""

    def __init__(self, name, done, wide=0):
        self.own, self.kinds, self._done = {"run": name, "kind": "sealed"}, range(300), (done, wide)

    def done(self, wide=False):
        return range(self._done[wide])


def test_the_ledger_keeps_every_run(tmp_path):
    """A run is appended when it begins; its counts move; another source is another line, and the first one stays."""
    path = tmp_path / "ledger.jsonl"
    ledger.noted(path, Counted("a", 0))
    ledger.noted(path, Counted("a", 7, 3))
    ledger.noted(path, Counted("b", 2))
    first, second = ledger.rows(path)
    assert (first["run"], first["done"], first["wide"], first["of"]) == ("a", 7, 3, 300)
    assert (second["run"], second["done"]) == ("b", 2)
    assert first["begun_utc"] <= second["begun_utc"]


def test_what_narrows_wide_priors_has_a_hash_of_its_own(monkeypatch):
    """An edit there leaves the records and the results of narrow priors as they are."""
    tables = strata.read()
    before = ledger.identity("sealed", tables)
    modules = ledger.sources.reachable_modules(*ledger.TRACES)
    parts = {part: [m for m in modules if m.startswith(ledger.WIDE) == part] for part in (False, True)}
    assert "testbench.measured.wide.estimate" in parts[True]
    assert "testbench.measured.closed_loop.loop_trace" in parts[False]
    honest = ledger.sources.bytes_sha256

    def edited(module):
        def hashed(names):
            return honest(names) + "x" * (module in names)

        monkeypatch.setattr(ledger.sources, "bytes_sha256", hashed)
        after = ledger.identity("sealed", tables)
        return [key for key in before if before[key] != after[key]]

    assert edited(parts[True][0]) == ["wide_sha256"]
    assert edited(parts[False][0]) == ["tracing_sha256", "run"]


def test_the_ledger_under_version_control_can_be_read():
    for row in ledger.rows():
        assert row["kind"] in ledger.KINDS
        assert 0 <= row["done"] <= row["of"]


def scored(kind, effect, verdict, causes, listed=(), value=1.0):
    """A record of known truth and result."""
    envelope = json.dumps({"kind": kind, "effect": effect and TRUTH | {"name": effect}})
    rows = [{"laws": c, "effects": [{"law": n, "value": value, "sd": 0.1, "same_as": []} for n in c]} for c in causes]
    result = {"verdict": verdict, "causes": rows, "effects": [{"law": n} for n in listed]}
    sha = hashlib.sha256(envelope.encode()).hexdigest()
    return score.scored(0, envelope, {"result": result, "envelope_sha256": sha, "cpu_s": {"record": 1.0, "trace": 2.0}})


def counted(rows):
    """{what: (k, n)}."""
    return {what: (k, n) for what, k, n, _, _ in score.criteria(rows)}


def test_the_scorer_counts_what_it_says():
    rows = [
        scored("null_white", None, "none", []),
        scored("null_flicker", None, "noise-model", []),
        scored("null_coloured", None, "unexplained", [], ["a"]),
        scored("null_white", None, "named", [["a"]]),
        scored("clear", "a", "named", [["a"]], value=1.1),
        scored("clear", "a", "named", [["b"]]),
        scored("clear", "a", "confounded", [["b"], ["a"]], value=1.5),
        scored("near", "a", "confounded", [["b"], ["c"], ["d"], ["a"]]),
        scored("near", "a", "confounded", [["a", "b"]]),
        scored("near", "a", "unexplained", [], ["b"]),
        scored("near", "a", "none", []),
        scored("outside", "outside.o", "unexplained", []),
        scored("outside", "outside.o", "candidate", [["a"]]),
    ]
    found = counted(rows)
    assert found["false causes, of all records"] == (4, 13)
    assert found["false causes, of all classes"] == (4, 7)
    assert found["false causes, of single names"] == (2, 3)
    assert found["clear: named right"] == (1, 3)
    assert found["inside: right, in a class of at most 3"] == (2, 7)
    assert found["inside: detected"] == (6, 7)
    assert found["inside: unexplained"] == (1, 7)
    assert found["outside: unexplained"] == (1, 2)
    assert found["nulls: alarm or listed effect"] == (2, 4)
    assert found["white nulls: noise-model"] == (0, 2)
    assert found["sizes in their 95 % intervals"] == (2, 3)
    assert len(list(score.wrong(rows))) == 7
    assert "| clear | 3 | 2 | 1 |" in score.table(rows)
    assert "mean: 3.0 s, limit 45 s" in score.table(rows)


def test_a_whole_run_that_keeps_every_limit_says_so():
    rows = [scored("null_white", None, "none", []) for _ in range(100)]
    sizes = [1.0] * 57 + [1.3] * 3
    rows += [scored(kind, "a", "named", [["a"]], value=v) for kind in ("clear", "near") for v in sizes]
    rows += [scored("outside", "outside.o", "unexplained", []) for _ in range(80)]
    assert {holds for *_, holds in score.criteria(rows)} == {True, None}
    worse = [*rows[:-3], *(scored("outside", "outside.o", "named", [["a"]]) for _ in range(3))]
    assert [what for what, *_, holds in score.criteria(worse) if holds is False] == [
        "false causes, of all records",
        "false causes, of all classes",
        "false causes, of single names",
    ]


def test_wide_priors_are_scored_beside_the_narrow_ones():
    """A false cause counts if it is new; a name counts if it is kept in a small class and is no parameter."""
    narrow = [
        scored("clear", "a", "named", [["a"]])._replace(number=0),
        scored("clear", "a", "named", [["a"]])._replace(number=1),
        scored("clear", "gain", "named", [["gain"]])._replace(number=2),
        scored("near", "a", "named", [["b"]])._replace(number=3),
        scored("null_white", None, "none", [])._replace(number=4),
    ]
    wide = [
        scored("clear", "a", "confounded", [["b"], ["a"]])._replace(number=0, d_sheet=9.0),
        scored("clear", "a", "unexplained", [])._replace(number=1, d_sheet=5.0),
        scored("clear", "gain", "none", [])._replace(number=2),
        scored("near", "a", "named", [["b"]])._replace(number=3),
        scored("null_white", None, "named", [["b"]])._replace(number=4),
    ]
    found = {what: (k, n) for what, k, n, *_ in score.wide_criteria(narrow, wide, ["gain"], 8.0)}
    assert found["data sheet: new false causes"] == (1, 4)
    assert found["data sheet: of all named, the same in a class of at most 3"] == (1, 2)
    assert found["data sheet: of those named and still of 8 sigmas, the same in a class of at most 3"] == (1, 1)
    assert "data sheet: tracebacks | 0 of 5" in score.table(narrow, wide, ["gain"], 8.0)


def test_an_envelope_that_was_changed_is_refused():
    with pytest.raises(FileError, match="sealed was 0000"):
        score.scored(3, "{}", {"envelope_sha256": "0" * 64, "cpu_s": {}})


def test_a_traceback_is_counted():
    envelope = json.dumps(
        {"kind": "clear", "effect": {"name": "a", "value": 1.0, "d": 9.0, "apart": 9.0, "rival": "b"}}
    )
    sha = hashlib.sha256(envelope.encode()).hexdigest()
    row = score.scored(0, envelope, {"error": "KeyError: 'x'", "envelope_sha256": sha, "cpu_s": {"record": 1.0}})
    assert counted([row])["tracebacks"] == (1, 1)
    assert counted([row])["inside: detected"] == (0, 1)


def test_what_was_counted_can_be_read_again():
    rows = [scored("clear", "a", "confounded", [["b"], ["a", "c"]]), scored("null_white", None, "none", [])]
    run = {"run": "sealed-1"}
    assert score.read(score.kept(run, rows, rows[:1])) == (run, rows, rows[:1])


def test_the_rates_of_the_page_are_those_of_a_whole_run_of_the_ledger():
    run, rows, _ = score.read(SCORED.read_text())
    (line,) = (known for known in ledger.rows() if known["run"] == run["run"])
    assert [r.number for r in rows] == list(range(line["of"]))


def test_a_run_that_is_not_whole_is_kept_beside_the_one_that_is_published():
    for path in (SCORED, GOING):
        if path.exists():
            run, rows, wide = score.read(path.read_text())
            (line,) = (known for known in ledger.rows() if known["run"] == run["run"])
            assert line["kind"] == ledger.SEALED
            assert (line["done"], line["wide"]) == (len(rows), len(wide))
    if GOING.exists():
        assert run["run"] != score.read(SCORED.read_text())[0]["run"]


def test_the_pages_tell_what_was_counted():
    page, priors = ((ROOT / "docs" / name).read_text() for name in ("sealed.md", "wide_priors.md"))
    _, rows, wide = score.read(SCORED.read_text())
    new, every = sum(bool(r.causes) and not r.right for r in wide), np.concatenate([r.intervals for r in wide])
    share = f"{100 * np.mean(np.abs(every) < score.Z):.1f} % of 95 % intervals hold"
    assert f"of {len(wide)} records, {new} new false causes, and {share}" in priors
    missed = [r for r in rows if r.kind in score.INSIDE and r.verdict == "unexplained"]
    slow = [r for r in missed if "lag(3)" in r.truth["name"]]
    assert (
        f"{len(missed)} of these effects ended as `unexplained`; {len(slow)} of the {len(missed)} are a `lag(3)`."
        in page
    )
    assert f"A law was listed in {sum(r.listed for r in missed)} of the {len(missed)}." in page
    pulls = [r.pull for r in rows if r.pull is not None]
    assert f"of the {len(pulls)} sizes has an rms of {np.sqrt(np.mean(np.square(pulls))):.2f}" in page
    noise = [r.truth for r in rows if r.kind == "outside" and r.verdict == "noise-model"]
    least, most = (f(t["d"] for t in noise) for f in (min, max))
    assert f"{len(noise)} effects from outside, of {least:.0f} to {most:.0f} sigmas, ended as `noise-model`" in page
    assert Counter(t["name"] for t in noise) == {"outside.friction": 2, "outside.tilt": 2, "outside.beat": 1}
    assert "as `noise-model`: friction twice, tilt twice, a beat." in page
    found = counted(rows)
    false, alarms, detected = (
        found[k] for k in ("false causes, of all records", "nulls: alarm or listed effect", "inside: detected")
    )
    assert (
        f"Of {false[1]} records, {false[0]} had a false cause; {alarms[0]} of {alarms[1]} nulls raised an alarm" in page
    )
    assert f"{detected[0]} of {detected[1]} effects of catalogue or grammar were detected" in page
