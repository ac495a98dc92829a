"""Ledger of sealed runs: one line of JSON for every run ever begun, stopped ones too. It is under version control.

    kind        sealed, or development: seeds of its own, never counted in a rate that is published
    run         what the seeds follow from: kind and hashes of the tracing source, strata and second plant
    done, of    records that have a result, and all of the strata; wide: those traced with a data sheet's priors too

Source    docs/sealed.md
"""

import datetime
import json
from pathlib import Path

from testbench.storage import sources
from testbench.storage.files import write_text
from testbench.tracing.problem.checkpoint import COMPUTES
from tests.sealed import second_plant
from tests.sealed.draw import seed_of

FILE = Path(__file__).with_name("ledger.jsonl")
SEALED, DEVELOPMENT = KINDS = ("sealed", "development")


def identity(kind, strata):
    """{kind, hashes} of a run and its name."""
    own = {
        "kind": kind,
        "tracing_sha256": sources.code_sha256(*COMPUTES),
        "strata_sha256": strata.sha256,
        "plant_sha256": second_plant.sha256(),
    }
    return own | {"run": f"{kind}-{seed_of(*own.values()):014x}"}


def rows(path=FILE):
    """Lines of the ledger, oldest first."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def noted(path, run):
    """Write the counts of a `records.Run` into its line; the first time it is appended, with the time."""
    known = rows(path)
    for row in known:
        if row["run"] == run.own["run"]:
            break
    else:
        begun = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        known.append(row := run.own | {"begun_utc": begun})
    row |= {"done": len(run.done()), "wide": len(run.done(wide=True)), "of": len(run.kinds)}
    write_text(path, "".join(json.dumps(row) + "\n" for row in known))
