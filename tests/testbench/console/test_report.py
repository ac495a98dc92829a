"""Pictures and report: levels are those of the formula, axes carry units, the HTML needs nothing from outside."""

import base64
import io
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from testbench.console import report
from testbench.console.text_table import Table
from testbench.errors import FileError

DRIVE_HZ = 11002.3


def sine(count, amplitude, cycles):
    return amplitude * np.sin(2 * np.pi * cycles * np.arange(count) / count)


@pytest.fixture(scope="module")
def figures():
    time_s = np.arange(2000) / 8000
    tick = np.arange(1 << 16)
    codes = np.round(335 * np.sin(2 * np.pi * DRIVE_HZ * 1e-6 * tick))
    rng = np.random.default_rng(0)
    return {
        "startup": report.startup(
            time_s,
            5 * (1 - np.exp(-time_s / 0.05)),
            20 * np.exp(-time_s / 0.05),
            np.exp(-time_s / 0.05),
            (time_s > 0.1) * 2,
            ["reset", "kick", "locked"],
            0.2,
            5.0,
        ),
        "spectra": report.spectra({"drive DAC, 16 bit": (codes, 16), "sense DAC, 20 bit": (codes * 16, 20)}, 1e6),
        "jitter": report.jitter({"drive": rng.uniform(0, 38.5, 500), "sense": rng.uniform(0, 38.5, 500)}, 38.46),
        "rate_step": report.rate_step(time_s, np.ones(2000), np.ones(2000), 25.6),
    }


@pytest.mark.parametrize("name", ["startup", "spectra", "jitter", "rate_step"])
def test_a_picture_is_1200_pixels_wide_with_units_on_its_axes(tmp_path, figures, name):
    figure = figures[name]
    path = report.save(figure, tmp_path / "a.png")
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert image.size[0] == 1200
        assert 500 <= image.size[1] <= 1000
        colours = np.asarray(image.convert("RGB")).reshape(-1, 3) @ [1 << 16, 1 << 8, 1]
        assert len(np.unique(colours)) > 20, "an empty picture"
    labels = [axis.get_ylabel() for axis in figure.axes] + [figure.axes[-1].get_xlabel()]
    assert all(re.search(r"\(.+\)$", label) or label == "state" for label in labels), labels
    texts = [text.get_fontsize() for axis in figure.axes for text in axis.texts + axis.get_xticklabels()]
    assert min(texts) >= 11


def test_the_palette_is_the_one_for_colour_blind_readers():
    assert {report.BLUE, report.VERMILION, report.GREEN, report.PURPLE, report.ORANGE} <= {
        "#0072B2",
        "#D55E00",
        "#009E73",
        "#CC79A7",
        "#E69F00",
        "#56B4E9",
        "#F0E442",
    }


def test_a_full_scale_sine_is_0_dbfs_and_half_is_6_less():
    count = 1 << 14
    for amplitude, want in ((1 << 15, 0.0), (1 << 14, -6.0206)):
        level, width = report.spectrum_dbfs(sine(count, amplitude, 1000) + 77, 16)
        assert np.argmax(level) == 1000
        assert level[1000] == pytest.approx(want, abs=1e-3)
        assert width == pytest.approx(2.0044, abs=1e-3), "noise bandwidth of the four-term window, in bins"


def test_a_sine_between_two_bins_leaks_less_than_the_window_promises():
    level, _ = report.spectrum_dbfs(sine(1 << 14, 1 << 15, 1000.5), 16)
    far = np.r_[level[5:980], level[1021:]]
    assert level.max() == pytest.approx(-0.83, abs=0.02), "scalloping of the window half a bin off"
    assert far.max() < -91


def test_the_images_have_the_size_of_the_hold():
    figure = report.spectra({"drive": (sine(1 << 16, 1 << 14, 721), 16)}, 1e6, images=3)
    marks = next(line for line in figure.axes[0].lines if line.get_marker() == "v")
    line_hz = 721 * 1e6 / (1 << 16)
    level = 20 * np.log10(0.5)
    for k, size in enumerate(marks.get_ydata(), 1):
        held = [abs(np.sinc((k * 1e6 + s * line_hz) / 1e6)) for s in (-1, 1)]
        exact = level + 20 * np.log10(held)
        assert exact.min() - 0.2 < size < exact.max() + 0.2
        drawn = next(line for line in figure.axes[0].lines if line.get_label() == "images of the hold")
        near = np.abs(drawn.get_xdata() - k * 1e6) < 1.2 * line_hz
        assert drawn.get_ydata()[near].max() == pytest.approx(exact.max(), abs=0.2)


def test_thinning_keeps_every_peak():
    frequency = np.arange(1, 100_001.0)
    level = np.full(100_000, -100.0)
    level[[10, 5000, 99_999]] = [-1, -2, -3]
    thin_hz, thin_db = report._thin(frequency, level)
    assert len(thin_hz) < 2000
    assert {-1, -2, -3} <= set(thin_db)


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.text, self.open = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_the_report_is_one_file_that_loads_nothing(tmp_path, figures):
    figure = figures["rate_step"]
    png = report.save(figure, tmp_path / "a.png")
    tables = [Table("Numbers <1>", ("name", "value"), [("a & b", "1.5"), ("<script>", "2")], "a note")]
    path = report.write_html(
        tmp_path / "run.html",
        "A run <b>",
        tables,
        [("a file", png), ("a figure", figure)],
        ["what & why"],
        [("Configuration", "[noise]\nseed = 1")],
    )
    reader = Reader()
    source = path.read_text()
    reader.feed(source)
    assert reader.open == []
    text = "".join(reader.text)
    for words in ("A run <b>", "Numbers <1>", "a & b", "<script>", "what & why", "[noise]\nseed = 1", "a note"):
        assert words in text
    assert not {"script", "link", "iframe"} & {tag for tag, _ in reader.tags}
    assert "http" not in source
    assert "url(" not in source
    images = [attrs for tag, attrs in reader.tags if tag == "img"]
    assert [image["alt"] for image in images] == ["a file", "a figure"]
    for image in images:
        head, data = image["src"].split(",")
        assert head == "data:image/png;base64"
        assert Image.open(io.BytesIO(base64.b64decode(data))).size[0] == 1200
    assert "prefers-color-scheme: dark" in source
    assert "viewport" in source


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.mark.skipif(not CHROMIUM, reason="no Chromium: the report was not looked at in a browser")
@pytest.mark.parametrize("dark", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_real_browser_shows_the_report(tmp_path, figures, dark):
    tables = [Table("Numbers", ("name", "value"), [("a", "1.5")])]
    path = report.write_html(tmp_path / "run.html", "A run", tables, [("a step", figures["rate_step"])])
    shot = tmp_path / "shot.png"
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1200,1000"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={shot}", path.as_uri()]
    command += ["--force-dark-mode", "--blink-settings=preferredColorScheme=0"] if dark else []
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    with Image.open(shot) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert pixels.shape == (1000, 1200, 3)
    paper = pixels[5, 5]
    assert (paper.mean() < 60) if dark else (paper.mean() > 240)
    # ink of the title at the top, the picture on its white card below, nothing beyond the right edge
    assert np.abs(pixels[20:80, 20:200] - paper).max() > 150
    assert (pixels[400:900, 100:1100].min(axis=2) > 250).mean() > 0.5
    assert np.abs(pixels[:, -8:] - paper).max() == 0


def test_an_unwritable_picture_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match=r"a\.png: cannot be written: "):
        report.save(Figure(), tmp_path / "file" / "a.png")
