"""A plant for differences: references that leave evenly, and how far a step goes.

Source    docs/measured.md
"""

from fpga_model.rates import MASTER_HZ, TICK_CYCLES
from testbench import config as configuration

RETIMING_DELAY_S = (TICK_CYCLES + 1) / 2 / MASTER_HZ  # 1 .. 26 clocks of waiting (fpga_model/references.py)
FREQUENCY_TOLERANCE_HZ = 1e-3  # of the drive frequency
AIM = 300.0  # sigmas by which a step moves all features together


def disable_retiming(config):
    """A configuration whose references leave evenly, at the same mean phase."""
    if not config.firmware.reference_retimed:
        return config
    changes = {"firmware.reference_retimed": False, "plant.sid_switch_s": config.plant.sid_switch_s + RETIMING_DELAY_S}
    return configuration.changed(config, changes)
