"""Sigmas that a data sheet leaves: those of a least squares with the priors as covariance."""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.config import Config
from testbench.measured.closed_loop.loop_symmetries import SYMMETRIES
from testbench.measured.wide import data_sheet
from tests.sealed import sheet_size
from tests.sealed.bank import Unit

ROWS = 60


class Made:
    """A bank of random columns, a row of unit variance each; it notes which parameter was asked for how."""

    def __init__(self):
        self.rng, self.columns = np.random.default_rng(3), {}
        self.strata = SimpleNamespace(priors={"plant.qx": None, "plant.fx_hz": None})

    def _column(self, key, scale):
        self.columns[key] = self.rng.normal(size=ROWS) / scale
        return Unit(self.columns[key], scale)

    def nuisance(self, key):
        return self._column(key, getattr(Config().plant, key.partition(".")[2]))

    def _measured(self, name, run, first):
        return self._column(name.removeprefix("nuisance "), first)

    def effect(self, effect):
        return Unit(np.full(ROWS, np.nan) if effect.name == "lost" else effect.change, 1.0)

    def whiten_rows(self, change):
        return change


def covariance_of(bank):
    """What the noise and the priors of the sheet leave unknown of the features."""
    priors = {p.key: p for p in data_sheet.parameters(Config(), data_sheet.read(data_sheet.BUNDLED_PATH))}
    assert set(priors) - set(bank.columns) == {s.dependent_key for s in SYMMETRIES}
    covariance = np.eye(ROWS)
    for key, column in bank.columns.items():
        p = priors[key]
        sd = p.scale * abs(p.mean) if p.logarithmic else p.scale
        covariance += sd**2 * np.outer(column, column)
    return covariance


def test_the_sheet_takes_what_its_covariance_takes():
    bank, change = Made(), np.random.default_rng(5).normal(size=ROWS)
    found = sheet_size.sizes(bank, [SimpleNamespace(name="a", change=change), SimpleNamespace(name="lost")])
    expected = np.sqrt(change @ np.linalg.solve(covariance_of(bank), change))
    assert found == {"a": pytest.approx(expected, rel=1e-9)}


def test_another_effect_of_any_size_takes_what_its_covariance_takes():
    bank, change = Made(), np.random.default_rng(5).normal(size=ROWS)
    other = change[::-1].copy()
    rest = sheet_size.left(bank, [SimpleNamespace(name="a", change=change), SimpleNamespace(name="b", change=other)])
    covariance = covariance_of(bank) + 1e12 * np.outer(other, other)
    expected = np.sqrt(change @ np.linalg.solve(covariance, change))
    assert sheet_size.beside(rest, "a", -2.0, "b") == pytest.approx(2 * expected, rel=1e-4)
    assert sheet_size.beside(rest, "a", 3.0, "a") == pytest.approx(0, abs=1e-9)
