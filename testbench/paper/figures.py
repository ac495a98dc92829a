"""Pictures of the page: the paper's figures 2 to 8 redrawn from the model, and what the project adds.

Each is a function of plain data that returns (caption, Figure); the caption says what to see. The paper's pictures are
not available: what each shows is taken from its running text.
Source    docs/paper.md
"""

import functools
import math

import numpy as np

from testbench import config as configuration
from testbench.console.report import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, axes_of, name_axes
from testbench.paper import temperature
from testbench.paper.calibration.calibrate import NODES
from testbench.paper.loop import advisor
from testbench.paper.loop import loop as loops
from testbench.paper.loop import parts as loop_parts
from testbench.paper.measure.measure_bandwidth import crossing_hz

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY)
MARKS = ("o", "s", "^", "D", "v")
NODE_TEXT = {"xe1": "xe1", "xe2": "xe2'", "ye1": "ye1", "ye2": "ye2'"}


def drive_errors(rows, config):
    """Fig. 2: simulated gyroscopes over xe1, beside the formulas."""
    device = config.device()
    angle = np.array([row["deg"]["xe1"] + row["deg"]["xe2"] for row in rows])
    figure, axes = axes_of("Fig. 2  Drive phase error: frequency, drive voltage, V_q, rate word (-30 deg/s)", 8.0, 2, 2)
    fine = np.linspace(angle.min(), angle.max(), 121)
    f = np.array([row["frequency_hz"] for row in rows])
    slope = -device.fx_hz / (2 * device.qx) * np.tan(np.radians(fine)) * 1e3
    axes[0, 0].plot(fine, slope, color=VERMILION, linestyle="--", label="-f/(2Q) tan(xe1 + xe2')")
    axes[0, 0].plot(angle, (f - device.fx_hz) * 1e3, "o", color=BLUE, label="simulated")
    name_axes(axes[0, 0], "xe1 + xe2' (deg)", "drive frequency less f_x (mHz)", "best")
    a = np.array([row["drive_v"] for row in rows])
    unit = float(np.mean(a * np.cos(np.radians(angle))))
    axes[0, 1].plot(fine, 1e3 * unit / np.cos(np.radians(fine)), color=VERMILION, linestyle="--", label="1/cos")
    axes[0, 1].plot(angle, 1e3 * a, "o", color=BLUE, label="simulated")
    name_axes(axes[0, 1], "xe1 + xe2' (deg)", "drive amplitude A_d (mV)", "best")
    v = np.array([row["quadrature_v"] for row in rows])
    axes[1, 0].plot(angle, (v - v.mean()) * 1e6, "o-", color=BLUE, label=f"simulated: {v.mean():.4f} V and")
    name_axes(axes[1, 0], "xe1 + xe2' (deg)", "V_q less its mean (uV)", "best")
    w = np.array([row["rate_word"] for row in rows])
    axes[1, 1].plot(angle, (w / w.mean() - 1) * 1e6, "o-", color=BLUE, label="simulated")
    name_axes(axes[1, 1], "xe1 + xe2' (deg)", "rate word less its mean (ppm)", "best")
    return (
        "What to see: the drive phase error moves the frequency by millihertz and the drive voltage by a percent; V_q "
        "and the rate word stay where they are, because the loop holds x on its reference whatever the force does.",
        figure,
    )


def phase_record(records, nodes, number):
    """Figs. 3 and 7: two hours of phase readings, before and after compensation."""
    figure, axes = axes_of(f"Fig. {number}  Phases over two hours after warm-up", 8.0, 2, 2)
    for row, case in enumerate(("1", "5")):
        rows = records[case]
        t = np.array([r["time_s"] for r in rows]) / 60
        for column, node in enumerate(nodes):
            y = np.array([r[node] for r in rows])
            axis = axes[row, column]
            axis.plot(
                t, 1e3 * (y - y.mean()), "o-", color=BLUE, label=f"{NODE_TEXT[node]}, case {case}: {y.mean():+.4f} deg"
            )
            truth = np.array([r["truth"][node] for r in rows])
            axis.plot(t, 1e3 * (truth - truth.mean()), "--", color=VERMILION, label="truth")
            name_axes(axis, "time from power-on (min)", "reading less mean (mdeg)", "best")
    return (
        "What to see: readings scatter by a millidegree or so, single ones by more where edges beat slowly with their "
        "grid; the truth moves by less. The paper's fluctuation of 7 to 9 mdeg is larger.",
        figure,
    )


QUANTITIES = (
    ("scale_lsb_per_dps", "scale factor (LSB per deg/s)"),
    ("quadrature_v", "V_q (V)"),
    ("bias_dps", "zero-rate output (deg/s)"),
    ("bandwidth_hz", "bandwidth (Hz)"),
    ("arw_deg_per_rt_h", "ARW (deg/sqrt(h))"),
    ("nonlinearity_ppm", "nonlinearity (ppm)"),
)


CASES_SHOW = {
    4: "compensating the drive phases (1 to 2, 2 to 3) moves the scale factor by a quarter percent at most. The "
    "model's scale factor falls with temperature by the diodes' threshold, which the paper's board compensates.",
    8: "compensating ye1 (3 to 4) lowers the scale factor by 1/cos, raises the bandwidth by half a hertz and takes the "
    "nonlinearity away; ye2 (4 to 5) moves the zero-rate output a little and nothing else.",
}


def cases_over_temperature(points, cases, number, paper):
    """Figs. 4 and 8: what was measured of each case over temperature, the paper's means beside it."""
    figure, axes = axes_of(f"Fig. {number}  Cases {', '.join(cases)} over temperature", 8.0, 2, 3)
    temps = sorted({t for _, t in points})
    for axis, (name, label) in zip(axes.ravel(), QUANTITIES):
        for k, case in enumerate(cases):
            have = [t for t in temps if (case, t) in points and points[case, t].get(name) is not None]
            axis.plot(
                have, [points[case, t][name] for t in have], MARKS[k] + "-", color=COLOURS[k], label=f"case {case}"
            )
        known = paper.get(name)
        if known:
            axis.plot(list(known), list(known.values()), "x", color=GREY, markersize=9, label="paper, cases 1-3")
        name_axes(axis, "temperature (degC)", label, "best")
    return (
        f"What to see: {CASES_SHOW[number]}",
        figure,
    )


def transfer_functions(config, angles_deg=(-9.0, 0.0, 9.0)):
    """Fig. 5 b-d: return ratio and closed loop over frequency for three ye1."""
    split_hz = loop_parts.parts(config).split_hz
    f = np.unique(np.concatenate([np.geomspace(0.5, 400.0, 160), split_hz + np.linspace(-6.0, 6.0, 601)]))
    rise = []
    figure, axes = axes_of("Fig. 5  Force-to-rebalance loop in the frequency domain", 8.0, 2, 2)
    for k, angle in enumerate(angles_deg):
        p = turned(config, ye1_deg=angle)
        ratio = loops.return_ratio(p, f)
        level = 20 * np.log10(np.abs(ratio))
        rise.append(float(level[f > 100.0].max() - level[(f > 60.0) & (f < split_hz)].min()))
        h = loops.response(loops.close(p), f)
        h = h / loops.response(loops.close(p), np.array([0.01]))[0].real
        for column, (values, what) in enumerate(((ratio, "return ratio"), (h, "closed loop"))):
            axes[0, column].semilogx(f, 20 * np.log10(np.abs(values)), color=COLOURS[k], label=f"ye1 = {angle:g} deg")
            axes[1, column].semilogx(
                f, np.degrees(np.unwrap(np.angle(values))), color=COLOURS[k], label=f"ye1 = {angle:g} deg"
            )
            name_axes(axes[0, column], "frequency (Hz)", f"{what}, gain (dB)", "best")
            name_axes(axes[1, column], "frequency (Hz)", f"{what}, phase (deg)", "best")
    return (
        f"What to see: the resonance at the split, {split_hz:.0f} Hz, stands {rise[1]:.0f} dB above the dip before it; "
        "there the demodulator's poles have turned the phase far enough. +-9 deg of ye1 change hardly a line.",
        figure,
    )


def turned(config, ye1_deg=0.0, ye2_deg=0.0):
    """Loop parts of a configuration with the sense phases at these angles."""
    return advisor.turned(loop_parts.parts(config), ye1_deg, ye2_deg)


@functools.cache
def loop_changes():
    """Largest change of bandwidth (Hz), and of the phase at 10 Hz (deg), of the default loop over both sense phases."""
    config = configuration.Config()
    rows = sense_grid(config)
    width = [b for _, _, b, _ in rows]
    phase = [p for _, _, _, p in rows]
    return {"bandwidth": max(width) - min(width), "phase": max(phase) - min(phase)}


def sense_grid(config, ye1_deg=(-9.0, -4.5, 0.0, 4.5, 9.0), ye2_deg=(-6.0, 0.0, 6.0)):
    """[(ye1, ye2, bandwidth Hz, phase at 10 Hz deg), ...] of the linear loop."""
    f = np.geomspace(10.0, 40.0, 61)
    rows = []
    for b in ye2_deg:
        for a in ye1_deg:
            closed = loops.close(turned(config, a, b))
            h = loops.response(closed, f)
            gain = 20 * np.log10(np.abs(h / abs(loops.response(closed, np.array([0.01]))[0])))
            at = loops.response(closed, np.array([10.0]))[0]
            sign = np.sign(loops.response(closed, np.array([0.01]))[0].real)
            rows.append((a, b, crossing_hz(f, gain), math.degrees(np.angle(sign * at))))
    return rows


def sense_errors(config, law_rows):
    """Fig. 6: bandwidth and phase over ye1 and ye2 (linear loop); scale factor over ye1 (simulated)."""
    rows = sense_grid(config)
    figure, axes = axes_of("Fig. 6  Sense phase errors: bandwidth, phase at 10 Hz, scale factor", 5.0, 1, 3)
    for k, b in enumerate(sorted({r[1] for r in rows})):
        mine = [r for r in rows if r[1] == b]
        x = [r[0] for r in mine]
        axes[0, 0].plot(x, [r[2] for r in mine], MARKS[k] + "-", color=COLOURS[k], label=f"ye2 = {b:g} deg")
        axes[0, 1].plot(x, [r[3] for r in mine], MARKS[k] + "-", color=COLOURS[k], label=f"ye2 = {b:g} deg")
    name_axes(axes[0, 0], "ye1 (deg)", "bandwidth (Hz)", "best")
    name_axes(axes[0, 1], "ye1 (deg)", "phase at 10 Hz (deg)", "best")
    mine = [r for r in law_rows if r["name"].startswith("ye1")]
    x = np.array([r["deg"]["ye1"] for r in mine])
    order = np.argsort(x)
    fine = np.linspace(x.min(), x.max(), 91)
    axes[0, 2].plot(x[order], [(mine[k]["ratio"] - 1) * 1e6 for k in order], "o", color=BLUE, label="simulated")
    left = float(np.mean([r["deg"]["xe2"] for r in mine]))
    axes[0, 2].plot(
        fine, (1 / np.cos(np.radians(fine + left)) - 1) * 1e6, "--", color=VERMILION, label="1/cos(ye1 + xe2')"
    )
    name_axes(axes[0, 2], "ye1 (deg)", "scale factor over case 5 (ppm)", "best")
    alone = [r[2] for r in rows if r[1] == 0.0]
    every = [r[2] for r in rows]
    own = closed_bandwidth(turned(config))
    gain = closed_bandwidth(advisor.varied(turned(config), crossover=math.cos(math.radians(9.0))))
    return (
        f"What to see: ye1 alone moves the bandwidth by {max(alone) - min(alone):.2f} Hz, both phases by "
        f"{max(every) - min(every):.2f} Hz; the paper says 0.3 Hz: not met. The loop gain falls "
        f"with cos(ye1 + ye2'), which at 9 deg alone makes {own - gain:.2f} Hz; the rest is the coupling to the "
        "quadrature loop. The scale factor follows 1/cos(ye1 + xe2').",
        figure,
    )


def closed_bandwidth(p):
    """Bandwidth (Hz) of the linear loop of these parts."""
    return advisor.bandwidth(loops.close(p))[0]


def allan(points, temp):
    """Allan deviation of all cases at one temperature."""
    figure, axes = axes_of(f"Allan deviation at rest, {temp:g} degC", 6.0, 1, 1)
    axis = axes[0, 0]
    for k, case in enumerate(sorted({c for c, _ in points})):
        p = points.get((case, temp))
        if p and p.get("tau_s"):
            hours = np.array(p["adev_dps"]) * 3600
            axis.loglog(p["tau_s"], hours, MARKS[k % 5] + "-", color=COLOURS[k], label=f"case {case}", markersize=4)
    tau = np.array([0.1, 100.0])
    axis.loglog(tau, 0.1337 * 60 / np.sqrt(tau), "--", color=GREY, label="paper: 0.1337 deg/sqrt(h)")
    axis.axhline(3.8333, color=GREY, linestyle=":", label="paper: 3.83 deg/h")
    name_axes(axis, "averaging time (s)", "overlapping Allan deviation (deg/h)", "best")
    return (
        "What to see: white rate noise down to some ten seconds, then the floor of the 1/f noise behind the SID.",
        figure,
    )


def response(points, config):
    """Frequency response of the simulated gyroscope beside the linear loop."""
    figure, axes = axes_of("Rate channel: simulated gyroscope beside the analysis", 8.0, 2, 1)
    f = np.geomspace(0.5, 125.0, 200)
    closed = loops.close(loop_parts.parts(config))
    unit = loops.response(closed, np.array([1e-3]))[0].real
    h = loops.response(closed, f) / unit
    axes[0, 0].semilogx(f, 20 * np.log10(np.abs(h)), color=VERMILION, label="analysis")
    axes[1, 0].semilogx(f, np.degrees(np.unwrap(np.angle(h))), color=VERMILION, label="analysis")
    for k, case in enumerate(sorted({c for c, t in points if t == 25.0})):
        p = points[case, 25.0]
        axes[0, 0].semilogx(
            p["response_hz"], p["response_db"], MARKS[k % 5], color=COLOURS[k], label=f"multisine, case {case}"
        )
        axes[1, 0].semilogx(
            p["response_hz"], p["response_deg"], MARKS[k % 5], color=COLOURS[k], label=f"multisine, case {case}"
        )
        if k == 0:
            axes[0, 0].semilogx(p["swept_hz"], p["swept_db"], "-", color=SKY, label=f"swept rate, case {case}")
    axes[0, 0].axhline(-3.0103, color=GREY, linestyle=":", label="-3.01 dB")
    name_axes(axes[0, 0], "frequency (Hz)", "gain (dB)", "best")
    name_axes(axes[1, 0], "frequency (Hz)", "phase (deg)", "best")
    return "What to see: one curve; the split at 139 Hz stays visible as a ripple at the right end.", figure


def scale_residuals(points):
    """Residuals of the 22 rates."""
    from testbench.paper.measure.measure_scale import RATES_DPS

    figure, axes = axes_of("22 rates at 25 degC: residual of the line, and V_q", 5.0, 1, 2)
    for k, case in enumerate(sorted({c for c, t in points if t == 25.0})):
        p = points[case, 25.0]
        axes[0, 0].plot(RATES_DPS, p["scale_residual_ppm"], MARKS[k % 5] + "-", color=COLOURS[k], label=f"case {case}")
        axes[0, 1].plot(
            RATES_DPS, p["quadrature_v_of_rate"], MARKS[k % 5] + "-", color=COLOURS[k], label=f"case {case}"
        )
    name_axes(axes[0, 0], "rate (deg/s)", "residual (ppm of full scale)", "best")
    name_axes(axes[0, 1], "rate (deg/s)", "V_q (V)", "best")
    return (
        "What to see: with ye1 uncompensated the quadrature loop must follow the rate, and rails at 5.5 V on one sign "
        "of it; that makes nonlinearity and asymmetry, and goes away with case 4.",
        figure,
    )


def noise_shares(noise):
    """ARW with one source on, and with each one off."""
    figure, axes = axes_of("Noise: share of each source in the angle random walk", 5.0, 1, 2)
    for axis, word in zip(axes[0], ("only", "without")):
        names = [name for name in noise if name.startswith(word)]
        values = [noise[name]["arw_deg_per_rt_h"] for name in names]
        axis.bar(range(len(names)), values, color=BLUE, label=f"{word} this source")
        axis.axhline(noise["all"]["arw_deg_per_rt_h"], color=VERMILION, linestyle="--", label="all on")
        axis.set_ylim(0.0, 1.35 * noise["all"]["arw_deg_per_rt_h"])
        axis.set_xticks(range(len(names)), [name.split(" ", 1)[1] for name in names], rotation=30)
        name_axes(axis, "source", "ARW (deg/sqrt(h))", "best")
    return "What to see: the C/V noise makes nearly all of it, the converter the rest.", figure


def residuals_of_boards(boards):
    """Truth after calibration, with the procedure's own uncertainty, board by board."""
    figure, axes = axes_of("Random boards: what the calibration leaves, and what it says about that", 8.0, 2, 2)
    for axis, node in zip(axes.ravel(), NODES):
        x = np.arange(len(boards))
        y = [1e3 * b["residual_deg"][node] for b in boards]
        u = [1e3 * b["uncertainty_deg"][node] for b in boards]
        axis.errorbar(x, y, yerr=u, fmt="o", color=BLUE, ecolor=SKY, capsize=3, label="truth, uncertainty at 99 %")
        axis.axhspan(-2, 2, color=GREEN, alpha=0.12, label="target, 2 mdeg")
        axis.axhline(0, color=GREY, linewidth=1)
        axis.xaxis.get_major_locator().set_params(integer=True)
        name_axes(axis, "board", f"residual {NODE_TEXT[node]} (mdeg)", "best")
    worst = max(abs(v) for b in boards for v in b["residual_deg"].values())
    return (
        f"What to see: bars reach zero; the largest residual is {1e3 * worst:.1f} mdeg, the paper's level 12 mdeg.",
        figure,
    )


def over_temperature(config):
    """Phases over temperature from part physics."""
    temps = np.array(temperature.GRID_DEGC)
    found = temperature.phases(config, temps)
    figure, axes = axes_of("Phases over temperature, from the parts' laws", 6.0, 1, 1)
    start = temperature.phases(config, (25.0,))
    for k, node in enumerate(NODES):
        axes[0, 0].plot(temps, 1e3 * (np.array(found[node]) - start[node][0]), MARKS[k] + "-", color=COLOURS[k],
                        label=f"{NODE_TEXT[node]}: {start[node][0]:.3f} deg at 25 degC")  # fmt: skip
    axes[0, 0].axhspan(-12, 12, color=GREEN, alpha=0.12, label="the paper's level, 12 mdeg")
    name_axes(axes[0, 0], "temperature (degC)", "phase less that at 25 degC (mdeg)", "best")
    return (
        "What to see: the pickoff's op amps make xe2 and ye2 rise with temperature (bandwidth falls by 0.2 %/K); the "
        "output path hardly moves while its resistors' drift is off, as in the base plant.",
        figure,
    )
