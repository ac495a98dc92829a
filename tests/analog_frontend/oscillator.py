"""Two clocks: the 26 MHz master and the 8 MHz carrier, each with its own error in ppm; the master with jitter.

    Tc = 1 / (26e6 (1 + 1e-6 ppm))      h = 26 Tc      carrier = 8e6 (1 + 1e-6 carrier_ppm)
    edge n happens at n Tc + error(n),  error(n) = jitter x unit noise: white, no memory

The error of edge n is one number: whatever leaves the chip on that edge (a code, a reference) is late by the same time.
Rounded  Tc, h and the carrier are exact rationals of the parameters, rounded once
Not here phase noise close to the carrier (random walk of the edge) and the temperature curve: slow against a tick
Source   docs/plant.md
"""

import math
from fractions import Fraction
from typing import NamedTuple

from analog_frontend.parts import noise
from fpga_model.jit import inlined

TICK_CYCLES = 26
PPM_LIMIT = 1000.0
JITTER_LIMIT_S = 1e-9  # a fortieth of a cycle: edges cannot change places


class Params(NamedTuple):
    """Clock period, tick length (s), carrier (Hz) and the source of edge jitter (s)."""

    tc_s: float
    h_s: float
    carrier_hz: float
    jitter: noise.Source


def design(seed=0, ppm=0.0, jitter_rms_s=0.0, carrier_ppm=20.0, master_hz=26e6, carrier_hz=8e6):
    """Clocks from their nominal frequencies (Hz), errors (ppm) and the rms of one edge (s)."""
    for name, value in (("ppm", ppm), ("carrier_ppm", carrier_ppm)):
        if not abs(value) <= PPM_LIMIT:
            raise ValueError(f"oscillator {name}: {value} ppm is outside -{PPM_LIMIT:g} .. {PPM_LIMIT:g} ppm")
    if not 0.0 <= jitter_rms_s <= JITTER_LIMIT_S:
        raise ValueError(f"oscillator jitter_rms_s: {jitter_rms_s} s is outside 0 .. {JITTER_LIMIT_S:g} s")
    if not (master_hz > 0.0 and carrier_hz > 0.0):
        raise ValueError(f"oscillator master_hz, carrier_hz: {master_hz}, {carrier_hz} Hz are not both positive")
    period = 1 / (Fraction(master_hz) * (1 + Fraction(ppm) / 1_000_000))
    carrier = Fraction(carrier_hz) * (1 + Fraction(carrier_ppm) / 1_000_000)
    jitter = noise.source(seed, "edge_jitter", jitter_rms_s)
    return Params(float(period), float(TICK_CYCLES * period), float(carrier), jitter)


@inlined
def edge_error_s(p, edge):
    """How late master edge `edge` is (s); exactly 0.0 without jitter. Within +-3.47 rms."""
    return noise.white_sample(p.jitter, edge)


def image_beat_hz(p, image=8):
    """Distance of the carrier from the DAC image it falls on: 8 Hz per ppm of difference between the clocks."""
    return abs(image / p.h_s - p.carrier_hz)


def phase_noise_dbc(jitter_rms_s, frequency_hz, rate_hz=26e6):
    """Single-sideband floor (dBc/Hz) that white jitter of the master's edges puts on a tone of `frequency_hz`."""
    return 10.0 * math.log10((2.0 * math.pi * frequency_hz * jitter_rms_s) ** 2 / rate_hz)
