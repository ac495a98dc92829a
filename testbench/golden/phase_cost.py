"""What declared clocks cost in the loop: degrees at the drive frequency, and the bias that the lag makes.

    lag   clocks / master clock * 360 f                             `budget`
    bias  of the loops at rest with the lag, less that without it   `derived`; the scale factor likewise

The closed form takes the lag as the firmware's own word of that path, whose sign is the opposite; nothing is simulated.
Source  docs/phases.md, docs/foreign_designs.md
"""

from typing import NamedTuple

from testbench import config as configuration
from testbench.golden.foreign import latency_effects
from testbench.paper.loop import derived
from testbench.run.budget import Rows

DIGITS = 12  # of deg/s: what is smaller is the last place of the closed form
WORDS = {"xe1": "firmware.phase_drive_sine_deg", "ye1": "firmware.phase_sense_sine_deg"}


class Cost(NamedTuple):
    """An instance of the block, the node whose lag changes, by how many clocks and degrees, and what that makes.

    bias_dps   change of the bias (deg/s)
    scale_ppm  change of the scale factor
    """

    instance: str
    node: str
    clocks: int
    degrees: float
    bias_dps: float
    scale_ppm: float

    def text(self):
        return (
            f"{self.instance}: {self.node} {self.clocks:+d} clocks = {self.degrees:+.4f} deg, "
            f"bias {self.bias_dps:+.2g} deg/s, scale factor {self.scale_ppm:+.4g} ppm"
        )


def costs(stem, case, clocks, config=None):
    """[`Cost`] of ports of a block, {RTL port: clocks}, on a board (the default one); about 0.1 s for each node."""
    config = config or configuration.Config()
    start = config.scenario.temperature_degc
    temp_degc = start if isinstance(start, (int, float)) else start[0][1]
    port_costs, unlagged_loop = [], None
    for lag in latency_effects.lags(stem, case, clocks):
        unlagged_loop = unlagged_loop or derived.derive(config, temp_degc)
        hz = config.design_record().master_hz
        degrees = Rows(unlagged_loop.frequency_hz, hz, hz).clocks("", lag.clocks).degrees
        word = WORDS[lag.node]
        section, key = word.split(".")
        lagged_config = configuration.changed(config, {word: getattr(getattr(config, section), key) - degrees})
        lagged_loop = derived.derive(lagged_config, temp_degc)
        ppm = 1e6 * (lagged_loop.lsb_per_dps / unlagged_loop.lsb_per_dps - 1)
        port_costs.append(Cost(*lag, degrees, round(lagged_loop.bias_dps - unlagged_loop.bias_dps, DIGITS) + 0.0, ppm))
    return port_costs
