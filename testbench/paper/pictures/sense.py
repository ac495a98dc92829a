"""The sense mode's pictures: the paper's figures 5 and 6, and the response of the rate channel.

The paper's pictures are not available: what each shows is taken from its running text.
Source    docs/paper.md
"""

import math

import numpy as np

from testbench.console.figure_files import Picture
from testbench.console.report import GREY, SKY, VERMILION, make_axes, name_axes
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as loops
from testbench.paper.loop import loop_parameters as loop_parts
from testbench.paper.loop.sense_grid import closed_bandwidth, phased_parameters, sense_grid
from testbench.paper.pictures import draw


def transfer_functions(config, angles_deg=(-9.0, 0.0, 9.0)):
    """Fig. 5 b-d: return ratio and closed loop over frequency for three ye1."""
    split_hz = abs(loop_parts.loop_parameters(config).split_hz)
    f = np.unique(np.concatenate([np.geomspace(0.5, 400.0, 160), split_hz + np.linspace(-6.0, 6.0, 601)]))
    rise = []
    figure, axes = make_axes(
        "Fig. 5  Force-to-rebalance loop in the frequency domain (analysis, no statistics)", 8.4, 2, 2
    )
    for k, angle in enumerate(angles_deg):
        p = phased_parameters(config, ye1_deg=angle)
        ratio = loops.return_ratio(p, f)
        level = 20 * np.log10(np.abs(ratio))
        rise.append(float(level[f > 100.0].max() - level[(f > 60.0) & (f < split_hz)].min()))
        h = loops.response(loops.close(p), f)
        h = h / loops.response(loops.close(p), np.array([0.01]))[0].real
        style = {"color": draw.COLOURS[k], "linestyle": draw.LINES[k], "label": f"ye1 = {angle:g} deg"}
        for column, (values, what) in enumerate(((ratio, "return ratio"), (h, "closed loop"))):
            axes[0, column].semilogx(f, 20 * np.log10(np.abs(values)), **style)
            axes[1, column].semilogx(f, np.degrees(np.unwrap(np.angle(values))), **style)
            name_axes(axes[0, column], "frequency (Hz)", f"{what}, gain (dB)")
            name_axes(axes[1, column], "frequency (Hz)", f"{what}, phase (deg)")
    draw.legend(figure)
    return Picture(
        "fig_5_transfer_functions",
        f"What to see: the resonance at the split, {split_hz:.0f} Hz, is {rise[1]:.0f} dB above the minimum below it. "
        "There the phase lag of the demodulator's poles is large enough for stability. +-9 deg of ye1 hardly change "
        "the curves.",
        figure,
    )


def scale_by_phases(rows):
    """Fig. 6 a: scale factor of simulated gyroscopes over ye1 at three ye2; rows of `phase_laws.sense_law`."""
    figure, axes = make_axes("Fig. 6 a  Scale factor over both sense phase errors", 5.6, 1, 2)
    unit = next(r["lsb_per_dps"] for r in rows if r["ye1"] == 0.0 and r["ye2"] == 0.0)
    worst = 0.0
    for k, b in enumerate(sorted({r["ye2"] for r in rows})):
        mine = sorted((r for r in rows if r["ye2"] == b), key=lambda r: r["deg"]["ye1"])
        x = np.array([r["deg"]["ye1"] for r in mine])
        y = np.array([r["lsb_per_dps"] for r in mine]) / unit
        sigma = np.array([r["sigma_lsb_per_dps"] for r in mine]) / unit
        law = np.array([r["inverse_cosine"] for r in mine])
        style = draw.case_style(k + 1) | {"linestyle": "none"}
        draw.draw_marks(
            axes[0, 0], x, 100 * (y - 1), 100 * sigma, f"ye2 = {b:g} deg, 1 sigma", draw.mark_shift_pt(k, 3), **style
        )
        off = 1e6 * (y / law - 1)
        draw.draw_marks(axes[0, 1], x, off, 1e6 * sigma, f"ye2 = {b:g} deg, 1 sigma", draw.mark_shift_pt(k, 3), **style)
        worst = max(worst, float(np.abs(off).max()))
    fine = np.linspace(-9.0, 9.0, 91)
    axes[0, 0].plot(fine, 100 * (1 / np.cos(np.radians(fine)) - 1), "--", color=GREY, label="1/cos(ye1), xe2' = 0")
    name_axes(axes[0, 0], "ye1 (deg)", "scale factor minus that at 0 deg (%)")
    name_axes(axes[0, 1], "ye1 (deg)", "deviation from 1/cos(ye1 + xe2') (ppm)")
    draw.legend(figure)
    return Picture(
        "fig_6a_scale_factor",
        f"What to see: the scale factor follows 1/cos(ye1) within {worst:.0f} ppm and does not depend on ye2. This is "
        "the paper's eq (12), which assumes an infinite loop gain.",
        figure,
    )


def sense_errors(config):
    """Fig. 6 b: bandwidth and phase over ye1 and ye2, by the linear loop."""
    rows = sense_grid(config)
    figure, axes = make_axes(
        "Fig. 6 b  Bandwidth, and phase at 10 Hz, over both sense phases (analysis, no statistics)", 5.6, 1, 2
    )
    for k, b in enumerate(sorted({r[1] for r in rows})):
        mine = [r for r in rows if r[1] == b]
        for axis, column in zip(axes[0], (2, 3)):
            axis.plot(
                [r[0] for r in mine], [r[column] for r in mine], label=f"ye2 = {b:g} deg", **draw.case_style(k + 1)
            )
    name_axes(axes[0, 0], "ye1 (deg)", "bandwidth (Hz)")
    name_axes(axes[0, 1], "ye1 (deg)", "phase at 10 Hz (deg)")
    draw.legend(figure)
    ye1_only_hz = [r[2] for r in rows if r[1] == 0.0]
    every = [r[2] for r in rows]
    nominal_hz = closed_bandwidth(phased_parameters(config))
    gain = closed_bandwidth(advisor.vary_parameters(phased_parameters(config), crossover=math.cos(math.radians(9.0))))
    return Picture(
        "fig_6b_bandwidth",
        f"What to see: ye1 alone changes the bandwidth by {max(ye1_only_hz) - min(ye1_only_hz):.2f} Hz, both phases by "
        f"{max(every) - min(every):.2f} Hz; the paper says less than 0.3 Hz. The loop gain is proportional to "
        f"cos(ye1 + ye2'), which at 9 deg explains {nominal_hz - gain:.2f} Hz. The coupling to the quadrature loop "
        "explains the remainder.",
        figure,
    )


def response(points, config):
    """Frequency response of the simulated gyroscope beside the linear loop."""
    figure, axes = make_axes("Rate channel: simulated gyroscope and analysis", 8.4, 2, 1)
    f = np.geomspace(0.5, 125.0, 200)
    closed = loops.close(loop_parts.loop_parameters(config))
    h = loops.response(closed, f) / loops.response(closed, np.array([1e-3]))[0].real
    names = sorted({c for c, t in points if t == 25.0})
    for axis, curve in zip(axes[:, 0], (20 * np.log10(np.abs(h)), np.degrees(np.unwrap(np.angle(h))))):
        axis.set_xscale("log")
        axis.plot(f, curve, color=GREY, label="analysis")
    for k, case in enumerate(names):
        p = points[case, 25.0]
        db = p.get("response_sigma_db")
        style = draw.case_style(case) | {"linestyle": "none"}
        # a relative error r of a line is 8.686 r dB and r rad
        for axis, values, sigma in ((axes[0, 0], "response_db", db), (axes[1, 0], "response_deg", db and db * 6.596)):
            bars = [None if sigma is None else sigma / 10 ** (g / 20) for g in p["response_db"]]
            draw.draw_marks(
                axis,
                p["response_hz"],
                p[values],
                bars,
                f"case {case}, 1 sigma",
                draw.mark_shift_pt(k, len(names)),
                **style,
            )
        if k == 0:
            axes[0, 0].plot(p["swept_hz"], p["swept_db"], "-", color=SKY, label=f"swept rate, case {case}")
    axes[0, 0].axhline(-3.0103, color=VERMILION, linestyle=":", label="-3.01 dB")
    name_axes(axes[0, 0], "frequency (Hz)", "gain (dB)")
    name_axes(axes[1, 0], "frequency (Hz)", "phase (deg)")
    draw.legend(figure)
    return Picture(
        "response",
        "What to see: all cases and the analysis give the same curve. The split at 139 Hz causes the ripple at its "
        "right end.",
        figure,
    )
