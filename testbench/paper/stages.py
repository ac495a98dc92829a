"""Stages of a study: jobs that are done once, on all cores, and kept in files that tell nothing of when or how.

    NAME.json     what a job was made from, its result and the result's SHA-256; a damaged one is done again
    timings.json  {NAME: seconds}: apart, so that all other files have the same bytes in every run

A job that ends is kept at once; after a kill only those that ran are done again.
Source    docs/paper.md
"""

import hashlib
import json
import multiprocessing
import signal
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from testbench.campaign import pool
from testbench.errors import FileError
from testbench.storage import inputs
from testbench.storage.files import write_text
from testbench.storage.sources import code_sha256

SOURCES = (
    "testbench.paper.calibration.calibrations",
    "testbench.paper.phase_laws",
    "testbench.paper.measure.record_phases",
    "testbench.run.simulate",
)
PRELOADED = ["testbench.paper.paper_study", "typer"]
TIMINGS = "timings.json"


class Job(NamedTuple):
    """Name of a stage's file, the sizes that it depends on, a function of a module, and its arguments."""

    name: str
    key: object
    work: Callable
    args: tuple


@dataclass
class StageFile:
    """The file of a stage."""

    made_from: str
    result: Any
    sha256: str


@dataclass
class Timings:
    """How long each stage took (s)."""

    seconds: dict[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]]


def _sha256(result):
    return hashlib.sha256(json.dumps(result, sort_keys=True).encode()).hexdigest()


def _read_stage(path, digest):
    """`StageFile` made from `digest`; None if there is none, or if it is damaged: then it is done again."""
    try:
        contents = inputs.read_json(path, StageFile, inputs.most_bytes())
        return contents if contents.made_from == digest and contents.sha256 == _sha256(contents.result) else None
    except FileError:
        return None


def _do(path, digest, job):
    """Do a job and keep it; returns its seconds."""
    began = time.monotonic()
    result = json.loads(json.dumps(job.work(*job.args), default=float))
    write_text(path, json.dumps(vars(StageFile(digest, result, _sha256(result)))))
    return time.monotonic() - began


def _prepare_worker():
    """A worker's first act: Ctrl-C is main's to act on, and no worker outlives it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pool.exit_with_main()


class Stages:
    """Jobs of one configuration in a folder; `workers` processes, 0: this one."""

    def __init__(self, directory, config, workers=2, progress=None):
        self.directory, self.config = Path(directory), config
        self.workers, self.progress = workers, progress

    def results(self, jobs):
        """{name: result} of the jobs; what is missing is done, in their order."""
        stage_files = {job.name: _read_stage(self._path(job), self._job_digest(job)) for job in jobs}
        self._run([job for job in jobs if stage_files[job.name] is None])
        for job in jobs:
            stage_files[job.name] = stage_files[job.name] or _read_stage(self._path(job), self._job_digest(job))
            if stage_files[job.name] is None:
                raise FileError(f"{self._path(job)}: the file changed while the study ran; start the command again")
        return {name: stage_file.result for name, stage_file in stage_files.items()}

    @property
    def seconds(self):
        """{stage: s} of what has been timed."""
        try:
            return inputs.read_json(self.directory / TIMINGS, Timings, inputs.most_bytes()).seconds
        except FileError:
            return {}

    def save_duration(self, name, seconds):
        """Keep how long a stage took."""
        durations = self.seconds | {name: seconds}
        write_text(self.directory / TIMINGS, json.dumps({"seconds": dict(sorted(durations.items()))}, indent=1) + "\n")

    def _path(self, job):
        return self.directory / f"{job.name}.json"

    def _job_digest(self, job):
        text = json.dumps([job.key, self.config.model_dump(), code_sha256(*SOURCES)], sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def _run(self, jobs):
        tasks = [(self._path(job), self._job_digest(job), job) for job in jobs]
        if self.workers == 0 or len(jobs) < 2:
            for number, task in enumerate(tasks):
                self._report_progress(number, jobs)
                self.save_duration(task[-1].name, _do(*task))
            return
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(PRELOADED)
        with ProcessPoolExecutor(min(self.workers, len(jobs)), context, _prepare_worker) as executor:
            running = {executor.submit(_do, *task): task[-1].name for task in tasks}
            try:
                for number, future in enumerate(as_completed(running), 1):
                    self.save_duration(running[future], future.result())
                    self._report_progress(number, jobs)
            except BaseException as problem:
                for process in multiprocessing.active_children():
                    process.kill()
                executor.shutdown(wait=False, cancel_futures=True)
                if isinstance(problem, BrokenProcessPool):
                    raise FileError(f"{self.directory}: a worker process died; start the command again") from None
                raise

    def _report_progress(self, number, jobs):
        if self.progress:
            self.progress("stages of the study", number, len(jobs))
