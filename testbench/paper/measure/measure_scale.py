"""Scale factor from the paper's 22 rates.

    word = K Omega + K0        least squares over all rates; K in LSB of the 24-bit word per deg/s
    nonlinearity               largest residual of that line / (K times the largest rate), ppm
    asymmetry                  |K+ - K-| / ((K+ + K-)/2), K+ and K- the slopes of lines over one sign each, ppm
    sigma                      standard error of K from the residuals

Source    IEEE Std 1431 and 647 (terms: scale factor, nonlinearity, asymmetry); docs/paper.md
"""

from typing import NamedTuple

import numpy as np

POSITIVE_DPS = (0.1, 0.5, 1.0, 5.0, 10.0, 50.0, 100.0, 200.0, 300.0, 400.0, 500.0)
RATES_DPS = (*(-r for r in reversed(POSITIVE_DPS)), *POSITIVE_DPS)
SETTLE_S, READ_S = 2.0, 1.0


class Scale(NamedTuple):
    """What 22 rates say."""

    lsb_per_dps: float
    sigma_lsb_per_dps: float
    offset_lsb: float
    nonlinearity_ppm: float
    asymmetry_ppm: float
    positive_lsb_per_dps: float
    negative_lsb_per_dps: float
    residual_ppm: tuple  # of full scale, per rate


def fit(rates_dps, words):
    """`Scale` of mean words at rates; needs two rates of each sign."""
    rates, words = np.asarray(rates_dps, float), np.asarray(words, float)
    slope, offset = np.polyfit(rates, words, 1)
    residual = words - slope * rates - offset
    full = abs(slope) * np.abs(rates).max()
    up = np.polyfit(rates[rates > 0], words[rates > 0], 1)[0]
    down = np.polyfit(rates[rates < 0], words[rates < 0], 1)[0]
    spread = np.sqrt(residual @ residual / max(len(rates) - 2, 1))
    return Scale(
        float(slope),
        float(spread / np.sqrt(np.sum((rates - rates.mean()) ** 2))),
        float(offset),
        float(np.abs(residual).max() / full * 1e6),
        float(abs(up - down) / (abs(up + down) / 2) * 1e6),
        float(up),
        float(down),
        tuple(float(r) for r in residual / full * 1e6),
    )


def rates_dps(bench):
    """The 22 rates, or the part of them that is within the board's range."""
    return tuple(bench.part * rate for rate in RATES_DPS)


def sweep(bench, settle_s=SETTLE_S, read_s=READ_S):
    """(mean words, mean V_q codes, flags seen) at each rate, lowest first; the table stands still afterwards."""
    words, codes, flags = [], [], 0
    for rate in rates_dps(bench):
        bench.rate_dps = rate
        bench.settle(settle_s)
        rows = bench.record(read_s)
        words.append(rows.hann("rate_word"))
        codes.append(rows.mean("quadrature_code"))
        flags |= int(np.bitwise_or.reduce(rows["flags"]))
    bench.rate_dps = 0.0
    bench.settle(settle_s)
    return np.array(words), np.array(codes), flags
