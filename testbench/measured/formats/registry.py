"""Measured data that others have published: name, origin, size, SHA-256. None of it is in the repository.

    GYRO_DATA_DIR=FOLDER   FOLDER/SET/FILE is read, and checked against the hash
    else                   pooch downloads from the origin into its cache (or GYRO_DATA_CACHE), and checks the hash
A file that is not the published one is refused. What is found in a file never depends on its name or set: `by_hash`
is for what belongs to the bytes themselves, such as an official split of samples.
Source    docs/measured_resonators.md; licences of the data are their owners', mostly not stated
"""

import hashlib
import os
from pathlib import Path
from typing import NamedTuple

from testbench.errors import FileError

FOLDER, CACHE = "GYRO_DATA_DIR", "GYRO_DATA_CACHE"
_RAW = "https://raw.githubusercontent.com/"
_QUARTZ = _RAW + "chili-chips-ba/uberClock/75c4e48/5.characterization/1.raw_data/1.Top/"
_RINGS = _RAW + "qpit/Ringdown-Processor/f12f12e56539dc73ccca0173836b57def7aec826/raw%20measurements%20data/"
_DAC = _RAW + "eielsen/dac_linearisation/f891058/measurements_and_data/"
_DMM = _RAW + "tin-/linkit/7924c72/"
_BOX = "https://drive.google.com/uc?export=download&id=17iS-6oBUUgrmiAcrZoG9S5sOaljZnDSy"  # nonlinearbenchmark.org
_DECADE = "dcl_rnd_10v_h1_k2001_nplc10_soak8s_comp_samples-3_jun2026.dsv"


class File(NamedTuple):
    """One published file. `member`: its name in the archive that `url` is; no `url`: it is not published as it is."""

    set: str
    name: str
    bytes: int
    sha256: str
    url: str = ""
    member: str = ""
    note: str = ""


def _ring(number, sample, size, sha256):
    name = f"measID_{number}_sampleID_{sample}.txt"
    return File("mems_ringdown", name, size, sha256, _RINGS + name)


_CONVERTED = "converted from adis_16405_imu1.rda of github.com/SMAC-Group/imudata, commit eec6e5b"
_TYPED = "typed from the paper, doi 10.1038/s41378-025-01144-6"
FILES = (
    File(
        "silverbox",
        "SNLS80mV.mat",
        2097520,
        "5c7413a52255af0cb4e2f93fb6903beb92b08965ba1e6ad0a6ffedfed8477ed4",
        _BOX,
        "SilverboxFiles/SNLS80mV.mat",
    ),
    File(
        "silverbox",
        "Schroeder80mV.mat",
        2097520,
        "ec5a9740a4789aa20b9d84f387424c0218e843844807b30b367c218778339fb6",
        _BOX,
        "SilverboxFiles/Schroeder80mV.mat",
    ),
    File(
        "quartz_vna",
        "A100_top_20C.s2p",
        853569,
        "100bd8c5879a99bd8f1e3e23e92f8f83308d6386aa48b402bcf48b327b53217a",
        _QUARTZ + "3.A100/A100_20C.s2p",
    ),
    File(
        "quartz_vna",
        "A100_top_25C.s2p",
        847243,
        "36e9dbb6fd22be1c74486612594df0e01147e9e92f5fc775eb904bb03a3d6f62",
        _QUARTZ + "3.A100/A100_25C.s2p",
    ),
    File(
        "quartz_vna",
        "C300_top_20C.s2p",
        851847,
        "a141d094581d95d06fc39bf454aebd1228a9f22fe089c205e7dc1fcb0b75c02b",
        _QUARTZ + "4.C300/C300_20C.s2p",
    ),
    File(
        "quartz_vna",
        "C300_top_25C.s2p",
        845501,
        "7c06f49a71c8eb58541072b42e6b9cc31dff0c92b9fc9768ed31262c66ec8d24",
        _QUARTZ + "4.C300/C300_25C.s2p",
    ),
    _ring(1445, "SP64-32", 25008, "81823406b4318de3ae847e1815e91a0a9e839919ecfc1222a6f7a87ed907c2ee"),
    _ring(1446, "SP64-32", 24989, "4819f0bb6757ec482be2f07170a4ef10601ba158400d713195ea46d5f01875d4"),
    _ring(1447, "SP64-32", 25003, "f132edd318b77f566493ca4e2482b7e2256408938c4689c7594113dd039126f4"),
    _ring(1448, "SP64-32", 25004, "814ec7d4613889600b9ec9733d7c4646922a31bea2fdd7cf53f78c83a0003e51"),
    _ring(1450, "SP64-33", 25000, "3f43f91d04928a5c6cf2fdedd897db5d1b2334a2c5a8f88fe203e675e03ef836"),
    _ring(1451, "SP64-33", 24991, "4a2c53d50d9cb06e6d59c2aab62412d81ee6e2a501ca61fa194f4192c424cb9e"),
    _ring(1452, "SP64-33", 25005, "de507ba9ff5c904c96f9d2f88fbcd02a9ae75a89c87fc9095df71054f97a0082"),
    _ring(1618, "SPT08-53-11", 15981, "70212357f1385fbdf3eefe7a115d96b256e9358a3bd66b2f53a8b67a1c064c4b"),
    _ring(3277, "PSE2-84-11", 22090, "7b77225e7e082662e2bf29266c22dd8024a38ca6cf29c530b9dc561cebc79f81"),
    _ring(3279, "PSE2-84-21", 22226, "5a7db58f3c2b625bf5a09857c8d852e01bde2a31be531702f5eb0d1a72a091d0"),
    _ring(3290, "PSE2-48-21", 22272, "56ddb280775add6c5689f698ac620241aa36ee973c32621f05abc096413a5e2f"),
    File(
        "dac16_levels",
        "PHYSCAL_level_measurements_set_1.mat",
        558633,
        "26767dcd0ac93b8c7afc95404d391afd25e6c9210bf3aa1a9d2238627a8f359d",
        _DAC + "PHYSCAL_level_measurements_set_1.mat",
    ),
    File(
        "dac16_levels",
        "PHYSCAL_level_measurements_set_2.mat",
        530102,
        "b68915cfff06c04600021193ff1b327addb004f73314938103a4858d3114837b",
        _DAC + "PHYSCAL_level_measurements_set_2.mat",
    ),
    File(
        "dmm_linearity",
        "dcl_10vdc_5440b_3458a_nplc100.csv",
        8998,
        "bab369705316dc0ff8f3da869c8d99e01e61005d2dcacbee520f39fb6407779b",
        _DMM + "example_data/dcl_10vdc_5440b_3458a_nplc100.csv",
    ),
    File(
        "dmm_linearity",
        "dcl_10vdc_hulk_3458ab_nplc100.csv",
        13064,
        "4898798c7d6d62c0d071c42cf375dd2cf8e6d65f7d962b42b7730cad1bb415f1",
        _DMM + "example_data/dcl_10vdc_hulk_3458ab_nplc100.csv",
    ),
    File(
        "dmm_linearity",
        _DECADE,
        68234,
        "a087db66de9addb430b6923748c20571ac468f5cd774b458e9ab91d3126daf5c",
        _DMM + "dmm9/" + _DECADE,
    ),
    File(
        "gyro_static",
        "adis_16405_imu1_gyro.npz",
        2505722,
        "3d2d60ff8080a973813b143a68398507fb6871d14814d40100f20fc4607c40a0",
        note=_CONVERTED,
    ),
    File(
        "paper_numbers",
        "measured_numbers.csv",
        15657,
        "af596dbec37b998174fdfe340275a2ac8a0f0963fd72ba294462b0e452f25565",
        note=_TYPED,
    ),
    File(
        "paper_numbers",
        "related_device_parameters.csv",
        7985,
        "efb43173d346c207e0e324c0846ecdfe0e0bb9ca5bcd7b2d59d0884c12951122",
        note=_TYPED,
    ),
)
SETS = tuple(dict.fromkeys(f.set for f in FILES))


def sha256_of(path):
    """SHA-256 of a file, hexadecimal; FileError if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as problem:
        raise FileError(f"{path}: cannot be read: {problem.strerror or problem}") from None


def by_hash(sha256):
    """The `File` with these bytes, or None."""
    return next((f for f in FILES if f.sha256 == sha256), None)


def files(set_name):
    """The `File`s of a set; FileError names those there are."""
    found = tuple(f for f in FILES if f.set == set_name)
    if not found:
        raise FileError(f"data set {set_name!r}: none of {', '.join(SETS)}")
    return found


def paths(set_name):
    """Where the files of a set lie, downloaded first if need be."""
    return [path(file) for file in files(set_name)]


def folders():
    """{set: [paths]} of all sets that can be had: those that are not published as they are need the folder."""
    whole = bool(os.environ.get(FOLDER))
    return {name: paths(name) for name in SETS if whole or all(f.url for f in files(name))}


def path(file):
    """Where the bytes of a `File` lie on this machine; FileError if they cannot be had or are others."""
    folder = os.environ.get(FOLDER)
    if folder:
        there = Path(folder) / file.set / file.name
        if not there.is_file():
            raise FileError(f"{there}: is not there ({FOLDER}={folder})")
        return _checked(there, file)
    if not file.url:
        raise FileError(f"{file.set}/{file.name}: {file.note}; set {FOLDER} to a folder that holds it")
    return _checked(_downloaded(file), file)


def _checked(there, file):
    size = there.stat().st_size
    if size != file.bytes:
        raise FileError(f"{there}: {size} bytes, the published file has {file.bytes}")
    found = sha256_of(there)
    if found != file.sha256:
        raise FileError(f"{there}: SHA-256 {found}, the published file has {file.sha256}")
    return there


def _downloaded(file):
    import pooch

    cache = Path(os.environ.get(CACHE) or pooch.os_cache("ftr-gyro")) / file.set
    try:
        if not file.member:
            return Path(pooch.retrieve(file.url, f"sha256:{file.sha256}", fname=file.name, path=cache))
        unpack = pooch.Unzip(members=[file.member], extract_dir="unpacked")
        found = pooch.retrieve(file.url, None, fname="archive.zip", path=cache, processor=unpack)
    except (OSError, ValueError) as problem:  # requests' errors are OSErrors; a wrong hash is a ValueError
        raise FileError(f"{file.set}/{file.name}: cannot be had from {file.url}: {problem}") from None
    for name in found:
        if name.endswith(file.member):
            return Path(name)
    raise FileError(f"{file.set}/{file.name}: {file.url} holds no {file.member}")
