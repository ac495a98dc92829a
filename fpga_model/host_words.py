"""Port and firmware: the word of each register that a host reads, and what the bus takes of a firmware. Selection only.

Source    docs/host_port.md
"""

from fpga_model import host_bus, rates, registers
from fpga_model.jit import inlined

IDENTITY = registers.IDENTITY
LOW_16, LOW_24, LOW_30 = (1 << 16) - 1, (1 << 24) - 1, (1 << 30) - 1


def paths():
    """{register: dotted path of what it reads}, of the firmware's state, or of the port's for its own."""
    return {r.name: r.path for r in (*registers.MAP, *host_bus.MAP)}


@inlined
def _bank_word(b, latch, register):
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
def _firmware_word(f, register):
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
    word_index = register - registers.FIRST_READ_ONLY
    return words[word_index] if word_index < len(words) else 0


@inlined
def _port_word(b, errors, register):
    """Word of a register of the port itself."""
    words = (
        b.rate & host_bus.WORD_MASK,
        b.held_temperature & LOW_16,
        b.held_status,
        b.held_number,
        errors,
    )
    word_index = register - host_bus.FIRST
    return words[word_index] if word_index < len(words) else 0


@inlined
def value(bus, errors, f, register):
    """Word of a register: of `bus` and `errors` of a port, or of the firmware `f` before the edge; 0 where none is."""
    if register < registers.FIRST_READ_ONLY:
        return _bank_word(f.registers, f.control.sequencer.faults.latch, register)
    if register < host_bus.FIRST:
        return _firmware_word(f, register)
    return _port_word(bus, errors, register)


@inlined
def read(bus, errors, f, address, fetch):
    """Word at a byte address: 0 without `fetch`, when nobody takes it."""
    return value(bus, errors, f, address >> host_bus.REGISTER_AT) if fetch == 1 else 0


@inlined
def bus_step(p, bus, f, address, fetch, start, read_complete, write, data, word):
    """One clock edge of the bus beside the firmware `f` before the edge; the other inputs are those of the slave."""
    seq, rate = f.control.sequencer, f.control.rate_output
    frame = 1 if f.rates.slot == rates.SLOTS else 0
    sample = rate.valid, rate.y, rate.t, rate.k, seq.faults.flags, seq.state, seq.lock.locked
    return host_bus.step(p, bus, address, fetch, start, read_complete, write, data, word, frame, *sample)
