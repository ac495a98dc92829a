"""A picture as files for a publication: PNG, SVG, PDF, and the numbers that are drawn, as CSV; always the same bytes.

    CSV     panel, series, x, label, y, low, high: one row a point; label where the x axis has texts instead of numbers,
            low and high where there is an error bar, or the two ends of a bar
    bytes   identifiers from the picture's name instead of random ones, no dates

Source  docs/paper.md
"""

import csv
import io
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import QuadMesh
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter

from testbench.console.report import png_bytes
from testbench.storage.files import atomic_outputs, write_bytes

HEAD = ("panel", "series", "x", "label", "y", "low", "high")
KINDS = ("png", "svg", "pdf", "csv")


class Picture(NamedTuple):
    """A picture: the name of its files, a sentence on what to see, the figure."""

    name: str
    caption: str
    figure: Figure


def write(picture, folder):
    """Write the four files together; returns the paths by kind, and the bytes of the PNG."""
    content_by_kind = {"png": png_bytes(picture.figure)}
    picture.figure.set_layout_engine("none")  # laid out once, for all kinds
    with matplotlib.rc_context({"svg.hashsalt": picture.name, "svg.fonttype": "path"}):
        buffer = io.BytesIO()
        FigureCanvasSVG(picture.figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
        content_by_kind["svg"] = buffer.getvalue()
    buffer = io.BytesIO()
    FigureCanvasPdf(picture.figure).print_pdf(buffer, metadata={"CreationDate": None, "Creator": None})
    content_by_kind["pdf"] = buffer.getvalue()
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(HEAD)
    out.writerows(figure_csv_rows(picture.figure))
    content_by_kind["csv"] = text.getvalue().encode()
    paths = {kind: Path(folder) / f"{picture.name}.{kind}" for kind in KINDS}
    with atomic_outputs():
        for kind, path in paths.items():
            write_bytes(path, content_by_kind[kind])
    return paths, content_by_kind["png"]


def figure_csv_rows(figure):
    """Rows of `HEAD` of all that is drawn with a name: curves, marks with error bars, bars, maps."""
    rows = []
    for axis in figure.axes:
        panel = " ".join((axis.get_title(loc="left") or axis.get_ylabel() or axis.get_xlabel()).split())
        rows += [(panel, *row) for row in _axis_csv_rows(axis)]
    return rows


def _axis_csv_rows(axis):
    labels, drawn = _labels(axis), set()
    for container in axis.containers:
        if isinstance(container, ErrorbarContainer):
            line, caps, bars = container
            drawn |= {line, *caps}
            yield from _points(container.get_label(), line.get_xdata(), line.get_ydata(), labels, *_ends(bars))
        elif isinstance(container, BarContainer):
            yield from _bars(container, labels)
    for line in axis.get_lines():
        if line not in drawn and not line.get_label().startswith("_"):
            level = line.get_transform() == axis.get_yaxis_transform()  # a level across the panel has no x
            x, y = line.get_xdata(), line.get_ydata()
            yield from _points(line.get_label(), *([[""], y[:1]] if level else [x, y]), labels)
    for mesh in (*axis.images, *(c for c in axis.collections if isinstance(c, QuadMesh))):
        values = np.ma.filled(np.ma.asarray(mesh.get_array(), float), np.nan)
        for (row, column), value in np.ndenumerate(np.atleast_2d(values)):
            yield f"row {row}", column, labels.get(column, ""), _text(value), "", ""


def _text(value):
    return value if isinstance(value, str) else repr(float(value))


def _labels(axis):
    """{place: text} of an axis whose ticks are texts."""
    for ruler in (axis.xaxis, axis.yaxis):
        texts, tick_positions = ruler.get_major_formatter(), ruler.get_majorticklocs()
        if isinstance(texts, FuncFormatter) and isinstance(ruler.get_major_locator(), FixedLocator):
            return {tick: " ".join(texts(tick, k).split()) for k, tick in enumerate(tick_positions)}
    return {}


def _ends(bars):
    """(low, high) of vertical error bars."""
    if not bars:
        return ()
    ends = [segment[:, 1] if len(segment) else (np.nan, np.nan) for segment in bars[0].get_segments()]
    return [min(e) for e in ends], [max(e) for e in ends]


def _points(name, x, y, labels, low=(), high=()):
    low, high = (values if len(values) == len(y) else [""] * len(y) for values in (low, high))
    for point in zip(x, y, low, high):
        x_value, value, *ends = point
        yield name, _text(x_value), labels.get(x_value, ""), _text(value), *map(_text, ends)


def _bars(container, labels):
    for bar in container:
        flat = container.orientation == "horizontal"
        start, length = (bar.get_x(), bar.get_width()) if flat else (bar.get_y(), bar.get_height())
        bar_position = bar.get_y() + bar.get_height() / 2 if flat else bar.get_x() + bar.get_width() / 2
        label = labels.get(round(bar_position), "")
        yield container.get_label(), _text(bar_position), label, _text(length), _text(start), _text(start + length)
