"""The pictures of the pages: python docs/pictures.py writes docs/pictures/*.png.

phase_budget.png    what each of the four phase lags is made of, from `gyro budget`
startup.png         from power-on to lock, from `gyro run --seconds 1 --rate-dps 100 --seed 1`
"""

import shutil
import tempfile
from pathlib import Path

from testbench import config
from testbench.commands.main import app
from testbench.console import report
from testbench.run import budget

FOLDER = Path(__file__).resolve().parent / "pictures"
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
    figure, axes = report.axes_of("Where the four phase lags come from", 4.4)
    axis = axes[0, 0]
    for place, (name, rows) in enumerate(planned.rows.items()):
        right = 0.0
        for (group, deg), colour in zip(grouped(rows).items(), (*report.CYCLE, report.GREY)):
            axis.barh(place, deg, left=right if deg > 0 else 0.0, color=colour, label=None if place else group)
            right += max(deg, 0.0)
        total = planned.node_deg()[name]
        axis.plot([total, total], [place - 0.45, place + 0.45], color="black", linewidth=2.5)
        axis.annotate(f"{total:.2f} deg", (max(right, total) + 0.15, place), va="center", fontsize=12)
    axis.set_yticks(range(4), [TITLES[name] for name in planned.rows], fontsize=12)
    axis.invert_yaxis()
    axis.set_xlabel("phase lag at 11 kHz, deg (black line: sum)", fontsize=13)
    axis.set_xlim(right=14)
    axis.legend(fontsize=11, loc="upper right")
    return figure


def main():
    """Write all pictures."""
    FOLDER.mkdir(exist_ok=True)
    report.save(phase_budget(), FOLDER / "phase_budget.png")
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["run", "--seconds", "1", "--rate-dps", "100", "--seed", "1", "--out", folder]
        app(arguments, standalone_mode=False)
        shutil.copyfile(Path(folder) / "startup.png", FOLDER / "startup.png")


if __name__ == "__main__":
    main()
