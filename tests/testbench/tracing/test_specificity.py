"""How often sets of laws imitate a law that is left out: against least squares law by law, and in a whole trace."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.tracing.fit import specificity


def ranking(columns):
    length = np.linalg.norm(columns, axis=0)
    names = tuple(f"law {k}" for k in range(columns.shape[1]))
    cosines = (columns / length).T @ (columns / length)
    return SimpleNamespace(names=names, length=length, cosines=cosines, index=names.index)


def alike(columns, law, size, d, least, minor):
    """True if least squares on some `size` other columns leave less than `least` of d sigmas of a column."""
    unit = columns / np.linalg.norm(columns, axis=0)
    for members in itertools.combinations([k for k in range(unit.shape[1]) if k != law], size):
        a = unit[:, members]
        c, *_ = np.linalg.lstsq(a, unit[:, law], rcond=None)
        variance = np.diag(np.linalg.inv(a.T @ a))
        sigmas = np.abs(c) / np.sqrt(variance)
        left = d * np.linalg.norm(unit[:, law] - a @ c)
        if variance.max() < 5 and sigmas.min() >= minor * sigmas.max() and left < least:
            return True
    return False


@pytest.mark.parametrize(("rows", "d"), [(4, 8.0), (4, 30.0), (6, 12.0), (9, 9.0)])
def test_the_share_is_that_of_least_squares_law_by_law(rows, d):
    columns = np.random.default_rng([rows, 3]).normal(size=(rows, 9))
    r, least = ranking(columns), 5.0
    singles = [k for k in range(9) if alike(columns, k, 1, d, least, 0.1)]
    left = [k for k in range(9) if k not in singles]
    share = np.mean([alike(columns, k, 2, d, least, 0.1) for k in left])
    assert specificity.imitated_share(r, r.names, 1, d, least, 0.1) == pytest.approx(len(singles) / 9)
    assert specificity.imitated_share(r, r.names, 2, d, least, 0.1) == pytest.approx(share)


def test_laws_at_right_angles_imitate_none_and_a_law_between_two_is_imitated_by_them():
    r = ranking(np.eye(5))
    assert specificity.imitated_share(r, r.names, 2, 50.0, 5.0, 0.1) == 0.0
    # the last law is the sum of the first two; each of these is then a difference, by laws at 45 degrees
    r = ranking(np.column_stack([np.eye(5)[:, :4], [1, 1, 0, 0, 0]]))
    assert specificity.imitated_share(r, r.names, 2, 50.0, 5.0, 0.1) == pytest.approx(3 / 5)


def test_a_remainder_that_is_seen_is_larger_with_more_laws_and_at_a_stricter_level():
    few, many, strict = (specificity.detection_limit(*case) for case in ((10, 0.01), (128, 0.01), (128, 0.001)))
    assert many == pytest.approx(5.23, abs=0.01)
    assert few < many < strict
