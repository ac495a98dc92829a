"""Words that a record lacks, from its ADC codes: what the firmware must have written, by its replay from power-on.

    recorded codes + register log + power-on --[replay]--> streams that were not recorded, tap "replayed"

Source    docs/measured.md
"""

import dataclasses

import numpy as np

from testbench.measured.record import check_tables, firmware_residual, replay, schema
from testbench.measured.record.sessions import sessions
from testbench.run import build
from testbench.storage.record import Column

TRACED = ("nco_fword", "amplitude_word", "rate_word", "quadrature_code")  # that tracing needs beside the channels
REPLAYED = "replayed"  # tap of a stream that nobody recorded


def replay_words(record, session, names):
    """{stream: (frames,)} of a session, int64."""
    firmware = build.firmware(check_tables.stated_config(record))
    word_blocks = {name: [] for name in names}
    for _, n, o in firmware_residual.replay_blocks(record, session, firmware):
        for name, parts in word_blocks.items():
            parts.append(o.words[:n, replay.WORDS.index(schema.REPLAYED[name])])
    return {name: np.concatenate(parts) for name, parts in word_blocks.items()}


def missing_replayed_streams(record):
    """Streams that a replay could add."""
    names = [name for name in schema.REPLAYED if name not in record.streams]
    if "adc_temperature" not in record.streams and "rate_output" in names:
        names.remove("rate_output")
    return tuple(names)


def complete_record(record):
    """(record with the streams that it lacks, why they cannot be had or "").

    The record itself is left as it is; it is returned where nothing can be, or need be, added. Where `adc_ok` is not
    recorded, every conversion that was seen is taken as good.
    """
    names = missing_replayed_streams(record)
    why = firmware_residual.unreplayable(record, check_tables.stated_config(record)) if names else ""
    if why or not names:
        return record, why
    each = [replay_words(record, session, names) for session in sessions(record)]
    lsb, added = schema.lsb_volts(check_tables.stated_config(record).device()), {}
    for name in names:
        data = np.concatenate([part[name] for part in each]).astype(schema.stream_dtype(name))
        attrs = schema.attributes(name, REPLAYED, lsb.get(name))
        added[name] = Column(data, schema.STREAMS[name].unit, *schema.PER_FRAME, 0, attrs)
    return dataclasses.replace(record, streams=record.streams | added), ""
