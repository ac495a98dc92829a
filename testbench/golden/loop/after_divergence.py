"""What a design does behind its first difference, without the plant: rows for a diagnosis.

    edge n    the converter answers the design's pins; the conversions of the last frames come again, a frame apart
    samples   the last ones stay, and the host writes no more

Source  docs/rtl.md (a design with the pins alone), docs/diagnosis.md (the whole design)
"""

from typing import NamedTuple

import numpy as np

from analog_frontend.parts import adc_serial
from fpga_model import top
from fpga_model.block import python_function
from testbench.golden.loop import library

FRAMES = 4
REPEATED = 8  # conversions that come again


class Continuation(NamedTuple):
    """Rows from the first that differs on: inputs of the edges, and registers and pins before them."""

    inputs: np.ndarray
    values: np.ndarray


def extend_stimulus(stimulus, row, record):
    """A `Stimulus` up to a row that goes on for FRAMES frames; `record` of the design."""
    last, clocks = stimulus.adc[-REPEATED:], record.frame_clocks
    if not len(last):
        return stimulus
    more = [last[k % len(last)].copy() for k in range(FRAMES + 1)]
    for k, conversion in enumerate(more):
        conversion[0] = last[-1, 0] + (k + 1) * clocks
    end = row + FRAMES * clocks
    return stimulus._replace(adc=np.concatenate([stimulus.adc, [c for c in more if row <= c[0] < end]]))


def simulate_continuation(design, chip, stimulus, row, record):
    """`Continuation` of a `library.Design` that stands before edge `row`, with the `adc_serial.State` of its converter.

    stimulus  `Stimulus`, repeated
    """
    count, step = FRAMES * record.frame_clocks, python_function(adc_serial.step)
    inputs, values = np.zeros((count, len(library.INPUTS)), np.int64), np.zeros((count, len(library.NAMES)), np.int64)
    conversions = {c[0]: c[1:] for c in stimulus.adc[stimulus.adc[:, 0] >= row].tolist()}
    none = (0,) * (1 + adc_serial.CHANNELS)
    samples = stimulus.sar if len(stimulus.sar) else np.zeros((1, 2), np.int64)
    before, host = stimulus.host[stimulus.host[:, 0] < row], {int(e[0]): e[2:] for e in stimulus.host}
    bus = before[-1, 2:] if len(before) else (0, 0)
    chip = adc_serial.State(*(tuple(map(int, item)) if isinstance(item, tuple) else int(item) for item in chip))
    for n in range(count):
        values[n] = design.read()
        bus = host.get(row + n, bus)
        sample = samples[min((row + n) // record.tick_clocks, len(samples) - 1)]
        inputs[n] = 0, chip.drdy_n, chip.out, *sample, row + n in host, *bus
        pins = top.Pins(*library.unpack_pin_rows(np.array([design.step(inputs[n])]))[0])
        status, *codes = conversions.get(row + n, none)
        lines = int(pins.adc_cs_n), int(pins.adc_sclk), int(row + n in conversions)
        chip = step(record.adc_word_bits, chip, *lines, status, tuple(codes))
    return Continuation(inputs, values)
