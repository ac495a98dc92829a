"""Law files: what is written is read back, runs switch it on, golden vectors come out of it; damage is one line."""

import pytest
from numba import config as numba_config

from testbench import config
from testbench.config import law_file
from testbench.config.law_file import LawFile
from testbench.errors import ConfigError
from testbench.golden.bundles import bundle, effect

FOUND = LawFile("x_cubed", ("force_x = -2500000000.0 x^3",), (1.2e7,), (("record", "bench.h5"),))


def test_what_is_written_is_read_back(tmp_path):
    law_file.write(tmp_path / "found.toml", FOUND)
    assert law_file.read(tmp_path / "found.toml") == FOUND


def test_a_configuration_takes_its_laws_in(tmp_path):
    law_file.write(tmp_path / "found.toml", FOUND)
    text = '[effects]\nfiles = ["found.toml"]\nlaws = ["cv_y = 1e-06 u"]\n'
    (tmp_path / "run.toml").write_text(text)
    loaded = config.load(tmp_path / "run.toml")
    assert loaded.effects.laws == ["cv_y = 1e-06 u", *FOUND.laws]
    # a record carries the laws themselves
    (tmp_path / "again.toml").write_text(config.to_toml(loaded))
    assert config.load(tmp_path / "again.toml") == loaded


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('schema = "gyrolaw/2"', "schema"),
        ('schema = "gyrolaw/1.0"\nname = "a b"\nlaws = ["force_x = 1.0 x"]', "name"),
        ('schema = "gyrolaw/1.0"\nname = "a"\nlaws = []', "laws"),
        ('schema = "gyrolaw/1.0"\nname = "a"\nlaws = ["force_x = 1.0 q"]', "none of"),
        ('schema = "gyrolaw/1.0"\nname = "a"\nlaws = ["force_x = 1.0 x"]\nsd = [1.0, 2.0]', "sd"),
        ('schema = "gyrolaw/1.0"\nname = "a"\nlaws = ["force_x = 1.0 x"]\nmore = 1', "more"),
        ("schema = ", "TOML"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(tmp_path, text, said):
    (tmp_path / "law.toml").write_text(text)
    with pytest.raises(ConfigError, match=said) as refused:
        law_file.read(tmp_path / "law.toml")
    assert "\n" not in str(refused.value)
    assert "law.toml" in str(refused.value)


def test_files_of_a_configuration_are_names(tmp_path):
    (tmp_path / "run.toml").write_text("[effects]\nfiles = [3]\n")
    with pytest.raises(ConfigError, match=r"effects\.files"):
        config.load(tmp_path / "run.toml")


def test_too_many_or_wrong_laws_are_refused_with_their_key():
    for laws, said in (
        (["force_x = 1.0 x"] * 9, "limit 8"),
        (["force_q = 1.0 x"], "PORT"),
        ("force_x", "list of texts"),
    ):
        with pytest.raises(ConfigError, match=said) as refused:
            config.from_dict({"effects": {"laws": laws}})
        assert "effects.laws" in str(refused.value)


@pytest.mark.skipif(numba_config.DISABLE_JIT, reason="minutes without the compiler")
def test_golden_vectors_of_a_loop_with_an_effect(tmp_path):
    law_file.write(tmp_path / "found.toml", FOUND)
    folder, manifest = effect.export("found", effect.case([tmp_path / "found.toml"], frames=24), tmp_path / "out")
    assert bundle.verify(folder) == manifest
    assert folder == tmp_path / "out" / "top" / "found"
    with pytest.raises(ConfigError, match="no effect"):
        effect.case()
