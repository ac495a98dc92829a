"""Files of a laboratory and a map of their columns as a measurement record; all that was found and assumed is kept.

    files --[board]--> power-ons, one behind the other --[replay]--> words, lock --[dwells]--> segments --> record

Where no word can be replayed the record has the recorded streams alone, and says why.
Source    docs/import.md
"""

import json
from typing import NamedTuple

import numpy as np

from fpga_model import registers, sequencer
from fpga_model.rates import FRAME_CYCLES
from testbench import config as configuration
from testbench.config import to_toml
from testbench.errors import ConfigError
from testbench.measured.importing import dwells, firmware_words, record_map, recorded_board
from testbench.measured.record import schema, timing
from testbench.measured.record.sessions import UNSEEN, Session
from testbench.run import design_check
from testbench.storage import inputs
from testbench.storage.record import Column, Record, TableColumn

IMPORT_ATTRIBUTE = "import"  # attribute with what was found and assumed, a line each


class Imported(NamedTuple):
    """A record, what was found and assumed, and why words are missing."""

    record: Record
    lines: tuple
    lacking: str


def model(lab_map, map_path):
    """Configuration of the model that a map names."""
    try:
        config = configuration.changed(configuration.Config(), lab_map.settings())
        design_check.default_only(config, "a measurement record")
        return config
    except (ConfigError, ValueError) as problem:
        raise ConfigError(f"{map_path}: [set] {str(problem).removeprefix('changed: ')}") from None


def import_files(paths, map_path):
    """`Imported` of files, each from one power-on, and their map."""
    lab_map = record_map.read(map_path)
    if len(lab_map.power_on) > len(paths):
        raise ConfigError(
            f"{map_path}: {len(lab_map.power_on)} [[power_on]] for {len(paths)} files; write at most one for each file"
        )
    config = model(lab_map, map_path)
    boards = [recorded_board.import_board(path, lab_map, k, config) for k, path in enumerate(paths)]
    starts = np.cumsum([0] + [b.frames for b in boards]).tolist()
    record = Record(_streams(boards, timing.valid_clock(config)), {}, to_toml(config), "measured")
    record.attrs = _head(lab_map, paths)
    record.tables = _record_tables(lab_map, boards, starts)
    lines = [f"{b.path}: {text}" for b in boards for text in b.words]
    completed_record, lacking = record, next((why for b in boards if (why := _unreplayable(b))), "")
    if not lacking:
        record.streams["adc_ok"] = _good(boards, record)
        lines.append("assumed: every recorded conversion was good (adc_ok)" if "adc_ok" not in lab_map.columns else "")
        completed_record, lacking = firmware_words.complete_record(record)
    if not lacking:
        _first_words(boards, starts, completed_record)
    for b, start in zip(boards, starts):
        lacking = _segments(lab_map, b, start, completed_record if not lacking else record, lacking, lines)
    record = record if lacking else completed_record
    record.tables["segments"] = _segment_table(boards, starts)
    record.attrs["roles_sha256"] = schema.roles_sha256(record.tables["segments"])
    lines += _outlook(record, lacking)
    lines = tuple(line for line in lines if line)
    record.attrs[IMPORT_ATTRIBUTE] = json.dumps(lines)
    return Imported(record, lines, lacking)


def _unreplayable(b):
    """Why no word of a power-on can be replayed, or ""."""
    if not b.line.powered:
        return f"{b.path}: {b.line.words[-1]}"
    if not b.raw:
        return f"{b.path}: its volts do not correspond to integer codes of the converter"
    return f"{b.path}: rows are lost" if b.line.lost else ""


def _head(lab_map, paths):
    head = {key: getattr(lab_map, key) for key in record_map.HEAD}
    sources = [[path.name, inputs.file_sha256(path)] for path in paths]
    return head | {
        "regmap_sha256": lab_map.regmap_sha256 or schema.regmap_sha256(),
        "roles_sha256": "",
        "nuisances": ",".join(p.param for p in lab_map.prior),
        "plan": lab_map.name,
        "sources": json.dumps(sources),
    }


def _streams(boards, valid):
    """{stream: Column} of the recorded columns, the power-ons one behind the other."""
    out = {}
    for name in boards[0].streams:
        lsb, unc = boards[0].lsb_v.get(name, (None, None))
        attrs = schema.attributes(name, schema.STREAMS[name].tap, lsb, unc)
        data = np.concatenate([b.streams[name] for b in boards]).astype(schema.stream_dtype(name))
        edge0 = valid if name.startswith("adc_") else 0
        out[name] = Column(data, schema.STREAMS[name].unit, *schema.PER_FRAME, edge0, attrs)
    return out


def _good(boards, record):
    """Stream adc_ok: as recorded, else 1 but in frame 0 of each power-on."""
    if "adc_ok" in record.streams:
        return record.streams["adc_ok"]
    data = np.concatenate([(np.arange(b.frames) > 0) for b in boards]).astype(np.int32)
    channel_column = record.streams["adc_xI"]
    return Column(data, "1", *schema.PER_FRAME, channel_column.edge0, schema.attributes("adc_ok", "assumed"))


def _first_words(boards, starts, record):
    """Recorded words of frame 0, where a file begins with the first conversion: those at power-on."""
    names = [name for name in schema.REPLAYED if name in boards[0].streams]
    for b, start in zip(boards, starts):
        if names and b.line.frames[0] > 0:
            for name, values in firmware_words.replay_words(record, Session(start, 1, True), names).items():
                record.streams[name].data[start] = values[0]


def _segments(lab_map, b, start, record, lacking, lines):
    """Fill the segments of a power-on; returns why words are missing, which may be that the board never locks."""
    if lab_map.segment:
        b.parts = dwells.stated_segments(lab_map.segment, b.line.begin, b.frames, b.path)
        return lacking
    locked = np.ones(b.frames, bool)
    if "state" in record.streams:
        locked = record.streams["state"].data[start : start + b.frames] == sequencer.LOCKED
        if locked.any():
            lines.append(f"{b.path}: locked from {int(np.argmax(locked)) / dwells.FRAME_HZ:.4g} s on")
        else:
            why = (
                f"{b.path}: the replayed firmware does not lock: registers, volts per code or the first frame are wrong"
            )
            lacking = lacking or why
    else:
        locked = dwells.drive_locked(b.streams)
        first = int(np.argmax(locked)) / dwells.FRAME_HZ
        lines.append(
            f"{b.path}: assumed: locked from {first:.4g} s on, where phase and amplitude of the drive are constant"
        )
    role = "validate" if b.is_validation else "fit"
    b.parts = dwells.find_segments(b.tracks, locked, lab_map.dwells, role)
    for p in b.parts:
        if p.kind == "dwell":
            t = b.tracks
            lines.append(
                f"{b.path}: dwell {p.id} {p.first / dwells.FRAME_HZ:.6g} .. {p.end / dwells.FRAME_HZ:.6g} s, {p.role}: "
                f"{t.rate_dps.value_at(p.first):g} deg/s from {t.rate_dps.value_at(p.first - 1):g}, "
                f"{t.temp_degc.value_at(p.first):g} degC, {t.a_um.value_at(p.first):.4g} um, "
                f"detuned {t.detune_deg.value_at(p.first):.4g} deg"
            )
    return lacking


def _outlook(record, lacking):
    """What can be done with a record, in words."""
    if not lacking:
        return ()
    missing = [name for name in firmware_words.TRACED if name not in record.streams]
    tracing_outlook = f"tracing needs {', '.join(missing)}" if missing else "tracing is possible"
    return (f"words are not replayed: {lacking}", f"R0 is not decidable; {tracing_outlook}")


def _table_column(values, unit):
    kinds = {"": str, "edge": np.int64}
    return TableColumn(np.array(values, kinds.get(unit)), unit)


def _table(name, rows):
    """A table of the schema from its rows."""
    units = schema.column_units(name)
    columns = zip(*rows) if rows else [()] * len(units)
    return {key: _table_column(values, unit) for (key, unit), values in zip(units.items(), columns)}


def _record_tables(lab_map, boards, starts):
    """Every table but the segments."""
    begun, order = [(b, FRAME_CYCLES * n) for b, n in zip(boards, starts)], schema.TABLES["priors"]
    return {
        "power_on": _table("power_on", [(a,) for b, a in begun if b.line.powered]),
        "registers": _table("registers", [(a + e, *_register(n), raw) for b, a in begun for e, n, raw in b.writes]),
        "gaps": _table("gaps", [row for b, a in begun for row in _gaps(b, a)]),
        "stimulus/rate": _table("stimulus/rate", [row for b, a in begun for row in _stimulus(b, a, "rate_dps")]),
        "stimulus/temperature": _table(
            "stimulus/temperature", [row for b, a in begun for row in _stimulus(b, a, "temp_degc")]
        ),
        "priors": _table("priors", [tuple(getattr(p, key) for key in order) for p in lab_map.prior]),
    }


def _register(name):
    """Name, address and format of a register, as the log states them; of another map the name alone."""
    if name not in registers.BY_NAME:
        return name, -1, 0, 0, 0
    entry = registers.BY_NAME[name]
    return name, entry.address, entry.fmt.width, entry.fmt.f, int(entry.fmt.s)


def _gaps(b, a):
    if b.line.powered:
        yield a, a + FRAME_CYCLES, "adc", UNSEEN
    for first, count in b.line.lost:
        yield a + FRAME_CYCLES * first, a + FRAME_CYCLES * (first + count), "all", "rows are missing"


def _stimulus(b, a, name):
    track = getattr(b.tracks, name)
    for frame, value in zip(track.frames, track.values):
        if frame < b.frames:
            edge = a + FRAME_CYCLES * frame
            more = (b.profile.rate_unc_ppm,) if name == "rate_dps" else ("stated", b.profile.temperature_unc_k)
            yield edge, value, *more


def _set(b, p):
    """What is set at the end of a part: amplitude, detuning, temperature, rate."""
    t, end = b.tracks, p.end - 1
    return tuple(one.value_at(end) for one in (t.a_um, t.detune_deg, t.temp_degc, t.rate_dps))


def _group(b, p, k, group_names, condition_keys):
    """Repeat group of a part: dwells of one condition in several files are repeats, named as the first of them."""
    if p.kind != "dwell":
        return f"{p.id}.{k}"
    key = (*_set(b, p), b.tracks.rate_dps.value_at(p.first - 1), p.role)
    # the same condition again in one power-on is no repeat: it shares the drive frequency with the first
    condition_keys.append(key)
    name = p.id if p.id not in group_names.values() else f"{p.id}.{k}"
    return group_names.setdefault((key, condition_keys.count(key)), name)


def _segment_table(boards, starts):
    rows, group_names = [], {}
    for k, (b, start) in enumerate(zip(boards, starts)):
        condition_keys = []
        for p in b.parts:
            at = FRAME_CYCLES * (start + p.first), FRAME_CYCLES * (start + p.end)
            group = p.group or _group(b, p, k, group_names, condition_keys)
            rows.append((f"{p.id}.{k}", *at, p.kind, "drv pll ftr qsc", *_set(b, p), group, p.role))
    return _table("segments", rows)
