"""Dumps in GHDL's own format, GHW: signals of bits, vectors of bits, integers and enumerations, by their paths.

    header | STR strings | TYP types | WKT | HIE hierarchy | EOH | (SNP snapshot | CYC cycles)... | DIR | TAI

Every element of a signal has a number; a port on a slice lists the numbers of that slice, so elements are looked up one
by one and never taken as neighbours. Paths are those of GHDL's VCD; parts of a record follow a dot, elements of an
array of vectors stand in parentheses: tb.dut.pair.code, tb.dut.words(2). What is not foreseen is an error.
Checked against the VCD of the same runs.
Source  GHDL 2.0, src/grt/grt-waves.adb (what is written)
"""

import math
import struct
from typing import NamedTuple

from testbench.errors import FileError
from testbench.storage.inputs import read_bytes

MAGIC = b"GHDLwave\n"
MOST_TIME = 1 << 62  # fs
B2, E8, I32, I64, F64, P32, P64 = 22, 23, 25, 26, 27, 28, 29
ARRAY, RECORD, OPEN_RECORD = 31, 32, 33
SUB_SCALAR, SUB_ARRAY, SUB_OPEN_ARRAY, SUB_RECORD, SUB_OPEN_RECORD = 34, 35, 37, 38, 39
BLOCK, IF, FOR, INSTANCE, PACKAGE, PROCESS, END, SIGNAL, LAST_PORT = 3, 4, 5, 6, 7, 13, 15, 16, 21
LOGIC = "UX01ZWLH-"


class Scalar(NamedTuple):
    """How a value is stored (kind), and the literals of an enumeration."""

    kind: int
    literals: tuple = ()
    count: int = 1

    @property
    def width(self):
        """Bits of a value, or None where it has none."""
        if self.kind in (I32, I64):
            return 32 if self.kind == I32 else 64
        if self.kind not in (B2, E8):
            return None
        return 1 if self.is_bit else max(1, (len(self.literals) - 1).bit_length())

    @property
    def is_bit(self):
        return self.literals in (("false", "true"), ("'0'", "'1'"), tuple(f"'{level}'" for level in LOGIC))

    def text(self, value):
        """Bits of a value, the highest first; levels of std_ulogic are themselves."""
        if self.is_bit:
            return LOGIC[value] if len(self.literals) > 2 else str(value)
        return f"{value & ((1 << self.width) - 1):0{self.width}b}"


class Array(NamedTuple):
    """`ranges` and `count` (of scalars) are None while a dimension is open; `element` too may be open then."""

    element: object
    dimensions: int
    ranges: tuple | None = None
    count: int | None = None


class Record(NamedTuple):
    """`count` of scalars is None while a field is open. Counts are kept: types of types may be walked for ever."""

    fields: tuple
    count: int | None = None


def sized_array(element, dimensions, ranges=None):
    """Array with the number of its scalars."""
    if ranges is None or _is_open(element):
        return Array(element, dimensions, ranges)
    return Array(element, dimensions, ranges, math.prod(ranges) * element.count)


def sized_record(fields):
    """Record with the number of its scalars."""
    counts = [part.count for _, part in fields]
    return Record(fields, None if None in counts else sum(counts))


def _is_open(kind):
    return kind.count is None


class _Reader:
    """Bytes of a file and a place in them; running over the end is an IndexError or a struct.error."""

    def __init__(self, data):
        self.data, self.at, self.order = data, 0, "<"

    def byte(self):
        value = self.data[self.at]
        self.at += 1
        return value

    def take(self, count):
        part = self.data[self.at : self.at + count]
        if len(part) != count:
            raise IndexError
        self.at += count
        return part

    def word(self, form="i"):
        return struct.unpack(self.order + form, self.take(struct.calcsize(self.order + form)))[0]

    def read_unsigned(self, bits=7):
        """A number of which each byte below 128, the last one, holds so many bits."""
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & ((1 << bits) - 1)) << shift
            shift += bits
            if byte < 128:
                return value
            self.require(shift < 70, "a number is too long")

    def read_signed(self):
        start_offset = self.at
        value = self.read_unsigned()
        bits = 7 * (self.at - start_offset)
        return value - (1 << bits) if value >> (bits - 1) else value

    def require(self, ok, what):
        if not ok:
            raise ValueError(what)

    def section(self, tag, zeros=4):
        self.require(self.take(4) == tag.encode() + b"\0", f"section {tag} is missing at this place")
        self.require(not any(self.take(zeros)), f"the head of section {tag} is not zero")


def _strings(r):
    """Strings, number 0 being none: each begins with so many characters of the one before it."""
    r.section("STR")
    count, _ = r.word(), r.word()
    out, shared_prefix = [None], ""
    for _ in range(count):
        text = bytearray()
        while not (r.data[r.at] < 32 or 128 <= r.data[r.at] < 160):
            text.append(r.byte())
        out.append(shared_prefix + text.decode("latin-1"))
        length = r.read_unsigned(bits=5)
        r.require(length <= len(out[-1]), "a string repeats more characters than the string before it has")
        shared_prefix = out[-1][:length]
    r.require(r.take(4) == b"EOS\0", "section STR has no end")
    return out


def _range(r):
    """Number of values of a range."""
    head = r.byte()
    kind, down = head & 127, head >> 7
    if kind in (B2, E8):
        start, stop = r.byte(), r.byte()
    elif kind in (I32, P32, I64, P64):
        start, stop = r.read_signed(), r.read_signed()
    elif kind == F64:
        r.take(16)
        return 0
    else:
        raise ValueError(f"a range is of the unknown kind {kind}")
    return max(0, (start - stop if down else stop - start) + 1)


def _read_bounds(r, kind):
    """The type with the bounds that follow in the file: its own ranges, then those of open elements."""
    if isinstance(kind, Array):
        ranges = tuple(_range(r) for _ in range(kind.dimensions))
        return sized_array(
            _read_bounds(r, kind.element) if _is_open(kind.element) else kind.element, kind.dimensions, ranges
        )
    return sized_record(tuple((name, _read_bounds(r, part) if _is_open(part) else part) for name, part in kind.fields))


def _read_type_reference(r, types):
    number = r.read_unsigned()
    r.require(0 < number < len(types), f"type number {number} is unknown")
    return types[number]


def _types(r, strings):
    """Types, number 0 being none; each is made of earlier ones."""
    r.section("TYP")
    out = [None]

    def earlier():
        return _read_type_reference(r, out)

    for _ in range(r.word()):
        kind = r.byte()
        name = strings[r.read_unsigned()]
        if kind in (B2, E8):
            out.append(Scalar(kind, tuple(strings[r.read_unsigned()] for _ in range(r.read_unsigned()))))
        elif kind in (I32, I64, F64):
            out.append(Scalar(kind))
        elif kind in (P32, P64):
            for _ in range(r.read_unsigned()):
                r.read_unsigned(), r.read_signed()
            out.append(Scalar(kind))
        elif kind == SUB_SCALAR:
            out.append(earlier())
            _range(r)
        elif kind == ARRAY:
            element, dimensions = earlier(), r.read_unsigned()
            r.require(dimensions > 0, f"array {name} has no dimension")
            for _ in range(dimensions):
                earlier()
            out.append(sized_array(element, dimensions))
        elif kind in (RECORD, OPEN_RECORD):
            out.append(sized_record(tuple((strings[r.read_unsigned()], earlier()) for _ in range(r.read_unsigned()))))
        elif kind in (SUB_ARRAY, SUB_RECORD):
            base = earlier()
            r.require(not isinstance(base, Scalar), f"type {name} has no elements")
            out.append(_read_bounds(r, base) if _is_open(base) else base)
        elif kind in (SUB_OPEN_ARRAY, SUB_OPEN_RECORD):
            out.append(earlier())
        else:
            raise ValueError(f"type {name} is of the unknown kind {kind}")
    r.require(r.byte() == 0, "section TYP has no end")
    return out


def leaf_signals(path, kind, numbers):
    """Yield (path, scalar, numbers) of what has a value: scalars and vectors of bits."""
    if kind.count == 0:
        return
    if isinstance(kind, Scalar):
        yield path, kind, numbers
    elif isinstance(kind, Record):
        for name, part in kind.fields:
            yield from leaf_signals(f"{path}.{name}", part, numbers[: part.count])
            numbers = numbers[part.count :]
    elif isinstance(kind.element, Scalar) and kind.element.is_bit and len(kind.ranges) == 1:
        yield path, kind.element, numbers
    elif len(kind.ranges) == 1:
        count = len(numbers) // kind.ranges[0]
        for k in range(kind.ranges[0]):
            yield from leaf_signals(f"{path}({k})", kind.element, numbers[k * count : (k + 1) * count])


def _scalars(kind):
    """The scalar of every element, in the order of their numbers."""
    if kind.count == 0:
        return []
    if isinstance(kind, Scalar):
        return [kind]
    if isinstance(kind, Record):
        return [scalar for _, part in kind.fields for scalar in _scalars(part)]
    return _scalars(kind.element) * (kind.count // kind.element.count)


def _hierarchy(r, strings, types):
    """({path: (scalar, numbers)}, {number: scalar})."""
    r.section("HIE")
    r.take(12)
    scopes, signals, stored = [], {}, {}
    while True:
        kind = r.byte()
        if kind == 0:
            break
        if kind == END:
            r.require(scopes, "the end of a scope has no begin")
            scopes.pop()
            continue
        name = strings[r.read_unsigned()]
        if kind == PROCESS:
            continue
        if kind in (BLOCK, IF, INSTANCE, PACKAGE):
            scopes.append(name)
        elif kind == FOR:
            scalar = _read_type_reference(r, types)
            r.require(isinstance(scalar, Scalar), "the index of a generate loop is not a scalar")
            scopes.append(f"{name}({_read_scalar(r, scalar.kind)})")
        elif SIGNAL <= kind <= LAST_PORT:
            signal_type = _read_type_reference(r, types)
            r.require(not _is_open(signal_type), f"signal {name} has no bounds")
            r.require(
                signal_type.count <= len(r.data) - r.at,
                f"signal {name} has {signal_type.count} elements, more than the file holds",
            )
            numbers = tuple(r.read_unsigned() for _ in range(signal_type.count))
            stored.update(zip(numbers, _scalars(signal_type)))
            path = ".".join([*scopes, name])
            signals.update((leaf, (scalar, part)) for leaf, scalar, part in leaf_signals(path, signal_type, numbers))
        else:
            raise ValueError(f"{name} is of the unknown kind {kind} in the hierarchy")
    r.require(not scopes, "a scope does not end")
    r.require(sorted(stored) == list(range(1, len(stored) + 1)), "the numbers of the signals have gaps")
    r.section("EOH", 0)
    return signals, stored


def _read_scalar(r, kind):
    if kind in (B2, E8):
        return r.byte()
    if kind in (I32, I64, P32, P64):
        return r.read_signed()
    r.take(8)
    return 0


def _changes(r, stored, watched):
    """Yield (time, group, place, value) of the watched numbers {number: [(group, place)]}, in order of time."""
    kinds = {number: scalar.kind for number, scalar in stored.items()}
    sections = []
    while True:
        sections.append(r.at)
        tag = r.take(4)
        if tag == b"SNP\0":
            r.require(not any(r.take(4)), "the head of section SNP is not zero")
            time = r.word("q")
            for number in range(1, len(stored) + 1):
                value = _read_scalar(r, kinds[number])
                for group, element_index in watched.get(number, ()):
                    yield time, group, element_index, value
            r.require(r.take(4) == b"ESN\0", "section SNP has no end")
        elif tag == b"CYC\0":
            time = r.word("q")
            while True:
                number = 0
                while step := r.read_unsigned():
                    number += step
                    r.require(number in kinds, f"signal {number} is not in the hierarchy")
                    value = _read_scalar(r, kinds[number])
                    for group, element_index in watched.get(number, ()):
                        yield time, group, element_index, value
                step = r.read_signed()
                if step < 0:
                    break
                time += step
            r.require(r.take(4) == b"ECY\0", "section CYC has no end")
        elif tag == b"DIR\0":
            break
        else:
            raise ValueError("a section is neither a snapshot nor cycles")
    _directory(r, sections)


def _directory(r, sections):
    """Check the list of sections at the end: it tells whether the file is whole."""
    directory_offset = sections[-1]
    r.take(4)
    tag_by_offset = {}
    for _ in range(r.word()):
        tag = r.take(4)
        tag_by_offset[r.word()] = tag
    r.require(r.take(4) == b"EOD\0" and r.take(4) == b"TAI\0", "section DIR has no end")
    r.take(4)
    r.require(r.word() == directory_offset and r.at == len(r.data), "the tail does not point at the list of sections")
    r.require(set(sections) <= set(tag_by_offset), "a section is not in the list of sections")


def _columns(r, signals, stored, signal_paths):
    """{path: (times, texts)}: one text per cycle in which the signal changes."""
    watched, out = {}, {path: ([], []) for path in signal_paths}
    for path in signal_paths:
        for element_index, number in enumerate(signals[path][1]):
            watched.setdefault(number, []).append((path, element_index))
    before = None
    for time, path, element_index, value in _changes(r, stored, watched):
        r.require(
            (before is None or time >= before) and abs(time) < MOST_TIME, "the time decreases, or exceeds the limit"
        )
        before = time
        scalar = signals[path][0]
        r.require(not scalar.literals or value < len(scalar.literals), f"{path} has a value that its type lacks")
        times, texts = out[path]
        if not times or times[-1] != time:
            # what was before stays as it is; this time begins with a copy of it
            times.append(time)
            texts.append(list(texts[-1]) if texts else [""] * len(signals[path][1]))
            if len(texts) > 1:
                texts[-2] = "".join(texts[-2])
        texts[-1][element_index] = scalar.text(value)
    return {path: (times, ["".join(text) for text in texts]) for path, (times, texts) in out.items()}


def read(path, choose):
    """{path: (times, texts, width)} of some signals of a GHW file; times in fs, texts of bits.

    choose  function of {path: width, None where a signal has no bits} that gives the paths that are wanted
    Raises FileError with one line if the file cannot be read, is damaged, or is not of this format.
    """
    data = read_bytes(path)
    if not data.startswith(MAGIC):
        raise FileError(f"{path}: not a GHW file")
    r = _Reader(data)
    try:
        r.at = len(MAGIC)
        r.require(r.byte() == 16 and r.byte() == 0, "the version is not 0.x")
        r.byte()
        order = r.byte()
        r.require(order in (1, 2) and r.byte() == 4 and r.byte() == 1 and r.byte() == 0, "the header is not GHDL's")
        r.order = "<" if order == 1 else ">"
        strings = _strings(r)
        types = _types(r, strings)
        r.section("WKT")
        while r.byte():
            r.read_unsigned()
        signals, stored = _hierarchy(r, strings, types)
    except (IndexError, struct.error, ValueError, RecursionError, TypeError) as problem:
        raise _damage_error(path, r, problem) from None
    widths = {name: scalar.width if scalar.width != 1 else len(numbers) for name, (scalar, numbers) in signals.items()}
    signal_paths = choose(widths)
    try:
        columns = _columns(r, signals, stored, signal_paths)
    except (IndexError, struct.error, ValueError, TypeError) as problem:
        raise _damage_error(path, r, problem) from None
    return {name: (*columns[name], widths[name]) for name in signal_paths}


def _damage_error(path, r, problem):
    why = "the file ends early" if isinstance(problem, IndexError | struct.error) else str(problem)
    return FileError(f"{path}: damaged or not of GHDL 2: {why} (byte {r.at})")
