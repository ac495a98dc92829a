"""Scores that are stored: of every block and the wiring, of today's vectors and design, and what the page says."""

import json
import shutil
import sys
from pathlib import Path

import pytest

from testbench.golden.bundles import bundle, scores
from testbench.golden.loop import library
from testbench.golden.mutation import mutate, mutate_top
from testbench.golden.recording import recording
from testbench.golden.stimulus import blocks
from tests.testbench.golden.benching import but_counting
from tests.testbench.rtl.test_rtl import RTL

sys.path.append(str(Path(__file__).resolve().parents[3] / "docs"))

import pages
import rtl_page

MEASURE = "python -m testbench.golden.rtl_verification mutation --only BLOCK; python docs/rtl_page.py scores"
ENTRIES = {e["block"]: e for e in scores.stored_scores()["mutation"]}


def test_every_block_and_the_wiring_meet_their_limits():
    assert list(ENTRIES) == [*blocks.BLOCKS, "top"]
    for e in ENTRIES.values():
        assert e["mutants"] >= 150
        assert e["killed"] + e["equivalent"] + len(e["left"]) == e["mutants"]
        assert e["score"] == e["killed"] / (e["mutants"] - e["equivalent"])
        assert {s["verdict"] for s in e["left"]} <= {"undecided"}
        assert len(e["left"]) == e["undecided"] <= mutate.MOST_UNDECIDED * e["mutants"]


@pytest.mark.parametrize("stem", but_counting(blocks.BLOCKS))
def test_a_score_is_of_these_vectors_and_of_this_design(stem, bundles):
    entry = ENTRIES[stem]
    ((case, vectors),) = entry["vectors"].items()
    manifest = bundle.verify(bundles(stem) / case)
    assert vectors == scores.vectors(manifest), MEASURE
    assert entry["design"] == scores.design(mutate.sources(manifest, RTL)), MEASURE
    noted = manifest["provenance"]["mutation"]
    assert (noted["mutants"], noted["score"], noted["seed"]) == (entry["mutants"], entry["score"], entry["seed"])


def test_the_score_of_the_wiring_is_of_these_recordings_and_of_this_design():
    entry = ENTRIES["top"]
    assert entry["vectors"] == {case: recording.sha256(recording.load(case)) for case in mutate_top.CASES}, MEASURE
    assert entry["design"] == scores.design(library.sources(RTL)), MEASURE


def test_other_vectors_have_no_score(bundles):
    manifest = bundle.verify(bundles("delay") / "depth3")
    assert scores.note_score(manifest)
    for other in (manifest | {"case": "depth8"}, manifest | {"block": "tiny"}, manifest | {"params": []}):
        assert scores.note_score(other) == {}


def test_comments_and_spaces_are_no_part_of_a_design(tmp_path):
    path = tmp_path / "dds.v"
    shutil.copy(RTL / "dds.v", path)
    before, text = scores.design([path]), path.read_text()
    path.write_text("// more words\n" + text.replace("    ", "  "))
    assert scores.design([path]) == before
    path.write_text(text.replace("endmodule", "wire more;\nendmodule"))
    assert scores.design([path]) != before


def test_the_page_holds_what_was_measured():
    found = scores.stored_scores()
    assert pages.part("rtl_mutation") == rtl_page.scores_table(found["mutation"])
    assert pages.part("rtl_times") == rtl_page.times(found["times"])


def test_what_was_left_is_taken_over(tmp_path, monkeypatch, capsys):
    kept, before = tmp_path / "scores.json", scores.stored_scores()["times"]
    shutil.copy(scores.FILE, kept)
    monkeypatch.setattr(scores, "FILE", kept)
    assert rtl_page.main(["scores", str(tmp_path)]) == 2
    assert "run make rtl first" in capsys.readouterr().err
    (tmp_path / "golden").mkdir()
    times = {"loop": {"passed": True, "seconds": 1.0, "cpu_s": 2.0}}
    (tmp_path / "golden" / scores.TIMES).write_text(json.dumps(times))
    assert rtl_page.main(["scores", str(tmp_path)]) == 0
    assert json.loads(kept.read_text())["times"] == before | times
    assert json.loads(kept.read_text())["mutation"] == list(ENTRIES.values())
    assert "| loop | passed | 1 | 2 |" in pages.part("rtl_times")
