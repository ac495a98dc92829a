"""`golden verify --recompute`: what was changed and sealed again is found by the model, with row and port."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from testbench.errors import FileError
from testbench.golden import cli
from testbench.golden.bundles import bundle, design_bundle, effect, recompute
from testbench.golden.recording import recording
from tests.testbench.golden import resealing


def reseal(folder, *change):
    """As `resealing.reseal`; plain `verify` finds nothing."""
    resealing.reseal(folder, *change)
    bundle.verify(folder)


def flip(path, line, bit):
    """Change one bit of one word of a hex file; returns its value before."""
    lines = path.read_text().split("\n")
    before = int(lines[line], 16)
    lines[line] = f"{before ^ 1 << bit:0{len(lines[line])}x}"
    path.write_text("\n".join(lines))
    return before


@pytest.fixture
def folder(bundles, tmp_path):
    return Path(shutil.copytree(bundles("pi") / "rate", tmp_path / "rate"))


@pytest.fixture(scope="module")
def reset():
    return recording.load("reset")


@pytest.fixture
def design(reset, tmp_path):
    """The first two frames of `reset`, every clock of the second a row."""
    design_bundle.write(
        design_bundle.shorten_recording(reset, 2, (recording.Window(3250, 3250, "second frame"),)), tmp_path / "reset"
    )
    return tmp_path / "reset"


def refused(folder, message):
    with pytest.raises(FileError, match=message) as caught:
        recompute.recompute(folder)
    assert "\n" not in str(caught.value)


def test_a_bundle_that_was_exported_is_proved(folder):
    proof = recompute.recompute(folder)
    assert proof.rows == bundle.read(folder).manifest["n"]
    assert (proof.code, proof.other) == (None, ())
    assert proof.files == len(bundle.read(folder).manifest["sha256"])


def test_a_shifted_result_is_found_with_row_and_port(folder):
    flip(folder / "exp.hex", 100, 0)
    reseal(folder)
    refused(folder, r"exp\.hex: row 100, port y: holds -?\d+, the model computes -?\d+$")


def test_a_changed_input_is_found(folder):
    manifest = bundle.read(folder).manifest
    flip(folder / "stim.hex", 40, bundle.total(manifest["inputs"]) - 1)
    reseal(folder)
    # reset is active in row 40 now, so the registers of row 41 are those of reset
    refused(folder, r"exp\.hex: row 41, port ")


def test_an_input_without_effect_is_found_in_the_other_files_that_hold_it(folder):
    rows = bundle.read(folder)
    names = [port["name"] for port in rows.manifest["inputs"]]
    quiet = next(n for n in range(rows.manifest["n"]) if rows.stim[n, names.index("en")] == 0 and not rows.stim[n, 0])
    flip(folder / "stim.hex", quiet, sum(p["width"] for p in rows.manifest["inputs"][names.index("e") + 1 :]))
    reseal(folder)
    refused(folder, rf"ports/e\.hex: line {quiet + 1} differs from what this version writes")


def test_a_bit_that_is_not_compared_is_found(folder):
    flip(folder / "mask.hex", 7, 3)
    reseal(folder)
    refused(folder, r"mask\.hex: row 7, port y: ")


FILES = ("params.vh", "ports/r_y.hex", "check.sh", "params_pkg.vhd", "vec.csv", "tb_pi.v")


@pytest.mark.parametrize("name", [*FILES[:3], *(pytest.param(name, marks=pytest.mark.slow) for name in FILES[3:])])
def test_a_changed_file_is_found(folder, name):
    path = folder / name if (folder / name).exists() else folder / name.replace("r_", "")
    path.write_text(path.read_text().replace("1", "2", 1))
    reseal(folder)
    refused(folder, rf"{path.name}: line \d+ differs from what this version writes")


def test_a_changed_parameter_is_found(folder):
    reseal(folder, lambda m: m["params"][0].update(raw=m["params"][0]["raw"] ^ 1))
    refused(folder, r"manifest\.json: params: is .*, this version computes ")


def test_an_added_and_a_missing_file_are_found(folder):
    (folder / "more.hex").write_text("0\n")
    reseal(folder, lambda m: m["sha256"].update({"more.hex": ""}))
    refused(folder, r"more\.hex: this version writes no such file")
    (folder / "more.hex").unlink()
    (folder / "tb_pi.v").unlink()
    reseal(folder, lambda m: [m["sha256"].pop(name) for name in ("more.hex", "tb_pi.v")])
    refused(folder, r"tb_pi\.v: missing: this version writes it")


def test_of_another_version_benches_are_not_compared_but_every_number_is(folder):
    (folder / "check.sh").write_text("exit 0\n")
    reseal(folder, lambda m: m["provenance"].update(version="0.0.9"))
    proof = recompute.recompute(folder)
    assert proof.other == ("check.sh",)
    assert "version 0.0.9" in proof.text()
    flip(folder / "exp.hex", 9, 0)
    reseal(folder)
    refused(folder, r"exp\.hex: row 9, port ")


def test_a_block_or_case_that_this_version_lacks_is_refused(folder):
    reseal(folder, lambda m: m.update(case="none"))
    refused(folder, "pi/none is not a block and case of this version")


def test_the_whole_design_is_proved_from_its_recording(design):
    assert recompute.recompute(design).code is None


@pytest.mark.parametrize(
    ("name", "line", "message"),
    [
        ("exp", 20, r"exp\.hex: row 20 \(clock 3269\), port "),
        pytest.param("stim", 20, r"stim\.hex: row 20 \(clock 3269\), port ", marks=pytest.mark.slow),
        pytest.param("sig", 1, r"sig\.hex: line 2 differs from what", marks=pytest.mark.slow),
        ("adc", 0, "differs from what|the model computes|this version computes"),
    ],
)
def test_one_bit_of_the_whole_design_is_found(design, name, line, message):
    flip(design / f"{name}.hex", line, 0)
    reseal(design)
    refused(design, message)


@pytest.mark.slow
def test_parameters_of_the_whole_design_are_found(design):
    reseal(design, lambda m: m["params"][5].update(raw=m["params"][5]["raw"] ^ 1))
    refused(design, "the model computes|params.*line|this version computes")
    reseal(design, lambda m: m["params"].pop())
    refused(design, "params: are not the")


def test_a_known_case_is_of_the_known_recording(reset, tmp_path):
    changed = reset.stimulus.adc.copy()
    changed[-1, 2] ^= 1
    design_bundle.write(reset._replace(stimulus=reset.stimulus._replace(adc=changed)), tmp_path)
    refused(tmp_path, "is of another recording of reset")


@pytest.mark.slow
def test_an_effect_is_proved_too(tmp_path):
    folder, _ = effect.export("cubic", effect.case(sets=["effects.duffing_k3_per_um2=1e-5"], frames=40), tmp_path)
    assert recompute.recompute(folder).code is None


def test_command_line(folder):
    run = CliRunner().invoke
    done = run(cli.app, ["verify", str(folder)])
    assert "hashes agree" in done.output
    done = run(cli.app, ["verify", str(folder), "--recompute"])
    assert "computed again: 4297 rows" in done.output
    assert "To prove the rows right" in " ".join(run(cli.app, ["verify", "--help"]).output.split())
