"""`make rtl`: parts one after the other, their times, and an exit code that is 0 only if all of them passed."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from testbench.errors import ConfigError, FileError
from testbench.golden import rtl_verification
from testbench.golden.bundles import scores
from testbench.golden.mutation import mutate
from testbench.golden.mutation.mutate import Outcome
from testbench.golden.proofs import formal
from testbench.golden.stimulus import blocks
from tests.testbench.rtl.test_rtl import RTL

ROOT = Path(__file__).resolve().parents[3]


def test_times_and_exit_code(tmp_path, monkeypatch, capsys):
    seen = []
    parts = {"good": lambda *_: seen.append("good") or True, "bad": lambda *_: False}
    monkeypatch.setattr(rtl_verification, "PARTS", parts)
    assert rtl_verification.main(["good", "--out", str(tmp_path)]) == 0
    assert rtl_verification.main(["--out", str(tmp_path)]) == 1
    assert seen == ["good", "good"]
    said = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"PASS  good +\d+\.\d s", said[-3])
    assert re.fullmatch(r"FAIL  bad +\d+\.\d s", said[-2])
    assert re.fullmatch(r"      all +\d+\.\d s", said[-1])
    took = json.loads((tmp_path / "rtl.json").read_text())
    assert {name: found["passed"] for name, found in took.items()} == {"good": True, "bad": False}
    assert all(set(found) == {"passed", "seconds", "cpu_s"} for found in took.values())


def test_what_cannot_be_done_is_one_line(tmp_path, monkeypatch, capsys):
    assert rtl_verification.main(["everything"]) == 2
    assert capsys.readouterr().err == (
        "gyro: part: 'everything' is not one of bundles, loop, proofs, synthesis, mutation\n"
    )

    def refuse(*_):
        raise FileError("no such thing")

    monkeypatch.setitem(rtl_verification.PARTS, "proofs", refuse)
    assert rtl_verification.main(["proofs", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == "gyro: no such thing\n"


def test_make_rtl_does_all_of_it():
    text = (ROOT / "Makefile").read_text()
    assert re.search(r"^rtl: .*\n\t\$\(BIN\)/python -m testbench\.golden\.rtl_verification \$\(PARTS\)", text, re.M)
    assert list(rtl_verification.PARTS) == ["bundles", "loop", "proofs", "synthesis", "mutation"]
    assert rtl_verification.COUNT >= 150
    assert all(case in blocks.BLOCKS[stem].cases for stem, case in rtl_verification.SCORED.items())


def test_proofs_and_scores_must_all_hold(tmp_path, monkeypatch):
    proof = formal.Proof("dds", "default", ("a",), True, 1, "", 0.0)
    monkeypatch.setattr(rtl_verification.formal, "CASES", {"dds": ("default",), "pi": ("rate",)})
    monkeypatch.setattr(rtl_verification.formal, "prove", lambda stem, case, rtl: proof._replace(proven=stem == "dds"))
    assert not rtl_verification.proofs(RTL, tmp_path, None)
    monkeypatch.setattr(rtl_verification.formal, "prove", lambda stem, case, rtl: proof)
    assert rtl_verification.proofs(RTL, tmp_path, None)


def test_scores_are_noted_left_and_must_all_be_whole(tmp_path, monkeypatch):
    noted, options = [], SimpleNamespace(count=150, only=[])
    outcome = Outcome("x", "y", 1, 150, 150, 0, 0, [])
    monkeypatch.setattr(rtl_verification.export, "export", lambda stem, out: None)
    monkeypatch.setattr(rtl_verification.bundle, "verify", lambda folder: {"block": folder.parent.name})
    monkeypatch.setattr(rtl_verification.measured, "vectors", lambda manifest: f"of {manifest['block']}")
    monkeypatch.setattr(mutate, "score_bundle", lambda folder, *_: outcome._replace(block=folder.parent.name))
    monkeypatch.setattr(mutate, "record", lambda folder, outcome: noted.append(folder.name))
    monkeypatch.setattr(rtl_verification.mutate_top, "score_wiring", lambda rtl, count: outcome._replace(block="top"))
    assert rtl_verification.scores(RTL, tmp_path, options)
    assert len(noted) == len(blocks.BLOCKS)
    left = json.loads((tmp_path / scores.MUTATION).read_text())
    assert [e["block"] for e in left] == [*blocks.BLOCKS, "top"]
    assert all(f"of {e['block']}" in e["vectors"].values() for e in left[:-1])
    assert set(left[-1]["vectors"]) == set(rtl_verification.mutate_top.CASES)
    monkeypatch.setattr(
        rtl_verification.mutate_top, "score_wiring", lambda rtl, count: outcome._replace(block="top", killed=149)
    )
    assert not rtl_verification.scores(RTL, tmp_path, options)


@pytest.mark.parametrize(
    ("killed", "equivalent", "undecided", "passed"),
    [(140, 10, 0, True), (137, 10, 3, True), (136, 10, 4, False), (139, 10, 0, False), (136, 10, 3, False)],
)
def test_no_fault_may_be_alive_and_few_undecided(killed, equivalent, undecided, passed):
    assert Outcome("x", "y", 1, 150, killed, equivalent, undecided, []).passed == passed


def test_one_score_alone_keeps_the_others(tmp_path, monkeypatch):
    monkeypatch.setattr(
        rtl_verification.mutate_top, "score_wiring", lambda rtl, count: Outcome("top", "y", 1, count, 7, 0, 0, [])
    )
    rtl_verification.scores(RTL, tmp_path, SimpleNamespace(count=9, only=["top"]))
    left = json.loads((tmp_path / scores.MUTATION).read_text())
    assert left[:-1] == scores.stored_scores()["mutation"][:-1]
    assert (left[-1]["mutants"], left[-1]["killed"]) == (9, 7)
    with pytest.raises(ConfigError, match="--only: 'ddds' is not one of dds, sine"):
        rtl_verification.scores(RTL, tmp_path, SimpleNamespace(count=9, only=["ddds"]))
