"""A gyroscope at rest against the noise of the board's rate output: white behind an averaging filter, flicker, steps.

    S_a(f) = w_a (1 + 2 r_a cos(2 pi f / fs)) + k_a / f + q + sum of laws     one-sided, (deg/s)^2/Hz, axis a
    r      overlap of the averaging windows of neighbouring samples;  q = LSB^2 / 12 / (fs / 2)
    laws   p L(f; f0, Q)   a vibration of power p, f0 on a grid;  walk / f^2
           once found, f0 and Q are fitted, and it may drift: f0 (1 + c exp(-t / tau))
    bias   steps between means of successive stretches; laws: warm-up exp(-t / tau)
Features  10 log10 of the periodogram, averaged over parts of a chunk and over bins 3 % wide (dB); the bias of the
          logarithm of chi2 is taken off, its sd is the floor. Chunks in time: the first 60 % choose, the rest judges
N-effects (colour of noise) and deterministic ones (bias) are told apart by their observable
Source    docs/measured_results.md
"""

import copy

import numpy as np
from scipy.linalg import block_diag
from scipy.special import digamma, polygamma

from testbench.measured.formats import gyro_npz
from testbench.measured.models.linear_problem import Dense, Diagonal, observable_noise_rms
from testbench.measured.models.part_problem import PartProblem
from testbench.tracing.problem.problem import Law, Nuisance, Observable, PredictionFailed, Segment

CHUNKS, CHOOSE = 10, 6
PARTS = 10  # periodograms of a chunk
WIDTH = 0.03  # of a bin, relative
GRID = 1.07  # ratio of neighbouring frequencies of the vibrations that are looked for
Q_LOOKED_FOR = 12.0
LOWEST_HZ = 0.2
DRIFT_S = (1000.0, 3000.0)
WARM_S = (300.0, 1000.0, 3000.0)
MEANS = 12  # stretches per chunk whose means make the bias
DB = 10.0 / np.log(10.0)
PAGE = "analog_frontend/effects/rate_vibration.py"


class Bins:
    """Averages of a chunk's periodograms; `hz` centres, `dof` of chi2."""

    def __init__(self, samples, rate_hz):
        self.length = samples // PARTS
        f = np.fft.rfftfreq(self.length, 1 / rate_hz)[1:]
        f = f[: len(f) - 1] if self.length % 2 == 0 else f
        edges, at = [0], 0
        while at < len(f):
            at += max(1, round(f[at] * WIDTH / f[0]))
            edges.append(min(at, len(f)))
        self.starts, self.counts = np.array(edges[:-1]), np.diff(edges)
        self.hz = np.add.reduceat(f, self.starts) / self.counts
        self.dof = 2.0 * PARTS * self.counts
        self.rate_hz, self.used = rate_hz, len(f)

    def log_spectrum(self, x):
        """dB of (deg/s)^2/Hz of one axis, free of the logarithm's bias."""
        parts = x[: self.length * PARTS].reshape(PARTS, self.length)
        parts = parts - parts.mean(axis=1, keepdims=True)
        power = np.abs(np.fft.rfft(parts, axis=1)[:, 1 : self.used + 1]) ** 2 * 2 / (self.rate_hz * self.length)
        mean = np.add.reduceat(power.mean(axis=0), self.starts) / self.counts
        return DB * (np.log(mean) - digamma(self.dof / 2) + np.log(self.dof / 2))

    @property
    def sd(self):
        return DB * np.sqrt(polygamma(1, self.dof / 2))


class LogChi2(Diagonal):
    """dB of averaged periodograms: the draw is that of chi2, not of Gauss."""

    def __init__(self, dof):
        super().__init__(DB * np.sqrt(polygamma(1, dof / 2)))
        self.dof = dof

    def draws(self, count, rng):
        power = rng.chisquare(self.dof, size=(count, len(self.dof))) / self.dof
        return (DB * (np.log(power) - digamma(self.dof / 2) + np.log(self.dof / 2))).T


def line(hz, f0, q):
    """One-sided density of unit power: a resonance of quality q driven by white noise."""
    g = f0 / (2 * q)
    shape = 1.0 / ((hz**2 - f0**2) ** 2 + (2 * g * hz) ** 2)
    return shape * (8 * g * f0**2) / (2 * np.pi)


def bias_noise(steps):
    """[(white of the means, random walk)] of each axis's steps between successive means (variances), by moments."""
    n, out = steps.shape[1], []
    for row in steps:
        track = np.cumsum(row)
        lag = min(8, max(2, n // 4))
        step_mean_square, lag_mean_square = np.mean(row**2), np.mean((track[lag:] - track[:-lag]) ** 2)
        walk = max((lag_mean_square - step_mean_square) / (lag - 1), 0.0)
        white = max((step_mean_square - walk) / 2, 0.05 * step_mean_square)
        walk = max(step_mean_square - 2 * white, 0.0)
        out.append((white, walk))
    return out


def _base(axis, level_db, density):
    """Nuisances of one axis."""
    return (
        Nuisance(f"{axis} white", "dB", float(level_db), 10.0, 0.01),
        Nuisance(f"{axis} overlap", "1", 0.0, 0.3, 0.001),
        Nuisance(f"{axis} flicker", "(deg/s)^2", 1e-2 * density, 0.05 * density, 1e-4 * density),
    )


def _axis_laws(axis, density, rate_hz):
    """Laws of one axis: vibrations on a grid of frequencies, a walk and a warm-up of the bias."""

    def law(name, words, unit, scale, sign, step, kind="plant"):
        return Law(f"{axis}: {name}", "rate", words, unit, scale, sign, step, kind, PAGE)

    top = 0.45 * rate_hz
    grid = np.geomspace(LOWEST_HZ, top, 1 + int(np.log(top / LOWEST_HZ) / np.log(GRID)))
    out, words = [], "narrow-band motion or noise about the axis"
    for f0 in grid:
        power = density * f0 * 0.5
        out.append(law(f"vibration {f0:.3g} Hz", words, "(deg/s)^2", power, 1, power * 1e-4, "preparation"))
    out.append(law("walk", "random walk of the bias", "(deg/s)^2 Hz", density * 1e-3, 1, density * 1e-7))
    return out + [law(f"warm-up {tau:g} s", "bias warms up", "deg/s", 0.1, 0, 1e-3) for tau in WARM_S]


def _settling(name):
    """Laws of a vibration that is part of the model."""
    words = "its frequency settles after the start"
    return [
        Law(f"{name} settling in {tau:g} s", "rate", words, "1", 0.1, 0, 1e-5, "preparation", PAGE) for tau in DRIFT_S
    ]


class StationaryProblem(PartProblem, adds="record model_laws bins time_s axes names"):
    """Problem of the tracing core about one record."""

    most_laws, heldout_independent, takes_one_file = 6, False, True

    def __init__(self, record, model_laws=()):
        """model_laws: names of laws that are part of the model."""
        self.record, self.model_laws = record, tuple(model_laws)
        x = record.counts * record.lsb_deg_per_s
        samples, self.axes = x.shape
        self.names = "xyzuvw"[: self.axes]
        size = samples // CHUNKS
        self.bins = Bins(size, record.rate_hz)
        self.time_s = (np.arange(CHUNKS) + 0.5) * size / record.rate_hz
        chunks = [
            np.concatenate([self.bins.log_spectrum(x[k * size : (k + 1) * size, a]) for a in range(self.axes)])
            for k in range(CHUNKS)
        ]
        per, self._cut = size // MEANS, MEANS * CHOOSE
        means = x[: per * MEANS * CHUNKS].reshape(MEANS * CHUNKS, per, self.axes).mean(axis=1).T
        steps = np.diff(means, axis=1)
        self._mean_s = (np.arange(MEANS * CHUNKS) + 0.5) * per / record.rate_hz
        self._data = [*chunks, steps[:, : self._cut - 1].ravel(), steps[:, self._cut :].ravel()]
        self.name = f"gyroscope at rest, {self.axes} axes"
        self.hashes = {"file": record.sha256}
        self._build_segments(bias_noise(steps[:, : self._cut - 1]))
        self._build()

    def _build_segments(self, walks):
        """Segments and their noise: chunks of spectra, and the bias steps of the chosen and the judged ones."""
        n = len(self.bins.hz)
        observables = tuple(
            Observable(f"spectrum {axis}", "dB", slice(a * n, (a + 1) * n)) for a, axis in enumerate(self.names)
        )
        segments, self._noise = [], []
        for k in range(CHUNKS):
            name, role = f"chunk {k + 1}", "fit" if k < CHOOSE else "validate"
            segments.append(Segment(name, {"time_s": float(self.time_s[k])}, name, 0, role, observables))
            self._noise.append(LogChi2(np.tile(self.bins.dof, self.axes)))
        for steps, role in zip(self._data[CHUNKS:], ("fit", "validate")):
            m = len(steps) // self.axes
            observables = tuple(
                Observable(f"bias step {axis}", "deg/s", slice(a * m, (a + 1) * m)) for a, axis in enumerate(self.names)
            )
            neighbour_matrix = np.eye(m, k=1) + np.eye(m, k=-1)
            blocks = [(2 * white + walk) * np.eye(m) - white * neighbour_matrix for white, walk in walks]
            segments.append(Segment(f"bias {role}", {}, f"bias {role}", 0, role, observables))
            self._noise.append(Dense(block_diag(*blocks)))
        self.segments = tuple(segments)

    def _build(self):
        """Nuisances and laws, those of `model_laws` among the nuisances."""
        n, nuisances, laws = len(self.bins.hz), [], []
        for a, axis in enumerate(self.names):
            level = np.median([c[a * n : (a + 1) * n] for c in self._data[:CHUNKS]])
            density = 10 ** (level / 10)
            nuisances += _base(axis, level, density)
            laws += _axis_laws(axis, density, self.bins.rate_hz)
        law_by_name = {law.name: law for law in laws}
        self._line_at = {name: float(name.split()[-2]) for name in law_by_name if ": vibration " in name}
        for law in (law_by_name[name] for name in self.model_laws if name in law_by_name):
            nuisances.append(Nuisance(law.name, law.unit, 0.1 * law.scale, 3 * law.scale, law.scale * 1e-4))
            if law.name in self._line_at:
                quality = float(np.log(Q_LOOKED_FOR))
                nuisances.append(Nuisance(f"{law.name} frequency", "1", 0.0, 0.04, 1e-5))
                nuisances.append(Nuisance(f"{law.name} log quality", "1", quality, 0.7, 1e-4))
                laws += _settling(law.name)
        settling = {law.name: law for law in laws[len(law_by_name) :]}
        for law in (settling[name] for name in self.model_laws if name in settling):
            nuisances.append(Nuisance(law.name, law.unit, 0.0, 3 * law.scale, 1e-5))
        self.nuisances = tuple(nuisances)
        self.laws = tuple(law for law in laws if law.name not in self.model_laws and not self._is_neighbour(law.name))
        self._index = {n.name: i for i, n in enumerate(self.nuisances)}

    def _is_neighbour(self, name):
        """True for a neighbour of a vibration that is part of the model: it is the same one."""
        if name not in self._line_at:
            return False
        mine = [n for n in self.model_laws if n in self._line_at and n.split(":")[0] == name.split(":")[0]]
        return any(abs(np.log(self._line_at[name] / self._line_at[n])) < 0.2 for n in mine)

    def dependent_nuisances(self, law):
        """Frequency and quality of a vibration that is part of the model, and how it settles."""
        return [n.name for n in self.nuisances if law in self._line_at and n.name.startswith(f"{law} ")]

    def include_laws(self, names):
        return self._again(names, self._data)

    def replace_data(self, data):
        return self._again(self.model_laws, data)

    def _again(self, model_laws, data):
        new_problem = copy.copy(self)
        new_problem.model_laws, new_problem._data = tuple(model_laws), list(data)
        new_problem._build()
        return new_problem

    def details(self, name, values):
        """Where a line settles, as fitted: its law is named by the nearest frequency of a grid; {} for other laws."""
        if name not in self._line_at:
            return {}
        hz = self._line_at[name] * (1 + values[f"{name} frequency"])
        quality = float(np.exp(values[f"{name} log quality"]))
        return {"hz": hz, "quality": quality, "text": f"narrow band, settles at {hz:.3g} Hz, quality {quality:.2g}"}

    def axis(self, segment, observable):
        """Abscissa of an observable's rows, for pictures."""
        if observable.startswith("spectrum"):
            return np.log10(self.bins.hz), "log10 of the frequency (Hz)"
        return self._mean_s[self._cut + 1 :], "time (s)"

    def observed_features(self, k):
        return self._data[k]

    def _density(self, axis, values, time_s):
        hz, fs = self.bins.hz, self.bins.rate_hz
        white = 10 ** (values[f"{axis} white"] / 10)
        s = white * (1 + 2 * values[f"{axis} overlap"] * np.cos(2 * np.pi * hz / fs))
        s = s + values[f"{axis} flicker"] / hz + self.record.lsb_deg_per_s**2 / 12 / (fs / 2)
        s = s + values.get(f"{axis}: walk", 0.0) / hz**2
        for name, power in values.items():
            f0 = self._line_at.get(name)
            if f0 and power and name.startswith(axis + ":"):
                quality = np.exp(values.get(f"{name} log quality", np.log(Q_LOOKED_FOR)))
                f0 = f0 * (1 + values.get(f"{name} frequency", 0.0))
                for tau in DRIFT_S:
                    f0 = f0 * (1 + values.get(f"{name} settling in {tau:g} s", 0.0) * np.exp(-time_s / tau))
                s = s + power * line(hz, f0, quality)
        if not np.all(s > 0) or not np.all(np.isfinite(s)):
            raise PredictionFailed(f"axis {axis}: the spectral density is not positive")
        return s

    def predict(self, points, which):
        out = []
        for theta, effects in points:
            values = dict(zip(self._index, np.asarray(theta, float))) | dict(effects)
            parts = []
            for k in which:
                if k < CHUNKS:
                    spectra = [self._density(axis, values, self.time_s[k]) for axis in self.names]
                    parts.append(DB * np.log(np.concatenate(spectra)))
                else:
                    t = self._mean_s[: self._cut] if k == CHUNKS else self._mean_s[self._cut :]
                    rows = []
                    for axis in self.names:
                        bias = sum(values.get(f"{axis}: warm-up {tau:g} s", 0.0) * np.exp(-t / tau) for tau in WARM_S)
                        rows.append(np.diff(bias * np.ones(len(t))))
                    parts.append(np.concatenate(rows))
            out.append(parts)
        return out

    def whiten(self, k, v):
        return self._noise[k].whiten(v)

    def noise_draw(self, k, rng):
        return self.noise_draws(k, 1, rng)[:, 0]

    def noise_draws(self, k, count, rng):
        return self._noise[k].draws(count, rng)

    def repeatability_rms(self, k):
        return observable_noise_rms(self._noise[k], self.segments[k])


def jobs(paths):
    """[(label, paths, options)]: each record by itself."""
    return [(path.stem, [path], {}) for path in paths if gyro_npz.is_zero_rate_file(path)]


def opener(paths, options):
    """`Problem` of an archive of counts at rest; None if it is none."""
    if len(paths) != 1 or not gyro_npz.is_zero_rate_file(paths[0]):
        return None
    return StationaryProblem(gyro_npz.read(paths[0]))
