"""Spectrum of a mode that only heat moves: power over frequency in dBm.

    P = S / (1 + ((f - f0) / w)^2) + B        half width w = f0 / 2Q, as of the plant's mode driven by white force
    nuisances   level of the peak (dBm), f0, ln w, background B (dBm), of blocks that are fitted and judged in turn
    laws        background that slopes, peak beside it that leaks in with a phase (Fano), frequency that wanders
                (Gaussian on top of the Lorentzian), logarithm that bends
Noise: differences over more points than the analyser's filter joins; frequencies put back on their grid by the loader.
"""

import numpy as np
from scipy.special import wofz

from testbench.errors import FileError
from testbench.measured.formats import load_matching_files, ringdown_text
from testbench.measured.models.row_noise import Noise, neighbours, turns
from testbench.measured.models.working import Working
from testbench.measured.parts.part import Part, Piece
from testbench.measured.quality.rows import series
from testbench.tracing.problem.problem import Law, Nuisance

BLOCKS = 24
SHORTEST = 256
LAG = 8  # points, beyond the filter of the analyser
DB = 10.0 / np.log(10.0)
LAWS = (
    Law("background_slope", "detector", "background that slopes over the span", "1", 1.0, kind="instrument"),
    Law("fano", "detector", "direct path in parallel with the mode: 1 + q x / (1 + x^2)", "1", 0.1, kind="instrument"),
    Law("wander", "force_x", "frequency that varies during the record, Gaussian, sd divided by w", "1", 0.5, 1),
    Law("log_bias", "detector", "curvature of the logarithmic detector", "dB/dB^2", 1e-3, kind="instrument"),
)


def power_dbm(f_hz, peak_dbm, f0_hz, half_width_hz, background_dbm, effects):
    """Power (dBm) at frequencies (Hz)."""
    x = (f_hz - f0_hz) / half_width_hz
    sigma = abs(effects.get("wander", 0.0))
    if sigma > 1e-3:
        line = wofz((x + 1j) / (sigma * np.sqrt(2))).real / wofz(1j / (sigma * np.sqrt(2))).real
    else:
        line = 1.0 / (1.0 + x * x) + sigma * sigma * (3 * x * x - 1) / (1 + x * x) ** 3
    peak = 10 ** (peak_dbm / 10)
    span = (f_hz - f_hz.mean()) / np.ptp(f_hz)
    p = peak * (line + effects.get("fano", 0.0) * x / (1.0 + x * x))
    p = p + 10 ** (background_dbm / 10) * (1.0 + effects.get("background_slope", 0.0) * span)
    y = 10 * np.log10(np.maximum(p, 1e-30))
    return y + effects.get("log_bias", 0.0) * (y - peak_dbm) ** 2


class ThermalSpectrum(Part):
    """The problem; `Piece.data` are frequencies (Hz), rows in dBm."""

    unit, observable = "dB", "power"

    def model(self, piece, values, effects, local):
        f0, w = self.f_ref_hz + values["f0"], float(np.exp(values["ln_w"]))
        return power_dbm(piece.data, values["peak"], f0, w, values["background"], effects)


def estimate_noise(p):
    """(sd (dB), correlation from point to point) from differences over one and over LAG points."""

    def typical(v):
        return np.mean(v**2)

    long_lag_variance = typical((p[2 * LAG :] - 2 * p[LAG:-LAG] + p[: -2 * LAG]) / np.sqrt(6))
    short_lag_variance = typical((p[2:] - 2 * p[1:-1] + p[:-2]) / np.sqrt(6))
    return float(np.sqrt(long_lag_variance)), neighbours(short_lag_variance / long_lag_variance)


def problem(trace):
    """`ThermalSpectrum` of a trace: even blocks are fitted, odd ones judged."""
    from testbench.measured.formats.registry import file_sha256

    f, p = trace.x, trace.power_dbm
    if len(p) < SHORTEST:
        raise FileError(f"{trace.path}: {len(p)} points, expected at least {SHORTEST}")
    sd, rho = estimate_noise(p)
    sd = max(sd, series.rounding_noise(p))
    if not 0 < sd < np.inf:
        raise FileError(f"{trace.path}: the spectrum has no noise")
    pieces = []
    for name, role, scored in zip(("even", "odd"), ("fit", "validate"), turns(len(f), BLOCKS)):
        noise = Noise.from_autocorrelation([1.0, rho], sd)
        pieces.append(Piece(f"{name}_blocks", role, p, scored, np.arange(0), noise, sd, f, {}))
    smooth = np.convolve(p, np.ones(15) / 15, "same")[7:-7]
    at = int(np.argmax(smooth)) + 7
    high = f[np.flatnonzero(smooth > smooth.max() - 3.0) + 7]
    width = max(float(np.ptp(high)) / 2, 2 * (f[1] - f[0]))
    nuisances = (
        Nuisance("peak", "dBm", float(smooth.max()), 3.0, 1e-4),
        Nuisance("f0", "Hz", 0.0, 5 * width, 1e-4 * width),
        Nuisance("ln_w", "1", float(np.log(width)), 1.0, 1e-5),
        Nuisance("background", "dBm", float(np.min(smooth)) - 3.0, 6.0, 1e-3),
    )
    spectrum_problem = ThermalSpectrum(
        f"thermal spectrum {trace.sample}", nuisances, LAWS, pieces, {"record": file_sha256(trace.path)}, ()
    )
    spectrum_problem.heldout_independent, spectrum_problem.takes_one_file = False, True
    spectrum_problem.f_ref_hz = float(f[at])
    spectrum_problem.working = Working("spectrum", 0.0, float(f[at]), float(f[at] / (2 * width)))
    return spectrum_problem


def _load_spectra(paths):
    return [(path, trace) for path, trace in load_matching_files(paths, ringdown_text) if trace.kind == "spectrum"]


def jobs(paths):
    """[(label, paths, options)]: each spectrum by itself."""
    return [(f"spectrum {trace.sample}", [path], {}) for path, trace in _load_spectra(paths)]


def opener(paths, options):
    """`Problem` of one spectrum; None if the file is another."""
    spectrum_traces = _load_spectra(paths)
    return problem(spectrum_traces[0][1]) if len(paths) == 1 and spectrum_traces else None
