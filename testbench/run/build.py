"""From a checked configuration to the parameters of the engine: the one place where firmware and plant are designed
together, each by its own `design` functions.

What the firmware's designers know of the gyroscope (`nominal`): the section [nominal], at its temp_ref_degc. The
simulated plant may differ; the tolerances of [nominal] are what the loops must stand.
Source    docs/architecture.md
"""

import functools
import math
from fractions import Fraction

import numpy as np

from analog_frontend import dac_levels, effects, ring_levels, ring_tables
from analog_frontend import top as plant
from analog_frontend.effects import catalogue, drive_cubic, duffing, feedthrough_y, law
from analog_frontend.effects.ports import CV_PORTS
from analog_frontend.parts import adc, cv_noise, dac, noise, propagator, resonator, sid, thermal
from analog_frontend.parts.device import Device
from fpga_model import (
    agc,
    control,
    dds,
    delay,
    digital_sid,
    fault_monitor,
    frequency_tracker,
    lock_monitor,
    modulator,
    notch,
    path_clocks,
    pi,
    quadrature_loop,
    rate_loop,
    rate_output,
    references,
    sequencer,
    sine,
    watchdog,
    wiring,
)
from fpga_model import top as fpga
from testbench.config.toml_text import short_toml
from testbench.engines import chips, engine
from testbench.run import repeated_code_probability

RAD_PER_DEG = math.pi / 180
KNOT_K = 0.5
# Keys that describe a part whose behaviour is fixed elsewhere; another value is refused, not ignored
NOT_READ = {
    "drive_dac_power_on_v": "the chip powers on at code -32768",
    "sense_dac_power_on_v": "the chip's output is clamped to 0 V until its control word",
    "quad_dac_power_on_v": "the chip powers on at code 0",
    "quad_dac_delay_s": "V_q acts at the next 8 kHz frame",
    "diode_rs_ohm": "the averaged model of the ring does not depend on it",
    "bias_v": "k_vf_drive_n_per_v and k_vf_sense_n_per_v include it",
}
CONVERSION_DELAY_S = 1.5e-6  # A  the decimator's last steps; DRDY must not fall before the plant tick is known


def nominal(config):
    """Scale factors that the loops are designed with, from the nominal board (SI units, some per deg/s).

    What a rate gives in the sense code changes its sign with that of fx - fy, and of the sense pickoff. The gains of
    both sense loops follow it. Raises ValueError for a board that these loops cannot hold.
    """
    d = config.nominal_device()
    w = 2 * math.pi * d.fx_hz
    amplitude_m = config.firmware.amplitude_um * 1e-6
    gain, _ = propagator.cv_chain(d, "drive", d.temp_ref_degc)
    if d.ring_saturation_on:
        gain = ring_levels.demodulated_v_per_m(d, d.temp_ref_degc, amplitude_m)
    sense_gain, _ = propagator.cv_chain(d, "sense", d.temp_ref_degc)
    sid_gain = 4 / math.pi
    coriolis_n = 2 * d.coriolis_mass_kg * w * amplitude_m * RAD_PER_DEG
    stiffness = -d.mass_kg * ((2 * math.pi * d.fy_hz) ** 2 - w**2)
    _check_nominal(d, gain * d.signal_gain, sense_gain * d.signal_gain)
    return {
        "v_per_um": gain * d.signal_gain * sid_gain * 1e-6,
        "code_v_per_deg_s": coriolis_n / stiffness * sense_gain * d.signal_gain * sid_gain,
        "word_v_per_deg_s": coriolis_n / d.k_vf_sense_n_per_v,
        "plant_fs_per_s": d.k_vf_drive_n_per_v
        * d.drive_dac_span_v
        / (2 * d.mass_kg * w)
        * gain
        * d.signal_gain
        * sid_gain
        * d.adc_pga_drive
        / d.adc_vref_v,
        "null_deg_per_s": d.kxy_n_per_m * amplitude_m / coriolis_n,
        "null_v": math.sqrt(d.kxy_n_per_m / d.kq_n_per_m_per_v2),
        "adc_drive_v": d.adc_vref_v / d.adc_pga_drive,
        "adc_sense_v": d.adc_vref_v / d.adc_pga_sense,
    }


def _check_nominal(d, drive_gain, sense_gain):
    """ValueError, naming the key of [nominal], for a board whose loops have no gain or the wrong sign."""
    for names, positive, reason in (
        (
            "k_vf_drive_n_per_v * signal_gain * dcdx_f_per_m",
            d.k_vf_drive_n_per_v * drive_gain,
            "the drive loop needs a positive gain",
        ),
        ("kxy_n_per_m", d.kxy_n_per_m, "V_q can cancel only a positive coupling stiffness"),
        ("kq_n_per_m_per_v2", d.kq_n_per_m_per_v2, "V_q must reduce the coupling stiffness"),
        ("coriolis_mass_kg", d.coriolis_mass_kg, "a rate must exert a force on the sense mode"),
    ):
        if not positive > 0:
            raise ValueError(f"nominal.{names} = {positive:g} is not above 0: {reason}")
    for names, other_than_0 in (
        ("fx_hz - fy_hz", d.fx_hz - d.fy_hz),
        ("k_vf_sense_n_per_v", d.k_vf_sense_n_per_v),
        ("signal_gain * dcdy_f_per_m", sense_gain),
    ):
        if not other_than_0:
            raise ValueError(
                f"nominal.{names} = 0: must not be 0, because its sign sets that of the sense loops' gains"
            )


def firmware(config):
    """Parameters of the FPGA. Raises ValueError if two ends of a wire have different formats."""
    f, n, d = config.firmware, nominal(config), config.nominal_device()
    record, board = config.design_record(), chips.dac_chips(config.design)
    wiring.check(record)
    sid_part = digital_sid.design()
    if f.board == "digital_sid":
        sid_part = digital_sid.design(samples_per_dump=record.frame_ticks, frame_hz=record.frame_hz)
    samples_move = repeated_code_probability.sar_alarm(config) < repeated_code_probability.LIMIT
    codes_move = (
        f.board == "analog_sid" and repeated_code_probability.adc_alarm(config) < repeated_code_probability.LIMIT
    )
    fpga_params = fpga.Params(
        digital=1 if f.board == "digital_sid" else 0,
        quadrature_fast=1 if f.quadrature_update_khz == 1000 else 0,
        pipe=delay.design(f.pipeline_registers),
        references=references.design(f.reference_registers, f.reference_retimed),
        drive_modulator=modulator.design(board.drive.bits, f.frame_latency_drive, record),
        sense_modulator=modulator.design(board.sense.bits, f.frame_latency_sense, record),
        drive_dac=board.drive.master,
        sense_dac=board.sense.master,
        quadrature_dac=board.quadrature.master,
        sid=sid_part._replace(still=digital_sid.STILL_TICKS if samples_move else 0),
        watchdog=watchdog.design(record),
        control=control.Params(
            agc=agc.design(
                f.agc_crossover_hz,
                f.agc_zero_hz,
                plant_fs_per_s=n["plant_fs_per_s"],
                ceiling_v=f.drive_ceiling_v,
                kick_v=f.kick_v,
                full_scale_v=d.drive_dac_span_v,
                d=record,
            ),
            frequency_tracker=frequency_tracker.design(f.pll_crossover_hz, f.pll_zero_hz, f.pll_limit_hz, record),
            rate_loop=rate_loop.design(
                f.ftr_crossover_hz,
                f.ftr_zero_hz,
                code_v_per_deg_s=n["code_v_per_deg_s"],
                adc_full_scale_v=n["adc_sense_v"],
                word_v_per_deg_s=n["word_v_per_deg_s"],
                dac_full_scale_v=d.sense_dac_span_v,
                frame_hz=record.frame_hz,
            ),
            quadrature_loop=quadrature_loop.design(
                f.qsc_crossover_hz,
                code_v_per_deg_s=n["code_v_per_deg_s"],
                adc_full_scale_v=n["adc_sense_v"],
                null_deg_per_s=n["null_deg_per_s"],
                null_v=n["null_v"],
                full_scale_v=d.quad_dac_span_v,
                rail_v=f.quadrature_ceiling_v,
                frame_hz=record.frame_hz,
            ),
            sequencer=_sequencer(f, n, codes_move, record),
            notch=notch.design(f.notch_hz, f.notch_width_hz, record.frame_hz) if f.notch_hz else None,
        ),
        design=record,
        paths=path_clocks.design(
            f.pipeline_registers,
            (f.drive_sine_registers, f.sense_sine_registers),
            (f.drive_code_registers, f.sense_code_registers),
            record,
        ),
    )
    return fpga_params._replace(control=_round_loop_gains(fpga_params.control, config.design))


def _round_loop_gains(loops, design):
    """The parameters of the four loops, their gains in the fraction bits of a [design], held by its accumulators."""
    for name in ("agc", "frequency_tracker", "rate_loop", "quadrature_loop"):
        one, key = getattr(loops, name), "coefficient_fraction_bits"
        try:
            loops = loops._replace(
                **{name: one._replace(loop=pi.round_gains(one.loop, design.coefficient_fraction_bits))}
            )
            key = "accumulator_fraction_bits"
            pi.check_accumulator(getattr(loops, name).loop, design.accumulator_fraction_bits)
        except ValueError as problem:
            raise ValueError(f"design.{key}: {name}: {problem}") from None
    return loops


def _sequencer(f, n, codes_move, record):
    """Start-up and lock of a [firmware] section, by the scale factors `n`."""
    residual = {
        f"{loop}_{side}_deg_s": value
        for loop in ("ftr", "qsc")
        for side, value in (("in", f.sense_lock_dps), ("out", f.sense_lost_dps))
    }
    code_per_deg_s = abs(n["code_v_per_deg_s"]) / n["adc_sense_v"] * 2**23
    return sequencer.design(
        kick_s=f.kick_s,
        decay_s=f.decay_s,
        search_s=f.search_s,
        retune_s=f.retune_s,
        timeout_s=f.acquire_timeout_s,
        reached=f.acquire_share,
        search_min_v=f.search_min_v,
        adc_full_scale_v=n["adc_drive_v"],
        search_limit_hz=f.search_limit_hz,
        lock=lock_monitor.design(code_per_deg_s=code_per_deg_s, frame_hz=record.frame_hz, **residual),
        # codes with too little noise may rest, and filtered ones do: nothing is stuck then
        faults=fault_monitor.design(frame_hz=record.frame_hz, **({} if codes_move else {"stuck_s": 0})),
        record=record,
    )


def word_per_deg_s(config):
    """Scale factor of the nominal board (word LSB per deg/s)."""
    return nominal(config)["word_v_per_deg_s"] / config.nominal.sense_dac_span_v * 2**23


def rate_scale(config):
    """RATE_SCALE of the nominal board, or 0 where none that the register holds gives deg/s."""
    words_per_dps = word_per_deg_s(config)
    return rate_output.design(words_per_dps).scale if abs(words_per_dps) >= rate_output.LEAST_WORD_PER_DEG_S else 0


def no_rate_output(config):
    """Lines: that the rate output reads 0, and why."""
    if not config.is_paper_board and rate_scale(config) == 0:
        yield (
            f"the rate output reads 0: the scale factor of {word_per_deg_s(config):.4g} LSB/(deg/s) is below "
            f"{rate_output.LEAST_WORD_PER_DEG_S:.4g}, the minimum for the rate register; read rate_word instead"
        )


def dac_notes(config):
    """(channel, line): another chip has still the analog values of the default one."""
    standard = type(config.design)()
    for channel in ("drive", "sense"):
        dac_key, pole_key = f"{channel}_dac", f"{channel}_pole"
        chip, default = getattr(config.design, dac_key), getattr(standard, dac_key)
        keys = (f"{dac_key}_delay_s", *(f"{pole_key}_{k}_s" for k in (1, 2, 3)), f"{dac_key}_noise_v_per_rthz")
        if chip != default and all(getattr(config.plant, key) == Device._field_defaults[key] for key in keys):
            yield (
                channel,
                f'design.{dac_key} = "{chip}": delay, poles and noise of the output are still those of the default '
                f"{default}; state nominal.{dac_key}_delay_s and {pole_key}_1_s for your chip",
            )


def register_writes(config):
    """Host writes of the first microseconds: (name, raw) of what the configuration sets in the register map."""
    f, n, record = config.firmware, nominal(config), config.design_record()
    # its reset value is that of the paper's board
    scale = () if config.is_paper_board else (("rate_scale", rate_scale(config)),)
    names = ("phase_drive_sine", "phase_sense_sine", "phase_drive_ref", "phase_sense_ref")
    return (
        ("frequency_fixed", dds.word_of_hz(f.nominal_frequency_hz, record)),
        ("amplitude_setpoint", agc.setpoint(f.amplitude_um, n["v_per_um"], n["adc_drive_v"], record)),
        *((name, word) for name, word in zip(names, f.phase_words(record.dds_bits)) if word),
        *scale,
    )


def lsb(config):
    """{column of a record: LSB as text} of the words that a converter of the board turns into volts."""
    d = config.device()
    return {
        "amplitude_word": f"{d.drive_dac_span_v:g} V/2^23",
        "rate_word": f"{d.sense_dac_span_v:g} V/2^23",
        "quadrature_code": f"{d.quad_dac_span_v:g} V/2^16",
    }


# Laws over temperature whose part has one number a run
ONE_TEMPERATURE = (
    "sid_rc_tc_per_k",
    "sid_charge_tc_per_k",
    "sid_leakage_a",
    "sid_flicker_exponent",
    *cv_noise.WITH_LAW,
)
_knots = functools.lru_cache(maxsize=256)(propagator.knots)


@functools.lru_cache(maxsize=256)
def _switch_instants(name, delay_s, tick_s, clocks):
    """Instant within its tick, and 1 for the next, of a switch `delay_s` after an edge at clock 0 .. `clocks` - 1."""
    if not 0.0 <= delay_s < tick_s:
        raise ValueError(f"{name} = {delay_s:g} is outside 0 .. {tick_s:g} s, one plant tick")
    instants = [Fraction(delay_s) + Fraction(tick_s) * c / clocks for c in range(clocks)]
    carry = [int(t >= Fraction(tick_s)) for t in instants]
    return np.array([float(t - c * Fraction(tick_s)) for t, c in zip(instants, carry)]), np.array(carry)


def analog(config, temp_lo_degc, temp_hi_degc):
    """Parameters of the plant for a range of temperatures.

    Densities of the mechanical noise and the impulses of the effects are those of the lowest temperature.
    """
    d, record = config.device(), config.design_record()
    clocks = record.tick_clocks
    for name, reason in NOT_READ.items():
        if getattr(d, name) != Device._field_defaults[name]:
            raise ValueError(f"plant.{name} = {getattr(d, name):g} would have no effect: {reason}")
    if temp_lo_degc != temp_hi_degc:
        for name in ONE_TEMPERATURE:
            if getattr(d, name):
                raise ValueError(f"plant.{name} = {getattr(d, name):g} needs a constant temperature, not a profile")
    for name in ("drive_dac_delay_s", "sense_dac_delay_s"):
        if getattr(d, name) >= 1 / record.tick_hz:
            limit = f"the limit {1 / record.tick_hz:g} s, one plant tick"
            raise ValueError(f"plant.{name} = {getattr(d, name):g} is above {limit}")
    warm = thermal.device_at_temperature(d, temp_lo_degc)
    knots = _knots(d, temp_lo_degc, temp_hi_degc, KNOT_K, clock=propagator.Clock(record.master_hz, clocks))
    tables = knots.stacks
    tick_s = float(tables.tick_s[0])
    on, seed = config.noise, config.noise.seed
    w = 2 * math.pi

    def noise_source(name, sigma, density, switch):
        return noise.source(seed, name, sigma(density, warm.fx_hz, tick_s), switch)

    at_carrier, force_density = noise.sigma_at_carrier, noise.thermomechanical_density
    damping_x = warm.mass_kg * w * warm.fx_hz / warm.qx
    damping_y = warm.mass_kg * w * warm.fy_hz / warm.qy
    cv_x, cv_y = (cv_noise.cv_density(d, temp_lo_degc, c) * abs(d.signal_gain) for c in ("drive", "sense"))
    rise = _switch_instants("plant.sid_switch_s", d.sid_switch_s, tick_s, clocks)
    fall = _switch_instants("plant.sid_switch_s + plant.sid_fall_s", d.sid_switch_s + d.sid_fall_s, tick_s, clocks)
    board = chips.dac_chips(config.design)
    converters = (
        dac.design(board.drive.bits, d.drive_dac_span_v, bow=d.drive_dac_bow, glitch_v_s=d.drive_dac_glitch_v_s),
        dac.design(board.sense.bits, d.sense_dac_span_v, bow=d.sense_dac_bow, glitch_v_s=d.sense_dac_glitch_v_s),
    )
    levels = config.effects.drive_dac_levels, config.effects.sense_dac_levels
    return plant.Params(
        *converters,
        *(dac_levels.design(level, chip.bits, part.lsb_v) for level, chip, part in zip(levels, board, converters)),
        quad_lsb_v=d.quad_dac_span_v / 2**16,
        frame_ticks=record.frame_ticks,
        tables=tables,
        temp_lo_degc=knots.temp_lo_degc,
        temp_step_k=knots.step_k,
        temp_count=knots.count,
        switch_tau_s=np.array([fall[0], rise[0]]),
        switch_carry=np.array([fall[1], rise[1]]),
        sid=sid.design(float(tables.sid_rc_s[0]), tick_s, sid.device_injection_volts(warm)),
        adc=adc_part(config, warm, tick_s),
        noise=plant.Noise(
            force_x=noise_source("force_x", at_carrier, force_density(damping_x, temp_lo_degc), on.thermomechanical),
            force_y=noise_source("force_y", at_carrier, force_density(damping_y, temp_lo_degc), on.thermomechanical),
            cv_x=noise_source("cv_x", noise.sigma_demodulated, cv_x, on.cv),
            cv_y=noise_source("cv_y", noise.sigma_demodulated, cv_y, on.cv),
            drive_dac=noise_source("dac_drive", at_carrier, d.drive_dac_noise_v_per_rthz, on.dac),
            sense_dac=noise_source("dac_sense", at_carrier, d.sense_dac_noise_v_per_rthz, on.dac),
            edge_jitter=noise.source(seed, "edge_jitter", d.clock_jitter_s, on.jitter),
        ),
        effects=_effects(config, warm, tick_s),
        laws=_configured_laws(config, warm, tick_s),
        sar_lsb_v=d.sar_span_v / 2**17,
        slope_gain=float(d.signal_gain),
        ring=_ring_parameters(config, d, (temp_lo_degc, temp_hi_degc), tick_s),
    )


def _ring_parameters(config, device, temps_degc, tick_s):
    """What a saturating ring adds to the C/V outputs; off, bit for bit nothing."""
    if config.firmware.board == "digital_sid" and device.ring_saturation_on:
        raise ValueError('plant.ring_saturation_on = 1 needs firmware.board = "analog_sid"')
    return ring_tables.design(device, *temps_degc, tick_s)


def electrode_leads(config, device):
    """(u, w): ticks by which the mean of the drive and of the sense electrode leads a straight line (`law.Params`)."""
    f, tick_s, out = firmware(config), 1 / config.design_record().tick_hz, []
    for name, clock in zip(("drive", "sense"), path_clocks.dac_clocks(f)):
        output_delay_s = clock * tick_s / f.design.tick_clocks + getattr(device, f"{name}_dac_delay_s")
        poles = [getattr(device, f"{name}_pole_{k}_s") for k in (1, 2, 3)]
        out.append(dac.end_share(output_delay_s % tick_s, poles, tick_s) - law.STRAIGHT)
    return tuple(out)


def _effects(config, device, tick_s):
    """The effects that the configuration switches on; all others are off, bit for bit."""
    e = config.effects
    k_n_per_m = device.mass_kg * (2 * math.pi * device.fx_hz) ** 2
    k3 = duffing.k3_from_ratio(e.duffing_k3_per_um2, k_n_per_m)
    w = resonator.W_RAD_PER_S
    leak = feedthrough_y.OFF
    if e.feedthrough_y:
        leak = feedthrough_y.design(e.feedthrough_y, law.STRAIGHT + electrode_leads(config, device)[0])
    return effects.collect(
        duffing=duffing.design(k3, device.mass_kg, tick_s, w),
        drive_cubic=drive_cubic.design(e.drive_cubic_per_v2, device.k_vf_drive_n_per_v, device.mass_kg, tick_s, w),
        feedthrough_y=leak,
    )


def _configured_laws(config, device, tick_s):
    """Laws of the catalogue that the configuration switches on, then those that it writes out."""
    e = config.effects
    laws = [item for c in catalogue.LAWS for item in catalogue.laws(c, getattr(e, c.INFO.name), device)]
    laws += [law.parse(text) for text in e.laws]
    if config.firmware.board == "digital_sid" and any(item.port in CV_PORTS for item in laws):
        raise ValueError('effects: a law at cv_x or cv_y needs firmware.board = "analog_sid"')
    stepped = e.drive_cubic_per_v2 or e.feedthrough_y or any(f.name in "uw" for item in laws for f in item.factors)
    leads = electrode_leads(config, device) if stepped else (0.0, 0.0)
    scale, seed = resonator.W_RAD_PER_S, config.noise.seed
    return law.design(laws, device.mass_kg, tick_s, scale, device.temp_ref_degc, seed, leads)


def adc_part(config, d, tick_s):
    """The converter: PGA 1 for the two drive channels and the sensor, the sense gain for the others."""
    on, e, record = config.noise, config.effects, config.design_record()
    for name in ("adc_curve", "adc_turnover", "adc_gain_tc_per_k", "adc_memory"):
        if getattr(e, name) and config.firmware.board == "digital_sid":
            raise ValueError(f'effects.{name} = {short_toml(getattr(e, name))} needs firmware.board = "analog_sid"')
    drive, sense = d.adc_noise_drive_v, d.adc_noise_sense_v
    flicker = d.sid_flicker_v_per_rthz if on.flicker else 0.0
    free_ppm = d.adc_clock_ppm if config.firmware.adc_clock == "free_running" else 0.0
    return adc.design(
        seed=on.seed,
        pga=(d.adc_pga_drive, d.adc_pga_drive, d.adc_pga_sense, d.adc_pga_sense, d.adc_pga_drive),
        vref_v=d.adc_vref_v,
        step_code=d.adc_step_code,
        code_hi=adc.FULL_CODE - d.adc_step_code if config.design.adc == chips.GENERIC else adc.CODE_HI,
        decimation=d.adc_decimation,
        period=adc.modulator_period(free_ppm, d.adc_modulator_hz, record.master_hz),
        master_hz=record.master_hz,
        tick_clocks=record.tick_clocks,
        conversion_delay_s=CONVERSION_DELAY_S + d.adc_delay_s,
        noise_v=(drive, drive, sense, sense, drive) if on.adc else (0.0,) * adc.CHANNELS,
        flicker_v_per_rthz=(flicker,) * 4 + (0.0,),
        turnover=(e.adc_turnover,) * 4 + (0.0,),
        gain_tc_per_k=(e.adc_gain_tc_per_k,) * 4 + (0.0,),
        curve=tuple(e.adc_curve),
        memory=(e.adc_memory,) * 4 + (0.0,),
    )


def params(config, temp_lo_degc, temp_hi_degc):
    """Parameters of the engine."""
    plant_params = analog(config, temp_lo_degc, temp_hi_degc)
    parts = chips.parts(chips.dac_chips(config.design))
    return engine.Params(firmware(config), plant_params, sine.table(config.design_record()), parts)


def lsb_hz(config):
    """True frequency of one LSB of the DDS word."""
    return clock_hz(config) / 2**config.design.dds_bits


def clock_hz(config):
    """True frequency of the master clock."""
    return config.design_record().master_hz * (1 + 1e-6 * config.plant.clock_ppm)
