"""Why a design differs from golden rows: one named cause if it alone explains every row, else "unknown".

    golden step of row n of the design  -->  next row     a register that differs here is at fault, not what feeds it
    each hypothesis on that register    -->  next row     it stays only if it gives the design's value in every row

Causes    late, early, rounding, wrap, saturate, limit, sign, gain, reset, bit_order, unknown
Method    one fault is assumed; a cause is named when all that fit agree on it, and every register at fault with it
Source    docs/golden.md

A register that the log lacks is taken from the golden rows. If two causes fit, both are listed and none is named.
"""

import importlib
import inspect
import re
from typing import NamedTuple

import numpy as np

from fpga_model import fixed, pi, sine, spi_adc
from fpga_model.rounding_aliases import ALIASES
from testbench import flatten

UNKNOWN = "unknown"
CAUSES = ("late", "early", "rounding", "wrap", "saturate", "limit", "sign", "gain", "reset", "bit_order", UNKNOWN)
MAX_SHIFT = 8
MAX_INPUT_SHIFT = 4
# A shift of something that hardly moves proves nothing
MIN_CHANGES = 3
WORDS = {
    "late": "a register too many",
    "early": "a register too few, or a log that starts too late",
    "rounding": "another rounding rule",
    "wrap": "wraps where it should saturate",
    "saturate": "saturates where it should wrap",
    "limit": "a limit is one LSB off",
    "sign": "the sign is wrong",
    "gain": "the gain is one bit off",
    "reset": "another reset value",
    "bit_order": "the order of the bits is reversed",
    UNKNOWN: "no single cause explains every row",
}


class Diagnosis(NamedTuple):
    """The cause, the port it was seen at, what exactly, and every hypothesis that fits as (cause, what)."""

    cause: str
    port: str
    what: str
    fits: tuple = ()

    def text(self):
        line = f"{self.cause}: {WORDS[self.cause]}"
        if self.cause != UNKNOWN:
            return f"{line} ({self.port}: {self.what})"
        if self.fits:
            return f"{line} alone; these fit: " + "; ".join(f"{cause} ({what})" for cause, what in self.fits)
        return line


class Port(NamedTuple):
    """What the diagnosis needs to know of a register or pin."""

    fmt: fixed.Fmt
    reset: int | None = None


# Arithmetic on whole columns ------------------------------------------------------------------------------------------


def _python(function):
    """The interpreted twin of a kernel, whose values are Python integers."""
    return getattr(function, "py_func", function)


# The rules of `fixed` branch on the sign of one number; a column needs the sign as a column
def _rounded(rule, x, n):
    """Column `x` with `n` LSBs dropped by `rule`."""
    low = (1 << n) - 1
    negative = (x < 0).astype(np.int64)
    added = {
        "floor": 0,
        "ceil": low,
        "toward_zero": low * negative,
        "half_up": (1 << n) >> 1,
        "half_down": low >> 1,
        "half_even": (low >> 1) + (((x >> n) & 1) if n else 0),
        "half_away": np.where(negative, low >> 1, (1 << n) >> 1),
        "half_zero": np.where(negative, (1 << n) >> 1, low >> 1),
    }[rule]
    return (x + added) >> n


def _wrapped(x, fmt):
    mask = np.int64((1 << fmt.width) - 1)
    low = x & mask
    return np.where(low > fmt.hi, low - (mask + 1), low) if fmt.s else low


def _reversed(x, width):
    """The low `width` bits in the opposite order, unsigned."""
    out = np.zeros_like(x)
    for k in range(width):
        out |= ((x >> k) & 1) << (width - 1 - k)
    return out


def _signed_bits(lo, hi):
    """Least signed width that holds lo .. hi."""
    return max(int(hi).bit_length(), int(-lo - 1).bit_length() if lo < 0 else 0) + 1


class Node(NamedTuple):
    """A register as sum, rounding and overflow: what the hypotheses on arithmetic vary.

    terms     {name: column}, whose sum is the exact value
    shift     LSBs dropped by `rounding`
    lo, hi    saturation, or None where the sum wraps in `fmt` (or cannot leave it)
    steps     sizes of "one LSB" of a limit
    flip      1 where the result is negated, or None
    enable    where the register takes the value; elsewhere it holds
    wraps     whether overflow happens and is meant to wrap
    """

    fmt: fixed.Fmt
    terms: dict
    shift: int = 0
    rounding: str = "floor"
    lo: int | None = None
    hi: int | None = None
    steps: tuple = (1,)
    flip: np.ndarray | None = None
    enable: np.ndarray | None = None
    wraps: bool = False


def _limited(node, x, lo, hi):
    if lo is None:
        return _wrapped(x, node.fmt)
    return np.clip(x, lo, hi)


def _variants(node):
    """Yield (cause, what, column) for every other arithmetic that the node may have been built with."""

    def done(x, flip=node.flip):
        return x if flip is None else np.where(flip == 1, -x, x)

    exact = sum(node.terms.values())
    if node.shift > 0:
        for rule in fixed.ROUNDINGS:
            if rule != node.rounding:
                yield "rounding", rule, done(_limited(node, _rounded(rule, exact, node.shift), node.lo, node.hi))
            if node.flip is not None:
                value = _rounded(rule, done(exact), node.shift)
                yield "rounding", f"{rule} of the signed value", _limited(node, value, node.lo, node.hi)
    value = _rounded(node.rounding, exact, node.shift)
    if node.lo is not None:
        for width in sorted({node.fmt.width, _signed_bits(node.lo, node.hi)}):
            yield "wrap", f"at {width} bits", done(_wrapped(value, fixed.signed(width)))
        for step in node.steps:
            for low, high in ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, 1), (1, -1), (1, 1), (-1, -1)):
                lo, hi = node.lo + low * step, node.hi + high * step
                what = ", ".join(f"{name} {sign * step:+d} LSB" for name, sign in (("lo", low), ("hi", high)) if sign)
                yield "limit", what, done(_limited(node, value, lo, hi))
            for low, high in ((-step, 0), (step, 0), (0, -step), (0, step)):
                stuck = np.where(value < node.lo, node.lo + low, np.where(value > node.hi, node.hi + high, value))
                what = f"saturates to {'lo' if low else 'hi'} {low or high:+d} LSB"
                yield "limit", what, done(stuck)
    elif node.wraps:
        yield "saturate", f"at {node.fmt.lo} and {node.fmt.hi}", done(np.clip(value, node.fmt.lo, node.fmt.hi))
    yield "sign", "result", -done(_limited(node, value, node.lo, node.hi))
    yield "sign", "result", _limited(node, -done(value), node.lo, node.hi)
    if node.flip is not None:
        for flip, what in ((1 - node.flip, "result"), (0 * node.flip, "never negative"), (0 * node.flip + 1, "always")):
            yield "sign", what, done(_limited(node, value, node.lo, node.hi), flip)
    for name, term in node.terms.items():
        rest = exact - term
        changes = (
            ("sign", f"of {name}", -term),
            ("gain", f"{name} x 2", term << 1),
            ("gain", f"{name} / 2", term >> 1),
        )
        for cause, what, other in changes:
            yield cause, what, done(_limited(node, _rounded(node.rounding, rest + other, node.shift), node.lo, node.hi))
    if node.shift > 0:
        for shift, what in ((node.shift - 1, "result x 2"), (node.shift + 1, "result / 2")):
            yield "gain", what, done(_limited(node, _rounded(node.rounding, exact, shift), node.lo, node.hi))
        yield "gain", "result x 2", done(_limited(node, value << 1, node.lo, node.hi))
        yield "gain", "result / 2", done(_limited(node, value >> 1, node.lo, node.hi))
    else:
        yield "gain", "result x 2", done(_limited(node, exact << 1, node.lo, node.hi))
        yield "gain", "result / 2", done(_limited(node, exact, node.lo, node.hi) >> 1)


# The arithmetic registers of the blocks: c holds the columns of inputs and registers, p the parameters ----------------


def _modulator(c, p, fmt):
    return {
        "product": Node(fmt["product"], {"amplitude * sine": c["amplitude"] * c["sine"]}, enable=c["en_product"] == 1),
        "code": Node(
            fmt["code"], {"product": c["product"]}, p["shift"], "half_up", p["lo"], p["hi"], enable=c["en_code"] == 1
        ),
    }


def _pi(c, p, fmt):
    en, mode = c["en"] != 0, c["mode"]
    run, off = mode == pi.RUN, mode == pi.OFF
    acc = {
        "acc": np.where(run, c["acc"], 0),
        "ki * e": np.where(run, p["ki"] * c["e"], 0),
        "preset": np.where(off, c["preset"] << pi.SHIFT, 0),
    }
    lo, hi = p["lo"] << pi.SHIFT, p["hi"] << pi.SHIFT
    prop = {"kp * e": np.where(off, 0, p["kp"] * c["e"])}
    return {
        "prop": Node(fmt["prop"], prop, enable=en & (mode <= pi.RUN)),
        "acc": Node(fmt["acc"], acc, lo=lo, hi=hi, steps=(1, 1 << pi.SHIFT), enable=en & (run | off)),
        "y": Node(fmt["y"], {"prop": c["prop"], "acc": c["acc"]}, pi.SHIFT, "half_up", p["lo"], p["hi"]),
    }


def _sine(c, p, fmt):
    base, product = c["base2"] << sine.ALIGN, c["product"]
    return {
        "product": Node(fmt["product"], {"slope * fraction": c["slope"] * (2 * c["fraction"] + 1)}),
        "y": Node(fmt["y"], {"base": base, "product": product}, sine.PRODUCT.f, "half_up", flip=c["sign2"]),
    }


def _dds(c, p, fmt):
    nodes = {"phase": Node(fmt["phase"], {"phase": c["phase"], "word": c["word"]}, wraps=True)}
    for name in ("drive_sine", "sense_sine", "drive_ref", "sense_ref"):
        nodes[name] = Node(fmt[name], {"phase": c["phase"], "offset": c[f"off_{name}"]}, wraps=True)
    return nodes


NODES = {"modulator": _modulator, "pi": _pi, "sine": _sine, "dds": _dds}


def _spi_dac_order(c, p, fmt, following):
    """The shift register of a master that sends the LSB first, in its two usual forms, and its pin."""
    load, run, mask = c["load"] == 1, c["sclk_en"] == 1, (1 << p["bits"]) - 1
    right = np.where(run, c["shift"] >> 1, c["shift"])
    left = np.where(run, (c["shift"] << 1) & mask, c["shift"])
    yield "shift", "LSB first, shifts right", np.where(load, c["word"], right)
    yield "shift", "LSB first, word reversed at load", np.where(load, _reversed(c["word"], p["bits"]), left)


def _spi_adc_order(c, p, fmt, following):
    """The words of a master that takes the LSB first."""
    take = (c["busy"] == 1) & (c["word"] != spi_adc.WORDS) & (c["sclk"] == 1)
    word = (c["shift"] >> 1) | (c["dout"] << (spi_adc.WORD_BITS - 1))
    last = take & (c["count"] == spi_adc.WORD_BITS - 1)
    yield "shift", "LSB first", np.where(take, word, c["shift"])
    yield "status", "LSB first", np.where(last & (c["word"] == 0), word, c["status"])
    for k in range(spi_adc.CHANNELS):
        name = f"channels_{k}"
        taken = last & (c["word"] == k + 1)
        yield name, "LSB first", np.where(taken, _wrapped(word, fmt[name]), c[name])


ORDERS = {"spi_dac": _spi_dac_order, "spi_adc": _spi_adc_order}
# Packed words of signs: a constant pattern of inverted bits is a wrong sign
PACKED_SIGNS = {"references"}


# The golden step of a block on any rows -------------------------------------------------------------------------------


class Model:
    """A block's own step on the rows of somebody else; `None` from `of` where the block is not of the plain form."""

    def __init__(self, module, params):
        self.step = _python(module.step)
        self.like = module.State()
        self.names = [name.replace(".", "_") for name in flatten.names(self.like)]
        self.reset = dict(zip(self.names, (value for _, value in flatten.leaves(self.like))))
        self.p = (
            module.Params(**{name: params[name] for name in module.Params._fields}) if "p" in self._args() else None
        )
        self.inputs = [name for name in self._args() if name not in ("p", "s")]
        self.pins = {name: _python(getattr(module, name)) for name in ("out", "pins", "sdin") if hasattr(module, name)}

    def _args(self):
        return list(inspect.signature(self.step).parameters)

    @classmethod
    def of(cls, block, params, inputs, registers):
        """The model, or None when the block, its parameters or its ports are not of the form step(p, s, inputs)."""
        if not re.fullmatch(r"[a-z][a-z0-9_]*", block):
            return None
        try:
            model = cls(importlib.import_module(f"fpga_model.{block}"), params)
        except (ImportError, AttributeError, KeyError, TypeError):
            return None
        known = set(model.inputs) <= set(inputs) and set(model.names) <= set(registers)
        return model if known else None

    def _call(self, function, state, inputs):
        given = {"p": self.p, "s": state, **inputs}
        return function(*[given[name] for name in inspect.signature(function).parameters])

    def run(self, columns):
        """Golden rows one edge after each row of `columns`, and golden pins of each row."""
        rows = list(zip(*[columns[name].tolist() for name in self.names]))
        inputs = list(zip(*[columns[name].tolist() for name in self.inputs])) or [()] * len(rows)
        step, p, head = self.step, self.p, () if self.p is None else (self.p,)
        after = np.empty((len(rows) + 1, len(self.names)), np.int64)
        after[0] = list(self.reset.values())
        pins = {name: np.empty(len(rows), np.int64) for name in self.pins}
        wanted = {name: list(inspect.signature(function).parameters) for name, function in self.pins.items()}
        for n, (row, given) in enumerate(zip(rows, inputs)):
            state = flatten.rebuild(self.like, row)
            flatten._store_python(after[n + 1], step(*head, state, *given))
            for name, function in self.pins.items():
                known = {"p": p, "s": state, **dict(zip(self.inputs, given))}
                pins[name][n] = function(*[known[argument] for argument in wanted[name]])
        if "rst" in columns:
            after[1:][columns["rst"] == 1] = list(self.reset.values())
        return {name: after[:-1, k].copy() for k, name in enumerate(self.names)}, pins


# The search -----------------------------------------------------------------------------------------------------------


class Case(NamedTuple):
    """Everything a diagnosis reads. Columns are int64 arrays of one length; `care[name]` marks the rows that count."""

    block: str
    params: dict
    inputs: dict
    ports: dict
    expected: dict
    got: dict
    care: dict


def _plain(name, names):
    """Name of a register or pin without the r_ or o_ that an RTL port carries."""
    return name[2:] if name[:2] in ("r_", "o_") and name not in names else name


def _after(column, first):
    """The column of values after each edge as rows: row 0 is what it was before any."""
    return np.concatenate(([first], column[:-1])).astype(np.int64)


def _same(a, b, care):
    return bool(np.array_equal(a[care], b[care]))


class _Search:
    def __init__(self, case):
        self.case = case
        self.n = len(next(iter(case.expected.values())))
        self.model = Model.of(case.block, case.params, case.inputs, case.expected)
        self.state = {
            name: np.where(case.care[name], case.got[name], want) if name in case.got else want
            for name, want in case.expected.items()
        }
        self.columns = {**case.inputs, **self.state}
        self.local = self._golden(self.columns)
        # Rows that show a reset: the first, and those after an edge with reset
        self.resets = np.zeros(self.n, bool)
        self.resets[0] = True
        if "rst" in case.inputs:
            self.resets[1:] = case.inputs["rst"][:-1] == 1

    def _golden(self, columns):
        """What every observed port should be, row by row, after the design's own previous row."""
        local = dict(self.case.expected)
        if self.model:
            rows, pins = self.model.run(columns)
            # a register of the design has its width whatever the fault puts in
            ports = self.case.ports
            local.update({w: _wrapped(rows[w], ports[w].fmt) if w in ports else rows[w] for w in rows})
            for name in local:
                if name not in rows and name in pins:
                    local[name] = pins[name]
            for name in rows:
                # row 0 has no row before it
                local[name][0] = self.case.expected[name][0]
        return local

    def faulty(self, local):
        return [
            name
            for name, got in self.case.got.items()
            if not _same(got, local[name], self.case.care[name])
            and not _same(got, self.case.expected[name], self.case.care[name])
        ]

    def hypotheses(self, name):
        """Yield (cause, what, column, where it must hold) for one port."""
        want, local, port = self.case.expected[name], self.local[name], self.case.ports[name]
        fmt = port.fmt
        care = self.case.care[name] & ~self.resets
        yield from self._reset(name)
        if self._moves(name):
            yield from self._shifted(name)
        for basis, driven in ((want, np.ones(self.n, bool)), (local, self._driven(name))):

            def driven_to(column, basis=basis, driven=driven):
                return np.where(driven, column, basis)

            if fmt.width == 1:
                yield "sign", "inverted", driven_to(1 - basis), care
                continue
            if fmt.s or fmt.f > 0:
                ends = care & (basis != fmt.lo) if fmt.s else care
                yield "sign", "result", driven_to(_wrapped(-basis, fmt)), ends
                yield "gain", "result x 2", driven_to(_wrapped(basis << 1, fmt)), care
                yield "gain", "result x 2", driven_to(np.clip(basis << 1, fmt.lo, fmt.hi)), care
                yield "gain", "result / 2", driven_to(basis >> 1), care
            if self.case.block.startswith("spi_"):
                yield "bit_order", "reversed", driven_to(_wrapped(_reversed(basis, fmt.width), fmt)), care
            if self.case.block in PACKED_SIGNS:
                pattern = np.unique((self.case.got[name] ^ basis)[care & driven])
                if len(pattern) == 1 and pattern[0]:
                    yield "sign", f"bits {int(pattern[0]):#x} inverted", driven_to(basis ^ pattern[0]), care
        yield from self._arithmetic(name, care)

    def _driven(self, name):
        """Rows whose golden value does not depend on the register itself: elsewhere it holds."""
        other = self._golden({**self.columns, name: self.columns[name] ^ 1})
        return other[name] == self.local[name]

    def _reset(self, name):
        got, care = self.case.got[name], self.case.care[name]
        seen = np.unique(got[self.resets & care])
        if len(seen) == 1 and seen[0] != self.case.expected[name][0]:
            column = np.where(self.resets, seen[0], self.local[name])
            yield "reset", f"{int(seen[0])} instead of {int(self.case.expected[name][0])}", column, care

    def _moves(self, name):
        return np.count_nonzero(np.diff(self.case.expected[name])) >= MIN_CHANGES

    def _shifted(self, name):
        """As `hypotheses`, for a port that is late or early; rows with no source this side of a reset do not count."""
        want = self.case.expected[name]
        for k in range(1, min(MAX_SHIFT, self.n // 4) + 1):
            clocks = f"{k} clock" + ("s" if k > 1 else "")
            late, early = self.case.care[name].copy(), self.case.care[name].copy()
            early[-k:] = False
            for row in np.flatnonzero(self.resets):
                late[row : row + k] = False
                early[max(0, row - k) : row + 1] = False
            yield "late", clocks, np.concatenate((want[:1].repeat(k), want[:-k])), late
            yield "early", clocks, np.concatenate((want[k:], want[-1:].repeat(k))), early

    def _arithmetic(self, name, care):
        plain = _plain(name, self.case.expected)
        fmt = {key: port.fmt for key, port in self.case.ports.items()}
        try:
            nodes = NODES[self.case.block](self.columns, self.case.params, fmt) if self.case.block in NODES else {}
            orders = ORDERS.get(self.case.block)
            orders = list(orders(self.columns, self.case.params, fmt, self.n)) if orders else []
        except KeyError:
            return
        first = self.case.expected[name][0]
        if plain in nodes:
            node = nodes[plain]
            for cause, what, column in _variants(node):
                value = column if node.enable is None else np.where(node.enable, column, self.state[name])
                yield cause, what, _after(_wrapped(value, node.fmt), first), care
        for target, what, column in orders:
            if target == plain:
                yield "bit_order", what, _after(column, first), care

    def fits(self, name):
        """Hypotheses on one port that give the design's value in every row, in order, without doubles."""
        got, local = self.case.got[name], self.local[name]
        wrong = self.case.care[name] & (got != local)
        found = {}
        for cause, what, column, care in self.hypotheses(name):
            # Rows that a shift cannot judge must not hold all that is wrong
            if _same(got, column, care) and np.any(wrong & care):
                found[(cause, what)] = None
        return list(found)

    def late_inputs(self):
        """Inputs that, taken k clocks late, explain every row of every port."""
        if not self.model:
            return
        for name in self.model.inputs:
            column = self.case.inputs[name]
            if np.count_nonzero(np.diff(column)) < MIN_CHANGES:
                continue
            for k in range(1, MAX_INPUT_SHIFT + 1):
                late = np.concatenate((column[:1].repeat(k), column[:-k]))
                local = self._golden({**self.columns, name: late})
                # the first rows hold what the design had before row 0, and prove nothing
                after = slice(k + 1, None)
                pairs = [(g[after], local[w][after], self.local[w][after], c[after]) for w, g, c in self._observed()]
                proven = any(np.any(c & (g != golden)) for g, _, golden, c in pairs)
                if proven and all(_same(g, late_by_k, c) for g, late_by_k, _, c in pairs):
                    yield name, ("late", f"{k} clock" + ("s" if k > 1 else ""))

    def _observed(self):
        return [(name, got, self.case.care[name]) for name, got in self.case.got.items()]

    def whole(self):
        """Shifts that explain all ports at once: [(cause, what)]. A port that hardly moves has no vote but a veto."""
        votes, allowed = [], []
        for name, got in self.case.got.items():
            wrong = self.case.care[name] & (got != self.case.expected[name])
            found = [
                (cause, what, bool(np.any(wrong & care)))
                for cause, what, column, care in self._shifted(name)
                if _same(got, column, care)
            ]
            allowed.append({(cause, what) for cause, what, _ in found})
            votes += [(cause, what) for cause, what, proven in found if proven and self._moves(name)]
        return sorted(set(votes) & set.intersection(*allowed))


def _agreed(sets):
    """What all registers at fault have in common, exactly if possible, else by cause alone."""
    exact = [fit for fit in sets[0] if all(fit in other for other in sets[1:])]
    if exact:
        return exact
    causes = set.intersection(*[{cause for cause, _ in fits} for fits in sets])
    # A shift or a rule that differs from port to port is no single cause
    return [fit for fit in sets[0] if fit[0] in causes - {"late", "early", "rounding"}]


def _named(port, fits):
    causes = {cause for cause, _ in fits}
    details = [what for _, what in fits]
    if len(causes) != 1:
        return Diagnosis(UNKNOWN, port, "", tuple(fits))
    cause = causes.pop()
    if cause in ("late", "early") and len(fits) > 1:
        return Diagnosis(UNKNOWN, port, "", tuple(fits))
    if cause == "rounding":
        what = " or ".join(
            f"{rule} ({', '.join(sorted(a for a, neutral in ALIASES.items() if neutral == rule.split()[0]))})"
            for rule in details
        )
        return Diagnosis(cause, port, what, tuple(fits))
    return Diagnosis(cause, port, " or ".join(details[:3]), tuple(fits))


def diagnose(block, params, inputs, ports, expected, got, care=None):
    """The cause of the difference between `got` and `expected`, as a `Diagnosis`; None if there is no difference.

    block          stem of the block; any name is allowed, the arithmetic of known ones is varied too
    params         {name: raw}
    inputs         {name: int64 column}
    ports          {name: Port} of every register and pin
    expected, got  {name: int64 column}; `got` may lack any
    care           {name: bool column} of the rows that count (default: all)
    """
    care = {name: np.ones(len(column), bool) for name, column in got.items()} | (care or {})
    search = _Search(Case(block, params, inputs, ports, expected, got, care))
    if all(_same(column, expected[name], care[name]) for name, column in got.items()):
        return None
    faulty = search.faulty(search.local)
    if not faulty:
        return Diagnosis(UNKNOWN, "", "")
    fits = _agreed([search.fits(name) for name in faulty])
    if not fits:
        fits = search.whole()
        if not fits:
            late = list(search.late_inputs())
            names = {name for name, _ in late}
            if len(names) == 1:
                return _named(names.pop(), [fit for _, fit in late])
            return Diagnosis(UNKNOWN, faulty[0], "", tuple(fit for _, fit in late))
    return _named(faulty[0], fits)
