"""Stimulus that means something: directed families made from the formats of a block, then random ones.

    idle, corners, signs, walking_ones    from the formats of the inputs alone                               families.py
    edges                                 truncation carries, ties, saturation edges +-1 LSB: solved         edges.py
    script                                long inputs: debouncing, whole frames, start-up                    scripts.py
    reset_at, enable_at, controls         reset and enable at every state of the pipeline, all 1-bit inputs  families.py
    held                                  steady inputs: limit cycles                                        families.py
    random_*                              dense, sparse and corner-weighted                                  families.py
    corners_found                         what a search has found beyond these, stored                       corners/

Source  docs/golden.md
"""

import numpy as np

from testbench.golden.stimulus import corners as found_corners
from testbench.golden.stimulus import edges, families, scripts
from testbench.golden.stimulus.writer import SEED, Random, Writer, corners

__all__ = ["SEED", "Random", "corners", "make", "make_directed"]


def make_directed(block, case, seed=SEED):
    """As `make`, without the family of found corners."""
    return _stimulus_and_families(_write_directed_families(block, case, seed))


def make(block, case, seed=SEED):
    """(rows, families): int64 rows in the columns of the block, and (name, first row, rows) of each family."""
    w = _write_directed_families(block, case, seed)
    found_corners.replay(w)
    return _stimulus_and_families(w)


def _stimulus_and_families(w):
    return np.array(w.rows, np.int64), [tuple(family_entry) for family_entry in w.families]


def _write_directed_families(block, case, seed):
    w = Writer(block, case, seed)
    w.family("idle")
    families.idle(w)
    for name, module in (("edges", edges), ("script", scripts)):
        written = getattr(module, f"{name}_{block.stem}", None)
        if written:
            w.family(name)
            written(w)
    parts = (families.of_values if w.wide else ()) + families.of_strobes
    for part in parts:
        part(w)
    return w
