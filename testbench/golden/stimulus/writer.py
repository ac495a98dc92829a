"""Rows of stimulus in the making: our own random numbers, corners of a format, families of rows.

The generator is splitmix64 on Python integers, so that no library can change a vector.
Source  docs/golden.md; Steele, Lea, Flood, OOPSLA 2014 (splitmix64)
"""

from fpga_model import fault_monitor, spi_adc
from testbench.golden.stimulus import blocks

MASK64 = (1 << 64) - 1
ALTERNATE = int("01" * 32, 2)
SEED = 20260131
LONG_ROWS = fault_monitor.QUICK_TOP + 7  # frames that are all good, then all bad: to a count of ten ones, and beyond


class Random:
    """splitmix64: 64 bits per call, the same for ever."""

    def __init__(self, seed):
        self.state = seed & MASK64

    def next(self):
        self.state = (self.state + 0x9E3779B97F4A7C15) & MASK64
        z = self.state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK64
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK64
        return z ^ (z >> 31)

    def draw_integer(self, n):
        """0 .. n - 1; the bias of the product is below n / 2**64."""
        return self.next() * n >> 64

    def raw(self, fmt):
        return fmt.lo + self.draw_integer(fmt.hi - fmt.lo + 1)

    def pick(self, items):
        return items[self.draw_integer(len(items))]


def corners(fmt):
    """Raw values at the ends of a format, around zero and around its middle bits; ascending, without repetition."""
    half = 1 << max(fmt.width - 1 - fmt.s, 0)
    corner_candidates = {fmt.lo, fmt.lo + 1, -1, 0, 1, fmt.hi - 1, fmt.hi, half - 1, half, half + 1, -half, half >> 1}
    corner_candidates |= {ALTERNATE & fmt.hi, (ALTERNATE << 1) & fmt.hi}
    return sorted(v for v in corner_candidates if fmt.holds(v))


def around(limit, fmt):
    """Values whose highest bit that differs from a limit is k, for every k: what each bit of a comparator decides.

    Below it the bits of the limit, +-1; then all zeros, all ones and both alternations, for faults of two bits.
    """
    values = set()
    for k in range(fmt.width):
        flipped = limit ^ (1 << k)
        values |= {flipped - 1, flipped, flipped + 1}
        values |= {(flipped >> k << k) | (pattern & ((1 << k) - 1)) for pattern in (0, -1, ALTERNATE, ALTERNATE << 1)}
    return sorted(v for v in values if fmt.holds(v))


def wrap_to_format(value, fmt):
    """The value that is `value` modulo the width of a format."""
    return (value - fmt.lo) % (1 << fmt.width) + fmt.lo


class Writer:
    """Rows in the making, and the families they belong to."""

    def __init__(self, block, case, seed=SEED):
        self.block, self.case = block, case
        self.random = Random(seed ^ int.from_bytes(f"{block.stem}/{case}".encode()[-8:], "big"))
        self.names = [port.name for port in block.columns]
        self.wide = [port for port in block.inputs if port.width > 1]
        self.flags = [port for port in block.inputs if port.width == 1]
        self.rows, self.families = [], []

    def family(self, name):
        self.families.append([name, len(self.rows), 0])

    def append_row(self, values=None, rst=0, times=1):
        """`times` rows: idle values but for those given."""
        full = {**dict.fromkeys(self.names, 0), **self.block.idle, **(values or {}), blocks.RESET_INPUT: rst}
        if len(full) != len(self.names):
            raise ValueError(f"{self.block.stem}: no input {sorted(set(full) - set(self.names))}")
        self.rows += [[full[name] for name in self.names]] * times
        self.families[-1][2] = len(self.rows) - self.families[-1][1]

    def operation(self, values, strobes=1):
        """One operation: the strobes high in one row with the values, then as many quiet rows as it takes."""
        if self.block.stem == "spi_adc":
            frame(self, self.random)
            return
        self.append_row({**dict.fromkeys(self.block.strobes, strobes), **values})
        if self.block.wait:
            self.append_row({**values, **dict.fromkeys(self.block.strobes, 0)}, times=self.block.wait)

    def some(self):
        """Random values for every input wider than one bit."""
        return {port.name: self.random.raw(port.fmt) for port in self.wide}

    def flips(self, low=1, of=2):
        """Random values for every 1-bit input, 1 in `low` of `of`."""
        return {port.name: int(self.random.draw_integer(of) < low) for port in self.flags}


def frame(w, random, status=None, cut=None, rows=None):
    """A conversion for `spi_adc`: DRDY_N falls, bits follow the serial clock; all or `cut` bits, then DOUT rests."""
    d = w.block.record
    head = (spi_adc.HEAD << 20) | random.draw_integer(1 << 20) if status is None else status
    words = [head] + [random.next() & 0xFFFFFF for _ in range(d.adc_channels)]
    if rows is not None:
        words[1:] = rows
    line = [(word >> (23 - k)) & 1 for word in words for k in range(d.adc_word_bits)][:cut]
    w.append_row({"drdy_n": 0, "dout": line[0]}, times=4)
    for bit in line:
        w.append_row({"drdy_n": 1, "dout": bit}, times=d.adc_divider)
    w.append_row({"drdy_n": 1}, times=d.adc_tail_clocks + 4)
