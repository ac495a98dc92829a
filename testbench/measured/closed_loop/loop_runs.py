"""The closed loop under several conditions at once: from a locked state each, through settling into the dwell.

    lock     frame engine from power-on, as `gyro measured record` does it, to START_TICKS
    runs     (model, condition, seed, whose lock, if not from a power-on of its own) -> features of the dwell
             lanes      exact to the bit, eight at a time on all cores
             baseband   averaged plant, three to six times as fast; its differences are what tangents are made of

A model is a configuration and the laws that are added to it. Runs do not depend on what runs beside them.
Source    docs/measured.md
"""

import math
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from analog_frontend import top as plant
from analog_frontend.averaged import averaged_laws
from analog_frontend.numeric.vector import LANES
from fpga_model import agc, references, sequencer
from fpga_model.rates import FRAME_TICKS, TICK_HZ
from testbench import config
from testbench.config import phase_word
from testbench.engines import baseband, baseband_setup, engine, frame, lanes
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_spectra
from testbench.measured.residual import features
from testbench.measured.residual.simulator import streams
from testbench.run import build
from testbench.run.simulation import Simulation
from testbench.storage.code_hash import frames_begun

DEG = math.pi / 180
AVERAGED_START_TICKS = 3_000 * FRAME_TICKS  # from here on the averaged plant holds
START_TICKS = 14_000 * FRAME_TICKS  # 1.75 s: the slowest start-up has locked, and half a second has passed
SETTLE_S = 1.5  # from START_TICKS to a dwell, if no record says otherwise: what power-on leaves is below a sigma then
LOCK_SETTLE_S = 2.0  # from a locked state to a dwell: of 300 sigmas there 0.2 are left in loops with zeros at 0.6 Hz
MOST_DELAY_FRAMES = 100  # frames by which a dwell may begin later: nobody knows the drive's phase at a step of the rate
FIRST_BIN = 64  # frames
FINE = 64  # frames of each bin in which held-out errors are told
BLOCK = 8  # frames of a mean in which responses are kept; a part of FIRST_BIN and FINE
TURN = 1 << 48
NAMES = tuple(features.OBSERVABLES)
THREADS = max(1, min(2, os.cpu_count() or 1))
EXACT, FAST = "lanes", "baseband"
MOST_LOCKED, MOST_SETUPS = 200, 400
LEAST_LANES = 3  # fewer gyroscopes side by side are no faster than one by one
DESIGN = threading.Lock()  # mpmath's precision belongs to the process, not to a thread


class Model(NamedTuple):
    """What is run: a configuration and laws beside its own, as texts."""

    config: config.Config
    laws: tuple = ()


class Run(NamedTuple):
    """One run that is asked for."""

    model: Model
    condition: object  # plan.Condition
    seed: int
    start: config.Config | None = None  # whose locked state it begins from; None: from a power-on of its own
    delay_frames: int = 0  # frames by which the dwell begins later, below MOST_DELAY_FRAMES
    smooth: bool = False  # of the averaged plant: codes of the drive are not rounded


def frame_count(seconds):
    """Whole frames."""
    return max(0, round(seconds * TICK_HZ / FRAME_TICKS))


def bins(condition):
    """First frames of the bins of a dwell and its end: FIRST_BIN, then twice as many each."""
    return features.bins(frame_count(condition.seconds), FIRST_BIN)


def fine_bins(condition):
    """First frames of bins of FINE frames each, and the end of the last whole one."""
    return np.arange(0, frame_count(condition.seconds) + 1, FINE)


def feature_count(condition):
    """How many features are for fits and alarms; those of the fine bins follow them."""
    return len(NAMES) * (len(bins(condition)) - 1)


def feature_vector(condition, columns, lsb_v, fine=False):
    """Means of each observable in turn over the bins, then over the fine ones, from streams of the dwell alone."""
    out = []
    for edges in (bins(condition), fine_bins(condition))[: 1 + fine]:
        for name in NAMES:
            stream = features.OBSERVABLES[name].stream
            values = features.physical(name, columns[stream][: edges[-1]], lsb_v.get(stream, 1.0))
            out.append(features.means(values, edges))
    return np.concatenate(out)


def lsb_volts(model):
    """Volts per code of the streams that are codes."""
    d = model.device()
    volts = dict.fromkeys(("adc_xI", "adc_xQ"), 2 * d.adc_vref_v / d.adc_pga_drive / 2**24)
    volts |= dict.fromkeys(("adc_yI", "adc_yQ"), 2 * d.adc_vref_v / d.adc_pga_sense / 2**24)
    return volts | {"dac_qsc": d.quad_dac_span_v / 2**16, "quadrature_code": d.quad_dac_span_v / 2**16}


def model_key(model):
    """The configuration of a model with its laws in place."""
    effects = model.config.effects
    laws = effects.model_copy(update={"laws": [*effects.laws, *model.laws]})
    return model.config.model_copy(update={"effects": laws})


def seeded_config(model, seed):
    """The configuration of a model with the noise of a seed."""
    cfg = model_key(model)
    return cfg.model_copy(update={"noise": cfg.noise.model_copy(update={"seed": seed})})


def begin_tick(run):
    """Tick at which a run begins: AVERAGED_START_TICKS, or LOCK_SETTLE_S before the dwell, whenever the loop locks."""
    if run.start is None:
        return AVERAGED_START_TICKS
    return START_TICKS + FRAME_TICKS * (frame_count(run.condition.settle_s) - frame_count(LOCK_SETTLE_S))


def settling(run):
    """Frames of a run before its dwell; from power-on SETTLE_S are enough."""
    if run.start is None:
        settle = frame_count(min(run.condition.settle_s, SETTLE_S))
        return (START_TICKS - AVERAGED_START_TICKS) // FRAME_TICKS + settle + run.delay_frames
    return frame_count(LOCK_SETTLE_S) + run.delay_frames


def _profiles(run):
    """Rate (rad/s) and temperature of every frame of a run, and one more."""
    c, settle = run.condition, settling(run)
    rate, temp = c.profile(frame_count(c.seconds) + 3 + MOST_DELAY_FRAMES - run.delay_frames)
    before = np.full(settle, before_dps(c)), np.full(settle, float(c.temperature_degc))
    return np.concatenate([before[0], rate]) * DEG, np.concatenate([before[1], temp])


def run_length_ticks(run):
    """Length of a run, one tick into the frame behind its last: its row holds the last codes."""
    return (settling(run) + frame_count(run.condition.seconds) + MOST_DELAY_FRAMES - run.delay_frames) * FRAME_TICKS + 1


def before_dps(condition):
    """Rate (deg/s) until the dwell begins."""
    return condition.rate_dps if condition.from_dps is None else condition.from_dps


def switched_on(cfg, condition):
    """`Simulation` of a board under a condition, whose registers have just been written."""
    temp, before = condition.temperature_degc, before_dps(condition)
    with DESIGN:
        sim = Simulation(cfg, temp, temp, engine="frame")
        nominal = build.nominal(cfg)
        register_words = dict(build.register_writes(cfg))
    sim.keep_codes = sim.keep_rows = False
    register_words["amplitude_setpoint"] = agc.setpoint(condition.a_um, nominal["v_per_um"], nominal["adc_drive_v"])
    if condition.detune_deg:
        compensation_word = cfg.firmware.phase_words()[0]
        register_words["phase_drive_sine"] = (phase_word(condition.detune_deg) + compensation_word) % TURN
    sim.now = (np.array([before * DEG]), np.array([temp]))
    for name, raw in register_words.items():
        sim.write(name, raw)
    return sim


def power_on(sims, ticks):
    """engine.State of boards that have been switched on under one condition, at a tick: side by side if they may."""
    now, tick_kind_pairs = [sim.now for sim in sims], {(sim.tick, lanes.kind(sim.params)) for sim in sims}
    if len(sims) >= LEAST_LANES and len(tick_kind_pairs) == 1 and tick_kind_pairs.pop()[1] is not None:
        lanes.Lanes(sims).advance(ticks - sims[0].tick, *zip(*now))
    else:
        for sim, (rate, temp) in zip(sims, now):
            sim.advance(ticks - sim.tick, rate, temp)
    return [sim.state for sim in sims]


def _get_cached(cache, key, most, make):
    """The value of a key, made when it is first asked for; of too many the oldest goes."""
    if key not in cache:
        while len(cache) > most:
            cache.pop(next(iter(cache)))
        cache[key] = make()
    return cache[key]


def _is_locked(state):
    return state.fpga.control.sequencer.state == sequencer.LOCKED


def _sure(state, condition):
    """A state that is locked, or ConfigError."""
    if not _is_locked(state):
        raise ConfigError(f"condition {condition.id}: the loops do not lock within {state.tick / TICK_HZ:g} s")
    return state


class Bench:
    """Locked states, parameters and set-ups, made once and kept."""

    def __init__(self, threads=THREADS):
        self.threads = threads
        self._setups, self._locked_states = {}, {}

    def locked_state(self, cfg, condition):
        """engine.State of a board under a condition's first rate, from power-on; made once.

        At START_TICKS, or at twice that if it has not locked before. Raises ConfigError if it has not locked then.
        """
        key = (
            cfg.model_dump_json(),
            condition.a_um,
            before_dps(condition),
            condition.temperature_degc,
            condition.detune_deg,
        )

        def power():
            (state,) = power_on([switched_on(cfg, condition)], START_TICKS)
            if not _is_locked(state):
                # the board of a data sheet may need nearly all of V_q, and comes there slowly
                (state,) = power_on([switched_on(cfg, condition)], 2 * START_TICKS)
            return _sure(state, condition)

        s = _get_cached(self._locked_states, key, MOST_LOCKED, power)
        # the matrix of the next frame is made anew: it may be that of another plant
        s.plant.now[:] = np.inf
        return engine.State(s.fpga, s.chips, plant.copy(s.plant), s.tick, s.drdy_cycle)

    def probe_run(self, run, frames, rate_rad_s):
        """engine.Streams of the frame engine, every tick probed, from the locked state that a run begins from."""
        p, state = _engine_params(run), self.locked_state(run.start, run.condition)
        out = engine.streams(0, frames + 1, 0, frames * FRAME_TICKS, 0)
        rate, temp = np.full(frames + 2, rate_rad_s), np.full(frames + 2, float(run.condition.temperature_degc))
        frame.run(p, sync_switches(p, state), frames * FRAME_TICKS, rate, temp, engine.NO_WRITE, engine.Faults(), out)
        return out

    def setup(self, run, p):
        """baseband Setup of a run; that of its model's configuration is kept, its laws are put in."""
        c = run.condition
        warmth = c.temperature_degc, c.temperature_ramp_k_s, c.seconds if c.temperature_ramp_k_s else 0.0
        key = run.model.config.model_dump_json(include={"firmware", "plant"}), *warmth
        cached_setup = _get_cached(self._setups, key, MOST_SETUPS, lambda: baseband_setup.setup(p))
        turns = p.fpga.design.tick_clocks * cached_setup.word0
        laws = averaged_laws.design(p.plant.effects, p.plant.laws, cached_setup.laws.reference_turns, turns)
        return cached_setup._replace(laws=laws, drive_lsb_v=0.0 if run.smooth else cached_setup.drive_lsb_v)

    def run(self, runs, kind, progress=None, fine=False, lenient=False, take=None):
        """Features of `Run`s.

        kind    EXACT or FAST.  Raises ConfigError where a run leaves the engine's range
        fine    with those of the fine bins behind the others
        lenient None for a run of the averaged plant that leaves its range, instead of the error
        take    function(run, engine.Streams) whose values are wanted instead of the features
        """
        take = take or (lambda run, rows: _features(run, rows.frames, fine))
        start_states = self._begun(runs)
        params = [_engine_params(r) for r in runs] if kind == EXACT else []
        out, simulated_s, total_run_s = [None] * len(runs), 0.0, sum(run_length_ticks(r) for r in runs) / TICK_HZ

        def work(members):
            nonlocal simulated_s
            if kind != EXACT:
                rows = [self._run_baseband(runs[k], start_states[k], lenient) for k in members]
            elif len(members) >= LEAST_LANES:
                rows = _side_by_side([(runs[k], params[k], start_states[k]) for k in members])
            else:
                rows = [_run_single(runs[k], params[k], start_states[k], frame.run) for k in members]
            for k, row in zip(members, rows):
                out[k] = None if row is None else take(runs[k], row)
            simulated_s += sum(run_length_ticks(runs[k]) for k in members) / TICK_HZ
            if progress:
                progress(f"{kind} engine", simulated_s, total_run_s)

        self._run_jobs(work, _lane_groups(runs, params) if kind == EXACT else [[k] for k in range(len(runs))])
        return out

    def _run_baseband(self, run, state, lenient):
        """Rows of a run in the baseband engine; None where it fails and may."""
        try:
            with DESIGN:
                p = _engine_params(run)
                baseband.prepare(p, self.setup(run, p))
            return _run_single(run, p, state, baseband.run)
        except ConfigError:
            if lenient:
                return None
            raise

    def _begun(self, runs):
        """States from which runs begin, each its own copy."""
        power_on_indices, run_states = {}, {}
        for k, r in enumerate(runs):
            if r.start is None:
                power_on_indices.setdefault(r.condition.id, []).append(k)

        def power(members):
            sims = [switched_on(seeded_config(runs[k].model, runs[k].seed), runs[k].condition) for k in members]
            run_states.update(zip(members, power_on(sims, AVERAGED_START_TICKS)))

        self._run_jobs(power, [g[i : i + LANES] for g in power_on_indices.values() for i in range(0, len(g), LANES)])
        locked = ((k, r) for k, r in enumerate(runs) if k not in run_states)
        run_states.update((k, self.locked_state(r.start, r.condition)._replace(tick=begin_tick(r))) for k, r in locked)
        return [run_states[k] for k in range(len(runs))]

    def _run_jobs(self, work, jobs):
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(work, jobs))


def _engine_params(run):
    _, temps = _profiles(run)
    return build.params(seeded_config(run.model, run.seed), float(temps.min()), float(temps.max()))


def _lane_groups(runs, params):
    """Indices of runs in groups of eight that may stand side by side: of one time, one length and one kind of parts."""
    groups = {}
    for k, (r, p) in enumerate(zip(runs, params)):
        groups.setdefault((begin_tick(r), run_length_ticks(r), lanes.kind(p)), []).append(k)
    return [g[i : i + LANES] for g in groups.values() for i in range(0, len(g), LANES)]


def _allocate_streams(run):
    return engine.streams(0, frames_begun(begin_tick(run), run_length_ticks(run)), 0, 0, 0)


def sync_switches(p, s):
    """A state as a board with other references goes on from it: its analog switches follow its own pins.

    An edge that has left one board's pins and not yet the other's would be missed, and a channel inverted for good.
    """
    refs = references.pins(p.fpga.references, s.fpga.references)
    for d in range(plant.DEMODULATORS):
        s.plant.switch[d] = (refs >> d & 1) ^ (s.plant.late_count[d] & 1)
    return s


def _side_by_side(members):
    """Rows of up to eight runs in the lanes engine."""
    members = [(r, p, sync_switches(p, s)) for r, p, s in members]
    ticks = run_length_ticks(members[0][0])
    profiles = [_profiles(r) for r, _, _ in members]
    outs = [_allocate_streams(r) for r, _, _ in members]
    start_states = [s for _, _, s in members]
    group = lanes.Engine([p for _, p, _ in members])
    after = group.run(start_states, ticks, *zip(*profiles), [engine.Faults()] * len(members), outs)
    for s, (r, _, _) in zip(after, members):
        _sure(s, r.condition)
    return outs


def _run_single(run, p, state, play):
    """Rows of a run in an engine by itself; `frame.run` has the bits of the lanes."""
    out = _allocate_streams(run)
    state = sync_switches(p, state)
    after = play(p, state, run_length_ticks(run), *_profiles(run), engine.NO_WRITE, engine.Faults(), out)
    _sure(after, run.condition)
    return out


def _table(run, frames):
    """{stream: its codes} from a run's first frame to the end of its dwell."""
    columns = {name: frames[:, k] for k, (name, _, _) in enumerate(engine.FRAME_COLUMNS)}
    return streams(columns, settling(run) + frame_count(run.condition.seconds))


def dwell_codes(run, frames):
    """{stream: its codes} of a run's dwell."""
    return {name: values[settling(run) :] for name, values in _table(run, frames).items()}


def _features(run, frames, fine):
    return feature_vector(run.condition, dwell_codes(run, frames), lsb_volts(run.model.config), fine)


def with_densities(run, rows):
    """(features with fine ones, densities of the channels) of a run."""
    columns, volts = dwell_codes(run, rows.frames), lsb_volts(run.model.config)
    channel_densities = loop_spectra.densities(columns, frame_count(run.condition.seconds))
    return feature_vector(run.condition, columns, volts, fine=True), channel_densities


def block_means(run, rows):
    """(observables, blocks) means over BLOCK frames each, of settling and dwell; the dwell begins with a block."""
    first = settling(run) % BLOCK
    table, lsb = _table(run, rows.frames), lsb_volts(run.model.config)
    out = []
    for name in NAMES:
        stream = features.OBSERVABLES[name].stream
        values = features.physical(name, table[stream][first:], lsb.get(stream, 1.0))
        values = values[: len(values) // BLOCK * BLOCK]
        out.append((values - values[0]).reshape(-1, BLOCK).mean(axis=1) + values[0])
    return np.array(out)


def features_of_blocks(condition, values):
    """Features, fine ones behind the others, of (observables, blocks) means of a dwell."""
    edges = [e // BLOCK for e in (bins(condition), fine_bins(condition))]
    edges[0][-1] = min(edges[0][-1], values.shape[1])
    return np.concatenate([[features.means(row[: e[-1]], e) for row in values] for e in edges], axis=None)
