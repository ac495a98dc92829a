"""docs/measured.md: every rule, stream and command is there, with the numbers of the code; and the command line."""

import json
import re
from pathlib import Path

import pytest

from testbench.commands.main import main
from testbench.config import Config
from testbench.measured import cli
from testbench.measured.record import recording_plan, schema, timing
from testbench.measured.residual import residuals, simulator
from testbench.storage.record import write_record

ROOT = Path(__file__).resolve().parents[3]
PAGE = " ".join((ROOT / "docs" / "measured.md").read_text().split())


def test_every_stream_rule_and_command_is_on_the_page():
    for name in schema.STREAMS:
        assert f"`{name}`" in PAGE, name
    for number in range(1, 21):
        assert f"| R{number:02d} |" in PAGE
    for command in cli.app.registered_commands:
        assert f"gyro measured {command.name or command.callback.__name__} " in PAGE
    for name in (*schema.TABLES, *schema.OPTIONAL_TABLES):
        assert f"`{name}`" in PAGE, name


def test_numbers_on_the_page():
    assert f"clock {timing.valid_clock(Config())} of every frame" in PAGE
    assert f"the mean of {residuals.DRAWS} draws" in PAGE
    assert simulator.SETTLED_EDGES / 26e6 == 0.25
    assert schema.MOST_SATURATED == 0.001
    widths = re.findall(r"\| `(adc_xI|dac_drv|nco_fword|amplitude_word|magnitude)`[^|]*\| ([\d, ]+) \|", PAGE)
    first = {name: int(bits.split(",")[0]) for name, bits in widths}
    assert first == {name: schema.STREAMS[name].bits for name in first}
    assert len(first) == 5


def test_the_plan_on_the_page_is_one(tmp_path):
    text = (ROOT / "docs" / "measured.md").read_text().split("## Plan")[1]
    lines = [line[4:] for line in text.splitlines() if line.startswith("    ") or not line]
    (tmp_path / "plan.toml").write_text("\n".join(lines))
    wanted = recording_plan.read(tmp_path / "plan.toml")
    assert [c.id for c in wanted.conditions] == ["nominal", "step"]
    assert wanted.hidden == {"plant.qx": 199000.0}
    assert wanted.model.plant.fx_hz == 11002.5


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"condition": []}, "needs 1 to 256 conditions"),
        ({"conditon": []}, "conditon is not a key here; did you mean condition?"),
        ({"condition": [{"id": "a", "a_um": 50.0}]}, r"condition\[0\].a_um = 50.0 is outside 0.1 .. 10 um"),
        ({"condition": [{"id": "a", "role": "both"}]}, 'role = "both" is not fit | validate | none'),
        ({"condition": [{"id": "a"}, {"id": "a"}]}, "condition ids must differ"),
        ({"set": {"scenario.seconds": 3.0}}, r"expected a key of \[firmware\]"),
        ({"truth": {"plant.qx": -1.0}}, "plant.qx = -1.0 is below the limit"),
        ({"set": {"noise.seed": 3}}, "the plan's key seed"),
        ({"prior": [{"param": "plant.qx"}]}, "needs param, mean and sd"),
    ],
)
def test_a_mistake_in_a_plan_is_one_line(tree, change, line):
    from testbench.errors import ConfigError

    with pytest.raises(ConfigError, match=line.replace("|", r"\|")) as caught:
        recording_plan.from_dict({**tree, **change})
    assert "\n" not in str(caught.value)


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(a) for a in arguments])
    return ended.value.code


def test_the_command_line(small, tmp_path, capsys):
    path = tmp_path / "a.h5"
    write_record(path, small)
    assert run("measured", "check", path, "--json") == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["accepted"], data["findings"], data["r0"]["first"]) == (True, [], None)
    assert run("measured", "check", path) == 0
    assert "R0 is 0 LSB in" in capsys.readouterr().out
    assert run("measured", "convert", path, tmp_path / "a") == 0
    assert list((tmp_path / "a").glob("streams_*.parquet"))
    capsys.readouterr()
    assert run("measured", "residuals", path, "--kind", "R1", "--json") == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert len(rows) == 8
    assert run("measured", "residuals", path, "--kind", "R1", "--set", "plant.qx=190000") == 0
    assert "chi2 / bins" in capsys.readouterr().out
    path.write_bytes(path.read_bytes()[:-5000])
    assert run("measured", "check", path) == 2
    assert "refused" in capsys.readouterr().out
    assert run("measured", "residuals", path) == 2
    assert capsys.readouterr().err.startswith("gyro: ")
    assert run("measured", "residuals", path, "--kind", "R3") == 2
