"""Digital side of the three DACs: what the chip does with the bits on its pins, and when its output is told to change.

    in the middle of a clock with SYNC low and SCLK running:  shift = (shift << 1 | SDIN), count += 1
    SYNC falls: count = 0     SYNC rises: the word is staged if it is complete and addressed to the data register
    output latch = staged     when SYNC rises (no LDAC pin, or LDAC low), or when LDAC falls
    code = output latch, or 0 while the output is clamped to ground (AD5791 until its control register says otherwise)

One call of `step` per 26 MHz clock, with the pin values after the edge. Integers only.

DAC8811   CLK rise samples, any number of bits, the last 16 count; offset binary around a bipolar output stage, so the
          power-on zero scale is code -32768
AD5791    exactly 24 bits, address 001 data, 010 control; two's complement (BIN/2sC must stay 0); powers up with the
          output clamped and VREFN behind the clamp: a control write before the first data write puts -2**19 out
DAC82002  exactly 24 bits, register 08h is DAC-A, straight binary, zero at power-on (RSTSEL low)
generic   counts its bits exactly, takes frames that begin with its command, puts out 0 at power-on

Power-on  send the AD5791 data 0 before its control word, or -10 V is on the sense electrodes until data are latched
Missing   other registers and addresses, readback, CLR, daisy chains, offset-binary coding of the AD5791
Origin    timing of DAC8811 and AD5791 is from memory; AD5791 Rev. D, p. 24, and AD5781 Rev. D, p. 22 have the same map
Source    TI SLAS411D; ADI AD5791 Rev. D; ADI AD5781 Rev. D; TI SBASAK1A
"""

from typing import NamedTuple

from fpga_model.jit import inlined

# Of the 24 bits kept here the DAC8811 has only the last 16; the others ignore a frame that is longer
SHIFT_MASK = (1 << 24) - 1


class Params(NamedTuple):
    """One part; use DAC8811, AD5791 or DAC82002. By default 24 bits, straight binary, and 0 put out at power-on.

    The data stand `tail` bits above the frame's end.
    """

    address_mask: int
    address_value: int
    data_mask: int
    bits: int = 24
    exact: int = 1
    has_ldac: int = 0
    control_value: int = -1
    clamp_mask: int = 0
    flip: int = 0
    sign_bit: int = 0
    power_on_code: int = 0
    needs_control: int = 0
    tail: int = 0


class State(NamedTuple):
    """Pins seen last, shift register, and the two data registers; `reset(p)` is the state at power-on."""

    shift: int = 0
    count: int = 0
    sync_n: int = 1
    ldac_n: int = 1
    staged: int = 0
    latch: int = 0
    code: int = 0
    enabled: int = 0
    updated: int = 0


DAC8811 = Params(0, 0, 0xFFFF, bits=16, exact=0, flip=0x8000, sign_bit=0x8000, power_on_code=-32768)
AD5791 = Params(
    0xF << 20,
    0x1 << 20,
    0xFFFFF,
    has_ldac=1,
    control_value=0x2 << 20,
    clamp_mask=1 << 3 | 1 << 2,
    sign_bit=0x80000,
    power_on_code=-(1 << 19),
    needs_control=1,
)
DAC82002 = Params(0xFF << 16, 0x08 << 16, 0xFFFF)


def reset(p):
    """The state at power-on: registers at their power-on code, the output clamped to 0 where the part does that."""
    enabled = 0 if p.needs_control else 1
    return State(
        staged=p.power_on_code,
        latch=p.power_on_code,
        code=p.power_on_code if enabled else 0,
        enabled=enabled,
    )


@inlined
def decode_word(p, word):
    """The signed code in a word's data bits."""
    data = ((word >> p.tail) & p.data_mask) ^ p.flip
    return data - ((data & p.sign_bit) << 1)


@inlined
def step(p, s, sync_n, sclk_en, sdin, ldac_n):
    """One 26 MHz clock: the pins as they are after its edge."""
    shift, count, staged, latch, enabled = s.shift, s.count, s.staged, s.latch, s.enabled
    code = s.code
    updated = 0
    if sync_n != s.sync_n or ldac_n != s.ldac_n:
        if sync_n == 0 and s.sync_n == 1:
            count = 0
        elif sync_n == 1 and s.sync_n == 0 and (p.exact == 0 or s.count == p.bits):
            address_field = s.shift & p.address_mask
            if address_field == p.address_value:
                staged = decode_word(p, s.shift)
                if p.has_ldac == 0 or ldac_n == 0:
                    latch = staged
                    updated = 1
            elif address_field == p.control_value:
                enabled = 1 if s.shift & p.clamp_mask == 0 else 0
                updated = 1
        if p.has_ldac == 1 and ldac_n == 0 and s.ldac_n == 1:
            latch = staged
            updated = 1
        code = latch if enabled == 1 else 0
    if sync_n == 0 and sclk_en == 1:
        shift = ((s.shift << 1) | sdin) & SHIFT_MASK
        count += 1
    return State(
        shift=shift,
        count=count,
        sync_n=sync_n,
        ldac_n=ldac_n,
        staged=staged,
        latch=latch,
        code=code,
        enabled=enabled,
        updated=updated,
    )
