"""Port of the host: wiring of SPI slave and bus beside the whole firmware, whose registers it reads.

    CS_N, SCK, SDI --[slave]-- words --[bus]-- write, address, data --> register bank of `top`      SDO <--[slave]
                                 ^        '--> data ready
                                 '-- value of the register at the slave's address

A firmware without the port keeps the bank's write port for another master; nothing of `top` changes.

Cost      385 register bits
Source    docs/host_port.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

from fpga_model import host_bus, host_words, spi_slave
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import bits, formats
from fpga_model.jit import inlined


class Params(NamedTuple):
    """Parameters of the blocks."""

    bus: host_bus.Params


def design(d=DEFAULT):
    """`Params` of a design."""
    return Params(host_bus.design(d))


class State(NamedTuple):
    """Every register of the port."""

    slave: spi_slave.State = spi_slave.State()
    bus: host_bus.State = host_bus.State()


class Inputs(NamedTuple):
    """Pins of the host."""

    cs_n: bits(1)
    sck: bits(1)
    sdi: bits(1)


class Pins(NamedTuple):
    """Output pins."""

    sdo: bits(1)
    data_ready: bits(1)


INPUTS_FMT, PINS_FMT, STATE_FMT = formats(Inputs), formats(Pins), formats(State)
IDLE_INPUTS = Inputs(1, 0, 0)  # nobody talks


@inlined
def pins(s):
    """What the pins show."""
    return Pins(spi_slave.sdo(s.slave), host_bus.data_ready(s.bus))


@inlined
def step(p, s, f, i):
    """One clock edge of the port.

    f  registers of the firmware before the edge, `top.State`
    """
    slave, bus, seq = s.slave, s.bus, f.control.sequencer
    address, fetch = slave.address, spi_slave.fetch(slave)
    word = host_words.read(bus, slave.errors, f, address, fetch)
    status, rdata = host_bus.bus_status(bus, seq.faults.flags, seq.state), host_bus.rdata(bus, address, word)
    start, read_complete, write, data = spi_slave.start(slave), slave.done, slave.write, slave.data
    return State(
        spi_slave.step(slave, i.cs_n, i.sck, i.sdi, status, rdata, bus.clear),
        host_words.bus_step(p.bus, bus, f, address, fetch, start, read_complete, write, data, word),
    )
