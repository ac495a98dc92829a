"""The inference: rows and priors as declared, the closed forms against the parts' own, coverage on simulated papers."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from analog_frontend.parts import ring_diode
from testbench.config import Config, changed
from testbench.paper import law
from testbench.paper.inference import board, forward, priors, ring_table, rows
from testbench.paper.loop import advisor, parts, sensitivity
from testbench.paper.loop import loop as lp
from testbench.run.budget import budget

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


# ---- the closed forms against budget and linear loop, which share none of them -----------------------------------------


def drawn(rng, count):
    z = rng.standard_normal((count, len(priors.PRIORS)))
    mode = {c.name: rng.choice(c.choices, count) for c in priors.CHOICES}
    return z, mode


def one(z, mode, k):
    v = {name: float(a[k]) for name, a in priors.values(z).items()}
    return board.config_of(v, {name: int(a[k]) for name, a in mode.items()})


def compensated(config, case):
    """The configuration with the words of a case, from its own budget at 25 degC."""
    p = parts.parts(config, 25.0)
    found = budget(config, 25.0, p.w_rad_s / (2 * math.pi))
    node, loop = found.node_deg(), found.loop_deg()
    words = {"drive_sine": (2, node["xe1"]), "drive_ref": (3, -loop["xe2"]), "sense_sine": (4, node["ye1"]),
             "sense_ref": (5, -loop["ye2"])}  # fmt: skip
    return changed(config, {f"firmware.phase_{n}_deg": value for n, (first, value) in words.items() if case >= first})


@pytest.mark.parametrize("temp", rows.TEMPERATURES_DEGC)
def test_closed_forms_are_those_of_budget_and_linear_loop(temp):
    z, mode = drawn(np.random.default_rng(int(temp) + 100), 4)
    found = forward.predict(z, mode)
    for k in range(4):
        config = one(z, mode, k)
        phases = budget(config, 25.0)
        for name, deg in {"xe1": phases.node_deg()["xe1"], "xe2": phases.loop_deg()["xe2"]}.items():
            assert found[name][k] == pytest.approx(deg, abs=1e-4)
        ye2 = phases.node_deg()["ye2"] if mode["ye2_at_pin"][k] else phases.loop_deg()["ye2"]
        assert found["ye1"][k] == pytest.approx(phases.node_deg()["ye1"], abs=1e-4)
        assert found["ye2"][k] == pytest.approx(ye2, abs=1e-4)
        seen = {}
        for case in forward.CASES:
            p = parts.parts(compensated(config, case), temp)
            loop = lp.close(p)
            lsb = advisor.rest_gain(loop) * lp.DEG
            still = lp.rest(loop, (p.dxy_n_s_per_m / (2 * p.coriolis_mass_kg), p.kxy_n_per_m, *p.sid_offset_v))
            seen[case] = {"scale_factor": lsb, "bias": still[lp.WORD_BEFORE] / lsb, "v_q": advisor.volts(p, still[lp.U]),
                          "arw": sensitivity.arw_deg_per_rth(p, loop)}  # fmt: skip
        for group, share in (("scale_factor", 2e-5), ("v_q", 2e-5), ("arw", 5e-3)):
            mean = np.mean([seen[c][group] for c in (1, 2, 3)])
            assert found[f"{group}_{temp:g}"][k] == pytest.approx(mean, rel=share), (group, k)
        mean = np.mean([seen[c]["bias"] for c in (1, 2, 3)])
        assert found[f"bias_{temp:g}"][k] == pytest.approx(mean, rel=2e-3, abs=1e-5)
        for group in rows.STEPPED:
            for step in rows.STEPS:
                before, after = (seen[int(c)][group] for c in step.split("to"))
                share = (after - before) / abs(before)
                assert found[f"{group}_{step}_{temp:g}"][k] == pytest.approx(share, rel=5e-3, abs=3e-5), (
                    group,
                    step,
                    k,
                )


def test_bias_instability_is_that_of_the_derived_floor():
    z, mode = drawn(np.random.default_rng(8), 3)
    found = forward.predict(z, mode)
    for k in range(3):
        floors = [law.derived_noise(changed(compensated(one(z, mode, k), c), {"scenario.temperature_degc": 25.0}))
                  ["flicker"]["instability_deg_per_h"] for c in (1, 2, 3)]  # fmt: skip
        assert found["bias_instability_25"][k] == pytest.approx(np.mean(floors), rel=1e-2)


def test_the_ring_table_is_the_ring():
    rng = np.random.default_rng(5)
    d = Config().device()
    diode = ring_diode.Diode(*(getattr(d, f"diode_{name}") for name in ring_diode.Diode._fields))
    for temp in rows.TEMPERATURES_DEGC:
        for _ in range(10):
            cref, carrier = math.exp(rng.uniform(math.log(12e-12), math.log(200e-12))), rng.uniform(2.2, 7.5)
            exact = ring_diode.ring(carrier, d.carrier_hz * (1 + 2e-5), d.c0_f, d.cp_f, cref, diode, temp)
            gain, tau = ring_table.rings(np.array([carrier]), np.array([cref]))[temp]
            assert gain == pytest.approx(exact.gain_v_per_f, rel=1e-6)
            assert tau == pytest.approx(exact.tau_s, rel=1e-5)
