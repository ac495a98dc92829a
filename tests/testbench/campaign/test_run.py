"""Campaigns in local workers: results that xarray opens, nothing run twice, one point alone, full disks, failures."""

import csv
import json
import os
import resource
import signal
import time

import numpy as np
import pytest
import xarray

from testbench.campaign import collect
from testbench.campaign.store import Store
from tests.testbench.campaign.helpers import INSTANT, LANES, OWN, campaign, child, finished, plan_file, run_json, start


def starts(store):
    return [event for event in Store.open_folder(store).events() if event.event == "start"]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A finished campaign of 2 temperatures x 3 boards x 2 seeds."""
    folder = tmp_path_factory.mktemp("tiny")
    report = run_json(plan_file(folder), "--out", folder / "store")
    assert (report["points"], report["done"], report["reused"], report["failures"]) == (12, 12, 0, [])
    return folder


def test_xarray_opens_the_results(tiny):
    with xarray.open_dataset(tiny / "store" / "results" / "tiny.nc") as data:
        assert dict(data.sizes) == {"temperature": 2, "board": 3, "seed": 2, "tau_s": 2, "time_4": 16}
        np.testing.assert_array_equal(data.temperature, [-40.0, 85.0])
        assert data.temperature.attrs["units"] == "degC"
        assert data.temperature.attrs["parameter"] == "scenario.temperature_degc"
        np.testing.assert_array_equal(data.tau_s, [0.000125, 0.0005])
        assert data["plant.fx_hz"].dims == ("board",)
        assert "plant.fx_hz" in data["rate_word.mean"].coords
        assert data["rate_word"].dims == ("temperature", "board", "seed", "time_4")
        assert float(data["time_4"][1]) == 0.0005
        one = data.isel(temperature=1, board=2, seed=0)
        np.testing.assert_allclose(one["rate_word"].mean(), one["rate_word.mean"], rtol=1e-12)
        assert data.drive_frequency_hz.attrs["units"] == "Hz"
        assert np.isnan(data["phase_deg.xe1"]).all(), "None is nan"
        assert (data.finished == 1).all()
        address = str(one.point.values)
    with xarray.open_dataset(Store.open_folder(tiny / "store").point_path(address)) as point:
        assert float(point.drive_frequency_hz) == float(one.drive_frequency_hz)
        assert json.loads(str(point.identity.values))["config"]["scenario"]["temperature_degc"] == 85.0


def test_the_table_says_the_same(tiny):
    with open(tiny / "store" / "results" / "tiny.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    with xarray.open_dataset(tiny / "store" / "results" / "tiny.nc") as data:
        flat = data["rate_word.std"].values.ravel()
        assert [float(row["rate_word.std"]) for row in rows] == flat.tolist()
        assert [row["point"] for row in rows] == data.point.values.ravel().tolist()
        assert [float(row["plant.fx_hz"]) for row in rows[:6:2]] == data["plant.fx_hz"].values.tolist()
    assert rows[0]["phase_deg.xe1"] == ""
    code, _, err = campaign("table", tiny / "store", "--out", tiny / "t.parquet")
    assert code == 0, err
    from pyarrow import parquet

    table = parquet.read_table(tiny / "t.parquet").to_pydict()
    assert table["rate_word.std"] == [float(row["rate_word.std"]) for row in rows]


def test_finished_points_are_not_run_again_also_by_other_plans(tiny, tmp_path):
    before = finished(tiny / "store")
    count = len(starts(tiny / "store"))
    report = run_json(plan_file(tiny), "--out", tiny / "store")
    assert (report["done"], report["reused"]) == (0, 12)
    assert finished(tiny / "store") == before
    larger = plan_file(tmp_path, boards=5)
    larger.write_text(larger.read_text().replace('"tiny"', '"larger"'))
    report = run_json(larger, "--out", tiny / "store")
    assert (report["points"], report["done"], report["reused"]) == (20, 8, 12)
    ran = [event.point for event in starts(tiny / "store")]
    assert len(ran) == count + 8 == len(set(ran))
    assert {k: v for k, v in finished(tiny / "store").items() if k in before} == before
    code, out, _ = campaign("status", tiny / "store", "--json")
    assert code == 0
    assert [(p["name"], p["points"], p["finished"]) for p in json.loads(out)["plans"]] == [
        ("larger", 20, 20),
        ("tiny", 12, 12),
    ]


def test_workers_batches_and_stores_do_not_matter(tiny, tmp_path):
    expected = finished(tiny / "store")
    plan = plan_file(tiny)
    run_json(plan, "--out", tmp_path / "two", workers=2)
    got = finished(tmp_path / "two")
    assert got == {name: expected[name] for name in got}
    assert len([name for name in got if name.startswith("points")]) == 12
    lanes = plan_file(tmp_path, engine=LANES)
    run_json(lanes, "--out", tmp_path / "lanes")
    with xarray.open_dataset(tiny / "store" / "results" / "tiny.nc") as a:
        with xarray.open_dataset(tmp_path / "lanes" / "results" / "tiny.nc") as b:
            assert a.drop_vars("point").identical(b.drop_vars("point")), "only the engine's name is another"


def test_a_point_alone_has_the_same_bytes(tiny, tmp_path):
    store = Store.open_folder(tiny / "store")
    address = store.addresses()[3]
    code, out, err = campaign("rerun", tiny / "store", address[:9], "--out", tmp_path / "p.h5", "--json")
    assert code == 0, err
    assert json.loads(out) == {
        "address": address,
        "identical": True,
        "bytes": store.point_path(address).stat().st_size,
        "differ": [],
    }
    assert (tmp_path / "p.h5").read_bytes() == store.point_path(address).read_bytes()
    code, _, err = campaign("rerun", tiny / "store", "zz")
    assert (code, err.count("\n")) == (2, 1)
    assert "no finished point begins with 'zz'" in err


def test_a_point_that_is_not_what_it_was_is_seen(tiny, tmp_path):
    run_json(plan_file(tiny), "--out", tmp_path / "s")
    store = Store.open_folder(tmp_path / "s")
    a, b = store.addresses()[:2]
    identity, variables = collect.read_point(store, a)
    from testbench.campaign import shard

    changed = variables | {"drive_frequency_hz": variables["drive_frequency_hz"]._replace(data=1.0)}
    store.publish(a, shard.encode(identity, changed, [0.000125, 0.0005]))
    code, out, _ = campaign("rerun", tmp_path / "s", a)
    assert code == 2
    assert "DIFFERENT" in out
    assert "drive_frequency_hz differs" in out
    data = bytearray(store.point_path(b).read_bytes())
    data[len(data) // 2] ^= 1
    store.point_path(b).write_bytes(data)
    code, _, err = campaign("run", plan_file(tiny), "--out", tmp_path / "s", "--workers", 0)
    assert code == 0
    assert (
        err.count(
            f"{store.point_path(b)}: was changed: its SHA-256 differs from that in the journal; this point is run"
        )
        == 1
    )
    store.reject(b)
    assert run_json(plan_file(tiny), "--out", tmp_path / "s")["done"] == 1


def test_other_sources_are_not_compared(tiny, monkeypatch):
    from testbench.campaign import rerun
    from testbench.campaign.plan import engines
    from testbench.errors import FileError

    monkeypatch.setattr(engines, "source_hash", lambda engine: "f" * 64)
    with pytest.raises(FileError, match="only the same sources"):
        rerun.rerun(tiny / "store", Store.open_folder(tiny / "store").addresses()[0], engine_options=OWN)


def test_show_has_mean_and_spread(tiny):
    code, out, _ = campaign("show", tiny / "store", "tiny", "--json")
    assert code == 0
    found = json.loads(out)
    with xarray.open_dataset(tiny / "store" / "results" / "tiny.nc") as data:
        values = data["rate_word.mean"].values.ravel()
    assert found["numbers"]["rate_word.mean"]["mean"] == pytest.approx(values.mean())
    assert found["numbers"]["rate_word.mean"]["std"] == pytest.approx(values.std(ddof=1))
    code, out, _ = campaign("show", tiny / "store", "tiny")
    assert "12 of 12 points finished" in out


def test_a_plan_without_axes_is_one_point(tmp_path):
    path = tmp_path / "one.toml"
    path.write_text(f'engine = "{INSTANT}"\n[keep.streams]\nrate_word = 1\n')
    run_json(path, "--out", tmp_path / "s")
    with xarray.open_dataset(tmp_path / "s" / "results" / "one.nc") as data:
        assert dict(data.sizes) == {"time_1": 64}
        assert data.rate_word.dtype == np.int64, "every place has its integers"


def test_cases_profiles_and_engines_as_axes(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(
        f'[axes.by]\nengine = ["{INSTANT}", "{LANES}"]\n[axes.motion]\nscenario.rate_dps = [[[0, 0], [1, 9]], 5]\n'
        '[[axes.case.cases]]\nname = "plain"\n[[axes.case.cases]]\nname = "cold"\nscenario.temperature_degc = -40\n'
    )
    assert run_json(path, "--out", tmp_path / "s")["done"] == 8
    with xarray.open_dataset(tmp_path / "s" / "results" / "p.nc") as data:
        assert data.case.values.tolist() == ["plain", "cold"]
        assert data["scenario.temperature_degc"].values.tolist() == [25.0, -40.0]
        assert data["scenario.rate_dps"].values.tolist() == ["[[0, 0], [1, 9]]", "5"]
        assert data["engine"].values.tolist() == [INSTANT, LANES]
        by = data.drive_frequency_hz
        assert (by.isel(by=0) == by.isel(by=1)).all()


# ---- what goes wrong -------------------------------------------------------------------------------------------------


def test_failed_points_leave_the_others_and_are_tried_again(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(f'engine = "{INSTANT}"\n[axes.rate]\nscenario.rate_dps = [0, 1, 2, 5]\n[keep.streams]\nx = 1\n')
    path.write_text(path.read_text().replace("x = 1", "rate_word = 1"))
    code, out, err = campaign("run", path, "--out", tmp_path / "s", "--workers", 2, "--json")
    assert code == 2, err
    report = json.loads(out)
    texts = [failure["error"] for failure in report["failures"]]
    assert report["done"] == 2
    assert texts == [
        "ValueError: this point cannot be simulated",
        "the worker process died 3 times while it ran this point (exit code -9)",
    ]
    with xarray.open_dataset(tmp_path / "s" / "results" / "p.nc") as data:
        assert data.finished.values.tolist() == [1, 0, 0, 1]
        assert np.isnan(data.drive_frequency_hz.values).tolist() == [False, True, True, False]
        assert np.isnan(data.rate_word.values).all(axis=1).tolist() == [False, True, True, False]
        assert data.codes_sha256.values[1] == ""
    code, out, _ = campaign("status", tmp_path / "s")
    assert "2/4 points finished, 1 failed" in out, "a killed worker cannot say so"
    assert "cannot be simulated" in out
    again = json.loads(campaign("run", path, "--out", tmp_path / "s", "--workers", 2, "--json")[1])
    assert (again["reused"], again["done"], len(again["failures"])) == (2, 0, 2)


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(
        f'engine = "{INSTANT}"\n[axes.rate]\nscenario.rate_dps = [4, 5, 6, 3, 7, 8]\n[keep.streams]\nrate_word = 1\n'
    )
    limit = 400_000  # the files of ordinary points are far below it, that of the fourth far above

    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    code, _, err = child("run", path, "--out", tmp_path / "s", "--workers", 1, preexec_fn=small_disk)
    assert code == 2
    errors = [line for line in err.splitlines() if line.startswith("gyro: ")]
    assert len(errors) == 1
    assert "cannot be written: File too large" in errors[0]
    assert "3 of 6 points are finished and kept; run the same command again to continue" in errors[0]
    assert "Traceback" not in err
    store = Store.open_folder(tmp_path / "s")
    assert len(store.addresses()) == 3
    assert not list((store.path / "points").rglob("*.part"))
    before = finished(store.path)
    report = run_json(path, "--out", tmp_path / "s")
    assert (report["reused"], report["done"]) == (3, 3)
    now = finished(store.path)
    assert {name: now[name] for name in before} == before


@pytest.mark.slow
def test_results_on_a_full_disk_leave_the_points(tmp_path):
    plan = plan_file(tmp_path)
    run_json(plan, "--out", tmp_path / "s")
    for path in (tmp_path / "s" / "results").iterdir():
        path.unlink()
    limit = 16_000

    def small_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    code, _, err = child("collect", tmp_path / "s", preexec_fn=small_disk)
    assert (code, err.count("\n")) == (2, 1)
    assert "results/tiny.nc: cannot be written: File too large" in err
    assert list((tmp_path / "s" / "results").iterdir()) == []
    code, out, _ = campaign("collect", tmp_path / "s")
    assert (code, len(out.splitlines())) == (0, 2)


@pytest.mark.slow
def test_two_campaigns_do_not_share_a_store_at_once(tmp_path):
    plan = plan_file(tmp_path, boards=20)
    first = start("run", plan, "--out", tmp_path / "s", "--workers", 1, GYRO_INSTANT_S="0.1")
    try:
        until = time.monotonic() + 60
        while not (tmp_path / "s" / "journal").is_dir() or not list((tmp_path / "s" / "journal").iterdir()):
            assert time.monotonic() < until
            time.sleep(0.05)
        code, _, err = campaign("run", plan, "--out", tmp_path / "s")
        assert (code, err.count("\n")) == (2, 1)
        assert f"another campaign is running in this store: process {first.pid} on " in err
        code, out, _ = campaign("status", tmp_path / "s")
        assert f"running: process {first.pid}" in out
        first.send_signal(signal.SIGINT)
        _, err = first.communicate(timeout=60)
        assert first.returncode == 130
        assert "interrupted" in err
        assert "run the same command again to continue" in err
        assert "Traceback" not in err
    finally:
        first.kill()
    assert not Store.open_folder(tmp_path / "s").busy()
    ended = len(Store.open_folder(tmp_path / "s").addresses())
    assert run_json(plan, "--out", tmp_path / "s")["reused"] == ended


def test_folders_that_are_no_stores(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.doc").write_text("x")
    code, _, err = campaign("run", plan_file(tmp_path), "--out", tmp_path / "full")
    assert (code, err.count("\n")) == (2, 1)
    assert "is neither empty nor a store of campaigns" in err
    assert os.listdir(tmp_path / "full") == ["thesis.doc"]
    code, _, err = campaign("status", tmp_path / "nowhere")
    assert (code, err.count("\n")) == (2, 1)
    assert "is not a store of campaigns" in err
    assert not (tmp_path / "nowhere").exists()


def test_workers_that_all_die_end_the_campaign(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(
        f'engine = "{INSTANT}"\n[set]\nscenario.rate_dps = 2\n[axes.seed]\nnoise.seed = {{ range = [1, 50] }}\n'
    )
    code, _, err = campaign("run", path, "--out", tmp_path / "s", "--workers", 2)
    assert code == 2
    assert "worker processes died before any point was finished (exit code -9)" in err
