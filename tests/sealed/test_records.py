"""Sealed records from power-on: made by the second plant, accepted by the record's checks, resumable, scored."""

import json
import shutil
import signal
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from testbench import config
from testbench.measured.record import load_record
from testbench.measured.wide import data_sheet
from tests.sealed import effects, ledger, score, strata
from tests.sealed.__main__ import counted, play, rows_of
from tests.sealed.records import Run, Tracing
from tests.sealed.test_sealed import Given

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
SIZE = {"damping_coupling": 3e-10, "outside.jump": 1e-3}  # coefficients; the columns below make d of them


def short(**counts):
    """Strata of two short dwells, each from power-on, with one law inside and one effect outside."""
    table = strata.read()
    plan = table.plan | {"condition": [table.plan["condition"][k] for k in (0, 4)], "repeats": 1}
    every = {"settle_s": 0.2, "seconds": 0.1}
    inside = tuple(e for e in table.inside if e.name == "damping_coupling")
    outside = effects.outside({"jump": ["mechanism jump {} 1.45", 1e-4]})
    table = table._replace(counts=counts, plan=plan, every=every, outside=outside)
    return table._replace(inside=tuple(e._replace(first=1.0) for e in inside))


def space():
    """Columns that give d = 30 at the coefficients of `SIZE`, in two directions."""
    return Given({name: 30 / value * np.eye(2)[k] for k, (name, value) in enumerate(SIZE.items())})


class Reader:
    """In place of the tracer: takes the file as `gyro measured check` does, and says what it was told to."""

    def __init__(self):
        self.seen, self.sheets = [], []

    def __call__(self, path, wide):
        loaded = load_record.load(path)
        assert not loaded.is_blocked
        assert loaded.residual.decidable
        assert loaded.residual.first is None, "the firmware's words are those of its replay"
        self.seen.append(loaded.record.attrs["truth_sha256"])
        self.sheets.append(config.from_dict(tomllib.loads(loaded.record.config_toml)).plant)
        return {"verdict": "none", "sentence": "nothing", "causes": [], "effects": []}


def test_a_run_makes_records_that_are_accepted_and_goes_on_where_it_was(tmp_path):
    """Three strata; DRDY, switches and delays drawn; R0 is zero; a second start does what is missing and no more."""
    table, own = short(null_white=1, clear=1, outside=1), ledger.identity("development", short(null_white=1))
    run = Run(table, space(), own, tmp_path, Reader())
    path = tmp_path / "ledger.jsonl"
    play(run, 2, 60.0, path)
    assert [row["done"] for row in ledger.rows(path)] == [2]
    again = Run(table, space(), own, tmp_path, Reader())
    play(again, 3, 60.0, path)
    assert len(again.trace.seen) == 1
    assert [(row["done"], row["wide"]) for row in ledger.rows(path)] == [(3, 0)]
    play(again, 1, 60.0, path, wide=True)
    assert [(row["done"], row["wide"]) for row in ledger.rows(path)] == [(3, 1)]
    assert (
        again.trace.seen[0]
        != again.trace.seen[1]
        == json.loads(run.path(run.parts[True], 0).read_text())["envelope_sha256"]
    )
    sheets = [plant.model_dump() for plant in again.trace.sheets]
    tolerances, default = data_sheet.read(data_sheet.BUNDLED_PATH), config.Config().plant.model_dump()
    assert sheets[0] == default
    assert {f"plant.{key}" for key in default if sheets[1][key] != default[key]} == set(tolerances)
    rows = rows_of(again)
    assert [row.number for row in rows_of(again, dict)] == [0]
    assert sorted(row.kind for row in rows) == ["clear", "null_white", "outside"]
    assert {row.truth["name"] for row in rows if row.truth} == set(SIZE)
    assert not list(run.folder.glob("*.h5"))
    assert "inside: detected | 0 of 1" in score.table(rows)


def test_another_machine_goes_on_with_what_was_counted(tmp_path):
    table = short(null_white=3)
    own, kept = ledger.identity("development", table), tmp_path / "scored.jsonl"
    rows = [score.Scored(n, "null_white", None, "none", (), False, False, None, 1.0) for n in (0, 2)]
    assert counted(own, (kept,)) == {False: {}, True: {}}
    kept.write_text(score.kept(own, rows, rows[:1]))
    assert counted(own | {"run": "of another source"}, (kept,)) == {False: {}, True: {}}
    run = Instant(table, space(), own, tmp_path, object(), counted(own, (kept,)))
    assert (run.done(), run.done(wide=True)) == ([0, 2], [0])
    assert rows_of(run) == rows
    play(run, 3, 60.0, tmp_path / "ledger.jsonl")
    assert [path.stem for path in (run.folder / "results").iterdir()] == ["001"]
    assert [(row["done"], row["wide"]) for row in ledger.rows(tmp_path / "ledger.jsonl")] == [(3, 1)]


HOLDS = """
import fcntl, sys, time
file = open(sys.argv[1], "w")
fcntl.flock(file, fcntl.LOCK_EX)
print("held", flush=True)
time.sleep(60)
"""


class Instant(Run):
    """A run whose records cost nothing."""

    def one(self, number, wide=False):
        self.path("results", number).write_text("{}")
        return {"cpu_s": {}, "error": "none was made"}


def test_two_processes_share_a_run_and_a_killed_one_holds_nothing(tmp_path):
    """What another process is at is left to it; after its kill it is done."""
    run = Instant(short(null_white=3), None, ledger.identity("development", short(null_white=3)), tmp_path, Reader())
    path = tmp_path / "ledger.jsonl"
    other = subprocess.Popen([sys.executable, "-c", HOLDS, run.path("claims", 1)], stdout=subprocess.PIPE, text=True)
    try:
        assert other.stdout.readline() == "held\n"
        play(run, 3, 60.0, path)
        assert run.done() == [0, 2]
    finally:
        other.send_signal(signal.SIGKILL)
        other.communicate()
    play(run, 3, 60.0, path)
    assert run.done() == [0, 1, 2]
    assert [row["done"] for row in ledger.rows(path)] == [3]


def test_a_run_that_is_stopped_within_a_record_does_it_again(tmp_path):
    """No result is left of it; the same envelope and the same record come out."""
    table, seen = short(null_white=1), []

    def stopped(path, wide):
        seen.append(load_record.load(path).record.attrs["truth_sha256"])
        if len(seen) == 1:
            raise KeyboardInterrupt
        return Reader()(path, wide)

    run = Run(table, space(), ledger.identity("development", table), tmp_path, stopped)
    with pytest.raises(KeyboardInterrupt):
        play(run, 1, 60.0, tmp_path / "ledger.jsonl")
    assert run.done() == []
    play(run, 1, 60.0, tmp_path / "ledger.jsonl")
    assert run.done() == [0]
    assert seen[0] == seen[1]
    assert not [*run.folder.glob("*.h5"), *run.folder.glob("own*")]


def test_a_traceback_of_the_tracer_is_a_result(tmp_path):
    def broken(path, wide):
        raise KeyError("amplitude_word")

    run = Run(short(null_white=1), space(), ledger.identity("development", short(null_white=1)), tmp_path, broken)
    assert run.one(0)["error"] == "KeyError: 'amplitude_word'"
    assert [row.verdict for row in rows_of(run)] == ["error"]


@pytest.fixture(scope="module")
def tracing():
    """The tracer, with what records share."""
    return Tracing()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["null_flicker", "clear"])
def test_a_whole_record_and_its_trace(tmp_path, kind, tracing):
    """The six conditions: nothing is named where the noise flickers; a damping coupling of d = 30 is in its class."""
    table = strata.read()._replace(counts={kind: 1}, inside=short().inside)
    run = Run(table, space(), ledger.identity("development", table), tmp_path, tracing)
    run.one(0)
    row = rows_of(run)[0]
    if kind == "null_flicker":
        assert row.verdict in score.QUIET
        assert not row.listed
    else:
        assert row.right
