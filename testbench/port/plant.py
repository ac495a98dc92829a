"""The plant of a run from outside: a library and what it is told of the configuration.

    keys     what of [plant], [noise] and [effects] is not at its default and not read: an effect is refused, since the
             run would claim it; all others are listed in `unseen`
    engines  frame and clocked. The parameters of the product's own plant stay in place for what a run says beside it,
             but no kernel reads more of them than the clocks of the converter

Source  docs/plant_port.md
"""

import hashlib

import numpy as np

from analog_frontend.parts import adc, resonator
from analog_frontend.port import foreign
from testbench.config import Config
from testbench.config.toml_text import short_toml, toml_value
from testbench.errors import ConfigError
from testbench.port import plant_loader
from testbench.storage.inputs import read_text

SECTIONS = ("plant", "noise", "effects")
SEED = "noise.seed"  # handed over by itself
CHANNELS = ("drive_sin", "drive_cos", "sense_sin", "sense_cos", "temperature")
MOTIONS = ("x", "vx", "y", "vy")
VELOCITIES = [1, 3]


def configuration_text(config):
    """The configuration as lines "section.key = value" for gyro_plant_create."""
    lines = [
        f"{section}.{key} = {toml_value(value)}"
        for section in SECTIONS
        for key, value in getattr(config, section).model_dump().items()
    ]
    d = config.design_record()
    clock = ("master_hz", d.master_hz), ("tick_clocks", d.tick_clocks), ("frame_ticks", d.frame_ticks)
    return "\n".join([*lines, *(f"clock.{key} = {toml_value(value)}" for key, value in clock), ""])


def reads(keys, name):
    """True if "section.key" is among the keys of a library, or all of its section."""
    return name in keys or f"{name.partition('.')[0]}.*" in keys


def unread(config, keys):
    """{key: value} of what is not at its default and not among the keys that a library reads."""
    default, unread_values = Config(), {}
    for section in SECTIONS:
        section_defaults = getattr(default, section).model_dump()
        for key, value in getattr(config, section).model_dump().items():
            name = f"{section}.{key}"
            if value != section_defaults[key] and name != SEED and not reads(keys, name):
                unread_values[name] = value
    return unread_values


def _check_supported(config, engine):
    """ConfigError for what a plant behind the port cannot do."""
    s = config.scenario
    if engine == "baseband":
        raise ConfigError(
            'scenario.plant: scenario.engine = "baseband" averages the built-in plant; use frame or clocked'
        )
    if config.firmware.board != "analog_sid":
        raise ConfigError('scenario.plant: needs firmware.board = "analog_sid": the port transfers codes of the ADC')
    if any(fault[1] == "plant_nan" for fault in s.faults):
        raise ConfigError(
            "scenario.plant: scenario.faults plant_nan needs the built-in plant; the port has no such fault"
        )


class Plant:
    """A library behind the port for one gyroscope; `params` belong into top.Params."""

    def __init__(self, config, engine):
        _check_supported(config, engine)
        s = config.scenario
        plant_library = plant_loader.open_library(s.plant)
        plant_file_text = read_text(s.plant_file) if s.plant_file else ""
        self.unseen = unread(config, plant_library.keys)
        for key in self.unseen:
            if key.startswith("effects."):
                raise ConfigError(
                    f"{s.plant}: does not read {key} = {short_toml(self.unseen[key])}; remove this effect"
                )
        self.identity = {"plant": plant_library.sha256}
        if s.plant_file:
            self.identity["plant_file"] = hashlib.sha256(plant_file_text.encode()).hexdigest()
        self._instance = plant_loader.Instance(plant_library, configuration_text(config), plant_file_text)
        self.params = foreign.mailboxes(self._instance.step, self._instance.address)

    def power_on(self, params, state, seed, temp_degc):
        """Reset the plant with the codes of a fresh state; FileError if the converter's promise is impossible.

        params, state  of the product's plant; mutates the converter's clock in `state`
        """
        drive, sense = (int(code) for code in state.codes)
        box = self.params
        self._instance.call("reset", int(seed), drive, sense, float(temp_degc), box.adc.ctypes.data)
        first, second = (int(v) for v in box.adc[foreign.DRDY :])
        if not (params.adc.tick_clocks <= first and first + foreign.LEAST_DRDY_INTERVAL <= second):
            self._instance.fail(
                f"gyro_plant_reset: drdy = {first}, {second} clocks; the first falls {params.adc.tick_clocks} clocks "
                f"after power-on or later, the second {foreign.LEAST_DRDY_INTERVAL} or more after it"
            )
        foreign.promise(params.adc, state.adc.clock, first, second)
        self.first_drdy = first

    def finish(self, streams):
        """Put velocities of the truth rows (m/s) into the unit of their columns, m at the reference frequency.

        FileError with one line if the library has failed since power-on.
        """
        streams.truth[:, VELOCITIES] /= resonator.W_RAD_PER_S
        kind, tick, which, value = (int(v) for v in self.params.failed)
        if kind == foreign.NOTHING:
            return
        message_by_kind = {
            foreign.RETURNED: lambda: f"gyro_plant_step: {self._instance.line(value)}",
            foreign.CODE: lambda: f"code of adc_{CHANNELS[which]} is {value}, outside {adc.CODE_LO} .. {adc.CODE_HI}",
            foreign.PROMISE: lambda: (
                f"drdy is {value} clocks, expected {which} as announced before"
                if which >= 0
                else f"drdy is {value} clocks, expected 0 or more"
            ),
            foreign.SHORT_DRDY_INTERVAL: lambda: (
                f"drdy {which} and {value} clocks are less than {foreign.LEAST_DRDY_INTERVAL} apart"
            ),
            foreign.NOT_FINITE: lambda: f"motion {MOTIONS[which]} is not finite",
        }
        self._instance.fail(f"tick {tick}: {message_by_kind[kind]()}")

    def notes(self):
        """Sentences on what runs here, and on what it does not see."""
        plant_library = self._instance.library
        yield f"The plant is {plant_library.path} (sha256 {plant_library.sha256[:16]}), not the built-in plant."
        if self.unseen:
            unread_text = ", ".join(f"{key} = {short_toml(value)}" for key, value in self.unseen.items())
            yield f"This plant does not read, and so does not simulate: {unread_text}."
        if not self.saves:
            yield "No checkpoint and no state are written, because the library exports no gyro_plant_save."

    @property
    def saves(self):
        """True if its state can be kept."""
        return self._instance.saves

    def state(self):
        """{"port": bytes} of a plant that saves its state, else {}."""
        return {"port": self._instance.state()} if self.saves else {}

    def set_state(self, values):
        """Continue from what `state` gave."""
        self._instance.set_state(np.asarray(values["port"]))
