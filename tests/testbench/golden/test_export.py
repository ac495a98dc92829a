"""Export: byte-identical twice, complete, and the benches pass on right designs and fail on wrong ones."""

import fnmatch
import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fpga_model import sine
from testbench.errors import ConfigError
from testbench.golden import cli
from testbench.golden.bundles import benches, bundle, export
from testbench.golden.stimulus import blocks

PINNED = Path(__file__).with_name("golden_sha256.json")
PAGE = Path(__file__).resolve().parents[3] / "docs" / "golden.md"
CHOSEN = ("dds", "sine", "agc")


def hashes(folder):
    """{path: hash of the bytes}, of a manifest without the commit of the tree, which may change meanwhile."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(
            re.sub(rb'"git": "[^"]*"', b"", path.read_bytes()) if path.name == bundle.MANIFEST else path.read_bytes()
        ).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "build" not in path.relative_to(folder).parts
    }


@pytest.mark.parametrize("stem", CHOSEN)
def test_export_twice_is_byte_identical(bundles, stem, tmp_path):
    export.export(stem, tmp_path)
    assert hashes(tmp_path / stem) == hashes(bundles(stem))


@pytest.mark.parametrize("stem", CHOSEN)
def test_bundle_is_complete_and_reads_back(bundles, stem):
    folder = bundles(stem) / "default"
    found = bundle.read(folder)
    block = blocks.BLOCKS[stem]
    regs, pins = blocks.run(block, "default", found.stim)
    assert np.array_equal(found.exp, np.column_stack([regs, pins]))
    listed = set(found.manifest["sha256"])
    assert {
        *(
            "stim.hex",
            "exp.hex",
            "mask.hex",
            "vec.csv",
            "params.vh",
            "params.svh",
            "params_pkg.vhd",
            "Makefile",
            "check.sh",
        ),
        *(f"tb_{stem}.v", f"tb_{stem}.vhd", f"test_{stem}.py", "run_vunit.py", "golden.vcd", "golden.gtkw"),
        *(f"ports/{p.name}.hex" for p in block.columns),
        *(f"ports/{name}.hex" for name, _ in benches.result_port_pairs(block)),
    } <= listed
    rows = (folder / "vec.csv").read_text().splitlines()
    assert len(rows) == found.manifest["n"] + 1
    assert [int(v) for v in rows[-1].split(",")][1:] == [*found.stim[-1].tolist(), *found.exp[-1].tolist()]
    assert found.manifest["families"][0] == ["idle", 0, 8]
    for path in ("test_{}.py", "run_vunit.py"):
        source = (folder / path.format(stem)).read_text()
        compile(source, path, "exec")


def test_the_page_says_what_each_file_of_a_bundle_is_for(bundles):
    table = PAGE.read_text().partition("## What is in a bundle")[2].partition("\n\nWords are")[0]
    cells = [row.split("|")[1] for row in table.splitlines() if row.startswith("| `")]
    patterns = {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)} - {"build/"}
    for stem in CHOSEN:
        listed = {*bundle.verify(bundles(stem) / "default", strict=False)["sha256"], bundle.MANIFEST}
        wanted = {pattern.replace("<block>", stem) for pattern in patterns}
        assert [name for name in listed if not any(fnmatch.fnmatch(name, pattern) for pattern in wanted)] == []
        unused = {pattern for pattern in wanted if not fnmatch.filter(listed, pattern)}
        assert unused == (set() if blocks.BLOCKS[stem].roms else {"rom/*.hex", "rom/*.mif"})


def digests(folder):
    """{block/case: hashes of the manifest, which holds those of all files, and of the vectors alone}."""
    found = {path.parent.name: json.loads(path.read_text()) for path in sorted(folder.glob(f"*/{bundle.MANIFEST}"))}
    return {f"{folder.name}/{case}": pin_of(manifest) for case, manifest in found.items()}


def pin_of(manifest):
    return {"manifest": manifest["manifest_sha256"], "vectors": bundle.vectors_sha256(manifest)}


# the ranges of the sequencer take seconds to prove
@pytest.mark.parametrize(
    "stem", [pytest.param(stem, marks=[pytest.mark.slow] * (stem == "sequencer")) for stem in blocks.BLOCKS]
)
def test_bundles_are_those_that_were_shipped(bundles, stem):
    """To ship others: `gyro golden export all --out DIR --json`, and put the hashes into golden_sha256.json."""
    pinned = json.loads(PINNED.read_text())
    found = digests(bundles(stem))
    assert found == {name: digest for name, digest in pinned.items() if name.startswith(f"{stem}/")}


def test_a_change_of_a_bench_leaves_the_hash_of_the_vectors(bundles):
    manifest = bundle.verify(bundles("dds") / "default", strict=False)
    for name, same in (("check.sh", True), ("tb_dds.v", True), ("stim.hex", False), ("mask.hex", False)):
        changed = {**manifest, "sha256": {**manifest["sha256"], name: "0" * 64}}
        assert bundle.seal(changed) != bundle.seal(manifest)
        assert (bundle.vectors_sha256(changed) == bundle.vectors_sha256(manifest)) == same, name


def test_rom_of_the_sine_is_the_firmwares(bundles):
    words = [int(line, 16) for line in (bundles("sine") / "default" / "rom" / "sine.hex").read_text().split()]
    assert words == sine.ROM.tolist()
    assert "WIDTH = 36;" in (bundles("sine") / "default" / "rom" / "sine.mif").read_text()


def test_no_file_names_the_version_or_this_machine(bundles):
    for path in bundles("dds").rglob("*"):
        if path.is_file() and path.name != bundle.MANIFEST and "build" not in path.parts:
            text = path.read_text()
            assert "0.1.0" not in text, path
            assert str(bundles("dds").parent) not in text, path


def test_an_unknown_block_is_one_clear_error(tmp_path):
    with pytest.raises(ConfigError, match="block: 'ddds' is not one of all, dds, sine"):
        export.export("ddds", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_command_line_exports_and_verifies(tmp_path):
    runner = CliRunner()
    done = runner.invoke(cli.app, ["export", "rates", "--out", str(tmp_path), "--json"])
    assert done.exit_code == 0, done.output
    (found,) = json.loads(done.output)["bundles"]
    assert found["rows"] == bundle.read(found["folder"]).manifest["n"]
    done = runner.invoke(cli.app, ["verify", found["folder"]])
    assert (done.exit_code, "ok" in done.output) == (0, True)


@pytest.mark.slow
def test_everything_is_exported_within_a_minute(tmp_path):
    code = "import sys; from testbench.golden.bundles.export import export; export('all', sys.argv[1])"
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    found = {name: digest for folder in tmp_path.iterdir() for name, digest in digests(folder).items()}
    assert found == json.loads(PINNED.read_text())
