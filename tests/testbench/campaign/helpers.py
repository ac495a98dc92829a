"""Plans, command lines and comparisons that the tests of campaigns share."""

import json
import os
import subprocess
import sys
from pathlib import Path

from tests.testbench.command import gyro

ROOT = Path(__file__).resolve().parents[3]
INSTANT, LANES = "instant", "instant_lanes"
OWN = (f"{INSTANT}=tests.testbench.campaign.instant:ENGINE", f"{LANES}=tests.testbench.campaign.instant:LANES")
OPTIONS = [word for text in OWN for word in ("--engine", text)]
TAKE_THEM = ("run", "check", "rerun")

PLAN = """
name = "tiny"
engine = "{engine}"

[set]
scenario.seconds = 0.001
scenario.origin = "power_on"
scenario.diagnose = false

[axes.temperature]
scenario.temperature_degc = {{ linspace = [-40, 85, {temperatures}] }}

[axes.board]
count = {boards}
plant.fx_hz = {{ normal = [11002.3, 5.0] }}
plant.qx = {{ lognormal = [100000, 0.1] }}

[axes.seed]
noise.seed = {{ range = [1, {seeds}] }}

[keep]
tau_s = [0.000125, 0.0005]
streams.rate_word = 4
statistics.rate_word = ["mean", "std", "slope", "adev"]
"""


def plan_file(folder, temperatures=2, boards=3, seeds=2, engine=INSTANT):
    """A plan of temperatures x boards x seeds points."""
    path = Path(folder) / "plan.toml"
    path.write_text(PLAN.format(engine=engine, temperatures=temperatures, boards=boards, seeds=seeds))
    return path


WARM = """
name = "warm"
engine = "{engine}"

[set]
scenario.resume = "warm/state.h5"
scenario.seconds = 0.04
scenario.diagnose = false

[axes.rate]
scenario.rate_dps = {{ linspace = [-300, 300, {rates}] }}

[axes.seed]
noise.seed = {{ range = [1, {seeds}] }}

[keep]
streams.rate_word = 8
statistics.rate_word = ["mean", "std"]
"""


def warm_plan_file(folder, rates, seeds, engine):
    """A plan of rates x seeds points of 40 ms, all of which begin where one gyroscope has locked."""
    if not (folder / "warm").exists():
        done = gyro("run", "--seconds", "0.01", "--set", "scenario.diagnose=false", "--out", folder / "warm")
        assert done.returncode == 0, done.stderr
    path = folder / f"{engine}.toml"
    path.write_text(WARM.format(engine=engine, rates=rates, seeds=seeds))
    return path


def environment(**more):
    """Environment in which a child finds this checkout and the engine of the tests."""
    places = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(places), **more}


def with_engines(argv):
    """ARGV with the engines of the tests, where the command takes them."""
    return [*map(str, argv), *(OPTIONS if argv[0] in TAKE_THEM else ())]


def start(*argv, preexec_fn=None, **env):
    """`gyro campaign ARGV` as a child that is not waited for."""
    return subprocess.Popen(
        [sys.executable, "-m", "testbench.commands.main", "campaign", *with_engines(argv)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=environment(**env),
        preexec_fn=preexec_fn,
    )


def child(*argv, **more):
    """(exit code, standard output, standard error) of `gyro campaign ARGV` in a process of its own."""
    started = start(*argv, **more)
    out, err = started.communicate(timeout=300)
    return started.returncode, out, err


def campaign(*argv):
    """The same in this process."""
    return gyro("campaign", *with_engines(argv))


def run_json(*argv, workers=0):
    """The JSON object of a run that must end well."""
    code, out, err = campaign("run", *argv, "--workers", workers, "--json")
    assert code == 0, err
    return json.loads(out)


def finished(store):
    """{name: bytes} of the points and results of a store."""
    out = {}
    for folder in ("points", "results"):
        for path in sorted((Path(store) / folder).rglob("*")):
            if path.is_file():
                out[str(path.relative_to(store))] = path.read_bytes()
    return out
