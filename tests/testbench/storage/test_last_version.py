"""Files that version 0.1.0 wrote are read: record, state, checkpoint, campaign store, measurement record.

Its design had 213 registers, this one has 217: a state or checkpoint continues with the reset values of the other four.
"""

import json
import shutil
from pathlib import Path

import numba
import numpy as np
import pytest

from testbench import flatten
from testbench.campaign import collect, store
from testbench.commands import main as cli
from testbench.config import changed, from_dict
from testbench.measured.record import load_record
from testbench.run import simulation
from testbench.storage import record_read, state_file
from testbench.storage.inputs import read_toml
from testbench.storage.record import RecordError

WRITTEN = Path(__file__).resolve().parents[2] / "data" / "written_by_0.1.0"
closed_loop = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A copy of the files, and the current folder."""
    shutil.copytree(WRITTEN, tmp_path / "files")
    monkeypatch.chdir(tmp_path / "files")
    return tmp_path / "files"


def said(capsys, *argv):
    """Standard output of a command that succeeds."""
    with pytest.raises(SystemExit) as caught:
        cli.main(list(argv))
    out, err = capsys.readouterr()
    assert (caught.value.code, err) == (0, "")
    return out


def configured(path, toml):
    """Checked configuration of a text, written to `path` for its reader."""
    path.write_text(toml)
    return from_dict(read_toml(path))


def test_a_record_is_read_and_its_content_hash_holds(tmp_path):
    record = record_read.read_record(WRITTEN / "run.h5")
    assert record.content_sha256 == "d0174ff4fbea77bc22afd424a280401b60d0803e1db88d1e0a177fb5722e96d8"
    assert sorted(record.streams) == ["frequency_word", "quadrature_code", "rate_word", "state"]
    assert record.versions["ftr-gyro"] == "0.1.0"
    scenario = configured(tmp_path / "config.toml", record.config_toml).scenario
    assert (scenario.seconds, scenario.rate_dps) == (0.02, 100.0)


def test_a_measurement_record_is_read_and_checked():
    loaded = load_record.load(WRITTEN / "gyrorec.h5", replay=False)
    # that version stated half the volts per code of its bipolar DACs
    assert [str(finding).split()[:2] for finding in loaded.findings] == [
        ["R14", "/segments"],
        ["R29", "/streams/dac_drv"],
        ["R29", "/streams/dac_ftr"],
    ]
    assert loaded.record.provenance == "simulated"


def test_the_registers_that_it_did_not_have_begin_at_their_reset_values():
    sim = simulation.Simulation(from_dict({}), 25.0, 25.0)
    values, _ = state_file.load_state(WRITTEN / "state.h5", *sim.layouts())
    assert len(values["fpga"]) == 213
    sim.set_state(values)
    held = dict(flatten.leaves(sim.state.fpga))
    assert len(held) == 213 + len(simulation.ADDED)
    assert [held.pop(name) for name in simulation.ADDED] == [0, 0, 0, 0]
    assert list(held.values()) == values["fpga"].tolist()
    with pytest.raises(RecordError, match=rf"R11 / expected state layout {sim.layout()}, found engine-1"):
        state_file.load_state(WRITTEN / "state.h5", sim.layout())


@closed_loop
def test_a_state_is_continued_to_the_same_codes(folder, capsys):
    settings = ("scenario.diagnose=false", "output.pictures=false", "output.html=false")
    sets = [part for text in settings for part in ("--set", text)]
    found = json.loads(
        said(capsys, "run", "--resume", "state.h5", "--seconds", "0.005", *sets, "--across-versions", "--json")
    )
    assert found["locked"]
    assert found["codes_sha256"] == "00bc5f4329447d2b322b791d9d82d548603d5f7bdc21024f0652986f9a7bb2de"


@closed_loop
def test_an_interrupted_run_is_continued_to_the_bytes_of_an_uncut_one(folder, capsys):
    found = json.loads(said(capsys, "run", "--resume-run", "interrupted", "--across-versions", "--json"))
    wanted = json.loads((folder / "uncut.json").read_text())
    of_the_wall = ("wall_s", "real_time_factor", "files")
    assert found.pop("warnings") == []
    # keys that came later are not in the last version's
    kept = [key for key in wanted if key not in (*of_the_wall, "warnings")]
    assert {key: found[key] for key in kept} == {key: wanted[key] for key in kept}
    have, want = (record_read.read_record(path) for path in ("interrupted/run.h5", "uncut.h5"))
    assert have.streams.keys() == want.streams.keys()
    for name, column in want.streams.items():
        np.testing.assert_array_equal(have.streams[name].data, column.data)
    # the configuration of another folder, with the flag; else the same
    one, other = (configured(folder / "config.toml", record.config_toml) for record in (have, want))
    assert one.scenario.across_versions
    assert changed(one, {"output.directory": other.output.directory, "scenario.across_versions": False}) == other


def test_a_campaign_store_is_listed_and_collected_to_the_same_results(folder, capsys):
    assert said(capsys, "campaign", "status", "store").startswith("two                  2/2 points finished")
    opened = store.Store.open_folder("store")
    addresses = collect.read_stored_plan(opened, "two").addresses
    points = [collect.read_point(opened, address)[1] for address in addresses]
    assert [float(point["rate_word.mean"].data) for point in points] == pytest.approx(
        [592883.03125, 892476.11], rel=1e-6
    )
    kept = (folder / "store/results/two.csv").read_bytes()
    (folder / "store/results/two.csv").unlink()
    said(capsys, "campaign", "collect", "store", "two")
    assert (folder / "store/results/two.csv").read_bytes() == kept
