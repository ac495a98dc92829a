"""Golden rows against the log of somebody's design: the first divergence, the rows before it, and a diagnosis.

    row n = registers before edge n;  edge n is at n / clock_hz;  ports of a log may be any subset of the manifest's

A value that the simulator did not know (x, z, u, ...) is a divergence wherever the golden row is compared.
Source    docs/golden.md (schema of the manifest)
"""

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fpga_model.design_record import DEFAULT
from fpga_model.fixed import Fmt
from testbench.errors import FileError
from testbench.golden.bundles import design_entry
from testbench.golden.check import diagnose as why
from testbench.golden.stimulus import levels

SCHEMA = "gyro-golden/1.0"
BEFORE = 8
MOST_INPUTS = 12  # that a report prints in one line
LEAST_DIGITS, MOST_DIGITS = 6, 12  # of a value
MAX_WIDTH = 63


class Column(NamedTuple):
    """One logged port: int64 values, and where they were known."""

    values: np.ndarray
    valid: np.ndarray


class Divergence(NamedTuple):
    """The first row that differs; `kind` is input, register, output or pin.

    `got` is None where the design's value was unknown; `error_lsb` is got - expected.

    Of a register that wraps it is taken modulo its width, nearest to zero.
    before  (row, {port: expected}, {port: got}, names of the ports that are not judged in this row)
    edge    (row, {input: value}) of the edge that decides the row; None of an input, and in the first row
    """

    cycle: int
    time_ns: float
    port: str
    kind: str
    expected: int
    got: int | None
    expected_value: float
    got_value: float | None
    error_lsb: int | None
    also: tuple
    before: tuple
    fmt: Fmt
    edge: tuple | None

    @property
    def is_input(self):
        return self.kind == "input"

    def decimal_texts(self):
        """(expected, got) as decimals: two digits more than distinguish them, and 6 to 12."""
        values = [v for v in (self.expected_value, self.got_value) if v is not None]
        digits = next((k for k in range(1, MOST_DIGITS) if len({f"{v:.{k}g}" for v in values}) == 2), MOST_DIGITS)
        digits = min(max(digits + 2, LEAST_DIGITS), MOST_DIGITS) if len(values) == 2 else LEAST_DIGITS
        return tuple(None if v is None else f"{v:.{digits}g}" for v in (self.expected_value, self.got_value))


class Report(NamedTuple):
    """Outcome of a comparison.

    judged_rows  rows with a port that is judged;  clocks  {RTL port: clocks that it was declared to come later}
    first_row    row of the bundle that row 0 of the comparison is;  got  {port: Column}, moved to the golden rows
    notes        lines on what was compared, such as a parameter without a value
    """

    block: str
    case: str
    rows: int
    golden_rows: int
    ports: tuple
    missing: tuple
    level: str
    judged_rows: int
    clocks: dict
    differing: dict
    divergence: Divergence | None
    diagnosis: tuple
    first_row: int = 0
    got: Mapping = MappingProxyType({})
    notes: tuple = ()

    @property
    def passed(self):
        return self.divergence is None

    def cause_entries(self):
        """[{cause, register, share of rows explained, what}] in order of rank; empty: unknown."""
        return [cause._asdict() for cause in self.diagnosis]

    def to_dict(self):
        """The one format of a result: passed, first, diagnosis, and what was compared."""
        d = self.divergence
        first = d and {
            "clock": d.cycle, "kind": d.kind, "name": d.port, "expected": d.expected, "got": d.got,
            "time_ns": d.time_ns, "error_lsb": d.error_lsb, "also": list(d.also),
            "before": [{"clock": c, "expected": e, "got": g, "not_judged": list(n)} for c, e, g, n in d.before],
            "fmt": list(d.fmt), "inputs": d.edge and {"edge": d.edge[0], "values": d.edge[1]},
        }  # fmt: skip
        report_keys = (
            "block",
            "case",
            "level",
            "rows",
            "golden_rows",
            "judged_rows",
            "ports",
            "missing",
            "clocks",
            "differing",
            "notes",
        )
        head = {"passed": self.passed, "first": first, "diagnosis": self.cause_entries()}
        return head | {k: getattr(self, k) for k in report_keys}

    def to_json(self):
        """The result as JSON text with sorted keys."""
        return json.dumps(self.to_dict(), indent=2, sort_keys=True) + "\n"

    def text(self):
        """The report for a terminal."""
        head = f"{self.block}/{self.case}: {self.rows} of {self.golden_rows} rows, {len(self.ports)} ports"
        if self.level != "registers":
            head += f" at level {self.level}"
        if self.judged_rows < self.golden_rows:
            head += f", {self.judged_rows} rows judged"
        if self.missing:
            head += f" (not in the log: {', '.join(self.missing)})"
        notes = "".join(f"{'note':18}{line}\n" for line in self.notes)
        if self.passed:
            return f"{head}: PASS\n{notes}"
        d = self.divergence
        expected_decimal, got_decimal = d.decimal_texts()
        got = "unknown (x)" if d.got is None else f"{d.got} = {got_decimal}, {d.error_lsb:+d} LSB"
        lines = [
            f"{head}: FAIL",
            f"first divergence  cycle {d.cycle}, {d.time_ns:.1f} ns, {d.kind} {d.port}",
            f"  expected        {d.expected} = {expected_decimal} {d.fmt}",
            f"  got             {got}",
        ]
        if d.also:
            lines.append(f"  also differing  {', '.join(d.also)}")
        lines += ["  " + line for line in self._rows_before()]
        lines.append("differing rows    " + ", ".join(f"{name} {count}" for name, count in self.differing.items()))
        return "\n".join(lines) + "\n" + self.why() + notes

    def why(self):
        """The lines of the diagnosis."""
        lines = [cause.text() for cause in self.diagnosis] or ["unknown: no known fault explains the rows that differ"]
        if self.divergence.is_input:
            lines = ["none: an input of the design was not given the golden stimulus"]
        return "".join(f"{'diagnosis' if k == 0 else '':18}{line}\n" for k, line in enumerate(lines))

    def _rows_before(self):
        d = self.divergence
        port_names = [d.port, *[name for name in self.ports if name != d.port]][:8]
        row_offset = d.cycle - d.before[-1][0] if d.before else 0
        table = [["row" if row_offset else "cycle", *port_names]]
        for cycle, want, got, masked_names in d.before:
            table.append([str(cycle), *(_cell_text(want[n], got[n], n in masked_names) for n in port_names)])
        widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
        lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths)) for row in table]
        mark_note = "; * expected, not judged" if any("*" in cell for row in table for cell in row) else ""
        offset_note = f"; row n of {d.port} is cycle n + {row_offset} of the design" if row_offset else ""
        return [*lines, f"(expected / got where they differ{mark_note}{offset_note})", *self._edge_lines()]

    def _edge_lines(self):
        if self.divergence.edge is None:
            return []
        edge, values = self.divergence.edge
        inputs = ", ".join(f"{name} {value}" for name, value in values.items())
        return [f"inputs at edge {edge}: {inputs if len(values) <= MOST_INPUTS else f'{len(values)}, in window.vcd'}"]


def _cell_text(expected, got, has_mask):
    if has_mask:
        return f"{expected}*"
    return str(expected) if got == expected else f"{expected} / {'x' if got is None else got}"


def _ports(manifest, kinds):
    """{name: (Fmt, reset, width)} of some of the manifest's lists."""
    port_formats = {}
    for kind in kinds:
        for port in manifest.get(kind, []):
            try:
                fmt = Fmt(*[int(k) for k in port["fmt"]])
                name, reset = port["name"], port.get("reset")
            except (KeyError, OverflowError, TypeError, ValueError):
                raise FileError(f"manifest: {kind}: {port!r} is not a port with name and fmt [s, i, f]") from None
            if fmt.width != port.get("width", fmt.width):
                raise FileError(
                    f"manifest: port {name}: width {port['width']} bits differs from the {fmt.width} of format {fmt}"
                )
            if not 0 < fmt.width <= MAX_WIDTH:
                raise FileError(f"manifest: port {name}: {fmt.width} bits, the limit is {MAX_WIDTH} bits")
            port_formats[name] = (fmt, reset)
    return port_formats


def formats(manifest):
    """{name: Fmt} of all ports of a manifest; raises FileError for another schema or a broken port."""
    if manifest.get("schema") != SCHEMA:
        raise FileError(f"manifest: schema {manifest.get('schema')!r} is not {SCHEMA!r}")
    return {name: fmt for name, (fmt, _) in _ports(manifest, ("inputs", "registers", "outputs")).items()}


def _as_column(value):
    if isinstance(value, Column):
        return value
    values = np.asarray(value, np.int64)
    return Column(values, np.ones(len(values), bool))


def _error_lsb(manifest, name, width, want, have):
    """Difference of two values of a port; of a register that wraps, modulo its width and nearest to zero."""
    port_entries = manifest["inputs"] + manifest["registers"] + manifest["outputs"]
    wraps = any(port["name"] == name and port.get("overflow") == "wrap" for port in port_entries)
    half = 1 << (width - 1)
    return (have - want + half) % (2 * half) - half if wraps else have - want


class Terms(NamedTuple):
    """What is judged: a level, from which row of the bundle on, and {RTL port: clocks that it comes later}."""

    level: str = "registers"
    first: int = 0
    clocks: Mapping = MappingProxyType({})


EVERYTHING = Terms()


def compare(manifest, inputs, expected, got, care=None, before=BEFORE, terms=EVERYTHING):
    """Compare a log with golden rows.

    manifest          as in a bundle; its order of ports decides which is named first in one row
    inputs, expected  {name: int64 column} of the golden rows
    got               {name: column or Column} of the log; rows beyond the golden ones are ignored
    care              {name: bool column} of the rows that count (default: all)
    before            rows shown before the first divergence
    terms             `Terms`; columns of a late port have been moved to the golden rows
    """
    fmts = formats(manifest)
    stray_ports = sorted(set(got) - set(fmts))
    if stray_ports:
        raise FileError(f"log: port {stray_ports[0]} is not in the manifest of {manifest['block']}")
    logged = {name: _as_column(got[name]) for name in fmts if name in got}
    if not set(logged) & set(expected):
        raise FileError(
            f"log: no port is a register or output of {manifest['block']}; name one of {', '.join(expected)}"
        )
    n = min([manifest["n"], *[len(column.values) for column in logged.values()]])
    if n < 1:
        raise FileError("log: has no rows")
    golden = {**inputs, **expected}
    counts = {name: (care or {}).get(name, np.ones(manifest["n"], bool))[:n] for name in logged}
    wrong = {name: counts[name] & (~c.valid[:n] | (c.values[:n] != golden[name][:n])) for name, c in logged.items()}
    differing = {name: int(rows.sum()) for name, rows in wrong.items() if rows.any()}
    rtl_name_by_port = {p["name"]: name for name, p in levels.compared_ports(manifest, terms.level)}
    missing = tuple(name for name in expected if name in rtl_name_by_port and name not in logged)
    some = np.logical_or.reduce([rows for name, rows in counts.items() if name in expected])
    head = (manifest["block"], manifest.get("case", ""), n, manifest["n"], tuple(logged), missing, terms.level,
            int(some.sum()), dict(terms.clocks), differing)  # fmt: skip
    if not differing:
        return Report(*head, None, (), terms.first, logged)

    # a late port shows a row later than the others
    port_delays = {name: terms.clocks.get(rtl_name_by_port.get(name), 0) for name in differing}
    firsts = {name: int(np.argmax(wrong[name])) + port_delays[name] for name in differing}
    clock = min(firsts.values())
    first_differing_ports = [name for name in differing if firsts[name] == clock]
    port, cycle = first_differing_ports[0], clock - port_delays[first_differing_ports[0]]

    def logged_value(name, row):
        column = logged[name]
        return int(column.values[row]) if column.valid[row] else None

    want, have = int(golden[port][cycle]), logged_value(port, cycle)
    scale = 2.0 ** -fmts[port].f
    preceding_rows = tuple(
        (
            terms.first + row,
            {name: int(golden[name][row]) for name in logged},
            {name: logged_value(name, row) for name in logged},
            tuple(name for name in logged if not counts[name][row]),
        )
        for row in range(max(0, cycle - before), cycle + 1)
    )
    is_result = port in rtl_name_by_port
    edge = None
    if is_result and cycle:
        edge = (terms.first + cycle - 1, {name: int(column[cycle - 1]) for name, column in inputs.items()})
    divergence = Divergence(
        cycle=terms.first + clock,
        time_ns=(terms.first + clock) * 1e9 / manifest["clock"]["hz"],
        port=port,
        kind=levels.port_kind(manifest, rtl_name_by_port[port]) if is_result else "input",
        expected=want,
        got=have,
        expected_value=want * scale,
        got_value=None if have is None else have * scale,
        error_lsb=None if have is None else _error_lsb(manifest, port, fmts[port].width, want, have),
        also=tuple(first_differing_ports[1:]),
        before=preceding_rows,
        fmt=fmts[port],
        edge=edge,
    )
    diagnosis = _diagnosis(manifest, inputs, golden, logged, counts, n, divergence)
    return Report(*head, divergence, diagnosis, terms.first, logged)


def compare_bundle(golden, got, before=BEFORE, comparison=None):
    """Compare columns of a design with a bundle that was read; returns a `Report`.

    golden  `bundle.Bundle`
    got     {name: column or Column} of the design
    comparison  `foreign.comparison_scope.ComparisonScope` of the bundle; None: every row of every port
    Raises FileError for the bundle of the whole firmware: its rows are apart, and only its own bench can use them.
    """
    manifest = golden.manifest
    if manifest["block"] == "top":
        raise FileError(
            "top: rows of this bundle are not consecutive clocks, so a log cannot be compared; "
            "run its bench: make -C FOLDER check"
        )
    names = [port["name"] for port in manifest["inputs"]]
    results = [port["name"] for port in manifest["registers"] + manifest["outputs"]]
    care = golden.mask != 0 if comparison is None else comparison.care
    return compare(
        manifest,
        dict(zip(names, golden.stim.T.copy())),
        dict(zip(results, golden.exp.T.copy())),
        got,
        dict(zip(results, care.T)),
        before,
        EVERYTHING if comparison is None else Terms(comparison.level, comparison.first, comparison.clocks),
    )


def _driven_input_column(golden, logged):
    """Column of an input: what the design was given, where its log says so."""
    return golden if logged is None else np.where(logged.valid[: len(golden)], logged.values[: len(golden)], golden)


def _diagnosis(manifest, inputs, golden, logged, counts, n, divergence):
    if divergence.is_input:
        return ()
    registers = [port["name"] for port in manifest["registers"]]
    names = registers + [port["name"] for port in manifest["outputs"]]
    logged_names = [name for name in names if name in logged]
    rows = why.Rows(
        block=manifest["block"],
        params={p["name"]: p["raw"] for p in manifest.get("params", [])},
        # a column has the register's values where an input has its name
        inputs={
            name: _driven_input_column(column[:n], None if name in names else logged.get(name))
            for name, column in inputs.items()
        },
        expected={name: golden[name][:n] for name in names},
        got={name: logged[name].values[:n] for name in logged_names},
        care={name: counts[name] & logged[name].valid[:n] for name in logged_names},
        undefined_registers=tuple(
            name for name in registers if name in logged_names and counts[name][0] and not logged[name].valid[0]
        ),
        design=design_entry.manifest_design("manifest", manifest) or DEFAULT,
    )
    return tuple(why.diagnose(rows))
