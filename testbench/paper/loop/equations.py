"""The paper's equations (1) to (14) as functions, and its misprints beside what is right.

      (1)    equation_of_motion    two modes, Coriolis, coupling
      (2-5)  drive_response, sense_response, phase_drive, phase_sense
      (6)    sense_force           forces on y, feedback force with phi_ye1
      (7)    baseband              y's component behind the multiplier, per newton of feedback
      (8-11) n1, n2, d1, d2        its polynomials
      (12)   scale_factor          for infinite loop gain
      (13)   open_loop_signal      y with both loops held: what phi_ye2 is read from
      (14)   phi_iq                its angle, from in-phase and quadrature amplitude

Phases    here as in the paper **leads**, in rad; the other pages of this project have lags
The formulas of the paper are pictures: form and sign here follow from its text and a derivation. `misprints` lists the
places where the two differ.
Source    doi:10.1038/s41378-025-01144-6
"""

import math
from typing import NamedTuple

import numpy as np


class Mode(NamedTuple):
    """A mode: mass (kg), angular frequency (rad/s), quality factor."""

    m: float
    w: float
    q: float


class Coupling(NamedTuple):
    """What turns x into a force on y: Coriolis mass (kg), rate (rad/s), stiffness (N/m), damping (N s/m)."""

    m_c: float
    omega_z: float = 0.0
    k_xy: float = 0.0
    d_xy: float = 0.0


def equation_of_motion(position, velocity, force, x: Mode, y: Mode, c: Coupling):
    """(1) accelerations (m/s^2) of the two modes; position, velocity, force are pairs (x, y) in m, m/s, N.

    m q'' + d q' + k q + [0 k_xy; k_xy 0] q + [0 d_xy; d_xy 0] q' + 2 m_c Omega [0 -1; 1 0] q' = F
    """
    q, v, f = np.asarray(position), np.asarray(velocity), np.asarray(force)
    swap = np.array([[0.0, 1.0], [1.0, 0.0]])
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    mass = np.array([x.m, y.m])
    mode_acceleration = np.array([x.w, y.w]) ** 2 * q + np.array([x.w / x.q, y.w / y.q]) * v
    return (f - c.k_xy * swap @ q - c.d_xy * swap @ v - 2 * c.m_c * c.omega_z * turn @ v) / mass - mode_acceleration


def _amplitude(force_n, mode: Mode, w_d):
    return force_n / (mode.m * math.hypot(mode.w**2 - w_d**2, mode.w * w_d / mode.q))


def _phase(mode: Mode, w_d):
    """Lead of the displacement over the force: between -pi and 0, unwrapped through resonance."""
    return -math.atan2(mode.w * w_d / mode.q, mode.w**2 - w_d**2)


def phase_drive(x: Mode, w_d):
    """(4) phase of x against its force; -pi/2 at lock."""
    return _phase(x, w_d)


def phase_sense(y: Mode, w_d):
    """(5) phase of y against its force; -pi where w_d is above w_y, the paper's 180 deg: f_x > f_y."""
    return _phase(y, w_d)


def drive_response(t, a_d_n, x: Mode, w_d):
    """(2) x(t) (m) under A_d sin(w_d t) (N)."""
    return _amplitude(a_d_n, x, w_d) * np.sin(w_d * t + phase_drive(x, w_d))


def sense_response(t, a_x, y: Mode, w_d, c: Coupling):
    """(3) y(t) (m), open loop, for x = -A_x cos(w_d t): Coriolis and quadrature force through the sense mode."""
    angle = w_d * t + phase_sense(y, w_d)
    coriolis = _amplitude(-2 * c.m_c * c.omega_z * a_x * w_d, y, w_d)
    return coriolis * np.sin(angle) + _amplitude(c.k_xy * a_x, y, w_d) * np.cos(angle)


def sense_force(t, v_c, phi_ye1, k_vf, a_x, w_d, c: Coupling):
    """(6) force on y (N): -2 m_c Omega A_x w sin + k_xy A_x cos + V_c k_vf sin(w t + phi_ye1)."""
    angle = w_d * t
    coupling_force = -2 * c.m_c * c.omega_z * a_x * w_d * np.sin(angle) + c.k_xy * a_x * np.cos(angle)
    return coupling_force + v_c * k_vf * np.sin(angle + phi_ye1)


def feedback_parts(v_c, phi_ye1, k_vf):
    """Below (6): (in phase with Coriolis, in phase with quadrature) amplitudes of the feedback force (N).

    sin(w t + phi) = cos(phi) sin(w t) + sin(phi) cos(w t): V_c k_vf sin(w t) **cos**(phi) cancels Coriolis, and
    V_c k_vf cos(w t) **sin**(phi) is what leaks into quadrature.
    """
    return v_c * k_vf * math.cos(phi_ye1), v_c * k_vf * math.sin(phi_ye1)


def feedback_parts_as_printed(v_c, phi_ye1, k_vf):
    """The sentence under (6) with sine and cosine of phi_ye1 the wrong way round."""
    return v_c * k_vf * math.sin(phi_ye1), v_c * k_vf * math.cos(phi_ye1)


def n1(s, y: Mode, w_d):
    """(8) 2 w_d s + w_d w_y / Q: right."""
    return 2 * w_d * s + w_d * y.w / y.q


def n2(s, y: Mode, w_d):
    """(9) s^2 + (w_y/Q) s + w_y^2 - w_d^2: right."""
    return s * s + y.w / y.q * s + y.w**2 - w_d**2


def _factor(s, y: Mode, w_d, root):
    return s * s + y.w / y.q * s + y.w**2 + w_d**2 - w_d * y.w * root


def root(q):
    """sqrt(4 - 1/Q^2), which (10) and (11) need: then D1 D2 = N1^2 + N2^2 identically."""
    return math.sqrt(4 - 1 / q**2)


def root_as_printed(q):
    """sqrt(1 - Q^2/4), imaginary for every resonator with Q > 2."""
    return complex(1 - q**2 / 4) ** 0.5


def d1(s, y: Mode, w_d):
    """(10) the slow pair: about s^2 + (w_y/Q) s + (w_d - w_y)^2, the split."""
    return _factor(s, y, w_d, root(y.q))


def d2(s, y: Mode, w_d):
    """(11) the fast pair, at w_d + w_y."""
    return _factor(s, y, w_d, -root(y.q))


def d1_as_printed(s, y: Mode, w_d):
    """(10) with the printed root."""
    return _factor(s, y, w_d, root_as_printed(y.q))


def d2_as_printed(s, y: Mode, w_d):
    """(11) with the printed root."""
    return _factor(s, y, w_d, -root_as_printed(y.q))


MULTIPLIER, HALF_BRIDGE, BRIDGE = 0.5, 2 / math.pi, 4 / math.pi


def baseband(s, phi, y: Mode, w_d, gain=MULTIPLIER):
    """(7) G(s) (m/N): y behind a demodulator at sin(w t + phi), for a force u sin(w t).

    gain  1/2 for a multiplier, 2/pi for one half of a switched demodulator, 4/pi for its difference
    G = gain (cos(phi) N2 - sin(phi) N1) / (m D1 D2);  with phi = phi_ye1 - phi_ye2 as far as G alone is concerned
    """
    return gain * (np.cos(phi) * n2(s, y, w_d) - np.sin(phi) * n1(s, y, w_d)) / (y.m * d1(s, y, w_d) * d2(s, y, w_d))


def baseband_as_printed(s, phi, y: Mode, w_d, m_c):
    """(7) as printed: numerator's sign turned over, 1/(2 m_c) in front, roots of (10) and (11) as printed."""
    numerator = np.sin(phi) * n1(s, y, w_d) - np.cos(phi) * n2(s, y, w_d)
    return numerator / (2 * m_c * d1_as_printed(s, y, w_d) * d2_as_printed(s, y, w_d))


def scale_factor(a_x, w_d, m_c, k_vf, phi_ye1):
    """(12) volts of feedback per rad/s, for infinite loop gain: -2 m_c A_x w_d / (k_vf cos phi_ye1)."""
    return -2 * m_c * a_x * w_d / (k_vf * math.cos(phi_ye1))


def scale_factor_with_drive(a_x, w_d, m_c, k_vf, phi_ye1, phi_xe2):
    """What the closed loops do: x is turned by phi_xe2 too, so the angle is phi_ye1 + phi_xe2; (12) has phi_xe2 = 0."""
    return scale_factor(a_x, w_d, m_c, k_vf, phi_ye1 + phi_xe2)


def open_loop_signal(t, a_i, a_q, w_d, phi_ye2):
    """(13) sense C/V output with both loops held: A_I sin + A_Q cos, turned by phi_ye2."""
    angle = w_d * t + phi_ye2
    return a_i * np.sin(angle) + a_q * np.cos(angle)


def phi_iq(a_i, a_q):
    """(14) angle of that signal against its in-phase part: 90 deg less 0.0072 deg at A_Q = 8000 A_I."""
    return math.atan2(a_q, a_i)


class Misprint(NamedTuple):
    """Where, what is printed, what is right, and a number that shows it: (name, printed, right)."""

    where: str
    printed: str
    right: str
    example: tuple


def misprints(y: Mode, w_d, m_c, phi_ye1):
    """The four places, each with a number for this gyroscope."""
    in_phase = feedback_parts(1.0, phi_ye1, 1.0)[0], feedback_parts_as_printed(1.0, phi_ye1, 1.0)[0]
    pole = [np.sqrt(complex(f(0.0, y, w_d))) / (2 * math.pi) for f in (d1_as_printed, d1)]
    gain = [baseband(0.0, 0.0, y, w_d), baseband_as_printed(0.0, 0.0, y, w_d, m_c)]
    s = 2j * math.pi * 10.0
    product = n1(s, y, w_d) ** 2 + n2(s, y, w_d) ** 2
    share = [abs(a(s, y, w_d) * b(s, y, w_d) / product - 1) for a, b in ((d1_as_printed, d2_as_printed), (d1, d2))]
    return (
        Misprint(
            "text under (6)",
            "V_c k_vf sin(w t) sin(phi_ye1) cancels Coriolis",
            "V_c k_vf sin(w t) cos(phi_ye1) cancels Coriolis; cos(w t) sin(phi_ye1) leaks into quadrature",
            ("share of the force that cancels Coriolis", in_phase[1], in_phase[0]),
        ),
        Misprint(
            "(7)",
            "sin(phi) N1 - cos(phi) N2, over 2 m_c",
            "cos(phi) N2 - sin(phi) N1, over m, times the demodulator's gain for a sine (1/2, 2/pi or 4/pi)",
            ("gain at 0 Hz (m/N)", float(abs(gain[1])), float(gain[0])),
        ),
        Misprint(
            "(10), (11)",
            "sqrt(1 - Q^2/4)",
            "sqrt(4 - 1/Q^2)",
            ("frequency of the slow pair (Hz)", float(abs(pole[0])), float(abs(pole[1]))),
        ),
        Misprint(
            "(10) times (11)",
            "D1 D2 is not N1^2 + N2^2",
            "D1 D2 = N1^2 + N2^2",
            ("relative difference at 10 Hz", float(share[0]), float(share[1])),
        ),
    )
