"""Plans: which points they have, what addresses depend on, one line for everything that is wrong."""

import json

import pytest

from testbench.campaign.plan import plan as plans
from testbench.campaign.plan import plan_points as point
from testbench.campaign.plan import stored
from testbench.campaign.plan.plan_points import point_address, read_task
from testbench.commands import main as cli
from testbench.config import load
from testbench.errors import FileError

HEAD = "[set]\nscenario.seconds = 0.5\n"


def written(tmp_path, text, name="plan.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def points_of(tmp_path, text, sets=()):
    return plans.points(plans.read(written(tmp_path, text), sets))[0]


def config_of(one):
    return read_task(one.identity, "/states").config


def test_axes_are_multiplied_and_what_one_axis_holds_moves_together(tmp_path):
    text = HEAD + (
        "[axes.temperature]\nscenario.temperature_degc = [-40, 25.0, 85]\n"
        "[axes.corner]\nplant.fx_hz = [11000, 11010.0]\nscenario.rate_dps = [5, [[0, 0], [0.1, 10]]]\n"
    )
    found = points_of(tmp_path, text)
    assert [p.index for p in found] == [(a, b) for a in range(3) for b in range(2)]
    assert [p.number for p in found] == list(range(6))
    seen = [(c.scenario.temperature_degc, c.plant.fx_hz, c.scenario.rate_dps) for c in map(config_of, found)]
    assert seen[:2] == [(-40.0, 11000.0, 5.0), (-40.0, 11010.0, [[0.0, 0.0], [0.1, 10.0]])]
    assert seen[5][0] == 85.0
    assert {c.scenario.seconds for c in map(config_of, found)} == {0.5}
    assert len({p.address for p in found}) == 6
    assert all(point_address(p.identity) == p.address for p in found)


def test_a_point_without_axes_is_the_configuration(tmp_path):
    (one,) = points_of(tmp_path, HEAD)
    expected = load(None, ["scenario.seconds=0.5"]).model_dump(exclude={"output"})
    assert config_of(one).model_dump(exclude={"output"}) == expected
    assert config_of(one).output.record is False


def test_base_set_and_option_in_this_order(tmp_path):
    written(
        tmp_path, "[plant]\nfx_hz = 11001.0\nqx = 90000.0\n[output]\ndirectory = 'x'\n[noise]\nseed = 9\n", "b.toml"
    )
    text = 'base = "b.toml"\n[set]\nplant.fx_hz = 11002.0\nnoise.seed = 8\n'
    (one,) = points_of(tmp_path, text, ["noise.seed=7"])
    config = config_of(one)
    assert (config.plant.fx_hz, config.plant.qx, config.noise.seed) == (11002.0, 90000.0, 7)


def test_cases_leave_the_rest_as_it_was(tmp_path):
    text = HEAD + (
        'plant.fx_hz = 11005.0\n[[axes.case.cases]]\nname = "plain"\n'
        '[[axes.case.cases]]\nname = "cold"\nscenario.temperature_degc = -40\n"plant.fx_hz" = 11020\n'
    )
    plan = plans.read(written(tmp_path, text))
    plain, cold = map(config_of, plans.points(plan)[0])
    assert (plain.plant.fx_hz, plain.scenario.temperature_degc) == (11005.0, 25.0)
    assert (cold.plant.fx_hz, cold.scenario.temperature_degc) == (11020.0, -40.0)
    (axis,) = plan.axes
    assert [plans.value_at(plan, axis, "plant.fx_hz", k) for k in (0, 1)] == [11005.0, 11020]
    assert [plans.value_at(plan, axis, "scenario.temperature_degc", k) for k in (0, 1)] == [25.0, -40]


def test_the_engine_may_be_an_axis(tmp_path):
    found = points_of(tmp_path, HEAD + '[axes.by]\nengine = ["frame", "clocked"]\n')
    assert [json.loads(p.identity)["engine"] for p in found] == ["frame", "clocked"]
    assert len({p.address for p in found}) == 2


def test_addresses_depend_on_what_a_result_depends_on_and_on_nothing_else(tmp_path, monkeypatch):
    def address(text, sets=()):
        return points_of(tmp_path, text, sets)[0].address

    same = address(HEAD)
    assert same == address('name = "other"\n' + HEAD), "the name of a plan"
    assert same == address(HEAD + "plant.fx_hz = 11002.3\n"), "a default that is written down"
    assert same == address(HEAD + "scenario.rate_dps = 0\n"), "0 and 0.0 are one rate"
    assert same == address(HEAD + "[axes.a]\nnoise.seed = [1, 2]\n"), "other points"
    others = [
        address(HEAD, ["noise.seed=2"]),
        address('engine = "clocked"\n' + HEAD),
        address(HEAD + "[keep.streams]\nrate_word = 8\n"),
        address(HEAD + '[keep.statistics]\nrate_word = ["mean"]\n'),
    ]
    monkeypatch.setattr(point.engines, "source_hash", lambda engine: "0" * 64)
    others.append(address(HEAD))
    assert len({same, *others}) == 6


def test_a_state_file_counts_by_its_bytes(tmp_path):
    (tmp_path / "a.h5").write_bytes(b"one")
    (tmp_path / "b.h5").write_bytes(b"one")
    (tmp_path / "c.h5").write_bytes(b"two")
    a, b, c = (points_of(tmp_path, HEAD + f'scenario.resume = "{n}.h5"\n')[0] for n in "abc")
    assert a.address == b.address != c.address
    assert config_of(a).scenario.resume.startswith("/states/")
    _, states = plans.points(plans.read(written(tmp_path, HEAD + 'scenario.resume = "a.h5"\n')))
    assert list(states.values()) == [tmp_path / "a.h5"]


def test_draws_of_an_axis_survive_more_points(tmp_path):
    text = HEAD + "[axes.board]\ncount = {}\nseed = 4\nplant.fx_hz = {{ normal = [11002.3, 5] }}\n"
    few, many = points_of(tmp_path, text.format(3)), points_of(tmp_path, text.format(9))
    assert [p.address for p in few] == [p.address for p in many[:3]]


def test_a_plan_comes_back_from_the_store(tmp_path):
    text = HEAD + (
        "[axes.t]\nscenario.temperature_degc = [1, 2]\n[keep]\ntau_s = [0.001]\nstreams.rate_word = 2\n"
        'statistics.rate_word = ["adev"]\n[[axes.c.cases]]\nname = "x"\n'
    )
    plan = plans.read(written(tmp_path, text))
    addresses = [point.address for point in plans.points(plan)[0]]
    (tmp_path / f"{plan.name}.json").write_text(stored.plan_json(plan, addresses))
    back, kept = stored.read(tmp_path / f"{plan.name}.json")
    assert kept == tuple(addresses)
    assert back.axes == plan.axes
    assert back.keep == plan.keep
    assert back.shape == (2, 1)


MISTAKES = [
    ("nam = 'x'", "nam is not a key of a plan; did you mean name?"),
    ("[plant]\nfx_hz = 1", "plant is not a key of a plan; write [set] plant"),
    ("name = 'a b'", "is not made of letters"),
    ("engine = 'farme'", "'farme' is not an engine; did you mean frame?"),
    ("base = 'nowhere.toml'", "nowhere.toml: cannot be read"),
    ("base = 3", "base = 3 is not the name of a file"),
    ("[set]\nplant.fx_khz = 11", "plant.fx_khz is not a known key; this quantity is in Hz: plant.fx_hz = 11000"),
    ("[set]\nplant.fx_hz = '11 kHz'", "write fx_hz = 11000"),
    ("[set]\nfx_hz = 3", "fx_hz is not of the form section.key"),
    ("[set]\noutput.directory = 'x'", "choose what it stores in [keep]"),
    ("[set]\nscenario.engine = 'frame'", "the engine of a campaign is the plan's key engine"),
    ("[set]\nengine = 'frame'", "write it above [set]"),
    ("set = 3", "set = 3 is not a table"),
    ("[axes.a]", "[axes.a] has no parameters"),
    ("[axes.a]\nplant.fx_hz = []", "plant.fx_hz = [] has no values"),
    ("[axes.a]\nplant.fxx_hz = [1]", "[axes.a]: plant.fxx_hz is not a known key; did you mean plant.fx_hz? (point 0)"),
    ("[axes.a]\nplnt.fx_hz = [1]", "[plnt] is not a known section; did you mean [plant]?"),
    ("[axes.a]\nplant.fx_hz = [11000, 1e9]", "plant.fx_hz = 1000000000.0 is above the limit"),
    ("[axes.a]\nplant.fx_hz = {normal = [11000, 1]}", "draws its values without a count; write count = NUMBER"),
    ("[axes.a]\ncount = 0\nplant.fx_hz = {normal = [11000, 1]}", "count = 0 is not an integer of at least 1"),
    ("[axes.a]\nplant.fx_hz = [1, 2]\nplant.fy_hz = [1]", "but needs equal ones: plant.fx_hz 2, plant.fy_hz 1"),
    ("[axes.a]\ncount = 3\nplant.fx_hz = [1, 2]", "but needs equal ones: count 3, plant.fx_hz 2"),
    ("[axes.a]\nnoise.seed = [1]\n[axes.b]\nnoise.seed = [2]", "[axes.b] noise.seed is already set in [axes.a]"),
    ("[set]\nnoise.seed = 3\n[axes.b]\nnoise.seed = [2]", "noise.seed is already set in [set]"),
    ("[axes.rate_word]\nnoise.seed = [1]", "is not a valid name of an axis"),
    ("[axes.time_8]\nnoise.seed = [1]", "is not a valid name of an axis"),
    ("[axes.a]\nnoise.seed = {range = [1, 200000]}", "200000 values, above the limit 100000"),
    (
        "[axes.a]\nnoise.seed = {range = [1, 1000]}\n[axes.b]\nplant.fx_hz = {linspace = [11000, 11001, 1000]}",
        "a 1000 x b 1000 = 1000000 points are above the limit 100000",
    ),
    ("[axes.a]\nengine = ['frame', 'fast']", "'fast' is not an engine"),
    ("[axes.a]\ncases = []", "is not a list of at least one table"),
    ("[[axes.a.cases]]\nnoise.seed = 1", "cases[0].name"),
    ("[[axes.a.cases]]\nname = 'x'\n[[axes.a.cases]]\nname = 'x'", 'cases[1].name = "x" is not a unique text'),
    ("[keep]\nstream = 1", "stream is not a key; did you mean streams?"),
    ("[keep.streams]\nrate_wrd = 1", "rate_wrd is not a stream; did you mean rate_word?"),
    ("[keep.streams]\nrate_word = 0", "rate_word = 0 is not an integer of at least 1"),
    ("[keep.streams]\nrate_word = 8001", "above the limit 8000 frames"),
    ("[keep.statistics]\nrate_word = 'mean'", "is not a list of names"),
    ("[keep.statistics]\nrate_word = ['men']", "did you mean mean?"),
    ("[keep.statistics]\nrate_word = ['adev']", "adev needs tau_s"),
    ("[keep]\ntau_s = [0.0001]", "0.0001 s is not a multiple of 1 frames of 125 us"),
    ("[keep]\nframes = 8\ntau_s = [0.0005]", "not a multiple of 8 frames"),
    ("[keep]\ntau_s = ['1 s']", "is not a number above 0 s"),
    (
        "[axes.a]\ndesign.frame_ticks = [125, 100]\n[keep]\nstreams.rate_word = 1",
        "[keep.streams]: points with 8000, 10000 frames a second have no common time axis",
    ),
    (
        "[axes.a]\ndesign.frame_ticks = [125, 100]\n[keep]\ntau_s = [0.125, 0.000375]",
        "0.000375 s is not a multiple of 1 frames of 100 us (0.0001 s) (point 1)",
    ),
    ("[set]\nscenario.resume = 'nowhere.h5'", "scenario.resume"),
]


@pytest.mark.parametrize(("text", "wanted"), MISTAKES)
def test_one_line_for_a_mistake(tmp_path, capsys, text, wanted):
    path = written(tmp_path, text)
    with pytest.raises(SystemExit) as caught:
        cli.main(["campaign", "run", str(path), "--out", str(tmp_path / "store")])
    said = capsys.readouterr()
    assert caught.value.code == 2
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert wanted in said.err
    assert not (tmp_path / "store").exists()


def test_check_says_what_would_run(tmp_path, capsys):
    path = written(tmp_path, HEAD + "[axes.t]\nscenario.temperature_degc = [1, 2, 2]\n[axes.s]\nnoise.seed = [1, 5]\n")
    with pytest.raises(SystemExit) as caught:
        cli.main(["campaign", "check", str(path)])
    assert caught.value.code == 0
    assert "6 points, 4 of them different" in capsys.readouterr().out


def test_a_point_of_another_version_is_refused():
    with pytest.raises(FileError, match="schema 'gyropoint/9'"):
        read_task('{"schema": "gyropoint/9"}', "/states")
    with pytest.raises(FileError, match="cannot read"):
        read_task(
            '{"schema":"gyropoint/1","config":{"scenario":{"resume":""},"plant":{"gone":1}},"keep":{}}', "/states"
        )
