"""Port of a host in the same chip: wiring of AXI4-Lite slave and bus beside the whole firmware, as `host` with SPI.

    AW, W, B, AR, R --[slave]-- words --[bus]-- write, address, data --> register bank of `top`
                          ^           '--> data ready
                          '-- value of the register at the slave's address

Source    docs/blocks/host.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

from fpga_model import axi_slave, host_bus, host_words, rates
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import bits, formats
from fpga_model.jit import inlined

NO_ERRORS = 0  # of frames: this port has none
NO_START = 0  # a transfer cannot be aborted


class Params(NamedTuple):
    """Parameters of the blocks."""

    bus: host_bus.Params


def design(d=DEFAULT):
    """`Params` of a design."""
    return Params(host_bus.design(d))


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
    """One clock edge of the port: every right-hand side reads the old registers.

    f  registers of the firmware before the edge, `top.State`
    """
    c, slave, bus = f.control, s.slave, s.bus
    seq = c.sequencer
    address = axi_slave.address(slave)
    fetch = axi_slave.fetch(slave)
    word = 0
    if fetch == 1:
        word = host_words.value(bus, NO_ERRORS, f, address >> host_bus.REGISTER_AT)
    return State(
        axi_slave.step(
            slave,
            i.awvalid,
            i.awaddr,
            i.wvalid,
            i.wdata,
            i.wstrb,
            i.bready,
            i.arvalid,
            i.araddr,
            i.rready,
            host_bus.rdata(bus, address, word),
        ),
        host_bus.step(
            p.bus,
            bus,
            address,
            fetch,
            NO_START,
            axi_slave.done(slave, i.rready),
            axi_slave.write(slave),
            slave.wdata,
            word,
            1 if f.rates.slot == rates.SLOTS else 0,
            c.rate_output.valid,
            c.rate_output.y,
            c.rate_output.t,
            c.rate_output.k,
            seq.faults.flags,
            seq.state,
            seq.lock.locked,
        ),
    )
