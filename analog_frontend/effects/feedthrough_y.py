"""Electrical feedthrough of the drive voltage into the sense C/V output, held over the tick.

    n_y += c ((1 - e) v_start + e v_end),   v = z[2], the drive electrode's voltage, e its `dac.end_share`
    off: c = 0, bit for bit nothing

c = 1e-4 at 0.1 V: (4/pi) c A_d = 12.7 uV in open loop, 0.22 deg/s. It vanishes at once when the drive stops, where the
motion rings down.
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
    fingerprint="bias is proportional to the drive word, hence to 1/Q; in phase with the drive, independent of rate",
)


class Params(NamedTuple):
    """Switch, and the coefficient (V/V) of each end of the tick."""

    on: int = 0
    start_v_per_v: float = 0.0
    end_v_per_v: float = 0.0


OFF = Params()


def design(coefficient_v_per_v, end=0.5):
    """Volts at the sense SID input per volt at the drive electrode, and the share of a tick's end in its mean."""
    if not abs(coefficient_v_per_v) <= 1.0:
        raise ValueError(f"feedthrough_y coefficient_v_per_v: {coefficient_v_per_v} is outside -1 .. 1 V/V")
    return Params(1, (1.0 - end) * coefficient_v_per_v, end * coefficient_v_per_v) if coefficient_v_per_v else OFF


@inlined
def volts(p, v_start, v_end):
    """Mean of the leaked voltage over the tick (V)."""
    return p.start_v_per_v * v_start + p.end_v_per_v * v_end
