"""The inference: rows and priors as declared, the closed forms against the parts' own, coverage on simulated papers."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, chisquare

from testbench.config import changed
from testbench.judge import numbers
from testbench.paper.inference import (
    forward,
    infer,
    likelihood,
    priors,
    probable_board,
    ring_table,
    rows,
    simulated_boards,
)
from testbench.paper.loop import derived, loop_parameters
from testbench.run.budget import budget

CSV = Path(numbers.__file__).with_name("measured_numbers.csv")


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
    names = {row.name: row for row in rows.fitted_rows()}
    assert len(names) == 19
    of_text = ("SF", "scale_factor"), ("ARW", "arw"), ("BI", "bias_instability"), ("Vq", "v_q"), ("bias", "bias")
    for symbol, group in of_text:
        for temp, (value, spread) in printed(symbol, "mean of cases 1,2,3").items():
            row = names[f"{group}_{temp:g}"]
            assert row.value == value
            if spread and symbol != "SF":
                assert row.sigma == pytest.approx(spread / math.sqrt(3), rel=1e-3)
    assert [names[n].value for n in rows.PHASES] == [3.7647, 1.2459, 8.8814, 1.5560]


def test_the_scale_factor_is_judged_without_the_spread_that_the_cosine_makes():
    """Two cases at 1/cos(ye1 + xe2), one at 1/cos(ye1): 31 LSB, 18 LSB of standard deviation."""
    names = {row.name: row for row in rows.fitted_rows()}
    step = 8651.0 * (math.cos(math.radians(8.8814)) / math.cos(math.radians(8.8814 + 1.2459)) - 1)
    assert 30 < step < 32
    for temp, (value, spread) in printed("SF", "mean of cases 1,2,3").items():
        rest = math.sqrt(spread**2 - (step * value / 8651.0) ** 2 / 3)
        assert names[f"scale_factor_{temp:g}"].sigma == pytest.approx(
            math.hypot(rest / math.sqrt(3), 12**-0.5), rel=1e-3
        )


def test_every_fitted_row_is_held_out_once_by_class_and_once_by_temperature():
    fitted, never = [row.name for row in rows.fitted_rows()], [row.name for row in rows.steps()]
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
    assert not [row.value for row in rows.fitted_rows() if f"{row.value:g}" in said]


# ---- the closed forms against budget and linear loop, which share none of them ---------------------------------------


def drawn(rng, count):
    z = np.clip(rng.standard_normal((count, len(priors.PRIORS))), -2.5, 2.5)  # within the limits of the keys
    return z, {c.name: rng.choice(c.choices, count) for c in priors.CHOICES}


def one(z, mode, k):
    v = {name: float(a[k]) for name, a in priors.board_numbers(z).items()}
    return probable_board.board_config(v, {name: int(a[k]) for name, a in mode.items()})


def linear(z, mode, k):
    """The board with a ring that does not saturate."""
    return changed(one(z, mode, k), {"nominal.ring_saturation_on": 0})


def compensated(config, case):
    """The configuration with the words of a case, from its own budget at 25 degC."""
    p = loop_parameters.loop_parameters(config, 25.0)
    found = budget(config, 25.0, p.w_rad_s / (2 * math.pi))
    node, loop = found.node_deg(), found.loop_deg()
    words = {"drive_sine": (2, node["xe1"]), "drive_ref": (3, -loop["xe2"]), "sense_sine": (4, node["ye1"]),
             "sense_ref": (5, -loop["ye2"])}  # fmt: skip
    return changed(config, {f"firmware.phase_{n}_deg": value for n, (first, value) in words.items() if case >= first})


NAMES = {"scale_factor": "lsb_per_dps", "arw": "arw_deg_per_rt_h", "bias_instability": "instability_deg_per_h",
         "v_q": "quadrature_v", "bias": "bias_dps"}  # fmt: skip
LARGEST = {"scale_factor": 5e-5, "v_q": 3e-5, "arw": 5e-3, "bias_instability": 5e-3, "bias": 2e-3}


@pytest.mark.parametrize(
    "temp", [pytest.param(t, marks=[pytest.mark.slow] * (k > 0)) for k, t in enumerate(rows.TEMPERATURES_DEGC)]
)
def test_closed_forms_are_those_of_budget_and_linear_loop(temp):
    z, mode = drawn(np.random.default_rng(int(temp) + 100), 4)
    z[:, priors.NAMES.index("pickoff_v")] = -4.5  # 6.4 mV: the ring keeps its gain within 3e-5
    z[:, priors.NAMES.index("sense_pickoff_ratio")] = 2.5  # and y is seen, as the firmware needs
    found = forward.predict(z, mode)
    for k in range(4):
        config = linear(z, mode, k)
        phases = budget(config, 25.0)
        for name, deg in {"xe1": phases.node_deg()["xe1"], "xe2": phases.loop_deg()["xe2"]}.items():
            assert found[name][k] == pytest.approx(deg, abs=1e-4)
        ye2 = phases.node_deg()["ye2"] if mode["ye2_at_pin"][k] else phases.loop_deg()["ye2"]
        assert found["ye1"][k] == pytest.approx(phases.node_deg()["ye1"], abs=1e-4)
        assert found["ye2"][k] == pytest.approx(ye2, abs=1e-4)
        seen = {case: derived.derive(compensated(config, case), temp) for case in forward.CASES}
        for group, share in LARGEST.items():
            mean = np.mean([getattr(seen[c], NAMES[group]) for c in (1, 2, 3)])
            near = pytest.approx(mean, rel=share, abs=1e-4 if group == "bias" else 0)
            assert found[f"{group}_{temp:g}"][k] == near, (group, k)
        for group in rows.STEPPED:
            for step in rows.STEPS:
                before, after = (getattr(seen[int(c)], NAMES[group]) for c in step.split("to"))
                share = (after - before) / abs(before)
                assert found[f"{group}_{step}_{temp:g}"][k] == pytest.approx(share, rel=5e-3, abs=5e-5), (
                    group,
                    step,
                    k,
                )


@pytest.mark.slow
def test_what_a_saturating_ring_does_to_the_scale_factor_is_that_of_its_integration():
    """Within 2e-3: the closed form knows the amplitude of 1 % loss within 8 %, and the gain within 0.3 %."""
    z, mode = drawn(np.random.default_rng(9), 2)
    z[:, priors.NAMES.index("pickoff_v")] = 1.6
    mode["carrier_compensated"][:] = 1
    found = forward.predict(z, mode)
    lost = []
    for k in range(2):
        for temp in (-20.0, 50.0):
            ratio = [derived.derive(f(z, mode, k), temp).lsb_per_dps / derived.derive(f(z, mode, k), 25.0).lsb_per_dps
                     for f in (one, linear)]  # fmt: skip
            own = found[f"scale_factor_{temp:g}"][k] / found["scale_factor_25"][k]
            assert own == pytest.approx(ratio[0], rel=2e-3)
            lost.append(ratio[0] / ratio[1] - 1)
    assert max(lost) > 3e-3  # warm: x is larger at the same signal


def test_the_ring_table_is_the_ring():
    rng = np.random.default_rng(5)
    for temp in rows.TEMPERATURES_DEGC:
        for _ in range(10):
            cref, carrier = math.exp(rng.uniform(math.log(12e-12), math.log(200e-12))), rng.uniform(2.2, 7.5)
            table = ring_table.rings(np.array([carrier]), np.array([cref]), temp)
            np.testing.assert_allclose([a[0] for a in table], ring_table.exact_ring(carrier, cref, temp), rtol=2e-6)


def test_a_compensated_carrier_keeps_the_gain_of_its_ring():
    carrier_v, cref = 4.0, 38e-12
    cold, warm = (
        ring_table.exact_ring(carrier_v + forward.DROP_V_PER_K * (temp - 25), cref, temp).gain_v_per_f
        for temp in (-20.0, 50.0)
    )
    plain = [ring_table.exact_ring(carrier_v, cref, temp).gain_v_per_f for temp in (-20.0, 50.0)]
    assert abs(warm / cold - 1) < 0.1 * (plain[1] / plain[0] - 1)


# ---- simulated papers ------------------------------------------------------------------------------------------------


def test_a_paper_of_a_known_board_gives_its_modes_and_its_rows():
    """Rows at the optimum of the true mode are within the noise they were drawn with."""
    z, mode, rng = simulated_boards.board(2, 0)
    (paper,) = likelihood.simulate_papers(z, mode, rng)
    data = likelihood.compared_rows(paper)
    found = infer.optimum(data)
    post = infer.posterior(data, rng, 200)
    assert post.size > 40
    same = np.all([found.mode[name] == mode[name] for name in mode], axis=0)
    assert found.weight[same].sum() > 0.02
    assert found.chi2[same][0] < chi2.ppf(0.999, len(data.names))
    assert np.std(post.z[:, priors.NAMES.index("full_scale_dps")]) < 0.05  # the data carry the scale
    assert 0.7 < np.std(post.z[:, priors.NAMES.index("amplitude_um")]) < 1.3  # and say nothing of the amplitude


@pytest.mark.slow
def test_simulated_papers_are_covered_and_ranks_are_uniform():
    judged = simulated_boards.simulate_truth_ranks(100, 11)
    parameters = np.array(list(judged.parameters.values()))
    held_out = np.concatenate(list(judged.heldout_ranks.values()))
    assert parameters.shape == (len(priors.PRIORS), 100)
    assert len(held_out) > 2000
    assert 0.86 < simulated_boards.coverage(np.concatenate([parameters.ravel(), held_out])) < 0.94
    assert 0.86 < simulated_boards.coverage(parameters) < 0.94
    assert 0.86 < simulated_boards.coverage(held_out) < 0.94
    # 10 bins of 10 boards each; one of all tests in a hundred fails by chance
    p = [chisquare(np.histogram(ranks, 10, (0, 1))[0]).pvalue for ranks in parameters]
    assert min(p) > 0.01 / len(p)
    assert np.mean(p) > 0.5 - 3 / math.sqrt(12 * len(p))
    # the true mode is among the draws
    hits = np.array(judged.true_mode) > 0
    assert hits.mean() > 0.95
