"""Set-up arithmetic of small complex matrices, as lists of rows of Python numbers: no BLAS, no libm, no open order.

Angles and exponents go through MP (exact.py) and are rounded once: every machine gets the same tables.
Source    docs/plant.md
"""

from analog_frontend.numeric.exact import MP


def times(a, b):
    """Product of two matrices."""
    return [[sum(a[i][k] * b[k][j] for k in range(len(b))) for j in range(len(b[0]))] for i in range(len(a))]


def plus(a, b):
    """Sum of two matrices."""
    return [[x + y for x, y in zip(p, q)] for p, q in zip(a, b)]


def solve_linear(a, rhs):
    """a x = rhs by elimination with pivots; complex, small."""
    n = len(a)
    rows = [list(a[i]) + list(rhs[i]) for i in range(n)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(n):
            if i != k:
                f = rows[i][k] / rows[k][k]
                rows[i] = [x - f * y for x, y in zip(rows[i], rows[k])]
    return [[v / rows[i][i] for v in rows[i][n:]] for i in range(n)]


def unit(angle):
    """e^(i angle) of an MP number, rounded once."""
    return complex(float(MP.cos(angle)), float(MP.sin(angle)))


def log(z):
    """Principal logarithm."""
    w = MP.log(MP.mpc(z.real, z.imag))
    return complex(float(w.real), float(w.imag))


def exp(z):
    """Exponential."""
    e = MP.exp(MP.mpf(z.real))
    return complex(float(e * MP.cos(z.imag)), float(e * MP.sin(z.imag)))
