"""Cubic term of the drive pick-off at the C/V output: V -> V + e V^3.

It acts behind the C/V poles. Scale factor and drive word fall together, with the square of the amplitude; a third of
the third harmonic reaches the demodulators.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="pickoff_cubic_x",
    port="cv_x",
    mechanism="polynomial",
    unit="1/V^2",
    source="gap change of the pick-off and diode law to third order; value assumed",
    fingerprint=(
        "true amplitude falls by (3/4) e V^2 at the same AGC reading, and the third harmonic reaches the "
        "demodulators with a third of its size"
    ),
)
IDS, LIMIT, EXAMPLE, SIGN = "E03", 0.01, 1e-05, 0
DOC = "cubic term of the drive C/V output: V -> V + e V^3"


def terms(value, device):
    return (f"cv_x = {value!r} cx^3",)
