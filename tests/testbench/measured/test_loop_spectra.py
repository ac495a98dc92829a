"""Level and colour of noise as findings, on streams whose noise is made here."""

import numpy as np
import pytest

from testbench.measured.closed_loop import loop_spectra
from testbench.tracing.noise import findings
from testbench.tracing.noise.noise_model import Noise, Octave

FRAMES, DWELLS, CONDITIONS = 4096, 2, 3


def white(rng):
    return rng.normal(size=FRAMES)


def sinc3(rng):
    """White noise through three means over two frames each, at the same rms."""
    kernel = np.convolve(np.convolve([1, 1], [1, 1]), [1, 1]).astype(float)
    return np.convolve(rng.normal(size=FRAMES + 3), kernel / np.sqrt(kernel @ kernel), mode="valid")


def recorded(rng, made, dwells=DWELLS):
    """{condition: densities of dwells}; the first channel has the noise `made`, the others are white."""
    out = {}
    for c in range(CONDITIONS):
        rows = []
        for _ in range(dwells):
            streams = {name: 100.0 * (white(rng) if k else made(rng)) for k, name in enumerate(loop_spectra.CHANNELS)}
            rows.append(loop_spectra.densities(streams, FRAMES))
        out[f"c{c}"] = rows
    return out


def found(rng, made):
    model = recorded(rng, white, 5)
    return findings.frame_findings(recorded(rng, made), model, loop_spectra.CHANNELS, loop_spectra.EDGES_HZ)


def test_a_louder_channel_is_told_with_its_level_and_no_other():
    (one,) = found(np.random.default_rng(1), lambda rng: 1.8 * white(rng))
    assert one.channel == "adc_xI"
    assert one.low < 1.8 < one.high
    assert one.high - one.low < 0.1
    assert one.text.startswith("noise of adc_xI at all frequencies is 1.8")


def test_colour_is_told_where_the_level_is_the_same():
    """The density of three means over two frames is cos^6(pi f / 8 kHz) times 64 / 20, made by no filter."""
    out = found(np.random.default_rng(2), sinc3)
    assert {f.channel for f in out} == {"adc_xI"}
    below = next(f for f in out if f.span.startswith("below"))
    above = next(f for f in out if f.span.startswith("above"))
    hz = np.linspace(5, 500, 1000)
    wanted = np.sqrt(np.mean(np.cos(np.pi * hz / 8000) ** 6) * 64 / 20)
    assert below.ratio == pytest.approx(wanted, rel=0.1)
    assert above.ratio < 0.5


def test_right_noise_is_seldom_told():
    """One set in a hundred may tell something; of twenty sets three have a chance of 0.1 %."""
    rng = np.random.default_rng(3)
    assert sum(bool(found(rng, white)) for _ in range(20)) < 3


def test_a_short_dwell_has_no_densities():
    streams = {name: np.zeros(2000) for name in loop_spectra.CHANNELS}
    assert loop_spectra.densities(streams, 2000) is None
    assert findings.frame_findings({}, {}, loop_spectra.CHANNELS, loop_spectra.EDGES_HZ) == []


def test_repeats_tell_octaves_that_chance_does_not_explain():
    octaves = (Octave("force", 1, 2, 4.0, 40, 4.0, 42.0), Octave("force", 3, 3, 1.3, 8, 1.3, 10.0))
    (one,) = findings.repeat_findings(Noise(octaves, 1e-6, "", "", 48))
    assert (one.channel, one.ratio, one.source) == ("force", 2.0, "repeats")
    assert one.low < 2.0 < one.high
