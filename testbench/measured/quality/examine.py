"""All checks on the sheets of one recording: what would spoil the others' judgement comes first.

    examine(sheets)                    findings, the worst first
    enforce_quality(findings, option)  QualityError of those that refuse; --option quality=report: none does
Source  docs/quality.md
"""

from testbench.errors import ConfigError
from testbench.measured.quality import (
    backwards,
    clipped,
    drift,
    duplicated,
    gaps,
    interpolated,
    quantised,
    spikes,
    stuck,
    swapped,
    units,
)
from testbench.measured.quality.finding import REFUSE, QualityError
from testbench.measured.quality.sheet import SIGNAL

MEANING = (swapped, units, backwards)
ROWS = (duplicated, stuck, clipped, gaps)
NOISE = (interpolated, quantised, spikes)  # these say nothing of columns that are not what they seem


def examine(sheets):
    """Findings about `Sheet`s of one part; one without a signal, such as a sweep of one port, has none."""
    findings, sheets = [], [sheet for sheet in sheets if sheet.columns_by_role(SIGNAL)]
    for sheet in sheets:
        meaning = [f for check in MEANING for f in check.check(sheet)]
        sound = not any(f.kind in ("swapped", "reversed") for f in meaning)
        findings += meaning + [f for check in (*ROWS, *(NOISE if sound else ())) for f in check.check(sheet)]
    if not any(f.kind in ("swapped", "unit", "reversed") for f in findings):
        findings += drift.check(sheets)
    return tuple(sorted(findings, key=lambda f: f.action != REFUSE))


def enforce_quality(findings, option=""):
    """Findings that go on; QualityError where one refuses and the user did not say quality=report."""
    if option not in ("", "report"):
        raise ConfigError(f"--option quality={option}: expected report")
    worst = [f for f in findings if f.action == REFUSE]
    if worst and option != "report":
        raise QualityError(worst)
    return findings
