"""Engines that simulate nothing: numbers and rows are hashes of the configuration, at once or after a moment.

`ENGINE` takes one point to a call, `LANES` eight; `GYRO_INSTANT_S` is how long a point takes.
Misbehaviour is asked for by the rate: 1 raises, 2 kills its process, 3 keeps far more rows than a small disk holds.
"""

import hashlib
import os
import signal
import time

import numpy as np

from testbench.campaign.plan.engines import Engine
from testbench.engines import engine

ROWS = 64
RAISES_DPS, KILLS_DPS, LARGE_DPS = 1.0, 2.0, 3.0


def _one(config, sink):
    time.sleep(float(os.environ.get("GYRO_INSTANT_S", "0")))
    rate = config.scenario.rate_dps
    if rate == RAISES_DPS:
        raise ValueError("this point cannot be simulated")
    if rate == KILLS_DPS:
        os.kill(os.getpid(), signal.SIGKILL)
    text = f"{config.noise.seed} {config.plant.fx_hz} {config.scenario.temperature_degc} {rate}"
    seed = int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")
    rng = np.random.Generator(np.random.PCG64(seed))
    rows = ROWS * (4000 if rate == LARGE_DPS else 1)
    for first in range(0, rows, 40):
        n = min(40, rows - first)
        frames = rng.integers(-(1 << 20), 1 << 20, (n, len(engine.FRAME_COLUMNS)))
        sink.add(100 + first, frames, rng.standard_normal((n, len(engine.TRUTH_COLUMNS))))
    return {
        "drive_frequency_hz": config.plant.fx_hz + seed % 1000 / 1e6,
        "locked": True,
        "phase_deg.xe1": None,
        "codes_sha256": hashlib.sha256(text.encode()).hexdigest(),
    }


def play(configs, sinks):
    """As `testbench.campaign.plan.engines` says; a point that raises fails alone."""
    out = []
    for config, sink in zip(configs, sinks):
        try:
            out.append(_one(config, sink))
        except ValueError as problem:
            out.append(problem)
    return out


MODULES = ("tests.testbench.campaign.instant",)
ENGINE = Engine(play, 1, MODULES)
LANES = Engine(play, 8, MODULES, group=lambda config: config.scenario.seconds)
