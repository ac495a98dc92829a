"""Designs with one planted fault: plain Python steps of eight blocks, each with places where a fault can be put.

They share no code with the diagnosis. A fault is (kind, where, how); `NONE` is the golden design.
"""

import functools
import inspect
import random
from typing import NamedTuple

import numpy as np

from fpga_model import dds, delay, modulator, pi, references, sine, spi_adc, spi_dac
from fpga_model.block import structure
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import formats
from testbench import flatten

NONE = ("", "", "")


class Port(NamedTuple):
    """Format and reset value of a register."""

    fmt: object
    reset: int


def rounded(x, n, rule):
    """Integers only, one line for each rule of the truth table."""
    if n == 0:
        return x
    q, r, half = x >> n, x & ((1 << n) - 1), 1 << (n - 1)
    up = {
        "floor": False,
        "ceil": r > 0,
        "toward_zero": x < 0 and r > 0,
        "half_up": r >= half,
        "half_down": r > half,
        "half_even": r > half or (r == half and q & 1),
        "half_away": r > half or (r == half and x >= 0),
        "half_zero": r > half or (r == half and x < 0),
    }[rule]
    return q + bool(up)


def wrapped(x, width):
    x &= (1 << width) - 1
    return x - (1 << width) if x >> (width - 1) else x


class Fault:
    def __init__(self, fault, d=DEFAULT):
        self.kind, self.where, self.how = fault
        self.d = d

    def on(self, kind, where):
        return self.kind == kind and self.where == where

    def term(self, where, x):
        if self.on("sign", where):
            return -x
        if self.on("gain", where):
            return x << 1 if self.how > 0 else x >> 1
        return x

    def rule(self, default):
        return self.how if self.kind == "rounding" else default

    def limit(self, where, x, lo, hi, step=1):
        if self.on("wrap", where):
            return wrapped(x, self.how)
        if self.on("limit", where):
            lo, hi = lo + self.how[0] * step, hi + self.how[1] * step
        return min(max(x, lo), hi)


def step_modulator(f, p, s, en_product, en_code, amplitude, sine):
    out = s._asdict()
    if en_product:
        out["product"] = f.term("product", amplitude * sine)
    if en_code:
        shift = p.shift - (f.how if f.on("gain", "code") else 0)
        code = rounded(s.product, shift, f.rule("half_up"))
        out["code"] = f.limit("code", -code if f.on("sign", "code") else code, p.lo, p.hi)
        out["held1"], out["held2"] = s.code, s.held1
    return type(s)(**out)


def step_pi(f, p, s, en, mode, e, preset):
    prop, acc, n = s.prop, s.acc, f.d.accumulator_fraction_bits
    limits = p.lo << n, p.hi << n, 1 << n
    if en and mode == 0:
        prop, acc = 0, f.limit("acc", preset << n, *limits)
    elif en and mode in (1, 2):
        prop = rounded(f.term("prop", p.kp * e), 24 - n, "half_up")
        if mode == 2:
            acc = f.limit("acc", s.acc + rounded(f.term("acc", p.ki * e), 24 - n, "half_up"), *limits)
    y = f.limit("y", f.term("y", rounded(s.prop + s.acc, n, f.rule("half_up"))), p.lo, p.hi)
    return type(s)(prop, acc, y)


def step_sine(f, p, s, phase):
    below, whole = f.d.sine_fraction_bits, f.d.sine_address_bits + f.d.sine_fraction_bits
    bases, slopes = sine.tables(f.d)
    turn, place = phase >> (f.d.dds_bits - 2), (phase >> (f.d.dds_bits - 2 - whole)) & ((1 << whole) - 1)
    place ^= ((1 << whole) - 1) * (turn & 1)
    magnitude = rounded((s.base2 << below) + f.term("slope", s.product), 6 + below, f.rule("half_up"))
    minus = s.sign2 if not f.on("sign", "y") else 1 - s.sign2
    return type(s)(
        sign=turn >> 1 if not f.on("sign", "sign") else 1 - (turn >> 1),
        base=bases[place >> below],
        slope=slopes[place >> below],
        fraction=place & ((1 << below) - 1),
        sign2=s.sign,
        base2=s.base,
        product=f.term("product", s.slope * (2 * s.fraction + 1)),
        y=(-magnitude if minus else magnitude) >> f.on("gain", "y"),
    )


def step_dds(f, p, s, word, *offsets):
    def add(where, b):
        x = s.phase + f.term(where, b)
        top = (1 << f.d.dds_bits) - 1
        return min(max(x, 0), top) if f.on("saturate", where) else x & top

    return type(s)(*[add(name, b) for name, b in zip(s._fields, (word, *offsets))])


def step_references(f, p, s, drive_ref, sense_ref, ce_1m):
    def pair(phase):
        return (phase < 1 << 47) + 2 * (phase < 1 << 46 or phase >= 3 << 46)

    picked = (s.signs, *s.aligned)[p.align]
    signs = pair(drive_ref) | pair(sense_ref) << 2
    if f.on("sign", "signs"):
        signs ^= f.how
    aligned = (s.signs, *s.aligned[:-1])
    if f.on("sign", "aligned"):
        aligned = (s.signs ^ f.how, *aligned[1:])
    retimed = picked if ce_1m else s.retimed
    if f.on("sign", "retimed") and ce_1m:
        retimed = picked ^ f.how
    return type(s)(signs, aligned, retimed)


def step_delay(f, p, s, x):
    return type(s)((f.term("taps", x), *s.taps[:-1]))


def flip(word, width):
    return int(f"{word:0{width}b}"[::-1], 2)


def step_spi_dac(f, p, s, load, word):
    if f.kind == "bit_order" and load and f.how == "load":
        word = flip(word, p.bits)
    out = getattr(spi_dac.step, "py_func", spi_dac.step)(p, s, load, word)
    if f.kind == "bit_order" and f.how == "right" and not load and s.sclk_en:
        out = out._replace(shift=s.shift >> 1)
    return out


def step_spi_adc(f, p, s, drdy_n, dout):
    out = getattr(spi_adc.step, "py_func", spi_adc.step)(f.d, s, drdy_n, dout)
    clocks = f.d.adc_divider // 2
    if f.kind == "bit_order" and s.busy and s.word <= f.d.adc_channels and s.sclk and (s.count + 1) % clocks == 0:
        shift = s.shift >> 1 | dout << 23
        out = out._replace(shift=shift)
        last = s.count + 1 == clocks * f.d.adc_word_bits
        if last and s.word == 0:
            out = out._replace(status=shift)
        elif last:
            channels = list(out.channels)
            channels[s.word - 1] = wrapped(shift, 24)
            out = out._replace(channels=tuple(channels))
    return out


STEPS = {
    "modulator": step_modulator,
    "pi": step_pi,
    "sine": step_sine,
    "dds": step_dds,
    "references": step_references,
    "delay": step_delay,
    "spi_dac": step_spi_dac,
    "spi_adc": step_spi_adc,
}
MODULES = {
    "modulator": modulator,
    "pi": pi,
    "sine": sine,
    "dds": dds,
    "references": references,
    "delay": delay,
    "spi_dac": spi_dac,
    "spi_adc": spi_adc,
}


@functools.cache
def sine_ties(d):
    """Phases whose magnitude lies midway between two codes."""
    found, n, whole = [], d.sine_fraction_bits, d.sine_address_bits + d.sine_fraction_bits
    cut = d.dds_bits - 2 - whole
    for a, (base, slope) in enumerate(zip(*sine.tables(d))):
        for fraction in np.flatnonzero(((base << n) + slope * (2 * np.arange(1 << n) + 1)) % (64 << n) == 32 << n):
            place = a << n | int(fraction)
            found += [(q << whole | place ^ (((1 << whole) - 1) * (q & 1))) << cut for q in range(4)]
    return found


def stimulus(block, seed, d=DEFAULT):
    """(params, inputs): enables in bursts and holds, corners and random words, ties at every rounding."""
    r = random.Random(f"{block} {seed}")

    def word(bits):
        return r.choice([0, 1, (1 << bits) - 1, 1 << (bits - 1), r.getrandbits(bits), r.getrandbits(bits)])

    def number(fmt):
        return r.choice(
            [fmt.lo + 1, fmt.lo, fmt.hi, r.randint(fmt.lo, fmt.hi), r.randint(fmt.lo, fmt.hi), r.randint(-9, 9)]
        )

    if block == "modulator":
        p = modulator.design(r.choice([16, 20]), r.choice([0, 1, 2]))
        half = 1 << (p.shift - 1)
        rows = []
        for _ in range(600):
            a, s = number(modulator.AMPLITUDE), number(modulator.SINE)
            # ties of both signs and parities; the three sums just above full scale come from the corners
            if r.random() < 0.4:
                a, s = half // 16 * r.choice([1, 3, 5, 7, -1, -3, -5, -7]), 16
            if r.random() < 0.08:
                a, s = r.choice([-1, 1]) * (1 << 23) + r.choice([0, -1]), -(1 << 17)
                a = max(modulator.AMPLITUDE.lo, min(a, modulator.AMPLITUDE.hi))
            rows.append((int(r.random() < 0.8), int(r.random() < 0.8), a, s))
        return p, rows
    if block == "pi":
        hi = r.randint(40_000, 300_000)
        p = pi.Params(r.randint(1, 1 << 24) << 8, r.randint(1, 1 << 23) << 9 | 1 << 8, -hi + r.randint(0, 99), hi)
        p = p._replace(kp=r.choice([1, 3]) << 23, ki=r.choice([1, 3, 5]) << 22)
        rows = []
        for _ in range(800):
            big = r.random() < 0.1
            e = r.choice([-1, 1]) * r.randint(1 << 15, 1 << 19) if big else r.randint(-9, 9)
            mode = r.choice([0, 1, 2, 2, 2, 2, 2, 3])
            rows.append((int(r.random() < 0.8), mode, e, r.choice([-1, 1]) * r.randint(0, 1 << r.choice([3, 12, 20]))))
        return p, rows
    if block == "sine":
        return None, [(r.choice(sine_ties(d)) if r.random() < 0.2 else word(d.dds_bits),) for _ in range(1500)]
    if block == "dds":
        return None, [tuple(word(d.dds_bits) for _ in range(5)) for _ in range(300)]
    if block == "references":
        p = references.design(r.randint(0, 3), True)
        return p, [(word(48), word(48), int(r.random() < 0.4)) for _ in range(300)]
    if block == "delay":
        return delay.design(r.randint(1, 8)), [(number(delay.X),) for _ in range(300)]
    if block == "spi_dac":
        p = r.choice([spi_dac.DAC8811, spi_dac.AD5791, spi_dac.DAC82002])
        rows = []
        while len(rows) < 500:
            rows += [(1, r.getrandbits(p.bits))] + [(0, r.getrandbits(24))] * r.randint(28, 34)
        return p, rows
    rows = []
    while len(rows) < 1600:
        rows += [(0, r.getrandbits(1)) for _ in range(8)] + [(1, r.getrandbits(1)) for _ in range(510)]
    return None, rows


def simulate(block, p, rows, fault, d=DEFAULT):
    """Rows of the registers of a design with the fault."""
    f, module = Fault(fault, d), MODULES[block]
    step, like = STEPS[block], module.State()
    names = [name.replace(".", "_") for name in flatten.names(like)]
    values = [value for _, value in flatten.leaves(like)]
    if f.kind == "reset":
        values[names.index(f.where)] = f.how
    fmts = [fmt for _, fmt in flatten.format_leaves(formats(module.State, d))]
    place = names.index(f.where) if f.kind == "late" else None
    state, out = flatten.rebuild(like, values), []
    # an extra register: everybody else sees the register late, it itself does not
    queue = [values[place]] * f.how if f.kind == "late" else None
    inner = values[place] if f.kind == "late" else None
    for given in rows:
        seen = [value for _, value in flatten.leaves(state)]
        out.append(seen)
        new = [value for _, value in flatten.leaves(step(f, p, state, *given))]
        if queue is not None:
            own = list(seen)
            own[place] = inner
            queue.append(inner)
            inner = [v for _, v in flatten.leaves(step(f, p, flatten.rebuild(like, own), *given))][place]
            new[place] = queue[-f.how]
        new = [wrapped(v, fmt.width) if fmt.s else v & fmt.hi for v, fmt in zip(new, fmts)]
        state = flatten.rebuild(like, new)
    return names, np.array(out, np.int64)


def case(block, seed, fault, golden=None, d=DEFAULT):
    """Arguments of `diagnose` for a planted fault."""
    p, rows = stimulus(block, seed, d)
    names, want = golden or simulate(block, p, rows, NONE, d)
    kind, where, how = fault
    if kind == "early":
        got = want.copy()
        places = range(len(names)) if where == "all" else [names.index(where)]
        for k in places:
            got[:-how, k] = want[how:, k]
    elif kind == "late" and where == "all":
        got = np.vstack([want[:1].repeat(how, axis=0), want[:-how]])
    else:
        got = simulate(block, p, rows, fault, d)[1]
    module = MODULES[block]
    step = getattr(module.step, "py_func", module.step)
    inputs = [name for name in inspect.signature(step).parameters if name not in ("d", "rom", "p", "s")]
    columns = dict(zip(inputs, np.array(rows, np.int64).T))
    ports = {
        name: Port(fmt, value)
        for name, (_, fmt), (_, value) in zip(
            names, flatten.format_leaves(formats(module.State, d)), flatten.leaves(module.State())
        )
    }
    return {
        "block": block,
        "params": {} if p is None else p._asdict(),
        "inputs": columns,
        "ports": ports,
        "expected": dict(zip(names, want.T.copy())),
        "got": dict(zip(names, got.T.copy())),
        "design": d,
    }


def faults(block, seed):
    """Faults of every kind that the block can have."""
    r = random.Random(f"faults {block} {seed}")
    names = [name.replace(".", "_") for name in flatten.names(MODULES[block].State())]
    p, _ = stimulus(block, seed)
    out = []
    rules = ["floor", "ceil", "toward_zero", "half_down", "half_even", "half_away", "half_zero"]
    if block == "modulator":
        bits = 16 if p.shift == 25 else 20
        out += [("rounding", "code", rule) for rule in rules]
        out += [("wrap", "code", bits), ("sign", "product", ""), ("sign", "code", "")]
        out += [("gain", "product", 1), ("gain", "product", -1), ("gain", "code", 1), ("gain", "code", -1)]
        out += [("limit", "code", how) for how in ((0, -1), (1, 0), (1, -1))]
        late = ["product", "code", "held2"]
    elif block == "pi":
        out += [("rounding", "y", rule) for rule in rules]
        out += [
            ("wrap", "y", max(p.hi.bit_length(), (-p.lo - 1).bit_length()) + 1),
            ("wrap", "acc", 60),
            ("wrap", "y", 36),
        ]
        out += [("sign", "prop", ""), ("sign", "acc", ""), ("sign", "y", "")]
        out += [("gain", "prop", 1), ("gain", "acc", 1), ("gain", "acc", -1), ("gain", "y", 1)]
        out += [("limit", w, how) for w in ("y", "acc") for how in ((0, -1), (0, 1), (1, 0), (-1, 0))]
        late = ["prop", "y"]
    elif block == "sine":
        # a magnitude has no sign, so only these differ from each other
        out += [("rounding", "y", rule) for rule in ("floor", "ceil", "half_down", "half_even")]
        out += [("sign", "y", ""), ("sign", "sign", ""), ("sign", "product", "")]
        out += [("gain", "product", 1), ("gain", "product", -1), ("gain", "slope", 1), ("gain", "y", -1)]
        late = ["base", "sign", "product", "y"]
    elif block == "dds":
        out += [
            (kind, w, how) for w in names for kind, how in (("saturate", ""), ("sign", ""), ("gain", 1), ("gain", -1))
        ]
        late = names[1:]
    elif block == "references":
        out += [("sign", w, r.randint(1, 15)) for w in ("signs", "aligned", "retimed")] + [("sign", "signs", 15)]
        late = ["signs", "retimed"]
    elif block == "delay":
        out += [("sign", "taps", ""), ("gain", "taps", 1), ("gain", "taps", -1)]
        late = ["taps_7", "taps_3"]
    elif block == "spi_dac":
        out += [("bit_order", "shift", "load"), ("bit_order", "shift", "right")]
        pin = "ldac_n" if p.ldac else "sync_n"
        late = [pin]
    else:
        out += [("bit_order", "shift", "")]
        late = ["valid", "status"]
    out += [("late", w, k) for w in late for k in (1, 2)]
    out += [("late", "all", k) for k in (1, 2, 3)] + [("early", "all", k) for k in (1, 2)]
    leaf = {
        "modulator": "held2",
        "pi": "y",
        "sine": "y",
        "references": "retimed",
        "delay": "taps_7",
        "dds": "sense_ref",
        "spi_dac": late[0],
        "spi_adc": "valid",
    }[block]
    out += [("early", leaf, 1), ("early", leaf, 2)]
    for w in r.sample(names, min(3, len(names))):
        fmt = dict(zip(names, (f for _, f in flatten.format_leaves(MODULES[block].STATE_FMT))))[w]
        value = dict(zip(names, (v for _, v in flatten.leaves(MODULES[block].State()))))[w]
        out.append(("reset", w, 1 - value if fmt.width == 1 else r.randint(1, min(fmt.hi, 15))))
    return out


def strangers(block, seed, golden):
    """Rows of designs whose fault is of no kind that has a name: stuck bits, glitches, swapped or foreign rows."""
    r = random.Random(f"strangers {block} {seed}")
    want = golden[1]
    moving = [k for k in range(want.shape[1]) if len(np.unique(want[:, k])) > 8]
    wide = r.choice(moving or list(range(want.shape[1])))
    glitch, stuck, scaled, mixed = (want.copy() for _ in range(4))
    row = r.randrange(want.shape[0] // 2, want.shape[0] - 9)
    glitch[row, wide] ^= 1
    yield "glitch", glitch
    stuck[:, wide] |= 2
    yield "stuck", stuck
    scaled[1:, wide] = scaled[1:, wide] * 3 // 4
    yield "gain 3/4", scaled
    mixed[row:, wide] = np.roll(mixed[row:, wide], 3)
    yield "late from the middle on", mixed


def model_rows(block, seed, d=DEFAULT):
    """Rows of the golden step itself."""
    module = MODULES[block]
    step = getattr(module.step, "py_func", module.step)
    p, rows = stimulus(block, seed, d)
    state, out = module.State(), []
    for given in rows:
        out.append([value for _, value in flatten.leaves(state)])
        state = step(*structure(module, d).values(), *(() if p is None else (p,)), state, *given)
    return np.array(out, np.int64)
