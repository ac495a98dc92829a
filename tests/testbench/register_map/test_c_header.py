"""A C compiler takes both headers, and what they define is the printed register map."""

import shutil
import subprocess

import pytest

from testbench.register_map import c_header, export_registers, systemrdl
from tests.testbench.register_map import printed_map

pytestmark = pytest.mark.skipif(
    shutil.which("gcc") is None, reason="gcc is not installed: the headers were NOT compiled"
)
STRICT = ("gcc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")


def values_of(exported, tmp_path, expressions):
    """Values of integer expressions in a C program that includes the headers."""
    lines = "\n".join(f'    printf("%lld\\n", (long long)({text}));' for text in expressions)
    heads = '#include <stddef.h>\n#include <stdio.h>\n#include "gyro_registers.h"\n#include "gyro_formats.h"\n'
    (tmp_path / "x.c").write_text(f"{heads}int main(void) {{\n{lines}\n    return 0;\n}}\n")
    command = [*STRICT, f"-I{exported / 'c'}", str(tmp_path / "x.c"), "-o", str(tmp_path / "x")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    out = subprocess.run([tmp_path / "x"], capture_output=True, text=True, check=True).stdout
    return [int(line) for line in out.split()]


def test_addresses_masks_and_resets_are_those_of_the_map(exported, tmp_path):
    expected = {}
    for part in printed_map.parts():
        expected[f"offsetof(gyro_registers_t, {part.name})"] = part.address
        for name, low, width, reset in part.fields:
            macro = f"GYRO_REGISTERS__{part.name}__{name}"
            expected[f"{macro}_bm"] = (2**width - 1) * 2**low
            expected[f"{macro}_bp"] = low
            if reset is not None:
                expected[f"{macro}_reset"] = reset
    assert values_of(exported, tmp_path, expected) == list(expected.values())


def test_formats_are_those_of_the_map(exported, tmp_path):
    expected = {}
    for row in printed_map.rows():
        macro = f"GYRO_{row.name}"
        expected[f"{macro}_ADDRESS"] = 8 * row.index
        expected[f"{macro}_WIDTH"] = row.width
        expected[f"{macro}_SIGNED"] = row.signed
        expected[f"{macro}_FRACTION_BITS"] = row.fraction_bits
        expected[f"{macro}_INTEGER_BITS"] = row.width - row.signed - row.fraction_bits
        expected[f"1 / {macro}_LSB"] = 2**row.fraction_bits
        if row.reset is not None:
            assert not (row.signed and row.reset >> row.width - 1), "no reset value is negative today"
            expected[f"{macro}_RESET"] = row.reset
        for k, name in enumerate(row.value_names()):
            expected[f"{macro}__{name}"] = k
    assert values_of(exported, tmp_path, expected) == list(expected.values())


def test_units_are_texts_and_a_state_has_no_reset(exported):
    text = (exported / "c" / "gyro_formats.h").read_text()
    assert '#define GYRO_RATE_UNIT "deg/s"\n' in text
    assert '#define GYRO_TEMPERATURE_UNIT "256 code LSB"\n' in text
    assert "GYRO_RATE_SCALE_RESET" in text
    assert "GYRO_RATE_RESET" not in text


def test_a_negative_reset_is_negative(exported, tmp_path):
    text = systemrdl.text().replace(
        "VALUE[31:0] = 32'h0;\n    } RATE_BIAS @", "VALUE[31:0] = 32'hfffffffe;\n    } RATE_BIAS @"
    )
    assert text != systemrdl.text()
    (tmp_path / "map.rdl").write_text(text)
    assert "#define GYRO_RATE_BIAS_RESET INT64_C(-2)\n" in c_header.text(
        export_registers.compiled(tmp_path / "map.rdl"), 4.0
    )


def test_cplusplus_takes_them_too(exported, tmp_path):
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed: C++ was NOT tried")
    (tmp_path / "x.cpp").write_text('#include "gyro_registers.h"\n#include "gyro_driver.h"\nint main() { return 0; }\n')
    command = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", f"-I{exported / 'c'}", "-c", tmp_path / "x.cpp"]
    subprocess.run([*command, "-o", tmp_path / "x.o"], check=True)
