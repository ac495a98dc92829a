"""What an analysis asks of an engine: a session again, driven by its words or free from its set-points.

    driven_codes   recorded words -> plant -> ADC codes (open loop)
    free           register log, rate, temperature -> whole loop -> every stream

`FrameSimulator` answers with the bits of the frame engine; another engine answers with the same two methods.
`BasebandSimulator` lives the closed loop in the averaged plant, and is the frame engine where words drive the plant.
Source    docs/measured.md
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from fpga_model import registers, sequencer
from fpga_model.rates import FRAME_CYCLES, FRAME_TICKS, TICK_CYCLES
from testbench.errors import ConfigError
from testbench.measured.record import replay, schema
from testbench.measured.record.sessions import stimulus, writes
from testbench.measured.residual import plant_replay
from testbench.run import build, design_check
from testbench.run.simulation import Simulation

DEG = math.pi / 180
SETTLED_EDGES = 26_000_000 // 4  # phase words may be set before the drive is switched on
DRIVING = ("nco_fword", "nco_pword", "amplitude_word", "rate_word", "quadrature_code")
PHASE_WORDS = ("phase_drive_sine", "phase_sense_sine", "phase_drive_ref", "phase_sense_ref")


class Task(NamedTuple):
    """A session as its board was told it: nothing that the board answered."""

    frames: int
    rate_rad_s: np.ndarray  # (frames,)
    temp_degc: np.ndarray  # (frames,)
    writes: np.ndarray  # (n, 3) edge, address, data


class Simulator(Protocol):
    """An engine that can live a session again."""

    name: str

    def driven_codes(self, config, drive):
        """(frames, 5) ADC codes of a plant that is driven by `plant_replay.Drive`."""

    def free(self, config, task):
        """{stream: (frames,)} of the closed loop, named as in a record."""


def quiet(config):
    """The same configuration without noise: a prediction is a mean."""
    off = {key: False for key in type(config.noise).model_fields if key != "seed"}
    return config.model_copy(update={"noise": config.noise.model_copy(update=off)})


def reseed_noise(config, seed):
    """The same configuration with another draw of its noise."""
    return config.model_copy(update={"noise": config.noise.model_copy(update={"seed": seed})})


def task(record, session):
    """`Task` of a session of a record."""
    return Task(
        session.frames,
        _stimulus_by_frame(record, "stimulus/rate", "rate", session) * DEG,
        _stimulus_by_frame(record, "stimulus/temperature", "temperature", session),
        writes(record, session),
    )


def _stimulus_by_frame(record, table, key, session):
    """Values of a stimulus per frame, held from the frame in which they are stated."""
    edges, values = record.tables[table]["edge"].data, record.tables[table][key].data
    frame = np.arange(session.first, session.first + session.frames)
    row = np.searchsorted(edges // FRAME_CYCLES, frame, side="right") - 1
    return np.ascontiguousarray(values[np.clip(row, 0, None)], float)


def drive(record, session, firmware, replayed=True):
    """`plant_replay.Drive` of a session.

    firmware  parameters of the FPGA
    replayed  the words are those of the firmware on the recorded codes, to the clock; else the recorded ones, whose
              clock within the window is taken for that of a sound firmware
    """
    job = task(record, session)
    if not session.powered:
        raise ConfigError(f"plant replay: no power-on at frame {session.first}, so the state of the plant is unknown")
    for edge, address, _ in job.writes:
        name = registers.BY_ADDRESS[address].name
        if name in PHASE_WORDS and edge > SETTLED_EDGES:
            raise ConfigError(
                f"plant replay: {name} is written at edge {edge}, the latest edge allowed is {SETTLED_EDGES}"
            )
    x = stimulus(record, session)
    if replayed:
        o = replay.rows(session.frames, driven=True)
        end = replay.run(firmware, replay.power_on(), x, o, replay.order(firmware), True)
        bank, table, phase = end.w.bank, o.driven, o.words[: session.frames, replay.WORDS.index("nco_phase")]
    else:
        bank = _bank(job.writes)
        table = _from_words(record, session, firmware)
        phase = record.streams["nco_pword"].data[session.rows].astype(np.int64)
    c = replay.power_on().w.control
    before = np.array([-1, c.frequency_tracker.word, c.frequency_tracker.word, 0, 0, 0, 0], np.int64)
    return plant_replay.Drive(bank, before, table, np.ascontiguousarray(phase), job.rate_rad_s, job.temp_degc)


def _bank(log):
    """The register bank after a log of writes."""
    values = registers.State()._asdict()
    for _, address, data in log:
        entry = registers.BY_ADDRESS[address]
        values[entry.name] = registers.from_bus(int(data), entry.fmt)
    return registers.State(**values)


def _from_words(record, session, firmware):
    """What the windows left, from the recorded words alone: a row shows what the window before it has done."""
    # another firmware's states are not known: its words are taken as those that act
    has_supported_map = schema.has_supported_map(record)
    for name in (*DRIVING, "state")[: len(DRIVING) + has_supported_map]:
        if name not in record.streams:
            raise ConfigError(f"plant replay: {name} is not recorded, and no replay of the firmware can compute it")
    column = {name: record.streams[name].data[session.rows].astype(np.int64) for name in record.streams}
    later = {name: np.append(values[1:], values[-1]) for name, values in column.items() if len(values)}
    state = later["state"] if has_supported_map else np.full(session.frames, sequencer.LOCKED)
    kick, kicked = state == sequencer.KICK, firmware.control.agc.kick
    amplitude = np.where(kick, kicked, later["amplitude_word"])
    halfway = np.where(kick, kicked, column["amplitude_word"])
    edge0 = record.streams["adc_xI"].edge0
    valid = edge0 + FRAME_CYCLES * np.arange(session.frames, dtype=np.int64)
    valid[0] = -1
    word = later["nco_fword"]
    # while the centre is loaded or corrected the word follows at once, else two clocks later, behind the PI
    word_mid = np.where(state < sequencer.ACQUIRE, word, column["nco_fword"])
    rows = (valid, word_mid, word, halfway, amplitude, later["rate_word"], later["quadrature_code"])
    return np.ascontiguousarray(np.stack(rows, axis=1))


class FrameSimulator:
    """The frame engine: exact, and about twenty times real time."""

    name = "frame"

    def __init__(self):
        self._built = {}

    def _params(self, config, lo_degc, hi_degc):
        """Parameters of a model; those of the last one are kept, at each of its temperatures."""
        text = config.model_dump_json()
        if text not in self._built:
            self._built = {text: {}}
        params_by_temperature = self._built[text]
        if (lo_degc, hi_degc) not in params_by_temperature:
            params_by_temperature[lo_degc, hi_degc] = build.params(config, lo_degc, hi_degc)
        return params_by_temperature[lo_degc, hi_degc]

    def driven_codes(self, config, drive):
        temps = drive.temp_degc
        params = self._params(config, float(temps.min()), float(temps.max()))
        return plant_replay.run(params, drive, float(temps.min()))

    def free(self, config, task):
        design_check.default_only(config, "a measurement record")
        sim = Simulation(config, float(task.temp_degc.min()), float(task.temp_degc.max()), engine=self.name)
        sim.now = (task.rate_rad_s[:1], task.temp_degc[:1])
        for edge, address, data in task.writes.tolist():
            if edge % TICK_CYCLES:
                raise ConfigError(f"free run: a register is written at edge {edge}, not at the first edge of a tick")
            self._to(sim, task, edge // TICK_CYCLES)
            entry = registers.BY_ADDRESS[address]
            sim.write(entry.name, registers.from_bus(data, entry.fmt))
        self._to(sim, task, FRAME_TICKS * task.frames + 1)
        columns = sim.columns()
        return streams(columns, task.frames)

    @staticmethod
    def _to(sim, task, tick):
        if tick > sim.tick:
            first = sim.tick // FRAME_TICKS
            rate, temp = task.rate_rad_s[first:], task.temp_degc[first:]
            sim.advance(tick - sim.tick, *(v if len(v) else last[-1:] for v, last in zip((rate, temp), task[1:3])))


class BasebandSimulator(FrameSimulator):
    """Closed loops by the baseband engine, within its tolerances (docs/plant.md); raises its ConfigErrors."""

    name = "baseband"


def streams(columns, frames):
    """Columns of an engine as streams of a record: a row of codes holds those that arrive in its frame."""
    out = {name: columns[source][1 : frames + 1] for name, source in schema.CODE_OF.items()}
    return out | {name: columns[source][:frames] for name, source in schema.WORD_OF.items()}
