"""A gyrorec record as a problem of tracing: its fitted and held-out dwells, its priors, its own model.

    condition   segments of one repeat group: set-points from /segments, the rate before from /stimulus/rate
    settling    at least LEAST_SETTLE_S of lock without a change before a dwell, because the model begins from a locked
                state of its own; a power-on may have several dwells
    firmware    R0 is replayed first: a record whose firmware is not the model's is not traced (verdict "firmware");
                words that were not recorded are those of the replay

Source    docs/measured.md
"""

import math
import os

import numpy as np

from fpga_model import agc, cordic, registers, sequencer
from fpga_model.rates import FRAME_CYCLES, TICK_HZ
from testbench.config import phase_word
from testbench.errors import ConfigError
from testbench.measured.closed_loop import loop_laws, loop_problem, loop_runs, loop_spectra
from testbench.measured.importing import firmware_words
from testbench.measured.quality.records import adc_codes, dac_range
from testbench.measured.record import check_tables, load_record, schema
from testbench.measured.record.meaning_segments import SETPOINTS, Stated, bank, rate_limit, temp_limit
from testbench.measured.record.recording_plan import Condition
from testbench.measured.record.sessions import segments, sessions
from testbench.measured.residual import features, parameters
from testbench.run import build
from testbench.storage.hdf5_input import is_hdf5, open_hdf5
from testbench.storage.record import SCHEMA

FRAME_HZ = 8000
MODELLED = ("control", "phase_sense_sine", "phase_drive_ref", "phase_sense_ref")  # as the configuration has them
LEAST_SETTLE_S = 2.0
TIME_S = 0.1  # in which times from power-on are told apart: power-ons of a condition lock at slightly other times


def is_record(path):
    """True if the content is a closed-loop record."""
    if os.path.isdir(path):
        return os.path.exists(path / "record.json")
    if not is_hdf5(path):
        return False
    with open_hdf5(path) as file:
        return str(file.attrs.get("schema", "")).startswith(SCHEMA.partition("/")[0]) and "segments" in file


def _before(record, edge):
    """Rate (deg/s) just before an edge."""
    table = record.tables["stimulus/rate"]
    edges, rates = table["edge"].data, table["rate"].data
    return float(rates[max(0, int(np.searchsorted(edges, edge, side="left")) - 1)])


def calm_from(record, first):
    """Frame from which on, up to frame `first`, the loops are locked and neither rate nor set-points change."""
    end, rate = first * FRAME_CYCLES, Stated(record, "rate")
    rows = rate.row(end)
    changes = [
        rate.edges[k]
        for k in range(1, rows + 1)
        if abs(rate.values[k] - rate.values[k - 1]) > max(rate_limit(rate, k), rate_limit(rate, k - 1))
    ]
    written = schema.rows(record.tables["registers"], "edge", "name")
    changes += [edge for edge, name in written if name in SETPOINTS and edge < end]
    changes += [edge for edge in record.tables["power_on"]["edge"].data if edge < end]
    calm = -(-max(changes, default=0) // FRAME_CYCLES)
    if "state" in record.streams:
        lost = np.flatnonzero(record.streams["state"].data[:first] != sequencer.LOCKED)
        return max(calm, int(lost[-1]) + 1 if len(lost) else 0)
    settles = [s.first for s in segments(record) if s.kind == "settle" and s.first + s.frames == first]
    return max(calm, settles[0] if settles else first)


def setpoints(record, model, s):
    """(amplitude in um, detuning in deg) of a segment: as stated, where the registers are those to the last bit.

    Else what the registers hold: a stated set-point of three digits would be taken for an effect. ConfigError for
    other registers that the model does not set.
    """
    recorded_registers = bank(record, (s.first + s.frames) * FRAME_CYCLES)
    model_registers = registers.State()._asdict() | dict(build.register_writes(model))
    for name in MODELLED:
        if name in recorded_registers and recorded_registers[name][0] != model_registers[name]:
            raw, source = recorded_registers[name]
            raise ConfigError(
                f"{source}: {name} = {raw}, but the configuration of the model sets {model_registers[name]}"
            )
    a_um, detune, nominal = float(s.a_set), float(s.detune), build.nominal(model)
    raw = recorded_registers.get("amplitude_setpoint", (None,))[0]
    if raw not in (None, agc.setpoint(a_um, nominal["v_per_um"], nominal["adc_drive_v"])):
        a_um = raw / (nominal["v_per_um"] / nominal["adc_drive_v"] * 2**23 * float(cordic.gain()))
    raw, model_phase_word = recorded_registers.get("phase_drive_sine", (None,))[0], model.firmware.phase_words()[0]
    if raw not in (None, (phase_word(detune) + model_phase_word) % loop_runs.TURN):
        detune = math.remainder((raw - model_phase_word) / loop_runs.TURN, 1.0) * 360
    return a_um, detune


def _course(record, s, quantity):
    """(value at a segment's begin, its change per second) by /stimulus; ConfigError if it is no straight line."""
    stated, begin = Stated(record, quantity), s.first * FRAME_CYCLES
    end = begin + s.frames * FRAME_CYCLES
    rows = stated.rows_between(begin, end)
    limit = (rate_limit if quantity == "rate" else temp_limit)(stated, rows[-1])
    if len(rows) < 2 or stated.observed_range(rows) <= limit:
        return float(s.rate_set if quantity == "rate" else s.temp_set), 0.0
    edges = np.clip([*stated.edges[rows.start : rows.stop], end], begin, end)
    middle_s = ((edges[1:] + edges[:-1]) / 2 - begin) / (FRAME_CYCLES * FRAME_HZ)
    values = stated.values[rows.start : rows.stop]
    slope, value = np.polyfit(middle_s, values, 1, w=np.sqrt(np.diff(edges)))
    off = float(np.abs(value + slope * middle_s - values).max())
    if off > limit:
        raise ConfigError(
            f"{stated.path}: deviates by {off:.3g} from a straight line in segment {s.id}, limit {limit:.3g}; tracing "
            "needs constant or ramped conditions in a dwell"
        )
    return float(value), float(slope)


def measured_features(record, name, hashes):
    """`loop_problem.Measured` of the segments with a role."""
    per_frame = {key: s.data for key, s in record.streams.items() if (s.num, s.den) == schema.PER_FRAME}
    features.demand(per_frame, loop_runs.NAMES)
    model = check_tables.stated_config(record)
    lsb = schema.lsb_volts(model.device())
    lsb |= {key: s.attrs["lsb_V"] for key, s in record.streams.items() if "lsb_V" in s.attrs}
    groups, values = {}, {}
    for s in segments(record):
        if s.role not in ("fit", "validate"):
            continue
        settle = (s.first - calm_from(record, s.first)) / FRAME_HZ
        if settle < LEAST_SETTLE_S:
            raise ConfigError(
                f"/segments {s.id}: settles for {settle:g} s, tracing needs {LEAST_SETTLE_S:g} s; raise settle_s in "
                "the plan"
            )
        before = _before(record, s.first * FRAME_CYCLES)
        a_um, detune_deg = setpoints(record, model, s)
        (rate, ramp_dps_s), (temp, ramp_k_s) = (_course(record, s, name) for name in ("rate", "temperature"))
        c = Condition(
            s.repeat_group, a_um, rate, before, temp, detune_deg, loop_runs.SETTLE_S, s.frames / FRAME_HZ, s.role,
            rate_ramp_dps_s=ramp_dps_s, temperature_ramp_k_s=ramp_k_s,
        )  # fmt: skip
        groups[c.id] = c._replace(seconds=min(c.seconds, groups.get(c.id, c).seconds))
        values.setdefault(c.id, []).append(s)
    for name, members in values.items():
        groups[name] = groups[name]._replace(settle_s=_settle_s(record, members))

    if "fit" not in {c.role for c in groups.values()}:
        raise ConfigError("/segments: no segment has the role fit, tracing needs one or more")
    for c in groups.values():
        if loop_runs.frame_count(c.seconds) < loop_runs.FINE:
            raise ConfigError(
                f"/segments {c.id}: {c.seconds:g} s, tracing needs {loop_runs.FINE / FRAME_HZ:g} s or more"
            )

    def columns(s):
        return {name: data[s.first : s.first + s.frames] for name, data in per_frame.items()}

    def compute_features(c, s):
        return loop_runs.feature_vector(c, columns(s), lsb, fine=True)

    out = {key: np.array([compute_features(groups[key], s) for s in members]) for key, members in values.items()}
    channel_densities = {
        key: [loop_spectra.densities(columns(s), loop_runs.frame_count(groups[key].seconds)) for s in members]
        for key, members in values.items()
    }
    return loop_problem.Measured(name, tuple(groups.values()), out, hashes, channel_densities)


def _settle_s(record, members):
    """Seconds from `loop_runs.START_TICKS` of a power-on to the dwells of a group, in TIME_S; laws may depend on it.

    `loop_runs.SETTLE_S` where a record begins later than its power-on.
    """
    powered = [x for x in sessions(record) if x.powered]
    begun = [max((x.first for x in powered if x.first <= s.first), default=None) for s in members]
    if None in begun:
        return loop_runs.SETTLE_S
    after_s = np.mean([s.first - first for s, first in zip(members, begun)]) / FRAME_HZ
    return round(TIME_S * round((after_s - loop_runs.START_TICKS / TICK_HZ) / TIME_S), 6)


def has_independent_holdout(record):
    """True if no power-on has both fitted and held-out segments: what is held out is of another session."""
    starts = [s.first for s in sessions(record)]
    power_ons_by_role = {role: {np.searchsorted(starts, s.first, "right") for s in segments(record) if s.role == role}
          for role in ("fit", "validate")}  # fmt: skip
    return not power_ons_by_role["fit"] & power_ons_by_role["validate"]


def open_record(paths, options, calibrated=None, bench=None, loop_cache=None):
    """`LoopProblem` of one record, or None if the content is no record. Options: grammar = no, threads = N.

    calibrated  function(data, model, record, bench) -> (model, parameters, lines) from priors that are too wide for a
                linear model, or None: the record's priors are narrow
    bench, loop_cache  of `loop_problem`, shared by many records under the same conditions
    """
    if len(paths) != 1 or not is_record(paths[0]):
        return None
    loaded = load_record.load(paths[0])
    if not schema.has_supported_map(loaded.record):
        text = "regmap_sha256 belongs to another firmware, but tracing simulates this one"
        raise ConfigError(f"{paths[0]}: {text}; use gyro measured residuals --kind R1, or gyro measured calibrate")
    record, lacking = firmware_words.complete_record(loaded.record)
    model = check_tables.stated_config(record)
    hashes = {"record": record.attrs.get("content_sha256", ""), "roles": record.attrs.get("roles_sha256", "")}
    data = measured_features(record, paths[0].name, hashes)
    library = () if options.get("grammar") == "no" else loop_laws.from_grammar()
    bench = bench or loop_runs.Bench(int(options.get("threads", loop_runs.THREADS)))
    calibration = calibrated(data, model, record, bench) if calibrated else None
    model, nuisances, lines = calibration or (model, parameters.read_parameters(record), ())
    problem = loop_problem.LoopProblem(data, model, nuisances, loop_laws.from_catalogue(), library, bench, loop_cache)
    quality = tuple(str(f) for of in (adc_codes, dac_range) for f in of.findings(record))
    problem.warnings = (
        *loaded.warnings,
        *quality,
        *((f"firmware words are not replayed: {lacking}",) if lacking else ()),
        *lines,
    )
    problem.heldout_independent = has_independent_holdout(record)
    if loaded.is_blocked:
        problem.firmware = next(str(f) for f in loaded.findings if f.rule == "R16")
    r0 = loaded.residual
    problem.firmware_certificate = {"decidable": bool(r0.decidable), "first": str(r0.first) if r0.first else None}
    return problem
