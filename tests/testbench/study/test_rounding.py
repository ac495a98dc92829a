"""The series of a rounded sine against sines that numpy rounds; chords and cut phases against their spectra."""

import math

import numpy as np
import pytest

from testbench.study import rounding

POINTS = 1 << 16
ANGLE = 2 * np.pi * (np.arange(POINTS) + 0.5) / POINTS


def harmonics(wave):
    """Amplitudes of the harmonics of one period."""
    return 2 * np.abs(np.fft.rfft(wave)) / len(wave)


@pytest.mark.parametrize("amplitude", [2.3, 21.0, 83.4, 333.7])
def test_lines_of_a_rounded_sine(amplitude):
    n, found = rounding.rounding_harmonics(amplitude)
    seen = harmonics(np.round(amplitude * np.sin(ANGLE)))[n]
    top = int(np.argmax(seen))
    assert 20 * abs(math.log10(found.max() / seen.max())) < 0.3
    assert harmonics(np.round(amplitude * np.sin(ANGLE)))[n[-1] + 1 :].max() < found.max(), "none beyond is larger"
    assert found[top] == pytest.approx(seen[top], rel=0.06)


def test_lines_of_a_sine_with_noise_in_its_amplitude():
    rng = np.random.default_rng(1)
    amplitude, rms = 83.4, 0.2
    mean = np.mean([np.round(a * np.sin(ANGLE)) for a in rng.normal(amplitude, rms, 400)], axis=0)
    n, found = rounding.rounding_harmonics(amplitude, rms)
    seen = harmonics(mean)[n]
    assert 20 * abs(math.log10(found.max() / seen.max())) < 0.5
    assert found.max() < 0.9 * rounding.rounding_harmonics(amplitude)[1].max(), "noise takes from the lines"


@pytest.mark.parametrize("amplitude", [333.7, 500.0])
def test_the_largest_line_of_a_large_sine(amplitude):
    seen = harmonics(np.round(amplitude * np.sin(ANGLE)))[3:]
    ratio = rounding.largest_line(amplitude) * amplitude / seen.max()
    assert 20 * abs(math.log10(ratio)) < 1.5, "later terms of the series are left out"


@pytest.mark.parametrize(("amplitude", "rms"), [(0.76, 0.0), (3.05, 0.0), (3.05, 0.2), (48.7, 0.1), (-3.05, 0.2)])
def test_mean_of_the_in_phase_error(amplitude, rms):
    draws = np.random.default_rng(2).normal(amplitude, rms, 4000 if rms else 1)
    wave = np.sin(ANGLE[::16])
    errors = [2 * np.mean(wave * (np.round(a * wave) - a * wave)) for a in draws]
    spread = np.std(errors) / math.sqrt(len(errors))
    assert rounding.in_phase_error(amplitude, rms) == pytest.approx(np.mean(errors), abs=4 * spread + 3e-3)


@pytest.mark.parametrize(("amplitude", "rms", "pole"), [(48.7, 0.66, 0.98), (48.7, 0.66, 0.0), (12.2, 0.45, 0.9)])
def test_density_of_the_in_phase_error(amplitude, rms, pole):
    """An amplitude that wanders from frame to frame, the describing function of a rounder, and the spectrum of both."""
    rng, frames, step_s = np.random.default_rng(3), 1 << 18, 125e-6
    white = rng.normal(0.0, rms * math.sqrt(1 - pole**2), frames)
    wander = np.empty(frames)
    level = rng.normal(0.0, rms)
    for k in range(frames):
        level = pole * level + white[k]
        wander[k] = level
    sizes = np.abs(amplitude + wander)
    error = -sizes
    for border in np.arange(0.5, sizes.max(), 1.0):
        error += 4 / np.pi * np.sqrt(np.maximum(1 - (border / np.maximum(sizes, border)) ** 2, 0.0))
    pieces = error.reshape(64, -1)
    pieces = pieces - pieces.mean()
    power = 2 * step_s * np.abs(np.fft.rfft(pieces, axis=1)) ** 2 / pieces.shape[1]
    seen = power[:, 1:9].mean()
    found = rounding.error_density(amplitude, rms**2 * pole ** np.arange(4000), step_s)
    assert found == pytest.approx(seen, rel=0.15), "512 values of the spectrum: 4.4 %"


@pytest.mark.parametrize("address_bits", [4, 5, 7])
def test_lines_of_a_table_of_chords(address_bits):
    rows = 4 << address_bits
    knots = np.sin(2 * np.pi * np.arange(rows + 1) / rows)
    seen = harmonics(np.interp(ANGLE, 2 * np.pi * np.arange(rows + 1) / rows, knots))
    assert seen[1] == pytest.approx(1 - (2 * np.pi / rows) ** 2 / 12, abs=1e-2 * (2 * np.pi / rows) ** 2 / 12)
    for k in (1, 2):
        assert seen[k * rows + 1] == pytest.approx(1 / (rows * k) ** 2, rel=0.05)


@pytest.mark.parametrize("phase_bits", [7, 9])
def test_lines_of_a_cut_phase(phase_bits):
    cells = 1 << phase_bits
    middle = (np.floor(ANGLE / (2 * np.pi) * cells) + 0.5) / cells
    seen = harmonics(np.sin(2 * np.pi * middle))
    assert seen[1] == pytest.approx(np.sinc(1 / cells), rel=1e-6)
    for k in (1, 2):
        assert seen[k * cells + 1] == pytest.approx(1 / (cells * k), rel=0.03)
