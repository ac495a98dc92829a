"""What the page opens with: the waterfall of the phase budget, and the cases beside the paper's numbers.

Source    docs/paper.md, docs/phases.md
"""

from testbench.console.figure_files import Picture
from testbench.console.report import BLUE, FONT, GREEN, GREY, ORANGE, VERMILION, make_axes, name_axes
from testbench.paper.pictures import draw

# steps of the waterfall: rows of the budget by the words that they begin with
STEPS = {
    "registers": ("DDS", "sine", "extra pipeline", "product", "SPI load"),
    "SPI frame": ("SPI frame",),
    "extra frames": ("extra 1 us",),
    "hold of update": ("hold",),
    "DAC response": ("DAC response",),
    "output poles": ("output pole",),
    "ring diode": ("ring diode",),
    "amplifiers": ("instrumentation", "unity"),
    "ref. registers": ("reference: DDS", "reference: sign", "reference: alignment"),
    "ref. edges": ("reference: edge", "reference: wait"),
}
OTHER = "other"
QUANTITIES = (
    ("scale_lsb_per_dps", "scale_noise_lsb_per_dps", "scale factor (LSB per deg/s)"),
    ("quadrature_v", "quadrature_sigma_v", "V_q (V)"),
    ("bias_dps", "bias_sigma_dps", "zero-rate output (deg/s)"),
    ("bandwidth_hz", "bandwidth_sigma_hz", "bandwidth (Hz)"),
    ("arw_deg_per_rt_h", "arw_sigma_deg_per_rt_h", "ARW (deg/sqrt(h))"),
    ("nonlinearity_ppm", "nonlinearity_sigma_ppm", "nonlinearity (ppm)"),
)


def waterfall_steps(rows):
    """{step: (deg, assumed)} of the rows of one phase, without steps of 0; `assumed` if any of its rows is."""
    out = {}
    for row in rows:
        name = next((step for step, begins in STEPS.items() if row.what.startswith(begins)), OTHER)
        deg, assumed = out.get(name, (0.0, False))
        out[name] = deg + row.degrees, assumed or bool(row.is_assumed and row.degrees)
    return {name: value for name, value in out.items() if abs(value[0]) > 1e-9}


def waterfall(planned, printed):
    """Step by step from the reference pin, or from the motion, to each node phase.

    planned  `budget.Budget`
    printed  {node: (deg, sigma)} of the paper, or {}
    """
    figure, axes = make_axes("Phase budget: contributions to each of the four phases", 9.0, 2, 2)
    for axis, (node, rows) in zip(axes.ravel(), planned.rows.items()):
        steps, start = waterfall_steps(rows), 0.0
        for bar_position, (deg, assumed) in enumerate(steps.values()):
            text = "contains an assumed or fitted value" if assumed else "follows from the design"
            axis.bar(bar_position, deg, 0.7, start, color=ORANGE if assumed else BLUE, label=text,
                     hatch="//" if assumed else "", edgecolor="white")  # fmt: skip
            axis.annotate(f"{deg:+.2f}", (bar_position, max(start, start + deg)), (0, 3), textcoords="offset points",
                          ha="center", fontsize=FONT["small"])  # fmt: skip
            start += deg
        names = [*steps, "sum"]
        axis.bar(len(steps), start, 0.7, color=GREEN, label="sum", edgecolor="white")
        axis.annotate(f"{start:.3f}", (len(steps), start), (0, 3), textcoords="offset points", ha="center",
                      fontsize=FONT["small"])  # fmt: skip
        if node in printed:
            deg, sigma = printed[node]
            names.append("paper")
            draw.draw_marks(axis, [len(steps) + 1], [deg], [sigma], "paper, standard uncertainty", color=VERMILION,
                        marker="x", markersize=9)  # fmt: skip
            axis.annotate(f"{deg:.3f}", (len(steps) + 1, deg), (0, 8), textcoords="offset points", ha="center",
                          fontsize=FONT["small"])  # fmt: skip
        axis.set_xticks(range(len(names)), names, rotation=40, ha="right", rotation_mode="anchor",
                        fontsize=FONT["small"])  # fmt: skip
        axis.set_xlim(-0.6, len(names) - 0.4)
        axis.set_ylim(top=1.1 * axis.get_ylim()[1])
        axis.set_title(f"{node}, node phase", fontsize=FONT["label"], loc="left")
        name_axes(axis, "", "lag (deg)")
    draw.legend(figure)
    return Picture(
        "waterfall",
        "What to see: digital delays cause most of xe1 and ye1; the ring diode causes most of xe2 and ye2. A hatched "
        "step contains a value that no document states; the table of the phase budget names it.",
        figure,
    )


def cases(points, names, printed, title, caption, file):
    """Six quantities over temperature, one mark a case, and the paper's means of cases 1 to 3.

    points   {(case, temperature): numbers}
    printed  {quantity: {temperature: (value, sigma)}} of the paper, or {}
    """
    figure, axes = make_axes(title, 8.4, 2, 3)
    temps = sorted({t for _, t in points})
    for axis, (name, sigma, label) in zip(axes.ravel(), QUANTITIES):
        for k, case in enumerate(names):
            rows = [(t, points[case, t]) for t in temps if points.get((case, t), {}).get(name) is not None]
            draw.draw_marks(axis, [t for t, _ in rows], [p[name] for _, p in rows], [p.get(sigma) for _, p in rows],
                        f"case {case}", draw.mark_shift_pt(k, len(names)), **draw.case_style(case))  # fmt: skip
        paper = printed.get(name)
        if paper:
            draw.draw_marks(axis, list(paper), [v for v, _ in paper.values()], [s for _, s in paper.values()],
                        "paper, mean of cases 1 to 3 and its spread", color=GREY, marker="x", markersize=9,
                        elinewidth=2)  # fmt: skip
        axis.margins(x=0.12)
        name_axes(axis, "temperature (degC)", label)
    draw.legend(figure)
    return Picture(file, caption, figure)
