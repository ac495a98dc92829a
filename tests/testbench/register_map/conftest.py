"""The folder of `gyro registers`, written once for the tests of its formats, and a program with its C driver."""

import shutil
import subprocess
from pathlib import Path

import pytest

EXTRA = ("systemrdl", "peakrdl_cheader", "peakrdl_uvm", "peakrdl_ipxact", "peakrdl_html")
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-O1", "-g")
CHECKED = ("-fsanitize=undefined,address", "-fno-sanitize-recover=all")


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    for name in EXTRA:
        pytest.importorskip(name, reason=f"{name} is not installed: no format of the register map was checked")
    from testbench.register_map.export_registers import export

    folder = tmp_path_factory.mktemp("register_map") / "map"
    export(folder)
    return folder


@pytest.fixture(scope="session")
def driver(exported, tmp_path_factory):
    """Lines of a program that calls the driver for each line of a list."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed: the driver was NOT compiled")
    program = tmp_path_factory.mktemp("driver") / "host"
    folder = exported / "c"
    sources = [Path(__file__).with_name("driver_host.c"), folder / "gyro_driver.c", folder / "gyro_spi.c"]
    command = ["gcc", *STRICT, *CHECKED, f"-I{folder}", *map(str, sources), "-o", str(program)]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr

    def called(lines):
        done = subprocess.run([program], input="\n".join(lines), capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        found = done.stdout.splitlines()
        assert len(found) == len(lines)
        return found

    return called
