"""Machine code that is not as it was written is not loaded: damaged, exchanged, or written by somebody else."""

import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numba
import pytest

from fpga_model import jit, kernel_cache, linkage, shared_files

pytestmark = pytest.mark.skipif(jit.DISABLED, reason="nothing is compiled")

ROOT = Path(__file__).resolve().parents[2]
KINDS = [(numba.int64,), (numba.float64,)]
NOBODY = 65534
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be two users")


def tripled(x):
    return 3 * x + 0.125


def halved(x):
    return x / 2


def cache_of(function, folder):
    dispatcher = numba.njit(function)
    return kernel_cache.KernelCache(dispatcher, folder, linkage.units, linkage.find_units), dispatcher


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A folder with four kernels."""
    folder = tmp_path_factory.mktemp("cache") / "kernels"
    folder.mkdir()
    for function in (tripled, halved):
        cache, dispatcher = cache_of(function, folder)
        for kind in KINDS:
            dispatcher.compile(kind)
            cache.save_overload(kind, dispatcher.overloads[kind])
    return folder


def damage(path, others, draw):
    """Damage a file in one of the ways that disks, copies and people have."""
    data = path.read_bytes()
    way = draw.choice(("flip", "truncate", "zeros", "exchange", "append", "old seal"))
    if way == "flip":
        k = draw.randrange(len(data))
        data = data[:k] + bytes([data[k] ^ 1 << draw.randrange(8)]) + data[k + 1 :]
    elif way == "truncate":
        data = data[: draw.randrange(len(data))]
    elif way == "zeros":
        begin = draw.randrange(len(data))
        end = min(begin + draw.randrange(1, 4096), len(data))
        data = data[:begin] + bytes(end - begin) + data[end:]
    elif way == "exchange":
        data = draw.choice(others).read_bytes()
    elif way == "append":
        data += b"\0"
    else:  # contents of another kernel under the seal of this one
        data = data[: kernel_cache.SEAL_BYTES] + draw.choice(others).read_bytes()[kernel_cache.SEAL_BYTES :]
    changed = data != path.read_bytes()
    path.write_bytes(data)
    return way, changed


def test_of_500_damages_none_is_loaded_and_none_is_unpickled(filled, tmp_path, monkeypatch, capsys):
    cache, _ = cache_of(tripled, filled)
    assert cache.read(KINDS[1])
    monkeypatch.setattr(kernel_cache.pickle, "loads", lambda _: pytest.fail("unpickled"))
    draw, count = random.Random(53), 0
    folder = shutil.copytree(filled, tmp_path / "kernels")
    cache, dispatcher = cache_of(tripled, folder)
    target = dispatcher.targetctx
    for _ in range(500):
        for path in filled.iterdir():
            shutil.copy2(path, folder / path.name)
        (path,) = (p for p in cache.kernel_files() if p == cache._kernel_file(KINDS[1])[0])
        others = sorted(p for p in folder.iterdir() if p != path)
        way, changed = damage(path, others, draw)
        if changed:
            count += 1
            assert not cache.read(KINDS[1]), way
            assert cache.load_overload(KINDS[1], target) is None
            said = capsys.readouterr().err
            assert said == f"gyro: {path}: is damaged: its kernel is compiled again\n"
            assert not path.exists()
    assert count > 450


@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_a_file_that_others_may_write_is_not_loaded(filled, tmp_path, mode, capsys):
    cache, _ = cache_of(halved, shutil.copytree(filled, tmp_path / "kernels"))
    cache._kernel_file(KINDS[0])[0].chmod(mode)
    assert not cache.read(KINDS[0])
    assert "can be written by another user" in capsys.readouterr().err
    assert cache.read(KINDS[1])


def test_a_link_in_the_place_of_a_file_is_not_followed(filled, tmp_path, capsys):
    (tmp_path / "kernels").mkdir()
    cache, _ = cache_of(halved, tmp_path / "kernels")
    path = cache._kernel_file(KINDS[0])[0]
    path.symlink_to(filled / path.name)
    assert not cache.read(KINDS[0])
    assert "its kernel is compiled again" in capsys.readouterr().err


SHOW = "from fpga_model import jit; print(jit.cache_root())"


def root_of(folder, **more):
    environment = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT), "TMPDIR": str(folder), **more}
    done = subprocess.run([sys.executable, "-c", SHOW], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip(), done.stderr


@as_root
@pytest.mark.parametrize("name", ["GYRO_CACHE", "XDG_CACHE_HOME"])
def test_a_cache_folder_of_another_user_is_refused_with_one_line(tmp_path, name):
    theirs = tmp_path / "cache" / "ftr-gyro"
    theirs.mkdir(parents=True)
    for path in (theirs, theirs.parent):
        os.chown(path, NOBODY, NOBODY)
    root, said = root_of(tmp_path, **{name: str(theirs.parent)})
    assert root == str(tmp_path / "ftr-gyro-0" / "ftr-gyro")
    assert said.count("\n") == 1
    assert f"{theirs} belongs to another user (uid {NOBODY})" in said
    assert "set GYRO_CACHE to a folder of your own" in said


@as_root
def test_a_cache_folder_behind_a_link_of_another_user_is_refused(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "mine")
    os.lchown(tmp_path / "link", NOBODY, NOBODY)
    root, said = root_of(tmp_path, GYRO_CACHE=str(tmp_path / "link"))
    assert root == str(tmp_path / "ftr-gyro-0" / "ftr-gyro")
    assert "a link of another user" in said
    assert not list((tmp_path / "mine").iterdir())


def test_a_folder_that_others_may_write_is_closed_whatever_the_umask(tmp_path):
    folder = tmp_path / "cache" / "ftr-gyro"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    root, said = root_of(tmp_path, GYRO_CACHE=str(folder.parent))
    assert (root, said) == (str(folder), "")
    assert not folder.stat().st_mode & 0o022


HOLD = """
import sys
from fpga_model import shared_files
files = [shared_files.try_lock(path) for path in sys.argv[1:]]
print("held", flush=True)
sys.stdin.read()
"""
CALL = """
import sys
sys.path.insert(0, sys.argv[1])
import of_lock
print(of_lock.answer(2), flush=True)
"""
PIPES = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}


def test_a_warm_start_takes_no_lock_and_a_cold_one_says_whom_it_waits_for(tmp_path):
    (tmp_path / "of_lock.py").write_text("from fpga_model.jit import hot\n@hot\ndef answer(x):\n    return x + 40\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "GYRO_CACHE": str(tmp_path / "cache")}
    call = [sys.executable, "-c", CALL, str(tmp_path)]
    assert subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout == "42\n"
    locks = [str(path) for path in (tmp_path / "cache").rglob("*.lock")]
    assert len(locks) == 1
    with subprocess.Popen([sys.executable, "-c", HOLD, *locks], env=environment, **PIPES) as holder:
        assert holder.stdout.readline() == "held\n"
        holder.send_signal(signal.SIGSTOP)
        warm = subprocess.run(call, env=environment, capture_output=True, text=True, check=True, timeout=60)
        assert (warm.stdout, warm.stderr) == ("42\n", "")
        for path in (tmp_path / "cache").rglob("*.kernel"):
            path.unlink()
        with subprocess.Popen(call, env=environment, **PIPES) as cold:
            said = cold.stderr.readline()
            holder.kill()
            assert cold.communicate(timeout=60)[0] == "42\n"
        assert said.startswith(f"gyro: waits for process {holder.pid} on ")
        assert said.endswith(" compiles of_lock.answer\n")


def test_a_lock_on_a_full_disk_holds_without_its_text(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(os, "write", full)
    with (
        shared_files.try_lock(tmp_path / "lock"),
        pytest.raises(shared_files.LockedError, match=shared_files.ANONYMOUS_OWNER),
    ):
        shared_files.try_lock(tmp_path / "lock")


def test_who_waits_says_so_after_the_patience_and_not_before(tmp_path, capsys):
    with (
        shared_files.try_lock(tmp_path / "lock"),
        pytest.raises(shared_files.LockedError, match=f"process {os.getpid()} on "),
    ):
        shared_files.try_lock(tmp_path / "lock")
    held = shared_files.try_lock(tmp_path / "lock")
    release = threading.Timer(shared_files.PATIENCE_S + 0.5, held.close)
    release.start()
    began = time.monotonic()
    shared_files.wait_for_lock(tmp_path / "lock", "sleeps").close()
    assert time.monotonic() - began > shared_files.PATIENCE_S
    said = capsys.readouterr().err
    assert said.startswith(f"gyro: waits for process {os.getpid()} on ")
    assert said.endswith(", which sleeps\n")
