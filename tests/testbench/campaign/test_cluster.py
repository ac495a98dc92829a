"""Dask: two workers give the bytes of the local run; what is missing is said in one line within seconds."""

import os
import socket
import subprocess
import sys
import time

import pytest

from testbench.campaign import cluster
from testbench.campaign.store import Store
from tests.testbench.campaign.helpers import (
    INSTANT,
    campaign,
    child,
    environment,
    finished,
    plan_file,
    run_json,
    start,
)

NOBODY = 65534


@pytest.mark.slow
def test_a_cluster_of_two_workers_equals_the_local_run(tmp_path):
    plan = plan_file(tmp_path, 2, 10, 2)
    run_json(plan, "--out", tmp_path / "local")
    code, out, err = child("run", plan, "--out", tmp_path / "dask", "--cluster", 2)
    assert code == 0, err
    assert "40 points, 0 finished earlier, 40 in this run" in out
    assert finished(tmp_path / "dask") == finished(tmp_path / "local")
    pids = {event.pid for event in Store.open_folder(tmp_path / "dask").events()}
    assert len(pids) == 2


@pytest.mark.slow
def test_points_that_fail_on_a_cluster(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(f'engine = "{INSTANT}"\n[axes.rate]\nscenario.rate_dps = [0, 1, 5]\n')
    code, out, err = child("run", path, "--out", tmp_path / "s", "--cluster", 1)
    assert code == 2, err
    assert "p: 3 points, 0 finished earlier, 2 in this run" in out
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
    code, _, err = child("run", plan, "--out", tmp_path / "s", "--unencrypted-scheduler", address)
    assert time.monotonic() - began < cluster.CONNECT_S + 45, "of which the start of a process on a busy machine"
    errors = [line for line in err.splitlines() if line.startswith("gyro: ")]
    assert (code, len(errors)) == (2, 1), err
    assert f"--unencrypted-scheduler {address}: no Dask scheduler answered within 5 s" in errors[0]
    assert "Traceback" not in err
    assert finished(tmp_path / "s") == before
    assert not Store.open_folder(tmp_path / "s").busy()


@pytest.mark.parametrize("address", ["nonsense://x:1", "127.0.0.1", "tcp://:8786", "tcp://a:b"])
def test_what_is_no_address_is_one_line(tmp_path, address):
    code, _, err = campaign("run", plan_file(tmp_path), "--out", tmp_path / "s", "--scheduler", address)
    assert (code, err.count("\n")) == (2, 1)
    assert f"--scheduler {address}: is not of the form tls://HOST:PORT" in err


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "ws://127.0.0.1:8786", "127.0.0.1:8786"])
def test_a_scheduler_without_certificates_wants_an_option_of_its_own(tmp_path, address):
    code, _, err = campaign("run", plan_file(tmp_path), "--out", tmp_path / "s", "--scheduler", address)
    assert (code, err.count("\n")) == (2, 1)
    assert f"--scheduler {address}: has no certificates, so anyone who reaches it can run code as you" in err
    assert f"--unencrypted-scheduler {address}" in err
    assert not (tmp_path / "s").exists()


def test_an_encrypted_scheduler_wants_the_certificates_of_the_configuration(tmp_path):
    address = "tls://127.0.0.1:8786"
    code, _, err = campaign("run", plan_file(tmp_path), "--out", tmp_path / "s", "--scheduler", address)
    assert (code, err.count("gyro: ")) == (2, 1)
    keys = "distributed.comm.tls.ca-file, distributed.comm.tls.client.cert"
    assert f"--scheduler {address}: Dask's configuration has no {keys}" in err


ATTACK = """
import encodings.idna, os, pathlib, socket, sys
import distributed

def task(mark):
    pathlib.Path(mark).touch()

uid, mark, *ports = sys.argv[1:]
own = distributed.Security.temporary()
if uid != "None":  # only now: another user may not read where Python lies
    os.setgroups([])
    os.setgid(int(uid))
    os.setuid(int(uid))
for port in ports:
    for scheme, security in (("tcp", None), ("tls", own)):
        try:
            address = f"{scheme}://127.0.0.1:{port}"
            with distributed.Client(address, timeout=3, security=security, set_as_default=False) as client:
                client.submit(task, mark).result(timeout=10)
            print("ran")
        except Exception:
            print("refused")
    with socket.create_connection(("127.0.0.1", int(port)), 3) as page:
        page.sendall(b"GET / HTTP/1.0\\r\\n\\r\\n")
        try:
            print("a page" if page.recv(99).startswith(b"HTTP") else "no page")
        except OSError:
            print("no page")
"""


def attack(mark, ports, uid):
    """What another process gets at these ports that would run a task, which writes `mark` as whoever runs it."""
    command = [sys.executable, "-c", ATTACK, str(uid), mark, *map(str, ports)]
    done = subprocess.run(command, cwd="/", capture_output=True, text=True, timeout=300)
    assert done.stdout.count("\n") == 3 * len(ports), done.stderr
    return done.stdout.split("\n")


def listening(process):
    """Ports at which a process and its children listen."""
    psutil = pytest.importorskip("psutil")
    main = psutil.Process(process.pid)
    found = [c for one in (main, *main.children(recursive=True)) for c in one.net_connections("tcp")]
    return [c.laddr.port for c in found if c.status == psutil.CONN_LISTEN]


@pytest.mark.slow
@pytest.mark.parametrize("uid", [None, NOBODY])
def test_nobody_else_runs_a_task_on_a_cluster_of_our_own(tmp_path, uid):
    if uid is not None and os.geteuid() != 0:
        pytest.skip("another user's process: only root can start one")
    distributed = pytest.importorskip("distributed")
    tmp_path.chmod(0o755)
    mark = tmp_path / "mark"
    plain = {"n_workers": 1, "processes": False, "protocol": "tcp://", "dashboard_address": None}
    with distributed.LocalCluster(**plain, host="127.0.0.1") as open_to_all:
        port = open_to_all.scheduler_address.rpartition(":")[2]
        assert "ran" in attack(mark, [port], uid), "the attack works where there are no certificates"
    mark.unlink()
    plan = plan_file(tmp_path, 20, 10, 10)
    main = start("run", plan, "--out", tmp_path / "s", "--cluster", 1, GYRO_INSTANT_S="1")
    try:
        until = time.monotonic() + 60
        while not list((tmp_path / "s" / "points").glob("??/*.h5")):
            assert main.poll() is None, main.communicate()[1]
            assert time.monotonic() < until
            time.sleep(0.2)
        ports = listening(main)
        assert len(ports) == 3, "scheduler, worker and nanny, no page"
        assert set(attack(mark, ports, uid)) == {"refused", "no page", ""}
        assert not mark.exists()
    finally:
        main.kill()
        main.communicate()


UNREACHABLE = """
from testbench.campaign import cluster
cluster.CONNECT_S = 0.5
try:
    cluster.Cluster("tcp://127.0.0.1:{}", unencrypted=True).__enter__()
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
    assert "Dask is not installed; run pip install '.[campaign]' in the clone" in err


def test_one_kind_of_worker_at_a_time(tmp_path):
    code, _, err = campaign("run", plan_file(tmp_path), "--out", tmp_path / "s", "--workers", 2, "--cluster", 1)
    assert code == 2
    assert "give only one of them" in err
