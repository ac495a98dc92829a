"""Ranges: what each part of the chain must hold at the largest rate and quadrature, and how much it has.

    force        (rate + bias) / cos(ye1 + xe2') in volts, for the weakest transducer and pickoff, against the sense
                 converter's span
    hold         m w^2 A / Q in volts at the drive electrode, for the least Q, against HOLD_SHARE of the drive's span
    V_q          quadrature +- rate tan(ye1 + xe2'), as a square of V_q: between 0 and the rail
    drive code   the set-point at the converter, which its loop holds whatever the pickoff's gain is
    sense code   rate, and quadrature, before their loops close
    x            A times nominal over least gain of the pickoff, against the gap
    y            rate and quadrature, a quarter of a turn apart, by the sense mode's stiffness, before the loops close

Each is linear in the amplitude A but V_q, which does not depend on it: `most_amplitude_um` follows at once.
Source  docs/design_of_loops.md
"""

import math
from typing import NamedTuple

from testbench.paper.loop.loop_parameters import loop_parameters
from testbench.run import build

ROOM = 0.9  # of a range, for noise, overshoot and temperature
HOLD_SHARE = 0.25  # of the drive's span: the rest starts the resonator
LARGEST_UM = 10.0
LOWER = "lower the amplitude"
LOWER_FORCE = "lower max_rate_deg_s or the amplitude"
LOWER_LEAK = "compensate = true, or lower max_rate_deg_s"
LOWER_V_Q = "compensate = true, or lower max_rate_deg_s or max_quadrature_deg_s"
LOWER_DRIVE = "lower the amplitude or nominal.adc_pga_drive"
LOWER_SENSE = "lower the amplitude or nominal.adc_pga_sense"


class Range(NamedTuple):
    """One range: what, its value, its limit, the unit, whether it grows with the amplitude, what to do."""

    what: str
    value: float
    limit: float
    unit: str
    by_amplitude: bool
    remedy: str

    @property
    def is_satisfied(self):
        return self.value <= self.limit * (1 + 1e-9)

    @property
    def share(self):
        return self.value / self.limit if self.limit > 0 else math.inf


def _leak_rad(p):
    # node phase ye1 counts from the sense pin, which the references' words turn against the drive's
    return p.ye1_rad + p.xe2_rad - p.sense_turn_rad


def leak_deg(config):
    """ye1 + xe2' (deg): the angle by which rate leaks into quadrature."""
    p = loop_parameters(config)
    return math.degrees(_leak_rad(p))


def ranges(config, target):
    """[Range, ...] of a configuration at the largest rate and quadrature of a target."""
    n, unit_scales, p = config.nominal, build.nominal(config), loop_parameters(config)
    angle = _leak_rad(p)
    root = math.sqrt(n.q_tolerance)
    # signals are held, so a weak pickoff moves further; a weak transducer needs more volts
    further = (1 + n.capacitor_tolerance) / (1 - n.transducer_tolerance)
    volts = further / (1 - n.transducer_tolerance)
    worst_sense_factor = further * (1 + n.transducer_tolerance) / (1 - n.capacitor_tolerance) / (1 - n.split_tolerance)
    rate = target.max_rate_deg_s
    bias = abs(p.dxy_n_s_per_m / (2 * p.coriolis_mass_kg)) * 180 / math.pi * root
    null_dps = unit_scales["null_deg_per_s"]
    quadrature = null_dps if target.max_quadrature_deg_s is None else target.max_quadrature_deg_s
    leak = rate * abs(math.tan(angle))
    full = (n.quad_dac_span_v / unit_scales["null_v"]) ** 2 * null_dps if unit_scales["null_v"] else math.inf
    w = 2 * math.pi * n.fx_hz
    drive = config.firmware.amplitude_um * unit_scales["v_per_um"]
    hold_v = n.mass_kg * w**2 * config.firmware.amplitude_um * 1e-6 / n.qx * root / n.k_vf_drive_n_per_v
    code_v = abs(unit_scales["code_v_per_deg_s"]) * worst_sense_factor
    um_per_dps = (
        1e6 * abs(unit_scales["code_v_per_deg_s"]) / abs(p.cv_v_per_m * p.sid_gain) * further / (1 - n.split_tolerance)
    )
    force_v = (rate + bias) / abs(math.cos(angle)) * abs(unit_scales["word_v_per_deg_s"]) * volts
    sense_v, drive_v = ROOM * unit_scales["adc_sense_v"], ROOM * unit_scales["adc_drive_v"]
    checked_ranges = [
        Range("force at the sense electrode", force_v, ROOM * n.sense_dac_span_v, "V", True, LOWER_FORCE),
        Range(
            "force that keeps the drive amplitude",
            abs(hold_v) * volts,
            HOLD_SHARE * n.drive_dac_span_v,
            "V",
            True,
            LOWER,
        ),
        Range(
            "quadrature and leaked rate against the V_q rail", quadrature + leak, ROOM * full, "deg/s", False, LOWER_V_Q
        ),
        Range("leaked rate against V_q = 0", leak, ROOM * null_dps, "deg/s", False, LOWER_LEAK),
        Range("drive signal at the converter", drive, drive_v, "V", True, LOWER_DRIVE),
        Range("rate at the sense converter, loop open", rate * code_v, sense_v, "V", True, LOWER_SENSE),
        Range("quadrature at the sense converter, loop open", quadrature * code_v, sense_v, "V", True, LOWER_SENSE),
    ]
    if target.gap_um is not None:
        most = target.gap_share * target.gap_um
        y_um = math.hypot(rate, quadrature) * um_per_dps
        x_um = config.firmware.amplitude_um * further
        checked_ranges.append(Range("displacement x against the gap", x_um, most, "um", True, LOWER))
        checked_ranges.append(Range("displacement y against the gap, loop open", y_um, most, "um", True, LOWER))
    return checked_ranges


def most_amplitude_um(checked_ranges, amplitude_um):
    """(largest amplitude (um) that the ranges hold, name of the range that bounds it)."""
    growing = [r for r in checked_ranges if r.by_amplitude]
    tightest = max(growing, key=lambda r: r.share)
    most = amplitude_um / tightest.share
    return (
        (most, tightest.what)
        if most < LARGEST_UM
        else (LARGEST_UM, f"{LARGEST_UM:g} um, the largest that the design chooses")
    )
