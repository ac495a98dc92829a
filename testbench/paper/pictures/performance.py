"""Pictures of what was measured of each case at each temperature: Allan deviation, residuals of 22 rates, nonlinearity.

Source    docs/paper.md
"""

import numpy as np

from testbench.console.figure_files import Picture
from testbench.console.report import FONT, GREY, VERMILION, make_axes, name_axes
from testbench.paper.pictures import draw


def _by_temperature(points):
    """{temperature: {case: point}}, both in order."""
    return {
        t: {c: points[c, t] for c in sorted(c for c, u in points if u == t)} for t in sorted({t for _, t in points})
    }


def allan(points, printed):
    """Allan deviation of all cases, one panel a temperature.

    printed  {"arw_deg_per_rt_h" or "instability_deg_per_h": {temperature: (value, sigma)}} of the paper, or {}
    """
    points_by_temp = _by_temperature(points)
    figure, axes = make_axes("Allan deviation at rest, 1 sigma", 6.4, 1, len(points_by_temp), sharey=True)
    for axis, (temp, cases) in zip(axes[0], points_by_temp.items()):
        axis.set_xscale("log")
        axis.set_yscale("log")
        for k, (case, p) in enumerate(cases.items()):
            if p.get("tau_s"):
                hours = np.array(p["adev_dps"]) * 3600
                style = draw.case_style(case) | {"markersize": 4, "capsize": 2}
                draw.draw_marks(axis, p["tau_s"], hours, hours * np.array(p["adev_sigma"]), f"case {case}",
                            draw.mark_shift_pt(k, len(cases)) / 2, **style)  # fmt: skip
        tau = np.array([0.1, 100.0])
        if temp in printed.get("arw_deg_per_rt_h", {}):
            arw, _ = printed["arw_deg_per_rt_h"][temp]
            axis.plot(tau, arw * 60 / np.sqrt(tau), "--", color=GREY, label="paper, ARW")
        if temp in printed.get("instability_deg_per_h", {}):
            axis.axhline(
                printed["instability_deg_per_h"][temp][0], color=GREY, linestyle=":", label="paper, bias instability"
            )
        axis.set_title(f"{temp:g} degC", fontsize=FONT["label"], loc="left")
        name_axes(axis, "averaging time (s)", "overlapping Allan deviation (deg/h)" if axis is axes[0, 0] else "")
    draw.legend(figure)
    return Picture(
        "allan_deviation",
        "What to see: white rate noise up to averaging times of about 10 s, then the minimum set by the 1/f noise "
        "after the SID. Both are nearly the same at all temperatures of the study. Neighbouring points share most "
        "of their data.",
        figure,
    )


def scale_residuals(points, rates_dps):
    """Residuals of the rates (deg/s), and V_q over rate, one column a temperature."""
    points_by_temp = _by_temperature(points)
    figure, axes = make_axes(
        "22 rates: residual of the fitted line, and V_q", 8.4, 2, len(points_by_temp), sharey="row"
    )
    for column, (temp, cases) in enumerate(points_by_temp.items()):
        for k, (case, p) in enumerate(cases.items()):
            style = draw.case_style(case) | {"markersize": 4}
            bars = [p.get("nonlinearity_sigma_ppm")] * len(rates_dps)
            shift_pt = draw.mark_shift_pt(k, len(cases)) / 2
            draw.draw_marks(
                axes[0, column], rates_dps, p["scale_residual_ppm"], bars, f"case {case}, 1 sigma", shift_pt, **style
            )
            bars = [p.get("quadrature_sigma_v")] * len(rates_dps)
            draw.draw_marks(
                axes[1, column], rates_dps, p["quadrature_v_of_rate"], bars, f"case {case}, 1 sigma", shift_pt, **style
            )
        axes[0, column].set_title(f"{temp:g} degC", fontsize=FONT["label"], loc="left")
        first = column == 0
        name_axes(axes[0, column], "", "residual (ppm of 500 deg/s)" if first else "")
        name_axes(axes[1, column], "rate (deg/s)", "V_q (V)" if first else "")
    draw.legend(figure)
    return Picture(
        "scale_residuals",
        "What to see: with ye1 uncompensated, V_q changes with the rate and reaches its ceiling for one sign of the "
        "rate. There the line bends: in case 3 more than in cases 1 and 2, and not in cases 4 and 5.",
        figure,
    )


def nonlinearity(explained, wide, printed):
    """Nonlinearity of cases 1 to 3 over temperature: measured, within V_q's range, by the rails alone, with more span.

    explained  {(case, temperature): (`nonlinearity.Explained`, sigma)}
    wide       {case: ppm} with more span at 25 degC
    printed    {temperature: (value, sigma)} of the paper's mean, or {}
    """
    temps = sorted({t for _, t in explained})
    figure, axes = make_axes(
        "Cause of the nonlinearity of the scale factor: V_q at its limits", 5.8, 1, len(temps), sharey=True
    )
    rows = (
        "measured, 1 sigma",
        "rates without V_q saturation, 1 sigma",
        "computed from V_q saturation (closed form)",
        "measured with more V_q span",
    )
    for axis, temp in zip(axes[0], temps):
        mine = {c: explained_pair for (c, t), explained_pair in sorted(explained.items()) if t == temp}
        names = list(mine)
        values = [
            [e.measured_ppm for e, _ in mine.values()],
            [e.unrailed_ppm for e, _ in mine.values()],
            [e.rail_ppm for e, _ in mine.values()],
            [wide[c] if temp == 25.0 and c in wide else np.nan for c in names],
        ]
        for k, (row, numbers) in enumerate(zip(rows, values)):
            bars = [s if k < 2 else None for _, s in mine.values()]
            draw.draw_marks(axis, range(len(names)), numbers, bars, row, 2.5 * draw.mark_shift_pt(k, len(rows)),
                        markersize=8, color=draw.COLOURS[k], marker=draw.MARKS[k])  # fmt: skip
        if temp in printed:
            axis.axhline(printed[temp][0], color=VERMILION, linestyle=":", label="paper, mean of cases 1 to 3")
        axis.set_xticks(range(len(names)), [f"case {c}" for c in names])
        axis.set_xlim(-0.6, len(names) - 0.4)
        axis.set_title(f"{temp:g} degC", fontsize=FONT["label"], loc="left")
        name_axes(axis, "", "nonlinearity (ppm of 500 deg/s)" if axis is axes[0, 0] else "")
    draw.legend(figure)
    return Picture(
        "nonlinearity",
        "What to see: saturation of V_q at its ceiling, and at -20 degC also at 0 V, causes the measured nonlinearity. "
        "Without saturated rates, or with more span, only the noise of a reading remains. The nonlinearity grows from "
        "case 2 to 3 with ye2' - xe2', and with temperature as V_q does. In the paper the three cases agree and the "
        "nonlinearity falls with temperature, so it has another cause.",
        figure,
    )
