"""Goals that no stimulus of a case can meet, each with the argument.

    claims       shapes of the place, outcomes and an argument in words
    bounds       intervals of registers: a bit that is the same all over its interval cannot toggle
    multiples    registers that are multiples of a power of two: the bits below it cannot toggle
    computed     what follows from the numbers of a case: gains, limits, widths, or all values tried

A place is the syntax tree of its expression in the function that it stands in; a shape is an expression in which `_` is
any expression, or any field. Each reason begins with "proved: ". A claim is an argument and not an observation: tests
try to break every one with random rows, and no vector may contradict one.
Source  docs/golden.md
"""

import ast
import functools
from typing import NamedTuple

import numpy as np

from fpga_model import axi_slave, cordic, fault_monitor, modulator, pi, rate_output, registers, sequencer, sine
from testbench.golden.coverage import coverage, probes
from testbench.golden.stimulus import blocks
from testbench.golden.stimulus.edges_pi import ERRORS, ONE, Loop, half_up, largest_power_of_two

TIES = ("tie+even", "tie+odd", "tie-even", "tie-odd")


@functools.cache
def _parse_expression(text):
    return ast.parse(text, mode="eval").body


def _matches_shape(shape, node):
    """Whether two trees are the same, but for `_` in the first."""
    if isinstance(shape, ast.Name) and shape.id == "_":
        return True
    if isinstance(shape, list):
        return len(shape) == len(node) and all(map(_matches_shape, shape, node))
    if not isinstance(shape, ast.AST):
        return shape == node
    return type(shape) is type(node) and all(
        _matches_shape(part, getattr(node, field)) or (field, part) == ("attr", "_")
        for field, part in ast.iter_fields(shape)
    )


class GoalSite(NamedTuple):
    """Where goals stand: the function, which copy of it, the expression, and which of its kind in that copy."""

    function: str
    copy: int
    tree: ast.expr
    again: int

    def has_shape(self, *shapes):
        """Whether the expression has one of the shapes."""
        return any(_matches_shape(_parse_expression(shape), self.tree) for shape in shapes)


@functools.cache
def _site_by_probe(stem, case):
    """{(kind, name): GoalSite} of every probe of a case."""
    sites = probes.build_probed_step(blocks.BLOCKS[stem], case).sites.values()
    return {(s.kind, s.name): GoalSite(s.function, s.copy, _parse_expression(s.text), s.again) for s in sites}


class Claim(NamedTuple):
    """Outcomes of the places of some shapes, in some blocks; in a function of this name where one is given."""

    stems: tuple
    shapes: tuple
    outcomes: tuple
    reason: str
    function: str | None = None
    again: int | None = None

    def covers(self, site):
        return (
            self.function in (None, site.function) and self.again in (None, site.again) and site.has_shape(*self.shapes)
        )


COUNTS = "the operand is a count plus 1, so at least 1"
UNSIGNED = "the operand is unsigned"
ROOTS, LOCKS, FAULTS = ("isqrt", "quadrature_loop"), ("lock_monitor", "sequencer"), ("fault_monitor", "sequencer")
CLAIMS = (
    Claim(("dds",), ("wrap_unsigned(_ + _, _)",), ("under",), UNSIGNED),
    Claim(ROOTS, ("wrap_unsigned(s.radicand << 2, _)",), ("under", "hi"), f"{UNSIGNED}, its low bits are 0"),
    Claim(ROOTS, ("wrap_unsigned(s.i + 1, _)",), ("under", "lo"), COUNTS),
    Claim(("registers",), ("wrap_unsigned(data, _)",), ("under",), UNSIGNED),
    Claim(("registers",), ("wrap(data, _)",), ("under", "lo"), UNSIGNED),
    Claim(("spi_adc",), ("wrap(shift, _)",), ("under", "lo"), UNSIGNED),
    Claim(
        ("spi_adc",),
        ("half_count == 0", "count & (1 << half_bits) - 1 == 0"),
        ("no", "-1", "+1"),
        "a half period of the default design is one clock",
    ),
    Claim(
        ("spi_slave",),
        ("s.shift >> SHIFT_TOP",),
        ("ones",),
        "a word is loaded with zeros below it, which do not all pass the top before the next load",
    ),
    Claim(("digital_sid",), ("clamp(s.still + 1, _, _)",), ("lo-1", "lo"), COUNTS),
    Claim(("watchdog",), ("clamp(s.age + 1, _, _)",), ("lo-1", "lo"), COUNTS),
    Claim(("rate_output",), ("clamp(p.decimation, _, _)",), ("lo-1",), UNSIGNED),
    Claim(("cordic",), ("s.i < ITERATIONS",), ("+1",), "i stops at ITERATIONS"),
    Claim(
        ("cordic",),
        ("s.i >= d.cordic_iterations",),
        ("yes", "0", "+1"),
        "the default design turns in all ITERATIONS clocks",
    ),
    Claim(("cordic",), ("half_up(ATAN[_], _)",), probes.ROUNDED, "the default design drops no bit of the table"),
    Claim(("cordic",), ("half_up(s.x, _)",), ("tie-even", "tie-odd"), "x is never negative"),
    Claim(("cordic",), ("wrap(half_up(s.angle, _), _)",), ("under",), "the angle is wrapped already, and rounds up"),
    Claim(
        ("pi", *ERRORS),
        ("half_up(p.kp * e, _)", "half_up(p.ki * e, _)"),
        probes.ROUNDED,
        "the default design drops no bit of a product",
    ),
    Claim(("sine",), ("half_up(_, _)",), ("tie-even", "tie-odd"), "the magnitude is never negative"),
    Claim(LOCKS, ("count >= _",), ("+1",), "a count starts again at its limit", "_judge"),
    Claim(LOCKS, ("pending",), ("no",), "without pending the count is 0", "_judge", 2),
    Claim(
        FAULTS,
        tuple(f"clamp({n} + 1, _, _)" for n in ("count", "s.bad_frames", "s.good_frames")),
        ("lo-1", "lo"),
        COUNTS,
    ),
    Claim(("sequencer",), ("clamp(s.timer + 1, _, _)",), ("lo-1", "lo"), COUNTS),
    Claim(("sequencer",), ("clamp(s.attempts + failed, _, _)",), ("lo-1",), UNSIGNED),
    Claim(
        ("sequencer",),
        ("frames < p._", "frames >= p._"),
        ("+1",),
        "the timer starts again at the limit of its state",
        "_following",
    ),
    Claim(
        ("sequencer",),
        ("s.faults.bad_frames >= p.offline",),
        ("+1",),
        "the drive starts with 0 bad frames, they rise by one, and at offline it stops",
    ),
    Claim(("sequencer",), ("en",), ("no",), "the sequencer passes 1", "fault_monitor.step"),
)


def _match_claims(block, goal_site_pairs):
    for claim in CLAIMS:
        if block.stem in claim.stems:
            for goal, site in goal_site_pairs:
                if goal[2] in claim.outcomes and claim.covers(site):
                    yield goal, claim.reason


# Registers --------------------------------------------------------------------------------------------------------


def pi_registers(p, prefix):
    """Intervals of the registers of a PI that starts at 0, and powers of two that divide them."""
    lo, hi = min(p.lo, 0), max(p.hi, 0)
    why = f"lo = {p.lo}, hi = {p.hi}"
    bounds = {f"{prefix}acc": (lo * ONE, hi * ONE, why), f"{prefix}y": (lo, hi, why)}
    if p.kp == 0:
        bounds[f"{prefix}prop"] = (0, 0, "kp = 0")
    return bounds, {
        f"{prefix}prop": (p.kp & -p.kp, f"kp = {p.kp}"),
        f"{prefix}acc": (largest_power_of_two(p.ki), f"ki = {p.ki}"),
    }


def _counters(p, prefix=""):
    tops = p._asdict() | dict.fromkeys(("bad_frames", "good_frames"), p.top)
    return {f"{prefix}{name}": (0, top, f"its top is {top}") for name, top in tops.items()}


def _locks(p, prefix=""):
    tops = [max(pair) - 1 for pair in zip(p.frames_in, p.frames_out, strict=True)]
    return {f"{prefix}count_{k}": (0, top, f"it starts again at {top + 1}") for k, top in enumerate(tops)}


def bounds(block, case):
    """({register: (least, most, why)}, {register: (a power of two that divides it, why)})."""
    p, stem = block.cases[case], block.stem
    if stem == "pi":
        return pi_registers(p, "")
    if stem in ERRORS:
        intervals, multiples = pi_registers(p.loop, "loop_")
        if stem == "agc":
            intervals["o_amplitude"] = (min(0, p.loop.lo), max(p.kick, p.loop.hi), "the kick and the limits")
        return intervals, multiples
    if stem == "delay" and p.depth == 0:
        return {f"taps_{k}": (0, 0, "depth 0 holds the taps at reset") for k in range(8)}, {}
    if stem == "spi_dac":
        return {
            "lead": (0, max(p.lead, p.gap), f"lead = {p.lead}, gap = {p.gap}"),
            "ldac_wait": (0, p.ldac, f"ldac = {p.ldac}"),
            "ldac_n": (1 - max(p.ldac, p.strobe), 1, f"ldac = {p.ldac}, strobe = {p.strobe}"),
        }, {}
    if stem == "axi_slave":
        return {}, dict.fromkeys(("bresp", "rresp"), (axi_slave.SLVERR, "OKAY or SLVERR"))
    if stem == "lock_monitor":
        return _locks(p), {}
    if stem == "fault_monitor":
        return _counters(p), {}
    if stem == "sequencer":
        return {**_locks(p.lock, "lock_"), **_counters(p.faults, "faults_")}, {}
    return {}, {}


def _steady(block, case):
    intervals, multiples = bounds(block, case)
    for port in coverage.goal_ports(block):
        least, most, why = intervals.get(port.name, (port.fmt.lo, port.fmt.hi, ""))
        power, gain = multiples.get(port.name, (1, ""))
        for k in range(port.width):
            reason = None
            if least >> k == most >> k:
                reason = f"{port.name} stays within {least} .. {most}: {why}"
            elif power and power >> (k + 1):
                reason = f"{port.name} is a multiple of {power}: {gain}"
            if reason:
                for way in ("rise", "fall"):
                    yield ("toggle", port.name, f"{way} {k}"), reason


# Places, from the numbers of the case -----------------------------------------------------------------------------


def _outside(fmt_lo, fmt_hi, lo, hi):
    """Outcomes of a clamp to lo .. hi whose operand stays within fmt_lo .. fmt_hi."""
    values = {"lo-1": lo - 1, "lo": lo, "lo+1": lo + 1, "hi-1": hi - 1, "hi": hi, "hi+1": hi + 1}
    return {outcome for outcome, value in values.items() if not fmt_lo <= value <= fmt_hi}


def _loop(block, case):
    p = block.cases[case]
    if block.stem == "pi":
        return Loop(p, pi.ERR, pi.OUT, None)
    preset = next(port.fmt for port in block.inputs if port.name == "preset")
    return Loop(p.loop, ERRORS[block.stem], None if block.stem == "frequency_tracker" else preset, None)


def _acc_reaches(loop, limit, offset):
    """Whether acc + ki*e can be limit*2**24 + beyond, by divisibility alone."""
    p = loop.p
    if loop.preset is None:
        return any((limit * ONE + offset - base * ONE) % p.ki == 0 for base in (min(max(0, p.lo), p.hi), p.lo, p.hi))
    if offset % largest_power_of_two(p.ki):
        return False
    integral_steps = [p.ki * e for e in loop.solve_residue_errors(p.ki, offset % ONE)]
    span = (p.hi - p.lo) * ONE
    lowest, highest = (offset, span + offset) if limit == p.hi else (offset - span, offset)
    return any(lowest <= m <= highest for m in integral_steps)


def _pi_exclusions(block, case, goal_site_pairs):
    loop = _loop(block, case)
    p = loop.p
    step = min(largest_power_of_two(p.kp), largest_power_of_two(p.ki))
    for goal, site in goal_site_pairs:
        outcome = goal[2]
        if site.has_shape("clamp(preset, _, _)") and outcome in _outside(loop.preset.lo, loop.preset.hi, p.lo, p.hi):
            yield goal, f"preset is of format {loop.preset}"
        if site.has_shape("clamp(s.acc + _, _, _)") and p.ki:
            limit, offset_lsb = (p.lo if outcome[:2] == "lo" else p.hi), int(outcome[2:] or 0)
            if not _acc_reaches(loop, limit, offset_lsb):
                yield goal, f"acc moves by multiples of ki = {p.ki} only, from where it is clamped or preset"
        if site.has_shape("half_up(s.prop + s.acc, _)"):
            if step > 1 and outcome in ("one", "half-1", "half+1", "ones"):
                yield goal, f"prop + acc is a multiple of {step}: kp = {p.kp}, ki = {p.ki}"
            if p.kp == 0 and p.lo >= 0 and outcome in ("tie-even", "tie-odd"):
                yield goal, "kp = 0 and lo >= 0: the sum is never negative"
        if site.has_shape("clamp(half_up(s.prop + s.acc, _), _, _)") and p.kp == 0 and outcome in ("lo-1", "hi+1"):
            yield goal, "kp = 0: the sum is acc, which is clamped already"


def _modulator_exclusions(block, case, goal_site_pairs):
    p = block.cases[case]
    amplitude, factor = modulator.AMPLITUDE, modulator.SINE
    ends = [a * s for a in (amplitude.lo, amplitude.hi) for s in (factor.lo, factor.hi)]
    impossible_outcomes = _outside(half_up(min(ends), p.shift), half_up(max(ends), p.shift), p.lo, p.hi)
    factors = np.arange(1, modulator.SINE.hi + 1, 2)
    for goal, site in goal_site_pairs:
        if site.has_shape("clamp(_, _, _)") and goal[2] in impossible_outcomes:
            yield goal, f"the products of the formats round to at most {half_up(max(ends), p.shift)} in magnitude"
        if site.has_shape("half_up(_, _)") and goal[2] in ("half-1", "half+1") and p.shift > modulator.AMPLITUDE.width:
            target_product = (1 << (p.shift - 1)) + (1 if goal[2] == "half+1" else -1)
            least, most = min(ends) - target_product >> p.shift, max(ends) - target_product >> p.shift
            sums = [target_product + (m << p.shift) for m in range(least, most + 1)]
            if not any(((abs(x) % factors == 0) & (abs(x) // factors <= 1 << 23)).any() for x in sums):
                yield goal, "no product of the two formats has these low bits: all odd factors were tried"


def _spi_dac_exclusions(block, case, goal_site_pairs):
    p = block.cases[case]
    why, longest = f"lead = {p.lead}, gap = {p.gap}", max(p.lead, p.gap)
    for goal, site in goal_site_pairs:
        if site.has_shape("s.lead != 0") and goal[2] == "yes" and longest == 0:
            yield goal, why
        if site.has_shape("s.lead == 1") and (longest == 0 or (longest == 1 and goal[2] == "no")):
            yield goal, why
        if site.has_shape("s.left == 0") and (longest == 0 or (p.gap == 0 and goal[2] == "yes")):
            yield goal, why
        if site.has_shape("s.left == 1") and p.gap != 0:
            yield goal, why


def _sequencer_exclusions(block, case, goal_site_pairs):
    p = block.cases[case]
    at_most = (p.search_limit << sequencer.GAIN.f) // p.gain
    totals = [sign * total for total in range(at_most - 2, at_most + 4) for sign in (1, -1)]
    possible_corrections = {abs(half_up(total * p.gain, sequencer.GAIN.f)) for total in totals}
    for goal, site in goal_site_pairs:
        if site.has_shape("abs(correction) <= p.search_limit") and goal[2] in ("-1", "0", "+1"):
            value = p.search_limit + int(goal[2])
            if value not in possible_corrections:
                yield goal, f"a correction is a whole rotation times gain = {p.gain}, rounded: never {value}"
    yield from _fault_exclusions(block, case, goal_site_pairs)


def _fault_exclusions(block, case, goal_site_pairs):
    p = block.cases[case]
    for goal, site in goal_site_pairs:
        if site.function not in ("_count", "_flag"):
            continue
        limit = (p.faults if block.stem == "sequencer" else p)[site.copy - 1]
        if (
            site.function == "_count"
            and goal[0] == "clamp"
            and int(goal[2][2:] or 0) + limit < 1
            and goal[2][:2] == "hi"
        ):
            yield goal, f"{COUNTS}; the limit is {limit}"
        if site.function == "_flag" and goal[0] == "compare" and limit == 0:
            yield goal, "the limit is 0, so the counts are not compared"


def _register_exclusions(block, case, goal_site_pairs):
    for goal, site in goal_site_pairs:
        if goal[2] != "over" or site.function != "_load_register" or not site.has_shape("wrap_unsigned(_, _)"):
            continue
        if registers.WRITABLE[site.copy - 1].fmt.width == registers.DATA.width:
            yield goal, "the register is as wide as the data"


def _sine_exclusions(block, case, goal_site_pairs):
    slopes = np.array(sine.tables()[1])
    for goal, site in goal_site_pairs:
        if site.has_shape("row >> slope_bits"):
            if goal[2] == "zero" and slopes.all():
                yield goal, "no slope of the table is 0"
            if goal[2] == "ones" and (slopes != sine.SLOPE.hi).all():
                yield goal, "no slope of the table is all ones"


def _rate_output_exclusions(block, case, goal_site_pairs):
    t = np.arange(rate_output.T.lo, rate_output.T.hi + 1)
    square, cut = t * t, rate_output.T2_CUT
    low, odd, half = square & ((1 << cut) - 1), (square >> cut) & 1, 1 << (cut - 1)
    values = {"zero": 0, "one": 1, "half-1": half - 1, "half+1": half + 1, "ones": (1 << cut) - 1}
    met = {name for name, value in values.items() if (low == value).any()}
    met |= {name for name, parity in (("tie+even", 0), ("tie+odd", 1)) if ((low == half) & (odd == parity)).any()}
    for goal, site in goal_site_pairs:
        if site.has_shape("half_up(s.t * s.t, _)") and goal[2] not in met:
            yield goal, "all temperatures were tried"


def _sid_exclusions(block, case, goal_site_pairs):
    p = block.cases[case]
    for goal, site in goal_site_pairs:
        if goal[0] != "round":
            continue
        if site.has_shape("half_up(alpha * (x - y), _)"):
            gain, name = p.alpha, "alpha"
        else:
            gain, name = (p.gain_x, "gain_x") if site.function == "_code" and site.copy <= 2 else (p.gain_y, "gain_y")
        if gain % 2 == 0 and goal[2] in ("one", "half-1", "half+1", "ones"):
            yield goal, f"the product is a multiple of {gain & -gain}: {name} = {gain}"


def _has_small_atan_sum():
    """Whether some sum of the first k entries of the table, with any signs, is -1, 0 or 1."""

    def signed_sums(entries):
        partial_sums = np.zeros(1, np.int64)
        for x in entries:
            partial_sums = np.concatenate([partial_sums + x, partial_sums - x])
        return np.sort(partial_sums)

    for k in range(1, cordic.ITERATIONS + 1):
        first_half_sums, second_half_sums = signed_sums(cordic.ATAN[: k // 2]), signed_sums(cordic.ATAN[k // 2 : k])
        insertion_indices = np.searchsorted(second_half_sums, -1 - first_half_sums)
        nearest = second_half_sums[np.minimum(insertion_indices, len(second_half_sums) - 1)] + first_half_sums
        if ((nearest >= -1) & (nearest <= 1)).any():
            return True
    return False


def _cordic_exclusions(block, case, goal_site_pairs):
    sums = sum(1 for x in cordic.ATAN if x % 2)
    turn = not _has_small_atan_sum()
    for goal, site in goal_site_pairs:
        if site.has_shape("wrap(s.angle + turn if _ else _, _)") and turn and sum(cordic.ATAN) < cordic.ANGLE.hi:
            yield goal, "no sum of the first entries of the table, with any signs, is -1, 0 or 1: all were tried"
        # the last angle is the start, a multiple of the cut, plus or minus every entry of the table
        if site.has_shape("half_up(s.angle, _)"):
            needs_zero_lsb = goal[2] in ("zero", *TIES)
            if needs_zero_lsb == bool(sums % 2):
                yield goal, f"the angle is a sum of all {cordic.ITERATIONS} table entries, {sums} of them odd"


COMPUTED = {
    "pi": _pi_exclusions,
    **dict.fromkeys(ERRORS, _pi_exclusions),
    "modulator": _modulator_exclusions,
    "spi_dac": _spi_dac_exclusions,
    "fault_monitor": _fault_exclusions,
    "sequencer": _sequencer_exclusions,
    "registers": _register_exclusions,
    "sine": _sine_exclusions,
    "rate_output": _rate_output_exclusions,
    "digital_sid": _sid_exclusions,
    "cordic": _cordic_exclusions,
}


WAIVED_REGISTERS_BY_BLOCK = {
    "fault_monitor": ("bad_frames", "good_frames"),
    "sequencer": ("timer", "faults_bad_frames", "faults_good_frames"),
}


def _is_timer_clamp(goal):
    case = next(iter(blocks.BLOCKS["sequencer"].cases))
    return _site_by_probe("sequencer", case)[goal[:2]].has_shape("clamp(s.timer + 1, _, _)")


def waiver_reason(block, goal):
    """Why a goal that can be met is not looked for, or None: upper bits of 16, and the top of the timer."""
    for name in WAIVED_REGISTERS_BY_BLOCK.get(block.stem, ()):
        bit = int(goal[2].split()[1]) if goal[0] == "toggle" and goal[1] == name else 0
        timer = name == "timer" and goal[0] == "clamp" and goal[2][:2] == "hi" and _is_timer_clamp(goal)
        if timer or bit >= fault_monitor.QUICK_TOP.bit_length():
            return f"left out: {name} takes up to 65535 frames to get there, more rows than a bundle has"
    return None


@functools.cache
def _reasons(stem, case):
    block = blocks.BLOCKS[stem]
    site_by_probe = _site_by_probe(stem, case)
    goal_site_pairs = [(goal, site_by_probe[goal[:2]]) for goal in coverage.goals(block, case) if goal[0] != "toggle"]
    parts = [_match_claims(block, goal_site_pairs), _steady(block, case)]
    if block.stem in COMPUTED:
        parts.append(COMPUTED[block.stem](block, case, goal_site_pairs))
    return {goal: f"proved: {reason}" for part in parts for goal, reason in part}


def reasons(block, case):
    """{goal: reason} of the goals of a case that cannot be met."""
    return _reasons(block.stem, case)
