"""Script of the AXI4-Lite slave: requests in every order, responses that wait, each strobe and each bit within a word.

Source  fpga_model/axi_slave.py
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

    def drain_responses():
        w.append_row(times=DRAIN)

    def some(**given):
        """Random words, addresses of words, all strobes; and what is given."""
        values = w.some()
        for name in ("awaddr", "araddr"):
            values[name] &= ~axi_slave.WITHIN_WORD
        return {**values, "wstrb": axi_slave.EVERY_BYTE, **given}

    def write(**given):
        w.append_row(some(**writes, **given))
        w.append_row(some(), times=2)

    def read(**given):
        w.append_row(some(arvalid=1, **given))
        w.append_row(some())
        w.append_row(some())

    # every strobe at every place within a word, alone and while a read waits; each bit of an address
    for strobes, byte_offset in itertools.product(range(axi_slave.STROBES.hi + 1), range(axi_slave.WITHIN_WORD + 1)):
        write(wstrb=strobes, awaddr=4 * strobes + byte_offset)
        w.append_row(some(**writes, arvalid=1, wstrb=strobes, awaddr=byte_offset, araddr=byte_offset ^ 1))
        drain_responses()
    for k in range(axi_slave.ADDRESS.width):
        for value in (1 << k, axi_slave.ADDRESS.hi ^ 1 << k):
            write(awaddr=value)
            read(araddr=value)
    # two rows of every word of the flags in sequence, then drained; with a response that waits before them, and without
    for is_stalled, first, second in itertools.product((0, 1), EVENTS, EVENTS):
        if is_stalled:
            w.append_row(some(**writes, arvalid=1))
            w.append_row(some(bready=0, rready=0), times=2)
        w.append_row(some(**first))
        w.append_row(some(**second))
        w.append_row(some(bready=1, rready=1))
        if w.random.draw_integer(4) == 0:
            w.append_row(some(), rst=1)
    drain_responses()
    # responses that wait long, while the same kind and the other go on
    for ready in ({"bready": 0}, {"rready": 0}, {"bready": 0, "rready": 0}):
        for _ in range(6):
            w.append_row(some(**writes, arvalid=1, **ready))
        drain_responses()
    # a reset while each request and response waits
    for opened in ({"awvalid": 1}, {"wvalid": 1}, {"arvalid": 1}, {**writes, "arvalid": 1}):
        for rows in range(4):
            w.append_row(some(**opened, wstrb=6, bready=0, rready=0))
            w.append_row(some(bready=0, rready=0), times=rows)
            w.append_row(some(**opened), rst=1)
            w.append_row(some(), times=2)
    # a host with random wait states, busy to slow
    for busy in (1, 2, 3):
        for _ in range(WAITS):
            flags = {name: int(w.random.draw_integer(4) >= busy) for name in FLAGS}
            strobes = w.random.pick((axi_slave.EVERY_BYTE, axi_slave.EVERY_BYTE, 0, w.random.draw_integer(16)))
            w.append_row(some(**flags, wstrb=strobes))
