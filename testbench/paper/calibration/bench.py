"""What a laboratory has in hand: one board on a rate table in an oven, its host port, and a counter.

    write, read    the register map                        rows     codes and words of each frame, as a host reads them
    rate, oven     what the table and the oven are set to  counter  interval between a reference pin and a voltage

No truth leaves this module but through `Judge`, which a procedure is never given.
Source    docs/paper.md
"""

import contextlib
import math
from typing import NamedTuple

import numpy as np

from fpga_model import dds, registers, sequencer
from testbench.errors import ConfigError
from testbench.paper.calibration import counter
from testbench.paper.calibration.grid import Grid
from testbench.run import budget, build, simulate
from testbench.run.simulation import DEG, FRAME, Simulation

PHASE_REGISTERS = ("phase_drive_sine", "phase_sense_sine", "phase_drive_ref", "phase_sense_ref")
GATE_S, COUNTED_S, STAMP_S = 0.25, 1.0, 0.5
OFFSET_HZ, OFFSET_WAIT_S, OFFSET_S = 80.0, 0.6, 1.0
READY_S = 4.0  # all boards that lock are at this time together
LARGEST_DPS, RANGE_PART = 500.0, 0.52  # largest rate of the procedures; part of a board's range that it may be


class _Rows:
    """A sink that keeps the registers, not the truth."""

    def __init__(self):
        self.pieces = []

    def add(self, first_frame, frames, truth):
        self.pieces.append(frames)


class Rows:
    """Rows of a segment, one a frame: `rows["rate_word"]`.

    stamps  instants of the reference grid, from the first row's on, at which edges of a sgn(sin) have left
    """

    def __init__(self, pieces, stamps=()):
        self._frames = np.concatenate(pieces) if pieces else np.zeros((0, len(FRAME)), np.int64)
        self.stamps = np.asarray(stamps, np.int64)

    def __len__(self):
        return len(self._frames)

    def __getitem__(self, name):
        return self._frames[:, FRAME[name]]

    def mean(self, name):
        """Mean of a column in its LSB."""
        return float(np.mean(self[name]))

    def hann(self, name):
        """Hann-weighted mean: lines that ring beside the mean do not enter."""
        x = self[name]
        weights = np.sin(np.pi * (np.arange(len(x)) + 0.5) / len(x)) ** 2
        return float(weights @ x / weights.sum())


class Bench:
    """One powered board.

    config   what the board is; the procedure on the bench does not look into it
    engine   name of an engine instead of that of the configuration
    drawing  the nominal board: what the procedure may know of the board
    design   rates and word lengths of its firmware
    pace     how many times longer than the default's loops the slowest of this board takes to settle
    slower   how many times slower than the default's the rate loop is, a whole number
    part     part of the default's rates that is within this board's range
    Raises ConfigError if the board does not lock.
    """

    def __init__(self, config, rate_dps=0.0, temp_degc=25.0, engine=None):
        self._sim = Simulation(config, temp_degc, temp_degc, engine=engine)
        self._sim.keep_codes = self._sim.keep_rows = False
        self.design = self._sim.design
        self.drawing, self.pace = config.nominal_device(), simulate.pace(config)
        self.slower = simulate.rate_loop_pace(config)
        largest_dps = self.drawing.sense_dac_span_v / abs(build.nominal(config)["word_v_per_deg_s"])
        self.part = min(1.0, RANGE_PART * largest_dps / LARGEST_DPS)
        self.rate_dps, self.temp_degc = rate_dps, temp_degc
        self.offset_codes = self._offsets(config)
        if simulate.start(config, self._sim, rate_dps * DEG, temp_degc) is None:
            raise ConfigError(f"calibration: the board does not lock within {simulate.lock_limit_s(config):g} s")
        ready = self._ticks(READY_S * self.pace)
        if self._sim.tick < ready:
            self._run(ready - self._sim.tick)

    def _offsets(self, config):
        """Codes of the demodulators before the drive is on: {column: LSB}. The board's first act is this wait.

        The references run OFFSET_HZ beside the nominal frequency: what the DACs' power-on has struck rings there.
        """
        self._sim.now = (np.array([self.rate_dps * DEG]), np.array([self.temp_degc]))
        self.write("control", 0)
        self.write("frequency_fixed", dds.word_of_hz(config.firmware.nominal_frequency_hz + OFFSET_HZ, self.design))
        self.wait(OFFSET_WAIT_S)
        rows = self.record(OFFSET_S)
        codes = {name: rows.hann(name) for name in ("adc_drive_sin", "adc_drive_cos", "adc_sense_sin", "adc_sense_cos")}
        self.write("control", sequencer.RUN)
        return codes

    def _ticks(self, seconds):
        return round(seconds * self.design.tick_hz)

    def _run(self, ticks):
        self._sim.advance(ticks, self.rate_dps * DEG, self.temp_degc)

    @property
    def time_s(self):
        """Time since power-on."""
        return self._sim.tick / self.design.tick_hz

    @property
    def frame_s(self):
        """Time from row to row."""
        return 1 / self.design.frame_hz

    @property
    def lsb_hz(self):
        """Nominal frequency of one LSB of the DDS."""
        return self.design.master_hz / 2**self.design.dds_bits

    def drive_v(self, word):
        """Drive voltage amplitude (V) of an amplitude word, by the span that the board is drawn with."""
        return word / 2**23 * self.drawing.drive_dac_span_v

    def quadrature_v(self, code):
        """V_q (V) of a mean code of its DAC of 16 bits, by the span that the board is drawn with."""
        return (code + 0.5) / 2**16 * self.drawing.quad_dac_span_v

    @property
    def locked(self):
        """All four loops are locked, or deliberately held."""
        return bool(self._sim.locked)

    def wait(self, seconds):
        """Let time pass."""
        self._run(self._ticks(seconds))

    def settle(self, seconds):
        """Wait as long as this board's loops need where the default's need `seconds`."""
        self.wait(seconds * self.pace)

    def record(self, seconds, rate_dps=None):
        """`Rows` of the next seconds; `rate_dps` an array of one value per frame, or the table's rate."""
        with self._rows() as sink:
            rate = np.atleast_1d(self.rate_dps if rate_dps is None else rate_dps) * DEG
            self._sim.advance(self._ticks(seconds), rate, self.temp_degc)
        return Rows(sink.pieces)

    def record_with_stamps(self, seconds):
        """`Rows` of the next seconds, in the last STAMP_S of which the counter stamps the drive's sgn(sin)."""
        with self._rows() as sink:
            first_row = self._first_row()
            self.wait(seconds - STAMP_S)
            stamps = [self._stamps(begun - first_row, probe, "drive") for begun, probe in self._gates(STAMP_S)]
        return Rows(sink.pieces, np.concatenate(stamps))

    @contextlib.contextmanager
    def _rows(self):
        sink = _Rows()
        self._sim.sinks.append(sink)
        try:
            yield sink
        finally:
            self._sim.sinks.remove(sink)

    def _first_row(self):
        """Tick at which the next row begins."""
        return -(-self._sim.tick // self.design.frame_ticks) * self.design.frame_ticks

    def _gates(self, seconds):
        """(first tick, `nodes.Probe`) of gates of GATE_S, one after the other."""
        ticks = self._ticks(GATE_S)
        for _ in range(round(seconds / GATE_S)):
            first = self._sim.tick
            streams = self._sim.advance(ticks, self.rate_dps * DEG, self.temp_degc, probe_ticks=ticks)
            yield first, self._sim.read_out(streams, self.temp_degc)

    def _stamps(self, ticks, probe, channel):
        """Instants of the grid of a segment that begins `ticks` after the first row."""
        return (self.design.tick_clocks * ticks + counter.stamps(probe, channel)) // self.grid.clocks

    def write(self, name, raw):
        """Host write of a register."""
        self._sim.write(name, raw)

    def read(self, name):
        """Host read of a register of the map."""
        entry = registers.BY_NAME[name]
        return registers.from_bus(registers.read(self._sim.state.fpga, entry.address), entry.fmt)

    def set_control(self, bits):
        """CONTROL with these bits besides RUN."""
        self.write("control", sequencer.RUN | bits)

    def advance_phase_deg(self, name, degrees):
        """Add to a phase word; positive advances its output."""
        self.write(name, (self.read(name) + dds.offset_of_deg(degrees, self.design)) % self.grid.turn)

    def phases_deg(self):
        """The four phase words, degrees within -180 .. 180."""
        turn = self.grid.turn
        return {n: ((self.read(n) + turn // 2) % turn - turn // 2) * 360.0 / turn for n in PHASE_REGISTERS}

    def counter(self, channel):
        """(`counter.Reading`, `Rows`) of "drive" (Vx-) or "sense" (Vy-) against its reference pins, COUNTED_S long."""
        with self._rows() as sink:
            first_row, gates, stamps = self._first_row(), [], []
            for begun, probe in self._gates(COUNTED_S):
                gates.append(counter.gate(probe, channel))
                stamps.append(self._stamps(begun - first_row, probe, channel))
        return counter.read(gates), Rows(sink.pieces, np.concatenate(stamps))

    @property
    def grid(self):
        """`Grid` of the reference edges, as the firmware is built."""
        return Grid(self.design.tick_clocks if self._sim.config.firmware.reference_retimed else 1, self.design)


class Residuals(NamedTuple):
    """Truth: what is left of each loop phase (deg), and the drive frequency it holds at."""

    deg: dict
    frequency_hz: float


class Judge:
    """Truth of a board on a bench: what the words have left of each phase, by the budget.

    A budget's pins are where they are in the long run. At one frequency the grid holds them some millidegrees beside
    that.
    """

    def __init__(self, bench):
        self._bench, self._sim = bench, bench._sim

    @property
    def temp_degc(self):
        """Temperature of the parts: the oven's and what the board has warmed by."""
        return self._bench.temp_degc + self._sim.rise_k

    def residuals(self):
        """`Residuals` of the registers as they are."""
        config, bench = self._sim.config, self._bench
        words = bench.phases_deg()
        frequency_hz = bench.read("frequency") * build.lsb_hz(config)
        bare = config.model_copy(
            update={"firmware": config.firmware.model_copy(update={f"{n}_deg": 0.0 for n in PHASE_REGISTERS})}
        )
        phase_budget = budget.budget(bare, self.temp_degc, frequency_hz)
        node, loop = phase_budget.node_deg(), phase_budget.loop_deg()
        return Residuals(
            {
                "xe1": node["xe1"] - words["phase_drive_sine"],
                "xe2": loop["xe2"] + words["phase_drive_ref"],
                "ye1": node["ye1"] - words["phase_sense_sine"],
                "ye2": loop["ye2"] + words["phase_sense_ref"],
            },
            frequency_hz,
        )


def log_cosine_ratio(theta_deg, ratio_log):
    """Angle psi (deg) with ln[cos(psi + theta)/cos(psi - theta)] = ratio_log."""
    return math.degrees(math.atan(-math.tanh(ratio_log / 2) / math.tan(math.radians(theta_deg))))
