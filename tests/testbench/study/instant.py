"""An engine of a study that simulates nothing: numbers near the default's, a little other for other word lengths."""

import numpy as np

from testbench.campaign.plan.engines import Engine
from testbench.engines import engine


def play(configs, sinks):
    """As `testbench.campaign.plan.engines` says."""
    out = []
    for config, sink in zip(configs, sinks):
        rng = np.random.default_rng(config.noise.seed)
        frames = rng.integers(-100, 100, (8 * 32000, len(engine.FRAME_COLUMNS)))
        sink.add(0, frames, np.zeros((len(frames), len(engine.TRUTH_COLUMNS))))
        coarse = 24 - config.design.adc_bits
        out.append(
            {
                "locked": 1,
                "density_lsb2_per_hz": 845.0 * (1 + 0.01 * coarse),
                "band_line_lsb": 0.0,
                "noise_lsb": 161.0,
                "bias_lsb": 12670.0,
                "scale_lsb_per_dps": 8794.0 + coarse,
                "bandwidth_hz": 25.4,
                "spur_dbc": -80.0,
                "spur_harmonic": 2095,
            }
        )
    return out


ENGINE = Engine(play, 1, ("tests.testbench.study.instant",))
