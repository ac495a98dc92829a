"""Duffing spring of the drive mode: F = -k3 x^3, as a velocity impulse once per tick.

    z[7] += -k3 x^3 h/(m W),   x = z[6] at the tick;   off: k3 = 0, bit for bit nothing

k3/k = 1e-4 um^-2 at 5 um: +10.3 Hz, within 5e-6 Hz of the exact period. During the ring-up the frequency moves faster
than a loop of 2 to 3 Hz follows. k3 < 0: softening by combs. No real suspension validates sign or size.
"""

from typing import NamedTuple

from analog_frontend.effects.ports import Info
from fpga_model.jit import inlined

INFO = Info(
    name="duffing",
    port="force_x",
    mechanism="polynomial",
    unit="N/m^3",
    source="beam stretching; k3/k = 1e-5 .. 1e-3 per square micrometre, assumed",
    fingerprint="drive frequency rises with amplitude squared: (3/8)(k3/k) A^2",
)


class Params(NamedTuple):
    """Switch, and h k3/(m W) in 1/m^2: the change of vx/W (m) per cubic metre of x."""

    on: int = 0
    kick_per_m2: float = 0.0


OFF = Params()


def design(k3_n_per_m3, mass_kg, h_s, w_rad_per_s):
    """Cubic stiffness k3 (N/m^3) of a mode of `mass_kg`, ticks of `h_s`, state scale `w_rad_per_s`."""
    if not (mass_kg > 0.0 and h_s > 0.0 and w_rad_per_s > 0.0):
        raise ValueError(f"duffing: mass {mass_kg} kg, tick {h_s} s, scale {w_rad_per_s} rad/s must be positive")
    if not abs(k3_n_per_m3) <= 1e15:
        raise ValueError(f"duffing k3_n_per_m3: {k3_n_per_m3} is outside -1e15 .. 1e15 N/m^3")
    return Params(1, k3_n_per_m3 * h_s / (mass_kg * w_rad_per_s)) if k3_n_per_m3 else OFF


def k3_from_ratio(k3_ratio_per_um2, k_n_per_m):
    """k3 (N/m^3) from k3/k in 1/um^2, as papers give it."""
    return k3_ratio_per_um2 * 1e12 * k_n_per_m


@inlined
def kick(p, x):
    """Change of vx/W (m) in one tick."""
    return -(p.kick_per_m2 * (x * x * x))
