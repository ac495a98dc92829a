"""Loaders take the published formats, put rounded grids back, and refuse damage with a line that says what is wrong."""

import numpy as np
import pytest

from testbench.errors import FileError
from testbench.measured.formats import input_output, ringdown_text, touchstone
from tests.testbench.measured.parts import recordings


def test_touchstone_is_read_and_its_grid_restored(tmp_path):
    f = 9.99e6 + 4.6875 * np.arange(200)
    s = 0.3 * np.exp(1j * np.linspace(0, 9, 200))
    found = touchstone.load(recordings.touchstone(tmp_path / "a.bin", f, s))
    assert found.regular
    assert found.rounding_hz == 1.0
    assert np.max(np.abs(found.frequency_hz - f)) < 0.51
    assert np.max(np.abs(np.diff(found.frequency_hz, 2))) < 1e-6
    np.testing.assert_allclose(found.s["s21"], s, rtol=1e-5)
    assert touchstone.is_one((tmp_path / "a.bin").read_bytes()[:4096])


@pytest.mark.parametrize(("kind", "row"), [("MA", "{f} 0.5 90"), ("RI", "{f} 0 0.5"), ("DB", "{f} -6.020599913 90")])
def test_one_port_of_any_kind_and_unit(tmp_path, kind, row):
    lines = [f"# MHz S {kind} R 75"] + [row.format(f=1 + 0.25 * k) for k in range(20)]
    (tmp_path / "b.s1p").write_text("\n".join(lines))
    found = touchstone.load(tmp_path / "b.s1p")
    np.testing.assert_allclose(found.s["s11"], 0.5j, atol=1e-9)
    assert found.frequency_hz[1] == 1.25e6
    assert found.ohm == 75


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("# Hz Y MA R 50\n1 2 3\n", "expected"),
        ("1 2 3\n" * 30, "no option line"),
        ("# Hz S MA R 50\n" + "1 2 3\n" * 30, "all frequencies are equal"),
        ("# Hz S MA R 50\n" + "".join(f"{k} 2\n" for k in range(30)), "columns"),
        ("# Hz S MA R 50\n1 2 3\n2 2\n", "2 numbers"),
        ("# Hz S MA R 50\n1 a 3\n", "not a row"),
        ("# Hz S MA R -1\n1 2 3\n", "reference"),
        ("# Hz S MA R 50\n" + "".join(f"{k} nan 1\n" for k in range(30)), "not finite"),
        ("# Hz S MA R 50\n" + "".join(f"{90 - k} 1 1\n" for k in range(30)), "fall"),
    ],
)
def test_touchstone_refusals(tmp_path, text, why):
    (tmp_path / "c.s2p").write_text(text)
    with pytest.raises(FileError, match=why):
        touchstone.load(tmp_path / "c.s2p")


def test_ring_down_text(tmp_path):
    t = np.arange(100) * 0.12
    found = ringdown_text.load(recordings.ring(tmp_path / "x", "S-1", 7, t, -20 - t))
    assert (found.kind, found.sample, found.header["measurement id"]) == ("ringdown", "S-1", "7")
    np.testing.assert_allclose(found.power_dbm, -20 - t)
    spectrum = ringdown_text.load(
        recordings.ring(tmp_path / "y", "S-1", 8, np.round(1e6 + 0.13 * np.arange(100)), -20 - t, "frequency [Hz]")
    )
    assert spectrum.kind == "spectrum"
    assert np.all(np.diff(spectrum.x) > 0)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1, 2\n" * 80, "no line"),
        ("% time [s], power [dBm]\n1, 2\n", "1 rows"),
        ("% time [s], power [dBm]\n1 2\n", "line 2"),
        ("% time [s], power [dBm]\n" + "1, 2\n" * 80, "duplicated"),
        ("% time [s], power [dBm]\n" + "".join(f"{k}, nan\n" for k in range(80)), "not finite"),
    ],
)
def test_ring_down_refusals(tmp_path, text, why):
    (tmp_path / "d.txt").write_text(text)
    with pytest.raises(FileError, match=why):
        ringdown_text.load(tmp_path / "d.txt")


def test_input_and_output(tmp_path):
    import scipy.io

    u = np.linspace(-1, 1, 5000)
    path = recordings.matlab(tmp_path / "any.name", u, 2 * u)
    found = input_output.load(path)
    np.testing.assert_array_equal(found.output_v, 2 * u)
    assert input_output.is_one(path.read_bytes()[:128])
    scipy.io.savemat(tmp_path / "other.mat", {"levels": u})
    assert input_output.load(tmp_path / "other.mat") is None
    path.write_bytes(path.read_bytes()[:60000])
    with pytest.raises(FileError, match=r"cannot be read|MATLAB"):
        input_output.load(path)
    for bad in (u[:100], u[:, None] * np.ones(3), np.where(u > 0.9, np.nan, u)):
        scipy.io.savemat(tmp_path / "bad.mat", {"V1": u, "V2": bad})
        with pytest.raises(FileError, match=r"V2|V1"):
            input_output.load(tmp_path / "bad.mat")
