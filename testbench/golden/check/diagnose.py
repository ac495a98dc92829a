"""Why a design differs from golden rows: one named cause if it alone explains every row, else "unknown".

    golden step of row n of the design  -->  next row     a register that differs here is at fault, not what feeds it
    each hypothesis on that register    -->  next row     it stays only if it gives the design's value in every row

Causes    late, early, rounding, wrap, saturate, limit, sign, gain, reset, bit_order, unknown
Method    one fault is assumed; a cause is named when all that fit agree on it, and every register at fault with it
Source    docs/golden.md

A register that the log lacks is taken from the golden rows. If two causes fit, both are listed and none is named.
"""

from typing import NamedTuple

import numpy as np

from fpga_model import fixed
from fpga_model.design_record import DEFAULT, Design
from fpga_model.rounding_aliases import ALIASES
from testbench.golden.check import diagnose_nodes as nodes
from testbench.golden.check.diagnose_model import Model

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
    design: Design


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
        self.model = Model.of(case.block, case.params, case.inputs, case.expected, case.design)
        self.state = {
            name: np.where(case.care[name], case.got[name], want) if name in case.got else want
            for name, want in case.expected.items()
        }
        shared = {f"in_{name}": case.inputs[name] for name in set(case.inputs) & set(self.state)}
        self.columns = {**case.inputs, **shared, **self.state}
        self.local = self._golden(case.inputs, self.state)
        # Rows that show a reset: the first, and those after an edge with reset
        self.resets = np.zeros(self.n, bool)
        self.resets[0] = True
        if "rst" in case.inputs:
            self.resets[1:] = case.inputs["rst"][:-1] == 1

    def _golden(self, inputs, state, **changed):
        """What every observed port should be, row by row, after the design's own previous row."""
        local = dict(self.case.expected)
        if self.model:
            rows, pins = self.model.run(inputs, state, **changed)
            # a register of the design has its width whatever the fault puts in
            ports = self.case.ports
            for name, after in rows.items():
                after = nodes.wrapped(after, ports[name].fmt) if name in ports else after
                # row 0 has no row before it
                local[name] = _after(after, self.case.expected[name][0])
            local.update({name: pins[name] for name in pins if name in local and name not in rows})
        return local

    def _explains(self, inputs, first=0, **changed):
        """Whether other inputs or parameters give the design's value in every row from `first` on.

        The rows that are wrong are tried first: most hypotheses fail there, and there are few of them.
        """
        wrong = np.zeros(self.n, bool)
        for name, got, care in self._observed():
            wrong |= care & (got != self.local[name])
        wrong[:first] = False
        if not wrong.any():
            return False
        for rows in (np.flatnonzero(wrong)[:50], np.arange(first, self.n)):
            after, _ = self.model.run(inputs, self.state, rows[rows > 0] - 1, **changed)
            _, pins = self.model.run(inputs, self.state, rows, **changed)
            for name, got, care in self._observed():
                at = rows[rows > 0] if name in after else rows
                value = after.get(name, pins.get(name, self.local[name][at]))
                if not _same(got[at], nodes.wrapped(value, self.case.ports[name].fmt), care[at]):
                    return False
        return True

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
                yield "sign", "result", driven_to(nodes.wrapped(-basis, fmt)), ends
                yield "gain", "result x 2", driven_to(nodes.wrapped(basis << 1, fmt)), care
                yield "gain", "result x 2", driven_to(np.clip(basis << 1, fmt.lo, fmt.hi)), care
                yield "gain", "result / 2", driven_to(basis >> 1), care
            if self.case.block.startswith("spi_"):
                yield (
                    "bit_order",
                    "reversed",
                    driven_to(nodes.wrapped(nodes.reversed_bits(basis, fmt.width), fmt)),
                    care,
                )
            if self.case.block in nodes.PACKED_SIGNS:
                pattern = np.unique((self.case.got[name] ^ basis)[care & driven])
                if len(pattern) == 1 and pattern[0]:
                    yield "sign", f"bits {int(pattern[0]):#x} inverted", driven_to(basis ^ pattern[0]), care
        yield from self._arithmetic(name, care)

    def _driven(self, name):
        """Rows whose golden value does not depend on the register itself: elsewhere it holds."""
        other = self._golden(self.case.inputs, {**self.state, name: self.state[name] ^ 1})
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
        yield from self._enabled_late(name)

    def _enabled_late(self, name):
        """A register too many under the same enable: late by a number of enables, where only they move the port."""
        want = self.case.expected[name]
        moves = np.flatnonzero(np.diff(want))
        for strobe in self.model.block.strobes if self.model else ():
            enable = (self.case.inputs[strobe] == 1) & ~np.append(self.resets[1:], False)
            if not np.all(enable[moves] | self.resets[moves + 1]) or enable.all():
                continue
            after = np.append(want[1:], want[-1:])[enable]
            count = np.concatenate(([0], np.cumsum(enable)[:-1]))
            since = count - count[np.maximum.accumulate(np.where(self.resets, np.arange(self.n), 0))]
            for k in range(1, MAX_INPUT_SHIFT + 1):
                column = after[np.clip(count - 1 - k, 0, None)] if len(after) else want
                what = f"{k} enable" + ("s" if k > 1 else "") + f" ({strobe})"
                yield "late", what, column, self.case.care[name] & (since > k)

    def _arithmetic(self, name, care):
        case, plain = self.case, _plain(name, self.case.expected)
        fmt = {key: port.fmt for key, port in case.ports.items()}
        try:
            found = (
                nodes.NODES[case.block](self.columns, case.params, fmt, case.design)
                if case.block in nodes.NODES
                else {}
            )
            special = nodes.SPECIAL.get(case.block)
            special = list(special(self.columns, case.params, fmt, case.design)) if special else []
            compared = nodes.COMPARED.get(case.block)
            compared = list(compared(self.columns, case.params)) if compared else []
        except KeyError:
            return
        first = case.expected[name][0]
        if plain in found:
            yield from self._varied(name, nodes.parts(found[plain]), care)
        for target, cause, what, column in special:
            if target == plain:
                yield cause, what, _after(nodes.wrapped(column, fmt[name]), first), care
        for target, what, column in compared:
            if target == plain:
                yield "limit", what, column, care

    def _varied(self, name, parts, care):
        """Other arithmetic of one part of a register, or the same fault in all of its parts that differ."""
        got, local, first = self.case.got[name], self.local[name], self.case.expected[name][0]
        wrong = []
        for node in parts:
            enable = np.ones(self.n, bool) if node.enable is None else node.enable
            # rows that show a load of this part
            shown = np.concatenate(([False], enable[:-1]))
            fitting = {}
            for cause, what, column in nodes.variants(node):
                column = np.where(shown, _after(nodes.wrapped(column, node.fmt), first), local)
                yield cause, what, column, care
                # a limit is one constant that each part may use in its own way; else the words are the same
                key = (cause, "" if cause in ("limit", "wrap") else what)
                if key not in fitting and _same(got, column, care & shown):
                    fitting[key] = (what, column)
            if not _same(got, local, care & shown):
                wrong.append((shown, fitting))
        if len(wrong) < 2:
            return
        for key in set.intersection(*[set(fitting) for _, fitting in wrong]):
            column = local
            for shown, fitting in wrong:
                column = np.where(shown, fitting[key][1], column)
            words = dict.fromkeys(fitting[key][0] for _, fitting in wrong)
            yield key[0], ", ".join(words), column, care

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
                # the first rows hold what the design had before row 0, and prove nothing
                if self._explains({**self.case.inputs, name: late}, k + 1):
                    yield name, ("late", f"{k} clock" + ("s" if k > 1 else ""))

    def tuned(self):
        """Parameters whose other value explains every row of every port."""
        if not self.model:
            return
        for cause, what, changed in nodes.tuned(self.case.block, self.case.params, self.model.parameters()):
            if self._explains(self.case.inputs, **changed):
                yield cause, what

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


def diagnose(block, params, inputs, ports, expected, got, care=None, design=DEFAULT):
    """The cause of the difference between `got` and `expected`, as a `Diagnosis`; None if there is no difference.

    block          stem of the block; any name is allowed, the arithmetic of known ones is varied too
    params         {name: raw}
    inputs         {name: int64 column}
    ports          {name: Port} of every register and pin
    expected, got  {name: int64 column}; `got` may lack any
    care           {name: bool column} of the rows that count (default: all)
    design         record of the design that the rows are of
    """
    care = {name: np.ones(len(column), bool) for name, column in got.items()} | (care or {})
    search = _Search(Case(block, params, inputs, ports, expected, got, care, design))
    if all(_same(column, expected[name], care[name]) for name, column in got.items()):
        return None
    faulty = search.faulty(search.local)
    if not faulty:
        return Diagnosis(UNKNOWN, "", "")
    fits = _agreed([search.fits(name) for name in faulty])
    fits += [fit for fit in search.tuned() if fit not in fits]
    if not fits:
        fits = search.whole()
        if not fits:
            late = list(search.late_inputs())
            names = {name for name, _ in late}
            if len(names) == 1:
                return _named(names.pop(), [fit for _, fit in late])
            return Diagnosis(UNKNOWN, faulty[0], "", tuple(fit for _, fit in late))
    return _named(faulty[0], fits)
