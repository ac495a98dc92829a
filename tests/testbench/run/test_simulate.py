"""`gyro run` as its user sees it: what it prints, what it leaves behind, and whether a physicist would believe it."""

import json
import math

import numpy as np
import pytest

from testbench.run import budget, simulate
from testbench.storage import record_read, state_file
from tests.testbench.bench_setup import configured, quiet
from tests.testbench.command import gyro

KEYS = {
    "locked",
    "lock_time_s",
    "drive_frequency_hz",
    "amplitude_m",
    "phase_deg",
    "budget_deg",
    "loop_phase_deg",
    "rate_lsb_per_dps",
    "quadrature_v",
    "real_time_factor",
    "codes_sha256",
}
NODES = {"xe1", "xe2", "ye1", "ye2"}


@pytest.fixture(scope="module")
def run_json(tmp_path_factory):
    """The command of the README, shorter."""
    out = tmp_path_factory.mktemp("run")
    command = "run --seconds 0.6 --rate-dps 100 --seed 1 --json --vcd 1200000:20 --out".split()
    done = gyro(*command, out)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), out


@pytest.fixture(scope="module")
def silent():
    """A run without noise at 100 deg/s."""
    return simulate.run(quiet(scenario__seconds=1.2, scenario__rate_dps=100.0)).summary


def test_one_object_with_all_keys(run_json):
    got, _ = run_json
    assert KEYS <= set(got)
    assert set(got["phase_deg"]) == set(got["budget_deg"]) == NODES
    assert got["locked"] is True
    assert 1.0 < got["lock_time_s"] < 3.0
    assert len(got["codes_sha256"]) == 64


def test_everything_is_left_behind(run_json):
    got, out = run_json
    names = {path.name for path in out.iterdir()}
    assert {"run.h5", "run.html", "state.h5", "run.vcd", "run.gtkw", "startup.png", "spectra.png"} <= names
    assert {"jitter.png", "rate_step.png"} <= names
    kept = record_read.read_record(out / "run.h5")
    state = kept.streams["state"].data
    assert kept.streams["adc_drive_cos"].rate_hz == 8000
    assert len(state) == pytest.approx(got["simulated_s"] * 8000, abs=2)


def test_measured_phases_with_noise_are_within_their_spread(run_json):
    got, _ = run_json
    for node in NODES:
        assert got["phase_deg"][node] == pytest.approx(
            got["budget_deg"][node], abs=0.003 + 4 * got["phase_sigma_deg"][node]
        )


@pytest.mark.slow
def test_measured_phases_without_noise_equal_the_budget(silent):
    for node in NODES:
        assert silent["phase_deg"][node] == pytest.approx(silent["budget_deg"][node], abs=0.003), node


def test_the_frequency_lies_where_the_phases_put_it(silent):
    assert silent["drive_frequency_hz"] == pytest.approx(silent["expected_frequency_hz"], abs=0.003)
    # 5.0 deg at Q 2e5: the offset itself is measured, not only its sum with f_x
    assert silent["drive_frequency_hz"] - 11002.3 == pytest.approx(-0.00226, abs=0.0008)


def test_the_counter_agrees_on_the_pickoff(silent):
    # noise off, smooth signal: what is left is the chord between samples, (2 pi f h)^2/8 of 3.96 deg
    assert silent["counter_deg"]["xe2"] == pytest.approx(silent["budget_deg"]["xe2"], abs=0.0024 + 0.003)


def test_scale_factor_follows_one_over_cos(silent):
    """k_vf alone gives 8651 LSB per deg/s; ye1 + xe2' turns x and the force apart: SF ~ 1/cos(ye1 + xe2')."""
    d = configured().device()
    w = 2 * math.pi * 11002.2977
    per_dps = 2 * d.coriolis_mass_kg * w * silent["amplitude_m"] * math.pi / 180 / d.k_vf_sense_n_per_v / 10.0 * 2**23
    angle = math.radians(silent["phase_deg"]["ye1"] + silent["loop_phase_deg"]["xe2"])
    # the step segment settles to 139 Hz ringing with tau 0.3 s averaged over 0.25 s: 3e-4
    assert silent["rate_lsb_per_dps"] == pytest.approx(per_dps / math.cos(angle), rel=5e-4)


def test_quadrature_voltage_nulls_the_coupling():
    """At rate 0 the loop finds V_q = sqrt(k_xy / kq), but for the 0.3 deg/s of damping coupling that leaks in."""
    got = simulate.run(quiet(scenario__seconds=2.0, scenario__diagnose=False)).summary
    assert got["quadrature_v"] == pytest.approx(4.52, abs=0.04)


@pytest.mark.slow
def test_the_loop_phase_is_what_the_demodulator_sees():
    """At lock the SID's phase is zero on average: the C/V output lags its reference by the switch delay."""
    for board, switch_s, fall_s in (
        ("analog_sid", 80e-9, 0.0),
        ("analog_sid", 300e-9, 66e-9),
        ("digital_sid", 80e-9, 0.0),
    ):
        checked = quiet(firmware__board=board, plant__sid_switch_s=switch_s, plant__sid_fall_s=fall_s)
        sim = simulate.Simulation(checked, 25.0, 25.0)
        assert simulate.start(checked, sim, 0.0, 25.0) is not None
        sim.advance(1_500_000, 0.0, 25.0)
        head = len(np.concatenate(sim.frames))
        readings = sim.probe(300_000, 0.0, 25.0)
        pin_deg = 360 * simulate.nodes.pin_lag_turns(readings.edges[0])
        # x = -cos(theta): its lag as a sine is 90 deg more
        seen_deg = readings.lag_deg["cv_x"] - 90.0 - pin_deg
        planned = budget.budget(checked)
        switch_deg = sum(row.degrees for row in planned.loop_rows["xe2"])
        left_deg = np.mean(sim.columns()["phase"][head:]) / 2**24 * 360
        # the codes are 9.5 ms late behind the SID; the residual moves by less than the tolerance in that
        assert (seen_deg + switch_deg + left_deg) % 360 == pytest.approx(0.0, abs=0.003) or (
            seen_deg + switch_deg + left_deg
        ) % 360 == pytest.approx(360.0, abs=0.003), (board, seen_deg, switch_deg, left_deg)


def test_a_run_resumes_to_the_same_codes(tmp_path):
    """State at the end of a run, continued, against one long run."""
    short = simulate.run(configured(scenario__seconds=0.2))
    state_file.save_state(tmp_path / "state.h5", *short.state)
    rest = simulate.run(
        configured(scenario__seconds=0.1, scenario__diagnose=False, scenario__resume=str(tmp_path / "state.h5"))
    )
    long = simulate.run(configured(scenario__seconds=0.3, scenario__diagnose=False))
    tail = {k: c.data for k, c in rest.record.streams.items()}
    for name, column in long.record.streams.items():
        np.testing.assert_array_equal(column.data[-len(tail[name]) :], tail[name], err_msg=name)


def test_bad_input_is_one_line_and_leaves_nothing(tmp_path):
    out = tmp_path / "out"
    for bad in ("plant.fx_hz=1e9", "firmware.pipeline_registers=12", 'plant.fx_hz="11 kHz"', "plant.fx=11000"):
        done = gyro("run", "--set", bad, "--out", out)
        assert done.returncode == 2
        assert done.stdout == ""
        assert len(done.stderr.strip().splitlines()) == 1, done.stderr
        assert not out.exists()


@pytest.mark.parametrize(
    ("setting", "name"),
    [
        ("plant.sid_switch_s=2e-6", "sid_switch_s"),
        ("plant.sense_dac_delay_s=2.5e-6", "sense_dac_delay_s"),
        ("plant.sid_c_f=1e-9", "sid rc_s"),
        ("firmware.amplitude_um=9.9", "setpoint"),
    ],
)
def test_what_only_the_design_can_refuse_is_one_line(setting, name):
    done = gyro("run", "--set", setting)
    assert done.returncode == 2, done.stderr
    assert name in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
