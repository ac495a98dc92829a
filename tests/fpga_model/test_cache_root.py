"""Where compiled kernels are kept: by a user without home or name, and never in a folder of somebody else."""

import os
import stat
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ADVICE = "set GYRO_CACHE to a folder of your own"
SHOW = """
from fpga_model import jit
import os
print(jit.cache_root(), jit.CACHE, os.environ.get("GYRO_CACHE"))
"""


def shown(tmp, before="", **environment):
    """(root, whether there is a cache, GYRO_CACHE afterwards), and standard error, of a process without HOME."""
    given = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp), **environment}
    # a user id without an entry in passwd, as `Path.home` sees it; nobody here needs the permission to become one
    nameless = "import pathlib\ndef home(): raise RuntimeError\npathlib.Path.home = home\n" + before
    done = subprocess.run(
        [sys.executable, "-c", nameless + SHOW], env=given, capture_output=True, text=True, check=True
    )
    return done.stdout.split(), done.stderr


def private(tmp):
    return tmp / f"ftr-gyro-{os.geteuid()}"


def test_without_a_home_kernels_are_kept_in_a_private_folder_and_one_line_says_so(tmp_path):
    found, said = shown(tmp_path)
    assert found == [str(private(tmp_path) / "ftr-gyro"), "True", str(private(tmp_path))]
    assert stat.S_IMODE(private(tmp_path).stat().st_mode) == 0o700
    assert said == f"gyro: no writable home folder: compiled kernels are stored in {private(tmp_path)}; {ADVICE}\n"
    # a child inherits the folder and says nothing
    assert shown(tmp_path, GYRO_CACHE=found[2])[1] == ""


def test_a_home_that_cannot_be_written_is_none(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    found, _ = shown(tmp_path, XDG_CACHE_HOME=str(blocked))
    assert found[0] == str(private(tmp_path) / "ftr-gyro")


def test_a_cache_that_is_off_makes_no_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert shown(tmp_path, GYRO_CACHE="0") == (["None", "False", "0"], "")
    assert not list(tmp_path.iterdir())


def test_where_the_private_folder_is_none_each_process_compiles(tmp_path):
    private(tmp_path).write_text("")
    found, said = shown(tmp_path)
    assert found == ["None", "False", "None"]
    told = "kernels are not stored, so each process compiles them"
    assert said == f"gyro: no writable home folder: {told}; {ADVICE}\n"


def test_a_folder_of_another_user_is_not_used(tmp_path):
    (tmp_path / f"ftr-gyro-{os.geteuid() + 1}").mkdir(mode=0o700)
    other = f"import os\nos.geteuid = lambda: {os.geteuid() + 1}\n"
    found, _ = shown(tmp_path, other)
    assert found[:2] == ["None", "False"]


def test_a_cache_that_is_named_needs_no_home(tmp_path):
    found, said = shown(tmp_path, GYRO_CACHE=str(tmp_path / "mine"))
    assert (found[0], said) == (str(tmp_path / "mine" / "ftr-gyro"), "")
    found, said = shown(tmp_path, GYRO_CACHE="0")
    assert (found[1], said) == ("False", "")
