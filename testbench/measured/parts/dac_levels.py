"""Levels of a DAC, measured in sessions, against the DAC of the board: straight line, bow, and what it lacks.

    y_s(code) = (level - line of session s) / LSB        LSB: slope of that line; offset and gain belong to the session
    features    means of 2^bits / 1024 neighbouring codes; what bits below that do averages out
    prediction  b bow(code) + sum_m c_m e_m(code),       e_m: analog_frontend.dac_levels, the kernel of the plant
    law         one, of all coefficients that a segmented converter has (`members`); the number of segments is found

Noise    of a session: white from its own scatter, slow from the differences between sessions (local size, exponential
         correlation over the code). One session alone: its own white scatter, and no more is said.
         Never below step / sqrt(12) of the print
Roles    the first sessions choose, the others judge
Source   docs/measured_results.md
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.ndimage import gaussian_filter1d

from analog_frontend import dac_levels
from analog_frontend.parts import dac
from testbench.errors import ConfigError
from testbench.measured.formats import levels_mat
from testbench.measured.models.linear_problem import Dense, Diagonal, LinearProblem, Stretch
from testbench.measured.models.part_problem import Family
from testbench.measured.quality.rows import series
from testbench.tracing.problem.problem import Law, Nuisance, Observable, Segment

BLOCKS = 1024
SEGMENTS = (4, 8, 16, 32)
SCALE_LSB = 1.0  # plausible size of any coefficient
PAGE = "analog_frontend/dac_levels.py"
MOST_LAWS = 4
LEAST_LSB = 1e-9  # of the noise of levels that were measured
LOCAL = 32  # blocks over which the slow noise is of one size
ALTERNATE = 8  # blocks that change roles together where there is one session


class Session(NamedTuple):
    """Errors (LSB) of all levels about the session's own straight line, and the noise (rms) of their print."""

    name: str
    error_lsb: np.ndarray
    lsb_v: float
    print_lsb: float = 0.0


def fit_line(v):
    """(residual, offset, slope) of a least-squares line over the code."""
    code = np.arange(len(v)) - (len(v) - 1) / 2
    slope, offset = float(code @ v) / float(code @ code), float(np.mean(v))
    return v - offset - slope * code, offset, slope


def block_codes(bits):
    """Neighbouring codes that are averaged."""
    return max(1, (1 << bits) // BLOCKS)


def features(error):
    """Block means."""
    return error.reshape(-1, max(1, len(error) // BLOCKS)).mean(axis=1)


def members(segments, bits):
    """{coefficient: texts for analog_frontend.dac_levels} of a converter of so many segments above a ladder.

    tap k/N     the border of segment k is off by 1 LSB: the segments at both its sides are a ramp each
    step k/N    a jump of 1 LSB at this border, half of it at either side, gone at the next borders
    carry b     a jump of 1 LSB where bit b of the ladder is set and those below are cleared, in every segment
    Ends of the line are those of the session's own, and the gain of the ladder is that of its segment.
    """
    n, out = segments, {}
    for k in range(1, n):
        out[f"tap {k}/{n}"] = [f"element {k}/{n} = 1", f"element {k + 1}/{n} = -1"]
        out[f"step {k}/{n}"] = [f"element {j}/{n} = -0.5" for j in (k, k + 1)] + [f"step {k + 1}/{n} = 1"]
    lowest = block_codes(bits).bit_length() - 1
    for b in range(lowest + 1, bits - (n.bit_length() - 1)):
        out[f"carry {b}"] = [f"bit {j} = {(j == b) - 2.0 ** (j - b - 1)!r}" for j in range(b + 1)]
    return out


def levels_texts(coefficients, bits, other_bits):
    """Texts of all coefficients {name: LSB} of a converter, in LSB of one of the same range with other bits."""
    total, finer = {}, other_bits - bits
    segments = max(int(name.partition("/")[2] or 0) for name in coefficients)
    texts = members(segments, bits)
    for name, lsb in coefficients.items():
        for text in texts[name]:
            kind, position, _, share = text.split()
            position = position if kind != "bit" else str(int(position) + finer)
            if position.startswith("-"):  # below the LSB of the other
                continue
            total[kind, position] = total.get((kind, position), 0.0) + float(share) * lsb * 2.0**finer
    return [f"{kind} {position} = {value:.5g}" for (kind, position), value in total.items()]


def catalogue(bits):
    """(laws, families, {name: (2^bits,) LSB}) of plant and instrument.

    Drift within a session is noise: it is another one in each, and codes and time go together.
    """
    families, shapes, laws = {}, {}, []
    for n in SEGMENTS:
        name, texts = f"{n} segments above a ladder", members(n, bits)
        words = "borders and steps of the segments, carries of the ladder that all segments share"
        families[name] = Family(Law(name, "dac", words, "LSB", SCALE_LSB, page=PAGE), tuple(texts), ("bow",))
        shapes |= {member: dac_levels.errors(text, bits) for member, text in texts.items()}
    code, lowest = np.arange(1 << bits), block_codes(bits).bit_length() - 1
    for b in range(lowest + 2, bits):
        name, u = f"bend of the ladder over {1 << b} codes", code % (1 << b) / (1 << b)
        laws.append(Law(name, "dac", "parabola of a loaded part of the ladder, repeated", "LSB", SCALE_LSB, page=PAGE))
        shapes[name] = 4 * u * (1 - u)
    u = (code + 0.5) / (1 << (bits - 1)) - 1.0
    for name, shape, words in (
        ("cubic of the voltage", u**3 - u, "reference loading, or the voltmeter's own curve"),
        ("turnover of the voltmeter", np.abs(u) - 0.5, "gain of the meter differs between the polarities"),
    ):
        laws.append(Law(name, "meter", words, "LSB", SCALE_LSB, kind="instrument", page=PAGE))
        shapes[name] = shape
    return laws, families, shapes


def bow(bits):
    """What the board's DAC model has already: the parabola of dac.volts, for a bow of 1 LSB at mid-scale."""
    full, bow_lsb = 1 << (bits - 1), 1.0
    part, ideal = dac.design(bits, 1.0, bow=bow_lsb / full), dac.design(bits, 1.0)
    return np.array([dac.volts(part, c) - dac.volts(ideal, c) for c in range(-full, full)]) / ideal.lsb_v


def white_sd(error):
    """Scatter of single levels from the differences of codes 2^k apart that share the ladder's low bits."""
    size = max(2, len(error) // BLOCKS)
    table = error.reshape(-1, size)
    table = table - table.mean(axis=1, keepdims=True)
    table = table - table.mean(axis=0, keepdims=True)
    return float(np.sqrt(np.mean(table**2) * size / (size - 1)))


def feature_sd(session, size):
    """White noise of means of `size` levels, never below the print's: neighbouring levels may share its error."""
    return max(white_sd(session.error_lsb) / np.sqrt(size), session.print_lsb)


def slow_covariance(differences):
    """Covariance of the slow part of one session from differences of two (block means, LSB): local sd, one length.

    sd     square root of the smoothed square, a Gaussian of LOCAL blocks, drawn halfway to the mean of all
    length of exp(-|i - j| / length), and a white share: the most likely of a grid for the scaled differences
    """
    d = np.array(differences) / np.sqrt(2.0)
    n = d.shape[1]
    power = np.mean([gaussian_filter1d(x * x, LOCAL * n / BLOCKS, mode="reflect") for x in d], axis=0)
    sd = np.sqrt((power + np.mean(power)) / 2)
    block_distance = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    best = None
    for length in n * np.array([0.003, 0.01, 0.03, 0.1]):
        for white in (0.001, 0.01, 0.1, 0.5):
            c = (1 - white) * np.exp(-block_distance / length) + white * np.eye(n)
            root = np.linalg.cholesky(c)
            z = solve_triangular(root, (d / sd).T, lower=True)
            cost = float(np.sum(z * z)) + 2 * len(d) * float(np.sum(np.log(np.diag(root))))
            if best is None or cost < best[0]:
                best = (cost, c)
    return best[1] * np.outer(sd, sd)


def noises(sessions, bits):
    """Noise object of each session."""
    size = block_codes(bits)
    means = [features(s.error_lsb) for s in sessions]
    slow = slow_covariance([a - b for a, b in pairwise(means)])
    return [Dense(slow + np.eye(len(slow)) * feature_sd(s, size) ** 2) for s in sessions]


class Levels(LinearProblem, adds="bits"):
    """The problem; the structure is that of a converter of `bits`."""

    def details(self, law, values):
        return {"bits": self.bits}


def problem(sessions, bits, name="levels of a DAC", hashes=None, fit=None):
    """`LinearProblem` of sessions; `fit`: indices of those that choose (default: the first half)."""
    if bits < 9:
        raise ConfigError(f"{name}: {bits} bits, expected at least 9")
    for a, b in pairwise(sessions):
        if np.array_equal(a.error_lsb, b.error_lsb):
            raise ConfigError(f"{name}: {a.name} and {b.name} have the same levels; give separate sessions")
    for s in sessions:
        if not white_sd(s.error_lsb) > LEAST_LSB:
            raise ConfigError(f"{name}: {s.name} has no noise above {LEAST_LSB:g} LSB; expected measured levels")
    laws, families, shapes = catalogue(bits)
    size, blocks = block_codes(bits), min(BLOCKS, 1 << bits)
    nuisances = (Nuisance("bow", "LSB", 0.0, np.inf, 1.0),)
    shapes = shapes | {"bow": bow(bits)}
    table = {n: features(fit_line(v)[0]) for n, v in shapes.items()}
    data = [features(s.error_lsb) for s in sessions]
    if len(sessions) == 1:
        # drift cannot be told from the levels: stretches of blocks take turns at choosing and judging
        turn = (np.arange(blocks) // ALTERNATE) % 2
        noise, stretches = Diagonal(np.full(blocks // 2, feature_sd(sessions[0], size))), []
        for role, k in (("fit", 0), ("validate", 1)):
            observables = (Observable("level", "LSB", slice(0, blocks // 2)),)
            segment = Segment(f"{sessions[0].name} {role}", {}, role, 0, role, observables)
            stretches.append(Stretch(segment, data[0][turn == k], noise))
        columns = {n: [v[turn == 0], v[turn == 1]] for n, v in table.items()}
        out = Levels(name, nuisances, laws, stretches, columns, hashes or {})
    else:
        chosen = set(range((len(sessions) + 1) // 2)) if fit is None else set(fit)
        observables, stretches = (Observable("level", "LSB", slice(0, blocks)),), []
        for k, (s, y, noise) in enumerate(zip(sessions, data, noises(sessions, bits))):
            group, role = ("fit", "fit") if k in chosen else ("held out", "validate")
            stretches.append(Stretch(Segment(s.name, {}, group, k, role, observables), y, noise))
        columns = {n: [v] * len(sessions) for n, v in table.items()}
        codes = np.arange(0, 1 << bits, size) + (size - 1) / 2
        out = Levels(name, nuisances, laws, stretches, columns, hashes or {}, lambda segment: (codes, "code"))
        out.same_rows = True
    out.bits = bits
    out.most_laws, out.families, out.heldout_independent = MOST_LAWS, families, len(sessions) > 1
    return out


def sessions_by_channel(files):
    """{channel: [Session]} of `Levels` of equal width; channels that all files have."""
    if len({f.bits for f in files}) != 1:
        raise ConfigError(f"levels: sessions of {sorted(f.bits for f in files)} bits, expected one width")
    common = [c for c in files[0].channels if all(c in f.channels for f in files)]
    if not common:
        raise ConfigError(f"levels: no variable is common to {', '.join(str(f.path) for f in files)}")
    out = {}
    for c in common:
        sessions = []
        for number, f in enumerate(files, 1):
            line_residual, _, slope = fit_line(f.channels[c])
            noise = series.rounding_noise(f.channels[c]) / abs(slope)
            sessions.append(Session(f"session {number}", line_residual / slope, slope, noise))
        out[c] = sessions
    # the channel of the largest swing first: a small one shows the voltmeter, not the DAC
    return dict(sorted(out.items(), key=lambda item: -abs(item[1][0].lsb_v)))


def jobs(paths):
    """[(label, paths, options)]: each session chooses once, the others judge; other channels for what they show."""
    if len(paths) < 2 or not all(levels_mat.is_levels_file(p) for p in paths):
        return [(p.stem, [p], {}) for p in paths if levels_mat.is_levels_file(p)]
    channels = sessions_by_channel([levels_mat.read(p) for p in paths])
    main = next(iter(channels))
    out = [(f"{main}, session {k} chooses", paths, {"channel": main, "fit": str(k)}) for k in range(len(paths), 0, -1)]
    return out + [(f"{c}, session 1 chooses", paths, {"channel": c, "fit": "1"}) for c in channels if c != main]


def opener(paths, options):
    """`Problem` of files with levels; None if they hold none. Options channel=NAME (largest swing), fit=SESSIONS."""
    if not paths or not all(levels_mat.is_levels_file(p) for p in paths):
        return None
    files = [levels_mat.read(p) for p in paths]
    channels = sessions_by_channel(files)
    name = options.get("channel", next(iter(channels)))
    if name not in channels:
        raise ConfigError(f"--option channel={name}: the files have {', '.join(channels)}")
    fit = None
    if "fit" in options:
        try:
            fit = [int(k) - 1 for k in options["fit"].split("+")]
        except ValueError:
            raise ConfigError(f"--option fit={options['fit']}: numbers of sessions joined by +, such as 2+3") from None
        if not fit or not set(fit) < set(range(len(files))):
            raise ConfigError(
                f"--option fit={options['fit']}: expected numbers within 1 .. {len(files)}, "
                "with at least one session held out"
            )
    hashes = {f"session {k}": f.sha256 for k, f in enumerate(files, 1)}
    return problem(channels[name], files[0].bits, f"levels of a DAC, {name}", hashes, fit)
