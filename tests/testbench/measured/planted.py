"""A firmware with one thing changed in its steps, on recorded codes: python planted.py IN.npz OUT.npz, interpreted.

NUMBA_DISABLE_JIT=1 makes every block's `step` plain Python, so that a changed copy can be put in its place.
"""

import contextlib
import sys

import numpy as np

from fpga_model import cordic, frequency_tracker, isqrt, modulator, pi, rate_loop, rate_output
from testbench.config import Config
from testbench.measured.record import firmware_residual, replay
from testbench.run import build


def cut(x, n):
    """Rounding down in place of ties toward +inf."""
    return x >> n


def changed(function, **fields):
    """A step whose result has some fields changed: name = function of the old value."""

    def step(*arguments):
        s = function(*arguments)
        return s._replace(**{name: change(getattr(s, name)) for name, change in fields.items()})

    return step


def late_force(function):
    """The rate loop works on the code of the frame before."""
    kept = [0]

    def step(d, p, s, en, en_pi, mode, sense_sin, preset):
        after = function(d, p, s, en, en_pi, mode, sense_sin, preset)
        if en:
            after = after._replace(error=kept[0])
            kept[0] = sense_sin
        return after

    return step


def rounded_root(function):
    """V_q rounded to nearest in place of cut."""

    def step(s, start, u):
        after = function(s, start, u)
        return after._replace(y=after.y + 1) if after.done and after.remainder > after.root else after

    return step


# name: (module, function, what it becomes, registers of which one must be named first)
PLANTS = {
    "PI rounds down": (pi, "half_up", lambda f: cut, "agc.loop frequency_tracker rate_loop quadrature_loop"),
    "modulators round down": (modulator, "half_up", lambda f: cut, "drive_modulator sense_modulator"),
    "rate output rounds down": (rate_output, "half_up", lambda f: cut, "rate_output"),
    "CORDIC rounds down": (cordic, "half_up", lambda f: cut, "cordic"),
    "magnitude a bit narrower": (
        cordic,
        "step",
        lambda f: changed(f, magnitude=lambda v: v & ~1),
        "cordic.magnitude",
    ),
    "phase an LSB off": (cordic, "step", lambda f: changed(f, phase=lambda v: v + 1), "cordic.phase"),
    "frequency word a bit narrower": (
        frequency_tracker,
        "step",
        lambda f: changed(f, word=lambda v: v & ~1),
        "frequency_tracker.word",
    ),
    "phase error cut to 16 bits": (
        frequency_tracker,
        "step",
        lambda f: changed(f, error=lambda v: v >> 8 << 8),
        "frequency_tracker",
    ),
    "rate output 31 bits wide": (rate_output, "step", lambda f: changed(f, y=lambda v: v & ~1), "rate_output"),
    "temperature a bit narrower": (rate_output, "step", lambda f: changed(f, word=lambda v: v & ~3), "rate_output"),
    "force a frame late": (rate_loop, "step", late_force, "rate_loop"),
    "V_q rounded to nearest": (isqrt, "step", rounded_root, "quadrature"),
}


@contextlib.contextmanager
def planted(name):
    module, function, change, _ = PLANTS[name]
    old = getattr(module, function)
    setattr(module, function, change(old))
    try:
        yield
    finally:
        setattr(module, function, old)


def main(source, target):
    data = np.load(source)
    x = replay.Stimulus(data["codes"], data["ok"], data["valid"], np.zeros((0, 3), np.int64))
    p = build.firmware(Config())
    out = {}
    for name in ("none", *PLANTS):
        o = replay.rows(len(x.valid))
        # a window at once has the closed forms of these two, not their steps
        at_once = name not in PLANTS or PLANTS[name][0] not in (cordic, isqrt)
        with planted(name) if name in PLANTS else contextlib.nullcontext():
            replay.run(p, firmware_residual.initial_side(data["initial"].tolist()), x, o, replay.order(p), at_once)
        out[name] = o.words
    np.savez(target, **out)


if __name__ == "__main__":
    main(*sys.argv[1:])
