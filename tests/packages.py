"""Wheel and sdist elsewhere: built, installed in empty environments, and run by a user without name and home.

    contents    every file of the three packages is in both
    run         the default run gives the hash of docs/tutorials/first_run.md, from a cold cache of kernels
    at once     two processes on one cold cache: one compiles, the other waits; at most AT_ONCE times as long as one,
                which is measured before and after: other work on the machine makes the slower of them count
    commands    each kind of command ends well in another folder

The installation is read-only for that user: root installs, and the commands run under the user id NOBODY. Who is not
root runs them under the own id, on an installation without permission to write; the table says which.

    python -m tests.packages [--python PYTHON] [--keep DIR]

prints a table; exit code 1 if anything is not as it must be. Packages come from the index that pip uses.
Source  docs/portability.md
"""

import argparse
import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from pathlib import Path
from typing import NamedTuple

from fpga_model.jit import PACKAGES
from testbench.console.show import print_tables
from testbench.console.text_table import Table

ROOT = Path(__file__).resolve().parents[1]
NOBODY = 54321  # no entry in passwd; `nobody` has one
AT_ONCE = 1.3
RUN = ("run", "--seconds", "1", "--rate-dps", "100", "--seed", "1", "--json")
RECORD = ROOT / "tests" / "data" / "written_by_0.1.0" / "gyrorec.h5"
COMMANDS = (
    ("--version",),
    ("budget",),
    ("config", "--keys", "--faults", "--targets", "--effects", "--columns"),
    ("golden", "ports", "dds"),
    ("registers",),
    ("report", "numbers"),
    ("loop",),
    ("golden", "export", "cordic", "--out", "golden"),
    ("golden", "verify", "--recompute", "golden/cordic/default"),
    ("measured", "check", "record.h5", "--no-replay"),
    ("report", "paper", "--help"),
    ("campaign", "--help"),
)
IGNORED = shutil.ignore_patterns("__pycache__", "*.pyc")


class Check(NamedTuple):
    """A row of the table."""

    package: str
    what: str
    found: str
    ok: bool


class Failed(Exception):
    """What could not be made, in one line."""


def wanted_hash():
    """First digits of the hash of all codes that the tutorial prints."""
    page = (ROOT / "docs" / "tutorials" / "first_run.md").read_text()
    return re.search(r"hash of all DAC and ADC codes +([0-9a-f]{16})", page)[1]


def identity():
    """Arguments of `subprocess` that make a child another user, if this one may."""
    return {"user": NOBODY, "group": NOBODY, "extra_groups": []} if os.getuid() == 0 else {}


def usable(python):
    """Whether an interpreter is new enough, can make environments, and can be run by the other user."""
    code = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))"
    with contextlib.suppress(OSError):
        return subprocess.run([python, "-c", code], capture_output=True, cwd="/", **identity()).returncode == 0
    return False


def interpreter(given=None):
    """The interpreter given, or the first that the other user can run."""
    found = [shutil.which(f"python3.{minor}", path="/usr/bin:/usr/local/bin") for minor in range(20, 10, -1)]
    for python in [given] if given else [getattr(sys, "_base_executable", sys.executable), *filter(None, found)]:
        if usable(python):
            return python
    raise Failed(
        f"{given or 'Python 3.11 or newer'}: no interpreter with venv that user {NOBODY} can run; --python PYTHON"
    )


def ran(command):
    """Standard output of a command that must work; it sees nothing of this checkout."""
    given = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, cwd="/", env=given)
    if done.returncode:
        lines = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        raise Failed(f"{' '.join(map(str, command))[:80]}: {lines[-1] if lines else done.returncode}")
    return done.stdout


def environment(python, folder, *wanted):
    """An environment with these requirements; its folder of commands."""
    ran([python, "-m", "venv", folder])
    ran([folder / "bin" / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check", *wanted])
    return folder / "bin"


def build(python, folder):
    """(wheel, sdist): the sdist from a copy of the sources alone, the wheel from the sdist."""
    tree = folder / "tree"
    tree.mkdir()
    for name in ("pyproject.toml", "LICENSE", "README.md"):
        shutil.copy(ROOT / name, tree)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tree / package, ignore=IGNORED)
    maker = environment(python, folder / "maker", "build")
    ran([maker / "python", "-m", "build", "--outdir", folder / "dist", tree])
    (wheel,), (sdist,) = ((folder / "dist").glob(pattern) for pattern in ("*.whl", "*.tar.gz"))
    return wheel, sdist


def missing(path):
    """Files of the packages that an archive lacks."""
    if path.suffix == ".whl":
        names = set(zipfile.ZipFile(path).namelist())
    else:
        with tarfile.open(path) as file:
            names = {name.partition("/")[2] for name in file.getnames()}
    files = (p for package in PACKAGES for p in (ROOT / package).rglob("*") if p.is_file() and p.suffix != ".pyc")
    return sorted({p.relative_to(ROOT).as_posix() for p in files} - names)


@contextlib.contextmanager
def locked(folder):
    """Without the permission to write anything below a folder, for those who are not root."""
    paths = [path for path in (folder, *folder.rglob("*")) if not path.is_symlink()] if not identity() else []
    for path in paths:
        path.chmod(path.stat().st_mode & ~0o222)
    try:
        yield
    finally:
        for path in paths:
            path.chmod(path.stat().st_mode | 0o200)


class User:
    """Runs `gyro` of an installation from a working folder of its own, without HOME, with a cold cache of kernels."""

    def __init__(self, binaries, folder):
        self.binaries, self.folder = binaries, folder
        for place in (folder, folder / "tmp"):
            place.mkdir()
            place.chmod(0o777)
        shutil.copy(RECORD, folder / "record.h5")

    def start(self, arguments, temporary="tmp"):
        """The process of a command line."""
        kept = {key: os.environ[key] for key in ("LANG", "LC_ALL") if key in os.environ}
        given = {"PATH": f"{self.binaries}:/usr/bin:/bin", "TMPDIR": str(self.folder / temporary), **kept}
        return subprocess.Popen(
            [str(self.binaries / "gyro"), *map(str, arguments)],
            cwd=self.folder, env=given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **identity(),
        )  # fmt: skip

    def cold(self, count, name):
        """(seconds, hashes) of so many default runs at once on a cold cache."""
        temporary = f"tmp_{name}"
        (self.folder / temporary).mkdir()
        (self.folder / temporary).chmod(0o777)
        began = time.perf_counter()
        running = [self.start([*RUN, "--out", f"out_{name}_{k}"], temporary) for k in range(count)]
        outputs = [process.communicate() for process in running]
        took = time.perf_counter() - began
        for process, (_, said) in zip(running, outputs):
            if process.returncode:
                raise Failed(f"gyro run: {said.strip().splitlines()[-1:]}")
        return took, {json.loads(out)["codes_sha256"][:16] for out, _ in outputs}


def runs(user, package, twice):
    """Checks of the default run: its hash, and two at once."""
    wanted = wanted_hash()
    alone_s, found = user.cold(1, "before")
    yield Check(package, "gyro run, cold cache", f"{', '.join(found)} in {alone_s:.1f} s", found == {wanted})
    if twice:
        both_s, found = user.cold(2, "both")
        alone_s = max(alone_s, user.cold(1, "after")[0])
        what = f"{', '.join(found)}; {both_s:.1f} s, {both_s / alone_s:.2f} of one"
        yield Check(package, "two at once, cold cache", what, found == {wanted} and both_s <= AT_ONCE * alone_s)


def commands(user, package):
    """Checks of every kind of command."""
    for arguments in COMMANDS:
        process = user.start(arguments)
        _, said = process.communicate()
        lines = [line for line in said.splitlines() if not line.startswith("gyro: no home")]
        found = "ends well" if process.returncode == 0 else f"exit code {process.returncode} {' '.join(lines[-1:])}"
        yield Check(package, f"gyro {' '.join(arguments)}", found, process.returncode == 0 and not lines)
    done = subprocess.run(
        [user.binaries / "python", "-m", "testbench.bench"],
        cwd=user.folder, env={"GYRO_CACHE": "0"}, capture_output=True, text=True, **identity(),
    )  # fmt: skip
    refused = done.returncode == 2 and len(done.stderr.splitlines()) == 1
    yield Check(package, "a command of the repository", done.stderr.strip()[-60:], refused)


def measure(folder, given=None):
    """All checks, in a folder that the other user can enter."""
    python = interpreter(given)
    for path in build(python, folder):
        package = "wheel" if path.suffix == ".whl" else "sdist"
        lacking = missing(path)
        yield Check(package, "contents", f"{lacking[0]} is missing" if lacking else "every file", not lacking)
        binaries = environment(python, folder / package, path)
        user = User(binaries, folder / f"user_{package}")
        with locked(folder / package):
            yield from runs(user, package, package == "wheel")
            if package == "wheel":
                yield from commands(user, package)


def main(arguments=None):
    """Check, print, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.packages", description="Wheel and sdist elsewhere.")
    parser.add_argument("--python", help="interpreter of the environments")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="new folder that keeps what was made")
    options = parser.parse_args(arguments)
    found = []
    with contextlib.ExitStack() as stack:
        folder = options.keep or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gyro-packages-")))
        folder.mkdir(exist_ok=True)
        folder.chmod(0o755)
        try:
            for check in measure(folder.resolve(), options.python):
                found.append(check)
                print(f"{check.package}: {check.what}: {check.found}", file=sys.stderr, flush=True)
        except Failed as problem:
            print(f"packages: {problem}", file=sys.stderr)
            return 2
    rows = [(check.package, check.what, check.found, "yes" if check.ok else "NO") for check in found]
    who = f"user {NOBODY}, no passwd entry" if identity() else f"user {os.getuid()}, read-only installation"
    print_tables(
        [Table(f"Installed packages: {who}, no HOME", ("package", "what", "found", "as it must be"), rows, numeric=())]
    )
    return 0 if all(check.ok for check in found) else 1


if __name__ == "__main__":
    sys.exit(main())
