"""Faults written into the reference RTL by rules on text, of kinds that the diagnosis was not written from."""

import shutil

import pytest

from testbench.golden.diagnosis.causes import CAUSES
from tests.testbench.golden.diagnosis import rtl_faults, score

pytestmark = pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus is not installed: no fault was TRIED")

# Rounds of docs/diagnosis.md: rules, faults of each rule, seed
ROUNDS = {"first": (8, 61), "second": (11, 62)}


def of_round(bundles, name, stems=tuple(rtl_faults.CASES), most=None):
    per_rule, seed = ROUNDS[name]
    faults = rtl_faults.drawn(getattr(rtl_faults, name.upper()), most or per_rule, seed, stems)
    return [score.judged(bundles(f.stem) / rtl_faults.CASES[f.stem], f) for f in faults]


def test_every_kind_has_a_cause_of_the_list_or_none():
    kinds = set()
    for rules in (rtl_faults.FIRST, rtl_faults.SECOND):
        found = rtl_faults.drawn(rules, 5, 1)
        assert len({f.kind for f in found}) >= 15
        assert all(f.text != rtl_faults.source(f.stem) for f in found)
        kinds |= {f.cause for f in found}
    assert kinds == {*CAUSES, ""}


def test_some_faults_are_named(bundles):
    found = of_round(bundles, "second", ("dds", "isqrt", "watchdog"), 1)
    seen = [one for one in found if one.verdict != "not seen"]
    assert len(seen) >= 8
    assert sum(one.verdict == "right" for one in seen) >= 0.75 * len(seen), [one.verdict for one in found]
    assert not any(one.verdict == "wrong" for one in seen), [(one.fault.edit, one.causes) for one in seen]
