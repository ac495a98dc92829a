"""Constants of a plant for its C: resources/plant.bin, in the order of `read_all` in plant.c; what is refused.

Words are little-endian, 64 bits each, integers or doubles.
Source    docs/fmu.md, analog_frontend/top.py
"""

import math

import numpy as np

from analog_frontend import top as plant
from analog_frontend.effects import acceleration
from analog_frontend.parts import adc, dac_serial, noise, resonator, sid, thermal
from testbench import config as configuration
from testbench.engines import chips
from testbench.errors import ConfigError
from testbench.run import build

NONE_OF = {
    "plant": (
        "drive_dac_bow", "sense_dac_bow", "drive_dac_glitch_v_s", "sense_dac_glitch_v_s", "ring_saturation_on",
        "self_heating_k",
    ),
}  # fmt: skip


def check(config):
    """ConfigError with the name of the first thing that the C of the plant does not cover."""
    default = configuration.Config()
    usual = default.effects.model_dump()
    for name, value in config.effects.model_dump().items():
        if value != usual[name] and name != acceleration.INFO.name:
            raise ConfigError(f"effects.{name} = {value}: the FMU of the plant supports no effect except acceleration")
    for name in NONE_OF["plant"]:
        value = getattr(config.plant, name)
        if value:
            raise ConfigError(f"plant.{name} = {value:g}: the FMU of the plant supports only 0")
    if config.firmware.board != "analog_sid":
        raise ConfigError(
            f'firmware.board = "{config.firmware.board}": the FMU of the plant supports only "analog_sid"'
        )
    if config.scenario.faults:
        raise ConfigError(
            "scenario.faults: the FMUs simulate no faults; change the signals between them in the importer"
        )
    if config.scenario.host != "bus":
        raise ConfigError(
            f'scenario.host = "{config.scenario.host}": the FMU of the firmware writes registers on the "bus" only'
        )
    if config.scenario.plant:
        raise ConfigError("scenario.plant: an external plant is already a library; the FMU needs the built-in plant")


def _tilt(config, temp_degc, tick_s):
    """What an acceleration changes, as `acceleration.terms` and `law.design` compute it."""
    d = thermal.device_at_temperature(config.device(), temp_degc)
    scale = (2 * math.pi * d.fy_hz) ** 2 * acceleration.GAP_M
    softer = acceleration.carrier_softening_n_per_m(d.carrier_v, d.c0_f, acceleration.GAP_M)
    push = tick_s / (d.mass_kg * resonator.W_RAD_PER_S)
    lead = build.electrode_leads(config, d)[1]
    return [2 * acceleration.MISMATCH, acceleration.G_M_PER_S2, scale, d.k_vf_sense_n_per_v, softer, push, lead]


def _source(p):
    """The five words of a source; of 1/f noise `sigma` is the level."""
    return p.key0, p.key1, p.on, getattr(p, "half", 0), float(p[2])


def words(config, p, temp_lo_degc, temp_hi_degc):
    """Integers and floats of a plant (`plant.Params`) at power-on, for temperatures lo .. hi (degC)."""
    t, d, n = p.tables, p.sid, p.noise
    clocks = p.switch_tau_s.shape[1]
    codes = [dac_serial.reset(part).code for part in chips.parts(chips.dac_chips(config.design))]
    s = plant.reset(p, codes[0], codes[1], temp_lo_degc)
    plant_constants = [p.temp_lo_degc, p.temp_step_k, float(temp_lo_degc), float(temp_hi_degc)]
    plant_constants += [int(c) for c in (*t.drive_carry[0], *t.sense_carry[0], *p.switch_carry.ravel())]
    plant_constants += p.switch_tau_s.ravel().tolist()
    plant_constants += [p.quad_lsb_v, p.drive_dac.lsb_v, p.sense_dac.lsb_v, p.drive_dac.offset_v, p.sense_dac.offset_v]
    plant_constants += [float(p.slope_gain)]
    plant_constants += [p.adc.period, p.adc.delay, p.adc.decimation, p.adc.step_code, p.adc.code_hi]
    plant_constants += [p.adc.normal, float(p.adc.full_steps), *p.adc.offset_v, *p.adc.steps_per_v]
    plant_constants += [adc.SENSOR_V_AT_25_DEGC, adc.SENSOR_V_PER_K]
    plant_constants += [d.h_s, d.r, d.e1, d.e2, d.e3, d.s1, d.s2, d.s3, *d.inject.tolist()]
    plant_constants += np.moveaxis(d.taylor.reshape(4, sid.TERMS, 4), -1, 0)[: sid.STAGES].ravel().tolist()
    sources = (n.force_x, n.force_y, n.cv_x, n.cv_y, n.drive_dac, n.sense_dac, n.edge_jitter, *p.adc.white)
    plant_constants += [word for item in (*sources, *p.adc.flicker) for word in _source(item)]
    plant_constants += map(float, _tilt(config, temp_lo_degc, float(t.tick_s[0])))
    plant_constants += [*noise.DECAY.tolist(), *noise.GAIN.tolist(), noise.IH4_SCALE, noise.IH12_SCALE]
    plant_constants += [*s.z.tolist(), *s.volts.tolist(), *s.adc.sums.ravel().tolist(), int(codes[2])]
    for k in range(p.temp_count):
        jet = np.zeros_like(t.g_jet[k])
        jet[:, :, : plant.FIRST_CV] = t.g_jet[k][:, :, : plant.FIRST_CV]
        jet[:, plant.FIRST_CV : plant.STATES] = t.g_jet[k][:, plant.FIRST_CV : plant.STATES]
        plant_constants += jet.ravel().tolist()
        for table in (t.drive_step, t.sense_step, t.drive_jitter, t.sense_jitter):
            plant_constants += table[k].ravel().tolist()
        plant_constants += t.pickoff[k].ravel().tolist()
        plant_constants += [float(t.driver_s[k]), float(t.kxy_n_per_m[k]), float(t.kq_n_per_m_per_v2[k])]
    return [len(plant_constants), clocks, p.frame_ticks, p.temp_count, *plant_constants]


def binary(plant_constants):
    """Bytes of these words."""
    return b"".join(np.array(w, "<f8" if isinstance(w, float) else "<i8").tobytes() for w in plant_constants)
