"""Pictures of a study of word lengths: plain results in, matplotlib figures 1200 pixels wide out.

Source    docs/word_lengths.md
"""

import numpy as np

from testbench.console.report import BLUE, GREY, VERMILION, make_axes, name_axes

COSTS = (("registers", "register bits"), ("multipliers", "multiplier bits"), ("tables", "table bits"))


def prediction_comparison(result):
    """Runs beside predictions, a design to a column: ARW, noise, largest line, scale factor."""
    rows = list(result.rows)
    x, names = np.arange(len(rows)), [row[0] for row in rows]
    holds = np.array([row[1]["holds"] for row in rows])
    base = rows[0]
    panels = (
        ("ARW\n(deg/sqrt(h))", lambda p: p["arw_deg_per_rt_h"], lambda s: s.arw_deg_per_rt_h),
        ("noise of the\nrate word (LSB)", lambda p: p["noise_lsb"], lambda s: s.noise_lsb),
        ("largest line,\ndrive DAC (dBc)", lambda p: p["spur_dbc"], lambda s: s.spur_dbc),
        (
            "scale factor\nchange (ppm)",
            lambda p: 1e6 * (p["scale_lsb_per_dps"] / base[1]["scale_lsb_per_dps"] - 1),
            lambda s: s.scale_ppm,
        ),
    )
    figure, axes = make_axes("Prediction and simulation", 11.0, len(panels), 1, sharex=True)
    for axis, (label, predicted, simulated_function) in zip(axes[:, 0], panels):
        values = np.array([simulated_function(row[3]) for row in rows])
        axis.plot(x, [predicted(row[1]) for row in rows], "_", color=GREY, markersize=18, mew=2, label="prediction")
        axis.plot(x[holds], values[holds], "o", color=BLUE, label="simulation, rule holds")
        axis.plot(x[~holds], values[~holds], "o", mfc="white", color=VERMILION, label="simulation, rule does not hold")
        name_axes(axis, "", label)
    axes[0, 0].legend(loc="best", fontsize=11, frameon=False)
    axes[-1, 0].set_xticks(x, names, rotation=90)
    figure.align_ylabels()
    return figure


def fronts(result):
    """Loss over cost with the Pareto fronts: ARW rise and moved scale factor, by each kind of bits."""
    from testbench.study.study import KEEP_PPM, KEEP_SHARE, front

    rows = list(result.rows)
    losses = (
        ("ARW rise (%)", [max(100 * row[3].arw_rise, 1e-2) for row in rows], 100 * KEEP_SHARE),
        ("scale factor change (ppm)", [max(abs(row[3].scale_ppm), 1.0) for row in rows], KEEP_PPM),
    )
    keeps, holds = (np.array([pick(row) for row in rows]) for pick in (lambda r: r[3].keeps, lambda r: r[1]["holds"]))
    figure, axes = make_axes("Cost against loss", 9.0, len(losses), len(COSTS))
    for line, (label, loss, limit) in zip(axes, losses):
        for axis, (kind, text) in zip(line, COSTS):
            price = np.array([getattr(row[2], kind) for row in rows])
            loss = np.array(loss)
            rule_indices = np.flatnonzero(holds)
            best = rule_indices[front(price[rule_indices].tolist(), loss[rule_indices].tolist())]
            axis.plot(
                price[best], loss[best], "-", color=GREY, drawstyle="steps-post", label="Pareto front, rule holds"
            )
            axis.plot(price[keeps], loss[keeps], "o", color=BLUE, label="keeps all figures")
            axis.plot(price[~keeps], loss[~keeps], "o", mfc="white", color=VERMILION, label="does not keep all figures")
            axis.axhline(limit, color=GREY, linestyle=":")
            axis.set_yscale("log")
            if kind == "tables":
                axis.set_xscale("log")
            name_axes(axis, text, label if kind == "registers" else "")
    axes[0, 0].legend(loc="best", fontsize=11, frameon=False)
    return figure
