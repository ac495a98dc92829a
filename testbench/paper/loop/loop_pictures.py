"""Pictures of the loop advisor: plain results in, matplotlib figures 1200 pixels wide out.

Source    docs/loop.md
"""

import numpy as np
from matplotlib.colors import SymLogNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter

from testbench.console.report import BLUE, FONT, GREEN, GREY, VERMILION, make_axes, name_axes
from testbench.paper.loop import advisor, confirm, limit_cycles, notch_loop, sensitivity
from testbench.paper.loop import loop as lp

UNSTABLE = "#9a9a9a"
STAR = {"marker": "*", "color": "white", "markeredgecolor": "black", "linestyle": "none"}


def _lags(values):
    """Phase in degrees, unwrapped, beginning between -180 and 0."""
    degrees = np.degrees(np.unwrap(np.angle(values)))
    return degrees - 360 * np.ceil((degrees[0] - 1e-9) / 360)


def _distance(axis, x, ends, text, offset):
    """A line with two heads between two levels at a frequency, and its length as a text `offset` points away."""
    axis.annotate(
        "", (x, ends[0]), (x, ends[1]), arrowprops={"arrowstyle": "<->", "color": GREEN, "linewidth": 1.8}, zorder=3
    )
    text_style = {"textcoords": "offset points", "ha": "left" if offset[0] > 0 else "right", "va": "center"}
    axis.annotate(text, (x, np.mean(ends)), offset, fontsize=FONT["small"], color=GREEN, **text_style)


def _split_frequencies(p, reach_hz, count):
    """Frequencies around the split, none below a tenth of it."""
    hz = abs(p.split_hz)
    return hz + np.linspace(max(-reach_hz, -0.9 * hz), reach_hz, count)


def bode(p, advice):
    """Open loop L at the force word: magnitude and phase, with the margins at |L| = 1 and where L is negative."""
    f = np.unique(np.concatenate([np.geomspace(0.3, min(1000, 0.4 / p.frame_s), 700), _split_frequencies(p, 6, 1201)]))
    values = lp.return_ratio(p, f)
    figure, axes = make_axes("Open loop, broken at the force word", 7.5, 2, sharex=True)
    top, bottom = axes[:, 0]
    level_db, phase = 20 * np.log10(np.abs(values)), _lags(values)
    top.semilogx(f, level_db, color=BLUE, linewidth=1.6, label="|L|")
    top.axhline(0, color=GREY, linewidth=1)
    bottom.semilogx(f, phase, color=BLUE, linewidth=1.6, label="phase of L")
    for level in (-180, -540):
        bottom.axhline(
            level, color=VERMILION, linestyle="--", linewidth=1.2, label="L = -|L|" if level == -180 else None
        )
    for k, c in enumerate(advice.crossings):
        at = np.interp(c.hz, f, phase)
        bottom.plot(c.hz, at, "o", color=VERMILION, markersize=7, label="|L| = 1" if not k else None)
        top.plot(c.hz, 0, "o", color=VERMILION, markersize=7)
        margin = min(c.lag_deg, c.lead_deg)
        critical_phase_deg = at + (c.lead_deg if c.lead_deg < c.lag_deg else -c.lag_deg)
        # the curve falls: left of it and below, right of it and above is place for a text
        side = (-8, 0) if critical_phase_deg < at else (8, 0)
        _distance(bottom, c.hz, (at, critical_phase_deg), f"phase margin {margin:.0f} deg\nat {c.hz:.1f} Hz", side)
    if advice.gain_margin_up_db is not None:
        # the first frequency at which more gain would bring L to -1
        past = np.argmax(phase < -180)
        hz = np.interp(180, -phase[past - 1 : past + 1], f[past - 1 : past + 1])
        text = f"gain margin {advice.gain_margin_up_db:.1f} dB\nat {hz:.1f} Hz"
        _distance(top, hz, (-advice.gain_margin_up_db, 0), text, (-8, -34))
    top.set_ylim(bottom=-80)
    name_axes(top, y="magnitude (dB)", legend="lower left")
    name_axes(bottom, "frequency (Hz)", "phase (deg)", "center left")
    return figure


def closed_loop_bode(p, simulated=None, lines_hz=confirm.LINES_HZ):
    """Closed loop: word per rate, with the lines of a simulated multisine and their difference if there are any."""
    loop = lp.close(p)
    dc = advisor.dc_gain(loop)
    f = np.unique(np.concatenate([np.geomspace(0.5, 400, 500), _split_frequencies(p, 4, 401)]))
    values = lp.response(loop, f) / dc
    figure, axes = make_axes("Closed loop: recorded word per rate", 9.0, 3 if simulated is not None else 2)
    top, middle = axes[0, 0], axes[1, 0]
    top.semilogx(f, 20 * np.log10(np.abs(values)), color=BLUE, linewidth=1.6, label="analysis")
    middle.semilogx(f, _lags(values), color=BLUE, linewidth=1.6, label="analysis")
    top.axhline(-3.01, color=GREY, linestyle=":", linewidth=1.2, label="-3 dB")
    if simulated is not None:
        lines = np.array(lines_hz, float)
        gain = simulated / (dc * lp.DEG)
        want = lp.response(loop, lines) / dc
        top.plot(lines, 20 * np.log10(np.abs(gain)), "o", color=VERMILION, markersize=5, label="simulated, multisine")
        middle.plot(lines, _lags(gain), "o", color=VERMILION, markersize=5, label="simulated, multisine")
        ratio, lower = gain / want, axes[2, 0]
        lower.semilogx(lines, 20 * np.log10(np.abs(ratio)), "o-", color=BLUE, label="magnitude (dB)")
        lower.semilogx(lines, np.degrees(np.angle(ratio)), "s--", color=VERMILION, label="phase (deg)")
        lower.set_xlim(top.get_xlim())
        name_axes(lower, "frequency (Hz)", "simulation minus analysis\n(dB, deg)", "upper left")
    name_axes(top, y="magnitude (dB)", legend="lower left")
    name_axes(middle, "frequency (Hz)" if simulated is None else "", "phase (deg)", "lower left")
    return figure


def step(p, simulated=None, width_hz=None, centre_hz=None):
    """Rate step: the word with and without a notch, and the ring enlarged; `simulated` is (time s, words per final)."""
    time_s, words = notch_loop.step_words(p)
    effect = notch_loop.effect(p, width_hz, centre_hz)
    figure, axes = make_axes("Rate step: ringing at the split, and a notch in the rate output", 7.5, 2)
    for axis in axes[:, 0]:
        axis.plot(time_s, words, color=BLUE, linewidth=1.3, label="analysis")
        if effect:
            notched_words = notch_loop.apply_notch(
                notch_loop.design(effect.centre_hz, effect.width_hz, 1 / p.frame_s), words
            )
            label = f"with a notch, {effect.centre_hz:.1f} Hz, {effect.width_hz:g} Hz wide"
            axis.plot(time_s, notched_words, color=VERMILION, linestyle="--", linewidth=1.3, label=label)
        if simulated is not None:
            axis.plot(*simulated, color=GREEN, linestyle=":", linewidth=1.6, label="simulated")
    axes[0, 0].set_xlim(-0.01, 0.4)
    axes[1, 0].set_xlim(0.1, 1.0)
    axes[1, 0].set_ylim(0.98, 1.02)
    name_axes(axes[0, 0], y="rate word over\nfinal rate word", legend="lower right")
    name_axes(axes[1, 0], "time from the step (s)", "enlarged", "upper right")
    return figure


def phase_influence(p, ye1_deg=(-9, 0, 9), ye2_deg=(-6, 0, 6)):
    """Closed loop over both phase errors of the sense path: bandwidth, and response against the one without."""
    figure, axes = make_axes("Both phase errors of the sense path", 8.0, 2)
    f = np.geomspace(1, 100, 200)
    base = None
    for colour, ye1 in zip((BLUE, GREY, VERMILION), ye1_deg):
        for style, ye2 in zip(("--", "-", ":"), ye2_deg):
            q = advisor.set_sense_phases(p, ye1, ye2)
            loop = lp.close(q)
            values = lp.response(loop, f) / advisor.dc_gain(loop)
            if base is None:
                zero = lp.close(advisor.set_sense_phases(p, 0.0, 0.0))
                base = lp.response(zero, f) / advisor.dc_gain(zero)
            edge = advisor.bandwidth(loop)[0]
            label = f"ye1 {ye1:+d}, ye2' {ye2:+d} deg: {edge:.2f} Hz"
            axes[0, 0].semilogx(f, 20 * np.log10(np.abs(values / base)), colour, linestyle=style, label=label)
            axes[1, 0].semilogx(f, np.degrees(np.angle(values / base)), colour, linestyle=style)
    name_axes(axes[0, 0], y="magnitude relative to\nno phase error (dB)")
    figure.legend(loc="outside right upper", fontsize=FONT["small"], frameon=False)
    name_axes(axes[1, 0], "frequency (Hz)", "phase relative to\nno phase error (deg)")
    return figure


def on_log_plane(axis, operating_point):
    """A map over two logarithmic rulers, grey where it has no value, with a star at `operating_point`."""
    axis.grid(False)
    axis.set_facecolor(UNSTABLE)
    axis.plot(*operating_point, markersize=16, **STAR)
    axis.set_xscale("log")
    axis.set_yscale("log")
    for ruler in (axis.xaxis, axis.yaxis):
        ruler.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ruler.set_major_formatter("{x:g}")
        ruler.set_minor_formatter(NullFormatter())


def draw_stability_maps(maps, points):
    """Stability maps side by side; `points` are (x, y) of the configuration in each."""
    figure, axes = make_axes("Stability: closed-loop maximum, grey where unstable", 4.6, 1, len(maps))
    for axis, m, point in zip(axes[0], maps, points):
        db = np.where(np.isfinite(m.peak_db), np.clip(m.peak_db, -1, 12), np.nan)
        mesh = axis.pcolormesh(m.x_values, m.y_values, db, cmap="viridis_r", vmin=-1, vmax=12, shading="nearest")
        edge = np.where(np.isfinite(m.peak_db), 0.0, 1.0)
        if 0 < edge.mean() < 1:
            axis.contour(m.x_values, m.y_values, edge, levels=[0.5], colors=[VERMILION], linewidths=2)
        on_log_plane(axis, point)
        name_axes(axis, "{} ({})".format(*advisor.AXES[m.x]), "{} ({})".format(*advisor.AXES[m.y]))
    figure.colorbar(mesh, ax=list(axes[0]), label="maximum relative to 0 Hz (dB)")
    marks = [
        (Line2D([], [], markersize=14, **STAR), "this configuration"),
        (Line2D([], [], color=VERMILION, linewidth=2), "stability limit"),
        (Patch(color=UNSTABLE), "unstable"),
    ]
    figure.legend(*zip(*marks), loc="outside lower center", ncols=3, fontsize=FONT["small"], frameon=False)
    return figure


def rounding(config, p):
    """Force of a rounded sine, and the quantised loops at rest without noise: this converter, and one of step 1."""
    figure, axes = make_axes("Rounding without noise", 7.5, 2)
    codes = np.linspace(0.01, 64, 1200) / 16
    force = np.array([limit_cycles.force_amplitude(c, 1) for c in codes])
    axes[0, 0].plot(codes, force, color=BLUE, label="in-phase force of rounded codes")
    axes[0, 0].plot(codes, codes, color=GREY, linestyle="--", label="without rounding")
    name_axes(axes[0, 0], "amplitude of the word (LSB of the force DAC)", "force (LSB)", "upper left")
    for colour, step_code, style in ((BLUE, p.step_code, "-"), (VERMILION, 1.0, "-")):
        run = limit_cycles.simulate_hunt(config, 0.0, 3.0, p=p._replace(step_code=step_code))
        time_s = np.arange(len(run.word)) * p.frame_s
        swing = run.word - np.median(run.word)
        axes[1, 0].plot(time_s, swing, style, color=colour, linewidth=1, label=f"converter step of {step_code:g} codes")
    name_axes(axes[1, 0], "time (s)", "force word minus\nits median (LSB)", "upper right")
    return figure


def influence(table):
    """Heat map: change of every observable for one step of every parameter, in shares of the column's largest."""
    values = sensitivity.matrix(table)
    values = np.where(np.abs(values) >= np.array(list(sensitivity.RESOLUTION.values())), values, 0.0)
    largest = np.max(np.abs(values), axis=0)
    shares = values / np.where(largest > 0, largest, 1.0)
    figure, axes = make_axes("Influence: change for one step, over the largest of its column", 14.0)
    axis = axes[0, 0]
    axis.grid(False)
    image = axis.imshow(shares, cmap="PuOr", norm=SymLogNorm(1e-3, vmin=-1, vmax=1), aspect="auto")
    names = [f"{text}\n({largest[k]:.3g} {unit})" for k, (text, unit) in enumerate(sensitivity.OBSERVABLES.values())]
    axis.set_xticks(range(len(names)), names, rotation=60, ha="left", fontsize=FONT["small"])
    axis.xaxis.tick_top()
    rows = [f"{row.parameter.name.split('.')[1]}, {row.parameter.unit}" for row in table]
    axis.set_yticks(range(len(rows)), rows, fontsize=FONT["small"])
    figure.colorbar(image, ax=axis, label="share of the column's largest change, with its sign", shrink=0.5)
    return figure
