"""Bus of the host: words of 32 bits to registers of up to 48 bits, and a sample of the rate that is read as a whole.

    read     the low word of a register latches its high word; the high word is the latch, or 0 behind another register
    write    a register of one word at once; of two, the low word is kept and the high word writes both in one clock
    sample   at `frame`, the end of the 8 kHz work, if the rate was new (`valid`): rate, temperature, status, number of
             the frame. A read of SAMPLE_RATE takes it: the others are held until the next such read
    unread   samples since the last one that was read (`done`), counted to 2: data ready at 1, overrun at 2

    address, data, write --(pair)--[bank_write, bank_address, bank_data] --> register bank      [low] waits for its high
    value of the register at address --+--> rdata
                                       '--[high] --> rdata                                      [..] register

Formats   address [0,11,0] bytes   data, rdata, low [0,32,0]   value, bank_data [0,48,0]   high [0,16,0]
          rate [1,11,20]   temperature [1,15,0]   frames, number [0,12,0]   status [0,19,0]   held_status [0,21,0]
          bank_address, high_of [0,8,0]   low_of [0,3,0]   unread, unread_after [0,2,0]   clear, k [0,3,0]
Latency   1 clock from write to bank_write and clear, from frame to a sample and data_ready; 0 to rdata, bus_status
Rounding  none
Overflow  frames wraps; unread and unread_after stop at 2
Cost      266 register bits
Source    docs/host_port.md
"""

from typing import NamedTuple

from fpga_model import dds, fault_monitor, rate_output, registers, sequencer, spi_slave
from fpga_model.block import BIT, Block
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import bits, formats
from fpga_model.jit import inlined

WORD = spi_slave.WORD
WORD_BITS, WORD_MASK = spi_slave.WORD_BITS, spi_slave.WORD_MASK
REGISTER_AT = 3  # a register has eight bytes
HIGH = bits(registers.DATA.width - WORD_BITS)
HIGH_MASK = HIGH.hi
STATE_BITS, LOCK_BITS, K_BITS = bits(4), bits(4), bits(3)
STATE_AT = fault_monitor.FLAGS.width
LOCK_AT = STATE_AT + STATE_BITS.width
K_AT = LOCK_AT + LOCK_BITS.width
STATUS = bits(K_AT + K_BITS.width)
NEW, OVERRUN = (1 << STATUS.width), (2 << STATUS.width)
SAMPLE_STATUS_FMT = bits(STATUS.width + 2)
STATUS_BITS = ("PENDING", "LOCKED", "FAULT", "OVERRUN", "DATA_READY")  # of bus_status, the lowest first
LOCKED = sequencer.LOCKED
MANY = 2
FIRST = 0x50  # register, the first of `MAP`
ERRORS_MASK = spi_slave.ERRORS.hi
NUMBER = bits(12)
NUMBER_MASK = NUMBER.hi
LATENCY = 1


def _rows():
    """The registers of the port itself; a path begins at the state of `host`."""
    status = f"0 .. {STATE_AT - 1} FLAGS, {STATE_AT} .. {LOCK_AT - 1} STATE, {LOCK_AT} .. {K_AT - 1} LOCK"
    status += f", {K_AT} .. {STATUS.width - 1} K, {STATUS.width} NEW, {STATUS.width + 1} OVERRUN"
    errors = ", ".join(f"{k} {name}" for k, name in enumerate(spi_slave.ERROR_BITS))
    rows = (
        (
            "sample_rate",
            rate_output.OUT,
            "ro",
            "deg/s",
            "bus.rate",
            "RATE of the newest sample; reading it takes the sample",
        ),
        (
            "sample_temperature",
            rate_output.T,
            "ro",
            "256 code LSB",
            "bus.held_temperature",
            "TEMPERATURE of the sample",
        ),
        ("sample_status", SAMPLE_STATUS_FMT, "ro", "bits", "bus.held_status", f"of the sample: {status}"),
        (
            "sample_number",
            NUMBER,
            "ro",
            "",
            "bus.held_number",
            "number of the sample's 8 kHz frame since reset, modulo 4096",
        ),
        ("spi_errors", spi_slave.ERRORS, "w1c", "bits", "slave.errors", f"wrong frames of the SPI port: {errors}"),
    )
    for address, (name, fmt, access, unit, path, doc) in enumerate(rows, FIRST):
        yield registers.Register(address, name, fmt, 0, access, unit, path, doc)


MAP = tuple(_rows())


def sample_status_fields():
    """{field: (lowest bit, bits)} of SAMPLE_STATUS."""
    names = ("FLAGS", "STATE", "LOCK", "K", "NEW", "OVERRUN")
    bit_offsets = (0, STATE_AT, LOCK_AT, K_AT, STATUS.width, STATUS.width + 1, SAMPLE_STATUS_FMT.width)
    return {name: (at, end - at) for name, at, end in zip(names, bit_offsets[:-1], bit_offsets[1:], strict=True)}


SAMPLE_RATE = MAP[0].address << REGISTER_AT
ERRORS_REGISTER = MAP[-1].address
PAIR = bits(3)  # number of a register of two words
PAIR_TOP = PAIR.hi
PAIRS = bits(PAIR_TOP + 1)

assert all(PAIR.holds(r.address) for r in registers.WRITABLE if r.fmt.width > WORD_BITS)
assert not {r.address for r in MAP} & set(registers.BY_ADDRESS)


class Params(NamedTuple):
    """Registers that a host writes in two words, a bit each; build with `design`."""

    pairs: PAIRS


def design(d=DEFAULT):
    """`Params` of a design: those of phases, if a phase has more bits than a word."""
    widths = {r.address: d.dds_bits if r.fmt == dds.PHASE else r.fmt.width for r in registers.WRITABLE}
    return Params(sum(1 << address for address, width in widths.items() if width > WORD_BITS))


class State(NamedTuple):
    """The registers."""

    high: HIGH = 0
    high_of: registers.ADDRESS = 0
    low: WORD = 0
    low_of: PAIR = 0
    pending: BIT = 0
    bank_write: BIT = 0
    bank_address: registers.ADDRESS = 0
    bank_data: registers.DATA = 0
    clear: spi_slave.ERRORS = 0
    frames: NUMBER = 0
    fresh: BIT = 0
    rate: rate_output.OUT = 0
    temperature: rate_output.T = 0
    status: STATUS = 0
    number: NUMBER = 0
    held_temperature: rate_output.T = 0
    held_status: SAMPLE_STATUS_FMT = 0
    held_number: NUMBER = 0
    unread: bits(2) = 0
    unread_after: bits(2) = 0
    reading: BIT = 0


PARAMS_FMT = formats(Params)
STATE_FMT = formats(State)


@inlined
def rdata(s, address, value):
    """Pin: the word at `address`; `value` is that of its register."""
    if (address >> 2) & 1 == 0:
        return value & WORD_MASK
    return s.high if s.high_of == address >> REGISTER_AT else 0


@inlined
def bus_status(s, flags, state):
    """Pin: what every frame tells of the bus."""
    ready = 1 if s.unread != 0 else 0
    overrun = 1 if s.unread == MANY else 0
    fault = 1 if flags != 0 else 0
    locked = 1 if state == LOCKED else 0
    return s.pending | (locked << 1) | (fault << 2) | (overrun << 3) | (ready << 4)


@inlined
def data_ready(s):
    """Pin: there is a sample that has not been read."""
    return 1 if s.unread != 0 else 0


@inlined
def step(p, s, address, fetch, start, done, write, data, value, frame, valid, rate, temperature, k, flags, state, lock):
    """One clock edge."""
    register = address >> REGISTER_AT
    second = (address >> 2) & 1
    high, high_of = s.high, s.high_of
    if fetch == 1 and second == 0:
        high, high_of = value >> WORD_BITS, register

    low, low_of, pending, bank_write, clear = s.low, s.low_of, s.pending, 0, 0
    bank_address, bank_data = s.bank_address, s.bank_data
    if write == 1:
        pending = 0
        if second == 1:
            if s.pending == 1 and s.low_of == register:
                bank_write, bank_address, bank_data = 1, register, ((data & HIGH_MASK) << WORD_BITS) | s.low
        elif register <= PAIR_TOP and (p.pairs >> register) & 1 == 1:
            low, low_of, pending = data, register, 1
        else:
            bank_write, bank_address, bank_data = 1, register, data
            if register == ERRORS_REGISTER:
                clear = data & ERRORS_MASK

    sample = 1 if frame == 1 and (s.fresh == 1 or valid == 1) else 0
    take = 1 if fetch == 1 and address == SAMPLE_RATE else 0
    after = 0 if take == 1 else s.unread_after
    unread = s.unread_after if done == 1 and s.reading == 1 else s.unread
    sample_status = s.status
    if s.unread != 0:
        sample_status = sample_status | NEW
    if s.unread == MANY:
        sample_status = sample_status | OVERRUN
    return State(
        high,
        high_of,
        low,
        low_of,
        pending,
        bank_write,
        bank_address,
        bank_data,
        clear,
        (s.frames + 1) & NUMBER_MASK if frame == 1 else s.frames,
        1 if frame == 0 and (s.fresh == 1 or valid == 1) else 0,
        rate if sample == 1 else s.rate,
        temperature if sample == 1 else s.temperature,
        flags | (state << STATE_AT) | (lock << LOCK_AT) | (k << K_AT) if sample == 1 else s.status,
        s.frames if sample == 1 else s.number,
        s.temperature if take == 1 else s.held_temperature,
        sample_status if take == 1 else s.held_status,
        s.number if take == 1 else s.held_number,
        unread + sample if unread + sample < MANY else MANY,
        after + sample if after + sample < MANY else MANY,
        1 if take == 1 else (0 if start == 1 or done == 1 else s.reading),
    )


BLOCK = Block(
    place=202,
    inputs={
        "address": spi_slave.ADDRESS,
        "fetch": BIT,
        "start": BIT,
        "done": BIT,
        "write": BIT,
        "data": WORD,
        "value": registers.DATA,
        "frame": BIT,
        "valid": BIT,
        "rate": rate_output.OUT,
        "temperature": rate_output.T,
        "k": K_BITS,
        "flags": fault_monitor.FLAGS,
        "state": STATE_BITS,
        "lock": LOCK_BITS,
    },
    outputs={"rdata": WORD, "bus_status": spi_slave.STATUS, "data_ready": BIT},
    cases={"default": design(), "narrow": design(DEFAULT._replace(dds_bits=32))},
    latency={
        "bank_write": LATENCY,
        "clear": LATENCY,
        "number": LATENCY,
        "data_ready": LATENCY,
        "rdata": 0,
        "bus_status": 0,
    },
    rules={"frames": (None, "wrap")},
    strobes=("fetch", "write", "frame"),
    split=("unread", "unread_after"),
)
