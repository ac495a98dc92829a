"""Plant and model edge by edge, for a bench in Python that drives a design itself (cocotb, a board in the loop).

    plant = Plant(config)           power-on
    plant.inputs()                  inputs of the design at the next edge: {name: value}, unsigned
    plant.edge(pins)                after the edge: output pins {name: value}, names of `fpga_model.top.Pins`, and
                                    r_drive_dac_ldac_n, r_quadrature_dac_ldac_n where the design's DAC has that pin
    model = Model(plant)            the firmware's model, given the same inputs
    model.expected()                {port: unsigned value} of every register and pin before the next edge
    model.edge(inputs)              one edge

What a tick does, and in which order, is that of `lockstep.ticks`; a call per edge takes some 0.1 ms.
Source  docs/rtl.md
"""

import math

import numpy as np

from analog_frontend import top as plant
from analog_frontend.parts import adc_serial
from fpga_model import registers
from fpga_model import top as fpga
from fpga_model.jit import kernel
from testbench.engines import engine
from testbench.errors import ConfigError
from testbench.flatten import leaves
from testbench.golden.loop import library
from testbench.run import build

DEG = math.pi / 180
STATUS = adc_serial.status_word()
SENT = 5  # channels of the ADC that are connected


@kernel
def _chips(parts, word_bits, chips, pins, ldacs, loaded, status, codes):
    return engine.chips_after(parts, word_bits, chips, pins, ldacs, loaded, status, codes)


@kernel
def _retune(p, a, rate_rad_s, quad_code, temp_degc):
    plant.retune(p, a, rate_rad_s, quad_code, temp_degc)


@kernel
def _tick(p, a, tick, pins, edges):
    return plant.step(p, a, tick, pins, edges)


@kernel
def _sar_codes(p, a, tick):
    return plant.sar_code(p, a, tick, 0), plant.sar_code(p, a, tick, 1)


@kernel
def _step(p, rom, s, i):
    return fpga.step(p, rom, s, i)


@kernel
def _firmware_pins(p, s):
    return fpga.pins(p, s)


class Plant:
    """Gyroscope, converters and host of a `Config` at a constant rate and temperature, from power-on.

    firmware  `fpga_model.top.Params` of the design, if not those of the configuration
    """

    def __init__(self, config, rate_dps=0.0, temp_degc=25.0, firmware=None):
        if config.scenario.host != "bus":
            raise ConfigError(f'scenario.host = "{config.scenario.host}": this bench supports "bus" only')
        self.params = build.params(config, temp_degc, temp_degc)
        self.firmware = firmware or self.params.fpga
        self.design = self.firmware.design
        self._rate_rad_s, self._temp_degc = rate_dps * DEG, temp_degc
        state = engine.reset(self.params, temp_degc)
        self.chips, self._analog = state.chips, state.plant
        self._writes = [(registers.BY_NAME[name], raw) for name, raw in build.register_writes(config)]
        self._edges = np.zeros((engine.MAX_EDGES, 2), np.int64)
        self.clock, self._drdy_cycle = 0, -1
        self._refs = fpga.pins(self.firmware, fpga.reset(self.design)).refs
        self._begin_tick()

    @property
    def tick(self):
        """Ticks since power-on."""
        return self.clock // self.design.tick_clocks

    def _begin_tick(self):
        a, p = self._analog, self.params.plant
        if self.tick % self.design.frame_ticks == 0:
            _retune(p, a, self._rate_rad_s, self.chips.quadrature.code, self._temp_degc)
        self._given = int(a.sar[0]), int(a.sar[1])
        if self.firmware.digital:
            a.sar[0], a.sar[1] = _sar_codes(p, a, self.tick)
        sent = a.adc.clock[engine.CODES : engine.CODES + SENT]
        self._codes = (*map(int, sent), *[0] * (adc_serial.CHANNELS - SENT))
        self._drive_cycle = self._sense_cycle = -1
        self._edge_count = 0

    def inputs(self):
        """Inputs of the design at the next edge; the host writes one register of the configuration per tick."""
        tick, c = divmod(self.clock, self.design.tick_clocks)
        write, address, data = 0, 0, 0
        if tick < len(self._writes):
            entry, raw = self._writes[tick]
            write, address, data = int(c == 0), entry.address, registers.to_bus(int(raw), entry.fmt)
        design_inputs = fpga.Inputs(
            int(self.chips.adc.drdy_n), int(adc_serial.dout(self.chips.adc)), *self._given, write, address, data
        )
        masks = ((1 << fmt.width) - 1 for fmt in fpga.INPUTS_FMT)
        return {name: value & mask for name, value, mask in zip(fpga.Inputs._fields, design_inputs, masks, strict=True)}

    def edge(self, pins):
        """The converters, and at the end of a tick the gyroscope, after an edge that left these output pins."""
        clocks = self.design.tick_clocks
        c, output_pins = self.clock % clocks, fpga.Pins(**{name: int(pins[name]) for name in fpga.Pins._fields})
        ldacs = tuple(
            int(pins[f"r_{role}_dac_ldac_n"]) if getattr(self.params.chips, role).has_ldac else 1
            for role in ("drive", "quadrature")
        )
        loaded = int(c == self._drdy_cycle)
        word_bits = self.design.adc_word_bits
        self.chips = _chips(self.params.chips, word_bits, self.chips, output_pins, ldacs, loaded, STATUS, self._codes)
        self._drive_cycle = c if self.chips.drive.updated else self._drive_cycle
        self._sense_cycle = c if self.chips.sense.updated else self._sense_cycle
        changed, self._refs = output_pins.refs ^ self._refs, output_pins.refs
        for d in range(4):
            if changed >> d & 1 and self._edge_count < engine.MAX_EDGES:
                self._edges[self._edge_count] = c, d
                self._edge_count += 1
        if c == clocks - 1:
            plant_pins = plant.Pins(
                self.chips.drive.code, self._drive_cycle, self.chips.sense.code, self._sense_cycle, self._edge_count
            )
            self._drdy_cycle = _tick(self.params.plant, self._analog, self.tick, plant_pins, self._edges)
        self.clock += 1
        if self.clock % clocks == 0:
            self._begin_tick()


class Model:
    """The firmware's own model beside a `Plant`, from reset."""

    def __init__(self, plant):
        self._params, self._rom = plant.firmware, plant.params.rom
        self._masks = tuple((1 << fmt.width) - 1 for fmt in library.port_formats(plant.design))
        self.state = fpga.reset(self._params.design)

    def expected(self):
        """{port of gyro_top: unsigned value} of every register and output pin before the next edge."""
        values = [value for _, value in leaves(self.state)] + list(_firmware_pins(self._params, self.state))
        return {port: int(v) & mask for port, v, mask in zip(library.PORTS, values, self._masks, strict=True)}

    def edge(self, inputs):
        """One edge, with what `Plant.inputs` gave."""
        signed = [
            value - (1 << fmt.width) if fmt.s and value > fmt.hi else value
            for value, fmt in zip(inputs.values(), fpga.INPUTS_FMT, strict=True)
        ]
        self.state = _step(self._params, self._rom, self.state, fpga.Inputs(*signed))
