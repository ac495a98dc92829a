"""SIGKILL to workers, scheduler and main at random moments: the same bytes, and no finished point is run twice.

Moments are drawn as numbers of finished points, so that they fall all over a campaign however fast the machine is, and
a delay behind each. What is proved comes from the journal, which workers write, and from the files themselves: a
finished point keeps its inode and its time from the moment that it is seen.
"""

import contextlib
import os
import random
import re
import signal
import subprocess
import sys
import time

import pytest

from testbench.campaign.store import Store
from tests.testbench.campaign.helpers import child, environment, finished, plan_file, run_json, start, warm_plan_file

PATIENCE_S = 120.0
POINT_S = "0.01"


def alive(pid):
    """True if the process exists and is no zombie."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


class Watched:
    """A store whose finished points are watched."""

    def __init__(self, path):
        self.path = path
        self.seen = {}
        self.workers = set()

    def points(self):
        """How many points are finished; every one that was seen before must be the same file."""
        now = {}
        for path in (self.path / "points").glob("??/*.h5"):
            stat = path.stat()
            now[f"{path.parent.name}{path.stem}"] = stat.st_ino, stat.st_mtime_ns
        for name, what in self.seen.items():
            assert now.get(name) == what, f"{name} was finished, and was written again or lost"
        self.seen = now
        return len(now)

    def pids(self):
        """Processes that began a point, those that ended long ago among them."""
        found = {int(path.stem.rsplit("-", 1)[1]) for path in (self.path / "journal").glob("*.jsonl")}
        self.workers |= found
        return sorted(pid for pid in found if alive(pid))

    def worker(self, rng):
        """A worker that is alive, once there is one."""
        until = time.monotonic() + PATIENCE_S
        while not (pids := self.pids()):
            assert time.monotonic() < until
            time.sleep(0.01)
        return rng.choice(pids)

    def wait_for(self, count, process):
        """Until so many points are finished; False if the process ended first."""
        until = time.monotonic() + PATIENCE_S
        while self.points() < count:
            if process.poll() is not None:
                return False
            assert time.monotonic() < until, process
            time.sleep(0.002)
        return True

    def prove(self, points):
        """No finished point was run twice, by what the workers wrote down; nothing half lies about."""
        assert self.points() == points
        store = Store.open_folder(self.path)
        ended, written = {}, {}
        for event in store.events():
            if event.event == "finish":
                assert event.point not in ended, f"{event.point} was finished twice"
                ended[event.point] = event.t
            if event.event == "start":
                assert event.point not in ended, f"{event.point} began again after it was finished"
                written[event.point] = event.t
        assert sorted(written) == store.addresses()
        for address, began in written.items():
            assert store.point_path(address).stat().st_mtime > began - 0.05, (
                "the last start is the one that was finished"
            )
        assert not list((self.path / "points").rglob("*.part"))


def moments(rng, kills, points):
    """Numbers of finished points at which something is killed, and what."""
    return sorted(rng.randrange(points - points // 10) for _ in range(kills))


def local(folder, plan, reference, points, kills, seed):
    """Kill workers and mains of local campaigns; returns the number of kills of each kind."""
    rng = random.Random(seed)
    watched = Watched(folder / "store")
    done = {"main": 0, "worker": 0}
    arguments = ("run", plan, "--out", watched.path, "--workers", 2)
    main = start(*arguments, GYRO_INSTANT_S=POINT_S)
    try:
        for k, moment in enumerate(moments(rng, kills, points)):
            assert watched.wait_for(moment, main), main.communicate()
            time.sleep(rng.uniform(0, 0.03))
            if k % 3 == 1:
                os.kill(watched.worker(rng), signal.SIGKILL)
                done["worker"] += 1
                continue
            watched.pids()
            main.send_signal(signal.SIGKILL)
            main.communicate()
            done["main"] += 1
            main = start(*arguments, GYRO_INSTANT_S=POINT_S)
        _, err = main.communicate(timeout=PATIENCE_S)
        assert main.returncode == 0, err
    finally:
        main.kill()
    watched.prove(points)
    assert finished(watched.path) == finished(reference)
    until = time.monotonic() + 20
    while any(alive(pid) for pid in watched.workers - {os.getpid()}):
        assert time.monotonic() < until, "a worker outlived its campaign"
        time.sleep(0.1)
    return done


def instant(folder, boards, seeds):
    """A plan of points that take no time, and the store of its finished campaign."""
    plan = plan_file(folder, 2, boards, seeds)
    run_json(plan, "--out", folder / "reference")
    return plan, folder / "reference"


def test_twenty_points_and_two_kills(tmp_path):
    assert local(tmp_path, *instant(tmp_path, 5, 2), 20, 2, seed=5) == {"main": 1, "worker": 1}


@pytest.mark.slow
def test_a_hundred_points_and_three_kills(tmp_path):
    assert local(tmp_path, *instant(tmp_path, 10, 5), 100, 3, seed=5) == {"main": 2, "worker": 1}


@pytest.mark.slow
def test_a_thousand_points_and_twenty_kills(tmp_path):
    assert local(tmp_path, *instant(tmp_path, 50, 10), 1000, 20, seed=6) == {"main": 13, "worker": 7}


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """A thousand points of 40 ms from lock on: (plan of the lanes engine, store that the frame engine has filled)."""
    folder = tmp_path_factory.mktemp("real")
    run_json(warm_plan_file(folder, 10, 100, "frame"), "--out", folder / "reference", workers=2)
    return warm_plan_file(folder, 10, 100, "lanes"), folder / "reference"


@pytest.mark.slow
def test_a_thousand_real_points_in_lanes_and_twenty_kills(tmp_path, real):
    assert local(tmp_path, *real, 1000, 20, seed=9) == {"main": 13, "worker": 7}


# ---- on a cluster: the scheduler may die as well ---------------------------------------------------------------------


class Dask:
    """A scheduler and two workers in processes of their own, on one port."""

    def __init__(self, folder):
        self.children = []
        self.address = None
        self.folder = folder

    def _run(self, module, *argv):
        with open(self.folder / f"{module}.log", "w") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *argv],
                stdout=log,
                stderr=log,
                cwd=self.folder,
                env=environment(GYRO_INSTANT_S=POINT_S, PYTHONUNBUFFERED="1"),
                start_new_session=True,
            )
        self.children.append(process)
        return process

    def begin(self):
        """A new scheduler and two new workers."""
        self.scheduler = self._run("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        until = time.monotonic() + PATIENCE_S
        while not (
            found := re.search(r"Scheduler at:\s+(tcp://\S+)", (self.folder / "dask_scheduler.log").read_text())
        ):
            assert time.monotonic() < until
            time.sleep(0.1)
        self.address = found[1]
        argv = (self.address, "--nworkers", "2", "--nthreads", "1", "--no-dashboard")
        self._run("dask_worker", *argv, "--local-directory", str(self.folder))

    def end(self):
        """End all of it."""
        for process in self.children:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        self.children = []


@pytest.mark.slow
def test_a_lost_scheduler_is_one_line(tmp_path):
    """The rest of the campaign then runs without a cluster, to the bytes that it would have had anyway."""
    plan = plan_file(tmp_path, 2, 20, 5)
    cluster = Dask(tmp_path)
    watched = Watched(tmp_path / "store")
    try:
        cluster.begin()
        main = start("run", plan, "--out", watched.path, "--unencrypted-scheduler", cluster.address)
        assert watched.wait_for(20, main), main.communicate()
        cluster.scheduler.send_signal(signal.SIGKILL)
        began = time.monotonic()
        _, err = main.communicate(timeout=PATIENCE_S)
        assert time.monotonic() - began < 60
        errors = [line for line in err.splitlines() if line.startswith("gyro: ")]
        assert (main.returncode, len(errors)) == (2, 1), err
        assert "the connection to the Dask scheduler was lost" in errors[0]
        assert "Traceback" not in err
    finally:
        cluster.end()
    assert watched.points() >= 20
    run_json(plan, "--out", watched.path)
    watched.prove(200)
    run_json(plan, "--out", tmp_path / "reference")
    assert finished(watched.path) == finished(tmp_path / "reference")


def on_a_cluster(folder, plan, reference, seed):
    """Kill workers, mains and schedulers of campaigns of a thousand points; returns the number of kills of each."""
    rng = random.Random(seed)
    watched, cluster = Watched(folder / "store"), Dask(folder)
    done = {"main": 0, "worker": 0, "scheduler": 0}

    def again():
        return start("run", plan, "--out", watched.path, "--unencrypted-scheduler", cluster.address)

    try:
        cluster.begin()
        main = again()
        for k, moment in enumerate(moments(rng, 20, 1000)):
            assert watched.wait_for(moment, main), main.communicate()
            time.sleep(rng.uniform(0, 0.03))
            what = ("worker", "main", "scheduler")[k % 3]
            done[what] += 1
            if what == "worker":
                os.kill(watched.worker(rng), signal.SIGKILL)
            elif what == "main":
                main.send_signal(signal.SIGKILL)
                main.communicate()
                main = again()
            else:
                cluster.scheduler.send_signal(signal.SIGKILL)
                _, err = main.communicate(timeout=PATIENCE_S)
                assert main.returncode == 2, err
                assert "Traceback" not in err
                cluster.end()
                cluster.begin()
                main = again()
        _, err = main.communicate(timeout=2 * PATIENCE_S)
        assert main.returncode == 0, err
    finally:
        main.kill()
        cluster.end()
    watched.prove(1000)
    assert finished(watched.path) == finished(reference)
    return done


@pytest.mark.slow
def test_a_thousand_points_and_twenty_kills_on_a_cluster(tmp_path):
    found = on_a_cluster(tmp_path, *instant(tmp_path, 50, 10), seed=7)
    assert found == {"worker": 7, "main": 7, "scheduler": 6}


@pytest.mark.slow
def test_a_thousand_real_points_in_lanes_and_twenty_kills_on_a_cluster(tmp_path, real):
    assert on_a_cluster(tmp_path, *real, seed=10) == {"worker": 7, "main": 7, "scheduler": 6}


@pytest.mark.slow
def test_real_points_killed_and_resumed(tmp_path):
    """The frame engine itself: forty points of a millisecond, four kills."""
    plan = plan_file(tmp_path, 2, 10, 2, engine="frame")
    assert child("run", plan, "--out", tmp_path / "reference", "--workers", 2)[0] == 0
    watched, rng = Watched(tmp_path / "store"), random.Random(8)
    main = start("run", plan, "--out", watched.path, "--workers", 2)
    try:
        for k, moment in enumerate(moments(rng, 4, 40)):
            assert watched.wait_for(moment, main), main.communicate()
            if k % 2:
                os.kill(watched.worker(rng), signal.SIGKILL)
                continue
            main.kill()
            main.communicate()
            main = start("run", plan, "--out", watched.path, "--workers", 2)
        _, err = main.communicate(timeout=300)
        assert main.returncode == 0, err
    finally:
        main.kill()
    watched.prove(40)
    assert finished(watched.path) == finished(tmp_path / "reference")
    address = Store.open_folder(watched.path).addresses()[7]
    code, out, _ = child("rerun", watched.path, address)
    assert (code, "identical" in out) == (0, True)
