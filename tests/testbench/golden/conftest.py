"""Bundles for every test of this folder: each block is exported once per run of the suite, each worker gets a copy."""

import fcntl
import os
import shutil

import pytest

from testbench.golden import export


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
