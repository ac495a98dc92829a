"""Recordings made by formulas of these tests alone, in the published formats, under any name."""

import numpy as np
from scipy.io import savemat


def levels(path, rng, elements=(), bits_lsb=(), bits=9, noise_lsb=0.02, drift_lsb=0.03, variable="A", steps=()):
    """A session of a DAC: elements and steps (k, of, LSB), bits_lsb (bit, LSB) weights; white noise and a slow walk."""
    code = np.arange(1 << bits)
    error = np.zeros(1 << bits)
    for k, of, lsb in elements:
        error += lsb * np.clip(code / len(code) * of - (k - 1), 0, 1)
    for k, of, lsb in steps:
        error += lsb * (code / len(code) * of >= k - 1)
    for b, lsb in bits_lsb:
        error += lsb * (code // 2**b % 2)
    slow = np.cumsum(rng.normal(size=64))
    slow = np.interp(code, np.linspace(0, code[-1], 64), slow - slow.mean()) / 8
    volts = (code - code.mean() + error + drift_lsb * slow + noise_lsb * rng.normal(size=len(code))) * 20 / len(code)
    savemat(path, {variable: volts[None, :]})
    return path


def meters(path, rng, laws, points=200, noise_uv=0.3, source_uv=0.2, order="random", sign_uv=0.0, full_v=10.5):
    """A file of readings: `laws` {meter: function(source V, warmth) -> uV}; sign_uv: the source's, in all meters."""
    source = np.linspace(-full_v, full_v, points)
    if order == "random":
        source = rng.permutation(source)
    source = np.round(source, 5)
    warmth = np.cumsum(rng.normal(size=points)) / 20
    common = source_uv * rng.normal(size=points) + sign_uv * np.sign(source)
    lines = [f"date;source;{';'.join(laws)};temp;"]
    for i in range(points):
        minutes = 2 * i
        when = f"0101{2020 + minutes // 500000}-{minutes // 60 % 24:02d}:{minutes % 60:02d}:00"
        cells = [when, f"{source[i]:.5f}"]
        for law in laws.values():
            uv = 3.0 + 2.0 * source[i] / 10 + law(source[i], warmth[i]) + common[i] + noise_uv * rng.normal()
            cells.append(f"{source[i] + uv * 1e-6:.9f}")
        lines.append(";".join([*cells, f"{30 + warmth[i]:.3f}"]) + ";")
    path.write_text("\n".join(lines) + "\n")
    return path


def rest(path, rng, vibration=None, samples=120_000, axes=1, fs=100.0, lsb=0.01):
    """Counts at rest: white noise, and (axis, Hz, Q, deg/s rms) of a filtered one."""
    x = 0.35 * rng.normal(size=(samples, axes))
    if vibration:
        axis, f0, q, rms = vibration
        w = 2 * np.pi * f0 / fs
        pole = np.exp(-w / (2 * q) + 1j * w)
        kicks = (rng.normal(size=samples) + 1j * rng.normal(size=samples)) * np.sqrt((1 - abs(pole) ** 2) / 2)
        a = np.zeros(samples, complex)
        for i in range(1, samples):
            a[i] = pole * a[i - 1] + kicks[i]
        x[:, axis] += rms * np.sqrt(2) * a.real
    np.savez(path, counts=np.round(x / lsb).astype(np.int16), lsb_deg_s=lsb, fs_hz=fs)
    return path
