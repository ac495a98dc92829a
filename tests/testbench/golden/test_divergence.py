"""What a check leaves of a difference: waveform, set-up, bundle and diagnosis, each read by something else."""

import json
import os
import re
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from testbench.errors import FileError
from testbench.golden import cli, divergence
from testbench.golden.bundles import bundle, recompute
from testbench.golden.check import compare, rtl_run
from testbench.golden.foreign import comparison_scope
from tests import naive
from tests.testbench.golden.benching import RTL, make, need
from tests.testbench.storage.test_vcd import parse, sampled

FRAME_CLOCKS = 3250  # of the default design
SLIP = (" + HALF_Y;", ";")  # the PI without its rounding constant


def package_of(path, first, count, name):
    """(golden, yours) of a port as text, row by row, at the clock edges that a simulator has."""
    _, changes = parse(path / "window.vcd")
    times = [naive.edge_picoseconds(k) for k in range(count)]
    (top,) = {signal.partition(".")[0] for signal in changes}
    _, clock = changes[f"{top}.clk_26m"]
    assert [t for t, level in clock if level] == [naive.edge_picoseconds(k) for k in range(count + 1)]
    assert f"edge {first};" in (path / "window.vcd").read_text()
    return [sampled(changes[f"{top}.{name}.{whose}"][1], times) for whose in ("golden", "yours")]


def flipped(golden, row, names, level="registers", style="sync", clocks=None, unknown=()):
    """Report of a design that is right but for the lowest bit of a port in one row, which has no value if unknown."""
    found = comparison_scope.build_scope(golden, level, style, clocks)
    results = golden.manifest["registers"] + golden.manifest["outputs"]
    got = {}
    for column, port in zip(found.golden.exp.T, results, strict=True):
        got[port["name"]] = compare.Column(column.copy(), np.ones(len(column), bool))
    for name in names:
        got[name].values[row - found.first] ^= 1
        got[name].valid[row - found.first] = name not in unknown
    return compare.compare_bundle(found.golden, got, comparison=found)


def test_a_difference_leaves_waveform_bundle_and_diagnosis(bundles, tmp_path):
    need("iverilog")
    given = bundles("pi") / "rate"
    text = (RTL / "pi.v").read_text()
    assert text.count(SLIP[0]) == 1
    (tmp_path / "pi.v").write_text(text.replace(*SLIP))
    words = ["check", str(given), "--rtl", str(tmp_path), "--sim", "icarus"]
    done = CliRunner().invoke(cli.app, words)
    assert done.exit_code == 1
    place = given / "build" / "divergence"
    assert done.stdout.endswith(f"\npackage           {place}\n")
    assert (place / "diagnosis.txt").read_text() + f"package           {place}\n" == done.stdout
    told = json.loads((place / "diagnosis.json").read_text())
    assert (told["first"]["clock"], told["first"]["name"], told["diagnosis"][0]["cause"]) == (37, "y", "rounding")
    bundle.verify(given)  # build/ is no part of the bundle

    # golden beside the design's values, every row from the first one of the bundle
    rows = 37 + 1 + divergence.AFTER
    exp, manifest = bundle.read(given).exp[:rows], bundle.read(given).manifest
    column = [p["name"] for p in manifest["registers"]].index("y")
    golden, yours = package_of(place, 0, rows, "reg.y")
    assert golden == [value & (1 << 36) - 1 for value in exp[:, column].tolist()]
    wrong = [n for n in range(rows) if golden[n] != yours[n]]
    assert wrong[0] == 37
    assert all((golden[n] - yours[n]) % (1 << 36) == 1 for n in wrong)
    setup = (place / "window.gtkw").read_text()
    (marker,) = re.findall(r"^\*-[\d.]+ (-?\d+)", setup, re.M)
    assert int(marker) == naive.edge_picoseconds(37)
    shown = re.findall(r"^gyro_pi\.(\S+?)(?:\[|$)", setup, re.M)
    assert shown.index("reg.y.yours") == shown.index("reg.y.golden") + 1 < shown.index("reg.acc.golden")
    assert re.findall(r"^@800200\n-(\S+)", setup, re.M) == ["in", "reg.y"]

    # the bundle: what the model computes, without Python, and by the check
    window = place / "bundle" / "pi" / "rate"
    recompute.recompute(window)
    assert bundle.read(window).manifest["n"] == rows
    said = make(window, "SIM=icarus", f"RTL={tmp_path}", "PYTHON=false")
    assert said.returncode != 0
    assert f"FAIL pi/rate: {len(wrong)} of {rows} rows differ, the first is row 37 [icarus]" in said.stdout
    said = make(window, "SIM=icarus", f"RTL={RTL}", "PYTHON=false")
    assert (said.returncode, said.stdout) == (0, f"PASS pi/rate: {rows} rows, 3 ports [icarus]\n")
    again = rtl_run.check(window, tmp_path, "icarus")
    assert (again.divergence.cycle, again.divergence.port, again.differing) == (37, "y", {"y": len(wrong)})


def test_two_frames_and_what_a_simulator_did_not_know(bundles, tmp_path):
    given = bundles("rate_output") / "default"
    golden, at = bundle.read(given), 7000
    names = [port["name"] for port in golden.manifest["registers"][:2]]
    divergence.write_block(tmp_path, given, flipped(golden, at, names, unknown=names[1:]))
    rows = 2 * FRAME_CLOCKS + divergence.AFTER
    for name in names:
        ours, yours = package_of(tmp_path, at + 1 - 2 * FRAME_CLOCKS, rows, f"reg.{name}")
        wrong = [n for n in range(rows) if ours[n] != yours[n]]
        assert wrong == [2 * FRAME_CLOCKS - 1]
        assert isinstance(yours[wrong[0]], str) == (name == names[1])
    window = bundle.read(tmp_path / "bundle" / "rate_output" / "default")
    assert window.manifest["n"] == at + 1 + divergence.AFTER


@pytest.mark.parametrize(("style", "level", "clocks"), [("none", "registers", {}), ("sync", "outputs", {"r_y": 3})])
def test_the_window_is_judged_as_the_bundle_was(bundles, tmp_path, style, level, clocks):
    """A design without a reset follows it from the first row; a late port shows the difference so much later."""
    given = bundles("pi") / "rate"
    golden = bundle.read(given)
    found = comparison_scope.build_scope(golden, level, style, clocks)
    names = [p["name"] for p in golden.manifest["registers"] + golden.manifest["outputs"]]
    column, row = names.index("y"), int(found.first) + 40
    row += int(np.flatnonzero(found.care[row - found.first :, column])[0])
    report = flipped(golden, row, ["y"], level, style, clocks)
    late = clocks.get("r_y", 0)
    assert (report.divergence.cycle, report.first_row) == (row + late, found.first)
    divergence.write_block(tmp_path, given, report)
    window = bundle.read(tmp_path / "bundle" / "pi" / "rate")
    end = min(row + late + 1 + divergence.AFTER, found.first + len(found.golden.exp))
    assert np.array_equal(window.exp, golden.exp[found.first : end])
    part = comparison_scope.build_scope(window, level, style, clocks)
    assert part.first == 0
    assert part.care[row - found.first, column]
    ours, yours = package_of(tmp_path, found.first, end - found.first, "reg.y")
    assert [n for n in range(len(ours)) if ours[n] != yours[n]] == [row - found.first]


def test_a_place_that_cannot_be_written_to(bundles, tmp_path):
    """The check still says what differs, and another folder can be asked for."""
    need("iverilog")
    given = tmp_path / "rate"
    shutil.copytree(bundles("pi") / "rate", given, ignore=shutil.ignore_patterns("build"))
    (given / "build").write_text("")
    (tmp_path / "pi.v").write_text((RTL / "pi.v").read_text().replace(*SLIP))
    words = ["check", str(given), "--rtl", str(tmp_path), "--sim", "icarus", "--json"]
    done = CliRunner().invoke(cli.app, words)
    assert done.exit_code == 1
    assert json.loads(done.stdout)["written"] is None
    with pytest.raises(FileError, match="cannot be written"):
        divergence.write_block(given / "build" / "x", given, flipped(bundle.read(given), 40, ["y"]))
    out = tmp_path / "found"
    done = CliRunner().invoke(cli.app, [*words, "--out", str(out)])
    assert json.loads(done.stdout)["written"] == str(out)
    assert sorted(os.listdir(out)) == ["bundle", "diagnosis.json", "diagnosis.txt", "window.gtkw", "window.vcd"]
