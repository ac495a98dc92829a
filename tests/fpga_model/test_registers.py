"""The register bank: every register at every clock, the map against the whole design, and its page."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpga_model import agc, fault_monitor, frequency_tracker, rate_loop, registers, sequencer
from fpga_model.design_record import DEFAULT
from tests.fpga_model.records import assert_rows, raws, rows

write = st.tuples(
    st.sampled_from([1, 1, 1, 0]),
    st.one_of(st.integers(0, 20), raws(registers.ADDRESS)),
    raws(registers.DATA),
    st.sampled_from([0, 0, 1]),
)


def expected_rows(inputs):
    """A dictionary by address: what is written replaces, but adds ones to the clear register, which `taken` empties."""
    bank = {r.address: r.reset for r in registers.MAP if r.access != "ro"}
    expected = [tuple(bank.values())]
    for on, address, data, taken in inputs:
        if taken:
            bank[registers.BY_NAME["fault_clear"].address] = 0
        if on and address in bank:
            fmt = registers.BY_ADDRESS[address].fmt
            low = data % 2**fmt.width
            if registers.BY_ADDRESS[address].access == "w1c":
                low |= bank[address]
            bank[address] = low - 2**fmt.width if fmt.s and low >= 2 ** (fmt.width - 1) else low
        expected.append(tuple(bank.values()))
    return expected


@given(st.lists(write, max_size=30))
def test_step_is_the_documented_equation(inputs):
    found = rows(lambda s, *i: registers.step(DEFAULT, s, *i), registers.State(), inputs)
    assert_rows(found, expected_rows(inputs), registers.STATE_FMT)


def test_ones_of_several_writes_add_up_until_they_are_taken():
    """Rows before each edge; the write in the very clock of `taken` is kept."""
    inputs = [(1, 1, 0x05, 0), (1, 1, 0x30, 0), (1, 1, 0, 0), (0, 1, 0xFF, 0), (1, 1, 0x80, 1), (0, 0, 0, 1)]
    found = rows(lambda s, *i: registers.step(DEFAULT, s, *i), registers.State(), inputs)
    assert [s.fault_clear for s in found] == [0, 0x05, 0x35, 0x35, 0x35, 0x80, 0]


@pytest.mark.parametrize("data", [0x5555_5555_5555, 0xAAAA_AAAA_AAAA, 0, 2**48 - 1])
def test_every_address_writes_its_own_register_and_no_other(data):
    inputs = [(1, address, data, 0) for address in range(256)]
    found = rows(lambda s, *i: registers.step(DEFAULT, s, *i), registers.State(), inputs)
    assert_rows(found, expected_rows(inputs), registers.STATE_FMT)


def test_map_leads_to_the_registers_of_the_design():
    """Every path exists in the whole design, in the format that the map gives; every reset is the state's default."""
    from fpga_model import top

    state = top.State()
    for r in registers.MAP:
        if not r.path:
            assert registers.read(state, r.address) == r.reset
            continue
        fmt, value = top.STATE_FMT, state
        for name in r.path.split("."):
            fmt, value = getattr(fmt, name), getattr(value, name)
        if r.name in ("amplitude", "rate_word"):
            # outputs of a PI: its register is wide, its limits keep it within the map's format
            loop = (agc.design() if r.name == "amplitude" else rate_loop.design()).loop
            assert r.fmt.lo <= loop.lo <= loop.hi <= r.fmt.hi
        else:
            assert fmt == r.fmt, r.name
        if r.access == "rw":
            assert value == r.reset
            assert registers.read(state, r.address) == registers.to_bus(r.reset, r.fmt)
    assert registers.read(state, 0x3F) == 0


@given(st.sampled_from(registers.MAP).flatmap(lambda r: st.tuples(st.just(r.fmt), raws(r.fmt))))
def test_bus_words_carry_every_value(pair):
    fmt, raw = pair
    assert 0 <= registers.to_bus(raw, fmt) < 2**48
    assert registers.from_bus(registers.to_bus(raw, fmt), fmt) == raw


def test_reset_values():
    s = registers.State()
    assert s.control == sequencer.RUN
    assert s.frequency_fixed == frequency_tracker.State().centre
    assert (s.phase_drive_sine, s.phase_sense_sine, s.phase_drive_ref, s.phase_sense_ref) == (0, 0, 0, 0)
    assert registers.read(None, 0x40).to_bytes(6, "big") == b"GYRO\x00\x02"


def test_names_of_bits_are_those_of_the_blocks():
    for k, name in enumerate(sequencer.CONTROL_BITS):
        assert getattr(sequencer, name) == 1 << k
        assert f"{k} {name}" in registers.BY_NAME["control"].doc
    for k, name in enumerate(fault_monitor.NAMES):
        assert getattr(fault_monitor, name) == 1 << k
        assert f"{k} {name}" in registers.BY_NAME["flags"].doc
    for k, name in enumerate(sequencer.STATES):
        assert getattr(sequencer, name) == k
        assert f"{k} {name}" in registers.BY_NAME["state"].doc
