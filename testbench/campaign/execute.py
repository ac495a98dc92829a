"""A campaign from plan to results: what is missing is run, wherever; then the results are made from the points.

Source  docs/campaigns.md
"""

import hashlib
import math
import shutil
import time
from typing import NamedTuple

from testbench.campaign import collect, verify, work
from testbench.campaign.plan import engines, plan, stored
from testbench.campaign.plan.plan_points import read_task
from testbench.campaign.store import Store
from testbench.errors import FileError
from testbench.storage.files import atomic_outputs, replace_file, write_text


class Report(NamedTuple):
    """What a run of a campaign came to; `rejected` are points that were there and were not what their address says."""

    name: str
    points: int
    reused: int
    done: int
    rejected: list  # (address, text)
    failures: list  # (address, text)
    files: list
    wall_s: float


def make_batches(points, states, workers=1):
    """`work.Batch`es of points that may share a call, in the order of the points; few are spread over all workers."""
    groups = {}
    for point in points:
        engine = engines.load(point.engine)
        # the configuration is made again only where an engine wants to know
        group = engine.group(read_task(point.identity, states).config) if engine.batch > 1 else ()
        groups.setdefault((point.engine, group), []).append(point.identity)
    out = []
    for (name, _), identities in groups.items():
        size = min(engines.load(name).batch, math.ceil(len(identities) / workers))
        out += [work.Batch(name, identities[k : k + size]) for k in range(0, len(identities), size)]
    return out


def run(campaign_plan, path, executor, progress, write_more=None):
    """Run what is missing of a plan; returns `Report`.

    path      folder of the store, which is made if it is not there
    executor  `pool.Pool` or `cluster.Cluster`, not yet entered
    progress  `progress.Progress`
    write_more  () -> paths of what belongs together with the results
    Raises ConfigError before anything runs, FileError when nothing more can be kept, ClusterError when it is lost.
    """
    began = time.monotonic()
    points, states = plan.points(campaign_plan)
    store = Store.open_folder(path, create=True)
    with store.hold_lock():
        for digest, state in states.items():
            _keep_state(store, digest, state)
        addresses = [point.address for point in points]
        write_text(collect.plan_path(store, campaign_plan.name), stored.plan_json(campaign_plan, addresses))
        rejected = verify.reject(store, addresses, store.journal_hashes())
        for text in rejected.values():
            progress.note(f"{text}; this point is run again")
        missing = {p.address: p for p in points if not store.has(p.address)}
        failures, finished = {}, 0
        unique = len(set(addresses))
        progress.set_totals(unique, unique - len(missing), executor)
        if missing:
            with executor, progress:
                for outcomes in executor.run(
                    store, make_batches(missing.values(), store.path / "states", executor.workers)
                ):
                    for outcome in outcomes:
                        if outcome.status == work.STOP:
                            raise FileError(_stop_message(outcome.error, store, addresses))
                        if outcome.status == work.FAILED:
                            failures[outcome.address] = outcome.error
                        finished += outcome.status in (work.FINISHED, work.FINISHED_ELSEWHERE)
                        progress.add(outcome)
        with atomic_outputs():
            files, faults = collect.write(store, campaign_plan.name)
            files += write_more() if write_more else []
        failures |= faults
    failed = [(address, failures[address]) for address in dict.fromkeys(addresses) if address in failures]
    reused, wall_s = unique - len(missing), time.monotonic() - began
    return Report(campaign_plan.name, len(points), reused, finished, list(rejected.items()), failed, files, wall_s)


def _keep_state(store, digest, state):
    """Copy a state file into the store, under its hash."""
    with replace_file(store.path / "states" / f"{digest}.h5") as part:
        shutil.copyfile(state, part)
        with open(part, "rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != digest:
                raise FileError(f"{state}: was changed while it was copied")


def _stop_message(text, store, addresses):
    finished = sum(store.has(address) for address in set(addresses))
    kept = f"{finished} of {len(set(addresses))} points are finished and kept"
    return f"{text}; {kept}; run the same command again to continue"
