"""R1 and R2: what a model of the plant leaves unexplained, per segment and observable, in units of the repeats' noise.

    R1   recorded words -> plant -> ADC codes        open loop: no loop colours the difference
    R2   set-points, rate, temperature -> loop -> every observable: the user's error

The floor is that of the differences between repeats. chi2 / bins of the mean over the repeats is about 1 where the
model lacks nothing. R1 is predicted without noise. R2 is not: without it the loops find their lock another way, which
shows for half a second; so it is the mean of some draws of the model's own noise, whose share is counted.
Source    docs/measured.md
"""

from typing import NamedTuple

import numpy as np

from testbench.errors import ConfigError
from testbench.measured.record import check_tables, firmware_residual, schema
from testbench.measured.record.sessions import segments, sessions
from testbench.measured.residual import simulator
from testbench.measured.residual.features import OBSERVABLES, bins, demand, features
from testbench.measured.residual.noise_floor import Group, estimate_noise_floor
from testbench.run import build

DRAWS, FIRST_DRAW = 4, 10**12  # seeds that no recording has


class Row(NamedTuple):
    """One observable of one condition."""

    group: str
    role: str
    observable: str
    unit: str
    repeats: int
    bins: int
    floor: float  # rms of the noise of the difference
    rms: float  # of recorded less predicted, means over the repeats
    chi2_per_bin: float


class Study(NamedTuple):
    """Residuals of a record."""

    kind: str  # R1 or R2
    engine: str
    exact_words: bool  # R1: its words are those of the firmware, to the clock
    draws: int  # of the model's noise in the prediction; 0: without noise
    dof: int  # deviations that the floor rests on
    rows: tuple
    groups: tuple  # recorded less predicted, as `noise_floor.Group`
    roles: dict


def predict_sessions(record, config, kind, engine, draws, progress=None, exact=None):
    """[[{stream: codes}, one for each draw] of each session], and whether the words of R1 are exact.

    exact  None: found out by a replay of the firmware
    """
    firmware = build.firmware(config)
    models = [simulator.reseed_noise(config, FIRST_DRAW + k) for k in range(draws)] or [simulator.quiet(config)]
    exact = kind == "R1" and (sound(record) if exact is None else exact)
    out, prediction_cache, record_sessions = [], {}, sessions(record)
    for k, session in enumerate(record_sessions):
        if kind == "R1":
            drive = simulator.drive(record, session, firmware, exact)
            codes = [engine.driven_codes(model, drive) for model in models]
            out.append([dict(zip(("adc_xI", "adc_xQ", "adc_yI", "adc_yQ"), c.T)) for c in codes])
        else:
            # repeats that were told the same have one prediction
            task = simulator.task(record, session)
            key = b"".join(np.asarray(item).tobytes() for item in task)
            if key not in prediction_cache:
                prediction_cache[key] = [engine.free(model, task) for model in models]
            out.append(prediction_cache[key])
        if progress:
            progress(f"{kind}, {engine.name} engine", k + 1, len(record_sessions))
    return out, exact


def sound(record):
    """True if the firmware replays to 0 LSB: its words are then known to the clock."""
    replay_residual = firmware_residual.residual(record)
    return replay_residual.decidable and replay_residual.first is None


def study_residuals(record, kind, config=None, engine=None, draws=None, progress=None):
    """`Study` of a checked record.

    kind    "R1" or "R2"
    config  the model; None: that of the record
    engine  a `simulator.Simulator`; None: the frame engine
    draws   of the model's noise; None: DRAWS for R2, none for R1
    """
    if kind not in ("R1", "R2"):
        raise ValueError(f"kind = {kind!r}, expected R1 or R2")
    names = [name for name, o in OBSERVABLES.items() if o.driven or kind == "R2"]
    demand(record.streams, names)
    if kind == "R2" and not schema.has_supported_map(record):
        raise ConfigError("R2: regmap_sha256 belongs to another firmware, but R2 simulates this one; use --kind R1")
    config = config or check_tables.stated_config(record)
    engine = engine or simulator.FrameSimulator()
    draws = (DRAWS if kind == "R2" else 0) if draws is None else draws
    predicted, exact = predict_sessions(record, config, kind, engine, draws, progress)
    groups, roles = differences(record, predicted, names)
    noise, rows = estimate_noise_floor(groups), []
    for g in groups:
        mean, repeats = g.values.mean(axis=0), len(g.values)
        share = 1 / repeats + (1 / draws if draws else 0.0)
        white = noise.whiten_group(g.name, mean) / np.sqrt(share)
        for k, name in enumerate(names):
            sigma = noise.sigma[g.name][k] * np.sqrt(share)
            rows.append(
                Row(
                    g.name,
                    roles[g.name],
                    name,
                    OBSERVABLES[name].unit,
                    repeats,
                    len(g.widths),
                    float(np.sqrt(np.mean(sigma**2))),
                    float(np.sqrt(np.mean(mean[k] ** 2))),
                    float(np.mean(white[k] ** 2)),
                )
            )
    return Study(kind, engine.name, exact, draws, noise.dof, tuple(rows), tuple(groups), roles)


def differences(record, predicted, names):
    """([Group], {group: role}): recorded less predicted features of every segment that is fitted or held out."""
    lsb_v = {name: c.attrs["lsb_V"] for name, c in record.streams.items() if "lsb_V" in c.attrs}
    recorded = {name: c.data for name, c in record.streams.items()}
    record_sessions, rows, roles = sessions(record), {}, {}
    for segment in segments(record):
        if segment.role == "none":
            continue
        k = max(i for i, s in enumerate(record_sessions) if s.first <= segment.first)
        rows.setdefault(segment.repeat_group, []).append((segment, k))
        roles[segment.repeat_group] = segment.role
    groups = []
    for name, members in rows.items():
        frames = min(segment.frames for segment, _ in members)
        values = []
        for segment, k in members:
            have = features(recorded, lsb_v, names, segment.first, frames)
            begin = segment.first - record_sessions[k].first
            want = [features(codes, lsb_v, names, begin, frames) for codes in predicted[k]]
            values.append(have - np.mean(want, axis=0))
        groups.append(Group(name, np.stack(values), np.diff(bins(frames))))
    return groups, roles
