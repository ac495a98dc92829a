"""The inference: rows and priors as declared, the closed forms against the parts' own, coverage on simulated papers."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from testbench.paper.inference import priors, rows

CSV = Path(rows.__file__).parents[1] / "measured_numbers.csv"


def printed(symbol, case):
    """{temperature: (value, spread)} read here from the text's numbers."""
    out = {}
    with CSV.open() as file:
        for line in csv.DictReader(file):
            if line["symbol"] == symbol and line["case"].startswith(case):
                temp = 25.0 if line["temperature_C"].startswith("room") else float(line["temperature_C"])
                spread = re.search(r"std ([\d.]+)", line["std_or_max_fluctuation"])
                out[temp] = float(line["value"]), float(spread[1]) if spread else None
    return out


def test_rows_are_the_texts_numbers():
    names = {row.name: row for row in rows.fitted()}
    assert len(names) == 19
    for symbol, group in (
        ("SF", "scale_factor"),
        ("ARW", "arw"),
        ("BI", "bias_instability"),
        ("Vq", "v_q"),
        ("bias", "bias"),
    ):
        for temp, (value, _) in printed(symbol, "mean of cases 1,2,3").items():
            assert names[f"{group}_{temp:g}"].value == value
    assert [names[n].value for n in rows.PHASES] == [3.7647, 1.2459, 8.8814, 1.5560]


def test_the_spread_of_the_scale_factor_loses_what_the_cosine_explains():
    """Three cases of one board: two at 1/cos(ye1 + xe2), one at 1/cos(ye1), and repeats of 18 LSB: drawn and pooled."""
    spreads = [s for _, s in printed("SF", "mean of cases 1,2,3").values()]
    rng = np.random.default_rng(3)
    k, a, b = 8651.0, 8.8814, 1.2459
    case = np.array([k, k, k * math.cos(math.radians(a + b)) / math.cos(math.radians(a))])
    drawn = case + rng.normal(0, 18.2, (40000, 3))
    assert rows.scale_spread_lsb(k, (math.sqrt(drawn.var(axis=1, ddof=1).mean()),), a, b) == pytest.approx(
        18.2, rel=0.02
    )
    assert rows.scale_spread_lsb() < math.sqrt(np.mean(np.square(spreads)))


def test_every_fitted_row_is_held_out_once_by_class_and_once_by_temperature():
    fitted, never = [row.name for row in rows.fitted()], [row.name for row in rows.steps()]
    by_rule = {}
    for fold in rows.folds():
        by_rule.setdefault(fold.rule, []).extend(fold.rows)
    assert sorted(by_rule["the class is left out"]) == sorted(by_rule["the temperature is left out"]) == sorted(fitted)
    assert sorted(by_rule["never fitted"]) == sorted(never)


def test_priors_have_their_quantiles_and_name_no_fitted_number():
    z = np.array([-priors.QUANTILE, priors.QUANTILE])
    for prior in priors.PRIORS:
        np.testing.assert_allclose(prior.value(z), (prior.lo, prior.hi), rtol=1e-12)
    said = " ".join(p.why for p in (*priors.PRIORS, *priors.CHOICES))
    assert not [row.value for row in rows.fitted() if f"{row.value:g}" in said]
