"""docs/import.md: its example from file to verdict, word for word, and its map."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from testbench.measured.importing import assemble, record_map
from testbench.measured.record import schema
from testbench.measured.record.sessions import sessions
from testbench.storage.record_read import read_record
from tests import tutorials
from tests.testbench.measured.importing import independent_writer
from tests.testbench.measured.importing.test_independent_writer import contents

PAGE = Path(__file__).resolve().parents[4] / "docs" / "import.md"
FILES = dict(step for step in tutorials.steps(PAGE) if not isinstance(step, tutorials.Command))


def test_the_page_lists_every_key_of_a_map():
    text = PAGE.read_text()
    parts = (record_map.Map, record_map.Time, record_map.Stream, record_map.Profiles, record_map.Write)
    for part in (*parts, record_map.PowerOn, record_map.Segment, record_map.Dwells):
        for key in part.model_fields:
            assert f"`{key}`" in text or f"[{key}]" in text or f"[{key}." in text, (part, key)


def test_the_pages_map_makes_a_record_of_a_short_file(small, tmp_path):
    """The columns of the example over the start-up of another power-on: every word is that of the board."""
    rows = sessions(small)[0].rows
    codes = [small.streams[name].data[rows] for name in schema.ADC]
    table = np.stack([125e-6 * np.arange(len(codes[0])), *codes], axis=1)
    csv, toml = tmp_path / "bench.csv", tmp_path / "bench.toml"
    np.savetxt(csv, table, ["%.6f", *["%d"] * 4], ",", header="t_s,xI,xQ,yI,yQ", comments="")
    toml.write_text(FILES["bench.toml"])
    found = assemble.import_files([csv], toml)
    assert found.lacking == ""
    for name in ("nco_fword", "amplitude_word", "rate_word", "quadrature_code", "state"):
        assert np.array_equal(found.record.streams[name].data, small.streams[name].data[rows]), name


def run(folder, *argv):
    done = subprocess.run(
        [sys.executable, "-m", "testbench.commands.main", *argv], cwd=folder, env=tutorials.environment()
    )
    assert done.returncode == 0, argv


@pytest.mark.slow
def test_the_example_goes_from_file_to_verdict(tmp_path, monkeypatch):
    """With its effect a class of at most five that holds it, and the next experiment; without it nothing.

    What is traced without the effect is the record as another program writes it, with the four channels alone.
    """
    monkeypatch.setattr(tutorials, "TIMEOUT_S", 1800)
    tutorials.follow(PAGE, tmp_path)
    found = json.loads((tmp_path / "bench.json").read_text())
    assert found["verdict"] == "candidate"
    members = [cause["laws"] for cause in found["causes"]]
    assert ["quadrature_cubic"] in members
    assert 1 <= len(members) <= 5
    assert found["next_experiment"]
    assert max(e["d"] for e in found["effects"]) > 20
    run(tmp_path, "run", "--config", "board.toml", "--seed", "8", "--out", "board", "--discard")
    subprocess.run([sys.executable, "to_csv.py"], cwd=tmp_path, check=True)
    run(tmp_path, "measured", "import", "bench.csv", "--map", "bench.toml", "-o", "clean.h5")
    independent_writer.write(tmp_path / "theirs.h5", *contents(read_record(tmp_path / "clean.h5")))
    run(tmp_path, "measured", "trace", "theirs.h5", "--json", "clean.json")
    found = json.loads((tmp_path / "clean.json").read_text())
    assert (found["verdict"], found["effects"]) == ("none", [])
