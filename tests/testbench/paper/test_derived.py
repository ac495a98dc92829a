"""Closed form of what a board gives at a temperature: against formulas, and against simulated boards (slow)."""

import math

import numba
import pytest

from analog_frontend.parts import cv_noise, noise
from analog_frontend.parts.device import FIELDS
from testbench.config import Config, changed
from testbench.errors import ConfigError
from testbench.paper.loop import advisor, derived, temperature_tables
from testbench.paper.loop import loop as lp
from testbench.paper.loop.loop_parameters import loop_parameters
from testbench.paper.measure import characterise
from testbench.run import build

TEMPS_DEGC = (-20.0, 25.0, 50.0)
# every law over temperature at once, none at its default
LAWS = {
    "plant.cv_noise_v_per_rthz": 6e-9,
    "plant.ring_noise_on": 1,
    "plant.cv_resistor_ohm": 4e3,
    "plant.ina_voltage_noise_v_per_rthz": 1.07e-9,
    "plant.ina_current_noise_a_per_rthz": 1.2e-12,
    "plant.ina_bias_exponent": 0.0,
    "plant.ina_beta_exponent": 2.0,
    "plant.sid_flicker_exponent": 3.0,
    "plant.carrier_tc_per_k": -3e-4,
    "plant.sid_charge_c": 0.3e-12,
    "plant.sid_charge_tc_per_k": 0.004,
    "plant.sid_leakage_a": -0.05e-9,
    "plant.dac_amplifier_tc_on": 1,
}


@pytest.mark.parametrize("temp_degc", TEMPS_DEGC)
def test_what_stands_at_rest_is_what_the_advisor_has(temp_degc):
    config = changed(Config(), {"scenario.temperature_degc": temp_degc})
    p = loop_parameters(config)
    a, found = advisor.analyse(p), derived.derive(config, temp_degc)
    assert found.lsb_per_dps == pytest.approx(a.lsb_per_dps, rel=1e-9)
    assert found.bias_dps == pytest.approx(a.bias_dps, rel=1e-6)
    assert found.quadrature_v == pytest.approx(a.v_q, rel=1e-9)
    # the loops are linear in what acts on them; k_xy is nulled by V_q and leaves nothing
    assert sum(derived.bias_parts_dps(p, lp.close(p)).values()) == pytest.approx(found.bias_dps, rel=1e-6)


def test_damping_and_charge_make_the_bias_that_formulas_give():
    """d_xy/(2 m_c) in deg/s, and 6 R f dQ + dQ/(4 C) volts behind 4/pi of what a rate makes of y."""
    config = Config()
    d, p = config.device(), loop_parameters(config)
    found = derived.bias_parts_dps(p, lp.close(p))
    damping = d.dxy_ratio * 2 * math.pi * d.fx_hz / d.qx / 2
    assert found["damping"] == pytest.approx(math.degrees(damping), rel=1e-3)
    charge = d.sid_charge_c * d.sid_charge_mismatch
    volts = charge * (6 * d.sid_r_ohm * d.fx_hz + 0.25 / d.sid_c_f)
    wd, wy = p.w_rad_s, p.wy_rad_s
    y_per_dps = 2 * math.radians(1.0) * wd * p.amplitude_m / abs(wy**2 - wd**2)
    # the sine channel reads y in phase with the force, up to the cosines of a degree
    assert found["sine"] == pytest.approx(volts / (4 / math.pi * p.cv_v_per_m * y_per_dps), rel=2e-3)
    assert abs(found["cosine"]) < 0.02 * found["sine"]


def test_flicker_has_its_floor_and_its_law():
    config = changed(Config(), {"plant.sid_flicker_exponent": 2.0})
    own, cold = derived.derive(config, 25.0), derived.derive(config, -20.0)
    steady = derived.derive(Config(), -20.0)
    assert own.instability_deg_per_h == derived.derive(Config(), 25.0).instability_deg_per_h
    assert cold.instability_deg_per_h / steady.instability_deg_per_h == pytest.approx((253.15 / 298.15) ** 2, rel=1e-12)


def test_tables_have_every_source_that_is_on_and_all_of_them():
    config = changed(Config(), LAWS)
    shown = temperature_tables.shares(config)
    *sources, total = ([float(cell) for cell in row[1:4]] for row in shown.rows)
    assert [row[0] for row in shown.rows[:-1]] == [
        text for name, text in temperature_tables.SOURCES.items() if name != "carrier"
    ]
    for n in range(3):
        assert total[n] == pytest.approx(math.hypot(*(row[n] for row in sources)), abs=2e-3)
    told = temperature_tables.as_json(config)
    for n, (temp_degc, at) in enumerate(zip(TEMPS_DEGC, told)):
        assert at["arw_deg_per_rt_h"] == derived.derive(config, temp_degc).arw_deg_per_rt_h
        assert 1e9 * math.hypot(*at["cv_noise_v_per_rthz"].values()) == pytest.approx(total[n], abs=5e-4)
    assert len(temperature_tables.numbers(config).rows) == len(temperature_tables.NUMBERS)


@pytest.mark.parametrize("temp_degc", TEMPS_DEGC)
def test_the_plant_is_built_with_the_numbers_of_its_temperature(temp_degc):
    """Densities, charges and flicker of a run are those that the closed form has."""
    config = changed(Config(), LAWS)
    plant, d = build.analog(config, temp_degc, temp_degc), config.device()
    fx_hz = d.fx_hz * (1 - 27e-6 * (temp_degc - 25.0))
    for source, channel in ((plant.noise.cv_x, "drive"), (plant.noise.cv_y, "sense")):
        density = d.signal_gain * math.hypot(*cv_noise.cv_noise_shares(d, temp_degc, channel).values())
        assert source.sigma == pytest.approx(noise.sigma_demodulated(density, fx_hz, 1e-6), rel=1e-9)
    leaked = d.sid_leakage_a * 2 ** ((temp_degc - 25.0) / 10) / (2 * fx_hz)
    charge = d.sid_charge_c * (1 + 0.004 * (temp_degc - 25.0)) * d.sid_charge_mismatch
    first, second = plant.sid.inject[:3], plant.sid.inject[3:]
    assert first - second == pytest.approx([(charge + leaked) / d.sid_c_f] * 3, rel=1e-9)
    level = d.sid_flicker_v_per_rthz * ((temp_degc + 273.15) / 298.15) ** 3
    assert plant.adc.flicker[2].level == pytest.approx(level, rel=1e-9)
    assert loop_parameters(config, temp_degc).flicker_v_per_rthz == pytest.approx(level, rel=1e-9)


@pytest.mark.parametrize("key", build.ONE_TEMPERATURE)
def test_a_law_with_one_number_a_run_refuses_a_profile(key):
    largest = next(field.hi for field in FIELDS if field.name == key)
    config = changed(Config(), {f"plant.{key}": largest})
    with pytest.raises((ValueError, ConfigError), match=rf"plant.{key} = .* needs a constant temperature"):
        build.analog(config, 20.0, 30.0)


@pytest.mark.slow
@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
@pytest.mark.parametrize("laws", [{}, LAWS], ids=["default", "laws"])
@pytest.mark.parametrize("temp_degc", TEMPS_DEGC)
def test_a_simulated_board_gives_what_is_derived(temp_degc, laws):
    """Averaged engine, 1200 s at rest: ARW within 5 %, the rest within what rails and seeds leave."""
    config = changed(Config(), laws | {"noise.seed": 11})
    found = characterise.characterise(config, engine="baseband", zero_rate_s=1200.0, temp_degc=temp_degc)
    want = derived.derive(config, temp_degc)
    assert found["scale_lsb_per_dps"] == pytest.approx(want.lsb_per_dps, rel=5e-4)
    assert found["bias_dps"] == pytest.approx(want.bias_dps, abs=2e-3)
    assert found["quadrature_v"] == pytest.approx(want.quadrature_v, abs=5e-4)
    assert found["arw_deg_per_rt_h"] == pytest.approx(want.arw_deg_per_rt_h, rel=0.05)
    assert found["frequency_hz"] == pytest.approx(want.frequency_hz, abs=2e-4)
