"""The paper's progressive procedure, with what a laboratory can see: counter, amplitude word, V_q, ADC codes.

    xe1   interval from sgn(sin) and sgn(cos) to Vx-; the drive sine is advanced by it
    xe2   the drive sine turned by +theta and -theta in turn: A_d(+)/A_d(-) = cos(psi + theta)/cos(psi - theta); the
          drive references are delayed by psi. Compared with the minimum of A_d over turned references
    ye1   force word fixed, interval from sgn(sin) and sgn(cos) to Vy-; the sense sine is advanced by it
    ye2   force word fixed where A_I is null, V_q chopped between null and 0: tan(psi) = dI/dQ of the codes, plus the
          sense mode's own lead 2 w_d / (tau (w_d^2 - w_y^2)), which its ring after each chop shows; the sense
          references follow

Cases 1 to 5 are the register sets before, and after each of these. The drive sine turns the force and leaves x where
its reference holds it, so nothing of y moves while xe2 is measured.
Source    docs/paper.md; FACTS corrections 16 to 18
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from fpga_model import sequencer
from fpga_model.rates import MASTER_HZ
from testbench.paper.bench import FRAME_S, PHASE_REGISTERS, log_cosine_ratio

NODES = ("xe1", "xe2", "ye1", "ye2")
REGISTER = dict(zip(NODES, ("phase_drive_sine", "phase_drive_ref", "phase_sense_sine", "phase_sense_ref")))
SETTLE_S = 2.0  # AGC: its slow zero is at 0.6 Hz
DETUNE_DEG, DETUNE_S = (35.0, 55.0, 45.0, 40.0, 50.0, 30.0), 3.0
SCAN_DEG, SCAN_S = (-24.0, -16.0, -8.0, 0.0, 8.0, 16.0, 24.0), 1.0
FORCE_WORD = 1 << 21  # a quarter of full scale
COUNTER_TURNS_DEG = (-45.0, -15.0, 20.0, 50.0)
NULL_S, CHOP_S, CHOP_SETTLE_S = 6.0, 5.0, 0.5
CHOP_TURNS_DEG = (-50.0, -35.0, -20.0, 0.0, 15.0, 30.0, 45.0, 55.0)
# standard uncertainty beside the repeats: what slow beats of the grid, 2 deg/q with q of some hundreds, leave of a mean
# over several frequencies; counter steps and rounding are far below
RESOLVED_DEG = 0.001
COVERAGE = 0.95


class Estimate(NamedTuple):
    """An angle (deg) and its expanded uncertainty at 95 %."""

    deg: float
    uncertainty_deg: float


class Pass(NamedTuple):
    """One pass of the procedure: what each step found, and what else was seen on the way."""

    found: dict  # node -> Estimate, before the word was moved
    seen: dict


class Calibration(NamedTuple):
    """Register sets of cases 1 to 5, both passes, uncertainty of what remains."""

    cases: dict  # case -> {register: deg}
    first: Pass
    second: Pass
    uncertainty_deg: dict


def _mean(values, *others_deg):
    """`Estimate` from repeated readings (deg) and further standard uncertainties."""
    values = np.asarray(values, float)
    n = len(values)
    if n == 1:
        return Estimate(float(values[0]), math.inf)
    own = float(stats.t.ppf((1 + COVERAGE) / 2, n - 1)) * float(values.std(ddof=1)) / math.sqrt(n)
    return Estimate(float(values.mean()), math.hypot(own, *(2 * u for u in others_deg)))


class Turned:
    """The drive sine turned on purpose. The drive frequency follows by some ten millihertz, x and y do not.

    Edges on the 1 MHz grid have a bias of some millidegrees that depends on the frequency to a millihertz, and that no
    repeat at one frequency shows. Readings at several turns average it, and their spread says how large it is.
    """

    def __init__(self, bench):
        self.bench, self.at_deg = bench, 0.0

    def to(self, degrees):
        """Turn and settle."""
        if degrees != self.at_deg:
            self.bench.advance_phase_deg("phase_drive_sine", degrees - self.at_deg)
            self.at_deg = degrees
            self.bench.wait(SETTLE_S)


def interval(bench, channel, turns_deg=COUNTER_TURNS_DEG):
    """Lag of an electrode voltage behind its undisplaced sgn(sin); (Estimate, mean lag behind sgn(cos)).

    sgn(sin) and sgn(cos) are at one phase but for what the grid does to each: both are readings of it.
    """
    turned, both, cos = Turned(bench), [], []
    behind = bench.phases_deg()[f"phase_{channel}_ref"]
    for turn in turns_deg:
        turned.to(turn)
        r = bench.counter(channel)
        known = behind - (turn if channel == "drive" else 0.0)
        both.append((r.lag_deg + r.cos_lag_deg) / 2 - known)
        cos.append(r.cos_lag_deg - known)
    turned.to(0.0)
    return _mean(both, RESOLVED_DEG), float(np.mean(cos))


def offset_deg(bench):
    """Angle (deg) by which the offset of the sine demodulator makes x lag: its code with the drive off over A."""
    return math.degrees(bench.offset_codes["adc_drive_sin"] / bench.read("magnitude"))


def detune(bench, angles_deg=DETUNE_DEG):
    """psi = xe1 + xe2' by turning the drive sine to both sides, by several angles; `Estimate`.

    The drive is at its best where force and velocity are in phase. The frequency loop holds x where signal and offset
    of its demodulator cancel, so the offset's angle is added.
    """
    turned, angles = Turned(bench), []
    side = 1.0
    for theta in angles_deg:
        level = {}
        for sign in (side, -side):
            turned.to(sign * theta)
            level[sign] = math.log(bench.record(DETUNE_S).mean("amplitude_word"))
        angles.append(log_cosine_ratio(theta, level[1.0] - level[-1.0]))
        side = -side  # the next angle begins where this one ends
    turned.to(0.0)
    return _mean(np.array(angles) + offset_deg(bench), RESOLVED_DEG)


def minimum(bench):
    """psi by the minimum of A_d over turned drive references; `Estimate`. FTR and QSC are fixed meanwhile."""
    _fix_sense(bench, 2.0)
    levels, at = [], 0.0
    order = (*SCAN_DEG, *reversed(SCAN_DEG))
    for turn in order:
        while abs(turn - at) > 1e-9:  # the loop holds steps well below its 30 deg limit
            step = math.copysign(min(abs(turn - at), 12.0), turn - at)
            bench.advance_phase_deg("phase_drive_ref", step)
            bench.wait(0.5)
            at += step
        bench.wait(SETTLE_S - 0.5)
        levels.append(math.log(bench.record(SCAN_S).mean("amplitude_word")))
    while abs(at) > 1e-9:
        step = math.copysign(min(abs(at), 12.0), -at)
        bench.advance_phase_deg("phase_drive_ref", step)
        bench.wait(0.5)
        at += step
    bench.set_control(0)
    bench.wait(SETTLE_S)
    # ln A_d = c - ln cos(psi + turn): linear in tan(psi) once the known cosine is taken out
    turn = np.radians(order)
    y = np.array(levels) + np.log(np.cos(turn))
    basis = np.stack([np.ones_like(turn), np.tan(turn)], axis=1)
    slope, weights = 0.0, np.ones_like(turn)
    for _ in range(20):
        # -ln(1 - s tan(turn)) = s tan(turn) + rest
        rest = -np.log1p(-slope * np.tan(turn)) - slope * np.tan(turn)
        coefficients = np.linalg.lstsq(basis * weights[:, None], (y - rest) * weights, rcond=None)[0]
        slope = coefficients[1]
    residual = y - rest - basis @ coefficients
    freedom = len(turn) - 2
    sd = math.sqrt(residual @ residual / freedom * np.linalg.inv(basis.T @ basis)[1, 1])
    k = float(stats.t.ppf((1 + COVERAGE) / 2, freedom))
    return Estimate(math.degrees(math.atan(slope)) + offset_deg(bench), math.degrees(k * sd))


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
    bench.wait(0.2)
    found = interval(bench, "sense", turns_deg)
    bench.set_control(0)
    bench.wait(SETTLE_S)
    return found


def ring(codes, frame_s=FRAME_S):
    """Split (rad/s) and decay time (s) of the line that rings in a record; codes without their mean."""
    x = codes - codes.mean()
    n = len(x)
    window = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
    spectrum = np.abs(np.fft.rfft(x * window, 4 * n))
    low = int(40.0 * 4 * n * frame_s)
    high = int(300.0 * 4 * n * frame_s)
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


def chop(bench, turns_deg=CHOP_TURNS_DEG):
    """psi of the sense pickoff: what V_q = 0 does to both codes, the force word fixed at A_I = 0; (Estimate, seen)."""
    rows = bench.record(NULL_S)
    word = round(rows.mean("rate_word"))
    u = round(float(np.mean(rows["quadrature_code"].astype(float) + 0.5)) ** 2)
    bench.write("rate_fixed", word)
    bench.write("quadrature_fixed", u)
    bench.set_control(sequencer.FIX_FTR | sequencer.FIX_QSC)
    turned, angles, opened, closed, rings = Turned(bench), [], [], [], []
    for turn in turns_deg:
        turned.to(turn)
        levels = []
        for value in (u, 0, u):
            bench.write("quadrature_fixed", value)
            bench.wait(CHOP_SETTLE_S)
            rows = bench.record(CHOP_S if value == 0 else CHOP_S / 2)
            levels.append((rows.hann("adc_sense_sin"), rows.hann("adc_sense_cos")))
            if value == 0:
                rings.append(ring(rows["adc_sense_cos"].astype(float)))
        (i0, q0), (i1, q1), (i2, q2) = levels
        angles.append(math.degrees(math.atan((i1 - (i0 + i2) / 2) / (q1 - (q0 + q2) / 2))))
        opened.append(abs(q1))
        closed.append(abs(i0))
    turned.to(0.0)
    bench.set_control(0)
    bench.wait(SETTLE_S)
    split, decay_s = (float(np.median([r[j] for r in rings])) for j in range(2))
    drive = 2 * math.pi * bench.read("frequency") * MASTER_HZ / 2**48
    lead_deg = math.degrees(2 * drive / (decay_s * split * (2 * drive - split)))
    decay_spread = float(np.std([r[1] for r in rings])) / decay_s
    found = _mean(np.array(angles) + lead_deg - offset_deg(bench), RESOLVED_DEG, lead_deg * decay_spread)
    seen = {
        "force_word": word,
        "null_v": math.sqrt(u / 2**32) * 5.5,
        "quadrature_code": float(np.mean(opened)),
        "in_phase_code": float(np.mean(closed)),
        "split_hz": split / (2 * math.pi),
        "decay_s": decay_s,
        "mode_lead_deg": lead_deg,
    }
    return found, seen


def one_pass(bench, compare, say=None, share=1.0):
    """Measure the four phases and move their words by `share` of each; `compare` takes the minimum of A_d, too."""
    found, seen = {}, {}

    def moved(node, degrees):
        bench.advance_phase_deg(REGISTER[node], share * degrees)
        bench.wait(SETTLE_S)

    def told(text):
        if say:
            say(text)

    told("xe1")
    found["xe1"], seen["xe1_cos_deg"] = interval(bench, "drive")
    moved("xe1", found["xe1"].deg)
    told("xe2")
    seen["offset_deg"] = offset_deg(bench)
    if compare:
        seen["xe2_minimum"] = minimum(bench)
    found["xe2"] = detune(bench)
    moved("xe2", -found["xe2"].deg)
    told("ye1")
    found["ye1"], seen["ye1_cos_deg"] = force_interval(bench)
    moved("ye1", found["ye1"].deg)
    told("ye2")
    found["ye2"], more = chop(bench)
    seen |= more
    moved("ye2", -found["ye2"].deg)
    return Pass(found, seen)


def calibrate(bench, compare=True, say=None):
    """Both passes from whatever the registers hold; the second one shows that nothing is left to move.

    Returns `Calibration`; the words stay in the registers.
    """
    begin = bench.phases_deg()
    first = one_pass(bench, compare, say)
    second = one_pass(bench, False, say, share=0.5)  # the mean of two readings as good as each other
    last, cases, words = bench.phases_deg(), {1: begin}, dict(begin)
    for number, node in enumerate(NODES, 2):
        words[REGISTER[node]] = last[REGISTER[node]]
        cases[number] = dict(words)
    # xe2 was found with what xe1 left, ye2 with what xe2 left: their uncertainties add
    u = {node: second.found[node].uncertainty_deg for node in NODES}
    total = {
        "xe1": u["xe1"],
        "xe2": math.hypot(u["xe2"], u["xe1"]),
        "ye1": u["ye1"],
        "ye2": math.hypot(u["ye2"], u["xe2"], u["xe1"]),
    }
    return Calibration(cases, first, second, total)


__all__ = ["NODES", "PHASE_REGISTERS", "REGISTER", "Calibration", "Estimate", "Pass", "calibrate", "chop", "detune"]
