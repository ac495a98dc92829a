"""The causes that a diagnosis can name. The list is fixed: docs/diagnosis.md says what belongs to each.

The order is that of preference where two causes give the same rows.
"""

WORDS = {
    "reset": "another reset value",
    "no_reset": "a register without reset",
    "async_reset": "an asynchronous reset",
    "condition": "the condition of a branch is missing, inverted or another one",
    "priority": "the order of two branches is exchanged",
    "late": "a register too many",
    "early": "a register too few: its new value is read in the place of the old one",
    "rounding": "another rounding rule",
    "wrap": "wraps where it should saturate",
    "saturate": "saturates where it should wrap",
    "limit": "another limit of a saturation",
    "comparison": "a comparison is off by one",
    "bit_order": "the order of the bits is reversed",
    "sign": "the sign is wrong, or a flag is inverted",
    "complement": "~x in the place of -x",
    "signedness": "a signed value is read as unsigned, or an unsigned one as signed",
    "gain": "a shift is one bit off",
    "width": "an intermediate value has too few bits",
    "constant": "a constant, a parameter or a word of a table is off by one LSB",
    "operand": "another register or input in the place of an operand",
    "operator": "another operation on bits",
    "bit_swap": "two bits are exchanged",
    "stuck": "a bit is stuck",
}
CAUSES = tuple(WORDS)
RANK = {cause: k for k, cause in enumerate(CAUSES)}
