"""Free decay of a mode, power over time in dBm: dP/dt = -g P - sum of laws, P in uW.

    nuisances   level (dBm) and rate g (1/s) of each fitted run           local unknowns of a judged run: the same two
    laws        -c P^2 (force x^2 vx), -c P^1.5 (|vx| vx), -c P^0.5 (sgn vx), -c P^3 (x^4 vx)         force_x, plant
                power added by the receiver, its compression, bias of its logarithm                  instrument
                second mode, rate that drifts with time                                              preparation
The averages over a period of the plant's force laws: F = -d x^2 vx gives dA/dt = -(d/8m) A^3, and P goes with A^2.
Stretch that decays: found in the data; what stands before it (drive on), behind it (floor) and at steps of the
receiver is named in the notes and left out.   Source    docs/measured_results.md
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from fpga_model.jit import kernel
from testbench.errors import FileError
from testbench.measured.formats import load_matching_files, ringdown_text
from testbench.measured.models.row_noise import turns
from testbench.measured.models.working import Working
from testbench.measured.parts.part import Part, Piece
from testbench.measured.parts.ringdown_stretch import (
    DB,
    LEAST_NOISE_DB,
    background,
    jumps,
    noise,
    running_median,
    stretch,
)
from testbench.measured.quality.rows import series
from testbench.tracing.problem.problem import Law, Nuisance

UW_DBM = -30.0
LEAST_LN = 60.0  # of ln P: what leaves it has gone wrong and stays there
BLOCKS = 12  # of a judged run: even ones set up, odd ones are scored
FEWEST, LEAST_DB = 100, 6.0  # samples and fall of a decay
CLEAR_DB = 10.0  # above the background: what is used
CLEAR_SD_DB = 2 * DB * np.sqrt(10 ** (-CLEAR_DB / 10) / 2)  # of power so far above a background: sd 2 DB sqrt(N / 2 P)
EXPONENTS = {"damping_cubic": 2.0, "damping_quadratic": 1.5, "coulomb_friction": 0.5, "damping_quintic": 3.0}
NAMES = tuple(EXPONENTS)


class Run(NamedTuple):
    """Instants (s) from the first of the stretch."""

    t_s: np.ndarray
    sample: str
    number: str


@kernel
def _integrate_log_power(t, log_p, g, drift, c, exponents, out):
    """ln P at instants t by Runge-Kutta 4 on d(ln P)/dt = -g (1 + drift (t/T - 1/2)) - sum c P^(n - 1)."""
    y, span = log_p, t[-1] - t[0] if len(t) > 1 else 1.0
    for i in range(len(t)):
        out[i] = y
        if i + 1 == len(t):
            break
        steps = 2
        h = (t[i + 1] - t[i]) / steps
        for j in range(steps):
            at = t[i] + j * h - t[0]
            k0 = 0.0
            total = 0.0
            for stage in range(4):
                shift = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
                v = min(max(y + shift * k0, -LEAST_LN), LEAST_LN)
                r = -g * (1.0 + drift * ((at + shift) / span - 0.5))
                for n in range(len(c)):
                    if c[n] != 0.0:
                        r -= c[n] * np.exp((exponents[n] - 1.0) * v)
                k0 = r
                total += r * (2.0 if stage == 1 or stage == 2 else 1.0)
            y = min(max(y + h * total / 6.0, -LEAST_LN), LEAST_LN)


def power_dbm(t_s, level_dbm, rate_per_s, effects):
    """Power (dBm) at instants (s) of a mode that begins at a level and decays at a rate, with laws."""
    out = np.empty(len(t_s))
    c = np.array([effects.get(name, 0.0) for name in NAMES])
    exponents = np.array([EXPONENTS[name] for name in NAMES])
    start = (level_dbm - UW_DBM) / DB
    _integrate_log_power(
        np.ascontiguousarray(t_s), start, rate_per_s, effects.get("rate_drift", 0.0), c, exponents, out
    )
    second, added = effects.get("second_mode", 0.0), effects.get("added_power", 0.0)
    if second or added:
        p = np.exp(out)
        p = p + second * np.exp(start - 3.0 * rate_per_s * (t_s - t_s[0])) + added * 1e-3
        out = np.log(np.maximum(p, 1e-12))
    squeeze = effects.get("compression", 0.0)
    if squeeze:
        out = out - np.log1p(squeeze * np.exp(out))
    y = UW_DBM + DB * out
    bias = effects.get("log_bias", 0.0)
    return y + bias * (y - level_dbm) ** 2 if bias else y


def _decay_laws(power_uw, rate, power_unit="uW"):
    u = power_unit if power_unit == "uW" else f"({power_unit})"

    def force(name, n, words):
        half = 2 * (n - 1)
        unit = f"1/(s {power_unit})" if n == 2 else f"1/(s {u}^{n - 1:g})" if n > 1 else f"{u}^0.5/s"
        law_text = f"{words}: dP/dt = -c P^{n:g}; force grows with power {half + 1:g} of the amplitude"
        page = "docs/measured_results.md" if name == "damping_quintic" else f"analog_frontend/effects/{name}.py"
        return Law(name, "force_x", law_text, unit, float(rate * power_uw ** (1 - n)), 1, page=page)

    return (
        force("damping_cubic", 2.0, "damping that grows with the square of the amplitude, F = -d x^2 vx"),
        force("damping_quadratic", 1.5, "damping that grows with the amplitude, F = -d |vx| vx"),
        force("coulomb_friction", 0.5, "dry friction, F = -d sgn vx"),
        force("damping_quintic", 3.0, "damping that grows with the fourth power of the amplitude, F = -d x^4 vx"),
        Law(
            "added_power",
            "detector",
            "power that the receiver adds",
            "nW" if power_unit == "uW" else f"1e-3 {power_unit}",
            1.0,
            sign=1,
            kind="instrument",
        ),
        Law(
            "compression",
            "detector",
            "receiver that saturates",
            f"1/{power_unit}",
            float(0.3 / power_uw),
            1,
            kind="instrument",
        ),
        Law("log_bias", "detector", "curvature of the logarithmic detector", "dB/dB^2", 1e-3, kind="instrument"),
        Law(
            "second_mode",
            "preparation",
            "second mode, also excited, that decays three times as fast",
            "1",
            0.3,
            1,
            kind="preparation",
        ),
        Law("rate_drift", "preparation", "decay rate that drifts over the record", "1", 0.1, kind="preparation"),
    )


class Ringdown(Part):
    """The problem; `Piece.data` is a `Run`, rows in dBm."""

    unit, observable = "dB", "power"

    def model(self, piece, values, effects, local):
        return power_dbm(piece.data.t_s, local[0], local[1], effects)

    def abscissa(self, piece):
        return piece.data.t_s, "time (s)"

    def locate(self, piece, values, effects):
        """Level and rate: nuisances of a fitted run, else least squares on the setup rows."""
        if piece.role == "fit":
            return values[f"level_{piece.data.number}"], float(np.exp(values[f"ln_rate_{piece.data.number}"]))
        t, y, used, its = piece.data.t_s, piece.rows, piece.setup, piece.noise.select_rows(piece.setup)

        def whitened_residual(local):
            return its.whiten((y - power_dbm(t, local[0], float(np.exp(local[1])), effects))[used])

        # the rate of the fitted runs of the sample: one from this run's slope could end the decay too early
        local = np.array([y[0], np.mean([v for name, v in values.items() if name.startswith("ln_rate_")])])
        now, damping = whitened_residual(local), 0.0
        for _ in range(40):
            j = np.column_stack([(whitened_residual(local + e) - now) / 1e-5 for e in np.eye(2) * 1e-5])
            if not np.all(np.isfinite(j)):
                break
            size = np.linalg.norm(j, axis=0)
            rows = np.concatenate([j, np.diag(np.sqrt(damping) * size)])
            step = -np.linalg.lstsq(rows, np.concatenate([now, np.zeros(2)]), rcond=None)[0]
            tried = whitened_residual(local + np.clip(step, [-5.0, -1.0], [5.0, 1.0]))
            if tried @ tried <= now @ now:
                local, now, damping = local + np.clip(step, [-5.0, -1.0], [5.0, 1.0]), tried, damping / 10
                if np.max(np.abs(step)) < 1e-9:
                    break
            else:
                damping = max(10 * damping, 1e-3)
        return local[0], float(np.exp(local[1]))


def _select_decay(trace, background_dbm):
    """(first, end, `Noise`) of the part of a run that is a decay clear of its background; FileError if it is short."""
    p, t = trace.power_dbm, trace.x
    a, b = stretch(p)
    if background_dbm is not None:  # nearer to it P is no longer signal with a small error
        b = _until(a, b, running_median(p)[a:b] < background_dbm + CLEAR_DB)
    while True:
        fall = p[a] - p[b - 1] if b > a else 0.0
        if b - a < FEWEST or fall < LEAST_DB:
            shortfall_text = (
                f"{b - a} samples decay by {fall:.1f} dB, expected at least {FEWEST} samples and {LEAST_DB:g} dB"
            )
            raise FileError(f"{trace.path}: {shortfall_text}")
        its = noise(t[a:b], p[a:b])
        if its is None:
            raise FileError(
                f"{trace.path}: the decay has no noise above {LEAST_NOISE_DB:g} dB; expected measured power"
            )
        its = its._replace(white_sd=max(its.white_sd, series.rounding_noise(p)))
        end = _until(a, b, its.sd > CLEAR_SD_DB)
        if end == b:
            return a, b, its
        b = end


def _until(a, b, too_low):
    return a + int(np.argmax(too_low)) if np.any(too_low) else b


def piece_from_trace(trace, fitted, background_dbm=None):
    """`Piece` of a run, and notes on what was left out."""
    t, p = trace.x, trace.power_dbm
    a, b, its = _select_decay(trace, background_dbm)
    number = trace.header.get("measurement id", "") or "run"
    notes = []
    if a:
        notes.append(f"{number}: first {t[a] - t[0]:.2f} s do not decay freely (drive on): left out")
    if b < len(t):
        steps = [i for i in jumps(p) if i > b]
        what = f", with a step of the receiver at {t[steps[0]]:.2f} s" if steps else ""
        notes.append(f"{number}: from {t[b - 1]:.2f} s on too near the background{what}: left out")
    t, p = t[a:b] - t[a], p[a:b]
    if fitted:
        scored, setup = np.arange(len(t)), np.arange(0)
    else:
        setup, scored = turns(len(t), BLOCKS)
    name = f"run_{number}"
    condition = {"level_dbm": float(p[0])}
    role = "fit" if fitted else "validate"
    return Piece(name, role, p, scored, setup, its, its.rms, Run(t, trace.sample, number), condition), notes


def _with_distinct_names(traces):
    numbers = [trace.header.get("measurement id", "") or "run" for trace in traces]
    names = [n if numbers.count(n) == 1 else f"{n}-{k}" for k, n in enumerate(numbers, 1)]
    if len(set(names)) < len(names):
        names = [f"{n}-{k}" for k, n in enumerate(numbers, 1)]
    return [trace._replace(header=trace.header | {"measurement id": n}) for trace, n in zip(traces, names)]


def problem(traces):
    """`Ringdown` of the runs of one sample, in the order of their dates: first, third .. are fitted, the others judged.

    A single run is split in time: its even blocks are fitted, its odd ones judged.
    """
    from testbench.measured.formats.registry import file_sha256

    traces = sorted(traces, key=lambda trace: (trace.header.get("date and time", ""), file_sha256(trace.path)))
    traces = _with_distinct_names(traces)
    power_units = sorted({trace.header.get("power unit", "uW") for trace in traces})
    if len(power_units) > 1:
        raise FileError(f"{traces[0].path}: runs in {' and '.join(power_units)}; give all in one unit")
    (power_unit,), pieces, notes = power_units, [], []
    levels = [v for v in (background(trace.power_dbm) for trace in traces) if v is not None]
    level = min(levels, default=None)
    if level is not None:
        amplitude_text = f"{level - UW_DBM:.1f} dB of 1 {power_unit}"
        notes.append(f"background power: {f'{level:.1f} dBm' if power_unit == 'uW' else amplitude_text}")
    if len(traces) == 1:
        piece, piece_notes = piece_from_trace(traces[0], False, level)
        notes += piece_notes
        pieces = [
            piece._replace(name=piece.name + "_even", role="fit", scored=piece.setup),
            piece._replace(name=piece.name + "_odd"),
        ]
    else:
        for k, trace in enumerate(traces):
            piece, piece_notes = piece_from_trace(trace, k % 2 == 0, level)
            pieces.append(piece)
            notes += piece_notes
    nuisances = []
    for piece in (p for p in pieces if p.role == "fit"):
        slope = np.polyfit(piece.data.t_s, piece.rows, 1)[0]
        number = piece.data.number
        nuisances.append(Nuisance(f"level_{number}", "dBm", float(piece.rows[0]), 3.0, 1e-4))
        nuisances.append(Nuisance(f"ln_rate_{number}", "1", float(np.log(-slope / DB)), 1.0, 1e-5))
    rate = np.exp(np.median([n.value for n in nuisances[1::2]]))
    power = 10 ** ((np.median([p.rows[0] for p in pieces]) - UW_DBM) / 10)
    hashes = {f"record_{i + 1}": file_sha256(trace.path) for i, trace in enumerate(traces)}
    ringdown_problem = Ringdown(
        f"ring-down {traces[0].sample}", nuisances, _decay_laws(power, rate, power_unit), pieces, hashes, notes
    )
    ringdown_problem.heldout_independent = len(traces) > 1
    f = traces[0].frequency_hz if np.isfinite(traces[0].frequency_hz) else 1.0
    largest = max(10 ** ((piece.rows[0] - UW_DBM) / 10) for piece in pieces)
    ringdown_problem.working = Working("ringdown", float(np.sqrt(largest)), f, float(2 * np.pi * f / rate))
    return ringdown_problem


def load(paths):
    """`ringdown_text.Trace`s of the files that are ring-downs."""
    return [trace for _, trace in load_matching_files(paths, ringdown_text) if trace.kind == "ringdown"]


def jobs(paths):
    """[(label, paths, options)]: the runs of each sample, as their headers say; samples with most runs first."""
    groups = {}
    for trace in load(paths):
        groups.setdefault(trace.sample or trace.path, []).append(Path(trace.path))
    return [(name, chosen, {}) for name, chosen in sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))]


def opener(paths, options):
    """`Problem` of ring-downs of one sample; None if the files are others."""
    traces = load(paths)
    if not traces or len(traces) != len(paths):
        return None
    samples = sorted({trace.sample for trace in traces})
    if len(samples) > 1:
        raise FileError(
            f"{paths[0]}: runs of {len(samples)} samples ({', '.join(samples)}); trace one sample at a time"
        )
    return problem(traces)
