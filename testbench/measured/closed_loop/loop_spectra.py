"""Level and colour of the converter channels within a dwell: mean densities in bands of frequency.

    density   Welch: SEGMENT frames, Hann, half overlapping, a straight line taken out of each; from SKIP frames on
Source    Welch, IEEE Trans. Audio Electroacoust. 15 (1967)
"""

from itertools import pairwise

import numpy as np
from scipy.signal import welch

from testbench.measured.residual import features

CHANNELS = tuple(name for name in features.OBSERVABLES if name.startswith("adc_"))
EDGES_HZ = (5.0, 31.25, 125.0, 500.0, 1000.0, 2000.0, 4000.0)
FRAME_HZ, SEGMENT, SKIP = 8000.0, 1024, 1024  # frames that a step of the rate is given to settle


def densities(columns, frames):
    """(channels, bands) densities of the first `frames` of {stream: codes}; None if there are too few."""
    if frames < SKIP + SEGMENT:
        return None
    out = []
    for name in CHANNELS:
        codes = np.asarray(columns[features.OBSERVABLES[name].stream][SKIP:frames], float)
        hz, density = welch(codes - codes[0], FRAME_HZ, nperseg=SEGMENT, detrend="linear")
        inside = [(hz > low) & (hz <= high) for low, high in pairwise(EDGES_HZ)]
        out.append([density[chosen].mean() for chosen in inside])
    # a channel that holds one code has none; it is equal to itself
    return np.maximum(out, 1e-12)
