"""Damaged stores: every kind of file with every kind of damage. No traceback, no hang, no wrong row, no lost point.

After each damage `status`, `collect`, `table` and `run` are called. A command ends with 0, or with 2 and a line for
each thing that is wrong. `run` either refuses, or ends with the bytes of an undamaged campaign; finished points that
are healthy stay the same files.
"""

import hashlib
import io
import json
import os
import random
import shutil
import signal

import h5py
import pytest

from testbench.campaign import collect, shard
from testbench.campaign.plan.plan_points import canonical
from testbench.campaign.store import FOLDERS, Store
from testbench.storage.files import SEAL, SEAL_BYTES
from tests.testbench.campaign.helpers import campaign, finished, plan_file, run_json

HANGS_S = 20
COMMANDS = ("status", "collect", "table", "show")


class Hangs(BaseException):
    """A command did not end; no `except Exception` swallows it."""


@pytest.fixture(autouse=True)
def alarm():
    """Raise in a command that hangs."""

    def raises(number, frame):
        raise Hangs

    before = signal.signal(signal.SIGALRM, raises)
    signal.alarm(3 * HANGS_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Folder with a plan of four points and the store of its finished campaign."""
    folder = tmp_path_factory.mktemp("sound")
    run_json(plan_file(folder, 2, 1, 2), "--out", folder / "store")
    return folder


def forget(store):
    """A store without journals, as of an earlier version."""
    shutil.rmtree(store.path / "journal")
    (store.path / "journal").mkdir()


@pytest.fixture
def store(sound, tmp_path):
    """A copy that may be damaged."""
    shutil.copytree(sound / "store", tmp_path / "store")
    return Store.open_folder(tmp_path / "store")


def lines(command, store, tmp_path):
    """(exit code, lines of error, output) of a command, which must be 0, or 2 with a line that says why."""
    more = {"table": ("--out", tmp_path / "t.parquet")}.get(command, ())
    signal.alarm(HANGS_S)
    code, out, err = campaign(command, store.path, *more)
    said = err.splitlines() + (out.splitlines() if command == "status" else [])
    assert code == 0 or (code == 2 and said), (command, code, out, err)
    assert all(len(line) < 2000 for line in said)
    return code, err.splitlines(), out


def identity_of_files(store):
    """{name: inode and time} of the points."""
    return {p: (p.stat().st_ino, p.stat().st_mtime_ns) for p in (store.path / "points").glob("??/*.h5") if p.is_file()}


def proved(sound, store, tmp_path, bad=(), refused=False):
    """Call all commands on a damaged store; `bad` are points that must be found, `refused`: `run` says one line."""
    healthy = {p: v for p, v in identity_of_files(store).items() if p not in [store.point_path(a) for a in bad]}
    for command in COMMANDS:
        code, err, out = lines(command, store, tmp_path)
        if bad and not refused:
            said = out if command == "status" else "\n".join(err)
            assert code == 2
            assert all(str(store.point_path(address)) in said for address in bad), (command, said)
            if command != "status":
                assert len(err) == len(bad)
    signal.alarm(HANGS_S)
    code, out, err = campaign("run", plan_file(sound, 2, 1, 2), "--out", store.path, "--workers", 0)
    now = identity_of_files(store)
    assert {p: v for p, v in now.items() if p in healthy} == healthy, "a healthy point was lost or written again"
    if refused:
        assert code == 2
        assert len([line for line in err.splitlines() if line.startswith("gyro: ")]) == 1
        return
    assert code == 0, err
    assert f"4 points, {4 - len(bad)} finished earlier, {len(bad)} in this run" in out
    assert all(str(store.point_path(address)) in err for address in bad)
    assert finished(store.path) == finished(sound / "store")
    assert lines("status", store, tmp_path)[0] == 0


# ---- what can be done to any file ------------------------------------------------------------------------------------

CONTENTS = {
    "empty": lambda data: b"",
    "half": lambda data: data[: len(data) // 2].rstrip(b"\n"),
    "list": lambda data: b"[]",
    "null": lambda data: b"null\n",
    "other_types": lambda data: b'{"schema": 3, "name": [], "t": "x", "points": {}, "axes": 1}\n',
    "nan": lambda data: b'{"schema": NaN, "name": NaN, "t": NaN, "event": NaN, "points": NaN}\n',
    "huge_integer": lambda data: b'{"t": ' + b"7" * 5000 + b"}\n",
    "deep": lambda data: b"[" * 100_000 + b"\n",
    "no_text": lambda data: b"\xff\xfe\x00\xd8" + data,
}


def put(path, data):
    path.unlink()
    path.write_bytes(data)


def fifo(path):
    path.unlink()
    os.mkfifo(path)


def folder(path):
    path.unlink()
    path.mkdir()
    (path / "x").write_text("x")


def dangling(path):
    path.unlink()
    path.symlink_to("nowhere")


def endless(path):
    path.unlink()
    path.symlink_to("/dev/zero")


SHAPES = {"fifo": fifo, "folder": folder, "dangling": dangling, "endless": endless}
DAMAGES = {
    **{name: lambda path, change=change: put(path, change(path.read_bytes())) for name, change in CONTENTS.items()},
    **SHAPES,
}


def some(names, *fast):
    """Parameters, of which `make test` takes those that are named."""
    return [pytest.param(name, marks=() if name in fast else pytest.mark.slow) for name in names]


def first(pattern):
    """A file of the store."""
    return lambda store: sorted(store.path.glob(pattern))[0]


def claim(store):
    """The claim of a point that somebody finished without it."""
    path = store.path / "claims" / store.addresses()[0]
    path.write_bytes(b"")
    store.point_path(store.addresses()[0]).unlink()
    return path


@pytest.mark.parametrize("damage", some(DAMAGES, "half", "no_text", "dangling", "endless"))
def test_a_point(sound, store, tmp_path, damage):
    address = store.addresses()[1]
    DAMAGES[damage](store.point_path(address))
    if damage == "dangling":  # nothing is there: the point is missing, not damaged
        assert campaign("run", plan_file(sound, 2, 1, 2), "--out", store.path, "--workers", 0)[0] == 0
        assert finished(store.path) == finished(sound / "store")
        return
    proved(sound, store, tmp_path, bad=[address])
    assert len(list((store.path / "rejected").iterdir())) == 1, "what was there is kept"


@pytest.mark.parametrize("damage", some(DAMAGES, "half", "null", "other_types", "nan", "deep", "fifo", "folder"))
def test_store_json(sound, store, tmp_path, damage):
    DAMAGES[damage](store.path / "store.json")
    proved(sound, store, tmp_path, refused=True)


@pytest.mark.parametrize("damage", some(DAMAGES, "half", "huge_integer", "fifo", "folder"))
def test_a_plan(sound, store, tmp_path, damage):
    path = store.path / "plans" / "tiny.json"
    DAMAGES[damage](path)
    for command in COMMANDS:
        code, err, out = lines(command, store, tmp_path)
        assert code == 2
        assert "tiny.json: " in "".join(err) + out
    if damage == "folder":  # what cannot be replaced is named
        code, _, err = campaign("run", plan_file(sound, 2, 1, 2), "--out", store.path, "--workers", 0)
        assert (code, err.count("\n")) == (2, 1)
        return
    proved(sound, store, tmp_path)


@pytest.mark.parametrize("damage", some(DAMAGES, "half", "other_types", "fifo"))
def test_a_journal(sound, store, tmp_path, damage):
    DAMAGES[damage](first("journal/*.jsonl")(store))
    proved(sound, store, tmp_path)
    if damage not in ("empty", "dangling"):
        assert "unreadable lines of journals" in lines("status", store, tmp_path)[2]


@pytest.mark.parametrize("damage", some(DAMAGES, "no_text", "fifo"))
def test_a_lock(sound, store, tmp_path, damage):
    DAMAGES[damage](store.path / "lock")
    code, err, out = lines("status", store, tmp_path)
    assert (code, "no campaign is running in this store" in out) == (0, True)
    if damage in ("fifo", "folder", "endless"):
        code, err, _ = lines("collect", store, tmp_path)
        assert (code, len(err)) == (2, 1)
        code, _, err = campaign("run", plan_file(sound, 2, 1, 2), "--out", store.path, "--workers", 0)
        assert (code, err.count("\n")) == (2, 1)
        return
    proved(sound, store, tmp_path)


@pytest.mark.parametrize("damage", some(SHAPES, "fifo"))
def test_a_claim(sound, store, tmp_path, damage):
    address = store.addresses()[0]
    SHAPES[damage](claim(store))
    code, _, err = campaign("run", plan_file(sound, 2, 1, 2), "--out", store.path, "--workers", 0)
    if damage != "dangling":
        assert code == 2
        assert f"claims/{address}" in err.splitlines()[-1]
        assert "3 of 4 points are finished and kept" in err
    assert len(store.addresses()) == 3 + (damage == "dangling")


@pytest.mark.parametrize("damage", some(DAMAGES, "fifo", "folder"))
@pytest.mark.parametrize("name", some(["tiny.nc", "tiny.csv"], "tiny.nc"))
def test_results(sound, store, tmp_path, name, damage):
    DAMAGES[damage](store.path / "results" / name)
    if damage == "folder":
        code, err, _ = lines("collect", store, tmp_path)
        assert (code, len(err)) == (2, 1)
        return
    proved(sound, store, tmp_path)


@pytest.mark.parametrize("name", some(FOLDERS, "points", "journal"))
@pytest.mark.parametrize("shape", some(["file", "fifo"], "file"))
def test_a_folder(sound, store, tmp_path, name, shape):
    path = store.path / name
    shutil.rmtree(path)
    if shape == "file":
        path.write_text("x")
    else:
        os.mkfifo(path)
    for command in COMMANDS:
        lines(command, store, tmp_path)
    code, _, err = campaign("run", plan_file(sound, 2, 1, 2), "--out", store.path, "--workers", 0)
    assert (code, err.count("\n")) == (2, 1)


@pytest.mark.parametrize("name", ["plans/tiny.json", "results/tiny.nc", "results/tiny.csv"])
def test_what_a_file_is_written_as(sound, store, tmp_path, name):
    """A FIFO under the name of an unfinished file is not waited for."""
    os.mkfifo(store.path / f"{name}.part")
    proved(sound, store, tmp_path)


# ---- points that are whole, and not what their address says ----------------------------------------------------------


def sealed(body):
    return body + SEAL % hashlib.sha256(body).hexdigest().encode()


def resealed(path, change):
    """Change a point in its HDF5 file, and seal it again."""
    buffer = io.BytesIO(path.read_bytes()[:-SEAL_BYTES])
    with h5py.File(buffer, "r+") as file:
        change(file)
    path.write_bytes(sealed(buffer.getvalue()))


def replaced(name, **how):
    def change(file):
        del file[name]
        file.create_dataset(name, **how)

    return change


def linked(link):
    def change(file):
        del file["locked"]
        file["locked"] = link

    return change


def schema_of_another_version(file):
    text = file["identity"][()].decode().replace("gyropoint/1", "gyropoint/2")
    replaced("identity", data=text)(file)


HOSTILE = {
    "edited": lambda file: file["drive_frequency_hz"].__setitem__((), 1.0),
    "another_schema": schema_of_another_version,
    "no_identity": lambda file: file.__delitem__("identity"),
    "identity_number": replaced("identity", data=3),
    "group": lambda file: (file.__delitem__("locked"), file.create_group("locked")),
    "external_link": linked(h5py.ExternalLink("/dev/zero", "/x")),
    "soft_link": linked(h5py.SoftLink("/drive_frequency_hz")),
    "dangling_link": linked(h5py.SoftLink("/nowhere")),
    "huge": replaced("locked", shape=(10**12,), dtype="f8", chunks=(1000,)),
    "huge_contiguous": replaced("locked", shape=(10**9,), dtype="f8"),
    "packed": replaced("locked", data=[0.0] * 1000, compression="gzip"),
    "no_dimension": replaced("rate_word", data=[1, 2, 3]),
    "compound": replaced("locked", data=[(1, 2.0)], dtype="i4,f8"),
    "texts": replaced("locked", data=["a", "b"], dtype=h5py.string_dtype()),
}


SEEN = ("edited", "another_schema", "external_link", "huge", "no_dimension")


@pytest.mark.parametrize("what", some(HOSTILE, *SEEN))
@pytest.mark.parametrize("journal", some([True, False], False))
def test_a_point_that_was_sealed_again(sound, store, tmp_path, what, journal):
    """The journal alone can tell a number that was edited; everything else the point itself tells."""
    address = store.addresses()[2]
    resealed(store.point_path(address), HOSTILE[what])
    if not journal and what != "edited":
        forget(store)
    proved(sound, store, tmp_path, bad=[address])


@pytest.mark.parametrize("journal", [True, False])
def test_swapped_points(sound, store, tmp_path, journal):
    a, b = store.addresses()[:2]
    if not journal:
        forget(store)
    one, other = store.point_path(a).read_bytes(), store.point_path(b).read_bytes()
    store.point_path(a).write_bytes(other)
    store.point_path(b).write_bytes(one)
    proved(sound, store, tmp_path, bad=[a, b])


@pytest.mark.parametrize("journal", [True, False])
def test_a_copy_of_another_point(sound, store, tmp_path, journal):
    a, b = store.addresses()[1:3]
    if not journal:
        forget(store)
    store.point_path(a).write_bytes(store.point_path(b).read_bytes())
    proved(sound, store, tmp_path, bad=[a])


def test_a_point_of_other_sources(sound, store, tmp_path):
    """The same configuration by another code has another address: under this one's name it is found."""
    address = store.addresses()[0]
    identity, variables = collect.read_point(store, address)
    other = canonical(json.loads(identity) | {"code": "f" * 64})
    store.point_path(address).write_bytes(shard.encode(other, variables, [0.000125, 0.0005]))
    forget(store)
    proved(sound, store, tmp_path, bad=[address])


# ---- plans whose checksum is right -----------------------------------------------------------------------------------

WRONG = ("null", "[]", "{}", '"x"', "-1", "NaN", "7" * 5000, "[" * 60 + "]" * 60, "1e999", "true", "[null]", "[{}]")
PLACES = (
    ("name",), ("engine",), ("set",), ("set", "scenario"), ("axes",), ("axes", 0), ("axes", 0, "name"),
    ("axes", 0, "length"), ("axes", 0, "values"), ("axes", 0, "cases"), ("keep",), ("keep", "tau_s"),
    ("keep", "frames"), ("keep", "streams"), ("keep", "statistics"), ("points",), ("points", 0), ("sha256",),
)  # fmt: skip


@pytest.mark.parametrize("place", some(PLACES, ("axes",), ("axes", 0, "values"), ("points",)), ids=str)
def test_wrong_values_in_a_plan(store, tmp_path, place):
    """Sealed again with wrong values, which is another plan or none: one line, or results."""
    path = store.path / "plans" / "tiny.json"
    text = path.read_text()
    for wrong in WRONG:
        data = json.loads(text)
        data.pop("sha256")
        node = data
        for key in place[:-1]:
            node = node[key]
        node[place[-1]] = "WRONG"
        path.write_text(canonical(data).replace('"WRONG"', wrong))
        code, err, _ = lines("collect", store, tmp_path)
        assert len(err) == (code == 2), err


# ---- one bit ---------------------------------------------------------------------------------------------------------


def flips(sound, store, tmp_path, tries, seed):
    """Flip a bit anywhere in a store, then collect; the counts of (results as they were, refused or reported)."""
    rng = random.Random(seed)
    expected = finished(sound / "store")
    results = {name: data for name, data in expected.items() if name.startswith("results")}
    files = sorted(p for p in store.path.rglob("*") if p.is_file() and p.parent.name != "results")
    counts = [0, 0]
    for _ in range(tries):
        path = rng.choice(files)
        data = path.read_bytes()
        flipped = bytearray(data)
        bit = rng.randrange(8 * len(data))
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        code, _, _ = lines("collect", store, tmp_path)
        now = {name: (store.path / name).read_bytes() for name in results}
        if code == 0:
            assert now == results, (path, bit)
        counts[code == 2] += 1
        for name in now:
            (store.path / name).write_bytes(results[name])
        path.write_bytes(data)
    return counts


def test_a_flipped_bit_changes_no_row(sound, store, tmp_path):
    same, refused = flips(sound, store, tmp_path, 20, seed=1)
    assert same + refused == 20
    assert refused > 5


@pytest.mark.slow
def test_five_hundred_flipped_bits_change_no_row(sound, store, tmp_path):
    for seed in range(10):
        assert sum(flips(sound, store, tmp_path, 50, seed)) == 50
        signal.alarm(3 * HANGS_S)
