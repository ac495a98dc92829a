"""What the firmware puts on its pins in a block of ticks, in closed form: DAC codes and reference edges.

    DAC codes        sine.phase_sine and modulator.dac_code of phase(26 k - pipeline), one per tick
    reference edges  one division per quarter turn; on the 1 MHz grid if they are re-timed

Source    docs/architecture.md, fpga_model/references.py, fpga_model/modulator.py
"""

from typing import NamedTuple

from analog_frontend import linear
from analog_frontend import top as plant
from analog_frontend.numeric.shapes import int64s, zeros
from fpga_model import modulator, path_clocks, sine, spi_dac
from fpga_model.design_record import DEFAULT
from fpga_model.fixed import wrap_unsigned
from fpga_model.jit import inner
from testbench.engines.turn import next_quarter, phase_at
from testbench.engines.window import HISTORY

SINE_CLOCKS = 1 + sine.LATENCY  # from the phase to the sine
REFERENCE_CLOCKS = 2  # from the phase to the pins
ROOM = linear.BLOCK + HISTORY


class Buffers(NamedTuple):
    """Scratch of a block: one place per tick, codes and loads with HISTORY places before it."""

    amplitude: int64s(ROOM)
    rate: int64s(ROOM)
    control_load: int64s(ROOM)
    drive: int64s(ROOM)
    sense: int64s(ROOM)
    refs: int64s(ROOM)  # the four pins before each tick's first edge
    sar: int64s(2, ROOM)
    edges: int64s(plant.MAX_EDGES * ROOM, 2)


def buffers():
    """Scratch of a run."""
    return zeros(Buffers)


@inner
def reference_edges(d, p, turn, bank, first, end, refs, b):
    """Reference edges of the pins in ticks `first` .. `end` - 1 (clocks from the first), and the pins after them."""
    delay, clocks = REFERENCE_CLOCKS + p.align, d.tick_clocks
    retimed = p.retimed
    # what the pins show before the first edge is the phase `delay` clocks before, or before the tick's first edge
    first_phase_clock = clocks * (first - 1 if retimed else first) - delay
    at_drive = next_quarter(turn, bank.phase_drive_ref, first_phase_clock)
    at_sense = next_quarter(turn, bank.phase_sense_ref, first_phase_clock)
    count = 0
    base, limit = clocks * first, clocks * end
    while True:
        sense = 1 if at_sense < at_drive else 0
        at = at_sense if sense else at_drive
        offset = bank.phase_sense_ref if sense else bank.phase_drive_ref
        if retimed:
            edge = (at + delay + clocks - 1) // clocks * clocks
        else:
            edge = at + delay - 1
        if edge >= limit:
            return count, refs
        quarter = wrap_unsigned(phase_at(turn, at) + offset, turn.bits) >> (turn.bits - 2)
        which = 2 * sense + (quarter & 1)
        edge_row = count
        if count > 0 and b.edges[count - 1, 0] == edge - base and b.edges[count - 1, 1] > which:
            # on one clock, in the order of the pins
            b.edges[count, 0], b.edges[count, 1] = b.edges[count - 1, 0], b.edges[count - 1, 1]
            edge_row = count - 1
        b.edges[edge_row, 0] = edge - base
        b.edges[edge_row, 1] = which
        count += 1
        refs = refs ^ (1 << which)
        following = next_quarter(turn, offset, at)
        if sense:
            at_sense = following
        else:
            at_drive = following


@inner
def dac_codes(p, rom, bank, turn, first, n, b):
    """Modulator codes of `n` ticks into b.drive and b.sense, after their history. Mutates `b`."""
    if sine.standard(p.design):
        # sizes and table as constants: only then LLVM computes eight ticks at a time
        _codes(DEFAULT, p, sine.ROM, bank, turn, first, n, b)
    else:
        _codes(p.design, p, rom, bank, turn, first, n, b)


@inner
def _codes(d, p, rom, bank, turn, first, n, b):
    (drive_pipe, sense_pipe), clocks = path_clocks.pipes(p.pipe, p.paths), p.design.tick_clocks
    drive_lag, sense_lag = SINE_CLOCKS + drive_pipe.depth, SINE_CLOCKS + sense_pipe.depth
    for k in range(n):
        phase = phase_at(turn, clocks * (first + k) - drive_lag)
        y = sine.phase_sine(d, rom, wrap_unsigned(phase + bank.phase_drive_sine, d.dds_bits))
        b.drive[HISTORY + k] = modulator.dac_code(p.drive_modulator, b.amplitude[k], y)
        phase = phase_at(turn, clocks * (first + k) - sense_lag)
        y = sine.phase_sine(d, rom, wrap_unsigned(phase + bank.phase_sense_sine, d.dds_bits))
        b.sense[HISTORY + k] = modulator.dac_code(p.sense_modulator, b.rate[k], y)


@inner
def words_of_ticks(p, drive_codes, sense_codes, n, enabled, staged, mixed, b):
    """What the DACs put out at the end of each tick; returns the sense DAC's output switch and its data register.

    A code is loaded in its own tick, or `frames` later; a DAC follows in the tick of its load, or in the next. A
    control word in place of a code only opens it. mixed: there are control words among the loads. Mutates its arrays.
    """
    drive_load, sense_load = path_clocks.loads(p.paths)
    sense_delay_ticks = spi_dac.update_delay_ticks(p.design, p.sense_dac, sense_load)
    first = HISTORY - p.drive_modulator.frames - spi_dac.update_delay_ticks(p.design, p.drive_dac, drive_load)
    drive, sense = b.drive[first:], b.sense[HISTORY - sense_delay_ticks - p.sense_modulator.frames :]
    for k in range(n):
        drive_codes[k] = drive[k]
        sense_codes[k] = sense[k]
    opened = p.sense_dac.control != 0  # by a control word
    if opened and (mixed or enabled == 0 or b.control_load[HISTORY - 1] * sense_delay_ticks == 1):
        for k in range(n):
            if b.control_load[HISTORY + k - sense_delay_ticks] == 1:
                enabled = 1
            else:
                staged = sense[k]
            sense_codes[k] = staged if enabled == 1 else 0
    else:
        staged = sense[n - 1]
    for k in range(HISTORY):
        b.drive[k], b.sense[k] = b.drive[n + k], b.sense[n + k]
        b.control_load[k] = b.control_load[n + k]
    return enabled, staged
