"""What physics allows of a law at a port: sign and size of its coefficient, and why.

    own axis, odd in time       a force of the mode's own motion takes energy; what modulates it: |F| <= d v
    own axis, even in time      the stiffness stays positive: |F| <= k x
    other axis                  the matrices of stiffness and damping stay positive: |F| <= k x,  |F| <= 2 d v
    rate v on the other axis    Coriolis force of a mass that is no larger than the mode's: |c| <= 2 m
    electrodes                  the force keeps the sign of its voltage: |F| <= k_vf V
    C/V outputs                 a gain stays positive: |V| <= the signal;  a leak stays within the amplifiers' swing

F, V: a law at the default gyroscope's typical states. Effects with a limit of their own state it as `PHYSICS`.
Source    Landau & Lifshitz, Mechanics, 25 (positive dissipation); docs/tracing.md
"""

import math

from analog_frontend.effects import law
from analog_frontend.parts.device import FIELDS, Device

# typical states of the default gyroscope at lock
TYPICAL = {"x": 5e-6, "vx": 0.3456, "y": 1e-10, "vy": 7e-6, "u": 0.1, "w": 0.5, "cx": 2.88, "cy": 1e-4}
TYPICAL |= {"rate": 1.0, "temp": 25.0}
BOARD = Device()
W_RAD_S = 2 * math.pi * BOARD.fx_hz
STIFF_N_PER_M = BOARD.mass_kg * W_RAD_S**2
DAMP_N_S_PER_M = BOARD.mass_kg * W_RAD_S / BOARD.qx
AXES = {"x": ("x", "vx"), "y": ("y", "vy")}


def typical_product(factors):
    """Product of `law.Factor`s at typical states."""
    powers = (1.0 if f.dress == law.SGN else TYPICAL[f.name] ** f.power for f in factors if f.name in TYPICAL)
    return math.prod(powers)


def _bound(one):
    """(largest force or voltage at typical states, largest to the driving side or None, reason)."""
    names = {f.name for f in one.factors} - set(law.TIMES)
    axis, around = one.port[-1], names & {"rate", "temp"}
    if one.port in law.CV_PORTS:
        if names - around == {"c" + axis}:
            return TYPICAL["c" + axis], "the gain must stay positive"
        return BOARD.amplifier_swing_v, "the swing of the amplifiers"
    if names & {"u", "w"}:
        return BOARD.k_vf_sense_n_per_v * TYPICAL[
            "w" if "w" in names else "u"
        ], "the force of the electrode must keep its sign"
    is_port_axis = names <= {*AXES[axis], "rate", "temp"}
    typical_displacement, speed = (TYPICAL[name] for name in AXES[axis if is_port_axis else "yx"["xy".index(axis)]])
    odd = sum(f.power for f in one.factors if f.name in ("vx", "vy") and f.dress != law.ABS) % 2
    if not odd:
        return STIFF_N_PER_M * typical_displacement, "the stiffness must stay positive"
    if not is_port_axis and names - around == {"vx"} and "rate" in names:
        return 2 * BOARD.mass_kg * speed, "the Coriolis mass cannot exceed the mass of the mode"
    return (1 if is_port_axis else 2) * DAMP_N_S_PER_M * speed, "the damping must stay positive"


def coefficient_limits(one):
    """(low, high, reason) of the coefficient of a `law.Law`; what it has is a factor of that coefficient."""
    largest, reason = _bound(one)
    high = largest / (abs(one.coefficient) * typical_product(one.factors))
    limits = -high, high
    if _takes_energy(one):
        limits, reason = (-high, 0.0), "a passive part cannot supply energy to its mode"
    low, high = sorted(limit * math.copysign(1.0, one.coefficient) + 0.0 for limit in limits)
    return low, high, reason


def field_change_limits(field):
    """(low, high, reason) of the change of a field of the default `Device`."""
    value, limits = getattr(BOARD, field), next(f for f in FIELDS if f.name == field)
    return limits.lo - value, limits.hi - value, f"the range of plant.{field}"


def _takes_energy(one):
    """True of a force on the drive mode whose work over a cycle of its own motion has one sign, and is not linear."""
    if one.port != "force_x" or not {f.name for f in one.factors} <= set(AXES["x"]):
        return False
    turns = {name: sum(f.power for f in one.factors if f.name == name and f.dress != law.ABS) % 2 for name in AXES["x"]}
    linear = len(one.factors) == 1 and one.factors[0].power == 1 and one.factors[0].dress == law.PLAIN
    return bool(turns["vx"]) and not turns["x"] and not linear
