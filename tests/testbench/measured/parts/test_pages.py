"""docs/measured_results.md says what docs/results/measured_parts.json holds, which a run of all sets has written."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from testbench.measured import in_loop
from testbench.measured.exam.part_page import is_unexplained
from testbench.measured.exam.staged import UNCHANGED_FACTOR

sys.path.append(str(Path(__file__).resolve().parents[4] / "docs"))

import measured_pages

KEPT = json.loads(measured_pages.STORED.read_text())
TEXT = " ".join((measured_pages.ROOT / "docs" / "measured_results.md").read_text().split())


def jobs(name):
    return {job["label"]: job for job in KEPT[name]["jobs"]}


def effects(job):
    return {e["law"]: e for e in job["effects"]}


def ratios(job):
    return {part: h["after"] / h["floor"] for part, h in job["heldout"].items()}


def test_every_set_is_in_a_table_of_the_page():
    tables = {name: part() for name, part in measured_pages.PARTS.items()}
    for name in tables:
        assert f"<!-- generated: {name} -->" in TEXT
    shown = " ".join(tables.values())
    for name in KEPT:
        for label, job in jobs(name).items():
            assert not job["heldout"] or label in shown, (name, label)


def test_a_verdict_named_leaves_nothing_above_the_limit():
    for name in KEPT:
        for job in jobs(name).values():
            rest = [part for part, h in job["heldout"].items() if is_unexplained(h)]
            found = job["verdict"] == "named in part"
            assert found == bool(rest and job["effects"]) or job["verdict"] in ("confounded", "candidate")
            assert all(h["after"] <= UNCHANGED_FACTOR * h["before"] for h in job["heldout"].values()), (
                "never worse than no law"
            )
            assert set(rest) <= set(job["rest"]), "what is left has its test"


def test_numbers_in_the_text_on_the_driven_resonator():
    (job,) = jobs("silverbox").values()
    found, text = effects(job), TEXT
    assert f"k3/k = {found['duffing']['value']:.2f} per V^2" in text
    assert f"|v| v with {found['damping_quadratic']['value']:.3f} per V" in text.replace("\\|", "|")
    assert f"does not repeat, {job['heldout']['multisine']['floor']:.2f} mV rms" in text
    low, high = min(ratios(job).values()), max(ratios(job).values())
    assert f"Unexplained: {low:.1f} to {high:.1f} floors" in text


def test_numbers_in_the_text_on_the_crystals():
    narrow, wide = (job for _, job in sorted(jobs("quartz_vna").items()))
    found, text = effects(narrow), TEXT
    assert abs(found["sweep_rate"]["value"] / effects(wide)["sweep_rate"]["value"] - 1) < 1e-3
    assert list(effects(wide)) == ["sweep_rate"]
    (h,) = narrow["heldout"].values()
    assert f"wrong by {h['before']:.0f} parts in 1000" in text
    assert f"a Duffing spring ({found['duffing']['value']:.0f} Hz at full response)" in text
    assert f"The path steps by {found['path_step_im']['value']:.4f}" in text
    assert f"misses the first {100 * found['receiver_wait']['value']:.0f} % of a step" in text
    assert f"pauses for {-found['kick_re']['value']:.0f} us at each step" in text
    assert f"The rest at 10 MHz is {h['after'] / h['floor']:.2f} times what does not repeat" in text
    assert "twice the noise" in text
    assert 1.8 < ratios(wide)["sweep_2"] < 2.5


def test_numbers_in_the_text_on_the_membranes():
    text, found = TEXT, {k: effects(job) for k, job in jobs("mems_ringdown").items()}
    c = [found[sample]["damping_cubic"]["value"] for sample in ("SP64-32", "SP64-33")]
    assert f"c = {c[0]:.3f} /(s uW) for SP64-32 and {c[1]:.3f} for SP64-33" in text
    left = ratios(jobs("mems_ringdown")["SP64-32"]).values()
    assert f"{min(left):.1f} to {max(left):.1f} floors are left there" in text
    assert [next(iter(found[f"PSE2-84-{k}"])) for k in ("11", "21")] == ["compression"] * 2


def test_numbers_in_the_text_on_the_parts():
    text, (two, one, second) = TEXT, jobs("dac16_levels").values()
    law, bend = "16 segments above a ladder", "bend of the ladder over 512 codes"
    first, other = (effects(job)[law]["coefficients"] for job in (two, one))
    lowest = min(first, key=lambda name: first[name]["value"])
    assert f"Border {lowest.split()[1].split('/')[0]} of 16 is {-first[lowest]['value']:.1f} LSB too low" in text
    near = [abs(first[n]["value"] - other[n]["value"]) < 1.96 * np.hypot(first[n]["sd"], other[n]["sd"]) for n in first]
    assert f"{sum(near)} of the {len(near)} coefficients agree" in text
    assert np.mean(near) >= 0.9
    bends = [effects(job)[bend]["value"] for job in (two, one)]
    assert bends[0] == pytest.approx(bends[1], rel=0.02)
    errors = [job["heldout"]["level"]["after"] for job in (two, one)]
    before = (0.0428, 0.0626)  # of the dictionary that the structure replaced
    assert all(now <= 1.2 * then for now, then in zip(errors, before))
    assert f"Held-out errors are {errors[0]:.3f} and {errors[1]:.3f} LSB" in text
    steps = [abs(c["value"]) for name, c in first.items() if name.startswith("step")]
    assert max(steps) < 0.3
    assert ratios(one)["level"] > 1.5
    (share,) = re.search(r"(\d+) % of its power in a tenth of the rows", one["rest"]["level"]).groups()
    assert 45 <= float(share) <= 55
    assert "Half of the rest lies in a tenth of the codes" in text
    assert not second["effects"]
    (gyro,) = jobs("gyro_static").values()
    first, first_settles, _, other_settles = gyro["effects"]
    assert f"a peak that settles at {first['hz']:.1f} Hz, from {100 * first_settles['value']:.0f} % above" in text
    assert first_settles["law"].endswith("settling in 3000 s")
    assert other_settles["value"] < first_settles["value"]


def test_numbers_in_the_text_on_the_meters():
    text, found = TEXT, jobs("dmm_linearity")
    whole, half = found["9 meter(s), random order"], found["9 meter(s), random order, first half chooses"]
    laws = [e["law"].split(": ") for e in whole["effects"]]
    warm = {meter for meter, law in laws if law.startswith(("gain with temp", "gain with room"))}
    counts = {1: "one", 3: "three", 4: "four", 5: "five", 6: "six"}
    assert f"in each of {counts[len(warm)]} meters" in text
    assert f"between the polarities in {counts[sum(law == 'turnover' for _, law in laws)]} of them" in text
    worst = max(ratios(whole), key=ratios(whole).get)
    assert [m for m, r in ratios(whole).items() if r > 1.5] == [worst], "the broken one"
    assert "neighbours 0.84 " in whole["rest"][worst]
    lost = sorted(r for m, r in ratios(half).items() if r > 1.5 and m != worst)
    words = (
        f"{counts[len(lost)]} meters beside the broken one keep more than 1.5 floors ({lost[0]:.1f} to {lost[-1]:.1f})"
    )
    assert words in text


@pytest.mark.parametrize("name", ["dac16_levels", "dmm_linearity", "gyro_static", "mems_ringdown", "silverbox"])
def test_what_runs_in_the_loop_has_its_numbers(name):
    rows = KEPT[name]["closed_loop"]
    controls = [row for row in rows if row["effect"].startswith("control")]
    assert len(rows) > len(controls) == len(in_loop.CONTROLS)
    assert all(isinstance(row[key], float) for row in rows for key in ("scale_ppm", "bias_deg_per_h", "noise_percent"))
