"""One bit flipped anywhere in a state or a record: refused, or without effect on what is read. Stores of campaigns and
unfinished runs have tests of their own (`test_damaged`, `test_checkpoint`)."""

import numpy as np
import pytest

from testbench.storage import record, state_file
from testbench.storage.record import Column, RecordError
from testbench.storage.record_read import read_record

TRIES = 500


def state(path):
    """Write a state of some kB; returns its reader."""
    rng = np.random.default_rng(1)
    values = {"fpga": rng.integers(-(1 << 40), 1 << 40, 217), "plant.z": rng.normal(size=24), "tick": 1_250_000}
    state_file.save_state(path, values, "layout 1", {"config_toml": "[noise]\nseed = 1\n"})

    def read():
        found, meta = state_file.load_state(path, "layout 1")
        return {name: np.asarray(value).tobytes() for name, value in found.items()}, meta

    return read


def run(path):
    """Write a record of some kB; returns its reader."""
    rng = np.random.default_rng(2)
    streams = {name: Column(rng.integers(-1000, 1000, 500), "code", 1, 3250) for name in ("adc_xI", "adc_yI")}
    record.write_record(path, record.Record(streams, config_toml="[noise]\nseed = 1\n"))

    def read():
        found = read_record(path)
        columns = {name: (column.data.tobytes(), column[1:5]) for name, column in found.streams.items()}
        return columns, found.config_toml, found.provenance, found.clock_ppm, found.content_sha256

    return read


@pytest.mark.parametrize("write", [state, run])
def test_one_flipped_bit_is_refused_or_without_effect(tmp_path, write):
    path = tmp_path / "file.h5"
    read = write(path)
    whole, want = path.read_bytes(), read()
    rng, refused = np.random.default_rng(TRIES), 0
    for bit in rng.integers(8 * len(whole), size=TRIES).tolist():
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            assert read() == want
        except RecordError:
            refused += 1
    # what is accepted has lost its seal, whose text is 0.2 % of the file, and is held by its content hash
    assert refused > 0.97 * TRIES
