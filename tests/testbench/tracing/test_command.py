"""`gyro measured trace`: openers by content, files written, errors in one line."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from testbench.commands.main import app
from testbench.measured import openers
from tests.testbench.tracing.toys import Toy


@pytest.fixture
def toy_opener(monkeypatch):
    """An opener that knows files that begin with the word toy; it is given what the command line was given."""
    given = []

    def opener(paths, options):
        if not Path(paths[0]).read_text().startswith("toy"):
            return None
        given.append(options)
        return Toy(5, {"feed": 0.2})

    monkeypatch.setattr(openers, "OPENERS", [lambda paths, options: None, opener])
    return given


def invoke(*arguments):
    return CliRunner().invoke(app, ["measured", "trace", *map(str, arguments)])


def test_a_file_is_traced_and_page_and_json_are_written(tmp_path, toy_opener):
    (tmp_path / "any.name").write_text("toy")
    page, data = tmp_path / "out.html", tmp_path / "out.json"
    kept = ("--checkpoint", tmp_path / "kept", "--option", "meter=a=b")
    done = invoke(tmp_path / "any.name", "--report", page, "--json", data, *kept)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("named: explained by feed")
    assert toy_opener == [{"meter": "a=b"}]
    result = json.loads(data.read_text())
    assert result["verdict"] == "named"
    assert page.read_text().startswith("<!DOCTYPE html>")
    assert any((tmp_path / "kept").rglob("*.npz"))


def test_what_no_opener_knows_is_one_error(tmp_path, toy_opener):
    (tmp_path / "other").write_text("something")
    with pytest.raises(openers.FileError, match="unknown kind of content"):
        openers.open_problem([tmp_path / "other"], {})
    with pytest.raises(openers.FileError, match="no such file"):
        openers.open_problem([tmp_path / "nothing"], {})
    assert invoke(tmp_path / "other").exit_code != 0


def test_an_option_without_a_value_is_refused(tmp_path, toy_opener):
    (tmp_path / "toy").write_text("toy")
    assert "expected KEY=VALUE" in str(invoke(tmp_path / "toy", "--option", "meter").exception)


def test_a_class_is_printed_with_its_members_and_the_next_experiment(tmp_path, monkeypatch):
    monkeypatch.setattr(openers, "OPENERS", [lambda paths, options: Toy(8, {"duffing": 0.0047 * 7})])
    (tmp_path / "toy").write_text("toy")
    done = invoke(tmp_path / "toy", "--json", tmp_path / "out.json")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    result = json.loads((tmp_path / "out.json").read_text())
    first, second = (cause["laws"][0] for cause in result["causes"])
    assert lines[0] == f"confounded: explained by {first} or {second}; these data cannot distinguish them"
    assert lines[-2].startswith(f"alternative: {second} ")
    assert lines[-1] == f"next experiment: {result['next_experiment'][0]['words']}"
