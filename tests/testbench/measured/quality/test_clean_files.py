"""Undamaged ring-downs and levels, by other generators than those of the damages: almost none is refused."""

import numpy as np
import pytest

from testbench.measured.formats import sheets
from testbench.measured.quality.finding import REFUSE
from tests.testbench.measured.parts import made, recordings

STREAM = 4242


def ring_down(rng, folder):
    return recordings.ring(folder / "r.txt", "S", 1, *recordings.clean_ring_down(rng))


def levels(rng, folder):
    """Steps of any size at the segments' borders and carries: jumps are what a converter has."""
    noise, drift = 10 ** rng.uniform(-2, 0, 2)
    elements = [(k, 8, rng.normal() * 0.5) for k in range(1, 9)]
    steps = [(int(rng.integers(2, 9)), 8, 10 ** rng.uniform(-1, 1.3))]
    bits = [(b, rng.normal() * 10 ** rng.uniform(-1, 0.7)) for b in range(8)]
    size = {"bits": int(rng.integers(9, 14)), "noise_lsb": noise, "drift_lsb": drift}
    return made.levels(folder / "l.mat", rng, elements=elements, steps=steps, bits_lsb=bits, **size)


def refused(make, count, folder):
    """[(number, findings)] of the files that are refused."""
    out = []
    for number in range(count):
        said = sheets.examine([make(np.random.default_rng([STREAM, number]), folder)])
        if any(f.action == REFUSE for f in said):
            out.append((number, [str(f) for f in said]))
    return out


@pytest.mark.slow
@pytest.mark.parametrize(("make", "count", "most"), [(ring_down, 200, 4), (levels, 100, 2)])
def test_almost_no_clean_file_is_refused(make, count, most, tmp_path):
    """At most 2 %."""
    found = refused(make, count, tmp_path)
    print(f"refused {found}")
    assert len(found) <= most, found
