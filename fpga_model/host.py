"""Port of the host: wiring of SPI slave and bus beside the whole firmware, whose registers it reads.

    CS_N, SCK, SDI --[slave]-- words --[bus]-- write, address, data --> register bank of `top`      SDO <--[slave]
                                 ^        '--> data ready
                                 '-- value of the register at the slave's address

A firmware without the port keeps the bank's write port for another master; nothing of `top` changes.
Source    docs/blocks/host.md
"""

from __future__ import annotations  # a field may bear the name of its module

from typing import NamedTuple

from fpga_model import host_bus, rates, registers, spi_slave
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import bits, formats
from fpga_model.jit import inlined

IDENTITY = registers.IDENTITY


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
REST = Inputs(1, 0, 0)  # nobody talks
LOW_16, LOW_24, LOW_30 = (1 << 16) - 1, (1 << 24) - 1, (1 << 30) - 1


def paths():
    """{register: dotted path of what it reads}, of the firmware's state, or of `State` for those of the port."""
    return {r.name: r.path for r in (*registers.MAP, *host_bus.MAP)}


@inlined
def pins(s):
    """What the pins show."""
    return Pins(spi_slave.sdo(s.slave), host_bus.data_ready(s.bus))


@inlined
def _of_bank(b, latch, register):
    """Word of a register of the bank."""
    words = (
        b.control,
        latch,
        b.phase_drive_sine,
        b.phase_sense_sine,
        b.phase_drive_ref,
        b.phase_sense_ref,
        b.amplitude_setpoint,
        b.frequency_fixed,
        b.amplitude_fixed & LOW_24,
        b.rate_fixed & LOW_24,
        b.quadrature_fixed,
        b.rate_bias & host_bus.WORD_MASK,
        b.rate_bias_t1 & host_bus.WORD_MASK,
        b.rate_bias_t2 & host_bus.WORD_MASK,
        b.rate_scale & LOW_30,
        b.rate_scale_t1 & LOW_24,
        b.rate_scale_t2 & LOW_24,
        b.decimation,
    )
    return words[register] if register < len(words) else 0


@inlined
def _of_firmware(f, register):
    """Word of a register that can be read only."""
    c = f.control
    words = (
        IDENTITY,
        c.sequencer.state,
        c.sequencer.lock.locked,
        c.sequencer.faults.flags,
        c.sequencer.attempts,
        c.frequency_tracker.word,
        c.agc.loop.y & LOW_24,
        c.cordic.magnitude,
        c.cordic.phase & LOW_24,
        c.rate_loop.loop.y & LOW_24,
        c.quadrature_loop.root.y,
        c.rate_output.y & host_bus.WORD_MASK,
        c.rate_output.t & LOW_16,
    )
    at = register - registers.FIRST_READ_ONLY
    return words[at] if at < len(words) else 0


@inlined
def _of_port(s, register):
    """Word of a register of the port itself."""
    b = s.bus
    words = (
        b.rate & host_bus.WORD_MASK,
        b.held_temperature & LOW_16,
        b.held_status,
        b.held_number,
        s.slave.errors,
    )
    at = register - host_bus.FIRST
    return words[at] if at < len(words) else 0


@inlined
def value(s, f, register):
    """Word of a register: of the port `s`, or of the firmware `f` before the edge; 0 where there is none."""
    if register < registers.FIRST_READ_ONLY:
        return _of_bank(f.registers, f.control.sequencer.faults.latch, register)
    if register < host_bus.FIRST:
        return _of_firmware(f, register)
    return _of_port(s, register)


@inlined
def step(p, s, f, i):
    """One clock edge of the port: every right-hand side reads the old registers.

    f  registers of the firmware before the edge, `top.State`
    """
    c, slave, bus = f.control, s.slave, s.bus
    seq = c.sequencer
    fetch = spi_slave.fetch(slave)
    word = 0
    if fetch == 1:
        word = value(s, f, slave.address >> host_bus.REGISTER_AT)
    return State(
        spi_slave.step(
            slave,
            i.cs_n,
            i.sck,
            i.sdi,
            host_bus.bus_status(bus, seq.faults.flags, seq.state),
            host_bus.rdata(bus, slave.address, word),
            bus.clear,
        ),
        host_bus.step(
            p.bus,
            bus,
            slave.address,
            fetch,
            spi_slave.start(slave),
            slave.done,
            slave.write,
            slave.data,
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
