"""What the tick adds to the lag of a pickoff, against the tick itself: matrices of a step, solved at z = e^(i w h)."""

import cmath
import math

import numpy as np
import pytest
from scipy.linalg import expm

from analog_frontend.parts import pickoff

H, HZ, OTHER_HZ = 1e-6, 11002.3, 10863.3
POLES_S, CHAIN_S = (290e-9, 77e-9, 31e-9), (68e-9, 16e-9, 40e-9)
W, SPLIT = 2 * math.pi * HZ, 2 * math.pi * OTHER_HZ


def ladder(poles_s, source, size, at):
    """Rows of a chain of poles within a generator of `size` states, fed by the state `source`."""
    a = np.zeros((size, size))
    for n, tau in enumerate(poles_s):
        a[at + n, at + n] = -1 / tau
        a[at + n, source if n == 0 else at + n - 1] = 1 / tau
    return a


def tick_of_mode(instant_s):
    """(M, N, J) of (x, x'/w, three poles) after a tick: states, held input, step of the input at the instant."""
    a = ladder(CHAIN_S, 5, 6, 2)
    a[0, 1], a[1, 0], a[1, 4] = W, -(SPLIT**2) / W, 1 / W
    whole, rest = expm(a * H), expm(a * (H - instant_s))
    return whole[:5, :5], whole[:5, 5], rest[:5, 5]


def lag_beyond_deg(force, instant_s=0.0):
    """Lag of the C/V output behind the samples of x, less that of its poles, by matrices; and force over x."""
    z = cmath.exp(1j * W * H)
    chain = ladder(POLES_S, 3, 7, 0)
    chain[3, 4] = chain[4, 5] = chain[5, 6] = 1 / H
    step = expm(chain * H)
    hermite = np.array([[1, 0, -6, 12], [0, 1, -4, 6], [0, 0, 6, -12], [0, 0, -2, 6]], float)
    if force:
        states, held, rise = tick_of_mode(instant_s)
        # the step of this tick goes from the last input, u/z, to u = 1
        x = np.linalg.solve(z * np.eye(5) - states, held / z + rise * (1 - 1 / z))
        fundamental = (1 - 1 / z) / (1j * W * H) * cmath.exp(-1j * W * instant_s)
        for tau in CHAIN_S:
            fundamental /= 1 + 1j * W * tau
        place, slope, per_m = x[0], x[1] * W * H, fundamental / x[0]
    else:
        place, slope, per_m = 1.0, 1j * W * H, 0.0
    driven = hermite.T @ np.array([place, slope, z * place, z * slope])
    output = np.linalg.solve(z * np.eye(3) - step[:3, :3], step[:3, 3:] @ driven)[2]
    exact = np.prod([1 / (1 + 1j * W * tau) for tau in POLES_S])
    return -math.degrees(cmath.phase(output / place / exact)), per_m


def test_the_cubic_alone():
    want, _ = lag_beyond_deg(force=False)
    assert pickoff.lag_deg(POLES_S, HZ, H) == pytest.approx(want, rel=1e-3)
    assert 1e-8 < abs(want) < 1e-7


@pytest.mark.parametrize("instant_s", [0.0, 0.168e-6, 0.5e-6, 0.73e-6])
def test_the_staircase_of_the_force(instant_s):
    want, per_m = lag_beyond_deg(True, instant_s)
    found = pickoff.lag_deg(POLES_S, HZ, H, pickoff.Force(per_m, CHAIN_S, instant_s))
    assert found == pytest.approx(want, rel=0.01)
    assert abs(want - lag_beyond_deg(False)[0]) > 1e-9
