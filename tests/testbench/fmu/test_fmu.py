"""FMUs of firmware and plant: the codes of the engines, valid descriptions, one line for what cannot be."""

import hashlib
import io
import itertools
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import numba
import numpy as np
import pytest

from testbench import config
from testbench.errors import ConfigError, FileError
from testbench.fmu import export_fmu, variables
from testbench.run import simulate
from testbench.run.simulation import DEG, Simulation
from tests.testbench.golden.benching import need

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="closed loop: too slow interpreted")
SEED = 7
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wno-unused-parameter", "-Werror")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The FMUs of the default configuration, for 25 to 26.5 degC."""
    need("cc", "unzip")
    folder = tmp_path_factory.mktemp("fmu")
    export_fmu.export(folder, warmed())
    return folder


def warmed():
    profile = {"scenario.seconds": 1.0, "scenario.temperature_degc": [[0.0, 25.0], [0.5, 26.5], [1.0, 26.5]]}
    return config.changed(config.Config(), {"noise.seed": SEED, **profile})


def coupled(folder, ticks, stimulus=None):
    """What the importer prints; the environment has no Python of ours."""
    goals = ["run", f"TICKS={ticks}", *([f"STIMULUS={stimulus}"] if stimulus else [])]
    done = subprocess.run(
        ["make", "-s", "-C", folder / "importer", *goals], capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"}
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def simulation():
    sim = Simulation(warmed(), 25.0, 26.5, engine="frame")
    sim.now = (np.zeros(1), np.full(1, 25.0))
    for name, raw in sim.first_writes:
        sim.write(name, raw)
    return sim


def test_the_first_ticks_have_the_codes_of_the_engine(written):
    sim = simulation()
    sim.advance(20_000 - sim.tick, 0.0, 25.0)
    assert coupled(written, 20_000) == f"codes_sha256 {sim.codes_sha256()}\n"


@pytest.mark.slow
def test_an_acceleration_is_that_of_the_effect(tmp_path):
    """300 g, so that it shows within the first frames of the kick; without it the codes are others."""
    need("cc", "unzip")
    hashes = []
    for size in (0.0, 300.0):
        given = config.changed(config.Config(), {"noise.seed": SEED, "effects.acceleration": size})
        export_fmu.export(tmp_path / f"{size:g}", given)
        sim = Simulation(given, 25.0, 25.0, engine="frame")
        sim.now = (np.zeros(1), np.full(1, 25.0))
        for name, raw in sim.first_writes:
            sim.write(name, raw)
        sim.advance(60_000 - sim.tick, 0.0, 25.0)
        hashes.append(sim.codes_sha256())
        assert coupled(tmp_path / f"{size:g}", 60_000) == f"codes_sha256 {hashes[-1]}\n"
    assert hashes[0] != hashes[1]


@pytest.mark.slow
def test_from_power_on_through_lock_and_a_second_with_changes(written, tmp_path):
    """Noise on; a rate step, its reverse and a temperature that moves in steps of a frame: every code, by the hash."""
    sim = Simulation(warmed(), 25.0, 26.5, engine="frame")
    assert simulate.start(sim.config, sim, 0.0, 25.0) is not None
    frame = sim.design.frame_ticks
    begin = sim.tick + -sim.tick % frame
    lines = ["0 0 25"]
    for k in range(8000):  # a second of frames
        rate = 100.0 * DEG if 2000 <= k < 6000 else -30.5 * DEG if k >= 6000 else 0.0
        temp = 25.0 + min(max(k - 3000, 0), 3000) * 0.0005
        lines.append(f"{begin + k * frame} {rate.hex()} {temp.hex()}")
    sim.advance(begin - sim.tick, 0.0, 25.0)
    columns = np.array([[float.fromhex(word) for word in line.split()[1:]] for line in lines[1:]])
    sim.advance(8000 * frame, columns[:, 0], columns[:, 1])
    assert len(np.unique(sim.columns()["truth_temperature"])) > 2000
    (tmp_path / "stimulus").write_text("\n".join(lines) + "\n")
    shown = coupled(written, sim.tick, tmp_path / "stimulus").splitlines()
    assert shown[1] == f"codes_sha256 {sim.codes_sha256()}"
    assert 1.0 < float(re.fullmatch(r"locked at ([0-9.]+) s", shown[0])[1]) < 1.2


def test_a_seed_changes_the_plant_alone(written):
    other = config.changed(warmed(), {"noise.seed": SEED + 1})
    firmware, plant = export_fmu.units(other)
    assert firmware.token in zipfile.ZipFile(written / "firmware.fmu").read("modelDescription.xml").decode()
    words = zipfile.ZipFile(written / "plant.fmu").read("resources/plant.bin")
    assert plant.resources["plant.bin"] != words
    assert len(plant.resources["plant.bin"]) == len(words)
    assert plant.token not in zipfile.ZipFile(written / "plant.fmu").read("modelDescription.xml").decode()


# ---- descriptions ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def older(tmp_path_factory):
    """The same as FMI 2.0."""
    need("cc")
    if export_fmu.binary_platform("3.0")[0] != "x86_64-linux":
        pytest.skip("FMI 2.0 has a name for binaries of x86_64 alone")
    folder = tmp_path_factory.mktemp("fmi2")
    export_fmu.export(folder, warmed(), "2.0")
    return folder


def test_fmpy_has_no_objection(written, older):
    validation = pytest.importorskip("fmpy.validation")
    for folder, name in itertools.product((written, older), ("firmware.fmu", "plant.fmu")):
        assert validation.validate_fmu(str(folder / name)) == []


def test_fmpy_simulates_each_alone(written, older):
    """Its own loop, with the start values of the inputs: the plant at rest shows noise, in both versions the same."""
    simulate_fmu = pytest.importorskip("fmpy").simulate_fmu
    shown = [
        simulate_fmu(str(folder / "plant.fmu"), stop_time=2e-4, output_interval=1e-6) for folder in (written, older)
    ]
    assert len(shown[0]) == len(shown[1]) == 201
    assert len(np.unique(shown[0]["y"])) > 100
    assert np.array_equal(shown[0]["y"], shown[1]["y"])


def test_both_versions_have_the_same_codes_in_fmpy(written, older):
    """A master in Python, 300 ticks: outputs of FMI 2.0 one by one, of FMI 3.0 as arrays."""
    pytest.importorskip("fmpy")
    histories = [looped(written, Three, 300), looped(older, Two, 300)]
    assert len(set(histories[0])) > 5
    assert histories[0] == histories[1]


class Three:
    """An FMU of FMI 3.0 in FMPy."""

    def __init__(self, path, folder):
        import fmpy
        from fmpy.fmi3 import FMU3Slave

        described = fmpy.read_model_description(str(path))
        self.variables = {v.name: v for v in described.modelVariables}
        self.fmu = FMU3Slave(
            guid=described.guid,
            unzipDirectory=fmpy.extract(str(path), str(folder)),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self.said = []
        self.fmu.instantiate(logMessage=lambda who, status, category, text: self.said.append(text.decode()))
        self.begin()

    def begin(self):
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, name, size):
        return self.fmu.getInt32([self.variables[name].valueReference], size)

    def set(self, name, values):
        self.fmu.setInt32([self.variables[name].valueReference], values)

    def step(self, tick):
        self.fmu.doStep(tick * 1e-6, 1e-6)

    def end(self):
        self.fmu.terminate()
        self.fmu.freeInstance()


class Two(Three):
    """An FMU of FMI 2.0 in FMPy."""

    def __init__(self, path, folder):
        import fmpy
        from fmpy.fmi2 import FMU2Slave

        described = fmpy.read_model_description(str(path))
        self.variables = {v.name: v for v in described.modelVariables}
        self.fmu = FMU2Slave(
            guid=described.guid,
            unzipDirectory=fmpy.extract(str(path), str(folder)),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)
        self.begin()

    def _references(self, name, size):
        names = [f"{name}[{k}]" for k in range(size)] if size > 1 else [name]
        return [self.variables[one].valueReference for one in names]

    def get(self, name, size):
        return self.fmu.getInteger(self._references(name, size))

    def set(self, name, values):
        self.fmu.setInteger(self._references(name, len(values)), values)


def crossed(firmware, plant, tick):
    """A tick of both, and what has crossed between them."""
    found = []
    for source, sink, rows in ((firmware, plant, variables.PINS), (plant, firmware, variables.CONVERTER)):
        source.step(tick)
        for name, _, size in rows:
            values = list(source.get(name, size))
            sink.set(name, values)
            found += values
    return tuple(found)


def looped(folder, kind, ticks):
    """What crosses between the FMUs, tick by tick."""
    fmus = [kind(folder / f"{name}.fmu", folder / name) for name in ("firmware", "plant")]
    found = [crossed(*fmus, tick) for tick in range(ticks)]
    for fmu in fmus:
        fmu.end()
    return found


def test_a_state_continues_with_the_same_codes(written, tmp_path):
    """Serialised in the middle, and set in other instances."""
    pytest.importorskip("fmpy")
    first, second = (
        [Three(written / f"{name}.fmu", tmp_path / copy / name) for name in ("firmware", "plant")] for copy in "ab"
    )
    ticks = [crossed(*first, tick) for tick in range(30)]
    for one, other in zip(first, second):
        state = one.fmu.getFMUState()
        other.fmu.setFMUState(other.fmu.deserializeFMUState(one.fmu.serializeFMUState(state)))
        one.fmu.freeFMUState(state)
    later = [crossed(*first, tick) for tick in range(30, 60)]
    assert [crossed(*second, tick) for tick in range(30, 60)] == later
    assert len(set(ticks + later)) > 3


DECLARED = r"FMI\d_Export\s+fmi\d\w+TYPE\s+(fmi\d\w+);"
# FMI 2.0 has these for model exchange alone
ABSENT = {
    *(f"fmi2{name}" for name in ("EnterEventMode", "NewDiscreteStates", "EnterContinuousTimeMode", "SetTime")),
    *(f"fmi2{name}" for name in ("CompletedIntegratorStep", "SetContinuousStates", "GetDerivatives")),
    *(f"fmi2Get{name}" for name in ("EventIndicators", "ContinuousStates", "NominalsOfContinuousStates")),
}


@pytest.mark.parametrize("version", export_fmu.VERSIONS)
def test_functions_are_those_of_the_standard(version, tmp_path):
    """A compiler compares each with the headers of the FMI project; a linker finds all of them."""
    fmpy = pytest.importorskip("fmpy")
    need("gcc")
    headers = Path(fmpy.__file__).parent / "c-code"
    unit = export_fmu.units(warmed(), version)[1]
    for name, text in unit.sources.items():
        (tmp_path / name).write_text(text)
    command = ["gcc", "-std=c99", "-Wall", "-Werror", "-Wno-unused-variable", "-DFMI_HEADERS", "-I", headers]
    subprocess.run([*command, "-c", f"fmi{version[0]}.c", "-o", "one.o"], cwd=tmp_path, check=True)
    declared = set(re.findall(DECLARED, (headers / f"fmi{version[0]}Functions.h").read_text()))
    shown = subprocess.run(["nm", "-g", "--defined-only", "one.o"], cwd=tmp_path, capture_output=True, text=True)
    assert len(declared) > 40
    assert declared - set(re.findall(r" T (\w+)", shown.stdout)) == {name for name in ABSENT if name in declared}


@pytest.mark.slow
@pytest.mark.parametrize("version", export_fmu.VERSIONS)
def test_compilers_have_no_warning(version, tmp_path):
    need("gcc")
    for unit, compiler in itertools.product(export_fmu.units(warmed(), version), ("gcc", "clang")):
        if shutil.which(compiler) is None:
            continue
        folder = tmp_path / f"{unit.name}-{compiler}"
        folder.mkdir()
        for name, text in unit.sources.items():
            (folder / name).write_text(text)
        subprocess.run([compiler, *STRICT, "-fPIC", "-c", *unit.compiled], cwd=folder, check=True)


@pytest.mark.slow
def test_sanitizers_find_nothing(written, tmp_path):
    """Both FMUs and the importer: addresses and undefined behaviour, 5000 ticks, the same hash."""
    need("gcc", "unzip")
    folder = shutil.copytree(written, tmp_path / "all")
    plain = coupled(folder, 5000)
    flags = ["-g", "-O1", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    for unit in export_fmu.units(warmed()):
        place, suffix = export_fmu.binary_platform("3.0")
        library = folder / "importer" / unit.name / "binaries" / place / f"gyro_{unit.name}{suffix}"
        sources = folder / "importer" / unit.name / "sources"
        names = [sources / name for name in unit.compiled]
        subprocess.run(["gcc", "-std=c99", *flags, "-fPIC", "-shared", *names, "-lm", "-o", library], check=True)
    subprocess.run(["make", "-s", "-B", "couple", f"CFLAGS={' '.join(flags)}"], cwd=folder / "importer", check=True)
    done = subprocess.run(
        ["./couple", "firmware", "plant", "5000"], cwd=folder / "importer", capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, plain), done.stderr


# ---- what cannot be --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"effects.duffing_k3_per_um2": 1e-7},
            r"effects.duffing_k3_per_um2 = 1e-07: the FMU of the plant supports no effect except acceleration",
        ),
        (
            {"effects.laws": ["force_x = -1e6 x^3"]},
            r"effects.laws = .*: the FMU of the plant supports no effect except acceleration",
        ),
        ({"plant.drive_dac_bow": 1e-4}, "plant.drive_dac_bow = 0.0001: the FMU of the plant supports only 0"),
        ({"plant.self_heating_k": 2.0}, "plant.self_heating_k = 2: the FMU of the plant supports only 0"),
        ({"scenario.host": "spi"}, 'scenario.host = "spi": the FMU of the firmware writes registers on the "bus" only'),
        (
            {"firmware.board": "digital_sid"},
            'firmware.board = "digital_sid": the FMU of the plant supports only "analog_sid"',
        ),
        ({"scenario.faults": [[0.1, "adc_silent", "adc", 0, 1.0]]}, "scenario.faults: the FMUs simulate no faults"),
    ],
)
def test_what_the_plant_does_not_cover_is_refused_by_name(changes, message):
    with pytest.raises(ConfigError, match=message):
        export_fmu.units(config.changed(config.Config(), changes))


def test_without_a_compiler_or_a_folder_the_export_is_one_line(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(export_fmu.Unit, "binary", lambda unit: b"")
    with pytest.raises(FileError, match=r"file: cannot be written: "):
        export_fmu.export(tmp_path / "file", config.Config())
    monkeypatch.undo()
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(ConfigError, match="gyro fmu: the C compiler no-such-compiler is not installed; install it"):
        export_fmu.export(tmp_path / "other", config.Config())
    assert not (tmp_path / "other").exists()
    with pytest.raises(ConfigError, match=r"--fmi 1.0: one of 3.0, 2.0 is needed"):
        export_fmu.units(config.Config(), "1.0")


IMPOSSIBLE = (
    ("plant", "edge_count", [9], "edge_count: 9 is outside 0 .. 8"),
    ("plant", "drive_clock", [26], "drive_clock: 26 is outside -1 .. 25"),
    ("firmware", "drdy_clock", [30], "drdy_clock: 30 is outside -1 .. 25"),
    ("firmware", "adc_code", [1 << 23, 0, 0, 0, 0], "adc_code: 8388608 is outside -8388608 .. 8388607"),
)


def test_what_is_impossible_is_one_line(written, tmp_path):
    pytest.importorskip("fmpy")
    fmus = {name: Three(written / f"{name}.fmu", tmp_path / name) for name in ("firmware", "plant")}
    for name, variable, values, message in IMPOSSIBLE:
        fmus[name].set(variable, values)
        with pytest.raises(Exception, match="fmi3DoStep"):
            fmus[name].step(0)
        assert fmus[name].said.pop() == message
        fmus[name].fmu.reset()
        fmus[name].begin()
    plant = fmus["plant"]
    for arguments, message in (
        ((0.0, 2e-6), "communicationStepSize: 2e-06 s, expected 1e-06 s, one tick"),
        ((5e-6, 1e-6), "currentCommunicationPoint: 5e-06 s, expected 0 s"),
    ):
        with pytest.raises(Exception, match="fmi3DoStep"):
            plant.fmu.doStep(*arguments)
        assert plant.said.pop() == message
    plant.fmu.setFloat64([plant.variables["temperature"].valueReference], [40.0])
    with pytest.raises(Exception, match="fmi3DoStep"):
        plant.step(0)
    assert plant.said.pop() == "temperature: 40 degC is outside 25 .. 26.5 degC, the range of the export"
    with pytest.raises(Exception, match="fmi3SetInt32"):
        plant.set("adc_code", [0] * 5)
    assert "no such variable" in plant.said.pop()


@pytest.mark.slow
def test_two_exports_are_one(written):
    for unit in export_fmu.units(warmed()):
        content = export_fmu.archive(unit.contents())
        first = (written / f"{unit.name}.fmu").read_bytes()
        assert hashlib.sha256(content).digest() == hashlib.sha256(first).digest()
        names = zipfile.ZipFile(io.BytesIO(first)).namelist()
        assert "modelDescription.xml" in names
        assert "sources/buildDescription.xml" in names
