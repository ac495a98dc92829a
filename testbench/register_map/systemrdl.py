"""The register map as SystemRDL 2.0 text: each word of the bus is a `reg` of 32 bits.

What SystemRDL has no property for is one of these, of each `reg`:

    gyro_format     [s,i,f] of the whole register: raw = value x 2^f
    gyro_signed     the whole register is two's complement
    gyro_unit       unit of the value
    gyro_lsb        one LSB of the whole register
    gyro_low_bit    bit of the register that is bit 0 of this word

Source  docs/register_map.md
"""

from fpga_model.design_record import DEFAULT
from testbench.register_map.words import WORD_BITS, design_register_map, lsb, unit, words

NAME = "gyro_registers"
HEAD = f"""\
// Register map of the gyroscope's firmware, a word of {WORD_BITS} bits per reg. Written by gyro registers.

property gyro_format  {{ type = string;  component = reg; }};
property gyro_signed  {{ type = boolean; component = reg; }};
property gyro_unit    {{ type = string;  component = reg; }};
property gyro_lsb     {{ type = string;  component = reg; }};
property gyro_low_bit {{ type = longint; component = reg; }};
"""
# What software and hardware may do; a constant is `hw = na`
ACCESS = {
    "rw": "sw = rw; hw = r;",
    "ro": "sw = r; hw = w;",
    "w1c": "sw = rw; hw = rw; onwrite = woclr;",
    "constant": "sw = r; hw = na;",
}
READ_LOW = "A read latches {name}_HI."
READ_HIGH = "Read it after {name}_LO: that read latched it."
HALVES = {
    ("ro", "LO"): READ_LOW,
    ("ro", "HI"): READ_HIGH,
    ("rw", "LO"): f"{READ_LOW} A write is held until {{name}}_HI is written.",
    ("rw", "HI"): f"{READ_HIGH} Write it after {{name}}_LO: both take effect in one clock. Alone it changes nothing.",
}


def _quote_text(text):
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _description(word):
    register = word.register
    rule = HALVES.get((register.access, word.half), "")
    return f"{register.doc}. {rule}".strip().format(name=register.name.upper())


def _enumeration(name, field):
    lines = [f"        {value} = {field.width}'d{k};" for k, value in enumerate(field.values)]
    return "\n".join([f"    enum {name} {{", *lines, "    };"])


def _field(word, field, access):
    reset = "" if field.reset is None else f" = {field.width}'h{field.reset:x}"
    encode = f" encode = {word.name.lower()}_values;" if field.values else ""
    declarator = f"{field.name}[{field.low + field.width - 1}:{field.low}]{reset}"
    return f"        field {{ {ACCESS[access]}{encode} }} {declarator};"


def _reg(word):
    register = word.register
    access = "constant" if register.access == "ro" and not register.path else register.access
    properties = {
        "name": _quote_text(word.name),
        "desc": _quote_text(_description(word)),
        "gyro_format": _quote_text(str(register.fmt)),
        "gyro_signed": "true" if register.fmt.s else "false",
        "gyro_unit": _quote_text(unit(register)),
        "gyro_lsb": _quote_text(lsb(register)),
        "gyro_low_bit": word.low_bit,
    }
    enumerations = [_enumeration(f"{word.name.lower()}_values", field) for field in word.fields if field.values]
    lines = [f"        {name} = {value};" for name, value in properties.items()]
    fields = [_field(word, field, access) for field in word.fields]
    return "\n".join([*enumerations, "    reg {", *lines, *fields, f"    }} {word.name} @ 0x{word.address:03x};"])


def text(design=DEFAULT):
    """The file of a design."""
    body = "\n\n".join(_reg(word) for word in words(design_register_map(design)))
    return f"""{HEAD}
addrmap {NAME} {{
    name = "FTR gyro";
    desc = "Registers of the gyroscope's firmware.";
    littleendian;
    default regwidth = {WORD_BITS};
    default accesswidth = {WORD_BITS};

{body}
}};
"""
