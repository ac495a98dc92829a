"""Converters against a source: the meter, the source or nobody is blamed, by the data alone."""

import numpy as np
import pytest

from analog_frontend.parts import adc
from testbench.errors import FileError
from testbench.measured.exam.staged import add_in_stages
from testbench.measured.formats import meters_csv
from testbench.measured.nulls import nulls
from testbench.measured.openers import open_problem
from tests.testbench.measured.parts import made


def plain(volts, warmth):
    return 0.0


def test_one_meters_turnover_is_that_meters(tmp_path):
    laws = {"p": plain, "q": lambda v, w: 4.0 * abs(v) / 10, "r": plain}
    path = made.meters(tmp_path / "no name.txt", np.random.default_rng(1), laws)
    found = add_in_stages(open_problem([path], {}), most=6).json
    assert (found["verdict"], found["effects"][0]["law"]) == ("candidate", "q: turnover"), (
        "one file: nothing confirms it"
    )
    assert abs(found["effects"][0]["value"] - 4.0) < 4 * found["effects"][0]["sd"]
    assert all(row["after"] < 1.5 * row["floor"] for row in found["heldout"].values())


def test_the_range_is_that_of_the_file(tmp_path):
    """The same relative error of meters on 1 V and on 100 V: the largest voltage of the file is the unit."""
    found = []
    for full in (1.0, 100.0):
        laws = {"p": plain, "q": lambda v, w, full=full: 4.0 * abs(v) / full}
        path = made.meters(tmp_path / f"{full}", np.random.default_rng(6), laws, full_v=full)
        found.append(add_in_stages(open_problem([path], {}), most=2).json["effects"][0])
    assert [e["law"] for e in found] == ["q: turnover"] * 2
    assert [e["full_v"] for e in found] == [1.0, 100.0]
    assert all(abs(e["value"] - 4.0) < 4 * e["sd"] for e in found)


def test_an_error_in_all_meters_is_the_sources(tmp_path):
    laws = {"p": plain, "q": plain, "r": plain}
    path = made.meters(tmp_path / "k2001.csv", np.random.default_rng(2), laws, sign_uv=1.5, order="sweep")
    found = add_in_stages(open_problem([path], {}), most=6).json
    assert found["effects"][0]["law"] == "source: polarity offset"
    assert found["effects"][0]["kind"] == "instrument"


def test_gain_with_temperature_is_told_from_a_curve(tmp_path):
    laws = {"p": lambda v, w: 6.0 * w * v / 10, "q": plain}
    path = made.meters(tmp_path / "a", np.random.default_rng(3), laws)
    assert add_in_stages(open_problem([path], {}), most=6).json["effects"][0]["law"] == "p: gain with temp"


def test_meters_without_an_effect_gain_none(tmp_path):
    path = made.meters(tmp_path / "a", np.random.default_rng(4), {"p": plain, "q": plain})
    assert nulls(open_problem([path], {}), 4) == [[]] * 4


def test_one_meter_alone_cannot_say_whose_it_is(tmp_path):
    path = made.meters(tmp_path / "a", np.random.default_rng(5), {"p": lambda v, w: 4.0 * abs(v) / 10})
    found = add_in_stages(open_problem([path], {}), most=2).json
    assert (found["verdict"], found["effects"][0]["port"]) == ("candidate", "adc or source")
    assert found["effects"][0]["status"] == "confounded"


def test_the_converters_errors_are_the_stated_ones():
    p = adc.design(turnover=(1e-3,) * 5, gain_tc_per_k=(1e-4,) * 5, memory=(1e-2,) * 5, curve=(1e-3,))
    v, sensor = -0.7, adc.SENSOR_V_AT_25_DEGC + 10 * adc.SENSOR_V_PER_K
    u = v / 4.0
    wanted = v * (1 + 1e-3) + 1e-3 * abs(v) + 1e-2 * 0.3 + 4.0 * 1e-3 * (2 * u * u - 1)
    assert adc.erroneous(p, 0, v, 0.3, sensor) == pytest.approx(wanted, rel=1e-12)
    assert adc.design().errors_on == (0,) * 5


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("a;b\n", "line 1"),
        ("date;source;m;\n01012020-00:00:00;1;x;\n", "line 2"),
        ("date;source;m;\n01012020-00:00:00;1;\n", "2 columns"),
        ("date;source;m;\n01012020-00:00:00;1;nan;\n", "finite"),
        ("date;source;m;\n01012020-00:00:00;1;2;\n", "points"),
    ],
)
def test_a_file_of_another_form_is_refused(tmp_path, text, wanted):
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=wanted):
        meters_csv.read(path)
