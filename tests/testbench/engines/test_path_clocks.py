"""Clocks of one path: what does not have them refuses them by name."""

import pytest

from testbench.engines import baseband_setup
from testbench.engines.lanes import Engine
from testbench.errors import ConfigError
from testbench.golden.recording import board_recording
from testbench.measured.record import replay
from testbench.run import build
from tests.testbench.bench_setup import configured


@pytest.mark.parametrize("key", ["drive_sine", "sense_sine", "drive_code", "sense_code"])
def test_others_refuse_them_by_name(key):
    params = build.params(configured(**{f"firmware__{key}_registers": 1}), 25.0, 25.0)
    refused = (
        lambda: Engine([params]),
        lambda: baseband_setup.check(params),
        lambda: replay.order(params.fpga),
        lambda: board_recording.check(params.fpga),
    )
    for refuse in refused:
        with pytest.raises(ConfigError, match=r"firmware\.\*_sine_registers, \*_code_registers"):
            refuse()
