"""The second plant against the product's, tick by tick without a firmware; its own error; its random numbers."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from scipy import stats

from analog_frontend import tick as units
from analog_frontend import top as plant
from fpga_model.jit import hot
from testbench.run import build
from tests.sealed import second_plant
from tests.testbench.bench_setup import quiet

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
FRAMES, CLOCKS, EDGE_CLOCK, RATE, QUADRATURE = 600, (19, 1), 5, 1.0, 53000


@hot
def played(p, s, drive, sense, edges, counts, rate, code, temp, motion, codes):
    """The product's plant over frames; `edges` (frames, most, 2)."""
    for n in range(len(counts)):
        units.retune(p, s, rate, code, temp)
        for t in range(125):
            s.work.drive_codes[t] = drive[125 * n + t]
            s.work.sense_codes[t] = sense[125 * n + t]
        units.advance_ticks(p, s, 125 * n, 125, 19, 1, counts[n], edges[n])
        for k in range(4):
            motion[n, k] = s.z[6 + k]
        for k in range(5):
            codes[n, k] = s.adc.clock[4 + k]


def stimulus(frames=FRAMES):
    """DAC codes of every tick and edges of every frame: a burst that drives x to microns, then a small tone."""
    theta = 2 * np.pi * 11002.2977e-6 * np.arange(125 * frames)
    amplitude = np.where(np.arange(125 * frames) < 25_000, 10.0, 0.12)
    drive = np.rint(amplitude * np.sin(theta) * 3276.7).astype(np.int64)
    sense = np.rint(0.6 * np.sin(theta + 0.3) * 52428.8).astype(np.int64)
    level = np.stack([f(theta + lag) > 0 for lag in (0.2, 0.15) for f in (np.sin, np.cos)])
    changes = np.diff(level, axis=1, prepend=False)
    edges = np.zeros((frames, 64, 2), np.int64)
    counts = np.zeros(frames, np.int64)
    for n in range(frames):
        ticks, pins = np.nonzero(changes[:, 125 * n : 125 * n + 125].T)
        counts[n] = len(ticks)
        edges[n, : len(ticks)] = np.stack([26 * ticks + EDGE_CLOCK, pins], axis=1)
    return drive, sense, edges, counts


def text_of(config):
    """The configuration as the port hands it over."""
    lines = [f"plant.{key} = {float(value)!r}" for key, value in config.device()._asdict().items()]
    lines += [f"noise.{key} = {str(value).lower()}" for key, value in config.noise.model_dump().items()]
    return "\n".join([*lines, "clock.master_hz = 26000000.0", "clock.tick_clocks = 26", ""])


def second(config, own, temp_degc):
    """(motion, codes) of the second plant at the end of each frame."""
    drive, sense, edges, counts = stimulus()
    driver, rows = second_plant.Driver(text_of(config), own, temp_degc=temp_degc), []
    for n in range(FRAMES):
        span = slice(125 * n, 125 * n + 125)
        rows.append(driver.frame(drive[span], sense[span], CLOCKS, QUADRATURE, edges[n, : counts[n]], RATE))
    return np.array([m for _, m in rows]), np.array([c for c, _ in rows])


def relative(a, b):
    """Largest difference of x and of y over the second half, relative to their largest values."""
    half = slice(FRAMES // 2, None)
    return [np.abs(a[half, k] - b[half, k]).max() / np.abs(b[half, k]).max() for k in (0, 2)]


@pytest.mark.parametrize("temp_degc", [25.0, -20.0, 65.0])
def test_the_second_plant_moves_and_reads_as_the_product_does(temp_degc):
    """Without noise: x within 1e-8, y within 1e-6, every code within one step of the converter, 10 codes of 3e6."""
    config = quiet()
    drive, sense, edges, counts = stimulus()
    p = build.analog(config, temp_degc, temp_degc)
    motion, codes = np.zeros((FRAMES, 4)), np.zeros((FRAMES, 5), np.int64)
    state = plant.reset(p, 0, 0, temp_degc)
    played(p, state, drive, sense, edges, counts, RATE, QUADRATURE, temp_degc, motion, codes)
    found, read = second(config, "", temp_degc)
    in_x, in_y = relative(found, motion)
    assert in_x < 1e-8
    assert in_y < 1e-6
    assert np.abs(codes[FRAMES // 2 :, 1]).max() > 1e6, "x moves by microns"
    assert np.abs(read - codes)[4:].max() <= 10


def test_its_own_error_falls_with_the_square_of_its_step():
    """One, two and four steps to a tick."""
    one, two, four = (second(quiet(), f"steps = {n}\n", 25.0)[0] for n in (1, 2, 4))
    first, then = relative(one, two), relative(two, four)
    assert max(then) < 5e-7
    assert 3.0 < first[1] / then[1] < 5.0


def test_an_effect_that_it_does_not_know_is_refused_by_name():
    with pytest.raises(ValueError, match=r"mechanism\.1 = "):
        second_plant.Driver(text_of(quiet()), 'mechanism.1 = "wobble 1 1"\n')
    with pytest.raises(ValueError, match=r"law\.1 = "):
        second_plant.Driver(text_of(quiet()), 'law.1 = "force_x = 1.0 q^2"\n')
    with pytest.raises(ValueError, match=r"plant\.qx"):
        second_plant.Driver(text_of(quiet()).replace("plant.qx =", "plant.q ="))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Draws of random.h: (name of the function, count) -> array."""
    folder = tmp_path_factory.mktemp("random")
    calls = {"normal": "normal(&r)", "flicker": "flicker_next(&f, &r)"}
    text = ['#include "random.h"']
    for name, call in calls.items():
        text.append(f"void {name}s(long seed, double *out, long n) {{ ziggurat_tables(); Flicker f;")
        text.append("Stream r = stream((uint64_t)seed, 3); flicker_begin(&f, &r);")
        text.append(f"for (long k = 0; k < n; k++) out[k] = {call}; }}")
    (folder / "draw.c").write_text("\n".join(text))
    command = ["cc", *second_plant.FLAGS, f"-I{second_plant.SOURCES}", "draw.c", "-o", "draw.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "draw.so"))

    def draw(name, seed, count):
        out = np.empty(count)
        getattr(library, f"{name}s")(ctypes.c_long(seed), out.ctypes.data_as(ctypes.c_void_p), ctypes.c_long(count))
        return out

    return draw


def test_the_ziggurat_is_normal_in_its_middle_and_in_its_tail(drawn):
    x = drawn("normal", 5, 1_000_000)
    assert abs(x.mean()) < 4.5e-3
    assert abs(x.var() - 1) < 4.5 * np.sqrt(2 / len(x))
    counts = np.histogram(stats.norm.cdf(x), 100, (0, 1))[0]
    assert stats.chi2.sf(np.sum((counts - 1e4) ** 2 / 1e4), 99) > 1e-5
    beyond = 2 * stats.norm.sf(3.6541528853610088) * len(x)
    assert abs(np.sum(np.abs(x) > 3.6541528853610088) - beyond) < 4.5 * np.sqrt(beyond)


def test_flicker_has_the_density_one_over_f(drawn):
    """0.5 to 500 Hz at 8 kHz, decade by decade within 5 %."""
    mean, hz = 0.0, np.fft.rfftfreq(1 << 17, 1 / 8000)[1:]
    for seed in range(24):
        x = drawn("flicker", seed, 1 << 17) * np.hanning(1 << 17)
        mean = mean + np.abs(np.fft.rfft(x)[1:]) ** 2 * 2 / 8000 / np.sum(np.hanning(1 << 17) ** 2) / 24
    for low in (0.5, 5.0, 50.0):
        band = (hz > low) & (hz < 10 * low)
        assert np.mean((mean * hz)[band]) == pytest.approx(1.0, abs=0.05)
