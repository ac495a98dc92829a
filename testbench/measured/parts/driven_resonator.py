"""A resonator driven by an arbitrary voltage, input and output sampled: free-run against the measured output.

    nuisances   f, ln Q, ln gain (static, V/V), offsets of input and output          initial state: setup rows
    laws        force_x: products of x, vx, u (relative to the stiffness)            plant
                output: cubic, square, feedthrough, skew                             instrument
                gain and frequency that drift with time                              preparation
Noise comes from what a periodic input repeats, in this record or in a further one of the same part; without any, from
the output where the input has no power. It is taken as white: its spectrum falls by 40 dB beyond the input's band, and
whitening by it would judge the model there, by its interpolation of the input.   Source    docs/measured_results.md
"""

from typing import NamedTuple

import numpy as np

from testbench.errors import ConfigError
from testbench.measured.formats import input_output, load_matching_files
from testbench.measured.models import mode, splits
from testbench.measured.models.row_noise import Noise
from testbench.measured.models.terms import FORCES, GRAMMAR, TERMS
from testbench.measured.models.working import Working
from testbench.measured.parts.part import Part, Piece
from testbench.measured.quality.rows import series
from testbench.tracing.problem.problem import Law, Nuisance

TICKS = 8  # of the model per sample
SCALE = 0.3  # plausible size of a law, as force over that of the spring, at the output's rms
OUTPUTS = (
    ("pickoff_cubic", "1/V^2", "cubic of the output stage", "instrument", 3),
    ("pickoff_square", "1/V", "square of the output stage", "instrument", 2),
    ("feedthrough", "V/V", "input that feeds through to the output", "instrument", 0),
    ("skew", "s", "output that is sampled later than the input", "instrument", 0),
)


class Drive(NamedTuple):
    """Input at the model's ticks, and where in the record the piece begins and how long the record is."""

    input_v: np.ndarray
    first: int
    record: int


def _term_degree(text):
    return sum(int(t.partition("^")[2] or 1) for t in text.split() if "sgn" not in t)


def _catalogue(rms_v, fs_hz):
    out = []
    for name, text, sign, words in FORCES:
        n = _term_degree(text)
        unit = "V" if n == 0 else "1" if n == 1 else f"1/V^{n - 1}" if n > 2 else "1/V"
        out.append(
            Law(
                name,
                "force_x",
                f"{words}: F = -k c {text}, velocities divided by w",
                unit,
                SCALE * rms_v ** (1 - n),
                sign,
                kind="plant",
                page=f"analog_frontend/effects/{name}.py" if name in PAGES else "docs/measured_results.md",
            )
        )
    for name, unit, words, kind, n in OUTPUTS:
        scale = SCALE * rms_v ** (1 - n) if n else 0.05 if unit == "V/V" else 0.05 / fs_hz
        out.append(Law(name, "cv_x" if unit != "s" else "clock_adc", words, unit, scale, kind=kind))
    for name, words in (("gain_drift", "drive gain"), ("frequency_drift", "frequency")):
        out.append(Law(name, "preparation", f"{words} that drifts over the record", "1", 0.01, kind="preparation"))
    return out


DISSIPATES = ("x^4 vx", "u^2 vx")


def _library(rms_v):
    return tuple(
        Law(
            name,
            "force_x",
            f"F = -k c {text}",
            "relative",
            SCALE * rms_v ** (1 - _term_degree(text)),
            int(text in DISSIPATES),
            term=tuple(_factors(text)),
        )
        for name, text in GRAMMAR
    )


def _factors(text):
    for token in text.split():
        name, _, power = token.partition("^")
        yield name, float(power or 1)


PAGES = ("duffing", "damping_quadratic", "damping_cubic", "coulomb_friction", "drive_cubic", "softening_drive")


class DrivenResonator(Part, adds="fs_hz"):
    """The problem; `Piece.data` is a `Drive`, rows in mV."""

    unit, observable = "mV", "output"
    most_laws = 2

    def __init__(self, fs_hz, start, *args, **named):
        super().__init__(*args, **named)
        self.fs_hz, self.f_ref_hz = fs_hz, start[0]

    def _rows(self, piece, values, effects, state, samples):
        f, q = values["f"], float(np.exp(values["ln_q"]))
        k = mode.MASS_KG * (2 * np.pi * f) ** 2
        drive = piece.data.input_v[: samples * TICKS] - values["input_offset"] * 1e-3
        gain = float(np.exp(values["ln_gain"]))
        drift = effects.get("gain_drift", 0.0)
        if drift:
            n = (piece.data.first + np.arange(len(drive)) / TICKS) / piece.data.record - 0.5
            drive = drive * (1.0 + drift * n)
        slow = effects.get("frequency_drift", 0.0)
        if slow:  # one frequency per piece: its middle
            f = f * (1.0 + slow * ((piece.data.first + len(piece.rows) / 2) / piece.data.record - 0.5))
        laws, h_s = mode.laws(effects, self.f_ref_hz, TERMS), 1.0 / (self.fs_hz * TICKS)
        x = mode.run(f, q, k * gain, drive, laws, h_s, TICKS, state)
        if x is None:
            return np.full(samples, np.nan)
        y = x
        c3, c2 = effects.get("pickoff_cubic", 0.0), effects.get("pickoff_square", 0.0)
        if c3 or c2:
            y = y + c3 * x**3 + c2 * x**2
        leak = effects.get("feedthrough", 0.0)
        if leak:
            y = y + leak * drive[::TICKS]
        skew = effects.get("skew", 0.0)
        if skew:
            y = y + skew * self.fs_hz * np.gradient(x)
        return 1e3 * y + values["output_offset"]

    def abscissa(self, piece):
        return np.arange(len(piece.rows)) / self.fs_hz, "time (s)"

    def locate(self, piece, values, effects):
        """Initial state (V, V) from the setup rows: Gauss-Newton on two numbers."""
        n, target = len(piece.setup), piece.rows[piece.setup]
        state = np.array([(target[0] - values["output_offset"]) * 1e-3, 0.0])
        for _ in range(12):
            base = self._rows(piece, values, effects, state, n)
            if not np.all(np.isfinite(base)):
                return np.zeros(2)
            h = 1e-5
            j = np.column_stack([(self._rows(piece, values, effects, state + h * e, n) - base) / h for e in np.eye(2)])
            step = np.linalg.lstsq(j, target - base, rcond=None)[0]
            state = state + step
            if np.max(np.abs(step)) < 1e-11:
                break
        return state

    def model(self, piece, values, effects, local):
        return self._rows(piece, values, effects, local, len(piece.rows))


def periodic(u, longest=16384):
    """(first, period, periods) of stretches in which u repeats itself, at least four periods of 256 or more samples."""
    periodic_stretches, covered_samples = [], np.zeros(len(u), bool)
    for p in (256, 512, 1024, 2048, 4096, 8192, longest):
        if len(u) < 4 * p:
            break
        change = (u[p:] - u[:-p]) ** 2
        blocks = len(change) // (p // 4)
        power = change[: blocks * (p // 4)].reshape(blocks, -1).mean(1)
        level = np.array([np.var(u[i * (p // 4) : i * (p // 4) + p]) for i in range(blocks)])
        repeating_blocks = power < 2 * 0.02**2 * np.maximum(level, 1e-12 * np.var(u))
        start = None
        for i, good in enumerate(np.append(repeating_blocks, False)):
            if good and start is None:
                start = i
            elif not good and start is not None:
                first, count = start * (p // 4), (i - start) // 4 + 1
                if count >= 4 and not covered_samples[first : first + count * p].any():
                    periodic_stretches.append((first, p, count))
                    covered_samples[first : first + count * p] = True
                start = None
    return periodic_stretches


def repeated_noise(record):
    """Pieces of the output's noise (mV) in periodic stretches: what does not repeat, without what the input says.

    The input's own change between periods (hum, drift) reaches the output through the part: lines where the input
    changes by 10 times its median are taken out.
    """
    out = []
    for first, p, count in periodic(record.input_v):
        u, y = (v[first : first + p * count].reshape(count, p) for v in (record.input_v, record.output_v))
        window = np.hanning(u.size)
        largest = np.max(np.abs(np.fft.rfft((u - u.mean()).ravel() * window)))
        u, y = ((v - v.mean(0)).ravel() * np.sqrt(count / (count - 1)) for v in (u, y))
        size = np.abs(np.fft.rfft(u * window))
        lines = np.flatnonzero(size > max(10 * np.median(size), 1e-5 * largest))
        spectrum = np.fft.rfft(y)
        for line in lines:
            spectrum[max(line - 2, 0) : line + 3] = 0.0
        out.append(1e3 * np.fft.irfft(spectrum, len(y)))
    return out


def quiet_band_sd(record):
    """White level (mV) of the output where the input has least power: the quietest eighth of the band."""
    n = 1 << int(np.log2(len(record.input_v)))
    window = np.hanning(n)
    u, y = (np.abs(np.fft.rfft((v[:n] - v[:n].mean()) * window)) ** 2 for v in (record.input_v, record.output_v))
    bands = 64
    size = len(u) // bands
    power = np.array([[np.median(v[i * size : (i + 1) * size]) for i in range(bands)] for v in (u, y)]) / np.log(2)
    quiet = np.argsort(power[0])[: bands // 8]
    return 1e3 * float(np.sqrt(np.median(power[1][quiet]) / np.sum(window**2)))


def crude(record):
    """Frequency (Hz), Q and static gain from the cross spectrum: only a place to begin."""
    n = min(8192, len(record.input_v) // 4)
    window = np.hanning(n)
    cross, power = 0.0, 0.0
    for i in range(0, len(record.input_v) - n + 1, n // 2):
        u, y = (np.fft.rfft((v[i : i + n] - v[i : i + n].mean()) * window) for v in (record.input_v, record.output_v))
        cross, power = cross + y * u.conj(), power + np.abs(u) ** 2
    used = power > 1e-3 * np.max(power)
    used[:2] = False
    h = np.where(used, np.abs(cross) / np.where(used, power, 1.0), 0.0)
    smooth = np.convolve(h, np.ones(9) / 9, "same")
    peak = int(np.argmax(smooth))
    low = float(np.median(h[used][: max(4, peak // 4)]))
    return peak * record.fs_hz / n, max(float(smooth[peak] / max(low, 1e-9)), 1.0), low


def problem(paths, fs_hz=input_output.FS_HZ):
    """`DrivenResonator` of one record, and of further ones of the same part for its noise and for the exam."""
    from testbench.measured.formats.registry import file_sha256

    records = [(input_output.load(path, fs_hz), file_sha256(path)) for path in paths]
    records.sort(key=lambda item: (item[1] not in splits.OFFICIAL, item[1]))
    (first, digest), further_records = records[0], records[1:]
    return problem_from_records(first, digest, further_records)


def problem_from_records(first, digest, further_records=()):
    """As `problem`, from `InputOutput`s and their hashes."""
    noises = [v for record, _ in ((first, digest), *further_records) for v in repeated_noise(record)]
    notes = []
    if noises:
        floor = float(np.sqrt(np.mean(np.concatenate(noises) ** 2)))
        notes.append(f"noise from {len(noises)} stretches that repeat: {floor:.3f} mV rms without hum")
    else:
        floor = quiet_band_sd(first)
        notes.append(f"no stretch repeats: noise assumed white, {floor:.3f} mV rms from the band without input")
    floor = max(floor, 1e3 * series.rounding_noise(first.output_v))
    noise = Noise.white_noise(floor)
    if first.overloaded:
        notes.append("the file says that the digitiser was overloaded")
    wide = mode.upsample(first.input_v, TICKS)
    plan = splits.split(digest, len(first.input_v))
    pieces = []
    for role in ("fit", "validate", "exam"):
        for name, (a, b) in getattr(plan, role).items():
            pieces.append(_cut_piece(name, role, first, wide, a, b, noise, floor))
    for number, (record, _) in enumerate(further_records):
        n = len(record.input_v)
        name = f"other_record_{number + 1}"
        pieces.append(_cut_piece(name, "exam", record, mode.upsample(record.input_v, TICKS), 0, n, noise, floor))
    f, q, gain = crude(first)
    rms = float(np.std(first.output_v))
    nuisances = (
        Nuisance("f", "Hz", f, 0.2 * f, 1e-5 * f),
        Nuisance("ln_q", "1", float(np.log(q)), 1.0, 1e-5),
        Nuisance("ln_gain", "1", float(np.log(gain)), 1.0, 1e-6),
        Nuisance("input_offset", "mV", 0.0, 20.0, 1e-3),
        Nuisance("output_offset", "mV", 0.0, 20.0, 1e-3),
    )
    hashes = {"record": digest} | {f"record_{i + 2}": h for i, (_, h) in enumerate(further_records)}
    resonator_problem = DrivenResonator(
        first.fs_hz, (f, q, gain), "driven resonator", nuisances, _catalogue(rms, first.fs_hz), pieces, hashes, notes
    )
    resonator_problem.library, resonator_problem.heldout_independent = _library(rms), bool(further_records)
    resonator_problem.working = Working("driven", float(np.max(np.abs(first.output_v))), f, q)
    return resonator_problem


def _cut_piece(name, role, record, wide, a, b, noise, floor):
    n = b - a
    return Piece(
        name,
        role,
        1e3 * record.output_v[a:b],
        np.arange(splits.SETUP, n),
        np.arange(splits.SETUP),
        noise,
        floor,
        Drive(wide[a * TICKS : b * TICKS], a, len(record.input_v)),
        {"input_rms_mv": float(1e3 * np.std(record.input_v[a:b]))},
    )


def _are(paths):
    return [path for path, _ in load_matching_files(paths, input_output)]


def jobs(paths):
    """[(label, paths, options)]: all records of a folder are of one part."""
    record_paths = _are(paths)
    return [("free run", record_paths, {})] if record_paths else []


def opener(paths, options):
    """`Problem` of records of input and output; --option fs_hz=HZ if not the published rate. None if no such files."""
    if not paths or len(_are(paths)) != len(paths):
        return None
    try:
        fs_hz = float(options.get("fs_hz", input_output.FS_HZ))
    except ValueError:
        fs_hz = np.nan
    if not 0 < fs_hz < 1e9:
        raise ConfigError(f"--option fs_hz={options['fs_hz']}: expected a sampling rate in Hz, above 0 and below 1e9")
    return problem(paths, fs_hz)
