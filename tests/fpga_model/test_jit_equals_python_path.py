"""The 26 MHz path, DDS to DAC chips and ADC chip to channels: compiled and interpreted give the same registers.

The parent runs in the mode of the suite, the child in the other one. Interpreted kernels get Python integers, so that
an overflow of int64 shows as a difference instead of wrapping in both.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np

from analog_frontend.parts import adc_serial, dac_serial
from fpga_model import dds, delay, modulator, rates, references, sine, spi_adc, spi_dac
from fpga_model.design_record import DEFAULT
from fpga_model.jit import kernel
from testbench.flatten import names, store

ROOT = Path(__file__).resolve().parents[2]
CLOCKS = 1500
STATUS = adc_serial.status_word(0x12, 0x34, 0x5)


class Chain(NamedTuple):
    """Every block of the path once or more, and the chips at its ends."""

    rates: tuple
    dds: tuple
    sine: tuple
    pipe: tuple
    references: tuple
    drive: tuple
    sense: tuple
    drive_dac: tuple
    sense_dac: tuple
    quadrature_dac: tuple
    drive_chip: tuple
    sense_chip: tuple
    quadrature_chip: tuple
    adc: tuple
    adc_chip: tuple


class Parts(NamedTuple):
    """Parameters of the chain."""

    pipe: delay.Params
    references: references.Params
    drive: modulator.Params
    sense: modulator.Params


PARTS = Parts(delay.design(3), references.design(2), modulator.design(16), modulator.design(20, 1))
RESET = Chain(
    rates.State(),
    dds.State(),
    sine.State(),
    delay.State(),
    references.State(),
    modulator.State(),
    modulator.State(),
    spi_dac.State(),
    spi_dac.State(),
    spi_dac.State(),
    dac_serial.reset(dac_serial.DAC8811),
    dac_serial.reset(dac_serial.AD5791),
    dac_serial.reset(dac_serial.DAC82002),
    spi_adc.State(),
    adc_serial.State(),
)
WIDTH = len(names(RESET))


@kernel
def step(p, s, word, offset, amplitude, codes):
    """One clock of the chain."""
    r = s.rates
    load = rates.tick_enable(r, spi_dac.LOAD_TICK)
    at_code = rates.tick_enable(r, spi_dac.CODE_TICK)
    y = delay.out(p.pipe, s.pipe, s.sine.y)
    init = 1 if r.frame < 3 else 0
    drive_word = spi_dac.frame(spi_dac.DAC8811, modulator.out(p.drive, s.drive), init)
    sense_word = spi_dac.frame(spi_dac.AD5791, modulator.out(p.sense, s.sense), init)
    quadrature_word = spi_dac.frame(spi_dac.DAC82002, (amplitude >> 7) & 0xFFFF, init)
    a = spi_dac.step(spi_dac.DAC8811, s.drive_dac, load, drive_word)
    b = spi_dac.step(spi_dac.AD5791, s.sense_dac, load, sense_word)
    c = spi_dac.step(spi_dac.DAC82002, s.quadrature_dac, load & r.frame & 1, quadrature_word)
    adc = spi_adc.step(DEFAULT, s.adc, s.adc_chip.drdy_n, adc_serial.dout(s.adc_chip))
    loaded = 1 if (r.tick == 5 and r.frame == 1) or (r.tick == 9 and r.frame == 30) else 0
    return Chain(
        rates.step(DEFAULT, r, s.adc.valid),
        dds.step(DEFAULT, s.dds, word, offset, 0, 0, offset),
        sine.step(DEFAULT, sine.ROM, s.sine, s.dds.drive_sine),
        delay.step(p.pipe, s.pipe, s.sine.y),
        references.step(DEFAULT, p.references, s.references, s.dds.drive_ref, s.dds.sense_ref, rates.ce_1m(r)),
        modulator.step(p.drive, s.drive, rates.ce_1m(r), at_code, amplitude, y),
        modulator.step(p.sense, s.sense, rates.ce_1m(r), at_code, -amplitude, y),
        a,
        b,
        c,
        dac_serial.step(
            dac_serial.DAC8811, s.drive_chip, a.sync_n, a.sclk_en, spi_dac.sdin(spi_dac.DAC8811, a), a.ldac_n
        ),
        dac_serial.step(
            dac_serial.AD5791, s.sense_chip, b.sync_n, b.sclk_en, spi_dac.sdin(spi_dac.AD5791, b), b.ldac_n
        ),
        dac_serial.step(
            dac_serial.DAC82002, s.quadrature_chip, c.sync_n, c.sclk_en, spi_dac.sdin(spi_dac.DAC82002, c), c.ldac_n
        ),
        adc,
        adc_serial.step(DEFAULT.adc_word_bits, s.adc_chip, adc.cs_n, adc.sclk, loaded, STATUS, codes),
    )


@kernel
def trace(p, s, words, offsets, amplitudes, codes):
    """Every register before each edge."""
    rows = np.empty((len(words), WIDTH), np.int64)
    for n in range(len(words)):
        store(rows[n], s)
        s = step(p, s, int(words[n]), int(offsets[n]), int(amplitudes[n]), codes)
    return rows


def traces():
    """The trace as plain lists, from stimuli that are the same in every process."""
    rng = np.random.default_rng(26)
    words = np.repeat(rng.integers(0, 1 << 46, CLOCKS // 30), 30)
    offsets = np.repeat(rng.choice([0, 1, 1 << 47, (1 << 48) - 1, 123456789012345], CLOCKS // 50), 50)
    limits = modulator.AMPLITUDE
    amplitudes = np.repeat(rng.choice([limits.lo + 1, limits.hi, -1, 0, 1, 4_000_000], CLOCKS // 25), 25)
    codes = (-(1 << 23), (1 << 23) - 1, -1, 0, 1, -5_000_000, 5_000_000, 77)
    return trace(PARTS, RESET, words, offsets, amplitudes, codes).tolist()


def test_the_trace_goes_everywhere():
    rows = np.array(traces())
    registers = dict(zip(names(RESET), rows.T))
    still = {name for name, column in registers.items() if (column == column[0]).all()}
    assert still == {"drive_chip.ldac_n", "drive_dac.ldac_n", "drive_dac.ldac_wait"} | {
        f"quadrature_dac.{name}" for name in ("lead", "ldac_n", "ldac_wait")
    } | {
        "sense_dac.lead", "drive_chip.enabled", "quadrature_chip.enabled", "quadrature_chip.ldac_n", "adc.channels.3",
        "adc_chip.pulse", "adc_chip.result.4", "adc_chip.frame.4",
    }  # fmt: skip
    assert registers["adc.valid"].sum() == 2


def test_jit_equals_python():
    env = {**os.environ, "NUMBA_DISABLE_JIT": "0" if numba.config.DISABLE_JIT else "1"}
    run = subprocess.run([sys.executable, "-m", __spec__.name], cwd=ROOT, env=env, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    other = json.loads(run.stdout)
    assert other["jit"] == bool(numba.config.DISABLE_JIT), "the child must run in the other mode"
    mine = traces()
    assert len(mine) == len(other["rows"]) == CLOCKS
    for clock, (a, b) in enumerate(zip(mine, other["rows"])):
        different = {name: (x, y) for name, x, y in zip(names(RESET), a, b) if x != y}
        assert not different, f"clock {clock}: (this mode, other mode) {different}"


if __name__ == "__main__":
    print(json.dumps({"jit": not numba.config.DISABLE_JIT, "rows": traces()}))
