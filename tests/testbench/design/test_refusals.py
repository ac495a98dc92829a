"""Wrong targets and boards that no choice suits: one line each, with the value, the limit and what to do."""

from pathlib import Path

import pytest

from testbench.design import designer, target
from testbench.errors import ConfigError

DISK = {"fx_hz": 14000.7, "fy_hz": 13980.7, "qx": 80e3, "qy": 80e3}
# what is wrong in the file: (tree, texts that the line must have)
WRITTEN = {
    "section": ({"goal": {}}, ("[goal] is not a known section",)),
    "plant": ({"plant": {}}, ("[plant] is not a known section", "; describe the board in [nominal]")),
    "key": ({"target": {"bandwidth": 25.0}}, ("target.bandwidth is not a known key", "bandwidth_hz")),
    "unit": ({"target": {"bandwidth_khz": 0.025}}, ("in Hz", "target.bandwidth_hz = 25")),
    "text": ({"target": {"bandwidth_hz": "25 Hz"}}, ("is text", "write bandwidth_hz = 25")),
    "low": ({"target": {"bandwidth_hz": 0.001}}, ("0.001", "below the limit 0.05 Hz")),
    "negative": ({"target": {"peak_db": -1.0}}, ("-1.0", "below the limit 0.1 dB")),
    "infinite": ({"target": {"startup_s": float("inf")}}, ("startup_s", "finite")),
    "switch": ({"target": {"compensate": 1}}, ("compensate = 1", "not true or false")),
    "twice": (
        {"target": {"amplitude_um": 5.0, "full_scale_deg_s": 900.0}},
        ("full_scale_deg_s", "amplitude_um", "one"),
    ),
    "board": ({"nominal": {"fx_hz": 11.0}}, ("nominal.fx_hz = 11.0", "limit 1000 Hz")),
    "firmware": ({"firmware": {"ftr_crossover_hz": 1e9}}, ("firmware.ftr_crossover_hz", "above the limit 200 Hz")),
    "place": ({"target": {"fx_hz": 11000.0}}, ("fx_hz belongs in [nominal]",)),
}
# what no choice suits, found before the search of the rate loop
RANGES = {
    "force": ({"target": {"max_rate_deg_s": 1e4, "amplitude_um": 5.0}}, ("force at the sense electrode", "V", "lower")),
    "quadrature": ({"target": {"max_quadrature_deg_s": 140.0}}, ("V_q rail", "140", "133.2 deg/s")),
    "leak": ({"target": {"compensate": False}}, ("deg/s is above the limit", "compensate = true")),
    "gap": ({"target": {"gap_um": 6.0, "amplitude_um": 5.0}}, ("displacement x", "limit 2 um", "amplitude")),
    "clipped": ({"target": {"amplitude_um": 7.0}}, ("drive signal at the converter", "3.6 V", "adc_pga_drive")),
    "scale": ({"target": {"scale_lsb_per_deg_s": 1e5}}, ("force at the sense electrode", "9 V")),
    "no scale": ({"target": {"scale_lsb_per_deg_s": 1.0}}, ("amplitude", "outside 0.01 .. 100 um")),
    "hold": ({"target": {"amplitude_um": 5.0}, "nominal": {"qx": 500.0}}, ("keeps the drive amplitude", "limit 2.5 V")),
    "sense code": (
        {"target": {"max_rate_deg_s": 500.0, "amplitude_um": 4.8}, "nominal": DISK},
        ("rate at the sense converter", "0.3 V", "adc_pga_sense"),
    ),
    "coupling": ({"nominal": {"kxy_n_per_m": -0.01}}, ("nominal.kxy_n_per_m = -0.01", "above 0")),
    "no split": ({"nominal": {"fy_hz": 11002.3}}, ("nominal.fx_hz - fy_hz = 0",)),
    "serial clock": ({"design": {"master_hz": 52_000_000}}, ("52000000 Hz", "DAC8811", "50000000 Hz")),
    "frame rate": ({"design": {"frame_ticks": 100}}, ("a conversion every 125 us", "needs 100 us", "[design]")),
    "tick": (
        {"design": {"master_hz": 24_000_000}},
        ("design.tick_clocks = 26 clocks of 24 MHz is 1.083 us; for 1 MHz set tick_clocks = 24",),
    ),
    "demodulator": ({"firmware": {"board": "digital_sid"}}, ("firmware.board", "analog_sid")),
}
# what the search finds impossible
SEARCHED = {
    "split": (
        {"target": {"bandwidth_hz": 25.0}, "nominal": DISK},
        ("25 Hz is above", "split", "20 Hz", "would be enough"),
    ),
    "start-up": ({"target": {"startup_s": 0.9}}, ("target.startup_s = 0.9 s", "slowest board")),
    "quality": ({"nominal": {"qx": 2000.0}, "target": {"bandwidth_hz": 20.0}}, ("qx",)),
    "tolerance": ({"nominal": {"f_tolerance": 0.1}}, ("search", "Hz", "nominal.f_tolerance")),
    "fixed": ({"firmware": {"ftr_crossover_hz": 5.0}}, ("bandwidth_hz", "ftr_crossover_hz")),
    "capacitor": (
        {"target": {"keep_sid": True}, "nominal": {"sid_c_f": 20e-9}},
        ("25 Hz", "nominal.sid_c_f = 2e-08 F", "keep_sid = false"),
    ),
    "frequency": ({"firmware": {"nominal_frequency_hz": 14000.0}}, ("search", "uV", "Hz")),
}


def line_of(tree):
    with pytest.raises(ConfigError) as refused:
        designer.design(target.from_dict(tree, "T.toml"), "T.toml")
    line = str(refused.value)
    assert "\n" not in line
    assert line.startswith("T.toml: ")
    return line


@pytest.mark.parametrize("name", WRITTEN | RANGES)
def test_a_wrong_target_is_one_line(name):
    tree, texts = (WRITTEN | RANGES)[name]
    line = line_of(tree)
    assert all(text in line for text in texts), line


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(SEARCHED) - {"split"}))
def test_what_no_choice_suits_is_one_line(name):
    tree, texts = SEARCHED[name]
    line = line_of(tree)
    assert all(text in line for text in texts), line


def test_what_a_run_refuses_is_not_written():
    assert "nominal.sense_dac_power_on_v = -10 would have no effect" in line_of(
        {"nominal": {"sense_dac_power_on_v": -10.0}}
    )


def test_the_split_stops_a_fast_loop():
    """The refusal that docs/design_of_loops.md shows."""
    line = line_of(SEARCHED["split"][0])
    page = Path(__file__).resolve().parents[3] / "docs" / "design_of_loops.md"
    assert line.removeprefix("T.toml: ") in page.read_text(), line


def test_a_file_that_is_none(tmp_path):
    for name, content, text in (("a.toml", None, "cannot be read"), ("b.toml", "x = [", "is not TOML")):
        if content is not None:
            (tmp_path / name).write_text(content)
        with pytest.raises(ConfigError, match=text):
            target.load(tmp_path / name)
