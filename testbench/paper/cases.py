"""Five register sets at three temperatures: the plan of the paper's tests as a campaign, and its results as a table.

Source    docs/paper.md, docs/campaigns.md
"""

from pathlib import Path

from testbench.config import to_toml
from testbench.paper.calibration.bench import PHASE_REGISTERS
from testbench.storage.files import write_text

TEMPERATURES_DEGC = (-20.0, 25.0, 50.0)
CASES = (1, 2, 3, 4, 5)
NAME = "paper"
BASE = "board.toml"  # file of the base board, beside the plan


def plan_text(cases_deg, seconds, temperatures=TEMPERATURES_DEGC):
    """The plan in TOML: axes `case` and `temperature` on the board of `BASE`.

    cases_deg  {case: {register: deg}}
    seconds    length of the record at rest
    """
    lines = [f'name = "{NAME}"', 'engine = "characterise"', f'base = "{BASE}"', ""]
    lines += ["[set]", f"scenario.seconds = {float(seconds)!r}", "scenario.diagnose = false"]
    for case, phases in cases_deg.items():
        lines += ["", "[[axes.case.cases]]", f'name = "{case}"']
        lines += [f"firmware.{name}_deg = {phases[name]!r}" for name in PHASE_REGISTERS]
    lines += ["", "[axes.temperature]", f"scenario.temperature_degc = {list(map(float, temperatures))!r}", ""]
    return "\n".join(lines)


def write_plan(path, config, *args):
    """Write `plan_text` to a file, and `BASE` beside it: every key of the configuration; returns the plan's path."""
    path = Path(path)
    write_text(path.with_name(BASE), to_toml(config))
    write_text(path, plan_text(*args))
    return path
