"""Gain of both C/V outputs that follows temperature: V -> V (1 + a (T - T_ref)).

To first order the law of plant.diode_tc_on, beside which it acts.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="pickoff_drift",
    port="cv_x",
    mechanism="drift",
    unit="1/K",
    source="carrier amplitude, diode threshold, stray capacitance; value assumed",
    fingerprint="true amplitude and drive word fall by a dT, and the scale factor with them",
)
IDS, LIMIT, EXAMPLE, SIGN = "E21a", 0.01, 0.0001, 0
DOC = "gain of both C/V outputs that follows temperature, in addition to the diode law"


def terms(value, device):
    return (f"cv_x = {value!r} temp cx", f"cv_y = {value!r} temp cy")
