"""Damages of recordings, drawn by seed, each large enough to move a result; nothing here knows the checks.

    damaged(kind, rng, sibling)   (name of the damage, damaged `Sibling`s) that moves a result by 3 of its sigmas
results    coefficients and residual sd of a least-squares line of the kind's own, with their sigmas: see `results`
"""

import numpy as np

WHICH = {
    "meters": "interpolated duplicated quantised stuck spikes clipped swapped unit gap reversed",
    "levels": "interpolated duplicated quantised stuck spikes clipped unit reversed drift",
    "driven": "interpolated duplicated quantised stuck spikes clipped swapped gap reversed",
    "ringdown": "interpolated duplicated quantised stuck spikes clipped swapped unit gap reversed drift",
    "spectrum": "interpolated duplicated quantised stuck spikes clipped swapped unit gap",
    "sweep": "interpolated duplicated quantised stuck spikes clipped swapped unit gap reversed",
    "rest": "interpolated duplicated quantised stuck spikes clipped unit",
}
MOVED = 3.0  # sigmas
TRIES = 60


def results(s):
    """(values, sigmas): what a plain least-squares fit says of a recording."""
    c = {name: np.asarray(v, float) for name, v in s.columns.items()}
    if s.kind == "meters":
        y, u = 1e6 * (c[s.signals[0]] - c["source"]), c["source"] / 10
        a = np.column_stack([np.ones(len(u)), u, u**3])
    elif s.kind == "levels":
        y = c["volts"]
        x = np.linspace(-1, 1, len(y))
        a = np.column_stack([np.ones(len(y)), x, x * x])
    elif s.kind == "driven":
        u, y = c["input"], c["output"]
        a = np.column_stack([u[1:-1], u[:-2], y[1:-1], y[:-2]])
        y = y[2:]
    elif s.kind == "rest":
        y = c[s.signals[0]] * s.head[next(k for k in s.head if k.endswith("deg_s"))]
        a = np.column_stack([np.ones(len(y)), np.linspace(-1, 1, len(y))])
    else:
        y = c[s.signals[0]]
        x = next(iter(c.values()))
        top = int(np.argmax(np.convolve(y, np.ones(5) / 5, "same")))
        near = (y > np.max(y) - 20) & (np.arange(len(y)) >= top - (0 if s.kind == "ringdown" else len(y)))
        y, x = y[near], (x[near] - x[top]) / (np.std(x) + 1e-300)
        a = np.column_stack([np.ones(len(y)), x, x * x])
    if len(y) < 10:
        return np.full(a.shape[1] + 1, np.nan), np.full(a.shape[1] + 1, np.nan)
    found, *_ = np.linalg.lstsq(a, y, rcond=None)
    rest = y - a @ found
    sd = float(np.sqrt(rest @ rest / max(len(y) - a.shape[1], 1)))
    sigma = sd * np.sqrt(np.abs(np.diag(np.linalg.pinv(a.T @ a))))
    # what is left of a smooth course is no noise: that is told by what neighbours do not share
    rough = float(np.std(np.diff(rest, 2)) / np.sqrt(6))
    return np.append(found, rough), np.append(sigma, rough / np.sqrt(len(y)))


def moves(clean, damaged):
    """True if a result is moved by more than MOVED of its sigmas."""
    with np.errstate(all="ignore"):
        (a, sigma), (b, _) = results(clean), results(damaged)
        return bool(np.any(~np.isfinite(b)) or np.any(np.abs(b - a) > MOVED * sigma))


def with_columns(s, **changed):
    return s._replace(columns=s.columns | changed)


def _axis(s):
    return next(iter(s.columns))


def _noise(v):
    return float(np.median(np.abs(np.diff(v, 2))) / 0.6745 / np.sqrt(6)) or float(np.std(np.diff(v))) or 1.0


def _stretch(n, rng, low, high):
    count = max(int(n * rng.uniform(low, high)), 8)
    first = int(rng.integers(0, n - count))
    return slice(first, first + count)


def _sorted_rows(s):
    """Rows in the order in which neighbours are alike: a source may be programmed in any."""
    return np.argsort(s.columns["source"]) if s.kind == "meters" else np.arange(len(s.columns[_axis(s)]))


def interpolated(s, rng):
    from scipy.interpolate import CubicSpline

    k = int(rng.integers(2, 9))
    cubic = rng.random() < 0.3
    order = _sorted_rows(s)
    n = len(order)
    part = slice(0, n) if rng.random() < 0.7 else _stretch(n, rng, 0.4, 0.8)
    out = dict(s.columns)
    names = s.signals if s.kind != "sweep" else tuple(x for x in s.columns if x != "frequency")
    if s.kind == "sweep":
        cubic = False
    x = np.arange(n, dtype=float)
    for name in names:
        base = s.columns["source"][order] if s.kind == "meters" else np.zeros(n)
        v = s.columns[name][order] - base
        knots = np.arange(part.start, part.stop, k)
        if name.endswith("deg"):
            v = np.degrees(np.unwrap(np.radians(v)))
        inside = x[(x >= knots[0]) & (x <= knots[-1])]
        v[(x >= knots[0]) & (x <= knots[-1])] = (
            CubicSpline(knots, v[knots])(inside) if cubic else np.interp(inside, knots, v[knots])
        )
        if name.endswith("deg"):
            v = (v + 180) % 360 - 180
        new = np.empty(n)
        new[order] = v + base
        out[name] = np.round(new) if s.kind == "rest" else new
    return s._replace(columns=out)


def duplicated(s, rng):
    n = len(s.columns[_axis(s)])
    if s.kind in ("levels", "driven", "rest") or rng.random() < 0.5:
        a = _stretch(n, rng, 0.05, 0.25)
        count = a.stop - a.start
        to = int(rng.integers(0, n - count))
        if abs(to - a.start) < count:
            to = 0 if a.start >= count else n - count
        out = {}
        for name, v in s.columns.items():
            v = v.copy()
            if name != _axis(s) or s.kind == "driven":
                v[to : to + count] = s.columns[name][a]
            out[name] = v
        return s._replace(columns=out)
    rows = np.sort(
        np.concatenate([np.arange(n), rng.choice(n, max(int(n * rng.uniform(0.05, 0.4)), 4), replace=False)])
    )
    return s._replace(columns={name: v[rows] for name, v in s.columns.items()})


def quantised(s, rng):
    name = s.signals[rng.integers(len(s.signals))]
    v = s.columns[name]
    course = v - s.columns["source"] if s.kind == "meters" else v
    step = _noise(course[_sorted_rows(s)]) * 10 ** rng.uniform(0.4, 1.0 if s.kind == "rest" else 2.0)
    step = max(round(step), 2) if s.kind == "rest" else step
    new = np.round(v / step) * step
    return with_columns(s, **{name: new if np.ptp(new) > 0 else v})


def stuck(s, rng):
    name = s.signals[rng.integers(len(s.signals))]
    v = s.columns[name].copy()
    part = _stretch(len(v), rng, 0.02, 0.2)
    v[part] = v[part.start]
    return with_columns(s, **{name: v})


def spikes(s, rng):
    name = s.signals[rng.integers(len(s.signals))]
    v = s.columns[name].copy()
    rows = rng.choice(len(v), max(int(len(v) * 10 ** rng.uniform(-3, -1.3)), 1), replace=False)
    course = v - s.columns["source"] if s.kind == "meters" else v
    size = _noise(course[_sorted_rows(s)]) * 10 ** rng.uniform(1.2, 3, len(rows)) * rng.choice([-1, 1], len(rows))
    v[rows] += np.round(size) if s.kind == "rest" else size
    return with_columns(s, **{name: v})


def clipped(s, rng):
    name = s.signals[rng.integers(len(s.signals))]
    v = s.columns[name]
    share = rng.uniform(0.01, 0.15)
    low, high = np.quantile(v, [share, 1 - share])
    if s.kind in ("ringdown", "spectrum", "sweep"):
        low = -np.inf
    return with_columns(s, **{name: np.clip(v, low, high)})


def swapped(s, rng):
    pair = {
        "meters": ("source", s.signals[0]),
        "driven": ("input", "output"),
        "ringdown": ("time", "power"),
        "spectrum": ("frequency", "power"),
        "sweep": [("s11 dB", "s21 dB"), ("s21 dB", "s21 deg")][rng.integers(2)],
    }[s.kind]
    return with_columns(s, **{pair[0]: s.columns[pair[1]], pair[1]: s.columns[pair[0]]})


def unit(s, rng):
    if s.kind == "meters":
        name = ["source", *s.signals][rng.integers(1 + len(s.signals))]
        return with_columns(s, **{name: s.columns[name] * 1e3})
    if s.kind == "levels":
        return with_columns(s, volts=s.columns["volts"] * 1e3)
    if s.kind == "ringdown":
        if rng.random() < 0.3:
            return with_columns(s, power=10 ** (s.columns["power"] / 10))
        return with_columns(s, time=s.columns["time"] * (1e3 if rng.random() < 0.5 else 1e-3))
    if s.kind == "spectrum":
        return with_columns(s, frequency=s.columns["frequency"] * 1e-3)
    if s.kind == "rest":
        name = next(k for k in s.head if k.endswith("deg_s"))
        return s._replace(head=s.head | {name: s.head[name] * 1e3})
    if rng.random() < 0.5:
        return s._replace(columns={k: np.radians(v) if k.endswith("deg") else v for k, v in s.columns.items()})
    return s._replace(columns={k: 10 ** (v / 20) if k.endswith("dB") else v for k, v in s.columns.items()})


def gap(s, rng):
    n = len(s.columns[_axis(s)])
    count = max(int(n * rng.uniform(0.02, 0.2)), 8)
    first = int(rng.integers(n // 20, n - count - n // 20))
    keep = np.r_[0:first, first + count : n]
    return s._replace(columns={name: v[keep] for name, v in s.columns.items()})


def reversed_order(s, rng):
    if s.kind == "levels":
        return with_columns(s, volts=s.columns["volts"][::-1].copy())
    if s.kind in ("meters", "ringdown") and rng.random() < 0.5:
        return s._replace(columns={k: v if k in (_axis(s), "source") else v[::-1].copy() for k, v in s.columns.items()})
    return s._replace(columns={k: v[::-1].copy() for k, v in s.columns.items()})


def drift(s, rng):
    """The second of two repeats."""
    if s.kind == "levels":
        x = np.linspace(-1, 1, len(s.columns["volts"]))
        lsb = np.mean(np.diff(s.columns["volts"]))
        size = rng.uniform(2, 10) * lsb * rng.choice([-1, 1])
        return with_columns(s, volts=s.columns["volts"] + size * (x * x if rng.random() < 0.5 else x**3 - 0.6 * x))
    top = np.max(s.columns["power"])
    t = s.columns["time"] - s.columns["time"][int(np.argmax(s.columns["power"]))]
    fall = np.clip(s.columns["power"] - top, -30, 0) * (t > 0)
    return with_columns(s, power=s.columns["power"] + rng.uniform(0.7, 1.5) * fall)


HOW = {f.__name__: f for f in (interpolated, duplicated, quantised, stuck, spikes, clipped, swapped, unit, gap, drift)}
HOW["reversed"] = reversed_order


def damaged(name, sibling, rng):
    """The sibling with a damage that moves a result; None if none of TRIES draws does."""
    for _ in range(TRIES):
        made = HOW[name](sibling, rng)
        if moves(sibling, made):
            return made
    return None
