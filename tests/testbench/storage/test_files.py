"""What is written together is all old or all new: kills at system calls, two writers, folders of other users."""

import errno
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import pytest

from testbench.campaign import store
from testbench.errors import FileError
from testbench.run import outputs
from testbench.storage import checkpoint, files
from testbench.tracing.problem import trace_checkpoint as kept

ROOT = Path(__file__).resolve().parents[3]
NAMES = ("a.txt", "b.txt", "sub/c.txt")
NOBODY = 65534
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be two users")
WRITER = """
import sys, time
from pathlib import Path
from testbench.errors import FileError
from testbench.storage import files

NAMES = ("a.txt", "b.txt", "sub/c.txt")

def write(kind, content, folder, pause_s=0.0):
    if kind == "folder":
        with files.replace_folder(folder / "set", "a.txt") as new:
            (new / "sub").mkdir()
            for name in NAMES:
                time.sleep(pause_s)
                (new / name).write_text(content * 1000)
    else:
        with files.atomic_outputs():
            for name in NAMES:
                time.sleep(pause_s)
                files.write_text(folder / "set" / name, content * 1000)

if __name__ == "__main__":
    try:
        write(sys.argv[1], sys.argv[2], Path(sys.argv[3]), float(sys.argv[4]))
    except FileError as problem:
        sys.exit(f"{problem}")
"""
CALLS = "mkdir,unlink,unlinkat,rmdir,rename,renameat2,flock,ftruncate,write,fsync,chmod,openat,vfork,wait4"


@pytest.fixture(scope="module")
def writer(tmp_path_factory):
    path = tmp_path_factory.mktemp("writer") / "writer.py"
    path.write_text(WRITER)
    return path


def command(writer, *arguments):
    return [sys.executable, str(writer), *map(str, arguments)]


def environment():
    return {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}


def of_one_writer(folder):
    """The content of the set, if all of it is of one writer; None if it is absent."""
    if not (folder / "set").exists() or not any(p.is_file() for p in (folder / "set").glob("*.txt")):
        return None
    texts = [(folder / "set" / name).read_text() for name in NAMES]
    assert len(set(texts)) == 1, texts
    assert len(texts[0]) == 1000
    return texts[0][0]


def calls_of(writer, kind, folder):
    """[(system call, its number among those of its name)] from the first one that concerns the set."""
    trace = folder / "trace"
    subprocess.run(command(writer, kind, "A", folder, 0), env=environment(), check=True, timeout=120)
    traced = ["strace", "-o", str(trace), "-e", f"trace={CALLS}", *command(writer, kind, "A", folder, 0)]
    subprocess.run(traced, env=environment(), check=True, timeout=120)
    count, found, begun = Counter(), [], False
    for line in trace.read_text().splitlines():
        if name := re.match(r"(\w+)\(", line):
            count[name[1]] += 1
            begun = begun or "/set" in line
            if begun:
                found.append((name[1], count[name[1]]))
    return found


@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
@pytest.mark.parametrize("kind", ["folder", "files"])
@pytest.mark.parametrize("count", [10, pytest.param(100, marks=pytest.mark.slow)])
def test_after_a_kill_at_a_drawn_system_call_all_is_old_or_all_is_new(writer, tmp_path, kind, count):
    draw, seen = random.Random(f"{kind} {count}"), Counter()
    calls = calls_of(writer, kind, tmp_path)
    assert of_one_writer(tmp_path) == "A"
    for k in range(count):
        before, content = of_one_writer(tmp_path), "BC"[k % 2]
        call, number = draw.choice(calls)
        kill = ["strace", "-o", os.devnull, "-e", f"trace={call}", "-e", f"inject={call}:signal=SIGKILL:when={number}"]
        done = subprocess.run([*kill, *command(writer, kind, content, tmp_path, 0)], env=environment(), timeout=120)
        assert done.returncode == -signal.SIGKILL, (call, number)
        # a process that renames may still be at it
        for _ in range(100):
            if not any((tmp_path / "set" / f"{name}.part" / "new").exists() for name in NAMES) or kind == "folder":
                break
            threading.Event().wait(0.01)
        after = of_one_writer(tmp_path)
        assert after in (before, content)
        seen[after == content] += 1
    assert seen[False]
    assert seen[True] or count < 100
    subprocess.run(command(writer, kind, "D", tmp_path, 0), env=environment(), check=True, timeout=120)
    assert of_one_writer(tmp_path) == "D"
    left = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()}
    assert left == {"trace", *(f"set/{name}" for name in NAMES)}


@pytest.mark.parametrize("kind", ["folder", "files"])
@pytest.mark.parametrize("count", [5, pytest.param(50, marks=pytest.mark.slow)])
def test_of_two_writers_at_least_one_succeeds_and_the_set_is_of_one(writer, tmp_path, kind, count):
    draw, refused = random.Random(kind), 0
    for k in range(count):
        folder = tmp_path / str(k)
        folder.mkdir()
        pipes = {"env": environment(), "stderr": subprocess.PIPE, "text": True}
        pause = draw.choice((0.0, 0.05))
        pair = [subprocess.Popen(command(writer, kind, content, folder, pause), **pipes) for content in "AB"]
        said = [process.communicate(timeout=120)[1] for process in pair]
        codes = [process.returncode for process in pair]
        assert 0 in codes, said
        for own, other in ((0, 1), (1, 0)):
            if codes[own]:
                refused += 1
                assert re.fullmatch(rf".*: another process is writing it: process {pair[other].pid} on .*\n", said[own])
        assert of_one_writer(folder) in [content for content, code in zip("AB", codes) if code == 0]
        assert not list(folder.rglob("*.part"))
    assert refused or count < 50


def test_when_the_process_that_renames_is_killed_this_one_goes_on(tmp_path, monkeypatch):
    for name in NAMES:
        files.write_text(tmp_path / name, "old")
    dies = files.RENAME.replace("os.replace", "os.kill(os.getpid(), 9) if k > 1 else os.replace")
    monkeypatch.setattr(files, "RENAME", dies)
    with files.atomic_outputs():
        for name in NAMES:
            files.write_text(tmp_path / name, "new")
    assert {(tmp_path / name).read_text() for name in NAMES} == {"new"}


def test_where_folders_cannot_be_exchanged_the_old_one_is_renamed_away(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_exchange", lambda *_: False)
    for text in ("old", "new"):
        with files.replace_folder(tmp_path / "set", "a.txt") as new:
            (new / "a.txt").write_text(text)
    assert (tmp_path / "set" / "a.txt").read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["set"]


def test_what_cannot_be_exchanged_is_said_by_the_system(tmp_path, monkeypatch):
    monkeypatch.setattr(files.ctypes, "get_errno", lambda: errno.EBUSY)
    (tmp_path / "new").mkdir()
    with pytest.raises(OSError, match="busy"):
        files._exchange(tmp_path / "new", tmp_path / "absent")


@pytest.mark.parametrize("kind", ["folder", "files"])
def test_a_failure_leaves_the_old_set(tmp_path, kind):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "a.txt").write_text("old")

    def fail():
        if kind == "folder":
            with files.replace_folder(tmp_path / "set", "a.txt") as new:
                (new / "a.txt").write_text("new")
                raise KeyError
        with files.atomic_outputs():
            files.write_text(tmp_path / "set" / "a.txt", "new")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert (tmp_path / "set" / "a.txt").read_text() == "old"
    assert [p.name for p in tmp_path.rglob("*")] == ["set", "a.txt"]


def test_what_else_is_in_a_folder_stays_if_it_is_kept(tmp_path):
    for name, text in (("a.txt", "old"), ("sub/mine.txt", "mine"), ("link", None)):
        path = tmp_path / "set" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to("a.txt") if text is None else path.write_text(text)
    with files.replace_folder(tmp_path / "set", keep=True) as new:
        (new / "a.txt").write_text("new")
    assert (tmp_path / "set" / "a.txt").read_text() == "new"
    assert (tmp_path / "set" / "sub" / "mine.txt").read_text() == "mine"
    assert os.readlink(tmp_path / "set" / "link") == "a.txt"


def test_folders_of_anything_else_are_refused(tmp_path, monkeypatch):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "mine.txt").write_text("mine")
    for mark, why in (("a.txt", "is not empty and has no a.txt"), (None, "is not empty; it is not replaced")):
        with pytest.raises(FileError, match=why), files.replace_folder(tmp_path / "set", mark):
            pass
    (tmp_path / "empty").mkdir()
    for name in ("set", "empty"):
        monkeypatch.chdir(tmp_path / name)
        with (
            pytest.raises(FileError, match="is the working directory or contains it"),
            files.replace_folder(".", keep=True),
        ):
            pass
    (tmp_path / "empty").rmdir()
    assert [p.name for p in tmp_path.rglob("*")] == ["set", "mine.txt"]


# ---- other users -----------------------------------------------------------------------------------------------------


def victim(tmp_path):
    path = tmp_path / "home" / "victim.txt"
    path.parent.mkdir()
    path.write_text("mine")
    return path


@pytest.mark.parametrize("name", ["out.txt", "out.txt.part", "out.txt.part/new", "out.txt.part/lock"])
def test_a_link_in_the_place_of_an_output_is_not_followed(tmp_path, name):
    mine, place = victim(tmp_path), tmp_path / "out" / name
    place.parent.mkdir(parents=True)
    place.symlink_to(mine)
    if name.endswith("lock"):
        with pytest.raises(FileError, match="cannot be written"):
            files.write_text(tmp_path / "out" / "out.txt", "new")
    else:
        files.write_text(tmp_path / "out" / "out.txt", "new")
        assert (tmp_path / "out" / "out.txt").read_text() == "new"
        assert not (tmp_path / "out" / "out.txt").is_symlink()
    assert mine.read_text() == "mine"


def test_a_link_of_the_user_to_a_folder_is_followed(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    files.write_text(tmp_path / "out" / "a.txt", "a")
    with files.replace_folder(tmp_path / "out", keep=True) as new:
        (new / "b.txt").write_text("b")
    assert sorted(p.name for p in (tmp_path / "disk").iterdir()) == ["a.txt", "b.txt"]
    assert (tmp_path / "out").is_symlink()


def begin_a_run(folder):
    with checkpoint.Partial(folder) as partial:
        partial.start_new_run("")


WRITERS = {
    "run": (begin_a_run, "run.partial"),
    "probe": (outputs.check_folder, "."),
    "campaign": (lambda folder: store.Store.open_folder(folder, create=True), "points"),
    "trace": (lambda folder: kept.Store(folder).save_arrays("ab" * 32, []), kept.code_sha256()[:16]),
}


@as_root
@pytest.mark.parametrize("name", WRITERS)
def test_what_keeps_work_in_a_folder_follows_no_link_of_another_user(tmp_path, name):
    mine, folder = victim(tmp_path), tmp_path / "out"
    write, place = WRITERS[name]
    if place == ".":
        folder.symlink_to(mine.parent)
    else:
        folder.mkdir()
        (folder / place).symlink_to(mine.parent)
    for path in (folder, *folder.rglob("*")):
        os.chown(path, NOBODY, NOBODY, follow_symlinks=False)
    with pytest.raises(FileError, match=r"a link of another user|is not a folder"):
        write(folder)
    assert [p.name for p in mine.parent.iterdir()] == ["victim.txt"]
    assert mine.read_text() == "mine"


@as_root
@pytest.mark.parametrize("what", ["link to a folder", "folder of parts"])
def test_a_folder_that_another_user_has_prepared_gets_no_write_outside(tmp_path, what):
    mine, folder = victim(tmp_path), tmp_path / "out"
    folder.mkdir()
    if what == "link to a folder":
        (folder / "sub").symlink_to(mine.parent)
        target, wanted = folder / "sub" / "victim.txt", "a link of another user"
    else:
        (folder / "a.txt.part").mkdir()
        (folder / "a.txt.part" / "new").symlink_to(mine)
        target, wanted = folder / "a.txt", "belongs to another user"
    for path in (folder, *folder.rglob("*")):
        os.chown(path, NOBODY, NOBODY, follow_symlinks=False)
    for write in (lambda: files.write_text(target, "theirs"), lambda: files.replace_folder(target).__enter__()):
        with pytest.raises(FileError, match=wanted):
            write()
    assert mine.read_text() == "mine"
    assert [p.name for p in mine.parent.iterdir()] == ["victim.txt"]
