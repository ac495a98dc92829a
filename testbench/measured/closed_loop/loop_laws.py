"""Candidates of the closed loop: the catalogue's effects, and the grammar of ports beyond it.

    catalogue   every effect of analog_frontend/effects that moves 8 kHz streams and is no noise; scale: the size that
                its page shows
    parameter   effects that are parameters of a part; 0 or the default is off
    grammar     gain and phase of every path, each quadrature of a port times slow variables and their products,
                offsets, products of states; order <= 5; their scale is a thousandth of the drive force, a tenth of a
                degree per second on the sense axis, 1e-4 of the C/V amplitude; no more than physics allows
    limits      of sign and size: loop_limits.py; a law with a limit of 0 has a sign
    same        x = A cos wt, vx = -w A sin wt:  x^a vx^b has the first harmonic of x^(a+b) (b even) or x^(a+b-1) vx
                (b odd), up to powers of w, which is constant. Only that moves the loop; slow factors (rate, temp) stay.
                So no amplitude, rate or temperature tells x^2 vx from vx^3: one law in other parameters

Source    docs/effects.md
"""

import math
from typing import NamedTuple

from analog_frontend.effects import catalogue, law
from testbench.config.config_errors import number_limits
from testbench.config.load import Effects
from testbench.measured.closed_loop import loop_limits
from testbench.tracing.problem.problem import Law

# need hours (the warm-up's bias is that of `damping_coupling` in a dwell of seconds), a line's phase, another attitude
HIDDEN_EFFECTS = ("coupling_warm_up", "pickoff_warm_up", "thermoelastic_bias", "softening_sense", "carrier_ripple")
HIDDEN_EFFECTS += ("acceleration",)
DUFFING_UM2, CUBIC_V2, LEAK = 1e-7, 1e-2, 1e-5
DRIVE_N, SENSE_N, CV_X_V, CV_Y_V = 2.8e-11, 2.8e-10, 2.9e-4, 5.8e-6
PORT_SIZE = dict(zip(law.PORTS, (DRIVE_N, SENSE_N, CV_X_V, CV_Y_V)))

MODES = {"x": "x", "vx": "x", "y": "y", "vy": "y"}
STAY = ("rate", "temp")


def harmonic(one):
    """Text that all laws with the first harmonic of a `law.Law` share; "" if it is no plain product of one mode."""
    fast = [f for f in one.factors if f.name not in STAY]
    modes = {MODES.get(f.name) for f in fast}
    if len(modes) != 1 or None in modes or any(f.dress for f in one.factors):
        return ""
    power = {f.name: f.power for f in fast}
    a, b = (sum(p for n, p in power.items() if (n[0] == "v") == speed) for speed in (False, True))
    if (a + b) % 2 == 0:
        return ""
    slow = " ".join(sorted(str(f) for f in one.factors if f.name in STAY))
    (mode,) = modes
    return f"{one.port}: {slow} {mode}^{a + b} {'odd' if b % 2 else 'even'} in time"


class Candidate(NamedTuple):
    """A law of the core, and how a model is told of it: a key of the configuration, or the text of its factors."""

    law: Law
    key: str = ""
    port: str = ""
    factors: str = ""
    terms: object = None  # of a key: function(value, device) -> texts of the laws that it stands for

    def law_texts(self, value):
        """Laws to add to a model's own."""
        return (f"{self.port} = {value!r} {self.factors}",) if self.factors else ()

    def unit_laws(self, device):
        """`law.Law`s of a coefficient of 1 in a device; () of a parameter of a part."""
        return tuple(map(law.parse, self.terms(1.0, device) if self.terms else self.law_texts(1.0)))

    def is_time_dependent(self, device):
        """True of a law that asks for the time from power-on."""
        return any(f.name in law.TIMES for one in self.unit_laws(device) for f in one.factors)


def _key(name, port, text, unit, scale, terms, limits=None, page=""):
    """Candidate of a key; a law whose limits have a side has that sign."""
    ones = tuple(map(law.parse, terms(1.0, loop_limits.BOARD)))
    low, high, reason = limits or loop_limits.coefficient_limits(ones[0])
    least, most = number_limits(Effects.model_fields[name])
    if least > low or most < high:
        low, high, reason = max(low, least), min(high, most), f"the range of effects.{name}"
    shape = harmonic(ones[0]) if len(ones) == 1 else ""
    module = f"analog_frontend/effects/{page or name}.py"
    key_law = Law(name, port, text, unit, scale, (low == 0.0) - (high == 0.0), page=module)
    return Candidate(key_law._replace(low=low, high=high, reason=reason, same=shape), f"effects.{name}", terms=terms)


def _cubic_spring(value, device):
    return (f"force_x = {-value * 1e12 * device.mass_kg * (2 * math.pi * device.fx_hz) ** 2!r} x^3",)


def _cubic_drive(value, device):
    return (f"force_x = {value * device.k_vf_drive_n_per_v!r} u^3",)


def _leak(value, device):
    return (f"cv_y = {value!r} u",)


def from_catalogue():
    """`Candidate`s of every effect that a closed-loop record of seconds can show."""
    out = [
        _key("duffing_k3_per_um2", "force_x", "-k3 x^3", "1/um^2", DUFFING_UM2, _cubic_spring, page="duffing"),
        _key("drive_cubic_per_v2", "force_x", "k_vf c u^3", "1/V^2", CUBIC_V2, _cubic_drive, page="drive_cubic"),
        _key("feedthrough_y", "cv_y", "c u", "V/V", LEAK, _leak),
    ]
    for effect in catalogue.LAWS:
        i = effect.INFO
        # noise has no shape to fit: another power-on has another; contrasts of repeats tell it (N01 to N04)
        if i.name not in HIDDEN_EFFECTS and i.mechanism != "noise":
            limits = getattr(effect, "PHYSICS", None)
            out.append(_key(i.name, i.port, effect.DOC, i.unit, abs(effect.EXAMPLE), effect.terms, limits))
    return tuple(out)


# slow variables by which every port's own two quadratures are multiplied; amplitude: even powers, or the absolute value
SLOW = ("rate", "rate^2", "temp", "temp^2", "rate temp", "lag(3)")
QUADRATURES = {"force_x": ("x", "vx"), "force_y": ("x", "vx"), "cv_x": ("cx", "u"), "cv_y": ("cx", "u")}
# gain of each path, offset of each demodulator, amplitude, other states, and products of these
GRAMMAR = {
    "force_x": (
        "u", "x^2", "x^5", "abs(x) x", "x vx", "x^4 vx", "x vx^2", "vx^3", "sgn(x)", "u^2", "u x", "u x^2", "u vx^2",
        "abs(u) u", "rate u", "temp u", "rate x^3", "temp x^3", "rate x^2 vx", "temp x^2 vx", "w", "w x", "y", "vy",
    ),
    "force_y": (
        "x^2", "x", "abs(x) x", "abs(vx) vx", "x^5", "x^4 vx", "x vx^2", "vx^3", "sgn(vx)", "sgn(x)", "u", "u^3",
        "u x^2", "rate u", "temp u", "rate x^3", "temp x^3", "rate x^2 vx", "temp x^2 vx", "y", "vy", "y^3", "w^2 x",
        "abs(w) w", "w", "x^2 w", "temp w",
    ),
    "cv_x": ("cx", "cx^5", "abs(cx) cx", "sgn(cx)", "sgn(u)", "u^3", "abs(u) u", "w", "cy"),
    "cv_y": ("cx", "cx^3", "abs(cx) cx", "sgn(cx)", "sgn(u)", "w^3", "abs(w) w", "temp w", "u^3", "abs(u) u", "cy"),
}  # fmt: skip
# phases of the paths, and the gain of V_q, are fields of parts: port, unit, scale
PARTS = {
    "drive_dac_delay_s": ("force_x", "s", 1e-9),
    "sense_dac_delay_s": ("force_y", "s", 1e-9),
    "kq_n_per_m_per_v2": ("force_y", "N/m/V^2", 1e-7),
    "opamp_gbw_hz": ("cv_x", "Hz", 1e4),
    "sid_switch_s": ("cv_y", "s", 1e-9),
}


def _factors(port):
    """Factors of the laws of a port."""
    slow = [f"{s} {q}" for q in QUADRATURES[port] for s in SLOW]
    return (*GRAMMAR[port], *(f for f in slow if f not in GRAMMAR[port]))


def from_grammar():
    """`Candidate`s beyond the catalogue."""
    out = []
    for port in GRAMMAR:
        for factors in _factors(port):
            one = law.parse(f"{port} = 1.0 {factors}")
            low, high, reason = loop_limits.coefficient_limits(one)
            name = f"{port}: {factors}"
            terms = tuple((str(f._replace(power=1)), float(f.power)) for f in one.factors)
            scale = min(PORT_SIZE[port] / loop_limits.typical_product(one.factors), max(-low, high))
            candidate_law = Law(
                name, port, f"c {factors}", one.unit, scale, (low == 0.0) - (high == 0.0), term=terms,
                page="docs/effects.md", low=low, high=high, reason=reason, same=harmonic(one),
            )  # fmt: skip
            out.append(Candidate(candidate_law, "", port, factors))
    for field, (port, unit, scale) in PARTS.items():
        low, high, reason = loop_limits.field_change_limits(field)
        sign, page = (low == 0.0) - (high == 0.0), "docs/effects.md"
        candidate_law = Law(f"plant.{field}", port, f"plant.{field} + c", unit, scale, sign, page=page)
        out.append(Candidate(candidate_law._replace(low=low, high=high, reason=reason), f"plant.{field}"))
    return tuple(out)
