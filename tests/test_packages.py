"""Wheel and sdist in environments of their own: `python -m tests.packages` finds nothing that is not as it must be."""

import zipfile

import pytest

from tests import packages


def test_the_tutorial_says_which_hash_an_installed_package_must_give():
    assert packages.wanted_hash() == "4987a6202059b500"


def test_a_file_that_an_archive_lacks_is_named(tmp_path):
    wheel = tmp_path / "a.whl"
    files = [p for package in packages.PACKAGES for p in (packages.ROOT / package).rglob("*") if p.is_file()]
    with zipfile.ZipFile(wheel, "w") as archive:
        for path in files:
            if path.name not in ("scores.json", "block.v.in"):
                archive.writestr(path.relative_to(packages.ROOT).as_posix(), "")
    assert packages.missing(wheel) == [
        "testbench/golden/bundles/benches/templates/block.v.in",
        "testbench/golden/bundles/scores.json",
    ]


def test_no_interpreter_is_one_line(tmp_path):
    with pytest.raises(packages.Failed, match="nothing: no interpreter"):
        packages.interpreter(str(tmp_path / "nothing"))


@pytest.mark.slow
def test_wheel_and_sdist_work_elsewhere_for_a_user_without_name_and_home(capfd):
    code = packages.main([])
    shown = capfd.readouterr()
    assert code == 0, f"{shown.out}\n{shown.err}"
