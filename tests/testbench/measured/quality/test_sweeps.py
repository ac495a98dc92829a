"""A true resonance is no spike, however coarsely it is sampled and however far beyond its fold; a row off it is."""

from functools import partial

import numpy as np
import pytest

from testbench.errors import FileError
from testbench.measured.formats import sheets
from testbench.measured.openers import open_problem
from testbench.measured.quality.finding import REFUSE
from tests.testbench.measured.quality import sweeps

STREAM = 2626


def judged(first, count, folder):
    """(clean sweeps with a finding, spikes not found, pairs) of so many drawn sweeps."""
    flagged, missed, spiked = [], [], 0
    for seed in range(first, first + count):
        rng = np.random.default_rng([STREAM, seed])
        drawn = sweeps.draw(rng)
        said = sheets.examine([sweeps.write(drawn, drawn.s, folder / "clean.s2p")])
        flagged += [(seed, drawn.kind, [str(f) for f in said])] if said else []
        made = sweeps.spiked(drawn, rng)
        if made is None:
            continue
        spiked += 1
        rows, s = made
        said = sheets.examine([sweeps.write(drawn, s, folder / "spiked.s2p")])
        found = [f for f in said if f.kind == "spikes" and f.rows[0] <= rows.max() + 1 and f.rows[1] >= rows.min() + 1]
        missed += [] if found else [(seed, drawn.kind, rows + 1, [str(f) for f in said])]
    return flagged, missed, spiked


def test_a_sample_of_sweeps(tmp_path):
    flagged, missed, spiked = judged(0, 10, tmp_path)
    assert (flagged, missed) == ([], [])
    assert spiked >= 8


def refused_in_print(first, count, folder):
    """Clean sweeps that are refused when printed in coarse steps; that the steps are coarse is reported."""
    out = []
    for seed in range(first, first + count):
        rng = np.random.default_rng([STREAM, seed])
        said = sheets.examine([sweeps.printed(sweeps.draw(rng), folder / "coarse.s2p", rng)])
        out += [(seed, [str(f) for f in said])] if any(f.action == REFUSE for f in said) else []
    return out


STEPS = 30  # of the print, by which a damage must move the decibels


def stuck(size, step, rng):
    """Decibels that stand still for 8 to 20 rows and come back by STEPS; None where they do not move so far."""
    count = int(rng.integers(8, 21))
    far = np.abs(size[count:] - size[:-count]) > STEPS * step
    if not far.any():
        return None
    first = rng.choice(np.flatnonzero(far))
    return np.concatenate([size[:first], np.full(count, size[first]), size[first + count :]])


def clipped(size, step, rng):
    """Decibels with a ceiling STEPS or more below their top, which 8 rows or more pass; None for a lower peak."""
    top = np.sort(size)[-8]
    return np.minimum(size, top) if np.max(size) - top > STEPS * step else None


def missed_in_print(first, count, folder):
    """(damages that are not named, damages) of sweeps printed in coarse steps."""
    missed, made = [], 0
    for seed in range(first, first + count):
        for how in (stuck, clipped):
            rng = np.random.default_rng([STREAM, seed])
            path = sweeps.printed(sweeps.draw(rng), folder / "damaged.s2p", rng, partial(how, rng=rng))
            if path is None:
                continue
            made += 1
            # what stands still at its extreme is named as clipped, whatever made it
            named = {"stuck", "clipped"} & {f.kind for f in sheets.examine([path])}
            missed += [] if named else [(seed, how.__name__)]
    return missed, made


def test_a_coarse_print_is_no_damage_and_hides_none(tmp_path):
    assert refused_in_print(0, 10, tmp_path) == []
    missed, made = missed_in_print(0, 10, tmp_path)
    assert made >= 8
    assert len(missed) <= 0.1 * made, missed


@pytest.mark.slow
def test_a_hundred_and_fifty_coarse_prints(tmp_path):
    """At most 2 % of the clean ones refused; at least 90 % of values that stand still or are clipped named."""
    refused = refused_in_print(7000, 150, tmp_path)
    missed, made = missed_in_print(7000, 150, tmp_path)
    print(f"refused {refused}\nmissed {missed}\nof {made}")
    assert len(refused) <= 3, refused
    assert made >= 100
    assert len(missed) <= 0.1 * made, missed


def test_a_sweep_of_one_port_has_no_finding_and_is_refused_by_its_reader(tmp_path):
    drawn = sweeps.draw(np.random.default_rng(1))
    rows = "\n".join(f"{f:.4f} {v.real:.9e} {v.imag:.9e}" for f, v in zip(drawn.f, drawn.s))
    path = tmp_path / "one.s1p"
    path.write_text(f"# Hz S RI R 50\n{rows}\n")
    assert sheets.examine([path]) == ()
    with pytest.raises(FileError, match="one port; S21 is required"):
        open_problem([path], {})


@pytest.mark.slow
def test_three_hundred_sweeps(tmp_path):
    """At most 1 % of the clean ones with a finding; at least 95 % of the spikes found."""
    flagged, missed, spiked = judged(1000, 300, tmp_path)
    print(f"flagged {flagged}\nmissed {missed}\nof {spiked}")
    assert len(flagged) <= 3, flagged
    assert spiked >= 285
    assert len(missed) <= 0.05 * spiked, missed
