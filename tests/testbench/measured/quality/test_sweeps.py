"""A true resonance is no spike, however coarsely it is sampled and however far beyond its fold; a row off it is."""

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


def test_a_coarse_print_is_no_damage(tmp_path):
    assert refused_in_print(0, 10, tmp_path) == []


def test_a_sweep_of_one_port_has_no_finding_and_is_refused_by_its_reader(tmp_path):
    drawn = sweeps.draw(np.random.default_rng(1))
    rows = "\n".join(f"{f:.4f} {v.real:.9e} {v.imag:.9e}" for f, v in zip(drawn.f, drawn.s))
    path = tmp_path / "one.s1p"
    path.write_text(f"# Hz S RI R 50\n{rows}\n")
    assert sheets.examine([path]) == ()
    with pytest.raises(FileError, match="one port; S21 wanted"):
        open_problem([path], {})


@pytest.mark.slow
def test_three_hundred_sweeps(tmp_path):
    """At most 1 % of the clean ones with a finding; at least 95 % of the spikes found."""
    flagged, missed, spiked = judged(1000, 300, tmp_path)
    print(f"flagged {flagged}\nmissed {missed}\nof {spiked}")
    assert len(flagged) <= 3, flagged
    assert spiked >= 285
    assert len(missed) <= 0.05 * spiked, missed
