"""The folder of `gyro registers`, written once for the tests of its formats."""

import pytest

EXTRA = ("systemrdl", "peakrdl_cheader", "peakrdl_uvm", "peakrdl_ipxact", "peakrdl_html")


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    for name in EXTRA:
        pytest.importorskip(name, reason=f"{name} is not installed: no format of the register map was checked")
    from testbench.register_map.export import export

    folder = tmp_path_factory.mktemp("register_map") / "map"
    export(folder)
    return folder
