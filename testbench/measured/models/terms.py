"""Forces that a driven resonator may have beside spring, damping and drive: names and products.

A force of the mode's own motion that goes against its velocity takes energy: with the other sign a part at rest or at a
large amplitude would start by itself.
"""

# name, product (see effects/law.py), sign, words
FORCES = (
    ("duffing", "x^3", 0, "cubic spring"),
    ("spring_square", "x^2", 0, "quadratic spring"),
    ("spring_abs", "abs(x) x", 0, "spring that stiffens with |x|"),
    ("spring_quintic", "x^5", 0, "fifth-order spring"),
    ("damping_quadratic", "abs(vx) vx", 1, "damping that grows with speed"),
    ("damping_cubic", "x^2 vx", 1, "damping that grows with the square of displacement"),
    ("damping_abs_x", "abs(x) vx", 1, "damping that grows with displacement"),
    ("damping_speed_cubed", "vx^3", 1, "damping that grows with the square of speed"),
    ("coulomb_friction", "sgn(vx)", 1, "dry friction"),
    ("inertia", "x vx^2", 0, "inertia that changes with displacement"),
    ("drive_cubic", "u^3", 0, "force that grows with the cube of the drive voltage"),
    ("drive_square", "u^2", 0, "force that grows with the square of the drive voltage"),
    ("softening_drive", "u^2 x", 0, "spring that changes with the square of the drive voltage"),
    ("drive_times_x", "u x", 0, "spring that changes with the drive voltage"),
)
GRAMMAR = (
    ("x^4", "x^4"),
    ("x^3 vx", "x^3 vx"),
    ("x vx", "x vx"),
    ("x^2 abs(x) x", "abs(x)^3 x"),
    ("x^4 vx", "x^4 vx"),
    ("vx^2", "vx^2"),
    ("u x^2", "u x^2"),
    ("u vx", "u vx"),
    ("u^2 vx", "u^2 vx"),
)
TERMS = {name: text for name, text, _, _ in FORCES} | dict(GRAMMAR)
