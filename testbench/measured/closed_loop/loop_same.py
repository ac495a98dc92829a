"""Products of a mode's position and velocity that are one law in other parameters: their first harmonics are.

    x = A cos wt, vx = -w A sin wt:  x^a vx^b has the first harmonic of x^(a+b) (b even) or x^(a+b-1) vx (b odd)
up to powers of w, which is constant. Only the first harmonic moves the loop; slow factors (rate, temp) stay what they
are. So no amplitude, rate or temperature tells x^2 vx from vx^3.
"""

MODES = {"x": "x", "vx": "x", "y": "y", "vy": "y"}
SLOW = ("rate", "temp")


def harmonic(one):
    """Text that all laws with the first harmonic of a `law.Law` share; "" if it is no plain product of one mode."""
    fast = [f for f in one.factors if f.name not in SLOW]
    modes = {MODES.get(f.name) for f in fast}
    if len(modes) != 1 or None in modes or any(f.dress for f in one.factors):
        return ""
    power = {f.name: f.power for f in fast}
    a, b = (sum(p for n, p in power.items() if (n[0] == "v") == speed) for speed in (False, True))
    if (a + b) % 2 == 0:
        return ""
    slow = " ".join(sorted(str(f) for f in one.factors if f.name in SLOW))
    (mode,) = modes
    return f"{one.port}: {slow} {mode}^{a + b} {'odd' if b % 2 else 'even'} in time"
