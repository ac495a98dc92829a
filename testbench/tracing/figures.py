"""Pictures of a finished trace: each a matplotlib Figure with a caption that says what to see.

Colours are Okabe and Ito's; before is always vermilion and dashed, after always blue and solid.
"""

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import norm

from testbench.console.report import BLUE, GREEN, GREY, VERMILION, plain_axes
from testbench.tracing.fit.rank import Projection, prior_z

MOST_DRAWN_LAWS = 12  # laws in a picture
MOST_POINTS = 4000


def _axes(columns=1, height=4.2, width=10.5):
    figure = Figure(figsize=(width, height), dpi=100, layout="constrained", facecolor="white")
    axes = figure.subplots(1, columns, squeeze=False)[0]
    plain_axes(axes)
    return figure, axes


def _bars(rows, color, label):
    """Horizontal bars of [(length, name)]."""
    figure, (axis,) = _axes(height=1.5 + 0.3 * len(rows))
    axis.barh(range(len(rows)), [length for length, _ in rows], color=color)
    axis.set_yticks(range(len(rows)), [name for _, name in rows])
    axis.set_xlabel(label)
    return figure, axis


def _annotate_cells(axis, values, form, white):
    """Numbers of a matrix in its image, white where `white(value)`; nan: none."""
    axis.grid(False)
    for i, j in np.argwhere(np.isfinite(values)):
        color = "white" if white(values[i, j]) else "k"
        axis.text(j, i, format(values[i, j], form), ha="center", va="center", fontsize=7, color=color)


def heldout_errors(tracer):
    """Error before and after, in units of each observable's own repeatability."""
    rows = [(k, r) for k, r in tracer.heldout.rows.items() if r["floor"]]
    if not rows:
        return None
    figure, (axis,) = _axes(height=1.6 + 0.45 * len(rows))
    for i, (_, r) in enumerate(rows):
        for label, colour, shift, style in (("before", VERMILION, 0.15, "s"), ("after", BLUE, -0.15, "o")):
            x, (low, high) = r[label] / r["floor"], np.array(r[label + "_ci"]) / r["floor"]
            axis.errorbar(x, i + shift, xerr=[[x - low], [high - x]], fmt=style, color=colour, capsize=3)
    axis.axvline(1.0, color=GREY, linestyle=":")
    axis.set_yticks(range(len(rows)), [k for k, _ in rows])
    axis.set_ylim(-0.6, len(rows) - 0.4)
    axis.set_xscale("log")
    axis.set_xlabel("held-out rms / repeatability (1 = noise only)")
    axis.plot([], [], "s", color=VERMILION, label="before (calibrated, no law)")
    axis.plot([], [], "o", color=BLUE, label="after")
    axis.legend(frameon=False, loc="upper right")
    return "Error on held-out data, with 95 % intervals. A blue dot at 1 means that only noise remains.", figure


def ranking(tracer):
    """Sizes d of all laws at the base fit."""
    rows = []
    for r in tracer.ranked.values():
        rows += [(abs(float(t)), n) for t, n in zip(r.t, r.names)]
    rows = sorted(rows)[-MOST_DRAWN_LAWS:]
    if not rows:
        return None
    best = tracer.found.best if tracer.found else ()
    colors = [BLUE if name in best else GREY for _, name in rows]
    figure, axis = _bars(rows, colors, "d: size in sigmas, with all nuisance parameters fitted")
    if tracer.power:
        d90 = [v["d"] for v in tracer.power["d90"].values() if v["d"] is not None]
        if d90:
            axis.axvline(min(d90), color=GREEN, linestyle="--", label="smallest d detected with 90 % probability")
            axis.legend(frameon=False, loc="lower right")
    return (
        "Ranking of single laws (blue: in the explanation). This record would not detect effects left of the line.",
        figure,
    )


def cosines(tracer):
    """How alike the signatures are."""
    if not tracer.ranked:
        return None
    names = [n for r in tracer.ranked.values() for n in r.names if n not in r.hidden]
    order = sorted(names, key=lambda n: -max(abs(r.t[r.index(n)]) for r in tracer.ranked.values() if n in r.names))
    names = order[:MOST_DRAWN_LAWS]
    if len(names) < 2:
        return None
    c = tracer.rank(tracer.base.fit, tuple(names)).cosines
    figure, (axis,) = _axes(height=2.0 + 0.38 * len(names), width=4.0 + 0.55 * len(names))
    image = axis.imshow(c, cmap="RdBu_r", vmin=-1, vmax=1)
    axis.set_xticks(range(len(names)), names, rotation=60, ha="right")
    axis.set_yticks(range(len(names)), names)
    _annotate_cells(axis, c, ".2f", lambda cosine: abs(cosine) > 0.6)
    figure.colorbar(image, ax=axis, label="cosine of the projected signatures")
    return "Cosines between laws after projection. These data cannot distinguish pairs near 1 or -1.", figure


def condition_map(tracer):
    """chi2 / rows per group and observable, before and after."""
    space = tracer.space
    groups, names = [g.name for g in space.groups], sorted({b.observable for b in space.blocks})
    if len(groups) * len(names) > 600:
        return None
    figure, axes = _axes(2, height=1.8 + 0.28 * len(groups))
    for axis, (title, fit) in zip(axes, (("before", tracer.base.fit), ("after", tracer.fits["after"]))):
        cells = np.full((len(groups), len(names)), np.nan)
        for b in space.blocks:
            cells[b.group, names.index(b.observable)] = np.mean(fit.z[b.rows] ** 2)
        image = axis.imshow(np.log10(np.maximum(cells, 1e-3)), cmap="PuOr", vmin=-1.5, vmax=1.5, aspect="auto")
        axis.set_xticks(range(len(names)), names, rotation=40, ha="right")
        axis.set_yticks(range(len(groups)), groups)
        axis.set_title(title)
        _annotate_cells(axis, cells, ".3g", lambda chi2: not 0.12 < chi2 < 8)
    figure.colorbar(image, ax=axes, label="log10(chi2 / rows)")
    return "Misfit per condition and observable (1 = noise). The misfit after must show no pattern.", figure


def added_variable(tracer):
    """What the residual still knows of each law of the explanation: partial regression."""
    fit = tracer.fits["after"]
    if not fit.model.names:
        return None
    n, count = len(fit.point.theta), min(len(fit.model.names), 3)
    figure, axes = _axes(count, height=3.8)
    for axis, i in zip(axes, range(count)):
        other_columns = np.delete(fit.jacobian, n + i, axis=1)
        p = Projection(other_columns, np.delete(fit.model.prior_columns(), n + i, axis=1))
        s = p(fit.jacobian[:, n + i : n + i + 1])[:, 0]
        partial_residual = p(fit.z[:, None], prior_z(fit)[:, None])[:, 0] + s * fit.point.c[i]
        step = max(1, len(s) // MOST_POINTS)
        law = fit.model.laws[i]
        axis.plot(s[::step] * law.scale, partial_residual[::step], ".", color=GREY, markersize=3)
        x = np.array([s.min(), s.max()])
        axis.plot(x * law.scale, x * fit.point.c[i], "-", color=BLUE, label=f"{fit.point.c[i]:.4g} {law.unit}")
        axis.set_xlabel(f"signature of {law.name} (sigma per {law.scale:g} {law.unit})")
        axis.set_ylabel("residual without the law (sigma)")
        axis.legend(frameon=False)
    return (
        "Residual against the signature of each law, with all other laws fitted. Points along a straight line mean "
        "that the law has the right shape.",
        figure,
    )


def whiteness(tracer):
    """QQ plot and autocorrelation before and after."""
    figure, axes = _axes(2)
    for label, fit, colour, style in (
        ("before", tracer.base.fit, VERMILION, "--"),
        ("after", tracer.fits["after"], BLUE, "-"),
    ):
        z = np.sort(fit.z)
        at = np.unique(np.linspace(0, len(z) - 1, min(len(z), 600)).astype(int))
        axes[0].plot(norm.ppf((at + 0.5) / len(z)), z[at], style, color=colour, label=label)
        lags, total, power = 20, np.zeros(21), 0.0
        for b in tracer.space.blocks:
            part = fit.z[b.rows]
            power += float(part @ part)
            for lag in range(min(lags + 1, len(part))):
                total[lag] += float(part[lag:] @ part[: len(part) - lag])
        axes[1].plot(range(lags + 1), total / max(power, 1e-300), style, color=colour, label=label, marker=".")
    axes[0].plot([-4, 4], [-4, 4], ":", color=GREY)
    axes[0].set_xlabel("normal quantile")
    axes[0].set_ylabel("whitened residual (sigma)")
    band = 1.96 / np.sqrt(max(tracer.space.size, 1))
    axes[1].axhspan(-band, band, color="#eeeeee")
    axes[1].set_xlabel("lag (rows)")
    axes[1].set_ylabel("autocorrelation")
    axes[0].legend(frameon=False)
    return (
        "Whitened residual: normal quantiles (left) and autocorrelation (right). White noise lies on the dotted line "
        "and within the band (95 %).",
        figure,
    )


def power(tracer):
    """Smallest effects that the record would have shown."""
    if not tracer.power:
        return None
    d90 = tracer.power["d90"]
    rows = sorted((v["d"], k) for k, v in d90.items() if v["d"] is not None)[-MOST_DRAWN_LAWS:]
    if not rows:
        return None
    labelled_bars = [(d, f"{k}: {d90[k]['value']:.3g} {d90[k]['unit']}") for d, k in rows]
    figure, _ = _bars(labelled_bars, GREEN, "d_90 (sigma)")
    return (
        "Smallest effect that this record detects with 90 % probability, in sigmas and in the unit of the law.",
        figure,
    )


def all_figures(tracer):
    """{name: (caption, Figure)} of everything that can be drawn."""
    drawn = {}
    for draw in (heldout_errors, condition_map, ranking, cosines, added_variable, whiteness, power):
        captioned_figure = draw(tracer)
        if captioned_figure is not None:
            drawn[draw.__name__] = captioned_figure
    return drawn
