"""The budget's arithmetic: defaults, what each setting moves, and the two assumptions."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbench.errors import ConfigError
from testbench.judge import phases
from testbench.run import budget, run_tables, summary
from tests.testbench.bench_setup import configured, quiet

F = 11002.3
CLOCK_DEG = 360 * F / 26e6


def node(**values):
    return budget.budget(configured(**values)).node_deg()


def test_the_defaults_are_the_sum_of_parts():
    """Clocks and poles counted by hand: the drive path, 7 clocks net of the re-timed reference, hold, three poles."""
    got = node()
    poles = sum(math.degrees(math.atan(2 * math.pi * F * tau)) for tau in (100e-9, 40e-9, 40e-9))
    assert got["xe1"] == pytest.approx(7 * CLOCK_DEG + 360 * F * 0.5e-6 + poles, abs=1e-9)
    poles = sum(math.degrees(math.atan(2 * math.pi * F * tau)) for tau in (68e-9, 16e-9, 40e-9))
    assert got["ye1"] == pytest.approx(15 * CLOCK_DEG + 360 * F * 1.63e-6 + poles, abs=1e-9)


def test_without_the_assumptions():
    """By hand 5.74 and 11.21 deg without re-timing, counting no mean edge quantisation: half a clock less."""
    got = node(firmware__reference_retimed=False)
    assert got["xe1"] == pytest.approx(5.74, abs=0.01 + CLOCK_DEG / 2)
    assert got["ye1"] == pytest.approx(11.21, abs=0.01 + CLOCK_DEG / 2)
    assert node()["xe1"] == pytest.approx(3.76, abs=0.005)
    assert node()["ye1"] == pytest.approx(9.23, abs=0.005)


@given(st.integers(0, 8), st.integers(0, 3), st.integers(0, 2))
def test_registers_and_frames_count(pipe, align, frames):
    base, got = (
        node(),
        node(
            firmware__pipeline_registers=pipe, firmware__reference_registers=align, firmware__frame_latency_sense=frames
        ),
    )
    assert got["xe1"] - base["xe1"] == pytest.approx((pipe - align + 1) * CLOCK_DEG, abs=1e-9)
    assert got["ye1"] - base["ye1"] == pytest.approx((pipe - align + 1 + 26 * (frames - 1)) * CLOCK_DEG, abs=1e-9)
    assert got["xe2"] == base["xe2"]


@given(*[st.integers(0, 8)] * 4)
def test_clocks_of_one_path_count_there(drive_sine, sense_sine, drive_code, sense_code):
    base = node()
    got = node(
        firmware__drive_sine_registers=drive_sine, firmware__sense_sine_registers=sense_sine,
        firmware__drive_code_registers=drive_code, firmware__sense_code_registers=sense_code,
    )  # fmt: skip
    assert got["xe1"] - base["xe1"] == pytest.approx((drive_sine + drive_code) * CLOCK_DEG, abs=1e-9)
    assert got["ye1"] - base["ye1"] == pytest.approx((sense_sine + sense_code) * CLOCK_DEG, abs=1e-9)


def test_two_clocks_of_the_sense_path_on_the_page():
    page = (Path(__file__).parents[3] / "docs" / "phases.md").read_text()
    for key in ("sine", "code"):
        more = node(**{f"firmware__sense_{key}_registers": 2})["ye1"] - node()["ye1"]
        assert f"Two more clocks in the sense path add {more:.3f} deg to ye1" in " ".join(page.split())


@given(st.floats(-90, 90), st.floats(-90, 90))
def test_compensation_words_move_the_phase_they_are_for(sine_deg, ref_deg):
    base, got = node(), node(firmware__phase_sense_sine_deg=sine_deg, firmware__phase_sense_ref_deg=ref_deg)
    moved = got["ye1"] - base["ye1"] - (ref_deg - sine_deg)
    assert (moved + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-9)  # a phase is within half a turn
    assert got["xe1"] == base["xe1"]


@pytest.mark.parametrize(
    ("word", "displaced"),
    [("drive_sine", "xe1"), ("drive_ref", "xe1"), ("sense_sine", "ye1"), ("sense_ref", "ye1")],
)
def test_a_displaced_phase_is_not_compared_with_the_paper(word, displaced):
    """The node that a compensation word moves; the verdicts of the other three are as without it."""
    config, key = configured(**{f"firmware__phase_{word}_deg": 1.0}), f"firmware.phase_{word}_deg"
    base, planned = budget.budget(configured()), budget.budget(config)
    assert [n for n, deg in planned.node_deg().items() if deg != base.node_deg()[n]] == [displaced]
    found, plain = (run_tables.budget_json(b)["paper_verdict"] for b in (planned, base))
    assert found.pop(displaced) == {"verdict": "not comparable", "basis": f"{key} is set", "rests_on": []}
    del plain[displaced]
    assert found == plain
    table = next(t for t in run_tables.budget_tables(planned) if t.title.startswith(displaced))
    sentence = f"{displaced} is not compared with the paper: {key} is set."
    assert sentence in table.note
    assert table.rows[-1][-1] == "not comparable"
    # a run
    said = {
        "locked": True,
        "phase_deg": planned.node_deg(),
        "paper_deg": budget.PAPER_DEG,
        "paper_verdict": phases.verdicts(planned.node_deg(), nonzero_words=planned.nonzero_words),
    }
    notes = summary.notes(config, said, planned)
    assert sentence in notes
    assert any(note.startswith("These three verdicts depend on") for note in notes)
    (gaps,) = (note for note in notes if note.startswith("Measured minus paper"))
    assert displaced not in gaps
    differences = {row[0]: row[-1] for row in run_tables.phases(said).rows}
    assert [n for n, cell in differences.items() if cell == "-"] == [displaced]


def test_two_words_of_a_phase_are_both_named():
    planned = budget.budget(configured(firmware__phase_sense_sine_deg=9.0, firmware__phase_sense_ref_deg=-1.0))
    basis = run_tables.budget_json(planned)["paper_verdict"]["ye1"]["basis"]
    assert basis == "firmware.phase_sense_sine_deg and firmware.phase_sense_ref_deg are set"


def test_loop_phase_is_less_the_switch():
    planned = budget.budget(configured())
    assert planned.loop_deg()["xe2"] - planned.node_deg()["xe2"] == pytest.approx(-360 * F * 80e-9, abs=1e-9)


def test_the_lock_offset_of_the_design():
    """-2.41 mHz at 5.01 deg and Q 2e5; -2.26 mHz with the switch delay taken off."""
    assert budget.lock_frequency_hz(F, 2e5, 3.7647, 1.2459) - F == pytest.approx(-2.41e-3, abs=0.01e-3)
    assert budget.lock_frequency_hz(F, 2e5, 3.7647, 1.2459 - 0.3169) - F == pytest.approx(-2.26e-3, abs=0.01e-3)


def test_a_design_that_a_run_refuses_has_no_budget():
    for values in ({"design__master_hz": 24_000_000, "design__tick_clocks": 24}, {"design__sense_dac_bits": 16}):
        with pytest.raises(ConfigError, match=r"design\.\w+ = \d+ .*(AD5791|generic)"):
            budget.budgets(configured(**values))


def test_a_value_of_the_configuration_is_called_given():
    values = {"nominal__sense_pole_1_s": 1e-7, "nominal__c0_f": 2.5e-12, "firmware__reference_registers": 2}
    default, planned = budget.budget(configured()), budget.budget(configured(**values))

    def texts(planned, node):
        return {row.what: row.assumed for row in planned.rows[node]}

    changes = {"output pole 1": "given", "reference: alignment registers": "given"}
    fitted = {what: text.removeprefix("fitted: ") for what, text in texts(default, "ye1").items()}
    assert texts(planned, "ye1") == fitted | changes
    assert texts(planned, "xe2")["ring diode with its capacitors"] == "given: c0_f"
    notes = [table.note for table in run_tables.budget_tables(planned)]
    assert all('"given" marks a value' in note for note in notes)
    assert "given" not in run_tables.budget_tables(default)[0].note


def test_another_chip_with_the_values_of_the_default_one_is_noted():
    planned = budget.budget(configured(design__sense_dac="DAC8811"))
    ((node, line),) = planned.dac_notes
    assert node == "ye1"
    assert line.startswith('design.sense_dac = "DAC8811": delay, poles and noise of the output are still those of the')
    assert [line in table.note for table in run_tables.budget_tables(planned)] == [False, False, True, False]
    assert run_tables.budget_json(planned)["dac_notes"] == [line]
    assert not budget.budget(configured(design__sense_dac="DAC8811", plant__sense_dac_delay_s=0.0)).dac_notes
    assert not budget.budget(configured()).dac_notes


def test_an_amplitude_beyond_one_percent_of_a_linear_ring_is_a_warning():
    (line,) = budget.ring_warnings(configured())
    assert "1 % at 3.09 um" in line
    assert line.endswith("set-point 5 um. The plant keeps it linear (plant.ring_saturation_on = 0). Choose a smaller "
                         "amplitude_um.")  # fmt: skip
    for values in ({"firmware__amplitude_um": 3.0}, {"plant__ring_saturation_on": 1}):
        assert not list(budget.ring_warnings(configured(**values)))


def test_poles_warm_up_with_the_op_amps():
    cold, hot = (budget.budget(quiet(), temp).node_deg()["xe2"] for temp in (-20.0, 50.0))
    assert hot > cold
