"""Writes of scenarios over the SPI pins: the frame is the page's, it comes when it says, and acts as any write does."""

import pytest

from fpga_model import host_bus, registers, spi_slave
from fpga_model.design_record import DEFAULT
from testbench.config import from_dict, host_frames
from testbench.errors import ConfigError
from testbench.golden.loop import by_edge
from testbench.run import design_check
from testbench.run.simulation import Simulation
from tests.fpga_model import spi_host


def words_of(register, raw):
    word = raw % 2**register.fmt.width
    return [word % 2**32, word >> 32] if register.fmt.width > 32 else [word]


@pytest.mark.parametrize("register", registers.WRITABLE, ids=lambda r: r.name)
def test_the_port_writes_the_value_at_the_first_clock_of_a_tick(register):
    for raw in (register.fmt.lo, register.fmt.hi, 1):
        bits = spi_host.text(0, 8 * register.address, words_of(register, raw))
        assert "".join(map(str, host_frames.sdi_bits(register, raw))) == bits
        found = host_frames.encode_write(DEFAULT, register, raw)
        assert (found.address, found.data) == (register.address, raw % 2**register.fmt.width)
        begin = int(found.pins[:, 0].argmin())
        end = begin + host_frames.LEAD_CLOCKS + 5 * len(bits)
        assert found.pins[end:, 0].all()
        assert not found.pins[begin:end, 0].any()
        second = len(words_of(register, raw)) - 1
        assert 26 * found.ticks == end + spi_slave.LATENCY + second + host_bus.LATENCY
        assert begin < 26


def simulation(**scenario):
    return Simulation(from_dict({"scenario": {"engine": "clocked", **scenario}}, "test"), 25.0, 25.0)


def test_a_write_over_the_pins_acts_as_one_on_the_bus_at_its_tick():
    """The same codes and registers, when both come to the bank at the same clock."""
    found, value = [], 0x0123_4567_89AB
    ticks = host_frames.encode_write(DEFAULT, registers.BY_NAME["phase_sense_ref"], value).ticks
    for way, waits in (("spi", 0), ("bus", ticks)):
        sim = simulation(host=way)
        sim.now = (0.1, 25.0)
        sim.advance(700 + waits, 0.1, 25.0)
        sim.write("phase_sense_ref", value)
        assert sim.tick == 700 + ticks + 1
        sim.advance(600, 0.1, 25.0)
        assert sim.state.fpga.registers.phase_sense_ref == value
        found.append((sim.codes_sha256(), sim.state.fpga))
    assert found[0] == found[1]


def test_what_takes_writes_of_the_bus_alone_refuses_the_pins_in_one_line():
    config = from_dict({"scenario": {"host": "spi"}}, "test")
    with pytest.raises(ConfigError, match=r'^scenario\.host = "spi": a record supports "bus" only$'):
        design_check.default_only(config, "a record")
    with pytest.raises(ConfigError, match=r'^scenario\.host = "spi": this bench supports "bus" only$'):
        by_edge.Plant(config)
