"""The rules of a measurement record, R01 to R33: one finding per line, no guess, no partial load.

    refused      the record is not loaded          downgraded   loaded, but less can be concluded from it
    warned       loaded, but implausible           blocked      loaded, but tracing waits for an override in writing

What concerns the file itself (R01, R02, R03, R05, R08, R15, R20 of columns) is found by its reader; this module
judges the form of what was read, and the modules `meaning_*` what it says. R16 needs a replay and is added by `load`.
Source    docs/measured.md
"""

import math

import numpy as np

from fpga_model.rates import FRAME_CYCLES, MASTER_HZ, SLOTS
from testbench.measured.record import check_tables, meaning_scales, meaning_segments, meaning_streams, schema
from testbench.measured.record.check_tables import span_edges
from testbench.measured.record.schema import PER_FRAME, PER_TICK, Finding

TURN = 1 << 48


def check(record):
    """Findings about a `testbench.storage.record.Record`, in the order of the rules."""
    findings = []
    try:
        for rule in RULES:
            # each rule may rely on what the ones before it have found in order
            if any(f.level == schema.REFUSED for f in findings) and rule in DEPENDENT_RULES:
                continue
            findings += rule(record)
        if not any(f.level == schema.REFUSED for f in findings):
            findings += [f for rule in MEANING for f in rule(record)]
    except (ValueError, TypeError, OverflowError, KeyError, RecursionError) as problem:
        damage = " ".join(str(problem).split())
        findings.append(Finding("R01", "/", f"expected a complete record, found damage: {damage}"))
    return findings


def _complete(record):
    for key in schema.ROOT_KEYS:
        if not isinstance(record.attrs.get(key), str):
            yield Finding("R02", "/", f"expected {key}, found nothing")
    for name, stream in schema.STREAMS.items():
        if stream.required and name not in record.streams:
            yield Finding("R02", f"/streams/{name}", "expected a stream, found nothing")
    for name, columns in (schema.TABLES | schema.OPTIONAL_TABLES).items():
        if name in schema.TABLES or name in record.tables:
            yield from _columns(record, name, columns)
    if record.provenance not in ("measured", "simulated", "sealed"):
        yield Finding("R02", "/", f"expected provenance measured, simulated or sealed, found {record.provenance}")


def _columns(record, name, columns):
    table = record.tables.get(name)
    if table is None:
        yield Finding("R02", f"/{name}", "expected a table, found nothing")
        return
    for column in columns:
        if column not in table:
            yield Finding("R02", f"/{name}/{column}", "expected a column, found nothing")
    rows = {key: len(column.data) for key, column in table.items()}
    if len(set(rows.values())) > 1:
        yield Finding("R05", f"/{name}", f"expected columns of one length, found {sorted(set(rows.values()))}")
    for key, unit in columns.items():
        if key in table and (table[key].data.dtype.kind == "U") != (unit == ""):
            kind = "texts" if unit == "" else "numbers"
            yield Finding("R04", f"/{name}/{key}", f"expected {kind}, found {table[key].data.dtype}")


def _units(record):
    for name, column in record.streams.items():
        reference = schema.STREAMS.get(name)
        if reference and column.unit != reference.unit:
            yield Finding("R03", f"/streams/{name}", f"expected unit {reference.unit}, found {column.unit}")
    for name, table in record.tables.items():
        for key, column in table.items():
            reference = "edge" if key.startswith("edge") else schema.column_units(name).get(key)
            if reference not in (None, "", "1", column.unit) and column.data.dtype.kind != "U":
                rule = "R18" if name.startswith("counter/") and key == "edge" else "R03"
                yield Finding(rule, f"/{name}/{key}", f"expected unit {reference}, found {column.unit}")


def _codes(record):
    for name, column in record.streams.items():
        schema_stream = schema.STREAMS.get(name)
        if schema_stream is None:
            yield Finding("R02", f"/streams/{name}", "expected a stream of the schema, found another name")
            continue
        path = f"/streams/{name}"
        if column.data.dtype.kind == "f":
            yield Finding("R20", path, f"expected integer codes, found {column.data.dtype}")
            continue
        bits, signed = column.attrs.get("bits"), column.attrs.get("twos_comp")
        if (bits, signed) != (schema_stream.bits, int(schema_stream.signed)):
            text = (
                f"expected bits = {schema_stream.bits}, twos_comp = {int(schema_stream.signed)}, found {bits}, {signed}"
            )
            yield Finding("R04", path, text)
            continue
        lo, hi = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
        if len(column.data) and (column.data.min() < lo or column.data.max() > hi):
            yield Finding(
                "R04", path, f"expected codes within {lo} .. {hi}, found {column.data.min()} .. {column.data.max()}"
            )
        volts = column.attrs.get("tap") in ("adc", "dac") and schema_stream.unit == "code"
        unc = column.attrs.get("lsb_V_unc")
        if volts and not (isinstance(unc, (int, float)) and math.isfinite(unc) and unc > 0):
            yield Finding("R19", path, f"expected lsb_V_unc above 0 V, found {unc}")
        size = column.attrs.get("lsb_V")
        if volts and not (isinstance(size, (int, float)) and math.isfinite(size) and size > 0):
            yield Finding("R02", path, f"expected lsb_V above 0 V, found {size}")


def _check_finite(record):
    for name, table in record.tables.items():
        for key, column in table.items():
            if column.data.dtype.kind == "f" and not np.isfinite(column.data).all():
                yield Finding("R09", f"/{name}/{key}", "expected finite numbers, found NaN or infinity")
    if not math.isfinite(record.clock_ppm):
        yield Finding("R09", "/clock", f"expected a finite ppm, found {record.clock_ppm}")


def _rates(record):
    if record.clock_hz != MASTER_HZ:
        yield Finding("R08", "/clock", f"expected f_xtal_nominal_Hz {MASTER_HZ}, found {record.clock_hz}")
    frames = schema.frame_count(record)
    adc_edge = record.streams["adc_xI"].edge0
    if not 0 < adc_edge < FRAME_CYCLES:
        yield Finding("R08", "/streams/adc_xI", f"expected edge0 within 1 .. {FRAME_CYCLES - 1}, found {adc_edge}")
    for name, column in record.streams.items():
        path, rate = f"/streams/{name}", (column.num, column.den)
        is_dac = name in schema.TICKED
        if rate != PER_FRAME and not (is_dac and rate == PER_TICK):
            allowed_rates = "1/3250 or 1/26" if is_dac else "1/3250"
            yield Finding("R08", path, f"expected rate {allowed_rates} of the clock, found {column.num}/{column.den}")
            continue
        edge0 = adc_edge if name.startswith("adc_") else (PER_TICK[1] if rate == PER_TICK else 0)
        if column.edge0 != edge0:
            yield Finding("R08", path, f"expected edge0 = {edge0}, found {column.edge0}")
        rows = frames * (FRAME_CYCLES // column.den)
        if len(column.data) != rows:
            yield Finding("R05", path, f"expected {rows} rows, found {len(column.data)}")
    if frames == 0:
        yield Finding("R05", "/streams/adc_xI", "expected at least one row, found 0")


def _check_edges(record):
    for name, table in record.tables.items():
        key = "edge_a" if "edge_a" in table else "edge"
        if key not in table:
            continue
        column = table[key].data
        if column.dtype.kind != "i" and len(column):
            yield Finding("R04", f"/{name}/{key}", f"expected integers, found {column.dtype}")
            continue
        steps = np.diff(column)
        rule = "R12" if name == "segments" else "R06"
        if (steps < 0).any():
            row = int(np.flatnonzero(steps < 0)[0]) + 1
            yield Finding(rule, f"/{name}/{key}", f"expected rising edges, found {column[row]} at row {row}")


def _gaps(record):
    table, span = record.tables["gaps"], span_edges(record)
    for k, (a, b, what) in enumerate(schema.rows(table, "edge_a", "edge_b", "streams")):
        if not 0 <= a < b <= span or what not in schema.GAP_STREAMS:
            yield Finding("R07", "/gaps", f"expected a gap within 0 .. {span}, found {a} .. {b} of {what} in row {k}")
    edges = record.tables["power_on"]["edge"].data
    for k, edge in enumerate(edges.tolist()):
        if edge % FRAME_CYCLES or not 0 <= edge < span:
            yield Finding(
                "R12", "/power_on", f"expected a frame's first edge within the record, found {edge} in row {k}"
            )
    if "nco_fword" not in record.streams or "nco_pword" not in record.streams:
        return
    word, phase = record.streams["nco_fword"].data, record.streams["nco_pword"].data
    expected, tolerance = phase_steps(record)
    error = (np.diff(phase) - expected + (TURN >> 1)) % TURN - (TURN >> 1)
    wrong = np.abs(error) > tolerance
    first = np.arange(len(word) - 1) * FRAME_CYCLES
    for a, b, what in schema.rows(table, "edge_a", "edge_b", "streams"):
        if what == "all":
            wrong &= (first + FRAME_CYCLES < a) | (first >= b)
    wrong[(edges[(edges > 0) & (edges < span)] // FRAME_CYCLES - 1)] = False
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        text = f"expected phase steps equal to the frequency word, found {error[row]} / 2^48 turn more after row {row}"
        yield Finding("R07", "/streams/nco_pword", text + ": rows are missing")


def phase_steps(record):
    """(steps, tolerance) of the phase accumulator from row to row; a word changes in the window behind the codes."""
    word = record.streams["nco_fword"].data.astype(np.int64)
    before = record.streams["adc_xI"].edge0
    steps = (word[:-1] * before + word[1:] * (FRAME_CYCLES - before)) % TURN
    return steps, np.abs(np.diff(word)) * SLOTS


def _alive(record):
    table, edge0 = record.tables["segments"], record.streams["adc_xI"].edge0
    for name, a, b, role in schema.rows(table, "id", "edge_a", "edge_b", "role"):
        if role != "fit":
            continue
        rows = slice(max(0, -(-(a - edge0) // FRAME_CYCLES)), max(0, -(-(b - edge0) // FRAME_CYCLES)))
        for stream in schema.ADC:
            codes = record.streams[stream].data[rows]
            if len(codes) and codes.min() == codes.max():
                yield Finding(
                    "R10", f"/streams/{stream}", f"expected codes that change in {name}, found only {codes[0]}"
                )
            rails = (codes <= -(1 << 23)) | (codes >= (1 << 23) - 1)
            if len(codes) and rails.mean() > schema.MOST_SATURATED:
                text = f"expected at most 0.1 % of the codes at the rails in {name}, found {100 * rails.mean():.2g} %"
                yield Finding("R10", f"/streams/{stream}", text)


# Rules that take for granted what the ones before them ask for
DEPENDENT_RULES = (
    _rates,
    _check_edges,
    _gaps,
    _alive,
    check_tables.check_identities,
    check_tables.log,
    check_tables.check_segments,
    check_tables.repeats,
    check_tables.priors,
    check_tables.counters,
    check_tables.uncertain,
)
RULES = (_complete, _units, _codes, _check_finite, *DEPENDENT_RULES)
# Rules about what a record of sound form says; none relies on another
MEANING = (*meaning_segments.RULES, *meaning_streams.RULES, *meaning_scales.RULES)
