"""Stages of a study: what is kept is read again only as it was written, and one process works in a folder."""

import json
import os
import signal
import typing

import pytest

from testbench import config
from testbench.campaign.plan import plan
from testbench.errors import ConfigError, FileError
from testbench.paper import cases, paper_study, stages
from testbench.paper.calibration import calibrations

RESULT = {"cases_deg": {"1": {"xe1": 1.5}}, "detuning": [0.1, None, float("inf")]}
DAMAGES = {
    "empty": lambda text: "",
    "half": lambda text: text[: len(text) // 2],
    "list": lambda text: "[]",
    "null": lambda text: "null",
    "huge_integer": lambda text: "7" * 5000,
    "deep": lambda text: "[" * 100_000,
    "edited": lambda text: text.replace("1.5", "2.5"),
    "no_result": lambda text: text.replace('"result"', '"results"'),
    "no_hash": lambda text: text.replace('"sha256"', '"sha255"'),
}


@pytest.fixture
def calls(monkeypatch):
    """Calls of the calibration, which gives `RESULT`."""
    made = []

    def many(*args, **kwargs):
        made.append(args)
        return [RESULT]

    monkeypatch.setattr(calibrations, "many", many)
    return made


def calibrated(folder):
    return paper_study.Study(config.Config(), folder, paper_study.SMALL).calibration()


def test_a_stage_is_done_once(calls, tmp_path):
    assert calibrated(tmp_path) == calibrated(tmp_path) == RESULT
    assert len(calls) == 1


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_stage_is_done_again(calls, tmp_path, damage):
    calibrated(tmp_path)
    path = tmp_path / "calibration.json"
    whole = path.read_text()
    path.write_text(DAMAGES[damage](whole))
    assert calibrated(tmp_path) == RESULT
    assert len(calls) == 2
    assert json.loads(path.read_text())["sha256"] == json.loads(whole)["sha256"]


def squared(number, folder):
    """A job that leaves a trace of each call."""
    (folder / f"called_{number}_{os.getpid()}").touch()
    return {"square": number**2, "third": number / 3}


def died():
    os.kill(os.getpid(), signal.SIGKILL)


def jobs_of(folder, count=5):
    return [stages.Job(f"job_{k}", [k], squared, (k, folder)) for k in range(count)]


def test_processes_and_this_one_leave_the_same_bytes(tmp_path):
    for name, workers in (("here", 0), ("pool", 2)):
        (tmp_path / name).mkdir()
        made = stages.Stages(tmp_path / name, config.Config(), workers)
        assert made.results(jobs_of(tmp_path))["job_3"] == {"square": 9, "third": 1.0}
        assert set(made.seconds) == {f"job_{k}" for k in range(5)}
    for k in range(5):
        here, pool = (tmp_path / name / f"job_{k}.json" for name in ("here", "pool"))
        assert here.read_bytes() == pool.read_bytes()
        assert "seconds" not in here.read_text()
    assert len({path.name.split("_")[-1] for path in tmp_path.glob("called_*")} - {str(os.getpid())}) == 2, (
        "two workers"
    )


def test_a_stage_is_done_again_only_if_it_must(tmp_path):
    stages.Stages(tmp_path, config.Config(), 0).results(jobs_of(tmp_path))
    count = len(list(tmp_path.glob("called_*")))
    for path in tmp_path.glob("called_*"):
        path.unlink()
    (tmp_path / "job_2.json").write_text("{}")
    stages.Stages(tmp_path, config.Config(), 0).results(jobs_of(tmp_path))
    assert [path.name.split("_")[1] for path in tmp_path.glob("called_*")] == ["2"]
    other = config.changed(config.Config(), {"noise.seed": 9})
    stages.Stages(tmp_path, other, 0).results(jobs_of(tmp_path))
    assert len(list(tmp_path.glob("called_*"))) == count == 5, "another configuration is another stage"


def test_a_worker_that_dies_is_one_line(tmp_path):
    made = stages.Stages(tmp_path, config.Config(), 2)
    with pytest.raises(FileError, match="a worker process died; start the command again"):
        made.results([stages.Job("dead", 0, died, ()), *jobs_of(tmp_path, 2)])


def test_damaged_timings_do_not_matter(tmp_path):
    made = stages.Stages(tmp_path, config.Config(), 0)
    (tmp_path / stages.TIMINGS).write_text('{"seconds": "long"}')
    assert made.seconds == {}
    made.save_duration("x", 1.5)
    assert json.loads((tmp_path / stages.TIMINGS).read_text()) == {"seconds": {"x": 1.5}}


def test_a_fifo_is_not_waited_for(calls, tmp_path):
    os.mkfifo(tmp_path / "calibration.json")
    assert calibrated(tmp_path) == RESULT


def test_one_process_at_a_time(tmp_path):
    one, other = (paper_study.Study(config.Config(), tmp_path, paper_study.SMALL) for _ in range(2))
    with one.lock_folder():
        with pytest.raises(FileError, match=rf"another study is running in this folder: process {os.getpid()} on "):
            with other.lock_folder():
                pass
    with other.lock_folder():
        pass


def test_a_file_in_the_place_of_the_folder_is_one_line(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(FileError, match="file: cannot be written"):
        paper_study.Study(config.Config(), tmp_path / "file")


# ---- every key of the configuration ----------------------------------------------------------------------------------

LISTS = {
    "effects.drive_dac_levels": ["bit 11 = 0.09"],
    "effects.sense_dac_levels": ["bit 11 = 0.09"],
    "effects.adc_curve": [1e-6],
    "effects.laws": ["force_x = -2.5e9 x^3"],
}
FREE = {"firmware.adc_clock": "free_running"}
NEEDED = {"plant.adc_clock_ppm": FREE, "nominal.adc_clock_ppm": FREE}  # what a key's other values go with
OWN = ("scenario", "output")
SECTIONS = {name: field.annotation for name, field in config.Config.model_fields.items()}
KEYS = [(section, key) for section, kind in SECTIONS.items() for key in kind.model_fields if section not in OWN]


def other_values(section, key):
    """Values of a key that are not its default; not all may be allowed."""
    field = SECTIONS[section].model_fields[key]
    default = field.default
    if f"{section}.{key}" in LISTS:
        return [LISTS[f"{section}.{key}"]]
    if isinstance(default, bool):
        return [not default]
    if typing.get_origin(field.annotation) is typing.Literal:
        return [value for value in typing.get_args(field.annotation) if value != default]
    limits = [getattr(limit, end) for limit in field.metadata for end in ("ge", "le") if hasattr(limit, end)]
    near = [default * 1.01, default * 0.99, sum(limits) / 2]
    return [v for v in [type(default)(v) for v in (*near, *limits)] + [default + 1, default - 1] if v != default]


def board_with(section, key):
    """A configuration whose key has another value than the default."""
    path = f"{section}.{key}"
    for value in other_values(section, key):
        try:
            return config.changed(config.Config(), {path: value} | NEEDED.get(path, {}))
        except ConfigError:
            continue
    raise AssertionError(f"no other value found for {path}")


def test_every_key_reaches_the_points(tmp_path):
    """Each key of each section but [scenario] and [output], one at a time: the points' configuration has its value."""
    words = dict.fromkeys(cases.PHASE_REGISTERS, 1.25)
    for section, key in KEYS:
        wanted = board_with(section, key)
        paper_study.check(wanted)
        # case 1 is the words that the board had before its calibration, as `calibrate` returns them
        begin = {name: getattr(wanted.firmware, f"{name}_deg") for name in cases.PHASE_REGISTERS}
        made = plan.read(cases.write_plan(tmp_path / "p.toml", wanted, {"1": begin, "2": words}, 10.0, (25.0, 50.0)))
        first, last = (config.from_dict(plan.point_config_tree(made, index)[0]) for index in ((0, 0), (1, 1)))
        for kept in SECTIONS.keys() - set(OWN):
            assert getattr(first, kept) == getattr(wanted, kept), f"{section}.{key}"
        assert last == config.changed(
            first, {"scenario.temperature_degc": 50.0, **{f"firmware.{n}_deg": v for n, v in words.items()}}
        )


def test_the_campaign_is_of_the_studys_board(calls, monkeypatch, tmp_path):
    """`Study.plan` and the calibration get the configuration whole: a key of each section."""
    wanted = config.changed(
        config.Config(),
        {"plant.qx": 1e5, "firmware.ftr_zero_hz": 90.0, "noise.cv": False, "effects.feedthrough_y": 1e-6,
         "nominal.q_tolerance": 3.0},
    )  # fmt: skip
    job = paper_study.Study(wanted, tmp_path, paper_study.SMALL)
    sets = {str(k): dict.fromkeys(cases.PHASE_REGISTERS, float(k)) for k in paper_study.SMALL.case_numbers}
    monkeypatch.setitem(RESULT, "cases_deg", sets)
    points, _ = plan.points(job.plan())
    assert len(points) == 2
    assert calls[0][0] == wanted
    for section in SECTIONS.keys() - {*OWN, "firmware"}:
        assert all(json.loads(point.identity)["config"][section] == wanted.model_dump()[section] for point in points)


@pytest.mark.parametrize("text", ["scenario.seconds=5.0", 'scenario.engine="clocked"', "output.pictures=false"])
def test_scenario_and_output_are_refused(text, tmp_path):
    with pytest.raises(ConfigError, match=f"{text.split('=')[0]} = .*the study of the paper sets"):
        paper_study.Study(config.load(None, [text]), tmp_path)
