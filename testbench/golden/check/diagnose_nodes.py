"""Registers as sum, rounding and overflow, block by block: what the hypotheses on arithmetic vary.

    value = limit(offset + flip(round(sum of terms, shift)))   where enabled; elsewhere it is not varied

`NODES[block](c, p, fmt, d)` gives {register: Node}, or a list of nodes for a register that is loaded in several ways: c
holds the columns of inputs and registers (an input that shares its name with a register is `in_NAME`), p the
parameters, fmt the formats, d the design. `SPECIAL`, `COMPARED` and `TUNED` hold what is no sum: bit orders,
comparisons in pins, and parameters.
Source  docs/blocks/ (the equations)
"""

from typing import NamedTuple

import numpy as np

from fpga_model import agc, cordic, digital_sid, fault_monitor, fixed, isqrt, pi, rate_output, sequencer, spi_adc

# Arithmetic on whole columns ------------------------------------------------------------------------------------------


# The rules of `fixed` branch on the sign of one number; a column needs the sign as a column
def rounded(rule, x, n):
    """Column `x` with `n` LSBs dropped by `rule`; n may be a column."""
    low = (np.int64(1) << n) - 1
    half = (np.int64(1) << n) >> 1
    negative = (x < 0).astype(np.int64)
    added = {
        "floor": 0,
        "ceil": low,
        "toward_zero": low * negative,
        "half_up": half,
        "half_down": low >> 1,
        "half_even": (low >> 1) + np.where(np.asarray(n) > 0, (x >> n) & 1, 0),
        "half_away": np.where(negative, low >> 1, half),
        "half_zero": np.where(negative, half, low >> 1),
    }[rule]
    return (x + added) >> n


def wrapped(x, fmt):
    """Column `x` modulo the width of `fmt`."""
    mask = np.int64((1 << fmt.width) - 1)
    low = x & mask
    return np.where(low > fmt.hi, low - (mask + 1), low) if fmt.s else low


def reversed_bits(x, width):
    """The low `width` bits in the opposite order, unsigned."""
    out = np.zeros_like(x)
    for k in range(width):
        out |= ((x >> k) & 1) << (width - 1 - k)
    return out


def _bits_for(lo, hi):
    """Least width that holds lo .. hi: signed unless lo is 0 or more."""
    if lo >= 0:
        return int(hi).bit_length()
    return max(int(hi).bit_length(), int(-lo - 1).bit_length()) + 1


class Node(NamedTuple):
    """One register.

    terms     {name: column}, whose sum is the exact value
    shift     LSBs dropped by `rounding`; a column where it changes from row to row
    offset    what is added after the rounding
    lo, hi    saturation, or None where the sum wraps in `fmt` (or cannot leave it)
    steps     sizes of "one LSB" of a limit
    flip      1 where the rounded sum is negated, or None
    enable    where the register takes the value; elsewhere it is golden
    wraps     whether overflow happens and is meant to wrap
    """

    fmt: fixed.Fmt
    terms: dict
    shift: int = 0
    rounding: str = "floor"
    lo: int | None = None
    hi: int | None = None
    steps: tuple = (1,)
    flip: np.ndarray | None = None
    enable: np.ndarray | None = None
    wraps: bool = False
    offset: np.ndarray | int = 0

    def limited(self, x, lo, hi):
        return wrapped(x, self.fmt) if lo is None else np.clip(x, lo, hi)

    def signed(self, x, flip=None):
        flip = self.flip if flip is None else flip
        return x if flip is None else np.where(flip == 1, -x, x)

    def of(self, x, flip=None):
        """The register for a rounded sum."""
        return self.limited(self.offset + self.signed(x, flip), self.lo, self.hi)


def variants(node):
    """Yield (cause, what, column) for every other arithmetic that the node may have been built with."""
    exact = sum(node.terms.values())
    cut = np.any(np.asarray(node.shift) > 0)
    value = rounded(node.rounding, exact, node.shift)
    whole = node.offset + node.signed(value)
    if cut:
        for rule in fixed.ROUNDINGS:
            if rule != node.rounding:
                yield "rounding", rule, node.of(rounded(rule, exact, node.shift))
            if node.flip is not None:
                other = rounded(rule, node.signed(exact), node.shift)
                yield "rounding", f"{rule} of the signed value", node.limited(node.offset + other, node.lo, node.hi)
    if node.lo is not None:
        like = fixed.signed if node.lo < 0 or node.fmt.s else fixed.bits
        for width in sorted({node.fmt.width, _bits_for(node.lo, node.hi) + (node.lo >= 0 and node.fmt.s)}):
            yield "wrap", f"at {width} bits", wrapped(whole, like(width))
        for step in node.steps:
            for low, high in ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, 1), (1, -1), (1, 1), (-1, -1)):
                lo, hi = node.lo + low * step, node.hi + high * step
                what = ", ".join(f"{name} {sign * step:+d} LSB" for name, sign in (("lo", low), ("hi", high)) if sign)
                # a limit beyond the format is no limit
                if node.fmt.holds(lo) and node.fmt.holds(hi):
                    yield "limit", what, node.limited(whole, lo, hi)
            for low, high in ((-step, 0), (step, 0), (0, -step), (0, step)):
                if node.fmt.holds(node.lo + low) and node.fmt.holds(node.hi + high):
                    stuck = np.where(whole < node.lo, node.lo + low, np.where(whole > node.hi, node.hi + high, whole))
                    yield "limit", f"saturates to {'lo' if low else 'hi'} {low or high:+d} LSB", stuck
    elif node.wraps:
        yield "saturate", f"at {node.fmt.lo} and {node.fmt.hi}", np.clip(whole, node.fmt.lo, node.fmt.hi)
    yield "sign", "result", -node.of(value)
    yield "sign", "result", node.limited(-whole, node.lo, node.hi)
    if np.ndim(node.offset):
        yield "sign", "of what is added", node.of(-value)
        yield "gain", "what is added x 2", node.of(value << 1)
        yield "gain", "what is added / 2", node.of(value >> 1)
    if node.flip is not None:
        for flip, what in ((1 - node.flip, "result"), (0 * node.flip, "never negative"), (0 * node.flip + 1, "always")):
            yield "sign", what, node.of(value, flip)
    for name, term in node.terms.items():
        rest = exact - term
        for cause, what, other in (
            ("sign", f"of {name}", -term),
            ("gain", f"{name} x 2", term << 1),
            ("gain", f"{name} / 2", term >> 1),
        ):
            yield cause, what, node.of(rounded(node.rounding, rest + other, node.shift))
    if cut:
        for shift, what in ((np.maximum(node.shift - 1, 0), "result x 2"), (node.shift + 1, "result / 2")):
            yield "gain", what, node.of(rounded(node.rounding, exact, shift))
        yield "gain", "result x 2", node.of(value << 1)
        yield "gain", "result / 2", node.of(value >> 1)
    else:
        yield "gain", "result x 2", node.limited(whole << 1, node.lo, node.hi)
        yield "gain", "result / 2", node.limited(whole, node.lo, node.hi) >> 1


# The arithmetic registers of the blocks -------------------------------------------------------------------------------


def _modulator(c, p, fmt, d):
    return {
        "product": Node(fmt["product"], {"amplitude * sine": c["amplitude"] * c["sine"]}, enable=c["en_product"] == 1),
        "code": Node(
            fmt["code"], {"product": c["product"]}, p["shift"], "half_up", p["lo"], p["hi"], enable=c["en_code"] == 1
        ),
    }


def _pi_of(c, p, fmt, en, mode, e, preset, at=""):
    """The PI under a prefix, with its inputs as columns."""
    enabled, run, off = en != 0, mode == pi.RUN, mode == pi.OFF
    low, high = p[f"{at}lo"], p[f"{at}hi"]
    acc = fmt[f"{at}acc"]
    shift, cut = acc.f, pi.PRODUCT_FRACTION - acc.f
    bounds = {"lo": low << shift, "hi": high << shift, "steps": (1, 1 << shift)}
    prop = {"kp * e": np.where(off, 0, p[f"{at}kp"] * e)}
    added = {"acc": c[f"{at}acc"] << cut, "ki * e": p[f"{at}ki"] * e}
    return {
        f"{at}prop": Node(fmt[f"{at}prop"], prop, cut, "half_up", enable=enabled & (mode <= pi.RUN)),
        f"{at}acc": [
            Node(acc, added, cut, "half_up", **bounds, enable=enabled & run),
            Node(acc, {"preset": preset << shift}, **bounds, enable=enabled & off),
        ],
        f"{at}y": Node(fmt[f"{at}y"], {"prop": c[f"{at}prop"], "acc": c[f"{at}acc"]}, shift, "half_up", low, high),
    }


def _pi(c, p, fmt, d):
    return _pi_of(c, p, fmt, c["en"], c["mode"], c["e"], c["preset"])


def _agc(c, p, fmt, d):
    kicked = c["mode"] == agc.KICK
    mode, preset = np.where(kicked, pi.OFF, c["mode"]), np.where(kicked, 0, c["preset"])
    error = {"setpoint": c["setpoint"], "magnitude": -c["magnitude"]}
    return {
        "error": Node(fmt["error"], error, enable=c["en"] == 1),
        **_pi_of(c, p, fmt, c["en_pi"], mode, c["error"], preset, "loop_"),
    }


def _frequency_tracker(c, p, fmt, d):
    load = c["load"] == 1
    adjust, en = (c["adjust"] == 1) & ~load, c["en"] == 1
    adjusted = {"centre": c["centre"], "correction": c["correction"]}
    return {
        "error": Node(fmt["error"], {"phase": c["phase"]}, enable=en),
        "centre": [
            Node(fmt["centre"], adjusted, enable=en & adjust, wraps=True),
            Node(fmt["centre"], {"preset": c["preset"]}, enable=en & load),
        ],
        "word": Node(fmt["word"], {"centre": c["centre"], "loop_y": c["loop_y"]}, wraps=True),
        **_pi_of(c, p, fmt, c["en_pi"], c["mode"], c["error"], 0 * c["mode"], "loop_"),
    }


def _rate_loop(c, p, fmt, d):
    return {
        "error": Node(fmt["error"], {"sense_sin": c["sense_sin"]}, enable=c["en"] == 1),
        **_pi_of(c, p, fmt, c["en_pi"], c["mode"], c["error"], c["preset"], "loop_"),
    }


def _quadrature_loop(c, p, fmt, d):
    return {
        "error": Node(fmt["error"], {"sense_cos": -c["sense_cos"]}, enable=c["en"] == 1),
        **_pi_of(c, p, fmt, c["en_pi"], c["mode"], c["error"], c["preset"], "loop_"),
        "root_radicand": _radicand(c, fmt, c["loop_y"], "root_", "en_root"),
    }


def _sine(c, p, fmt, d):
    fraction = fmt["product"].f
    base, product = c["base2"] << (fraction - fmt["base2"].f), c["product"]
    return {
        "product": Node(fmt["product"], {"slope * fraction": c["slope"] * (2 * c["fraction"] + 1)}),
        "y": Node(fmt["y"], {"base": base, "product": product}, fraction, "half_up", flip=c["sign2"]),
    }


def _dds(c, p, fmt, d):
    nodes = {"phase": Node(fmt["phase"], {"phase": c["phase"], "word": c["word"]}, wraps=True)}
    for name in ("drive_sine", "sense_sine", "drive_ref", "sense_ref"):
        nodes[name] = Node(fmt[name], {"phase": c["phase"], "offset": c[f"off_{name}"]}, wraps=True)
    return nodes


def _cordic(c, p, fmt, d):
    start, busy = c["start"] == 1, (c["start"] == 0) & (c["busy"] == 1)
    rotate = busy & (c["i"] < d.cordic_iterations)
    finish = busy & (c["i"] == cordic.ITERATIONS)
    guard = fmt["x"].f
    shift, below, left = np.where(rotate, c["i"], 0), (c["y"] < 0).astype(np.int64), c["x_in"] < 0
    atan = np.array([*cordic.table(d), *[0] * (32 - cordic.ITERATIONS)], np.int64)[c["i"]]
    minus = left.astype(np.int64)
    turned = {"shift": shift, "rounding": "half_up", "enable": rotate}
    half_turn = {"half a turn": np.where(left, fmt["angle"].lo, 0)}
    angle = {"angle": np.where(c["x"] == 0, 0, c["angle"])}
    return {
        "x": [
            Node(fmt["x"], {"y shifted": c["y"]}, offset=c["x"], flip=below, **turned),
            Node(fmt["x"], {"x_in": c["x_in"] << guard}, flip=minus, enable=start),
        ],
        "y": [
            Node(fmt["y"], {"x shifted": c["x"]}, offset=c["y"], flip=1 - below, **turned),
            Node(fmt["y"], {"y_in": c["y_in"] << guard}, flip=minus, enable=start),
        ],
        "angle": [
            Node(fmt["angle"], {"atan": atan}, offset=c["angle"], flip=below, enable=rotate, wraps=True),
            Node(fmt["angle"], half_turn, enable=start),
        ],
        "magnitude": Node(fmt["magnitude"], {"x": c["x"]}, guard, "half_up", enable=finish),
        "phase": Node(fmt["phase"], angle, guard, "half_up", enable=finish, wraps=True),
    }


def _radicand(c, fmt, u, at="", start="start"):
    load, rest, of = c[start] == 1, c[f"{at}radicand"], fmt[f"{at}radicand"]
    busy = ~load & (c[f"{at}busy"] == 1)
    return [Node(of, {"u": u}, enable=load), Node(of, {"radicand": rest << 2}, enable=busy, wraps=True)]


def _isqrt(c, p, fmt, d):
    return {"radicand": _radicand(c, fmt, c["u"])}


def _digital_sid(c, p, fmt, d):
    ce, dump = c["ce_1m"] == 1, c["dump"] == 1
    delay = p["ref_delay"]
    now = c["refs"] if delay == 0 else c[f"refs_{delay - 1}"]
    stages = (("pole1", ce & dump), ("pole2", c["stage"] == 1), ("pole3", c["stage"] == 2))
    nodes = {}
    for k in range(4):
        sample = c["sample_x" if k < 2 else "sample_y"]
        acc, x = c[f"acc_{k}"], np.where((now >> k) & 1 == 1, sample, -sample)
        bounds = {"lo": digital_sid.ACC_LO, "hi": digital_sid.ACC_HI}
        nodes[f"acc_{k}"] = [
            Node(fmt[f"acc_{k}"], {"acc": acc, "sample": x}, **bounds, enable=ce & ~dump),
            Node(fmt[f"acc_{k}"], {"sample": x}, enable=ce & dump),
        ]
        before = acc << digital_sid.POLE.f
        for name, enable in stages:
            held = c[f"{name}_{k}"]
            step = {"alpha * difference": p["alpha"] * (before - held)}
            nodes[f"{name}_{k}"] = Node(
                fmt[f"{name}_{k}"], step, digital_sid.ALPHA.f, "half_up", offset=held, enable=enable
            )
            before = held
        scaled = {"gain * pole3": p["gain_x" if k < 2 else "gain_y"] * c[f"pole3_{k}"]}
        nodes[f"codes_{k}"] = Node(
            fmt[f"codes_{k}"], scaled, digital_sid.SHIFT, "half_up", digital_sid.CODE_LO, digital_sid.CODE_HI,
            enable=c["stage"] == 3,
        )  # fmt: skip
    return nodes


def _rate_output(c, p, fmt, d):
    m, stage = rate_output, c["stage"]
    on = [stage >> k & 1 == 1 for k in range(5)]
    t, t2, first = c["t"], c["t2"], c["count"] == 0
    k = np.where(first, np.minimum(c["decimation"], m.MAX_K), c["k"])
    acc = {"acc": np.where(first, 0, c["acc"]), "scaled": c["scaled"]}
    bias = {
        "b0": c["in_bias"] << (m.BIAS.f - m.BIAS_0.f),
        "b1 * t": c["bias_t1"] * t,
        "b2 * t2": c["bias_t2"] * t2,
    }
    scale = {
        "s0": c["in_scale"] << (m.SCALE_SUM.f - m.SCALE.f),
        "s1 * t": c["scale_t1"] * t,
        "s2 * t2": c["scale_t2"] * t2,
    }
    error = {"word": c["word"] << m.BIAS.f, "bias": -c["bias"]}
    product = {"corrected * scale": c["corrected"] * c["scale"]}
    return {
        "word": Node(fmt["word"], {"word": c["in_word"]}, enable=c["en"] == 1),
        "t": Node(fmt["t"], {"temperature": c["temperature"]}, m.CODE_CUT, "floor", enable=c["en"] == 1),
        "t2": Node(fmt["t2"], {"t * t": t * t}, m.T2_CUT, "half_up", enable=on[0]),
        "bias": Node(fmt["bias"], bias, enable=on[1]),
        "scale": Node(fmt["scale"], scale, m.SCALE_SUM.f - m.SCALE.f, "half_up", m.SCALE_LO, m.SCALE_HI, enable=on[1]),
        "corrected": Node(
            fmt["corrected"], error, m.BIAS.f - m.CORRECTED.f, "half_up", m.CORRECTED_LO, m.CORRECTED_HI, enable=on[2]
        ),
        "scaled": Node(fmt["scaled"], product, m.SCALED_CUT, "half_up", m.OUT_LO, m.OUT_HI, enable=on[3]),
        "acc": Node(fmt["acc"], acc, enable=on[4]),
        "y": Node(fmt["y"], acc, k, "half_up", enable=on[4] & (c["count"] + 1 == 1 << k)),
    }


def _sequencer(c, p, fmt, d):
    searching = (c["en"] == 1) & (c["state"] == sequencer.SEARCH)
    stuck = c["faults_flags"] & fault_monitor.STUCK != 0
    usable = (c["i_adc_ok"] == 1) & (c["i_stale"] == 0) & ~stuck
    turned = wrapped(c["i_phase"] - c["last_phase"], cordic.PHASE)
    rotation = np.where(usable, c["rotation"] + turned, 0)
    return {
        "rotation": Node(
            fmt["rotation"],
            {
                "rotation": np.where(searching & usable, c["rotation"], 0),
                "turned": np.where(searching & usable, turned, 0),
            },
            enable=c["en"] == 1,
        ),
        "correction": Node(
            fmt["correction"],
            {"rotation * gain": rotation * p["gain"]},
            sequencer.GAIN.f,
            "half_up",
            enable=searching,
        ),
    }


def _watchdog(c, p, fmt, d):
    counts = (c["frame"] == 1) | (c["ce_1m"] == 1)
    age = {"age": np.where(c["frame"] == 1, 0, c["age"]), "one": 1 - c["frame"]}
    return {"age": Node(fmt["age"], age, lo=0, hi=fmt["age"].hi, enable=counts)}


def parts(found):
    """The nodes of a register as a list."""
    return found if isinstance(found, list) else [found]


NODES = {
    "modulator": _modulator,
    "pi": _pi,
    "sine": _sine,
    "dds": _dds,
    "agc": _agc,
    "frequency_tracker": _frequency_tracker,
    "rate_loop": _rate_loop,
    "quadrature_loop": _quadrature_loop,
    "cordic": _cordic,
    "isqrt": _isqrt,
    "digital_sid": _digital_sid,
    "rate_output": _rate_output,
    "sequencer": _sequencer,
    "watchdog": _watchdog,
}


# What is no sum: (register, cause, what, column after the edge) -------------------------------------------------------


def _spi_dac_order(c, p, fmt, d):
    """The shift register of a master that sends the LSB first, in its two usual forms."""
    load, run, mask = c["load"] == 1, c["sclk_en"] == 1, (1 << p["bits"]) - 1
    right = np.where(run, c["shift"] >> 1, c["shift"])
    left = np.where(run, (c["shift"] << 1) & mask, c["shift"])
    turned = reversed_bits(c["word"], p["bits"])
    yield "shift", "bit_order", "LSB first, shifts right", np.where(load, c["word"], right)
    yield "shift", "bit_order", "LSB first, word reversed at load", np.where(load, turned, left)


def _spi_adc_order(c, p, fmt, d):
    """The words of a master that takes the LSB first."""
    half = d.adc_divider // 2
    falls = (c["count"] + 1) % half == 0
    take = (c["busy"] == 1) & (c["word"] <= d.adc_channels) & (c["sclk"] == 1) & falls
    word = (c["shift"] >> 1) | (c["dout"] << (spi_adc.WORD_BITS - 1))
    last = take & (c["count"] == half * d.adc_word_bits - 1)
    yield "shift", "bit_order", "LSB first", np.where(take, word, c["shift"])
    yield "status", "bit_order", "LSB first", np.where(last & (c["word"] == 0), word, c["status"])
    for k in range(spi_adc.CHANNELS):
        name = f"channels_{k}"
        taken = last & (c["word"] == k + 1)
        yield name, "bit_order", "LSB first", np.where(taken, wrapped(word, fmt[name]), c[name])


def _isqrt_root(c, p, fmt, d, at="", start="start"):
    """The last step of a root that is rounded otherwise, and a comparison that is off by one."""
    busy = (c[start] == 0) & (c[f"{at}busy"] == 1)
    last = busy & (c[f"{at}i"] == isqrt.ITERATIONS - 1)
    pair = (c[f"{at}remainder"] << 2) + (c[f"{at}radicand"] >> isqrt.TOP)
    trial = (c[f"{at}root"] << 2) + 1

    def stepped(fits):
        return (c[f"{at}root"] << 1) + fits, np.where(fits == 1, pair - trial, pair)

    root, rest = stepped((pair >= trial).astype(np.int64))
    for rule, up in (("half_up", rest > root), ("ceil", rest > 0)):
        yield f"{at}y", "rounding", rule, np.where(last, root + up, c[f"{at}y"])
    root, rest = stepped((pair > trial).astype(np.int64))
    loaded = c[start] == 1
    for name, column in (("root", root), ("remainder", rest)):
        held = np.where(busy, column, c[f"{at}{name}"])
        yield f"{at}{name}", "limit", "fits only above the trial", np.where(loaded, 0, held)
    yield f"{at}y", "limit", "fits only above the trial", np.where(last, root, c[f"{at}y"])


def _quadrature_root(c, p, fmt, d):
    yield from _isqrt_root(c, p, fmt, d, "root_", "en_root")


SPECIAL = {
    "spi_dac": _spi_dac_order,
    "spi_adc": _spi_adc_order,
    "isqrt": _isqrt_root,
    "quadrature_loop": _quadrature_root,
}


# Comparisons in pins: (pin, what, column in the same row) -------------------------------------------------------------


def _compared(y, lo, hi, pin):
    """A pin that is 1 at the limits of y: each limit one LSB off."""
    for low, high in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        at_lo = 0 if lo is None else y <= lo + low
        if lo is not None or not low:
            what = f"{'lo' if low else 'hi'} {low or high:+d} LSB"
            yield pin, what, ((y >= hi + high) | at_lo).astype(np.int64)


COMPARED = {
    "agc": lambda c, p: _compared(c["loop_y"], None, p["loop_hi"], "saturated"),
    "rate_loop": lambda c, p: _compared(c["loop_y"], p["loop_lo"], p["loop_hi"], "saturated"),
    "quadrature_loop": lambda c, p: _compared(c["loop_y"], p["loop_lo"], p["loop_hi"], "railed"),
}


# Parameters that a design may have wrong: {name: causes that another value stands for} --------------------------------

LIMIT, COEFFICIENT = ("limit",), ("sign", "gain")
_LOCK = [f"{name}_{k}" for name in ("limit_in", "limit_out", "frames_in", "frames_out") for k in range(4)]
_FAULTS = ["over_range", "stuck", "drive", "rate", "rail"]
_TIMES = ["power_up", "init", "kick", "decay", "search", "retune", "timeout", "offline", "recover"]
TUNED = {
    "lock_monitor": dict.fromkeys(_LOCK, LIMIT),
    "fault_monitor": dict.fromkeys(_FAULTS, LIMIT),
    "watchdog": {"limit": LIMIT},
    "digital_sid": {**dict.fromkeys(("alpha", "gain_x", "gain_y"), COEFFICIENT), "still": LIMIT},
    "sequencer": dict.fromkeys([*_TIMES, "reached", "min_magnitude", "search_limit"], LIMIT)
    | dict.fromkeys([f"lock_{name}" for name in _LOCK] + [f"faults_{name}" for name in _FAULTS], LIMIT),
}


def tuned(block, params, formats):
    """Yield (cause, what, {parameter: value}) for the parameters that may be wrong; `formats` are theirs."""
    for name, causes in TUNED.get(block, {}).items():
        value, fmt = params[name], formats[name]
        others = [("limit", f"{name} {step:+d} LSB", value + step) for step in (-1, 1) if "limit" in causes]
        if "gain" in causes:
            others += [("gain", f"{name} x 2", value << 1), ("gain", f"{name} / 2", value >> 1)]
        if "sign" in causes and fmt.s:
            others.append(("sign", f"of {name}", -value))
        yield from ((cause, what, {name: other}) for cause, what, other in others if fmt.holds(other))


# Packed words of signs: a constant pattern of inverted bits is a wrong sign
PACKED_SIGNS = {"references"}
