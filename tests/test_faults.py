"""The list of faults made by hand is of today's sources; `python -m tests.faults` plants them."""

from tests.faults import FAULTS, ROOT


def test_each_fault_has_its_place_and_its_tests():
    assert len(FAULTS) == 20
    for path, old, new, tests in FAULTS:
        assert old in (ROOT / path).read_text(), (path, old)
        assert old != new
        assert all((ROOT / "tests" / name).exists() for name in tests.split()), tests
