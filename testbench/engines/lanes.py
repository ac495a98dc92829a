"""Lanes engine: gyroscopes side by side, eight in the registers of one core, with the bits of the frame engine.

    for each gyroscope    clocked ticks to its first quiet one            frame.enter_block_mode
    blocks of all eight   up to the nearest event of any of them          block_state.ticks_to_event
        each              words, codes, edges                             block_state.advance_control, words_of_ticks
        all together      plants, converters                              side_by_side_top.advance_lanes
        each              frames that the converter has completed         block_state.after_ticks
    for each gyroscope    from the last quiet one: flush, clocked ticks   frame.exit_block_mode

Nothing of a gyroscope depends on which others stand beside it. Each has its own parameters, registers, profiles, noise
and effects; each enters and leaves by itself, so that their converters need not run in step.
Source    docs/architecture.md, docs/decisions/0012-lanes.md
"""

import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor, as_completed

import numpy as np

from analog_frontend import top as plant
from analog_frontend.lanes import side_by_side, side_by_side_adc
from analog_frontend.lanes.side_by_side import ENTRIES, MOVING
from analog_frontend.numeric import arena
from analog_frontend.numeric.records import Kind, split
from analog_frontend.numeric.vector import LANES
from analog_frontend.parts import dac, propagator
from fpga_model.path_clocks import dac_clocks
from testbench import interrupts
from testbench.engines import engine, lane_group, pins
from testbench.engines.lane_group import FAR, GroupChunk, Part, enter_lane, leave_lane, run_lane_blocks
from testbench.errors import ConfigError

CHUNK_TICKS = 1_000_000
STREAMS = ("drive_code", "sense_code", "frames", "truth")


def _entry_jets(tables, clocks, row, out):
    """Jets (knots, 6) of one entry of G at the clocks of the DACs."""
    drive_clock, sense_clock = clocks
    clocked = {
        propagator.DU_DRIVE: (tables.drive_step, drive_clock),
        propagator.DU_SENSE: (tables.sense_step, sense_clock),
        propagator.JIT_DRIVE: (tables.drive_jitter, drive_clock),
        propagator.JIT_SENSE: (tables.sense_jitter, sense_clock),
    }
    if row in clocked:
        table, clock = clocked[row]
        return table[:, :, clock, out]
    return tables.g_jet[:, :, row, out]


def _plant_tables(p, clocks):
    """(moving, still, knots) of a plant, as in Group without its first axis; `clocks` of its DACs."""
    t = p.tables
    moving = np.stack([_entry_jets(t, clocks, *entry) for entry in MOVING], axis=-1)
    still = np.stack([_entry_jets(t, clocks, *entry) for entry in ENTRIES], axis=-1)
    if still[:, 1:].any():
        raise RuntimeError("an entry of a chain follows the rate: lanes would not")
    still = np.concatenate([still[:, 0], t.pickoff.reshape(len(t.pickoff), -1)], axis=1)
    return moving, still, np.stack([t.driver_s, t.kq_n_per_m_per_v2, t.kxy_n_per_m], axis=-1)


def _lane_part(p):
    return Part(
        p.fpga,
        p.plant.adc,
        p.plant.drive_dac,
        p.plant.sense_dac,
        float(p.plant.quad_lsb_v),
        float(p.plant.temp_lo_degc),
        float(p.plant.temp_step_k),
        int(p.plant.temp_count),
    )


def _rows(records):
    """Rows of integers and of floats of up to eight records of one shape; places left over repeat the first."""
    pairs = [split(record) for record in records]
    pairs += pairs[:1] * (LANES - len(pairs))
    return np.array([i for i, _ in pairs], np.int64), np.array([f for _, f in pairs], float).reshape(LANES, -1)


def _pad_tables(tables):
    """One array of tables with different numbers of knots; those behind the last repeat it."""
    most = max(len(table) for table in tables)
    full = [np.concatenate([table, np.repeat(table[-1:], most - len(table), axis=0)]) for table in tables]
    return np.stack(full + full[:1] * (LANES - len(full)))


def _is_unvectorised(params):
    """True for what the registers of eight do not carry: another board, levels, errors of converter or ring, a port."""
    p = params.plant
    levels = p.drive_levels.on or p.sense_levels.on
    return bool(params.fpga.digital or levels or any(p.adc.errors_on) or p.ring.on or p.port.step)


def kind(params):
    """What gyroscopes must have in common to stand side by side: the types of their parts; None for one that cannot."""
    if _is_unvectorised(params):
        return None
    return _types((_lane_part(params), params.plant.effects)), params.fpga.design, dac_clocks(params.fpga)


def _types(item):
    return tuple(map(_types, item)) if isinstance(item, tuple) else isinstance(item, float)


class Engine:
    """Up to eight gyroscopes of the same kinds of parts: the arrays of a group, made once for their parameters.

    params  testbench.engines.engine.Params of each
    """

    def __init__(self, params):
        if not 1 <= len(params) <= LANES:
            raise ValueError(f"lanes: {len(params)} gyroscopes are outside 1 .. {LANES} of a group")
        if any(p.fpga.digital for p in params):
            raise ConfigError('lanes: firmware.board = "digital_sid" is run by the frame engine only')
        if any(p.fpga.control.notch is not None for p in params):
            raise ConfigError("lanes: firmware.notch_hz is run by the other engines only")
        if any(p.fpga.paths is not None for p in params):
            raise ConfigError("lanes: firmware.*_sine_registers, *_code_registers are run by the other engines only")
        if any(p.plant.ring.on for p in params):
            raise ConfigError("lanes: plant.ring_saturation_on = 1 is run by the other engines only")
        if any(_is_unvectorised(p) for p in params):
            raise ConfigError("lanes: levels of a DAC and errors of the converter are run by the frame engine only")
        self.design, self.clocks = params[0].fpga.design, dac_clocks(params[0].fpga)
        if any(p.fpga.design != self.design or dac_clocks(p.fpga) != self.clocks for p in params):
            raise ConfigError("lanes: all gyroscopes of a group need the same [design]")
        self.params = params
        self.part, self.effect = Kind(_lane_part(params[0])), Kind(params[0].plant.effects)
        self.parts_i, self.parts_f = _rows([_lane_part(p) for p in params])
        tables = zip(*(_plant_tables(p.plant, self.clocks) for p in params))
        self.tables = [_pad_tables(table) for table in tables]
        self.floats, self.ints = arena.room(lane_group.AT.sizes)
        self.v = arena.views(side_by_side.SideBySide, side_by_side.AT, self.floats, self.ints)
        self.q = arena.views(lane_group.Group, lane_group.AT, self.floats, self.ints)
        self.a = arena.views(side_by_side_adc.Converters, side_by_side_adc.AT, self.floats, self.ints)
        side_by_side_adc.fill(self.a, [p.plant.adc for p in params])
        self.v.effects_i[:], self.v.effects_f[:] = _rows([p.plant.effects for p in params])
        self.v.clocks[0] = self.design.tick_clocks
        for k, p in enumerate(params):
            self._constants(k, p.plant)

    @property
    def nbytes(self):
        """Bytes of all arrays."""
        group_arrays = (self.floats, self.ints, self.parts_i, self.parts_f, *self.tables)
        return sum(array.nbytes for array in group_arrays)

    def _constants(self, k, p):
        v, n = self.v, p.noise
        pairs = ((n.drive_dac, n.sense_dac), (n.edge_jitter,) * 2, (n.force_x, n.force_y), (n.cv_x, n.cv_y))
        for pair, sources in enumerate(pairs):
            for half, source in enumerate(sources):
                v.sigma[(2 * pair + half) * LANES + k] = source.sigma if source.on else 0.0
                v.flags[pair] |= source.on
            v.keys[2 * pair * LANES + k] = sources[0].key0
            v.keys[(2 * pair + 1) * LANES + k] = sources[0].key1
        v.flags[side_by_side.GLITCHES] |= p.drive_dac.glitch_v_s != 0.0 or p.sense_dac.glitch_v_s != 0.0
        v.flags[side_by_side.FORCE_EFFECTS] |= p.effects.any_force or p.laws.force > 0
        v.flags[side_by_side.CV_EFFECTS] |= p.effects.any_cv or p.laws.cv > 0
        v.flags[side_by_side.LAWS] |= p.laws.force + p.laws.cv > 0
        v.law_counts[k] = p.laws.force, p.laws.cv
        v.law_tables[k], v.law_numbers[k], v.law_temps[k] = p.laws.table, p.laws.numbers, p.laws.temp_ref_degc
        v.law_leads[k] = p.laws.leads
        v.flags[side_by_side.BOWS] |= p.drive_dac.bow != 0.0 or p.sense_dac.bow != 0.0
        carries = (p.tables.drive_carry[0, self.clocks[0]], p.tables.sense_carry[0, self.clocks[1]])
        for which, (part, carry) in enumerate(zip((p.drive_dac, p.sense_dac), carries)):
            numbers = (part.lsb_v, part.offset_v, part.bow, part.full_code, 1.0 / part.full_code)
            for i, number in enumerate(numbers):
                v.dac[(5 * which + i) * LANES + k] = number
            v.carry[2 * which * LANES + k] = float(carry)
            v.carry[(2 * which + 1) * LANES + k] = 1.0 - float(carry)
        for i, name in enumerate(("e1", "e2", "e3", "s1", "s2", "s3")):
            v.sid[i * LANES + k] = getattr(p.sid, name)
        v.sid_numbers[k] = p.sid[: side_by_side.NUMBERS]
        v.sid_inject[k], v.sid_taylor[k] = p.sid.inject, p.sid.taylor
        v.h_s[k], v.r[k], v.taylor[k::LANES] = p.sid.h_s, p.sid.r, p.sid.taylor
        clocks = p.adc.tick_clocks
        v.switch_tau_s[k, :, :clocks], v.switch_carry[k, :, :clocks] = p.switch_tau_s, p.switch_carry
        v.slope_gain[k] = p.slope_gain

    def run(self, states, ticks, rate_rad_s, temp_degc, faults, streams):
        """Advance all by `ticks` from the same tick; lists as long as the group, entries as for engine.run.

        Returns the new states, whose arrays are those of `states`, moved on.
        Raises RuntimeError if a register is not what it must be.
        """
        q, begin = self.q, states[0].tick
        if any(s.tick != begin for s in states):
            raise ValueError("lanes: the gyroscopes of a group are not at the same tick")
        if not all(getattr(o, name).flags.c_contiguous for o in streams for name in STREAMS):
            raise ValueError("lanes: a stream is not contiguous in memory")
        end = begin + ticks
        q.ends[:], q.exit_tick[:], q.entered[:] = end, end, FAR
        chunks, begun = [], []
        for k, (p, s) in enumerate(zip(self.params, states)):
            edges = np.zeros((engine.MAX_EDGES, 2), np.int64)
            chunks.append(engine.Chunk(begin, rate_rad_s[k], temp_degc[k], 0, 0, 0, faults[k], streams[k], edges))
            f, chips, drdy_cycle, tick = enter_lane(
                p, s.fpga, s.chips, s.plant, chunks[k], end, s.drdy_cycle, q.block_states[k], self._buffers(k)
            )
            begun.append((f, chips, drdy_cycle))
            if tick < end:
                q.entered[k], q.exit_tick[k] = tick, -1
                self._load_plant_state(k, s.plant, faults[k])
        count = len(states)
        group_chunk = GroupChunk(
            begin,
            *self.tables,
            *(_stack_lanes(values) for values in (rate_rad_s, temp_degc)),
            np.array([[getattr(o, name).ctypes.data for name in STREAMS] for o in streams], np.int64),
            *(np.array([len(getattr(o, name)) for o in streams], np.int64) for name in ("drive_code", "frames")),
            np.zeros(LANES),
            self.design.frame_ticks,
            self.params[0].rom,
        )
        q.faults[:] = _rows(faults)[0]
        run_lane_blocks(self.part, self.effect, self.parts_i, self.parts_f, self.floats, self.ints, group_chunk)
        after = []
        for k in range(count):
            f, chips, drdy_cycle = begun[k]
            a, failed = states[k].plant, 0
            if q.entered[k] < end:
                self._unload_plant_state(k, a)
                streams[k].peak_x[0] = max(streams[k].peak_x[0], group_chunk.peak_x[k])
                now = q.now.reshape(3, LANES)[:, k].copy()
                f, chips, drdy_cycle, failed = leave_lane(
                    self.params[k], f, chips, a, chunks[k], end, q.block_states[k], q.exit_tick[k], now
                )
            if failed:
                raise RuntimeError(f"lanes engine: the registers of tick {failed} are not those of the clocked engine")
            after.append(engine.State(f, chips, a, end, drdy_cycle))
        return after

    def _buffers(self, k):
        array_by_name = self.q._asdict() | {"edges": self.v.edges}
        return pins.Buffers(*(array_by_name[name][k] for name in pins.Buffers._fields))

    def _load_plant_state(self, k, a, faults):
        """A plant's state into the group."""
        v, q, p = self.v, self.q, self.params[k].plant
        q.z[k], q.caps[k], q.late_area[k] = a.z, a.caps, a.late_area
        for fault, state in zip(faults.nan, (plant.X, plant.Y)):
            if fault:
                q.z[k, state] = np.nan
        v.late_tau_s[k], v.late_count[k], v.switch[k] = a.late_tau_s, a.late_count, a.switch
        self.a.clock[k], self.a.lane_sums[k] = a.adc.clock, a.adc.sums
        q.now.reshape(3, LANES)[:, k] = a.now[:3]
        for which, part in enumerate((p.drive_dac, p.sense_dac)):
            q.acting[k, which] = (_dac_code_from_volts(part, a.volts[which]), a.codes[which])

    def _unload_plant_state(self, k, a):
        """A plant's state out of the group; its matrix is left to `lane_group.leave_lane`."""
        v, q, p = self.v, self.q, self.params[k].plant
        a.z[:], a.caps[:], a.late_area[:] = q.z[k], q.caps[k], q.late_area[k]
        a.late_tau_s[:], a.late_count[:], a.switch[:] = v.late_tau_s[k], v.late_count[k], v.switch[k]
        a.adc.clock[:], a.adc.sums[:] = self.a.clock[k], self.a.lane_sums[k]
        a.cycles[:] = self.clocks
        a.now[:] = np.inf
        for which, part in enumerate((p.drive_dac, p.sense_dac)):
            now, coming = q.acting[k, which].tolist()
            a.volts[which], a.coming_v[which] = dac.volts(part, now), dac.volts(part, coming)
            a.codes[which] = coming


class Lanes:
    """Simulations at the same tick, side by side: `Simulation.advance` for each, with the same results and streams.

    threads  how many groups run at once, a core each; neither they nor the number of groups change any result
    """

    def __init__(self, sims, threads=1):
        count = math.ceil(len(sims) / LANES)
        count = min(len(sims), math.ceil(count / threads) * threads)  # a core without a group would wait
        size = math.ceil(len(sims) / count) if threads > 1 else LANES
        self.threads = threads
        self.groups = [sims[k : k + size] for k in range(0, len(sims), size)]
        self.engines = [Engine([sim.params for sim in group]) for group in self.groups]

    def advance(self, ticks, rate_rad_s, temp_degc, progress=None):
        """Run all by `ticks`. Rates (rad/s), temperatures (degC): a value or an array of frames for each simulation.

        progress  called with the number of a group's first simulation and its ticks so far, in the group's thread
        """
        sims = [sim for group in self.groups for sim in group]
        profiles = [sim.conditions(rate, temp) for sim, rate, temp in zip(sims, rate_rad_s, temp_degc, strict=True)]
        stop = threading.Event()
        first, jobs = 0, []
        for engine_, sims in zip(self.engines, self.groups):
            jobs.append((engine_, sims, first, ticks, profiles[first : first + len(sims)], progress, stop))
            first += len(sims)
        if self.threads == 1:
            for job in jobs:
                _advance(*job)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            try:
                for future in as_completed([pool.submit(_advance, *job) for job in jobs]):
                    future.result()
            except BaseException:
                stop.set()
                raise


def _advance(engine_, sims, first, ticks, profiles, progress, stop):
    """One group by `ticks`, or to the end of the chunk in which `stop` is set."""
    elapsed_ticks = 0
    while elapsed_ticks < ticks and not stop.is_set():
        step = min(CHUNK_TICKS, ticks - elapsed_ticks)
        frame_ticks = engine_.design.frame_ticks
        begun = sims[0].tick // frame_ticks - (sims[0].tick - elapsed_ticks) // frame_ticks
        rates, temps, streams = zip(
            *(
                sim.chunk(step, rate[min(begun, len(rate) - 1) :], temp[min(begun, len(temp) - 1) :])
                for sim, (rate, temp) in zip(sims, profiles)
            )
        )
        started = time.perf_counter()
        with interrupts.defer_interrupts():
            states = engine_.run([sim.state for sim in sims], step, rates, temps, [sim.faults for sim in sims], streams)
        spent = (time.perf_counter() - started) / len(sims)
        for sim, state, stream in zip(sims, states, streams):
            sim.seconds_spent += spent
            sim.commit_chunk(state, stream)
        elapsed_ticks += step
        if progress:
            progress(first, elapsed_ticks)


def _stack_lanes(items):
    """(8, ...) of up to eight arrays; places left over repeat the first."""
    return np.stack([np.ascontiguousarray(item) for item in items] + [items[0]] * (LANES - len(items)))


def _dac_code_from_volts(part, volts):
    """The code of an output voltage."""
    nominal_code = round((volts - part.offset_v) / part.lsb_v)
    reach = 1 + int(abs(part.bow) * part.full_code)
    for code in range(nominal_code - reach, nominal_code + reach + 1):
        if dac.volts(part, code) == volts:
            return code
    raise RuntimeError(f"lanes: no DAC code gives the output {volts} V")
