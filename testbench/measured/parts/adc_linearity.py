"""Voltmeters in parallel on one source, against the converter of the board: offset, gain, cubic, and what it lacks.

    y_m(i) = reading - source (uV) = o_m + g_m u + k_m (u^3 - u) + sum_l c_l B_l(i) + e_m(i) + e_source(i)
    u      source / its largest.  Laws of a meter: |u|, Chebyshev polynomials, gain with temperature, humidity, time,
           memory of the point before, offset with temperature, start of the run.  Of the source: the same in all meters
Noise    of a point about everything smooth in source, environment and time: a + b u^2, at least the spread of the
         readings behind a point; part of it is the source's, in all meters at once: what the quietest of them share
Roles    stretches of eight points take turns: one chooses, the next judges
Source   docs/measured_results.md
"""

import numpy as np
from scipy.optimize import nnls

from analog_frontend.parts import adc
from testbench.errors import FileError
from testbench.measured.formats import meters_csv
from testbench.measured.models.linear_problem import Common, LinearProblem, Stretch
from testbench.measured.quality.rows import series
from testbench.tracing.problem.problem import Law, Nuisance, Observable, Segment

STRETCH = 8
PAGE = "analog_frontend/parts/adc.py"
WARM_S = (120.0, 600.0, 1800.0)
SETTLE_S = (1200.0, 2400.0)  # a meter follows the room with a delay
LAWS_PER_METER = 4  # at most, on average
LEAST_UV = 1e-6  # of the noise of readings
SHUFFLED = 0.5  # correlation of time and source below which the order is random
READINGS = 3  # behind one point, where the file gives their spread


def low_pass_series(seconds, x, tau_s):
    """`x` behind a first-order lag."""
    y = np.array(x, float)
    for i in range(1, len(y)):
        a = np.exp(-(seconds[i] - seconds[i - 1]) / tau_s)
        y[i] = a * y[i - 1] + (1 - a) * x[i]
    return y


def normalise_series(x):
    """Zero mean, largest magnitude 1; None if it does not move."""
    x = np.asarray(x, float) - np.mean(x)
    top = np.max(np.abs(x))
    return x / top if top > 0 else None


def full_v(data):
    """Largest source voltage (V) of a file: what its errors are told relative to."""
    return float(np.max(np.abs(data.source_v)))


def shapes(data):
    """{law: (words, (points,))} of one instrument, for a coefficient of 1 uV at the largest."""
    u = data.source_v / full_v(data)
    before = np.concatenate([[u[0]], u[:-1]])
    out = {
        "turnover": ("gain differs between the polarities", _turnover(u)),
        "polarity offset": ("offset differs between the polarities", np.sign(u)),
        "memory": ("part of the previous point remains", before - u),
    }
    for n in (2, *range(4, 2 + adc.CURVE)):
        out[f"curve T{n}"] = ("Chebyshev polynomial of the transfer's curve", _chebyshev(n, u))
    hours = (data.seconds - data.seconds.mean()) / 3600.0
    rows = {"time": hours}
    for column, x in data.environment.items():
        rows[column] = x
        if "room" in column.lower() and "temp" in column.lower():
            rows |= {f"{column} {tau:g} s late": low_pass_series(data.seconds, x, tau) for tau in SETTLE_S}
    for column, x in rows.items():
        span, x = np.max(np.abs(x - np.mean(x))), normalise_series(x)
        if x is not None:
            out[f"gain with {column}"] = (f"gain proportional to it; coefficient for a change of {span:.4g}", x * u)
            out[f"offset with {column}"] = (f"offset proportional to it; coefficient for a change of {span:.4g}", x)
    for tau in WARM_S:
        out[f"start {tau:g} s"] = ("transient after the start", np.exp(-(data.seconds - data.seconds[0]) / tau))
    return out


def _turnover(u):
    """The converter's own law, from its kernel: |v| added at v."""
    part = adc.design(turnover=(1.0,) * adc.CHANNELS)
    return np.array([adc.erroneous(part, 0, v, 0.0, adc.SENSOR_V_AT_25_DEGC) - v for v in u])


def _chebyshev(n, u):
    """The converter's own law, from its kernel, at a full scale of 1."""
    curve = tuple(1e-2 if k == n else 0.0 for k in range(2, 2 + adc.CURVE))
    part = adc.design(vref_v=1.0, curve=curve)
    return np.array([adc.erroneous(part, 0, v, 0.0, adc.SENSOR_V_AT_25_DEGC) - v for v in u]) / 1e-2


def cubic(u):
    """What the board's converter has: its cubic, from the kernel's own formula at full scale 1."""
    return u**3 - u


def smooth_fit_residuals(data):
    """Residuals (uV) of a regression on everything smooth: source, environment, time; what is left is noise."""
    u = data.source_v / full_v(data)
    knots = np.linspace(-1, 1, 24)
    tents = np.clip(1 - np.abs(u[:, None] - knots) / (knots[1] - knots[0]), 0, None)
    rows = [x for x in (normalise_series(v) for v in data.environment.values()) if x is not None]
    t = normalise_series(data.seconds)
    rows += [t, t * t, t**3]
    a = np.column_stack([tents, np.sign(u), *rows, *[x * u for x in rows]])
    error = (data.readings_v - data.source_v[:, None]) * 1e6
    q, s, _ = np.linalg.svd(a, full_matrices=False)
    q = q[:, s > 1e-9 * s[0]]
    if len(u) <= q.shape[1]:
        raise FileError(f"{data.path}: {len(u)} points, expected more than {q.shape[1]}")
    residual = (error - q @ (q.T @ error)) * np.sqrt(len(u) / (len(u) - q.shape[1]))
    if not np.all(robust(residual) > LEAST_UV):
        raise FileError(f"{data.path}: readings have no noise above {LEAST_UV:g} uV; expected measured readings")
    return residual


def noise_sd(data):
    """(own (meters, points), source): uV rms of a point. The source's from what the quietest meters share."""
    residual, u = smooth_fit_residuals(data), data.source_v / full_v(data)
    points, meters = residual.shape
    source = 0.0
    if meters > 1:
        quiet = np.argsort(robust(residual))[: max(2, min(3, meters))]
        covariance = residual.T @ residual / points
        shared = [covariance[a, b] for a in quiet for b in quiet if a < b]
        source = float(np.sqrt(max(np.median(shared), 0.0)))
    # a reference's noise grows with the voltage: variance a + b u^2, both >= 0
    profile = np.column_stack([np.ones(points), u * u])
    total_variance = np.stack([profile @ nnls(profile, residual[:, m] ** 2)[0] for m in range(meters)])
    print_uv = 1e6 * np.array([series.rounding_noise(v) for v in data.readings_v.T])
    least = (np.maximum(0.3 * robust(residual), print_uv)[:, None]) ** 2
    if data.spread_v is not None:
        # the sd of the mean of the readings behind a point
        least = np.maximum(least, (np.mean(data.spread_v**2, axis=0) / (READINGS - 1) * 1e12)[:, None])
    return np.sqrt(np.maximum(total_variance - source**2, least)), source


def robust(residuals):
    """Standard deviation of most, by the median of the magnitudes."""
    return np.median(np.abs(residuals), axis=0) / 0.6745


class Meters(LinearProblem, adds="full_v"):
    """The problem; each law tells the voltage at which its coefficient is reached."""

    def details(self, law, values):
        return {"full_v": self.full_v}


def problem(data, name="voltmeters on one source", roles=None):
    """`LinearProblem` of one file. roles: (points,) True where a point chooses; default: stretches take turns."""
    points, meters = data.readings_v.shape
    u = data.source_v / full_v(data)
    choose = (np.arange(points) // STRETCH) % 2 == 0 if roles is None else np.asarray(roles, bool)
    meter_sd, source_sd = noise_sd(data)
    floor = np.sqrt(np.mean(meter_sd**2 + source_sd**2, axis=1))
    nuisances, laws, columns = [], [], {}

    def column(law, meter, shape):
        table = np.zeros((meters, points))
        table[slice(None) if meter is None else meter] = shape
        columns[law] = [table[:, choose].ravel(), table[:, ~choose].ravel()]

    base = {"offset": np.ones(points), "gain": u, "cubic": cubic(u)}
    for m, meter in enumerate(data.names):
        for label, shape in base.items():
            nuisances.append(Nuisance(f"{meter} {label}", "uV", 0.0, np.inf, 1.0))
            column(nuisances[-1].name, m, shape)
    table = shapes(data)
    port = "adc" if meters > 1 else "adc or source"  # one meter alone cannot say whose error it is
    scale = float(np.median(floor)) * 10
    for m, meter in enumerate(data.names):
        for label, (words, shape) in table.items():
            kind = "preparation" if label.startswith("start") else "plant"
            laws.append(Law(f"{meter}: {label}", port, words, "uV", max(scale, 10 * floor[m]), kind=kind, page=PAGE))
            column(laws[-1].name, m, shape)
    if meters > 1:
        for label, (words, shape) in table.items():
            laws.append(Law(f"source: {label}", "source", words, "uV", scale, kind="instrument", page=PAGE))
            column(laws[-1].name, None, shape)
    error = ((data.readings_v - data.source_v[:, None]) * 1e6).T
    stretches = []
    for role, mask in (("fit", choose), ("validate", ~choose)):
        n = int(mask.sum())
        observables = tuple(Observable(meter, "uV", slice(m * n, (m + 1) * n)) for m, meter in enumerate(data.names))
        segment = Segment("chooses" if role == "fit" else "judges", {}, role, 0, role, observables)
        noise = Common(meter_sd[:, mask], np.full(n, source_sd))
        stretches.append(Stretch(segment, error[:, mask].ravel(), noise))

    def axis(segment):
        return data.source_v[choose if segment == "chooses" else ~choose], "source (V)"

    out = Meters(name, nuisances, laws, stretches, columns, {"file": data.sha256}, axis)
    out.most_laws, out.full_v, out.heldout_independent = LAWS_PER_METER * meters, full_v(data), False
    out.takes_one_file = True
    return out


def jobs(paths):
    """[(label, paths, options)]: each file by itself; where time does not go with the source, halves in time, too."""
    out = []
    for path in paths:
        if meters_csv.is_meters_file(path):
            data = meters_csv.read(path)
            shuffled = abs(np.corrcoef(data.seconds, data.source_v)[0, 1]) < SHUFFLED
            label = f"{len(data.names)} meter(s), {'random order' if shuffled else 'sweep'}"
            if label in [job[0] for job in out]:
                label += f", {path.stem}"
            out.append((label, [path], {}))
            if shuffled:
                out.append((f"{label}, first half chooses", [path], {"roles": "halves"}))
    return sorted(out, key=lambda job: (bool(job[2]), -len(meters_csv.read(job[1][0]).names)))


def opener(paths, options):
    """`Problem` of a file of readings; --option roles=halves: the first half in time chooses. None if no such file."""
    if len(paths) != 1 or not meters_csv.is_meters_file(paths[0]):
        return None
    data = meters_csv.read(paths[0])
    roles = None
    if options.get("roles") == "halves":
        roles = np.arange(len(data.seconds)) < len(data.seconds) // 2
    return problem(data, f"{len(data.names)} voltmeter(s) on one source", roles)
