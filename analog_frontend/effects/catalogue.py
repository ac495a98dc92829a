"""The catalogue's laws: each a file that says what it is and gives the laws of a size. Off is a size of 0.

The three effects with kernels of their own (duffing, drive_cubic, feedthrough_y) stand in effects.EFFECTS.
Source    docs/effects/README.md
"""

from analog_frontend.effects import (
    acceleration,
    bias_cubic,
    burst_noise,
    carrier_beat,
    carrier_ripple,
    centrifugal,
    coulomb_friction,
    coupling_warm_up,
    damping_coupling,
    damping_cubic,
    damping_quadratic,
    dispersive,
    feedthrough_x,
    frequency_walk,
    law,
    parasitic_mode,
    pickoff_cubic_x,
    pickoff_drift,
    pickoff_warm_up,
    quadrature_cubic,
    sense_cubic,
    sid_absorption,
    softening_drive,
    softening_sense,
    thermoelastic_bias,
)

LAWS = (
    damping_cubic,
    damping_quadratic,
    coulomb_friction,
    pickoff_cubic_x,
    feedthrough_x,
    damping_coupling,
    coupling_warm_up,
    softening_drive,
    softening_sense,
    sense_cubic,
    centrifugal,
    dispersive,
    quadrature_cubic,
    bias_cubic,
    pickoff_drift,
    pickoff_warm_up,
    carrier_ripple,
    carrier_beat,
    thermoelastic_bias,
    frequency_walk,
    burst_noise,
    sid_absorption,
    parasitic_mode,
    acceleration,
)


def laws(effect, value, device):
    """`law.Law`s of a module of LAWS at a size, for a plant; none for 0."""
    return [law.parse(text) for text in effect.terms(float(value), device)] if value else []
