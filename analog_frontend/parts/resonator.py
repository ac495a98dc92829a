"""Two coupled modes: the 4 x 4 block of the plant's generator, affine in the rate and in the coupling stiffness.

    m x'' + d_x x' + k_x x + k_xy y + d_xy y' - 2 m_c Omega y' = F_x        d_i = m w_i / Q_i,   k_i = m w_i^2
    m y'' + d_y y' + k_y y + k_xy x + d_xy x' + 2 m_c Omega x' = F_y        d_xy = dxy_ratio d_x

    states  x (m), x'/W (m), y (m), y'/W (m)     W = 2 pi 11000 rad/s, fixed, so that a rotation stays nearly orthogonal
    z' = (base + Omega omega + kappa stiffness) z + force (F_x, F_y)        Omega in rad/s, kappa = total k_xy in N/m

Left out   centrifugal and Euler forces, (Omega/w)^2 = 1.6e-8 at 500 deg/s; Duffing (an effect)
Numbers    entries in 240-bit arithmetic; nothing is rounded here
Frequency  fx_hz and fy_hz are undamped; the damped ones are 3e-12 lower
Accuracy   after 1e5 periods at 100 deg/s (asserted): phase within 1e-9 rad, amplitude within 1e-9
Source     docs/plant.md
"""

from typing import NamedTuple

from analog_frontend.numeric.exact import MP

STATES = 4
X, VX, Y, VY = range(STATES)
FX, FY = range(2)
SCALE_HZ = 11000
W = 2 * MP.pi * SCALE_HZ
W_RAD_PER_S = float(W)


class Block(NamedTuple):
    """Non-zero entries as {(row, column): value}; columns of `force` are the two forces (N)."""

    base: dict
    omega: dict
    stiffness: dict
    force: dict


def resonator_matrices(device):
    """The generator's resonator block for a device already at its temperature."""
    m = MP.mpf(device.mass_kg)
    wx = 2 * MP.pi * MP.mpf(device.fx_hz)
    wy = 2 * MP.pi * MP.mpf(device.fy_hz)
    damping_x = wx / MP.mpf(device.qx)
    damping_y = wy / MP.mpf(device.qy)
    damping_xy = MP.mpf(device.dxy_ratio) * damping_x
    gyration = 2 * MP.mpf(device.coriolis_mass_kg) / m
    per_force = 1 / (m * W)
    return Block(
        base={
            (X, VX): W,
            (VX, X): -wx * wx / W,
            (VX, VX): -damping_x,
            (VX, VY): -damping_xy,
            (Y, VY): W,
            (VY, VX): -damping_xy,
            (VY, Y): -wy * wy / W,
            (VY, VY): -damping_y,
        },
        omega={(VX, VY): gyration, (VY, VX): -gyration},
        stiffness={(VX, Y): -per_force, (VY, X): -per_force},
        force={(VX, FX): per_force, (VY, FY): per_force},
    )
