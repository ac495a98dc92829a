"""What is fuzzed: for each kind of file a function (rng, corpus, folder) that makes one input and gives what reads it.

A third of the inputs has damaged bytes; the others are valid files with something hostile in them, whose hashes and
seals were made again, so that what is wrong passes the check of integrity.
"""

import contextlib
import hashlib
import io
import json
import shutil
import struct
import tomllib
import zipfile
import zlib

import h5py
import numpy as np

from tests.fuzz import hostile

BYTES = 1 / 3  # part of the inputs whose bytes are damaged


def _bytes_or(rng, source, target, change):
    """Write `source` with damaged bytes, or what `change()` makes of it."""
    target.write_bytes(hostile.damaged(rng, source.read_bytes()) if rng.random() < BYTES else change())
    return target


def _array(rng, array):
    """An array with other numbers, another shape or another type."""
    array = np.array(array)
    how = rng.randrange(9)
    if how == 0 and array.size and array.dtype.kind in "iuf":
        with np.errstate(all="ignore"):
            array.flat[rng.randrange(array.size)] = np.array(rng.choice((0, 1, -1, 1 << 40, 1 << 62)), "i8").astype(
                array.dtype
            )
    elif how == 1 and array.dtype.kind == "f" and array.size:
        array.flat[rng.randrange(array.size)] = rng.choice((np.nan, np.inf, 1e300, -1e300, 5e-324))
    elif how == 2:
        array = array[: rng.choice((0, 1, 2, len(array) // 2))] if array.ndim else array
    elif how == 3:
        array = np.zeros_like(array)
    elif how == 4 and array.size:
        array = np.full_like(array, array.flat[0])
    elif how == 5:
        with contextlib.suppress(ValueError, OverflowError):
            array = array.astype(rng.choice(("i1", "u8", "f4", "f8", "c16", "U9", "?", ">i4", "S3")))
    elif how == 6:
        array = np.stack([array] * rng.choice((1, 2, 3)))
    elif how == 7:
        array = np.concatenate([np.atleast_1d(array)] * 2)
    else:
        array = array.T[..., None]
    return array


# ---- HDF5 ------------------------------------------------------------------------------------------------------------


def _sealed(path, seal=True):
    from testbench.storage import files

    data = path.read_bytes()
    if data[-files.SEAL_BYTES :].startswith(files.SEAL[:-3]):
        path.write_bytes(data[: -files.SEAL_BYTES])
    if seal:
        files.seal(path)


def _hostile_hdf5(rng, path):
    """Change the structure of an HDF5 file by the library, and seal it again, or leave it without a seal."""
    _sealed(path, seal=False)
    with h5py.File(path, "r+") as file:
        places = []
        file.visit(places.append)
        for _ in range(rng.choice((1, 1, 2))):
            place = rng.choice(places)
            # a place may be gone, or a circle of links; and what the library itself refuses is no input
            with contextlib.suppress(KeyError, ValueError, OSError, TypeError, RuntimeError):
                _change_item(rng, file, place)
    if rng.random() < 0.7:
        _sealed(path)


def _change_item(rng, file, place):
    how, item = rng.randrange(13), file[place]
    if how == 0:
        owner = rng.choice((file, item))
        names = list(owner.attrs) or ["new"]
        held = (0, -1, np.nan, "x", "[]", "[" * 9000, "9" * 5000, np.arange(5), h5py.Empty("f8"), b"\xff", [1.0, 2.0])
        owner.attrs[rng.choice(names)] = rng.choice(held)
        return
    if how == 1:
        for name in list(item.attrs)[: rng.choice((1, 10))]:
            del item.attrs[name]
        return
    data = item[()] if isinstance(item, h5py.Dataset) else np.arange(5)
    attrs = {k: v for k, v in item.attrs.items() if k not in ("DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME")}
    del file[place]
    if how == 2:
        file[place] = h5py.SoftLink(rng.choice(("/", "/streams", "/nothing", place)))
    elif how == 3:
        file[place] = h5py.ExternalLink(rng.choice(("/dev/zero", "/etc/passwd", "state.h5")), "/")
    elif how == 4:
        file[place] = file
    elif how == 5:
        file.create_dataset(place, (1 << rng.choice((33, 40, 62)),), "i4", chunks=(1024,), compression=1)
    elif how == 6:
        file.create_dataset(place, (1000,), "i4", external=[("/etc/passwd", 0, 4000)])
    elif how == 7:
        layout = h5py.VirtualLayout((100,), "i4")
        layout[:] = h5py.VirtualSource("/etc/passwd", "x", (100,))
        file.create_virtual_dataset(place, layout)
    elif how == 8:
        file.create_dataset(place, data=np.zeros(20_000_000 if rng.random() < 0.2 else 1000, "i8"), compression="lzf")
    elif how == 9:
        texts = np.array(["x" * 1000] * 50 + [""], object)
        file.create_dataset(place, data=texts, dtype=h5py.string_dtype())
    elif how == 10:
        file.create_dataset(place, data=np.zeros(5, [("a", "f8"), ("b", "i4", (3,))]))
    elif how == 11:
        node = file.create_group(place)
        for k in range(rng.choice((3, 30, 300))):
            node = node.create_group(f"g{k}")
    elif np.asarray(data).dtype.kind in "iuf":
        made = _array(rng, data)
        if made.dtype.kind == "U":
            made = made.astype(object)
        file.create_dataset(place, data=made)
    if place in file and how >= 8:
        for name, value in attrs.items():
            file[place].attrs[name] = value


def _changed_record(rng, record):
    """A record in memory with something hostile in it."""
    from testbench.storage.record import Column, TableColumn

    for _ in range(rng.choice((1, 1, 2))):
        how = rng.randrange(8)
        if how == 0:
            record.config_toml = hostile.retyped(rng, record.config_toml, "= ,")
        elif how == 1:
            record.config_toml = hostile.toml(hostile.regrown(rng, tomllib.loads(record.config_toml)))
        elif how == 2:
            record.attrs[rng.choice([*record.attrs, "new"])] = rng.choice((*hostile.NUMBERS, *hostile.TEXTS))
        elif how == 3:
            record.clock_ppm = float(rng.choice(hostile.NUMBERS))
        elif how in (4, 5):
            name = rng.choice(list(record.streams))
            old = record.streams[name]
            part = rng.randrange(5)
            number = rng.choice((0, 1, 2, 7, 13, 1 << 31, 1 << 62))
            record.streams[name] = (
                old._replace(data=_array(rng, old.data)) if part == 0
                else old._replace(den=max(1, number)) if part == 1
                else old._replace(edge0=number - 5) if part == 2
                else old._replace(attrs={**old.attrs, rng.choice([*old.attrs, "x"]): rng.choice(hostile.NUMBERS)})
                if part == 3 else Column(old.data, rng.choice(("V", "1", "deg", "10 V/2^23")), *old[2:])
            )  # fmt: skip
        else:
            name = rng.choice(list(record.tables))
            table = record.tables[name] = dict(record.tables[name])
            key = rng.choice(list(table))
            if rng.random() < 0.3:
                del table[key]
            elif rng.random() < 0.3:
                table[key] = TableColumn(np.array([rng.choice(hostile.TEXTS)] * len(table[key].data), str), "")
            else:
                table[key] = table[key]._replace(data=_array(rng, table[key].data))
    return record


def _read_record(path):
    from testbench.measured.closed_loop import loop_record
    from testbench.measured.record import check_tables, load_record

    def read():
        loop_record.is_record(path)
        check_tables.stated_config(load_record.load(path, replay=False).record)

    return read


def record(rng, corpus, folder):
    """Measurement record or record of a run, HDF5."""
    from testbench.storage import record_read
    from testbench.storage.record import write_record

    path, source = folder / "a.h5", corpus / rng.choice(("gyrorec.h5", "run.h5"))
    shutil.copy(source, path)
    how = rng.random()
    if how < BYTES:
        path.write_bytes(hostile.damaged(rng, source.read_bytes()))
        if rng.random() < 0.5:
            _sealed(path, seal=False)
    elif how < 2 * BYTES:
        _hostile_hdf5(rng, path)
    else:
        _made(lambda: write_record(path, _changed_record(rng, record_read.read_record(source))))
    return _read_record(path)


def _made(write):
    """What this project itself refuses to write is no input: the file stays as it was."""
    with contextlib.suppress(ValueError, TypeError, OverflowError, AttributeError):
        write()


def _hostile_parquet(rng, path):
    import pyarrow
    from pyarrow import parquet as pq

    table = pq.read_table(path)
    name = rng.choice(table.column_names)
    rows = len(table)
    columns = (
        pyarrow.array(["x"] * rows), pyarrow.array([[1.0]] * rows), pyarrow.array([None] * rows, "int64"),
        pyarrow.array([b"x"] * rows), pyarrow.array(np.zeros(rows)), pyarrow.array([{"a": 1}] * rows),
        pyarrow.array([True] * rows), pyarrow.array(np.zeros(rows, "datetime64[s]")),
    )  # fmt: skip
    if rng.random() < 0.2:
        table = pyarrow.table({name: np.zeros(60_000_000, "i8") for name in table.column_names[:8]})
    else:
        table = table.set_column(table.column_names.index(name), name, rng.choice(columns))
    pq.write_table(table, path, compression=rng.choice(("zstd", "gzip", "none", "brotli")))


def state(rng, corpus, folder):
    """State file."""
    from testbench.storage.state_file import save_state

    path = folder / "a.h5"
    shutil.copy(corpus / "state.h5", path)
    how = rng.random()
    if how < BYTES:
        path.write_bytes(hostile.damaged(rng, path.read_bytes()))
        if rng.random() < 0.5:
            _sealed(path, seal=False)
    elif how < 1.5 * BYTES:
        _hostile_hdf5(rng, path)
    else:
        with h5py.File(path, "r") as file:
            values = {name: data[()] for name, data in file["state"].items()}
            layout, meta = file.attrs["source_format"], json.loads(file.attrs["meta"])
        name = rng.choice(list(values))
        if rng.random() < 0.2:
            del values[name]
        elif rng.random() < 0.5:
            values[name] = _array(rng, values[name])
        elif np.ndim(values[name]):
            values[name].flat[rng.randrange(values[name].size)] = rng.choice((-1, 0, 1 << 40, 1 << 62, -(1 << 62)))
        if rng.random() < 0.3:
            meta = hostile.regrown(rng, meta)
        if rng.random() < 0.2:
            meta["config_toml"] = hostile.retyped(rng, str(meta.get("config_toml")), "= ,")
        _made(lambda: save_state(path, values, layout, meta))
    simulation = _simulation()
    return lambda: simulation.restore(path)


_KEPT = []


def _simulation():
    from testbench import config
    from testbench.run.simulation import Simulation

    if not _KEPT:
        _KEPT.append(Simulation(config.Config(), 25.0, 25.0))
    return _KEPT[0]


# ---- golden vectors and dumps ----------------------------------------------------------------------------------------


def against(corpus, folder=None, log=None, signals=None):
    """What compares a log with a bundle."""
    from testbench.golden.check import waves

    def read():
        report = waves.check(folder or corpus / "toy", log or corpus / "toy.csv", signals or corpus / "csv.toml")
        report.text()
        report.to_json()

    return read


def _csv_map(folder, **more):
    tree = {"schema": "gyro-map/1.0", "ports": {name: name for name in ("x", "y", "z")}, **more}
    (folder / "csv.toml").write_text(hostile.toml(tree))
    return folder / "csv.toml"


def golden(rng, corpus, folder):
    """Golden bundle: its manifest, sealed again."""
    from testbench.golden.bundles import bundle

    path = folder / "toy"
    shutil.copytree(corpus / "toy", path)
    manifest = path / bundle.MANIFEST
    if rng.random() < BYTES:
        manifest.write_bytes(hostile.damaged(rng, manifest.read_bytes()))
    else:
        tree = hostile.regrown(rng, json.loads(manifest.read_text()))
        if rng.random() < 0.9:
            tree["manifest_sha256"] = bundle.seal(tree)
        manifest.write_text(json.dumps(tree))
    return _golden_read(corpus, path, _csv_map(folder))


def _golden_read(corpus, path, signals):
    from testbench.golden.bundles import bundle

    def read():
        bundle.verify(path)
        against(corpus, path, corpus / "toy.csv", signals)()

    return read


def hexadecimal(rng, corpus, folder):
    """Hex files of a golden bundle, with their hashes made again."""
    from testbench.golden.bundles import bundle

    path = folder / "toy"
    shutil.copytree(corpus / "toy", path)
    file = path / rng.choice(("stim.hex", "exp.hex", "mask.hex"))
    if rng.random() < 0.5:
        file.write_bytes(hostile.damaged(rng, file.read_bytes()))
    else:
        file.write_text(hostile.retyped(rng, file.read_text()), errors="replace")
    tree = json.loads((path / bundle.MANIFEST).read_text())
    tree["sha256"][file.name] = hashlib.sha256(file.read_bytes()).hexdigest()
    tree["manifest_sha256"] = bundle.seal(tree)
    (path / bundle.MANIFEST).write_text(json.dumps(tree))
    return _golden_read(corpus, path, _csv_map(folder))


def vcd(rng, corpus, folder):
    """VCD dump."""
    path, source = folder / f"a{rng.choice(('.vcd', '.vcd', '.vcd', '.fst', '.ghw'))}", corpus / "toy.vcd"
    _bytes_or(rng, source, path, lambda: hostile.retyped(rng, source.read_text()).encode("utf-8", "replace"))
    return against(corpus, log=path, signals=corpus / "map.toml")


def fst(rng, corpus, folder):
    """FST dump; some under another ending."""
    path = folder / f"a{rng.choice(('.fst', '.fst', '.fst', '.fst', '.vcd'))}"
    path.write_bytes(hostile.damaged(rng, (corpus / "toy.fst").read_bytes()))
    return against(corpus, log=path, signals=corpus / "map.toml")


def ghw(rng, corpus, folder):
    """GHW dump."""
    path = folder / "a.ghw"
    data = (corpus / "toy.ghw").read_bytes()
    if rng.random() < 0.3:
        at = data.index(b"TYP\0") + rng.randrange(80)
        data = data[:at] + struct.pack("<I", rng.choice((0, 1, 0xFFFFFFFF, 0x7FFFFFFF, 0x80808080))) + data[at + 4 :]
        path.write_bytes(data)
    else:
        path.write_bytes(hostile.damaged(rng, data))
    return against(corpus, log=path, signals=corpus / "map.toml")


def csv_log(rng, corpus, folder):
    """Log as CSV."""
    path, source = folder / "a.csv", corpus / "toy.csv"
    _bytes_or(rng, source, path, lambda: hostile.retyped(rng, source.read_text(), ",").encode("utf-8", "replace"))
    return against(corpus, log=path, signals=_csv_map(folder))


def signal_map(rng, corpus, folder):
    """Map from port to signal, TOML."""
    path = _toml(rng, folder, (corpus / "map.toml").read_text())
    return against(corpus, log=corpus / rng.choice(("toy.vcd", "toy.csv")), signals=path)


def recording(rng, corpus, folder):
    """Recording of a closed loop, npz."""
    from testbench.golden.recording import recording as recordings

    _npz(rng, corpus / "reset.npz", folder / "reset.npz")
    return lambda: recordings.load("reset", folder)


# ---- texts -----------------------------------------------------------------------------------------------------------


def _toml(rng, folder, text, name="a.toml"):
    path, how = folder / name, rng.random()
    if how < BYTES / 2:
        path.write_bytes(hostile.damaged(rng, text.encode()))
    elif how < BYTES:
        path.write_text(hostile.retyped(rng, text, "= ,"), errors="replace")
    else:
        path.write_text(hostile.toml(hostile.regrown(rng, tomllib.loads(text))), errors="replace")
    return path


def configuration(rng, corpus, folder):
    """Configuration, TOML, some with a law file."""
    from testbench import config
    from testbench.config import scenario

    path = _toml(rng, folder, (corpus / rng.choice(("config.toml", "whole.toml"))).read_text())

    def read():
        found = config.load(path)
        scenario.expand(found.scenario)

    return read


def law(rng, corpus, folder):
    """Law file, named by a configuration."""
    from testbench import config

    path = _toml(rng, folder, (corpus / "law.toml").read_text())
    (folder / "c.toml").write_text(f"[effects]\nfiles = [{json.dumps(path.name)}]\n")
    return lambda: config.load(folder / "c.toml")


def campaign_plan(rng, corpus, folder):
    """Plan of a campaign, TOML."""
    from testbench.campaign.plan import plan

    path = _toml(rng, folder, (corpus / "campaign.toml").read_text())
    return lambda: plan.points(plan.read(path, ()))


def measured_plan(rng, corpus, folder):
    """Plan of a measurement record, TOML."""
    from testbench.measured.record import recording_plan

    path = _toml(rng, folder, (corpus / "measured.toml").read_text())
    return lambda: recording_plan.read(path)


def imported(rng, corpus, folder):
    """File of a laboratory, or the map of its columns."""
    from testbench.measured.importing import assemble
    from testbench.measured.record import checks

    path, source = folder / "a.csv", corpus / "lab.csv"
    if rng.random() < 0.5:
        toml = _toml(rng, folder, (corpus / "lab.toml").read_text())
        shutil.copy(source, path)
    else:
        toml = shutil.copy(corpus / "lab.toml", folder / "a.toml")
        change = hostile.retyped if rng.random() < 0.5 else _flattened
        text = change(rng, source.read_text(), ",")
        path.write_bytes(hostile.damaged(rng, source.read_bytes()) if rng.random() < BYTES else text.encode())
    return lambda: checks.check(assemble.import_files([path], toml).record)


def store(rng, corpus, folder):
    """Store of a campaign: plan, journal, head or a point."""
    path = folder / "store"
    shutil.copytree(corpus / "store", path)
    file = rng.choice([p for p in sorted(path.rglob("*")) if p.is_file() and p.parent.name != "claims"])
    if file.suffix == ".json" and rng.random() < 0.7:
        file.write_text(json.dumps(hostile.regrown(rng, json.loads(file.read_text()))))
    elif file.suffix == ".jsonl" and rng.random() < 0.7:
        lines = file.read_text().splitlines()
        at = rng.randrange(len(lines))
        lines[at] = json.dumps(
            hostile.regrown(rng, {"x": json.loads(lines[at])}).get("x") if rng.random() < 0.8 else [1]
        )
        file.write_text("\n".join(lines) + "\n")
    elif file.suffix == ".h5" and rng.random() < 0.7:
        _hostile_hdf5(rng, file)
    else:
        file.write_bytes(hostile.damaged(rng, file.read_bytes()))

    def read():
        from tests.fuzz.commands import said

        for command in ("status", "show", "collect"):
            said(["campaign", command, str(path)])

    return read


# ---- recordings of parts ---------------------------------------------------------------------------------------------


def part(path):
    """What opens a recording of a part."""
    from testbench.measured import openers, trace_recording

    def read():
        if trace_recording.trace_table([path], {}) is None:
            openers.open_problem([path], {})

    return read


def _text_part(name, separators):
    def kind(rng, corpus, folder):
        path, source = folder / f"a.{rng.choice(('txt', 'dat'))}", corpus / name
        if rng.random() < 0.25:
            path.write_text(_flattened(rng, source.read_text(), separators), errors="replace")
        else:
            _bytes_or(
                rng,
                source,
                path,
                lambda: hostile.retyped(rng, source.read_text(), separators).encode("utf-8", "replace"),
            )
        return part(path)

    kind.__doc__ = f"{name}: text with hostile words, or a column that is the same in every row."
    return kind


def _flattened(rng, text, separators):
    """A table in which one column holds one value, or an arithmetic series, in every row."""
    lines = text.split("\n")
    separator = next(s for s in separators if s in lines[len(lines) // 2])
    column = rng.randrange(len(lines[len(lines) // 2].split(separator)))
    word = rng.choice(("0", "1", "-1", "1e-300", "1e8", "25.0"))
    out = []
    for k, line in enumerate(lines):
        words = line.split(separator)
        if k > 2 and column < len(words) and not line.startswith(("%", "!", "#")):
            words[column] = word if rng.random() < 0.999 else str(k)
        out.append(separator.join(words))
    return "\n".join(out)


def _npz(rng, source, path):
    """An archive of arrays with one array changed, or with what no writer makes."""
    with np.load(source) as archive:
        held = dict(archive)
    name, how = rng.choice(list(held)), rng.randrange(8)
    if how == 0:
        path.write_bytes(hostile.damaged(rng, source.read_bytes()))
        return
    if how < 5:
        held[name] = _array(rng, held[name])
    if how == 5:
        held[name] = np.array([{}], object)
    kinds = (zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2, zipfile.ZIP_STORED)
    with zipfile.ZipFile(path, "w", rng.choice(kinds)) as archive:
        for key, array in held.items():
            data = io.BytesIO()
            np.save(data, array, allow_pickle=True)
            body = data.getvalue()
            if how == 6 and key == name:
                body = _lying_header(rng)
            archive.writestr(f"{key}.npy", body)
        for k in range(rng.choice((0, 0, 0, 100))):
            archive.writestr(f"more{k}.npy", b"")
    if how == 7:
        data = bytearray(path.read_bytes())
        for at in range(len(data) - 4):
            if data[at : at + 4] == b"PK\x01\x02":
                data[at + rng.choice((8, 10, 20, 24))] ^= 1 << rng.randrange(8)
        path.write_bytes(data)


def _lying_header(rng):
    """An .npy file of 10^12 rows, of minus one, or of a header that is no dictionary."""
    shape = rng.choice(("(1000000000000,)", "(-1,)", "(2, 1000000000000, 0)", "()", "[1]", "(1.5,)"))
    kind = rng.choice(("'<i8'", "'|O'", "[('a', '<i8')]", "'<U1000000000'", "'x'", "3"))
    text = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + bytes(80)


def rest(rng, corpus, folder):
    """Gyroscope at rest, npz."""
    _npz(rng, corpus / "rest.npz", folder / "a.npz")
    return part(folder / "a.npz")


def checkpoint(rng, corpus, folder):
    """Finished work of a trace: a damaged file is never an error, it is computed again."""
    from testbench.tracing.problem.trace_checkpoint import Store

    kept = Store(folder)
    (folder / "ke").mkdir()
    _npz(rng, corpus / "point.npz", folder / "ke" / "key.npz")
    (folder / "ke" / "key.json").write_bytes(hostile.damaged(rng, b'{"a": [1, 2.5, "x"]}'))

    def read():
        kept.load_arrays("key")
        kept.load_or_compute("key", lambda: 1)

    return read


def mat(rng, corpus, folder):
    """MATLAB 5 file: levels of a DAC, or a driven resonator."""
    from scipy.io import loadmat, savemat

    path, source = folder / "a.mat", corpus / rng.choice(("levels.mat", "driven.mat"))
    held = {name: value for name, value in loadmat(source).items() if not name.startswith("__")}
    name, how = rng.choice(list(held)), rng.randrange(6)
    if how < 3:
        others = ({"a": 1}, "text", np.array([["x"]], object), 1j * held[name], np.zeros((0, 0)), [[]])
        held[name] = _array(rng, held[name]) if how else rng.choice(others)
        try:
            savemat(path, held, do_compression=rng.random() < 0.5)
        except (ValueError, TypeError, NotImplementedError):
            shutil.copy(source, path)
    elif how == 3:
        path.write_bytes(hostile.damaged(rng, source.read_bytes()))
    else:
        data = source.read_bytes()
        body = hostile.damaged(rng, data[128:]) if how == 4 else bytes(300_000_000 if rng.random() < 0.1 else 100_000)
        packed = zlib.compress(body, 1)
        path.write_bytes(data[:128] + struct.pack("<II", 15, len(packed)) + packed)
    return part(path)


def column_map(rng, corpus, folder):
    """Column map of a table, or the table."""
    source = corpus / "maps" / rng.choice([path.name for path in sorted((corpus / "maps").iterdir())])
    shutil.copy(source / "data", folder / "data")
    if rng.random() < 0.5:
        return part(_toml(rng, folder, (source / "map.toml").read_text()))
    data, path = source / "data", folder / "data"
    head = data.read_bytes()[:4]
    if rng.random() < BYTES or head == b"MATL":
        path.write_bytes(hostile.damaged(rng, data.read_bytes()))
    elif head == b"PAR1":
        _hostile_parquet(rng, path)
    elif head == b"PK\x03\x04":
        _npz(rng, data, path)
    else:
        change = rng.choice((hostile.retyped, _flattened))
        path.write_text(change(rng, data.read_text(), ";"), errors="replace")
    return part(shutil.copy(source / "map.toml", folder / "a.toml"))


KINDS = {
    "record": record, "state": state, "golden": golden, "hex": hexadecimal, "vcd": vcd, "fst": fst,
    "ghw": ghw, "csv": csv_log, "map": signal_map, "recording": recording, "config": configuration, "law": law,
    "campaign": campaign_plan, "plan": measured_plan, "import": imported,
    "store": store, "npz": rest, "checkpoint": checkpoint, "mat": mat, "column map": column_map,
    "touchstone": _text_part("sweep.s2p", "\t"), "ring-down": _text_part("ring.txt", ","),
    "spectrum": _text_part("spectrum.txt", ","), "meters": _text_part("meters.csv", ";"),
    "paper": _text_part("paper.csv", ","),
}  # fmt: skip
NEEDED = {"fst": "toy.fst", "ghw": "toy.ghw"}  # files that only some machines can make
