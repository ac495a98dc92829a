"""Tables of anybody as columns: every form gives the same numbers, and what is damaged ends in one line."""

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from scipy.io import savemat

from testbench.errors import FileError
from testbench.measured.formats.table import numeric_columns, read_table

T, V = np.arange(5.0) / 8000, np.array([1.5, -2.25, 3e-9, 0.0, 7.0])


def test_every_form_gives_the_same_columns(tmp_path):
    rows = list(zip(T.tolist(), V.tolist()))
    for mark, name in ((",", "c"), (";", "s"), ("\t", "t"), (" ", "b")):
        text = "\n".join(["# a comment", f"t{mark}v", *(f"{a!r}{mark}{b!r}" for a, b in rows)])
        (tmp_path / name).write_text(text + "\n")
    pyarrow.parquet.write_table(pyarrow.table({"t": T, "v": V, "note": ["x"] * 5}), tmp_path / "p")
    np.savez(tmp_path / "n.npz", t=T, v=V)
    savemat(tmp_path / "m.mat", {"t": T, "v": V[:, None]})
    for path in tmp_path.iterdir():
        found = numeric_columns(path, read_table(path), ("t", "v"))
        assert np.array_equal(found["t"], T), path
        assert np.array_equal(found["v"], V), path


def test_columns_without_names_texts_and_empty_cells(tmp_path):
    (tmp_path / "a").write_text("1,2,\n3,,\n")
    found = read_table(tmp_path / "a")
    assert list(found) == ["1", "2"]
    assert np.isnan(found["2"][1])
    with pytest.raises(FileError, match="'2': row 2 is empty"):
        numeric_columns("a", found, ("2",))
    (tmp_path / "b").write_text("when;v\n2020-01-01;1\n2020-01-02;2,5\n")
    found = read_table(tmp_path / "b")
    assert found["when"].tolist() == ["2020-01-01", "2020-01-02"]
    with pytest.raises(FileError, match=r"'v': '2,5' is not a number"):
        numeric_columns("b", found, ("v",))
    with pytest.raises(FileError, match="no column 'w'; known: when, v"):
        numeric_columns("b", found, ("w",))


def test_an_array_of_axes_is_split_by_its_shorter_side(tmp_path):
    counts = np.arange(12).reshape(2, 6)
    np.savez(tmp_path / "n.npz", x=counts, fs=8.0)
    found = read_table(tmp_path / "n.npz")
    assert list(found) == ["x[0]", "x[1]", "fs"]
    assert np.array_equal(found["x[1]"], counts[1])
    with pytest.raises(FileError, match="different lengths"):
        numeric_columns("n", found, ("x[0]", "fs"))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"a,b\n1,2\n1,2,3\n", "line 3: 3 cells, expected 2"),
        (b"a,a\n1,2\n", "line 1: duplicate or empty column name 'a'"),
        (b"", "no column of numbers"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"),
        (b"PAR1 and no more", "Parquet"),
        (b"PK\x03\x04 and no more", "archive"),
        (b"a,b\n\xff,1\n", "line 2: is not UTF-8"),
        (",".join(f"c{k}" for k in range(300)).encode(), "300 columns"),
    ],
)
def test_what_is_damaged_is_one_line(tmp_path, data, reason):
    (tmp_path / "x").write_bytes(data)
    with pytest.raises(FileError, match=reason):
        read_table(tmp_path / "x")
