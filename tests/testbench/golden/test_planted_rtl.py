"""Faults planted in real RTL are called by their name: the acceptance of `gyro golden check --rtl`."""

import collections
import shutil
import tempfile
from pathlib import Path

import pytest

from testbench.golden import rtl_run
from testbench.golden.benches import PARTS
from testbench.golden.diagnose import CAUSES, UNKNOWN
from testbench.golden.export import export
from tests.testbench.golden.planted_rtl import FAULTS, RTL, STRANGERS

TOOL = {"v": ("icarus", "iverilog"), "vhd": ("ghdl", "ghdl")}
QUICK = FAULTS[::13]
QUICK_STRANGERS = STRANGERS[::9]


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("golden")
    for block in sorted({fault.block for fault in FAULTS}):
        export(block, folder)
    return folder


def diagnosed(out, fault):
    """The report on the design with the fault; a skip is loud, never a pass."""
    sim, tool = TOOL[fault.file.split(".")[1]]
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed: the planted faults of {fault.file} were NOT tried")
    with tempfile.TemporaryDirectory() as folder:
        for part in (fault.block, *PARTS.get(fault.block, ())):
            shutil.copy(RTL / f"{part}.{fault.file.split('.')[1]}", folder)
        Path(folder, fault.file).write_text(fault.text())
        return rtl_run.check(out / fault.block / fault.case, folder, sim, before=0)


def score(out, faults):
    """(right, unknown) of planted faults; a wrong name or a fault that no row shows is an assertion."""
    right, unknown = [], []
    for fault in faults:
        report = diagnosed(out, fault)
        where = (fault.file, fault.case, fault.cause, fault.what, fault.edits[-1])
        assert not report.passed, f"no vector shows {where}"
        found = report.diagnosis
        assert found.cause in (fault.cause, UNKNOWN), (where, found)
        if found.cause == UNKNOWN:
            unknown.append((where, found))
            continue
        assert fault.what in found.what, (where, found)
        right.append(fault)
    return right, unknown


def test_the_table_has_every_kind_and_every_edit_fits_once():
    assert len(FAULTS) >= 200
    assert {fault.cause for fault in FAULTS} == set(CAUSES) - {UNKNOWN}
    texts = [(fault.file, fault.case, fault.text()) for fault in FAULTS + STRANGERS]
    assert len(set(texts)) == len(texts)
    for file, _, text in texts:
        assert text != (RTL / file).read_text()


def test_some_planted_faults_are_named(out):
    right, unknown = score(out, QUICK)
    assert len(right) >= 0.95 * len(QUICK), unknown


def test_some_strangers_are_unknown(out):
    for fault in QUICK_STRANGERS:
        report = diagnosed(out, fault)
        assert (report.passed, report.diagnosis.cause) == (False, UNKNOWN), (fault, report.diagnosis)


@pytest.mark.slow
def test_planted_faults_are_named(out):
    """At least 95 % of at least 200, and never a wrong name."""
    right, unknown = score(out, FAULTS)
    print(collections.Counter(fault.cause for fault in right), len(unknown), "unknown of", len(FAULTS))
    assert len(right) + len(unknown) == len(FAULTS) >= 200
    assert len(right) >= 0.95 * len(FAULTS), unknown


@pytest.mark.slow
def test_strangers_are_unknown(out):
    for fault in STRANGERS:
        report = diagnosed(out, fault)
        assert not report.passed, fault
        assert report.diagnosis.cause == UNKNOWN, (fault, report.diagnosis)
