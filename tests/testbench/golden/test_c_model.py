"""The firmware in C: compilers accept it, bundles pass, planted faults fail by name, other bundles are refused."""

import ctypes
import json
import random
import re
import shutil
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fpga_model import fixed
from testbench.errors import ConfigError
from testbench.golden import cli
from testbench.golden.bundles import design_bundle
from testbench.golden.bundles import export as bundles_export
from testbench.golden.c_model import export_c
from testbench.golden.c_model.c_kinds import NUMBER, infer_kind
from testbench.golden.c_model.expressions import Unsupported
from testbench.golden.c_model.program import Program
from testbench.golden.recording import recording
from tests import naive
from tests.testbench.golden.benching import RTL, need
from tests.testbench.golden.resealing import reseal

FRAMES = 3
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")


def checked(folder, *goals):
    """Finished `make` in a folder of C; both outputs are one text."""
    command = ["make", "-s", "-C", str(folder), *goals]
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=1200)


@pytest.fixture(scope="module")
def model(bundles, tmp_path_factory):
    """A folder of C with bundles of three blocks and of the first frames of the whole design."""
    folder = tmp_path_factory.mktemp("c")
    export_c.export(folder)
    for stem in ("dds", "pi", "quadrature_loop"):
        shutil.copytree(bundles(stem), folder / "golden" / stem)
    r = recording.load("reset")
    window = recording.Window(3250, 200, "second frame")
    design_bundle.write(design_bundle.shorten_recording(r, FRAMES, (window,)), folder / "golden" / "top" / "reset")
    return folder


@pytest.fixture(scope="module")
def passed(model):
    need("gcc")
    return checked(model, "check", "CC=gcc", "CFLAGS=-O1")


def test_bundles_pass(passed):
    assert passed.returncode == 0, passed.stdout
    lines = passed.stdout.splitlines()
    assert [line.split()[:2] for line in lines if not line.startswith("PASS")] == []
    assert "PASS dds/default: 3440 rows, 5 ports [c]" in lines
    assert "PASS top/reset: 9750 clocks, 201 rows of 230 ports, 3 of 3 frames [c]" in lines
    assert len(lines) == 1 + 4 + 1 + 1


FAULTS = {
    # header, text and what stands in its place, first line of the report
    "dds": ("s->phase + off_sense_ref", "s->phase + off_sense_ref + 1", "row 1: r_sense_ref: expected 0, got 1 (hex)"),
    "pi": ("gyro_shr(x + gyro_shr(gyro_shl(1, n), 1), n)", "gyro_shr(x, n)", "row 37: r_y: expected 4, got 3 (hex)"),
}


@pytest.mark.parametrize("stem", FAULTS)
def test_a_planted_fault_is_named(model, tmp_path, stem):
    need("gcc")
    text, wrong, line = FAULTS[stem]
    copied = shutil.copytree(model, tmp_path / "c", ignore=shutil.ignore_patterns("build", "golden"))
    found = [path for path in (copied / "model").glob("*.h") if text in path.read_text()]
    assert len(found) == 1
    found[0].write_text(found[0].read_text().replace(text, wrong))
    case = {"dds": "default", "pi": "rate"}[stem]
    done = checked(copied, "check", "CC=gcc", "CFLAGS=-O0", f"BUNDLES={model / 'golden' / stem / case}")
    assert done.returncode != 0
    assert done.stdout.splitlines()[0] == f"{line} [c]"
    assert f"FAIL {stem}/{case}: " in done.stdout


def test_a_wrong_frame_of_the_whole_design_is_named(model, passed, tmp_path):
    """A row that is not listed shows in the signature of its frame."""
    folder = shutil.copytree(model / "golden" / "top" / "reset", tmp_path / "reset")
    words = (folder / "sig.hex").read_text().split()
    (folder / "sig.hex").write_text("\n".join([words[0], f"{int(words[1], 16) ^ 1:016x}", *words[2:], ""]))
    done = subprocess.run([model / "build/gcc/check", folder], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stdout.startswith(f"frame 1: signature: expected {int(words[1], 16) ^ 1:016x}, got {words[1]} [c]\n")


TOO_MANY = "not of this model's design: more ports than the block in registers"


def refused(model, folder, message):
    done = subprocess.run([model / "build/gcc/check", folder], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, f"{folder}: {message}\n")


def test_what_is_not_of_the_model_is_refused_in_one_line(model, passed, tmp_path):
    refused(model, tmp_path, "no bundle: manifest.json cannot be read")
    changes = {
        "another": (lambda m: m.update(block="another"), "no block of this model: another"),
        "width": (lambda m: m["inputs"][1].update(width=40), "not of this model's design: port word"),
        "port": (lambda m: m["registers"].append(m["registers"][0]), TOO_MANY),
        "design": (lambda m: m.update(design={"dds_bits": 40}), "not of this model's design: dds_bits"),
    }  # fmt: skip
    for name, (change, message) in changes.items():
        folder = shutil.copytree(model / "golden" / "dds" / "default", tmp_path / name)
        reseal(folder, change)
        refused(model, folder, message)
    cut = shutil.copytree(model / "golden" / "dds" / "default", tmp_path / "cut")
    (cut / "exp.hex").write_text("".join((cut / "exp.hex").read_text().splitlines(True)[:-1]))
    refused(model, cut, "stim, exp and mask.hex do not hold the rows of the manifest")


def test_no_statement_allocates_or_computes_in_floating_point(model):
    for path in (model / "model").glob("*.[ch]"):
        assert not re.search(r"\b(malloc|calloc|alloca|free|float|double)\b|[0-9]\.[0-9]+[^,\]]*;", path.read_text()), (
            path
        )


def test_two_exports_are_one(model, tmp_path):
    for path in export_c.export(tmp_path):
        assert path.read_bytes() == (model / path.relative_to(tmp_path)).read_bytes()


# ---- what is translated ----------------------------------------------------------------------------------------------


def compiled(program, folder, stem):
    """Functions of a part as a shared library."""
    files = {f"{stem}.h": program.header(stem), f"{stem}.c": program.source(stem)}
    for name in ("integers.h", "integers.c"):
        files[name] = (export_c.TEMPLATES / name).read_text()
    for name, text in files.items():
        (folder / name).write_text(text)
    sources = [folder / name for name in files if name.endswith(".c")]
    subprocess.run(["gcc", *STRICT, "-fPIC", "-shared", *sources, "-o", folder / "lib.so"], check=True)
    return ctypes.CDLL(str(folder / "lib.so"))


def test_rounding_and_overflow_are_those_of_exact_fractions(tmp_path):
    need("gcc")
    program = Program(recording.load("reset").params.design)
    for rule in fixed.ROUNDINGS.values():
        program.function(rule, (NUMBER, NUMBER))
    program.function(fixed.wrap, (NUMBER, NUMBER))
    library = compiled(program, tmp_path, "fixed")
    draw = random.Random(1)
    values = [*range(-70, 71), *(draw.randrange(-(1 << 61), 1 << 61) for _ in range(200))]
    for name in fixed.ROUNDINGS:
        of = getattr(library, f"gyro_fixed_{name}")
        of.argtypes, of.restype = [ctypes.c_int64] * 2, ctypes.c_int64
        for n in (0, 1, 2, 3, 30):
            for x in values:
                assert of(x, n) == naive.rounded(name, Fraction(x, 1 << n)), (name, x, n)
    wrap = library.gyro_fixed_wrap
    wrap.argtypes, wrap.restype = [ctypes.c_int64] * 2, ctypes.c_int64
    for width in (1, 2, 24, 62):
        for x in values:
            if abs(x) < 1 << 61:
                assert wrap(x, width) == naive.congruent_within(x, 1 << width, -(1 << (width - 1)))


def with_a_loop(x):
    while x > 0:
        x = x - 1
    return x


def with_a_division(x):
    return x // 3


def of_one_way(x):
    if x:
        y = 1
    return y


def of_two_kinds(x):
    if x:
        return (x, x)
    return x


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (with_a_loop, "while x > 0:"),
        (with_a_division, "x // 3"),
        (of_one_way, "y is first assigned in only one branch of an if"),
        (of_two_kinds, "its results have two kinds"),
    ],
)
def test_what_no_kernel_uses_is_refused_by_name(function, message):
    with pytest.raises(Unsupported, match=rf"{function.__name__}: .*{re.escape(message)}"):
        Program(recording.load("reset").params.design).function(function, (NUMBER,))


def swapped(x, y):
    """Both at once."""
    x, y = y, x
    return (x, y) if x > y else (y, x + 1)


def test_names_that_change_places_do_so_at_once(tmp_path):
    need("gcc")
    program = Program(recording.load("reset").params.design)
    found = program.function(swapped, (NUMBER, NUMBER))
    assert found.result == infer_kind((0, 0))
    library = compiled(program, tmp_path, "test_c_model")
    result = (ctypes.c_int64 * 2)()
    of = getattr(library, found.name)
    of.argtypes = [ctypes.c_int64, ctypes.c_int64, ctypes.POINTER(ctypes.c_int64)]
    for x, y in ((1, 2), (2, 1), (-3, -3)):
        of(x, y, result)
        assert tuple(result) == swapped(x, y)


# ---- command ---------------------------------------------------------------------------------------------------------


def test_the_command_writes_model_and_bundles(tmp_path):
    done = CliRunner().invoke(cli.app, ["export", "dds", "--c", str(tmp_path), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert [Path(b["folder"]).relative_to(tmp_path).as_posix() for b in told["bundles"]] == ["golden/dds/default"]
    assert {Path(path).name for path in told["c_files"]} >= {"Makefile", "top.h", "blocks.h", "main.c"}
    with pytest.raises(ConfigError, match="one of --out DIR and --c DIR is needed"):
        CliRunner().invoke(cli.app, ["export", "dds"], catch_exceptions=False)


def test_a_file_that_is_not_of_the_model_is_refused(tmp_path):
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "mine.c").write_text("")
    with pytest.raises(ConfigError, match=r"mine\.c is not part of this model, but make would compile it; move it"):
        export_c.export(tmp_path)


PAGE = Path(__file__).parents[3] / "docs" / "c_model.md"
PRINTED = ["0\n119086341745\n238172683490\n", "phase behind the first edge: 119086341745\n"]


@pytest.mark.parametrize("number", range(len(PRINTED)))
def test_the_programs_of_the_page(model, tmp_path, number):
    need("gcc")
    texts = re.findall(r"^```c\n(.*?)^```$", PAGE.read_text(), re.M | re.S)
    assert len(texts) == len(PRINTED)
    (tmp_path / "example.c").write_text(texts[number])
    sources = sorted((model / "model").glob("*.c"))
    command = ["gcc", *STRICT, "-I", model / "model", "example.c", *sources, "-o", "example"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "example"], capture_output=True, text=True).stdout == PRINTED[number]


def test_the_python_of_the_page(model, tmp_path):
    """The PI of the page by hand: prop = kp e, acc = ki e, and y rounds their sum in the clock behind."""
    need("gcc")
    assert checked(model, "lib", "CFLAGS=-O0").returncode == 0
    (text,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.M | re.S)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "c").symlink_to(model)
    done = subprocess.run([sys.executable, "-I", "-c", text], cwd=tmp_path, capture_output=True, text=True)
    kp, ki = 14937228, 1173167
    acc = 1000 * ki
    first, second, third = [1000 * kp, acc, 0], [0, acc, (1000 * kp + acc + (1 << 23)) >> 24], [0, acc, 70]
    assert done.stdout == f"{first}\n{second}\n{third}\n", done.stderr


# ---- scoreboards -----------------------------------------------------------------------------------------------------

FAULT_FRAME = 164  # of `story` in which a loop rounds for the first time
ROUNDING = ("{{2{r_acc[A-1]}}, r_acc} + HALF_Y;", "{{2{r_acc[A-1]}}, r_acc};")


@pytest.fixture
def wrong_rtl(tmp_path):
    """The reference RTL without the rounding constant of the PI."""
    folder = Path(shutil.copytree(RTL, tmp_path / "rtl"))
    text = (folder / "pi.v").read_text()
    assert text.count(ROUNDING[0]) == 1
    (folder / "pi.v").write_text(text.replace(*ROUNDING))
    return folder


def test_a_fault_of_rtl_stops_the_simulation_at_its_clock(model, wrong_rtl):
    """The bench of the bundle names the same row, from its own file of expected values."""
    need("verilator", "g++")
    files = f"FILES={wrong_rtl / 'pi.v'}"
    done = checked(model, "dpi", "BUNDLE=golden/pi/rate", files, "CFLAGS=-O0", "BENCHED=-O0")
    lines = done.stdout.splitlines()
    assert done.returncode != 0
    named = [line for line in lines if line.endswith("[dpi]")]
    assert named == ["clock 37: r_y: expected 4, got 3 (hex) [dpi]", "FAIL pi: 1 ports differ at clock 37 [dpi]"]
    assert [line for line in lines if line.startswith("row ")] == ["row 37: r_y: expected 4, got 3 (hex)"]


@pytest.mark.slow
def test_a_fault_of_the_whole_design_stops_at_its_clock(model, wrong_rtl, tmp_path):
    """A bundle with a row at each clock says where and which."""
    need("verilator", "g++")
    r, frames = recording.load("story"), FAULT_FRAME + 1
    clocks = r.params.design.frame_clocks
    window = recording.Window(FAULT_FRAME * clocks, clocks, "every clock")
    design_bundle.write(design_bundle.shorten_recording(r, frames, (window,)), tmp_path / "top" / "story")
    done = checked(model, "dpi", f"BUNDLE={tmp_path / 'top' / 'story'}", f"RTL={RTL}")
    assert f"top: {frames * clocks} clocks equal to the model [dpi]" in done.stdout
    done = checked(model, "dpi", f"BUNDLE={tmp_path / 'top' / 'story'}", f"RTL={wrong_rtl}")
    named = [line for line in done.stdout.splitlines() if line.endswith("[dpi]")]
    benched = [line for line in done.stdout.splitlines() if line.startswith("clock ") and not line.endswith("[dpi]")]
    assert done.returncode != 0
    assert benched
    assert named[0].removesuffix(" [dpi]") == benched[0], done.stdout


def test_unknown_bits_differ(model, tmp_path):
    need("gcc", "verilator")
    root = subprocess.run(["verilator", "--getenv", "VERILATOR_ROOT"], capture_output=True, text=True).stdout.strip()
    sources = [*(model / "model").glob("*.c"), model / "dpi" / "gyro_dpi.c"]
    include = ["-I", model / "model", "-isystem", f"{root}/include/vltstd"]
    command = ["gcc", *STRICT, "-fPIC", "-shared", *include, *sources, "-o", tmp_path / "lib.so"]
    subprocess.run(command, check=True)
    library = ctypes.CDLL(str(tmp_path / "lib.so"))
    library.gyro_dpi_open.restype = ctypes.c_void_p
    library.gyro_dpi_values.restype = library.gyro_dpi_name.restype = ctypes.c_char_p
    opened = ctypes.c_void_p(library.gyro_dpi_open(b"watchdog"))
    words = ctypes.c_uint32 * 1
    known, zero = words(0x7FF), words(0)  # age of 10 bits, stale
    for rst, shown, mask, count in ((0, 5, 0, 0), (1, 9, 0, 0), (0, 0, 0x7FF, 0), (0, 0, 0x7FE, 1), (0, 2, 0x7FF, 1)):
        assert library.gyro_dpi_clock(opened, ctypes.c_ubyte(rst), zero, words(shown), words(mask)) == count
    assert library.gyro_dpi_name(opened, 0) == b"r_age"
    assert library.gyro_dpi_values(opened, 0) == b"expected 0, got 1 (hex)"
    assert library.gyro_dpi_clock(opened, ctypes.c_ubyte(0), zero, zero, words(known[0] - 1)) == 1
    assert library.gyro_dpi_name(opened, 0) == b"r_stale"
    assert library.gyro_dpi_values(opened, 0) == b"expected 0 (hex), got unknown bits"


@pytest.mark.slow
def test_every_scoreboard_elaborates(model):
    need("verilator")
    for path in sorted((model / "dpi").glob("*_bind.sv")):
        stem = path.name.removesuffix("_bind.sv")
        command = ["verilator", "--lint-only", "--timing", "-Wno-fatal", "-Wno-lint", "-Wno-style"]
        command += ["--top-module", f"gyro_{stem}", "dpi/gyro_dpi.sv", f"dpi/{stem}_scoreboard.sv"]
        done = subprocess.run([*command, *RTL.glob("*.v"), path], cwd=model, capture_output=True, text=True)
        assert done.returncode == 0, (stem, done.stderr)


def test_the_headers_suit_cpp(model, tmp_path):
    need("g++")
    (tmp_path / "all.cpp").write_text('#include "top.h"\n#include "blocks.h"\nint main() { gyro_top_State s, t; }\n')
    command = ["g++", "-std=c++17", "-Wall", "-Wno-unused-variable", "-Werror", "-fsyntax-only", "-I", model / "model"]
    subprocess.run([*command, tmp_path / "all.cpp"], check=True)


@pytest.mark.slow
def test_the_numbers_of_a_small_processor_are_those_of_the_page(model):
    """Other versions of the tools give others: half as much or twice as much is not what the page says."""
    need("arm-none-eabi-gcc", "qemu-system-arm")
    sizes = checked(model, "size").stdout.split()
    sizes = dict(zip(sizes[:3], map(int, sizes[6:9])))
    counts = {}
    for shift in (0, 1):  # the program measures what the timer counts: QEMU's time per instruction does not matter
        qemu = f"QEMU=timeout 100 qemu-system-arm -machine mps2-an386 -icount shift={shift}"
        text = (model / "Makefile").read_text().replace(" -icount shift=0", "")
        (model / f"shift_{shift}.mk").write_text(text)
        done = checked(model, "-f", f"shift_{shift}.mk", "instructions", qemu)
        counts[shift] = int(re.fullmatch(r"(\d+) instructions per frame\n\d+ .* per clock\n", done.stdout)[1])
    assert counts[1] == pytest.approx(counts[0], rel=1e-3)
    rows = PAGE.read_text().partition("## On a small processor")[2].partition("## From Python")[0]
    text, data, bss, instructions = (int(n) for n in re.findall(r"\| (\d+)(?: bytes)? \|", rows))
    assert (data, bss) == (sizes["data"], sizes["bss"])
    assert sizes["text"] == pytest.approx(text, rel=0.5)
    assert counts[0] == pytest.approx(instructions, rel=0.5)
    assert bss >= 2 * 8 * 200


# ---- all of it -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("goal", ["check", "sanitize"])
def test_every_bundle_passes_under_both_compilers(tmp_path, goal, compiler):
    """Every row of every register; under the sanitizers the first frames of the whole design."""
    need(compiler)
    export_c.export(tmp_path)
    written = bundles_export.export("all", tmp_path / "golden")
    done = checked(tmp_path, goal, f"CC={compiler}", *(["FRAMES=100"] if goal == "sanitize" else []))
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("PASS ") == len(written)
    assert "FAIL" not in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", ["low_cost", "notch"])
def test_the_design_of_a_file_passes_its_bundles(tmp_path, name):
    need("gcc")
    path = Path(__file__).parents[3] / "docs" / "boards" / "low_cost.toml"
    if name == "notch":
        path = tmp_path / "notch.toml"
        path.write_text("[firmware]\nnotch_hz = 139.0\nsense_code_registers = 2\n")
    export_c.export(tmp_path / "c", path)
    for stem in ("dds", "agc", "sine", "spi_adc", "notch"):
        bundles_export.export(stem, tmp_path / "c" / "golden", config=path)
    done = checked(tmp_path / "c", "check", "CC=gcc")
    assert done.returncode == 0, done.stdout
    assert "FAIL" not in done.stdout
