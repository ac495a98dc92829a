"""The C driver, compiled with every check of the compiler, against Python that knows nothing of it."""

import random
import re
import shutil
import subprocess
from fractions import Fraction
from pathlib import Path

import pytest

from analog_frontend.parts import adc
from fpga_model import rate_output
from tests.testbench.register_map import printed_map
from tests.testbench.register_map.conftest import STRICT

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed: the driver was NOT compiled")
GUIDE = Path(__file__).parents[3] / "docs" / "register_map.md"


def limits(width, signed):
    return (-(2 ** (width - 1)), 2 ** (width - 1) - 1) if signed else (0, 2**width - 1)


def binary(raw, width):
    """Two's complement as a text of 64 digits, zeros above `width`."""
    digits = "".join(str(int(raw) // 2**k % 2) for k in reversed(range(width)))
    return digits.rjust(64, "0")


FORMATS = sorted({(row.width, row.signed) for row in printed_map.rows()} | {(1, 0), (2, 1), (33, 1), (62, 0), (62, 1)})


def test_values_become_words_and_what_does_not_fit_is_refused(driver):
    draw, lines, expected = random.Random(1), [], []
    for width, signed in FORMATS:
        low, high = limits(width, signed)
        inside = [low, high, 0, 1, high // 3] + [draw.randint(low, high) for _ in range(40)]
        for raw in inside:
            digits = binary(raw, width)
            words = 2 if width > 32 else 1
            untouched = 0xDEADBEEF
            lines.append(f"pack {width} {signed} {raw}")
            expected.append(f"{words} {int(digits[32:], 2)} {int(digits[:32], 2) if words == 2 else untouched}")
        for raw in (low - 1, high + 1, -(2**63), 2**63 - 1):
            lines.append(f"pack {width} {signed} {raw}")
            expected.append(f"0 {0xDEADBEEF} {0xDEADBEEF}")
    assert driver(lines) == expected


def test_words_become_values_whatever_stands_above_the_register(driver):
    draw, lines, expected = random.Random(2), [], []
    for width, signed in FORMATS:
        low, high = limits(width, signed)
        for raw in [low, high, 0] + [draw.randint(low, high) for _ in range(40)]:
            above = draw.choice((0, 2**64 - 1, draw.getrandbits(64)))
            digits = binary(above, 64)[: 64 - width] + binary(raw, width)[64 - width :]
            lines.append(f"unpack {width} {signed} {int(digits[32:], 2)} {int(digits[:32], 2)}")
            expected.append(str(raw))
    assert driver(lines) == expected


def crc_by_division(data):
    """CRC-8/SAE-J1850 as long division: the first byte inverted, eight zeros behind, remainder by 0x11D, inverted."""
    bits = [int(digit) for byte in data for digit in f"{byte:08b}"] + [0] * 8
    bits[:8] = [1 - bit for bit in bits[:8]]
    divisor = [1, 0, 0, 0, 1, 1, 1, 0, 1]
    for k in range(len(bits) - 8):
        if bits[k]:
            bits[k : k + 9] = [a ^ b for a, b in zip(bits[k : k + 9], divisor, strict=True)]
    return int("".join(map(str, bits[-8:])), 2) ^ 0xFF


def test_crc_is_that_of_sae_j1850(driver):
    draw = random.Random(3)
    frames = [b"123456789", b"\0", b"\xff", *(draw.randbytes(draw.randint(1, 64)) for _ in range(200))]
    expected = [str(crc_by_division(frame)) for frame in frames]
    assert expected[0] == str(0x4B), "the check value in catalogues of CRCs"
    assert driver([f"crc {len(frame)} {' '.join(map(str, frame))}" for frame in frames]) == expected


def test_crc_sees_every_burst_of_eight_bits(driver):
    frame, wrong = bytes(range(10, 17)), []
    for place in range(8 * len(frame) - 7):
        for burst in (0x01, 0x81, 0xFF, 0xA5):
            wrong.append((int.from_bytes(frame, "big") ^ burst << place).to_bytes(len(frame), "big"))
    found = driver([f"crc {len(data)} {' '.join(map(str, data))}" for data in (frame, *wrong)])
    assert found[0] not in found[1:]


def test_rate_is_in_deg_per_s(driver):
    raws = [0, 1, -1, 2**31 - 1, -(2**31), 104857600]
    found = [Fraction(float(line)) for line in driver([f"rate {raw}" for raw in raws])]
    assert found == [Fraction(raw, 2**20) for raw in raws]
    assert found[-1] == 100


def test_temperature_is_that_of_the_sensor_within_half_a_step(driver):
    """The plant's sensor and converter, and the cut of the firmware, in front of the driver."""
    part = adc.design()
    temps_degc = [-40.0, -12.3, 0.0, 25.0, 25.2, 60.0, 84.9]
    codes = [adc.code(part, adc.TEMPERATURE, adc.temperature_volts(t)) for t in temps_degc]
    found = [float(line) for line in driver([f"temperature {code >> rate_output.CODE_CUT}" for code in codes])]
    # data sheet: 490 uV per kelvin; a step of t is 256 codes of 4 V / 2^23, the converter's own step is 10 codes
    step_k = 256 * 4.0 / 2**23 / 490e-6
    for temp, degc in zip(temps_degc, found, strict=True):
        assert abs(degc - temp) <= step_k / 2 + 5 * step_k / 256
    assert 0.249 < step_k < 0.2492


def test_registers_are_named(driver):
    by_name = {row.name: row for row in printed_map.rows()}
    scale, frequency = by_name["RATE_SCALE_T1"], by_name["FREQUENCY"]
    expected = f"{8 * scale.index} {scale.width} 1 1 {8 * frequency.index} 48 0 2"
    assert driver(["register"]) == [expected]


BUS = """
#include <stdint.h>
static uint32_t word[512], latched, held;
static int two_words(uint16_t address) { return address >> 3 >= 2 && address >> 3 <= 5; }
uint32_t bus_read(uint16_t address) {
    if (two_words(address) && address & 4) return latched;
    latched = two_words(address) ? word[address / 4 + 1] : latched;
    return word[address / 4];
}
void bus_write(uint16_t address, uint32_t value) {
    if (two_words(address) && !(address & 4)) { held = value; return; }
    if (two_words(address)) word[address / 4 - 1] = held;
    word[address / 4] = value;
}
__attribute__((constructor)) static void state(void) {
    word[0x4B * 2] = (uint32_t)(-100 * 1048576);
    word[0x4C * 2] = 1190;
    word[0x41 * 2] = 12;
}
"""


def test_the_example_of_the_page_prints_what_it_says(exported, tmp_path):
    example, of_spi = re.findall(r"```c\n(.*?)```", GUIDE.read_text(), re.S)
    (printed,) = re.findall(r"```text\n(.*?)```", GUIDE.read_text(), re.S)
    (tmp_path / "example.c").write_text(example)
    (tmp_path / "bus.c").write_text(BUS)
    folder = exported / "c"
    command = ["gcc", *STRICT, f"-I{folder}", "example.c", "bus.c", folder / "gyro_driver.c", "-o", "example"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    assert subprocess.run(["./example"], cwd=tmp_path, capture_output=True, text=True).stdout == printed
    head = '#include "gyro_spi.h"\nvoid spi_transfer(const uint8_t *sent, uint8_t *received, size_t count);\n'
    (tmp_path / "spi.c").write_text(head + of_spi)
    command = ["gcc", *STRICT, "-Wno-unused-function", f"-I{folder}", "-c", "spi.c"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
