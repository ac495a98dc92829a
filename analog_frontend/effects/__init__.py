"""All effects of a plant in one record, and the two kernels by which an engine applies them.

    force_impulse   before the linear step of each tick: impulse on the velocity of x
    cv_volts        after it: voltages at the SID inputs for that tick

Order     as in `EFFECTS`; impulses of one port add, so the order only matters to the last bit
Splitting impulse, step, impulse, step: the Strang step of the same pair seen half a tick later; error O(h^2), on
          Duffing's 10 Hz at 5 um 5e-6 Hz
Off       every flag is 0 and the kernels touch nothing: bit for bit the plant without effects, one branch per tick
Source    docs/effects.md
"""

from typing import NamedTuple

from analog_frontend.effects import drive_cubic, duffing, feedthrough_y
from analog_frontend.effects.ports import CV_PORTS, FORCE_PORTS
from fpga_model.jit import inlined

EFFECTS = (duffing, drive_cubic, feedthrough_y)
# a field called like its module would hide it inside the class body
_DUFFING_OFF, _DRIVE_CUBIC_OFF, _FEEDTHROUGH_Y_OFF = (e.OFF for e in EFFECTS)


class Params(NamedTuple):
    """Flags of the two stages, then one record per effect in the order of EFFECTS."""

    any_force: int = 0
    any_cv: int = 0
    duffing: tuple = _DUFFING_OFF
    drive_cubic: tuple = _DRIVE_CUBIC_OFF
    feedthrough_y: tuple = _FEEDTHROUGH_Y_OFF


OFF = Params()


def collect(**effects):
    """Params of the named effects; the others are off. The flags of the stages are set here and nowhere else."""
    extra = set(effects) - {e.INFO.name for e in EFFECTS}
    if extra:
        raise ValueError(f"effects: {', '.join(sorted(extra))} not among {', '.join(e.INFO.name for e in EFFECTS)}")
    p = Params(**effects)
    on = [e.INFO.port for e in EFFECTS if getattr(p, e.INFO.name).on]
    return p._replace(
        any_force=1 if any(port in FORCE_PORTS for port in on) else 0,
        any_cv=1 if any(port in CV_PORTS for port in on) else 0,
    )


@inlined
def force_impulse(p, x, drive_v):
    """Sum of the impulses of all force effects on vx/W (m) at a tick, from x (m) and the drive electrode (V)."""
    impulse = 0.0
    if p.duffing.on:
        impulse = impulse + duffing.kick(p.duffing, x)
    if p.drive_cubic.on:
        impulse = impulse + drive_cubic.kick(p.drive_cubic, drive_v)
    return impulse


@inlined
def cv_volts(p, x_volts, y_volts, drive_start_v, drive_end_v):
    """The voltages at the two SID inputs for this tick, with what the effects add to the given ones.

    drive_start_v, drive_end_v  drive electrode voltage z[2] at both ends of the tick
    """
    if p.any_cv and p.feedthrough_y.on:
        y_volts = y_volts + feedthrough_y.volts(p.feedthrough_y, drive_start_v, drive_end_v)
    return x_volts, y_volts
