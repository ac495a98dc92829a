"""Sweeps of a network analyser as a problem: which files belong to one peak, the rows around it, where its fit starts.

    window    half way to the next peak; two thirds of at most WIDEST points lie behind the peak, where it still rings
    one file  even rows are fitted, odd ones judged; else the first sweep is fitted, in the order of dates
Frequencies are those of the grid (formats/touchstone.py); equation, unknowns and laws: swept_mode.py.
Errors    FileError: one port, no noise, no peak, sweeps of other frequencies      Source    docs/measured_results.md
"""

from pathlib import Path

import numpy as np
from scipy.signal import find_peaks

from testbench.errors import FileError
from testbench.measured.formats import load_matching_files, touchstone
from testbench.measured.models.row_noise import Noise
from testbench.measured.models.working import Working
from testbench.measured.parts import second_mode
from testbench.measured.parts.part import Piece
from testbench.measured.parts.swept_mode import PATH, TWO_PI, Sweep, SweptResonator, locate_mode, sweep_laws
from testbench.tracing.problem.problem import Nuisance

WIDEST = 3000  # points used
LEAST_PEAK = 1e-6  # of the largest response
FEWEST = 32  # points around the peak


def window(s, f):
    """Points around the strongest peak, half way to the next one that stands out of the noise by 60 times."""
    smooth = np.median(np.abs(np.diff(s, 2))) / 2.0
    size = np.abs(np.gradient(s))
    peaks, _ = find_peaks(size, height=max(60 * smooth, 0.03 * size.max()))
    main = int(np.argmax(size))
    ring_points = 250  # points that one response may ring over before another peak is another mode
    lower_neighbour_peak = max([p for p in peaks if p < main - ring_points], default=None)
    upper_neighbour_peak = None
    level = size[main]
    for p in peaks:
        quiet = size[max(p - 30, 0) : p - 8] if p > 40 else size[:8]
        if p > main + ring_points and size[p] > max(2 * np.median(quiet), 0.05 * level):
            upper_neighbour_peak = int(p)
            break
    a = 0 if lower_neighbour_peak is None else (main + int(lower_neighbour_peak)) // 2
    b = len(f) if upper_neighbour_peak is None else (main + upper_neighbour_peak) // 2
    return max(a, main - WIDEST // 3), min(b, main + 2 * WIDEST // 3)


def analyser_step(s11):
    """Index at which S11 jumps by 50 times its usual change from point to point; None if it does not."""
    change = np.abs(np.diff(s11))
    at = int(np.argmax(change))
    return at + 1 if change[at] > 50 * np.median(change) else None


def noise_sd(s):
    """Noise of real and imaginary part: second differences of the quieter half."""
    change = np.abs(np.diff(s, 2)) / np.sqrt(6)
    quiet = change[change <= np.median(change)]
    return float(np.sqrt(np.mean(quiet**2) / 2) * np.sqrt(1.0 / 0.30685))  # mean of the lower half of an exponential


def _piece_from_sweep(sweep, number, role):
    if "s21" not in sweep.s:
        raise FileError(f"{sweep.path}: the file has one port; S21 is required")
    s, f = sweep.s["s21"], sweep.frequency_hz
    if noise_sd(s) == 0 or np.ptp(np.abs(s)) < LEAST_PEAK * np.max(np.abs(s)):
        raise FileError(f"{sweep.path}: S21 has no noise, or the same magnitude at all frequencies")
    a, b = window(s, f)
    if b - a < FEWEST or noise_sd(s[a:b]) == 0 or f[a] <= 0:
        raise FileError(
            f"{sweep.path}: {b - a} points around the peak at {f[a]:g} Hz, expected at least {FEWEST} with noise"
        )
    step = analyser_step(sweep.s["s11"])
    step_mask = np.zeros(len(f))
    if step is not None:
        step_mask[step:] = 1.0
    notes = []
    if sweep.regular:
        notes.append(
            f"{number}: frequencies rounded to {sweep.rounding_hz:g} Hz, restored to a grid of {f[1] - f[0]:.4f} Hz"
        )
    if (a, b) != (0, len(f)):
        notes.append(f"{number}: only {f[a]:.0f} .. {f[b - 1]:.0f} Hz used")
    if step is not None and a < step < b:
        notes.append(f"{number}: the analyser steps at {f[step]:.0f} Hz (S11)")
    s, f, step_mask = s[a:b], f[a:b], step_mask[a:b]
    n = len(f)
    rows = 1e3 * np.concatenate([s.real, s.imag])
    odd = np.arange(n) % 2 == 1
    both = np.concatenate([odd, odd])
    scored = np.arange(2 * n) if role == "fit" else np.flatnonzero(both)
    setup = np.arange(0) if role == "fit" else np.flatnonzero(~both)
    sd = 1e3 * max(noise_sd(s), sweep.print_noise)
    data = Sweep(np.ascontiguousarray(f), np.linspace(-1, 1, n), step_mask, str(number))
    condition = {"peak_hz": float(f[int(np.argmax(np.abs(s)))])}
    return Piece(f"sweep_{number}", role, rows, scored, setup, Noise.white_noise(sd), sd, data, condition), notes


def problem(sweeps):
    """`SweptResonator` of sweeps of one peak: the first is fitted, the others judged; in the order of their dates."""
    from testbench.measured.formats.registry import file_sha256

    sweeps = sorted(sweeps, key=lambda s: (s.comments[-1:], file_sha256(s.path)))
    pieces, notes = [], []
    for k, sweep in enumerate(sweeps):
        piece, piece_notes = _piece_from_sweep(sweep, k + 1, "fit" if k == 0 else "validate")
        pieces.append(piece)
        notes += piece_notes
    first = pieces[0]
    if len(sweeps) == 1:
        n = len(first.data.f_hz)
        half = np.arange(n) % 2 == 1
        both = np.concatenate([half, half])
        pieces = [
            first._replace(name="sweep_even", scored=np.flatnonzero(~both)),
            first._replace(name="sweep_odd", role="validate", scored=np.flatnonzero(both), setup=np.flatnonzero(~both)),
        ]
    n = len(first.data.f_hz)
    s = 1e-3 * (first.rows[:n] + 1j * first.rows[n:])
    resonator_problem = SweptResonator("swept resonator", (), (), pieces, {}, notes)
    (f0, ln_g), linear = locate_mode(resonator_problem.columns, first, s, np.arange(n), {})
    fitted = pieces[0].scored[pieces[0].scored < n]
    second = second_mode.choose(resonator_problem.columns, first, s, fitted, (f0, ln_g), 1e-3 * first.floor)
    if second:
        (f0, ln_g), linear = second.q[:2], second.linear
        notes.append(second.words())
    spacing = first.data.f_hz[1] - first.data.f_hz[0]
    level = float(np.max(np.abs(s)))
    nuisances = [
        Nuisance("f0_1", "Hz", float(f0 - first.data.f_hz[0]), 400 * spacing, 1e-3 * spacing),
        Nuisance("ln_g_1", "1", float(ln_g), 3.0, 1e-5),
    ]
    if second:
        second_offset_hz = float(second.f_hz - first.data.f_hz[0])
        nuisances.append(Nuisance("f2_1", "Hz", second_offset_hz, 400 * spacing, 1e-3 * spacing))
        nuisances.append(Nuisance("ln_g2_1", "1", second.ln_g, 3.0, 1e-5))
    for name, value in zip(("k", *PATH, "k2"), linear):
        for part, v in (("re", value.real), ("im", value.imag)):
            nuisances.append(Nuisance(f"{name}_{part}_1", "1", float(v), 10 * level, 1e-6 * level))
    has_steps = any(np.any(np.diff(p.data.step_mask)) for p in pieces)
    laws = sweep_laws(has_steps, float(np.exp(ln_g)), float(np.exp(ln_g)) / TWO_PI, level)
    hashes = {f"record_{k + 1}": file_sha256(sweep.path) for k, sweep in enumerate(sweeps)}
    resonator_problem = SweptResonator("swept resonator", nuisances, laws, pieces, hashes, notes)
    resonator_problem.heldout_independent, resonator_problem.second = len(sweeps) > 1, second
    resonator_problem.working = Working("swept", level, float(f0), TWO_PI * float(f0 / np.exp(ln_g)))
    return resonator_problem


def load(paths):
    """`touchstone.Sweep`s of the files that are such sweeps."""
    return [sweep for _, sweep in load_matching_files(paths, touchstone)]


def _has_little_overlap(a, b):
    """True if two sweeps share less than half of the shorter one's span."""
    (a0, a1), (b0, b1) = ((s.frequency_hz[0], s.frequency_hz[-1]) for s in (a, b))
    return min(a1, b1) - max(a0, b0) < 0.5 * min(a1 - a0, b1 - b0)


def jobs(paths):
    """[(label, paths, options)]: sweeps over the same frequencies are of one peak."""
    groups = []
    for sweep in load(paths):
        for group in groups:
            if not _has_little_overlap(group[0], sweep):
                group.append(sweep)
                break
        else:
            groups.append([sweep])
    groups.sort(key=lambda g: -float(np.max(np.abs(g[0].s["s21" if "s21" in g[0].s else "s11"]))))
    return [(f"{g[0].frequency_hz.mean() / 1e6:.2f} MHz", [Path(s.path) for s in g], {}) for g in groups]


def opener(paths, options):
    """`Problem` of sweeps of one peak; None if the files are others."""
    sweeps = load(paths)
    if not sweeps or len(sweeps) != len(paths):
        return None
    for sweep in sweeps[1:]:
        if _has_little_overlap(sweeps[0], sweep):
            raise FileError(f"{sweep.path}: frequencies differ from those of {sweeps[0].path}; give sweeps of one peak")
    return problem(sweeps)
