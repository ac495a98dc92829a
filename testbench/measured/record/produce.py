"""A measurement record from the simulated board: every condition of a plan, as often as it says, each from power-on.

    sitting    power-on with noise of its own, register writes, lock, `settle_s`, a dwell of `seconds`, and what a
               counter would read at its end
    record     raw codes and words, register log, stimuli, segments with roles; nothing of the plant's truth

Source    docs/measured.md
"""

import math

import numpy as np

from fpga_model import agc, registers, sequencer
from fpga_model.control import SLOT_PI
from fpga_model.rates import FRAME_CYCLES, FRAME_TICKS, TICK_CYCLES, TICK_HZ
from testbench.config import phase_word, to_toml
from testbench.engines.window import SLOT_WORD
from testbench.errors import ConfigError
from testbench.measured.record import schema, timing
from testbench.measured.record.recording_plan import RAMP_FRAMES
from testbench.measured.record.sessions import UNSEEN
from testbench.port import plant_loader
from testbench.port.plant import reads
from testbench.run import build, design_check, simulate
from testbench.run.simulation import Simulation
from testbench.storage.record import Column, Record, TableColumn
from testbench.version import VERSION

DEG = math.pi / 180
TURN = 1 << 48
RATE_UNC_PPM, TEMP_UNC_K = 50.0, 0.1


class Board(Simulation):
    """A simulated board whose writes are logged and whose phase accumulator is known at every frame."""

    def __init__(self, config, lo_degc, hi_degc, ticked):
        design_check.default_only(config, "a measurement record")
        super().__init__(config, lo_degc, hi_degc)
        self.log, self.codes, self.ticked = [], [], ticked
        self.valid_clock = timing.valid_clock(config, self.foreign.first_drdy if self.foreign else None)
        self._anchors = []

    def write(self, name, raw):
        self.log.append((TICK_CYCLES * self.tick, name, int(raw)))
        super().write(name, raw)

    def commit_chunk(self, state, streams, inside=False):
        if self.ticked:
            self.codes.append((streams.drive_code, streams.sense_code))
        super().commit_chunk(state, streams, inside)
        frame, tick = divmod(state.tick, FRAME_TICKS)
        if TICK_CYCLES * tick < self.valid_clock:
            self._anchors.append((frame, TICK_CYCLES * tick, state.fpga.dds.phase))

    def phase_rows(self):
        """Phase accumulator before each frame's first edge, from the words and the clocks at which they change.

        RuntimeError if that is not the firmware's own at the ends of chunks; ConfigError for a plant behind the port.
        """
        columns = self.columns()
        word, state = columns["frequency_word"], columns["state"]
        # while the centre is loaded or corrected the word follows at once, else two clocks later, behind the PI
        is_immediate = state[1:] < sequencer.ACQUIRE
        at = self.valid_clock + 1 + np.where(is_immediate, SLOT_PI, SLOT_WORD)
        at[0] = FRAME_CYCLES  # no codes in the first frame
        steps = at * word[:-1] + (FRAME_CYCLES - at) * word[1:]
        rows = np.concatenate([[0], np.cumsum(steps)]) % TURN
        for frame, clocks, phase in self._anchors:
            if frame < len(rows) and (int(rows[frame]) + clocks * int(word[frame]) - phase) % TURN:
                if self.foreign:
                    raise ConfigError(
                        f"scenario.plant: DRDY of frame {frame} or an earlier one comes at another clock of its frame"
                    )
                raise RuntimeError(f"phase accumulator: the rows up to frame {frame} do not lead to the firmware's")
        return rows


def _ticks(seconds):
    """Whole frames, in ticks."""
    return max(1, round(seconds * TICK_HZ / FRAME_TICKS)) * FRAME_TICKS


class Sitting:
    """One power-on of the board: a condition in one of its sittings."""

    def __init__(self, plan, condition, repeat, number):
        self.plan, self.condition, self.repeat = plan, condition, repeat
        seed = plan.seed + number
        shift = plan.fx_scatter_hz * np.random.default_rng([9, seed]).normal()
        plant_update = {"fx_hz": plan.truth.plant.fx_hz + shift} if shift else {}
        noise = plan.truth.noise.model_copy(update={"seed": seed})
        plant = plan.truth.plant.model_copy(update=plant_update)
        self.config = plan.truth.model_copy(update={"noise": noise, "plant": plant})
        _, temps = condition.profile(_ticks(condition.seconds) // FRAME_TICKS)
        lo, hi = (f(condition.temperature_degc, *temps[[0, -1]]) for f in (min, max))
        self.board = Board(self.config, lo, hi, plan.dac == "tick")
        self.board.first_writes = self._first_writes()
        self.segments, self.rates, self.temps, self.counters = [], [], [], []
        self._run()

    def _first_writes(self):
        """Those of the configuration, with what the condition sets in their place."""
        c, nominal = self.condition, build.nominal(self.plan.model)
        register_writes = dict(build.register_writes(self.plan.model))
        register_writes["amplitude_setpoint"] = agc.setpoint(c.a_um, nominal["v_per_um"], nominal["adc_drive_v"])
        if c.detune_deg:
            nominal_phase_word = self.plan.model.firmware.phase_words()[0]
            register_writes["phase_drive_sine"] = (phase_word(c.detune_deg) + nominal_phase_word) % TURN
        return tuple(register_writes.items())

    def _run(self):
        c, board, temp = self.condition, self.board, self.condition.temperature_degc
        first = c if c.from_dps is None else c._replace(rate_dps=c.from_dps)  # until the dwell begins
        before = first.rate_dps * DEG
        where = f"condition {c.id}, repeat {self.repeat}"
        self._stimulus(before, temp)
        if simulate.start(self.config, board, before, temp) is None:
            raise ConfigError(f"{where}: the gyroscope does not lock within {simulate.lock_limit_s(self.config):g} s")
        ticks_to_frame = -board.tick % FRAME_TICKS
        if ticks_to_frame:
            board.advance(ticks_to_frame, before, temp)
        self._add_segment("startup", 0, first, "startup", "none")
        if c.settle_s:
            begin = board.tick
            board.advance(_ticks(c.settle_s), before, temp)
            self._add_segment("settle", begin, first, "settle", "none")
        begin = board.tick
        probe = min(_ticks(c.counter_s), _ticks(c.seconds)) if c.counter_s else 0
        rate, temp = self._dwell(_ticks(c.seconds) - probe, before)
        if probe:
            self._count(probe, rate, temp)
        if not board.locked:
            raise ConfigError(f"{where}: the gyroscope loses lock")
        self._add_segment("", begin, c, "sweep" if c.is_ramped else c.kind, c.role)
        self.frames = board.tick // FRAME_TICKS
        # one tick of the next frame: its row holds the last codes
        board.advance(1, rate, temp)
        self.phases = board.phase_rows()[: self.frames]

    def _dwell(self, ticks, before):
        """Rate and temperature at the end of a dwell of some ticks, constant or in the steps of its ramps."""
        rates, temps = self.condition.profile(max(ticks // FRAME_TICKS, 1))
        step = RAMP_FRAMES if self.condition.is_ramped else len(rates)
        for first in range(0, len(rates), step):
            rate, temp = float(rates[first]) * DEG, float(temps[first])
            if rate != before or self.condition.is_ramped:
                self._stimulus(rate, temp)
            before = rate
            if ticks:
                self.board.advance(min(step, len(rates) - first) * FRAME_TICKS, rate, temp)
        return rate, temp

    def _stimulus(self, rate_rad_s, temp_degc):
        edge = TICK_CYCLES * self.board.tick
        self.rates.append((edge, rate_rad_s / DEG))
        self.temps.append((edge, temp_degc))

    def _add_segment(self, part, begin, c, kind, role):
        edges = (TICK_CYCLES * begin, TICK_CYCLES * self.board.tick)
        group = f"{c.id}.{part}" if part else c.id
        self.segments.append((f"{group}.{self.repeat}", *edges, kind, c, group, role))

    def _count(self, ticks, rate, temp):
        """What a counter reads: phases of both force voltages against the reference pins, and the drive frequency."""
        edge = TICK_CYCLES * self.board.tick
        readings = self.board.probe(ticks, rate, temp)
        for node, pair in (("xe1", "Vxm_vs_sgnsin"), ("ye1", "Vym_vs_sgnsin")):
            unc = readings.counter_resolution_deg[node]
            if math.isfinite(unc) and 0 < unc < 5.0:
                self.counters.append((pair, edge, readings.counter_deg[node], ticks / TICK_HZ, unc))
        word = self.board.state.fpga.control.frequency_tracker.word
        hz = build.clock_hz(self.plan.truth) * word / 2**48
        self.counters.append(("f_drive", edge, hz, ticks / TICK_HZ, 1e-6 * hz))


def record(plan, progress=None):
    """`testbench.storage.record.Record` of a plan; ConfigError if a repeat does not lock."""
    if plan.truth.firmware.board != "analog_sid":
        raise ConfigError(f'firmware.board = "{plan.truth.firmware.board}": records need "analog_sid"')
    foreign = plan.truth.scenario.plant
    if foreign:
        _check_foreign(plan, plant_loader.open_library(foreign).keys)
    sittings, schedule = [], [(c, r) for r in range(plan.repeats) for c in plan.conditions]
    for number, (condition, repeat) in enumerate(schedule):
        sittings.append(Sitting(plan, condition, repeat, number))
        first, last = sittings[0].board, sittings[-1].board
        if first.valid_clock != last.valid_clock:
            where = f"DRDY comes at clock {last.valid_clock} of a frame, but at clock {first.valid_clock}"
            raise ConfigError(f"scenario.plant: {where} of another power-on; a record needs one clock for all")
        if progress:
            progress("recording", number + 1, len(schedule))
    starts = np.cumsum([0] + [r.frames for r in sittings]).tolist()
    out = Record(
        streams=_streams(plan, sittings),
        tables=_build_tables(plan, sittings, [FRAME_CYCLES * n for n in starts]),
        config_toml=to_toml(plan.model),
        provenance="sealed" if plan.hidden else "simulated",
        clock_ppm=plan.model.plant.clock_ppm,
    )
    out.attrs = {
        **plan.head,
        "plan": plan.name,
        "bitstream_sha256": schema.bitstream_sha256(build.firmware(plan.model)),
        "firmware_version": VERSION,
        "regmap_sha256": schema.regmap_sha256(),
        "roles_sha256": schema.roles_sha256(out.tables["segments"]),
        "nuisances": ",".join(p.param for p in plan.priors),
    }
    if foreign:
        plant = sittings[0].board.foreign
        out.attrs |= {f"{key}_sha256": digest for key, digest in plant.identity.items()}
        out.attrs["plant_unseen"] = " ".join(plant.unseen)
    if plan.hidden:
        out.attrs["truth_sha256"] = schema.json_sha256(envelope(plan))
    return out


def _check_foreign(plan, keys):
    """ConfigError for what a record of a plant behind the port, which reads `keys`, cannot hold."""
    for c in plan.conditions:
        if c.counter_s:
            raise ConfigError(
                f"condition {c.id}: counter_s = {c.counter_s:g} s; a plant library has no counter, set it to 0"
            )
    for key in plan.hidden:
        if not reads(keys, key):
            raise ConfigError(f"[truth] {key}: the plant library does not read this key, so a record cannot hide it")


def envelope(plan):
    """What a sealed record must not hold: the plan's [truth], and the seed."""
    return {"truth": plan.hidden, "seed": plan.seed}


def _streams(plan, sittings):
    """Every stream, the sittings one behind the other."""
    lsb = schema.lsb_volts(plan.model.device())
    columns = [r.board.columns() for r in sittings]
    before = sittings[0].board.valid_clock
    values = {}
    for name, source in schema.CODE_OF.items():
        # a row holds the codes that arrived in the frame before it
        values[name] = [c[source][1 : r.frames + 1] for r, c in zip(sittings, columns)]
    for name, source in schema.WORD_OF.items():
        values[name] = [c[source][: r.frames] for r, c in zip(sittings, columns)]
    values["adc_ok"] = [(np.arange(r.frames) > 0).astype(np.int64) for r in sittings]
    values["nco_pword"] = [r.phases for r in sittings]
    ticked = plan.dac == "tick"
    if ticked:
        for k, name in enumerate(schema.TICKED):
            pieces = [np.concatenate([codes[k] for codes in r.board.codes]) for r in sittings]
            values[name] = [p[: r.frames * FRAME_TICKS] for p, r in zip(pieces, sittings)]
    out = {}
    for name, pieces in values.items():
        stream = schema.STREAMS[name]
        num, den = schema.PER_TICK if ticked and name in schema.TICKED else schema.PER_FRAME
        edge0 = before if name.startswith("adc_") else (TICK_CYCLES if den == TICK_CYCLES else 0)
        attrs = schema.attributes(name, stream.tap, lsb.get(name))
        data = np.concatenate(pieces).astype(schema.stream_dtype(name))
        out[name] = Column(data, stream.unit, num, den, edge0, attrs)
    return out


def _table(name, rows):
    """A table of the schema from its rows."""
    units = schema.column_units(name)
    columns = zip(*rows) if rows else [()] * len(units)
    kinds = {"": str, "edge": np.int64}
    return {
        key: TableColumn(np.array(values, kinds.get(unit)), unit) for (key, unit), values in zip(units.items(), columns)
    }


def _build_tables(plan, sittings, starts):
    """Every table; the edges of a sitting count from where it starts in the record."""
    begun = list(zip(sittings, starts))
    rows = {
        "power_on": [(a,) for _, a in begun],
        "registers": [(a + edge, *_register(name), raw) for r, a in begun for edge, name, raw in r.board.log],
        "segments": [
            (name, a + begin, a + end, kind, "drv pll ftr qsc")
            + (c.a_um, c.detune_deg, c.temperature_degc, c.rate_dps, group, role)
            for r, a in begun
            for name, begin, end, kind, c, group, role in r.segments
        ],
        "gaps": [(a, a + FRAME_CYCLES, "adc", UNSEEN) for _, a in begun],
        "stimulus/rate": [(a + edge, float(v), RATE_UNC_PPM) for r, a in begun for edge, v in r.rates],
        "stimulus/temperature": [(a + edge, float(v), "ambient", TEMP_UNC_K) for r, a in begun for edge, v in r.temps],
        "priors": [
            (p.param, p.dist, float(p.mean), float(p.sd), p.unit, p.source, p.correlation_group) for p in plan.priors
        ],
    }
    for pair in schema.COUNTER_PAIRS:
        read = [(a + edge, *values) for r, a in begun for its, edge, *values in r.counters if its == pair]
        if read:
            rows[f"counter/{pair}"] = read
    return {name: _table(name, table_rows) for name, table_rows in rows.items()}


def _register(name):
    """Name, address and format of a register, as the log states them."""
    entry = registers.BY_NAME[name]
    return name, entry.address, entry.fmt.width, entry.fmt.f, int(entry.fmt.s)
