"""Pictures of random boards after calibration, of phases over temperature, and of the shares of the noise.

Source    docs/paper.md
"""

import math

import numpy as np

from testbench.console.figure_files import Picture
from testbench.console.report import GREEN, GREY, SKY, VERMILION, make_axes, name_axes
from testbench.paper.calibration.calibrate_phases import NODES
from testbench.paper.pictures import draw


def noise_shares(noise, seconds):
    """ARW with one source on, and with each one off; `seconds` of record, by which white noise scatters.

    The fit's first point has 0.3 s: its variance is known to sqrt(2 * 0.3 / T), the deviation to half of that.
    """
    figure, axes = make_axes("Noise: share of each source in the angle random walk", 5.8, 1, 2, sharey=True)
    for axis, word in zip(axes[0], ("only", "without")):
        names = [name for name in noise if name.startswith(word)]
        values = np.array([noise[name]["arw_deg_per_rt_h"] for name in names])
        sigma = values * np.array([math.sqrt(0.6 / seconds[name]) / 2 for name in names])
        draw.draw_marks(
            axis, range(len(names)), values, sigma, "only this source, or all without it; 1 sigma", markersize=7
        )
        axis.axhline(noise["all"]["arw_deg_per_rt_h"], color=VERMILION, linestyle="--", label="all on")
        axis.axhline(noise["none"]["arw_deg_per_rt_h"], color=GREY, linestyle=":", label="all off")
        axis.set_ylim(bottom=0.0)
        axis.set_xticks(range(len(names)), [name.split(" ", 1)[1] for name in names], rotation=30)
        name_axes(axis, f"{word} this source", "ARW (deg/sqrt(h))" if word == "only" else "")
    draw.legend(figure)
    return Picture(
        "noise_shares",
        "What to see: the C/V noise causes nearly all of the angle random walk, the converter nearly all that remains.",
        figure,
    )


def residuals(boards):
    """Truth after calibration, with the procedure's own uncertainty, board by board."""
    figure, axes = make_axes("Random boards: residuals after calibration, and their stated uncertainty", 8.4, 2, 2)
    for axis, node in zip(axes.ravel(), NODES):
        y = [1e3 * b["residual_deg"][node] for b in boards]
        u = [1e3 * b["uncertainty_deg"][node] for b in boards]
        draw.draw_marks(axis, np.arange(len(boards)), y, u, "true residual, stated uncertainty (99 %)", ecolor=SKY)
        axis.axhspan(-2, 2, color=GREEN, alpha=0.12, label="target, 2 mdeg")
        axis.axhline(0, color=GREY, linewidth=1)
        axis.xaxis.get_major_locator().set_params(integer=True)
        name_axes(axis, "board", f"residual {draw.NODE_TEXT[node]} (mdeg)")
    draw.legend(figure)
    worst = max(abs(v) for b in boards for v in b["residual_deg"].values())
    return Picture(
        "random_boards",
        f"What to see: the bars include 0. The largest residual is {1e3 * worst:.1f} mdeg, the paper's level 12 mdeg.",
        figure,
    )


def phase_drift(temps_degc, phases, start):
    """Phases over temperature from the parts' laws; `phases` and `start`, at 25 degC, of `temperature.phases`."""
    figure, axes = make_axes("Phases over temperature, computed from the parts' laws (no statistics)", 6.4, 1, 1)
    axis = axes[0, 0]
    for k, node in enumerate(NODES):
        label = f"{draw.NODE_TEXT[node]}: {start[node][0]:.3f} deg at 25 degC"
        axis.plot(temps_degc, 1e3 * (np.array(phases[node]) - start[node][0]), label=label, **draw.case_style(k + 1))
    axis.axhspan(-12, 12, color=GREEN, alpha=0.12, label="the paper's level, 12 mdeg")
    name_axes(axis, "temperature (degC)", "phase minus phase at 25 degC (mdeg)")
    draw.legend(figure)
    return Picture(
        "phases_over_temperature",
        "What to see: xe2 and ye2 rise with temperature because the bandwidth of the pickoff's op amps falls by "
        "0.2 %/K. xe1 and ye1 hardly change because the base plant has no drift of the output path's resistors.",
        figure,
    )
