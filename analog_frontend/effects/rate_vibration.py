"""Narrow-band rotation about the sense axis, as a mounting or a lever would make it: a profile of the rate.

    Omega(t) = sqrt(2) rms Re(a(t) e^{i theta(t)}),  theta' = 2 pi f (1 + settling e^{-t/tau})
    a        complex Ornstein-Uhlenbeck process of unit power, rate pi f / Q (f in Hz, Q quality);  rms in deg/s
    off      rms = 0: no profile, bit for bit nothing
It enters where a rate table does, so loop and plant answer to it as to any rate. Kind: preparation or instrument.
Source    docs/measured_results.md, docs/effects.md
"""

import math

import numpy as np

from analog_frontend.effects.ports import Info

INFO = Info(
    name="rate_vibration",
    port="rate",
    mechanism="noise",
    unit="deg/s",
    source="spectrum of a three-axis gyroscope at rest (docs/measured_results.md)",
    fingerprint="a peak in the spectrum of one axis; the loop's bandwidth determines its height",
)
MOST_POINTS = 200_000


def profile(seconds, f_hz, quality, rms_dps, seed, settling=0.0, tau_s=1000.0, first_s=0.0):
    """[[t_s, deg/s], ...] for `scenario.rate_dps`; straight lines between, 12 points a period. rms 0: empty."""
    if not (seconds > 0 and f_hz > 0 and quality >= 1 and rms_dps >= 0 and tau_s > 0):
        raise ValueError(
            f"rate_vibration: {seconds} s, {f_hz} Hz, Q {quality}, {rms_dps} deg/s, {tau_s} s: "
            "expected positive numbers and Q >= 1"
        )
    if rms_dps == 0.0:
        return []
    count = math.ceil(seconds * 12 * f_hz * (1 + abs(settling))) + 1
    if count > MOST_POINTS:
        raise ValueError(f"rate_vibration: {count} points are more than {MOST_POINTS}")
    t = np.linspace(0.0, seconds, count)
    rng = np.random.default_rng(seed)
    decay = math.exp(-math.pi * f_hz / quality * (t[1] - t[0]))
    kicks = (rng.normal(size=count) + 1j * rng.normal(size=count)) * math.sqrt(0.5)
    a = np.empty(count, complex)
    a[0] = kicks[0]
    for i in range(1, count):
        a[i] = decay * a[i - 1] + math.sqrt(1 - decay * decay) * kicks[i]
    shift = -settling * tau_s * (np.exp(-(t + first_s) / tau_s) - math.exp(-first_s / tau_s))
    rate_dps = math.sqrt(2.0) * rms_dps * np.real(a * np.exp(2j * math.pi * f_hz * (t + shift)))
    return [[float(x), float(y)] for x, y in zip(t, rate_dps)]
