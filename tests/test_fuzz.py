"""The fuzzers in short: some inputs of every kind from a fixed number on, and a fuzzer that finds what is planted."""

import random

import pytest

from testbench.errors import FileError
from tests.fuzz import __main__ as fuzz
from tests.fuzz import commands, corpus, kinds, worker

COUNT = 3
FIRST = 100
DUMPS = (".vcd", ".fst", ".ghw")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return corpus.make(tmp_path_factory.mktemp("corpus"))


@pytest.mark.parametrize("kind", kinds.KINDS)
def test_some_files_of_every_kind_are_read_or_refused_by_one_line(folder, kind):
    if not (folder / kinds.NEEDED.get(kind, "")).exists():
        pytest.skip("no simulator that writes such a dump")
    for number in range(FIRST, FIRST + COUNT):
        problem, _ = worker.one(folder, kind, number)
        assert not problem, fuzz.Finding(kind, number, problem).text()


@pytest.mark.parametrize("kind", [pytest.param(k, marks=[pytest.mark.slow] * (k != "options")) for k in commands.KINDS])
def test_hostile_options_and_paths_are_refused_by_one_line(folder, kind):
    """In a process of its own, in which what is heavy is put out of action."""
    done, _, findings = fuzz.batch(folder, kind, FIRST, COUNT)
    assert done == COUNT
    assert not findings, findings[0].text()


def test_the_corpus_is_read(folder):
    """What is changed must be valid before: else every input would be refused for the same reason."""
    from testbench import config
    from testbench.campaign.plan import plan as campaign
    from testbench.measured.importing import assemble
    from testbench.measured.record import load_record, recording_plan

    readers = [
        lambda: campaign.read(folder / "campaign.toml", ()),
        lambda: recording_plan.read(folder / "measured.toml"),
        lambda: config.load(folder / "config.toml"),
        lambda: load_record.load(folder / "gyrorec.h5", replay=False),
        lambda: assemble.import_files([folder / "lab.csv"], folder / "lab.toml"),
        *(kinds.part(folder / name) for name in corpus.PARTS),
        *(kinds.part(folder / "maps" / kind / "map.toml") for kind in corpus.MAPPED),
        *(
            kinds.against(folder, log=path, signals=folder / "map.toml")
            for path in folder.glob("toy.*")
            if path.suffix in DUMPS
        ),
    ]
    for read in readers:
        read()


def test_an_input_is_made_by_its_number_alone(folder, tmp_path):
    made = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        kinds.vcd(random.Random(5), folder, tmp_path / name)
        made.append([path.read_bytes() for path in (tmp_path / name).iterdir()])
    assert made[0] == made[1]


def fails():
    raise KeyError("planted")


def ends():
    raise SystemExit(1)


def refuses():
    raise FileError("a: b")


@pytest.mark.parametrize(
    ("read", "said", "accepted"),
    [(fails, "planted", False), (ends, "SystemExit", False), (refuses, "", False), (lambda: None, "", True)],
)
def test_a_finding_is_an_exception_of_another_kind(monkeypatch, tmp_path, read, said, accepted):
    monkeypatch.setitem(worker.KINDS, "planted", lambda rng, corpus, folder: read)
    problem, taken = worker.one(tmp_path, "planted", 1)
    assert (bool(problem), taken) == (bool(said), accepted)
    assert said in problem


@pytest.mark.parametrize(
    ("kind", "number"),
    [
        ("paper", 721),
        ("golden", 746),
        ("npz", 757),
        ("state", 818),
        ("config", 817),
        ("campaign", 833),
        ("store", 993),
        ("column map", 16),
        ("column map", 297),
        ("column map", 347),
        ("column map", 348),
        ("column map", 721),
    ],
)
def test_what_was_once_a_traceback_is_one_line(folder, kind, number):
    """What the fuzzers found, by its number; an input that could not be made is among them."""
    assert not worker.one(folder, kind, number)[0]
