"""The paper's record of phases: two hours after a warm-up of 1800 s, a reading every few minutes.

    xe1, ye1    counter, as when they are calibrated      xe2, ye2    amplitude and codes, likewise

One reading takes a minute: few turns of the drive sine.

The package warms by itself while it runs; between readings the board runs on. The engine for hours runs all
but the counter's gates, which the frame engine runs.
Source    docs/paper.md
"""

from testbench import config as configuration
from testbench.paper.calibration.bench import Bench, Judge
from testbench.paper.calibration.calibrate_phases import NODES, chop, detune, force_interval, interval
from testbench.paper.measure.characterise import choose_engine

WARM_UP_S, RECORD_S = 1800.0, 7200.0
SELF_HEATING_K = 5.0  # A: the paper's board is warm after 1800 s


def record(base, phases_deg, seconds=RECORD_S, warm_up_s=WARM_UP_S, readings=12):
    """Rows of {"time_s", node readings (deg), "truth"} of a board with these words; time counts from power-on."""
    values = {f"firmware.{name}_deg": value for name, value in phases_deg.items()}
    values |= {"plant.self_heating_k": SELF_HEATING_K}
    config = configuration.changed(base, values)
    bench = Bench(config, engine=choose_engine(config))
    rows = []
    for k in range(readings + 1):
        until = warm_up_s + seconds * k / readings
        if bench.time_s < until:
            bench.wait(until - bench.time_s)
        row = {"time_s": bench.time_s}
        row["xe1"] = interval(bench, "drive", (0.0,)).estimate().deg
        row["xe2"] = detune(bench, (45.0, 40.0)).estimate().deg - row["xe1"]
        row["ye1"] = force_interval(bench, (0.0,)).estimate().deg
        row["ye2"] = chop(bench, (0.0, 20.0))[0].estimate().deg + row["xe2"]
        row["truth"] = Judge(bench).residuals().deg
        rows.append(row)
    return rows


def reading_spread(rows):
    """{node: (mean, standard deviation, largest excursion)} of a record (deg)."""
    out = {}
    for node in NODES:
        values = [row[node] for row in rows]
        mean = sum(values) / len(values)
        sd = (sum((v - mean) ** 2 for v in values) / max(len(values) - 1, 1)) ** 0.5
        out[node] = mean, sd, max(abs(v - mean) for v in values)
    return out
