"""Gain of both C/V outputs that creeps after power-on: V -> V (1 + a (1 - e^(-t/tau))), tau = plant.warm_up_tau_s."""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="pickoff_warm_up",
    port="cv_x",
    mechanism="drift",
    unit="1",
    source="warm-up of the carrier's oscillator and its supply; value assumed",
    fingerprint="drive amplitude word drifts by -a with time, at constant temperature of the package",
)
IDS, LIMIT, EXAMPLE, SIGN = "E21b", 0.1, 0.0001, 0
DOC = "gain of both C/V outputs that drifts over plant.warm_up_tau_s from power-on"


def terms(value, device):
    return (
        f"cv_x = {value!r} lag({device.warm_up_tau_s!r}) cx",
        f"cv_y = {value!r} lag({device.warm_up_tau_s!r}) cy",
    )
