"""Cubic term of the drive electrode's voltage-to-force law: F = k_vf (v + c3 v^3), as a velocity impulse once per tick.

    z[7] += k_vf c3 v^3 h/(m W),   v = z[2] at the tick;   off: c3 = 0, bit for bit nothing

c3 = 0.5 /V^2 at 0.1 V: +0.375 % of force, -0.125 % of third harmonic. Largest at the kick, least at lock. Its phase is
up to half a tick early.
"""

from typing import NamedTuple

from analog_frontend.effects.ports import Info
from fpga_model.jit import inlined

INFO = Info(
    name="drive_cubic",
    port="force_x",
    mechanism="polynomial",
    unit="1/V^2",
    source="electrode pair beyond first order, amplifier compression; value assumed",
    fingerprint="force per volt changes by (3/4) c3 A_d^2: the AGC word is no longer proportional to 1/Q",
)


class Params(NamedTuple):
    """Switch, and k_vf c3 h/(m W) in m/V^3."""

    on: int = 0
    kick_m_per_v3: float = 0.0


OFF = Params()


def design(c3_per_v2, k_vf_n_per_v, mass_kg, h_s, w_rad_per_s):
    """Cubic coefficient c3 (1/V^2) of an electrode of `k_vf_n_per_v` on a mode of `mass_kg`."""
    if not (mass_kg > 0.0 and h_s > 0.0 and w_rad_per_s > 0.0):
        raise ValueError(f"drive_cubic: mass {mass_kg} kg, tick {h_s} s, scale {w_rad_per_s} rad/s must be positive")
    if not abs(c3_per_v2) <= 1.0:
        raise ValueError(f"drive_cubic c3_per_v2: {c3_per_v2} is outside -1 .. 1 per V^2")
    return Params(1, k_vf_n_per_v * c3_per_v2 * h_s / (mass_kg * w_rad_per_s)) if c3_per_v2 else OFF


@inlined
def kick(p, v):
    """Change of vx/W (m) in one tick."""
    return p.kick_m_per_v3 * (v * v * v)
