"""Script of the host's bus: pairs of words whole and broken, reads that are done, aborted or overtaken, every count.

Source  fpga_model/host_bus.py
"""

import itertools

from fpga_model import host_bus, registers, spi_slave
from testbench.golden.stimulus.writer import ALTERNATE

SAMPLE, ERRORS = host_bus.SAMPLE_RATE, host_bus.ERRORS_REGISTER << host_bus.REGISTER_AT
HIGH = 4
PAIRS = tuple(r.address << host_bus.REGISTER_AT for r in registers.WRITABLE if host_bus.design().pairs >> r.address & 1)
SAMPLE_EVENTS = ({"frame": 1}, {"frame": 1, "valid": 1}, {"valid": 1}, {})
READ_EVENTS = ({"start": 1}, {"fetch": 1, "address": SAMPLE}, {"done": 1}, {"fetch": 1, "address": SAMPLE + 8}, {})


def script_host_bus(w):
    def rows(*given):
        for values in given:
            w.append_row({**w.some(), **values})

    def write(address, data):
        rows({"write": 1, "address": address, "data": data})

    words = (0, host_bus.WORD_MASK, ALTERNATE & host_bus.WORD_MASK, (ALTERNATE << 1) & host_bus.WORD_MASK)
    # every address alone, and as the high word of every register behind a low one
    for address in range(0, 1 << 11, HIGH):
        write(address, words[address // HIGH % len(words)])
        rows({"fetch": 1, "address": address})
        rows({"address": address ^ HIGH})
    for low, high in itertools.product((*PAIRS, 0, 48, 64), repeat=2):
        write(low, w.random.raw(host_bus.WORD))
        write(high + HIGH, w.random.raw(host_bus.WORD))
        w.append_row()
    # addresses that differ in one bit from the one that counts
    for k in range(host_bus.REGISTER_AT, spi_slave.ADDRESS.width):
        for low in PAIRS:
            write(low, w.random.raw(host_bus.WORD))
            write((low ^ 1 << k) + HIGH, w.random.raw(host_bus.WORD))
            w.append_row()
    for k in range(spi_slave.ADDRESS.width):
        rows(
            SAMPLE_EVENTS[1],
            READ_EVENTS[1],
            SAMPLE_EVENTS[1],
            {"fetch": 1, "address": SAMPLE ^ 1 << k},
            SAMPLE_EVENTS[1],
        )
        write(ERRORS ^ 1 << k, host_bus.WORD_MASK)
    # a low word waits while others read, and for one high word only
    for low, word in itertools.product(PAIRS, words):
        write(low, word)
        rows({"fetch": 1, "address": low}, {"fetch": 1, "address": low + HIGH})
        write(low + HIGH, word ^ host_bus.WORD_MASK)
        write(low + HIGH, word)
    # the latch, and each bit of the address that asks for it
    for word in (0, registers.DATA.hi, ALTERNATE & registers.DATA.hi, (ALTERNATE << 1) & registers.DATA.hi):
        for k in range(host_bus.REGISTER_AT, 11):
            rows({"fetch": 1, "address": 1 << k, "value": word}, {"address": (1 << k) + HIGH, "value": 0})
            rows({"address": HIGH}, {"fetch": 1, "address": (1 << k) + HIGH, "value": registers.DATA.hi ^ word})
            rows({"address": (1 << k) + HIGH})
    for errors in range(8):
        write(ERRORS, errors)
        write(ERRORS + HIGH, errors)
    # samples and reads in every order, three events in following rows, from each count of unread samples
    for unread in range(3):
        for order in itertools.product(range(len(READ_EVENTS)), range(len(SAMPLE_EVENTS)), repeat=2):
            rows(READ_EVENTS[0], READ_EVENTS[1], READ_EVENTS[2])
            rows(*[SAMPLE_EVENTS[1]] * unread)
            rows({**READ_EVENTS[order[0]], **SAMPLE_EVENTS[order[1]]})
            rows({**READ_EVENTS[order[2]], **SAMPLE_EVENTS[order[3]]})
            rows(READ_EVENTS[2])
    # a reset, and every strobe, while a low word waits
    for values in ({}, {"fetch": 1}, {"frame": 1}, {"write": 1, "address": ERRORS}):
        write(PAIRS[0], w.random.raw(host_bus.WORD))
        w.append_row({**w.some(), **values}, rst=0 if values else 1)
    for unread in range(3):
        rows(READ_EVENTS[1], READ_EVENTS[2], READ_EVENTS[1], *[SAMPLE_EVENTS[1]] * unread, SAMPLE_EVENTS[2])
        write(ERRORS, unread)
        w.append_row(w.some(), rst=1)
    for single in range(8):
        rows({**SAMPLE_EVENTS[1], "flags": 1 << single}, READ_EVENTS[1])
    # the count of frames to its wrap
    w.append_row({"frame": 1, "valid": 1}, times=host_bus.NUMBER.hi + 3)
    rows(READ_EVENTS[1], READ_EVENTS[2])
