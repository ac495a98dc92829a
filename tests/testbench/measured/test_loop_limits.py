"""Limits of physics of the candidate laws, against work and forces that are computed here from their texts."""

import math
import re

import numpy as np
import pytest

from analog_frontend.effects import law
from testbench.measured.closed_loop import loop_laws, loop_limits
from testbench.tracing.problem.problem import Law

TURNS = (np.arange(4096) + 0.5) / 4096 * 2 * math.pi
ALL = {c.law.name: c for c in (*loop_laws.from_catalogue(), *loop_laws.from_grammar())}
# F of a coefficient of 1 for the keys whose law is a force on the drive mode by its own motion
KEYS = {"damping_cubic": "x^2 vx", "damping_quadratic": "abs(vx) vx", "coulomb_friction": "sgn(vx)"}


def value(factors, states):
    """A law's factors, read anew."""
    out = 1.0
    for form, inside, name, power in re.findall(r"(?:(sgn|abs)\((\w+)\)|(\w+))(?:\^(\d))?", factors):
        v = states[inside or name]
        out = out * {"sgn": np.sign, "abs": np.abs, "": lambda x: x}[form](v) ** int(power or 1)
    return out


def motion(amplitude_m, w_rad_s=2 * math.pi * 11002.3):
    return {"x": -amplitude_m * np.cos(TURNS), "vx": amplitude_m * w_rad_s * np.sin(TURNS)}


def own_motion():
    for name, c in ALL.items():
        factors = KEYS.get(name, c.factors if c.port == "force_x" else "")
        if factors and set(re.findall(r"\b(x|vx|y|vy|u|w|rate|temp|lag)\b", factors)) <= {"x", "vx"}:
            yield name, factors, -1.0 if name in KEYS else 1.0


def test_a_force_that_works_over_a_cycle_takes_energy_within_its_limits():
    signs = []
    for name, factors, side in own_motion():
        law, states = ALL[name].law, motion(5e-6)
        power = side * value(factors, states) * states["vx"]
        work, whole = power.mean(), np.abs(power).mean()
        wanted = 0 if abs(work) < 1e-9 * whole else -int(np.sign(work))
        assert law.sign == wanted, name
        assert (law.high == 0.0, law.low == 0.0) == (wanted < 0, wanted > 0), name
        signs.append(wanted)
    assert {-1, 0, 1} == set(signs)


def test_stiffness_within_the_limits_stays_positive():
    """Of softening springs: at its limit a cubic spring has lost all of the force of k x at 5 um."""
    k_n_per_m = 2.325e-7 * (2 * math.pi * 11002.3) ** 2
    for name, factors in (("force_x: x^5", "x^5"), ("force_x: abs(x) x", "abs(x) x")):
        force = ALL[name].law.high * value(factors, {"x": 5e-6}) - k_n_per_m * 5e-6
        assert abs(force) < 1e-9 * k_n_per_m * 5e-6
    low, _, reason = loop_limits.coefficient_limits(law.parse(f"force_x = {k_n_per_m * 1e12!r} x^3"))
    assert (low, reason) == (pytest.approx(-1 / 5**2, rel=1e-9), "the stiffness must stay positive")


def test_a_law_keeps_to_the_range_of_its_key():
    own = ALL["duffing_k3_per_um2"].law
    assert (own.low, own.high, own.reason) == (-0.01, 0.01, "the range of effects.duffing_k3_per_um2")


def test_damping_of_both_modes_stays_positive():
    """The matrix [[d, c/2], [c/2, d]] of a coupling in one direction has no negative eigenvalue at the limit."""
    d = 2.325e-7 * 2 * math.pi * 11002.3 / 2e5
    at = np.linalg.eigvalsh([[d, ALL["damping_coupling"].law.high / 2], [ALL["damping_coupling"].law.high / 2, d]])
    assert at[0] == pytest.approx(0.0, abs=1e-12 * d)
    assert at[1] > 0


def test_sizes_that_physics_gives():
    assert (ALL["centrifugal"].law.low, ALL["centrifugal"].law.high, ALL["centrifugal"].law.sign) == (0.0, 1.0, 1)
    assert ALL["parasitic_mode"].law.sign == 1
    for name, c in ALL.items():
        assert c.law.reason, name
        assert c.law.low <= 0.0 <= c.law.high, name
        assert c.law.low < c.law.high, name
        assert c.law.scale <= max(-c.law.low, c.law.high), name


def test_what_breaks_a_limit_is_told_with_value_limit_unit_and_reason():
    law = Law("centrifugal", "force_x", "c m rate^2 x", "1", 1.0, low=0.0, high=1.0, reason="inertia")
    assert law.beyond(-13.0, 0.5) == "centrifugal: -13 is below the physical limit 0 1 (inertia)"
    assert law.beyond(3.0) == "centrifugal: 3 is above the physical limit 1 1 (inertia)"
    assert law.beyond(3.0, 1.5) == law.beyond(1.0) == law.beyond(-0.9, 0.5) == ""


def test_each_path_has_its_gain_phase_offset_and_slow_variables():
    """By catalogue or grammar; x and vx at force_x alone are the drive mode's frequency and quality factor."""
    there = {(one.port, *sorted(map(str, one.factors))) for c in ALL.values() for one in c.unit_laws(loop_limits.BOARD)}
    quadratures = {"force_x": ("x", "vx"), "force_y": ("x", "vx"), "cv_x": ("cx", "u"), "cv_y": ("cx", "u")}
    slow = (("rate",), ("rate^2",), ("temp",), ("temp^2",), ("rate", "temp"), ("lag(3)",))
    wanted = [(port, *sorted((*s, q))) for port, pair in quadratures.items() for q in pair for s in slow]
    wanted += [(port, q) for port, pair in quadratures.items() for q in pair if port != "force_x"]
    wanted += [(port, state) for port in quadratures for state in ("u", "w")]
    wanted += [(port, f"sgn({state})") for port in ("cv_x", "cv_y") for state in ("cx", "u")]
    assert [row for row in wanted if row not in there] == []
    phases = ("drive_dac_delay_s", "sense_dac_delay_s", "opamp_gbw_hz", "sid_switch_s")
    assert {f"plant.{field}" for field in phases} <= set(ALL)
