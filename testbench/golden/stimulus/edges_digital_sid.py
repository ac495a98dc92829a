"""Edges of the digital demodulator: sums at their limits, poles and codes whose dropped bits are at their edges.

Source  fpga_model/digital_sid.py
"""

import itertools
from typing import NamedTuple

import numpy as np

from fpga_model import digital_sid
from testbench.golden.stimulus.edges_pi import largest_power_of_two
from testbench.golden.stimulus.writer import wrap_to_format

SHORT = 16  # ticks of rest


def _append_samples(w, rows):
    """Samples into the integrators of all four channels, their signs by the references."""
    for refs, x, times in rows:
        w.append_row({"ce_1m": 1, "refs": refs, "sample_x": x, "sample_y": x}, times=times)


def _start(w):
    """After a reset the references that a design delays are all ones too."""
    w.append_row(rst=1)
    w.append_row({"ce_1m": 1, "refs": 15}, times=digital_sid.MAX_DELAY)


def edges_digital_sid(w):
    """acc at both limits +-1 LSB, poles whose 20 dropped bits are at their edges, dumps at every distance."""
    lo, hi = digital_sid.SAMPLE.lo, digital_sid.SAMPLE.hi
    for x, y in ((hi, lo), (lo, hi), (lo, lo)):
        for refs in (0, 15, 5, 10):
            w.append_row({"ce_1m": 1, "refs": refs, "sample_x": x, "sample_y": y}, times=30)
            w.operation({"refs": refs, "sample_x": x, "sample_y": y})
    for limit, end in ((digital_sid.ACC.lo, lo), (digital_sid.ACC.hi, hi)):
        ticks = limit // end - 1
        for offset in (-1, 0, 1):
            _start(w)
            remainder = limit - ticks * end + offset
            _append_samples(
                w, [(15, end, ticks), (15, remainder - remainder // 2, 1), (15, remainder // 2, 1), (15, 0, 1)]
            )
    for first, second in _rounding_pairs(w.block.cases[w.case].alpha):
        _start(w)
        w.append_row({"ce_1m": 1, "refs": 15, "sample_x": first, "sample_y": first})
        w.operation({"refs": 15, "sample_x": second, "sample_y": second})
        w.operation({"refs": 15})
    for sums in (*_code_ties(w.block.cases[w.case]), *_code_limits(w.block.cases[w.case])):
        _start(w)
        for total in sums:
            _append_samples_of_sum(w, total)
            w.operation({"refs": 15})
    _append_constant_samples(w, w.block.cases[w.case].still)
    for gap in range(1, 8):
        w.append_row({"ce_1m": 1, "dump": 1, **w.some()})
        w.append_row({"refs": 3}, times=gap)


def _append_constant_samples(w, limit):
    """Samples at rest for as long as is allowed, and one tick more or less, until a dump; then each of them alone."""
    for times in (limit - 1, limit, limit + 1) if limit <= SHORT else (limit + 1,):
        w.append_row({"ce_1m": 1, "sample_x": 1 + times, "sample_y": -times})
        w.append_row({"ce_1m": 1, "sample_x": 3, "sample_y": -3})
        w.append_row({"ce_1m": 1, "sample_x": 3, "sample_y": -3}, times=times - 1)
        w.operation({"sample_x": 3, "sample_y": -3})
        w.operation({"sample_x": 4, "sample_y": -4})
    for name in ("sample_x", "sample_y"):
        for k in range(min(limit, SHORT) + 2):
            w.append_row({"ce_1m": 1, "sample_x": 9, "sample_y": 9, name: k})
        w.operation({"sample_x": 9, "sample_y": 9, name: -1})
    # one bit of one sample after the other: each alone is another sample
    values = {"sample_x": 0, "sample_y": 0}
    for bit in range(digital_sid.SAMPLE.width):
        values = {name: wrap_to_format(v ^ (1 << bit), digital_sid.SAMPLE) for name, v in values.items()}
        w.append_row({"ce_1m": 1, **values})
        w.append_row({"ce_1m": 1, **values, "sample_x": wrap_to_format(~values["sample_x"], digital_sid.SAMPLE)})


def _step_pole(alpha, y, x):
    """(what is rounded, the pole after it) for arrays of a pole and of its input."""
    product = alpha * (x - y)
    return product, y + ((product + (1 << (digital_sid.ALPHA.f - 1))) >> digital_sid.ALPHA.f)


def _rounding_pairs(alpha):
    """Pairs of dumped sums that bring each of three poles to every edge of its rounding."""
    cut = digital_sid.ALPHA.f
    half, size, step = 1 << (cut - 1), 1 << cut, largest_power_of_two(alpha)
    first = np.arange(1, 1 << 17) << digital_sid.POLE.f
    kinds = [(low, None, None) for low in (0, step, half - step, half + step, size - step)]
    kinds += [(half, odd, negative) for odd in (0, 1) for negative in (False, True)]
    missing_kinds, pairs = {(pole, *kind) for pole in range(3) for kind in kinds}, []
    for second in itertools.chain.from_iterable((k, -k) for k in range(1, 17)):
        zero, inputs = np.zeros_like(first), (first, np.full_like(first, second << digital_sid.POLE.f))
        for pole in range(3):
            _, pole_first_dump = _step_pole(alpha, zero, inputs[0])
            product, pole_second_dump = _step_pole(alpha, pole_first_dump, inputs[1])
            low, parity = product & (size - 1), (product >> cut) & 1
            for kind in sorted((k for k in missing_kinds if k[0] == pole), key=str):
                _, value, odd, negative = kind
                is_match = low == value
                if odd is not None:
                    is_match &= (parity == odd) & ((product < 0) == negative)
                if is_match.any():
                    missing_kinds.discard(kind)
                    pairs.append((int(first[is_match.argmax()]) >> digital_sid.POLE.f, second))
            inputs = (pole_first_dump, pole_second_dump)
        if not missing_kinds:
            break
    return pairs


def _dump_poles(alpha, poles, x):
    """The three poles after a dump of the sums x (arrays)."""
    value, after = x << digital_sid.POLE.f, []
    for pole in poles:
        _, value = _step_pole(alpha, pole, value)
        after.append(value)
    return after


def _append_samples_of_sum(w, total):
    """Samples whose sum is `total`."""
    end = digital_sid.SAMPLE.hi if total > 0 else -digital_sid.SAMPLE.hi
    full_scale_ticks, remainder = divmod(abs(total), digital_sid.SAMPLE.hi)
    _append_samples(w, [(15, end, full_scale_ticks)] if full_scale_ticks else [])
    _append_samples(w, [(15, remainder if total > 0 else -remainder, 1)])


class Grid(NamedTuple):
    """Sums of four dumps: two fixed, two that vary (arrays), and pole3 after a fifth as start + slope * sum."""

    sums: tuple
    poles: list
    start: np.ndarray
    slope: np.ndarray

    def solve_dump_sums(self, alpha, target, fits):
        """The sums of the five dumps whose pole3 is near `target` and fits; None if there are none."""
        last = ((target - self.start) << 16) // self.slope
        hits = fits(_dump_poles(alpha, self.poles, last)[2]) & (abs(last) <= digital_sid.ACC.hi)
        if not hits.any():
            return None
        n = int(hits.argmax())
        return tuple(int(np.broadcast_to(x, last.shape)[n]) for x in (*self.sums, last))


def _build_sum_grid(alpha, base):
    second, third = (x.ravel() for x in np.meshgrid(np.arange(512) * 7, np.arange(512) * 5, indexing="ij"))
    zero = np.zeros_like(second)
    sums, poles = (base, base, base + second, base + third), [zero] * 3
    for x in sums:
        poles = _dump_poles(alpha, poles, zero + x)
    start = _dump_poles(alpha, poles, zero)[2]
    return Grid(sums, poles, start, _dump_poles(alpha, poles, zero + (1 << 16))[2] - start)


def _fast(p):
    """Whether five dumps get pole3 anywhere: with slow poles they do not."""
    return p.alpha >= 1 << (digital_sid.ALPHA.f - 1)


def _code_ties(p):
    """Sums that bring gain*pole3 to a tie, of either sign, even and odd: for each gain pole3 has one residue for it."""
    sums_by_kind = {}
    for base in (20_000, -20_000, 110_000, -110_000) if _fast(p) else ():
        grid = _build_sum_grid(p.alpha, base)
        for gain in (p.gain_x, p.gain_y):
            twos = gain & -gain
            size = (1 << digital_sid.SHIFT) // twos
            residue = (size >> 1) * pow(gain // twos, -1, size) % size
            for target in range(residue - 2 * size, residue + 2 * size, size):
                kind = (gain, target < 0, (gain * target >> digital_sid.SHIFT) & 1)
                if kind not in sums_by_kind:
                    sums = grid.solve_dump_sums(p.alpha, target, lambda pole, target=target: pole == target)
                    sums_by_kind |= {kind: sums} if sums else {}
    return list(sums_by_kind.values())


def _code_limits(p):
    """Sums that bring gain*pole3 to both limits of a code and one LSB beside them, for each gain."""
    limit_sums = []
    half, shift = 1 << (digital_sid.SHIFT - 1), digital_sid.SHIFT
    for gain, limit in itertools.product((p.gain_x, p.gain_y), (digital_sid.CODE.lo, digital_sid.CODE.hi)):
        if not _fast(p):
            break
        grid = _build_sum_grid(p.alpha, ((limit << shift) // gain) >> digital_sid.POLE.f)
        for target_code in (limit - 1, limit, limit + 1):
            sums = grid.solve_dump_sums(
                p.alpha,
                (target_code << shift) // gain,
                lambda pole, gain=gain, wanted=target_code: (gain * pole + half) >> shift == wanted,
            )
            limit_sums += [sums] if sums else []
    return limit_sums
