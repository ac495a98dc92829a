"""Closed-form window: the registers of blocks that need many clocks, after the slots of a window.

    rotate        the micro-rotations without a branch: the sign of y is not predictable
    root          floor of the root in double precision, exact below 2^52, instead of 16 trial subtractions
    close_loops   the four loops: errors, PI, output, frequency word; a PI at rest gives the same y at every edge
    scale_rate    the rate output until its stages are empty: 6 clocks, all others hold

Bit for bit what `step` gives, clock by clock: tests/testbench/engines/test_closed_form.py.
Source    fpga_model/cordic.py, fpga_model/isqrt.py, docs/decisions/0007-frame-engine.md
"""

import math

import numpy as np

from fpga_model import (
    agc,
    control,
    cordic,
    frequency_tracker,
    isqrt,
    quadrature_loop,
    rate_loop,
    rate_output,
    sequencer,
)
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import half_up, wrap
from fpga_model.jit import inner, outlined

ATAN = np.array(cordic.ATAN, np.int64)
SCALED_CLOCKS = rate_output.LATENCY
SIGN_BIT = 63
ACCUMULATOR_FRACTION = DEFAULT.accumulator_fraction_bits


@inner
def rotate(d, s, x_in, y_in):
    """A CORDIC at rest, some clocks after a start with this vector and at least two after its result."""
    flip = x_in >> SIGN_BIT
    guard = d.cordic_guard_bits
    x = ((x_in ^ flip) - flip) << guard
    y = ((y_in ^ flip) - flip) << guard
    angle = (cordic.HALF_TURN & flip) << guard
    for i in range(d.cordic_iterations):
        # all ones where y is negative: the sign of a sum without a branch
        back = y >> SIGN_BIT
        across, down, turn = half_up(y, i), half_up(x, i), half_up(ATAN[i], cordic.GUARD - guard)
        x = x + ((across ^ back) - back)
        y = y - ((down ^ back) - back)
        angle = angle + ((turn ^ back) - back)
    angle = wrap(angle, cordic.PHASE_BITS + guard)
    phase = wrap(half_up(angle, guard), cordic.PHASE_BITS)
    return cordic.State(
        x=x,
        y=y,
        angle=angle,
        i=cordic.ITERATIONS,
        busy=0,
        done=0,
        magnitude=half_up(x, guard),
        phase=0 if x == 0 else phase,
    )


@inner
def root(s):
    """The square root that has been started, after its result has come out."""
    u = s.radicand
    root = int(math.sqrt(float(u)))
    return isqrt.State(radicand=0, root=root, remainder=u - root * root, i=0, busy=0, done=0, y=root)


@inner
def scale_rate(p, s):
    """The rate output that has been given a word, after it has come through."""
    for _ in range(SCALED_CLOCKS):
        s = rate_output.step(p, s, 0, 0, 0)
    return s


@inner
def close_loops(d, p, s, i, bank):
    """Control at rest after SLOT_LOOPS .. SLOT_ROOT, and the frequency word after SLOT_PI.

    The default shifts of the accumulators are constants: as numbers of the record they cost 5 % of the frame engine.
    """
    if d.accumulator_fraction_bits == ACCUMULATOR_FRACTION:
        return _step_loops(d._replace(accumulator_fraction_bits=ACCUMULATOR_FRACTION), p, s, i, bank)
    return _step_loops_outlined(d, p, s, i, bank)


@outlined
def _step_loops_outlined(d, p, s, i, bank):
    return _step_loops(d, p, s, i, bank)


@inner
def _step_loops(d, p, s, i, bank):
    o = sequencer.outputs(s.sequencer)
    amplitude = bank.amplitude_fixed if o.fix_drive else 0
    rate = bank.rate_fixed if o.fix_ftr else 0
    quadrature = bank.quadrature_fixed if o.fix_qsc else 0
    magnitude, setpoint, phase = s.cordic.magnitude, bank.amplitude_setpoint, s.cordic.phase
    a, f, r, q = s.agc, s.frequency_tracker, s.rate_loop, s.quadrature_loop
    word = f.word
    # the edges of SLOT_LOOPS and SLOT_PI, and the one after them, which takes the PI's sum
    for at_loops, at_pi in ((1, 0), (0, 1), (0, 0)):
        a = agc.step(d, p.agc, a, at_loops, at_pi, o.agc_mode, magnitude, setpoint, amplitude)
        f = frequency_tracker.step(
            d,
            p.frequency_tracker,
            f,
            at_loops,
            at_pi,
            o.pll_mode,
            phase,
            o.load,
            o.adjust,
            s.sequencer.correction,
            bank.frequency_fixed,
        )
        word = f.word if at_pi else word
        r = rate_loop.step(d, p.rate_loop, r, at_loops, at_pi, o.ftr_mode, i.sense_sin, rate)
        q = quadrature_loop.step(d, p.quadrature_loop, q, at_loops, at_pi, 0, o.qsc_mode, i.sense_cos, quadrature)
    f = frequency_tracker.step(d, p.frequency_tracker, f, 0, 0, o.pll_mode, 0, o.load, o.adjust, 0, 0)
    q = quadrature_loop.step(d, p.quadrature_loop, q, 0, 0, 1, o.qsc_mode, 0, 0)
    n = control.step_notch(p.notch, s.notch, 1, r.loop.y)
    rate_word = control.rate_word(n, r.loop.y)
    out = rate_output.step(control.output_params(bank), s.rate_output, 1, rate_word, i.temperature)
    return s._replace(agc=a, frequency_tracker=f, rate_loop=r, quadrature_loop=q, rate_output=out, notch=n), word
