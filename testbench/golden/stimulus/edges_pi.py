"""Edges of a PI, alone or within a loop: operations solved so that acc, the rounding and y meet their edges exactly.

    acc = base + ki*E     E the sum of errors since acc was base = preset*2**24, or a limit where there is no preset
    y   = clamp(round(acc + kp*e))

E for a wanted acc follows from the inverse of ki modulo 2**24; an even gain has steps of its power of two instead of 1.
Source  fpga_model/pi.py
"""

from typing import NamedTuple

from fpga_model import pi
from fpga_model.fixed import Fmt, half_up, signed_bits
from testbench.golden.stimulus.writer import around, corners

ONE = 1 << pi.SHIFT
CARRY_TRIES, CARRY_STRIDE = 256, 7919
half_up = getattr(half_up, "py_func", half_up)


def largest_power_of_two(x):
    """Largest power of two in x; 2**24 for 0, which moves no fraction bit."""
    return min(x & -x, ONE) if x else ONE


class Loop(NamedTuple):
    """A PI with its parameters, the formats of its error and its preset (None if fixed at 0), and how to operate it."""

    p: pi.Params
    error: Fmt
    preset: Fmt | None
    operate: object

    def presets(self, values):
        """Those that the port can give and the clamp leaves alone."""
        fits = self.preset.holds if self.preset else (lambda v: v == 0)
        return [v for v in values if fits(v) and self.p.lo <= v <= self.p.hi]

    def errors(self, total):
        """A sum of errors in steps that the input can give."""
        end = self.error.hi if total > 0 else self.error.lo + 1
        full_scale_steps, remainder = divmod(total, end) if total else (0, 0)
        return [end] * full_scale_steps + ([remainder] if remainder or not full_scale_steps else [])

    def solve_residue_errors(self, gain, low):
        """Errors e >= 0 and e < 0 with gain*e = low modulo 2**24, nearest to 0; none if the gain is too even."""
        twos = largest_power_of_two(gain)
        if low % twos or twos == ONE:
            return []
        size = ONE // twos
        e = low // twos * pow(gain // twos, -1, size) % size
        return [e, e - size]

    def solve_target_operations(self, target):
        """[(mode, e, preset)] that bring acc to `target`, which may lie just beyond a limit; None if none do."""
        if self.p.ki == 0:
            return None
        if self.preset is None:
            for base, ops in self.bases():
                if base is not None and (target - base) % self.p.ki == 0:
                    total = (target - base) // self.p.ki
                    if len(self.errors(total)) < 40:
                        return ops + [(pi.RUN, e, 0) for e in self.errors(total)]
            return None
        for total in sorted({0, *self.solve_residue_errors(self.p.ki, target % ONE)}, key=abs):
            integral_step = self.p.ki * total
            if (target - integral_step) % ONE == 0 and self.presets([(target - integral_step) // ONE]):
                runs = [(pi.RUN, e, 0) for e in self.errors(total)]
                return [(pi.OFF, 0, (target - integral_step) // ONE), *runs]
        return None

    def bases(self):
        """Places that acc comes to exactly without a preset: 0 (clamped), and the limits if they are near."""
        zero = min(max(0, self.p.lo), self.p.hi) * ONE
        yield zero, [(pi.OFF, 0, 0)]
        for limit, end in ((self.p.lo, self.error.lo), (self.p.hi, self.error.hi)):
            if self.p.ki < 0:
                end = -end
            steps = abs(limit * ONE - zero) // abs(self.p.ki * end) + 1
            if steps < 40:
                yield limit * ONE, [(pi.OFF, 0, 0)] + [(pi.RUN, end, 0)] * steps

    def solve_limit_approach(self, limit, sign):
        """Operations that bring acc as near as it can be to one side of a limit, where no single LSB is possible."""
        if self.p.ki == 0:
            return None
        reach = min((self.p.hi - self.p.lo) * ONE // abs(self.p.ki), 1 << 14)
        closest_error = min(range(-reach, reach + 1), key=lambda e: (sign * self.p.ki * e) % ONE or ONE)
        integral_step = self.p.ki * closest_error
        # target = limit + distance, distance > 0 towards `sign`
        distance = sign * ((sign * integral_step) % ONE)
        start = limit + (distance - integral_step) // ONE
        if self.preset is None or not self.presets([start]):
            return None
        return [(pi.OFF, 0, start), *((pi.RUN, e, 0) for e in self.errors(closest_error))]


def presets_at_the_limits(loop):
    if loop.preset is None:
        return
    for limit in (loop.p.lo, loop.p.hi):
        for value in (limit - 2, limit - 1, limit, limit + 1, limit + 2):
            if loop.preset.holds(value):
                loop.operate(pi.OFF, 0, value)


def acc_at_the_limits(loop):
    step = largest_power_of_two(loop.p.ki)
    for limit in (loop.p.lo, loop.p.hi):
        for offset in (-1, 0, 1):
            ops = loop.solve_target_operations(limit * ONE + offset * step) or (
                offset and loop.solve_limit_approach(limit, offset)
            )
            for op in ops or ():
                loop.operate(*op)


def rounding(loop):
    """Sums whose 24 dropped bits are 0, 1, half -1, half, half +1, all ones; ties of either sign, even and odd."""
    p, half = loop.p, ONE >> 1
    step = min(largest_power_of_two(p.kp), largest_power_of_two(p.ki))
    for low in (0, step, half - step, half, half + step, ONE - step):
        missing_kinds = {(low, sign, odd) for sign in (0, 1) for odd in (0, 1)} if low == half else {low}
        for first in range(48):
            for start in loop.presets((1, 2, 0, p.lo, p.hi, (p.lo + p.hi) // 2))[: 3 if first else 6]:
                acc = min(max(start * ONE + p.ki * first, p.lo * ONE), p.hi * ONE)
                if p.kp:
                    tries = [(acc + p.kp * e, first, e) for e in loop.solve_residue_errors(p.kp, (low - acc) % ONE)]
                else:
                    tries = [(start * ONE + p.ki * e, e, 0) for e in loop.solve_residue_errors(p.ki, low)]
                    tries = [t for t in tries if p.lo * ONE <= t[0] <= p.hi * ONE]
                for total, run, last in tries:
                    kind = (low, int(total < 0), (total >> pi.SHIFT) & 1) if low == half else low
                    if kind in missing_kinds and loop.error.holds(run) and loop.error.holds(last):
                        missing_kinds.discard(kind)
                        loop.operate(pi.OFF, 0, start)
                        loop.operate(pi.RUN, run, 0)
                        if p.kp:
                            loop.operate(pi.P_ONLY, last, 0)
                        loop.operate(pi.HOLD, 0, 0)
            if not missing_kinds:
                break


def y_at_the_limits(loop):
    p = loop.p
    for limit in (p.lo, p.hi):
        for offset_lsb in (-2, -1, 0, 1, 2):
            for e in (0, 1, -1, 2, -2, 3, -3, 4, -4):
                value = limit + offset_lsb - half_up(p.kp * e, pi.SHIFT)
                ops = [(pi.OFF, 0, value)] if loop.presets([value]) else None
                if loop.preset is None and p.lo <= value <= p.hi:
                    ops = _solve_value_approach(loop, value)
                if ops:
                    for op in ops:
                        loop.operate(*op)
                    loop.operate(pi.P_ONLY, e, 0)
                    loop.operate(pi.HOLD, 0, 0)
                    break


def _solve_value_approach(loop, value):
    """Operations without a preset that bring acc nearest to a value of y."""
    for base, ops in loop.bases():
        total = (value * ONE - base) // loop.p.ki if loop.p.ki else 0
        if loop.p.ki and len(loop.errors(total)) < 8:
            return ops + [(pi.RUN, e, 0) for e in loop.errors(total)]
    return None


def comparators(loop):
    """Each bit of the three comparisons with a limit alone: preset, then acc and y one bit beside it.

    acc with all bits of the limit and one more of the 24 below it is beyond hi by that bit alone.
    """
    p = loop.p
    if loop.preset is None:
        _comparators_by_integration(loop)
        return
    for limit in (p.lo, p.hi):
        for target in around(limit, pi.OUT):
            if loop.preset.holds(target):
                loop.operate(pi.OFF, 0, target)
                loop.operate(pi.RUN, 0, 0)
            if not p.lo <= target <= p.hi:
                _overshoot_limit(loop, target)
    for k in range(pi.SHIFT):
        for op in loop.solve_target_operations(p.hi * ONE + (1 << k)) or ():
            loop.operate(*op)


def _comparators_by_integration(loop):
    """As `comparators`: acc from a limit that it is clamped to, in steps of ki; y from acc = 0, by acc and prop."""
    p = loop.p
    if not (p.kp and p.ki):
        return
    for base, ops in loop.bases():
        if base == 0:
            continue
        for op in ops:
            loop.operate(*op)
        steps = {(target - base) // p.ki for target in around(base, signed_bits(61))}
        outwards = 1 if (base > 0) == (p.ki > 0) else -1
        for e in sorted(e for e in steps if loop.error.holds(e)):
            loop.operate(pi.RUN, e, 0)
            if e * outwards < 0:
                loop.operate(pi.RUN, max(loop.error.lo, min(-e, loop.error.hi)), 0)
    for limit in (p.lo, p.hi):
        for target in around(limit, pi.OUT):
            e = target * ONE // p.kp
            run = (target * ONE - p.kp * e) // p.ki
            if loop.error.holds(e) and loop.error.holds(run) and limit:
                loop.operate(pi.OFF, 0, 0)
                loop.operate(pi.RUN, run, 0)
                loop.operate(pi.P_ONLY, e, 0)
                loop.operate(pi.HOLD, 0, 0)


def _overshoot_limit(loop, target):
    """The sum behind y at a target beyond a limit by prop, then acc there by one error, if they get so far."""
    for gain, mode in ((loop.p.kp, pi.P_ONLY), (loop.p.ki, pi.RUN)):
        limit = loop.p.hi if target > loop.p.hi else loop.p.lo
        e = -((limit - target) * ONE // gain) if gain else 0
        start = target - half_up(gain * e, pi.SHIFT)
        if gain and loop.error.holds(e) and loop.presets([start]):
            loop.operate(pi.OFF, 0, start)
            loop.operate(mode, e, 0)
            loop.operate(pi.HOLD, 0, 0)


def carries(loop):
    """Sums whose 24 dropped bits are exactly half, or one step less: there each bit of prop and of acc counts alone.

    At half every set bit decides whether y is rounded up; a step below it every clear one would, if it were set.
    """
    p, half = loop.p, ONE >> 1
    step = min(largest_power_of_two(p.kp), largest_power_of_two(p.ki))
    if not p.kp:
        return
    for low, level in ((half, 1), (half - step, 0)):
        missing = {(name, k) for name in ("prop", "acc") for k in range(pi.SHIFT)}
        for first in range(CARRY_TRIES):
            run = first * CARRY_STRIDE % (1 << (1 + first % (loop.error.width - 2)))
            for start in loop.presets((0, 1, p.lo, p.hi, (p.lo + p.hi) // 2)):
                acc = start * ONE + p.ki * run
                if not p.lo * ONE < acc < p.hi * ONE:
                    continue
                for e in loop.solve_residue_errors(p.kp, (low - acc) % ONE):
                    total = (acc + p.kp * e) >> pi.SHIFT
                    terms = {"prop": p.kp * e, "acc": acc}
                    deciding_bits = {(name, k) for name, k in missing if terms[name] >> k & 1 == level}
                    if deciding_bits and loop.error.holds(e) and p.lo < total < p.hi:
                        missing -= deciding_bits
                        loop.operate(pi.OFF, 0, start)
                        loop.operate(pi.RUN, run, 0)
                        loop.operate(pi.P_ONLY, e, 0)
                        loop.operate(pi.HOLD, 0, 0)


def append_pi_edges(loop):
    for part in (presets_at_the_limits, acc_at_the_limits, rounding, carries, y_at_the_limits, comparators):
        part(loop)


# Who owns the PI ------------------------------------------------------------------------------------------------------


def edges_pi(w):
    """The PI itself: one enable for each operation; then every mode at every step of a limit."""
    p = w.block.cases[w.case]

    def operate(mode, e, preset):
        w.append_row({"en": 1, "mode": mode, "e": e, "preset": preset})

    append_pi_edges(Loop(p, pi.ERR, pi.OUT, operate))
    for limit in (p.lo, p.hi):
        w.append_row({"en": 1, "mode": pi.OFF, "preset": limit})
        for e in (0, 1, -1, pi.ERR.hi, pi.ERR.lo, 1, -1):
            for mode in (pi.RUN, pi.P_ONLY, pi.HOLD):
                w.append_row({"en": 1, "mode": mode, "e": e, "preset": limit})
        w.append_row({"mode": pi.RUN, "e": 5}, times=2)


def _loop_error_inputs(stem, e):
    """Inputs that make the error of a loop."""
    if stem == "agc":
        return {"setpoint": max(e, 0), "magnitude": max(-e, 0)}
    cos = min(-e, ERRORS[stem].hi)  # minus full scale has no opposite
    return {"frequency_tracker": {"phase": e}, "rate_loop": {"sense_sin": e}, "quadrature_loop": {"sense_cos": cos}}[
        stem
    ]


ERRORS = {"agc": Fmt(1, 24, 0)} | dict.fromkeys(("frequency_tracker", "rate_loop", "quadrature_loop"), signed_bits(24))


def edges_loop(w):
    """The edges of the PI through the error of its loop; then strobes one clock apart, the inputs at their corners."""
    stem = w.block.stem
    preset = next(port.fmt for port in w.block.inputs if port.name == "preset")
    fixed = stem == "frequency_tracker"

    def operate(mode, e, value):
        w.append_row({"en": 1, "mode": pi.HOLD, **_loop_error_inputs(stem, e)})
        w.append_row({"en_pi": 1, "mode": mode, **({} if fixed else {"preset": value})})

    p = w.block.cases[w.case].loop
    append_pi_edges(Loop(p, ERRORS[stem], None if fixed else preset, operate))
    w.append_row(times=3)
    if fixed:
        # the word at all ones, at 0, and one LSB beyond each end
        for e in (1, -1):
            for word in (-2, -1, 0, 1):
                w.append_row(
                    {"en": 1, "load": 1, "preset": (word - half_up(p.kp * e, pi.SHIFT)) % (preset.hi + 1), "phase": e}
                )
                w.append_row({"en_pi": 1, "mode": pi.OFF})
                w.append_row({"en_pi": 1, "mode": pi.P_ONLY})
                w.append_row(times=3)
    modes = next(port for port in w.wide if port.name == "mode")
    for mode in (0, 2, 1, 2, 3, modes.fmt.hi, 2):
        for port in w.wide:
            for value in corners(port.fmt) if port.name != "mode" else ():
                w.append_row({**w.some(), "mode": mode, port.name: value, "en": 1})
                w.append_row({**w.some(), "mode": mode, port.name: value, "en_pi": 1})
                w.append_row({"mode": mode}, times=3)
