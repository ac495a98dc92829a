"""Port of a host in the same chip: wiring of AXI4-Lite slave and bus beside the whole firmware, as `host` with SPI.

    AW, W, B, AR, R --[slave]-- words --[bus]-- write, address, data --> register bank of `top`
                          ^           '--> data ready
                          '-- value of the register at the slave's address

Cost      365 register bits
Source    docs/host_port.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

from fpga_model import axi_slave, host, host_bus, host_words
from fpga_model.fixed import bits, formats
from fpga_model.jit import inlined

NO_ERRORS = 0  # of frames: this port has none
NO_START = 0  # a transfer cannot be aborted
Params, design = host.Params, host.design  # of the bus


class State(NamedTuple):
    """Every register of the port."""

    slave: axi_slave.State = axi_slave.State()
    bus: host_bus.State = host_bus.State()


class Inputs(NamedTuple):
    """What the host drives."""

    awvalid: bits(1)
    awaddr: axi_slave.ADDRESS
    wvalid: bits(1)
    wdata: axi_slave.WORD
    wstrb: axi_slave.STROBES
    bready: bits(1)
    arvalid: bits(1)
    araddr: axi_slave.ADDRESS
    rready: bits(1)


class Pins(NamedTuple):
    """What the host sees."""

    awready: bits(1)
    wready: bits(1)
    bvalid: bits(1)
    bresp: axi_slave.RESPONSE
    arready: bits(1)
    rvalid: bits(1)
    rdata: axi_slave.WORD
    rresp: axi_slave.RESPONSE
    data_ready: bits(1)


INPUTS_FMT, PINS_FMT, STATE_FMT = formats(Inputs), formats(Pins), formats(State)


@inlined
def pins(s):
    """What the pins show."""
    a = s.slave
    ready = host_bus.data_ready(s.bus)
    return Pins(a.awready, a.wready, a.bvalid, a.bresp, a.arready, a.rvalid, a.rdata, a.rresp, ready)


@inlined
def step(p, s, f, i):
    """One clock edge of the port.

    f  registers of the firmware before the edge, `top.State`
    """
    slave, bus = s.slave, s.bus
    address, fetch = axi_slave.address(slave), axi_slave.fetch(slave)
    word = host_words.read(bus, NO_ERRORS, f, address, fetch)
    channels = i.awvalid, i.awaddr, i.wvalid, i.wdata, i.wstrb, i.bready, i.arvalid, i.araddr, i.rready
    read_complete, write, data = axi_slave.done(slave, i.rready), axi_slave.write(slave), slave.wdata
    return State(
        axi_slave.step(slave, *channels, host_bus.rdata(bus, address, word)),
        host_words.bus_step(p.bus, bus, f, address, fetch, NO_START, read_complete, write, data, word),
    )
