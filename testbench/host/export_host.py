"""`gyro host`: the RTL with a port of the host, closed around chips and plant, as a library for a host in C.

    gyro_board.v, rtl/       firmware and port; registers begin as state.hex says
    state.bin, state.hex     a locked gyroscope: plant and chips, registers of the firmware
    board.h, loop.h, .cpp    chips and plant in C++, around the verilated board
    bus.cpp, gyro_bus.h      master of the port: SPI or AXI4-Lite
    gyro_loop.h, access.h, host.c    what a host in C calls, how it reads registers, and one
    map/                     the register map, with the driver

Source  docs/host_port.md
"""

import shutil
from pathlib import Path

from fpga_model import host, host_axi
from fpga_model.rates import FRAME_TICKS
from testbench.config import scenario
from testbench.errors import ConfigError
from testbench.flatten import leaves
from testbench.golden.loop import library, locked_state
from testbench.golden.recording import board_recording, host_board
from testbench.register_map import export_registers as register_map
from testbench.run import simulate
from testbench.run.simulation import Simulation
from testbench.storage.files import replace_folder

TEMPLATES = Path(__file__).with_name("templates")
RTL = Path(__file__).parents[1] / "rtl"
BOARD = Path(__file__).parents[1] / "bench" / "board.h"
BUSES = {
    "spi": (host, ("spi_slave", "host_bus", "host_words", "host")),
    "axi": (host_axi, ("axi_slave", "host_bus", "host_words", "host_axi")),
}  # model, Verilog
OPEN_FIRST = ("Makefile", "host.c", "access.h", "gyro_loop.h", "gyro_bus.h", "gyro_board.v", "map/c/gyro_driver.h")
MARK = "gyro_loop.h"  # a folder with it is one of ours


def locked_simulation(config):
    """(`Simulation` at the begin of a frame, its rate in rad/s) of a configuration; ConfigError if it does not lock."""
    timeline = scenario.expand(config.scenario, config.design_record())
    rate_rad_s, temp_degc = timeline.rate_before_rad_s, timeline.temp_before_degc
    sim = Simulation(config, temp_degc, temp_degc, engine="frame")
    sim.keep_rows = sim.keep_codes = False
    if simulate.start(config, sim, rate_rad_s, temp_degc) is None:
        raise ConfigError("gyro host: the gyroscope of this configuration does not lock")
    sim.advance(-sim.tick % FRAME_TICKS, rate_rad_s, temp_degc)
    return sim, rate_rad_s


def write_loop(folder, sim, rate_rad_s, bus="spi"):
    """Board, tables, state and sources of the loop around a locked `Simulation`."""
    model, stems = BUSES[bus]
    try:
        locked_state.write_state(sim, rate_rad_s, folder)
    except ValueError as problem:
        raise ConfigError(f"gyro host: {problem}") from None
    reset = [f"    host.{path.replace('.', '.r_')} = {int(value)};" for path, value in leaves(model.State()) if value]
    board_recording.write_roms(folder, sim.design)
    (folder / f"{board_recording.MODULE}.v").write_text(
        locked_state.from_state(host_board.text(sim.params.fpga, model), reset)
    )
    (folder / "rtl").mkdir()
    for path in (*library.sources(RTL), *(RTL / f"{stem}.v" for stem in stems)):
        shutil.copyfile(path, folder / "rtl" / path.name)
    shutil.copyfile(BOARD, folder / "board.h")
    for path in (*TEMPLATES.iterdir(), *(TEMPLATES / bus).iterdir()):
        if path.is_file():
            shutil.copyfile(path, folder / path.name)


def export(folder, config, bus="spi"):
    """Write the folder of a configuration; one that was written before is replaced. Paths of what to open first.

    bus  "spi" or "axi"
    ConfigError for another bus, and a board that the C++ plant leaves out; FileError if the folder holds anything else
    """
    if bus not in BUSES:
        raise ConfigError(f"gyro host: --bus {bus}: one of {', '.join(BUSES)} is needed")
    folder = Path(folder)
    with replace_folder(folder, MARK) as new:
        write_loop(new, *locked_simulation(config), bus)
        register_map.export(new / "map", config)
    return [folder / name for name in OPEN_FIRST]
