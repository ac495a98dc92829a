"""Nothing in a file runs code: every key of every kind of file names a module, a library and a path outside in turn."""

import importlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.fuzz import hostile, named, watch

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="inotify is Linux's")


LONG = ("bundle", "record", "run")  # half a minute and more each
QUICK = tuple(name for name in named.FORMATS if name not in LONG)


@pytest.mark.parametrize("formats", [QUICK, pytest.param(LONG, marks=pytest.mark.slow)])
def test_no_key_of_a_file_runs_or_reaches_what_it_names(tmp_path, formats):
    command = [sys.executable, "-m", "tests.fuzz.named", str(tmp_path), *formats]
    env = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    done = subprocess.run(command, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert [name for name, _, _ in found] == [*formats, "ran"]
    assert not [f"{name}: {finding}" for name, _, findings in found for finding in findings]
    assert all(count for _, count, _ in found[:-1]), "a format without a key"


def test_what_a_key_runs_writes_or_reads_is_found(tmp_path, monkeypatch):
    """By readers that do what they must not, with the one value that a key is given."""
    canary = tmp_path / "outside.txt"
    canary.write_text("")
    tree = {"key": "", "effects": {"files": ""}}
    bad = {
        "import": lambda value: importlib.import_module(value),
        "exec": lambda value: exec(compile("1", value, "exec")),
        "process": lambda value: subprocess.run([sys.executable, "-c", f"0 # {value}"], check=True),
        "write": lambda value: (tmp_path / "new").write_text(""),
        "read": lambda value: canary.read_text(),
        "traceback": lambda value: {}[value],
    }
    said = {
        "import": "exec",
        "write": "for writing",
        "read": f"read {canary}",
        "traceback": "KeyError",
        "process": "subprocess.Popen",
    }
    opened = watch.Opened(canary)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    for name, act in bad.items():
        sys.modules.pop(hostile.MODULE, None)
        kept = {}
        read = lambda kept=kept, act=act: act(kept["key"]) if kept.get("key") else None  # noqa: E731
        form = named.Format(tree, lambda changed, kept=kept: kept.update(changed), [read])
        monkeypatch.setitem(named.FORMATS, name, lambda files, folder, form=form: form)
        monkeypatch.chdir(tmp_path)
        count, findings = named.tried(name, tmp_path, tmp_path, [hostile.MODULE], opened)
        assert count == 2, "two keys"
        assert findings, name
        assert any(said.get(name, name) in line for line in findings), findings
        assert findings[0].startswith("key = ")
