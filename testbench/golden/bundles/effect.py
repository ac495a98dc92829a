"""Golden vectors of the firmware in a loop whose plant has an effect: found in data, written as a law file, or any key.

    law files, settings -> closed loop from power-on, clocked -> recording -> bundle of the whole design

Source    docs/golden.md (recordings), docs/effects.md
"""

from pathlib import Path

from testbench.config import law_file, parse_set
from testbench.errors import ConfigError
from testbench.golden.bundles import design_bundle
from testbench.golden.recording import make_recordings
from testbench.run import build

MOST_ROWS = 200  # with one row each


def case(laws=(), sets=(), frames=9400):
    """`make_recordings.Case` of law files and `section.key=value` texts; ConfigError for what no engine runs."""
    design_bundle.check_frames(frames)
    values = dict(parse_set(text)[:2] for text in sets)
    texts = [text for path in laws for text in law_file.read(path).laws]
    if texts:
        values["effects.laws"] = [*values.get("effects.laws", []), *texts]
    if not any(key.startswith("effects.") for key in values):
        raise ConfigError("no effect: give --law FILE, or --set effects.NAME=VALUE")
    row_every = max(1, frames // MOST_ROWS)
    return make_recordings.Case(config=values, firmware=build.firmware, frames=frames, row_every=row_every)


def export(name, recording_case, out, progress=None):
    """Run a case, write its bundle to OUT/top/NAME; (folder, manifest)."""
    if not name.isidentifier():
        raise ConfigError(f"name: {name!r} is not a valid name of a case; use letters, digits and _")
    r = make_recordings.record_closed_loop(name, recording_case, progress)
    folder = Path(out) / design_bundle.STEM / name
    return folder, design_bundle.write(r._replace(windows=make_recordings.find_windows(r)), folder)
