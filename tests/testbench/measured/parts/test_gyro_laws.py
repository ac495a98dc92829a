"""Laws carried over to the gyroscope keep their strength relative to what they add to."""

import numpy as np
import pytest

from analog_frontend.effects import law
from analog_frontend.parts.device import Device
from testbench.measured.models import gyro_laws
from testbench.measured.models.working import Working

D = Device()
W = 2 * np.pi * D.fx_hz
K = D.mass_kg * W * W
A = gyro_laws.AMPLITUDE_M


def effect(name, value, kind="plant"):
    return {"law": name, "port": "force_x", "value": value, "kind": kind}


def force(text, x, v):
    """Force (N) of a law by hand."""
    item = law.parse(text)
    out = item.coefficient
    for f in item.factors:
        s = {"x": x, "vx": v}[f.name]
        s = abs(s) if f.dress == law.ABS else np.sign(s) if f.dress == law.SGN else s
        out *= s**f.power
    return out


def test_springs_and_dampings_of_a_driven_part():
    working = Working("driven", 0.2, 68.0, 10.0)
    spring, damping = gyro_laws.laws_of_loop([effect("duffing", 3.8), effect("damping_quadratic", 0.018)], working, D)
    assert force(spring.text, A, 0.0) == pytest.approx(-3.8 * 0.2**2 * K * A)
    linear = K * A / D.qx  # damping force at speed w A
    assert force(damping.text, 0.0, W * A) == pytest.approx(-0.018 * 0.2 * 10.0 * linear)
    assert spring.share == pytest.approx(3.8 * 0.04)


def test_ring_down_keeps_the_ratio_of_rates():
    f, q = 1.45e6, 1.2e8
    g = 2 * np.pi * f / q
    (one,) = gyro_laws.laws_of_loop([effect("damping_cubic", 0.06)], Working("ringdown", 2.0, f, q), D)
    assert one.share == pytest.approx(0.06 * 4.0 / g)
    t = np.linspace(0, 2 * np.pi, 4001)[:-1]
    power = np.mean([force(one.text, A * np.cos(p), -W * A * np.sin(p)) * (-W * A * np.sin(p)) for p in t])
    energy = K * A * A / 2
    assert -power / energy == pytest.approx(one.share * W / D.qx, rel=1e-6)


def test_a_sweep_keeps_the_relative_shift_of_frequency():
    (one,) = gyro_laws.laws_of_loop([effect("duffing", 13.0)], Working("swept", 0.27, 1e7, 1e6), D)
    k3 = -force(one.text, 1.0, 0.0)
    assert 3 / 8 * k3 / K * A**2 == pytest.approx(13.0 * 0.27**2 / 1e7)


def test_instruments_are_no_law_of_the_plant():
    assert gyro_laws.laws_of_loop([effect("sweep_rate", 1e3, "instrument")], Working("swept", 1.0, 1e7, 1e6), D) == []
