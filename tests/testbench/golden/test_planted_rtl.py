"""Faults planted in real RTL are called by their name: the acceptance of `gyro golden check --rtl`."""

import collections
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

from fpga_model import fixed, pi
from testbench.golden.bundles import bundle
from testbench.golden.bundles.benches import PARTS
from testbench.golden.check import rtl_run
from testbench.golden.diagnosis.perturb import CAUSES
from tests.testbench.golden.benching import COUNTING
from tests.testbench.golden.planted_rtl import EQUIVALENT, FAULTS, RTL, plain

TOOL = {"v": ("icarus", "iverilog"), "vhd": ("ghdl", "ghdl")}
QUICK = [fault for fault in FAULTS if fault.block not in COUNTING][::70]


@pytest.fixture(scope="module")
def out(bundles):
    """Function of a block's name: folder of its bundles."""
    absent = sorted({fault.file for fault in FAULTS if not (RTL / fault.file).is_file()})
    if absent:
        pytest.skip(f"no RTL yet for {', '.join(absent)}: the planted faults were NOT tried")
    return bundles


def diagnosed(out, fault):
    """The report on the design with the fault; a skip is loud, never a pass."""
    sim, tool = TOOL[fault.file.split(".")[1]]
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed: the planted faults of {fault.file} were NOT tried")
    with tempfile.TemporaryDirectory() as folder:
        for part in (fault.block, *PARTS.get(fault.block, ())):
            shutil.copy(RTL / f"{part}.{fault.file.split('.')[1]}", folder)
        Path(folder, fault.file).write_text(fault.text())
        return rtl_run.check(out(fault.block) / fault.case, folder, sim, before=0)


# The table calls any limit one LSB off `limit`; docs/diagnosis.md has a cause of its own for what is compared
ALSO = {"limit": "comparison"}


def score(out, faults):
    """(right, others) of planted faults; a certain wrong name or a fault that no row shows is an assertion."""
    right, others = [], []
    for fault in faults:
        report = diagnosed(out, fault)
        where = (fault.file, fault.case, fault.cause, fault.what, fault.edits[-1])
        assert not report.passed, f"no vector shows {where}"
        found = report.diagnosis
        if found and found[0].cause in (fault.cause, ALSO.get(fault.cause)):
            right.append(fault)
        else:
            others.append((where, found))
            assert not any(cause.sure for cause in found[:1]), (where, found)
    return right, others


def test_the_table_has_many_kinds_and_every_edit_fits_once(out):
    assert len(FAULTS) >= 200
    assert {fault.cause for fault in FAULTS} <= set(CAUSES)
    texts = [(fault.block, fault.file, fault.case, fault.text()) for fault in FAULTS]
    assert len(set(texts)) == len(texts)
    for _, file, _, text in texts:
        assert text != plain((RTL / file).read_text())


def test_some_planted_faults_are_named(out):
    right, others = score(out, QUICK)
    assert len(right) >= 0.8 * len(QUICK), others


@pytest.mark.slow
def test_planted_faults_are_named(out):
    """At least 90 % of at least 200, and never a certain wrong name."""
    right, others = score(out, FAULTS)
    print(collections.Counter(fault.cause for fault in right), len(others), "others of", len(FAULTS))
    assert len(right) + len(others) == len(FAULTS) >= 200
    assert len(right) >= 0.9 * len(FAULTS), others


def test_what_no_vector_can_show_is_shown_equivalent(out, tmp_path):
    """The mask of 24 bits by yosys; the loop without a proportional gain by its numbers."""
    mask, *loop = EQUIVALENT
    for fault in EQUIVALENT:
        assert diagnosed(out, fault).passed, fault
    params = {p["name"]: p["raw"] for p in bundle.read(out("quadrature_loop") / "default").manifest["params"]}
    assert len(loop) == 2
    assert params["loop_kp"] == 0
    for limit in (params["loop_lo"], params["loop_hi"]):
        assert fixed.half_up(limit << pi.SHIFT, pi.SHIFT) == limit
    if shutil.which("yosys") is None:
        pytest.skip("yosys is not installed: the equivalence was NOT proven")
    given = bundle.read(out(mask.block) / mask.case).manifest["params"]
    for name, text in (("gold", (RTL / mask.file).read_text()), ("gate", mask.text())):
        for p in given:
            text, found = re.subn(
                rf"(parameter .*\b{p['name']} *= )[^,\s]+", rf"\g<1>{sum(p['fmt'])}'d{p['raw']}", text
            )
            assert found == 1, p
        (tmp_path / f"{name}.v").write_text(text.replace("module gyro_spi_dac", f"module {name}"))
    script = """read_verilog gold.v gate.v
proc
opt
miter -equiv -flatten -make_outputs gold gate miter
hierarchy -top miter
sat -verify -prove trigger 0 -tempinduct -set-init-undef -set-at 1 in_rst 1 -seq 1 -maxsteps 10 miter
"""
    (tmp_path / "prove.ys").write_text(script)
    done = subprocess.run(["yosys", "-q", "prove.ys"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
