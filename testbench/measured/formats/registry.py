"""Measured data that others have published: name, origin, size, SHA-256. None of it is in the repository.

    GYRO_DATA_DIR=FOLDER   FOLDER/SET/FILE is read, and checked against the hash
    else                   pooch downloads from the origin into its cache (or GYRO_DATA_CACHE), and checks the hash
A file that is not the published one is refused. What is found in a file never depends on its name or set.
The list is `published.csv` in this folder, a `File` a row; the set silverbox is that of nonlinearbenchmark.org.
The licences of the data are their owners', mostly not stated.
Source    docs/measured_results.md, docs/references.md
"""

import csv
import os
from pathlib import Path
from typing import NamedTuple

from testbench.errors import FileError
from testbench.storage.inputs import file_sha256

FOLDER, CACHE = "GYRO_DATA_DIR", "GYRO_DATA_CACHE"


class File(NamedTuple):
    """One published file. `member`: its name in the archive that `url` is; no `url`: it is not published as it is."""

    set: str
    name: str
    bytes: int
    sha256: str
    url: str = ""
    member: str = ""
    note: str = ""


with open(Path(__file__).with_name("published.csv"), encoding="utf-8", newline="") as _table:
    FILES = tuple(File(**row | {"bytes": int(row["bytes"])}) for row in csv.DictReader(_table))
SETS = tuple(dict.fromkeys(f.set for f in FILES))


def files(set_name):
    """The `File`s of a set; FileError names those there are."""
    set_files = tuple(f for f in FILES if f.set == set_name)
    if not set_files:
        raise FileError(f"data set {set_name!r}: unknown; known: {', '.join(SETS)}")
    return set_files


def paths(set_name):
    """Where the files of a set lie, downloaded first if need be."""
    return [path(file) for file in files(set_name)]


def folders():
    """{set: [paths]} of all sets that can be had: those that are not published as they are need the folder."""
    has_data_folder = bool(os.environ.get(FOLDER))
    return {name: paths(name) for name in SETS if has_data_folder or all(f.url for f in files(name))}


def path(file):
    """Where the bytes of a `File` lie on this machine; FileError if they cannot be had or are others."""
    folder = os.environ.get(FOLDER)
    if folder:
        file_path = Path(folder) / file.set / file.name
        if not file_path.is_file():
            raise FileError(f"{file_path}: does not exist ({FOLDER}={folder})")
        return _verify_file(file_path, file)
    if not file.url:
        raise FileError(f"{file.set}/{file.name}: {file.note}; set {FOLDER} to a folder that contains it")
    return _verify_file(_download_file(file), file)


def _verify_file(file_path, file):
    size = file_path.stat().st_size
    if size != file.bytes:
        raise FileError(f"{file_path}: {size} bytes, the published file has {file.bytes}")
    local_sha256 = file_sha256(file_path)
    if local_sha256 != file.sha256:
        raise FileError(f"{file_path}: SHA-256 {local_sha256}, the published file has {file.sha256}")
    return file_path


def _download_file(file):
    import pooch

    cache = Path(os.environ.get(CACHE) or pooch.os_cache("ftr-gyro")) / file.set
    try:
        if not file.member:
            return Path(pooch.retrieve(file.url, f"sha256:{file.sha256}", fname=file.name, path=cache))
        unpack = pooch.Unzip(members=[file.member], extract_dir="unpacked")
        unpacked_paths = pooch.retrieve(file.url, None, fname="archive.zip", path=cache, processor=unpack)
    except (OSError, ValueError) as problem:  # requests' errors are OSErrors; a wrong hash is a ValueError
        raise FileError(f"{file.set}/{file.name}: cannot be downloaded from {file.url}: {problem}") from None
    for name in unpacked_paths:
        if name.endswith(file.member):
            return Path(name)
    raise FileError(f"{file.set}/{file.name}: {file.url} does not contain {file.member}")
