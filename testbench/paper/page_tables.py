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

PHASES = {"xe1": "xe1", "xe2": "xe2'", "ye1": "ye1", "ye2": "ye2'"}  # node phases, and loop phases with a prime


def calibration_table(one):
    rows = []
    for node in NODES:
        rows.append(
            (
                PHASES[node],
                f"{one['found_deg'][node]:.5f}",
                f"{one['found_uncertainty_deg'][node]:.5f}",
                f"{one['second_pass_deg'][node]:+.5f}",
                f"{one['residual_deg'][node]:+.5f}",
                f"{one['uncertainty_deg'][node]:.5f}",
            )
        )
    minimum = one["seen"].get("xe2_minimum")
    note = "The procedure never sees the true values. Residual: loop phase that remains, relative to the pin at word 0."
    if minimum:
        note += (
            f" xe1 + xe2' from the minimum of A_d over rotated references: {minimum['deg']:.4f} +- "
            f"{minimum['uncertainty_deg']:.4f} deg; from symmetric detuning {one['found_deg']['xe2']:.4f} +- "
            f"{one['found_uncertainty_deg']['xe2']:.4f} deg."
        )
    return Table(
        "Calibration of the base board (deg)",
        ("phase", "estimate", "+- (99 %)", "second pass", "true residual", "stated +- (99 %)"),
        rows,
        note,
        (1, 2, 3, 4, 5),
    )


def cases_table(one):
    names = ("phase_drive_sine", "phase_drive_ref", "phase_sense_sine", "phase_sense_ref")
    rows = [(f"case {k}", *(f"{v[n]:.5f}" for n in names)) for k, v in sorted(one["cases_deg"].items())]
    return Table("Register sets (deg)", ("case", *names), rows, numeric=(1, 2, 3, 4))


def boards_table(boards, is_configured=False):
    """Residuals over random boards, or of the configured board alone."""
    s = calibrations.summary(boards)
    rows = [
        (
            PHASES[node],
            f"{1e3 * v['largest_deg']:.2f}",
            f"{v['covered']}/{s['boards']}",
            f"{v['unchanged']}/{s['boards']}",
        )
        for node, v in s["phases"].items()
    ]
    return Table(
        "This board" if is_configured else "1 random board" if s["boards"] == 1 else f"{s['boards']} random boards",
        (
            "phase",
            "largest residual (mdeg)",
            "true residual within its uncertainty",
            "second pass within its uncertainty",
        ),
        rows,
        f"All four true residuals are within their uncertainties on {s['covered_all_four']} of {s['boards']} boards.",
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
        "Noise of case 5: each source alone, and all sources without it",
        ("source", "ARW, alone (deg/sqrt(h))", "ARW, without it", "ARW, derived", "bias instability, alone (deg/h)",
         "instability, without it", "instability, derived"),
        rows,
        "Alone, without it: fits to the Allan deviation of simulated records. Derived: computed with the linear loop "
        "from the parts' noise densities and the rounding of the converters. 0: the fit found no such noise. With all "
        "sources off, the beat of the re-timed reference edges with their 1 MHz grid remains; the linear loop does not "
        "model it.",
        (1, 2, 3, 4, 5, 6),
    )  # fmt: skip


def law_table(rows):
    return Table(
        "Scale factor compared with two laws",
        ("set", "residual ye1 (deg)", "residual xe2' (deg)", "K (LSB per deg/s)", "K over K of case 5",
         "deviation from 1/cos(ye1 + xe2') (ppm)", "deviation from eq (12), 1/cos(ye1) (ppm)"),
        [
            (r["name"], f"{r['deg']['ye1']:.4f}", f"{r['deg']['xe2']:.4f}", f"{r['lsb_per_dps']:.3f}",
             f"{r['ratio']:.6f}", f"{r['law_ppm']:+.1f}", f"{r['eq12_ppm']:+.1f}")
            for r in rows
        ],
        numeric=(1, 2, 3, 4, 5, 6),
    )  # fmt: skip


POINT_COLUMNS = (
    ("scale_lsb_per_dps", "scale factor (LSB per deg/s)", 6),
    ("nonlinearity_ppm", "nonlinearity (ppm)", 4),
    ("asymmetry_ppm", "asymmetry (ppm)", 4),
    ("quadrature_v", "V_q (V)", 5),
    ("bias_dps", "bias (deg/s)", 4),
    ("bandwidth_hz", "bandwidth, multisine (Hz)", 4),
    ("bandwidth_swept_hz", "bandwidth, sweep (Hz)", 4),
    ("arw_deg_per_rt_h", "ARW (deg/sqrt(h))", 4),
    ("instability_deg_per_h", "bias instability, fit (deg/h)", 3),
    ("floor_deg_per_h", "Allan minimum (deg/h)", 3),
    ("floor_low_deg_per_h", "Allan minimum, lower limit (deg/h)", 3),
    ("floor_high_deg_per_h", "Allan minimum, upper limit (deg/h)", 3),
    ("frequency_hz", "drive frequency (Hz)", 9),
    ("drive_v", "drive amplitude A_d (V)", 5),
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
        "Allan minimum: least overlapping Allan deviation, with 68 % limits. Bias instability: 0.664 B of the fit.",
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
        "Response of the simulated gyroscope minus that of the linear loop, 0.5 to 60 Hz",
        ("case", "largest difference (dB)", "largest difference (deg)"),
        [(case, f"{db:.4f}", f"{deg:.3f}") for case, (db, deg) in differences_by_case.items()],
        numeric=(1, 2),
    )


def temperature_table(config):
    limits = temperature.drift_limits_k(config)
    grid = temperature.phases(config, (-20.0, 25.0, 50.0))
    rows = [
        (
            PHASES[node],
            *(f"{v:.4f}" for v in grid[node]),
            *("more than 80" if math.isinf(k) else f"{k:g}" for k in limits[node]),
        )
        for node in NODES
    ]
    band = min(k for pair in limits.values() for k in pair)
    after = temperature.rise_after_s(record_phases.SELF_HEATING_K, config.plant.warm_up_tau_s, band)
    return Table(
        "Phases over temperature, and temperature range of a calibration",
        (
            "phase",
            "-20 degC (deg)",
            "25 degC (deg)",
            "50 degC (deg)",
            "cooling from 25 degC to 12 mdeg of drift (K)",
            "heating to 12 mdeg of drift (K)",
        ),
        rows,
        f"A change of {band:g} K moves the first phase by more than the paper's level. With "
        f"{record_phases.SELF_HEATING_K:g} K of self-heating (assumed), a calibration of the warm device is valid from "
        f"{after:.0f} s after power-on.",
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
        ("point", "measured", "1 sigma", "rates without V_q saturation", "computed from V_q saturation",
         "V_q at its ceiling from (deg/s)", "V_q at 0 V from (deg/s)",
         f"measured, V_q span x {phase_laws.SPAN_PART:g}"),
        rows,
        "Computed from V_q saturation: beyond the rate at which V_q reaches its ceiling or 0 V, the slope grows by "
        "tan(ye1 + xe2') tan(ye2' - xe2'). The phases are the calibrated ones with their drift; the lead of the sense "
        "mode is subtracted from ye2'. Nothing is fitted. Noise alone gives a largest residual of about two sigma.",
        (1, 2, 3, 4, 5, 6, 7),
    )  # fmt: skip


def changes_table(points):
    """The paper's Table 5; None if no two neighbouring cases are there."""
    rows = sensitivity_rows(points)
    return rows and Table(
        "The paper's Table 5 from the model: relative change at each compensation",
        ("compensation", "degC", "scale factor", "bias", "V_q", "ARW", "bandwidth"),
        rows,
        "|after - before| / |before|. The changes of ARW and bandwidth are within their uncertainty.",
        (1, 2, 3, 4, 5, 6),
    )
