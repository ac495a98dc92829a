"""Compiled and interpreted arithmetic blocks give the same registers: one process of each kind, same stimuli.

The parent runs in the mode of the suite, the child in the other one. Interpreted kernels get Python integers, so that
an overflow of int64 shows as a difference instead of wrapping in both.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np

from fpga_model import fixed, pi
from tests.fpga_model import test_cordic, test_isqrt, test_pi

ROOT = Path(__file__).resolve().parents[2]


def traces():
    """Register traces and rounding results as plain lists, from stimuli that are the same in every process."""
    rng = np.random.default_rng(20)
    n = 400
    start = (rng.random(n) < 0.04).astype(np.int64)
    x, y = rng.integers(-(1 << 23), 1 << 23, (2, n)) >> rng.integers(0, 24, (2, n))
    u = rng.integers(0, 1 << 32, n) >> rng.integers(0, 33, n)
    p = pi.Params(kp=-pi.COEF.hi, ki=pi.COEF.lo, lo=-(1 << 34), hi=pi.OUT.hi)
    en, mode = rng.integers(0, 2, n), rng.integers(0, 5, n)
    e = rng.choice([pi.ERR.lo, pi.ERR.hi, -1, 0, 1, 12345], n)
    preset = rng.integers(pi.OUT.lo, pi.OUT.hi, n)
    big = [int(v) for v in rng.integers(-(1 << 62), 1 << 62, 20)] + [1 << 62, -(1 << 62), 0, -1]
    return {
        "cordic": test_cordic.trace(test_cordic.DEFAULT, test_cordic.RESET, start, x, y).tolist(),
        "isqrt": test_isqrt.trace(test_isqrt.RESET, start, u).tolist(),
        "pi": test_pi.trace(test_pi.DEFAULT, p, pi.State(), en, mode, e, preset).tolist(),
        "rounding": {
            rule: [[int(func(v, k)) for v in big] for k in range(63)] for rule, func in fixed.ROUNDINGS.items()
        },
        "wrap": [[int(fixed.wrap(v, k)) for v in big[:20]] for k in range(1, 63)],
        "wrap_unsigned": [[int(fixed.wrap_unsigned(v, k)) for v in big] for k in range(63)],
    }


def test_jit_equals_python():
    env = {**os.environ, "NUMBA_DISABLE_JIT": "0" if numba.config.DISABLE_JIT else "1"}
    run = subprocess.run([sys.executable, "-m", __spec__.name], cwd=ROOT, env=env, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    other = json.loads(run.stdout)
    assert other.pop("jit") == bool(numba.config.DISABLE_JIT), "the child must run in the other mode"
    mine = traces()
    assert mine.keys() == other.keys()
    for name in mine:
        assert mine[name] == other[name], name


if __name__ == "__main__":
    print(json.dumps({"jit": not numba.config.DISABLE_JIT, **traces()}))
