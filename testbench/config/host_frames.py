"""A register write of a scenario as a frame at the SPI pins: what the port makes of it, and when.

    CS_N falls    at the clock of a tick from which on the write comes to the register bank at the first clock of a tick
    SCK           5.2 MHz, the limit: 5 clocks, 3 of them low
    port          `fpga_model.host`, slave and bus, clocked over the frame

So a write takes the ticks of its frame, and then acts as one without the port does. All engines know such a write.
Source    docs/host_port.md
"""

from typing import NamedTuple

import numpy as np

from fpga_model import host_bus, registers, spi_slave
from fpga_model.jit import kernel

LEAD_CLOCKS, LOW_CLOCKS, HIGH_CLOCKS, IDLE_CLOCKS = 5, 3, 2, 8
assert LOW_CLOCKS + HIGH_CLOCKS == spi_slave.LEAST_PERIOD_CLOCKS


class Frame(NamedTuple):
    """Pins (cs_n, sck, sdi) at each clock from the first of a tick on, and the write that comes of them.

    ticks  whole ticks from there to the tick at whose first clock the bank takes `data` at `address`
    """

    pins: np.ndarray
    ticks: int
    address: int
    data: int


@kernel
def _crc(word, bits, crc):
    for k in range(bits):
        crc = spi_slave.divided(crc, (word >> (bits - 1 - k)) & 1)
    return crc


@kernel
def _simulate_port_write(p, s, b, pins):
    """(clock, address, data) of the write that a port makes of its pins; clock -1: of none."""
    for n in range(len(pins)):
        if b.bank_write == 1:
            return n, b.bank_address, b.bank_data
        after = spi_slave.step(s, pins[n, 0], pins[n, 1], pins[n, 2], 0, 0, 0)
        b = host_bus.step(p, b, s.address, 0, 0, 0, s.write, s.data, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        s = after
    return -1, 0, 0


def sdi_bits(register, raw):
    """Bits of SDI of the frame that writes a value: command, words with the low one first, CRC."""
    word = registers.to_bus(int(raw), register.fmt)
    count = 2 if register.fmt.width > host_bus.WORD_BITS else 1
    words = [word & host_bus.WORD_MASK, word >> host_bus.WORD_BITS][:count]
    command = count << spi_slave.WORDS_AT | register.address << host_bus.REGISTER_AT
    parts, crc = [(command, spi_slave.COMMAND_BITS), *((w, host_bus.WORD_BITS) for w in words)], spi_slave.CRC_MASK
    for part in parts:
        crc = _crc(*part, crc)
    parts.append((int(crc) ^ spi_slave.CRC_MASK, spi_slave.CRC_BITS))
    return [part >> (size - 1 - k) & 1 for part, size in parts for k in range(size)]


def _frame_pins(bits, begin):
    """Pins of a frame whose CS_N falls at clock `begin`."""
    rows = [(1, 0, 0)] * begin + [(0, 0, bits[0])] * LEAD_CLOCKS
    for bit in bits:
        rows += [(0, 0, bit)] * LOW_CLOCKS + [(0, 1, bit)] * HIGH_CLOCKS
    return np.array(rows + [(1, 0, 0)] * IDLE_CLOCKS, np.int64)


def encode_write(design, register, raw):
    """`Frame` of the write of a value to a register of the map."""
    bits, clocks = sdi_bits(register, raw), design.tick_clocks
    port = host_bus.design(design), spi_slave.State(), host_bus.State()
    latency_clocks, _, _ = _simulate_port_write(*port, _frame_pins(bits, 0))
    pins = _frame_pins(bits, -latency_clocks % clocks)
    clock, address, data = _simulate_port_write(*port, pins)
    if clock < 0 or clock % clocks:
        raise RuntimeError(f"host port: the write of {register.name} comes at clock {clock} of its frame")
    return Frame(pins, clock // clocks, int(address), int(data))
