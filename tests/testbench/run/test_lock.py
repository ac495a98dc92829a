"""From power-on to lock and on: temperatures, random plants, rates, the other board. Long versions are slow."""

import math

import numpy as np
import pytest

from analog_frontend.parts import thermal
from fpga_model import fault_monitor, sequencer
from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench.run import budget, build, simulate
from tests.testbench.bench_setup import configured

DEG = math.pi / 180
LOCK_LIMIT_S = 3.0
KXY_RANGE = (0.012, 0.055)


def random_plant(seed):
    """One draw of the tolerances the sequencer must stand."""
    draw = np.random.default_rng([20250, seed])
    fx = 11002.3 * (1 + draw.uniform(-0.005, 0.005))
    return {
        "plant__fx_hz": fx,
        "plant__fy_hz": fx - draw.uniform(120.0, 160.0),
        "plant__qx": draw.uniform(1e5, 4e5),
        "plant__qy": draw.uniform(1e5, 4e5),
        "plant__kxy_n_per_m": draw.uniform(*KXY_RANGE),
        "plant__k_vf_drive_n_per_v": 2.72e-7 * draw.uniform(0.9, 1.1),
        "plant__k_vf_sense_n_per_v": 2.72e-7 * draw.uniform(0.9, 1.1),
        "plant__dcdx_f_per_m": 1e-7 * draw.uniform(0.9, 1.1),
        "plant__dcdy_f_per_m": 1e-7 * draw.uniform(0.9, 1.1),
        "noise__seed": seed,
    }


def locked_run(checked, temp_degc, rate_dps=0.0, stay_s=1.5, limit_s=LOCK_LIMIT_S):
    """A simulation that has locked and stayed; asserts everything that the start-up promises."""
    sim = simulate.Simulation(checked, temp_degc, temp_degc)
    lock_s = simulate.start(checked, sim, rate_dps * DEG, temp_degc, limit_s=limit_s)
    assert lock_s is not None, simulate_state(sim)
    assert lock_s < limit_s
    sim.advance(round(stay_s * TICK_HZ), rate_dps * DEG, temp_degc)
    c = sim.columns()
    after = c["state"][int(lock_s * TICK_HZ / FRAME_TICKS) + 1 :]
    assert np.all(after == sequencer.LOCKED), "lock was lost"
    settled = slice(len(c["state"]) - 8000, None)
    # the SID's own amplitude, CORDIC gain taken out, against its set-point
    setpoint = sim.state.fpga.registers.amplitude_setpoint
    assert np.mean(c["magnitude"][settled]) == pytest.approx(setpoint, rel=1e-4)
    warm = thermal.device_at_temperature(checked.device(), temp_degc)
    planned = budget.budget(checked, temp_degc)
    expected = budget.lock_frequency_hz(warm.fx_hz, warm.qx, planned.node_deg()["xe1"], planned.loop_deg()["xe2"])
    measured = np.mean(c["frequency_word"][settled]) * build.clock_hz(checked) / 2**48
    assert measured == pytest.approx(expected, abs=0.003)
    amplitude = np.hypot(c["truth_x"], c["truth_vx"] * 11000.0 / expected)
    final = np.mean(amplitude[settled])
    reached = int(np.argmax(amplitude >= 0.95 * final))
    assert np.max(amplitude[reached:]) < 1.01 * final
    return sim


def simulate_state(sim):
    s = sim.state.fpga.control.sequencer
    where = f"state {sequencer.STATES[s.state]}, lock {s.lock.locked:04b}, flags {s.faults.flags:#x}"
    return f"{where} at {sim.tick / TICK_HZ} s"


@pytest.mark.parametrize("temp_degc", [-20.0, 50.0])
def test_locks_over_temperature(temp_degc):
    locked_run(configured(), temp_degc)


@pytest.mark.parametrize("seed", range(3))
def test_locks_with_random_plants(seed):
    locked_run(configured(**random_plant(seed)), 25.0)


@pytest.mark.slow
@pytest.mark.parametrize("temp_degc", [-20.0, 25.0, 50.0])
def test_stays_locked_for_20_s_over_temperature(temp_degc):
    locked_run(configured(), temp_degc, stay_s=20.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_50_random_plants_lock_and_stay_for_20_s(seed):
    locked_run(configured(**random_plant(seed)), 25.0, stay_s=20.0)


@pytest.mark.slow
def test_the_other_board_locks_too():
    checked = configured(firmware__board="digital_sid")
    sim = locked_run(checked, 25.0)
    readings = simulate.diagnose(sim, 0.0, 25.0).nodes
    for node, want in budget.budget(checked).node_deg().items():
        # noise is on: a few sigma of the fit on top of the 3 mdeg
        assert readings.phase_deg[node] == pytest.approx(want, abs=0.003 + 4 * readings.sigma_deg[node]), node


@pytest.mark.parametrize("kxy", [0.002, 0.15])
def test_outside_its_range_the_quadrature_loop_rails_and_says_so(kxy):
    """Too little or too much coupling for 0 .. 5.5 V; the other three loops hold."""
    checked = configured(plant__kxy_n_per_m=kxy)
    sim = simulate.Simulation(checked, 25.0, 25.0)
    rate = 100.0 * DEG if kxy < 0.01 else -100.0 * DEG
    simulate.start(checked, sim, rate, 25.0, limit_s=2.5)
    sim.advance(round(0.5 * TICK_HZ), rate, 25.0)
    c = sim.columns()
    assert np.all(c["flags"][-4000:] & fault_monitor.QSC_RAIL)
    assert np.all(c["lock"][-4000:] & 0b0111 == 0b0111), simulate_state(sim)


@pytest.mark.parametrize("kxy", [0.012, 0.0561, 0.07, 0.08])
def test_rates_of_500_deg_per_s_never_drop_lock(kxy):
    """Also with couplings of which V_q reaches a limit at such rates."""
    checked = configured(plant__kxy_n_per_m=kxy)
    sim = simulate.Simulation(checked, 25.0, 25.0)
    assert simulate.start(checked, sim, 0.0, 25.0) is not None
    for rate_dps in (300.0, 0.0, -300.0, 500.0, -500.0):
        sim.advance(round(0.35 * TICK_HZ), rate_dps * DEG, 25.0)
        c = sim.columns()
        assert np.all(c["state"][-2800:] == sequencer.LOCKED), rate_dps
        assert np.all(c["lock"][-2800:] == 0b1111), rate_dps


def test_self_heating_moves_the_frequency():
    """5 K with 1 s: after 1 s of run 63 % of 5 K times -0.297 Hz/K."""
    checked = configured(plant__self_heating_k=5.0, plant__warm_up_tau_s=1.0)
    sim = simulate.Simulation(checked, 25.0, 25.0)
    assert simulate.start(checked, sim, 0.0, 25.0) is not None
    sim.advance(2_000_000 - sim.tick, 0.0, 25.0)
    rise_k = 5.0 * (1 - math.exp(-sim.tick / TICK_HZ))
    assert sim.columns()["truth_temperature"][-1] == pytest.approx(25.0 + rise_k, abs=0.002)
    moved_hz = sim.columns()["frequency_word"][-80:].mean() * 26e6 / 2**48 - 11002.3
    # the loop of 3 Hz with a zero at 0.6 Hz follows a ramp of 0.2 Hz/s within 0.02 Hz
    assert moved_hz == pytest.approx(-27e-6 * 11002.3 * rise_k, abs=0.03)


def test_chunks_do_not_matter_to_self_heating():
    """Chunks that begin and end anywhere in a frame: the parts' temperature of each frame is that of one chunk."""
    checked = configured(plant__self_heating_k=5.0, plant__warm_up_tau_s=1.0)
    temps = []
    for steps in ((5000,), (1, 124, 1, 374, 250, 3999, 251)):
        sim = simulate.Simulation(checked, 25.0, 26.0)
        for ticks in steps:
            sim.advance(ticks, 0.0, np.linspace(25.0, 26.0, 42)[sim.tick // 125 :])
        temps.append(sim.columns()["truth_temperature"])
    np.testing.assert_array_equal(*temps)
    assert len(temps[0]) == 40
    assert np.all(np.diff(temps[0]) > 1.0 / 41 + 1e-5)


def test_a_temperature_ramp_is_followed():
    """-0.3 Hz/K: 2 K in a second are 0.6 Hz, and the word follows."""
    checked = configured()
    sim = simulate.Simulation(checked, 25.0, 27.0)
    assert simulate.start(checked, sim, 0.0, 25.0) is not None
    first = sim.columns()["frequency_word"][-800:].mean()
    frames = 8002
    sim.advance(TICK_HZ, np.zeros(frames), np.linspace(25.0, 27.0, frames))
    sim.advance(TICK_HZ // 2, 0.0, 27.0)
    moved_hz = (sim.columns()["frequency_word"][-800:].mean() - first) * 26e6 / 2**48
    assert moved_hz == pytest.approx(-27e-6 * 11002.3 * 2.0, abs=0.01)
    assert sim.locked
