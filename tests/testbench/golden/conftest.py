"""Bundles for every test of this folder, exported once per run of the suite, and Verilator's library.

The library is compiled once for each version of Verilator, and kept beside what pytest keeps.
"""

import fcntl
import os
import shutil
import subprocess

import pytest

from testbench.golden.bundles import export


def of_all_workers(tmp_path_factory, name):
    """A temporary folder that every process of this run of the suite shares."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def bundles(tmp_path_factory):
    """Function of a block's name: folder of its bundles, one folder per case, that no other worker touches."""
    own = tmp_path_factory.mktemp("bundles")
    shared = of_all_workers(tmp_path_factory, "exported")

    def folder(stem):
        if not (own / stem).exists():
            with open(shared / f"{stem}.lock", "w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                # the block's own Makefile is written last
                if not (shared / stem / "Makefile").exists():
                    export.export(stem, shared)
            shutil.copytree(shared / stem, own / stem)
        return own / stem

    return folder


@pytest.fixture(scope="session")
def verilated(request, tmp_path_factory):
    """Folder as check.sh keeps it: Verilator's compiled library and its version; None without Verilator."""
    if shutil.which("verilator") is None or shutil.which("g++") is None:
        return None
    cache = getattr(request.config, "cache", None)  # none with -p no:cacheprovider
    folder = cache.mkdir("verilated") if cache else of_all_workers(tmp_path_factory, "verilated")
    version = subprocess.run(["verilator", "--version"], check=True, capture_output=True, text=True).stdout
    kept = folder / "kept"
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (kept / "version").exists() or (kept / "version").read_text() != version:
            _verilate(folder, kept)
            (kept / "version").write_text(version)  # last: what is there is whole
    return kept


def _verilate(folder, kept):
    shutil.rmtree(kept, ignore_errors=True)
    (folder / "t.v").write_text("module t; initial #1 $finish; endmodule\n")
    fast = ["-j", "0", "-MAKEFLAGS", "OPT_FAST=-O0 OPT_GLOBAL=-O0"]
    command = ["verilator", "--binary", "--timing", *fast, "-Wno-fatal", "--Mdir", "build", "t.v"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=300)
    kept.mkdir(exist_ok=True)
    for path in (folder / "build").glob("verilated*.o"):
        shutil.copy2(path, kept)
