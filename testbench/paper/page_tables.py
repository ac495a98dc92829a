"""Tables of the page of the paper and of the commands: calibration, cases, points, laws, noise, temperature.

Source    docs/paper.md
"""

import math

import numpy as np

from testbench.console.text_table import Table
from testbench.judge import judge
from testbench.paper import phase_laws, simulated, temperature
from testbench.paper.calibration import calibrations
from testbench.paper.calibration.calibrate_phases import NODES
from testbench.paper.judge_table import format_value
from testbench.paper.loop import equations, loop_page
from testbench.paper.loop import loop as loops
from testbench.paper.loop import loop_parameters as loop_parts
from testbench.paper.measure import record_phases


def calibration_table(one):
    rows = []
    for node in NODES:
        rows.append(
            (
                node,
                f"{one['found_deg'][node]:.5f}",
                f"{one['found_uncertainty_deg'][node]:.5f}",
                f"{one['second_pass_deg'][node]:+.5f}",
                f"{one['residual_deg'][node]:+.5f}",
                f"{one['uncertainty_deg'][node]:.5f}",
            )
        )
    minimum = one["seen"].get("xe2_minimum")
    note = "Truth is never shown to the procedure. Residual: loop phase that is left, counted from the undisplaced pin."
    if minimum:
        note += (
            f" xe1 + xe2' by the minimum of A_d over turned references: {minimum['deg']:.4f} +- "
            f"{minimum['uncertainty_deg']:.4f} deg; by symmetric detuning {one['found_deg']['xe2']:.4f} +- "
            f"{one['found_uncertainty_deg']['xe2']:.4f} deg."
        )
    return Table(
        "Calibration of the base board (deg)",
        ("phase", "found", "+- (99 %)", "second pass", "residual, truth", "+- stated"),
        rows,
        note,
        (1, 2, 3, 4, 5),
    )


def cases_table(one):
    names = ("phase_drive_sine", "phase_drive_ref", "phase_sense_sine", "phase_sense_ref")
    rows = [(f"case {k}", *(f"{v[n]:.5f}" for n in names)) for k, v in sorted(one["cases_deg"].items())]
    return Table("Register sets (deg)", ("case", *names), rows, numeric=(1, 2, 3, 4))


def boards_table(boards):
    s = calibrations.summary(boards)
    rows = [
        (node, f"{1e3 * v['largest_deg']:.2f}", f"{v['covered']}/{s['boards']}", f"{v['unchanged']}/{s['boards']}")
        for node, v in s["phases"].items()
    ]
    return Table(
        f"{s['boards']} random boards",
        ("phase", "largest residual (mdeg)", "truth within the stated uncertainty", "second pass within it"),
        rows,
        f"All four phases within theirs at once: {s['covered_all_four']} of {s['boards']} boards.",
        (1, 2, 3),
    )


def noise_table(noise, derived):
    def cell(label, name, digits):
        return format_value(noise.get(label, {}).get(name), digits)

    arw, floor = "arw_deg_per_rt_h", "instability_deg_per_h"
    rows = []
    for source, want in derived.items():
        only_set, off = (source, "") if source in noise else (f"only {source}", f"without {source}")
        rows.append((source, *(cell(x, arw, 4) for x in (only_set, off)), format_value(want.get(arw), 4),
                     *(cell(x, floor, 3) for x in (only_set, off)), format_value(want.get(floor), 3)))  # fmt: skip
    return Table(
        "Noise of case 5: each source alone, and without it",
        ("source", "ARW, alone (deg/sqrt(h))", "without it", "derived", "bias instability, alone (deg/h)", "without it",
         "derived"),
        rows,
        "Alone and without: fits to the Allan deviation of simulated records. Derived: by the linear loop from the "
        "parts' densities, with the rounding of the converters. 0: the fit found none. Without any source is left "
        "the beat of re-timed reference edges with their 1 MHz grid, of which the linear loop knows nothing.",
        (1, 2, 3, 4, 5, 6),
    )  # fmt: skip


def law_table(rows):
    return Table(
        "Scale factor against the two laws",
        ("set", "ye1 left (deg)", "xe2' left (deg)", "K (LSB per deg/s)", "K / case 5", "less 1/cos(ye1 + xe2') (ppm)",
         "less eq (12), 1/cos(ye1) (ppm)"),
        [
            (r["name"], f"{r['deg']['ye1']:.4f}", f"{r['deg']['xe2']:.4f}", f"{r['lsb_per_dps']:.3f}",
             f"{r['ratio']:.6f}", f"{r['law_ppm']:+.1f}", f"{r['eq12_ppm']:+.1f}")
            for r in rows
        ],
        numeric=(1, 2, 3, 4, 5, 6),
    )  # fmt: skip


POINT_COLUMNS = (
    ("scale_lsb_per_dps", "K (LSB per deg/s)", 6),
    ("nonlinearity_ppm", "nonlin. (ppm)", 4),
    ("asymmetry_ppm", "asym. (ppm)", 4),
    ("quadrature_v", "V_q (V)", 5),
    ("bias_dps", "bias (deg/s)", 4),
    ("bandwidth_hz", "BW (Hz)", 4),
    ("bandwidth_swept_hz", "BW swept (Hz)", 4),
    ("arw_deg_per_rt_h", "ARW (deg/sqrt(h))", 4),
    ("instability_deg_per_h", "BI fit (deg/h)", 3),
    ("floor_deg_per_h", "floor (deg/h)", 3),
    ("floor_low_deg_per_h", "low", 3),
    ("floor_high_deg_per_h", "high", 3),
    ("frequency_hz", "f_d (Hz)", 9),
    ("drive_v", "A_d (V)", 5),
)


def points_table(points):
    rows = [
        (f"case {case}, {temp:g} degC", *(format_value(p.get(name), digits) for name, _, digits in POINT_COLUMNS))
        for (case, temp), p in points.items()
    ]
    return Table(
        "Five cases at three temperatures",
        ("point", *(head for _, head, _ in POINT_COLUMNS)),
        rows,
        "floor: least overlapping Allan deviation with its 68 % limits; BI fit: 0.664 B of the fitted flicker.",
        tuple(range(1, len(POINT_COLUMNS) + 1)),
    )


STEPS = (("1", "2", "xe1"), ("2", "3", "xe2"), ("3", "4", "ye1"), ("4", "5", "ye2"))


def sensitivity_rows(points):
    """The paper's Table 5: |after - before| / |before| of each quantity at each compensation."""
    symbols, model = ("SF", "bias", "Vq", "ARW", "BW"), judge.Model("simulation", points=simulated.point_values(points))
    rows = []
    for before, after, node in STEPS:
        for temp in sorted({t for _, t in points}):
            if (before, temp) in points and (after, temp) in points:
                changes = [judge.relative_change(model, symbol, (before, after), temp) for symbol in symbols]
                cells = (format_value(c and c.value, 3) for c in changes)
                rows.append((f"{node}: case {before} to {after}", f"{temp:g}", *cells))
    return rows


def response_difference(points, configs):
    """{case: (dB, deg)}: largest difference of the measured response from the linear loop up to 60 Hz, at 25 degC."""
    out = {}
    for case, config in configs.items():
        point = points.get((case, 25.0))
        if not point:
            continue
        f = np.array(point["response_hz"])
        closed = loops.close(loop_parts.loop_parameters(config))
        h = loops.response(closed, f) / loops.response(closed, np.array([1e-3]))[0].real
        use = f <= 60.0
        gain = np.abs(np.array(point["response_db"]) - 20 * np.log10(np.abs(h)))[use]
        turn = np.array(point["response_deg"]) - np.degrees(np.unwrap(np.angle(h)))
        out[case] = float(gain.max()), float(np.abs((turn[use] + 180.0) % 360.0 - 180.0).max())
    return out


def response_table(differences_by_case):
    return Table(
        "Response of the simulated gyroscope less the linear loop, 0.5 to 60 Hz",
        ("case", "largest (dB)", "largest (deg)"),
        [(case, f"{db:.4f}", f"{deg:.3f}") for case, (db, deg) in differences_by_case.items()],
        numeric=(1, 2),
    )


def temperature_table(config):
    limits = temperature.drift_limits_k(config)
    grid = temperature.phases(config, (-20.0, 25.0, 50.0))
    rows = [
        (node, *(f"{v:.4f}" for v in grid[node]), *("beyond 80" if math.isinf(k) else f"{k:g}" for k in limits[node]))
        for node in NODES
    ]
    band = min(k for pair in limits.values() for k in pair)
    after = temperature.rise_after_s(record_phases.SELF_HEATING_K, config.plant.warm_up_tau_s, band)
    return Table(
        "Phases over temperature, and how far a calibration holds",
        ("phase", "-20 degC (deg)", "25 degC (deg)", "50 degC (deg)", "12 mdeg below 25 degC after (K)", "above (K)"),
        rows,
        f"The first phase leaves the paper's level after {band:g} K. With {record_phases.SELF_HEATING_K:g} K of "
        f"self-heating (assumed) a calibration made warm holds from {after:.0f} s after power-on.",
        (1, 2, 3, 4, 5),
    )


def misprint_table(config):
    device = config.device()
    y = equations.Mode(device.mass_kg, 2 * math.pi * device.fy_hz, device.qy)
    drive, ye1_rad = 2 * math.pi * device.fx_hz, math.radians(8.8814)
    return loop_page.misprint_table(y, drive, device.coriolis_mass_kg, ye1_rad)


def rail_table(explained, wide):
    """Nonlinearity of cases 1 to 3: `nonlinearity.Explained` of each point; with more span of V_q at 25 degC."""
    rows = [
        (f"case {case}, {temp:g} degC", f"{e.measured_ppm:.0f}", f"{sigma:.0f}", f"{e.unrailed_ppm:.0f}",
         f"{e.rail_ppm:.0f}",
         *("-" if math.isnan(knee) else f"{knee:.0f}" for knee in (e.ceiling_dps, e.zero_dps)),
         f"{wide[case]:.0f}" if temp == 25.0 and case in wide else "-")
        for (case, temp), (e, sigma) in explained.items()
    ]  # fmt: skip
    return Table(
        "Nonlinearity of cases 1 to 3 (ppm of 500 deg/s)",
        ("point", "measured", "1 sigma", "rates between the rails", "by the rails alone",
         "ceiling from (deg/s)", "0 V from (deg/s)",
         f"V_q's span x {phase_laws.SPAN_PART:g}"),
        rows,
        "By the rails alone: behind the rate at which V_q reaches its ceiling, or 0, the slope grows by "
        "tan(ye1 + xe2') tan(ye2' - xe2'), phases as they were calibrated and as they drift, ye2' less the sense "
        "mode's own "
        "lead; nothing is fitted. The largest residual of noise alone is about two sigma.",
        (1, 2, 3, 4, 5, 6, 7),
    )  # fmt: skip


def changes_table(points):
    """The paper's Table 5; None if no two neighbouring cases are there."""
    rows = sensitivity_rows(points)
    return rows and Table(
        "The paper's Table 5 from the model: relative change at each compensation",
        ("compensation", "degC", "scale factor", "bias", "V_q", "ARW", "bandwidth"),
        rows,
        "|after - before| / |before|. ARW and bandwidth differ within their own uncertainty.",
        (1, 2, 3, 4, 5, 6),
    )
