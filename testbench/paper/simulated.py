"""What the study's simulations say of the paper's numbers, as the `Model` that the judge takes.

    phases      the calibration's readings; xe2 and ye2 are read through the loop: the switch's delay is added
    points      22 rates, record at rest and bandwidth of each case and temperature
    sigma       of a phase by the calibration, of a point's numbers by their measures
    not read    the bias instability: records of minutes know it to a sixth only, so it is that of the closed form

Source    docs/paper.md
"""

import math

from analog_frontend.parts import thermal
from testbench.judge.judge import NAME_OF, Model
from testbench.judge.number_verdict import Value
from testbench.paper import closed_form, temperature
from testbench.paper.calibration.calibrate_phases import FACTOR, NODES, REGISTER
from testbench.paper.measure import record_phases
from testbench.run.budget import budget

SOURCE = "simulation"
BY_FORMULA = "instability_deg_per_h"


def node_deg(config, calibration):
    """{node: Value} of the uncompensated node phases: what was found, for xe2 and ye2 with the delay of the switch."""
    switch = {n: -sum(row.degrees for row in rows) for n, rows in budget(closed_form.bare(config)).loop_rows.items()}
    readings_deg, sigma = calibration["found_deg"], calibration["found_uncertainty_deg"]
    return {n: Value(readings_deg[n] + switch.get(n, 0.0), sigma[n] / FACTOR) for n in NODES}


def mode_lead_deg(device):
    """Phase (deg) by which y leads what an ideal spring would show: 2 w_d / (tau (w_d^2 - w_y^2)), tau = 2 Q / w_y."""
    drive, sense = 2 * math.pi * device.fx_hz, 2 * math.pi * device.fy_hz
    return math.degrees(drive * sense / (device.qy * (drive**2 - sense**2)))


def residual_phases_deg(config, calibration, words, temp_degc):
    """{"xe2", "ye1", "ye2": deg}: loop phases that a case's words leave at a temperature, ye2 less the mode's lead.

    They are those that were found at 25 degC with the words of case 1, and drift by the parts' laws.
    """
    node, begin = calibration["found_deg"], calibration["cases_deg"]["1"]
    drift = {n: end - start for n, (start, end) in temperature.phases(config, (25.0, temp_degc)).items()}
    change = {n: words[REGISTER[n]] - begin[REGISTER[n]] for n in NODES}
    out = {n: node[n] + drift[n] + (change[n] if n.endswith("2") else -change[n]) for n in ("xe2", "ye1", "ye2")}
    lead_deg = mode_lead_deg(thermal.device_at_temperature(config.device(), temp_degc))
    return out | {"ye2": out["ye2"] - lead_deg}


def _stated_sigma(point, name):
    """Standard uncertainty of a number of a point as its own measure states it; 0 where none is stated."""
    what, _, unit = name.partition("_")
    return point.get(f"{what}_sigma_{unit}") or 0.0


def point_values(point_results):
    """{(case, degC): {name: Value}} of the numbers of a study's points."""
    return {
        key: {
            n: Value(point[n], _stated_sigma(point, n))
            for n in NAME_OF.values()
            if n != BY_FORMULA and point.get(n) is not None
        }
        for key, point in point_results.items()
    }


def excursion_deg(records):
    """{node: Value}: largest excursion of a reading from the mean of its record, over the records."""
    spreads = [record_phases.reading_spread(rows) for rows in records.values()]
    return {n: Value(max(s[n][2] for s in spreads)) for n in NODES} if spreads else {}


def with_closed_forms(config, simulated):
    """The `Model` with what takes no simulation: bias instability, rise of phases, changes of the loop, settings."""
    floor = {t: closed_form.instability_values(config, t) for _, t in simulated.points}
    return simulated._replace(
        points={(case, t): values | floor[t] for (case, t), values in simulated.points.items()},
        rise_deg=closed_form.rise_deg(config),
        loop_change=closed_form.loop_change(config),
        settings=closed_form.settings(config),
    )


def model(config, calibration, point_results, records):
    """`Model` of a study: its calibration, its points, its records; the rest is in closed form."""
    error = {n: Value(abs(calibration["residual_deg"][n]), calibration["uncertainty_deg"][n] / FACTOR) for n in NODES}
    simulated = Model(
        SOURCE, node_deg(config, calibration), error, excursion_deg(records), points=point_values(point_results)
    )
    return with_closed_forms(config, simulated)


def as_json(study_model):
    """What was simulated of a `Model`, as plain data: {"points": {"CASE, DEGC": {name: [value, sigma]}}, ...}."""
    return {
        "points": {
            f"{case}, {temp:g}": {n: v for n, v in values.items() if n != BY_FORMULA}
            for (case, temp), values in study_model.points.items()
        },
        **{name: dict(getattr(study_model, name)) for name in ("node_deg", "residual_deg", "excursion_deg")},
    }


def from_json(data, config):
    """`Model` from what `as_json` wrote, of a configuration."""
    phases = {
        name: {n: Value(*v) for n, v in data[name].items()} for name in ("node_deg", "residual_deg", "excursion_deg")
    }
    points = {}
    for key, values in data["points"].items():
        case, temp = key.split(", ")
        points[case, float(temp)] = {name: Value(*v) for name, v in values.items()}
    return with_closed_forms(config, Model(SOURCE, points=points, **phases))
