"""The port of the host, wired: the word of every address, the latency of a write, and the page's numbers."""

import random
from pathlib import Path

from fpga_model import host, host_bus, host_words, rates, registers, spi_slave, top
from testbench.flatten import format_leaves, rebuild
from tests.fpga_model import spi_host
from tests.fpga_model.records import uncompiled

PAGE = Path(__file__).resolve().parents[2] / "docs" / "host_port.md"
EVERY = {r.address: r for r in (*registers.MAP, *host_bus.MAP)}


def drawn(record, fmt, draw):
    return rebuild(record, [draw.randint(f.lo, f.hi) for _, f in format_leaves(fmt)])


def at(state, path):
    for name in path.split("."):
        state = getattr(state, name)
    return state


def test_every_address_reads_the_register_of_the_map(monkeypatch):
    uncompiled(monkeypatch, host_words)
    draw = random.Random(2)
    for _ in range(20):
        firmware, port = drawn(top.State(), top.STATE_FMT, draw), drawn(host.State(), host.STATE_FMT, draw)
        for register in range(256):
            r = EVERY.get(register)
            expected = 0
            if r is not None:
                raw = r.reset
                if r.path:
                    raw = at(port if register >= host_bus.FIRST else firmware, r.path)
                expected = registers.to_bus(int(raw), r.fmt)
            found = host_words.value(port.bus, port.slave.errors, firmware, register)
            assert found == expected, register


def test_the_paths_of_the_port_are_registers_in_the_format_of_the_map():
    for r in host_bus.MAP:
        assert at(host.STATE_FMT, r.path) == r.fmt, r.name


def test_a_write_reaches_the_bank_when_the_page_says(monkeypatch):
    uncompiled(monkeypatch, host, host_words)
    p, s, firmware, seen = host.design(), host.State(), top.State(), []
    levels = [(1, 0, 0)] * 6 + [(0, 0, 0)] * 5
    for bit in spi_host.text(0, 8 * 7, [0x12345678, 0x9ABC]):
        levels += [(0, 0, int(bit))] * 3 + [(0, 1, int(bit))] * 2
    end = len(levels)
    for pins in [*levels, *[(1, 0, 0)] * 8]:
        s = host.step(p, s, firmware, host.Inputs(*pins))
        seen.append((s.bus.bank_write, s.bus.bank_address, s.bus.bank_data))
    whole = (1, 7, 0x9ABC_1234_5678)
    assert [row for row in seen if row[0]] == [whole]
    # of two words the slave gives the second a clock behind the first
    assert seen.index(whole) + 1 - end == spi_slave.LATENCY + 1 + host_bus.LATENCY


def test_the_page_has_the_numbers():
    page = PAGE.read_text()
    assert f"{sum(fmt.width for _, fmt in format_leaves(host.STATE_FMT))} register bits with SPI" in page
    assert f"{len(EVERY)} registers" in page
    assert f"DATA_READY comes {rates.SLOTS + host_bus.LATENCY} clocks after the valid ADC frame" in page
    clocks = spi_host.LEAD + 256 * spi_host.PERIOD + spi_host.HIGH
    assert f"At 5.2 MHz a read of seven words takes {clocks / 26:.1f} us" in page
    one = spi_slave.LATENCY + host_bus.LATENCY + registers.LATENCY
    assert f"A write takes effect {one} clocks (two words: {one + 1}) behind" in page
