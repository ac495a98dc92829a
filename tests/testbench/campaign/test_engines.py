"""Which code runs as an engine: that of an option or of an installed package, never that of a file."""

import json
import sys

import pytest

from testbench.campaign.plan import engines, plan
from testbench.campaign.plan.plan_points import canonical
from testbench.campaign.store import Store
from testbench.errors import ConfigError
from tests.testbench.campaign.helpers import OWN, plan_file, run_json
from tests.testbench.command import gyro

PLACE = "tests.testbench.campaign.instant:ENGINE"
EVIL = "import pathlib\npathlib.Path({mark!r}).touch()\nENGINE = 1\n"


@pytest.fixture
def evil(tmp_path, monkeypatch):
    """A module that leaves a mark when it is imported; the mark."""
    (tmp_path / "evil_engine.py").write_text(EVIL.format(mark=str(tmp_path / "mark")))
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / "mark"
    sys.modules.pop("evil_engine", None)


@pytest.mark.parametrize(
    "text",
    [
        'engine = "evil_engine:ENGINE"',
        '[axes.by]\nengine = ["frame", "evil_engine:ENGINE"]',
        '[[axes.by.cases]]\nname = "a"\nengine = "evil_engine:ENGINE"',
    ],
)
def test_a_plan_names_no_code(tmp_path, evil, text):
    path = tmp_path / "p.toml"
    path.write_text(text + "\n")
    for argv in (("check", path), ("run", path, "--out", tmp_path / "s")):
        done = gyro("campaign", *argv)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert "a plan cannot name code to run" in done.stderr
        assert "give the option --engine NAME=evil_engine:ENGINE" in done.stderr
    assert not evil.exists()


def test_the_place_of_an_engine_that_has_a_name_is_answered_with_the_name(tmp_path):
    path = tmp_path / "p.toml"
    for text, said in ((PLACE, 'write "instant"'), ("testbench.study.points:POINTS", 'write "word_lengths"')):
        path.write_text(f'engine = "{text}"\n')
        with pytest.raises(ConfigError, match=said):
            plan.read(path, (), OWN)


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["a"], "is not of the form NAME=package.module:OBJECT"),
        (["a=b"], "is not of the form NAME=package.module:OBJECT"),
        (["a=b:c d"], "is not of the form NAME=package.module:OBJECT"),
        (["frame=b:c"], "the name frame is already used"),
        (["word_lengths=b:c"], "the name word_lengths is already used"),
        (["a=b:c", "a=b:d"], "the name a is already used"),
    ],
)
def test_options_that_are_none(texts, said):
    with pytest.raises(ConfigError, match=said):
        engines.parse_options(texts)


def test_an_installed_package_adds_an_engine(tmp_path, monkeypatch):
    info = tmp_path / "others-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{engines.ENTRY_POINTS}]\ntheirs = {PLACE}\nframe = {PLACE}\n")
    path = plan_file(tmp_path, 1, 1, 1, engine="theirs")
    with pytest.raises(ConfigError, match="'theirs' is not an engine"):
        plan.read(path)
    monkeypatch.syspath_prepend(tmp_path)
    assert json.loads(plan.points(plan.read(path))[0][0].identity)["engine"] == PLACE
    assert plan.read(plan_file(tmp_path, engine="frame")).engines == {"frame": "frame"}, "ours first"


def test_points_are_kept_under_the_place_whatever_its_name(tmp_path):
    run_json(plan_file(tmp_path, 1, 2, 1), "--out", tmp_path / "s")
    path = plan_file(tmp_path, 1, 2, 1, engine="another")
    done = gyro("campaign", "run", path, "--out", tmp_path / "s", "--engine", f"another={PLACE}", "--json")
    assert json.loads(done.stdout)["reused"] == 2, done.stderr


def old_store(folder, place):
    """A store whose plan and points name the place of their engine, as those of former versions do."""
    run_json(plan_file(folder, 1, 2, 1), "--out", folder / "s")
    path = folder / "s" / "plans" / "tiny.json"
    data = json.loads(path.read_text()) | {"engine": place}
    del data["sha256"]
    path.write_text(canonical(data))  # without a checksum, as those had none
    return folder / "s"


def test_an_old_store_is_read_without_an_import_and_runs_again_by_the_option(tmp_path, evil):
    store = old_store(tmp_path, "evil_engine:ENGINE")
    for argv in (("status", store), ("show", store), ("collect", store)):
        done = gyro("campaign", *argv)
        assert done.returncode == 0, done.stderr
    assert not evil.exists()
    point = Store.open_folder(store).addresses()[0]
    done = gyro("campaign", "rerun", store, point)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert f"was computed by the engine '{PLACE}'; give --engine NAME={PLACE} to run it" in done.stderr
    done = gyro("campaign", "rerun", store, point, "--engine", f"x={PLACE}")
    assert (done.returncode, "identical" in done.stdout) == (0, True), done.stderr
