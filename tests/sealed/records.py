"""Sealed records one by one: truth and envelope, record by the second plant, trace, result. Resumable.

    FOLDER/RUN/envelopes/NNN.json   truth, for the scorer alone; its hash is in the result
    FOLDER/RUN/results/NNN.json     result of the trace, times, hash of the envelope
    FOLDER/RUN/wide-HASH/NNN.json   the same of the same record without priors, traced from a data sheet; the hash is
                                    that of what narrows wide priors
    FOLDER/RUN/claims/NNN           held by the process that is at this record; a killed one holds nothing
The trace gets the record's file and nothing else. Anchors, noise and tangents that do not depend on a record's data are
shared by all of a process (`loop_problem.LoopCache`).
Source    docs/sealed.md
"""

import contextlib
import fcntl
import hashlib
import json
import time

from fpga_model.shared_files import open_regular
from testbench.config import changed, to_toml
from testbench.errors import ConfigError, FileError
from testbench.measured.closed_loop import loop_problem, loop_record, loop_runs, loop_trace
from testbench.measured.record import produce, schema
from testbench.measured.wide import wide_calibration
from testbench.storage.files import write_text
from testbench.storage.record import column_digest, write_record
from testbench.tracing.trace import Options
from tests.sealed import draw
from tests.sealed.strata import plan

STREAMS = ("adc_ok", "nco_pword", *schema.CODE_OF, *schema.WORD_OF)  # all of a record by the second plant
REDRAWS = 20  # boards drawn in place of one that loses its lock with its effect


class Tracing:
    """The tracer as a user has it, but for what records share."""

    def __init__(self, threads=1):
        self.bench, self.kept = loop_runs.Bench(threads), loop_problem.LoopCache()

    def __call__(self, path, wide=False):
        """`Result` of a record's file, as plain numbers; wide: with the priors of a data sheet."""
        calibrated = wide_calibration.Calibrated("sheet") if wide else None
        problem = loop_record.open_record([path], {}, calibrated, self.bench, None if wide else self.kept)
        _, result = loop_trace.run(problem, Options(power=False, experiments=False))
        return result.to_json()


def envelope_text(truth):
    """Text of the envelope of a truth."""
    return json.dumps(truth, sort_keys=True, indent=1) + "\n"


def make_record(strata, name, truth, folder, sheet=None, model=None):
    """Record of a truth, by the second plant; ConfigError or FileError where the board does not lock.

    folder  for the plant's own text while it runs
    sheet   {key: value} of a data sheet: then the record has it as configuration, and no priors
    model   configuration of a board without deviations; None is the default one
    """
    plant_file = folder / f"own_{name}.txt"
    write_text(plant_file, truth["own"])
    strata = strata if sheet is None else strata._replace(priors={})
    try:
        recording = plan(strata, name, truth["seed"], truth["values"], plant_file, model=model)
        record = produce.record(recording)
    finally:
        plant_file.unlink()
    if sheet is not None:
        record.config_toml = to_toml(changed(recording.model, sheet))
    record.attrs["truth_sha256"] = hashlib.sha256(envelope_text(truth).encode()).hexdigest()
    return record


def streams_sha256(record, names=STREAMS):
    """SHA-256 of all bits of the streams of some names; they are whole numbers."""
    return schema.json_sha256([column_digest(record.streams[name].data) for name in names if name in record.streams])


class Run:
    """The records of a run; `own` is its line in the ledger.

    counted  {wide: numbers} that have been counted before, whose results need not be in the folder
    """

    def __init__(self, strata, space, own, folder, trace=None, counted=None):
        self.strata, self.space, self.own, self.trace = strata, space, own, trace or Tracing()
        self.counted = counted or {False: (), True: ()}
        self.folder = folder / own["run"]
        self.parts = {False: "results", True: f"wide-{own['wide_sha256'][:12]}"}
        for part in ("envelopes", "claims", *self.parts.values()):
            (self.folder / part).mkdir(parents=True, exist_ok=True)
        self.kinds = draw.order(strata, own["run"])

    def path(self, part, number):
        return self.folder / part / f"{number:03d}.json"

    def done(self, wide=False):
        """Numbers that have a result, or had one."""
        part, before = self.parts[wide], self.counted[wide]
        return [n for n in range(len(self.kinds)) if n in before or self.path(part, n).exists()]

    @contextlib.contextmanager
    def claimed(self, number):
        """True while this process has the record, False where another one has it."""
        with open(open_regular(self.path("claims", number)), "r+") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield False
            else:
                yield True

    def _made(self, number, wide):
        """(truth, record) of the first board that locks; wide: without priors, and the configuration of a sheet."""
        for again in range(REDRAWS):
            seed = draw.seed_of(self.own["run"], number, again)
            truth = draw.truth(self.strata, self.space, self.kinds[number], seed) | {"redrawn": again}
            sheet = draw.sheet_values(self.strata, seed) if wide else None
            try:
                return truth, make_record(self.strata, f"{self.own['run']}-{number:03d}", truth, self.folder, sheet)
            except (ConfigError, FileError):
                if again == REDRAWS - 1:
                    raise

    def one(self, number, wide=False):
        """Make, seal and trace a record; its result is kept whole or not at all."""
        begun = time.process_time()
        truth, record = self._made(number, wide)
        envelope = envelope_text(truth)
        sealed = self.path("envelopes", number)
        if sealed.exists() and sealed.read_text() != envelope:
            raise FileError(f"{sealed}: is the envelope of another truth than this source draws")
        write_text(sealed, envelope)
        file = self.folder / f"record_{number:03d}.h5"
        write_record(file, record)
        made = time.process_time()
        try:
            out = {"result": self.trace(file, wide)}
        except Exception as problem:  # a traceback of the tracer is a result to be counted
            out = {"error": f"{type(problem).__name__}: {problem}"}
        out |= {"envelope_sha256": record.attrs["truth_sha256"], "streams_sha256": streams_sha256(record)}
        out["cpu_s"] = {"record": round(made - begun, 2), "trace": round(time.process_time() - made, 2)}
        write_text(self.path(self.parts[wide], number), json.dumps(out) + "\n")
        file.unlink()
        return out
