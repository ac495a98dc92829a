"""What becomes of findings: refused, mended or reported, on the command line and in what is fitted."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from testbench.errors import ConfigError
from testbench.measured import cli
from testbench.measured.formats import readers, sheets
from testbench.measured.openers import open_problem
from testbench.measured.quality.finding import QualityError
from testbench.measured.quality.rows.series import grid_step
from tests.testbench.measured.quality import siblings


def ring(tmp_path, change):
    """A ring-down whose columns {name: values} `change` alters."""
    whole = siblings.draw("ringdown", np.random.default_rng(3))
    return siblings.write(whole._replace(columns=change(dict(whole.columns))), tmp_path / "ring.txt")


def spiked(columns):
    return columns | {"power": columns["power"] + np.where(np.arange(len(columns["power"])) == 40, 5.0, 0.0)}


@pytest.mark.parametrize(
    ("step", "origin"), [(1.0, 0.0), (0.037, 0.0), (1e-9, 0.0), (2.5e-5, 3.0), (0.5, -1000.25), (0.0, 0.0)]
)
def test_the_step_of_a_grid(step, origin):
    rng = np.random.default_rng(1)
    v = rng.normal(size=500)
    if step:
        v = origin + step * np.round(v * 50 if step > 1e-6 else v * 1e7)
    assert grid_step(v) == pytest.approx(step, rel=1e-6)


def test_check_says_what_it_finds_and_what_becomes_of_it(tmp_path):
    run = CliRunner()
    good = ring(tmp_path, lambda columns: columns)
    done = run.invoke(cli.app, ["check", str(good)])
    assert (done.exit_code, done.output) == (0, f"{good}: accepted\n")
    bad = ring(tmp_path, spiked)
    done = run.invoke(cli.app, ["check", str(bad), "--json"])
    assert done.exit_code == 2
    data = json.loads(done.output)
    assert not data["accepted"]
    (found,) = data["quality"]
    assert (found["kind"], found["column"], found["rows"], found["action"]) == ("spikes", "power", [41, 41], "refuse")


def test_a_refusal_comes_before_the_fit_and_can_be_overruled(tmp_path):
    bad = ring(tmp_path, spiked)
    with pytest.raises(QualityError, match=r"spikes: power, rows 41 \.\. 41"):
        open_problem([bad], {})
    assert [f.kind for f in open_problem([bad], {"quality": "report"}).quality] == ["spikes"]
    with pytest.raises(ConfigError, match="quality=no: expected report"):
        open_problem([bad], {"quality": "no"})


def test_rows_in_reverse_order_are_put_right(tmp_path):
    first = readers.content(ring(tmp_path, lambda columns: columns))
    path = ring(tmp_path, lambda columns: {name: v[::-1] for name, v in columns.items()})
    second = readers.content(path)
    assert np.array_equal(second.x, first.x)
    assert np.array_equal(second.power_dbm, first.power_dbm)
    assert [(f.kind, f.action) for f in sheets.examine([path])] == [("reversed", "correct")]


def test_a_power_is_no_logarithm(tmp_path):
    path = ring(tmp_path, lambda columns: columns | {"power": 10 ** ((columns["power"] + 20) / 10)})
    assert ("unit", "power", "refuse") in [(f.kind, f.column, f.action) for f in sheets.examine([path])]


def test_no_floor_is_below_the_steps_of_the_values(tmp_path):
    path = ring(tmp_path, lambda columns: columns | {"power": np.round(columns["power"])})
    assert [f.kind for f in sheets.examine([path])] == ["quantised"]
    floors = [piece.floor for piece in open_problem([path], {"quality": "report"}).all_pieces]
    assert min(floors) >= 1 / np.sqrt(12)


def test_a_spectrum_with_a_gap_keeps_its_frequencies(tmp_path):
    whole = siblings.draw("spectrum", np.random.default_rng(3))
    keep = np.r_[0:100, 160 : len(whole.columns["power"])]
    cut = whole._replace(columns={name: v[keep] for name, v in whole.columns.items()})
    path = siblings.write(cut, tmp_path / "cut.txt")
    assert np.array_equal(readers.content(path).x, cut.columns["frequency"])
    (found,) = sheets.examine([path])
    assert (found.kind, found.rows) == ("gap", (101, 101))
