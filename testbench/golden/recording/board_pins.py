"""Pins of the whole design as a board reads them: rows and signatures of the levels `pins` and `outputs`.

    SDIN       0 but in the clocks in which its chip reads it: SYNC_N low, and SCLK running
    k clocks   of a pin that comes k clocks later: row n holds the model's row n - k, and 0 where one of the edges
               n - k .. n - 1 resets, or lies before row 0: the registers more of the design may be reset or not

Source  docs/golden.md (pins alone), analog_frontend/parts/dac_serial.py
"""

import numpy as np

from fpga_model import top
from testbench.golden.recording import signature

# data pin: what selects its chip (active low), and what says that SCLK runs
READ = {f"{role}_sdin": (f"{role}_sync_n", f"{role}_sclk_en") for role in ("drive", "sense", "quadrature")}
pin_column = top.Pins._fields.index
WIDTHS = tuple(fmt.width for fmt in top.PINS_FMT)


def read(pins):
    """Rows of pins, with 0 where no chip reads a data pin."""
    board_pin_rows = pins.copy()
    for data, (select_n, running) in READ.items():
        board_pin_rows[:, pin_column(data)] &= ~pins[:, pin_column(select_n)] & pins[:, pin_column(running)]
    return board_pin_rows


class Board:
    """Reads pins of successive clocks.

    clocks  {pin: clocks that it comes later}
    """

    def __init__(self, clocks=None):
        self.clocks = {name: k for name, k in (clocks or {}).items() if k}
        self._before = np.zeros((max(self.clocks.values(), default=0), len(WIDTHS)), np.int64)

    def read(self, pins, first, host):
        """The rows from clock `first` on; `host` are the events of a `replay.Stimulus`."""
        rows, most = np.concatenate([self._before, read(pins)]), len(self._before)
        board_pin_rows, self._before = rows[most:].copy(), rows[len(rows) - most :].copy()
        resets = np.r_[-1, host[host[:, 1] == 1, 0]]
        at = first + np.arange(len(pins))
        age = at - 1 - resets[np.searchsorted(resets, at) - 1]
        for name, k in self.clocks.items():
            board_pin_rows[:, pin_column(name)] = np.where(age < k, 0, rows[most - k : len(rows) - k, pin_column(name)])
        return board_pin_rows

    @staticmethod
    def signatures(rows, clocks):
        """Signature of every `clocks` rows, uint64."""
        words = np.zeros(len(rows), np.int64)
        for k, width in enumerate(WIDTHS):
            words = words << width | rows[:, k]
        return signature.frame_signatures(words, clocks)


assert sum(WIDTHS) <= signature.CHUNK, "a row of pins is one word"
