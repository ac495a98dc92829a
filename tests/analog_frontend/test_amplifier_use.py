"""What amplifiers are asked for: against held sines stepped through the poles, the plant's tables, page, docstring."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from analog_frontend import amplifier_use, ring_saturation, ring_tables
from analog_frontend.parts.device import Device, make
from testbench.config import Config
from testbench.run import budget, run_tables, summary
from tests.testbench.bench_setup import board, configured

PAGE = Path(__file__).parents[2] / "docs" / "plant.md"
ABOUT = " ".join(amplifier_use.__doc__.split())
# use of swing and of slew rate (%) at 25 degC: default board, most probable board
USES = {
    "C/V amplifier and driver": ("18.5 and 1.03 %", "2.78 and 0.156 %"),
    "drive outputs, kick": ("83.3 and 46.7 %", "83.3 and 62.1 %"),
    "drive outputs, lock": ("0.851 and 0.477 %", "0.592 and 0.441 %"),
    "sense outputs, full scale": ("83.3 and 68.7 %", "83.3 and 63.3 %"),
}
PER_TICK, TICKS = 200, 4000


def steepest(poles_s, f_hz, tick_s):
    """Largest slope (V/s) behind each of the poles of a sine of 1 V that is held over ticks, by fine steps."""
    held = np.repeat(np.sin(2 * math.pi * f_hz * tick_s * np.arange(TICKS)), PER_TICK)
    found, before, step_s = [], held, tick_s / PER_TICK
    for k, tau_s in enumerate(poles_s):
        q = math.exp(-step_s / tau_s)
        # what comes from a DAC is held over a step, what comes from a pole goes in a straight line
        end = 1 - tau_s * (1 - q) / step_s if k else 0.0
        behind = lfilter([end, 1 - q - end], [1.0, -q], before)
        found.append(np.abs(before - behind)[len(held) // 4 :].max() / tau_s)
        before = behind
    return found


@pytest.mark.parametrize("f_hz", [3900.7, 11002.3, 50e3 * 0.9973])
@pytest.mark.parametrize("poles_s", [(100e-9, 40e-9, 40e-9), (68e-9, 16e-9, 40e-9), (980e-9, 16e-9), (9e-6, 2e-6)])
def test_no_output_is_steeper_and_the_first_is_as_steep(poles_s, f_hz):
    use = amplifier_use.output(Device(), "", 1.0, poles_s[0], f_hz, 1e-6)
    first, *later = steepest(poles_s, f_hz, 1e-6)
    # the nearest phase of 3000 ticks
    assert first == pytest.approx(use.slope_v_per_s, rel=1e-3)
    assert first < use.slope_v_per_s * (1 + 1e-9)
    assert max(later) < use.slope_v_per_s


def test_uses_are_parts_of_what_the_amplifiers_have():
    device = make(amplifier_slew_v_per_s=2e6, amplifier_swing_v=8.0)
    use = amplifier_use.use(device, "one", 10.0, 1e6)
    assert (use.swing_use, use.slew_use) == (1.25, 0.5)
    assert list(amplifier_use.warnings([use])) == [
        "one: 10 V is 1.25 times plant.amplifier_swing_v = 8 V; the plant does not clip or slew there"
    ]
    assert not list(amplifier_use.warnings([amplifier_use.use(device, "at the limit", 8.0, 2e6)]))


def test_the_pickoff_has_the_voltage_that_the_plant_puts_there():
    linear = amplifier_use.pickoff(Device(), 25.0, 5e-6, 11002.3)
    # the textbook's gain (E - 2 Vf)/Ct is 5 % high, and the bounce a few more
    assert linear.peak_v == pytest.approx(5 * 0.5 / 5 * (5 - 2 * 0.13), rel=0.08)
    assert linear.slope_v_per_s == pytest.approx(2 * math.pi * 11002.3 * linear.peak_v, rel=1e-12)
    on = make(ring_saturation_on=1)
    ring = ring_tables.design(on, 25.0, 25.0, 1e-6)
    clipped = amplifier_use.pickoff(on, 25.0, 5e-6, 11002.3)
    static, _ = ring_saturation.saturation_terms(ring, 0, 0.0, 0, linear.peak_v)
    assert clipped.peak_v == pytest.approx(linear.peak_v + static, rel=1e-4)
    assert clipped.peak_v < 0.85 * linear.peak_v
    assert clipped.slope_v_per_s == linear.slope_v_per_s


def test_budget_and_run_say_it():
    planned = budget.budget(Config())
    said = amplifier_use.sentence(planned.amplifiers)
    assert said in run_tables.budget_tables(planned)[1].note
    assert said in summary.notes(Config(), {"locked": True, "phase_deg": None}, planned)
    listed = run_tables.budget_json(planned)["amplifier_use"]
    assert [row["slew_use"] for row in listed] == [u.slew_use for u in planned.amplifiers]
    assert not list(amplifier_use.warnings(planned.amplifiers))
    slow = budget.budget(configured(plant__amplifier_slew_v_per_s=7e6, plant__amplifier_swing_v=9.0))
    assert [line.split(":")[0] for line in amplifier_use.warnings(slow.amplifiers)] == [
        "drive outputs, kick",
        "sense outputs, full scale",
        "sense outputs, full scale",
    ]
    assert "is 1.45 times plant.amplifier_slew_v_per_s = 7e+06 V/s" in run_tables.budget_tables(slow)[1].note


def test_the_drive_at_lock_is_what_its_damping_takes():
    c = configured(plant__qx=1e5)
    d = c.device()
    use = budget.budget(c).amplifiers[2]
    damping_n = d.mass_kg * (2 * math.pi * d.fx_hz) / d.qx * (2 * math.pi * d.fx_hz * 5e-6)
    assert use.peak_v == pytest.approx(damping_n / d.k_vf_drive_n_per_v, rel=1e-12)
    # a drive without force, or too weak, ends at its ceiling
    kick, lock = budget.budget(configured(plant__k_vf_drive_n_per_v=0.0)).amplifiers[1:3]
    assert lock.peak_v == kick.peak_v == 10.0
    half = budget.budget(configured(plant__drive_dac_span_v=5.0)).amplifiers[1]
    assert half.peak_v == 5.0


def test_the_uses_of_both_boards_and_the_page_has_the_largest():
    boards = [Config(), board("paper_inferred")]
    found = {}
    for uses in zip(*(budget.budget(c, temp_degc=25.0).amplifiers for c in boards)):
        found[uses[0].where] = tuple(f"{100 * u.swing_use:.3g} and {100 * u.slew_use:.3g} %" for u in uses)
    assert found == USES
    swing, slew = found["drive outputs, kick"][0].split(" and ")
    assert f"{swing} % of the swing and {slew} of the slew rate" in " ".join(PAGE.read_text().split())
    for c in boards:
        for temp_degc in (-20.0, 50.0):
            assert not list(amplifier_use.warnings(budget.budget(c, temp_degc=temp_degc).amplifiers))
    d = Device()
    times = 10.0 / d.drive_pole_1_s / d.amplifier_slew_v_per_s
    assert f"ask for {times:.2f} times the slew rate" in ABOUT
    assert f"slews for {1e6 * 10.0 / d.amplifier_slew_v_per_s:.2f} us" in ABOUT
    # the converter's rail at the C/V output
    assert d.adc_vref_v * math.pi / 4 / d.adc_pga_drive == pytest.approx(3.14, abs=5e-3)
    assert d.drive_dac_power_on_v == -10.0


def test_the_docstring_says_what_a_single_step_loses():
    d, tau_s, step_v = Device(), Device().drive_pole_1_s, 10.0
    # fine steps of an amplifier that follows its pole, but no faster than it slews
    dt_s, behind_v, lost, exact = 1e-11, 0.0, 0.0, 0.0
    for n in range(200_000):
        behind_v += dt_s * min(d.amplifier_slew_v_per_s, (step_v - behind_v) / tau_s)
        lost += dt_s * (step_v - behind_v)
        exact += dt_s * step_v * math.exp(-n * dt_s / tau_s)
    kick = 10.0 * 2 / math.pi * Config().firmware.kick_s
    assert 1e6 * (lost - exact) == pytest.approx(2.45, abs=5e-3)
    assert f"loses {100 * (lost - exact) / kick:.2g} % of the kick's area" in ABOUT
