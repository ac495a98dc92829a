"""Words that a record lacks: those of the replay, bit for bit those that were recorded."""

import copy
import dataclasses

import numpy as np
import pytest

from testbench.errors import ConfigError
from testbench.measured.importing import firmware_words
from testbench.measured.record import checks, load_record, schema
from testbench.measured.residual import features, residuals
from testbench.storage.record import write_record


def codes_only(record):
    """The four channels that the schema requires, nothing else."""
    return dataclasses.replace(record, streams={name: record.streams[name] for name in schema.ADC})


def test_words_from_the_codes_alone_are_those_that_the_board_had(small, tmp_path):
    bare = codes_only(small)
    assert checks.check(bare) == []
    write_record(tmp_path / "bare.h5", bare)
    loaded = load_record.load(tmp_path / "bare.h5")
    assert loaded.residual.verdict == "R0 not decidable: adc_ok is not recorded"
    found, why = firmware_words.complete_record(loaded.record)
    assert why == ""
    first = [edge // 3250 for edge in small.tables["power_on"]["edge"].data]
    for name in small.streams.keys() & schema.REPLAYED.keys() - {"rate_output"}:
        have, wanted = found.streams[name], small.streams[name]
        assert have.attrs["tap"] == firmware_words.REPLAYED
        assert (have.unit, have.num, have.den, have.edge0, have.data.dtype) == (*wanted[1:5], wanted.data.dtype)
        rows = np.ones(len(have.data), bool)
        rows[first] = name not in schema.DAC  # what the chips held before the first frame no replay knows
        assert np.array_equal(have.data[rows], wanted.data[rows]), name
    # the compensated rate needs the temperature
    assert small.streams.keys() - found.streams.keys() == {"adc_ok", "adc_temperature", "rate_output"}
    assert firmware_words.missing_replayed_streams(found) == ()


def test_what_tracing_needs_is_named():
    assert {o.stream for o in features.OBSERVABLES.values()} == {*schema.ADC, *firmware_words.TRACED}


def test_a_complete_record_is_left_alone(small):
    whole, _ = firmware_words.complete_record(small)
    found, why = firmware_words.complete_record(whole)
    assert found is whole
    assert why == ""


def test_without_a_power_on_no_word_follows(small):
    bare = codes_only(copy.deepcopy(small))
    for table in ("power_on", "gaps"):
        bare.tables[table] = {key: c._replace(data=c.data[:0]) for key, c in bare.tables[table].items()}
    found, why = firmware_words.complete_record(bare)
    assert found is bare
    assert why == "frame 0 is not a power-on, and /initial does not contain every register"


def test_r1_of_another_firmware_takes_the_recorded_words(own):
    """With its states unknown the kick of the start-up is missing; behind it nothing else is."""
    own.attrs["regmap_sha256"] = "0" * 64
    own.streams.pop("state")
    study = residuals.study_residuals(own, "R1")
    assert not study.exact_words
    assert {row.observable for row in study.rows} == set(schema.ADC)
    with pytest.raises(ConfigError, match="R2: regmap_sha256 belongs to another firmware"):
        residuals.study_residuals(own, "R2")
