"""A locked gyroscope that goes on with other parts or another register: what is unstable would never lock."""

import numpy as np

from fpga_model.rates import FRAME_HZ, FRAME_TICKS, TICK_HZ
from testbench.run import simulate
from testbench.run.simulation import Simulation


def exchange(config, after, seconds, settle_s=2.0, writes=()):
    """Rows of `seconds` with the parts of `after`, from the locked and settled state of `config`.

    after   configuration of the same firmware
    writes  (register, raw) at the moment of the exchange
    """
    sim = Simulation(config, 25.0, 25.0)
    sim.keep_codes = sim.keep_rows = False
    simulate.start(config, sim, 0.0, 25.0)
    sim.advance(round(settle_s * TICK_HZ), 0.0, 25.0)
    sim.advance(-sim.tick % FRAME_TICKS, 0.0, 25.0)
    values = sim.state_values()
    sim = Simulation(after, 25.0, 25.0)
    sim.keep_codes = False
    sim.set_state(values)
    # the plant's matrix is made anew, at the frame's begin
    sim.state.plant.now[:] = np.inf
    sim.now = (np.zeros(1), np.full(1, 25.0))
    for name, raw in writes:
        sim.write(name, raw)
    sim.advance(round(seconds * TICK_HZ), 0.0, 25.0)
    return sim.columns()


def growth(words, least=2e4, most=2.5e6, span=100):
    """(time constant s, frequency Hz) of a word that grows away from its first value, by its swing every `span` frames.

    The frequency is 0 for one that does not change its sign.
    """
    swing = np.asarray(words, float) - float(words[0])
    until = int(np.argmax(np.abs(swing) > most)) or len(swing)
    swing = swing[:until]
    peaks = np.array([np.max(np.abs(swing[k : k + span])) for k in range(0, len(swing) - span, span)])
    seen = np.flatnonzero(peaks > least)
    if len(seen) < 3:
        raise ValueError(
            f"growth: {len(seen)} spans of {span} frames between {least:g} and {most:g} LSB, at least 3 needed"
        )
    slope = np.polyfit(seen * span / FRAME_HZ, np.log(peaks[seen]), 1)[0]
    late = swing[seen[0] * span :]
    turns = np.flatnonzero(np.diff(np.sign(late)))
    hz = (len(turns) - 1) / 2 / ((turns[-1] - turns[0]) / FRAME_HZ) if len(turns) > 2 else 0.0
    return float(1 / slope), float(hz)
