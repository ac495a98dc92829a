"""Rivals: what else could make a number of the paper, what each predicts, and what would tell it from the others.

    phases       rows of testbench.run.budget of the default board
    scale        1/cos of the phases;   V_q, bias: what a step between two cases would take
    noise        square root of the absolute temperature

What the model says of the numbers and the verdict are the judge's.
Source    docs/measured_results.md, docs/phases.md
"""

import math

import numpy as np

from testbench import config
from testbench.errors import FileError
from testbench.measured.formats.paper_numbers import ROOM, TEMPERATURES, Rival
from testbench.run import budget

RATES = (0.1, 0.5, 1, 5, 10, 50, 100, 200, 300, 400, 500)
COUPLING_DPS = 100.0  # quadrature of the paper's k_xy, at V_q = 4.5247 V
RAIL_V = 5.5  # of the quadrature DAC, analog_frontend/parts/dac.py
HOT_K, COLD_K = 323.15, 253.15
MEAN, STEP = "mean of cases", "case 3 vs case 4"


def quadrature_mean(phase_deg, quadrature_v):
    """Mean V_q (V) over the paper's 22 rates with the sense phase uncompensated, as a share of V_q at rest.

    V_q^2 = zero_rate_v^2 (1 + rate tan(phase) / coupling), within 0 .. rail.
    """
    rates = np.array([s * r for r in RATES for s in (-1, 1)])
    u = 1 + rates * math.tan(math.radians(phase_deg)) / COUPLING_DPS
    return float(np.mean(np.clip(quadrature_v * np.sqrt(np.maximum(u, 0)), 0, RAIL_V)) / quadrature_v)


def rivals(numbers):
    """{(symbol, beginning of the case, temperature): rivals} of a list of numbers."""
    planned = budget.budget(config.Config())
    out = _feedback(numbers, planned) | _forward()
    for t in TEMPERATURES:
        out["SF", STEP, t] = _scale(numbers, planned)
        out["Vq", STEP, t] = _quadrature(numbers, t)
        out["bias", STEP, t] = _bias(numbers, t)
        out["ARW", MEAN, t], out["BI", MEAN, t] = _noise_rivals(numbers, "ARW"), _noise_rivals(numbers, "BI")
        out["SF nonlinearity", MEAN, t] = NONLINEARITY
    return out


def _budget_phase_deg(planned, node, words):
    return next(r.degrees for r in planned.rows[node] if words in r.what)


def _feedback(numbers, planned):
    node, us = planned.node_deg(), 360 * planned.frequency_hz * 1e-6
    xe1, ye1 = numbers.get("phi_xe1", "case 1"), numbers.get("phi_ye1", "case 3")
    plain = node["xe1"] - _budget_phase_deg(planned, "xe1", "wait for the 1 MHz grid")
    short = node["ye1"] - _budget_phase_deg(planned, "ye1", "extra 1 us frames")
    pole_deg = ye1 - short
    tau_ns = math.tan(math.radians(pole_deg)) / (2 * math.pi * planned.frequency_hz) * 1e9
    loss = 100 * (1 - math.cos(math.radians(pole_deg)))
    retimed = Rival(
        "references re-timed on the 1 MHz grid (in the model)",
        f"{node['xe1']:.3f} deg",
        "oscilloscope: whether the reference edges lie on the grid",
    )
    faster = Rival(
        "references not re-timed, SPI at a faster clock",
        f"{plain:.3f} deg at 26 MHz SPI; the paper's value needs {(plain - xe1) / us * 1e3:.0f} ns less",
        "oscilloscope: length of an SPI frame",
    )
    frame = Rival(
        "one extra 1 us frame in the sense path (in the model)",
        f"{node['ye1']:.3f} deg, {(node['ye1'] - ye1) / us * 1e3:.0f} ns too much",
        "phase at two frequencies 1 kHz apart: a delay of 1 us gives 0.360 deg",
    )
    pole = Rival(
        "no extra frame, an analogue reconstruction pole",
        f"{short:.3f} deg + arctan(2 pi f tau), tau = {tau_ns:.0f} ns",
        f"gain: the pole attenuates by {loss:.2f} %, a delay does not; a force step on an oscilloscope",
    )
    return {("phi_xe1", "case 1", ROOM): (retimed, faster), ("phi_ye1", "case 3", ROOM): (frame, pole)}


def _forward():
    capacitors = Rival(
        "capacitors at the ring diode (chosen in the model to fit: no test)",
        "tau = Cref / (4 fc (C0 + Cp)): 1 % of it is 0.008 deg",
        "phase with another carrier frequency: tau goes as 1 / fc",
    )
    amplifiers = Rival(
        "bandwidth of the op amps", "2 % of the gain-bandwidth is 0.009 deg", "phase against gain of the amplifier"
    )
    both = capacitors, amplifiers
    return {("phi_xe2", "case 3", ROOM): both, ("phi_ye2", "case 4 (phi_ye2", ROOM): both}


def _scale(numbers, planned):
    ye1 = numbers.get("phi_ye1", "case 3")
    both = 1 / math.cos(math.radians(ye1 + planned.loop_deg()["xe2"])) - 1
    law = 1 / math.cos(math.radians(ye1)) - 1
    return (
        Rival(
            "eq (12) with the paper's own phi_ye1",
            f"{law:.4f}",
            "scale factor with phi_ye1 at 0, 4.4, 8.9 deg by its register: 1/cos or a line",
        ),
        Rival("phi_xe2' is not compensated", f"{both:.4f}", "case 1 against case 3"),
    )


def _quadrature_change_dps(numbers, t):
    """Quadrature (deg/s) by which V_q has moved from case 3 to case 4, by its square; FileError if it has not."""
    change = numbers.get("Vq", "case 3 vs case 4", t)
    change_dps = COUPLING_DPS * (1 - (1 - change) ** 2)
    if change_dps == 0:
        raise FileError(f"{numbers.path}: Vq: a change of {change:g} from case 3 to case 4 does not change its square")
    return change_dps


def _quadrature(numbers, t):
    ye1, quadrature_v = numbers.get("phi_ye1", "case 3"), numbers.get("Vq", "mean of cases")
    share = 1 - quadrature_mean(ye1, quadrature_v)
    force = _quadrature_change_dps(numbers, t) / math.tan(math.radians(ye1))
    return (
        Rival(
            "V_q is the mean over the 22 rates",
            f"{share:.4f}, by V_q^2 = V_q(0)^2 (1 + rate tan(phi_ye1) / 100 deg/s) and the 5.5 V rail",
            "V_q at rest alone, and against rate",
        ),
        Rival(
            "an in-phase force, turned by phi_ye1",
            f"{force:.0f} deg/s of this force give the printed change; the bias is below 1 deg/s",
            "bias against V_q with the quadrature loop open",
        ),
        Rival("charging or drift between the cases", "any, without a register write", "case 3, 4, 3, 4 in turn"),
    )


def _bias(numbers, t):
    bias, ye1 = abs(numbers.get("bias", "mean of cases", t)), numbers.get("phi_ye1", "case 3")
    step = numbers.get("bias", "case 3 vs case 4", t) * bias
    leak = math.degrees(math.atan(step / _quadrature_change_dps(numbers, t)))
    turned = bias * (1 / math.cos(math.radians(ye1)) - 1)
    return (
        Rival(
            "shares its cause with V_q",
            f"a leak of {leak:.2f} deg of the quadrature by which V_q changed",
            "bias against V_q",
        ),
        Rival("damping coupling, divided by cos(phi_ye1)", f"{turned:.4f} deg/s", "bias against phi_ye1"),
    )


def _noise_rivals(numbers, symbol):
    other = "BI" if symbol == "ARW" else "ARW"
    ratio = numbers.get(other, "mean of cases", "50") / numbers.get(other, "mean of cases", "-20")
    law = math.sqrt(HOT_K / COLD_K)
    return (
        Rival(
            "thermal noise of resistors or resonator",
            f"ratio of 50 degC to -20 degC: {law:.4f}",
            f"{symbol} at five temperatures",
        ),
        Rival(
            "the gain of the C/V falls, the noise after it does not",
            f"the same ratio in both: {other} has {ratio:.4f}",
            "noise with the drive off compared with the drive on",
        ),
        Rival("the motion becomes smaller", "as 1 / amplitude, and A_d with it", "A_d and C/V amplitude"),
    )


NONLINEARITY = (
    Rival(
        "rail of the quadrature loop at high rate",
        "vanishes with phi_ye1 compensated (case 4), or with rates below 260 deg/s",
        "residuals of the straight line against rate, cases 3 and 4",
    ),
    Rival("curve of the force DAC or of its electrodes", "stays with phi_ye1 compensated", "the same experiment"),
)
