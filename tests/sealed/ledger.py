"""Ledger of sealed runs: one line of JSON for every run ever begun, stopped ones too. It is under version control.

    kind        sealed, or development: seeds of its own, never counted in a rate that is published
    run         what the seeds follow from: kind and hashes of the tracing source, strata, second plant and draws
    done, of    records that have a result, and all of the strata
    wide        records traced again from a data sheet, by the estimator of `wide_sha256`: another one counts anew

Source    docs/sealed.md
"""

import contextlib
import datetime
import fcntl
import hashlib
import json
import os
from pathlib import Path

from testbench.storage import sources
from testbench.storage.files import write_text
from testbench.tracing.problem.trace_checkpoint import COMPUTES
from tests.sealed import second_plant
from tests.sealed.draw import seed_of

FILE = Path(__file__).with_name("ledger.jsonl")
DRAWN_BY = ("bank", "draw", "effects", "records", "strata")  # sources beside this one
TRACES = (*COMPUTES, "testbench.measured.closed_loop.loop_trace")
WIDE = "testbench.measured.wide"  # is at work from a data sheet alone
SEALED, DEVELOPMENT = KINDS = ("sealed", "development")


def identity(kind, strata):
    """{kind, hashes} of a run, its name, and the hash of what narrows wide priors, which the name does not have."""
    reached = sources.reachable_modules(*TRACES)
    wide = [module for module in reached if module.startswith(WIDE)]
    own = {
        "kind": kind,
        "tracing_sha256": sources.bytes_sha256([module for module in reached if module not in wide]),
        "strata_sha256": strata.sha256,
        "plant_sha256": second_plant.sha256(),
        "draw_sha256": _drawn_by_sha256(),
    }
    name = f"{kind}-{seed_of(*own.values()):014x}"
    return own | {"run": name, "wide_sha256": sources.bytes_sha256(wide)}


def _drawn_by_sha256():
    sources_of = (FILE.with_name(f"{name}.py").read_bytes() for name in DRAWN_BY)
    return hashlib.sha256(b"\0".join(sources_of)).hexdigest()


@contextlib.contextmanager
def _locked(folder):
    """One process at a time; a killed one has no lock."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def rows(path=FILE):
    """Lines of the ledger, oldest first."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def noted(path, run):
    """Write the counts of a `records.Run` into its line; the first time it is appended, with the time."""
    with _locked(path.parent):
        known = rows(path)
        for row in known:
            if row["run"] == run.own["run"]:
                break
        else:
            begun = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
            known.append(row := run.own | {"begun_utc": begun})
        row |= run.own | {"done": len(run.done()), "wide": len(run.done(wide=True)), "of": len(run.kinds)}
        write_text(path, "".join(json.dumps(row) + "\n" for row in known))
