"""Coupling stiffness that creeps after power-on: F_y = -k (1 - e^(-t/tau)) x, F_x likewise from y; tau =
plant.warm_up_tau_s.

V_q follows while it is within its rail; the bias follows only through ye2' - xe2'.
"""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="coupling_warm_up",
    port="force_y",
    mechanism="drift",
    unit="N/m",
    source="stress of the die attach, charging of glass; value assumed",
    fingerprint="quadrature voltage drifts by k/(2 kq V_q) with time, independent of rate",
)
IDS, LIMIT, EXAMPLE, SIGN = "E13", 0.1, 1e-05, 0
DOC = "coupling stiffness that grows over plant.warm_up_tau_s from power-on"


def terms(value, device):
    return (
        f"force_y = {-value!r} lag({device.warm_up_tau_s!r}) x",
        f"force_x = {-value!r} lag({device.warm_up_tau_s!r}) y",
    )
