"""A run from a configuration: power-on, lock, the scenario, and two diagnostic segments at its end.

    start-up     until all four loops are locked (or `LOCK_LIMIT_S`), at the scenario's first rate and temperature
    scenario     its profiles, register writes and faults; time counts from lock
    rate step    150 deg/s, through zero if it can: scale factor and step response; 50 deg/s of force are left for ye1
    ye2          FTR word held, quadrature left open by 60 deg/s: a tone at y, and all four node phases are read

The two segments are the diagnosis that a bench makes after its measurement; `[scenario] diagnose = false` omits them.
Source    docs/architecture.md, docs/phases.md
"""

import hashlib
import math
import time
import tomllib
from typing import NamedTuple

import numpy as np

from analog_frontend import thermal
from fpga_model import fault_monitor, quadrature_loop, registers, sequencer
from fpga_model import top as fpga
from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench import budget, build, engine, flatten, nodes, record, scenario
from testbench.config import to_toml
from testbench.errors import ConfigError
from testbench.outputs import Result
from testbench.vcd import Signal, signals

DEG = math.pi / 180
LOCK_LIMIT_S = 5.0
CHUNK_TICKS = 25_000
STEP_DPS, STEP_S, STEP_TAIL_S = 150.0, 0.6, 0.25
LEAST_DPS = 50.0  # of force, for ye1 to be read from
OPEN_DPS, OPEN_S, PROBE_S = 60.0, 0.1, 0.3
SPECTRUM_TICKS = 1 << 17
STATE_FORMAT = "engine-1"


class Simulation:
    """A state, and the streams of everything that happened to it. Advances in chunks; saves and restores exactly."""

    def __init__(self, config, temp_lo_degc, temp_hi_degc, window=None):
        self.config = config
        if config.firmware.board == "digital_sid" and any(f[1].startswith("adc_") for f in config.scenario.faults):
            raise ConfigError(
                'scenario.faults: adc_* faults need firmware.board = "analog_sid"; the other has no such ADC'
            )
        self.heating = thermal.design(config.device(), FRAME_TICKS / TICK_HZ)
        self.rise_k = 0.0
        temp_hi_degc += config.plant.self_heating_k
        try:
            self.params = build.params(config, temp_lo_degc, temp_hi_degc)
            self.first_writes = build.register_writes(config)
        except ValueError as problem:
            raise ConfigError(problem) from None
        self.state = engine.reset(self.params, temp_lo_degc)
        self.window = window  # (first tick, ticks) of the register window
        self.rows = None
        self.frames, self.truth = [], []
        self.hashes = [hashlib.sha256() for _ in range(3)]
        self.tail = np.zeros((2, 0), np.int32)
        self.faults = engine.Faults()
        self.peak_x = 0.0
        self.seconds_spent = 0.0
        self.register_count = len(flatten.names(self.state.fpga))

    @property
    def tick(self):
        return self.state.tick

    def write(self, name, raw):
        """Host write of a register at the next edge, which takes one tick."""
        entry = registers.BY_NAME[name]
        self._advance(1, *self.now, (1, entry.address, registers.to_bus(int(raw), entry.fmt)))

    def advance(self, ticks, rate_rad_s, temp_degc, probe_ticks=0, progress=None):
        """Run `ticks` ticks at constant rate and temperature, or with arrays of one value per frame begun."""
        frames = ticks // FRAME_TICKS + 2
        rate = np.broadcast_to(np.asarray(rate_rad_s, float), frames) if np.ndim(rate_rad_s) == 0 else rate_rad_s
        temp = np.broadcast_to(np.asarray(temp_degc, float), frames) if np.ndim(temp_degc) == 0 else temp_degc
        done, streams = 0, None
        while done < ticks:
            step = ticks if probe_ticks else self._to_window(min(CHUNK_TICKS, ticks - done))
            first = (self.tick // FRAME_TICKS) - (self.tick - done) // FRAME_TICKS
            streams = self._advance(
                step, np.ascontiguousarray(rate[first:]), np.ascontiguousarray(temp[first:]), (0, 0, 0), probe_ticks
            )
            done += step
            if progress:
                progress(done)
        return streams

    def _to_window(self, step):
        """Shorten a chunk so that the register window begins and ends with one."""
        if self.window:
            for border in (self.window[0], self.window[0] + self.window[1]):
                if self.tick < border < self.tick + step:
                    return border - self.tick
        return step

    def _advance(self, ticks, rate, temp, host, probe_ticks=0):
        rate, temp = np.atleast_1d(rate), np.atleast_1d(temp)
        need = ticks // FRAME_TICKS + 2
        if len(rate) < need:
            rate = np.concatenate([rate, np.full(need - len(rate), rate[-1])])
            temp = np.concatenate([temp, np.full(need - len(temp), temp[-1])])
        self.now = (rate[-1:], temp[-1:])
        inside = self.window and not probe_ticks and self.window[0] <= self.tick < self.window[0] + self.window[1]
        temp = self._warmed(temp, ticks)
        begun = (self.tick + ticks - 1) // FRAME_TICKS - (self.tick - 1) // FRAME_TICKS
        streams = engine.streams(
            ticks, begun, 26 * ticks if inside else 0, probe_ticks, self.register_count if inside else 0
        )
        started = time.perf_counter()
        self.state = engine.run(self.params, self.state, ticks, rate, temp, *host, self.faults, streams)
        self.seconds_spent += time.perf_counter() - started
        for digest, column in zip(self.hashes, (streams.drive_code, streams.sense_code, streams.frames[:, :9])):
            digest.update(np.ascontiguousarray(column, column.dtype.newbyteorder("<")).data)
        self.frames.append(streams.frames)
        self.truth.append(streams.truth)
        self.tail = np.concatenate([self.tail, np.stack([streams.drive_code, streams.sense_code])], axis=1)
        self.tail = self.tail[:, -SPECTRUM_TICKS:]
        self.peak_x = max(self.peak_x, float(streams.peak_x[0]))
        if inside:
            rows = np.concatenate([streams.pins, streams.registers], axis=1)
            self.rows = rows if self.rows is None else np.concatenate([self.rows, rows])
        return streams

    def _warmed(self, temp_degc, ticks):
        """Ambient temperatures plus the rise by self-heating, one step for each frame begun in the chunk."""
        if not self.heating.final_k:
            return temp_degc
        warmed = np.array(temp_degc, float)
        for n in range(len(warmed)):
            frame_tick = (self.tick // FRAME_TICKS + n) * FRAME_TICKS
            if self.tick <= frame_tick < self.tick + ticks:
                self.rise_k = thermal.step(self.heating, self.rise_k)
            warmed[n] += self.rise_k
        return warmed

    def codes_sha256(self):
        """Hash of every DAC code of every tick and every ADC code and word of every frame; chunks do not matter."""
        return hashlib.sha256(b"".join(h.digest() for h in self.hashes)).hexdigest()

    def columns(self):
        """All frames so far as {name: array}, registers and truth together."""
        frames = np.concatenate(self.frames) if self.frames else np.zeros((0, len(engine.FRAME_COLUMNS)), np.int64)
        truth = np.concatenate(self.truth) if self.truth else np.zeros((0, len(engine.TRUTH_COLUMNS)))
        out = {name: frames[:, k] for k, (name, _, _) in enumerate(engine.FRAME_COLUMNS)}
        return out | {f"truth_{name}": truth[:, k] for k, (name, _) in enumerate(engine.TRUTH_COLUMNS)}

    @property
    def locked(self):
        return self.state.fpga.control.sequencer.state == sequencer.LOCKED

    def probe(self, ticks, rate_rad_s, temp_degc):
        """Run `ticks` and read the phases of all nodes."""
        streams = self.advance(ticks, rate_rad_s, temp_degc, probe_ticks=ticks)
        return nodes.read(self.read_out(streams, temp_degc))

    def read_out(self, streams, temp_degc):
        """`nodes.Probe` of a recorded segment."""
        device, tables = self.config.device(), self.params.plant.tables
        warm = thermal.at_temperature(device, float(np.atleast_1d(temp_degc)[0]))
        tick_s = float(tables.tick_s[0])
        cycles = self.state.plant.cycles
        instants = [
            (float(c) * tick_s / 26 + delay_s) % tick_s
            for c, delay_s in zip(cycles, (device.drive_dac_delay_s, device.sense_dac_delay_s))
        ]
        chains = [[getattr(warm, f"{name}_pole_{n}_s") for n in (1, 2, 3)] for name in ("drive", "sense")]
        return nodes.Probe(
            streams.probe_ints,
            streams.probe_floats,
            streams.edges[: int(streams.edge_count[0])],
            tuple(chains),
            tuple(instants),
            tick_s,
            warm.fy_hz,
            -1 if self.state.fpga.control.rate_loop.loop.y < 0 else 1,
        )

    # ---- state files -------------------------------------------------------------------------------------------------

    def dump(self):
        """(values, format, meta) for `record.save_state`."""
        values = {"fpga": np.array([v for _, v in flatten.leaves(self.state.fpga)], np.int64)}
        values["chips"] = np.array([v for _, v in flatten.leaves(self.state.chips)], np.int64)
        values["tick"] = self.state.tick
        values["drdy_cycle"] = self.state.drdy_cycle
        values["rise_k"] = self.rise_k
        for name, item in self.state.plant._asdict().items():
            # copies: the arrays of a state move on in place
            if hasattr(item, "_fields"):
                values |= {f"plant.{name}.{k}": np.copy(v) for k, v in item._asdict().items()}
            else:
                values[f"plant.{name}"] = np.copy(item)
        return values, self._format(), {"config_toml": to_toml(self.config)}

    def _format(self):
        arrays = [f"{name}{np.shape(item)}" for name, item in flatten.leaves(self.state.plant)]
        text = " ".join(flatten.names(self.state.fpga) + flatten.names(self.state.chips) + arrays)
        return f"{STATE_FORMAT} {hashlib.sha256(text.encode()).hexdigest()[:12]}"

    def _check_same_gyroscope(self, path, meta):
        """A state continues the firmware and the plant that made it; only noise, effects and scenario may differ."""
        saved, mine = tomllib.loads(meta["config_toml"]), tomllib.loads(to_toml(self.config))
        for section in ("firmware", "plant"):
            for key in sorted(mine[section] | saved.get(section, {})):
                was, now = saved.get(section, {}).get(key), mine[section].get(key)
                if was != now:
                    raise ConfigError(f"{path}: was saved with {section}.{key} = {was}; it cannot continue with {now}")

    def restore(self, path):
        """Continue from a state file; RecordError if it is damaged or of another layout."""
        values, meta = record.load_state(path, self._format())
        self._check_same_gyroscope(path, meta)
        plant = {}
        for name, item in self.state.plant._asdict().items():
            if hasattr(item, "_fields"):
                plant[name] = type(item)(**{k: np.array(values[f"plant.{name}.{k}"]) for k in item._fields})
            else:
                plant[name] = np.array(values[f"plant.{name}"])
        self.rise_k = float(values["rise_k"])
        self.state = engine.State(
            flatten.rebuild(self.state.fpga, values["fpga"].tolist()),
            flatten.rebuild(self.state.chips, values["chips"].tolist()),
            type(self.state.plant)(**plant),
            int(values["tick"]),
            int(values["drdy_cycle"]),
        )


class Reading(NamedTuple):
    """What the diagnostic segments found."""

    nodes: nodes.Readings
    lsb_per_dps: float
    step: dict
    edges: np.ndarray


def _faults(active):
    """`engine.Faults` from the list of (kind, channel, value) in force."""
    silent, status = 0, engine.Faults().status
    stuck, code, dac, dac_code, nan = [0] * 4, [0] * 4, [0] * 3, [0] * 3, [0] * 2
    for kind, channel, value in active:
        if kind == "adc_silent":
            silent = 1
        elif kind == "adc_bad_status":
            status = value
        elif kind == "dac_stuck":
            k = list(scenario.DAC_CODES).index(channel)
            dac[k], dac_code[k] = 1, value
        elif kind == "plant_nan":
            nan["xy".index(channel)] = 1
        else:
            k = scenario.ADC_CHANNELS.index(channel)
            stuck[k] = 1
            code[k] = value if kind == "adc_stuck" else ((1 << 23) - 1 if value > 0 else -(1 << 23))
    return engine.Faults(silent, status, tuple(stuck), tuple(code), tuple(dac), tuple(dac_code), tuple(nan))


def start(config, sim, rate_rad_s, temp_degc, progress=None, limit_s=LOCK_LIMIT_S):
    """From power-on to lock: writes what the configuration sets, then waits. Returns the time of lock (s) or None."""
    sim.now = (np.array([rate_rad_s]), np.array([temp_degc]))
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    limit = round(limit_s * TICK_HZ)
    while not sim.locked and sim.tick < limit:
        sim.advance(min(CHUNK_TICKS, limit - sim.tick), rate_rad_s, temp_degc)
        if progress:
            progress("start-up to lock", sim.tick, limit)
    if not sim.locked:
        return None
    state = sim.columns()["state"]
    return float(np.argmax(state == sequencer.LOCKED) * FRAME_TICKS / TICK_HZ)


def play(sim, timeline, progress=None):
    """Run a timeline: profiles per frame, events at their ticks."""
    rate, temp = timeline.rate_rad_s, timeline.temp_degc
    active, events, done, begin = [], list(timeline.events), 0, sim.tick
    while done < timeline.ticks:
        while events and events[0].tick <= done:
            event = events.pop(0)
            key = (event.name[:3], event.channel)
            if event.action == scenario.WRITE:
                # a write takes its own tick; those at the very end lengthen the scenario by theirs
                sim.write(event.name, event.value)
                done += 1
            elif event.action == scenario.FAULT_ON:
                active.append((event.name, event.channel, event.value))
            else:
                active = [a for a in active if (a[0][:3], a[1]) != key]
            sim.faults = _faults(active)
        until = min(events[0].tick if events else timeline.ticks, timeline.ticks)
        if until > done:
            step = min(until - done, CHUNK_TICKS)
            sim.advance(step, _frames(rate, begin, sim.tick, step), _frames(temp, begin, sim.tick, step))
            done += step
        if progress:
            progress("scenario", done, timeline.ticks)
    sim.faults = _faults([])


def _frames(values, start_tick, tick, ticks):
    """Values of a profile for the engine's own frames of a chunk; the scenario began at `start_tick`."""
    frame = tick // FRAME_TICKS - start_tick // FRAME_TICKS
    return values[np.clip(frame + np.arange(ticks // FRAME_TICKS + 2), 0, len(values) - 1)]


def diagnose(sim, rate_rad_s, temp_degc, progress=None):
    """The two diagnostic segments."""

    def say(part):
        if progress:
            progress("diagnosis", part, 4)

    say(0)
    before_rate = rate_rad_s / DEG
    after_rate = before_rate - math.copysign(STEP_DPS, before_rate)
    if abs(after_rate) < LEAST_DPS:
        after_rate -= math.copysign(LEAST_DPS, before_rate)
    tail = round(STEP_TAIL_S * TICK_HZ)
    sim.advance(tail, rate_rad_s, temp_degc)
    head = len(np.concatenate(sim.frames))
    frames = tail // FRAME_TICKS
    sim.advance(round(STEP_S * TICK_HZ), after_rate * DEG, temp_degc)
    word = sim.columns()["rate_word"].astype(float)
    mean_before, mean_after = word[head - frames : head].mean(), word[-frames:].mean()
    scale = (mean_after - mean_before) / (after_rate - before_rate)
    shown = slice(head - 400, head + 2400)
    time_s = (np.arange(len(word)) - head)[shown] * FRAME_TICKS / TICK_HZ
    offset = mean_before / scale - before_rate
    step = {
        "time_s": time_s,
        "rate_dps": word[shown] / scale - offset,
        "stimulus_dps": np.where(time_s < 0, before_rate, after_rate),
    }
    say(1)
    bank = sim.state.fpga.registers
    u = sim.state.fpga.control.quadrature_loop.loop.y
    known = build.nominal(sim.config)
    per_dps = quadrature_loop.u_of_volts(known["null_v"]) / known["null_deg_per_s"]
    open_u = u - OPEN_DPS * per_dps if u > OPEN_DPS * per_dps else u + OPEN_DPS * per_dps
    sim.write("quadrature_fixed", int(min(open_u, 2**32 - 1)))
    sim.write("control", bank.control | sequencer.HOLD_FTR | sequencer.FIX_QSC)
    sim.advance(round(OPEN_S * TICK_HZ), after_rate * DEG, temp_degc)
    say(2)
    ticks = round(PROBE_S * TICK_HZ)
    streams = sim.advance(ticks, after_rate * DEG, temp_degc, probe_ticks=ticks)
    probe = sim.read_out(streams, temp_degc)
    say(3)
    readings = nodes.read(probe)
    sim.write("control", bank.control)
    say(4)
    return Reading(readings, scale, step, probe.edges)


def _loop_phases(readings, planned):
    """Loop phases from node phases: less what the demodulator's switching delays the reference."""
    return {node: readings[node] + sum(row.degrees for row in planned.loop_rows[node]) for node in ("xe2", "ye2")}


def run(config, progress=None):
    """Do a whole run; returns `Result`."""
    say = progress or (lambda *_: None)
    wanted = config.scenario
    timeline = scenario.expand(wanted)
    temps = np.append(timeline.temp_degc, timeline.temp_before_degc)
    window = None
    if config.output.vcd_length_us:
        window = (round(config.output.vcd_start_us), max(1, round(config.output.vcd_length_us)))
    say("compiling", 0, 1)
    sim = Simulation(config, float(temps.min()), float(temps.max()), window)
    began = time.perf_counter()
    lock_s = None
    if wanted.resume:
        sim.restore(wanted.resume)
        sim.now = (np.array([timeline.rate_before_rad_s]), np.array([timeline.temp_before_degc]))
    elif wanted.origin == "lock":
        lock_s = start(config, sim, timeline.rate_before_rad_s, timeline.temp_before_degc, progress)
    else:
        sim.now = (np.array([timeline.rate_before_rad_s]), np.array([timeline.temp_before_degc]))
        for name, raw in sim.first_writes:
            sim.write(name, raw)
    first_frame = len(np.concatenate(sim.frames)) if sim.frames else 0
    spent, ticks = sim.seconds_spent, sim.tick
    play(sim, timeline, progress)
    real_time_factor = (sim.tick - ticks) / TICK_HZ / max(sim.seconds_spent - spent, 1e-9)
    locked = bool(sim.locked)
    codes = sim.codes_sha256()
    state = sim.dump() if config.output.state else None
    rate_rad_s, temp_degc = float(timeline.rate_rad_s[-1]), float(timeline.temp_degc[-1])
    main, tail = sim.columns(), sim.tail
    reading = diagnose(sim, rate_rad_s, temp_degc, progress) if locked and wanted.diagnose else None
    return _result(config, sim, main, tail, first_frame, lock_s, locked, real_time_factor, codes, state, reading, began)


def _result(config, sim, main, tail, first_frame, lock_s, locked, real_time_factor, codes, state, reading, began):
    planned = budget.budget(config)
    clock_hz = build.clock_hz(config)
    part = {name: column[first_frame:] for name, column in main.items()}
    part = part if len(part["state"]) else main
    if lock_s is None and not config.scenario.resume and np.any(main["state"] == sequencer.LOCKED):
        lock_s = float(np.argmax(main["state"] == sequencer.LOCKED) * FRAME_TICKS / TICK_HZ)
    device = config.device()
    amplitude = np.sqrt(
        part["truth_x"] ** 2 + (part["truth_vx"] * 11000.0 / (part["frequency_word"] * clock_hz / 2**48)) ** 2
    )
    summary = {
        "locked": locked,
        "lock_time_s": lock_s,
        "drive_frequency_hz": float(np.mean(part["frequency_word"]) * clock_hz / 2**48),
        "expected_frequency_hz": budget.lock_frequency_hz(
            thermal.at_temperature(device, float(part["truth_temperature"][-1])).fx_hz,
            thermal.at_temperature(device, float(part["truth_temperature"][-1])).qx,
            planned.node_deg()["xe1"],
            planned.loop_deg()["xe2"],
        ),
        "amplitude_m": float(np.mean(amplitude)),
        "phase_deg": None if reading is None else reading.nodes.phase_deg,
        "phase_sigma_deg": None if reading is None else reading.nodes.sigma_deg,
        "counter_deg": None if reading is None else reading.nodes.counter_deg,
        "counter_resolution_deg": None if reading is None else reading.nodes.counter_resolution_deg,
        "budget_deg": planned.node_deg(),
        "loop_phase_deg": None if reading is None else _loop_phases(reading.nodes.phase_deg, planned),
        "budget_loop_deg": planned.loop_deg(),
        "paper_deg": dict(budget.PAPER_DEG),
        "rate_lsb_per_dps": None if reading is None else reading.lsb_per_dps,
        "rate_word_mean_lsb": float(np.mean(part["rate_word"])),
        "quadrature_v": float(np.mean(part["quadrature_code"]) * device.quad_dac_span_v / 2**16),
        "flags": [name for k, name in enumerate(fault_monitor.NAMES) if np.bitwise_or.reduce(part["flags"]) >> k & 1],
        "window_missing": 0 if not sim.window else 26 * sim.window[1] - (0 if sim.rows is None else len(sim.rows)),
        "real_time_factor": real_time_factor,
        "simulated_s": sim.tick / TICK_HZ,
        "wall_s": time.perf_counter() - began,
        "codes_sha256": codes,
        "seed": config.noise.seed,
    }
    return Result(
        summary,
        _notes(config, summary, planned),
        _record(config, sim),
        _plots(sim, tail, summary, lock_s, reading, clock_hz, config),
        _window(sim),
        state,
    )


def _notes(config, summary, planned):
    """Sentences: what is assumed, and what remains unexplained."""
    notes = []
    if not summary["locked"]:
        notes.append("NOT LOCKED at the end of the scenario; see docs/blocks/sequencer.md")
    if summary.get("window_missing"):
        notes.append(f"The waveform window lacks {summary['window_missing']} clocks: run or phase reading cut it.")
    if summary.get("flags"):
        notes.append(f"Fault flags raised: {', '.join(summary['flags'])}; see docs/blocks/fault_monitor.md")
    if config.firmware.reference_retimed:
        notes.append(
            "Assumed, not known: the references leave on the 1 MHz grid (firmware.reference_retimed), which takes "
            "13.5 clocks off xe1 and ye1."
        )
    if config.firmware.frame_latency_sense:
        notes.append("Assumed, not known: one extra 1 us frame in the sense path (firmware.frame_latency_sense).")
    measured = summary["phase_deg"]
    if measured:
        gap = {k: (measured[k] - v) / 360.0 / planned.frequency_hz * 1e9 for k, v in budget.PAPER_DEG.items()}
        notes.append(
            "Unexplained beside the paper: "
            + ", ".join(f"{k} {measured[k] - budget.PAPER_DEG[k]:+.4f} deg ({ns:+.0f} ns)" for k, ns in gap.items())
            + ". No latency was tuned."
        )
    if measured and config.firmware == type(config.firmware)() and config.plant == type(config.plant)():
        notes.append(
            "ye1 holds most of it. Two rivals: the DAC's 130 ns are partly inside its output poles, or a pole near "
            "170 kHz stands where the frame is assumed. Their drift with temperature differs (docs/phases.md)."
        )
        notes.append(
            "How xe2 and ye2 split into ring diode, noise gains and switch delay, two numbers cannot say; the "
            "loop phases printed above are less the assumed 80 ns of the analog switch."
        )
    return tuple(notes)


def _record(config, sim):
    """Everything that was recorded, as a `record.Record`."""
    streams = {}
    columns = sim.columns()
    units = {name: unit for name, unit, _ in engine.FRAME_COLUMNS}
    fmts = {name: fmt for name, _, fmt in engine.FRAME_COLUMNS}
    truth = {f"truth_{name}": unit for name, unit in engine.TRUTH_COLUMNS}
    for name, data in columns.items():
        if name in units:
            attrs = {"lsb": units[name], "format": str(fmts[name])}
            unit = "code" if "code" in name or name.startswith("adc") else "word"
            streams[name] = record.Column(data, unit, 1, FRAME_TICKS * 26, 0, attrs)
        else:
            streams[name] = record.Column(data, truth[name], 1, FRAME_TICKS * 26, 0, {"tap": "truth"})
    return record.Record(streams, {}, to_toml(config), "simulated", config.plant.clock_ppm)


def _plots(sim, tail, summary, lock_s, reading, clock_hz, config):
    """Arguments of the pictures."""
    c = sim.columns()
    count = len(c["state"]) if lock_s is None else int(min(len(c["state"]), (lock_s + 0.5) * 8000))
    ratio = 11000.0 / (c["frequency_word"] * clock_hz / 2**48)
    plots = {
        "startup": {
            "time_s": np.arange(count) * FRAME_TICKS / TICK_HZ,
            "amplitude_um": np.sqrt(c["truth_x"] ** 2 + (c["truth_vx"] * ratio) ** 2)[:count] * 1e6,
            "phase_deg": c["phase"][:count] / 2**24 * 360,
            "frequency_error_hz": c["frequency_word"][:count] * clock_hz / 2**48 - summary["expected_frequency_hz"],
            "state": c["state"][:count],
            "state_names": sequencer.STATES,
            "lock_time_s": lock_s,
            "setpoint_um": config.firmware.amplitude_um,
        },
        "spectra": {"outputs": {"drive (16 bit)": (tail[0], 16), "sense (20 bit)": (tail[1], 20)}},
    }
    if reading is not None:
        names = ("drive sgn(sin)", "drive sgn(cos)", "sense sgn(sin)", "sense sgn(cos)")
        f = summary["drive_frequency_hz"]
        errors = {n: nodes.edge_errors_turns(reading.edges, k) / f * 1e9 for k, n in enumerate(names)}
        plots["jitter"] = {
            "edges_ns": errors,
            "grid_ns": 1000.0 if config.firmware.reference_retimed else 1e9 / clock_hz,
        }
        plots["rate_step"] = reading.step
    return plots


def _window(sim):
    """Register window for the waveform writer."""
    if sim.rows is None:
        return None
    pins = [
        Signal(f"pins.{name}", 24 if name.endswith("code") else (4 if name == "refs" else 1), name.endswith("code"))
        for name in engine.PIN_COLUMNS
    ]
    formats = [fmt for _, fmt in flatten.format_leaves(fpga.STATE_FMT)]
    return sim.rows, pins + signals(flatten.names(sim.state.fpga), formats), sim.window[0] * 26
