"""Files of a picture: the numbers in the CSV are those drawn, and the bytes tell nothing of when they were written."""

import csv
import os
import subprocess
import sys

import numpy as np
import pytest

from testbench.console import figure_files
from testbench.console.figure_files import Picture
from testbench.console.report import make_axes, name_axes

X, Y, S = (0.1, 0.2, 0.3), (1.5, -2.5, 1 / 3), (0.5, np.nan, 0.25)


def drawn():
    """A curve, marks with error bars, bars that begin anywhere, a level, a map; one curve has no name."""
    figure, axes = make_axes("All kinds", 6.0, 2, 2)
    axes[0, 0].plot(X, Y, label="curve")
    axes[0, 0].plot(X, np.negative(Y))
    axes[0, 0].axhline(7.5, label="level")
    name_axes(axes[0, 0], "x", "first (V)")
    axes[0, 1].errorbar(X, Y, yerr=S, label="marks")
    name_axes(axes[0, 1], "x", "second (V)")
    axes[1, 0].bar([0, 1], [2.0, -1.0], 0.7, [0.0, 2.0], label="bars")
    axes[1, 0].set_xticks([0, 1], ["up", "down"])
    axes[1, 0].set_title("third", loc="left")
    axes[1, 1].imshow([[1.0, 2.0], [3.0, 4.0]])
    name_axes(axes[1, 1], "x", "fourth")
    return Picture("all_kinds", "What to see: nothing.", figure)


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    return figure_files.write(drawn(), tmp_path_factory.mktemp("figures"))[0]


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_csv_has_what_is_drawn(paths):
    found = {}
    for row in rows_of(paths["csv"]):
        found.setdefault((row["panel"], row["series"]), []).append(row)
    curve, marks = found["first (V)", "curve"], found["second (V)", "marks"]
    assert [(float(r["x"]), float(r["y"])) for r in curve] == list(zip(X, Y))
    assert [(float(r["x"]), float(r["y"])) for r in marks] == list(zip(X, Y))
    for row, y, s in zip(marks, Y, S):
        np.testing.assert_allclose([float(row["low"]), float(row["high"])], [y - s, y + s], rtol=1e-15)
    assert [(r["x"], r["y"]) for r in found["first (V)", "level"]] == [("", "7.5")]
    ends = [(r["label"], float(r["y"]), float(r["low"]), float(r["high"])) for r in found["third", "bars"]]
    assert ends == [("up", 2.0, 0.0, 2.0), ("down", -1.0, 2.0, 1.0)]
    assert [float(r["y"]) for k in (0, 1) for r in found["fourth", f"row {k}"]] == [1.0, 2.0, 3.0, 4.0]
    assert len(found) == 6, "a curve without a name is no number"


WRITE = """
import sys
from pathlib import Path
from testbench.console import figure_files
from tests.testbench.console.test_figure_files import drawn
figure_files.write(drawn(), Path(sys.argv[1]))
"""


def test_another_process_at_another_time_writes_the_same_bytes(paths, tmp_path):
    more = {"PYTHONHASHSEED": "7", "SOURCE_DATE_EPOCH": "1", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", WRITE, str(tmp_path)], check=True, env=os.environ | more, timeout=300)
    for kind, path in paths.items():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), kind
    assert sorted(paths) == sorted(figure_files.KINDS)
    assert paths["png"].read_bytes()[:4] == b"\x89PNG"
    assert paths["pdf"].read_bytes()[:5] == b"%PDF-"
    assert b"<svg" in paths["svg"].read_bytes()[:2000]
