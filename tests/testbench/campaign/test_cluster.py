"""Dask: two workers give the bytes of the local run; what is missing is said in one line within seconds."""

import socket
import subprocess
import sys
import time

import pytest

from testbench.campaign import cluster
from testbench.campaign.store import Store
from tests.testbench.campaign.helpers import INSTANT, campaign, child, environment, finished, plan_file, run_json


@pytest.mark.slow
def test_a_cluster_of_two_workers_equals_the_local_run(tmp_path):
    plan = plan_file(tmp_path, 2, 10, 2)
    run_json(plan, "--out", tmp_path / "local")
    code, out, err = child("run", plan, "--out", tmp_path / "dask", "--cluster", 2)
    assert code == 0, err
    assert "40 points, 0 finished before, 40 now" in out
    assert finished(tmp_path / "dask") == finished(tmp_path / "local")
    pids = {event.pid for event in Store.at(tmp_path / "dask").events()}
    assert len(pids) == 2


@pytest.mark.slow
def test_points_that_fail_on_a_cluster(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(f'engine = "{INSTANT}"\n[axes.rate]\nscenario.rate_dps = [0, 1, 5]\n')
    code, out, err = child("run", path, "--out", tmp_path / "s", "--cluster", 1)
    assert code == 2, err
    assert "p: 3 points, 0 finished before, 2 now" in out
    assert "ValueError: this point cannot be simulated" in out


def closed_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.slow
def test_an_unreachable_scheduler_is_one_line_within_seconds(tmp_path):
    plan = plan_file(tmp_path)
    run_json(plan, "--out", tmp_path / "s", "--set", "scenario.seconds=0.002")
    before = finished(tmp_path / "s")
    began = time.monotonic()
    address = f"tcp://127.0.0.1:{closed_port()}"
    code, _, err = child("run", plan, "--out", tmp_path / "s", "--scheduler", address)
    assert time.monotonic() - began < cluster.CONNECT_S + 45, "of which the start of a process on a busy machine"
    errors = [line for line in err.splitlines() if line.startswith("gyro: ")]
    assert (code, len(errors)) == (2, 1), err
    assert f"--scheduler {address}: no Dask scheduler answers there within 5 s" in errors[0]
    assert "Traceback" not in err
    assert finished(tmp_path / "s") == before
    assert not Store.at(tmp_path / "s").busy()


@pytest.mark.parametrize("address", ["nonsense://x:1", "127.0.0.1", "tcp://:8786", "", "tcp://a:b"])
def test_what_is_no_address_is_one_line(tmp_path, address):
    code, _, err = campaign("run", plan_file(tmp_path), "--out", tmp_path / "s", "--scheduler", address)
    assert (code, err.count("\n")) == (2, 1)
    assert f"--scheduler {address}: is not of the form tcp://HOST:PORT" in err


UNREACHABLE = """
from testbench.campaign import cluster
cluster.CONNECT_S = 0.5
try:
    cluster.Cluster("tcp://127.0.0.1:{}").__enter__()
except cluster.ClusterError:
    print("refused")
"""


@pytest.mark.slow
def test_connecting_gives_up_in_time():
    """In a process of its own: a Dask client that finds nobody leaves a thread behind."""
    command = [sys.executable, "-c", UNREACHABLE.format(closed_port())]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=cluster.CONNECT_S + 40)
    assert done.stdout == "refused\n", done.stderr


def test_without_dask_it_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, err = campaign("run", plan_file(tmp_path), "--out", tmp_path / "s", "--cluster", 1)
    assert code == 2
    assert "Dask is not installed; pip install 'ftr-gyro[campaign]'" in err


def test_one_kind_of_worker_at_a_time(tmp_path):
    code, _, err = campaign("run", plan_file(tmp_path), "--out", tmp_path / "s", "--workers", 2, "--cluster", 1)
    assert code == 2
    assert "give one of them" in err
