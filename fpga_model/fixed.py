"""Fixed-point core: formats [s, i, f], their growth, and every rounding and overflow rule by one neutral name.

    value = raw * 2**-f,   -s * 2**(i+f) <= raw < 2**(i+f),   width = s + i + f

Raw values are int64. Formats are data: `mul_fmt` and `add_fmt` hold every result exactly, and a block asserts at
import that its widest intermediate stays within 63 bits, so that no kernel can overflow silently. A format may depend
on the design record: its widths are ints of the default design that remember their rule, and `Fmt.for_design` has those
of another one. Sums, differences and `most` of widths keep the rule; any other operation gives a plain int.

Rounding  `n` LSBs are dropped, 0 <= n <= 62; the names say what happens to ties (`half_*`) or to everything else
Overflow  `clamp` saturates, `wrap` keeps the low bits (two's complement), `wrap_unsigned` for phase-like words
Source    fpga_model/rounding_aliases.py (what other tools call each rule)

`floor` is free in gates but shifts the mean by half an LSB, which an integrator turns into a ramp. `half_up`, one carry
input, is the rule of the blocks unless they say otherwise. Round first, then saturate: rounding can pass the maximum.
"""

from fractions import Fraction
from types import UnionType
from typing import NamedTuple, get_type_hints

from fpga_model.jit import inlined

MAX_WIDTH = 63


# Widths that the design decides ---------------------------------------------------------------------------------------


class Term(NamedTuple):
    """What the design decides of a width: its expression in the RTL, its default, and rule(design)."""

    text: str
    default: int
    rule: object


class Width(int):
    """A number of bits that the design decides: a constant and terms {Term: how often}.

    for_design(design)  the number at that design
    text                the expression that gives it in the RTL
    """

    def __new__(cls, constant, terms):
        self = super().__new__(cls, constant + sum(count * term.default for term, count in terms.items()))
        self.constant, self.terms = constant, {term: count for term, count in terms.items() if count}
        return self

    def for_design(self, design):
        """The number at a design."""
        return int(self.constant + sum(count * term.rule(design) for term, count in self.terms.items()))

    @property
    def text(self):
        """As `2*A-B+5`."""
        signs = {1: "+", -1: "-"}
        parts = [signs.get(count, f"{count:+d}*") + term.text for term, count in self.terms.items()]
        return "".join([*parts, f"{self.constant:+d}" if self.constant else ""]).removeprefix("+")

    def __add__(self, other):
        more = other if isinstance(other, Width) else Width(int(other), {})
        terms = {term: self.terms.get(term, 0) + more.terms.get(term, 0) for term in (*self.terms, *more.terms)}
        return Width(self.constant + more.constant, terms)

    __radd__ = __add__

    def __neg__(self):
        return Width(-self.constant, {term: -count for term, count in self.terms.items()})

    def __sub__(self, other):
        return self + -other

    def __rsub__(self, other):
        return other + -self


RULES = object()  # in place of a design: widths stay as they are


def design_width(number, design):
    """A width, or a plain number, at a design."""
    return number.for_design(design) if isinstance(number, Width) else number


def most(*numbers):
    """The largest of some widths."""
    if any(isinstance(n, Width) for n in numbers):
        text = ", ".join(n.text if isinstance(n, Width) else str(n) for n in numbers)
        term = Term(f"max({text})", max(map(int, numbers)), lambda d: max(design_width(n, d) for n in numbers))
        return Width(0, {term: 1})
    return max(numbers)


# Formats --------------------------------------------------------------------------------------------------------------


class Fmt(NamedTuple):
    """Number format [s, i, f]: sign, integer and fraction bits; `i` or `f` may be negative, the width may not."""

    s: int
    i: int
    f: int

    @property
    def width(self):
        return self.s + self.i + self.f

    @property
    def lo(self):
        return -(1 << (self.i + self.f)) if self.s else 0

    @property
    def hi(self):
        return (1 << (self.i + self.f)) - 1

    def __str__(self):
        return f"[{self.s},{self.i},{self.f}]"

    def holds(self, raw):
        return self.lo <= raw <= self.hi

    def for_design(self, design):
        """The format at a design, in plain ints; None for the default one, `RULES` for widths that know their rule."""
        if design is RULES:
            return self
        return Fmt(*(int(bits) if design is None else design_width(bits, design) for bits in self))


def formats(record, design=None, parts_template=None):
    """`record` filled with the formats of its registers, which are the types of its fields; a list for a tuple.

    A part `Record | None` is None, unless a record `parts_template` has it.

    design  as in `Fmt.for_design`
    """
    hints = get_type_hints(record).items()
    return record(*(_format(hint, design, getattr(parts_template, name, None)) for name, hint in hints))


def _format(hint, design, parts_template):
    if isinstance(hint, UnionType):
        return None if parts_template is None else formats(hint.__args__[0], design, parts_template)
    if isinstance(hint, type):
        return formats(hint, design, parts_template)
    return tuple(fmt.for_design(design) for fmt in hint) if isinstance(hint, list) else hint.for_design(design)


def bits(n):
    """Format of an unsigned integer of `n` bits: counters, flags, packed pins."""
    return Fmt(0, n, 0)


def signed_bits(n):
    """Format of a signed integer of `n` bits in all."""
    return Fmt(1, n - 1, 0)


def mul_fmt(a, b):
    """Format that holds every product exactly (min times min is the one that needs the extra bit)."""
    return Fmt(max(a.s, b.s), a.i + b.i + (a.s & b.s), a.f + b.f)


def add_fmt(a, b):
    """Format that holds every sum exactly."""
    return Fmt(max(a.s, b.s), most(a.i, b.i) + 1, most(a.f, b.f))


def sub_fmt(a, b):
    """Format that holds every difference exactly; always signed."""
    return Fmt(1, most(a.i, b.i) + (1 if a.s or b.s else 0), most(a.f, b.f))


def quantize(value, fmt, name="value"):
    """Raw integer nearest to `value` (ties to even) in `fmt`; raises instead of saturating.

    value  int, float or Fraction, in the unit of the format
    Raises ValueError naming the quantity, the value and the limits.
    """
    if value != value or value in (float("inf"), float("-inf")):
        raise ValueError(f"{name}: {value} is not a finite number")
    raw = round(Fraction(value) * Fraction(2) ** fmt.f)
    if not fmt.holds(raw):
        scale = Fraction(2) ** fmt.f
        limits = f"{float(fmt.lo / scale):g} .. {float(fmt.hi / scale):g}"
        raise ValueError(f"{name}: {float(value):g} does not fit format {fmt}, which holds {limits}")
    return raw


def to_real(raw, fmt):
    """Exact value of a raw integer as a Fraction."""
    return Fraction(int(raw)) / Fraction(2) ** fmt.f


# Rounding: drop n LSBs ----------------------------------------------------------------------------------------------


@inlined
def floor(x, n):
    """Toward minus infinity: drop the bits."""
    return x >> n


@inlined
def ceil(x, n):
    """Toward plus infinity."""
    return (x + ((1 << n) - 1)) >> n


@inlined
def toward_zero(x, n):
    """Toward zero: magnitude truncation."""
    return (x + (((1 << n) - 1) if x < 0 else 0)) >> n


@inlined
def half_up(x, n):
    """Nearest, ties toward plus infinity: add half, drop."""
    return (x + ((1 << n) >> 1)) >> n


@inlined
def half_down(x, n):
    """Nearest, ties toward minus infinity."""
    return (x + (((1 << n) - 1) >> 1)) >> n


@inlined
def half_even(x, n):
    """Nearest, ties to even (convergent)."""
    return (x + (((1 << n) - 1) >> 1) + ((x >> n) & 1 if n > 0 else 0)) >> n


@inlined
def half_away(x, n):
    """Nearest, ties away from zero."""
    return (x + (((1 << n) - 1) >> 1 if x < 0 else (1 << n) >> 1)) >> n


@inlined
def half_zero(x, n):
    """Nearest, ties toward zero."""
    return (x + ((1 << n) >> 1 if x < 0 else ((1 << n) - 1) >> 1)) >> n


ROUNDINGS = {
    "floor": floor,
    "ceil": ceil,
    "toward_zero": toward_zero,
    "half_up": half_up,
    "half_down": half_down,
    "half_even": half_even,
    "half_away": half_away,
    "half_zero": half_zero,
}


# Overflow -----------------------------------------------------------------------------------------------------------


@inlined
def clamp(x, lo, hi):
    """Saturate to lo .. hi."""
    return lo if x < lo else (hi if x > hi else x)


@inlined
def wrap(x, width):
    """Keep the low `width` bits, read as two's complement; 1 <= width <= 62."""
    return ((x + (1 << (width - 1))) & ((1 << width) - 1)) - (1 << (width - 1))


@inlined
def wrap_unsigned(x, width):
    """Keep the low `width` bits, read as unsigned; 0 <= width <= 62."""
    return x & ((1 << width) - 1)
