"""Script of the AXI4-Lite slave: requests in every order, responses that wait, each strobe and each bit within a word.

Source  docs/blocks/axi_slave.md
"""

import itertools

from fpga_model import axi_slave

FLAGS = ("awvalid", "wvalid", "bready", "arvalid", "rready")
EVENTS = tuple(dict(zip(FLAGS, bits, strict=True)) for bits in itertools.product((0, 1), repeat=len(FLAGS)))
DRAIN = 4  # rows in which every response is taken
WAITS = 400  # rows of a host with random wait states


def script_axi_slave(w):
    """Accesses come from a state with nothing under way, unless they are meant to meet."""
    writes = {"awvalid": 1, "wvalid": 1}

    def drained():
        w.row(times=DRAIN)

    def some(**given):
        """Random words, addresses of words, all strobes; and what is given."""
        values = w.some()
        for name in ("awaddr", "araddr"):
            values[name] &= ~axi_slave.WITHIN_WORD
        return {**values, "wstrb": axi_slave.EVERY_BYTE, **given}

    def write(**given):
        w.row(some(**writes, **given))
        w.row(some(), times=2)

    def read(**given):
        w.row(some(arvalid=1, **given))
        w.row(some())
        w.row(some())

    # every strobe at every place within a word, alone and while a read waits; each bit of an address
    for strobes, within in itertools.product(range(axi_slave.STROBES.hi + 1), range(axi_slave.WITHIN_WORD + 1)):
        write(wstrb=strobes, awaddr=4 * strobes + within)
        w.row(some(**writes, arvalid=1, wstrb=strobes, awaddr=within, araddr=within ^ 1))
        drained()
    for k in range(axi_slave.ADDRESS.width):
        for value in (1 << k, axi_slave.ADDRESS.hi ^ 1 << k):
            write(awaddr=value)
            read(araddr=value)
    # two rows of every word of the flags in sequence, then drained; with a response that waits before them, and without
    for held, first, second in itertools.product((0, 1), EVENTS, EVENTS):
        if held:
            w.row(some(**writes, arvalid=1))
            w.row(some(bready=0, rready=0), times=2)
        w.row(some(**first))
        w.row(some(**second))
        w.row(some(bready=1, rready=1))
        if w.random.below(4) == 0:
            w.row(some(), rst=1)
    drained()
    # responses that wait long, while the same kind and the other go on
    for ready in ({"bready": 0}, {"rready": 0}, {"bready": 0, "rready": 0}):
        for _ in range(6):
            w.row(some(**writes, arvalid=1, **ready))
        drained()
    # a reset while each request and response waits
    for opened in ({"awvalid": 1}, {"wvalid": 1}, {"arvalid": 1}, {**writes, "arvalid": 1}):
        for rows in range(4):
            w.row(some(**opened, wstrb=6, bready=0, rready=0))
            w.row(some(bready=0, rready=0), times=rows)
            w.row(some(**opened), rst=1)
            w.row(some(), times=2)
    # a host with random wait states, busy to slow
    for busy in (1, 2, 3):
        for _ in range(WAITS):
            flags = {name: int(w.random.below(4) >= busy) for name in FLAGS}
            strobes = w.random.pick((axi_slave.EVERY_BYTE, axi_slave.EVERY_BYTE, 0, w.random.below(16)))
            w.row(some(**flags, wstrb=strobes))
