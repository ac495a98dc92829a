"""Records of a published run, made again by this version."""

import hashlib
import shutil
import tomllib
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from testbench.errors import ConfigError, FileError
from testbench.measured.wide import data_sheet
from testbench.storage.record import Column
from tests.sealed import again, ledger, score
from tests.sealed.__main__ import SCORED
from tests.sealed.records import Run
from tests.sealed.test_records import short, space

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
LINE, ROWS, _ = score.read(SCORED.read_text())
EQUAL = {"envelope": "equal", "streams": "equal"}
FILE = again.FOLDER / f"{LINE['run']}.json"


def test_the_published_run_has_the_truths_that_were_scored():
    """The ledger's line, and stratum and effect of each record; the envelopes have their hashes."""
    run = again.read_run(FILE)
    assert run["ledger"] == LINE
    truths = [again.read_truth(run, n) for n in range(len(run["records"]))]
    assert [(truth["kind"], truth["effect"]) for truth in truths] == [(r.kind, r.truth) for r in ROWS]
    digests = [hashlib.sha256(again.envelope_text(truth).encode()).hexdigest() for truth in truths]
    assert digests == [row["envelope_sha256"] for row in run["records"]]


@needs_compiler
@pytest.mark.parametrize(("kind", "options"), [("null_flicker", ["--wide"]), ("clear", []), ("outside", [])])
def test_a_record_is_made_again(tmp_path, capsys, kind, options):
    """Envelope and streams are as published, bit by bit; about 15 s each.

    From a data sheet a record has the same streams, the sheet in its configuration and no priors.
    """
    number = next(r.number for r in ROWS if r.kind == kind)
    code = again.main([LINE["run"], str(number), "--out", str(tmp_path), *options])
    assert "beside the published record: envelope equal, streams equal" in capsys.readouterr().out
    assert code == 0
    (path,) = tmp_path.glob("*.h5")
    with h5py.File(path) as file:
        plant = tomllib.loads(file.attrs["config_toml"])["plant"]
        assert len(file["priors/param"]) == (0 if options else 10)
    default = again.read_run(FILE)["configuration"]["plant"]
    changed = {f"plant.{key}" for key in default if plant[key] != default[key]}
    assert changed == (set(data_sheet.read(data_sheet.BUNDLED_PATH)) if options else set())
    assert len(list(tmp_path.iterdir())) == 2


@needs_compiler
def test_a_run_is_written_and_its_record_made_again(tmp_path):
    """A short record; before it has a result there is no file."""
    table, path = short(null_white=1), tmp_path / "run.json"
    run = Run(table, space(), ledger.identity("development", table), tmp_path, lambda path, wide: {})
    with pytest.raises(FileError, match=r"000\.json: cannot be read"):
        again.write_run(run, path)
    assert not path.exists()
    run.one(0)
    again.write_run(run, path)
    published = again.read_run(path)
    assert again.compare_hashes(published, 0, *again.make_again(published, 0, tmp_path)) == EQUAL


def test_a_record_without_a_data_sheet_is_not_made_with_one(tmp_path):
    with pytest.raises(ConfigError, match=r"record 299 was not traced from a data sheet; leave out --wide"):
        again.make_again(again.read_run(FILE), 299, tmp_path, wide=True)


def test_a_record_that_differs_is_reported():
    record = SimpleNamespace(streams={"adc_xI": Column(np.arange(3), "code")})
    row = {"envelope_sha256": hashlib.sha256(b"{}").hexdigest(), "streams_sha256": again.streams_sha256(record)}
    run = {"streams": ["adc_xI"], "records": [row]}
    assert again.compare_hashes(run, 0, "{}", record) == EQUAL
    assert again.compare_hashes(run, 0, "{ }", record) == EQUAL | {"envelope": "differs"}
    record.streams["adc_xI"].data[1] ^= 1
    assert again.compare_hashes(run, 0, "{}", record) == EQUAL | {"streams": "differs"}
    row["streams_sha256"] = None
    assert again.compare_hashes(run, 0, "{}", record) == EQUAL | {"streams": "unknown"}


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda text: text.replace('"redrawn":0', '"redrawn":1', 1), "sha256 differs from that of the content"),
        (lambda text: "{}", "sha256 differs from that of the content"),
        (lambda text: "[]", "content: Input should be a valid dictionary"),
        (lambda text: text[:-100], "is not a readable JSON"),
    ],
)
def test_a_wrong_file_is_one_error(tmp_path, monkeypatch, capsys, edit, message):
    (tmp_path / FILE.name).write_text(edit(FILE.read_text()))
    monkeypatch.setattr(again, "FOLDER", tmp_path)
    with pytest.raises(SystemExit) as exit_code:
        again.main([FILE.stem, "0", "--out", str(tmp_path)])
    assert exit_code.value.code == 1
    assert message in (line := capsys.readouterr().err)
    assert line.startswith(f"{tmp_path / FILE.name}: ")
    assert line.count("\n") == 1


def test_a_number_outside_of_the_run_is_refused(capsys):
    with pytest.raises(SystemExit):
        again.main([FILE.stem, "300"])
    assert "number = 300 is outside 0 .. 299" in capsys.readouterr().err
