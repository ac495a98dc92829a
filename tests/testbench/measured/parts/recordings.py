"""Files of parts in their published formats, made from models that share no code with the parts."""

import numpy as np
from scipy.integrate import simpson, solve_ivp

FS_HZ = 1e7 / 2**14


def ring(path, sample, number, t, power_dbm, kind="time [s]"):
    """Ring-down or spectrum as text."""
    head = [f"% Measurement ID: {number}", f"% Date and time: 2020-01-01 12:{number:02d}:00", f"% Sample ID: {sample}"]
    head += ["% Notes: ", "%", f"% {kind}, power [dBm]"]
    path.write_text("\n".join(head + [f"{a:.6g}, {b:.10g}" for a, b in zip(t, power_dbm)]) + "\n")
    return path


def decay(t, start_uw, rate, law, rng, sd_db=0.03, background_uw=1e-8):
    """Power (dBm) of dP/dt = -rate P - law(P) with a background beside the signal."""
    found = solve_ivp(lambda _, p: -rate * p - law(p), (t[0], t[-1]), [start_uw], t_eval=t, rtol=1e-9, atol=1e-15)
    n = rng.normal(size=(2, len(t))) * np.sqrt(background_uw / 2)
    p = (np.sqrt(np.maximum(found.y[0], 0.0)) + n[0]) ** 2 + n[1] ** 2
    return 10 * np.log10(p) - 30.0 + sd_db * rng.normal(size=len(t))


def clean_ring_down(rng):
    """(t_s, power_dbm): a linear mode behind a drive that ends, and a background in the receiver's filter; no effect.

    Length, rate, time before the end of the drive, background, colour, noise of the receiver and printed digits are
    drawn; the power falls by 20 dB or more before it is 10 dB above the background.
    """
    n, step_s = int(np.exp(rng.uniform(np.log(300), np.log(3000)))), 10 ** rng.uniform(-2, -0.3)
    lead, above_db = int(n * rng.uniform(0, 0.25)), rng.uniform(30, 75)
    fall_db, samples = min(above_db - 10, rng.uniform(20, 60)), int(rng.uniform(max(150 / n, 0.3), 0.7) * n)
    k = np.arange(n)
    amplitude = 10 ** (-fall_db / samples * np.maximum(k - lead, 0) / 20)
    turn = np.exp(1j * (rng.uniform(-0.3, 0.3) * k + rng.uniform(0, 2 * np.pi)))
    colour, kicks = rng.uniform(0, 0.9), rng.normal(size=(n + 200, 2)) @ [1, 1j] / np.sqrt(2)
    back = np.zeros(n + 200, complex)
    for i in range(1, n + 200):
        back[i] = colour * back[i - 1] + np.sqrt(1 - colour**2) * kicks[i]
    z = amplitude * turn + 10 ** (-above_db / 20) * back[200:]
    dbm = rng.uniform(-40, 0) + 20 * np.log10(np.abs(z)) + rng.uniform(0, 0.05) * rng.normal(size=n)
    return step_s * k, np.round(dbm, int(rng.integers(2, 6)))


def touchstone(path, f_hz, s21, s11=None, date="2025-01-01 10:00"):
    """Two ports, dB and degrees, seven digits as an analyser prints them."""
    s11 = np.full(len(f_hz), 0.01 + 0j) if s11 is None else s11
    lines = ["!SIMULATED", f"!{date}", "# Hz S dB R 50.000"]
    for f, a, b in zip(f_hz, s11, s21):
        cells = []
        for v in (a, b, 1e-5 + 0j, 0.1 + 0j):
            cells += [20 * np.log10(abs(v)), np.degrees(np.angle(v))]
        lines.append("\t".join([f"{f:.6e}", *(f"{c:.6e}" for c in cells)]))
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


def swept(f_hz, f0_hz, g, coupling, path, points_per_s=0.0, stiff=0.0, damp=0.0):
    """S21 of a mode: its envelope integrated step by step by scipy, or settled at each frequency."""

    def rate(a, f):
        size = (abs(a) * g / 2) ** 2
        return (g + damp * size) / 2 + 2j * np.pi * (f - f0_hz - stiff * size)

    out = np.empty(len(f_hz), complex)
    a = 1.0 / (g / 2 + 2j * np.pi * (f_hz[0] - f0_hz))
    for k, f in enumerate(f_hz):
        if points_per_s == 0:
            a = 1.0 / (g / 2 + 2j * np.pi * (f - f0_hz))
            for _ in range(400):
                a = 0.7 * a + 0.3 / rate(a, f)
            out[k] = a
            continue
        t = np.linspace(0.0, 1.0 / points_per_s, 41)
        slope = lambda _, z, f=f: 1.0 - rate(z[0], f) * z  # noqa: E731
        found = solve_ivp(slope, (0, t[-1]), [complex(a)], t_eval=t, rtol=1e-6, atol=1e-10)
        out[k] = simpson(found.y[0], x=t) / t[-1]
        a = found.y[0, -1]
    return coupling * out * g / 2 + path


def multisine(n, rng, lines=300, rms=0.025):
    """Input of odd lines with random phases."""
    x = np.zeros(n // 2 + 1, complex)
    x[1 : 2 * lines : 2] = np.exp(2j * np.pi * rng.random(lines))
    u = np.fft.irfft(x, n)
    return u * rms / u.std()


def driven(u, f0_hz, q, force, rng, sd_v, fine=16):
    """Output (V) of x'' + w x'/q + w^2 (x + force(x, x'/w)) = w^2 u(t), u a spline, Runge-Kutta 4."""
    from scipy.interpolate import CubicSpline

    w, n = 2 * np.pi * f0_hz, len(u)
    t = np.arange(n) / FS_HZ
    at = CubicSpline(t, u)(np.arange(2 * fine * n) / (2 * fine * FS_HZ))
    h = 1.0 / (fine * FS_HZ)
    x, v, out = 0.0, 0.0, np.empty(n)

    def slope(x, v, drive):
        return w * v, -w * v / q - w * (x + force(x, v) - drive)

    for k in range(n * fine):
        if k % fine == 0:
            out[k // fine] = x
        a, b, c = at[2 * k], at[min(2 * k + 1, len(at) - 1)], at[min(2 * k + 2, len(at) - 1)]
        x1, v1 = slope(x, v, a)
        x2, v2 = slope(x + h / 2 * x1, v + h / 2 * v1, b)
        x3, v3 = slope(x + h / 2 * x2, v + h / 2 * v2, b)
        x4, v4 = slope(x + h * x3, v + h * v3, c)
        x, v = x + h / 6 * (x1 + 2 * x2 + 2 * x3 + x4), v + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
    return out + sd_v * rng.normal(size=n)


def matlab(path, u, y):
    """MATLAB 5 file with V1 and V2."""
    import scipy.io

    scipy.io.savemat(path, {"V1": u[None, :], "V2": y[None, :], "Ovld1": np.zeros((1, 1)), "Ovld2": np.zeros((1, 1))})
    return path
