"""Configuration: planted mistakes give one exact line each, random nonsense gives a line and never a traceback."""

import math
import sys
import tomllib
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from analog_frontend.parts.device import Device
from testbench import config
from testbench.config import config_errors
from testbench.config.toml_text import toml_key, toml_value
from testbench.errors import ConfigError

ROOT = Path(__file__).resolve().parents[3]
sys.path.append(str(ROOT / "docs"))

import pages  # noqa: E402

# TOML text, and the one line it must give
MISTAKES = [
    ("[firmware]\npipeline_registers = 12", "firmware.pipeline_registers = 12 is above the limit 8 registers"),
    ("[firmware]\npipeline_registers = -1", "firmware.pipeline_registers = -1 is below the limit 0 registers"),
    ("[firmware]\npipeline_registers = 2.5", "firmware.pipeline_registers = 2.5 is not an integer (0 to 8 registers)"),
    (
        "[firmware]\npipeline_registers = true",
        "firmware.pipeline_registers = true is not an integer (0 to 8 registers)",
    ),
    (
        "[firmware]\npipline_registers = 1",
        "firmware.pipline_registers is not a known key; did you mean firmware.pipeline_registers?",
    ),
    (
        "[firmware]\namplitude_m = 5e-6",
        "firmware.amplitude_m is not a known key; this quantity is in um: firmware.amplitude_um = 5",
    ),
    (
        '[firmware]\namplitude_um = "5 um"',
        'firmware.amplitude_um = "5 um" is text; the key needs a bare number in um: write amplitude_um = 5',
    ),
    (
        '[firmware]\namplitude_um = "5e-6 m"',
        'firmware.amplitude_um = "5e-6 m" is text; the key needs a bare number in um: write amplitude_um = 5',
    ),
    (
        '[firmware]\namplitude_um = "5 V"',
        'firmware.amplitude_um = "5 V" is text; the key needs a bare number in um: V cannot be converted to it',
    ),
    ('[firmware]\namplitude_um = "big"', 'firmware.amplitude_um = "big" is not a number (0.001 to 100 um)'),
    (
        '[firmware]\nboard = "digital-sid"',
        'firmware.board = "digital-sid" is none of "analog_sid" | "digital_sid"; did you mean digital_sid?',
    ),
    ("[firmware]\nquadrature_update_khz = 7", "firmware.quadrature_update_khz = 7 is none of 500 | 1000 kHz"),
    ("[firmware]\nreference_retimed = 1", "firmware.reference_retimed = 1 is not true or false"),
    ("[firmware]\nagc_zero_hz = nan", "firmware.agc_zero_hz = nan is not finite (0.001 to 100 Hz)"),
    ("[firmware]\nagc_zero_hz = inf", "firmware.agc_zero_hz = inf is not finite (0.001 to 100 Hz)"),
    ("[firmware]\nagc_zero_hz = []", "firmware.agc_zero_hz = [] is not a number (0.001 to 100 Hz)"),
    ("[firmware]\nseconds = 3", "firmware.seconds is not a known key; seconds belongs in [scenario]"),
    ("[plant]\nfx_khz = 11.01", "plant.fx_khz is not a known key; this quantity is in Hz: plant.fx_hz = 11010"),
    ("[plant]\nfx = 11010", "plant.fx is not a known key; this quantity is in Hz: plant.fx_hz"),
    ("[plant]\nkxy_n_per_mm = 5.6e-5", "plant.kxy_n_per_mm is not a known key; did you mean plant.kxy_n_per_m?"),
    ("[plant]\nqx = 1", "plant.qx = 1 is below the limit 100"),
    (
        "[plant]\nadc_pga_sense = 5",
        "plant.adc_pga_sense = 5 is none of the gains (1, 2, 3, 4, 6, 8, 12) (limits 1 .. 12, unit 1)",
    ),
    (
        "[plant]\nadc_clock_ppm = 3",
        'plant.adc_clock_ppm = 3 needs firmware.adc_clock = "free_running"; it is "synchronous"',
    ),
    (
        "[effects]\nadc_curve = [0.05]",
        "effects.adc_curve = [0.05] is not a list of up to 13 numbers within -0.01 .. 0.01",
    ),
    ("[effect]\nx = 1", "[effect] is not a known section; did you mean [effects]?"),
    (
        "[wobble]\nx = 1",
        "[wobble] is not a known section; known: design, firmware, nominal, plant, effects, noise, scenario, output",
    ),
    ("seconds = 3", "seconds is not in a section; seconds belongs in [scenario]"),
    ("firmware = 3", "firmware = 3 is not a section; write [firmware] and its keys below"),
    ("[noise]\nseed = -1", "noise.seed = -1 is below the limit 0"),
    ('[noise]\ncv = "off"', 'noise.cv = "off" is not true or false'),
    ("[scenario]\nresume = 5", "scenario.resume = 5 is not a text in quotes"),
    ("[scenario]\nseconds = 0", "scenario.seconds = 0 is below the limit 0.001 s"),
    ("[scenario]\nrate_dps = [[0, 0], [1, 2000]]", "scenario.rate_dps[1] = 2000 is above the limit 1000 deg/s"),
    ('[scenario]\nrate_dps = "100 dps"', 'scenario.rate_dps = "100 dps": the value is not a number'),
    ("[scenario]\ntemperature_degc = 300", "scenario.temperature_degc = 300 is above the limit 125 degC"),
    (
        '[scenario]\nfaults = [[0.5, "adc_stick", "sense_sin", 0, 0.1]]',
        'scenario.faults[0] = "adc_stick" is not a kind of fault; did you mean adc_stuck?',
    ),
    (
        '[scenario]\nfaults = [[5, "adc_stuck", "sense_sin", 0, 0.1]]',
        "scenario.faults[0] is at 5 s, outside 0 to 2 s (scenario.seconds)",
    ),
    (
        '[firmware]\npipeline_registers = 12\nboard = "x"',
        'firmware.board = "x" is none of "analog_sid" | "digital_sid" (and 1 more)',
    ),
    ("[firmware", "is not TOML: ..."),
    ("[firmware]\nx = 1\nx = 2", "is not TOML: ..."),
    (b"[firmware]\nboard = '\xff'", "is not UTF-8 text (byte 20)"),
]


@pytest.mark.parametrize(("text", "line"), MISTAKES, ids=[line[:60] for _, line in MISTAKES])
def test_a_planted_mistake_gives_this_line(tmp_path, text, line):
    path = tmp_path / "config.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError) as caught:
        config.load(path)
    said = str(caught.value).replace(f"{tmp_path}/", "")
    # how tomllib words it depends on the version of Python
    assert said.startswith(f"config.toml: {line[:-3]}") if line.endswith("...") else said == f"config.toml: {line}"


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match=r"no\.toml: cannot be read: No such file or directory$"):
        config.load(tmp_path / "no.toml")
    with pytest.raises(ConfigError, match="is not a regular file"):
        config.load(tmp_path)


# ---- defaults, overrides, writing ------------------------------------------------------------------------------------


def test_the_defaults_are_those_of_the_device():
    checked = config.load()
    assert checked.device() == Device()
    assert checked.firmware.reference_registers == 1
    assert checked.firmware.reference_retimed
    assert checked.firmware.frame_latency_sense == 1
    assert checked.scenario.rate_dps == 0.0


def test_an_override_wins_and_is_named_in_the_error(tmp_path):
    path = tmp_path / "config.toml"
    path.write_text("[plant]\nfx_hz = 11005\n[scenario]\nrate_dps = 3\n")
    checked = config.load(path, ["plant.fx_hz=11010", config.Override("noise.seed", 7, "--seed")])
    assert checked.device() == Device(fx_hz=11010.0)
    assert (checked.noise.seed, checked.scenario.rate_dps) == (7, 3)
    with pytest.raises(ConfigError, match=r"^--set: plant\.fx_hz = 1 is below the limit 1000 Hz$"):
        config.load(path, ["plant.fx_hz=1"])
    with pytest.raises(ConfigError, match=r"^--seed: noise\.seed = -1 is below the limit 0$"):
        config.load(path, [config.Override("noise.seed", -1, "--seed")])
    with pytest.raises(ConfigError, match=r"^--rate-dps: scenario\.rate_dps = 2000 is above"):
        config.load(path, [config.Override("scenario.rate_dps", 2000.0, "--rate-dps")])


@pytest.mark.parametrize("text", ["plant.fx_hz", "fx_hz=3", "=3", "plant.=3", "plant.fx hz=3", ""])
def test_a_malformed_set_is_refused(text):
    with pytest.raises(ConfigError, match=r"^--set: .* is not of the form section\.key=value"):
        config.load(None, [text])


def test_a_bare_word_after_set_is_text():
    assert config.load(None, ["firmware.board=digital_sid"]).firmware.board == "digital_sid"
    assert config.load(None, ["firmware.reference_retimed=false"]).firmware.reference_retimed is False


def test_an_override_below_a_value_is_refused():
    with pytest.raises(ConfigError, match="plant is a value, not a section"):
        config.load(None, [config.Override("plant", 3, "--set"), "plant.fx_hz=3"])


def test_the_written_configuration_reads_back_the_same():
    changes = {
        "scenario.rate_dps": [[0, 0.1], [0.5, 100]],
        "scenario.faults": [[0.25, "adc_stuck", "sense_sin", -5, math.inf]],
        "scenario.resume": 'a "quoted" \\ path\n',
        "plant.fx_hz": 0.1 + 11000,
        "firmware.board": "digital_sid",
    }
    checked = config.changed(config.load(), changes)
    again = config.from_dict(tomllib.loads(config.to_toml(checked)))
    assert again == checked
    assert config.to_toml(again) == config.to_toml(checked)
    assert config.from_dict(tomllib.loads(config.to_toml(checked, inherited=False))) == checked


def test_a_configuration_is_written_without_what_follows_the_nominal_board():
    checked = config.from_dict({"nominal": {"fx_hz": 14000.0}, "plant": {"qx": 9e4}})
    tree = tomllib.loads(config.to_toml(checked, inherited=False))
    assert config.from_dict(tree) == checked
    assert tree["plant"] == {"qx": 9e4}
    assert "plant" not in tomllib.loads(config.to_toml(config.load(), inherited=False))


def test_a_configuration_cannot_be_changed_in_place():
    checked = config.load()
    with pytest.raises(ValueError, match="frozen"):
        checked.firmware.pipeline_registers = 3


# ---- two boards ------------------------------------------------------------------------------------------------------


def test_the_default_nominal_board_is_the_default_plant():
    checked = config.load()
    assert checked.nominal_device() == checked.device() == Device()
    assert checked.firmware.nominal_frequency_hz == Device().fx_hz


def test_what_a_file_does_not_give_follows_the_nominal_board():
    tree = {"nominal": {"fx_hz": 14000.0, "qx": 8e4}, "plant": {"qx": 9e4}}
    checked = config.from_dict(tree)
    assert (checked.plant.fx_hz, checked.firmware.nominal_frequency_hz) == (14000.0, 14000.0)
    assert (checked.nominal.qx, checked.plant.qx) == (8e4, 9e4)
    assert tree == {"nominal": {"fx_hz": 14000.0, "qx": 8e4}, "plant": {"qx": 9e4}}
    assert config.changed(config.load(), {"nominal.fx_hz": 14000.0}).plant.fx_hz == 14000.0
    drawn = config.changed(checked, {"plant.fx_hz": 14010.0})
    assert config.changed(drawn, {"nominal.fx_hz": 13000.0}).plant.fx_hz == 14010.0
    assert config.from_dict(tomllib.loads(config.to_toml(drawn))) == drawn


def test_the_plant_alone_leaves_the_firmware_designed_for_the_nominal_board():
    checked = config.load(None, ["plant.fx_hz=14000"])
    assert checked.nominal_device() == Device()
    assert checked.firmware == config.load().firmware


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("nominal.fx_hz=1e6", "nominal.fx_hz = 1000000.0 is above the limit 50000 Hz"),
        ("nominal.adc_pga_sense=5", "nominal.adc_pga_sense = 5 is none of the gains (1, 2, 3, 4, 6, 8, 12) "),
        ("nominal.q_tolerance=0.5", "nominal.q_tolerance = 0.5 is below the limit 1"),
        ("plant.q_tolerance=3", "plant.q_tolerance is not a known key; q_tolerance belongs in [nominal]"),
        ("firmware.fx_hz=11000", "firmware.fx_hz is not a known key; fx_hz belongs in [nominal] or [plant]"),
    ],
)
def test_a_mistake_in_a_nominal_board_is_said_once(text, line):
    with pytest.raises(ConfigError) as caught:
        config.load(None, [text])
    assert str(caught.value).startswith(f"--set: {line}")
    assert "more)" not in str(caught.value)


scalars = st.one_of(
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=20),
)


@given(st.recursive(scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=3)))
def test_a_value_written_as_toml_reads_back(value):
    back = tomllib.loads(f"{toml_key('key é')} = {toml_value(value)}")["key é"]
    assert toml_value(back) == toml_value(value)
    assert type(back) is type(value)


# ---- the compensation words ------------------------------------------------------------------------------------------


def test_round_angles_are_round_words():
    assert [config.phase_word(a) for a in (0, 90, -90, 180, -180)] == [0, 1 << 46, 3 << 46, 1 << 47, 1 << 47]


@given(st.floats(-180, 180))
def test_a_phase_word_is_the_nearest(angle_deg):
    word = config.phase_word(angle_deg)
    assert 0 <= word < 1 << 48
    error = Fraction(word) - Fraction(angle_deg) / 360 * 2**48
    assert abs((error + 2**47) % 2**48 - 2**47) <= Fraction(1, 2)


def test_the_words_come_in_the_order_of_the_registers():
    keys = ("drive_sine", "sense_sine", "drive_ref", "sense_ref")
    checked = config.changed(config.load(), {f"firmware.phase_{key}_deg": 45.0 * k for k, key in enumerate(keys)})
    assert checked.firmware.phase_words() == tuple(k << 45 for k in range(4))


# ---- units -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "have", "want", "result"),
    [
        (5e-6, "m", "um", 5.0),
        (11.0023, "khz", "hz", 11002.3),
        (50, "ns", "s", 5e-8),
        (3, "pf", "f", 3e-12),
        (1, "rad", "deg", 57.2957795131),
        (1, "um", "hz", None),
        (1, "um", "parsec", None),
    ],
)
def test_units_convert_only_within_a_quantity(value, have, want, result):
    assert config_errors.convert(value, have, want) == result


# ---- nonsense --------------------------------------------------------------------------------------------------------

KEYS = [f"{section}.{key}" for section, model in config.sections().items() for key in model.model_fields]
nonsense = st.recursive(
    scalars | st.sampled_from(["5 um", "1e3 kHz", "adc_stuck", "sense_sin"]), lambda inner: st.lists(inner, max_size=5)
)


def refusal(load, *args):
    """The line with which `load` refuses, or None; any other exception is a failure of the test."""
    try:
        load(*args)
    except ConfigError as problem:
        return str(problem)
    return None


def one_line(text):
    return text is None or (
        0 < len(text) < 400 and not any(bad in text for bad in ("\n", "Traceback", "pydantic", "Value error"))
    )


@settings(max_examples=3 * settings.default.max_examples)
@example([("output.columns", [[False, 1e14, "a long text of no meaning", 1e14, 1e14]])])
@given(st.lists(st.tuples(st.sampled_from(KEYS), nonsense), min_size=1, max_size=4))
def test_nonsense_in_known_keys_is_refused_in_one_line(pairs):
    text = refusal(config.load, None, [config.Override(path, value) for path, value in pairs])
    assert one_line(text)
    assert text is None or text.startswith("--set: ")


@given(st.dictionaries(st.text(max_size=12), st.dictionaries(st.text(max_size=12), nonsense, max_size=3), max_size=3))
def test_nonsense_in_unknown_keys_is_refused_in_one_line(tree):
    assert one_line(refusal(config.from_dict, tree, "config.toml"))


@given(st.binary(max_size=60) | st.text(alphabet="[]{}=\"'.\n\t#, abx019-+e_", max_size=60).map(str.encode))
def test_a_damaged_file_is_refused_in_one_line(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("config") / "config.toml"
    path.write_bytes(data)
    assert one_line(refusal(config.load, path))


# ---- documentation ---------------------------------------------------------------------------------------------------


def test_the_documented_tables_are_the_code():
    page = pages.part("keys")
    assert all(f"| `{path.split('.')[1]}` |" in page for path in KEYS)


def test_the_example_of_the_page_is_valid():
    page = (ROOT / "docs" / "configuration.md").read_text()
    example = page.split("```toml\n")[1].split("```")[0]
    assert config.from_dict(tomllib.loads(example)).scenario.seconds == 2.0


def test_every_key_has_limits_or_choices_and_a_meaning():
    for section, model in config.sections().items():
        for key, info in model.model_fields.items():
            if info.annotation in (int, float):
                assert any(hasattr(m, "ge") for m in info.metadata), f"{section}.{key} has no limits"
            described = info.description or key in Device._fields
            assert described, f"{section}.{key} has no meaning"
