"""Configuration: TOML in, checked values out, one clear line for everything that is wrong.

    [firmware]  what the FPGA is built with           [noise]     sources, one switch each, and the seed
    [nominal]   the board that it is designed for     [scenario]  what happens, in seconds from lock
    [plant]     the board that it meets               [output]    what is written where
    [effects]   imperfections, off by default

Every key carries its unit in its name, its limits and a sentence; `docs/configuration.md` and the error lines are made
from these. Nothing is guessed: a text "5 um" is refused with the number to write instead.
Source  docs/configuration.md
"""

import functools
import re
import tomllib
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import ValidationError, create_model, model_validator

from analog_frontend import dac_levels
from analog_frontend.effects import catalogue
from analog_frontend.parts import adc
from fpga_model import design_record, spi_adc
from fpga_model.design_record import DEFAULT
from testbench.arguments import name_of_file, numpy_to_python
from testbench.config import law_file, scenario
from testbench.config.board import Nominal, Plant, drop_inherited, inherit_nominal
from testbench.config.config_errors import explain
from testbench.config.section import Section, as_validator, number, other
from testbench.config.toml_text import short_toml, toml_value
from testbench.errors import ConfigError
from testbench.storage.inputs import read_toml

TEMPS_DEGC = -55.0, 125.0  # ambient temperatures that a part may stand
LIBRARY = "scenario.plant"  # the one key that no file may set: what it names runs here
PERMITTED = ("--plant", "caller", "compared only")  # the option; code that permits it; nothing is built


def _profile(lo, hi, unit):
    return as_validator(lambda value: scenario.profile_points(value, lo, hi, unit))


class _DesignBase(Section):
    """Rates, word lengths and converters of the firmware; what is refused: docs/firmware.md."""

    master_hz: int = number(DEFAULT.master_hz, "Hz", 1_000_000, 200_000_000, "master clock")
    tick_clocks: int = number(
        DEFAULT.tick_clocks, "clocks", 16, 32, "master clocks per tick, the update period of the DACs"
    )
    frame_ticks: int = number(DEFAULT.frame_ticks, "ticks", 50, 426, "ticks per frame of the ADC")
    dds_bits: int = number(
        DEFAULT.dds_bits, "bits", 24, 48, "length of phase, frequency words and phase words of the DDS"
    )
    sine_address_bits: int = number(
        DEFAULT.sine_address_bits, "bits", 4, 12, "address length of the quarter-wave table"
    )
    sine_fraction_bits: int = number(
        DEFAULT.sine_fraction_bits, "bits", 1, 12, "fraction bits of the interpolation between table rows"
    )
    sine_bits: int = number(DEFAULT.sine_bits, "bits", 10, 20, "length of the sine, sign included")
    cordic_iterations: int = number(
        DEFAULT.cordic_iterations, "rotations", 8, 24, "rotations of the CORDIC within its 24 clocks"
    )
    cordic_guard_bits: int = number(
        DEFAULT.cordic_guard_bits, "bits", 0, 8, "guard bits of the CORDIC below the LSB of its input and of its phase"
    )
    drive_dac: Literal["DAC8811", "generic"] = other("DAC8811", "chip of the drive DAC")
    sense_dac: Literal["AD5791", "DAC8811", "generic"] = other("AD5791", "chip of the sense DAC")
    quadrature_dac: Literal["DAC82002", "generic"] = other("DAC82002", "chip of the V_q DAC, 16 bits")
    drive_dac_bits: int = number(16, "bits", 8, 16, 'code length of a "generic" drive DAC')
    sense_dac_bits: int = number(20, "bits", 8, 20, 'code length of a "generic" sense DAC')
    adc: Literal["ADS1298", "generic"] = other(
        "ADS1298", "chip of the ADC; its step is plant.adc_step_code, or that of adc_bits"
    )
    adc_bits: int = number(24, "bits", 16, 24, 'code length of a "generic" ADC; codes are left-justified in its words')
    adc_divider: Literal[2, 4, 8] = other(
        DEFAULT.adc_divider, "master clocks per bit of the ADC (SCLK period)", "clocks"
    )
    adc_word_bits: int = number(
        DEFAULT.adc_word_bits,
        "bits",
        16,
        24,
        'length of the status and of each channel on the serial line of a "generic" ADC',
    )
    adc_channels: int = number(DEFAULT.adc_channels, "", 5, 8, 'channels that a "generic" ADC sends after its status')
    adc_tail_clocks: int = number(
        0, "clocks", 0, 511, 'time of CS low after the last bit of a "generic" ADC; 0: the 2.056 us of the ADS1298'
    )
    coefficient_fraction_bits: int = number(24, "bits", 8, 24, "fraction bits of kp and ki of the four loops")
    accumulator_fraction_bits: int = number(
        DEFAULT.accumulator_fraction_bits, "bits", 8, 24, "fraction bits of products and integrators of the four loops"
    )


def _dac_keys(role, of):
    """Keys of the serial frame of a DAC; but for the divider they need "generic"."""
    latches = Literal["SYNC", "LDAC", "load"]
    return {
        f"{role}_dac_divider": (int, number(1, "clocks", 1, 4, f"master clocks per bit of the {of} DAC (SCLK period)")),
        f"{role}_dac_frame_bits": (
            int,
            number(0, "bits", 0, 24, f"serial frame of the {of} DAC; 0: code and tail only"),
        ),
        f"{role}_dac_command": (
            int,
            number(0, "", 0, 65535, "command number, in the bits of the frame before the code"),
        ),
        f"{role}_dac_tail_bits": (int, number(0, "bits", 0, 15, "zero bits of the frame after the code")),
        f"{role}_dac_lead_clocks": (int, number(0, "clocks", 0, 3, "clocks from SYNC low to the first bit")),
        f"{role}_dac_latch": (latches, other("SYNC", "signal that updates the output: SYNC, LDAC, or the next load")),
    }


Design = create_model(
    "Design",
    __base__=_DesignBase,
    __doc__=_DesignBase.__doc__,
    **_dac_keys("drive", "drive"),
    **_dac_keys("sense", "sense"),
    **_dac_keys("quadrature", "V_q"),
)


class Firmware(Section):
    """What the FPGA is built with: structure, loop settings, compensation words."""

    board: Literal["analog_sid", "digital_sid"] = other(
        "analog_sid", "demodulation by the board's analog SID, or in the FPGA after ADCs with one sample per tick"
    )
    pipeline_registers: int = number(0, "registers", 0, 8, "extra registers between sine and modulator, one clock each")
    drive_sine_registers: int = number(
        0,
        "registers",
        0,
        8,
        "further registers between sine and modulator in the drive path only; they delay the phase",
    )
    sense_sine_registers: int = number(
        0, "registers", 0, 8, "further registers between sine and modulator in the sense path only"
    )
    drive_code_registers: int = number(
        0, "registers", 0, 8, "registers after the modulator's product in the drive path only; they delay the code"
    )
    sense_code_registers: int = number(
        0, "registers", 0, 8, "registers after the modulator's product in the sense path only"
    )
    reference_registers: int = number(1, "registers", 0, 3, "registers before the reference pins, one clock each")
    reference_retimed: bool = other(True, "references change only at ticks")
    frame_latency_drive: int = number(0, "frames", 0, 2, "ticks that a drive code waits, each one frame of the DAC")
    frame_latency_sense: int = number(1, "frames", 0, 2, "ticks that a sense code waits, each one frame of the DAC")
    quadrature_update_khz: Literal[500, 1000] = other(
        500,
        "highest update rate of the V_q DAC, every 1, 2, 4 .. ticks; 1000 with 1 MHz ticks violates its SYNC high time",
        "kHz",
    )
    agc_crossover_hz: float = number(3.0, "Hz", 0.01, 100.0, "drive amplitude loop: crossover")
    agc_zero_hz: float = number(0.6, "Hz", 0.001, 100.0, "drive amplitude loop: zero of the PI")
    pll_crossover_hz: float = number(3.0, "Hz", 0.01, 100.0, "drive frequency loop: crossover")
    pll_zero_hz: float = number(0.6, "Hz", 0.001, 100.0, "drive frequency loop: zero of the PI")
    ftr_crossover_hz: float = number(15.0, "Hz", 0.001, 200.0, "force-to-rebalance loop: crossover of the integrator")
    ftr_zero_hz: float = number(100.0, "Hz", 0.01, 4000.0, "force-to-rebalance loop: zero of the PI")
    notch_hz: float = number(0.0, "Hz", 0.0, 1999.0, "notch in the rate output: centre frequency; 0: no notch")
    notch_width_hz: float = number(20.0, "Hz", 0.1, 1000.0, "notch in the rate output: width at -3 dB")
    qsc_crossover_hz: float = number(1.0, "Hz", 0.0001, 50.0, "quadrature loop: crossover of the integrator")
    amplitude_um: float = number(5.0, "um", 1e-3, 100.0, "drive amplitude set-point")
    nominal_frequency_hz: float = number(11002.3, "Hz", 1e3, 50e3, "frequency word at power-on; follows nominal.fx_hz")
    kick_v: float = number(10.0, "V", 1e-3, 20.0, "drive voltage of the kick; follows nominal.drive_dac_span_v")
    kick_s: float = number(0.006, "s", 0.000125, 8.0, "length of the kick")
    decay_s: float = number(
        0.035, "s", 0.000125, 8.0, "time with the drive off after the kick, until the demodulators have settled"
    )
    search_s: float = number(0.06, "s", 0.000125, 0.511, "length of the search: rotation of the drive signal")
    search_limit_hz: float = number(80.0, "Hz", 0.1, 4000.0, "largest frequency correction that the search accepts")
    search_min_v: float = number(0.00576, "V", 1e-6, 1.0, "pickoff signal at the ADC below which the search fails")
    retune_s: float = number(0.03, "s", 0.000125, 8.0, "wait after the search at the corrected frequency")
    acquire_share: float = number(
        0.95,
        "",
        0.1,
        1.0,
        "part of the set-point that ends the ring-up; the loop must reach it without its integrator",
    )
    acquire_timeout_s: float = number(2.0, "s", 0.1, 8.0, "longest ring-up to the set-point, and longest settling")
    drive_ceiling_v: float = number(
        10.0, "V", 1e-3, 20.0, "largest drive voltage of the amplitude loop; follows nominal.drive_dac_span_v"
    )
    pll_limit_hz: float = number(
        100.0, "Hz", 0.01, 4000.0, "largest difference of the frequency from that of the search"
    )
    quadrature_ceiling_v: float = number(
        5.5, "V", 1e-3, 20.0, "largest V_q of the quadrature loop; follows nominal.quad_dac_span_v"
    )
    sense_lock_dps: float = number(
        5.0, "deg/s", 1e-3, 1e4, "residual rate and quadrature below which their loops count as locked"
    )
    sense_lost_dps: float = number(
        100.0, "deg/s", 1e-3, 1e5, "residual rate and quadrature above which their loops lose lock"
    )
    phase_drive_sine_deg: float = number(0.0, "deg", -180.0, 180.0, "added to the DDS phase of the drive sine")
    phase_sense_sine_deg: float = number(0.0, "deg", -180.0, 180.0, "added to the DDS phase of the sense sine")
    phase_drive_ref_deg: float = number(0.0, "deg", -180.0, 180.0, "added to the DDS phase of the drive references")
    phase_sense_ref_deg: float = number(0.0, "deg", -180.0, 180.0, "added to the DDS phase of the sense references")
    adc_clock: Literal["synchronous", "free_running"] = other(
        "synchronous", "converter clock: from the master clock, or its own oscillator (plant.adc_clock_ppm)"
    )

    def phase_words(self, bits=DEFAULT.dds_bits):
        """The four compensation words of `bits`: drive sine, sense sine, drive references, sense references."""
        degrees = (
            self.phase_drive_sine_deg,
            self.phase_sense_sine_deg,
            self.phase_drive_ref_deg,
            self.phase_sense_ref_deg,
        )
        return tuple(phase_word(angle_deg, bits) for angle_deg in degrees)


def _dac_levels_validator(bits):
    def check(value):
        if not isinstance(value, (list, tuple)):
            raise scenario.Problem("", f"= {short_toml(value)} is not a list of texts")
        for k, text in enumerate(value):
            if not isinstance(text, str):
                raise scenario.Problem(f"[{k}]", f"= {short_toml(text)} is not a text")
            try:
                dac_levels.table([text[:80]], bits)
            except ValueError as problem:
                raise scenario.Problem(f"[{k}]", f"= {problem}") from None

    return as_validator(check)


def _folder(value):
    if not value or "\0" in value:
        raise scenario.Problem("", f"= {short_toml(value)} is not the name of a folder; . is the current one")


def _curve(value):
    numbers = isinstance(value, (list, tuple)) and all(isinstance(v, float) for v in value)
    if not numbers or len(value) > adc.CURVE or not all(abs(v) <= 1e-2 for v in value):
        limits = f"a list of up to {adc.CURVE} numbers within -0.01 .. 0.01"
        raise scenario.Problem("", f"= {short_toml(value)} is not {limits}")


class _EffectsBase(Section):
    """Imperfections on the plant's ports; 0 is bit for bit nothing."""

    duffing_k3_per_um2: float = number(0.0, "1/um^2", -1e-2, 1e-2, "cubic stiffness of the drive mode, k3/k")
    drive_cubic_per_v2: float = number(0.0, "1/V^2", -1e-2, 1e-2, "drive force = k_vf v (1 + c v^2)")
    feedthrough_y: float = number(0.0, "V/V", -1e-2, 1e-2, "drive electrode voltage that reaches the sense C/V output")
    drive_dac_levels: Annotated[Any, _dac_levels_validator(16)] = other(
        [],
        'level errors of the drive DAC: texts such as "element 5/8 = -2.2", "step 2/8 = 0.2", "bit 11 = 0.09"',
        "LSB",
    )
    sense_dac_levels: Annotated[Any, _dac_levels_validator(20)] = other(
        [], "level errors of the sense DAC, in the same form", "LSB"
    )
    adc_curve: Annotated[Any, as_validator(_curve)] = other(
        [],
        "transfer curve of the ADC: up to 13 coefficients of Chebyshev polynomials T2 .. T14, parts of full scale",
        "1",
    )
    adc_turnover: float = number(0.0, "V/V", -1e-3, 1e-3, "turnover error of the four demodulator channels: v + c |v|")
    adc_gain_tc_per_k: float = number(
        0.0, "1/K", -1e-3, 1e-3, "change of the gain of the four channels with the sensor's temperature"
    )
    adc_memory: float = number(0.0, "V/V", -1e-3, 1e-3, "part of a conversion that remains in the next one")
    laws: Annotated[Any, as_validator(scenario.check_laws)] = other(
        [], 'user-defined laws: texts such as "force_x = -2.5e9 x^3"; docs/effects.md'
    )


def _effect_key(effect):
    return float, number(0.0, effect.INFO.unit, -effect.LIMIT, effect.LIMIT, effect.DOC)


Effects = create_model(
    "Effects",
    __base__=_EffectsBase,
    __doc__=_EffectsBase.__doc__,
    **{effect.INFO.name: _effect_key(effect) for effect in catalogue.LAWS},
)


class Noise(Section):
    """Noise sources; each has its own counter-based stream, so switching one leaves the others as they were."""

    thermomechanical: bool = other(True, "force noise of both modes' damping")
    cv: bool = other(True, "voltage noise at the C/V outputs")
    dac: bool = other(True, "voltage noise of the drive and sense DACs")
    adc: bool = other(True, "converter noise")
    flicker: bool = other(True, "1/f noise after the SID")
    jitter: bool = other(True, "jitter of the master clock at DAC and reference edges")
    seed: int = number(1, "", 0, 2**62 - 1, "seed of all noise streams")


class Scenario(Section):
    """What happens. Times count from lock unless `origin` says otherwise, in seconds of the master clock."""

    engine: Literal["frame", "clocked", "baseband"] = other(
        "frame", "engine of the run: frame and clocked give the same bits; baseband averages the plant, for hours"
    )
    origin: Literal["lock", "power_on"] = other("lock", "what `seconds` and all times of this section count from")
    seconds: float = number(2.0, "s", 0.001, 36000.0, "length of the run")
    temperature_degc: Annotated[Any, _profile(*TEMPS_DEGC, "degC")] = other(
        25.0, "ambient temperature: a number, or points [t_s, degC] joined by straight lines", "degC"
    )
    rate_dps: Annotated[Any, _profile(-1000.0, 1000.0, "deg/s")] = other(
        0.0, "angular rate: a number, or points [t_s, deg/s]", "deg/s"
    )
    rate_shape: Literal["linear", "steps"] = other(
        "linear", "points of rate_dps: joined by straight lines (equal times jump), or held until the next"
    )
    register_writes: Annotated[Any, as_validator(scenario.check_register_writes)] = other(
        [], "writes to registers: [[t_s, register, raw value], ...]"
    )
    host: Literal["bus", "spi"] = other(
        "bus", "how registers are written: at once on the bank's bus, or by frames at the SPI pins of the host port"
    )
    faults: Annotated[Any, as_validator(scenario.check_faults)] = other(
        [], "faults: [[t_s, kind, channel, value, duration_s], ...]; gyro config --faults prints the kinds"
    )
    diagnose: bool = other(
        True, "end with a rate step and an open sense loop, which measure scale factor and all phases"
    )
    plant: str = other("", "library that replaces the built-in plant; only --plant sets it: docs/plant_port.md")
    plant_file: str = other("", "text file that is passed to this library")
    resume: str = other("", "state file to start from instead of power-on")
    across_versions: bool = other(False, "continue a state that another version of the code saved; the record says so")

    @model_validator(mode="after")
    def _check_schedule(self):
        scenario.check_times(self)
        return self


class Output(Section):
    """What is written where."""

    directory: Annotated[str, as_validator(_folder)] = other("out", "folder for all files of a run")
    record: bool = other(True, "HDF5 record, run.h5")
    columns: Annotated[Any, as_validator(scenario.check_columns)] = other(
        [], "columns of the record; an empty list means all"
    )
    decimate: int = number(1, "frames", 1, 8000, "frames per row of the record; above 1, codes and words are sums")
    checkpoint_s: float = number(60.0, "s", 0.0, 36000.0, "simulated time between checkpoints; 0 writes none")
    pictures: bool = other(True, "PNG pictures")
    html: bool = other(True, "report in one HTML file, run.html")
    state: bool = other(True, "final state, state.h5, for `resume`")
    vcd_start_us: float = number(0.0, "us", 0.0, 3.6e10, "start of the waveform window, from power-on")
    vcd_length_us: float = number(0.0, "us", 0.0, 10000.0, "length of the waveform window; 0 writes none")


class Config(Section):
    """Everything a run depends on."""

    design: Design = Design()
    firmware: Firmware = Firmware()
    nominal: Nominal = Nominal()
    plant: Plant = Plant()
    effects: Effects = Effects()
    noise: Noise = Noise()
    scenario: Scenario = Scenario()
    output: Output = Output()

    @model_validator(mode="after")
    def _check_key_dependencies(self):
        if self.firmware.adc_clock == "synchronous" and self.plant.adc_clock_ppm:
            raise scenario.Problem(
                "plant.adc_clock_ppm",
                f'= {self.plant.adc_clock_ppm:g} needs firmware.adc_clock = "free_running"; it is "synchronous"',
            )
        if self.scenario.plant_file and not self.scenario.plant:
            raise scenario.Problem("scenario.plant_file", "needs scenario.plant, the library that reads this file")
        return self

    def design_record(self):
        """Rates and word lengths of the firmware as the record that all of it is built from."""
        record = design_record.Design(*(getattr(self.design, key) for key in design_record.Design._fields))
        return record._replace(adc_tail_clocks=record.adc_tail_clocks or spi_adc.tail_clocks(record.master_hz))

    def device(self):
        """The plant's parameters as the record that the plant is built from; the steps of a "generic" ADC included."""
        device = self.plant.device()
        if self.design.adc == "generic":
            return device._replace(adc_step_code=1 << (adc.CODE_BITS - self.design.adc_bits))
        return device

    def nominal_device(self):
        """Likewise of the board that the firmware is designed for."""
        return self.nominal.device()

    @property
    def is_paper_board(self):
        """True if the firmware is designed for the paper's board, the default one: only then do we compare with it."""
        return self.nominal_device() == Nominal().device() and self.design == Design()


def require_config(config):
    """The configuration itself; ConfigError for what is none."""
    if not isinstance(config, Config):
        raise ConfigError(f"config = {config!r} is not a configuration; config.load(path) reads one")
    return config


def phase_word(angle_deg, bits=DEFAULT.dds_bits):
    """Angle as an unsigned word of `bits`, to the nearest LSB; exact, so that 90 deg is a quarter of 2**bits."""
    return round(Fraction(angle_deg) * (1 << bits) / 360) % (1 << bits)


# ---- reading ---------------------------------------------------------------------------------------------------------


class Override(NamedTuple):
    """A value given outside the file: dotted path, TOML text or value, and the name of the option that gave it."""

    path: str
    value: Any
    source: str = "--set"


def parse_set(text):
    """Override from the text of `--set`: dotted path, =, TOML value; a bare word counts as text."""
    path, equals, value = text.partition("=")
    path, value = path.strip(), value.strip()
    if control := re.search(r"[\0\r\n]", value):
        raise ConfigError(f"--set: {text!r} has {control[0]!r} in its value; write one --set for each key")
    if not equals or not re.fullmatch(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+", path):
        raise ConfigError(f"--set: {text!r} is not of the form section.key=value, such as plant.fx_hz=11010")
    try:
        return Override(path, tomllib.loads(f"value = {value}")["value"])
    except (ValueError, RecursionError):
        return Override(path, value)


def _names(value, path):
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ConfigError(f"{path}: effects.files = {short_toml(value)} is not a list of names of law files")
    return value


def load(path=None, overrides=()):
    """Checked `Config` from a TOML file (or none) and overrides, which win.

    path       file name, or None for the defaults; `effects.files` in it names law files beside it, whose laws are
               taken into `effects.laws`, so that a record carries them
    overrides  `Override`s or texts as of `--set`
    Raises ConfigError with one line.
    """
    if isinstance(overrides, (str, bytes)) or not isinstance(overrides, Iterable):
        raise ConfigError(f"overrides = {overrides!r} is not a list, such as ['plant.fx_hz=11010']")
    tree = {} if path is None else read_toml(name_of_file("path", path))
    origin = {}
    section = tree.get("effects", {})
    if isinstance(section, dict) and "files" in section:
        folder = Path(path).parent
        file_laws = [text for name in _names(section.pop("files"), path) for text in law_file.read(folder / name).laws]
        section["laws"] = [*section.get("laws", []), *file_laws]
    for item in overrides:
        item = parse_set(item) if isinstance(item, str) else item
        if not isinstance(item, Override):
            raise ConfigError(f"overrides: {item!r} is neither a text such as 'plant.fx_hz=11010' nor an Override")
        *sections, key = item.path.split(".")
        node = tree
        for section in sections:
            node = node.setdefault(section, {})
            if not isinstance(node, dict):
                raise ConfigError(f"{item.source}: {item.path}: {section} is a value, not a section")
        node[key] = numpy_to_python(item.value)
        origin[item.path] = item.source
    return from_dict(tree, str(path) if path is not None else "defaults", origin)


def from_dict(tree, source="config", origin=None):
    """Checked `Config` from nested dicts; `origin` names the option that gave a dotted path, if not `source`.

    A library runs here, so neither a file nor --set can name one: `origin` of `scenario.plant` is one of `PERMITTED`.
    """
    scenario_section = tree.get("scenario")
    plant_origin = (origin or {}).get(LIBRARY, source)
    if plant_origin not in PERMITTED and isinstance(scenario_section, dict) and scenario_section.get("plant"):
        raise ConfigError(
            f"{plant_origin}: {LIBRARY} names a library that would be executed; only the option --plant may name one"
        )
    tree, filled = inherit_nominal(tree)
    try:
        return Config.model_validate(tree)
    except ValidationError as problem:
        errors = [e for e in problem.errors(include_url=False) if _error_key(e) not in filled]
        lines = [explain(error, sections(), source, origin or {}) for error in errors]
        more = f" (and {len(lines) - 1} more)" if len(lines) > 1 else ""
        raise ConfigError(lines[0] + more) from None


def _error_key(error):
    """(section, key) that an error of pydantic is about."""
    section, *key = (*error["loc"], *([error["ctx"]["error"].where] if error["type"] == "value_error" else []))
    return section, ".".join(map(str, key)).strip(".")


def changed(config, values, library=False):
    """The same configuration with {"section.key": value, ...} in place, checked as a file would be.

    What equals a key of [nominal] that changes follows it, as what a file does not give would. `library` permits
    `scenario.plant` among the values: a library that runs here.
    """
    if not isinstance(values, dict):
        raise ConfigError(f'values = {values!r} is not a dictionary, such as {{"plant.fx_hz": 11010.0}}')
    for path in values:
        if not isinstance(path, str) or path.count(".") != 1:
            raise ConfigError(f'values: {path!r} is not of the form section.key, such as "plant.fx_hz"')
    tree = drop_inherited(require_config(config).model_dump(), values)
    for path, value in values.items():
        section, key = path.split(".")
        tree.setdefault(section, {})[key] = numpy_to_python(value)
    return from_dict(tree, "changed", {LIBRARY: "caller"} if library or LIBRARY not in values else {})


def placeless(config):
    """The same configuration without where its output lies: what a record and a state keep, the same in any folder."""
    names = {f"scenario.{key}": Path(getattr(config.scenario, key)).name for key in ("plant", "plant_file")}
    return changed(config, {"output.directory": Output().directory} | names, library=True)


@functools.cache
def sections():
    """Section name -> its model."""
    return {name: info.annotation for name, info in Config.model_fields.items()}


def to_toml(config, inherited=True):
    """The whole configuration as TOML, defaults included; `load` gives the same back.

    inherited  with the keys that follow [nominal]
    """
    tree, lines = require_config(config).model_dump(), []
    if not inherited:
        tree = drop_inherited(tree, [f"nominal.{key}" for key in tree["nominal"]])
        lines += ["# Keys of [plant] and [firmware] that are not in this file have the values of [nominal].", ""]
    for section, keys in tree.items():
        if keys:
            values = getattr(config, section)
            lines += [f"[{section}]", *(f"{key} = {toml_value(getattr(values, key))}" for key in keys), ""]
    return "\n".join(lines)
