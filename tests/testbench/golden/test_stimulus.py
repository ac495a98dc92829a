"""Stimulus: the generator's published numbers, families that reach what they are named for, the same every time."""

import numpy as np
import pytest

from fpga_model import fault_monitor, modulator, rates, sequencer, spi_adc
from fpga_model.fixed import Fmt, bits
from testbench.golden import blocks, stimulus

CASES = [(stem, case) for stem, block in blocks.BLOCKS.items() for case in block.cases]


def record(stem, case):
    """(stimulus, registers, pins) by port name, for a case."""
    block = blocks.BLOCKS[stem]
    rows, _ = stimulus.make(block, case)
    regs, pins = blocks.run(block, case, rows)
    named = [(block.columns, rows), (block.registers, regs), (block.pins, pins)]
    return [{port.name: array[:, k] for k, port in enumerate(ports)} for ports, array in named]


def test_splitmix64_gives_the_published_numbers():
    random = stimulus.Random(0)
    assert [random.next() for _ in range(3)] == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]


def test_raw_values_stay_in_the_format_and_reach_its_ends():
    random, fmt = stimulus.Random(1), Fmt(1, 2, 0)
    assert {random.raw(fmt) for _ in range(400)} == set(range(-4, 4))


def test_corners_hold_the_ends():
    for fmt in (bits(1), bits(2), bits(48), Fmt(1, 0, 17), Fmt(1, -1, 24), Fmt(1, 35, 24)):
        found = stimulus.corners(fmt)
        assert {fmt.lo, fmt.hi} <= set(found)
        assert found == sorted(set(found))
        assert all(fmt.holds(v) for v in found)


@pytest.mark.parametrize(("stem", "case"), CASES)
def test_families_follow_one_another_and_repeat_exactly(stem, case):
    block = blocks.BLOCKS[stem]
    rows, families = stimulus.make(block, case)
    again, same = stimulus.make(block, case)
    assert np.array_equal(rows, again)
    assert families == same
    at = 0
    for name, first, count in families:
        assert (first, count > 0) == (at, True), name
        at += count
    assert at == len(rows) < 20_000
    assert rows[:, 0].sum() >= 3, "resets in the middle"
    blocks.check(block.columns, rows, stem)


@pytest.mark.parametrize("case", blocks.BLOCKS["modulator"].cases)
def test_modulator_meets_both_limits_every_tie_and_one_beyond(case):
    p = blocks.BLOCKS["modulator"].cases[case]
    _, regs, _ = record("modulator", case)
    assert {p.lo, p.hi} <= set(regs["code"].tolist())
    product = regs["product"]
    low = set((product & ((1 << p.shift) - 1)).tolist())
    half = 1 << (p.shift - 1)
    assert {0, 1, half, (1 << p.shift) - 1} <= low
    # a tie +-1 of 39 dropped bits has no factors of 24 and 18 bits
    assert ({half - 1, half + 1} <= low) == (case != "dac2")
    rounded = set(((product + half) >> p.shift).tolist())
    assert {p.lo, p.lo + 1, p.hi - 1, p.hi, p.hi + 1} <= rounded
    assert (p.lo - 1 in rounded) == (case == "narrow")
    assert product.max() == modulator.AMPLITUDE.lo * modulator.SINE.lo


@pytest.mark.parametrize("case", blocks.BLOCKS["pi"].cases)
def test_pi_meets_both_limits(case):
    p = blocks.BLOCKS["pi"].cases[case]
    _, regs, _ = record("pi", case)
    assert (regs["y"].min(), regs["y"].max()) == (p.lo, p.hi)
    assert (regs["acc"].min(), regs["acc"].max()) == (p.lo << 24, p.hi << 24)


def test_pi_meets_a_tie_and_its_neighbours():
    _, regs, _ = record("pi", "odd")
    low = set(((regs["prop"] + regs["acc"]) & ((1 << 24) - 1)).tolist())
    assert {(1 << 23) - 1, 1 << 23, (1 << 23) + 1, 0, (1 << 24) - 1} <= low


def test_sequencer_sees_every_state_and_every_fault():
    _, regs, pins = record("sequencer", "quick")
    assert set(regs["state"].tolist()) == set(range(len(sequencer.STATES)))
    assert int(np.bitwise_or.reduce(regs["faults_flags"])) == fault_monitor.ALL
    assert int(np.bitwise_or.reduce(regs["lock_locked"])) == 15
    for name, column in pins.items():
        assert len(set(column.tolist())) > 1, name


def test_spi_adc_completes_good_and_bad_frames():
    _, regs, _ = record("spi_adc", "default")
    assert regs["valid"].sum() > 10
    assert {0, 1} == set(regs["ok"][1:][regs["valid"][1:] == 1].tolist())
    assert set(regs["count"].tolist()) == set(range(spi_adc.TAIL_CYCLES))


def test_counters_wrap_or_saturate():
    _, regs, _ = record("rates", "default")
    assert regs["frame"].max() == rates.FRAME_TICKS - 1
    assert ((regs["frame"][:-1] == rates.FRAME_TICKS - 1) & (regs["frame"][1:] == 0)).any()
    assert regs["slot"].max() == rates.SLOTS
    _, regs, _ = record("watchdog", "default")
    assert regs["age"].max() == 1023
    _, regs, _ = record("lock_monitor", "default")
    assert int(np.bitwise_or.reduce(regs["locked"])) == 15


@pytest.mark.parametrize("stem", ["dds", "sine", "delay", "references", "modulator", "spi_adc", "cordic", "registers"])
def test_every_bit_of_every_register_is_seen_high_and_low(stem):
    block, ones, zeros = blocks.BLOCKS[stem], {}, {}
    for case in block.cases:
        _, regs, _ = record(stem, case)
        for port in block.registers:
            mask = (1 << port.width) - 1
            column = regs[port.name]
            ones[port.name] = ones.get(port.name, 0) | int(np.bitwise_or.reduce(column)) & mask
            zeros[port.name] = zeros.get(port.name, 0) | ~int(np.bitwise_and.reduce(column)) & mask
    for port in block.registers:
        full = (1 << port.width) - 1
        assert (ones[port.name], zeros[port.name]) == (full, full), port.name
