"""Damages of recordings are flagged by their kind before anything is fitted; undamaged ones are not."""

import os

import numpy as np
import pytest

from testbench.errors import FileError
from testbench.measured.formats import registry, sheets
from testbench.measured.quality.finding import REFUSE, QualityError
from tests.testbench.measured.quality import damages, siblings

REAL = 0.25  # share of siblings that are drawn from the real sets, where there are any


def found(paths):
    """(findings, refusal of a reader) about files."""
    try:
        return sheets.examine(paths), ""
    except QualityError as problem:
        return problem.findings, ""
    except FileError as problem:
        return (), str(problem)


def pairs(first, folder):
    """(kind, damage, clean path, damaged path) of one seed after the other; what no damage can move is drawn anew."""
    seed = first
    while True:
        rng, kind = np.random.default_rng([2611, seed]), siblings.KINDS[seed % len(siblings.KINDS)]
        seed += 1
        whole = (siblings.real(kind, rng) if rng.random() < REAL else None) or siblings.draw(kind, rng)
        names = damages.WHICH[kind].split()
        name = names[rng.integers(len(names))]
        made = damages.damaged(name, whole, rng)
        if made is not None:
            paths = siblings.write(whole, folder / f"clean{seed}"), siblings.write(made, folder / f"damaged{seed}")
            yield kind, name, *paths


def judged(first, count, folder):
    """(missed, flagged siblings, pairs whose damage is not refused) of so many pairs."""
    missed, flagged, accepted = [], [], []
    for (kind, name, clean, damaged), _ in zip(pairs(first, folder), range(count)):
        said, refusal = found([clean])
        if said or refusal:
            flagged.append((kind, [str(f) for f in said], refusal))
        said, refusal = found([clean, damaged] if name == "drift" else [damaged])
        if name not in [f.kind for f in said]:
            missed.append((kind, name, [f.kind for f in said], refusal))
        if not refusal and not any(f.action == REFUSE for f in said):
            accepted.append((kind, name, clean, damaged))
    return missed, flagged, accepted


def test_a_sample_of_damages(tmp_path, monkeypatch):
    monkeypatch.delenv(registry.FOLDER, raising=False)
    missed, flagged, _ = judged(0, 7, tmp_path)
    assert len(missed) <= 1, missed
    assert flagged == []


@pytest.mark.slow
def test_a_hundred_and_fifty_damages(tmp_path):
    """At least 95 % flagged with the right kind; at most 3 of the siblings flagged."""
    missed, flagged, _ = judged(int(os.environ.get("GYRO_DAMAGES_FROM", 10_000)), 150, tmp_path)
    print(f"missed {missed}\nflagged {flagged}")
    assert len(missed) <= 7, missed
    assert len(flagged) <= 3, flagged
