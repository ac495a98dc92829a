"""The command line tells of a part what the page tells, under any name; and what the closed loop is given."""

import html
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from testbench.measured import cli, in_loop, sets_report, trace_recording
from testbench.measured.formats import registry
from tests.testbench.measured.parts import made, recordings
from tests.testbench.measured.parts.test_pages import KEPT


def told(paths, options, where, name):
    """JSON that `gyro measured trace` writes of files; it must print the verdict, too."""
    out, page = where / f"{name}.json", where / f"{name}.html"
    given = [word for key, value in options.items() for word in ("--option", f"{key}={value}")]
    done = CliRunner().invoke(cli.app, ["trace", *map(str, paths), "--json", str(out), "--report", str(page), *given])
    assert done.exit_code == 0, done.output
    data = json.loads(out.read_text())
    assert data["verdict"] in done.output
    assert html.escape(data["sentence"]) in page.read_text()
    return data


def copies(paths, where):
    where.mkdir()
    return [shutil.copy(path, where / f"recording{k}.bin") for k, path in enumerate(paths)]


def same(paths, options, where, name):
    """The report of files, the same by the page's way and by the command line's under other names."""
    text = trace_recording.text(sets_report.trace_job(paths, options)[0])
    renamed = copies(paths, where / name)
    for old, new in zip(paths, renamed, strict=True):
        text = text.replace(str(old), str(new)).replace(Path(old).name, Path(new).name)
    data = json.loads(text)
    assert told(renamed, options, where, name) == data
    return data


@pytest.mark.slow
def test_a_ring_down(tmp_path):
    rng, t, paths = np.random.default_rng(3), np.linspace(0.0, 40.0, 240), []
    for k, level in enumerate((1.0, 0.7)):
        power = recordings.decay(t, level, 0.1, lambda p: 0.06 * p * p, rng)
        paths.append(recordings.ring(tmp_path / f"{k}.txt", "A", 10 + k, t, power))
    data = same(paths, {}, tmp_path, "ring")
    assert [e["law"] for e in data["effects"]] == ["damping_cubic"]
    assert len(data["gyroscope"]) == 1
    assert [row["segment"] for row in data["left"]] == list(data["heldout"])
    (case,) = in_loop.cases({"set": {"jobs": [data | {"label": "A"}]}})
    assert case.settings["laws"] == [data["gyroscope"][0]["text"]]


def test_the_levels_of_a_dac(tmp_path):
    rng = np.random.default_rng(1)
    paths = [made.levels(tmp_path / f"{k}.mat", rng, [(5, 8, -2.0)]) for k in range(2)]
    data = same(paths, {"fit": "2"}, tmp_path, "levels")
    assert data["effects"][0]["law"] == "8 segments above a ladder"
    names = [case.name for case in in_loop.cases({"set": {"jobs": [data | {"label": "A"}]}})]
    assert names == ["set: levels as drive DAC", "set: levels as force DAC"]


def effect(law, value, port="", kind="instrument", text=""):
    return {"law": law, "port": port, "value": value, "kind": kind, "text": text, "full_v": 10.0}


def test_of_each_kind_of_law_the_worst_meter_runs_and_the_rest_is_listed():
    meters = [effect("a: turnover", 10.0), effect("b: turnover", -30.0), effect("a: start 120 s", 3.0)]
    lines = [
        effect("z: vibration 20 Hz", 0.04) | {"hz": 19.5, "quality": 8.0},
        effect("sweep_rate", 1059.0, "instrument"),
    ]
    sets = {"m": {"jobs": [{"label": "1", "effects": meters}, {"label": "2", "effects": lines}]}}
    turnover, line = in_loop.cases(sets)
    assert "b as converter" in turnover.name
    assert turnover.settings == {"adc_turnover": pytest.approx(-3e-6)}
    assert line.vibration == (19.5, 8.0, pytest.approx(0.2))
    assert [row[2] for row in in_loop.not_run(sets)] == ["a: start 120 s", "sweep_rate"]


@pytest.mark.slow
@pytest.mark.skipif(not os.environ.get(registry.FOLDER), reason=f"{registry.FOLDER} is not set")
@pytest.mark.parametrize("name", [*registry.SETS])
def test_published_sets(tmp_path, name):
    for k, (label, paths, options) in enumerate(sets_report.jobs(registry.paths(name))):
        data = same(paths, options, tmp_path, f"job{k}")
        (kept,) = (job for job in KEPT[name]["jobs"] if job["label"] == label)
        assert (data["verdict"], [e["law"] for e in data["effects"]]) == (
            kept["verdict"],
            [e["law"] for e in kept["effects"]],
        )
        for part, h in data["heldout"].items():
            assert h["after"] == pytest.approx(kept["heldout"][part]["after"], rel=1e-3)
