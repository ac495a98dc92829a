"""Published files: read from a folder, or downloaded from a server on this machine; others' bytes are refused."""

import functools
import hashlib
import http.server
import threading
import zipfile

import pytest

from testbench.errors import FileError
from testbench.measured.formats import registry

DATA = b"published bytes\n" * 100


def entry(name, data=DATA, **more):
    return registry.File("some_set", name, len(data), hashlib.sha256(data).hexdigest(), **more)


@pytest.fixture
def server(tmp_path):
    root = tmp_path / "origin"
    root.mkdir()
    (root / "plain.txt").write_bytes(DATA)
    with zipfile.ZipFile(root / "all.zip", "w") as archive:
        archive.writestr("inner/member.txt", DATA)
        archive.writestr("inner/other.txt", b"no")

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    found = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(root)))
    thread = threading.Thread(target=found.serve_forever, args=(0.01,))
    thread.start()
    yield f"http://127.0.0.1:{found.server_address[1]}"
    found.shutdown()
    thread.join()
    found.server_close()


@pytest.fixture
def downloads(tmp_path, monkeypatch):
    monkeypatch.delenv(registry.FOLDER, raising=False)
    monkeypatch.setenv(registry.CACHE, str(tmp_path / "cache"))


def test_a_file_is_downloaded_once(server, downloads):
    file = entry("mine.txt", url=server + "/plain.txt")
    first = registry.path(file)
    assert first.read_bytes() == DATA
    stamp = first.stat().st_mtime_ns
    assert registry.path(file).stat().st_mtime_ns == stamp


def test_a_member_of_an_archive(server, downloads):
    assert registry.path(entry("m.txt", url=server + "/all.zip", member="inner/member.txt")).read_bytes() == DATA


@pytest.mark.parametrize("what", ["hash", "gone", "member", "server"])
def test_other_bytes_are_refused(server, downloads, what):
    file = {
        "hash": entry("x.txt", b"other", url=server + "/plain.txt"),
        "gone": entry("y.txt", url=server + "/nothing.txt"),
        "member": entry("z.txt", url=server + "/all.zip", member="inner/absent.txt"),
        "server": entry("w.txt", url="http://127.0.0.1:9/closed.txt"),
    }[what]
    with pytest.raises(FileError, match=file.name):
        registry.path(file)


def test_a_folder_is_read_and_checked(tmp_path, monkeypatch):
    monkeypatch.setenv(registry.FOLDER, str(tmp_path))
    (tmp_path / "some_set").mkdir()
    there = tmp_path / "some_set" / "a.txt"
    with pytest.raises(FileError, match="does not exist"):
        registry.path(entry("a.txt"))
    there.write_bytes(DATA)
    assert registry.path(entry("a.txt")) == there
    there.write_bytes(DATA[:-1])
    with pytest.raises(FileError, match="bytes"):
        registry.path(entry("a.txt"))
    there.write_bytes(DATA[:-1] + b"x")
    with pytest.raises(FileError, match="SHA-256"):
        registry.path(entry("a.txt"))


def test_what_is_not_published_as_it_is_says_so(downloads):
    with pytest.raises(FileError, match=r"converted.*GYRO_DATA_DIR"):
        registry.path(registry.files("gyro_static")[0])


def test_names_and_hashes_are_there_once():
    assert (
        len({f.sha256 for f in registry.FILES}) == len(registry.FILES) == len({(f.set, f.name) for f in registry.FILES})
    )
    assert all(len(f.sha256) == 64 and f.bytes > 0 and (f.url or f.note) for f in registry.FILES)
    assert all(f.url.startswith("https://") for f in registry.FILES if f.url)
    with pytest.raises(FileError, match="silverbox"):
        registry.files("nothing")
