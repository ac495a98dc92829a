"""Electrostatics behind the plant's coefficients: force per volt, the quadrature electrode, unequal-gap combs.

    push-pull force       F = C'/2 [(Vdc + v)^2 - (1 - e)(Vdc - v)^2] = 2 C' Vdc v + e C'/2 (Vdc - v)^2
    force coefficient     k_vf = 2 C' Vdc, e = 0
    quadrature stiffness  k_res = k_xy - kq V_q^2                       nulled by V_q = sqrt(k_xy / kq)

    unequal-gap combs     n fingers, gaps d and lambda d, height h, overlap l0 + x (x moves along, y across the gap):
        W(x, y) = n e0 h V^2 (l0 + x)/2 [1/(d - y) + 1/(lambda d + y)],   F_y = dW/dy
        kq    = d2W/dxdy / V^2     = n e0 h (1 - 1/lambda^2) / (2 d^2)        the coupling falls by kq V^2
        k_y falls by kqy V^2, kqy  = d2W/dy2 / V^2 = n e0 h l0 (1 + 1/lambda^3) / d^3
    With lambda = 1 the two gaps cancel: no quadrature force, only softening.

Left out   softening of k_y with V_q^2 (an effect: it moves the split), carrier softening (part of the measured f)
Numbers    + - * / only, and one square root (correctly rounded by IEEE 754)
Source     docs/plant.md
"""

import math
from typing import NamedTuple

from fpga_model.jit import inlined

EPS0_F_PER_M = 8.8541878128e-12


class Comb(NamedTuple):
    """Unequal-gap quadrature combs; defaults: the dual-mass gyroscope of Micromachines 2018 9(10) 511, Table 1."""

    fingers: int = 30
    height_m: float = 60e-6
    gap_m: float = 5e-6
    overlap_m: float = 10e-6
    gap_ratio: float = 2.5


def check_comb(comb):
    """The comb itself; ValueError for a dimension that is not positive or a ratio below 1."""
    for name, value, unit in zip(Comb._fields, comb, ("1", "m", "m", "m", "1")):
        lo = 1.0 if name in ("gap_ratio", "fingers") else 0.0
        if not lo <= value < math.inf or value == 0.0:
            raise ValueError(f"{name} = {value!r} is outside {lo:g} .. inf (unit {unit})")
    return comb


def comb_kq_n_per_m_per_v2(comb):
    """Coupling stiffness taken away per V_q^2."""
    n, height, gap, _, ratio = check_comb(comb)
    return n * EPS0_F_PER_M * height * (1.0 - 1.0 / (ratio * ratio)) / (2.0 * gap * gap)


def comb_softening_n_per_m_per_v2(comb):
    """Stiffness of the sense mode taken away per V_q^2."""
    n, height, gap, overlap, ratio = check_comb(comb)
    return n * EPS0_F_PER_M * height * overlap * (1.0 + 1.0 / (ratio * ratio * ratio)) / (gap * gap * gap)


@inlined
def push_pull_n(dcdx_f_per_m, bias_v, mismatch, v):
    """Force (N) of a push-pull electrode pair, the second half smaller by the fraction `mismatch`."""
    up = bias_v + v
    down = bias_v - v
    return 0.5 * dcdx_f_per_m * (up * up - (1.0 - mismatch) * (down * down))


def k_vf_n_per_v(dcdx_f_per_m, bias_v):
    """Force per volt of the matched pair."""
    return 2.0 * dcdx_f_per_m * bias_v


@inlined
def coupling_n_per_m(kxy_n_per_m, kq_n_per_m_per_v2, vq_v):
    """Residual coupling stiffness (N/m) at the quadrature voltage: `kappa` of the propagator."""
    return kxy_n_per_m - kq_n_per_m_per_v2 * (vq_v * vq_v)


def null_v(kxy_n_per_m, kq_n_per_m_per_v2):
    """Quadrature voltage (V) that nulls the coupling; ValueError if no voltage can."""
    if not (kxy_n_per_m >= 0.0 and kq_n_per_m_per_v2 > 0.0):
        raise ValueError(
            f"kxy_n_per_m = {kxy_n_per_m!r} with kq_n_per_m_per_v2 = {kq_n_per_m_per_v2!r} has no null: "
            "the limits are 0 .. inf (unit N/m) and above 0 (unit N/m/V^2)"
        )
    return math.sqrt(kxy_n_per_m / kq_n_per_m_per_v2)


def quadrature_deg_per_s(kappa_n_per_m, coriolis_mass_kg, f_hz):
    """Rate (deg/s) whose Coriolis force equals the coupling force: k / (2 m_c 2 pi f) rad/s."""
    return 180.0 / (4.0 * math.pi * math.pi) * kappa_n_per_m / (coriolis_mass_kg * f_hz)
