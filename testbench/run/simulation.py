"""A gyroscope in time: its state, and the streams of everything that happens to it.

    engine     frame or clocked: the same bits, the same State; which one is only a matter of speed
               baseband: the same State and rows, within stated tolerances; no codes of single ticks
    sinks      objects with `add(first_frame, frames, truth)`: what a long run does with its rows at once
    columns    all rows stay in memory besides (`keep_rows`), for runs of seconds from Python
    codes      of every tick, for their hash and the spectra; without `keep_codes` there are rows of 8 kHz only

Advances in chunks, which do not matter to any result (baseband: within its tolerances); saves and restores exactly.
Source    docs/architecture.md
"""

import hashlib
import json
import math
import time
from collections import deque

import numpy as np

from analog_frontend import ring_saturation
from analog_frontend.parts import thermal
from fpga_model import bound, fixed, registers, sequencer
from fpga_model import top as fpga
from testbench import flatten, interrupts
from testbench.arguments import integer, name_of_file, number, series
from testbench.config import TEMPS_DEGC, from_dict, host_frames, placeless, require_config, scenario, to_toml
from testbench.engines import engine as clocked
from testbench.errors import ConfigError, FileError
from testbench.port.plant import Plant
from testbench.run import build, design_check, nodes, warmup
from testbench.storage import identity, state_file
from testbench.storage.code_hash import WORDS, CodeHash, frames_begun
from testbench.storage.inputs import parse_json, parse_toml, validate_data

DEG = math.pi / 180
CHUNK_TICKS = 100_000
BASEBAND_CHUNK_TICKS = 2_000_000  # its ends cost what some hundred frames cost; its rows stay in the cache
SPECTRUM_TICKS = 1 << 17
STATE_FORMAT = "engine-1"
# sections of the configuration in which a state and what continues it are one
STATE_SECTIONS = ("design", "firmware", "nominal", "plant")
MOST_TICKS = 1 << 48  # nine years
MOST_RATE_RAD_S = 10_000 * DEG  # ten times what a scenario takes; the plant's tables are of second order in the rate
ROUNDING_K = 1e-9  # of a profile's temperature beyond its points
ENGINES = ("frame", "clocked", "baseband")
# registers that version 0.1.0 did not have; a state without them continues with their reset values
ADDED = ("sid.last.0", "sid.last.1", "sid.still", "sid.ok")
SCRATCH = "work"  # field of the plant's state that holds nothing from one tick to the next
FRAME = {name: k for k, (name, _, _) in enumerate(clocked.FRAME_COLUMNS)}
TRUTH = {name: k for k, (name, _) in enumerate(clocked.TRUTH_COLUMNS)}


def runner(name):
    """`run` of the engine called `name`; an engine that is not used is not loaded."""
    if name not in ENGINES:
        raise ConfigError(f"engine = {name!r} is not one of {', '.join(ENGINES)}")
    if name == "clocked":
        return clocked.run
    if name == "baseband":
        from testbench.engines import baseband

        return baseband.run
    return warmup.frame_run()


class Simulation:
    """A state, and the streams of everything that happened to it.

    config                      `Config` of `config.load`
    temp_lo_degc, temp_hi_degc  range of ambient temperatures of the run; `advance` takes no other
    window                      (first tick, ticks) whose registers are kept in `rows`
    engine                      name of the engine instead of that of the configuration
    """

    def __init__(self, config, temp_lo_degc, temp_hi_degc, window=None, engine=None):
        self.config = require_config(config)
        temp_lo_degc = number("temp_lo_degc", temp_lo_degc, *TEMPS_DEGC, "degC")
        temp_hi_degc = number("temp_hi_degc", temp_hi_degc, temp_lo_degc, TEMPS_DEGC[1], "degC, from temp_lo_degc on")
        self.temps_degc = temp_lo_degc - ROUNDING_K, temp_hi_degc + ROUNDING_K
        foreign = {"digital_sid": "adc_", "analog_sid": "sample_"}[config.firmware.board]
        if any(fault[1].startswith(foreign) for fault in config.scenario.faults):
            board = {"adc_": "analog_sid", "sample_": "digital_sid"}[foreign]
            raise ConfigError(
                f'scenario.faults: {foreign}* faults need firmware.board = "{board}"; the other board has no such ADC'
            )
        self.engine = engine or config.scenario.engine
        self.design = config.design_record()
        self.heating = thermal.design(config.device(), self.design.frame_ticks / self.design.tick_hz)
        self.rise_k = 0.0
        temp_hi_degc += config.plant.self_heating_k
        design_check.check(config)
        if stale := bound.outdated_functions():
            raise RuntimeError(
                f"{stale[0]} was compiled before a function that it calls was replaced; start a new process"
            )
        try:
            self.params = build.params(config, temp_lo_degc, temp_hi_degc)
            self.first_writes = build.register_writes(config)
        except ValueError as problem:
            raise ConfigError(problem) from None
        if self.engine == "baseband":
            from testbench.engines import baseband

            baseband.prepare(self.params)
        self.foreign = Plant(config, self.engine) if config.scenario.plant else None
        if self.foreign:
            self.params = self.params._replace(plant=self.params.plant._replace(port=self.foreign.params))
        self.state = clocked.reset(self.params, temp_lo_degc)
        if self.foreign:
            self.foreign.power_on(self.params.plant, self.state.plant, config.noise.seed, temp_lo_degc)
        self.window = _parse_window(window)
        self.now = np.zeros(1), np.full(1, temp_lo_degc)  # rate and temperature of the last tick
        self.rows = None
        self.sinks = []
        self.keep_rows, self.keep_codes = True, True
        self.frames, self.truth = [], []
        self.hash = CodeHash(self.design.frame_ticks)
        self._tail, self._tail_ticks = deque(), 0
        self.faults = clocked.Faults()
        self.peak_x = 0.0
        self.seconds_spent = 0.0
        self.register_count = len(flatten.names(self.state.fpga))

    @property
    def engine(self):
        """Name of the engine."""
        return self._engine

    @engine.setter
    def engine(self, name):
        self._run = runner(name)
        self._engine = name

    @property
    def is_averaged(self):
        """True for the engine that knows no codes of single ticks."""
        return self.engine == "baseband"

    @property
    def chunk_ticks(self):
        """Longest chunk that is worth while for the engine."""
        return BASEBAND_CHUNK_TICKS if self.is_averaged else CHUNK_TICKS

    @property
    def tick(self):
        return self.state.tick

    def frame_index(self, tick):
        """The frame that a tick belongs to."""
        return tick // self.design.frame_ticks

    @property
    def locked(self):
        return self.state.fpga.control.sequencer.state == sequencer.LOCKED

    def write(self, name, raw):
        """Host write of a register at the next edge, which takes one tick; over the SPI pins those of its frame too.

        name  register of the map, such as "ftr_preset"
        raw   int within the register's format, in LSB
        """
        formats = scenario.writable_registers()
        if not isinstance(name, str) or name not in formats:
            raise ConfigError(f"write: {name!r} is not a writable register; {scenario.nearest(name, formats)}")
        raw, entry = integer(f"write: {name}", raw, formats[name].lo, formats[name].hi), registers.BY_NAME[name]
        address, data = entry.address, registers.to_bus(raw, entry.fmt)
        if self.config.scenario.host == "spi":
            spi_frame = host_frames.encode_write(self.design, entry, raw)
            address, data = spi_frame.address, spi_frame.data
            self.advance(spi_frame.ticks, *self.now)
        self._advance(1, *self.now, (1, address, data))

    def conditions(self, rate_rad_s, temp_degc):
        """Rates and temperatures as arrays; ConfigError beyond what this simulation was built for."""
        rate = series("rate_rad_s", rate_rad_s, -MOST_RATE_RAD_S, MOST_RATE_RAD_S, "rad/s")
        return rate, series("temp_degc", temp_degc, *self.temps_degc, "degC, which this Simulation was built for")

    def advance(self, ticks, rate_rad_s, temp_degc, probe_ticks=0, progress=None):
        """Run `ticks` ticks; returns the `Streams` of the last probe, or None.

        ticks        int, ticks of 1 us
        rate_rad_s   number, or array (frames begun,): one value for each 8 kHz frame
        temp_degc    ambient temperature, number or array (frames begun,)
        probe_ticks  the last ticks whose plant signals are kept for `read_out`
        """
        ticks = integer("ticks", ticks, 0, MOST_TICKS - self.tick, "ticks")
        probe_ticks = integer("probe_ticks", probe_ticks, 0, ticks, "ticks")
        rate, temp = self.conditions(rate_rad_s, temp_degc)
        elapsed_ticks, streams = 0, None
        while elapsed_ticks < ticks:
            step = ticks if probe_ticks else self._to_window(min(self.chunk_ticks, ticks - elapsed_ticks))
            first = self.frame_index(self.tick) - self.frame_index(self.tick - elapsed_ticks)
            streams = self._advance(
                step, rate[min(first, len(rate) - 1) :], temp[min(first, len(temp) - 1) :], probe_ticks=probe_ticks
            )
            elapsed_ticks += step
            if progress:
                progress(elapsed_ticks)
        return streams

    def _to_window(self, step):
        """Shorten a chunk so that the register window begins and ends with one."""
        if self.window:
            for border in (self.window[0], self.window[0] + self.window[1]):
                if self.tick < border < self.tick + step:
                    return border - self.tick
        return step

    @property
    def in_window(self):
        """True while the next tick belongs to the register window."""
        return bool(self.window) and self.window[0] <= self.tick < self.window[0] + self.window[1]

    def _advance(self, ticks, rate, temp, host=(0, 0, 0), probe_ticks=0):
        if probe_ticks and self.foreign:
            raise ConfigError(
                "scenario.plant: phases cannot be measured: the library gives no voltages of the plant's nodes"
            )
        rate, temp, streams = self.chunk(ticks, rate, temp, probe_ticks)
        started = time.perf_counter()
        with interrupts.defer_interrupts():
            state = self._run(self.params, self.state, ticks, rate, temp, host, self.faults, streams)
        self.seconds_spent += time.perf_counter() - started
        if self.foreign:
            self.foreign.finish(streams)
        self.commit_chunk(state, streams, self.in_window and not probe_ticks)
        return streams

    def chunk(self, ticks, rate, temp, probe_ticks=0):
        """What an engine is told for the next `ticks`: rates (rad/s) and temperatures (degC) per frame, and Streams."""
        need = self.frame_index(ticks) + 2
        rate, temp = _pad_frame_values(rate, need), _pad_frame_values(temp, need)
        self.now = (rate[-1:], temp[-1:])
        inside = self.in_window and not probe_ticks
        streams = clocked.streams(
            ticks if self.keep_codes and not self.is_averaged else 0,
            frames_begun(self.tick, ticks, self.design.frame_ticks),
            self.design.tick_clocks * ticks if inside else 0,
            probe_ticks,
            self.register_count if inside else 0,
        )
        return rate, self._add_heating(temp, ticks), streams

    def commit_chunk(self, state, streams, inside=False):
        """An engine has come to `state` and filled `streams`; `inside` the register window."""
        tick, self.state = self.tick, state
        if self.keep_codes:
            words = streams.frames[:, :WORDS]
            self.hash.add(tick, state.tick - tick, streams.drive_code, streams.sense_code, words)
            self._keep_tail(streams.drive_code, streams.sense_code)
        if len(streams.frames):
            if self.keep_rows:
                self.frames.append(streams.frames)
                self.truth.append(streams.truth)
            for sink in self.sinks:
                sink.add(-self.frame_index(-tick), streams.frames, streams.truth)
        self.peak_x = max(self.peak_x, float(streams.peak_x[0]))
        if inside:
            rows = np.concatenate([streams.pins, streams.registers], axis=1)
            self.rows = rows if self.rows is None else np.concatenate([self.rows, rows])

    def _keep_tail(self, drive, sense):
        """Keep the arrays that hold the last codes; nothing is copied while a run advances."""
        self._tail.append((drive, sense))
        self._tail_ticks += len(drive)
        while self._tail_ticks - len(self._tail[0][0]) >= SPECTRUM_TICKS:
            self._tail_ticks -= len(self._tail.popleft()[0])

    @property
    def tail(self):
        """The last codes of drive and sense DAC, (2, SPECTRUM_TICKS) or fewer."""
        if not self._tail:
            return np.zeros((2, 0), np.int32)
        return np.stack([np.concatenate(pieces)[-SPECTRUM_TICKS:] for pieces in zip(*self._tail)])

    def _add_heating(self, temp_degc, ticks):
        """Ambient temperatures plus the rise by self-heating, one step for each frame begun in the chunk."""
        if not self.heating.final_k:
            return temp_degc
        begun = frames_begun(self.tick, ticks, self.design.frame_ticks)
        rises = thermal.rises(self.heating, self.rise_k, begun)
        self.rise_k = float(rises[-1])
        # a chunk's first row is of a frame that begins with it or has begun before
        rows = np.arange(len(temp_degc)) + (self.tick % self.design.frame_ticks == 0)
        return temp_degc + rises[np.minimum(rows, begun)]

    def codes_sha256(self):
        """Hash of every DAC code of every tick and every ADC code and word of every frame; chunks do not matter.

        Of the baseband engine "frames:" and the hash of codes and words of every frame.
        Raises ValueError if the codes are not kept.
        """
        if not self.keep_codes:
            raise ValueError("simulation: has no hash, because codes are not kept")
        return "frames:" * self.is_averaged + self.hash.hexdigest()

    def columns(self):
        """All frames so far as {name: array}, registers and truth together, if it keeps its rows."""
        frames = np.concatenate(self.frames) if self.frames else np.zeros((0, len(FRAME)), np.int64)
        truth = np.concatenate(self.truth) if self.truth else np.zeros((0, len(TRUTH)))
        out = {name: frames[:, k] for name, k in FRAME.items()}
        return out | {f"truth_{name}": truth[:, k] for name, k in TRUTH.items()}

    def probe(self, ticks, rate_rad_s, temp_degc):
        """Run `ticks` and read the phases of all nodes."""
        ticks = integer("ticks", ticks, 1, MOST_TICKS - self.tick, "ticks")
        streams = self.advance(ticks, rate_rad_s, temp_degc, probe_ticks=ticks)
        try:
            return nodes.read(self.read_out(streams, temp_degc))
        except ValueError as problem:
            raise ConfigError(f"probe of {ticks} ticks: {problem}") from None

    def read_out(self, streams, temp_degc):
        """`nodes.Probe` of a recorded segment."""
        device, tables = self.config.device(), self.params.plant.tables
        warm_degc = float(np.atleast_1d(temp_degc)[0])
        warm = thermal.device_at_temperature(device, warm_degc)
        tick_s = float(tables.tick_s[0])
        cycles = self.state.plant.cycles
        instants = [
            (float(c) * tick_s / self.design.tick_clocks + delay_s) % tick_s
            for c, delay_s in zip(cycles, (device.drive_dac_delay_s, device.sense_dac_delay_s))
        ]
        chains = [[getattr(warm, f"{name}_pole_{n}_s") for n in (1, 2, 3)] for name in ("drive", "sense")]
        floats = streams.probe_floats
        if self.params.plant.ring.on:
            floats = floats.copy()
            for channel, name in enumerate(("cv_x", "cv_y")):
                column = floats[:, clocked.PROBE_FLOATS.index(name)]
                column[:] = ring_saturation.saturated_output(self.params.plant.ring, warm_degc, channel, column)
        return nodes.Probe(
            streams.probe_ints,
            floats,
            streams.edges[: int(streams.edge_count[0])],
            tuple(chains),
            tuple(instants),
            tick_s,
            warm.fy_hz,
            -1 if self.state.fpga.control.rate_loop.loop.y < 0 else 1,
            self.design,
            grid_clocks=self.design.tick_clocks if self.config.firmware.reference_retimed else 1,
        )

    # ---- state files -------------------------------------------------------------------------------------------------

    def dump(self):
        """(values, format, meta) for `state_file.save_state`."""
        meta = {"config_toml": to_toml(placeless(self.config)), "identity": json.dumps(self.identity)}
        return self.state_values(), self.layout(), meta

    @property
    def identity(self):
        """Identity of the code that runs here, and of a foreign plant."""
        return identity.identity() | (self.foreign.identity if self.foreign else {})

    @property
    def saves(self):
        """True if its state can be kept: a foreign plant's may not."""
        return self.foreign is None or self.foreign.saves

    def state_values(self):
        """The state as numbers by name; copies, because the arrays of a state move on in place."""
        values = {"fpga": np.array([v for _, v in flatten.leaves(self.state.fpga)], np.int64)}
        values["chips"] = np.array([v for _, v in flatten.leaves(self.state.chips)], np.int64)
        values["tick"] = self.state.tick
        values["drdy_cycle"] = self.state.drdy_cycle
        values["rise_k"] = self.rise_k
        for name, item in _fields(self.state.plant):
            if hasattr(item, "_fields"):
                values |= {f"plant.{name}.{k}": np.copy(v) for k, v in item._asdict().items()}
            else:
                values[f"plant.{name}"] = np.copy(item)
        return values | (self.foreign.state() if self.foreign else {})

    def layout(self, excluded_registers=()):
        """Text that names the registers and arrays of a state, but for those in `excluded_registers`."""
        arrays = [f"{name}{np.shape(v)}" for part, item in _fields(self.state.plant) for name, v in _leaves(part, item)]
        register_names = [name for name in flatten.names(self.state.fpga) if name not in excluded_registers]
        text = " ".join(register_names + flatten.names(self.state.chips) + arrays)
        return f"{STATE_FORMAT} {hashlib.sha256(text.encode()).hexdigest()[:12]}"

    def layouts(self):
        """Layouts of the states that can be continued, this version's first."""
        return self.layout(), self.layout(ADDED)

    def _check_saved_config(self, path, meta):
        """A state continues the firmware and the plant that made it; only noise, effects and scenario may differ."""
        saved = parse_toml(str(meta.get("config_toml", "")), f"{path}: config_toml", FileError)
        saved = validate_data({key: saved.get(key, {}) for key in STATE_SECTIONS}, dict[str, dict], path)
        # what an earlier version did not have is at its default
        saved = from_dict(saved, f"{path}: config_toml")
        for section in STATE_SECTIONS:
            was, now = getattr(saved, section).model_dump(), getattr(self.config, section).model_dump()
            for key in sorted(key for key in now if was[key] != now[key]):
                what = f"{section}.{key} = {was[key]}"
                raise ConfigError(f"{path}: was saved with {what}; it cannot continue with {now[key]}")

    def restore(self, path):
        """Continue from a state file; RecordError if it is damaged or of another layout.

        Returns the identity of the code that saved it if it is another one's (`identity.check`), else None.
        """
        values, meta = state_file.load_state(name_of_file("path", path), *self.layouts())
        saved = parse_json(meta.get("identity", "{}"), path)
        other = identity.check(path, saved, self.identity, self.config.scenario.across_versions)
        values = self._with_added(values)
        state_file.check_shapes(path, values, self.state_values())
        self._check_saved_config(path, meta)
        register_formats = flatten.leaves(fixed.formats(fpga.State, self.design, self.state.fpga))
        for (name, fmt), value in zip(register_formats, values["fpga"].tolist(), strict=True):
            if not fmt.holds(value):
                raise FileError(f"{path}: register {name} = {value} is outside its format {fmt}")
        if not (0 <= values["tick"] < MOST_TICKS and -1 <= values["drdy_cycle"] < self.design.tick_clocks):
            raise FileError(f"{path}: tick {values['tick']} or drdy_cycle {values['drdy_cycle']} is outside its range")
        self.set_state(values)
        return other

    def _with_added(self, values):
        """A state with all registers of this version."""
        saved_registers = values["fpga"].tolist() if np.ndim(values.get("fpga", 0)) == 1 else []
        if len(saved_registers) + len(ADDED) != self.register_count:
            return values
        saved, reset = iter(saved_registers), flatten.leaves(fpga.reset(self.design))
        return values | {"fpga": np.array([v if name in ADDED else next(saved) for name, v in reset], np.int64)}

    def set_state(self, values):
        """Continue from what `state_values` gave."""
        if missing := sorted(set(self.state_values()) - set(values)):
            raise ConfigError(f"state: lacks {missing[0]}; state_values() returns a complete one")
        values = self._with_added(values)
        plant = {}
        for name, item in _fields(self.state.plant):
            if hasattr(item, "_fields"):
                plant[name] = type(item)(**{k: np.array(values[f"plant.{name}.{k}"]) for k in item._fields})
            else:
                plant[name] = np.array(values[f"plant.{name}"])
        if self.foreign:
            self.foreign.set_state(values)
        self.rise_k = float(values["rise_k"])
        self.state = clocked.State(
            flatten.rebuild(self.state.fpga, values["fpga"].tolist()),
            flatten.rebuild(self.state.chips, values["chips"].tolist()),
            self.state.plant._replace(**plant),
            int(values["tick"]),
            int(values["drdy_cycle"]),
        )

    # ---- checkpoints: the state, and what the streams have come to ---------------------------------------------------

    def dump_all(self):
        """Numbers by name: everything but the register window and what the sinks keep."""
        values = self.state_values() | {f"hash.{name}": value for name, value in self.hash.dump().items()}
        drive, sense = self.tail
        rate, temp = self.now
        return (
            values
            | {"tail.drive": drive, "tail.sense": sense, "peak_x": self.peak_x}
            | {
                "rate_rad_s": float(rate[-1]),
                "temp_degc": float(temp[-1]),
                "seconds_spent": self.seconds_spent,
            }
        )

    def restore_all(self, values):
        """Continue where `dump_all` was."""
        self.set_state(values)
        self.hash.restore({name[5:]: value for name, value in values.items() if name.startswith("hash.")})
        self._tail, self._tail_ticks = deque(), 0
        self._keep_tail(values["tail.drive"], values["tail.sense"])
        self.peak_x, self.seconds_spent = values["peak_x"], values["seconds_spent"]
        self.now = (np.array([values["rate_rad_s"]]), np.array([values["temp_degc"]]))


def _parse_window(window):
    """(first tick, ticks) as integers, or None."""
    if window is None:
        return None
    if not isinstance(window, (tuple, list)) or len(window) != 2:
        raise ConfigError(f"window = {window!r} is not (first tick, ticks)")
    first, ticks = window
    return integer("window[0]", first, 0, MOST_TICKS, "ticks"), integer("window[1]", ticks, 1, MOST_TICKS, "ticks")


def _pad_frame_values(values, need):
    """Values for `need` frames, the last one repeated; one value is for all of them."""
    if len(values) >= need:
        return np.ascontiguousarray(values[:need], float)
    return np.concatenate([values, np.full(need - len(values), values[-1])], dtype=float)


def _fields(plant):
    """(name, array or record) of the plant's state, without its scratch."""
    return [(name, item) for name, item in plant._asdict().items() if name != SCRATCH]


def _leaves(name, item):
    """(dotted name, array) of a part of the plant's state."""
    return [(f"{name}.{k}", v) for k, v in item._asdict().items()] if hasattr(item, "_fields") else [(name, item)]
