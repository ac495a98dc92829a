"""The pictures of the pages: python docs/pictures.py [NAME ...] writes docs/pictures/*.png, all or those named.

phase_budget.png    what each of the four phase lags is made of, from `gyro budget`
startup.png, rate_step.png, spectra.png     what `gyro run --seconds 1 --rate-dps 100 --seed 1` writes
block_diagram.png   the closed loop: blocks of the firmware and parts of the plant, with the rates between them
divergence.png      one register of the model and of a faulty design, from `gyro golden check`; needs Icarus Verilog
trace.png           residual on held-out data before and after an effect is named: the toy problem of the tests
loop_margins.png    open loop of the force-to-rebalance loop with its margins, from `gyro loop`
"""

import shutil
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.patches import FancyBboxPatch, Rectangle

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from fpga_model import rates  # noqa: E402
from testbench import config  # noqa: E402
from testbench.commands.main import app  # noqa: E402
from testbench.console import report  # noqa: E402
from testbench.golden.bundles import bundle, export  # noqa: E402
from testbench.golden.check import compare, rtl_run  # noqa: E402
from testbench.golden.stimulus import blocks  # noqa: E402
from testbench.paper.loop import advisor, loop_pictures  # noqa: E402
from testbench.paper.loop.loop_parameters import loop_parameters  # noqa: E402
from testbench.run import budget  # noqa: E402
from testbench.tracing.trace import Options, Tracer  # noqa: E402
from tests.testbench.tracing import toys  # noqa: E402

FOLDER = ROOT / "docs" / "pictures"
SMALL = 13  # size of a font that is legible where a page shows the picture 900 pixels wide

# ---- phase budget ----------------------------------------------------------------------------------------------------

# what a reader tells apart: rows of the budget by the first words that they begin with
GROUPS = {
    "pipeline of the FPGA": ("DDS", "sine", "extra pipeline", "product", "SPI load"),
    "SPI frame and latch": ("SPI frame", "extra 1 us", "DAC response"),
    "hold of the 1 MHz update": ("hold",),
    "analog poles": ("output pole", "ring diode", "instrumentation", "unity"),
    "path of the reference": ("reference",),
}
TITLES = {
    "xe1": "xe1  drive, reference to force",
    "xe2": "xe2  drive, motion to C/V output",
    "ye1": "ye1  sense, reference to force",
    "ye2": "ye2  sense, motion to C/V output",
}


def grouped(rows):
    """{group: degrees} of the rows of one phase; raises StopIteration for a row that no group has."""
    sums = dict.fromkeys(GROUPS, 0.0)
    for row in rows:
        name = next(name for name, begins in GROUPS.items() if row.what.startswith(begins))
        sums[name] += row.degrees
    return sums


def phase_budget():
    """Stacked bars: delays to the right of zero, what the reference's own path takes off to the left."""
    planned = budget.budget(config.Config())
    figure, axes = report.make_axes("Where the four phase lags come from", 4.4)
    axis = axes[0, 0]
    for place, (name, rows) in enumerate(planned.rows.items()):
        right = 0.0
        for (group, deg), colour in zip(grouped(rows).items(), (*report.CYCLE, report.GREY)):
            axis.barh(place, deg, left=right if deg > 0 else 0.0, color=colour, label=None if place else group)
            right += max(deg, 0.0)
        total = planned.node_deg()[name]
        axis.plot([total, total], [place - 0.45, place + 0.45], color="black", linewidth=2.5)
        axis.annotate(f"sum {total:.2f} deg", (max(right, total) + 0.15, place), va="center", fontsize=12)
    axis.set_yticks(range(4), [TITLES[name] for name in planned.rows], fontsize=12)
    axis.invert_yaxis()
    axis.set_xlabel("phase lag at 11 kHz, deg (black line: sum)", fontsize=13)
    axis.set_xlim(right=14)
    axis.legend(fontsize=11, loc="upper right")
    return figure


# ---- a run -----------------------------------------------------------------------------------------------------------

RUN = ("run", "--seconds", "1", "--rate-dps", "100", "--seed", "1")


def run_picture(name):
    """Path of the picture that a run writes, in a folder that the caller removes."""
    folder = tempfile.mkdtemp()
    app([*RUN, "--out", folder], standalone_mode=False)
    return Path(folder) / f"{name}.png"


def startup():
    """From power-on to lock."""
    return run_picture("startup")


def rate_step():
    """Answer of the rate output to a step of the rate."""
    return run_picture("rate_step")


def spectra():
    """Spectra of the codes of both DACs."""
    return run_picture("spectra")


# ---- block diagram ---------------------------------------------------------------------------------------------------


class Box(NamedTuple):
    """A block of the diagram: folder with a module of that name, centre, and what it does."""

    folder: str
    x: float
    y: float
    text: str


FIRMWARE, PLANT = "fpga_model", "analog_frontend/parts"
C = (0.78, 2.86, 4.94, 7.02, 9.4, 11.22)  # columns, inches
BOXES = {
    "dds": Box(FIRMWARE, C[0], 6.0, "phase, 48 bits"),
    "sine": Box(FIRMWARE, C[1], 6.0, "drive, sense"),
    "modulator": Box(FIRMWARE, C[2], 6.0, "product, code"),
    "spi_dac": Box(FIRMWARE, C[3], 6.0, "three masters"),
    "references": Box(FIRMWARE, C[1], 4.75, "four sign pins"),
    "frequency_tracker": Box(FIRMWARE, C[0], 3.1, "PLL: DDS word"),
    "agc": Box(FIRMWARE, C[1], 3.1, "amplitude"),
    "rate_loop": Box(FIRMWARE, C[2], 3.1, "FTR: force"),
    "quadrature_loop": Box(FIRMWARE, C[3], 3.1, "QSC: V_q"),
    "cordic": Box(FIRMWARE, 1.82, 1.65, "length, angle"),
    "rate_output": Box(FIRMWARE, C[2], 1.65, "deg/s"),
    "spi_adc": Box(FIRMWARE, C[3], 0.55, "one master"),
    "dac": Box(PLANT, C[4], 6.0, "code to volts"),
    "resonator": Box(PLANT, C[5], 4.75, "two modes"),
    "ring_diode": Box(PLANT, C[5], 3.1, "C/V converters"),
    "sid": Box(PLANT, C[4], 3.1, "demodulator"),
    "adc": Box(PLANT, C[4], 0.55, "24 bits"),
}
LINES = {"frequency_tracker": "frequency_\ntracker", "quadrature_loop": "quadrature_\nloop"}


def rate_text(hz):
    """8 kHz, 1 MHz or 26 MHz."""
    return f"{hz / 1e6:g} MHz" if hz >= 1e6 else f"{hz / 1e3:g} kHz"


FAST, TICK, FRAME = map(rate_text, (rates.MASTER_HZ, rates.TICK_HZ, rates.FRAME_HZ))
# corners of each connection, its text, where the text stands, and its side: the text is above a line or right of it
EDGES = (
    ([(C[0], 6.0), (C[1], 6.0)], FAST, (1.82, 6.05), "center"),
    ([(C[0], 6.0), (C[0], 4.75), (C[1], 4.75)], FAST, (1.5, 4.8), "center"),
    ([(C[1], 6.0), (C[2], 6.0)], FAST, (3.9, 6.05), "center"),
    ([(C[2], 6.0), (C[3], 6.0)], TICK, (5.98, 6.05), "center"),
    ([(C[3], 6.0), (C[4], 6.0)], f"codes\n{TICK}", (8.21, 6.05), "center"),
    ([(C[4], 6.0), (C[5], 6.0), (C[5], 4.75)], "volts", (10.65, 6.05), "center"),
    ([(C[1], 4.75), (C[4], 4.75), (C[4], 3.1)], f"edges, {TICK} grid", (8.3, 4.8), "center"),
    ([(C[5], 4.75), (C[5], 3.1)], "motion", (C[5] + 0.05, 3.85), "left"),
    ([(C[5], 3.1), (C[4], 3.1)], "volts", (10.31, 3.15), "center"),
    ([(C[4], 3.1), (C[4], 0.55)], "volts", (C[4] + 0.05, 1.75), "left"),
    ([(C[4], 0.55), (C[3], 0.55)], f"codes\n{FRAME}", (8.21, 0.6), "center"),
    ([(C[3], 0.55), (1.82, 0.55), (1.82, 1.65)], f"drive codes, {FRAME}", (4.1, 0.6), "center"),
    ([(C[3], 0.55), (C[3], 3.1)], f"sense\ncodes\n{FRAME}", (C[3] + 0.05, 1.5), "left"),
    ([(C[3], 2.4), (5.4, 2.4), (5.4, 3.1)], "", (0, 0), "left"),
    ([(1.82, 1.65), (1.82, 2.4), (C[0], 2.4), (C[0], 3.1)], FRAME, (1.3, 2.42), "center"),
    ([(1.82, 2.4), (C[1], 2.4), (C[1], 3.1)], FRAME, (2.34, 2.42), "center"),
    ([(4.6, 3.1), (4.6, 1.65)], FRAME, (4.55, 2.25), "right"),
    ([(0.4, 3.1), (0.4, 6.0)], FRAME, (0.45, 4.0), "left"),
    ([(C[1], 3.1), (C[1], 3.95), (4.6, 3.95), (4.6, 6.0)], FRAME, (3.73, 4.0), "center"),
    ([(5.2, 3.1), (5.2, 6.0)], FRAME, (5.25, 4.0), "left"),
    ([(C[3], 3.1), (C[3], 6.0)], FRAME, (C[3] + 0.05, 4.0), "left"),
)
HALF = (0.68, 0.42)  # of a box


def clipped(corners):
    """Corners with the last one moved to the border of the box that it is in."""
    (x0, y0), (x1, y1) = corners[-2:]
    box = min(BOXES.values(), key=lambda box: abs(box.x - x1) / HALF[0] + abs(box.y - y1) / HALF[1])
    if y0 == y1:
        return [*corners[:-1], (box.x - np.sign(x1 - x0) * HALF[0], y1)]
    return [*corners[:-1], (x1, box.y - np.sign(y1 - y0) * HALF[1])]


def block_diagram():
    """The closed loop, drawn from `BOXES` and `EDGES`."""
    figure, axes = report.make_axes("The closed loop: firmware left, plant right", 7.0)
    axis = axes[0, 0]
    axis.axis("off")
    for left, right, colour, name in (
        (0.0, 7.85, report.SKY, f"{FIRMWARE}/  integers, {FAST}"),
        (8.58, 12.0, report.ORANGE, f"{PLANT}/  SI units"),
    ):
        axis.add_patch(Rectangle((left, 0.0), right - left, 6.9, facecolor=colour, alpha=0.13))
        axis.text(left + 0.1, 6.7, name, fontsize=SMALL, fontweight="bold", va="center")
    grey = {"color": report.GREY, "linewidth": 1.6}
    for corners, text, at, side in EDGES:
        path = clipped(corners)
        axis.plot(*np.transpose(path[:-1] + [np.mean(path[-2:], axis=0)]), **grey, zorder=1)
        arrow = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, **grey}
        axis.annotate("", path[-1], path[-2], arrowprops=arrow, zorder=1)
        axis.text(*at, text, ha=side, va="bottom", fontsize=SMALL - 1, zorder=4)
    for name, box in BOXES.items():
        colour = report.BLUE if box.folder == FIRMWARE else report.VERMILION
        corner, size = (box.x - HALF[0] + 0.05, box.y - HALF[1] + 0.05), (2 * HALF[0] - 0.1, 2 * HALF[1] - 0.1)
        edge = {"boxstyle": "round,pad=0.05", "facecolor": "white", "edgecolor": colour, "zorder": 2}
        axis.add_patch(FancyBboxPatch(corner, *size, **edge))
        name = LINES.get(name, name)
        low = 0.0 if "\n" not in name else 0.07
        middle = {"ha": "center", "va": "center", "zorder": 3, "fontsize": SMALL - 1}
        axis.text(box.x, box.y + 0.13, name, fontweight="bold", **middle)
        axis.text(box.x, box.y - 0.18 - low, box.text, **middle)
    axis.set_xlim(0.0, 12.0)
    axis.set_ylim(0.0, 6.9)
    return figure


# ---- divergence ------------------------------------------------------------------------------------------------------

ROUNDING = ("+ 62'sd8388608", "+ 62'sd0")  # the constant of testbench/rtl/pi.v that rounds to nearest


def without_rounding(folder):
    """(bundle, columns of a PI without its rounding constant under Icarus): the example of docs/golden.md."""
    export.export_case(blocks.BLOCKS["pi"], "rate", folder)
    text = (ROOT / "testbench" / "rtl" / "pi.v").read_text()
    assert text.count(ROUNDING[0]) == 1
    (folder / "pi.v").write_text(text.replace(*ROUNDING))
    golden = bundle.read(folder / "pi" / "rate")
    return golden, rtl_run.log(folder / "pi" / "rate", golden.manifest, folder, "icarus")


def divergence(before=7, after=24):
    """Register y of model and design around the first row that differs, and their difference."""
    with tempfile.TemporaryDirectory() as folder:
        golden, columns = without_rounding(Path(folder))
    found = compare.compare_bundle(golden, columns)
    assert found.divergence.port == "y"
    first = found.divergence.cycle
    place = [port["name"] for port in golden.manifest["registers"]].index("y")
    rows = np.arange(first - before, first + after)
    expected, got = golden.exp[rows, place], columns["y"].values[rows]
    title = (
        f"pi/rate, register y: the first divergence is at row {first} ({found.diagnosis[0].text().partition(' (')[0]})"
    )
    figure, axes = report.make_axes(title, 6.6, 2, sharex=True, height_ratios=(3, 2))
    top, bottom = axes[:, 0]
    top.step(rows, expected, where="mid", color=report.BLUE, linewidth=2.4, label="expected: model")
    top.step(rows, got, where="mid", color=report.VERMILION, linestyle="--", linewidth=1.8, label="got: faulty Verilog")
    top.set_yscale("symlog", linthresh=10, linscale=2)
    report.name_axes(top, y="y (LSB)", legend="upper right")
    bottom.bar(rows, got - expected, color=report.VERMILION, width=0.7)
    bottom.set_yticks(range(min(got - expected), 1))
    report.name_axes(bottom, f"row (edge of the {FAST} clock)", "got - expected (LSB)")
    text = f"row {first}: expected {expected[before]}, got {got[before]}  "
    top.text(first, -1e3, text, ha="right", fontsize=SMALL, color=report.GREEN)
    for axis in (top, bottom):
        axis.axvline(first, color=report.GREEN, linestyle="-.", linewidth=1.6)
    return figure


# ---- tracing ---------------------------------------------------------------------------------------------------------

TRUTH_HZ = 0.3  # of the effect that the data have and the model lacks
SEED = 5


def traced():
    """Tracer of the toy problem whose data have a Duffing spring."""
    tracer = Tracer(toys.Toy(SEED, {"duffing": TRUTH_HZ}), Options(n_null=499), None, None)
    return tracer, tracer.run()


def trace():
    """Residuals of the frequency in each held-out condition, before and after the effect is named."""
    tracer, result = traced()
    (effect,) = result.effects
    problem = tracer.problem
    held = [k for k, segment in enumerate(problem.segments) if segment.role == "validate"]
    name = f"{effect['law']} {effect['value']:.3f} +- {effect['sd']:.3f} {effect['unit']}"
    figure, axes = report.make_axes("Residual of the frequency on held-out data", 5.2, 1, 2, sharey=True)
    for axis, (label, title) in zip(axes[0], (("before", "before: no effect"), ("after", f"after: {name}"))):
        fit = tracer.fits[label]
        (predicted,) = problem.predict([(fit.point.theta, fit.model.effects(fit.point))], held)
        seen = {}
        for k, features in zip(held, predicted):
            rows = problem.segments[k].observables[0].rows
            seen.setdefault(problem.segments[k].group, []).append((problem.observed_features(k) - features)[rows])
        for n, (group, repeats) in enumerate(seen.items()):
            amplitude = problem.segments[next(k for k in held if problem.segments[k].group == group)].condition["A"]
            axis.plot(
                toys.TIME,
                np.mean(repeats, axis=0),
                marker="o",
                color=report.CYCLE[n],
                linestyle=report.STYLES[n],
                label=f"amplitude {amplitude:g}, mean of {len(repeats)}",
            )
        floor = problem.repeatability_rms(held[0])["f"] / np.sqrt(len(repeats))
        axis.axhspan(-2 * floor, 2 * floor, color="#eeeeee", zorder=0, label="2 sigma of the noise")
        rms = result.heldout["f"][label]
        axis.set_title(f"{title}\nrms of single repeats {rms:.3f} Hz", fontsize=report.FONT["label"], loc="left")
        report.name_axes(axis, "time (s)")
    report.name_axes(axes[0, 0], "time (s)", "measured - predicted (Hz)", "upper left")
    return figure


# ---- loop ------------------------------------------------------------------------------------------------------------


def loop_margins():
    """The Bode plot of `gyro loop --report` at the default configuration."""
    planned = loop_parameters(config.Config())
    return loop_pictures.bode(planned, advisor.analyse(planned))


OF_RUN = (startup, rate_step, spectra)
PICTURES = {f.__name__: f for f in (phase_budget, *OF_RUN, block_diagram, divergence, trace, loop_margins)}


def main(names):
    """Write the pictures of these names, or all."""
    FOLDER.mkdir(exist_ok=True)
    for name in names or PICTURES:
        made = PICTURES[name]()
        if isinstance(made, Path):
            shutil.copyfile(made, FOLDER / f"{name}.png")
            shutil.rmtree(made.parent)
        else:
            report.save(made, FOLDER / f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
