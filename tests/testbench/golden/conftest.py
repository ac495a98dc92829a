"""Bundles for every test of this folder, exported once per run of the suite, and Verilator's library, compiled once."""

import fcntl
import os
import shutil
import subprocess

import pytest

from testbench.golden.bundles import export


@pytest.fixture(scope="session")
def bundles(tmp_path_factory):
    """Function of a block's name: folder of its bundles, one folder per case, that no other worker touches."""
    own = tmp_path_factory.mktemp("bundles")
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    shared = shared / "exported"
    shared.mkdir(exist_ok=True)

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
def verilated(tmp_path_factory):
    """Folder as check.sh keeps it: Verilator's compiled library and its version; None without Verilator."""
    if shutil.which("verilator") is None or shutil.which("g++") is None:
        return None
    folder = tmp_path_factory.mktemp("verilated")
    (folder / "t.v").write_text("module t; initial #1 $finish; endmodule\n")
    fast = ["-j", "0", "-MAKEFLAGS", "OPT_FAST=-O0 OPT_GLOBAL=-O0"]
    command = ["verilator", "--binary", "--timing", *fast, "-Wno-fatal", "--Mdir", "build", "t.v"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=300)
    kept = folder / "kept"
    kept.mkdir()
    for path in (folder / "build").glob("verilated*.o"):
        shutil.copy2(path, kept)
    version = subprocess.run(["verilator", "--version"], check=True, capture_output=True, text=True).stdout
    (kept / "version").write_text(version)
    return kept
