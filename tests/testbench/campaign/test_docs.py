"""The page of campaigns: its examples run, its plan is the file beside it, its numbers are those of the code."""

import re

import pytest
import xarray

from testbench.campaign import cluster, pool
from testbench.campaign.plan import draws, measure, plan
from tests.testbench.campaign.helpers import INSTANT, ROOT, campaign, run_json

PAGE = (ROOT / "docs" / "campaigns.md").read_text()
EXAMPLES = sorted((ROOT / "docs" / "campaigns").glob("*.toml"))


def test_the_plan_on_the_page_is_the_file():
    (shown,) = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
    text = (ROOT / "docs" / "campaigns" / "temperature.toml").read_text()
    assert shown == re.sub(r"^#.*\n", "", text)


# the plan of the word lengths has 160 points; it is read in tests/testbench/study, too
@pytest.mark.parametrize(
    "path", [pytest.param(p, marks=[pytest.mark.slow] * (p.stem == "word_lengths"), id=p.stem) for p in EXAMPLES]
)
def test_examples_are_plans_that_run(path, tmp_path):
    code, out, err = campaign("check", path)
    assert code == 0, err
    count = int(re.search(r"(\d+) points", out)[1])
    # the same plan on an engine that takes no time
    copy = tmp_path / path.name
    plan_text = re.sub(r"^engine = .*\n", "", path.read_text(), flags=re.M)
    copy.write_text(f'engine = "{INSTANT}"\n' + plan_text)
    assert run_json(copy, "--out", tmp_path / "s")["done"] == count
    with xarray.open_dataset(tmp_path / "s" / "results" / f"{path.stem}.nc") as data:
        assert data.finished.size == count
        assert bool((data.finished == 1).all())
    said = re.search(r": (\d+) points\.", path.read_text())
    assert said is None or int(said[1]) == count


def test_the_python_on_the_page_draws(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    copy = tmp_path / "temperature.toml"
    copy.write_text(f'engine = "{INSTANT}"\n' + (ROOT / "docs" / "campaigns" / "temperature.toml").read_text())
    run_json(copy, "--out", "campaign")
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    names = {"print": lambda data: None}
    exec(code, names)
    names["data"].close()
    from matplotlib import pyplot

    assert pyplot.gca().lines
    pyplot.close("all")


def test_forms_statistics_and_limits_on_the_page():
    for form in draws.FORMS:
        assert f"{{ {form} = [" in PAGE, form
    for name in measure.STATISTICS:
        assert f"`{name}`" in PAGE, name
    for key in (*plan.KEYS[:3], "frames = N", "tau_s = [...]", "streams.COLUMN", "statistics.COLUMN"):
        assert f"`{key}" in PAGE, key
    text = " ".join(PAGE.split())
    assert f"does not answer within {cluster.CONNECT_S:g} s, has no workers for {cluster.NO_WORKER_S:g} s" in text
    assert pool.TRIES == 3
    assert "at most three times" in text
    decision = " ".join((ROOT / "docs" / "decisions" / "0010-store-of-campaigns.md").read_text().split())
    assert f"{plan.MAX_POINTS:,}".replace(",", " ") + " points are 1 GB" in decision


def test_every_command_is_on_the_page():
    from testbench.campaign import cli

    for command in cli.app.registered_commands:
        name = command.name or command.callback.__name__
        assert f"gyro campaign {name} " in PAGE, name
