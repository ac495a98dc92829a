"""Clocks that the drive and the sense path have beyond the design's own, before and behind the modulator's sampling.

    before   registers between sine and modulator: the delay line of a path is deeper (`delay`)
    behind   a register each behind the product: code and load of a path come so many clocks later in every tick

The modulators of both paths sample in one clock, so registers before turn the sine only; those behind delay the
amplitude and the force word too. A design without such clocks has None in place of `Params`, and nothing of it is
compiled.

Source    docs/phases.md (clocks of a path)
"""

from typing import NamedTuple

from fpga_model import delay, rates, spi_dac
from fpga_model.design_record import DEFAULT
from fpga_model.jit import inlined, inner

TICK = rates.State.__annotations__["tick"]
MOST_CODE_DELAY_CLOCKS = 8


class Params(NamedTuple):
    """Delay lines of the paths, and the tick counts at which each makes and loads its code; build with `design`."""

    drive_pipe: delay.Params
    sense_pipe: delay.Params
    drive_code: TICK
    drive_load: TICK
    sense_code: TICK
    sense_load: TICK


def design(shared, clocks_before=(0, 0), clocks_after=(0, 0), d=DEFAULT):
    """`Params` of (drive, sense) clocks before and behind, or None where all are 0.

    shared  registers of both delay lines already
    d       the design record
    Raises ValueError for a line or a delay that is too long.
    """
    if not any((*clocks_before, *clocks_after)):
        return None
    for role, first, second in zip(("drive", "sense"), clocks_before, clocks_after, strict=True):
        if not 0 <= shared + first <= delay.MAX_DEPTH:
            keys = f"firmware.pipeline_registers + {role}_sine_registers"
            raise ValueError(f"{keys} = {shared + first} is outside 0 .. {delay.MAX_DEPTH}")
        most = min(MOST_CODE_DELAY_CLOCKS, d.tick_clocks - 1 - spi_dac.LOAD_TICK)
        if not 0 <= second <= most:
            raise ValueError(
                f"firmware.{role}_code_registers = {second} is outside 0 .. {most}, the clocks of a tick after the load"
            )
    pipes = [delay.design(shared + n) for n in clocks_before]
    return Params(*pipes, *(tick + n for n in clocks_after for tick in (spi_dac.CODE_TICK, spi_dac.LOAD_TICK)))


@inner
def pipes(pipe, paths):
    """Parameters of the delay lines of the drive and the sense sine."""
    if paths is None:
        return pipe, pipe
    return paths.drive_pipe, paths.sense_pipe


@inner
def codes(paths):
    """Tick counts at which the drive and the sense code are made."""
    if paths is None:
        return spi_dac.CODE_TICK, spi_dac.CODE_TICK
    return paths.drive_code, paths.sense_code


@inner
def loads(paths):
    """Tick counts at which the masters of drive and sense load a word."""
    if paths is None:
        return spi_dac.LOAD_TICK, spi_dac.LOAD_TICK
    return paths.drive_load, paths.sense_load


@inlined
def dac_clocks(f):
    """Clocks of a tick at which the outputs of the drive and the sense DAC are told to change; `f`: fpga.Params."""
    clocks, (drive, sense) = f.design.tick_clocks, loads(f.paths)
    drive += spi_dac.latch_cycles(f.drive_dac, clocks)
    sense += spi_dac.latch_cycles(f.sense_dac, clocks)
    # a latch of at most one tick, behind a load within one
    return drive - clocks if drive >= clocks else drive, sense - clocks if sense >= clocks else sense
