"""Five register sets at three temperatures: the plan of the paper's tests as a campaign, and its results as a table.

Source    docs/paper.md, docs/campaigns.md
"""

from pathlib import Path

from testbench.config.toml_text import toml_value
from testbench.paper.calibration.bench import PHASE_REGISTERS
from testbench.storage.files import write_text

TEMPERATURES_DEGC = (-20.0, 25.0, 50.0)
CASES = (1, 2, 3, 4, 5)
NAME = "paper"


def plan_text(cases_deg, seconds, temperatures=TEMPERATURES_DEGC, settings=()):
    """The plan in TOML: axes `case` and `temperature`.

    cases_deg  {case: {register: deg}}
    seconds    length of the record at rest
    settings   further (key, value) of [set], such as noise.seed
    """
    lines = [f'name = "{NAME}"', 'engine = "testbench.paper.measure.characterise:POINTS"', "", "[set]"]
    lines += [f"scenario.seconds = {float(seconds)!r}", "scenario.diagnose = false"]
    lines += [f"{key} = {toml_value(value)}" for key, value in settings]
    for case, phases in cases_deg.items():
        lines += ["", "[[axes.case.cases]]", f'name = "{case}"']
        lines += [f"firmware.{name}_deg = {phases[name]!r}" for name in PHASE_REGISTERS]
    lines += ["", "[axes.temperature]", f"scenario.temperature_degc = {list(map(float, temperatures))!r}", ""]
    return "\n".join(lines)


def write_plan(path, *args, **kwargs):
    """Write `plan_text` to a file; returns its path."""
    write_text(path, plan_text(*args, **kwargs))
    return Path(path)
