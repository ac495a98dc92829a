"""Undamaged recordings of every kind of part, as columns: simulated here by formulas of this file alone, or real sets.

    draw(kind, rng)       `Sibling` of a simulated recording
    write(sibling, path)  its file in the published format
Nothing here knows the checks, nor the models of the parts.
"""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.io
from scipy.signal import lfilter

KINDS = ("meters", "levels", "driven", "ringdown", "spectrum", "sweep", "rest")
SETS = {
    "meters": "dmm_linearity",
    "levels": "dac16_levels",
    "driven": "silverbox",
    "ringdown": "mems_ringdown",
    "spectrum": "mems_ringdown",
    "sweep": "quartz_vna",
    "rest": "gyro_static",
}


class Sibling(NamedTuple):
    """`columns` {name: (n,)}: the first is what rows are ordered by; `signals`: what was measured; `head`: the rest."""

    kind: str
    columns: dict
    signals: tuple
    head: dict


def digits(v, decimals):
    """As a meter prints them."""
    return np.round(v, decimals)


def _meters(rng):
    points = int(rng.integers(160, 320))
    source = np.linspace(-10.5, 10.5, points)
    if rng.random() < 0.5:
        source = rng.permutation(source)
    source = digits(source, 4)
    common = 0.2e-6 * rng.normal(size=points)
    room = np.cumsum(rng.normal(size=points)) / 30
    columns, names = (
        {"time": 130.0 * np.arange(points), "source": source},
        ("alpha", "beta", "gamma")[: rng.integers(1, 4)],
    )
    for name in names:
        error = 1e-6 * (rng.normal() * 3 + 4 * rng.normal() * source / 10 + rng.normal() * (source / 10) ** 3)
        noise = 10 ** rng.uniform(-0.7, 0.3) * 1e-6
        columns[name] = digits(source + error + common + noise * rng.normal(size=points), 9)
    return Sibling("meters", columns | {"temp": digits(30 + room, 1)}, names, {})


def _levels(rng):
    bits = int(rng.integers(10, 15))
    code = np.arange(1 << bits)
    error = sum(rng.normal() * 0.3 * ((code >> b) & 1) for b in range(bits - 4, bits))
    error = error + rng.normal() * 2 * ((code / len(code) - 0.5) ** 2 - 1 / 12)
    lsb = 20.0 / len(code)
    noise = 10 ** rng.uniform(-2, -1)
    volts = lsb * (code - code.mean() + error + noise * rng.normal(size=len(code)))
    return Sibling("levels", {"code": code.astype(float), "volts": volts}, ("volts",), {})


def _driven(rng):
    fs, n, period = 1e7 / 2**14, 16384, 2048
    f0, q = rng.uniform(50, 110), rng.uniform(3, 20)
    if rng.random() < 0.5:
        lines = np.zeros(period // 2 + 1, complex)
        lines[1 : int(0.33 * period) : 2] = np.exp(2j * np.pi * rng.random(len(lines[1 : int(0.33 * period) : 2])))
        u = np.tile(np.fft.irfft(lines, period), n // period)
    else:
        u = lfilter([1], [1, -1.1, 0.55, -0.1], rng.normal(size=n))
    u *= 0.025 / u.std()
    w = 2 * np.pi * f0 / fs
    pole = np.exp(-w / (2 * q) + 1j * w * np.sqrt(1 - 1 / (4 * q * q)))
    a = np.poly([pole, np.conj(pole)]).real
    y = lfilter([0, a.sum()], a, u)
    noise = 10 ** rng.uniform(-1.5, -0.5) * 1e-3
    columns = {"input": u + 0.02e-3 * rng.normal(size=n), "output": y + noise * rng.normal(size=n)}
    return Sibling("driven", columns, ("input", "output"), {})


def _ringdown(rng):
    n = int(rng.integers(300, 1200))
    t = np.linspace(0.1, rng.uniform(20, 200), n)
    rate = rng.uniform(4, 12) / t[-1]
    power = rng.uniform(0.01, 2.0) * np.exp(-rate * t)
    p = 10 * np.log10(_beside(power, 1e-8 * 10 ** rng.uniform(-1, 1), rng)) - 30
    f = rng.uniform(1e5, 2e6)
    head = {"Frequency [Hz]": f"{f:.1f}", "Quality factor": f"{2 * np.pi * f / rate:.6g}"}
    noise = 10 ** rng.uniform(-2.5, -1)
    return Sibling(
        "ringdown", {"time": digits(t, 4), "power": digits(p + noise * rng.normal(size=n), 5)}, ("power",), head
    )


def _beside(power, background, rng):
    n = rng.normal(size=(2, len(power))) * np.sqrt(background / 2)
    return (np.sqrt(power) + n[0]) ** 2 + n[1] ** 2


def _spectrum(rng):
    n = int(rng.integers(400, 1000))
    f0, width = rng.uniform(1e5, 2e6), rng.uniform(4, 15)
    f = f0 + np.linspace(-10, 10, n) * width
    line = 10 ** (-13) * (1 / (1 + ((f - f0) / width) ** 2) + 0.01)
    power = line * rng.chisquare(30, size=n) / 30
    head = {"Frequency [Hz]": f"{f0:.3f}"}
    columns = {"frequency": digits(f, 3), "power": digits(10 * np.log10(power), 4)}
    return Sibling("spectrum", columns, ("power",), head)


def _sweep(rng):
    n = int(rng.integers(400, 1600))
    f0, q = rng.uniform(5e6, 1e7), 10 ** rng.uniform(4, 5)
    width = f0 / q
    f = f0 + np.linspace(-1, 1, n) * width * rng.uniform(8, 25)
    a = 1 / (1 + 2j * (f - f0) / width)
    noise = 10 ** rng.uniform(-4.5, -3.5)
    s21 = 0.3 * a * np.exp(1j * rng.uniform(0, 6)) + 0.01 + noise * (rng.normal(size=n) + 1j * rng.normal(size=n))
    s11 = 0.8 - 0.3 * a + noise * (rng.normal(size=n) + 1j * rng.normal(size=n))
    columns = {"frequency": digits(f, 1)}
    for name, s in (("s11", s11), ("s21", s21), ("s12", s21 * 1e-3), ("s22", s11 * 0.9)):
        columns |= {f"{name} dB": 20 * np.log10(np.abs(s)), f"{name} deg": np.angle(s, deg=True)}
    return Sibling("sweep", columns, ("s21 dB",), {"print": ".8e"})


def _rest(rng):
    n, axes = 40_000, int(rng.integers(1, 4))
    lsb = 10 ** rng.uniform(-2.5, -1.3)
    columns = {"sample": np.arange(n, dtype=float)}
    for k in range(axes):
        white = lsb * rng.uniform(2, 12) * rng.normal(size=n)
        columns[f"axis {k}"] = np.round((rng.normal() + white + lsb * 0.01 * np.cumsum(rng.normal(size=n))) / lsb)
    return Sibling("rest", columns, tuple(columns)[1:], {"lsb_deg_s": lsb, "fs_hz": 100.0})


SIMULATED = {
    "meters": _meters,
    "levels": _levels,
    "driven": _driven,
    "ringdown": _ringdown,
    "spectrum": _spectrum,
    "sweep": _sweep,
    "rest": _rest,
}


def draw(kind, rng):
    """A simulated recording of a kind."""
    return SIMULATED[kind](rng)


# ---- real sets ------------------------------------------------------------------------------------------


def real(kind, rng):
    """A recording of a real set as columns, or None where there is no GYRO_DATA_DIR."""
    root = os.environ.get("GYRO_DATA_DIR", "")
    if not root:
        return None
    paths = [p for p in sorted((Path(root) / SETS[kind]).iterdir()) if not p.name.startswith("README")]
    if kind in ("ringdown", "spectrum"):
        paths = [p for p in paths if ("% time" in p.read_text()) == (kind == "ringdown")]
    return READ[kind](paths[rng.integers(len(paths))])


def _read_power(path):
    lines = path.read_text().splitlines()
    rows = np.array([[float(c) for c in line.split(",")] for line in lines if not line.startswith("%")])
    head = dict(line.lstrip("% ").split(": ", 1) for line in lines if line.startswith("%") and ": " in line)
    kind, axis = ("ringdown", "time") if "% time" in path.read_text() else ("spectrum", "frequency")
    return Sibling(kind, {axis: rows[:, 0], "power": rows[:, 1]}, ("power",), head)


def _read_sweep(path):
    rows = np.array([[float(c) for c in line.split()] for line in path.read_text().splitlines() if line[0] not in "!#"])
    names = ["frequency", *(f"{s} {u}" for s in ("s11", "s21", "s12", "s22") for u in ("dB", "deg"))]
    return Sibling("sweep", dict(zip(names, rows.T.copy())), ("s21 dB",), {"print": ".6e"})


def _read_meters(path):
    head, *lines = [line.strip().rstrip(";").split(";") for line in path.read_text().splitlines() if line.strip()]
    table = np.array([[float(c) for c in line[1:]] for line in lines])
    columns = {"time": 140.0 * np.arange(len(lines))} | dict(zip(head[1:], table.T.copy()))
    first = next(k for k, n in enumerate(head) if n.startswith(("sdev", "temp")))
    return Sibling("meters", columns, tuple(head[2:first]), {})


def _read_levels(path):
    v = scipy.io.loadmat(path)["PRILVLS"].ravel().astype(float)
    return Sibling("levels", {"code": np.arange(len(v), dtype=float), "volts": v}, ("volts",), {})


def _read_driven(path):
    held = scipy.io.loadmat(path)
    columns = {"input": held["V1"].ravel().astype(float), "output": held["V2"].ravel().astype(float)}
    return Sibling("driven", columns, ("input", "output"), {})


def _read_rest(path):
    with np.load(path) as held:
        (counts,) = [held[n] for n in held.files if held[n].ndim == 2]
        head = {n: held[n].item() for n in held.files if held[n].size == 1}
    counts = counts if counts.shape[0] > counts.shape[1] else counts.T
    columns = {"sample": np.arange(len(counts), dtype=float)}
    columns |= {f"axis {k}": counts[:, k].astype(float) for k in range(counts.shape[1])}
    return Sibling("rest", columns, tuple(columns)[1:], head)


READ = {
    "meters": _read_meters,
    "levels": _read_levels,
    "driven": _read_driven,
    "ringdown": _read_power,
    "spectrum": _read_power,
    "sweep": _read_sweep,
    "rest": _read_rest,
}


# ---- files ------------------------------------------------------------------------------------------


def write(sibling, path):
    """Write a sibling, damaged or not, in the published format of its kind."""
    WRITE[sibling.kind](sibling, path)
    return path


def _write_power(s, path):
    axis = "time [s]" if s.kind == "ringdown" else "frequency [Hz]"
    stated = {"Measurement ID": path.name, "Sample ID": "A"} | s.head
    head = [f"% {k}: {v}" for k, v in stated.items()] + ["%", f"% {axis}, power [dBm]"]
    path.write_text(
        "\n".join(head + [f"{a!r}, {b!r}" for a, b in zip(*(v.tolist() for v in s.columns.values()))]) + "\n"
    )


def _write_sweep(s, path):
    form, rows = s.head["print"], zip(*(v.tolist() for v in s.columns.values()))
    lines = [" ".join(format(c, form) for c in row) for row in rows]
    path.write_text("\n".join(["!made", "# Hz S dB R 50", *lines]) + "\n")


def _write_meters(s, path):
    stamp = np.datetime64("2020-01-01T00:00:00") + s.columns["time"].astype("timedelta64[s]")
    dates = [f"{str(t)[5:7]}{str(t)[8:10]}{str(t)[:4]}-{str(t)[11:19]}" for t in stamp]
    names = [n for n in s.columns if n != "time"]
    rows = [";".join([d, *(repr(float(s.columns[n][k])) for n in names)]) + ";" for k, d in enumerate(dates)]
    path.write_text("\n".join([f"date;{';'.join(names)};", *rows]) + "\n")


def _write_levels(s, path):
    scipy.io.savemat(path, {"LEVELS": s.columns["volts"][None, :]})


def _write_driven(s, path):
    none = np.zeros((1, 1))
    scipy.io.savemat(
        path, {"V1": s.columns["input"][None], "V2": s.columns["output"][None], "Ovld1": none, "Ovld2": none}
    )


def _write_rest(s, path):
    counts = np.column_stack([s.columns[n] for n in s.columns if n != "sample"])
    with open(path, "wb") as file:
        np.savez(file, counts=np.round(counts).astype(np.int32), **s.head)


WRITE = {
    "meters": _write_meters,
    "levels": _write_levels,
    "driven": _write_driven,
    "ringdown": _write_power,
    "spectrum": _write_power,
    "sweep": _write_sweep,
    "rest": _write_rest,
}
