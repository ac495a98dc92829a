"""What a worker does with a batch of points: claim, play, measure, write. The same function in every kind of worker.

A point counts from the moment its file has its name. Whatever happens before leaves nothing; what happens after cannot
take it back. `Outcome` is only news: the truth is in the store.
Source  docs/campaigns.md
"""

import contextlib
import functools
import platform
import socket
import threading
import time
from typing import NamedTuple

from testbench.campaign import shard
from testbench.campaign.plan import engines
from testbench.campaign.plan.measure import Keeper
from testbench.campaign.plan.plan_points import point_address, read_task
from testbench.campaign.store import Store
from testbench.errors import ConfigError, FileError
from testbench.version import VERSION

# mpmath has one precision for a whole process: threads of a Dask worker take turns
ENGINE_LOCK = threading.Lock()
FINISHED, FINISHED_ELSEWHERE, FAILED, STOP = "done", "found", "failed", "stop"


class Batch(NamedTuple):
    """Points that share one call of an engine, by their identities; `engine` is the command's word, not a file's."""

    engine: str
    identities: list

    @property
    def addresses(self):
        """Their addresses."""
        return [point_address(identity) for identity in self.identities]

    def split(self):
        """One batch for each of them."""
        return [Batch(self.engine, [identity]) for identity in self.identities]


class Outcome(NamedTuple):
    """What became of a point.

    status   done; found: another process had finished it; failed: the point's own error; stop: no point can be kept
    numbers  {name: number or text} if done
    wall_s   share of the batch's time
    """

    address: str
    status: str
    error: str = ""
    numbers: dict = {}  # noqa: RUF012  (nobody writes to it)
    wall_s: float = 0.0
    simulated_s: float = 0.0


@functools.cache
def _prepare_engine(name, store_path):
    """The engine, ready to play; on each machine one process after the other compiles, and the later ones find it."""
    engine = engines.load(name)
    if engine.prepare is not None:
        with Store(store_path, "").claim(f"prepare-{socket.gethostname()}"):
            engine.prepare()
    return engine


def compute(identity, states, engine):
    """(bytes of the point's file, numbers) of one point by an `Engine`, alone; the identity's code is not compared."""
    task = read_task(identity, states)
    keeper = Keeper(task.keep, task.config.design_record())
    (numbers,) = engine.run_points([task.config], [keeper])
    if isinstance(numbers, BaseException):
        raise numbers
    return _encode_point(identity, task, keeper, numbers), numbers


def _encode_point(identity, task, keeper, numbers):
    return shard.encode(identity, shard.variables_from_numbers(numbers) | keeper.variables(), task.keep.tau_s)


def _reason(problem):
    return " ".join(f"{type(problem).__name__}: {problem}".split())


def _run_tasks(engine, tasks):
    """[(keeper, numbers or exception), ...]; if a call of several fails as a whole, each is played alone."""
    keepers = [Keeper(task.keep, task.config.design_record()) for task in tasks]
    try:
        return list(zip(keepers, engine.run_points([task.config for task in tasks], keepers)))
    except Exception as problem:
        if len(tasks) == 1:
            return [(keepers[0], problem)]
        return [_run_tasks(engine, [task])[0] for task in tasks]


def run_batch(store_path, store_name, batch):
    """[Outcome, ...] of a `Batch`."""
    try:
        store = Store.open_folder(store_path)
        if store.name != store_name:
            raise FileError(f"{store_path}: is not the store of the campaign on this machine")
        with ENGINE_LOCK:
            return _run(store, batch)
    except (FileError, ConfigError) as problem:
        where = f"worker on {socket.gethostname()}: " if store_name else ""
        return [Outcome(batch.addresses[0], STOP, f"{where}{problem}")]


def _run(store, batch):
    out = []
    with contextlib.ExitStack() as claims:
        for address in sorted(batch.addresses):  # one order for all, or two batches may wait for each other
            claims.enter_context(store.claim(address))
        ahead = []
        for identity, address in zip(batch.identities, batch.addresses):
            if store.has(address):
                out.append(Outcome(address, FINISHED_ELSEWHERE))
            else:
                ahead.append((identity, address, read_task(identity, store.path / "states")))
        if not ahead:
            return out
        tasks = [task for _, _, task in ahead]
        engine = _prepare_engine(batch.engine, str(store.path))
        for task in tasks:
            if task.code != engines.source_hash(engine):
                raise FileError(
                    f"worker: its sources ({engines.source_hash(engine)[:12]}) differ from those of the campaign "
                    f"({task.code[:12]})"
                )
        for _, address, _ in ahead:
            store.journal("start", point=address)
        began = time.perf_counter()
        for (identity, address, task), (keeper, numbers) in zip(ahead, _run_tasks(engine, tasks)):
            wall_s = (time.perf_counter() - began) / len(ahead)
            try:
                if isinstance(numbers, Exception):
                    raise numbers
                data = _encode_point(identity, task, keeper, numbers)
            except Exception as problem:
                store.journal("fail", point=address, error=_reason(problem))
                out.append(Outcome(address, FAILED, _reason(problem)))
                continue
            store.publish(address, data)
            version_fields = {"version": VERSION, "python": platform.python_version()}
            store.journal("finish", point=address, wall_s=round(wall_s, 6), **version_fields)
            out.append(Outcome(address, FINISHED, "", numbers, wall_s, task.config.scenario.seconds))
    return out
