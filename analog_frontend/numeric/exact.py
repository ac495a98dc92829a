"""Set-up arithmetic: one 240-bit mpmath context of our own, and the step from it to doubles.

Logs, roots, exponentials and pi are needed only while constants are prepared. They are taken here, in integers, so that
every machine gets the same constants; the C library's versions differ in the last bit.

    split(x) = (hi, lo),   hi = nearest double of x,   lo = nearest double of x - hi,   |x - hi - lo| <= 2^-106 |x|

Source  analog_frontend/parts/propagator.py
"""

import mpmath

MP = mpmath.mp.clone()
MP.prec = 240


def split(x):
    """`x` as a double-double: the two doubles nearest to it in turn."""
    hi = float(x)
    return hi, float(x - hi)
