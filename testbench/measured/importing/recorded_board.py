"""One file of a laboratory as one power-on of a board: codes of every frame, registers, conditions, segments.

    columns --[codes]--> integers --[time_line]--> frames --[replay]--> words --[dwells]--> segments

Source    docs/import.md
"""

from dataclasses import dataclass, field

import numpy as np

from fpga_model import agc, cordic, registers
from fpga_model.rates import FRAME_CYCLES, MASTER_HZ, TICK_CYCLES
from testbench.config import phase_word
from testbench.errors import ConfigError, FileError
from testbench.measured.formats import table
from testbench.measured.importing import codes, dwells, time_line
from testbench.measured.record import schema
from testbench.run import build

TURN = 1 << 48


@dataclass
class Board:
    """What a file says of its power-on."""

    path: object
    line: time_line.Line
    frames: int
    streams: dict  # {stream: (frames,) int64}; rows that are missing hold the one before
    lsb_v: dict  # {stream: (V per code, its uncertainty or None)}
    raw: bool  # all channels are the converter's own codes
    writes: list  # (edge, name, raw)
    tracks: dwells.Tracks
    profile: object
    is_validation: bool
    parts: list = field(default_factory=list)
    words: list = field(default_factory=list)  # what was found and assumed


def import_board(path, lab_map, k, config):
    """`Board` of file k with a `record_map.Map` and the configuration of the model."""
    table_columns = table.read_table(path)
    names = {name: stream.column for name, stream in lab_map.columns.items()}
    time = lab_map.time
    numbers = table.numeric_columns(
        path, table_columns, [*dict.fromkeys([*names.values(), *([time.column] if time else [])])]
    )
    model, stream_codes, words, lsb_v = schema.lsb_volts(config.device()), {}, [], {}
    for name, stream in lab_map.columns.items():
        stream_codes[name] = one = codes.codes(path, name, stream, numbers[stream.column], model.get(name))
        words.append(f"{name}: column {stream.column!r} in {stream.unit}, {one.text}")
        if one.lsb_v is not None:
            lsb_v[name] = (one.lsb_v, stream.lsb_V_unc)
            assumed = f"assumed: {name} has the model's {one.lsb_v:.7g} V per code"
            words += [assumed] if one.assumed else []
    values = {name: one.values for name, one in stream_codes.items()}
    line = time_line.line(path, numbers[time.column] if time else None, time, values)
    if len(line.rows) < 2:
        raise FileError(f"{path}: {len(line.rows)} rows after the power-on, expected at least two")
    profile, writes, heldout = lab_map.file_settings(k)
    log, tracks = _registers(lab_map, profile, writes, config)
    tracks = dwells.Tracks(*(t.shift_origin(line.begin) for t in tracks))
    log = [(max(0, edge - FRAME_CYCLES * line.begin), name, raw) for edge, name, raw in log]
    raw = all(stream_codes[name].raw for name in schema.ADC)
    frames = int(line.frames[-1]) + line.decimated
    streams = _dense(line, frames, values)
    out = Board(path, line, frames, streams, lsb_v, raw, log, tracks, profile, heldout, words=[*words, *line.words])
    if line.lost and line.powered:
        _cut(out)
    return out


def _dense(line, frames, values):
    """{stream: (frames,)}: a row holds until the next; before the first row codes are 0."""
    at = np.searchsorted(line.frames, np.arange(frames), side="right") - 1
    return {name: np.where(at >= 0, v[line.rows][np.maximum(at, 0)], 0) for name, v in values.items()}


def _cut(b):
    """A lost code is lost for every later word: what is behind the first lost row is left out."""
    end = b.line.lost[0][0]
    b.words.append(
        f"left out: all rows from frame {end} on; no word can be replayed after the first lost row; split the file"
    )
    b.frames, b.streams = end, {name: v[:end] for name, v in b.streams.items()}
    b.line = b.line._replace(lost=())


def _registers(lab_map, profile, writes, config):
    """([(edge, name, raw)], `dwells.Tracks`): the configuration's writes at power-on, then those of the map."""
    nominal = build.nominal(config)
    log = [(TICK_CYCLES * k, name, raw) for k, (name, raw) in enumerate(build.register_writes(config))]
    model_phase = config.firmware.phase_words()[0]
    a_um, detune = [(0.0, config.firmware.amplitude_um)], [(0.0, 0.0)]
    per_um = nominal["v_per_um"] / nominal["adc_drive_v"] * 2**23 * float(cordic.gain())
    for one in sorted(writes, key=lambda w: w.at_s):
        edge = round(one.at_s * MASTER_HZ / TICK_CYCLES) * TICK_CYCLES
        name, raw = one.name, one.raw
        if one.a_um is not None:
            name, raw = "amplitude_setpoint", agc.setpoint(one.a_um, nominal["v_per_um"], nominal["adc_drive_v"])
        elif one.detune_deg is not None:
            name, raw = "phase_drive_sine", (phase_word(one.detune_deg) + model_phase) % TURN
        if not lab_map.regmap_sha256 and (name not in registers.BY_NAME or registers.BY_NAME[name].access == "ro"):
            raise ConfigError(f"write at {one.at_s:g} s: {name} is not a writable register")
        if not lab_map.regmap_sha256 and not registers.BY_NAME[name].fmt.holds(raw):
            fmt = registers.BY_NAME[name].fmt
            raise ConfigError(f"write at {one.at_s:g} s: {name} = {raw} is outside {fmt.lo} .. {fmt.hi}")
        if name == "amplitude_setpoint":
            a_um.append((one.at_s, one.a_um or raw / per_um))
        elif name == "phase_drive_sine":
            angle = one.detune_deg
            detune.append((one.at_s, (((raw - model_phase) / TURN + 0.5) % 1 - 0.5) * 360 if angle is None else angle))
        log.append((edge, name, raw))
    tracks = dwells.Tracks(
        dwells.track(profile.rate_dps, profile.rate_shape == "linear"),
        dwells.track(profile.temperature_degc, profile.temperature_shape == "linear"),
        dwells.track(a_um),
        dwells.track(detune),
    )
    return sorted(log, key=lambda row: row[0]), tracks
