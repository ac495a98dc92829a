"""Phase budget: what contributes to xe1, xe2, ye1, ye2, in clocks, ns and degrees, from the configuration alone.

    node phase   xe1 = signal path (theta to force voltage) - reference path (theta to pin)
                 xe2 = ring-diode pole + op-amp poles                                       (y likewise)
    loop phase   xe2' = xe2 - what the demodulator's own switching delays the reference

A register counts one clock, a pole arctan(2 pi f tau), a hold half its length. The hold of the DAC delays its own
signal; a reference that is re-timed on the 1 MHz grid is delayed by the mean wait for the next tick. Rows say which
entries are assumptions about the paper's hardware. Nothing here is read by the simulation.
Source  docs/phases.md
"""

import math
from types import MappingProxyType
from typing import Any, NamedTuple

from analog_frontend import amplifier_use, ring_levels
from analog_frontend.parts import propagator, thermal
from fpga_model import dds, references, sine, spi_dac
from fpga_model.design_record import DEFAULT
from testbench.arguments import number
from testbench.config import TEMPS_DEGC, changed, require_config
from testbench.engines import chips
from testbench.errors import ConfigError
from testbench.run import build, design_check

PAPER_DEG = {"xe1": 3.7647, "xe2": 1.2459, "ye1": 8.8814, "ye2": 1.5560}
NODES = tuple(PAPER_DEG)
PRODUCT_AND_CODE_CLOCKS = 2
SID_GAIN = 4 / math.pi
USER_VALUE = "given"
WORDS = {
    "xe1": ("phase_drive_sine_deg", "phase_drive_ref_deg"),
    "ye1": ("phase_sense_sine_deg", "phase_sense_ref_deg"),
}


class Row(NamedTuple):
    """One contribution: lag in seconds and degrees at the drive frequency; `assumed` names why it is no fact, or ''."""

    what: str
    seconds: float
    degrees: float
    assumed: str = ""
    clock_hz: float = DEFAULT.master_hz  # nominal

    @property
    def clocks(self):
        return self.seconds * self.clock_hz

    @property
    def ns(self):
        return self.seconds * 1e9

    @property
    def is_assumed(self):
        return bool(self.assumed) and not self.is_user_value

    @property
    def is_user_value(self):
        return self.assumed.startswith(USER_VALUE)


class Rows(NamedTuple):
    """Makes the rows of a budget at a frequency (Hz), with the firmware's clock (Hz): the true one, the nominal one."""

    f: float
    clock_hz: float
    nominal_hz: float

    def delay(self, what, seconds, assumed=""):
        return Row(what, seconds, 360.0 * self.f * seconds, assumed, self.nominal_hz)

    def clocks(self, what, count, assumed=""):
        return self.delay(what, count / self.clock_hz, assumed)

    def pole(self, what, tau_s, assumed=""):
        angle = math.atan(2 * math.pi * self.f * tau_s)
        return Row(what, angle / (2 * math.pi * self.f), math.degrees(angle), assumed, self.nominal_hz)

    def word(self, what, degrees):
        return Row(what, degrees / 360.0 / self.f, degrees, "", self.nominal_hz)


class Budget(NamedTuple):
    """Rows per node, the extra rows that make the loop phase of xe2 and ye2, and the frequency they hold at."""

    frequency_hz: float
    rows: dict
    loop_rows: dict
    paper_deg: dict  # what the paper measured; None for each node of another board
    ring: str  # where the ring diode leaves 1 %
    amplifiers: tuple = ()  # amplifier_use.Use of each
    dac_notes: tuple = ()  # (node, line) of `build.dac_notes`
    nonzero_words: Any = MappingProxyType({})  # {node: keys of the compensation words that displace it}

    def node_deg(self):
        return {node: _wrap_degrees(sum(row.degrees for row in self.rows[node])) for node in self.rows}

    def loop_deg(self):
        node = self.node_deg()
        return {name: _wrap_degrees(node[name] + sum(r.degrees for r in rows)) for name, rows in self.loop_rows.items()}


def _nonzero_words(firmware):
    return {node: tuple(f"firmware.{name}" for name in names if getattr(firmware, name))
            for node, names in WORDS.items()}  # fmt: skip


def _wrap_degrees(deg):
    return deg if -180.0 <= deg <= 180.0 else (deg + 180.0) % 360.0 - 180.0


def lock_frequency_hz(fx_hz, qx, xe1_deg, xe2_loop_deg):
    """f_x - f_x/(2Q) tan(xe1 + xe2'): where the frequency loop settles."""
    return fx_hz - fx_hz / (2 * qx) * math.tan(math.radians(xe1_deg + xe2_loop_deg))


def pickoff_poles_s(base, channel, temp_degc):
    """Poles (s) between a mode and its C/V output: ring diode at small signals, instrumentation amplifier, driver."""
    device = thermal.device_at_temperature(base, temp_degc)
    gains = (device.ina_noise_gain, device.driver_noise_gain)
    _, tau_s = propagator.cv_chain(base, channel, temp_degc)
    return tau_s, *(gain / (2 * math.pi * device.opamp_gbw_hz) for gain in gains)


def _path_register_rows(firmware, channel, at):
    """Rows of the registers that one path has beyond the other."""
    counts = {"before": getattr(firmware, f"{channel}_sine_registers")}
    counts["after"] = getattr(firmware, f"{channel}_code_registers")
    return [at.clocks(f"registers {where} the product, this path only", n) for where, n in counts.items() if n]


def _origin(text, section, *keys):
    """`text`, or USER_VALUE where a section differs from its defaults."""
    user_keys = [key for key in keys if getattr(section, key) != type(section).model_fields[key].default]
    if not user_keys:
        return text
    return USER_VALUE if len(keys) == 1 else f"{USER_VALUE}: {', '.join(user_keys)}"


def _switch(firmware, device, tick_clocks, at, assumed):
    """The row that makes a loop phase of a node: where the demodulator switches."""
    if firmware.board == "analog_sid":
        mean_s = device.sid_switch_s + device.sid_fall_s / 2
        return at.delay("reference: analog switch", -mean_s, assumed)
    if firmware.reference_retimed:
        return at.clocks("reference: sampled one tick after the grid, minus half a sample", -tick_clocks / 2)
    return at.clocks("reference: mean wait for the sample, minus half a sample", -0.5)


def setpoint_amplitude_m(config, temp_degc):
    """Drive amplitude (m) at which a ring that saturates shows the demodulator the set-point. ValueError: none does."""
    device = config.device()
    demodulated_v = build.nominal(config)["v_per_um"] * config.firmware.amplitude_um / (SID_GAIN * device.signal_gain)
    return ring_levels.amplitude_m(device, temp_degc, abs(demodulated_v))


def _ring_note(config, temp_degc):
    """Where the ring diode leaves 1 %, and what the plant makes of it."""
    device = config.device()
    ring_text = f"Ring diode: its gain is reduced by 1 % at {1e6 * ring_levels.limit_m(device, temp_degc):.3g} um "
    ring_text += f"({temp_degc:g} degC, accurate to 8 %); set-point {config.firmware.amplitude_um:g} um"
    if device.ring_saturation_on:
        amplitude_um = 1e6 * setpoint_amplitude_m(config, temp_degc)
        return f"{ring_text}, held at {amplitude_um:.4g} um. It saturates in this plant (plant.ring_saturation_on = 1)."
    return f"{ring_text}. The plant keeps it linear (plant.ring_saturation_on = 0)."


def ring_warnings(config):
    """Line: the set-point is beyond 1 % of a ring diode that the plant keeps linear."""
    device, temp_degc = config.device(), _first_temp_degc(config)
    if not device.ring_saturation_on and config.firmware.amplitude_um > 1e6 * ring_levels.limit_m(device, temp_degc):
        yield f"{_ring_note(config, temp_degc)} Choose a smaller amplitude_um."


def _amplifiers(config, temp_degc, f_hz):
    """What the amplifiers are asked for: C/V, drive outputs at the kick and at lock, sense outputs."""
    base, firmware = config.device(), config.firmware
    warm, tick_s = thermal.device_at_temperature(base, temp_degc), 1 / config.design_record().tick_hz
    moves_m, w = 1e-6 * firmware.amplitude_um, 2 * math.pi * f_hz
    if base.ring_saturation_on:
        moves_m = setpoint_amplitude_m(config, temp_degc)
    full_v = max(firmware.kick_v, firmware.drive_ceiling_v) / config.nominal.drive_dac_span_v * warm.drive_dac_span_v
    lock_n, n_per_v = warm.mass_kg * w**2 * moves_m / warm.qx, abs(warm.k_vf_drive_n_per_v)
    lock_v = lock_n / n_per_v if lock_n < n_per_v * full_v else full_v
    drive, sense = warm.drive_pole_1_s, warm.sense_pole_1_s
    return (
        amplifier_use.pickoff(base, temp_degc, moves_m, f_hz),
        amplifier_use.output(warm, "drive outputs, kick", full_v, drive, f_hz, tick_s),
        amplifier_use.output(warm, "drive outputs, lock", lock_v, drive, f_hz, tick_s),
        amplifier_use.output(warm, "sense outputs, full scale", warm.sense_dac_span_v, sense, f_hz, tick_s),
    )


def _pickoff_rows(config, channel, at, temp_degc, fitted):
    base, plant = config.device(), config.plant
    ring_s, ina_s, driver_s = pickoff_poles_s(base, channel, temp_degc)
    if base.ring_saturation_on:
        moves_m = setpoint_amplitude_m(config, temp_degc) if channel == "drive" else 0.0
        ring_s = ring_levels.delay_s(base, channel, temp_degc, moves_m)
    capacitors = _origin(f"{fitted}capacitors", plant, "c0_f", "cp_f", f"cref_{channel}_f")
    ina, driver = (
        _origin(f"{fitted}gain split", plant, "opamp_gbw_hz", f"{amplifier}_noise_gain")
        for amplifier in ("ina", "driver")
    )
    return [
        at.pole("ring diode with its capacitors", ring_s, capacitors),
        at.pole("instrumentation amplifier", ina_s, ina),
        at.pole("unity driver", driver_s, driver),
    ]


def _first_temp_degc(config):
    start = config.scenario.temperature_degc
    return start if isinstance(start, (int, float)) else start[0][1]


def budget(config, temp_degc=None, frequency_hz=None):
    """Phase budget; temp_degc None: the scenario's first temperature, frequency_hz None: f_x."""
    design_check.check(require_config(config))
    if temp_degc is None:
        temp_degc = _first_temp_degc(config)
    temp_degc = number("temp_degc", temp_degc, *TEMPS_DEGC, "degC")
    firmware, base = config.firmware, config.device()
    device = thermal.device_at_temperature(base, temp_degc)
    design, board = config.design_record(), chips.dac_chips(config.design)
    tick_clocks, clock_hz = design.tick_clocks, design.master_hz * (1 + 1e-6 * device.clock_ppm)
    tick_us, grid = f"{1e6 / design.tick_hz:g} us", f"{1e-6 * design.tick_hz:g} MHz"
    f = device.fx_hz if frequency_hz is None else number("frequency_hz", frequency_hz, 1.0, 1e6, "Hz")

    at = Rows(f, clock_hz, design.master_hz)
    fitted = "fitted: " if config.is_paper_board else ""  # what the default board has for the paper's phases
    typical = f"{fitted}typical value"

    def signal(channel, chip, frames, delay_s, words_deg):
        sine_deg, ref_deg = words_deg
        poles = [getattr(device, f"{channel}_pole_{n}_s") for n in (1, 2, 3)]
        align = firmware.reference_registers
        extra = _origin(f"{fitted}one frame in the sense path", firmware, f"frame_latency_{channel}")
        response = _origin("recalled from a data sheet" if delay_s else "", config.plant, f"{channel}_dac_delay_s")
        depth = _origin(f"{fitted}pipeline depth of 3 net", firmware, "reference_registers")
        rows = [
            at.clocks("DDS output register", dds.LATENCY),
            at.clocks("sine pipeline", sine.LATENCY),
            at.clocks("extra pipeline registers", firmware.pipeline_registers),
            *_path_register_rows(firmware, channel, at),
            at.clocks("product and code registers", PRODUCT_AND_CODE_CLOCKS),
            at.clocks("SPI load register", 1),
            at.clocks("SPI frame to latch", spi_dac.latch_cycles(chip, tick_clocks)),
            at.clocks(f"extra {tick_us} frames", frames * tick_clocks, extra if frames else ""),
            at.clocks(f"hold of the {grid} update, half a period", tick_clocks / 2),
            at.delay("DAC response after its latch", delay_s, response),
            *(
                at.pole(f"output pole {n}", tau, _origin(typical, config.plant, f"{channel}_pole_{n}_s"))
                for n, tau in enumerate(poles, 1)
            ),
            at.clocks("reference: DDS output register", -dds.LATENCY),
            at.clocks("reference: sign register", -references.LATENCY),
            at.clocks("reference: alignment registers", -align, depth if align else ""),
            at.clocks("reference: edge quantisation, mean", -0.5),
        ]
        if firmware.reference_retimed:
            wait = f"reference: wait for the {grid} grid, mean"
            rows.append(at.clocks(wait, -(tick_clocks + 1) / 2, f"{fitted}re-timed references"))
        if sine_deg or ref_deg:
            rows.append(at.word("compensation words (sine, reference)", ref_deg - sine_deg))
        return rows

    switch_origin = _origin(typical, config.plant, "sid_switch_s", "sid_fall_s")
    switch = [_switch(firmware, device, tick_clocks, at, switch_origin)]
    drive_words = (firmware.phase_drive_sine_deg, firmware.phase_drive_ref_deg)
    sense_words = (firmware.phase_sense_sine_deg, firmware.phase_sense_ref_deg)
    return Budget(
        f,
        {
            "xe1": signal(
                "drive", board.drive.master, firmware.frame_latency_drive, device.drive_dac_delay_s, drive_words
            ),
            "xe2": _pickoff_rows(config, "drive", at, temp_degc, fitted),
            "ye1": signal(
                "sense", board.sense.master, firmware.frame_latency_sense, device.sense_dac_delay_s, sense_words
            ),
            "ye2": _pickoff_rows(config, "sense", at, temp_degc, fitted),
        },
        {"xe2": switch, "ye2": switch},
        dict(PAPER_DEG) if config.is_paper_board else dict.fromkeys(NODES),
        _ring_note(config, temp_degc),
        _amplifiers(config, temp_degc, f),
        tuple(({"drive": "xe1", "sense": "ye1"}[channel], line) for channel, line in build.dac_notes(config)),
        _nonzero_words(firmware),
    )


def budgets(config):
    """Budget, and the budget without the two assumptions about the paper's firmware. Raises ConfigError."""
    plain = {"reference_retimed": False, "frame_latency_drive": 0, "frame_latency_sense": 0}
    try:
        return budget(config), budget(changed(config, {f"firmware.{key}": value for key, value in plain.items()}))
    except ValueError as problem:
        raise ConfigError(problem) from None
