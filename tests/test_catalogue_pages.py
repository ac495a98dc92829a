"""Pages of effects: everything in the catalogue has an id, a section and a table, and a new effect is one file."""

import hashlib
import importlib
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from analog_frontend.effects import (
    acceleration,
    bias_cubic,
    catalogue,
    damping_coupling,
    parasitic_mode,
    sid_absorption,
)
from analog_frontend.parts import device
from fpga_model import jit
from testbench import config
from testbench.console import results
from testbench.storage import sources

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "docs"))

import effects_pages  # noqa: E402

PAGE = (ROOT / "docs" / "effects.md").read_text()
TABLES = {one.title: one for one in results.read_results("effects")[1]}
OWN_KERNELS = ("duffing", "drive_cubic", "feedthrough_y")


def rows(text):
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]


def cell(name, what, unit):
    """Number of a measured table."""
    (change,) = (row[1] for row in TABLES[name].rows if row[0] == what)
    return float(change.removesuffix(f" {unit}"))


def test_every_effect_has_an_id_of_its_own_and_no_candidate_is_left_out():
    """Own ids are unique; with those of parameters of parts they count from 1 without a gap."""
    own = [effect.IDS.split(", ")[0] for effect in catalogue.LAWS]
    assert len(set(own)) == len(own)
    parameters = [row[0] for row in rows(PAGE) if re.match(r"[EN]\d", row[0])]
    listed = {one for ids in (*(effect.IDS for effect in catalogue.LAWS), *parameters) for one in ids.split(", ")}
    for kind in "EN":
        numbers = {int(re.fullmatch(r"[EN](\d\d)[a-z]?", one)[1]) for one in listed if one[0] == kind}
        assert numbers == set(range(1, max(numbers) + 1)), f"the next free id is {kind}{len(numbers) + 1:02d}"
    assert {"E24", "N04"} < listed


def test_what_the_tables_name_exists():
    sections = {"effects": config.Effects, "plant": config.Plant, "firmware": config.Firmware, "noise": config.Noise}
    sections["scenario"] = config.Scenario
    named = re.findall(r"`(effects|plant|firmware|noise|scenario)\.(\w+)`", PAGE)
    named += [("effects", effect.INFO.name) for effect in catalogue.LAWS]
    named += [key.split(".") for key in effects_pages.KEYS.values()]
    assert len(named) > 60
    for section, key in named:
        assert key in sections[section].model_fields or key in ("files",), f"{section}.{key}"


def test_order_of_the_catalogue_is_kept_and_an_unknown_name_is_refused(capsys):
    names = [effect.INFO.name for effect in catalogue.LAWS]
    assert names == [*catalogue.FIRST, *sorted(set(names) - set(catalogue.FIRST))]
    assert effects_pages.main(["no_such_effect"]) == 2
    assert "no_such_effect: not among damping_cubic, " in capsys.readouterr().err


def test_measured_tables_are_those_of_the_catalogue():
    command, tables = results.read_results("effects")
    assert command == effects_pages.COMMAND
    assert [one.title for one in tables] == [effect.INFO.name for effect in catalogue.LAWS]
    for effect, one in zip(catalogue.LAWS, tables):
        wanted = effects_pages.table(effect, (0.0,) * 5)
        assert one._replace(rows=[]) == wanted._replace(rows=[])
        assert [row[0] for row in one.rows] == [row[0] for row in wanted.rows]
        for found, zero in zip(one.rows, wanted.rows):
            assert re.fullmatch(r"[+-]\d+\.\d+ \S+", found[1])
            assert re.sub(r"\d+", "0", found[1])[1:] == re.sub(r"\d+", "0", zero[1])[1:]


@pytest.mark.parametrize("effect", catalogue.LAWS, ids=lambda e: e.INFO.name)
def test_a_page_says_physics_source_fingerprint_and_what_it_changes(effect):
    """The built page: the docstring says the physics, and the section below it the rest."""
    section, info = effects_pages.effect_section(effect.__name__), effect.INFO
    assert effect.__doc__.strip()
    assert section == effects_pages.effect_section(info.name)
    for text in ("**Source.**", "**Laws**", "**Fingerprint.**", info.fingerprint[1:], info.source[1:], "| change |"):
        assert text in section
    for text in (info.port, info.mechanism, info.unit, effect.IDS, f"`effects.{info.name}`"):
        assert f"| {text} |" in section
    for term in effect.terms(effect.EXAMPLE, device.Device()):
        assert f"\n    {term}" in section
    for row in TABLES[info.name].rows:
        assert f"| {row[0]} | {row[1]} |" in section


@pytest.mark.parametrize("name", [*OWN_KERNELS, "rate_vibration"])
def test_a_page_says_as_much_of_an_effect_that_is_no_law_of_the_catalogue(name):
    section = effects_pages.effect_section(f"analog_frontend.effects.{name}")
    info = importlib.import_module(f"analog_frontend.effects.{name}").INFO
    for text in (f"| {info.port} |", f"| {info.unit} |", f"| `{effects_pages.KEYS[name]}` |", info.fingerprint[1:]):
        assert text in section
    assert "**Laws**" not in section
    assert "| change |" not in section


def test_a_module_that_is_no_effect_has_no_section():
    for name in ("", ".catalogue", ".law", ".ports"):
        assert effects_pages.effect_section(f"analog_frontend.effects{name}") == ""


def test_scale_factors_of_pages_are_those_that_were_derived():
    """Rebalance force as x has grown behind power-on, as a second compliance takes it, as its electrodes give it."""
    d = device.Device()
    share, g = (d.fx_hz**2 - d.fy_hz**2) / (parasitic_mode.MODE_HZ**2 - d.fx_hz**2), acceleration.EXAMPLE
    # half a second into a dwell that begins 1.5 s behind a state of 1.75 s
    decayed = math.exp(-3.75 / sid_absorption.TAU_S)
    wanted = {
        "sid_absorption": sid_absorption.tail(sid_absorption.EXAMPLE, d.sid_r_ohm * d.sid_c_f) * decayed,
        "parasitic_mode": parasitic_mode.EXAMPLE * share / (1 - parasitic_mode.EXAMPLE * share),
        "acceleration": -acceleration.shift(g, d) / (1 + acceleration.shift(g, d)),
    }
    for name, value in wanted.items():
        assert cell(name, "scale factor", "ppm") == pytest.approx(1e6 * value, rel=0.03), name


def test_biases_of_pages_are_the_rates_that_their_forces_are():
    """-2 m Omega vx is a rate: d vx is d/2m, d x^2 vx by its fundamental d A^2/8m; in quadrature there is none."""
    d = device.Device()
    deg_per_h = math.degrees(3600 / d.coriolis_mass_kg)
    wanted = {
        "damping_coupling": damping_coupling.EXAMPLE / 2 * deg_per_h,
        "bias_cubic": bias_cubic.EXAMPLE * 5e-6**2 / 8 * deg_per_h,
        "quadrature_cubic": 0.0,
    }
    for name, value in wanted.items():
        assert cell(name, "bias", "deg/h") == pytest.approx(value, abs=0.2), name


# a new effect ---------------------------------------------------------------------------------------------------------

SPRING = '''"""Quadratic spring of the drive mode: F = -k2 x^2."""

from analog_frontend.effects.ports import Info

INFO = Info(
    name="{name}",
    port="force_x",
    mechanism="polynomial",
    unit="N/m^2",
    source="electrodes off their middle; value assumed",
    fingerprint="frequency falls with the square of the amplitude, at any sign of k2",
)
IDS, LIMIT, EXAMPLE, SIGN = "E{number}", 1e9, 1e6, 0
DOC = "quadratic spring of the drive mode: F = -k2 x^2"


def terms(value, device):
    """Laws of a stiffness in N/m^2."""
    return (f"force_x = {{-value!r}} x^2",)
'''
NEW = "a_quadratic_spring"


def new_effect(folder):
    """The file that a newcomer writes, with the next free id."""
    used = {int(number) for effect in catalogue.LAWS for number in re.findall(r"E(\d\d)", effect.IDS)}
    (folder / f"{NEW}.py").write_text(SPRING.format(name=NEW, number=max(used) + 1))


def done(code, folder, cache, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(folder), "GYRO_CACHE": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    got = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert got.returncode == 0, got.stdout + got.stderr
    return got.stdout


def contents(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and not {"__pycache__", ".pytest_cache"} & set(path.parts)
    }


WALK = """
import sys
import pytest
sys.path.append("docs")
import effects_pages
effects_pages.measure_table = lambda names: {name: (0.0,) * 5 for name in names}  # needs an engine: the test below
assert effects_pages.main(sys.argv[1:]) == 0
checks = "own or exists or measured_tables or page_says"
sys.exit(pytest.main(["-v", "-p", "no:cacheprovider", "-k", checks, "tests/test_catalogue_pages.py"]))
"""


@pytest.mark.slow
def test_a_new_effect_is_one_file(tmp_path):
    """In a copy of the tree: one file is written, its table is measured, and no file is edited."""
    for name in ("fpga_model", "analog_frontend", "testbench", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "tests").mkdir()
    for name in ("tests/__init__.py", "tests/test_catalogue_pages.py", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path / name)
    before = contents(tmp_path)
    new_effect(tmp_path / "analog_frontend" / "effects")
    cache = tmp_path.with_name("cache")
    said = done(WALK, tmp_path, cache, NEW)
    assert f"[{NEW}] PASSED" in said
    after = contents(tmp_path)
    compiled = {path.parents[1].name for path in cache.rglob("*.kernel")}
    assert not [name for name in compiled if re.match(r"testbench|analog_frontend\.(top|tick|lanes|averaged)", name)]
    assert after.keys() - before.keys() == {f"analog_frontend/effects/{NEW}.py"}
    assert {name for name in before if after.get(name) != before[name]} == {"docs/results/effects.json"}


def test_no_kernel_is_compiled_from_an_effect_of_the_catalogue():
    effects = {Path(effect.__file__) for effect in catalogue.LAWS}
    kernels = re.compile(r"^@(kernel|hot|outlined|inlined|inner)\b", re.M)
    paths = [p for name in jit.PACKAGES for p in (ROOT / name).rglob("*.py") if kernels.search(p.read_text())]
    assert len(paths) > 30
    for path in paths:
        assert not effects & set(jit.kernel_sources(path)), path


def test_points_of_a_campaign_depend_on_every_effect():
    assert {effect.__name__ for effect in catalogue.LAWS} <= set(sources.reachable_modules("testbench.run.simulate"))


MEASURE = """
import sys, time
from analog_frontend import effects
effects.__path__.append(sys.argv[1])
from fpga_model import jit
sys.path.append("docs")
import effects_pages
effects_pages.measure_table(["damping_cubic"])  # whatever an engine still lacks
folder = jit.cache_folder(jit.Path(jit.__file__).resolve()).parents[1]
before = set(folder.rglob("*.kernel"))
start = time.monotonic()
(change,) = effects_pages.measure_table([sys.argv[2]]).values()
assert set(folder.rglob("*.kernel")) == before, "an engine was compiled"
print(time.monotonic() - start, change[0])
"""


@pytest.mark.slow
@pytest.mark.skipif(jit.DISABLED or not jit.CACHE, reason="needs compiled engines and their cache")
def test_the_table_of_a_new_effect_stands_within_half_a_minute(tmp_path):
    new_effect(tmp_path)
    seconds, change_hz = map(float, done(MEASURE, ROOT, os.environ.get("GYRO_CACHE", ""), tmp_path, NEW).split())
    assert seconds < 30
    d = device.Device()
    k = d.mass_kg * (2 * math.pi * d.fx_hz) ** 2
    assert abs(change_hz) < d.fx_hz * (1e6 * 5e-6 / k) ** 2 + 1e-5
