"""Script of the SPI slave: frames as a host sends them, each way in which one can be wrong, resets in every phase.

Source  fpga_model/spi_slave.py
"""

import itertools

from fpga_model import spi_slave
from fpga_model.block import python_function

IDLE = {"cs_n": 1}
READ = 1


def crc(bits):
    """CRC of a list of bits, as it is sent."""
    divide_bit, remainder = python_function(spi_slave.divided), spi_slave.CRC_MASK
    for bit in bits:
        remainder = divide_bit(remainder, bit)
    return remainder ^ spi_slave.CRC_MASK


def msb_first_bits(value, count):
    """The bits of a number, MSB first."""
    return [(value >> k) & 1 for k in reversed(range(count))]


def frame(read, address, words, count=None, spoil=0, zeros=0):
    """Bits of SDI. A read sends random words; `count` is the count in the command, `zeros` its bit 11 and those
    below a word; the CRC is inverted in the bits `spoil`."""
    count = len(words) if count is None else count
    head = msb_first_bits(
        read << spi_slave.READ_AT | count << spi_slave.WORDS_AT | address | zeros, spi_slave.COMMAND_BITS
    )
    data = [bit for word in words for bit in msb_first_bits(word, spi_slave.WORD_BITS)]
    check = msb_first_bits(crc(head if read else head + data) ^ spoil, spi_slave.CRC_BITS)
    return head + check + data + [0] * spi_slave.CRC_BITS if read else head + data + check


def search_crc_words(words, check):
    """Words of a write to address 10h with another last one, so that the CRC is `check`."""
    for last in itertools.count():
        candidate_words = [*words[:-1], last]
        if frame(0, 0x10, candidate_words)[-spi_slave.CRC_BITS :] == msb_first_bits(check, spi_slave.CRC_BITS):
            return candidate_words


class Host:
    """Sends frames into a writer; the bus answers at random."""

    def __init__(self, w):
        self.w = w

    def rows(self, values, times=1, **more):
        for _ in range(times):
            self.w.append_row({**self.w.some(), "cs_n": 0, "clear": 0, **values, **more})

    def bits(self, bits, low=1, high=1, **more):
        for bit in bits:
            self.rows({"sdi": bit}, low, **more)
            self.rows({"sdi": bit, "sck": 1}, high, **more)

    def send(self, bits, lead=1, tail=1, idle=6, **more):
        """A frame; CS_N is low `lead` rows before it and `tail` rows behind it, then high for `idle` rows."""
        self.rows({}, lead)
        self.bits(bits, **more)
        self.rows({}, tail)
        self.rows(IDLE, idle)

    def words(self, count):
        return [self.w.random.raw(spi_slave.WORD) for _ in range(count)]

    def address(self):
        return self.w.random.raw(spi_slave.ADDRESS) & ~(spi_slave.WORD_BYTES - 1)


def script_spi_slave(w):
    host = Host(w)
    good(host, w)
    send_wrong_frames(host, w)
    reset_during_frames(host, w)


def good(host, w):
    """Reads and writes of every length; each bit of an address, words at their ends; slow and uneven clocks."""
    for k in range(2, spi_slave.ADDRESS.width):
        host.send(frame(k & 1, 1 << k, host.words(1)))
    for word in (0, spi_slave.WORD_MASK, 0x55555555, 0xAAAAAAAA, 1, 1 << 31):
        host.send(frame(0, host.address(), [word]))
    ends = (0, spi_slave.WORD_MASK, 0x55555555, 0xAAAAAAAA)
    for address, first, second in zip(
        (0, spi_slave.ADDRESS_MASK & ~3, 0x554, 0x2A8), ends, (ends[1], ends[0], *ends[3:1:-1])
    ):
        host.send(frame(0, address, [first, second]))
    for count in (1, 4, spi_slave.COUNT_MASK):
        host.send(frame(READ, host.address(), host.words(count)))
    # a read leaves the data of a write alone until it is over
    host.send(frame(0, host.address(), [spi_slave.WORD_MASK]))
    host.send(frame(READ, host.address(), host.words(2)))
    host.send(frame(READ, spi_slave.ADDRESS_MASK & ~3, host.words(3)))
    host.send(frame(0, host.address(), host.words(1)), lead=5, tail=3, low=3, high=2)
    host.send(frame(READ, host.address(), host.words(1)), lead=0, tail=0, low=1, high=3)
    # frames with CS_N high for one row and for two between them
    for idle in (1, 2):
        host.send(frame(0, host.address(), host.words(2)), idle=idle)
        host.send(frame(READ, host.address(), host.words(1)), idle=idle)
    # words of all zeros and all ones; a CRC of all zeros and all ones
    for word in (0, spi_slave.WORD_MASK):
        host.send(frame(READ, 0x300, [word]), rdata=word)
    for count in range(1, spi_slave.MOST_WRITTEN + 1):
        for check in (0, spi_slave.CRC_MASK):
            host.send(frame(0, 0x10, search_crc_words(host.words(count), check)))
    # SCK moves while nothing is selected
    for sck in (1, 0, 1, 1, 0):
        host.rows(IDLE, sck=sck)


def send_wrong_frames(host, w):
    """Each bit of the CRC, each wrong command and length; flags that are cleared, also in the clock of a new one."""
    for k in range(spi_slave.CRC_BITS):
        host.send(frame(k % 2, host.address(), host.words(1), spoil=1 << k))
    host.rows(IDLE, clear=0b101)
    for word_count in (0, spi_slave.MOST_WRITTEN + 1, 4, spi_slave.COUNT_MASK):
        host.send(frame(0, host.address(), host.words(max(word_count, 1)), word_count))
        host.rows(IDLE, clear=0b100 if word_count < 4 else 0b111)
    host.send(frame(READ, host.address(), host.words(1), 0))
    for zeros in (1 << spi_slave.ADDRESS.width, 1, 2):
        for read in (0, READ):
            host.rows(IDLE, clear=spi_slave.ERRORS.hi)
            host.send(frame(read, host.address(), host.words(1), zeros=zeros))
    for command in (0, 0x7FFF, 0x8000, 0xFFFF):
        host.send(msb_first_bits(command, spi_slave.COMMAND_BITS))
    # wrong in two ways
    host.send(frame(0, host.address(), host.words(1), zeros=1, spoil=0x10))
    host.send(frame(READ, host.address(), host.words(1), zeros=2, spoil=0x01))
    host.rows(IDLE, clear=spi_slave.ERRORS.hi)
    few, some = (16, 25), (1, 2, 4, 8, 15, 16, 17, 23, 24, 25, 48, 49, 80)
    for read, words, cuts, extra_bit_counts in (
        (0, 1, few, (1, 32, 33)),
        (0, 2, some, (1,)),
        (READ, 1, some, (2,)),
        (READ, 2, few, ()),
    ):
        full_frame = frame(read, host.address(), host.words(words))
        for cut in (*cuts, len(full_frame) - 1):
            host.send(full_frame[:cut], idle=4)
            if cut in few or cut < 15:
                host.rows(IDLE, clear=0b010)
        for more in extra_bit_counts:
            host.send(full_frame + [0] * more)
        host.rows(IDLE, clear=0b010)
    # CS_N and SCK rise together, where the next bit would fetch a word
    for cut in (23, 24 + 31):
        host.rows({})
        host.bits(frame(READ, host.address(), host.words(2))[:cut])
        host.rows({})
        host.rows(IDLE, sck=1)
        host.rows(IDLE, 3)
    # no bit is no frame
    host.send([], lead=4)
    host.send(frame(0, host.address(), host.words(1)))
    # clear at each clock around a new flag; the last clears come before it, so a flag is up at the next reset
    for delay_row_count in reversed(range(6)):
        host.rows({})
        host.bits([1])
        host.rows(IDLE, delay_row_count)
        host.rows(IDLE, clear=spi_slave.ERRORS.hi)
        host.rows(IDLE, 4)


def reset_during_frames(host, w):
    """A reset in every bit of a write, in a read, also a wrong one, behind a frame that is too long or whole."""
    write, read = frame(0, 0x2A8, host.words(1)), frame(READ, 0x554, host.words(1))
    ends = [(write, cut) for cut in range(len(write) + 1)]
    refused = frame(READ, 0x554, [0], zeros=1, spoil=1)
    ends += [(read, cut) for cut in (17, 24, 56, 64)] + [(refused, 25)]
    ends += [(write + [1] * 3, len(write) + k) for k in (2, 3)]
    for bits, cut in ends:
        host.bits(bits[:cut])
        host.rows({}, 3)
        w.append_row({**w.some(), **w.flips()}, rst=1)
        host.rows(IDLE, 4)
    for words, clocks in ((read, (1, 2, 3, 4)), (frame(0, 8, host.words(2)), (1, 2, 3, 4, 5))):
        for delay_row_count in clocks:
            host.send(words, idle=delay_row_count)
            w.append_row({**w.some(), **w.flips()}, rst=1)
            host.rows(IDLE, 3)
