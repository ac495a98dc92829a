"""Electrical feedthrough of the drive voltage into the sense C/V output, held over the tick.

    n_y += c (v_start + v_end)/2,   v = z[2], the drive electrode's voltage;   off: c = 0, bit for bit nothing
    fingerprint: (4/pi) c A_d at the sense SID, in phase with the drive voltage; bias goes with the drive word

Port cv_y   Mechanism leak from force_x   Unit V/V
Source: common-mode current through the amplifier's rejection; docs/effects/feedthrough_y.md
"""

from typing import NamedTuple

from analog_frontend.effects.ports import Info
from fpga_model.jit import inlined

INFO = Info(
    name="feedthrough_y",
    port="cv_y",
    mechanism="leak from force_x",
    unit="V/V",
    source="stray capacitance times the amplifier's finite common-mode rejection; value assumed",
    fingerprint="bias goes with the drive amplitude word, so with 1/Q; in phase with the drive, independent of rate",
)


class Params(NamedTuple):
    """Switch, and half the coefficient (V/V): each end of the tick counts half."""

    on: int = 0
    half_v_per_v: float = 0.0


OFF = Params()


def design(coefficient_v_per_v):
    """Volts at the sense SID input per volt at the drive electrode."""
    if not abs(coefficient_v_per_v) <= 1.0:
        raise ValueError(f"feedthrough_y coefficient_v_per_v: {coefficient_v_per_v} is outside -1 .. 1 V/V")
    return Params(1, 0.5 * coefficient_v_per_v) if coefficient_v_per_v else OFF


@inlined
def volts(p, v_start, v_end):
    """Mean of the leaked voltage over the tick (V)."""
    return p.half_v_per_v * (v_start + v_end)
