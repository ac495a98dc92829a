"""What a record says: wrong ones are refused or warned with table and row, right ones have no finding; both drawn."""

import collections
import copy
import re

import numpy as np
import pytest
from numba import config as numba_config
from typer.testing import CliRunner

from testbench.errors import ConfigError
from testbench.measured.cli import app
from testbench.measured.closed_loop import loop_record
from testbench.measured.record import checks, load_record, schema
from testbench.measured.residual import residuals
from testbench.storage.record import RecordError, write_record
from tests.testbench.measured import meanings

SEED = 2611  # of the numbers that docs/measured.md states; no limit was set with it
RIGHT, WRONG = 200, 80


def findings(path, record):
    """Lines about a record that went through a file, with the firmware's replay."""
    write_record(path, record)
    try:
        return [str(f) for f in load_record.load(path).findings]
    except RecordError as refused:
        return list(refused.findings)


def named(lines, place, row):
    """True if a line names the table or stream, and the row where the mistake has one."""
    of_table = not place.startswith(("adc", "streams", "clock"))
    wanted = r"\d+" if row is None else str(row)
    return any(re.search(place, line) and (re.search(rf"\brows? {wanted}\b", line) or not of_table) for line in lines)


def alarms(records, seed, count):
    """{number of a right record: its findings}, of those that have some."""
    found = {}
    for k in range(count):
        lines = [str(f) for f in checks.check(meanings.right(np.random.default_rng([seed, 1, k]), records))]
        if lines:
            found[k] = lines
    return found


def missed(records, seed, mistakes, read):
    """[(mistake, place, row, findings)] of wrong records in which no finding names the place."""
    out = []
    for k, mistake in enumerate(mistakes):
        record, place, row = meanings.wrong(np.random.default_rng([seed, 2, k]), records, mistake)
        lines = read(record)
        if not named(lines, place, row):
            out.append((mistake.__name__, place, row, lines[:2]))
    return out


def test_right_records_have_no_finding(small):
    assert alarms([small], 1, 12) == {}


# what two conditions at one temperature, without a step, can have, and what needs no replay of the firmware
ELSEWHERE = ("dwell_during_step", "over_power_on", "exchanged", "negated")
FITTING = [m for m in meanings.MISTAKES if m.__name__ not in ELSEWHERE]


def test_each_mistake_is_named(small):
    def read(record):
        return [str(f) for f in checks.check(record)]

    assert len(FITTING) >= 16
    assert missed([small], 1, FITTING, read) == []


@pytest.mark.slow
@pytest.mark.skipif(bool(numba_config.DISABLE_JIT), reason="too slow interpreted")
def test_eighty_wrong_and_two_hundred_right_records(tmp_path, capsys):
    records = meanings.pool(SEED)
    false = alarms(records, SEED, RIGHT)
    mistakes = [meanings.MISTAKES[k % len(meanings.MISTAKES)] for k in range(WRONG)]
    misses = missed(records, SEED, mistakes, lambda record: findings(tmp_path / "a.h5", record))
    kinds = len(collections.Counter(m.__name__ for m in mistakes))
    with capsys.disabled():
        print(f"\n{WRONG - len(misses)} of {WRONG} wrong records of {kinds} kinds named")
        print(f"{len(false)} of {RIGHT} right records with a finding")
        for miss in misses:
            print("  missed:", *miss)
    assert false == {}
    assert len(misses) <= 0.05 * WRONG


@pytest.mark.parametrize("words", ["adc_yI and adc_yQ exchanged", "adc_yQ negated", "adc_yQ shifted by +1 row"])
def test_the_replay_names_one_mistake_in_the_streams_of_the_converter(own, tmp_path, words):
    one, other = (own.streams[name].data for name in ("adc_yI", "adc_yQ"))
    if "exchanged" in words:
        meanings.codes(own, "adc_yI", other)
    told = {"a": one, "d": -other, "w": np.roll(other, 1)}[words[-1]] if "exchanged" not in words else one
    meanings.codes(own, "adc_yQ", told)
    line = findings(tmp_path / "a.h5", own)[-1]
    assert line.startswith("R16 /streams/")
    assert line.endswith(f"; 0 LSB with {words}")


def test_two_mistakes_are_no_single_one(own, tmp_path):
    for name in ("adc_yI", "adc_yQ"):
        meanings.codes(own, name, -own.streams[name].data)
    line = findings(tmp_path / "a.h5", own)[-1]
    assert line.startswith("R16 /streams/")
    assert "0 LSB with" not in line


def test_what_is_implausible_is_a_warning_that_every_reader_sees(own, tmp_path):
    meanings.attrs(own, "dac_drv", lsb_V=0.5 * own.streams["dac_drv"].attrs["lsb_V"])
    (finding,) = checks.check(own)
    assert (finding.rule, finding.level) == ("R29", schema.WARNED)
    write_record(tmp_path / "a.h5", own)
    assert load_record.load(tmp_path / "a.h5", replay=False).warnings == (str(finding),)
    said = CliRunner().invoke(app, ["check", str(tmp_path / "a.h5"), "--no-replay"])
    assert said.exit_code == 0
    assert f"{finding} (warned)\n" in said.stdout


def test_a_contradiction_in_a_segment_that_no_analysis_takes_is_a_warning(own):
    row = own.tables["segments"]["kind"].data.tolist().index("settle")
    meanings.put(own, "segments", "rate_set", row, 77.0)
    finding = checks.check(own)[0]
    assert (finding.rule, finding.level) == ("R21", schema.WARNED)
    assert f"found 77 deg/s in row {row}" in finding.text


def test_required_streams_alone_are_checked_and_what_tracing_lacks_is_named(small):
    record = copy.deepcopy(small)
    for name in meanings.OPTIONAL:
        record.streams.pop(name, None)
    assert checks.check(record) == []
    line = "/streams/[a-z_]*word: expected a stream with one row per frame, found none; "
    line += "the observable [a-z_]* is computed from it"
    with pytest.raises(ConfigError, match=line):
        loop_record.measured_features(record, "a", {})
    with pytest.raises(ConfigError, match=line):
        residuals.study_residuals(record, "R2")
