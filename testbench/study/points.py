"""A point of the study: one gyroscope from power-on, a record at rest, two rates, a multisine, codes of the drive DAC.

    rest      scenario.seconds; its 8 kHz rows are what [keep] keeps; density of the rate word, 0.5 to 5 Hz
    rates     +-RATE_DPS: scale factor
    lines     multisine of rate: bandwidth
    codes     of the drive DAC, CODE_RECORDS times SPECTRUM_TICKS: the largest line beside the carrier

An engine of a campaign, `testbench.study.points:POINTS`.
Source    docs/word_lengths.md
"""

import math

import numpy as np

from testbench.campaign.plan.engines import Engine
from testbench.errors import ConfigError
from testbench.paper.measure import measure_bandwidth
from testbench.run import build, design_check, simulate
from testbench.run.simulation import DEG, SPECTRUM_TICKS, Simulation

SETTLE_S = 3.0
RATE_DPS, RATE_SETTLE_S, RATE_READ_S = 100.0, 1.5, 1.5
BAND_HZ = 0.5, 5.0
LINE_TIMES = 10.0
CODE_RECORDS = 4
CARRIER_GUARD_HZ = 300.0  # of the carrier: noise of the amplitude loop
MOST_HARMONIC = 6500
# five terms of a flat top: a line between two bins loses 0.01 dB
FLAT_TOP = 0.21557895, -0.41663158, 0.277263158, -0.083578947, 0.006947368


class Board:
    """A gyroscope of any design at its default frame rate, driven as the bench of the paper's measures expects."""

    slower, part = 1, 1.0

    def __init__(self, config):
        design_check.default_only(config, "the study of word lengths", ("master_hz", "tick_clocks", "frame_ticks"))
        self.config, self.temp_degc = config, float(config.scenario.temperature_degc)
        self.sim = Simulation(config, self.temp_degc, self.temp_degc, engine="frame")
        self.sim.keep_rows = self.sim.keep_codes = False
        self.lock_s = simulate.start(config, self.sim, 0.0, self.temp_degc)
        if self.lock_s is None:
            raise ConfigError(f"study: the gyroscope does not lock within {simulate.lock_limit_s(config):g} s")
        self.wait(SETTLE_S)

    @property
    def frame_s(self):
        """Time from row to row."""
        return 1 / self.sim.design.frame_hz

    def wait(self, seconds, rate_dps=0.0):
        """Let time pass at a rate, or one value per frame."""
        rate = np.atleast_1d(rate_dps) * DEG
        self.sim.advance(round(seconds * self.sim.design.tick_hz), rate, self.temp_degc)

    def record(self, seconds, rate_dps=0.0, sinks=(), names=("rate_word",)):
        """{column: values} of the next seconds; `sinks` get the rows too."""
        watches = {name: simulate.Watch(name) for name in names}
        self.sim.sinks += [*watches.values(), *sinks]
        self.wait(seconds, rate_dps)
        self.sim.sinks = []
        return {name: watch.values() for name, watch in watches.items()}


def band_density(words, frame_hz):
    """(one-sided density (LSB^2/Hz) of words, mean over BAND_HZ; amplitude (LSB) of the largest line in it, 0 if none).

    A straight line is taken away first. A bin above LINE_TIMES the level of the noise is a spectral line: it is no
    random walk, and is left out with its neighbours. Noise alone exceeds it in 1 % of records of 60 s.
    """
    n = len(words)
    k = np.arange(n) - (n - 1) / 2
    x = words - words.mean()
    x = x - k * (k @ x) / (k @ k)
    f = np.fft.rfftfreq(n, 1 / frame_hz)
    power = 2 * np.abs(np.fft.rfft(x)) ** 2 / (frame_hz * n)
    power = power[(f >= BAND_HZ[0]) & (f <= BAND_HZ[1])]
    is_line = power > LINE_TIMES * np.median(power) / math.log(2)
    lines = np.convolve(is_line, np.ones(3), "same") > 0
    largest = math.sqrt(2 * power[is_line].max() * frame_hz / n) if is_line.any() else 0.0
    return float(power[~lines].mean()), largest


def largest_line(records, tick_hz, carrier_hz):
    """(odd harmonic, dBc) of the largest line beside the carrier, up to MOST_HARMONIC; mean power of records."""
    n = len(records[0])
    turn = 2 * np.pi * np.arange(n) / n
    window = sum(a * np.cos(k * turn) for k, a in enumerate(FLAT_TOP))
    power = sum(np.abs(np.fft.rfft(codes * window)) ** 2 for codes in records)
    harmonic = np.arange(1, MOST_HARMONIC, 2)
    alias = harmonic * carrier_hz % tick_hz
    alias = np.minimum(alias, tick_hz - alias)
    level = power[np.round(alias * n / tick_hz).astype(int)]
    far = (np.abs(alias - carrier_hz) > CARRIER_GUARD_HZ) & (alias > CARRIER_GUARD_HZ)
    top = int(np.argmax(np.where(far, level, 0.0)))
    return int(harmonic[top]), 10 * math.log10(max(level[top], 1e-12) / level[0])


def measure_point(config, sink):
    """{name: number} of one configuration; its rows at rest go to `sink`."""
    board = Board(config)
    design = board.sim.design
    columns = board.record(config.scenario.seconds, 0.0, (sink,), ("rate_word", "frequency_word"))
    words = columns["rate_word"].astype(float)
    carrier_hz = float(columns["frequency_word"][-1000:].mean()) * build.lsb_hz(config)
    board.sim.keep_codes = True
    codes = []
    for _ in range(CODE_RECORDS):
        board.wait(SPECTRUM_TICKS / design.tick_hz)
        codes.append(board.sim.tail[0].astype(float))
    board.sim.keep_codes = False
    harmonic, spur_dbc = largest_line(codes, design.tick_hz, carrier_hz)
    density, line_lsb = band_density(words, design.frame_hz)
    means = {}
    for rate in (RATE_DPS, -RATE_DPS):
        board.wait(RATE_SETTLE_S, rate)
        means[rate] = float(board.record(RATE_READ_S, rate)["rate_word"].mean())
    scale = (means[RATE_DPS] - means[-RATE_DPS]) / (2 * RATE_DPS)
    board.wait(RATE_SETTLE_S)
    lines = measure_bandwidth.multisine(board, scale)
    return {
        "locked": int(board.sim.locked),
        "lock_s": board.lock_s,
        "density_lsb2_per_hz": density,
        "band_line_lsb": line_lsb,
        "noise_lsb": float(words.std(ddof=1)),
        "bias_lsb": float(words.mean()),
        "scale_lsb_per_dps": scale,
        "bandwidth_hz": lines.bandwidth_hz,
        "spur_harmonic": harmonic,
        "spur_dbc": spur_dbc,
    }


def run_points(configs, sinks):
    """As `campaign.engines` says, one point to a call; a board that does not lock fails alone."""
    out = []
    for config, sink in zip(configs, sinks):
        try:
            out.append(measure_point(config, sink))
        except ConfigError as problem:
            out.append(problem)
    return out


def _compile():
    from testbench.run import warmup

    warmup.warm_up()


POINTS = Engine(run_points, 1, ("testbench.study.points", "testbench.run.simulate"), _compile)
