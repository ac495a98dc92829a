"""The AXI4-Lite port of the host, wired: latency of a write, and samples that are whole whatever waits."""

import itertools
import random
from pathlib import Path
from types import SimpleNamespace

import pytest

from fpga_model import host_axi, host_words, rates
from testbench.flatten import format_leaves
from tests.fpga_model import axi_host
from tests.fpga_model.records import uncompiled

PAGE = Path(__file__).resolve().parents[2] / "docs" / "host_port.md"
PERIOD = 60  # clocks between samples: shorter than a frame, so that few rows have many
SAMPLE = (0x280, 0x288, 0x290, 0x298)


def firmware(frame=0, sample=False):
    """What the port reads for a sample: all of it says of which frame it is."""
    seq = SimpleNamespace(
        faults=SimpleNamespace(flags=frame % 256), state=frame % 13, lock=SimpleNamespace(locked=frame // 2 % 16)
    )
    output = SimpleNamespace(valid=int(sample), y=-7 * frame, t=frame - 99, k=0)
    slot = rates.SLOTS if sample else 0
    return SimpleNamespace(control=SimpleNamespace(sequencer=seq, rate_output=output), rates=SimpleNamespace(slot=slot))


def test_a_write_reaches_the_bank_when_the_page_says(monkeypatch):
    uncompiled(monkeypatch, host_words, host_axi)
    p, s, seen = host_axi.design(), host_axi.State(), []
    asked = {"awvalid": 1, "wvalid": 1, "wstrb": 15, "bready": 1}
    for n in range(12):
        words = {0: {"awaddr": 0x38, "wdata": 0x12345678}, 2: {"awaddr": 0x3C, "wdata": 0x9ABC}}
        pins = dict.fromkeys(host_axi.Inputs._fields, 0) | ({**asked, **words[n]} if n in words else {"bready": 1})
        seen.append((s.bus.bank_write, s.bus.bank_address, s.bus.bank_data))
        s = host_axi.step(p, s, firmware(), host_axi.Inputs(**pins))
    whole = (1, 7, 0x9ABC_1234_5678)
    assert [row for row in seen if row[0]] == [whole]
    behind = seen.index(whole) - 2 + 1  # the bank takes it at the next edge
    assert f"A write takes effect {behind} clocks behind the edge that takes its last part" in PAGE.read_text()


@pytest.mark.parametrize("busy", [0.05, 0.1, 0.4, 1.0])
def test_a_sample_is_of_one_frame_and_what_is_lost_is_told(busy, monkeypatch):
    """Reads of samples beside writes, with wait states that make reads shorter and longer than the period."""
    uncompiled(monkeypatch, host_words, host_axi)
    rng, p, s = random.Random(f"sample {busy}"), host_axi.design(), host_axi.State()
    writes = [axi_host.Write(8 * rng.randrange(18) + 4 * rng.randrange(2), 1, rng.randrange(16)) for _ in range(50)]
    host, frame, ready = axi_host.Host(rng, writes, (), busy), 0, 0
    for n in range(6000):
        if len(host.reads) == len(host.of_reads) and s.bus.unread:
            ready = s.bus.number
            host.reads += [axi_host.Read(address) for address in SAMPLE]
        i = host_axi.Inputs(*host.before())
        sample = n % PERIOD == PERIOD - 1
        host.behind(s.slave)
        s = host_axi.step(p, s, firmware(frame, sample), i)
        frame += sample
    words = [r.word for r in host.of_reads]
    reads = list(zip(*(words[k : len(words) // 4 * 4 : 4] for k in range(4)), strict=True))
    assert len(reads) > 10
    assert ready > 10
    before = None
    for rate, temperature, status, number in reads:
        assert (rate, temperature) == (-7 * number & 0xFFFFFFFF, number - 99 & 0xFFFF)
        assert status & 0xFFFF == number % 256 | number % 13 << 8 | number // 2 % 16 << 12
        assert status >> 19 & 1, "new"
        lost = 0 if before is None else number - before - 1
        if before is not None:
            assert status >> 20 == (lost > 0), "OVERRUN where one was lost, and nowhere else"
        before = number
    gaps = {b[3] - a[3] for a, b in itertools.pairwise(reads)}
    assert gaps == {1} if busy >= 0.4 else max(gaps) > 1


def test_the_page_has_the_cost():
    bits = sum(fmt.width for _, fmt in format_leaves(host_axi.STATE_FMT))
    assert f", {bits} with AXI4-Lite" in PAGE.read_text()
