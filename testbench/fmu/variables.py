"""Variables of the two FMUs: names, types, units; as a header of C, and for the model descriptions.

A variable of n numbers has the value references first .. first + n - 1. FMI 3.0 knows it as an array by the first of
them, FMI 2.0 as n variables.
Source    docs/fmu.md
"""

from typing import NamedTuple

MOST_EDGES, CHANNELS = 8, 5
REAL, INT32, INT64, BOOLEAN = "dilb"
INPUT, OUTPUT = "input", "output"


class Variable(NamedTuple):
    """A variable; `start` of an input, one number for all its elements."""

    name: str
    kind: str
    causality: str
    text: str
    start: object = 0
    size: int = 1
    unit: str = ""


TIME = Variable("time", REAL, "independent", "time", unit="s")
# What the firmware's chips tell the plant about a tick; inputs of one FMU, outputs of the other
PINS = (
    ("drive_code", "code of the drive DAC at the end of the tick", 1),
    ("sense_code", "code of the sense DAC at the end of the tick", 1),
    ("quadrature_code", "code of the DAC of V_q at the end of the tick; acts from the next frame on", 1),
    ("drive_clock", "clock of the tick at which the drive DAC changed, -1: not", 1),
    ("sense_clock", "clock of the tick at which the sense DAC changed, -1: not", 1),
    ("edge_count", "edges of the reference pins in the tick", 1),
    ("edge_clock", "clock of each edge, in order", MOST_EDGES),
    ("edge_pin", "pin of each edge: 0 drive sin, 1 drive cos, 2 sense sin, 3 sense cos", MOST_EDGES),
)
CONVERTER = (
    ("adc_code", "last codes of the converter: drive sin, drive cos, sense sin, sense cos, temperature", CHANNELS),
    ("drdy_clock", "clock of the next tick at which DRDY falls, -1: not", 1),
)


def _code_variables(rows, causality, start):
    return [Variable(name, INT32, causality, text, start.get(name, 0), size) for name, text, size in rows]


def firmware():
    """Variables of the firmware's FMU."""
    host = [
        Variable("host_write", BOOLEAN, INPUT, "1: the host writes at the first clock of the tick"),
        Variable("host_address", INT32, INPUT, "address of the register that the host writes"),
        Variable("host_data", INT64, INPUT, "raw word of 48 bits that the host writes"),
    ]
    fmu_outputs = [
        Variable("read_code", INT32, OUTPUT, "codes that the firmware has read last", size=CHANNELS),
        Variable("frequency_word", INT64, OUTPUT, "word of the DDS"),
        Variable("amplitude_word", INT64, OUTPUT, "word of the amplitude loop"),
        Variable("rate_word", INT64, OUTPUT, "word of the rate loop"),
        Variable("quadrature_word", INT64, OUTPUT, "word of the quadrature loop"),
        Variable("state", INT32, OUTPUT, "state of the sequencer"),
        Variable("lock", INT32, OUTPUT, "a bit for each locked loop"),
        Variable("flags", INT32, OUTPUT, "flags of faults"),
        Variable("rate_output", REAL, OUTPUT, "measured rate", unit="deg/s"),
    ]
    idle = {"drdy_clock": -1}
    return [TIME, *_code_variables(CONVERTER, INPUT, idle), *host, *_code_variables(PINS, OUTPUT, {}), *fmu_outputs]


def plant(start, temp_degc, acceleration_g=0.0):
    """Variables of the plant's FMU; `start` has the codes of the DACs at power-on."""
    tilt = "steady acceleration along the sense gap, taken at the begin of a frame"
    stimulus = [
        Variable("rate", REAL, INPUT, "rate of rotation, taken at the begin of a frame", 0.0, unit="rad/s"),
        Variable("temperature", REAL, INPUT, "temperature, taken at the begin of a frame", temp_degc, unit="degC"),
        Variable("acceleration", REAL, INPUT, tilt, acceleration_g, unit="g"),
    ]
    motion = [
        Variable("x", REAL, OUTPUT, "displacement of the drive mode", unit="m"),
        Variable("y", REAL, OUTPUT, "displacement of the sense mode", unit="m"),
    ]
    idle = {"drive_clock": -1, "sense_clock": -1, **start}
    return [TIME, *stimulus, *_code_variables(PINS, INPUT, idle), *_code_variables(CONVERTER, OUTPUT, {}), *motion]


def value_references(variables):
    """[(value reference, variable)]."""
    first, reference_pairs = 0, []
    for v in variables:
        reference_pairs.append((first, v))
        first += v.size
    return reference_pairs


def header(variables, token, tick_hz):
    """Text of variables.h."""
    placed = value_references(variables)
    slots = [(v, k) for _, v in placed for k in range(v.size)]
    sizes = ", ".join(str(0 if k else v.size) for v, k in slots)
    inputs = ", ".join(str(int(v.causality == INPUT)) for v, _ in slots)
    starts = [f"{{.d = {float(v.start)!r}}}" if v.kind == REAL else f"{{.i = {int(v.start)}}}" for v, _ in slots]
    return "\n".join(
        [
            "/* Value references of the variables, and what is known of each: kind, size, direction, start value. */",
            "#ifndef VARIABLES_H",
            "#define VARIABLES_H",
            "",
            f'#define TOKEN "{token}"',
            f"#define TICK_HZ {float(tick_hz)!r}",
            f'#define V_KINDS "{"".join(v.kind for v, _ in slots)}"',
            "",
            "enum {",
            *(f"    V_{v.name.upper()} = {first}, /* {v.text} */" for first, v in placed),
            f"    V_COUNT = {len(slots)}",
            "};",
            "",
            f"static const unsigned char v_size[] = {{{sizes}}};",
            f"static const unsigned char v_input[] = {{{inputs}}};",
            f"#define V_START {{{', '.join(starts)}}}",
            "",
            "#endif",
            "",
        ]
    )
