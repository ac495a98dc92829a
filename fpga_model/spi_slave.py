"""SPI slave of the host, mode 0, SCK sampled by the master clock: frames of one command, up to 7 words and a CRC.

    rise = SCK went from 0 to 1 behind two synchronising registers, CS_N low
    SDI, MSB first     read: command (16), CRC (8)            write: command (16), 1 or 2 words (32 each), CRC (8)
    SDO, MSB first     read: status, its complement, 0, words (32 each), CRC (8)
    command            15 read   14..12 words   11 zero   10..0 byte address
    CRC                over command and words: x^8 + x^4 + x^3 + x^2 + 1, begins with FFh, sent inverted

    CS_N --[cs_meta]--[cs_n]--[active]     rdata --+--[shift]-- SDO     [..] register
    SCK ---[sck_meta]-[sck]---[sck_seen]           |      '--[data]-- to the bus, with [address] and [write]
    SDI ---[sdi_meta]-[sdi]------------------------'--[crc]

A frame counts when CS_N rises. Its length, its CRC and its command must be right; else it is dropped and one flag of
`errors` is set. `write`: `data` belongs at `address`, for one clock per word. `done`: a read was complete.
`fetch`: `rdata` must be the word at `address`, which has stood for 8 bits of SCK or more.

Formats   shift [0,40,0]   data, rdata [0,32,0]   address [0,11,0]   crc [0,8,0]   bit, status [0,5,0]
          phase, words, errors, clear [0,3,0]   all others [0,1,0]
Latency   3 clocks from the edge that sees SCK high to the next bit on SDO; 3 from CS_N high to write and done
Rounding  none
Overflow  shift drops its highest bits; bit and address wrap
Cost      119 register bits
Source    docs/host_port.md; SAE J1850 (CRC)
"""

from typing import NamedTuple

from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, formats
from fpga_model.jit import inlined

WORD_BITS = 32
WORD = bits(WORD_BITS)
WORD_MASK = WORD.hi
CRC = bits(8)
CRC_BITS = CRC.width
CRC_MASK = CRC.hi
CRC_POLYNOMIAL = 0x1D
SHIFT = bits(WORD_BITS + CRC_BITS)
SHIFT_MASK = SHIFT.hi
SHIFT_TOP = SHIFT.width - 1
COMMAND_BITS = 16
ADDRESS = bits(11)
ADDRESS_MASK = ADDRESS.hi
WORD_BYTES = 4
MOST_WRITTEN = 2  # words: one register
WORDS_AT, READ_AT = 12, 15  # bits of the command
ZERO_BITS = (1 << ADDRESS.width) | (WORD_BYTES - 1)  # of the command: the reserved one, and those within a word
COUNT = bits(3)
COUNT_MASK = COUNT.hi
BITS = bits(5)
BITS_MASK = BITS.hi
STATUS = bits(5)
STATUS_AT, COMPLEMENT_AT = SHIFT.width - 8, SHIFT.width - 16
COMMAND, CHECK, DATA, TAIL, COMPLETE, TOO_LONG = range(6)
PHASES = ("COMMAND", "CHECK", "DATA", "TAIL", "COMPLETE", "TOO_LONG")
ERRORS = bits(3)
ERRORS_WIDTH = ERRORS.width
ERROR_BITS = ("CRC", "LENGTH", "COMMAND")
WRONG_CRC, WRONG_LENGTH, WRONG_COMMAND = (1 << k for k in range(len(ERROR_BITS)))
LATENCY = 3
LEAST_PERIOD_CLOCKS = 5  # of SCK
LEAST_LEVEL_CLOCKS = 2  # of SCK, high or low

assert WORD_BITS == BITS.hi + 1, "the count of bits wraps at the end of a word"


class State(NamedTuple):
    """The registers."""

    cs_meta: BIT = 1
    cs_n: BIT = 1
    active: BIT = 0
    sck_meta: BIT = 0
    sck: BIT = 0
    sck_seen: BIT = 0
    sdi_meta: BIT = 0
    sdi: BIT = 0
    phase: bits(3) = COMMAND
    bit: BITS = 0
    words: COUNT = 0
    read: BIT = 0
    address: ADDRESS = 0
    crc: CRC = CRC_MASK
    shift: SHIFT = 0
    data: WORD = 0
    second: BIT = 0
    spoiled: BIT = 0
    refused: BIT = 0
    write: BIT = 0
    done: BIT = 0
    errors: ERRORS = 0


STATE_FMT = formats(State)


@inlined
def divided(crc, bit):
    """The CRC register after one more bit."""
    return ((crc << 1) & CRC_MASK) ^ (CRC_POLYNOMIAL if crc >> (CRC_BITS - 1) != bit else 0)


@inlined
def rises(s):
    """Whether SCK has risen."""
    return 1 if s.sck == 1 and s.sck_seen == 0 else 0


@inlined
def fetch(s):
    """Pin: the word at `address` is taken from `rdata`."""
    if s.cs_n == 1 or rises(s) == 0 or s.read == 0:
        return 0
    if s.phase == CHECK:
        return 1 if s.bit == CRC_BITS - 1 else 0
    return 1 if s.phase == DATA and s.bit == BITS_MASK and s.words > 1 else 0


@inlined
def start(s):
    """Pin: a frame begins."""
    return 1 if s.cs_n == 0 and s.active == 0 else 0


@inlined
def sdo(s):
    """Serial data pin: the MSB of the shift register."""
    return s.shift >> SHIFT_TOP


@inlined
def taken(s, rdata):
    """What the bit of a rise makes of phase, bit, words, read, address, crc, shift, data, second, spoiled, refused."""
    phase, bit, words, read, address = s.phase, (s.bit + 1) & BITS_MASK, s.words, s.read, s.address
    crc, shift, data, second = s.crc, ((s.shift << 1) & SHIFT_MASK) | s.sdi, s.data, s.second
    spoiled, refused = s.spoiled, s.refused
    if s.phase == COMMAND:
        crc = divided(s.crc, s.sdi)
        if s.bit == COMMAND_BITS - 1:
            bit = 0
            read = (shift >> READ_AT) & 1
            words = (shift >> WORDS_AT) & COUNT_MASK
            address = shift & ADDRESS_MASK
            most = COUNT_MASK if read == 1 else MOST_WRITTEN
            refused = 1 if words == 0 or words > most or shift & ZERO_BITS != 0 else 0
            phase = CHECK if read == 1 else DATA
    elif s.phase == CHECK:
        if s.bit == CRC_BITS - 1:
            bit = 0
            spoiled = 1 if shift & CRC_MASK != s.crc ^ CRC_MASK else 0
            shift = rdata << CRC_BITS
            address = (s.address + WORD_BYTES) & ADDRESS_MASK
            phase = DATA
    elif s.phase == DATA:
        crc = divided(s.crc, s.shift >> SHIFT_TOP if s.read == 1 else s.sdi)
        if s.bit == BITS_MASK:
            if s.words > 1:
                words = s.words - 1
                if s.read == 1:
                    shift = rdata << CRC_BITS
                    address = (s.address + WORD_BYTES) & ADDRESS_MASK
                else:
                    data = shift & WORD_MASK
                    second = 1
            else:
                if s.read == 1:
                    shift = (crc ^ CRC_MASK) << WORD_BITS
                phase = TAIL
    elif s.phase == TAIL:
        if s.bit == CRC_BITS - 1:
            bit = 0
            if s.read == 0:
                spoiled = 1 if shift & CRC_MASK != s.crc ^ CRC_MASK else 0
            phase = COMPLETE
    else:
        phase = TOO_LONG
    return phase, bit, words, read, address, crc, shift, data, second, spoiled, refused


@inlined
def wrong(s):
    """Flag of a frame that ends here and does not count; 0 for one without a bit."""
    if s.phase != COMPLETE:
        return 0 if s.phase == COMMAND and s.bit == 0 else WRONG_LENGTH
    return WRONG_CRC if s.spoiled == 1 else WRONG_COMMAND


@inlined
def step(s, cs_n, sck, sdi, status, rdata, clear):
    """One clock edge."""
    phase, bit, words, read, address = s.phase, s.bit, s.words, s.read, s.address
    crc, shift, data, second, spoiled, refused = s.crc, s.shift, s.data, s.second, s.spoiled, s.refused
    write, done, flag = 0, 0, 0
    if s.cs_n == 1:
        phase, bit, crc, spoiled, refused = COMMAND, 0, CRC_MASK, 0, 0
        if s.active == 0:
            status_word = (status << ERRORS_WIDTH) | s.errors
            shift = (status_word << STATUS_AT) | ((status_word ^ CRC_MASK) << COMPLEMENT_AT)
        elif s.phase == COMPLETE and s.spoiled == 0 and s.refused == 0:
            write, done = 1 - s.read, s.read
            if s.second == 0:
                data = (s.shift >> CRC_BITS) & WORD_MASK
        else:
            second = 0
            flag = wrong(s)
    elif rises(s) == 1:
        phase, bit, words, read, address, crc, shift, data, second, spoiled, refused = taken(s, rdata)
    if s.write == 1 and s.second == 1:
        data = (s.shift >> CRC_BITS) & WORD_MASK
        address = (s.address + WORD_BYTES) & ADDRESS_MASK
        write, second = 1, 0
    return State(
        cs_meta=cs_n,
        cs_n=s.cs_meta,
        active=1 - s.cs_n,
        sck_meta=sck,
        sck=s.sck_meta,
        sck_seen=s.sck,
        sdi_meta=sdi,
        sdi=s.sdi_meta,
        phase=phase,
        bit=bit,
        words=words,
        read=read,
        address=address,
        crc=crc,
        shift=shift,
        data=data,
        second=second,
        spoiled=spoiled,
        refused=refused,
        write=write,
        done=done,
        errors=(s.errors & ~clear) | flag,
    )


BLOCK = Block(
    place=195,
    inputs={"cs_n": BIT, "sck": BIT, "sdi": BIT, "status": STATUS, "rdata": WORD, "clear": ERRORS},
    outputs={"sdo": BIT, "fetch": BIT, "start": BIT},
    latency={"sdo": LATENCY, "write": LATENCY, "done": LATENCY},
    rules={"shift": (None, "wrap"), "bit": (None, "wrap"), "address": (None, "wrap")},
    idle={"cs_n": 1},
    split=("phase",),
)
