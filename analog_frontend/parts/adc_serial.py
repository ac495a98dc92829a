"""Digital side of the ADC: DRDY, and the conversion result bit by bit on DOUT (read data continuous mode).

    frame  = status (24 bits: 1100, 8 lead-off P, 8 lead-off N, 4 GPIO), then channel 1 .. 8 (24 bits, two's complement)
    a part with words of n bits sends the first n of each
    a new conversion (`loaded`) fills the result registers and DRDY_N falls; the first SCLK fall after it raises DRDY_N
    CS falls: the result is copied to the frame registers, so a conversion that ends during a read does not disturb it
    SCLK rises: DOUT = next bit, MSB first; after nine words zeros

One call of `step` per 26 MHz clock, with the pin values after the edge. Integers only.
A result that nobody read before the next: DRDY_N is high for PULSE clocks first (the part pulses before new data).

Status    a head other than 1100 is a fault of the interface (ok = 0); lead-off bits are none
Missing   registers, commands and power-up: the part is taken as configured and converting
Timing    TI SBAS459I, p. 32; TI SBAS499A, p. 8 (same interface)
Source    TI SBAS459I; TI SBAS499A
"""

from typing import NamedTuple

from fpga_model.jit import inlined

CHANNELS = 8
WORD_BITS = 24
WORDS = 1 + CHANNELS
WORD_MASK = (1 << WORD_BITS) - 1
MSB = WORD_BITS - 1
PULSE = 4


class State(NamedTuple):
    """Pins and registers; the defaults are the state at power-on."""

    cs_n: int = 1
    sclk: int = 0
    drdy_n: int = 1
    pulse: int = 0
    out: int = 0
    shift: int = 0
    left: int = 0
    word: int = 0
    result: tuple = (0,) * WORDS
    frame: tuple = (0,) * WORDS


def status_word(lead_off_p=0, lead_off_n=0, gpio=0):
    """The 24 status bits of a healthy interface: 1100, lead-off P and N of channel 8 .. 1, GPIO 4 .. 1."""
    for name, value, width in (("lead_off_p", lead_off_p, 8), ("lead_off_n", lead_off_n, 8), ("gpio", gpio, 4)):
        if not 0 <= value < 1 << width:
            raise ValueError(f"{name}: {value} does not fit {width} bits")
    return 0b1100 << 20 | lead_off_p << 12 | lead_off_n << 4 | gpio


@inlined
def frame_words(status, codes):
    """The nine words of a frame."""
    return (
        status & WORD_MASK,
        codes[0] & WORD_MASK,
        codes[1] & WORD_MASK,
        codes[2] & WORD_MASK,
        codes[3] & WORD_MASK,
        codes[4] & WORD_MASK,
        codes[5] & WORD_MASK,
        codes[6] & WORD_MASK,
        codes[7] & WORD_MASK,
    )


@inlined
def step(word_bits, s, cs_n, sclk, loaded, status, codes):
    """One 26 MHz clock: the pins as they are after its edge.

    word_bits  bits of a word on the line, 24 of an ADS1298
    loaded     1 in the clock in which a conversion ends; then `status` (24 bits) and `codes` (8 signed) are its result
    """
    drdy_n, pulse, out, shift, left, word = s.drdy_n, s.pulse, s.out, s.shift, s.left, s.word
    result, frame = s.result, s.frame
    if s.pulse != 0:
        pulse = s.pulse - 1
        if s.pulse == 1:
            drdy_n = 0
    if loaded == 1:
        result = frame_words(status, codes)
        if s.drdy_n == 0:
            drdy_n = 1
            pulse = PULSE
        elif s.pulse == 0:
            drdy_n = 0
    if cs_n != s.cs_n:
        out = 0
        shift = 0
        left = 0
        word = 0
        if cs_n == 0:
            frame = result
    elif cs_n == 0 and sclk != s.sclk:
        if sclk == 1:
            if s.left != 0:
                left = s.left - 1
            elif s.word != WORDS:
                shift = s.frame[s.word]
                left = word_bits - 1
                word = s.word + 1
            else:
                shift = 0
            out = (shift >> MSB) & 1
            shift = (shift << 1) & WORD_MASK
        elif loaded == 0 and s.pulse == 0:
            drdy_n = 1
    return State(
        cs_n=cs_n,
        sclk=sclk,
        drdy_n=drdy_n,
        pulse=pulse,
        out=out,
        shift=shift,
        left=left,
        word=word,
        result=result,
        frame=frame,
    )


@inlined
def dout(s):
    """The DOUT pin; 0 while CS is high (the part lets go of it)."""
    return s.out
