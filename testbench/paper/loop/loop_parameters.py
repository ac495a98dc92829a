"""What the loops around the sense mode are made of: numbers of the linear model, each from the part that has it.

    phases      from `budget` (registers, frames, holds, poles, words); the output chain's own poles are in `chain_s`
    gains       C/V from the ring diode, force from the transducer, words and codes from the converters' spans
    firmware    kp and ki as quantised for the PI; the clock at which a new word acts, from its slots and registers

Left out     back action on the drive mode (y is nulled), images of hold and demodulator beyond their fundamental
Source       docs/loop.md
"""

import math
from typing import NamedTuple

from analog_frontend import ring_levels
from analog_frontend.parts import propagator, sid, thermal
from analog_frontend.parts.cv_noise import cv_density
from analog_frontend.parts.noise import thermomechanical_density
from fpga_model import isqrt, modulator, pi, rates, sine, spi_adc, spi_dac
from fpga_model.design_record import DEFAULT
from testbench.config import Design
from testbench.config.config_errors import number_limits
from testbench.engines import chips
from testbench.errors import ConfigError
from testbench.run import build, design_check
from testbench.run.budget import budget, lock_frequency_hz

WORD_READY_SLOT = rates.SLOT_LOOPS + 2  # error, then PI; the sum stands one clock later
PRODUCT_AND_CODE_CLOCKS, LOAD_CLOCKS = 2, 1
RAW_GAIN = 2.0**pi.COEF.f


class LoopParameters(NamedTuple):
    """Numbers of the loops; angles in rad, lags positive; reference: the drive's sgn(sin) pin, mean instant."""

    tick_hz: float  # updates of the DACs
    frame_s: float  # one conversion, one step of the controllers
    samples: int  # of the converter's modulator, in a frame
    w_rad_s: float  # drive frequency, where the frequency loop holds it
    wy_rad_s: float
    qy: float
    mass_kg: float
    coriolis_mass_kg: float
    amplitude_m: float  # of x, as its loop holds it
    xe2_rad: float  # loop phase of the drive C/V: x leads the pin by it
    ye1_rad: float  # node phase: sense pin to force, chain included
    sense_turn_rad: float  # by which the sense references are ahead of the drive's
    chain_s: tuple  # three poles of the sense output
    volts_per_word: float  # electrode voltage per LSB of the force word, droop of the hold included
    dac_lsb_v: float  # of the sense converter
    word_per_code: int  # LSB of the force word to one of the sense converter
    k_vf_n_per_v: float
    cv_v_per_m: float
    cv_s: tuple  # ring diode, instrumentation amplifier, driver
    switch_rad: float
    sid_gain: float  # volts per volt of in-phase amplitude
    sid_hz: float  # corner of each stage
    sid_stages: int
    sid_switched: bool  # two groups of capacitors take turns; False: a plain low-pass behind a sign
    sid_offset_v: tuple  # of the sine and cosine channel, by charge injection
    code_per_v: float
    step_code: float
    word_kp: float
    word_ki: float  # per frame
    word_acts_s: float  # in the frame after the conversion's: when a new word reaches the electrode's chain
    u_ki: float  # per frame
    u_full_n_per_m: float  # stiffness that u = 2^32 takes away
    u_rail: float  # largest u (LSB)
    quad_span_v: float
    v_q_lsb_v: float  # of the quadrature converter
    kxy_n_per_m: float
    dxy_n_s_per_m: float
    cv_noise_v_per_rthz: float  # at the demodulator's input
    flicker_v_per_rthz: float  # behind it, at 1 Hz
    adc_noise_v: float  # rms of a conversion
    dac_noise_v_per_rthz: float
    force_noise_n_per_rthz: float

    @property
    def split_hz(self):
        return (self.w_rad_s - self.wy_rad_s) / (2 * math.pi)


def _check_tick(record, frame_s):
    clocks, remainder_hz = divmod(record.master_hz, DEFAULT.tick_hz)
    low, high = number_limits(Design.model_fields["tick_clocks"])
    if not remainder_hz and low <= clocks <= high and abs(record.frame_ticks / DEFAULT.tick_hz - frame_s) <= 1e-12:
        raise ConfigError(
            f"design.tick_clocks = {record.tick_clocks} clocks of {1e-6 * record.master_hz:g} MHz is "
            f"{1e6 / record.tick_hz:.4g} us; for {1e-6 * DEFAULT.tick_hz:g} MHz set tick_clocks = {clocks:g}"
        )


def _check(config):
    design_check.check(config)
    device, needed_s = config.device(), 1 / config.design_record().frame_hz
    if config.firmware.board != "analog_sid":
        raise ConfigError(
            f'firmware.board = "{config.firmware.board}": the loop analysis needs "analog_sid", whose demodulator it '
            "describes"
        )
    if config.firmware.adc_clock != "synchronous":
        raise ConfigError(f'firmware.adc_clock = "{config.firmware.adc_clock}": the loop analysis needs "synchronous"')
    frame_s = device.adc_decimation / device.adc_modulator_hz
    if abs(frame_s - needed_s) > 1e-12:
        _check_tick(config.design_record(), frame_s)
        raise ConfigError(
            f"plant.adc_decimation = {device.adc_decimation}: a conversion every {1e6 * frame_s:g} us; "
            f"the loop analysis needs {1e6 * needed_s:g} us, one frame of [design]"
        )
    return device


def word_acts_s(config):
    """Instant in a frame at which the word of the conversion before it begins to act at the sense DAC's output (s).

    last sample, DRDY, serial read, slots to the PI's sum; next product; registers, frames, latch, response
    """
    device, record, chip = config.device(), config.design_record(), chips.dac_chips(config.design).sense
    last_sample_clock = (device.adc_decimation - 1) * record.master_hz / device.adc_modulator_hz
    ready = math.ceil(last_sample_clock + (build.CONVERSION_DELAY_S + device.adc_delay_s) * record.master_hz)
    sum_ready_clock = ready + spi_adc.read_clocks(record) + WORD_READY_SLOT
    product = math.ceil(sum_ready_clock / record.tick_clocks) * record.tick_clocks
    clocks = (
        product
        + PRODUCT_AND_CODE_CLOCKS
        + config.firmware.frame_latency_sense * record.tick_clocks
        + LOAD_CLOCKS
        + config.firmware.sense_code_registers
        + spi_dac.latch_cycles(chip.master, record.tick_clocks)
    )
    return (clocks - record.frame_clocks) / record.master_hz + device.sense_dac_delay_s


def _by_design(config, device, f_hz):
    """(fields of `LoopParameters` that [design] decides, what the hold over a tick leaves of a tone at f)."""
    record, code_bits = config.design_record(), chips.dac_chips(config.design).sense.bits
    turn, full_sine = math.pi * f_hz / record.tick_hz, sine.OUT.for_design(record)
    grid = math.sin(turn) / turn
    return {
        "tick_hz": record.tick_hz,
        "frame_s": 1 / record.frame_hz,
        "samples": device.adc_decimation,
        "volts_per_word": device.sense_dac_span_v / 2**23 * grid * full_sine.hi / 2**full_sine.f,
        "dac_lsb_v": device.sense_dac_span_v / 2 ** (code_bits - 1),
        "word_per_code": 2 ** (modulator.AMPLITUDE.width - code_bits),
    }, grid


def loop_parameters(config, temp_degc=None):
    """`LoopParameters` of a configuration at `temp_degc` (default: the scenario's first temperature).

    Raises ConfigError for the board or the converter clock that this analysis is not made for, and for a [design]
    that cannot work.
    """
    device = _check(config)
    start = config.scenario.temperature_degc
    if temp_degc is None:
        temp_degc = start if isinstance(start, (int, float)) else start[0][1]
    warm = thermal.device_at_temperature(device, temp_degc)
    first = budget(config, temp_degc)
    f_hz = lock_frequency_hz(warm.fx_hz, warm.qx, *_lock_phases(first))
    phases = budget(config, temp_degc, f_hz)
    node, loop = phases.node_deg(), phases.loop_deg()
    w = 2 * math.pi * f_hz
    nominal, gains = build.nominal(config), build.firmware(config).control
    per_gbw = 1 / (2 * math.pi * warm.opamp_gbw_hz)
    amplifiers = (warm.ina_noise_gain * per_gbw, warm.driver_noise_gain * per_gbw)
    drive_gain, drive_ring = propagator.cv_chain(device, "drive", temp_degc)
    sense_gain, sense_ring = propagator.cv_chain(device, "sense", temp_degc)
    by_design, grid = _by_design(config, device, f_hz)
    edges = grid if config.firmware.reference_retimed else 1.0
    passed = math.prod(math.cos(math.atan(w * tau)) for tau in (drive_ring, *amplifiers))
    output_v_per_um = drive_gain * device.signal_gain * passed * 4 / math.pi * edges * 1e-6
    drive_full_v = device.adc_vref_v / device.adc_pga_drive
    setpoint_fraction = config.firmware.amplitude_um * nominal["v_per_um"] / nominal["adc_drive_v"]
    amplitude_um = setpoint_fraction * drive_full_v / output_v_per_um
    if device.ring_saturation_on:
        linear_v = abs(drive_gain) * amplitude_um * 1e-6
        amplitude_um = 1e6 * ring_levels.amplitude_m(device, temp_degc, linear_v)
    words = config.firmware
    inject = sid.device_injection_volts(warm)
    rc_s = warm.sid_r_ohm * warm.sid_c_f
    # on-time means are raised by 2 Q R f a stage, and the last capacitor is held a quarter of its jump above its mean
    unequal = [a - b for a, b in zip(inject[:3], inject[3:])]
    offset_v = sum(unequal) * 2 * rc_s * f_hz + unequal[2] / 4
    on = config.noise
    damping = warm.mass_kg * 2 * math.pi * warm.fy_hz / warm.qy
    force_noise = thermomechanical_density(damping, temp_degc)
    return LoopParameters(
        **by_design,
        w_rad_s=w,
        wy_rad_s=2 * math.pi * warm.fy_hz,
        qy=warm.qy,
        mass_kg=warm.mass_kg,
        coriolis_mass_kg=warm.coriolis_mass_kg,
        amplitude_m=amplitude_um * 1e-6,
        xe2_rad=math.radians(loop["xe2"]),
        ye1_rad=math.radians(node["ye1"]),
        sense_turn_rad=math.radians(words.phase_sense_ref_deg - words.phase_drive_ref_deg),
        chain_s=tuple(getattr(warm, f"sense_pole_{n}_s") for n in (1, 2, 3)),
        k_vf_n_per_v=warm.k_vf_sense_n_per_v,
        cv_v_per_m=sense_gain * device.signal_gain,
        cv_s=(sense_ring, *amplifiers),
        switch_rad=w * (device.sid_switch_s + device.sid_fall_s / 2),
        sid_gain=4 / math.pi * edges,
        sid_hz=sid.corner_hz(rc_s),
        sid_stages=sid.STAGES,
        sid_switched=True,
        sid_offset_v=(offset_v, offset_v),
        code_per_v=device.adc_pga_sense / device.adc_vref_v * 2**23,
        step_code=float(device.adc_step_code),
        word_kp=gains.rate_loop.loop.kp / RAW_GAIN,
        word_ki=gains.rate_loop.loop.ki / RAW_GAIN,
        word_acts_s=word_acts_s(config),
        u_ki=gains.quadrature_loop.loop.ki / RAW_GAIN,
        u_full_n_per_m=warm.kq_n_per_m_per_v2 * device.quad_dac_span_v**2,
        u_rail=float(gains.quadrature_loop.loop.hi),
        quad_span_v=device.quad_dac_span_v,
        v_q_lsb_v=device.quad_dac_span_v / 2**isqrt.ROOT.width,
        kxy_n_per_m=warm.kxy_n_per_m,
        dxy_n_s_per_m=warm.dxy_ratio * warm.mass_kg * 2 * math.pi * warm.fx_hz / warm.qx,
        cv_noise_v_per_rthz=cv_density(device, temp_degc) * abs(device.signal_gain) if on.cv else 0.0,
        flicker_v_per_rthz=warm.sid_flicker_v_per_rthz if on.flicker else 0.0,
        adc_noise_v=device.adc_noise_sense_v if on.adc else 0.0,
        dac_noise_v_per_rthz=device.sense_dac_noise_v_per_rthz if on.dac else 0.0,
        force_noise_n_per_rthz=force_noise if on.thermomechanical else 0.0,
    )


def _lock_phases(phases):
    return phases.node_deg()["xe1"], phases.loop_deg()["xe2"]
