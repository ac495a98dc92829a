"""R0: the firmware replayed on the recorded codes. Every recorded word and code must come out again, to the last bit.

    recorded codes + register log + power-on (or initial registers) --[replay]--> words, DAC codes
    recorded words, DAC codes ------------------------------------------------(=)--> 0 LSB, or the first that differs

A difference is the firmware's, its parameters' or the log's, never the physics'. Where an input was not recorded the
answer is "not decidable", and why.
Source    docs/measured.md
"""

import dataclasses
import itertools
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fpga_model import registers, watchdog
from fpga_model.design_record import DEFAULT
from fpga_model.rates import FRAME_CYCLES, FRAME_TICKS, TICK_CYCLES
from testbench import flatten
from testbench.engines.turn import Turn
from testbench.measured.record import check_tables, replay, schema
from testbench.measured.record.sessions import received_rows, sessions, stimulus
from testbench.run import build

BLOCK_FRAMES = 400_000
TICK_BLOCK_FRAMES = 4000
DAC_DELAY_TICKS = 3  # at most, from a modulator's code to the DAC
MORE_FRAMES = 8000  # behind a difference, in which a mistake undone must explain everything
UNDECIDED_TICKS = DAC_DELAY_TICKS  # whose codes were decided before the record begins
# In the order in which a window computes them, and the register that each is
REGISTERS = {
    "magnitude": "control.cordic.magnitude",
    "phase": "control.cordic.phase",
    "state": "control.sequencer.state",
    "lock": "control.sequencer.lock.locked",
    "flags": "control.sequencer.faults.flags",
    "agc_acc": "control.agc.loop.acc",
    "amplitude_word": "control.agc.loop.y",
    "pll_acc": "control.frequency_tracker.loop.acc",
    "nco_fword": "control.frequency_tracker.word",
    "ftr_acc": "control.rate_loop.loop.acc",
    "rate_word": "control.rate_loop.loop.y",
    "qsc_acc": "control.quadrature_loop.loop.acc",
    "quadrature_code": "control.quadrature_loop.root.y",
    "rate_output": "control.rate_output.y",
    "nco_pword": "dds.phase",
    "dac_drv": "drive_modulator.code",
    "dac_ftr": "sense_modulator.code",
    "dac_qsc": "quadrature_dac",
}
assert set(REGISTERS) == set(schema.REPLAYED), "every replayed stream has a register"


class First(NamedTuple):
    """The first value that differs: where, when, and both values."""

    stream: str
    register: str
    edge: int
    tick: int
    recorded: int
    replayed: int
    also: tuple  # other registers that differ at the same edge

    def __str__(self):
        also = f"; also {', '.join(self.also)}" if self.also else ""
        return (
            f"{self.register} at tick {self.tick} (edge {self.edge}): "
            f"recorded {self.recorded}, replayed {self.replayed}{also}"
        )


@dataclass
class Residual:
    """What a replay of a whole record found."""

    compared: tuple  # streams
    left_out: dict  # stream: why it could not be compared
    undecided: str  # why nothing could be decided, or ""
    frames: int
    differing: dict  # stream: rows that differ
    first: First | None
    seconds: float

    @property
    def decidable(self):
        return not self.undecided

    @property
    def verdict(self):
        """One line."""
        if not self.decidable:
            return f"R0 not decidable: {self.undecided}"
        if self.first is None:
            return f"R0 is 0 LSB in {self.frames} frames of {len(self.compared)} streams"
        return f"R0 differs: {self.first}"


def unreplayable(record, config):
    """Why the firmware cannot be replayed, or ""."""
    if not schema.has_supported_map(record):
        stated = record.attrs["regmap_sha256"][:16]
        return f"skipped, regmap_sha256 {stated} is not that of this version; it belongs to another firmware"
    if config.firmware.board != "analog_sid":
        return "firmware.board = digital_sid, and a record does not contain its samples"
    for session in sessions(record):
        if not session.powered and _initial(record) is None:
            return f"frame {session.first} is not a power-on, and /initial does not contain every register"
        _, lost = received_rows(record, session)
        if lost.any():
            row = int(np.flatnonzero(lost)[0]) + session.first
            return f"codes of frame {row} are lost in a gap"
    return ""


def initial_names():
    """Names of the registers that /initial must hold: control, register bank, watchdog, and the phase."""
    s = replay.power_on()
    return [
        *(f"control.{name}" for name in flatten.names(s.w.control)),
        *(f"registers.{name}" for name in registers.State._fields),
        *(f"watchdog.{name}" for name in watchdog.State._fields),
        "dds.phase",
    ]


def initial_values(side):
    """The values of `initial_names` at the clock where a replay is, between two windows."""
    phase = replay.phase(side)
    return [*(v for _, v in flatten.leaves(side.w.control)), *side.w.bank, *side.w.dog, phase]


def _initial(record):
    """`replay.Side` of the table /initial at the record's first edge, or None."""
    table = record.tables.get("initial")
    if table is None:
        return None
    have = dict(zip(table["name"].data.tolist(), table["raw"].data.tolist()))
    names = initial_names()
    if any(name not in have for name in names):
        return None
    return initial_side([have[name] for name in names])


def initial_side(row):
    """`replay.Side` at edge 0 from the values of `initial_names`."""
    s = replay.power_on()
    c = flatten.rebuild(s.w.control, row)
    remaining_values, count = row[len(flatten.names(c)) :], len(registers.State._fields)
    bank, dog = registers.State(*remaining_values[:count]), watchdog.State(*remaining_values[count:-1])
    word = c.frequency_tracker.word
    turn = Turn(0, remaining_values[-1], word, word, 0, word, DEFAULT.dds_bits)
    return s._replace(w=s.w._replace(control=c, bank=bank, dog=dog, turn=turn))


def residual(record, progress=None, firmware=None):
    """`Residual` of a checked record.

    firmware  parameters of the FPGA instead of those of the record's configuration
    """
    began = time.perf_counter()
    config = check_tables.stated_config(record)
    streams = [name for name in REGISTERS if name in record.streams]
    why = unreplayable(record, config)
    if not why and "adc_ok" not in record.streams:
        why = "adc_ok is not recorded"
    if not why and not streams:
        why = "no word is recorded"
    skipped_streams = {}
    if "adc_temperature" not in record.streams and "rate_output" in streams:
        skipped_streams["rate_output"] = "adc_temperature is not recorded"
        streams.remove("rate_output")
    frames = schema.frame_count(record)
    out = Residual(tuple(streams), skipped_streams, why, frames, {}, None, 0.0)
    if why:
        return out
    p = firmware or build.firmware(config)
    ticked = [name for name in streams if record.streams[name].den == TICK_CYCLES]
    for session in sessions(record):
        _session(record, session, p, streams, ticked, out, progress)
    out.seconds = time.perf_counter() - began
    return out


def explanation(record, result):
    """What makes the firmware the model's again, if one mistake in the ADC streams does: two of them exchanged, one
    negated, one a row off; "" else. It is judged up to MORE_FRAMES behind the first difference.
    """
    if not result.decidable or result.first is None:
        return ""
    frame = result.first.edge // FRAME_CYCLES
    session = next(s for s in sessions(record) if s.first <= frame < s.first + s.frames)
    session = session._replace(frames=min(session.frames, frame - session.first + MORE_FRAMES))
    p = build.firmware(check_tables.stated_config(record))
    for text, changed in _mistakes({name: record.streams[name].data for name in schema.ADC}):
        streams = {name: record.streams[name]._replace(data=data) for name, data in changed.items()}
        other = dataclasses.replace(record, streams=record.streams | streams)
        out = Residual(result.compared, {}, "", 0, {}, None, 0.0)
        frames = [name for name in result.compared if record.streams[name].den == FRAME_CYCLES]
        _session(other, session, p, frames, [], out, None)
        if out.first is None:
            return text
    return ""


def _mistakes(codes):
    """(words, {stream: codes}) of each mistake undone."""
    for a, b in itertools.combinations(codes, 2):
        yield f"{a} and {b} exchanged", {a: codes[b], b: codes[a]}
    for name, data in codes.items():
        yield f"{name} negated", {name: -data}
        for rows in (1, -1):
            yield f"{name} shifted by {rows:+d} row", {name: np.roll(data, -rows)}


def _session(record, session, p, streams, ticked, out, progress):
    """Replay one session block by block and compare; adds to `out`."""
    for start_frame, n, o in replay_blocks(record, session, p, bool(ticked)):
        _compare_block(record, session, start_frame, n, o, streams, ticked, out)
        if progress:
            progress("firmware replay", session.first + start_frame + n, out.frames)


def replay_blocks(record, session, p, ticked=False):
    """Yield (frames before, frames, `replay.Rows`) of a session, block by block; with DAC codes of ticks if asked."""
    x, order = stimulus(record, session), replay.order(p)
    s = replay.power_on() if session.powered else _initial(record)
    pending_codes = np.zeros((DAC_DELAY_TICKS, 2), np.int64)
    last = np.zeros(len(replay.WORDS), np.int64)
    start_frame, most = 0, TICK_BLOCK_FRAMES if ticked else BLOCK_FRAMES
    while start_frame < session.frames:
        n = min(most, session.frames - start_frame)
        o = replay.rows(n, ticks=FRAME_TICKS * n + DAC_DELAY_TICKS if ticked else 0)
        # codes decided at the end of a block belong to the first rows of the next one
        o.words[0] = last
        if ticked:
            o.codes[:DAC_DELAY_TICKS] = pending_codes
        s = replay.run(p, s, x, o, order, True)
        last = o.words[-1].copy()
        if ticked:
            pending_codes = o.codes[-DAC_DELAY_TICKS:].copy()
        yield start_frame, n, o
        start_frame += n


def _compare_block(record, session, start_frame, n, o, streams, ticked, out):
    first = session.first + start_frame
    first_differences = []
    for name in streams:
        if name in ticked:
            have = record.streams[name].data[FRAME_TICKS * first : FRAME_TICKS * (first + n)]
            predicted_values, cycles = o.codes[: FRAME_TICKS * n, 0 if name == "dac_drv" else 1], TICK_CYCLES
        else:
            have, cycles = record.streams[name].data[first : first + n], FRAME_CYCLES
            predicted_values = o.words[:n, replay.WORDS.index(schema.REPLAYED[name])]
        wrong = have != predicted_values
        if name in schema.DAC and start_frame == 0:
            wrong[: UNDECIDED_TICKS if name in ticked and not session.powered else int(name not in ticked)] = False
        count = int(wrong.sum())
        if count:
            out.differing[name] = out.differing.get(name, 0) + count
            row = int(np.flatnonzero(wrong)[0])
            edge = FRAME_CYCLES * first + cycles * row + (TICK_CYCLES if cycles == TICK_CYCLES else 0)
            first_differences.append((edge, name, int(have[row]), int(predicted_values[row])))
    if first_differences and out.first is None:
        edge = min(item[0] for item in first_differences)
        (_, name, recorded, replayed), *simultaneous_differences = [
            item for item in first_differences if item[0] == edge
        ]
        also = tuple(REGISTERS[item[1]] for item in simultaneous_differences)
        out.first = First(name, REGISTERS[name], edge, edge // TICK_CYCLES, recorded, replayed, also)
