"""The drive mode's pictures: the paper's figure 2, and its records of phases, figures 3 and 7.

The paper's pictures are not available: what each shows is taken from its running text.
Source    docs/paper.md
"""

import numpy as np

from testbench.console.figure_files import Picture
from testbench.console.report import FONT, VERMILION, make_axes, name_axes
from testbench.paper.pictures import draw


def drive_errors(rows, config):
    """Fig. 2 b, c: simulated gyroscopes over xe1 at -30 deg/s with ye1 = -9 and ye2 = -6 deg, beside the formulas.

    rows  of `phase_laws.drive_law`
    """
    device = config.device()
    angle = np.array([row["deg"]["xe1"] + row["deg"]["xe2"] for row in rows])
    first = rows[0]["deg"]
    figure, axes = make_axes(
        f"Fig. 2 b, c  Drive phase error at -30 deg/s, ye1 = {first['ye1']:.0f} deg, ye2 = {first['ye2']:.0f} deg",
        8.0,
        2,
        2,
    )
    fine = np.linspace(angle.min(), angle.max(), 121)
    f, a, v, w = (np.array([row[n] for row in rows]) for n in ("frequency_hz", "drive_v", "quadrature_v", "rate_word"))
    sigma = {name: np.array([row["sigma"][name] for row in rows]) for name in rows[0]["sigma"]}
    slope = -device.fx_hz / (2 * device.qx) * np.tan(np.radians(fine)) * 1e3
    unit = float(np.mean(a * np.cos(np.radians(angle))))
    panels = (
        ((f - device.fx_hz) * 1e3, sigma["frequency_hz"] * 1e3, slope, "drive frequency minus f_x (mHz)",
         "formula: -f/(2Q) tan(xe1 + xe2')"),
        (1e3 * a, 1e3 * sigma["drive_v"], 1e3 * unit / np.cos(np.radians(fine)), "drive amplitude A_d (mV)",
         "formula: 1/cos(xe1 + xe2')"),
        ((v - v.mean()) * 1e6, sigma["quadrature_v"] * 1e6, None, f"V_q minus {v.mean():.4f} V (uV)", ""),
        ((w / w.mean() - 1) * 1e6, np.abs(sigma["rate_word"] / w.mean()) * 1e6, None, "rate word minus mean (ppm)", ""),
    )  # fmt: skip
    for axis, (values, bars, curve, name, formula) in zip(axes.ravel(), panels):
        if curve is not None:
            axis.plot(fine, curve, color=VERMILION, linestyle="--", label=draw.FORMULA)
            axis.set_title(formula, fontsize=FONT["small"], loc="right")
        draw.draw_marks(axis, angle, values, bars, draw.MODEL)
        name_axes(axis, "xe1 + xe2' (deg)", name)
    draw.legend(figure)
    return Picture(
        "fig_2_drive_phase",
        f"What to see: 18 deg of drive phase change the frequency by {1e3 * np.ptp(f):.1f} mHz and the drive voltage "
        f"by {100 * (a.max() / a.min() - 1):.2f} %. V_q changes by only {1e6 * np.ptp(v):.0f} uV and the rate word by "
        f"{1e6 * np.ptp(w) / abs(w.mean()):.0f} ppm, because the drive loops keep x at its reference for any phase of "
        "the force.",
        figure,
    )


def phase_record(records, nodes, number):
    """Figs. 3 and 7: two hours of phase readings, each case by its mark.

    records  {case: rows of `record_phases.record`}
    """
    figure, axes = make_axes(f"Fig. {number}  Phases over two hours after warm-up, minus their mean", 5.6, 1, 2)
    for axis, node in zip(axes[0], nodes):
        for k, (case, rows) in enumerate(sorted(records.items())):
            t = np.array([r["time_s"] for r in rows]) / 60
            y = np.array([r[node] for r in rows])
            scatter = [1e3 * y.std(ddof=1)] * len(y)
            style = draw.case_style(case) | {"linestyle": "none"}
            draw.draw_marks(
                axis,
                t,
                1e3 * (y - y.mean()),
                scatter,
                f"case {case}, 1 sigma",
                draw.mark_shift_pt(k, len(records)),
                **style,
            )
        truth = np.array([r["truth"][node] for r in records[max(records)]])
        times = np.array([r["time_s"] for r in records[max(records)]]) / 60
        axis.plot(times, 1e3 * (truth - truth.mean()), color=draw.COLOURS[-1], label="true phase of the last case")
        name_axes(axis, "time from power-on (min)", f"{draw.NODE_TEXT[node]} minus its mean (mdeg)")
    draw.legend(figure)
    worst = max(
        abs(r[node] - np.mean([q[node] for q in rows])) for rows in records.values() for r in rows for node in nodes
    )
    return Picture(
        f"fig_{number}_phases_over_time",
        f"What to see: the largest deviation of a reading from its mean is {1e3 * worst:.1f} mdeg; the true phase "
        "changes by less. The paper's fluctuation is 7 to 9 mdeg. Bars: standard deviation of a case's readings.",
        figure,
    )
