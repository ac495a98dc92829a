"""AXI4-Lite slave of the host: single words of 32 bits in the master clock, one write and one read under way.

    AWVALID, AWADDR --[awready, awaddr]--+--(turn)-- address, write, data --> bus       [..] register
    WVALID, WDATA, WSTRB --[wready ..]---'      '--> [bvalid, bresp]
    ARVALID, ARADDR --[arready, araddr]-----(turn)-- address, fetch --> bus --> word -->[rdata, rvalid, rresp]

A request that was taken waits in its registers, and its READY is 0 meanwhile. The bus has one address: a write whose
response has room goes first, a read that has room otherwise. `write`, `fetch`: the access at `address`, for one clock.
`done`: the word of a read was taken by the host.

Response  SLVERR, and no access, where the address is no multiple of 4 or some, but not all, strobes of a write are 1.
          OKAY otherwise; a write without a strobe is no access

Formats   wdata, rdata, word [0,32,0]   awaddr, araddr, address [0,11,0]   wstrb [0,4,0]   bresp, rresp [0,2,0]
          all others [0,1,0]
Latency   2 clocks from the edge that takes a request to the one that sees its response valid
Rounding  none
Overflow  none
Cost      99 register bits
Source    docs/host_port.md; ARM IHI 0022 (AXI4-Lite)
"""

from typing import NamedTuple

from fpga_model import spi_slave
from fpga_model.block import BIT, Block
from fpga_model.fixed import bits, formats
from fpga_model.jit import inlined

ADDRESS, WORD = spi_slave.ADDRESS, spi_slave.WORD
STROBES = bits(spi_slave.WORD_BYTES)
EVERY_BYTE = STROBES.hi
WITHIN_WORD = spi_slave.WORD_BYTES - 1  # bits of an address
RESPONSE = bits(2)
OKAY, SLVERR = 0, 2
LATENCY = 2


class State(NamedTuple):
    """The registers."""

    awready: BIT = 1
    awaddr: ADDRESS = 0
    wready: BIT = 1
    wdata: WORD = 0
    wstrb: STROBES = 0
    bvalid: BIT = 0
    bresp: RESPONSE = OKAY
    arready: BIT = 1
    araddr: ADDRESS = 0
    rvalid: BIT = 0
    rdata: WORD = 0
    rresp: RESPONSE = OKAY


STATE_FMT = formats(State)


@inlined
def writes(s):
    """Whether it is the turn of a write."""
    return 1 if s.awready == 0 and s.wready == 0 and s.bvalid == 0 else 0


@inlined
def reads(s):
    """Whether it is the turn of a read."""
    return 1 if s.arready == 0 and s.rvalid == 0 and writes(s) == 0 else 0


@inlined
def address(s):
    """Pin: byte address of the access."""
    return s.awaddr if writes(s) == 1 else s.araddr


@inlined
def write(s):
    """Pin: `wdata` belongs at `address`."""
    return 1 if writes(s) == 1 and s.awaddr & WITHIN_WORD == 0 and s.wstrb == EVERY_BYTE else 0


@inlined
def fetch(s):
    """Pin: the word at `address` is taken."""
    return 1 if reads(s) == 1 and s.araddr & WITHIN_WORD == 0 else 0


@inlined
def done(s, rready):
    """Pin: the host takes the word of a read."""
    return 1 if s.rvalid == 1 and rready == 1 else 0


@inlined
def step(s, awvalid, awaddr, wvalid, wdata, wstrb, bready, arvalid, araddr, rready, word):
    """One clock edge."""
    awready, wready, bvalid, bresp = s.awready, s.wready, s.bvalid, s.bresp
    takes_address = 1 if s.awready == 1 and awvalid == 1 else 0
    takes_data = 1 if s.wready == 1 and wvalid == 1 else 0
    if takes_address == 1:
        awready = 0
    if takes_data == 1:
        wready = 0
    if s.bvalid == 1 and bready == 1:
        bvalid = 0
    if writes(s) == 1:
        awready, wready, bvalid = 1, 1, 1
        is_full_word = s.awaddr & WITHIN_WORD == 0 and (s.wstrb == EVERY_BYTE or s.wstrb == 0)
        bresp = OKAY if is_full_word else SLVERR

    arready, rvalid, rdata, rresp = s.arready, s.rvalid, s.rdata, s.rresp
    takes_read = 1 if s.arready == 1 and arvalid == 1 else 0
    if takes_read == 1:
        arready = 0
    if s.rvalid == 1 and rready == 1:
        rvalid = 0
    if reads(s) == 1:
        arready, rvalid = 1, 1
        rdata, rresp = (word, OKAY) if s.araddr & WITHIN_WORD == 0 else (0, SLVERR)
    return State(
        awready,
        awaddr if takes_address == 1 else s.awaddr,
        wready,
        wdata if takes_data == 1 else s.wdata,
        wstrb if takes_data == 1 else s.wstrb,
        bvalid,
        bresp,
        arready,
        araddr if takes_read == 1 else s.araddr,
        rvalid,
        rdata,
        rresp,
    )


BLOCK = Block(
    place=196,
    inputs={
        "awvalid": BIT,
        "awaddr": ADDRESS,
        "wvalid": BIT,
        "wdata": WORD,
        "wstrb": STROBES,
        "bready": BIT,
        "arvalid": BIT,
        "araddr": ADDRESS,
        "rready": BIT,
        "word": WORD,
    },
    outputs={"address": ADDRESS, "write": BIT, "fetch": BIT, "done": BIT},
    latency={"bvalid": LATENCY, "rvalid": LATENCY, "address": 1, "write": 1, "fetch": 1, "done": 0},
    strobes=("awvalid", "wvalid", "arvalid"),
    idle={"bready": 1, "rready": 1},
    split=("awready", "wready", "bvalid", "arready", "rvalid"),
)
