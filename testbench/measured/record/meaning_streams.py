"""Streams against stimuli and registers, by physics that no tolerance of a board bends; and against each other.

    R25  drive at lock: its amplitude is the set-point's, its code is all cosine
    R26  force word against /stimulus/rate, in sign and size        R27  temperature sensor against its stimulus
    R28  ADC rows that no replay of the firmware sees: copies, rests, rows without a conversion, the last ones

Means are over the second half of a segment, when the loops have settled.
Source    docs/measured.md
"""

import math

import numpy as np

from analog_frontend.parts import adc, propagator
from fpga_model import cordic, sequencer
from fpga_model.rates import FRAME_CYCLES
from testbench.measured.record import check_tables, schema
from testbench.measured.record.meaning_segments import CONDITIONS, COVERAGE_FACTOR, Stated, bank, rate_limit, segments
from testbench.measured.record.schema import REFUSED, WARNED, Finding
from testbench.measured.record.sessions import UNSEEN, received_rows, sessions

LEAST_FRAMES = 64  # of the half of a segment
DRIVE_SHARE = 0.05  # of the set-point: what a lock of the amplitude loop may leave, several times
DRIVE_PHASE = 0.2  # rad; a locked drive is within some mrad of its cosine
FORCE_SHARE, FORCE_DPS = 0.25, 10.0  # tolerance of force and mass; a tenth of the quadrature leaks, 6 deg of phase
SETTLED = 10.0  # time constants of the rate loop from a step to where its force is judged
SENSOR_K = 10.0  # the sensor's own error, and a die that is warmer than its surroundings
COPIED_ROWS, COPIED_CODES = 16, 8  # equal rows of two channels in a row, and different codes among them
LEAST_STUCK_ROWS, STUCK_FACTOR = 20, 5  # rows that rest, and times the next longer rest
CHANCE = 1e-5  # that all channels repeat in a session's last rows
STEP_FRAMES, STEP_SHARE = 3, 0.05  # a sinc3 filter has settled after three conversions
MOST_BAD = 0.01  # part of the frames of a locked loop with a bad status word
CHANNELS = (*schema.ADC, "adc_temperature")


def halves(record):
    """(row, segment, rows of its second half) of segments in which a condition holds and the loops are locked."""
    state = record.streams["state"].data if "state" in record.streams else None
    for k, s in segments(record):
        first, last = -(-s["edge_a"] // FRAME_CYCLES), s["edge_b"] // FRAME_CYCLES
        rows = slice((first + last) // 2, last)
        is_locked = state is None or (state[rows] == sequencer.LOCKED).all()
        if s["kind"] in CONDITIONS and rows.stop - rows.start >= LEAST_FRAMES and is_locked:
            yield k, s, rows


def drive(record):
    """R25."""
    reported_sources = set()
    for _, s, rows in halves(record):
        means = [record.streams[name].data[rows].mean() for name in ("adc_xI", "adc_xQ")]
        raw, source = bank(record, s["edge_b"]).get("amplitude_setpoint", (0, ""))
        loops = s["loops"].split()
        size, where = math.hypot(*means) * float(cordic.gain()), f"rows {rows.start} to {rows.stop - 1}"
        if raw and "drv" in loops and abs(size - raw) > DRIVE_SHARE * raw and source not in reported_sources:
            reported_sources.add(source)
            text = (
                f"expected a magnitude of {raw} within {100 * DRIVE_SHARE:g} % by {source}, found {size:.0f} in {where}"
            )
            yield Finding("R25", "/registers/amplitude_setpoint", text, WARNED)
        angle = math.atan2(means[0], -means[1])
        if "pll" in loops and abs(angle) > DRIVE_PHASE:
            text = f"expected the phase of minus cosine in adc_xI and adc_xQ within {DRIVE_PHASE} rad"
            text += f", found {angle:.3g} rad in {where}"
            yield Finding("R25", "/streams/adc_xI", text, REFUSED)
            return


def _force(record, rows):
    """Mean force word over rows; without its stream from the codes of the sense DAC and the phase."""
    if "rate_word" in record.streams:
        return record.streams["rate_word"].data[rows].mean()
    column = record.streams["dac_ftr"]
    step = FRAME_CYCLES // column.den
    codes = column.data[rows.start * step : rows.stop * step : step].astype(float)
    angle = record.streams["nco_pword"].data[rows] * (2 * np.pi / 2**48)
    waves = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    wave_coefficients = np.linalg.lstsq(waves, codes, rcond=None)[0]
    # the code lags the phase by a few us, less than a quarter turn
    return math.copysign(math.hypot(*wave_coefficients), wave_coefficients[0]) * 16


def force(record):
    """R26."""
    if "rate_word" not in record.streams and not {"dac_ftr", "nco_pword"} <= set(record.streams):
        return
    rate, config = Stated(record, "rate"), check_tables.stated_config(record)
    d, reported_rows = config.device(), set()
    gain, _ = propagator.cv_chain(d, "drive", d.temp_ref_degc)
    metres = d.adc_vref_v / d.adc_pga_drive / 2**23 / (gain * d.signal_gain * 4 / math.pi)  # of a drive code
    newtons = 2 * d.coriolis_mass_kg * 2 * math.pi * d.fx_hz * metres * math.pi / 180  # of a code and 1 deg/s
    settle = SETTLED / (2 * math.pi * config.firmware.ftr_crossover_hz) * 8000
    for _, s, rows in halves(record):
        a, b = FRAME_CYCLES * rows.start, FRAME_CYCLES * rows.stop
        stimulus_rows = rate.rows_between(a, b)
        row = stimulus_rows[-1] if stimulus_rows else -1
        steady = row >= 0 and rate.observed_range(stimulus_rows) <= rate_limit(rate, row)
        recent = rate.rows_between(max(0, int(a - settle * FRAME_CYCLES)), b)
        calm = steady and rate.observed_range(recent) <= rate_limit(rate, row)
        if not calm or row in reported_rows or "ftr" not in s["loops"].split() or not d.k_vf_sense_n_per_v:
            continue
        drive = math.hypot(*(record.streams[name].data[rows].mean() for name in ("adc_xI", "adc_xQ")))
        force_rate_dps = _force(record, rows) * 10 / 2**23 * d.k_vf_sense_n_per_v / (newtons * drive) if drive else 0.0
        stated = float(np.mean(rate.values[stimulus_rows.start : stimulus_rows.stop]))
        limit = FORCE_SHARE * abs(stated) + FORCE_DPS
        if abs(force_rate_dps - stated) > limit:
            reported_rows.add(row)
            opposite = force_rate_dps * stated < 0 and min(abs(force_rate_dps), abs(stated)) > FORCE_DPS
            text = f"expected {force_rate_dps:.4g} deg/s, by the force in segment {s['id']}, within {limit:.3g} deg/s"
            text += f"{' and the same sign' if opposite else ''}, found {stated:.6g} in row {row}"
            yield Finding("R26", f"{rate.path}/rate", text, REFUSED if opposite else WARNED)


def sensor(record):
    """R27."""
    column = record.streams.get("adc_temperature")
    if column is None:
        return
    stated, config = Stated(record, "temperature"), check_tables.stated_config(record)
    warmer, reported_rows = config.plant.self_heating_k, set()
    lsb, unc = column.attrs["lsb_V"], column.attrs["lsb_V_unc"]
    for _, s, rows in halves(record):
        row = stated.row(FRAME_CYCLES * rows.stop)
        if row < 0 or row in reported_rows:
            continue
        volts = column.data[rows].mean() * lsb
        sensor_degc = 25.0 + (volts - adc.SENSOR_V_AT_25_DEGC) / adc.SENSOR_V_PER_K
        limit = SENSOR_K + COVERAGE_FACTOR * (float(stated.unc[row]) + abs(volts) * unc / lsb / adc.SENSOR_V_PER_K)
        value = float(stated.values[row])
        if not -limit <= sensor_degc - value <= limit + warmer:
            reported_rows.add(row)
            text = f"expected {sensor_degc:.4g} degC from adc_temperature in segment {s['id']} within {limit:.3g} K"
            yield Finding("R27", f"{stated.path}/temperature", f"{text}, found {value:.6g} in row {row}", WARNED)


def runs(equal):
    """(first, length) of runs of True, longest first."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], equal.astype(np.int8), [0]])))
    runs_by_length = sorted(zip((edges[1::2] - edges[::2]).tolist(), edges[::2].tolist()), reverse=True)
    return [(first, length) for length, first in runs_by_length]


def _channels(record):
    return {name: record.streams[name].data for name in CHANNELS if name in record.streams}


def copies(record):
    """R28: converters with noise do not agree for long."""
    channels = _channels(record)
    names = list(channels)
    for k, name in enumerate(names):
        for other in names[:k]:
            equal = [run for run in runs(channels[name] == channels[other]) if run[1] >= COPIED_ROWS]
            for first, length in equal:
                if len(np.unique(channels[name][first : first + length])) >= COPIED_CODES:
                    text = (
                        f"expected codes other than {other}, found equal codes in rows {first} to {first + length - 1}"
                    )
                    yield Finding("R28", f"/streams/{name}", text)
                    break


def _locked_row_mask(record):
    """Rows in which noise moves every channel: those of segments behind the start-up that nobody has lost."""
    rows = np.zeros(schema.frame_count(record), bool)
    for _, s in segments(record):
        if s["kind"] in CONDITIONS:
            rows[s["edge_a"] // FRAME_CYCLES : s["edge_b"] // FRAME_CYCLES] = True
    for session in sessions(record):
        rows[session.rows] &= received_rows(record, session)[0]
    return rows


def rests(record):
    """R28: a channel that rests far longer than it does elsewhere, and last rows in which all repeat."""
    if not check_tables.stated_config(record).noise.adc:
        return
    channels, is_locked = _channels(record), _locked_row_mask(record)
    still = {name: np.diff(codes) == 0 for name, codes in channels.items()}
    for name, equal in still.items():
        (first, length), *next_runs = [*runs(equal & is_locked[1:]), (0, 0), (0, 0)][:2]
        if length >= LEAST_STUCK_ROWS and length > STUCK_FACTOR * next_runs[0][1]:
            text = f"expected one code for at most {max(LEAST_STUCK_ROWS, STUCK_FACTOR * next_runs[0][1])} rows"
            yield Finding("R28", f"/streams/{name}", f"{text}, found rows {first} to {first + length}", WARNED)
    chance = math.prod(float(equal[is_locked[1:]].mean()) if is_locked[1:].any() else 1.0 for equal in still.values())
    together = np.logical_and.reduce(list(still.values()))
    for session in sessions(record):
        last = session.first + session.frames - 1
        changed_rows = np.flatnonzero(~together[session.first : last])
        repeats = last - session.first - (int(changed_rows[-1]) + 1 if len(changed_rows) else 0)
        if chance**repeats < CHANCE:
            text = f"expected new codes of {', '.join(channels)}"
            text += f", found those of row {last - repeats} repeated up to row {last}"
            yield Finding("R28", "/streams/adc_xI", text, WARNED)


def bad_frames(record):
    """R28: loops stay locked only on frames whose status is good."""
    if "adc_ok" not in record.streams:
        return
    bad, is_locked = record.streams["adc_ok"].data == 0, _locked_row_mask(record)
    share = bad[is_locked].mean() if is_locked.any() else 0.0
    if share > MOST_BAD:
        row = int(np.flatnonzero(bad & is_locked)[0])
        text = f"expected at most {100 * MOST_BAD:g} % of rows with 0 after the start-up"
        yield Finding("R28", "/streams/adc_ok", f"{text}, found {100 * share:.3g} % from row {row} on", WARNED)


def first_rows(record):
    """R28: rows without a conversion hold nothing new; behind a power-on the sensor's filter settles."""
    channels = _channels(record)
    frames = schema.frame_count(record)
    edge0 = record.streams["adc_xI"].edge0
    for j, (a, b, reason) in enumerate(schema.rows(record.tables["gaps"], "edge_a", "edge_b", "reason")):
        if reason != UNSEEN:
            continue
        for row in range(max(0, -(-(a - edge0) // FRAME_CYCLES)), min(frames, -(-(b - edge0) // FRAME_CYCLES))):
            where = f"in row {row}, which has no conversion by /gaps row {j}"
            for name, codes in channels.items():
                if codes[row] != 0 and (row == 0 or codes[row] != codes[row - 1]):
                    yield Finding("R28", f"/streams/{name}", f"expected 0, found {codes[row]} {where}", WARNED)
            if "adc_ok" in record.streams and record.streams["adc_ok"].data[row]:
                yield Finding("R28", "/streams/adc_ok", f"expected 0, found 1 {where}", WARNED)
    codes = channels.get("adc_temperature", np.zeros(0))
    for session in sessions(record):
        row, after = session.first + STEP_FRAMES, codes[session.first + STEP_FRAMES + 1 : session.first + 64]
        if len(after) and session.powered and received_rows(record, session)[0][:64].sum() >= len(after) + STEP_FRAMES:
            settled = float(np.median(after))
            if abs(codes[row] - settled) > STEP_SHARE * abs(settled):
                text = f"expected {settled:.0f} within {100 * STEP_SHARE:g} %, found {codes[row]} in row {row}"
                yield Finding("R28", "/streams/adc_temperature", text, WARNED)


RULES = (drive, force, sensor, copies, rests, bad_frames, first_rows)
