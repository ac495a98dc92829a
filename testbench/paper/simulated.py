"""What the study's simulations say of the paper's numbers, as the `Model` that the judge takes.

    phases      the calibration's readings; xe2 and ye2 are read through the loop: the switch's delay is added
    points      22 rates, record at rest and bandwidth of each case and temperature
    sigma       of a phase by calibration; of K and bias by their own; of ARW, flicker and bandwidth by what the
                cases of a temperature scatter; of residuals by the noise of a reading

Source    docs/paper.md
"""

import math
import statistics

from testbench.judge.judge import NAME_OF, Model
from testbench.judge.verdict import Value
from testbench.paper import closed_form
from testbench.paper.calibration.calibrate import FACTOR, NODES
from testbench.paper.measure import measure_scale, record_phases
from testbench.run.budget import budget

SOURCE = "simulation"
OWN_SIGMA = {"scale_lsb_per_dps": "scale_sigma_lsb_per_dps", "bias_dps": "bias_sigma_dps"}
SCATTERED = ("arw_deg_per_rt_h", "instability_deg_per_h", "bandwidth_hz")


def node_deg(config, calibration):
    """{node: Value} of the uncompensated node phases: what was found, for xe2 and ye2 with the delay of the switch."""
    switch = {n: -sum(row.degrees for row in rows) for n, rows in budget(closed_form.bare(config)).loop_rows.items()}
    found, sigma = calibration["found_deg"], calibration["found_uncertainty_deg"]
    return {n: Value(found[n] + switch.get(n, 0.0), sigma[n] / FACTOR) for n in NODES}


def _reading_sigma(point):
    """{name: sigma} of what the noise of 22 readings makes: N / sqrt(T) of a Hann-weighted mean of length T.

    Largest residual over 500 deg/s: one reading's. Difference of two slopes: sqrt(2) sigma / sqrt(sum (r - mean)^2).
    """
    arw = point.get("arw_deg_per_rt_h")
    if arw is None:
        return {}
    reading_dps = arw / 60 * math.sqrt(1.5 / measure_scale.READ_S)
    rates = measure_scale.POSITIVE_DPS
    spread = math.sqrt(statistics.pvariance(rates) * len(rates))
    return {
        "nonlinearity_ppm": reading_dps / max(rates) * 1e6,
        "asymmetry_ppm": math.sqrt(2) * reading_dps / spread * 1e6,
    }


def points(found):
    """{(case, degC): {name: Value}} of the numbers of a study's points."""
    out = {}
    for (case, temp), point in found.items():
        beside = [p for (_, t), p in found.items() if t == temp]
        sigma = _reading_sigma(point) | {name: point.get(key) or 0.0 for name, key in OWN_SIGMA.items()}
        for name in SCATTERED:
            values = [p[name] for p in beside if p.get(name) is not None]
            sigma[name] = statistics.stdev(values) if len(values) > 1 else 0.0
        named = {name: point.get(name) for name in NAME_OF.values()}
        out[case, temp] = {n: Value(v, sigma.get(n, 0.0)) for n, v in named.items() if v is not None}
    return out


def excursion_deg(records):
    """{node: Value}: largest excursion of a reading from the mean of its record, over the records."""
    spreads = [record_phases.spread(rows) for rows in records.values()]
    return {n: Value(max(s[n][2] for s in spreads)) for n in NODES} if spreads else {}


def model(config, calibration, found, records):
    """`Model` of a study: its calibration, its points, its records; the rest is in closed form."""
    left = {n: Value(abs(calibration["residual_deg"][n]), calibration["uncertainty_deg"][n] / FACTOR) for n in NODES}
    return Model(
        SOURCE,
        node_deg=node_deg(config, calibration),
        residual_deg=left,
        excursion_deg=excursion_deg(records),
        rise_deg=closed_form.rise_deg(config),
        points=points(found),
        loop_change=closed_form.loop_change(config),
        settings=closed_form.settings(config),
    )
