"""A few concurrent starts and kills of every command that writes; `make kills` does all of them."""

import numba
import pytest

from tests import kills, kills_run

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")


@pytest.mark.slow
def test_a_run_survives_a_second_start(monkeypatch, tmp_path):
    """Without pictures and diagnosis, most of the time of so short a run; a kill is in storage/test_checkpoint.py."""
    short = (*kills_run.NO_PICTURES, "--set", "scenario.diagnose=false")
    monkeypatch.setattr(kills_run, "RUN", (*kills_run.RUN, *short))
    kills_run.undisturbed.cache_clear()
    assert kills_run.pair(11, tmp_path) is None
    kills_run.undisturbed.cache_clear()


@pytest.mark.slow
def test_the_quick_commands_for_two_minutes():
    done, wrong = kills.run(kills.QUICK, seed=7, minutes=2.0)
    assert wrong == []
    assert {name for name, _ in done} == set(kills.QUICK)


def test_every_case_is_drawn_as_often_as_the_page_says():
    for name, (pairs, kills_of) in kills.COUNTS.items():
        found = [kind for kind, _, _ in kills.drawn(name, 1)]
        assert found.count("pair") == pairs
        assert [found.count(number.name) for number in kills.SIGNALS] == [kills_of // 3] * 3
