"""Dielectric absorption of the demodulators' capacitors: a share k of each is behind a resistor, time constant TAU_S.

    a stage fed through R half of the time:  v - w = 2 R C k (w - s)/tau,  s the slow part:  w = v (1 - b e^(-t/tau))
    three stages:  V -> V (1 - a e^(-t/tau)),  a = 3 k 2 R C / tau

A later step of the set-point begins no new tail. Typical k, from memory: polypropylene 0.0002, polyester 0.002 to
0.005, X7R 0.02. A circuit of six capacitors with slow branches has the same law within 3 % (asserted).
"""

from analog_frontend.effects.ports import Info

TAU_S = 10.0  # A
STAGES, DUTY = 3, 0.5

INFO = Info(
    name="sid_absorption",
    port="cv_x",
    mechanism="drift",
    unit="1",
    source="derived; share and time constant of film capacitors assumed",
    fingerprint="drive amplitude falls by a with time constant tau after power-on, and the scale factor with it",
)
IDS, LIMIT, EXAMPLE, SIGN = "E16", 0.1, 0.01, 1
DOC = "slow share of the demodulators' capacitors: a tail of ten seconds after power-on"
PHYSICS = (0.0, 1.0, "it is a share of the capacitance")


def tail(share, rc_s):
    """What the output lacks at first, as a share of it."""
    return STAGES * share * rc_s / DUTY / TAU_S


def terms(value, device):
    """Laws of a share of the capacitance."""
    a = tail(value, device.sid_r_ohm * device.sid_c_f)
    return tuple(text for c in "xy" for text in (f"cv_{c} = {-a!r} c{c}", f"cv_{c} = {a!r} lag({TAU_S!r}) c{c}"))
