"""`gyro fmu --out DIR`: the closed loop as two FMUs for co-simulation, and a program in C that couples them.

    DIR/firmware.fmu   firmware and digital sides of the converters; a step is one tick of 1 us, 26 clocks
    DIR/plant.fmu      everything analog; configuration, seed and range of temperatures are fixed
    DIR/importer/      couple.c: both in one process, with the hash of all codes

The firmware is stepped before the plant. What the C of the plant does not cover is refused by name.
Source    docs/fmu.md
"""

import hashlib
import io
import os
import platform
import shutil
import tempfile
import zipfile
from pathlib import Path

from fpga_model import sequencer
from testbench.config import scenario
from testbench.errors import ConfigError
from testbench.fmu import description, firmware_source, plant_words, variables
from testbench.run.simulation import Simulation
from testbench.storage.files import replace_folder
from testbench.tool import run_tool

TEMPLATES = Path(__file__).with_name("templates")
VERSIONS = ("3.0", "2.0")
COMMON = ("instance.c", "instance.h")
PLANT = ("plant.c", "plant.h", "plant_model.c")
IMPORTER = ("Makefile", "couple.c", "sha256.c", "sha256.h", "fmi3.h")
TEXTS = {
    "firmware": "Firmware of a force-to-rebalance gyroscope, with the digital sides of its converters",
    "plant": "DACs, electrodes, two modes, C/V converters, demodulators and converter of a gyroscope",
}
# without contraction, or the doubles are others; for every processor of the architecture
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
SYSTEMS = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}
MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
DATE = (1980, 1, 1, 0, 0, 0)  # the same bytes whenever it is written


def binary_platform(version):
    """(folder of the binary, its suffix) of an FMU on this machine."""
    if platform.system() not in SYSTEMS:
        raise ConfigError(f"gyro fmu: binaries are built only on {' and '.join(SYSTEMS)}, not on {platform.system()}")
    system, suffix = SYSTEMS[platform.system()]
    machine = MACHINES.get(platform.machine().lower(), platform.machine())
    if version == "3.0":
        return f"{machine}-{system}", suffix
    if machine != "x86_64":
        raise ConfigError(f"gyro fmu: FMI 2.0 has no name for binaries of {machine}; use --fmi 3.0")
    return f"{system}64", suffix


def compiler():
    """The C compiler, `CC` or cc; ConfigError if it is not installed."""
    name = os.environ.get("CC", "cc")
    if shutil.which(name) is None:
        raise ConfigError(f"gyro fmu: the C compiler {name} is not installed; install it, or name another in CC")
    return name


def _templates(*names):
    return {name: (TEMPLATES / name).read_text() for name in names}


class Unit:
    """One FMU before it is compiled: its variables, sources and resources."""

    def __init__(self, name, version, fmu_variables, sources, resources, tick_hz):
        digits = version[0]
        self.name, self.version, self.fmu_variables, self.tick_hz = name, version, fmu_variables, tick_hz
        self.sources = sources | _templates(*COMMON, f"fmi{digits}.c", f"fmi{digits}.h")
        self.resources = resources
        token_hash = hashlib.sha256(repr((name, version, fmu_variables, tick_hz)).encode())
        for key, content in sorted((*self.sources.items(), *resources.items())):
            token_hash.update(key.encode() + b"\0" + (content.encode() if isinstance(content, str) else content))
        self.token = f"{{{token_hash.hexdigest()}}}"
        self.sources["variables.h"] = variables.header(fmu_variables, self.token, tick_hz)

    @property
    def compiled(self):
        """Names of the sources that a compiler is given."""
        return sorted(name for name in self.sources if name.endswith(".c"))

    def binary(self):
        """Bytes of the library."""
        with tempfile.TemporaryDirectory() as folder:
            for name, text in self.sources.items():
                (Path(folder) / name).write_text(text)
            run_tool([compiler(), *FLAGS, *self.compiled, "-lm", "-o", "library"], folder, f"{self.name}.fmu")
            return (Path(folder) / "library").read_bytes()

    def contents(self):
        """{path: bytes} of the FMU."""
        folder, suffix = binary_platform(self.version)
        described = description.model(
            self.version, self.name, TEXTS[self.name], self.token, self.fmu_variables, self.compiled, self.tick_hz
        )
        files = {"modelDescription.xml": described, f"binaries/{folder}/gyro_{self.name}{suffix}": self.binary()}
        files |= {f"sources/{name}": text for name, text in self.sources.items()}
        if self.version == "3.0":
            files["sources/buildDescription.xml"] = description.build(self.name, self.compiled)
        files |= {f"resources/{name}": content for name, content in self.resources.items()}
        return {name: content.encode() if isinstance(content, str) else content for name, content in files.items()}


def archive(files):
    """Bytes of a zip archive."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name, content in files.items():
            zipped.writestr(zipfile.ZipInfo(name, DATE), content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def units(config, version="3.0"):
    """`Unit`s of firmware and plant; ConfigError for what the C of the plant does not cover."""
    if version not in VERSIONS:
        raise ConfigError(f"gyro fmu: --fmi {version}: one of {', '.join(VERSIONS)} is needed")
    plant_words.check(config)
    timeline = scenario.expand(config.scenario, config.design_record())
    lo, hi = timeline.temp_degc.limits()
    lo, hi = min(lo, timeline.temp_before_degc), max(hi, timeline.temp_before_degc)
    sim = Simulation(config, lo, hi, engine="clocked")
    tick_hz = config.design_record().tick_hz
    plant_constants = plant_words.words(config, sim.params.plant, lo, hi)
    start = firmware_source.power_on_codes(config)
    return (
        Unit(
            "firmware",
            version,
            variables.firmware(),
            firmware_source.source_texts(sim.params, sim.state, sim.first_writes) | _templates("firmware_model.c"),
            {},
            tick_hz,
        ),
        Unit(
            "plant",
            version,
            variables.plant(start, lo, float(config.effects.acceleration)),
            _templates(*PLANT),
            {"plant.bin": plant_words.binary(plant_constants)},
            tick_hz,
        ),
    )


def export(folder, config, version="3.0"):
    """Write both FMUs of a configuration, and for FMI 3.0 the importer; returns the paths."""
    with replace_folder(folder, keep=True) as new:
        files = _files(config, version)
        for name, content in files.items():
            (new / name).parent.mkdir(exist_ok=True)
            (new / name).write_bytes(content)
    return [Path(folder) / name for name in files]


def _files(config, version):
    """{path: bytes} of what `export` writes."""
    files = {f"{unit.name}.fmu": archive(unit.contents()) for unit in units(config, version)}
    if version == "3.0":
        record = config.design_record()
        header = f'#define PLATFORM "{binary_platform(version)[0]}"\n#define LIBRARY "{binary_platform(version)[1]}"\n'
        header += f"enum {{ LOCKED = {sequencer.LOCKED}, FRAME_TICKS = {record.frame_ticks} }};\n"
        header += f"#define TICK_S {1 / record.tick_hz!r}\n"
        texts = {**_templates(*IMPORTER), "of_export.h": header}
        files |= {f"importer/{name}": text.encode() for name, text in texts.items()}
    return files
