"""SPI frames of the C driver: bytes against texts of bits, replies with faults, and the model of the slave."""

import random
import struct

from fpga_model import spi_slave
from tests.testbench.register_map.test_driver import crc_by_division

OK, NO_SLAVE, CORRUPT = range(3)


def numbers(data):
    return " ".join(map(str, data))


def bits_to_bytes(text):
    text = text.replace(" ", "")
    assert len(text) % 8 == 0
    return bytes(int(text[k : k + 8], 2) for k in range(0, len(text), 8))


def read_frame(address, words):
    """Read, number of words, 0, byte address; CRC; zeros while words and their CRC come back."""
    command = bits_to_bytes(f"1 {words:03b} 0 {address:011b}")
    return command + bytes([crc_by_division(command)]) + bytes(4 * words + 1)


def write_frame(address, words):
    data = bits_to_bytes(f"0 {len(words):03b} 0 {address:011b}" + "".join(f"{word:032b}" for word in words))
    return data + bytes([crc_by_division(data)])


def test_frames_are_those_of_the_port(driver):
    draw, lines, expected = random.Random(4), [], []
    for _ in range(60):
        address, words = 4 * draw.randrange(512), [draw.getrandbits(32), draw.getrandbits(32)]
        for n in range(1, 8):
            lines.append(f"spi_read {address} {n}")
            expected.append(read_frame(address, n))
        for n in (1, 2):
            lines.append(f"spi_write {address} {n} {words[0]} {words[1]}")
            expected.append(write_frame(address, words[:n]))
    assert driver(lines) == [f"{len(frame)} {numbers(frame)}" for frame in expected]


def test_what_cannot_be_a_frame_is_refused(driver):
    lines = [f"spi_read {address} {n}" for address, n in ((2, 1), (2048, 1), (0, 0), (0, 8), (0, -1))]
    lines += [f"spi_write {address} {n} 0 0" for address, n in ((1, 1), (4096, 1), (0, 0), (0, 3))]
    assert driver(lines) == ["0"] * len(lines)


def reply(sent, received):
    return f"spi_reply {len(sent)} {numbers(sent)} {numbers(received)}"


def test_every_single_bit_error_of_a_reply_is_noticed(driver):
    words, status = (0xDEADBEEF, 0x12345678), 0x58
    sent = read_frame(0x258, 2)
    good = bytes([status, 0xFF - status, 0]) + struct.pack(">2I", *words)
    good += bytes([crc_by_division(sent[:2] + good[3:])])
    wrong = [(int.from_bytes(good, "big") ^ 1 << k).to_bytes(len(good), "big") for k in range(8 * len(good))]
    right, *others = driver([reply(sent, data) for data in (good, *wrong)])
    assert right == f"{OK} {status} {words[0]} {words[1]} 0 0 0 0 0"
    for place, line in enumerate(reversed(others)):
        result = int(line.split()[0])
        byte = place // 8
        assert result == (NO_SLAVE if byte < 2 else OK if byte == 2 else CORRUPT), place
        assert result == OK or line.split()[2:] == ["0"] * 7, "words of a wrong reply must not be used"


def test_the_echo_of_a_write_is_compared(driver):
    sent = write_frame(0x10, [0x01234567, 0x89AB])
    good = bytes([0, 0xFF, 0, 0, 0]) + sent[:-5]
    assert len(good) == len(sent)
    lost = good[:-1] + bytes([good[-1] ^ 1])
    absent = bytes(len(sent))
    found = driver([reply(sent, data) for data in (good, lost, absent, b"\xff" * len(sent))])
    assert [int(line.split()[0]) for line in found] == [OK, CORRUPT, NO_SLAVE, NO_SLAVE]


def test_a_sample_is_taken_from_the_words_of_a_read_and_lost_ones_are_counted(driver):
    def words(number, k):
        return [0xF9C00000, 0, 0xFFFF, 0, k << 16 | 0xFC00, 0, number]

    cases = [(7, 8, 0, 0), (7, 9, 0, 1), (4095, 0, 0, 0), (4090, 6, 0, 11), (0, 8, 3, 0), (4088, 16, 3, 2)]
    found = driver([f"samples {numbers(words(a, k) + words(b, k))}" for a, b, k, _ in cases])
    assert found == [f"{0xF9C00000 - 2**32} -1 {k << 16 | 0xFC00} {b} {lost}" for _, b, k, lost in cases]


# ---- the model of the slave ------------------------------------------------------------------------------------------


class Slave:
    """The model behind the pins, with a bus of words; SCK has eight clocks a bit."""

    def __init__(self, memory):
        self.state, self.memory, self.written = spi_slave.State(), memory, []

    def clock(self, cs_n, sck, sdi):
        rdata = self.memory.get(int(self.state.address), 0)
        self.state = spi_slave.step(self.state, cs_n, sck, sdi, 5, rdata, 0)
        if self.state.write:
            self.written.append((int(self.state.address), int(self.state.data)))
        return int(self.state.shift) >> (spi_slave.SHIFT.width - 1)

    def exchange(self, sent):
        received = []
        for _ in range(8):
            self.clock(0, 0, 0)
        for bit in "".join(f"{byte:08b}" for byte in sent):
            levels = [self.clock(0, 0, int(bit)) for _ in range(4)]
            received.append(str(levels[-1]))
            for _ in range(4):
                self.clock(0, 1, int(bit))
        for _ in range(8):
            self.clock(0, 0, 0)
        for _ in range(12):
            self.clock(1, 0, 0)
        return bits_to_bytes("".join(received))


def test_the_slave_takes_the_frames_and_the_driver_its_replies(driver):
    memory = {0x258: 0xF9C00000, 0x260: 1190, 0x228: 0xBA0D8C5E, 0x22C: 0x1B}
    calls = [
        "spi_read 600 1",
        "spi_read 552 2",
        "spi_read 600 3",
        "spi_write 16 2 4096 49152",
        "spi_write 88 1 4294967040 0",
    ]
    frames = [bytes(map(int, line.split()[1:])) for line in driver(calls)]
    slave = Slave(memory)
    received = [slave.exchange(frame) for frame in frames]
    found = [list(map(int, line.split())) for line in driver([reply(s, r) for s, r in zip(frames, received)])]
    status = 5 << 3
    assert [line[:2] for line in found] == [[OK, status]] * 5
    assert found[0][2:4] == [0xF9C00000, 0]
    assert found[1][2:5] == [0xBA0D8C5E, 0x1B, 0]
    assert found[2][2:6] == [0xF9C00000, 0, 1190, 0]
    assert slave.written == [(16, 4096), (20, 49152), (88, 4294967040)]


def test_the_slave_drops_a_frame_with_a_wrong_bit(driver):
    slave = Slave({})
    frame = write_frame(16, [4096])
    slave.exchange(frame[:4] + bytes([frame[4] ^ 4]) + frame[5:])
    assert slave.written == []
    again = write_frame(16, [4096])
    (line,) = driver([reply(again, slave.exchange(again))])
    assert line.split()[:2] == [str(OK), str(5 << 3 | 1)], "the flag CRC is in the status of the next frame"
    assert slave.written == [(16, 4096)]
