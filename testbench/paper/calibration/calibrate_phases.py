"""The paper's progressive procedure, with what a laboratory can see: counter, amplitude word, V_q, ADC codes.

    xe1   interval from sgn(sin) and sgn(cos) to Vx-; the drive sine is advanced by it
    xe2   the drive sine turned by +theta and -theta in turn: A_d(+)/A_d(-) = cos(psi + theta)/cos(psi - theta); the
          drive references are delayed by psi. Compared with the minimum of A_d over turned references
    ye1   force word fixed, interval from sgn(sin) and sgn(cos) to Vy-; the sense sine is advanced by it
    ye2   force word fixed where A_I is null, V_q chopped between null and 0: tan(psi) = dI/dQ of the codes, plus the
          sense mode's own lead, of tangent 2 w_d / (tau (w_d^2 - w_y^2)), which its ring after each chop shows; the
          sense references follow

Cases 1 to 5 are the register sets before, and after each of these. The drive sine turns the force and leaves x where
its reference holds it, so nothing of y moves while xe2 is measured.
Source    docs/paper.md
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.optimize import brentq, least_squares

from analog_frontend.parts import sid
from fpga_model import cordic, sequencer
from testbench.paper.calibration import grid
from testbench.paper.calibration.bench import PHASE_REGISTERS, log_cosine_ratio

NODES = ("xe1", "xe2", "ye1", "ye2")
REGISTER = dict(zip(NODES, ("phase_drive_sine", "phase_drive_ref", "phase_sense_sine", "phase_sense_ref")))
SETTLE_S = 2.0  # AGC: its slow zero is at 0.6 Hz
DETUNE_DEG, DETUNE_S = (35.0, 55.0, 45.0, 40.0, 50.0, 30.0), 3.0
SCAN_DEG, SCAN_S = (-24.0, -16.0, -8.0, 0.0, 8.0, 16.0, 24.0), 1.0
FORCE_WORD = 1 << 21  # a quarter of full scale
COUNTER_TURNS_DEG = (-45.0, -15.0, 20.0, 50.0)
STEP_SKIPPED, STEP_DECAYS = 12.0, 6.0  # time constants: of the demodulator, then of the ring
RING_PARTS = 0.29, 2.15  # of the drawing's split: where the ring is looked for
NULL_S, CHOP_S, CHOP_SETTLE_S = 6.0, 5.0, 0.5
CHOP_TURNS_DEG = (-50.0, -35.0, -20.0, 0.0, 15.0, 30.0, 45.0, 55.0)
# at 95 % a batch of 20 boards has 19 covered with a probability of 0.74 only, at 99 % of 0.98
COVERAGE = 0.99
FACTOR = float(stats.norm.ppf((1 + COVERAGE) / 2))


class Estimate(NamedTuple):
    """An angle (deg) and its expanded uncertainty at 99 %."""

    deg: float
    uncertainty_deg: float


class Readings(NamedTuple):
    """Repeated readings of an angle (deg), the standard deviation that the grid leaves of each, and what is common."""

    deg: np.ndarray
    grid_deg: np.ndarray
    common_deg: float = 0.0  # standard uncertainty that no repeat shows

    def add_angle(self, degrees):
        """The same with `degrees` added to each."""
        return self._replace(deg=self.deg + degrees)

    def estimate(self):
        """`Estimate`: mean weighted by the grid's variance and one more, which the scatter shows; Student's factor.

        Mandel and Paule: the other variance is the one with which chi-squared is n - 1, or 0.
        """
        n, grid = len(self.deg), np.square(self.grid_deg)
        if n == 1:
            return Estimate(float(self.deg[0]), math.inf)

        def mean(other):
            w = 1.0 / (grid + other)
            return float(w @ self.deg / w.sum()), w

        def excess(other):
            middle, w = mean(other)
            return float(w @ np.square(self.deg - middle)) - (n - 1)

        least = 1e-18
        other = brentq(excess, least, float(self.deg.var()) * n + 2 * least) if excess(least) > 0 else least
        middle, w = mean(other)
        worth = w.sum() ** 2 / np.square(w).sum()  # readings of equal weight that would say as much
        factor = float(stats.t.ppf((1 + COVERAGE) / 2, max(worth - 1, 1.0)))
        return Estimate(middle, math.hypot(factor / math.sqrt(w.sum()), FACTOR * self.common_deg))


def join_passes(first, second):
    """`Readings` of both."""
    return Readings(np.append(first.deg, second.deg), np.append(first.grid_deg, second.grid_deg), second.common_deg)


class Pass(NamedTuple):
    """One pass of the procedure: what each step found, and what else was seen on the way."""

    estimates: dict  # node -> Estimate, before the word was moved
    extra_numbers: dict
    uncertainty_deg: dict  # node -> expanded uncertainty of what is left of it afterwards


class Calibration(NamedTuple):
    """Register sets of cases 1 to 5, both passes, uncertainty of what remains."""

    cases: dict  # case -> {register: deg}
    first: Pass
    second: Pass
    uncertainty_deg: dict


class TurnedReading:
    """The drive sine turned on purpose. The drive frequency follows by some ten millihertz, x and y do not.

    Edges on the 1 MHz grid have a bias that depends on the frequency to a millihertz, and that no repeat at one
    frequency shows: `pin_delay` says how large it is. Readings at several turns show what else depends on it.
    """

    def __init__(self, bench):
        self.bench, self.at_deg = bench, 0.0

    def to(self, degrees):
        """Turn and settle."""
        if degrees != self.at_deg:
            self.bench.advance_phase_deg("phase_drive_sine", degrees - self.at_deg)
            self.at_deg = degrees
            self.bench.settle(SETTLE_S)


def _words_and_start(bench, rows, of="drive"):
    """(words, `grid.Start`) of rows in which the pin of a channel was stamped."""
    words = rows["frequency_word"]
    return words, grid.start(words, rows.stamps, bench.read(f"phase_{of}_ref"), bench.grid)


def pin_delay(bench, rows, weights, channel="drive", of="drive", cosine=False):
    """`grid.EdgeDelay` of a channel's sgn(sin) or sgn(cos) over stamped rows; `of` the channel of the stamped pin."""
    words, begun = _words_and_start(bench, rows, of)
    offset = bench.read(f"phase_{channel}_ref") + cosine * bench.grid.turn // 4
    return grid.mean_edge_delay(words, weights, begun, offset, bench.grid)


def rung(bench, rows, omega):
    """Standard deviation (codes) of the mean of adc_sense_sin where y rings at `omega` (rad/s) below the drive.

    The ring, 20 times as large before the demodulator, times a line of the reference's lateness at the same place.
    """
    words, begun = _words_and_start(bench, rows)
    weights, step, x = grid.hann(len(rows)), omega * bench.frame_s, rows["adc_sense_cos"].astype(float)
    ring_amplitude = 2 * abs(np.sum(weights * (x - x.mean()) * np.exp(-1j * step * np.arange(len(x))))) / weights.sum()
    corner_hz = sid.corner_hz(bench.drawing.sid_r_ohm * bench.drawing.sid_c_f)
    ahead = abs(1 + 1j * omega / (2 * math.pi * corner_hz)) ** sid.STAGES
    line = grid.line_deg(words, weights, begun, bench.read("phase_sense_ref"), bench.grid, step)
    return ring_amplitude * ahead * math.radians(line) / math.sqrt(2)


def interval(bench, channel, turns_deg=COUNTER_TURNS_DEG):
    """`Readings` of the lag of an electrode voltage behind its undisplaced sgn(sin); sgn(cos) is read as well."""
    turned, lags_deg, sd_deg = TurnedReading(bench), [], []
    reference_phase_deg = bench.phases_deg()[f"phase_{channel}_ref"]
    for turn in turns_deg:
        turned.to(turn)
        r, rows = bench.counter(channel)
        reference_shift_deg = reference_phase_deg - (turn if channel == "drive" else 0.0)
        pins = [pin_delay(bench, rows, grid.hann(len(rows)), channel, channel, cosine) for cosine in (False, True)]
        lags_deg.append((r.lag_deg + r.cos_lag_deg + pins[0].deg + pins[1].deg) / 2 - reference_shift_deg)
        sd_deg.append((pins[0].sd_deg + pins[1].sd_deg) / 2)
    turned.to(0.0)
    return Readings(np.array(lags_deg), np.array(sd_deg))


def offset_deg(bench):
    """Angle (deg) by which the offset of the sine demodulator makes x lag: its code with the drive off over A's."""
    gain = float(cordic.gain(bench.design.cordic_iterations))
    return math.degrees(bench.offset_codes["adc_drive_sin"] * gain / bench.read("magnitude"))


def detune(bench, angles_deg=DETUNE_DEG):
    """`Readings` of psi = xe1 + xe2' by turning the drive sine to both sides, by several angles.

    The drive is at its best where force and velocity are in phase; the force goes with the velocity, w x, and w differs
    by w/Q tan(theta) between the sides: 1/(2 Q) of angle. The frequency loop holds x where signal and offset of its
    demodulator cancel, so the offset's angle is added; it follows a late pin, so the force is ahead by as much.
    """
    turned, angles, sd_deg = TurnedReading(bench), [], []
    side = 1.0
    for theta in angles_deg:
        level, pin = {}, {}
        for sign in (side, -side):
            turned.to(sign * theta)
            rows = bench.record_with_stamps(DETUNE_S)
            level[sign] = math.log(rows.mean("amplitude_word") / rows.mean("frequency_word"))
            pin[sign] = pin_delay(bench, rows, np.ones(len(rows)))
        ahead, delay_asymmetry_deg = (pin[1.0].deg + pin[-1.0].deg) / 2, (pin[1.0].deg - pin[-1.0].deg) / 2
        angles.append(log_cosine_ratio(theta + delay_asymmetry_deg, level[1.0] - level[-1.0]) + ahead)
        sd_deg.append(math.hypot(pin[1.0].sd_deg, pin[-1.0].sd_deg) / 2)
        side = -side  # the next angle begins where this one ends
    turned.to(0.0)
    return Readings(np.array(angles) + offset_deg(bench), np.array(sd_deg))


def minimum(bench):
    """psi by the minimum of A_d over turned drive references; `Estimate`. FTR and QSC are fixed meanwhile."""
    _fix_sense(bench, 2.0)
    levels, turns, at = [], [], 0.0
    for turn in (*SCAN_DEG, *reversed(SCAN_DEG)):
        at = _turn_drive_references(bench, at, turn)
        bench.settle(SETTLE_S - 0.5)
        rows = bench.record_with_stamps(SCAN_S)
        levels.append(math.log(rows.mean("amplitude_word")))
        turns.append(turn - pin_delay(bench, rows, np.ones(len(rows))).deg)
    _turn_drive_references(bench, at, 0.0)
    bench.set_control(0)
    bench.settle(SETTLE_S)
    # ln A_d = c - ln cos(psi + turn): linear in tan(psi) once the known cosine is taken out
    turn = np.radians(turns)
    y = np.array(levels) + np.log(np.cos(turn))
    basis = np.stack([np.ones_like(turn), np.tan(turn)], axis=1)
    slope, weights = 0.0, np.ones_like(turn)
    for _ in range(20):
        # -ln(1 - s tan(turn)) = s tan(turn) + rest
        nonlinear_part = -np.log1p(-slope * np.tan(turn)) - slope * np.tan(turn)
        coefficients = np.linalg.lstsq(basis * weights[:, None], (y - nonlinear_part) * weights, rcond=None)[0]
        slope = coefficients[1]
    residual = y - nonlinear_part - basis @ coefficients
    freedom = len(turn) - 2
    sd = math.sqrt(residual @ residual / freedom * np.linalg.inv(basis.T @ basis)[1, 1])
    k = float(stats.t.ppf((1 + COVERAGE) / 2, freedom))
    return Estimate(math.degrees(math.atan(slope)) + offset_deg(bench), math.degrees(k * sd))


def _turn_drive_references(bench, at, turn):
    """Turn the drive references from `at` to `turn` (deg) in steps well below the loop's limit of 30 deg."""
    while abs(turn - at) > 1e-9:
        step = math.copysign(min(abs(turn - at), 12.0), turn - at)
        bench.advance_phase_deg("phase_drive_ref", step)
        bench.settle(0.5)
        at += step
    return at


def _fix_sense(bench, seconds):
    """Fix force word and V_q at their means; returns (rate word, u)."""
    rows = bench.record(seconds)
    word = round(rows.mean("rate_word"))
    u = round(float(np.mean(rows["quadrature_code"].astype(float) + 0.5)) ** 2)
    bench.write("rate_fixed", word)
    bench.write("quadrature_fixed", u)
    bench.set_control(sequencer.FIX_FTR | sequencer.FIX_QSC)
    return word, u


def force_interval(bench, turns_deg=COUNTER_TURNS_DEG):
    """ye1 with a fixed sine of a quarter of full scale on the electrode."""
    _fix_sense(bench, 1.0)
    bench.write("rate_fixed", FORCE_WORD)
    bench.settle(0.2)
    lag_readings = interval(bench, "sense", turns_deg)
    bench.set_control(0)
    bench.settle(SETTLE_S)
    return lag_readings


def fit_ringing(codes, split_hz, frame_s):
    """Split (rad/s) and decay time (s) of the line that rings in a record of codes, near the drawing's split."""
    x = codes - codes.mean()
    n = len(x)
    window = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
    spectrum = np.abs(np.fft.rfft(x * window, 4 * n))
    low, high = (int(part * split_hz * 4 * n * frame_s) for part in RING_PARTS)
    top = low + int(np.argmax(spectrum[low:high]))
    a, b, c = np.log(spectrum[top - 1 : top + 2])
    omega = 2 * math.pi * (top + 0.5 * (a - c) / (a - 2 * b + c)) / (4 * n * frame_s)
    # the line of successive fifths: its logarithm falls with time
    parts = np.array_split(np.arange(n), 8)
    t, level = [], []
    for part in parts:
        w = np.sin(np.pi * (np.arange(len(part)) + 0.5) / len(part)) ** 2
        line = np.sum(w * x[part] * np.exp(-1j * omega * part * frame_s)) / w.sum()
        t.append(part.mean() * frame_s)
        level.append(math.log(abs(line)))
    return omega, -1.0 / float(np.polyfit(t, level, 1)[0])


def fit_step_ringing(codes, split_hz, decay_s, rc_s, frame_s):
    """As `fit_ringing`, of a line that has gone before the codes are read: from the codes right after a chop.

    decay_s  of the drawing;  rc_s  of the demodulator, whose own transient is left out
    """
    first = round(STEP_SKIPPED * rc_s / frame_s)
    x = codes[first : first + round(STEP_DECAYS * decay_s / frame_s)]
    t = np.arange(len(x)) * frame_s

    def residual(v):
        line = np.exp((1j * v[0] * 2 * math.pi * split_hz - 1 / (v[1] * decay_s)) * t)
        basis = np.stack([line.real, line.imag, np.ones_like(t)], axis=1)
        return basis @ np.linalg.lstsq(basis, x, rcond=None)[0] - x

    nominal_factors = least_squares(residual, (1.0, 1.0), bounds=((RING_PARTS[0], 0.1), (RING_PARTS[1], 10.0))).x
    return nominal_factors[0] * 2 * math.pi * split_hz, nominal_factors[1] * decay_s


def chop(bench, turns_deg=CHOP_TURNS_DEG):
    """(`Readings`, extra numbers) of the sense pickoff's psi: what V_q = 0 does to both codes, force word at A_I = 0.

    x stands on the drive's references, y is read by the sense's: the lateness of both counts, only while V_q is 0.
    y rings after each chop. Where a line of lateness meets the ring the mean of the codes is off: `rung`.
    """
    word, u = _fix_sense(bench, NULL_S * bench.pace)
    drawing = bench.drawing
    split_hz, decay_s = drawing.fx_hz - drawing.fy_hz, drawing.qy / (math.pi * drawing.fy_hz)
    rc_s = 2 * drawing.sid_r_ohm * drawing.sid_c_f  # of a group that is closed half the time
    turned, angles, sd_deg, opened, closed, rings = TurnedReading(bench), [], [], [], [], []
    for turn in turns_deg:
        turned.to(turn)
        levels, records, steps = [], [], []
        for value in (u, 0, u):
            bench.write("quadrature_fixed", value)
            settling = bench.record(CHOP_SETTLE_S * bench.pace)
            steps.append(settling["adc_sense_cos"].astype(float))
            rows = bench.record_with_stamps(CHOP_S / 2 if value else CHOP_S)
            levels.append((rows.hann("adc_sense_sin"), rows.hann("adc_sense_cos")))
            records.append(rows)
        (i0, q0), (i1, q1), (i2, q2) = levels
        quadrature_code_step = q1 - (q0 + q2) / 2
        weights = grid.hann(len(records[1]))
        x, y = (pin_delay(bench, records[1], weights, channel) for channel in ("drive", "sense"))
        angles.append(math.degrees(math.atan((i1 - (i0 + i2) / 2) / quadrature_code_step)) - x.deg + y.deg)
        if decay_s < CHOP_SETTLE_S * bench.pace / 4:
            rings.append(fit_step_ringing(steps[1], abs(split_hz), decay_s, rc_s, bench.frame_s))
        else:
            rings.append(fit_ringing(records[1]["adc_sense_cos"].astype(float), abs(split_hz), bench.frame_s))
        off = [share * rung(bench, rows, rings[-1][0]) for share, rows in zip((0.5, 1.0, 0.5), records)]
        sd_deg.append(math.hypot(x.sd_deg, y.sd_deg, math.degrees(math.hypot(*off) / quadrature_code_step)))
        opened.append(abs(q1))
        closed.append(abs(i0))
    turned.to(0.0)
    bench.set_control(0)
    bench.settle(SETTLE_S)
    split, decay_s = (float(np.median([r[j] for r in rings])) for j in range(2))
    drive = 2 * math.pi * bench.read("frequency") * bench.lsb_hz
    split = math.copysign(split, split_hz)
    lead_deg = math.degrees(math.atan(2 * drive / (decay_s * split * (2 * drive - split))))
    decay_spread = float(np.std([r[1] for r in rings])) / decay_s
    psi = Readings(np.array(angles) + lead_deg - offset_deg(bench), np.array(sd_deg), lead_deg * decay_spread)
    extra_numbers = {
        "force_word": word,
        "null_v": math.sqrt(u / 2**32) * bench.drawing.quad_dac_span_v,
        "quadrature_code": float(np.mean(opened)),
        "in_phase_code": float(np.mean(closed)),
        "split_hz": split / (2 * math.pi),
        "decay_s": decay_s,
        "mode_lead_deg": lead_deg,
    }
    return psi, extra_numbers


# what a reading falls by for the words: +1 is the word's own degrees
WORDS = {
    "xe1": {"phase_drive_sine": 1},
    "xe2": {"phase_drive_sine": 1, "phase_drive_ref": -1},
    "ye1": {"phase_sense_sine": 1},
    "ye2": {"phase_drive_ref": 1, "phase_sense_ref": -1},
}
STEPS = {
    "xe1": lambda bench: (interval(bench, "drive"), {}),
    "xe2": lambda bench: (detune(bench), {"offset_deg": offset_deg(bench)}),
    "ye1": lambda bench: (force_interval(bench), {}),
    "ye2": chop,
}


def one_pass(bench, compare, say=None, before=None):
    """(`Pass`, {node: `Readings` with words at zero}): measure the four phases, each word moved to where it should be.

    before   readings of an earlier pass, which count as these do
    compare  take the minimum of A_d, too
    """
    estimates, extra_numbers, zero_word_readings, best = {}, {}, {}, {}
    for node, measure in STEPS.items():
        if say:
            say(node)
        if compare and node == "xe2":
            extra_numbers["xe2_minimum"] = minimum(bench)
        node_readings, more = measure(bench)
        extra_numbers |= more
        words = bench.phases_deg()
        compensation_deg = sum(sign * words[name] for name, sign in WORDS[node].items())
        estimates[node] = node_readings.estimate()
        zero_word_readings[node] = node_readings.add_angle(compensation_deg)
        if before:
            zero_word_readings[node] = join_passes(before[node], zero_word_readings[node])
        best[node] = zero_word_readings[node].estimate()
        bench.advance_phase_deg(REGISTER[node], WORDS[node][REGISTER[node]] * (best[node].deg - compensation_deg))
        bench.settle(SETTLE_S)
    # xe2 counts from x's force, ye2 from where x stands: their uncertainties add
    u = {node: e.uncertainty_deg for node, e in best.items()}
    total = u | {"xe2": math.hypot(u["xe2"], u["xe1"]), "ye2": math.hypot(u["ye2"], u["xe2"], u["xe1"])}
    return Pass(estimates, extra_numbers, total), zero_word_readings


def calibrate(bench, compare=True, say=None):
    """Both passes from whatever the registers hold; the second one shows that nothing is left to move.

    Returns `Calibration`; the words stay in the registers.
    """
    begin = bench.phases_deg()
    first, first_readings = one_pass(bench, compare, say)
    second, _ = one_pass(bench, False, say, first_readings)
    last, cases, words = bench.phases_deg(), {1: begin}, dict(begin)
    for number, node in enumerate(NODES, 2):
        words[REGISTER[node]] = last[REGISTER[node]]
        cases[number] = dict(words)
    return Calibration(cases, first, second, second.uncertainty_deg)


__all__ = ["NODES", "PHASE_REGISTERS", "REGISTER", "Calibration", "Estimate", "Pass", "calibrate", "chop", "detune"]
