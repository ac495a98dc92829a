"""C header with address, format, unit and reset value of every register, read from the compiled SystemRDL.

Masks and positions of fields are in the header that PeakRDL makes of the same tree.
Source  docs/register_map.md
"""

import re

from analog_frontend.parts import adc
from fpga_model import rate_output

GUARD = "GYRO_FORMATS_H"
HALF = re.compile(r"_(LO|HI)$")


def temperature(vref_v):
    """(degC at t = 0, degC per LSB) of the register TEMPERATURE behind a converter with this reference voltage."""
    volts = 2.0**rate_output.CODE_CUT * vref_v / adc.FULL_CODE
    return 25.0 - adc.SENSOR_V_AT_25_DEGC / adc.SENSOR_V_PER_K, volts / adc.SENSOR_V_PER_K


def _registers(top):
    """{name: words of the register, the low one first} of a compiled map."""
    words_by_name = {}
    for reg in top.registers():
        name = HALF.sub("", reg.inst_name) if reg.size * 8 < _register_width(reg) else reg.inst_name
        words_by_name.setdefault(name, []).append(reg)
    return words_by_name


def _format(reg):
    return tuple(int(part) for part in reg.get_property("gyro_format")[1:-1].split(","))


def _register_width(reg):
    return sum(_format(reg))


def _reset(words):
    """Reset value as the register's number; None if it is the state of another block."""
    raw = 0
    for word in words:
        for field in word.fields():
            reset = field.get_property("reset")
            if reset is None:
                return None
            raw |= reset << field.low + word.get_property("gyro_low_bit")
    width = _register_width(words[0])
    return raw - (1 << width) if words[0].get_property("gyro_signed") and raw >> width - 1 else raw


def _defines(name, words):
    """Lines of one register."""
    low = words[0]
    sign, integer_bits, fraction_bits = _format(low)
    macros = {
        "ADDRESS": f"0x{low.absolute_address:03X}",
        "WIDTH": _register_width(low),
        "SIGNED": sign,
        "INTEGER_BITS": integer_bits,
        "FRACTION_BITS": fraction_bits,
        "LSB": f"(1.0 / {1 << fraction_bits}.0)",
        "UNIT": f'"{low.get_property("gyro_unit")}"',
    }
    if (reset := _reset(words)) is not None:
        macros["RESET"] = f"INT64_C({reset})"
    yield f"/* {name}, {low.get_property('gyro_format')}, LSB {low.get_property('gyro_lsb')} */"
    yield from (f"#define GYRO_{name}_{key} {value}" for key, value in macros.items())
    for field in low.fields():
        for value in field.get_property("encode") or ():
            yield f"#define GYRO_{name}__{value.name} {value.value}"
    yield ""


def text(top, vref_v):
    """The header of a compiled map and of a converter with this reference voltage."""
    at_zero, per_lsb = temperature(vref_v)
    body = [line for name, words in _registers(top).items() for line in _defines(name, words)]
    return "\n".join(
        [
            "/* Formats of the gyroscope's registers. Written by gyro registers.",
            " *",
            " * value = raw x LSB in UNIT; raw has WIDTH bits, two's complement where SIGNED is 1.",
            " * ADDRESS is in bytes. A register of more than 32 bits has a second word at ADDRESS + 4.",
            " */",
            f"#ifndef {GUARD}",
            f"#define {GUARD}",
            "",
            "#include <stdint.h>",
            "",
            *body,
            "/* TEMPERATURE in degC, of the converter's own sensor; t is cut, so its step begins at t x LSB */",
            f"#define GYRO_DEGC_AT_T_0 ({at_zero!r})",
            f"#define GYRO_DEGC_PER_T {per_lsb!r}",
            "",
            f"#endif /* {GUARD} */",
            "",
        ]
    )
