"""One small record of the simulated board for all tests here."""

import copy

import pytest

from testbench.measured.record import produce, recording_plan

TREE = {
    "name": "small",
    "lab": "desk",
    "repeats": 2,
    "seed": 5,
    "set": {"plant.fx_hz": 11002.5},
    "condition": [
        {"id": "a", "rate_dps": 100.0, "seconds": 0.05, "settle_s": 0.025},
        {
            "id": "b",
            "rate_dps": -80.0,
            "a_um": 4.0,
            "seconds": 0.05,
            "settle_s": 0.0,
            "role": "validate",
            "counter_s": 0.02,
        },
    ],
    "prior": [{"param": "plant.fx_hz", "mean": 11002.3, "sd": 1.0, "unit": "Hz"}],
}


@pytest.fixture(scope="session")
def tree():
    return copy.deepcopy(TREE)


@pytest.fixture(scope="session")
def small(tree):
    """A record of two conditions in two repeats; not to be changed."""
    return produce.record(recording_plan.from_dict(tree))


@pytest.fixture
def own(small):
    """A copy that a test may spoil."""
    return copy.deepcopy(small)
