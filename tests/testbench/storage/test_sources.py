"""The hash of the code: what an engine reaches, and nothing else."""

import shutil

import pytest

from fpga_model import kernel_cache
from testbench.campaign.plan import engines
from testbench.errors import ConfigError
from testbench.storage import sources


def test_the_frame_engine_reaches_firmware_plant_and_statistics():
    found = sources.reachable_modules(*engines.load("frame").modules, engines.MEASURES)
    wanted = (
        "fpga_model.dds",
        "fpga_model.jit",
        "analog_frontend.parts.noise",
        "testbench.engines.frame",
        "testbench.campaign.plan.measure",
    )
    assert set(wanted) <= set(found)
    assert not {
        "testbench.commands.main",
        "testbench.bench.measure_speed",
        "testbench.campaign.pool",
    } & set(found)


def test_an_edit_counts_where_it_is_reached(tmp_path, monkeypatch):
    for package in kernel_cache.PACKAGES:
        shutil.copytree(kernel_cache.ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(kernel_cache, "ROOT", tmp_path)

    def code():
        sources.reachable_modules.cache_clear()
        sources.code_sha256.cache_clear()
        return sources.code_sha256("testbench.run.simulate", engines.MEASURES)

    before = code()
    with open(tmp_path / "testbench" / "commands" / "main.py", "a") as file:
        file.write("# more\n")
    assert code() == before
    with open(tmp_path / "fpga_model" / "sine.py", "a") as file:
        file.write("# more\n")
    assert code() != before
    sources.reachable_modules.cache_clear()
    sources.code_sha256.cache_clear()


def test_an_engine_elsewhere_counts_too(tmp_path, monkeypatch):
    (tmp_path / "my_engine_of_tests.py").write_text(
        "from testbench.campaign.plan.engines import Engine\n"
        "MINE = Engine(lambda configs, sinks: [{}], 1, ('my_engine_of_tests',))\nOTHER = 3\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    engine = engines.load("my_engine_of_tests:MINE")
    assert "my_engine_of_tests" in sources.reachable_modules(*engine.modules)
    with pytest.raises(ConfigError, match="is a int, not an Engine"):
        engines.load("my_engine_of_tests:OTHER")
    with pytest.raises(ConfigError, match="cannot be loaded"):
        engines.load("my_engine_of_tests:GONE")
