"""What a run remembers of its rows once they are gone: means of the scenario, and the rows of the start-up.

Both are sinks of `simulation.Simulation`; their size does not grow with the run, but for the start-up that they keep.
Integers are summed exactly.
Source  docs/record.md
"""

import numpy as np

from analog_frontend.parts import resonator
from fpga_model import sequencer
from fpga_model.design_record import DEFAULT
from testbench.run.simulation import FRAME, TRUTH

SUMMED = ("frequency_word", "rate_word", "quadrature_code")
START_LIMIT_S = 10.0  # of rows kept from the first one on, where lock does not come
AFTER_LOCK_S = 0.5


def amplitude_m(x, vx, frequency_word, lsb_hz):
    """Amplitude of the drive mode (m) from its state at one instant and the DDS word; vx is x' / W of the resonator.

    lsb_hz  frequency of one LSB of the word (Hz)
    """
    return np.sqrt(x**2 + (vx * resonator.SCALE_HZ / (frequency_word * lsb_hz)) ** 2)


class RunStatistics:
    """Sums over the rows while `active`."""

    def __init__(self, lsb_hz):
        self.lsb_hz = lsb_hz  # of the frequency word
        self.active = False
        self.rows = 0
        self.sums = np.zeros(len(SUMMED), np.int64)
        self.amplitude_sum_m = 0.0
        self.flags = 0
        self.temp_degc = 0.0

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        if not self.active:
            return
        self.rows += len(frames)
        self.sums += frames[:, [FRAME[name] for name in SUMMED]].sum(axis=0)
        x, vx = truth[:, TRUTH["x"]], truth[:, TRUTH["vx"]]
        self.amplitude_sum_m += float(amplitude_m(x, vx, frames[:, FRAME["frequency_word"]], self.lsb_hz).sum())
        self.flags |= int(np.bitwise_or.reduce(frames[:, FRAME["flags"]]))
        self.temp_degc = float(truth[-1, TRUTH["temperature"]])

    def mean(self, name):
        """Mean of a summed column, in its LSB."""
        return int(self.sums[SUMMED.index(name)]) / self.rows

    @property
    def amplitude_m(self):
        """Mean amplitude of the drive mode."""
        return self.amplitude_sum_m / self.rows

    def dump(self):
        """What a checkpoint keeps."""
        return {name: value for name, value in vars(self).items() if name not in ("active", "lsb_hz")}

    def restore(self, values):
        """Continue where `dump` was."""
        vars(self).update(values)


class StartUp:
    """The rows up to half a second after lock, and the frame of the first lock (-1: none yet)."""

    COLUMNS = ("frequency_word", "phase", "state", "x", "vx")  # each exact as a double

    def __init__(self, frame_hz=DEFAULT.frame_hz):
        self.frame_hz = frame_hz
        self.first_frame = -1
        self.lock_frame = -1
        self._pieces = []
        self._count = 0

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        if self.first_frame < 0:
            self.first_frame = first_frame
        if self.lock_frame < 0:
            locked = frames[:, FRAME["state"]] == sequencer.LOCKED
            if locked.any():
                self.lock_frame = first_frame + int(np.argmax(locked))
        if self._count < self._row_limit():
            columns = [frames[:, FRAME[name]] if name in FRAME else truth[:, TRUTH[name]] for name in self.COLUMNS]
            self._pieces.append(np.stack(columns, axis=1, dtype=float, casting="unsafe"))
            self._count += len(frames)

    def _row_limit(self):
        rows = START_LIMIT_S * self.frame_hz
        if self.lock_frame >= 0:
            rows = min(rows, self.lock_frame - self.first_frame + AFTER_LOCK_S * self.frame_hz)
        return int(rows)

    @property
    def lock_s(self):
        """Time from power-on to the first lock, or None."""
        return None if self.lock_frame < 0 else self.lock_frame / self.frame_hz

    def columns(self):
        """The rows that were kept as {name: array of doubles}, and their time from power-on (s)."""
        rows = np.concatenate(self._pieces)[: self._row_limit()] if self._pieces else np.zeros((0, len(self.COLUMNS)))
        time_s = (max(self.first_frame, 0) + np.arange(len(rows))) / self.frame_hz
        return {"time_s": time_s} | {name: rows[:, k] for k, name in enumerate(self.COLUMNS)}

    def dump(self):
        """What a checkpoint keeps."""
        rows = np.concatenate(self._pieces) if self._pieces else np.zeros((0, len(self.COLUMNS)))
        return {"first_frame": self.first_frame, "lock_frame": self.lock_frame, "rows": rows}

    def restore(self, values):
        """Continue where `dump` was."""
        self.first_frame, self.lock_frame = values["first_frame"], values["lock_frame"]
        self._pieces, self._count = [values["rows"]], len(values["rows"])
