"""A host at the pins of the SPI slave, in time: SCK of any period and phase, flip-flops that take old or new.

Times are in clocks of the slave. What a flip-flop sees at edge n of a pin that has changed since edge n - 1 is the old
or the new value, at random: a window of a whole clock, far longer than that of a real flip-flop.
Shares nothing with the slave: the CRC is that of tests/naive.py.
"""

import bisect
import math
from typing import NamedTuple

from tests import naive

WORD_BITS, CRC_BITS = 32, 8
PERIOD, LEVEL, LEAD, HIGH = 5.0, 2.0, 5.0, 5.0  # least clocks: of SCK; SCK high or low; CS_N low to SCK; CS_N high
SETUP_SDI, SETUP_SDO, HOLD_SDO = 1.0, 1.0, 2.0  # clocks around a rise of SCK
SLOWEST = 260.0  # 0.1 MHz


class Frame(NamedTuple):
    """A frame as it was sent: bits of SDI, whether it was complete, right in CRC and in command, and its rises.

    flag  the error bit that it must leave, 0 for none
    """

    read: int
    address: int
    words: tuple
    bits: str
    flag: int
    begin: float
    rises: list
    end: float


def crc(bits):
    """Text of the CRC as it is sent."""
    return f"{naive.crc_j1850(bits) ^ 255:08b}"


def text(read, address, words, count=None, zeros=0):
    """Bits of SDI of a right frame; a read sends zeros while it listens."""
    head = f"{read << 15 | (len(words) if count is None else count) << 12 | address | zeros:016b}"
    data = "".join(f"{word:032b}" for word in words)
    return head + crc(head) + "0" * (len(data) + CRC_BITS) if read else head + data + crc(head + data)


class Host:
    """Frames, one after the other, as changes of three pins."""

    def __init__(self, rng):
        self.rng, self.now, self.frames = rng, 20.0 + rng.random(), []
        self.changes = {"cs_n": [(0.0, 1)], "sck": [(0.0, 0)], "sdi": [(0.0, 0)]}

    def send(self, bits, period, read=0, address=0, words=(), flag=0):
        """One frame; it begins when CS_N has been high for long enough."""
        rng = self.rng
        begin = self.now
        self.changes["cs_n"].append((begin, 0))
        rise, rises = begin + LEAD + rng.random() * period, []
        self.changes["sdi"].append((begin + rng.random(), int(bits[0]) if bits else 0))
        for k in range(len(bits)):
            high = max(LEVEL + 1e-3, (0.41 + 0.18 * rng.random()) * period)
            high = min(high, period - LEVEL - 1e-3)
            rises.append(rise)
            self.changes["sck"] += [(rise, 1), (rise + high, 0)]
            if k + 1 < len(bits):
                late = rng.random() * (period - high - SETUP_SDI)
                self.changes["sdi"].append((rise + high + late, int(bits[k + 1])))
            fall, rise = rise + high, rise + period
        end = (fall if bits else begin + LEAD) + 1e-3 + rng.random() * 3
        self.changes["cs_n"].append((end, 1))
        self.now = end + HIGH + rng.random() * 20
        self.frames.append(Frame(read, address, tuple(words), bits, flag, begin, rises, end))

    def any_frame(self, period=None, most_words=7, addresses=512):
        """A frame of any kind: right, or wrong in one way."""
        rng = self.rng
        period = period or PERIOD * (SLOWEST / PERIOD) ** (rng.random() ** 3)
        read = rng.randrange(2)
        words = [rng.getrandbits(WORD_BITS) for _ in range(rng.randint(1, most_words if read else 2))]
        address = 4 * rng.randrange(addresses)
        right = text(read, address, words)
        kind = rng.choice(["right"] * 5 + ["crc", "short", "long", "command", "empty"])
        if kind == "crc":
            k = rng.randrange(CRC_BITS) + (16 if read else len(right) - CRC_BITS)
            self.send(right[:k] + "10"[int(right[k])] + right[k + 1 :], period, read, address, words, 1)
        elif kind == "short":
            self.send(right[: rng.randint(1, len(right) - 1)], period, read, address, words, 2)
        elif kind == "long":
            self.send(
                right + "".join(rng.choice("01") for _ in range(rng.randint(1, 40))), period, read, address, words, 2
            )
        elif kind == "command":
            wrong = rng.choice([{"count": 0}, {"zeros": 1}, {"zeros": 2}, {"zeros": 1 << 11}])
            words = words[:1]
            self.send(text(read, address, words, **wrong), period, read, address, words, 4)
        elif kind == "empty":
            self.send("", period)
        else:
            self.send(right, period, read, address, words)

    def pins(self):
        """Rows (cs_n, sck, sdi) that the first flip-flops take at edges 0, 1, .., to a while behind the last frame."""
        count = int(self.now) + 20
        columns = []
        for changes in self.changes.values():
            times = [time for time, _ in changes]
            values = [changes[max(bisect.bisect_right(times, n) - 1, 0)][1] for n in range(count)]
            seen = [values[0]]
            seen += [values[n] if self.rng.random() < 0.5 else values[n - 1] for n in range(1, count)]
            columns.append(seen)
        return list(zip(*columns, strict=True))


def heard(frame, sdo):
    """Text of the bits that a host takes at its rises; `sdo[n]` is the pin before edge n.

    AssertionError if a bit moves within set-up or hold.
    """
    found = ""
    for rise in frame.rises:
        levels = set(sdo[math.ceil(rise - SETUP_SDO) : math.ceil(rise + HOLD_SDO) + 1])
        assert len(levels) == 1, f"SDO moves around a rise of SCK at {rise:.3f} clocks"
        found += str(levels.pop())
    return found
