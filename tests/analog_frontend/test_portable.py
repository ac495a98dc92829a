"""The run-time parts give the same bits compiled and interpreted, and the bits written down here."""

import hashlib
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
from numba import config

from analog_frontend import effects
from analog_frontend.effects import drive_cubic, duffing, feedthrough_y
from analog_frontend.parts import adc, noise, propagator, sid
from analog_frontend.parts.device import Device
from fpga_model.jit import kernel
from tests.analog_frontend import oscillator

ROOT = Path(__file__).resolve().parents[2]
TICKS = 3000
PINNED = "c8dba251202e45b349907c449e58719a5f380eca6d8cc9a7c79b0faa60c8baf5"


@kernel
def play(fx, osc, cv, demods, conv, z, caps, clock, sums, out, sensor, ticks, log):
    """A made-up closed chain: a rotating state, effects, noise, jittered edges, demodulators, converter."""
    value, slope, refs = 0.0, 0.0, 1
    rows = 0
    for k in range(ticks):
        before = z[2]
        if fx.any_force:
            z[7] += effects.force_impulse(fx, z[6], z[2])
        x = z[6]
        z[6] = 0.9976 * x + 0.0691 * z[7]
        z[7] = 0.9976 * z[7] - 0.0691 * x
        z[2] = 3e5 * z[7]
        v1, d1 = 5e5 * z[6], 3.5e10 * z[7]
        _, n = effects.cv_volts(fx, 0.0, noise.hold_sample(cv, k), before, z[2])
        mean = 0.5 * (value + v1)
        p1, p2, p3 = 6.29e-4 * mean, 1.98e-7 * mean, 4.15e-11 * mean
        tau = 0.5e-6 + oscillator.edge_error_s(osc, 26 * k + 13)
        for d in range(4):
            if (k + 11 * d) % 45 == 44:
                refs = refs ^ (1 << d)
                sid.edge(demods, caps, d, (refs >> d) & 1, tau, n, p1, p2, p3, value, slope, v1, d1)
            else:
                sid.step_edgeless_tick(demods, caps, d, (refs >> d) & 1, n, p1, p2, p3)
            out[d] = out[4 + d]
            out[4 + d] = sid.output(caps, d)
        ready = adc.convert_block(conv, clock, sums, out, 1, sensor)
        if ready >= 0:
            log[rows, 0] = 26 * k + ready
            for c in range(5):
                log[rows, 1 + c] = clock[adc.CODES + c]
            rows += 1
        value, slope = v1, d1
    return rows


def digest():
    """SHA-256 over every state and code of the chain, and over the constants that set-up computes."""
    fx = effects.collect(
        duffing=duffing.design(1e11, 2.325e-7, 1e-6, 69115.0),
        drive_cubic=drive_cubic.design(1e-3, 2.72e-7, 2.325e-7, 1e-6, 69115.0),
        feedthrough_y=feedthrough_y.design(1e-4),
    )
    osc = oscillator.design(seed=4, ppm=1.5, jitter_rms_s=1e-12)
    cv = noise.source(4, "cv_y", 91e-9 * 707.0)
    demods = sid.design(10e3 * 159e-9, osc.h_s, sid.injection_volts(1e-12, 0.1, 159e-9))
    conv = adc.design(
        seed=4, period=adc.modulator_period(37.0), noise_v=(12.4e-6,) * 5, flicker_v_per_rthz=(37e-9,) * 5
    )
    s = adc.reset(conv)
    z, caps, log = np.zeros(24), sid.reset(), np.zeros((TICKS // 100, 6), np.int64)
    z[6] = 5e-6
    rows = play(
        fx, osc, cv, demods, conv, z, caps, s.clock, s.sums, np.zeros(8), adc.temperature_volts(31.0), TICKS, log
    )
    assert rows == 24
    chains = [propagator.cv_chain(Device(), c, t) for t in (-20.0, 25.0, 70.0) for c in ("drive", "sense")]
    numbers = [x for chain in chains for x in chain]
    numbers += [
        *np.moveaxis(demods.taylor.reshape(4, sid.TERMS, 4), -1, 0)[:3].ravel(),
        *demods[:8],
        *noise.DECAY,
        *noise.GAIN,
        noise.DEVIATION,
        osc.tc_s,
        osc.carrier_hz,
    ]
    parts = [a.tobytes() for a in (z, caps, s.clock, s.sums, log)] + [struct.pack(f"<{len(numbers)}d", *numbers)]
    return hashlib.sha256(b"".join(parts)).hexdigest()


def other_mode():
    """The digest from a process with the compiler switched the other way."""
    environment = dict(os.environ, PYTHONPATH=str(ROOT), NUMBA_DISABLE_JIT="0" if config.DISABLE_JIT else "1")
    code = "from tests.analog_frontend import test_portable as t; print(t.digest())"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_compiled_interpreted_and_pinned_are_the_same_bits():
    """A change of the pin is a change of every seeded run: say in the changelog why."""
    mine = digest()
    assert other_mode() == mine
    assert mine == PINNED
