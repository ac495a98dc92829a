"""How the page's pictures are drawn: five cases that can be distinguished, error bars, legends beside the data.

A case has a colour of Okabe and Ito, a mark, a line style and a place some points beside the others; numbers stay.
Source    docs/paper.md
"""

import numpy as np
from matplotlib.transforms import ScaledTranslation

from testbench.console.report import BLUE, DPI, FONT, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, WIDTH_IN

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY)
MARKS = ("o", "s", "^", "D", "v")
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
HANDLE_PX, LETTER_PX = 90, 7.6  # of an entry of a legend
CASE_SPACING_PT = 4.0  # between the marks of two cases
NODE_TEXT = {"xe1": "xe1", "xe2": "xe2'", "ye1": "ye1", "ye2": "ye2'"}
MODEL, FORMULA = "simulated, 1 sigma", "formula"


def case_style(case):
    """Colour, mark and line style of a case "1" .. "5"."""
    k = (int(case) - 1) % len(MARKS)
    return {"color": COLOURS[k], "marker": MARKS[k], "linestyle": LINES[k]}


def draw_marks(axis, x, y, sigma, label, shift_pt=0.0, **style):
    """Marks with error bars, `shift_pt` typographic points from their place; a sigma that is None or nan has no bar."""
    transform = axis.transData + ScaledTranslation(shift_pt / 72, 0, axis.figure.dpi_scale_trans)
    bars = np.array([np.nan if s is None else s for s in sigma], float)
    style = {
        "color": BLUE,
        "marker": "o",
        "linestyle": "none",
        "markersize": 5,
        "capsize": 3,
        "elinewidth": 1.2,
    } | style
    axis.errorbar(x, y, yerr=bars, label=label, transform=transform, **style)
    # what is drawn beside its place does not count for the axes' limits by itself
    x, y, bars = np.asarray(x, float), np.asarray(y, float), np.nan_to_num(bars)
    if len(x):
        axis.update_datalim(np.column_stack([np.tile(x, 2), np.concatenate([y - bars, y + bars])]))
        axis.autoscale_view()


def mark_shift_pt(number, count):
    """Typographic points that mark `number` of `count` stands beside its place."""
    return CASE_SPACING_PT * (number - (count - 1) / 2)


def legend(figure):
    """One legend below all panels, each name once, in as many columns as there is room for."""
    handle_by_label = {}
    for axis in figure.axes:
        for handle, text in zip(*axis.get_legend_handles_labels()):
            handle_by_label.setdefault(text, handle)
    wide = HANDLE_PX + LETTER_PX * max(map(len, handle_by_label), default=0)
    columns = max(1, min(len(handle_by_label), int(WIDTH_IN * DPI / wide)))
    figure.legend(
        handle_by_label.values(), handle_by_label.keys(), loc="outside lower center", ncols=columns,
        fontsize=FONT["small"], frameon=False,
    )  # fmt: skip
