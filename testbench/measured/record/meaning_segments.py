"""Segments against what the record itself says happened: set-points, steps, power-ons, repeats, lost rows.

    R21  rate_set, temp_set against the stimuli; a_set, detune against the registers
    R22  the kind of a segment against stimuli, power-ons, register log and state
    R23  set-points of repeats        R24  rows of a fitted or held-out segment that nobody recorded

A contradiction in a fitted or held-out segment is refused, because an analysis takes its condition from there; in
another one it is a warning.
Source    docs/measured.md
"""

import math

import numpy as np

from fpga_model import agc, registers, sequencer
from fpga_model.rates import FRAME_CYCLES
from testbench.measured.record import check_tables, schema
from testbench.measured.record.schema import REFUSED, WARNED, Finding
from testbench.measured.record.sessions import UNSEEN, sessions
from testbench.run import build

COVERAGE_FACTOR = 5.0  # stated standard uncertainties
RATE_SHARE, RATE_DPS = 0.01, 0.1  # what a rate table and its operator leave open
TEMP_K = 2.0  # of a chamber: what IEC 60068-2-1 and -2-2 allow
AMPLITUDE_SHARE = 0.01  # a set-point that is stated to three digits
DETUNE_DEG = 0.05  # a set-point that is stated to a tenth of a degree
TURN = 1 << 48
VARYING = ("sweep", "multisine", "warmup", "ringdown")  # kinds without one condition
CONDITIONS = ("dwell", "rate_step", "detune", "settle")
FIXED = {"drv": sequencer.OPEN_DRIVE, "ftr": sequencer.FIX_FTR, "qsc": sequencer.FIX_QSC}
SETPOINTS = ("control", "amplitude_setpoint", "frequency_fixed", "phase_drive_sine", "phase_sense_sine")
SETPOINTS += ("phase_drive_ref", "phase_sense_ref", "amplitude_fixed", "rate_fixed", "quadrature_fixed")


def level(role):
    """Of a contradiction in a segment of a role."""
    return REFUSED if role in ("fit", "validate") else WARNED


class Stated:
    """A stimulus table: what holds when."""

    def __init__(self, record, quantity):
        self.path, table = f"/stimulus/{quantity}", record.tables[f"stimulus/{quantity}"]
        self.edges, self.values, self.unc = (table[key].data for key in ("edge", quantity, "unc"))

    def row(self, edge):
        """Row that holds just before an edge; -1: none."""
        return int(np.searchsorted(self.edges, edge, side="left")) - 1

    def rows_between(self, a, b):
        """Rows that hold in edges a .. b - 1; what is stated within the first frame holds from its beginning."""
        return range(max(0, self.row(a + FRAME_CYCLES)), self.row(b) + 1)

    def observed_range(self, rows):
        """Largest less smallest value of rows."""
        values = self.values[rows.start : rows.stop]
        return float(np.ptp(values)) if len(values) else 0.0


def rate_limit(stated, row):
    """How far (deg/s) a rate may lie from that of a row of /stimulus/rate."""
    size = abs(float(stated.values[row]))
    return (RATE_SHARE + COVERAGE_FACTOR * 1e-6 * float(stated.unc[row])) * size + RATE_DPS


def temp_limit(stated, row):
    """The same of a temperature (K)."""
    return TEMP_K + COVERAGE_FACTOR * float(stated.unc[row])


def segments(record):
    """(row, {column: value}) of each segment."""
    for k, values in enumerate(schema.rows(record.tables["segments"], *schema.TABLES["segments"])):
        yield k, dict(zip(schema.TABLES["segments"], values))


def bank(record, edge):
    """{register: (raw, where it is stated)} that the firmware holds at an edge.

    {} if its beginning is not stated, or its map is not this version's.
    """
    if not schema.has_supported_map(record):
        return {}
    session = [s for s in sessions(record) if FRAME_CYCLES * s.first < edge or s.first == 0][-1]
    begin = FRAME_CYCLES * session.first
    if session.powered:
        register_values = {name: (raw, f"{name} at reset") for name, raw in registers.State()._asdict().items()}
    elif "initial" in record.tables:
        rows = schema.rows(record.tables["initial"], "name", "raw")
        register_values = {name.removeprefix("registers."): (raw, f"/initial {name}") for name, raw in rows}
    else:
        return {}
    for k, (at, name, raw) in enumerate(schema.rows(record.tables["registers"], "edge", "name", "raw")):
        if begin <= at < edge:
            register_values[name] = (raw, f"/registers row {k}")
    return register_values


def setpoints(record):
    """R21."""
    rate, temperature = Stated(record, "rate"), Stated(record, "temperature")
    config = check_tables.stated_config(record)
    nominal = build.nominal(config)
    lsb_per_um = agc.setpoint(1.0, nominal["v_per_um"], nominal["adc_drive_v"])
    for k, s in segments(record):
        if s["kind"] in VARYING:
            continue

        def differs(column, unit, source, target_value, limit, k=k, s=s):
            text = f"expected {target_value:.6g} {unit} of {source} within {limit:.2g} {unit}"
            observed_text = f"found {s[column]:.6g} {unit} in row {k}"
            return Finding("R21", f"/segments/{s['id']}/{column}", f"{text}, {observed_text}", level(s["role"]))

        for stated, column, unit, limit_of in (
            (rate, "rate_set", "deg/s", rate_limit),
            (temperature, "temp_set", "degC", temp_limit),
        ):
            row = stated.row(s["edge_b"])
            if row < 0 or stated.edges[0] > s["edge_a"]:
                text = f"expected a row at edge {s['edge_a']} or before, where segment {s['id']} of row {k} begins"
                observed_text = f"found the first at {stated.edges[0]} in row 0" if len(stated.edges) else "found none"
                yield Finding("R21", stated.path, f"{text}, {observed_text}", level(s["role"]))
                continue
            limit = limit_of(stated, row)
            if abs(s[column] - stated.values[row]) > limit:
                yield differs(column, unit, f"{stated.path} row {row}", stated.values[row], limit)
        register_values = bank(record, s["edge_b"])
        if "amplitude_setpoint" in register_values:
            raw, source = register_values["amplitude_setpoint"]
            a_um = raw / lsb_per_um
            if abs(s["a_set"] - a_um) > AMPLITUDE_SHARE * a_um:
                yield differs("a_set", "um", source, a_um, AMPLITUDE_SHARE * a_um)
        if "phase_drive_sine" in register_values:
            raw, source = register_values["phase_drive_sine"]
            turns = (raw - config.firmware.phase_words()[0]) % TURN / TURN
            if abs(math.remainder(s["detune"] / 360 - turns, 1.0)) * 360 > DETUNE_DEG:
                yield differs("detune", "deg", source, math.remainder(turns, 1.0) * 360, DETUNE_DEG)


def kinds(record):
    """R22."""
    powered = record.tables["power_on"]["edge"].data
    rate, temperature = Stated(record, "rate"), Stated(record, "temperature")
    state = record.streams["state"].data if "state" in record.streams else None
    for k, s in segments(record):
        a, b, kind = s["edge_a"], s["edge_b"], s["kind"]

        def wrong(expected, observed_text, how=None, k=k, s=s):
            text = f"expected {expected} in a {s['kind']}, found {observed_text} in row {k}"
            return Finding("R22", f"/segments/{s['id']}/kind", text, how or level(s["role"]))

        inside = powered[(powered > a) & (powered < b)]
        begins = kind == "startup" and (powered == a).any()
        if kind == "startup" and not begins and len(inside) != 1:
            yield wrong(f"a power-on from edge {a} on", f"{len(inside)} in /power_on")
        elif kind != "startup" and len(inside):
            row = int(np.flatnonzero(powered == inside[0])[0])
            yield wrong("no power-on", f"edge {inside[0]} of /power_on row {row}")
        rows = rate.rows_between(a, b)
        if kind == "rate_step":
            yield from _check_rate_step(rate, rows, a, wrong)
        elif kind in CONDITIONS and rows and rate.observed_range(rows) > max(rate_limit(rate, r) for r in rows):
            text = f"{rate.observed_range(rows):.4g} deg/s of {rate.path} rows {rows[0]} to {rows[-1]}"
            yield wrong(f"changes of rate below {max(rate_limit(rate, r) for r in rows):.2g} deg/s", text)
        if kind not in CONDITIONS:
            continue
        rows = temperature.rows_between(a, b)
        if rows and temperature.observed_range(rows) > max(temp_limit(temperature, r) for r in rows):
            text = f"{temperature.observed_range(rows):.4g} K of {temperature.path} rows {rows[0]} to {rows[-1]}"
            yield wrong(f"changes of temperature below {temp_limit(temperature, rows[0]):.2g} K", text, WARNED)
        yield from _check_condition_writes(record, s, wrong)
        if state is not None and s["role"] != "none":
            first, last = -(-a // FRAME_CYCLES), b // FRAME_CYCLES
            lost = np.flatnonzero(state[first:last] != sequencer.LOCKED)
            if len(lost):
                text = f"{state[first + lost[0]]} at row {first + lost[0]} of /streams/state"
                yield wrong(f"state {sequencer.LOCKED} (LOCKED)", text, WARNED)


def _check_rate_step(rate, rows, a, wrong):
    """A step of the rate, or none."""
    rows = range(max(0, min(rate.row(a), rows.start)), rows.stop)
    least = min((rate_limit(rate, r) for r in rows), default=RATE_DPS)
    if rate.observed_range(rows) <= least:
        where = f"{rate.path} rows {rows.start} to {rows.stop - 1}"
        yield wrong(f"a step above {least:.2g} deg/s", f"{rate.observed_range(rows):.4g} deg/s of {where}")


def _check_condition_writes(record, s, wrong):
    """Set-points that are written while a condition holds, and loops that a register has opened."""
    for row, (at, name) in enumerate(schema.rows(record.tables["registers"], "edge", "name")):
        if s["edge_a"] + FRAME_CYCLES <= at < s["edge_b"] and name in SETPOINTS:
            yield wrong("no write to a set-point", f"{name} at edge {at} of /registers row {row}", WARNED)
    control, source = bank(record, s["edge_b"]).get("control", (0, ""))
    for loop, bit in FIXED.items():
        if loop in s["loops"].split() and control & bit:
            name = sequencer.CONTROL_BITS[bit.bit_length() - 1]
            yield wrong(f"loop {loop} closed", f"{name} set by {source}")


def conditions(record):
    """R23: repeats share one condition."""
    first = {}
    for k, s in segments(record):
        j, other = first.setdefault(s["repeat_group"], (k, s))
        for column, limit in (("a_set", 0.0), ("detune", DETUNE_DEG), ("temp_set", TEMP_K), ("rate_set", RATE_DPS)):
            limit += AMPLITUDE_SHARE * abs(other[column]) if column in ("a_set", "rate_set") else 0.0
            if abs(s[column] - other[column]) > limit:
                text = f"expected {other[column]:.6g} of row {j} in all of {s['repeat_group']}"
                observed_text = f"found {s[column]:.6g} in row {k}"
                yield Finding("R23", f"/segments/{s['id']}/{column}", f"{text}, {observed_text}", level(s["role"]))
        if s["kind"] != other["kind"]:
            text = f"expected {other['kind']} of row {j} in all of {s['repeat_group']}, found {s['kind']} in row {k}"
            yield Finding("R23", f"/segments/{s['id']}/kind", text, level(s["role"]))


def lost_rows(record):
    """R24: means over a segment would count rows that nobody recorded."""
    table = record.tables["gaps"]
    for j, (a, b, reason) in enumerate(schema.rows(table, "edge_a", "edge_b", "reason")):
        for k, s in segments(record):
            if reason != UNSEEN and s["role"] != "none" and a < s["edge_b"] and b > s["edge_a"]:
                text = f"expected no lost rows in segment {s['id']} of row {k}, found edges {a} .. {b} in row {j}"
                yield Finding("R24", "/gaps", text, WARNED)


RULES = (setpoints, kinds, conditions, lost_rows)
