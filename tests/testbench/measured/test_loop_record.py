"""A record as a problem: what is held out of another session, and what is not."""

from types import SimpleNamespace as Row

import pytest

from testbench.measured.closed_loop import loop_record


@pytest.mark.parametrize(
    ("roles", "apart"),
    [
        (("fit", "", "validate"), True),
        (("fit", "validate", "fit"), False),
        (("validate", "fit", "validate"), False),
        (("", "fit", "fit"), True),
    ],
)
def test_held_out_dwells_of_a_fitted_power_on_are_not_of_another_session(monkeypatch, roles, apart):
    """Three dwells: the first two of one power-on, the last of the next."""
    dwells = [Row(first=first, role=role) for first, role in zip((100, 500, 1100), roles)]
    monkeypatch.setattr(loop_record, "sessions", lambda record: [Row(first=0), Row(first=1000)])
    monkeypatch.setattr(loop_record, "segments", lambda record: dwells)
    assert loop_record.held_out_apart(None) == apart
