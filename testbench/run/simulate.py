"""A run from a configuration: power-on, lock, the scenario, and two diagnostic segments at its end.

    start-up     until all four loops are locked (or `lock_limit_s`), at the scenario's first rate and temperature
    scenario     its profiles, register writes and faults; time counts from lock
    rate step    150 deg/s, through zero if it can: scale factor and step response; 50 deg/s of force are left for ye1
    ye2          FTR word held, quadrature left open by 60 deg/s: a tone at y, and all four node phases are read

These rates are smaller where the nominal board's range is, and times longer where its loops are slower (`pace`).

The two segments are the diagnosis that a bench makes after its measurement; `[scenario] diagnose = false` omits them.
Memory does not grow with the scenario: rows go to the disk, means to `RunStatistics`. During the scenario checkpoints
are written at ends of chunks, from which an interrupted run continues to the same bytes.
Source    docs/architecture.md, docs/phases.md, docs/record.md
"""

import json
import math
import time
import tomllib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fpga_model import quadrature_loop, sequencer
from testbench.arguments import number
from testbench.config import changed, from_dict, placeless, require_config, scenario, to_toml
from testbench.engines import engine
from testbench.errors import ConfigError, FileError
from testbench.run import build, nodes, summary
from testbench.run.anomaly_warnings import AnomalyDetector
from testbench.run.run_statistics import RunStatistics, StartUp
from testbench.run.simulation import CHUNK_TICKS, DEG, FRAME, Simulation
from testbench.storage import checkpoint, identity, inputs
from testbench.storage.spool import Recording, Spool

LOCK_LIMIT_S = 5.0  # at the default loops' pace
MOST_LOCK_S = 36_000.0
LOCK_STEP_TICKS = 25_000  # the scenario begins at the first multiple after lock
STEP_DPS, STEP_S, STEP_TAIL_S = 150.0, 0.6, 0.25
LEAST_DPS = 50.0  # of force, for ye1 to be read from
OPEN_DPS, OPEN_S, PROBE_S = 60.0, 0.1, 0.3
RANGE_PART = 0.2  # of the largest rate, and of the converter's range: no step is beyond it
STEP_PLOT_WINDOW_S = 0.05, 0.3  # of the rate step in the picture: before and after it
SEGMENTS = ("start_up", "scenario", "diagnosis")


class Reading(NamedTuple):
    """What the diagnostic segments found."""

    nodes: nodes.Readings
    lsb_per_dps: float
    step: dict
    edges: np.ndarray


class Watch:
    """A sink that keeps one column of the rows that pass."""

    def __init__(self, name):
        self._index = FRAME[name]
        self._pieces = [np.zeros(0, np.int64)]

    def add(self, first_frame, frames, truth):
        """Rows of consecutive frames."""
        self._pieces.append(frames[:, self._index].copy())

    def values(self):
        """The column so far."""
        return np.concatenate(self._pieces)


def build_faults(active):
    """`engine.Faults` from the list of (kind, channel, value) in force."""
    silent, status = 0, engine.Faults().status
    channel, level, dac, dac_code = [0] * 5, [0] * 5, [0] * 3, [0] * 3
    nan, sample, sample_code, lost_bit = [0] * 2, [0] * 2, [0] * 2, 0
    for kind, name, value in active:
        if kind == "adc_silent":
            silent = 1
        elif kind == "adc_bad_status":
            status = value
        elif kind == "dac_stuck":
            k = list(scenario.DAC_CODES).index(name)
            dac[k], dac_code[k] = 1, value
        elif kind == "plant_nan":
            nan["xy".index(name)] = 1
        elif kind == "adc_lost_bit":
            lost_bit = value
        elif kind.startswith("sample_"):
            k = scenario.SAMPLES.index(name)
            sample[k], sample_code[k] = 1 if kind == "sample_stuck" else 2, value
        elif kind == "adc_over_range":
            k = scenario.ADC_CHANNELS.index(name)
            channel[k], level[k] = engine.STUCK, scenario.CODE_HI if value > 0 else scenario.CODE_LO
        else:
            k = scenario.ADC_CHANNELS.index(name)
            channel[k], level[k] = 1 + engine.WRONG.index(kind.removeprefix("adc_")), value
    lists = channel, level, dac, dac_code, nan, sample, sample_code
    channel, level, dac, dac_code, nan, sample, sample_code = (tuple(item) for item in lists)
    return engine.Faults(silent, status, channel, level, lost_bit, dac, dac_code, nan, sample, sample_code)


def pace(config):
    """How many times longer than the default's loops the slowest of these takes to settle, 1 or more."""
    default = type(config.firmware)()
    names = (
        "agc_crossover_hz",
        "agc_zero_hz",
        "pll_crossover_hz",
        "pll_zero_hz",
        "ftr_crossover_hz",
        "qsc_crossover_hz",
    )
    return max(1.0, *(getattr(default, name) / getattr(config.firmware, name) for name in names))


def rate_loop_pace(config):
    """How many times slower than the default's the rate loop is: a whole number, 1 or more."""
    return max(1, round(type(config.firmware)().ftr_crossover_hz / config.firmware.ftr_crossover_hz))


def lock_limit_s(config):
    """How long a run waits for lock from power-on (s)."""
    return LOCK_LIMIT_S * pace(config)


def start(config, sim, rate_rad_s, temp_degc, progress=None, limit_s=None):
    """From power-on to lock: writes what the configuration sets, then waits. Returns the time of lock (s) or None.

    sim         `Simulation` at power-on
    rate_rad_s  one number; so is temp_degc
    limit_s     time of power-on to give up; None: `lock_limit_s`
    """
    limit_s = (
        lock_limit_s(require_config(config)) if limit_s is None else number("limit_s", limit_s, 0.0, MOST_LOCK_S, "s")
    )
    limit = round(limit_s * sim.design.tick_hz)
    sim.now = sim.conditions(rate_rad_s, temp_degc)
    if max(map(len, sim.now)) > 1:
        raise ConfigError("start: rate_rad_s and temp_degc must be single numbers; use advance for profiles")
    start_up_sink = StartUp(sim.design.frame_hz)
    sim.sinks.append(start_up_sink)
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    while not sim.locked and sim.tick < limit:
        sim.advance(min(LOCK_STEP_TICKS, limit - sim.tick), rate_rad_s, temp_degc)
        if progress:
            progress("start-up to lock", sim.tick, limit)
    sim.sinks.remove(start_up_sink)
    if not sim.locked:
        return None
    # a lock in the middle of the last frame has no row yet
    return start_up_sink.lock_s if start_up_sink.lock_s is not None else sim.tick / sim.design.tick_hz


@dataclass
class Position:
    """How far a timeline has been played."""

    begin: int = -1  # tick of its first instant
    done: int = 0  # ticks
    fired: int = 0  # events


def play(sim, timeline, progress=None, position=None, after_chunk=None):
    """Run a timeline, or the rest of it behind `position`: profiles per frame, events at their ticks."""
    position = position or Position()
    if position.begin < 0:
        position.begin = sim.tick
    active = []
    for event in timeline.events[: position.fired]:
        active = _in_force(active, event)
    sim.faults = build_faults(active)
    while position.done < timeline.ticks:
        for event in timeline.events[position.fired :]:
            if event.tick > position.done:
                break
            if event.action == scenario.WRITE:
                # a write takes its own ticks; those at the very end lengthen the scenario by theirs
                sim.now, before = _profiles(timeline, position, sim, 1), sim.tick
                sim.write(event.name, event.value)
                position.done += sim.tick - before
            active = _in_force(active, event)
            sim.faults = build_faults(active)
            position.fired += 1
        ahead = timeline.events[position.fired :]
        until = min(ahead[0].tick if ahead else timeline.ticks, timeline.ticks)
        if until > position.done:
            step = min(until - position.done, sim.chunk_ticks)
            sim.advance(step, *_profiles(timeline, position, sim, step))
            position.done += step
        if progress:
            progress("scenario", position.done, timeline.ticks)
        if after_chunk:
            after_chunk()
    sim.faults = build_faults([])


def _in_force(active, event):
    """The list of faults after an event."""
    if event.action == scenario.FAULT_ON:
        return [*active, (event.name, event.channel, event.value)]
    if event.action == scenario.FAULT_OFF:
        return [a for a in active if (a[0][:3], a[1]) != (event.name[:3], event.channel)]
    return active


def _profiles(timeline, position, sim, ticks):
    """Rate and temperature for the frames of a chunk, the first for the frame in progress."""
    frame = sim.frame_index(sim.tick) - sim.frame_index(position.begin)
    return tuple(p.frame_values(frame, sim.frame_index(ticks) + 2) for p in (timeline.rate_rad_s, timeline.temp_degc))


def diagnose(sim, rate_rad_s, temp_degc, progress=None):
    """The two diagnostic segments."""

    def report_progress(part):
        if progress:
            progress("diagnosis", part, 4)

    report_progress(0)
    unit_scales, device, slower = build.nominal(sim.config), sim.config.nominal_device(), pace(sim.config)
    step_dps = min(STEP_DPS, RANGE_PART * device.sense_dac_span_v / abs(unit_scales["word_v_per_deg_s"]))
    least_dps = LEAST_DPS / STEP_DPS * step_dps
    before_rate = rate_rad_s / DEG
    after_rate = before_rate - math.copysign(step_dps, before_rate)
    if abs(after_rate) < least_dps:
        after_rate -= math.copysign(least_dps, before_rate)
    tick_hz, frame_ticks = sim.design.tick_hz, sim.design.frame_ticks
    tail = round(STEP_TAIL_S * slower * tick_hz)
    watch = Watch("rate_word")
    sim.sinks.append(watch)
    sim.advance(tail, rate_rad_s, temp_degc)
    head = len(watch.values())
    frames = tail // frame_ticks
    sim.advance(round(STEP_S * slower * tick_hz), after_rate * DEG, temp_degc)
    sim.sinks.remove(watch)
    word = watch.values().astype(float)
    mean_before, mean_after = word[head - frames : head].mean(), word[-frames:].mean()
    scale = (mean_after - mean_before) / (after_rate - before_rate)
    before, after = (round(seconds * tick_hz / frame_ticks) for seconds in STEP_PLOT_WINDOW_S)
    plot_slice = slice(head - before, head + after)
    time_s = (np.arange(len(word)) - head)[plot_slice] * frame_ticks / tick_hz
    offset = mean_before / scale - before_rate
    step = {
        "time_s": time_s,
        "rate_dps": word[plot_slice] / scale - offset,
        "stimulus_dps": np.where(time_s < 0, before_rate, after_rate),
    }
    report_progress(1)
    bank = sim.state.fpga.registers
    u = sim.state.fpga.control.quadrature_loop.loop.y
    per_dps = quadrature_loop.u_of_volts(unit_scales["null_v"], device.quad_dac_span_v) / unit_scales["null_deg_per_s"]
    open_dps = min(OPEN_DPS, RANGE_PART * unit_scales["adc_sense_v"] / abs(unit_scales["code_v_per_deg_s"]))
    open_u = u - open_dps * per_dps if u > open_dps * per_dps else u + open_dps * per_dps
    sim.write("quadrature_fixed", int(min(open_u, 2**32 - 1)))
    sim.write("control", bank.control | sequencer.HOLD_FTR | sequencer.FIX_QSC)
    sim.advance(round(OPEN_S * tick_hz), after_rate * DEG, temp_degc)
    report_progress(2)
    ticks = round(PROBE_S * tick_hz)
    streams = sim.advance(ticks, after_rate * DEG, temp_degc, probe_ticks=ticks)
    probe = sim.read_out(streams, temp_degc)
    report_progress(3)
    readings = nodes.read(probe)
    sim.write("control", bank.control)
    report_progress(4)
    return Reading(readings, scale, step, probe.edges)


# ---- the whole run ---------------------------------------------------------------------------------------------------


class Run:
    """Everything that a run consists of; what a checkpoint keeps is `parts`.

    directory  where rows and checkpoints are kept until the run is done: a folder, or its `checkpoint.Partial`;
               None keeps the rows in memory
    resume     continue the run that was interrupted there
    """

    def __init__(self, config, directory=None, resume=False):
        self.config = require_config(config)
        self.timeline = scenario.expand(config.scenario, config.design_record())
        self.temp_before_degc, self.rate_before_rad_s = self.timeline.temp_before_degc, self.timeline.rate_before_rad_s
        lo, hi = self.timeline.temp_degc.limits()
        window = None
        if config.output.vcd_length_us:
            us = 1e-6 * config.design_record().tick_hz
            window = (round(config.output.vcd_start_us * us), max(1, round(config.output.vcd_length_us * us)))
        self.sim = Simulation(config, min(lo, self.temp_before_degc), max(hi, self.temp_before_degc), window)
        self.statistics, self.start_up, self.anomaly_detector = (
            RunStatistics(build.lsb_hz(config)),
            StartUp(self.sim.design.frame_hz),
            AnomalyDetector(pace(config), config.device().adc_step_code),
        )
        self.position, self.segments = Position(), dict.fromkeys(SEGMENTS, -1)
        self.partial = directory
        if resume and directory is None:
            raise ConfigError("resume = True needs directory, the folder of the interrupted run")
        if directory is not None and not isinstance(directory, checkpoint.Partial):
            self.partial = checkpoint.Partial(directory)
        self.tick_before, self.spent_before_s = 0, 0.0  # where the scenario begins
        self._every_ticks = round(config.output.checkpoint_s * self.sim.design.tick_hz)
        self.others = []  # identities of other versions that this run continues
        parts, meta = self._load_checkpoint() if resume else ({}, {})
        if self.partial and not resume:
            self.partial.start_new_run(to_toml(config))
        self.recording = None
        if config.output.record:
            rows = parts["spool"]["rows"] if resume else None
            path = self.partial.rows if self.partial else None
            spool = Spool(config.output.columns, config.output.decimate, path, rows, self.sim.design, build.lsb(config))
            self.recording = Recording(
                spool,
                to_toml(placeless(config)),
                config.plant.clock_ppm,
                meta.get("record_id"),
                meta.get("created_utc"),
            )
            self.recording.codes, self.recording.partial = self.sim.hash, self.partial
        self.sim.keep_rows = False
        self.sim.sinks = [self.start_up, self.statistics, self.anomaly_detector] + (
            [self.recording.spool] if self.recording else []
        )
        if resume:
            self._restore(parts, meta)
        self._next_tick = self.sim.tick + self._every_ticks

    def _load_checkpoint(self):
        """(parts, meta) of the checkpoint, which must be of this configuration and, unless allowed, of this version."""
        self.partial.hold()
        parts, meta = self.partial.load(*self.sim.layouts())
        # compared as configurations: another version's text may have other keys, in another order
        saved = from_dict(tomllib.loads(meta["config_toml"]), origin={"scenario.plant": "compared only"})
        across = self.config.scenario.across_versions
        if changed(saved, {"scenario.across_versions": across}) != self.config:
            raise FileError(f"{self.partial.checkpoint}: belongs to another configuration than {self.partial.config}")
        self.others = inputs.parse_json(meta.get("others", "[]"), self.partial.checkpoint, list)
        saved = inputs.parse_json(meta.get("identity", "{}"), self.partial.checkpoint)
        self._continues(identity.check(self.partial.checkpoint, saved, self.sim.identity, across))
        return parts, meta

    def _continues(self, other):
        """Note the identity of another version whose state goes on here."""
        if other is not None:
            self.others.append(other)

    def mark_segment_start(self, segment):
        """Note where a segment begins."""
        self.segments[segment] = self.sim.design.tick_clocks * self.sim.tick

    def start(self, progress):
        """From power-on or from a state file to where the scenario begins."""
        scenario_section, sim = self.config.scenario, self.sim
        sim.now = (np.array([self.rate_before_rad_s]), np.array([self.temp_before_degc]))
        if scenario_section.resume:
            self._continues(sim.restore(scenario_section.resume))
        else:
            self.mark_segment_start("start_up")
            if scenario_section.origin == "lock":
                start(self.config, sim, self.rate_before_rad_s, self.temp_before_degc, progress)
            else:
                for name, raw in sim.first_writes:
                    sim.write(name, raw)
        self.mark_segment_start("scenario")
        self._next_tick = sim.tick + self._every_ticks
        self.spent_before_s, self.tick_before = sim.seconds_spent, sim.tick
        self.statistics.active = self.anomaly_detector.active = True

    def checkpoint_if_due(self):
        """Write a checkpoint where one is due; not inside the register window, whose rows are kept when complete."""
        sim = self.sim
        if not (self.partial and self._every_ticks and sim.saves) or sim.tick < self._next_tick or sim.in_window:
            return
        self._next_tick = sim.tick + self._every_ticks
        meta = {
            "config_toml": to_toml(self.config),
            "identity": json.dumps(sim.identity),
            "others": json.dumps(self.others),
            "window_sha256": "" if sim.rows is None else self.partial.keep_window(sim.rows),
        }
        parts = {
            "sim": sim.dump_all(),
            "tally": self.statistics.dump(),
            "doubts": self.anomaly_detector.dump(),
            "start_up": self.start_up.dump(),
            "position": vars(self.position),
            "segments": self.segments,
            "before": {"spent_s": self.spent_before_s, "tick": self.tick_before},
        }
        if self.recording:
            parts["spool"] = self.recording.spool.dump()
            meta |= {"record_id": self.recording.record_id, "created_utc": self.recording.created_utc}
        self.partial.save(sim.layout(), parts, meta)

    def _restore(self, parts, meta):
        sim = self.sim
        sim.restore_all(parts["sim"])
        self.statistics.restore(parts["tally"])
        # a checkpoint of version 0.1.0 has none: what it gathered is not looked at
        self.anomaly_detector.restore(parts.get("doubts", {}))
        self.statistics.active = self.anomaly_detector.active = True
        self.start_up.restore(parts["start_up"])
        self.position = Position(**parts["position"])
        self.segments = parts["segments"]
        self.spent_before_s, self.tick_before = parts["before"]["spent_s"], parts["before"]["tick"]
        if self.recording:
            self.recording.spool.restore(parts["spool"])
        columns = len(engine.PIN_COLUMNS) + sim.register_count
        sim.rows = self.partial.load_window(columns, meta.get("window_sha256", ""))

    def play_scenario(self, progress):
        """The scenario, or what is left of it."""
        play(self.sim, self.timeline, progress, self.position, self.checkpoint_if_due)
        self.statistics.active = self.anomaly_detector.active = False

    def end(self):
        """What holds at the end of the scenario: `summary.End`."""
        sim = self.sim
        simulated_s = (sim.tick - self.tick_before) / sim.design.tick_hz
        return summary.End(
            locked=bool(sim.locked),
            codes_sha256=sim.codes_sha256(),
            tail=sim.tail,
            state=sim.dump() if self.config.output.state and sim.saves else None,
            real_time_factor=simulated_s / max(sim.seconds_spent - self.spent_before_s, 1e-9),
        )


def run(config, progress=None, directory=None, resume=False, sinks=()):
    """Do a whole run; returns `Result`.

    config     `Config`; its scenario has rate and temperature
    directory  where rows and checkpoints are kept meanwhile; None: rows stay in memory, for runs of seconds
    resume     continue the interrupted run in `directory`, of the same configuration
    sinks      objects that get the rows of the scenario, and of nothing else (`simulation`)
    """
    if progress:
        progress("compiling", 0, 1)
    began = time.perf_counter()
    job = Run(config, directory, resume)
    if not resume:
        job.start(progress)
    job.sim.sinks.extend(sinks)
    job.play_scenario(progress)
    job.sim.sinks = [sink for sink in job.sim.sinks if sink not in sinks]
    end, reading = job.end(), None
    if end.locked and config.scenario.diagnose and not job.sim.foreign:
        job.mark_segment_start("diagnosis")
        last = job.timeline.frames - 1
        rate_rad_s, temp_degc = (
            float(p.frame_values(last)[0]) for p in (job.timeline.rate_rad_s, job.timeline.temp_degc)
        )
        reading = diagnose(job.sim, rate_rad_s, temp_degc, progress)
    if job.recording:
        names = [name for name in SEGMENTS if job.segments[name] >= 0]
        edges = np.array([job.segments[name] for name in names], np.int64)
        job.recording.tables["segments"] = {"name": ("", np.array(names)), "edge": ("edge", edges)}
        if job.sim.foreign:
            job.recording.attrs |= {f"{key}_sha256": digest for key, digest in job.sim.foreign.identity.items()}
        if job.others:
            job.recording.attrs["continues"] = json.dumps(job.others)
    return summary.build_run_result(job, end, reading, time.perf_counter() - began)


__all__ = ["CHUNK_TICKS", "DEG", "Simulation", "diagnose", "play", "run", "start"]
